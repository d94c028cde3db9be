"""Planning particles: their tracks during the plan, given everything known before it.

They use another random seed than the particles on which the plan is scored, so that the plan cannot
overfit those.

Tracks are straight between their times. Drift paths bend slowly. Steering particles may turn
anywhere: with a right-angled turn in the middle of a bin the chord is v dt / sqrt(8) off, which is
0.6 nmi at 20 kn in five minutes and 7 nmi in an hour. So bins are short if a case steers, and run
steps end at bin edges. There the mean velocity of a bridge's leg is read, which the bridge's noise
would hide.
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

BINS = 48  # fewest bins of a plan, unless they would be shorter than SHORTEST
SHORTEST = 300  # [s]
# most positions if particles steer: bins have the length SHORTEST up to this number
POSITIONS = 8_000_000


def follow(case: Case, where: Environment, own: bool = False) -> Tracks:
    """Return tracks from the plan's begin to its end, weighted by all sorties and contacts.

    Args:
        case: with the plan.
        where: environment of the run.
        own: True: the case's own particles, on which plans are scored, instead of others.
    """
    spec = case.plan
    span = int((spec.until - spec.begin) / np.timedelta64(1, "s"))
    count = max(span // max(SHORTEST, span // BINS), 1)
    steers = [s.itinerary for s in case.scenarios if s.itinerary is not None]
    seed = case.seed if own else noise.seed_for(case.seed, Purpose.PLANNING)
    particles = case.particles if own else spec.particles
    planning_case = replace(
        case, particles=particles, seed=seed, end=spec.until, resampling=Resampling()
    )
    setup = run_setup.prepare(planning_case, where)
    try:
        search = run_setup.build_search_filter(planning_case, setup)
        first = case.period.elapsed(spec.begin)
        edges = np.unique(np.linspace(0, span, count + 1).round().astype(np.int64))
        if steers:
            edges = _on_lattice(span, particles, setup.clock, first)
        moments, flows, ports, drawn = (
            list[Moment](),
            list[Array](),
            list[Array](),
            run_setup.ensemble_spec(planning_case),
        )
        bridged = _bridged(steers)
        for moment in simulate.run(
            setup.ensemble, setup.scene, setup.clock, first + edges, search=search
        ):
            moments.append(moment)
            ports.append(
                overdue.in_port(
                    drawn, setup.ensemble, moment.status, case.period.time(moment.elapsed)
                )
            )
            if bridged.any():
                # Inside a step the columns are those of its end, so the velocity of its begin is
                # kept.
                known = not flows or setup.clock.ends(moment.elapsed)
                flows.append(_flow(setup.ensemble, bridged, moment.elapsed) if known else flows[-1])
    finally:
        setup.scene.forcing.close()
    ensemble = setup.ensemble
    epoch = setup.clock.start
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
    """Return bin edges [s after the plan's begin], int64, with one at each end of a run step.

    span: length of the plan [s]; first: its begin [s after the run's start].
    """
    finest = max(SHORTEST, -(-span * particles // POSITIONS))
    last = clock.start + first - clock.phase  # the plan's begin in the lattice's own time
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
    """Return the spread rate [m/sqrt(s)] of each phase of all itineraries; 0: no bridge.

    Uncertain rates count with their median. One more entry at the end stands for arrived particles,
    which are beyond their last phase.
    """
    rates = [
        phase.k if isinstance(phase, Ways) else 0.0 for own in itineraries for phase in own.phases
    ]
    return np.array([*rates, 0.0])


def _flow(ensemble: Ensemble, bridged: Array, time: int) -> Array:
    """Return mean velocity [m/s] (east, north) and K of bridges, float32 (3, n).

    NaN for particles that follow no bridge. time: of the ensemble's columns [s after the run's
    start].
    """
    phase, status, to_time = (
        ensemble.columns[name].to_numpy() for name in ("phase", "status", "to_time")
    )
    on_bridge = (bridged[phase] > 0) & (status == Status.UNDER_WAY) & (to_time > time)
    lon, lat, to_lon, to_lat = (
        ensemble.columns[name].to_numpy()[on_bridge] * sphere.UNIT
        for name in ("lon", "lat", "to_lon", "to_lat")
    )
    flow = np.full((3, len(on_bridge)), np.nan, np.float32)
    flow[2, on_bridge] = bridged[phase[on_bridge]]
    flow[:2, on_bridge] = np.stack(sphere.offset(lon, lat, to_lon, to_lat)) / (
        to_time[on_bridge] - time
    )
    return flow


def _turn(case: Case, ensemble: Ensemble, epoch: int) -> Array:
    """Return when each particle goes adrift [s since 1970], shape (m,).

    -inf in scenarios that do not steer, inf for particles that have arrived or run aground.
    """
    ended = np.isin(ensemble.status.to_numpy(), (Status.ARRIVED, Status.AGROUND))
    turn = np.where(ended, np.inf, epoch + ensemble.release.to_numpy().astype(np.float64))
    steers = np.array([scenario.itinerary is not None for scenario in case.scenarios])
    return np.where(np.repeat(steers, np.diff(ensemble.bounds)), turn, -np.inf)
