"""Run shards as tasks of a dask.distributed cluster, a local or an existing one."""

import asyncio
import contextlib
import importlib
import itertools
import logging
import math
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import CancelledError, wait
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from drift.case.record import Case
from drift.engine.motion.clock import Clock
from drift.engine.motion.spool import AtTime
from drift.engine.particles.ensemble import Layout
from drift.engine.particles.snapshot import Question
from drift.pipeline.shards import fingerprint, worker
from drift.pipeline.shards.divide import Begun, Workers
from drift.pipeline.shards.work import Task, Work
from drift.products.files import interrupt
from geo.errors import UserError

PATIENCE = 20  # [s] to wait for a cluster to answer
# [s] to wait for a first worker, or for a new one after all are lost: batch queues are slow
WAIT = 900
LOOK, POLL = 10, 0.05  # [s] between checks for workers, and for a finished shard
# warnings go to standard error unless the calling program configures logging
LOG = logging.getLogger("drift")


@contextlib.contextmanager
def connect_to_cluster(workers: int | None, address: str | None) -> Iterator[Any]:
    """Yield a client of a cluster; None if neither a number of workers nor an address is given.

    Args:
        workers: number of workers of a local cluster to start.
        address: address of an existing cluster.

    Raises:
        UserError: no cluster answers, both are given, or dask.distributed is not installed.
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
            log = logging.getLogger(name)  # our one-line errors replace dask's log
            stack.callback(log.setLevel, log.level)
            log.setLevel(logging.CRITICAL + 1)
        if workers is not None:
            place = stack.enter_context(
                tempfile.TemporaryDirectory(prefix="drift-", ignore_cleanup_errors=True)
            )
            # this process ends its workers, once they have started
            with interrupt.signals_deferred(), interrupt.blocked_in_children():
                address = distributed.LocalCluster(
                    n_workers=workers,
                    local_directory=place,
                    threads_per_worker=1,
                    memory_limit=0,
                    dashboard_address="127.0.0.1:0",
                    silence_logs=50,
                )
                stack.callback(_close_cluster, address)
        try:
            if workers is None and not str(address).startswith("ucx"):
                # a client of an invalid address takes a minute to close
                distributed.comm.get_address_host_port(address)
            client = stack.enter_context(
                distributed.Client(address, timeout=PATIENCE, set_as_default=False)
            )
        except (TimeoutError, OSError, ValueError) as error:
            raise UserError(
                f"--cluster {address}: no cluster answers there ({_first_line(error)})"
            ) from error
        yield client


def _close_cluster(local: Any) -> None:
    """Close a local cluster; workers that do not end in time end with this process."""
    with contextlib.suppress(Exception):
        local.close(timeout=PATIENCE)


def _dask() -> Any:
    """Import dask.distributed, which is slow to import and not installed by default."""
    try:
        return importlib.import_module("distributed")
    except ImportError:
        raise UserError(
            "--workers and --cluster need dask: pip install 'casp-drift[cluster]'"
        ) from None


def workers_of(client: Any) -> Workers:
    """Wait for the first workers of a cluster; return their number and memory.

    Raises:
        UserError: no worker starts within WAIT seconds.
    """
    with _lost_cluster_as_error(lambda: "nothing is kept yet"):
        status = getattr(client, "status", f"no dask.distributed.Client ({client!r})")
        if status != "running":
            raise UserError(f"the client is {status}; give one that is open")
        if not client.nthreads():
            LOG.warning("the cluster has no workers yet; drift waits for the first")
        until = time.monotonic() + WAIT
        rooms: dict[str, tuple[str, float, float]] = {}
        while not rooms:  # the only worker may be lost during the call
            if time.monotonic() > until:
                raise UserError(
                    f"the cluster loses its workers one after another (waited {WAIT / 60:g} min)"
                )
            _wait_for_worker(client, "the cluster has no workers; start some")
            rooms = _call_on_workers(client, worker.room)
    hosts = Counter(host for host, _, _ in rooms.values()) + Counter([worker.host()])
    together = max(hosts[host] for host, _, _ in rooms.values())
    free = min(free / hosts[host] for host, free, _ in rooms.values())
    return Workers(len(rooms), together, free, min(limit for _, _, limit in rooms.values()))


def _call_on_workers(client: Any, function: Callable[..., Any], *given: Any) -> dict[str, Any]:
    """Call a function on all workers; return the results by address, without lost workers."""
    results, lost = {}, (_dask().comm.CommClosedError, ConnectionError, TimeoutError)
    # client.run would wait forever for a machine that hangs.
    answers = client.sync(client._run, function, *given, on_error="return", callback_timeout=WAIT)
    for address, answer in answers.items():
        if isinstance(answer, lost) or (type(answer) is OSError and answer.errno is None):
            continue  # the worker is lost; other workers do its tasks
        if isinstance(answer, Exception):
            raise UserError(
                f"worker {address}: {_first_line(answer)}; install the same versions everywhere"
            ) from answer
        results[address] = answer
    return results


def check(client: Any, folder: Path | None = None) -> None:
    """Reject workers with other versions or arithmetic, and workers that do not see the folder.

    Workers that are threads of this process are rejected too: they would wait forever for its lock
    on the kernels.

    Args:
        client: the client of the cluster.
        folder: the run's folder; None: there is none yet.

    Raises:
        UserError: a worker is rejected.
    """
    if worker.process() in _call_on_workers(client, worker.process).values():
        raise UserError(
            "the cluster's workers are threads of this process; begin it with processes=True"
        )
    own = fingerprint.of_machine()
    for address, other in sorted(
        _call_on_workers(client, worker.about, str(folder.absolute()) if folder else "").items()
    ):
        if other.pop("folder") != "True":
            if folder is not None and not folder.is_dir():
                raise UserError(
                    f"{folder}: deleted while the run needs it; the same command starts the run again"
                )
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
    """Simulate shards on the workers, which store the shards in the run's folder.

    If a worker is lost, other workers repeat the shards that it was working on.

    Args:
        client: the client of the cluster.
        kept: the store of finished shards.
        mark: the run's fingerprint; each worker compares it with its own.
        units: the shards to simulate.
        tell: called with the number of shards done.

    Raises:
        UserError: the cluster is lost, or a shard fails on one worker after another.
    """
    if not units:
        return
    stored = partial(_stored, kept)
    with _lost_cluster_as_error(stored):
        check(client, kept.folder)
        # passed to each task: scattered data would be lost with its worker
        folder, given = str(kept.folder.absolute()), dict(mark)
        tasks = [
            client.submit(worker.move, folder, given, unit, pure=False, retries=0) for unit in units
        ]
        for done, (_, sound) in enumerate(_finished_tasks(client, tasks, stored), 1):
            kept.sound.add(sound)  # the worker has just computed the file's digest
            tell(done)


def _stored(kept: Work) -> str:
    """Return what is stored of a run, and where, for messages."""
    return f"{kept.folder}: {kept.kept}"


def check_shard_starts(
    client: Any,
    case: Case,
    opened: Case,
    mark: Mapping[str, str],
    clock: Clock,
    layouts: Sequence[Layout],
) -> list[Begun]:
    """Compute `drift.pipeline.shards.divide.check_shard_start` of each shard on the workers.

    Args:
        client: the client of the cluster.
        case: the case of the run.
        opened: the case whose environment it has: see drift.pipeline.run_options.Job.
        mark: the run's fingerprint.
        clock: the steps of the run.
        layouts: the particles of each shard.
    """
    stored = lambda: "nothing is kept yet"  # noqa: E731
    with _lost_cluster_as_error(stored):
        check(client)
        tasks = [
            client.submit(
                worker.begun, case, opened, dict(mark), clock, part, pure=False, retries=0
            )
            for part in layouts
        ]
        found = dict(_finished_tasks(client, tasks, stored))
    return [found[task.key] for task in tasks]


def answer_on_workers(
    client: Any,
    kept: Work,
    mark: Mapping[str, str],
    outputs: Sequence[AtTime],
    questions: Sequence[Question],
) -> Iterator[Sequence[Any]]:
    """Yield the answers to questions about stored outputs: a `Deal` of the workers.

    Each task reads one output of a range of shards. Answers stay on the workers until their turn.

    Args:
        client: the client of the cluster.
        kept: the store of finished shards.
        mark: the run's fingerprint.
        outputs: the particles at some times, all of one store.
        questions: one for each output.

    Raises:
        UserError: the cluster is lost.
    """
    if not outputs:
        return
    store, ask = outputs[0].spool, partial(_answers, client, kept, mark)
    with _lost_cluster_as_error(partial(_stored, kept)):
        store.normalise([output.at for output in outputs], ask)
        yield from ask(outputs, questions)


def _answers(
    client: Any,
    kept: Work,
    mark: Mapping[str, str],
    outputs: Sequence[AtTime],
    questions: Sequence[Question],
) -> Iterator[Sequence[Any]]:
    """Yield the answers of `answer_on_workers`, whose scale of weights is known."""
    stored = partial(_stored, kept)
    _wait_for_worker(client, f"the cluster has no workers; {stored()}")
    addresses = sorted(client.nthreads())
    store = outputs[0].spool
    most = math.ceil(len(addresses) / len(outputs))  # at least a task a worker
    # by output and number: a range of its shards
    ranges = {
        (k, number): span
        for k, output in enumerate(outputs)
        for number, span in enumerate(_ranges(store.shards(output.at), most))
    }
    # the same worker each time, whose memory holds what it has read
    preferred = {
        (k, number): addresses[(outputs[k].at * most + number) % len(addresses)]
        for k, number in ranges
    }

    def submit(part: tuple[int, int], own: str | None) -> Any:
        k = part[0]
        return client.submit(
            worker.answer,
            dict(mark),
            store.some(outputs[k].at, *ranges[part]),
            questions[k],
            pure=False,
            retries=0,
            workers=own,
            allow_other_workers=own is not None,
        )

    tasks = {part: submit(part, own) for part, own in preferred.items()}

    def current(part: tuple[int, int]) -> Any:
        """Return the task of a part; tasks whose worker is lost are submitted again.

        If all workers were lost at once, dask would assign such a task to no new one (distributed
        2026.8: Scheduler.bulk_schedule_unrunnable_after_adding_worker).
        """
        there = client.nthreads()
        for lost in [other for other, own in preferred.items() if own not in there]:
            del preferred[lost]
            if lost in tasks and not tasks[lost].done():
                client.cancel(tasks[lost])
                tasks[lost] = submit(lost, None)
        return tasks[part]

    try:
        for k in range(len(outputs)):
            own = [part for part in ranges if part[0] == k]
            yield [_result_of(client, tasks[part], stored, partial(current, part)) for part in own]
            for part in own:
                del tasks[part]  # its answer can leave the worker
    finally:
        with contextlib.suppress(Exception):  # the scheduler may be lost
            client.cancel([*tasks.values()])


def _ranges(shards: int, most: int) -> list[tuple[int, int]]:
    """Return up to `most` ranges [first, last) of shards."""
    edges = np.linspace(0, shards, min(most, shards) + 1).astype(int).tolist()
    return list(itertools.pairwise(edges))


def release(client: Any) -> None:
    """Close the run's files on all workers that can be reached."""
    with contextlib.suppress(Exception):
        if client.status == "running":  # client.run would wait forever for a lost worker
            tasks = [
                client.submit(worker.release, workers=[own], pure=False)
                for own in client.nthreads()
            ]
            _dask().wait(tasks, timeout=PATIENCE)


@contextlib.contextmanager
def _lost_cluster_as_error(kept: Callable[[], str]) -> Iterator[None]:
    """Turn a lost cluster into a UserError; `kept` says what is stored of the run."""
    distributed = _dask()
    try:
        yield
    except distributed.KilledWorker as error:
        raise UserError(
            f"one worker after another died while running a shard ({_first_line(error)}); {kept()}"
        ) from error
    except (
        TimeoutError,
        distributed.comm.CommClosedError,
        asyncio.CancelledError,
        CancelledError,
    ) as error:
        raise UserError(f"the cluster is lost ({_first_line(error)}); {kept()}") from error


def _finished_tasks(
    client: Any, tasks: Sequence[Any], kept: Callable[[], str]
) -> Iterator[tuple[str, Any]]:
    """Yield the keys and results of tasks as they finish; `kept` says what is stored of the run."""
    done = _dask().as_completed(tasks, loop=client.loop)
    last_check = time.monotonic()
    try:
        while not done.is_empty():
            if not done.has_ready():
                time.sleep(POLL)
                if time.monotonic() - last_check > LOOK:
                    _wait_for_worker(client, f"the cluster has lost all of its workers; {kept()}")
                    last_check = time.monotonic()
                continue
            task = next(done)
            yield task.key, _result_of(client, task, kept)
    finally:
        with contextlib.suppress(Exception):  # the scheduler may be lost
            client.cancel(tasks)


def _result_of(
    client: Any, task: Any, kept: Callable[[], str], current: Callable[[], Any] | None = None
) -> Any:
    """Return the result of a finished task, or raise its exception.

    If its worker is lost before the transfer, another worker repeats the task.

    Args:
        client: the client of the cluster.
        task: the task.
        kept: a message on what is stored of the run.
        current: asked from time to time while the task is waited for; returns the task that has
            replaced it, or the task itself. None: nothing replaces it.
    """
    while True:
        fetched = asyncio.run_coroutine_threadsafe(
            client.gather(task, asynchronous=True), client.loop.asyncio_loop
        )
        before = task
        while task is before and not wait([fetched], timeout=LOOK).done:
            _wait_for_worker(client, f"the cluster has lost all of its workers; {kept()}")
            task = current() if current is not None else task
        if task is before:
            return fetched.result()


def _wait_for_worker(client: Any, otherwise: str) -> None:
    """Wait for a worker; if none starts, raise UserError with the message `otherwise`."""
    try:
        client.wait_for_workers(1, timeout=WAIT)
    except TimeoutError:
        raise UserError(f"{otherwise} (waited {WAIT / 60:g} min)") from None


def _first_line(error: BaseException) -> str:
    return (str(error).strip().splitlines() or [type(error).__name__])[0]
