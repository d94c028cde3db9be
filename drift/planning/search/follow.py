"""Tracks to plan on: particles of their own, followed through all that is known and on from there.

They are drawn with another seed than those that the plan is scored on, so that it cannot profit
from their accidents.

Tracks are straight between their times. What drifts bends slowly; what steers may turn anywhere,
and a right-angled turn in the middle of a bin leaves a chord that is v dt / sqrt(8) off it: 0.6 nmi
at 20 kn in five minutes, 7 nmi in an hour. So bins are short where a case steers, and steps of the
run end at their edges: there the mean velocity of a bridge's leg is read, which its noise hides.
"""

from dataclasses import replace

import numpy as np

from drift.case.record import Case
from drift.engine.environment.environment import Environment
from drift.engine.motion import simulate
from drift.engine.motion.clock import Clock
from drift.engine.motion.simulate import Moment
from drift.engine.motion.steering.itinerary import Itinerary, Ways
from drift.engine.particles import ensemble as record
from drift.engine.particles.ensemble import Ensemble
from drift.engine.particles.status import STRANDED, Status, on_map
from drift.evidence.filter import overdue
from drift.evidence.filter.records import Resampling
from drift.pipeline import run_setup
from drift.planning.search.planning_tracks import Tracks
from geo import sphere
from geo.array import Array
from kernels.maths import noise
from kernels.maths.noise import Purpose

BINS = 48  # over the time of a plan, at least, unless they would be shorter than
SHORTEST = 300  # [s]
# of what steers, in all: bins of SHORTEST as long as there are no more than these
POSITIONS = 8_000_000


def follow(case: Case, where: Environment) -> Tracks:
    """Return tracks from the plan's begin to its end, weighted by all sorties and contacts of the
    case.
    """
    spec = case.plan
    span = int((spec.until - spec.begin) / np.timedelta64(1, "s"))
    count = max(span // max(SHORTEST, span // BINS), 1)
    steers = [s.itinerary for s in case.scenarios if s.itinerary is not None]
    seed = noise.seed_for(case.seed, Purpose.PLANNING)
    few = replace(
        case, particles=spec.particles, seed=seed, end=spec.until, resampling=Resampling()
    )
    begin = run_setup.prepare(few, where)
    try:
        search = run_setup.build_search_filter(few, begin)
        first = case.period.elapsed(spec.begin)
        edges = np.unique(np.linspace(0, span, count + 1).round().astype(np.int64))
        if steers:
            edges = _on_lattice(span, spec.particles, begin.clock, first)
        moments, flows, ports, drawn = (
            list[Moment](),
            list[Array](),
            list[Array](),
            run_setup.ensemble_spec(few),
        )
        bridged = _bridged(steers)
        for moment in simulate.run(
            begin.ensemble, begin.scene, begin.clock, first + edges, search=search
        ):
            moments.append(moment)
            ports.append(
                overdue.in_port(
                    drawn, begin.ensemble, moment.status, case.period.time(moment.elapsed)
                )
            )
            if bridged.any():
                # Inside a step the columns are those of its end; there the velocity that it began
                # with still holds.
                known = not flows or begin.clock.ends(moment.elapsed)
                flows.append(_flow(begin.ensemble, bridged, moment.elapsed) if known else flows[-1])
    finally:
        begin.scene.forcing.close()
    ensemble = begin.ensemble
    epoch = begin.clock.start
    unseen = () if spec.ashore else STRANDED
    seen = [
        on_map(moment.status) & ~np.isin(moment.status, unseen) & ~port
        for moment, port in zip(moments, ports, strict=True)
    ]
    return Tracks(
        time=(epoch + first + edges).astype(np.float64),
        lon=np.stack([moment.lon for moment in moments]),
        lat=np.stack([moment.lat for moment in moments]),
        adrift=np.stack(seen),
        weight=record.probability(ensemble),
        scenario=np.repeat(
            np.arange(len(case.scenarios), dtype=np.int32), np.diff(ensemble.bounds)
        ),
        release=epoch + ensemble.release.to_numpy().astype(np.float64),
        turn=_turn(case, ensemble, epoch) if steers else None,
        flow=np.stack(flows, axis=1) if flows else None,
    )


def _on_lattice(span: int, particles: int, clock: Clock, first: int) -> Array:
    """Return edges of bins [s after the plan's begin], int64, such that each step of the run ends
    at one.

    span [s] of the plan; first: when it begins [s after the run's start].
    """
    finest = max(SHORTEST, -(-span * particles // POSITIONS))
    last = clock.start + first - clock.phase  # its begin, in the lattice's own time
    low = last // clock.step * clock.step - last
    if clock.step > finest:
        ticks = low + np.arange(0, span - low + clock.step, clock.step)
        parts = -(-clock.step // finest)
        edges = (
            (ticks[:, None] + np.arange(parts) * clock.step / parts)
            .round()
            .astype(np.int64)
            .ravel()
        )
    else:
        edges = low + np.arange(0, span - low, finest // clock.step * clock.step)
    return np.unique(np.concatenate([[0], edges[(edges > 0) & (edges < span)], [span]]))


def _bridged(itineraries: list[Itinerary]) -> Array:
    """Return the spread rates [m/sqrt(s)] of all itineraries' phases, in their order; 0: it follows
    no bridge.

    Where they are uncertain these are the middle ones. One more at the end: what has arrived is
    beyond its last phase.
    """
    rates = [
        phase.k if isinstance(phase, Ways) else 0.0 for own in itineraries for phase in own.phases
    ]
    return np.array([*rates, 0.0])


def _flow(ensemble: Ensemble, bridged: Array, time: int) -> Array:
    """Return the mean velocity [m/s] east and north of what follows a bridge, and its K, float32
    (3, n), else NaN.

    time [s after the run's start]: that of the ensemble's columns.
    """
    phase, status, to_time = (
        ensemble.columns[name].to_numpy() for name in ("phase", "status", "to_time")
    )
    mine = (bridged[phase] > 0) & (status == Status.UNDER_WAY) & (to_time > time)
    lon, lat, to_lon, to_lat = (
        ensemble.columns[name].to_numpy()[mine] * sphere.UNIT
        for name in ("lon", "lat", "to_lon", "to_lat")
    )
    flow = np.full((3, len(mine)), np.nan, np.float32)
    flow[2, mine] = bridged[phase[mine]]
    flow[:2, mine] = np.stack(sphere.offset(lon, lat, to_lon, to_lat)) / (to_time[mine] - time)
    return flow


def _turn(case: Case, ensemble: Ensemble, epoch: int) -> Array:
    """Return when each particle goes adrift [s since 1970]; -inf where none steers, inf where it
    ended before.
    """
    ended = np.isin(ensemble.status.to_numpy(), (Status.ARRIVED, Status.AGROUND))
    turn = np.where(ended, np.inf, epoch + ensemble.release.to_numpy().astype(np.float64))
    steers = np.array([scenario.itinerary is not None for scenario in case.scenarios])
    return np.where(np.repeat(steers, np.diff(ensemble.bounds)), turn, -np.inf)
