"""Tables of rows, for the terminal, the text beside the rows, and the report."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from rich import box
from rich.table import Table
from rich.text import Text

from benchmarks import ratios
from benchmarks.attempts import MISSING
from benchmarks.interface import scientific
from benchmarks.records import Record

BOUNDS = (1e-2, 1e-3, 1e-6, 1e-9)


def scene_table(title: str, rows: Sequence[Record]) -> Table:
    """Return one scene's table: a line per setting, the cold first step beside the warm steps."""
    table = new_table(title)
    table.add_column("engine, solver, program, setting", overflow="fold", min_width=36)
    for column in ("cold ms", "solve ms", "load err", "nat. map", "warm ms", "load err", "sunk µm", "drift µm"):
        table.add_column(column, justify="right", no_wrap=True)
    table.add_column("remark", style="yellow", overflow="fold", min_width=15)
    previous = ""
    for cold, stepped in _pairs(rows):
        if previous and cold.engine != previous:
            table.add_section()
        previous = cold.engine
        table.add_row(
            _label(cold),
            _ms(cold.step_ms),
            _ms(None if cold.solve_seconds is None else 1e3 * cold.solve_seconds),
            _error(cold.figure("load_error")),
            _error(cold.natural_map),
            _ms(stepped.step_ms),
            _error(stepped.figure("load_error")),
            _micro(stepped.figure("penetration"), ratios.PENETRATION_LIMIT),
            _micro(stepped.figure("drift"), ratios.DRIFT_LIMIT),
            _remark(cold, stepped),
        )
    return table


def reach_table(titles: Mapping[str, str], rows: Sequence[Record]) -> Table:
    """Return, for each scene and bound, the fastest gpx-lcp and the fastest peer whose cold load error is below it."""
    table = new_table("Fastest cold step, with friction, whose load error is below the bound at every cut, ms")
    table.add_column("scene")
    table.add_column("engine")
    for bound in BOUNDS:
        table.add_column(scientific(bound), justify="right")
    cold = [row for row in rows if row.case == "cold" and row.measured and not row.frictionless]
    for scene, title in titles.items():
        here = [row for row in cold if row.scene == scene]
        for engine in dict.fromkeys(row.engine for row in here):
            cells = [_fastest([row for row in here if row.engine == engine], bound) for bound in BOUNDS]
            table.add_row(title, engine, *cells)
    return table


def ratio_table(titles: Mapping[str, str], rows: Sequence[Record]) -> Table:
    """Return the fastest gpx-lcp against the fastest peer: settled steps by error bound, and the cold exact step."""
    table = new_table(
        "Fastest gpx-lcp / fastest peer, ms a step, settled, where loads and balance are right to the bound and "
        "nothing drifts or overlaps by 1 mm; cold: our first step exact to 1e-10 / pybullet's with 50 sweeps"
    )
    table.add_column("scene", overflow="fold")
    for bound in ratios.BOUNDS:
        table.add_column(f"≤ {scientific(bound)}", overflow="fold")
    table.add_column("cold", overflow="fold")
    for scene, title in titles.items():
        if not any(row.scene == scene and row.measured for row in rows):
            continue
        standing = [_ratio(ratios.standing(rows, scene, bound)) for bound in ratios.BOUNDS]
        table.add_row(title, *standing, _ratio(ratios.cold(rows, scene)))
    return table


def certified_table(titles: Mapping[str, str], rows: Sequence[Record]) -> Table:
    """Return, for large scenes, our fastest step that is no less accurate than pybullet's with 50 sweeps."""
    table = new_table(
        "Fastest gpx-lcp no less accurate (natural map) than pybullet with 50 sweeps / pybullet, ms a step"
    )
    for column in ("scene", "ratio", "natural map, gpx-lcp", "pybullet"):
        table.add_column(column)
    for scene, title in titles.items():
        for solver in (ratios.USUAL_SOLVER, ratios.SHIPPED_SOLVER):
            ratio = ratios.certified(rows, scene, solver)
            maps = ["" if row is None else _error(row.natural_map) for row in (ratio.own, ratio.peer)]
            if ratio.peer is not None:
                table.add_row(title, _ratio(ratio), *maps)
    return table


def rate_table(records: Iterable[Record]) -> Table:
    """Return the cost of a sweep per contact."""
    table = new_table("Cost of a sweep, ns per contact")
    for column in ("scene", "engine", "solver", "program"):
        table.add_column(column)
    for column in ("contacts", "median", "fastest repeat"):
        table.add_column(column, justify="right")
    for record in records:
        costs = [
            "" if seconds is None else f"{1e9 * seconds:.1f}"
            for seconds in (record.step_seconds, record.step_seconds_low)
        ]
        table.add_row(record.scene, *record.line, str(record.contacts), *costs)
    return table


def missing_notes(records: Iterable[Record]) -> list[Text]:
    """Return a line for each engine that is missing: how to get it."""
    gone = {record.engine: record.message for record in records if record.status == MISSING}
    return [Text(f"{name} is missing. {install}", style="yellow") for name, install in gone.items()]


def new_table(title: str) -> Table:
    """Return an empty table in the house style."""
    return Table(title=title, title_justify="left", title_style="bold", box=box.SIMPLE_HEAD, pad_edge=False)


def _pairs(rows: Sequence[Record]) -> Iterable[tuple[Record, Record]]:
    """Return the cold and the stepped row of each setting."""
    stepped = {(row.line, row.setting): row for row in rows if row.case == "stepped"}
    return ((row, stepped[row.line, row.setting]) for row in rows if row.case == "cold")


def _label(record: Record) -> str:
    """Return who ran, and with which setting; a missing engine has none."""
    return f"{record.engine} {record.solver} {record.formulation}, {record.setting}" if record.solver else record.engine


def _fastest(rows: Sequence[Record], bound: float) -> str:
    reached = [row for row in rows if (error := row.figure("load_error")) is not None and error <= bound]
    if not reached:
        return "never"
    best = min(reached, key=lambda row: float(row.step_ms or 0.0))
    return f"{_ms(best.step_ms)} {best.solver}"


def _ratio(ratio: ratios.Ratio) -> Text:
    """Return the quotient, then whose time over whose."""
    own = "we do not" if ratio.own is None else f"{_ms(ratio.own.step_ms)} {ratio.own.solver}"
    if ratio.peer is None:
        late = f" ({ratio.unfinished} not in time)" if ratio.unfinished else ""
        return Text(f"nobody{late}: {own}")
    peer = f"{_ms(ratio.peer.step_ms)} {ratio.peer.engine} {ratio.peer.solver}"
    value = ratio.value
    return Text.assemble(("" if value is None else f"{value:.2f}  ", "bold"), f"{own} / {peer}")


def _remark(cold: Record, stepped: Record) -> str:
    """Return the statuses where they are not plain success, and every fallback and message."""
    parts = [] if cold.status in ("ran", "solved") else [cold.status]
    if stepped.status not in ("ran", "solved", cold.status):
        parts.append(f"warm: {stepped.status}" if stepped.measured else stepped.status)
    parts.extend(f"fell back to {name}" for name in dict.fromkeys((cold.fallbacks, stepped.fallbacks)) if name)
    parts.extend(message for message in dict.fromkeys((cold.message, stepped.message)) if message)
    return "; ".join(parts)


def _ms(value: float | None) -> str:
    return "" if value is None else f"{value:.3g}"


def _error(value: float | None) -> str:
    return "" if value is None else f"{value:.1e}"


def _micro(value: float | None, limit: float) -> Text:
    """Return a length in µm, in red beyond the limit."""
    return Text(
        "" if value is None else f"{1e6 * value:.3g}", style="red" if value is not None and value > limit else ""
    )
