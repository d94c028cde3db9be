"""Moves a run shard by shard."""

import contextlib
import hashlib
import platform
import sys
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from importlib import metadata

import numpy as np

from drift import facts, start
from drift.job import Job
from drift.motion import prior, simulate
from drift.motion.forcing import Forcing
from drift.motion.spool import Reel, Spool
from drift.particles.ensemble import Layout
from drift.shards import work
from drift.shards.divide import Divided
from geo.files import digest
from kernels import probe

FUNCTIONS = (np.exp, np.log, np.sin, np.cos, np.tan, np.sqrt, np.cbrt, np.expm1, np.log1p, np.arctan)


@contextlib.contextmanager
def moved(job: Job, run: Divided) -> Iterator[Spool]:
    """Give what the particles of a run were like at all output times."""
    case = job.case
    outputs, many = case.period.seconds(case.outputs), len(run.layouts)
    need = work.need(sum(layout.bounds[-1] for layout in run.layouts), len(outputs))
    with work.opened(job.out, fingerprint(job, many), need) as kept:
        reels = []
        for number, layout in enumerate(run.layouts):

            def tell(share: float, number: int = number) -> None:
                job.tell("drift", (number + share) / many)

            tell(0.0)
            reels.append(kept.reel(number, layout.bounds[-1], partial(_move, job, run, layout, outputs, tell)))
        with Spool(reels) as spool:
            start.check_end(case, job.where, run.stage, spool, None)
            yield spool


def _move(job: Job, run: Divided, layout: Layout, outputs: np.ndarray, tell: simulate.Progress, reel: Reel) -> None:
    """Draw a shard, move it through the run, and take down what it was like at all output times."""
    ensemble = prior.draw(start.ensemble_spec(job.case), run.coast, layout).ensemble
    with contextlib.closing(Forcing(list(job.where.scenarios), job.case.direction)) as forcing:
        scene = replace(run.stage.scene, forcing=forcing)
        reel.record(job.case.period, ensemble, simulate.run(ensemble, scene, run.stage.clock, outputs, tell))


def fingerprint(job: Job, many: int) -> dict[str, str]:
    """Return what the results of a run follow from, by what it is."""
    told = facts.attributes(job.case, job.where)
    files = hashlib.sha256("".join(digest.of(path) for path in job.case.inputs).encode()).hexdigest()
    return {
        "the case": told["case"],
        "the seed": told["seed"],
        "the versions": f"{told['versions']}, Python {sys.version.split()[0]}, SciPy {metadata.version('scipy')}",
        "the backend": told["backend"],
        "the forcing": f"{told['forcing']}; {files}",
        "the coast": told["coast"],
        "the processor's arithmetic": arithmetic(),
        "the number of shards": str(many),
    }


def arithmetic() -> str:
    """Return a fingerprint of this machine's arithmetic: its functions may differ in the last bit from another's."""
    x = np.linspace(0.001, 50.0, 4001)
    values = [function(x) for function in FUNCTIONS]
    values += [np.arctan2(np.sin(x), np.cos(x)), np.hypot(x, 1 / x), x**0.37, probe.values(x.astype(np.float32))]
    total = hashlib.sha256(b"".join(np.ascontiguousarray(value).tobytes() for value in values))
    return f"{platform.machine()} {total.hexdigest()[:16]}"
