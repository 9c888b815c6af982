"""What the verbs do: `list` says what there is, `run stacks` measures it, prints it and writes it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from rich.console import Console
from rich.text import Text

import gpx_lcp as gpx
from benchmarks import machine, stacks
from benchmarks.charts import AXES, speed_accuracy
from benchmarks.engines import ENGINES, OWN
from benchmarks.interface import Engine, Setting
from benchmarks.pages import Pages
from benchmarks.rates import Rate, measure_rates
from benchmarks.report import moving_table, new_table, rate_table, ratio_table, reach_table, scene_table
from benchmarks.rows import Row, write_csv
from benchmarks.runner import Plan, rows_not_run, run_scene
from benchmarks.suites import SUITES

RATE_SCENES = ("tower-30", "wall-10")
RATE_REPEATS = 7

HEADINGS = {
    "cold": "Resting stacks, cold: the first step from touching rest",
    "stepped": "Resting stacks, settled: the last of the warm steps, where time sufficed for them",
    "swinging": "Towers while gravity swings by half of itself, five times a second",
}


@dataclass(frozen=True)
class Request:
    """What the command line asked for; None stands for all."""

    scenes: Sequence[str]
    solvers: frozenset[str] | None
    formulations: frozenset[str] | None
    engines: Sequence[str]
    repeats: int
    steps: int
    time_limit: float
    quick: bool
    out: Path
    picture: Path | None

    def wants(self, setting: Setting) -> bool:
        """Whether the setting passes the filters."""
        return (self.solvers is None or setting.solver in self.solvers) and (
            self.formulations is None or setting.formulation in self.formulations
        )


@dataclass
class Results:
    """What a run has measured so far, and the columns that say where."""

    where: Mapping[str, str]
    rows: list[Row] = field(default_factory=list)
    rates: list[Rate] = field(default_factory=list)
    interrupted: bool = False

    @property
    def errors(self) -> int:
        """How many rows ended in an error."""
        return sum(row.status == "error" for row in self.rows)


def run_stacks(request: Request, console: Console) -> Results | None:
    """Run the suite; write rows, rates, tables and charts to `request.out`, also when Ctrl-C cuts it short.

    Returns None, and says so, when nothing that was asked for can run.
    """
    installed = {name: ENGINES[name] for name in request.engines if ENGINES[name].version()}
    missing = [ENGINES[name] for name in request.engines if name not in installed]
    for engine in missing:
        console.print(f"[yellow]{engine.name} is missing and is left out.[/] {engine.install}")
    settings = [s for engine in installed.values() for s in engine.settings(request.quick) if request.wants(s)]
    if not settings:
        console.print("[red]nothing to run:[/] no installed engine has such a solver and formulation; see `list`.")
        return None
    results = Results(machine.describe())
    results.rows += [row for engine in missing for row in _missing_rows(request.scenes, engine, results.where)]
    pages = Pages(console)
    _measure(request, installed, settings, results, pages)
    charted, at_rest, moving = (
        _titles(request, wanted)
        for wanted in (lambda scene: scene.charted, lambda scene: scene.at_rest, lambda scene: not scene.at_rest)
    )
    if charted:
        pages.show(reach_table(charted, results.rows))
    if at_rest:
        pages.show(ratio_table(at_rest, results.rows))
    if moving:
        pages.show(moving_table(moving, results.rows))
    if results.rates:
        pages.show(rate_table(results.rates))
        write_csv(request.out / "rates.csv", Rate, results.rates, results.where)
    line = version_line(results)
    for text in (line, stacks.NOT_SHOWN):
        pages.show(Text(text, style="dim"))
    pages.write(request.out / "tables.txt")
    written = [request.out / "rows.csv", request.out / "tables.txt", *_draw(request, results, line)]
    console.print("written: " + ", ".join(str(path) for path in written))
    if results.interrupted:
        console.print("[yellow]stopped by Ctrl-C: rows that were not measured say so.[/]")
    return results


def _measure(
    request: Request,
    engines: Mapping[str, Engine],
    settings: Sequence[Setting],
    results: Results,
    pages: Pages,
) -> None:
    """Fill `results` scene by scene, showing and writing each as it is done; Ctrl-C ends it early."""
    plan = Plan(stacks.TIME_STEP, request.repeats, request.steps, request.time_limit)
    scenes = {name: stacks.SCENES[name].make() for name in request.scenes}
    runs = {name: [setting for setting in settings if stacks.SCENES[name].wants(setting)] for name in scenes}
    rate_scenes = [] if request.quick else [name for name in RATE_SCENES if name in scenes]
    total = sum(map(len, runs.values())) * plan.repeats + RATE_REPEATS * len(rate_scenes)
    done = 0

    def keep(measured: Sequence[Row]) -> None:
        results.rows += [replace(row, **results.where) for row in measured]
        write_csv(request.out / "rows.csv", Row, results.rows)

    with pages.progress(total) as advance:
        try:
            for name, scene in scenes.items():
                kind = stacks.SCENES[name]
                own_plan = replace(
                    plan,
                    time_limit=plan.time_limit * kind.patience,
                    gravity=kind.gravity(),
                    at_rest=kind.at_rest,
                )
                for measured in run_scene(name, scene, engines, runs[name], own_plan, advance):
                    done += 1
                    keep(measured)
                    pages.show(scene_table(kind.title, measured))
            for name in rate_scenes:
                results.rates += measure_rates(
                    name, scenes[name], engines, plan.time_step, RATE_REPEATS, request.wants, advance
                )
        except KeyboardInterrupt:
            results.interrupted = True
            for name, scene in list(scenes.items())[done:]:
                keep(rows_not_run(name, scene, engines, runs[name], plan))


def _draw(request: Request, results: Results, footer: str) -> list[Path]:
    """Draw a chart per case into the results, and the one for the README where it is asked for."""
    targets = [(name, request.out / f"speed-accuracy-{name}") for name in AXES]
    if request.picture is not None:
        suffixed = request.picture.suffix in (".png", ".svg")
        targets.append(("cold", request.picture.with_suffix("") if suffixed else request.picture))
    charted = _titles(request, lambda scene: scene.charted)
    swinging = _titles(request, lambda scene: scene.swings)
    return [
        path
        for name, stem in targets
        for path in speed_accuracy(
            results.rows, AXES[name], swinging if name == "swinging" else charted, HEADINGS[name], footer, stem
        )
    ]


def _titles(request: Request, wanted: Callable[[stacks.StackScene], bool]) -> dict[str, str]:
    """Return the titles of the scenes asked for that are of a kind, by name."""
    scenes = {name: stacks.SCENES[name] for name in request.scenes}
    return {name: scene.title for name, scene in scenes.items() if wanted(scene)}


def list_all(console: Console) -> None:
    """Print suites, scenes, engines and solvers, and the command that gets what is missing."""
    scenes = new_table("Suite stacks")
    scenes.add_column("scene")
    scenes.add_column("what it is")
    for name, scene in stacks.SCENES.items():
        scenes.add_row(name, scene.title)
    console.print(scenes)
    for suite in SUITES.values():
        table = new_table(f"Suite {suite.name}: {suite.summary}")
        table.add_column("scene")
        table.add_column("what it is")
        for name, text in suite.scenes().items():
            table.add_row(name, text)
        console.print(table)
    engines = new_table("Engines")
    for column in ("engine", "installed", "solvers", "how it is run, or how to get it"):
        engines.add_column(column)
    for engine in ENGINES.values():
        version = engine.version()
        engines.add_row(
            engine.name if engine.name == OWN else f"{engine.name} (peer)",
            version or "[red]missing[/]",
            ", ".join(dict.fromkeys(setting.solver for setting in engine.settings(quick=False))) if version else "",
            engine.note if version else engine.install,
        )
    console.print(engines)
    console.print("[bold]Solvers of gpx-lcp[/]")
    console.print(str(gpx.solvers()), markup=False)


def version_line(results: Results) -> str:
    """Return versions, processor and settings of the run in one line."""
    peers = dict.fromkeys(
        f"{row.engine} {row.engine_version or 'missing'}" for row in results.rows if row.engine != OWN
    )
    return machine.version_line(results.where, *peers, "dt = 1/240 s, sleeping off")


def _missing_rows(scenes: Sequence[str], engine: Engine, where: Mapping[str, str]) -> Iterator[Row]:
    """Yield one row per scene for an engine that is not installed, so that a missing peer is no hole in the results."""
    for scene in scenes:
        yield Row(
            suite=stacks.NAME,
            scene=scene,
            case="cold",
            bodies=0,
            engine=engine.name,
            engine_version="",
            solver="",
            formulation="",
            setting="",
            effort=0.0,
            time_step=stacks.TIME_STEP,
            status="missing",
            message=engine.install,
            **where,
        )
