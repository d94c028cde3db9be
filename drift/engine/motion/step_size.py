"""The time step of a run: as given in the case, or the largest with a small error on a sample."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from drift.engine.motion.clock import NEVER, Clock, Timed, lattice, off_lattice_times
from drift.engine.motion.errors.forcing_error import Errors
from drift.engine.motion.period import ClockSpec, Period
from drift.engine.motion.scene import Begin, Scene
from drift.engine.particles import ensemble as record
from drift.engine.particles.ensemble import Ensemble
from drift.engine.particles.status import Status, on_map
from geo import notation, sphere
from geo.array import Array
from geo.errors import UserError
from geo.forcing.sources import Source
from kernels.step import advance as kernel
from kernels.step import curve
from kernels.step.curve import CHORD
from kernels.step.errors import OF_A_STEP

Times = npt.NDArray[np.int64]  # [s since 1970]

# [s] steps that "auto" chooses from
LADDER = (3600, 1800, 1200, 900, 600, 450, 300, 240, 180, 120, 60, 30, 15)
# candidate steps tried together: often the first is accepted
RUNGS = ((0, 1), (1, 5), (5, 9), (9, 13))
FEWEST = 100  # fewest particles for a percentile
# sample size for the step's error: the rank of the percentile has an error of 0.7 %
TRIAL_SIZE = 1000
# [s] longest step with sliding along the shore: inside a step the track is a straight line, which
# at one hour is up to 3.5 km off
SLIDES = 600
WINDOW = 86_400  # [s] over which an error is measured
WINDOWS = 4  # most windows; in a longer run they are evenly spaced from begin to end
DAY = 86_400
HALF_TURN = 180.0  # [deg] cell width of a uniform current


@dataclass(frozen=True)
class Trial:
    """Result of the automatic choice of a step: errors, and how long tracks are straight
    within it.
    """

    step: int
    errors: dict[int, float]  # the 95th percentile of the error [m a day] of each step tried
    straight: int = NEVER  # [s]


def clock_of(
    period: Period,
    spec: ClockSpec,
    errors: Errors,
    sources: Sequence[Source],
    ensemble: Ensemble,
    scene: Scene,
    ends: Sequence[np.datetime64] = (),
    evidence: bool = False,
) -> tuple[Clock, Trial | None]:
    """Return the clock, on the lattice of the forcing's times, and the trial that chose its step.

    The step is the one given, or the largest whose error is small; for a given step the trial is
    None.

    Args:
        period: of the run.
        spec: step, scheme and tolerance of the case.
        errors: of the forcing.
        sources: of all forcing.
        ensemble: of the run.
        scene: of the run.
        ends: times at which a step has to end: contacts at which particles are repopulated.
        evidence: whether evidence uses tracks inside steps, so that their straightness matters.
    """
    times = [notation.epochs(s.times) for s in sources if s.times.size > 1]
    divisor, origin = lattice(times)
    divisor = int(
        np.gcd.reduce(
            [divisor, *(abs(int(end) - origin) for end in notation.epochs(np.array(ends, "M8[s]")))]
        )
    )
    if spec.step is not None and divisor % spec.step and ends:
        raise UserError(
            f"clock.step: {spec.step} s: [resampling] repopulates particles at contacts, so a step must end at each contact; give a "
            f'divisor of {divisor} s, "auto", or contacts at rounder times'
        )
    start, duration, direction = period.epoch, period.duration, period.direction
    limits = {
        **{
            reason: longest
            for model, _ in scene.motions
            for reason, longest in model.longest(errors).items()
        },
        # A particle that strands again waits for the next step: with r this share, its wait is
        # longer by r^2 / 6, 4 %.
        "half of the mean time on the beach": scene.place.beach.stay / 2 or np.inf,
        "the limit for sliding (inside a step its track is a straight line)": SLIDES
        if scene.place.beach.slides
        else np.inf,
        "the interval of the forcing": min(
            (float(np.median(np.diff(t))) for t in times), default=np.inf
        ),
        "the time in which a target set by the current crosses a cell of it": _crossing(
            scene, sources
        ),
    }
    reason, longest = min(limits.items(), key=lambda item: item[1])
    run = Clock(start, duration, direction, 1, 0)
    if spec.step is None:
        trial = choose_step(ensemble, scene, run, divisor, origin, longest, spec.tolerance, times)
        return _stepping(run, trial.step, origin, times, trial.straight), trial
    if spec.step > longest:
        raise UserError(
            f"clock.step: {spec.step} s is longer than {reason}, {longest:.0f} s: the result would depend on it; "
            'give at most that, or "auto"'
        )
    step, straight = spec.step, NEVER
    if evidence:
        march = _March(ensemble, scene, run, [step], origin, times, [step])
        straight = min(found.straight(step) for found in march.windows())
    return _stepping(run, step, origin, times, straight), None


def _stepping(
    run: Clock, step: int, origin: int, times: Sequence[Times], straight: int = NEVER
) -> Clock:
    """Return the clock of a run with a step, on the lattice through `origin` [s since 1970]."""
    return replace(
        run,
        step=step,
        phase=origin % step,
        breaks=off_lattice_times(times, step, origin),
        straight=straight,
    )


def _crossing(scene: Scene, sources: Sequence[Source]) -> float:
    """Return the shortest time [s] in which a target that is set by the current crosses a forcing
    cell.
    """
    felt = [scene.steering.itineraries[k] for k in scene.steering.feel] if scene.steering else []
    fastest = max((itinerary.pace for itinerary in felt if itinerary), default=0.0)
    grids = [
        source.grid
        for source in sources
        if source.quantity == "current" and source.grid.dlon < HALF_TURN
    ]
    if fastest == 0 or not grids:
        return np.inf
    box = scene.place.domain
    highest = max(abs(box.south), abs(box.south + box.height)) * sphere.UNIT
    cells = [min(grid.dlat, grid.dlon * float(np.cos(highest))) for grid in grids]
    return float(np.radians(min(cells)) * sphere.RADIUS / fastest)


def choose_step(
    ensemble: Ensemble,
    scene: Scene,
    clock: Clock,
    divisor: int,
    origin: int,
    longest: float,
    tolerance: float,
    times: Sequence[Times] = (),
) -> Trial:
    """Return the largest candidate step whose error stays below a tolerance.

    The error compares tracks of a sample computed with a step and with half of it, without noise
    (step halving; Hairer, Norsett and Wanner 1993, II.4). It is the distance between their ends per
    day [m a day], or inside a step the distance between the interpolated and the computed position
    [m]. The 95th percentile is used, over particles adrift at the end with both steps, or over
    stranded ones if hardly any is adrift, in the worst of the windows.

    Args:
        ensemble: of the run, of which a sample is taken.
        scene: of the run.
        clock: from begin to end of the run; its step does not matter.
        divisor: [s] the forcing's interval, which all candidate steps divide.
        origin: [s since 1970] a point of the lattice.
        longest: [s] the longest step allowed.
        tolerance: [m a day], and inside a step [m].
        times: of sources [s since 1970], at which steps are split.

    Returns:
        The step, and the errors of all candidates tried.
    """
    ladder = [s for s in LADDER if divisor % s == 0 and s <= longest] or [
        _largest_divisor(divisor, longest)
    ]
    errors: dict[int, float] = {}
    straight: dict[int, int] = {}
    for first, last in RUNGS:
        rungs = ladder[first:last]
        if not rungs:
            break
        steps = sorted({*rungs, *(_half(s) for s in rungs)}, reverse=True)
        for found in _March(ensemble, scene, clock, steps, origin, times, rungs).windows():
            for step in rungs:
                errors[step] = max(errors.get(step, 0.0), found.error(step))
                straight[step] = min(straight.get(step, NEVER), found.straight(step))
        for step in rungs:
            if errors[step] <= tolerance:
                return Trial(step, errors, straight[step])
    return Trial(ladder[-1], errors, straight[ladder[-1]])


@dataclass(frozen=True)
class _Window:
    """Positions of a sample after a part of the run, by step; columns of shape (m,)."""

    ends: dict[int, tuple[Array, Array, Array]]  # lon, lat [binary angle] and status at its end
    days: Array  # drift time of each particle in it, at least one hour
    # [m] how far apart particles are by a step and by its half, half-way in a step
    inside: dict[int, float]
    bulges: dict[int, float]  # [m] by how much a way departs from its chord at most

    def error(self, step: int) -> float:
        """Return the error of a step: see `choose_step`."""
        (lon, lat, status), (lon_half, lat_half, status_half) = (
            self.ends[step],
            self.ends[_half(step)],
        )
        adrift = (status == Status.ADRIFT) & (status_half == Status.ADRIFT)
        if adrift.sum() < FEWEST:  # most stranded: their stranding positions count
            adrift = on_map(status) & on_map(status_half)
        if not adrift.any():
            return 0.0
        apart = _distances(lon, lat, lon_half, lat_half)
        return max(float(np.percentile((apart / self.days)[adrift], 95)), self.inside[step])

    def straight(self, step: int) -> int:
        """Return for how long tracks are straight [s], by kernels.step.curve.CHORD."""
        bulge = self.bulges[step]
        return NEVER if bulge <= CHORD else max(int(step * np.sqrt(CHORD / bulge)), 1)


class _March:
    """A sample that moves through windows of the run with several steps in parallel, without noise.

    All steps share one pass through the forcing, so that it is read once. Particles that strand or
    are lost in a window return in the next one to where they were last afloat, so that each window
    is judged by drifting particles.
    """

    def __init__(
        self,
        ensemble: Ensemble,
        scene: Scene,
        run: Clock,
        steps: list[int],
        origin: int,
        times: Sequence[Times],
        judged: Sequence[int],
    ) -> None:
        """Take the sample.

        Args:
            ensemble: of the run.
            scene: of the run.
            run: its clock.
            steps: [s] descending, each step of a pair followed by its half.
            origin: [s since 1970] a point of the lattice.
            times: of sources [s since 1970], at which steps are split.
            judged: those of the steps whose errors and straightness are asked for.
        """
        chosen = np.unique(
            np.linspace(0, ensemble.n - 1, min(TRIAL_SIZE, ensemble.n)).astype(np.int64)
        )
        self._scene, self._run, self._origin = scene.without_noise(), run, origin
        self._clocks = {step: _stepping(run, step, origin, times) for step in steps}
        self._trials = {step: _without_errors(record.sample(ensemble, chosen)) for step in steps}
        self._stretch = int(np.lcm.reduce(steps))
        self._judged = frozenset(judged)
        self._waiting: dict[int, list[Timed]] = {step: [] for step in steps}
        self._inside: dict[int, curve.Inside] = {}
        first = self._trials[steps[-1]]
        self._lon, self._lat, self._release = (
            first.lon.to_numpy(),
            first.lat.to_numpy(),
            first.release.to_numpy(),
        )

    def windows(self) -> Iterator[_Window]:
        """Yield the sample after each window, for each step."""
        duration, before = self._run.duration, 0
        count = min(max(-(-duration // WINDOW), 1), WINDOWS)
        lasting = min(duration / count, WINDOW)
        for begin in np.linspace(0, duration - lasting, count).astype(int).tolist():
            if begin > before:
                self._skip_to(before, begin)
            before = begin + math.ceil(lasting)
            yield self._run_window(begin, before)

    def _skip_to(self, begin: int, end: int) -> None:
        """Move the sample to the next window in one step: it need only be typical, not accurate."""
        finest = min(self._trials)
        self._start(finest, begin)
        low = self._run.start + self._run.direction * (begin if self._run.direction > 0 else end)
        step = kernel.Step(0, begin, end - begin, self._run.direction)
        trial = self._trials[finest]
        self._scene.advance(trial, low, low + end - begin, step)
        self._afloat(trial.lon.to_numpy(), trial.lat.to_numpy(), trial.status.to_numpy())

    def _start(self, step: int, begin: int) -> None:
        """Place the particles of a trial at the sample's positions."""
        trial = self._trials[step]
        trial.lon.from_numpy(self._lon)
        trial.lat.from_numpy(self._lat)
        trial.release.from_numpy(np.maximum(self._release, begin).astype(np.int32))
        trial.status.fill(int(Status.PENDING))

    def _afloat(self, lon: Array, lat: Array, status: Array) -> None:
        """Move the sample to the positions of a trial's particles that are adrift."""
        adrift = status == Status.ADRIFT
        self._lon, self._lat = np.where(adrift, lon, self._lon), np.where(adrift, lat, self._lat)

    def _run_window(self, begin: int, end: int) -> _Window:
        """Move the sample through a window [s after the run's start]."""
        plan = []
        for size, clock in self._clocks.items():
            self._start(size, begin)
            for low, high, step in clock.steps():
                if begin < step.elapsed + step.duration and step.elapsed < end:
                    together = self._run.direction * ((low - self._origin) // self._stretch)
                    plan.append((together, -size, step.elapsed, Timed(low, high, step)))
        bulges = dict.fromkeys(self._clocks, 0.0)
        # half-way in steps, by step: where, by the whole and by its halves, and who is adrift
        halfway: dict[int, list[tuple[Array, ...]]] = {size: [] for size in self._clocks}
        # by half: when and where, by the whole
        awaited: dict[int, tuple[int, int, Array, Array, Array]] = {}
        seen: set[tuple[int, int]] = set()
        ends: dict[int, tuple[Array, Array, Array]] = {}
        stretch: tuple[int, Timed] | None = None
        for together, minus, _, timed in sorted(plan):
            if stretch is None or stretch[0] != together:
                self._keep_pace(stretch and stretch[1], timed)
                stretch = together, timed
            step, size, trial = timed.step, -minus, self._trials[-minus]
            over = step.elapsed + step.duration
            first = size in self._judged and (together, size) not in seen
            seen.add((together, size))
            is_last = over >= end
            kept = self._move(size, timed, keep=first or over > end)
            if not (kept or is_last or (size in awaited and awaited[size][0] == over)):
                continue
            self._catch_up(size)
            status = trial.status.to_numpy()
            if kept is not None:
                bulges[size] = max(bulges[size], _bulge(kept, trial.lat.to_numpy(), status))
                middle = step.elapsed + _half(size)
                if _half(size) in self._trials and middle < over:
                    places = self._places(size, kept, step, middle)
                    awaited[_half(size)] = (middle, size, *places, status)
            if is_last:
                places = trial.lon.to_numpy(), trial.lat.to_numpy()
                if over > end and kept is not None:
                    places = self._places(size, kept, step, end)
                ends[size] = (*places, status)
            if size in awaited and awaited[size][0] == over:
                _, whole, lon, lat, other = awaited.pop(size)
                both = (status == Status.ADRIFT) & (other == Status.ADRIFT)
                places = trial.lon.to_numpy(), trial.lat.to_numpy()
                halfway[whole].append((lon, lat, *places, both))
        inside = {size: _worst_percentile(found) for size, found in halfway.items()}
        days = np.maximum(end - np.maximum(self._release, begin), 3600) / DAY
        self._afloat(*ends[min(self._trials)])
        return _Window(ends, days, inside, bulges)

    def _move(self, size: int, timed: Timed, keep: bool) -> Begin | None:
        """Move a trial over a step; without `keep`, only once something needs its positions.

        Steps between the same slices then take one launch, which costs more than the work in it.
        """
        if not keep and self._joins(size, timed):
            self._waiting[size].append(timed)
            return None
        self._catch_up(size)
        if keep:
            return self._scene.advance(self._trials[size], *timed, keep=True)
        self._waiting[size].append(timed)
        return None

    def _joins(self, size: int, timed: Timed) -> bool:
        """Return whether a step takes one launch with the steps of its trial that wait.

        Steps that wait lie between the same slices: see `_keep_pace`, and inside a stretch there is
        no time of a source but those that split a step.
        """
        waiting, step = self._waiting[size], timed.step
        if not waiting:
            return True
        last = waiting[-1].step
        return (
            step.duration == last.duration
            and step.number == last.number + step.direction
            and len(waiting) < self._scene.at_once(self._trials[size])
        )

    def _catch_up(self, size: int) -> None:
        """Move a trial over the steps that wait."""
        waiting = self._waiting[size]
        if waiting:
            self._scene.advance(self._trials[size], *waiting[0], count=len(waiting))
            waiting.clear()

    def _keep_pace(self, before: Timed | None, timed: Timed) -> None:
        """Move all trials to the end of a stretch, unless the next has the same slices.

        Otherwise a trial would want slices that the others have done with.
        """
        if before is None or not self._scene.forcing.same_slices(
            (before.low, before.high), (timed.low, timed.high)
        ):
            for size in self._trials:
                self._catch_up(size)

    def _places(self, size: int, kept: Begin, step: kernel.Step, time: int) -> tuple[Array, Array]:
        """Return lon, lat [binary angle] of a trial at a time inside its last step, (m,)."""
        if size not in self._inside:
            self._inside[size] = curve.bind_places(self._trials[size], kept.bend, kept.polar)
        before = kept.lon, kept.lat
        lon, lat = self._inside[size](before, step.elapsed, step.duration, time)
        return lon, lat


def _without_errors(trial: Ensemble) -> Ensemble:
    """Set a trial's random errors of current and wind to zero; return the trial."""
    for name in OF_A_STEP:
        if name in trial.own:
            trial.own[name].fill(0.0)
    return trial


def _distances(lon: Array, lat: Array, other_lon: Array, other_lat: Array) -> Array:
    """Return the distances [m] between places [binary angle], (m,)."""
    return sphere.distance(*(x * sphere.UNIT for x in (lon, lat, other_lon, other_lat)))


def _worst_percentile(halfway: Sequence[tuple[Array, ...]]) -> float:
    """Return the largest 95th percentile of distances [m] over some times.

    halfway: at each time two places [binary angle] of each particle, lon, lat, lon, lat, and which
    particles count, each (m,).
    """
    if not halfway:
        return 0.0
    *places, counts = (np.stack(column) for column in zip(*halfway, strict=True))
    apart, worst = _distances(*places), 0.0
    most = np.where(counts, apart, 0.0).max(axis=1)  # no percentile is larger
    for time in np.argsort(-most):
        if most[time] <= worst:
            break
        worst = max(worst, float(np.percentile(apart[time][counts[time]], 95)))
    return worst


def _bulge(kept: Begin, lat: Array, status: Array) -> float:
    """Return the largest distance of drifting particles' tracks from their chords [m]."""
    bend = np.abs(kept.bend.to_numpy()).reshape(-1, 4)
    x, y = (curve.MOST * (bend[:, k] + bend[:, k + 2]) for k in (0, 1))
    if not kept.polar:
        x *= sphere.UNIT * sphere.RADIUS
        y *= sphere.UNIT * sphere.RADIUS
        x *= np.cos(lat * sphere.UNIT)
    return float(np.hypot(x, y)[status == Status.ADRIFT].max(initial=0.0))


def _half(step: int) -> int:
    """Return half of a step, or a third if that is in whole seconds and the half is not, otherwise
    1 [s].
    """
    return step // 2 if step % 2 == 0 else step // 3 if step % 3 == 0 else 1


def _largest_divisor(number: int, most: float) -> int:
    """Return the largest whole number of seconds, at most a quarter of an hour, that divides
    `number`.
    """
    return next(s for s in range(int(max(min(most, 900, number), 1)), 0, -1) if number % s == 0)
