"""Shards as tasks of a dask.distributed cluster: a local one, or one that stands already."""

import contextlib
import importlib
import logging
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from drift.case.record import Case
from drift.motion.clock import Clock
from drift.particles.ensemble import Layout
from drift.shards import machine, worker
from drift.shards.divide import Begun
from drift.shards.work import Task, Work
from geo.errors import UserError

PATIENCE = 20  # [s] to wait for a cluster to answer


@contextlib.contextmanager
def connected(workers: int | None, address: str | None) -> Iterator[Any]:
    """Give a client of a local cluster of some workers, or of the one at an address; None where neither is asked for.

    Raises UserError where there is none, or dask.distributed is not installed.
    """
    if workers is None and address is None:
        yield None
        return
    if workers is not None and address is not None:
        raise UserError("--workers and --cluster: give one of them")
    if workers is not None and workers < 1:
        raise UserError(f"--workers {workers} must be at least 1")
    distributed = _dask()
    with contextlib.ExitStack() as stack:
        log = logging.getLogger("distributed")  # what goes wrong is told in a line
        stack.callback(log.setLevel, log.level)
        log.setLevel(logging.CRITICAL)
        if workers is not None:
            local = distributed.LocalCluster(
                n_workers=workers,
                threads_per_worker=1,
                memory_limit=0,
                dashboard_address="127.0.0.1:0",
                silence_logs=50,
            )
            address = stack.enter_context(local)
        try:
            client = stack.enter_context(distributed.Client(address, timeout=PATIENCE, set_as_default=False))
        except (OSError, TimeoutError, ValueError) as error:
            raise UserError(f"--cluster {address}: no cluster answers there ({_line(error)})") from error
        yield client


def _dask() -> Any:
    """Return the package dask.distributed, which is slow to import, and not installed by default."""
    try:
        return importlib.import_module("distributed")
    except ImportError:
        raise UserError("--workers and --cluster need dask: pip install 'casp-drift[cluster]'") from None


def workers_of(client: Any) -> int:
    """Return how many workers a cluster has."""
    return len(client.nthreads())


def check(client: Any, folder: Path | None = None) -> None:
    """Refuse workers of other versions or arithmetic than this process's, and those that do not see the run's folder.

    Threads of this process are refused too: they would wait for the kernels, which it holds, for ever.
    """
    if worker.process() in client.run(worker.process).values():
        raise UserError("the cluster's workers are threads of this process; begin it with processes=True")
    own = {**machine.versions(), "its arithmetic": machine.arithmetic()}
    found = client.run(worker.about, str(folder or ""))
    if not found:
        raise UserError("the cluster has no workers; start some")
    for address, other in sorted(found.items()):
        if other.pop("folder") != "True":
            raise UserError(
                f"worker {address} does not see {folder}: name a folder with --out that all machines of the cluster share"
            )
        if differs := [name for name in own if own[name] != other.get(name)]:
            raise UserError(
                f"worker {address}: {differs[0]} is {other.get(differs[0])}, here it is {own[differs[0]]}: results would not be "
                "the same everywhere; install the same versions, and use machines of one kind"
            )


def moved(client: Any, kept: Work, units: Sequence[Task], tell: Callable[[float], None]) -> None:
    """Have the workers move shards, which they keep in the run's folder; tell: takes how many are done.

    A worker that is lost costs the shards under way on it, which others do again. Raises UserError where the cluster is
    lost, or a shard fails on one worker after another.
    """
    if not units:
        return
    check(client, kept.folder)
    tasks = [client.submit(worker.move, str(kept.folder), unit, pure=False, retries=0) for unit in units]
    for done, task in enumerate(_each(client, tasks, lambda: f"{kept.folder}: {kept.kept}"), 1):
        kept.sound.add(task.result())  # the worker has just taken its digest
        tell(done)


def begun(client: Any, case: Case, clock: Clock, layouts: Sequence[Layout]) -> list[Begun]:
    """Have the workers say how the places of shards were drawn, and what of them lacks forcing as the run begins."""
    check(client)
    tasks = [client.submit(worker.begun, case, clock, layout, pure=False, retries=0) for layout in layouts]
    found = {task.key: task.result() for task in _each(client, tasks, lambda: "nothing is kept yet")}
    return [found[task.key] for task in tasks]


def _each(client: Any, tasks: Sequence[Any], kept: Callable[[], str]) -> Iterator[Any]:
    """Yield tasks as they are done; kept: what is kept of the run where the cluster is lost, in words."""
    distributed = _dask()
    try:
        for task in distributed.as_completed(tasks, loop=client.loop):
            if task.status == "error":
                raise task.exception()
            if task.status != "finished":
                raise UserError(f"the cluster is lost (a shard is {task.status}); {kept()}")
            yield task
    except distributed.KilledWorker as error:
        raise UserError(f"worker after worker died of a shard ({_line(error)}); {kept()}") from error
    finally:
        with contextlib.suppress(Exception):  # of a scheduler that is gone
            client.cancel(tasks)


def _line(error: BaseException) -> str:
    return (str(error).strip().splitlines() or [type(error).__name__])[0]
