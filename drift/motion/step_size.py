"""The step of a run: as the case says, or the largest whose error on a sample of its particles is small."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from drift.motion.clock import Clock, lattice
from drift.motion.forcing_error import Errors
from drift.motion.period import ClockSpec, Period
from drift.motion.scene import Scene
from drift.particles import ensemble as record
from drift.particles.ensemble import Ensemble
from drift.particles.status import Status, on_map
from geo import notation, sphere
from geo.array import Array
from geo.errors import UserError
from geo.forcing.sources import Source
from kernels import advance as kernel

LADDER = (3600, 1800, 1200, 900, 600, 450, 300, 240, 180, 120, 60, 30, 15)  # [s] steps that "auto" chooses from
RUNGS = ((0, 1), (1, 5), (5, 9), (9, 13))  # rungs of the ladder that are tried together: often the first one will do
FEWEST = 100  # least particles from which a percentile is taken
TRIAL_SIZE = 1000  # particles whose error decides on the step: the rank of their percentile errs by 0.7 %
TRIAL_SPAN = 86_400  # [s] over which the error is measured
DAY = 86_400
HALF_TURN = 180.0  # [deg] cells as wide as that are of a current that is the same everywhere


@dataclass(frozen=True)
class Trial:
    """Why "auto" chose a step: the 95th percentile of the error [m a day] of each step tried."""

    step: int
    errors: dict[int, float]


def clock_of(
    period: Period, spec: ClockSpec, errors: Errors, sources: Sequence[Source], ensemble: Ensemble, scene: Scene,
    ends: Sequence[np.datetime64] = (),
) -> tuple[Clock, Trial | None]:  # fmt: skip
    """Return the clock, on the lattice of the forcing's times, and why its step was chosen.

    The step is the one asked for, or the largest whose error is small. sources: of all forcing. ends: times at
    which a step has to end, those of contacts at which particles are placed anew.
    """
    times = [notation.epochs(s.times) for s in sources if s.times.size > 1]
    divisor, origin = lattice(times)
    divisor = int(
        np.gcd.reduce([divisor, *(abs(int(end) - origin) for end in notation.epochs(np.array(ends, "M8[s]")))])
    )
    if spec.step is not None and divisor % spec.step and ends:
        raise UserError(
            f"clock.step: {spec.step} s: where particles are placed anew at contacts ([resampling]) a step has to end at each; give a "
            f'divisor of {divisor} s, "auto", or contacts at rounder times'
        )
    start, duration, direction = period.epoch, period.duration, period.direction
    limits = {
        **{reason: longest for model, _ in scene.motions for reason, longest in model.longest(errors).items()},
        "the interval of the forcing": min((float(np.median(np.diff(t))) for t in times), default=np.inf),
        "the time in which what feels the current under way crosses a cell of it": _crossing(scene, sources),
    }
    reason, longest = min(limits.items(), key=lambda item: item[1])
    if spec.step is None:
        ladder_clock = Clock(start, duration, direction, 1, 0)
        trial = choose_step(ensemble, scene, ladder_clock, divisor, origin, longest, spec.tolerance)
        return Clock(start, duration, direction, trial.step, origin % trial.step), trial
    if spec.step > longest:
        raise UserError(
            f"clock.step: {spec.step} s is longer than {reason}, {longest:.0f} s: the result would depend on it; "
            'give at most that, or "auto"'
        )
    return Clock(start, duration, direction, spec.step, origin % spec.step), None


def _crossing(scene: Scene, sources: Sequence[Source]) -> float:
    """Return the shortest time [s] in which a target that feels the current crosses a cell of a current."""
    felt = [scene.steering.itineraries[k] for k in scene.steering.feel] if scene.steering else []
    fastest = max((itinerary.pace for itinerary in felt if itinerary), default=0.0)
    grids = [source.grid for source in sources if source.quantity == "current" and source.grid.dlon < HALF_TURN]
    if fastest == 0 or not grids:
        return np.inf
    box = scene.place.domain
    highest = max(abs(box.south), abs(box.south + box.height)) * sphere.UNIT
    cells = [min(grid.dlat, grid.dlon * float(np.cos(highest))) for grid in grids]
    return float(np.radians(min(cells)) * sphere.RADIUS / fastest)


def choose_step(
    ensemble: Ensemble, scene: Scene, clock: Clock, divisor: int, origin: int, longest: float, tolerance: float
) -> Trial:
    """Return the largest step of the ladder whose error stays under a tolerance [m a day].

    The ladder's steps divide `divisor` [s], the forcing's interval, and are at most `longest` [s]; lattices pass
    through `origin` [s since 1970], one of its times. The error of a step is the distance between tracks of a sample
    with that step and with half of it, noise off, over at most a day: its 95th percentile among those adrift to the end
    with both (step halving; Hairer, Norsett and Wanner 1993, II.4), or ashore if hardly any is.
    """
    ladder = [s for s in LADDER if divisor % s == 0 and s <= longest] or [_largest_divisor(divisor, longest)]
    chosen = np.unique(np.linspace(0, ensemble.n - 1, min(TRIAL_SIZE, ensemble.n)).astype(np.int64))
    release = ensemble.release.to_numpy()[chosen]
    span = min(clock.duration, TRIAL_SPAN + int(release.max()))
    errors: dict[int, float] = {}
    for first, last in RUNGS:
        rungs = ladder[first:last]
        steps = sorted({*rungs, *(_half(s) for s in rungs)})
        ends, elapsed = _march(
            ensemble, scene.without_noise(), chosen, steps, Clock(clock.start, span, clock.direction, 1, origin)
        )
        days = np.maximum(elapsed - np.maximum(release, 0), 3600) / DAY
        for step in rungs:
            coarse, fine = ends[step], ends[_half(step)]
            adrift = (coarse[2] == Status.ADRIFT) & (fine[2] == Status.ADRIFT)
            if adrift.sum() < FEWEST:  # most went ashore: where they did so counts
                adrift = on_map(coarse[2]) & on_map(fine[2])
            apart = sphere.distance(*(x[adrift] * sphere.UNIT for x in (*coarse[:2], *fine[:2])))
            errors[step] = float(np.percentile(apart / days[adrift], 95)) if adrift.any() else 0.0
            if errors[step] <= tolerance:
                return Trial(step, errors)
    return Trial(ladder[-1], errors)


def _march(
    ensemble: Ensemble, scene: Scene, chosen: Array, steps: list[int], clock: Clock
) -> tuple[dict[int, tuple[Array, Array, Array]], int]:
    """Return where a sample ends (lon, lat, status) with each step, and after how long [s].

    All go through the forcing side by side, in stretches that every step divides, so that it is read once.
    """
    if not steps:
        return {}, 0
    stretch = int(np.lcm.reduce(steps))
    trials = {step: record.sample(ensemble, chosen) for step in steps}
    elapsed = 0
    for low, high, whole in Clock(clock.start, clock.duration, clock.direction, stretch, clock.phase % stretch).steps():
        for step, trial in trials.items():
            for k in range(stretch // step):
                begin = low + k * step if clock.direction > 0 else high - (k + 1) * step
                part = kernel.Step(0, whole.elapsed + k * step, step, clock.direction)
                scene.advance(trial, begin, begin + step, part)
        elapsed = whole.elapsed + stretch
    return {s: (t.lon.to_numpy(), t.lat.to_numpy(), t.status.to_numpy()) for s, t in trials.items()}, elapsed


def _half(step: int) -> int:
    """Return half a step, or the largest other share of it in whole seconds."""
    return step // 2 if step % 2 == 0 else step // 3 if step % 3 == 0 else 1


def _largest_divisor(number: int, most: float) -> int:
    """Return the largest whole number of seconds, at most a quarter of an hour, that divides `number`."""
    return next(s for s in range(int(max(min(most, 900, number), 1)), 0, -1) if number % s == 0)
