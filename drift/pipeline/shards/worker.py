"""Functions that dask runs on a worker: open a case's environment once and simulate its shards.

A worker stores finished shards in the run's folder.
"""

import functools
import math
import os
import pickle
import socket
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from drift.case.record import Case
from drift.engine.environment import environment
from drift.engine.environment.environment import Environment
from drift.engine.motion.clock import Clock
from drift.engine.motion.scene import Scene
from drift.engine.particles.ensemble import Layout
from drift.engine.particles.snapshot import Output, Question
from drift.pipeline import run_setup
from drift.pipeline.shards import divide, fingerprint, work
from geo.errors import UserError
from kernels.runtime import memory, runtime
from kernels.step import coast as device_coast

_open: dict[str, tuple[Environment, Scene]] = {}  # the run opened last, by its digest


def host() -> str:
    """Return the name of this machine."""
    return socket.gethostname()


def process() -> str:
    """Return the name of this machine and the id of this process."""
    return f"{host()} {os.getpid()}"


def room(dask_worker: Any) -> tuple[str, float, float]:
    """Return this machine's name, its free memory and dask's memory limit of the worker [bytes].

    dask passes the worker as `dask_worker`.
    """
    return host(), float(memory.free()), float(dask_worker.memory_manager.memory_limit or math.inf)


def about(folder: str = "") -> dict[str, str]:
    """Return this machine's fingerprint, and under "folder" whether it sees the run's folder."""
    with runtime.alone():
        runtime.start(threads=1)
        return {**_machine(), "folder": str(not folder or (Path(folder) / work.ABOUT).is_file())}


@functools.cache
def _machine() -> dict[str, str]:
    return fingerprint.of_machine()


def move(folder: str, mark: Mapping[str, str], unit: work.Task) -> str:
    """Simulate a shard, store it in the run's folder and return the name of its file.

    Args:
        folder: the folder of the run's finished shards.
        mark: the fingerprint of the run.
        unit: the shard.
    """
    with runtime.alone():
        where, scene = _open_once(unit.case, unit.opened, mark)
        kept = work.Work(Path(folder), work.run_of(mark))
        environment.share_slices(where, kept.forcing)
        unit.move(scene, where, None, kept)
    return unit.name


def begun(
    case: Case, opened: Case, mark: Mapping[str, str], clock: Clock, layout: Layout
) -> divide.Begun:
    """Return `drift.pipeline.shards.divide.check_shard_start` of a shard, computed on this worker."""
    with runtime.alone():
        where, scene = _open_once(case, opened, mark)
        return divide.check_shard_start(case, where, scene, clock, layout)


def answer(mark: Mapping[str, str], output: Output, question: Question) -> Any:
    """Return the answer to a question about some stored particles.

    Args:
        mark: the fingerprint of the run.
        output: the particles.
        question: what is asked.
    """
    with runtime.alone():
        runtime.start(threads=1)
        _check(mark, _machine())
        return question(output)


def release() -> None:
    """Close the run that was opened last and its files."""
    with runtime.alone():
        for where, scene in _open.values():
            environment.share_slices(where, None)
            scene.forcing.close()
        _open.clear()


def _open_once(case: Case, opened: Case, mark: Mapping[str, str]) -> tuple[Environment, Scene]:
    """Return the environment and scene of a run, opened at the first call; start Taichi.

    opened: the case whose environment the run has. The caller holds the lock of `runtime.alone`. Raises UserError if the machine's or the files'
    fingerprint differs from the run's.
    """
    runtime.start(threads=1)
    _check(mark, _machine())
    key = f"{work.run_of(mark)} {hash(pickle.dumps((case, opened)))}"
    if key not in _open:
        release()
        where = run_setup.open_for(opened)
        _check(mark, fingerprint.fingerprint_of(case, where, int(mark[work.NUMBER])))
        coast = device_coast.upload(where.coast) if where.coast else None
        _open[key] = where, run_setup.scene_of(case, where, coast)
    return _open[key]


def _check(mark: Mapping[str, str], own: Mapping[str, str]) -> None:
    for name, value in own.items():
        if mark[name] != value:
            raise UserError(
                f"worker {process()}: {name} differs from the machine where the run was started ({value} here, {mark[name]} there), so "
                "results could differ; give all workers the same files and versions, on machines of one kind"
            )
