"""What a worker of a cluster does: opens a case's environment once, moves shards in it, and keeps them in the run's folder."""

import hashlib
import os
import pickle
import socket
from pathlib import Path

from drift import start
from drift.case.record import Case
from drift.environment import environment
from drift.environment.environment import Environment
from drift.motion.clock import Clock
from drift.motion.scene import Scene
from drift.particles.ensemble import Layout
from drift.shards import divide, machine, work
from kernels import coast as device_coast
from kernels import runtime

_open: dict[str, tuple[Environment, Scene]] = {}  # the case that was opened last, by its digest


def process() -> str:
    """Return which machine and process this is."""
    return f"{socket.gethostname()} {os.getpid()}"


def about(folder: str = "") -> dict[str, str]:
    """Return what tells this worker from others, and whether it sees the run's folder, if there is one yet."""
    with runtime.alone():
        runtime.start(threads=1)
        return {
            **machine.versions(),
            "its arithmetic": machine.arithmetic(),
            "folder": str(not folder or (Path(folder) / work.ABOUT).is_file()),
        }


def move(folder: str, unit: work.Task) -> str:
    """Move a shard, keep it in the run's folder, and return its name there."""
    with runtime.alone():
        where, scene = _opened(unit.case)
        kept = work.Work(Path(folder))
        environment.store(where, kept.forcing)
        unit.move(scene, where, None, kept)
    return unit.name


def begun(case: Case, clock: Clock, layout: Layout) -> divide.Begun:
    """Return how the places of a shard were drawn, and what of it lacks forcing as the run begins."""
    with runtime.alone():
        where, scene = _opened(case)
        return divide.begun(case, where, scene, clock, layout)


def _opened(case: Case) -> tuple[Environment, Scene]:
    """Return a case's environment and scene, opened once; start Taichi, which is held."""
    runtime.start(threads=1)
    key = hashlib.sha256(pickle.dumps(case)).hexdigest()
    if key not in _open:
        for _, scene in _open.values():
            scene.forcing.close()
        _open.clear()
        where = start.open_for(case)
        coast = device_coast.upload(where.coast) if where.coast else None
        _open[key] = where, start.scene_of(case, where, coast)
    return _open[key]
