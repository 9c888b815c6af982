"""`--scheduler`: the same batches on a Dask cluster, on this machine or elsewhere; rows come back as batches end.

A batch is one task: what is compared is measured side by side on one worker. A batch whose worker is lost runs again on
another; its rows are stored once, when they arrive. Workers must run one task at a time, or they would time each other.
"""

from __future__ import annotations

import pickle
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import gpx_lcp as gpx
from benchmarks.attempts import ERROR, Batch
from benchmarks.measuring import Measured, measure, not_measured

LOCAL = "local"
INSTALL = "pip install 'gpx-lcp[cluster]'"
# How often workers are looked for, and how long a cluster may be without one, s: a nanny starts another in less.
LOOK, PATIENCE = 1.0, 60.0


def measure_on(
    scheduler: str, batches: Sequence[Batch], advance: Callable[[str], None]
) -> Iterator[tuple[Batch, Measured]]:
    """Measure every batch on the cluster and yield each with what it gave, as they end.

    Parameters
    ----------
    scheduler : str
        "local", or the address of a scheduler, e.g. "tcp://10.0.0.1:8786".

    Raises
    ------
    SettingsError
        When there is no such scheduler, or a worker runs more than one task at a time.
    BackendMissing
        When distributed is not installed.
    """
    with connected(scheduler) as client:
        require_one_task_at_a_time(client)
        require_project(client)
        left = list(reversed(batches))
        running: dict[Any, Batch] = {}
        # No more than there are workers: Dask blames whatever waits on a worker that is lost, too.
        while left or running:
            while left and len(running) < max(1, len(_workers(client))):
                batch = left.pop()
                # As bytes: a worker that cannot unpack an object by itself is lost, and here it is the batch's error.
                running[client.submit(_measure, pickle.dumps(batch), pure=False)] = batch
            future = _first_done(client, running)
            batch = running.pop(future)
            _tell(batch, advance)
            if future.status == "finished":
                yield batch, future.result()
            else:
                error = future.exception()
                yield batch, _failed(batch, f"{type(error).__name__}: {error}")


def _first_done(client: Any, running: Mapping[Any, Batch]) -> Any:
    """Wait for the first of the batches to end.

    Raises
    ------
    BackendMissing
        When there has been no worker for a while.
    """
    distributed, there = _distributed(), time.monotonic()
    while True:
        try:
            return distributed.wait(list(running), timeout=LOOK, return_when="FIRST_COMPLETED").done.pop()
        except TimeoutError:
            there = time.monotonic() if _workers(client) else there
            if time.monotonic() - there > PATIENCE:
                raise gpx.BackendMissing(
                    f"--scheduler: the cluster has had no worker for {PATIENCE:g} s; what was measured is kept, and "
                    "--resume goes on"
                ) from None


def _tell(batch: Batch, advance: Callable[[str], None]) -> None:
    for attempt in batch.attempts:
        for _ in range(batch.repeats):
            advance(attempt.label)


@contextmanager
def connected(scheduler: str, workers: int | None = None) -> Iterator[Any]:
    """Connect to a cluster; "local" makes one of single-threaded processes, one for each core, and takes it down.

    Raises
    ------
    SettingsError
        When nothing answers at the address.
    BackendMissing
        When distributed is not installed.
    """
    distributed = _distributed()
    if scheduler == LOCAL:
        with (
            distributed.LocalCluster(
                n_workers=workers, threads_per_worker=1, processes=True, dashboard_address=":0"
            ) as cluster,
            distributed.Client(cluster) as client,
        ):
            yield client
        return
    try:
        client = distributed.Client(scheduler, timeout=10)
    except (OSError, ValueError, TimeoutError) as error:
        raise gpx.SettingsError(f"--scheduler is {scheduler}: no scheduler answers there ({error})") from error
    with client:
        yield client


def require_one_task_at_a_time(client: Any) -> None:
    """Raise SettingsError when a worker has several threads, and where there is no worker at all."""
    workers = _workers(client)
    if not workers:
        raise gpx.SettingsError("--scheduler: the cluster has no worker: start some, e.g. `dask worker ADDRESS`")
    for address, worker in workers.items():
        if worker["nthreads"] != 1:
            raise gpx.SettingsError(
                f"--scheduler: the worker {address} runs {worker['nthreads']} tasks at a time, which would time each "
                "other: start it with --nthreads 1"
            )


def require_project(client: Any) -> None:
    """Raise SettingsError when a worker cannot load this module: it would be lost with the first batch that it got."""
    # A lambda, which Dask sends as it is and not by its name.
    loaded = client.run(lambda: bool(__import__("benchmarks.cluster")), on_error="return")
    for address, answer in loaded.items():
        if isinstance(answer, Exception):
            raise gpx.SettingsError(
                f"--scheduler: the worker {address} cannot load the benchmarks ({answer}): start it in a checkout of "
                "this project"
            )


def _workers(client: Any) -> dict[str, Any]:
    workers: dict[str, Any] = client.scheduler_info(n_workers=-1)["workers"]
    return workers


def _measure(packed: bytes) -> Measured:
    """Measure a batch on a worker; one that has joined since with several threads takes no times."""
    batch = pickle.loads(packed)
    threads = _distributed().get_worker().state.nthreads
    if threads != 1:
        raise RuntimeError(f"this worker runs {threads} tasks at a time: start it with --nthreads 1")
    return measure(batch, lambda text: None)


def _failed(batch: Batch, message: str) -> Measured:
    """Return the rows of a batch that could not be measured."""
    return Measured([replace(row, status=ERROR, message=message) for row in not_measured(batch)], b"")


def _distributed() -> Any:
    try:
        import distributed
    except ImportError as error:
        raise gpx.BackendMissing(f"--scheduler needs dask.distributed: {INSTALL}") from error
    return distributed
