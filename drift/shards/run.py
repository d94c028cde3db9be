"""Moves a run shard by shard."""

import contextlib
import hashlib
from collections.abc import Iterator
from functools import partial

import numpy as np

from drift import facts, start
from drift.environment import environment
from drift.job import Job
from drift.motion.spool import Spool
from drift.shards import cluster, machine, work
from drift.shards.divide import Divided
from drift.shards.unit import Unit
from drift.shards.work import Work
from geo import notation
from geo.errors import UserError
from geo.files import digest


@contextlib.contextmanager
def moved(job: Job, run: Divided) -> Iterator[Spool]:
    """Give what the particles of a run were like at all output times."""
    case, client = job.case, job.client
    many = len(run.layouts)
    need = work.need(sum(layout.bounds[-1] for layout in run.layouts), case.outputs.size)
    slices = run.setup.scene.forcing.size(*notation.epochs(np.array(case.period.span)).tolist())
    units = [Unit(case, run.setup.clock, layout, number) for number, layout in enumerate(run.layouts)]
    with work.opened(job.out, fingerprint(job, many), need, slices) as kept, _stored(job, kept):
        if client is not None:
            missing = [unit for unit in units if not kept.finished(unit.number)]
            cluster.moved(client, kept, missing, partial(_tell, job, many - len(missing), many))
        reels = []
        for unit in units:
            tell = partial(_tell, job, unit.number, many)
            reels.append(kept.reel(unit.number, unit.n, partial(unit.move, run.setup.scene, job.where, tell)))
        with Spool(reels) as spool:
            try:
                start.check_end(case, job.where, run.setup, spool, None)
            except UserError:
                kept.drop()  # the same command would only be refused again
                raise
            yield spool


@contextlib.contextmanager
def _stored(job: Job, kept: Work) -> Iterator[None]:
    """Have what this process reads of the forcing stored with the shards meanwhile."""
    environment.store(job.where, kept.forcing)
    try:
        yield
    finally:
        environment.store(job.where, None)


def _tell(job: Job, done: int, many: int, share: float) -> None:
    """Tell how much of the drift is done: so many shards, and a share of another (or of more, from 1 on)."""
    job.tell("drift", min((done + share) / many, 1.0))


def fingerprint(job: Job, many: int) -> dict[str, str]:
    """Return what the results of a run follow from, by what it is."""
    of = facts.attributes(job.case, job.where)
    files = hashlib.sha256("".join(digest.of(path) for path in job.case.inputs).encode()).hexdigest()
    return {
        "the case": of["case"],
        "the seed": of["seed"],
        "the versions": ", ".join(f"{name} {version}" for name, version in machine.versions().items()),
        "the backend": of["backend"],
        "the forcing": f"{of['forcing']}; {files}",
        "the coast": of["coast"],
        "the processor's arithmetic": machine.arithmetic(),
        work.NUMBER: str(many),
    }
