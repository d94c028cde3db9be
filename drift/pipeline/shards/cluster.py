"""Shards as tasks of a dask.distributed cluster: a local one, or one that stands already."""

import asyncio
import contextlib
import importlib
import logging
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import CancelledError, wait
from pathlib import Path
from typing import Any

from drift.case.record import Case
from drift.engine.motion.clock import Clock
from drift.engine.particles.ensemble import Layout
from drift.pipeline.shards import fingerprint, worker
from drift.pipeline.shards.divide import Begun, Workers
from drift.pipeline.shards.work import Task, Work
from geo.errors import UserError

PATIENCE = 20  # [s] to wait for a cluster to answer
# [s] to wait for a first worker, or for another where all are lost: queues take their time
WAIT = 900
LOOK, POLL = 10, 0.05  # [s] between looks whether there are workers, and whether a shard is done
# warnings come to standard error unless a program sends them elsewhere
LOG = logging.getLogger("drift")


@contextlib.contextmanager
def connected(workers: int | None, address: str | None) -> Iterator[Any]:
    """Give a client of a local cluster of some workers, or of the one at an address; None where
    neither is asked for.

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
        for name in [
            name for name in logging.root.manager.loggerDict if name.split(".")[0] == "distributed"
        ]:
            log = logging.getLogger(name)  # what goes wrong is told in a line
            stack.callback(log.setLevel, log.level)
            log.setLevel(logging.CRITICAL)
        if workers is not None:
            address = distributed.LocalCluster(
                n_workers=workers,
                local_directory=stack.enter_context(
                    tempfile.TemporaryDirectory(prefix="drift-", ignore_cleanup_errors=True)
                ),
                threads_per_worker=1,
                memory_limit=0,
                dashboard_address="127.0.0.1:0",
                silence_logs=50,
            )
            stack.callback(_close, address)
        try:
            if workers is None and not str(address).startswith("ucx"):
                # a client of no address would close for a minute
                distributed.comm.get_address_host_port(address)
            client = stack.enter_context(
                distributed.Client(address, timeout=PATIENCE, set_as_default=False)
            )
        except (TimeoutError, OSError, ValueError) as error:
            raise UserError(
                f"--cluster {address}: no cluster answers there ({_line(error)})"
            ) from error
        yield client


def _close(local: Any) -> None:
    """End a local cluster; what does not end in time does so with this process, whose results are
    written by now.
    """
    with contextlib.suppress(Exception):
        local.close(timeout=PATIENCE)


def _dask() -> Any:
    """Return the package dask.distributed, which is slow to import, and not installed by default."""
    try:
        return importlib.import_module("distributed")
    except ImportError:
        raise UserError(
            "--workers and --cluster need dask: pip install 'casp-drift[cluster]'"
        ) from None


def workers_of(client: Any) -> Workers:
    """Return the workers of a cluster, once it has any: jobs of a queue take their time to begin.

    Raises UserError where none comes.
    """
    with _answered(lambda: "nothing is kept yet"):
        status = getattr(client, "status", f"no dask.distributed.Client ({client!r})")
        if status != "running":
            raise UserError(f"the client is {status}; give one that is open")
        if not client.nthreads():
            LOG.warning("the cluster has no workers yet; the first is waited for")
        until = time.monotonic() + WAIT
        told: dict[str, tuple[str, float, float]] = {}
        while not told:  # the only one may be lost while it is asked
            if time.monotonic() > until:
                raise UserError(
                    f"the cluster's workers are lost one after another (waited {WAIT / 60:g} min)"
                )
            _first(client, "the cluster has no workers; start some")
            told = _asked(client, worker.room)
    hosts = Counter(host for host, _, _ in told.values()) + Counter([worker.host()])
    together = max(hosts[host] for host, _, _ in told.values())
    free = min(free / hosts[host] for host, free, _ in told.values())
    return Workers(len(told), together, free, min(limit for _, _, limit in told.values()))


def _asked(client: Any, function: Callable[..., Any], *given: Any) -> dict[str, Any]:
    """Return what all workers answer, by address, but those that are lost meanwhile."""
    told, lost = {}, (_dask().comm.CommClosedError, ConnectionError, TimeoutError)
    # client.run would wait for ever for a machine that hangs.
    answers = client.sync(client._run, function, *given, on_error="return", callback_timeout=WAIT)
    for address, answer in answers.items():
        if isinstance(answer, lost) or (type(answer) is OSError and answer.errno is None):
            continue  # nobody answers there: what it had to do others do
        if isinstance(answer, Exception):
            raise UserError(
                f"worker {address}: {_line(answer)}; install the same versions everywhere"
            ) from answer
        told[address] = answer
    return told


def check(client: Any, folder: Path | None = None) -> None:
    """Refuse workers of other versions or arithmetic than this process's, and those that do not see
    the run's folder.

    Threads of this process are refused too: they would wait for the kernels, which it holds, for
    ever.
    """
    if worker.process() in _asked(client, worker.process).values():
        raise UserError(
            "the cluster's workers are threads of this process; begin it with processes=True"
        )
    own = fingerprint.of_machine()
    for address, other in sorted(
        _asked(client, worker.about, str(folder.absolute()) if folder else "").items()
    ):
        if other.pop("folder") != "True":
            raise UserError(
                f"worker {address} does not see {folder}: name a folder with --out that all machines of the cluster share"
            )
        if differs := [name for name in own if own[name] != other.get(name)]:
            raise UserError(
                f"worker {address}: {differs[0]}: {other.get(differs[0])}; here: {own[differs[0]]}: results would not be "
                "the same everywhere; install the same versions, and use machines of one kind"
            )


def move_shards_on_cluster(
    client: Any,
    kept: Work,
    mark: Mapping[str, str],
    units: Sequence[Task],
    tell: Callable[[float], None],
) -> None:
    """Have the workers move shards, which they keep in the run's folder.

    mark: the run's fingerprint, which workers hold against what they see themselves. tell: takes
    how many are done. A worker that is lost costs the shards under way on it, which others do
    again. Raises UserError where the cluster is lost, or a shard fails on one worker after another.
    """
    if not units:
        return
    told = lambda: f"{kept.folder}: {kept.kept}"  # noqa: E731
    with _answered(told):
        check(client, kept.folder)
        # with each: what is scattered goes with its worker
        folder, given = str(kept.folder.absolute()), dict(mark)
        tasks = [
            client.submit(worker.move, folder, given, unit, pure=False, retries=0) for unit in units
        ]
        for done, (_, sound) in enumerate(_each(client, tasks, told), 1):
            kept.sound.add(sound)  # the worker has just taken its digest
            tell(done)


def begun(
    client: Any, case: Case, mark: Mapping[str, str], clock: Clock, layouts: Sequence[Layout]
) -> list[Begun]:
    """Have the workers say how the places of shards were drawn, and what of them lacks forcing as
    the run begins.
    """
    told = lambda: "nothing is kept yet"  # noqa: E731
    with _answered(told):
        check(client)
        tasks = [
            client.submit(worker.begun, case, dict(mark), clock, part, pure=False, retries=0)
            for part in layouts
        ]
        found = dict(_each(client, tasks, told))
    return [found[task.key] for task in tasks]


def release(client: Any) -> None:
    """Have the workers let go of a run's files, as far as they can be reached."""
    with contextlib.suppress(Exception):
        if client.status == "running":  # client.run would wait for ever for one that is lost
            tasks = [
                client.submit(worker.release, workers=[own], pure=False)
                for own in client.nthreads()
            ]
            _dask().wait(tasks, timeout=PATIENCE)


@contextlib.contextmanager
def _answered(kept: Callable[[], str]) -> Iterator[None]:
    """Tell in a line that the cluster does not answer any more; kept: what is kept of the run, in
    words.
    """
    distributed = _dask()
    try:
        yield
    except distributed.KilledWorker as error:
        raise UserError(
            f"worker after worker died of a shard ({_line(error)}); {kept()}"
        ) from error
    except (
        TimeoutError,
        distributed.comm.CommClosedError,
        asyncio.CancelledError,
        CancelledError,
    ) as error:
        raise UserError(f"the cluster is lost ({_line(error)}); {kept()}") from error


def _each(client: Any, tasks: Sequence[Any], kept: Callable[[], str]) -> Iterator[tuple[str, Any]]:
    """Yield the keys of tasks and what they return, as they are done.

    kept: what is kept of the run where the cluster is lost, in words.
    """
    done = _dask().as_completed(tasks, loop=client.loop)
    looked = time.monotonic()
    try:
        while not done.is_empty():
            if not done.has_ready():
                time.sleep(POLL)
                if time.monotonic() - looked > LOOK:
                    _first(client, f"the cluster has lost all of its workers; {kept()}")
                    looked = time.monotonic()
                continue
            task = next(done)
            yield task.key, _result(client, task, kept)
    finally:
        with contextlib.suppress(Exception):  # of a scheduler that is gone
            client.cancel(tasks)


def _result(client: Any, task: Any, kept: Callable[[], str]) -> Any:
    """Return what a task that is done returned, or raise what it raised.

    Its worker may be lost before it has handed that over: then others do it again.
    """
    fetched = asyncio.run_coroutine_threadsafe(
        client.gather(task, asynchronous=True), client.loop.asyncio_loop
    )
    while not wait([fetched], timeout=LOOK).done:
        _first(client, f"the cluster has lost all of its workers; {kept()}")
    return fetched.result()


def _first(client: Any, otherwise: str) -> None:
    """Wait for a worker; raise UserError, saying what else is so, where none comes."""
    try:
        client.wait_for_workers(1, timeout=WAIT)
    except TimeoutError:
        raise UserError(f"{otherwise} (waited {WAIT / 60:g} min)") from None


def _line(error: BaseException) -> str:
    return (str(error).strip().splitlines() or [type(error).__name__])[0]
