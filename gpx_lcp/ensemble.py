"""Thousands of scenes at once: every combination of seeds and parameters, solved or simulated, as one table."""

from __future__ import annotations

import itertools
import os
import pickle
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from multiprocessing import get_context
from typing import Any, Final, TypeAlias

import numpy as np
import numpy.typing as npt

from formulations import StackedSystem
from gpx_lcp.errors import BackendError, BackendMissing, SettingsError
from gpx_lcp.scene import Scene
from gpx_lcp.solution import Solution
from gpx_lcp.solve import solve
from gpx_lcp.world import World

# A value of a parameter, or a figure of a member.
Value: TypeAlias = float | int | bool | str
Table: TypeAlias = dict[str, npt.NDArray[Any]]

# The columns that are there whatever is asked, with what they hold where a member has failed.
COLUMNS: Final[Mapping[str, Value]] = {
    "status": "error",
    "message": "",
    "method": "",
    "contacts": -1,
    "iterations": -1,
    "natural_map": float("nan"),
    "setup_seconds": float("nan"),
    "solve_seconds": float("nan"),
    "unsolved_steps": -1,
}

# A process takes so many batches of members: few enough to cost nothing, enough that none waits long for the last.
BATCHES_PER_WORKER: Final = 8


def ensemble(
    make: Callable[..., Scene | StackedSystem],
    parameters: Mapping[str, Iterable[Value]],
    *,
    steps: int = 0,
    time_step: float = 1 / 240,
    observe: Callable[[World | Solution], Mapping[str, Value]] | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    **settings: Any,
) -> Table:
    """Solve or simulate every combination of the parameters, in processes or on a cluster.

    Parameters
    ----------
    make : callable
        Takes one value of each parameter, by name, and returns a Scene or a StackedSystem, e.g. `scenes.sphere_pile`.
    parameters : mapping of str to iterable
        The values of each; a seed is a parameter like others. Members are their product, the last one changing fastest.
    steps : int
        Time steps of each scene; with 0 its first system is solved, from nothing.
    time_step : float, s
    observe : callable, optional
        Takes the World after its steps, or the Solution where `steps` is 0, and returns further columns by name.
    workers : int, optional
        Processes; one for each core unless given. With 1, everything runs in this one.
    scheduler : str, optional
        Run on a Dask cluster instead: "local", or the address of a scheduler.
    **settings
        As of `gpx.solve`, or of `World` where `steps` is above 0: solver, formulation, tolerance, ...

    Returns
    -------
    dict of str to (members,) array
        The parameters; status, message, method, contacts, iterations, natural_map, setup_seconds and solve_seconds of
        the solution (of the last step), unsolved_steps; and what `observe` gives. A member that raises an exception has
        the status "error", a message, and NaN for the numbers that are missing (-1 for counts). Nothing but the
        seconds depends on workers or scheduler. `pandas.DataFrame` and `pyarrow.table` take it as it is.

    Raises
    ------
    SettingsError
        When a setting is not what is needed, or a function cannot be sent to another process.
    BackendMissing
        When a scheduler is named and distributed is not installed.
    BackendError
        When a process was killed.

    Examples
    --------
    >>> table = ensemble(scenes.incline, {"angle": [0.1, 0.6], "friction": [0.5]})
    >>> table["angle"], table["status"]
    (array([0.1, 0.6]), array(['solved', 'solved'], dtype='<U6'))
    """
    values = {name: list(given) for name, given in parameters.items()}
    taken = sorted(set(values) & set(COLUMNS))
    if taken:
        raise SettingsError(f"parameters has the name {taken[0]!r}, which is a column of the table: call it otherwise")
    if isinstance(steps, bool) or not isinstance(steps, int) or steps < 0:
        raise SettingsError(f"steps is {steps!r}: it must be a whole number, not negative")
    count = os.cpu_count() or 1 if workers is None else workers
    if isinstance(count, bool) or not isinstance(count, int) or count < 1:
        raise SettingsError(f"workers is {workers!r}: it must be a whole number of at least 1")
    members = [dict(zip(values, chosen, strict=True)) for chosen in itertools.product(*values.values())]
    task = _Task(make, steps, time_step, observe, settings)
    rows = [row for batch in _run(task, members, count, scheduler) for row in batch]
    return _table(values, members, rows)


@dataclass(frozen=True)
class _Task:
    """What is done with every member."""

    make: Callable[..., Scene | StackedSystem]
    steps: int
    time_step: float
    observe: Callable[[World | Solution], Mapping[str, Value]] | None
    settings: Mapping[str, Any]

    def __call__(self, members: Sequence[Mapping[str, Value]]) -> list[dict[str, Value]]:
        return [self._row(member) for member in members]

    def _row(self, member: Mapping[str, Value]) -> dict[str, Value]:
        try:
            return self._found(self.make(**member))
        except SettingsError:
            # It is wrong for every member: nothing that a table should repeat.
            raise
        except Exception as error:
            return {"status": "error", "message": f"{type(error).__name__}: {error}"}

    def _found(self, made: Scene | StackedSystem) -> dict[str, Value]:
        seen: World | Solution
        if isinstance(made, StackedSystem):
            if self.steps:
                raise SettingsError(f"steps is {self.steps}: make returns a StackedSystem, which has no time")
            seen = solution = solve(made, **self.settings)
            unsolved = 0
        elif not isinstance(made, Scene):
            raise SettingsError(f"make returns a {type(made).__name__}: a Scene or a StackedSystem is needed")
        elif self.steps:
            seen = world = World(made, self.time_step, **self.settings)
            world.step(self.steps)
            assert world.solution is not None  # there was a step
            solution, unsolved = world.solution, world.unsolved_steps
        else:
            seen = solution = solve(World(made, self.time_step).system(), **self.settings)
            unsolved = 0
        row: dict[str, Value] = {
            "status": solution.status.name.lower(),
            "message": "",
            "method": solution.method,
            "contacts": solution.system.contacts,
            "iterations": solution.iterations,
            "natural_map": solution.certificate.natural_map,
            "setup_seconds": solution.setup_seconds,
            "solve_seconds": solution.solve_seconds,
            "unsolved_steps": unsolved if self.steps else int(solution.status.name != "SOLVED"),
        }
        observed = dict(self.observe(seen)) if self.observe else {}
        for name in observed:
            if name in row:
                raise SettingsError(f"observe returns {name!r}, which is a column of the table: call it otherwise")
        return row | observed


def _run(
    task: _Task, members: Sequence[Mapping[str, Value]], count: int, scheduler: str | None
) -> Iterator[list[dict[str, Value]]]:
    """Yield the rows of batches of members, in order."""
    if scheduler is None and count == 1:
        yield task(members)
        return
    size = max(1, -(-len(members) // (BATCHES_PER_WORKER * count)))
    batches = [members[first : first + size] for first in range(0, len(members), size)]
    packed = [_packed(task)] * len(batches)
    if scheduler is not None:
        with _client(scheduler) as client:
            yield from client.gather(client.map(_unpack_and_run, packed, batches, pure=False))
        return
    # Spawned, not forked: a fork copies locks that other threads hold.
    with ProcessPoolExecutor(min(count, len(batches) or 1), mp_context=get_context("spawn")) as pool:
        try:
            yield from pool.map(_unpack_and_run, packed, batches)
        except BrokenProcessPool as error:
            raise BackendError("a process of the ensemble was killed: is there memory for so many workers?") from error


@contextmanager
def _client(scheduler: str) -> Iterator[Any]:
    """Connect to a Dask cluster."""
    try:
        distributed: Any = import_module("distributed")
    except ImportError as error:
        raise BackendMissing("scheduler needs dask.distributed: pip install 'gpx-lcp[cluster]'") from error
    if scheduler == "local":
        with (
            distributed.LocalCluster(threads_per_worker=1, processes=True, dashboard_address=":0") as cluster,
            distributed.Client(cluster) as client,
        ):
            yield client
        return
    try:
        client = distributed.Client(scheduler, timeout=10)
    except (OSError, ValueError, TimeoutError) as error:
        raise SettingsError(f"scheduler is {scheduler!r}: no scheduler answers there ({error})") from error
    with client:
        yield client


def _packed(task: _Task) -> bytes:
    for name, value in (("make", task.make), ("observe", task.observe), ("settings", task.settings)):
        try:
            pickle.dumps(value)
        except Exception as error:
            raise SettingsError(
                f"{name} cannot be sent to a process ({error}): define it at the top of a module, or set workers=1"
            ) from error
    return pickle.dumps(task)


def _unpack_and_run(packed: bytes, members: Sequence[Mapping[str, Value]]) -> list[dict[str, Value]]:
    """Run a task in another process, to which it comes as bytes: one that cannot be unpacked is an error of its own.

    A worker of Dask that cannot unpack an object by itself is lost with its connection, and never heard of again.
    """
    try:
        task: _Task = pickle.loads(packed)
    except Exception as error:
        raise SettingsError(
            f"make or observe cannot be loaded in the process that is to run it ({error}): define it in a module that "
            "is there, too, or set workers=1"
        ) from error
    return task(members)


def _table(
    values: Mapping[str, Sequence[Value]],
    members: Sequence[Mapping[str, Value]],
    rows: Sequence[Mapping[str, Value]],
) -> Table:
    table: Table = {name: np.array([member[name] for member in members]) for name in values}
    observed = dict.fromkeys(name for row in rows for name in row if name not in COLUMNS)
    for name in values:
        if name in observed:
            raise SettingsError(f"observe returns {name!r}, which is a parameter: call it otherwise")
    for name, missing in COLUMNS.items():
        table[name] = np.array([row.get(name, missing) for row in rows], dtype=None if rows else np.float64)
    for name in observed:
        kind = next(type(row[name]) for row in rows if name in row)
        table[name] = np.array([row.get(name, "" if kind is str else np.nan) for row in rows])
    return table
