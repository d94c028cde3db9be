"""What a worker of a cluster does: opens a case's environment once, moves shards in it, and keeps
them in the run's folder.
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
from drift.pipeline import run_setup
from drift.pipeline.shards import divide, fingerprint, work
from geo.errors import UserError
from kernels.runtime import memory, runtime
from kernels.step import coast as device_coast

_open: dict[str, tuple[Environment, Scene]] = {}  # the run that was opened last, by its digest


def host() -> str:
    """Return which machine this is."""
    return socket.gethostname()


def process() -> str:
    """Return which machine and process this is."""
    return f"{host()} {os.getpid()}"


def room(dask_worker: Any) -> tuple[str, float, float]:
    """Return which machine this is, what memory it has left, and what dask lets the worker take,
    which it gives [bytes].
    """
    return host(), float(memory.free()), float(dask_worker.memory_manager.memory_limit or math.inf)


def about(folder: str = "") -> dict[str, str]:
    """Return what tells this worker from others, and whether it sees the run's folder, if there is
    one yet.
    """
    with runtime.alone():
        runtime.start(threads=1)
        return {**_machine(), "folder": str(not folder or (Path(folder) / work.ABOUT).is_file())}


@functools.cache
def _machine() -> dict[str, str]:
    return fingerprint.of_machine()


def move(folder: str, mark: Mapping[str, str], unit: work.Task) -> str:
    """Move a shard of the run of a fingerprint, keep it in the run's folder, and return its name
    there.
    """
    with runtime.alone():
        where, scene = _opened(unit.case, mark)
        kept = work.Work(Path(folder), work.run_of(mark))
        environment.store(where, kept.forcing)
        unit.move(scene, where, None, kept)
    return unit.name


def begun(case: Case, mark: Mapping[str, str], clock: Clock, layout: Layout) -> divide.Begun:
    """Return how the places of a shard were drawn, and what of it lacks forcing as the run begins."""
    with runtime.alone():
        where, scene = _opened(case, mark)
        return divide.begun(case, where, scene, clock, layout)


def release() -> None:
    """Let go of the run that was opened last, and of its files."""
    with runtime.alone():
        for where, scene in _open.values():
            environment.store(where, None)
            scene.forcing.close()
        _open.clear()


def _opened(case: Case, mark: Mapping[str, str]) -> tuple[Environment, Scene]:
    """Return the environment and scene of a run, opened once; start Taichi, which is held.

    Raises UserError where this machine, or a file as it is seen from here, is not what the run's
    fingerprint says.
    """
    runtime.start(threads=1)
    _check(mark, _machine())
    key = f"{work.run_of(mark)} {hash(pickle.dumps(case))}"
    if key not in _open:
        release()
        where = run_setup.open_for(case)
        _check(mark, fingerprint.fingerprint_of(case, where, int(mark[work.NUMBER])))
        coast = device_coast.upload(where.coast) if where.coast else None
        _open[key] = where, run_setup.scene_of(case, where, coast)
    return _open[key]


def _check(mark: Mapping[str, str], own: Mapping[str, str]) -> None:
    for name, value in own.items():
        if mark[name] != value:
            raise UserError(
                f"worker {process()}: {name} is not what it is where the run was started ({value}, and not {mark[name]}): "
                "results would not be the same everywhere; let all workers see the same files, with the same versions on machines of one kind"
            )
