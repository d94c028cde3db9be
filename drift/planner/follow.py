"""Tracks to plan on: particles of their own, followed through all that is known and on from there.

They are drawn with another seed than those that the plan is scored on, so that it cannot profit from their accidents.
"""

from dataclasses import replace

import numpy as np

from drift import start
from drift.case.record import Case
from drift.environment.environment import Environment
from drift.motion import simulate
from drift.particles import ensemble as record
from drift.particles.status import on_map
from drift.planner.planning_tracks import Tracks
from drift.search.records import Resampling
from kernels import noise
from kernels.noise import Purpose

BINS = 48  # over the time of a plan, at least, unless they would be shorter than
SHORTEST = 300  # [s]


def follow(case: Case, where: Environment) -> Tracks:
    """Return tracks from the plan's begin to its end, weighted by all sorties and contacts of the case."""
    spec = case.plan
    span = int((spec.until - spec.begin) / np.timedelta64(1, "s"))
    count = max(span // max(SHORTEST, span // BINS), 1)
    edges = np.unique(np.linspace(0, span, count + 1).round().astype(np.int64))
    seed = noise.seed_for(case.seed, Purpose.PLANNING)
    few = replace(case, particles=spec.particles, seed=seed, end=spec.until, resampling=Resampling())
    begin = start.prepare(few, where)
    try:
        search = start.search(few, begin)
        first = case.period.elapsed(spec.begin)
        moments = list(simulate.run(begin.ensemble, begin.scene, begin.clock, first + edges, search=search))
    finally:
        begin.scene.forcing.close()
    ensemble = begin.ensemble
    epoch = begin.clock.start
    seen = [on_map(moment.status) for moment in moments]
    return Tracks(
        time=(epoch + first + edges).astype(np.float64),
        lon=np.stack([moment.lon for moment in moments]),
        lat=np.stack([moment.lat for moment in moments]),
        adrift=np.stack(seen),
        weight=record.probability(ensemble),
        scenario=np.repeat(np.arange(len(case.scenarios), dtype=np.int32), np.diff(ensemble.bounds)),
        release=epoch + ensemble.release.to_numpy().astype(np.float64),
    )
