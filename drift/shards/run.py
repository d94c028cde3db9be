"""Moves a run shard by shard."""

import contextlib
import hashlib
from collections.abc import Iterator
from functools import partial

from drift import facts, start
from drift.job import Job
from drift.motion.spool import Spool
from drift.shards import cluster, told, work
from drift.shards.divide import Divided
from drift.shards.unit import Unit
from geo.files import digest


@contextlib.contextmanager
def moved(job: Job, run: Divided) -> Iterator[Spool]:
    """Give what the particles of a run were like at all output times."""
    case, client = job.case, job.client
    outputs, many = case.period.seconds(case.outputs), len(run.layouts)
    need = work.need(sum(layout.bounds[-1] for layout in run.layouts), len(outputs))
    with work.opened(job.out, fingerprint(job, many), need) as kept:
        if client is not None:
            missing = [number for number in range(many) if not kept.finished(number)]
            units = [Unit(case, run.stage.clock, layout, number) for number, layout in enumerate(run.layouts)]
            cluster.moved(
                client,
                kept.folder,
                [units[number] for number in missing],
                partial(_tell, job, many - len(missing), many),
            )
        reels = []
        for number, layout in enumerate(run.layouts):
            tell = partial(_tell, job, number, many)
            unit = Unit(case, run.stage.clock, layout, number)
            reels.append(kept.reel(number, layout.bounds[-1], partial(unit.move, run.stage.scene, job.where, tell)))
        with Spool(reels) as spool:
            start.check_end(case, job.where, run.stage, spool, None)
            yield spool


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
        "the versions": ", ".join(f"{name} {version}" for name, version in told.versions().items()),
        "the backend": of["backend"],
        "the forcing": f"{of['forcing']}; {files}",
        "the coast": of["coast"],
        "the processor's arithmetic": told.arithmetic(),
        work.NUMBER: str(many),
    }
