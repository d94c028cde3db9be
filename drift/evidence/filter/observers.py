"""Sensors that observe over a time: fields, barriers, and lines whose crossings are reported.

While the ensemble moves, each sensor keeps for every particle the probability of no change: that
the particle has not touched the field or the line, or has not left the field. Steps are cut at
times when other evidence needs positions, because the tracks are conditioned on those positions.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from drift.engine.motion.ensemble_spec import EnsembleSpec
from drift.engine.motion.scene import Begin, Scene
from drift.engine.motion.simulate import PositionsAt
from drift.engine.particles.ensemble import Ensemble
from drift.evidence.filter.crossings import Watched
from drift.evidence.filter.detection import looks, sensor_shape
from drift.evidence.filter.records import Barrier, Kind, Line, Presence, Sensors
from geo import notation
from geo.array import Array
from kernels.evidence import observe
from kernels.evidence.observe import Shape, Window
from kernels.runtime import runtime
from kernels.steering import pieces
from kernels.steering.pieces import Paths
from kernels.step import curve
from kernels.step.advance import Step

Device = Any
Places = tuple[Device, Device]  # lon and lat

FOR_EVER = 2**31 - 1  # [s] end time of a line, which is observed to the end of the run


@dataclass(eq=False)
class Observer:
    """One sensor in one run; times are seconds after the run's start."""

    what: Presence | Barrier | Line
    begin: int
    end: int
    shape: Shape
    besides: int = observe.WHETHER
    report: tuple[float, float] = (0.0, 1.0)  # time [s] and error [s]
    # the columns `stayed` and, if it is read, `told` of kernels.evidence.observe.observe_along
    columns: dict[str, Device] = field(default_factory=dict)

    def ready(self, n: int) -> dict[str, Device]:
        """Return its columns for n particles; create them on the first call."""
        if not self.columns:
            self.columns = {"stayed": runtime.empty(n)}
            if self.besides != observe.WHETHER:
                first = -1.0 if self.besides == observe.WHEN else 0.0
                self.columns["told"] = runtime.upload(np.full(n, first, np.float32))
        return self.columns

    def likelihood(self, columns: dict[str, Device], over: bool) -> Array | None:
        """Return the log likelihood of its report, float64 (n,); None if there is none yet.

        Before its end, only reports of no change are known: that a field or barrier has reported
        nothing, or that a field still reports the object in it.

        Args:
            columns: of the particles, as `ready` returns them.
            over: whether it has ended.
        """
        stayed = columns["stayed"].to_numpy().astype(np.float64)
        if isinstance(self.what, Presence):
            throughout = self.what.present == "throughout"
            if self.what.present == "sometime" and not over:
                return None
            chance = np.exp(stayed) if throughout else -np.expm1(stayed)
            return looks.log_report_probability(
                chance, self.what.present != "never", self.what.detection, self.what.false_alarms
            )
        if isinstance(self.what, Line):
            return None
        missed = 1 + self.what.detection * np.expm1(stayed)
        if self.what.reported is not None:
            if not over:
                return None
            missed = (
                self.what.detection * columns["told"].to_numpy() + self.what.false_rate * missed
            )
        with np.errstate(divide="ignore"):
            return np.asarray(np.log(missed))

    @property
    def kind(self) -> Kind:
        """The kind of its update."""
        return "presence" if isinstance(self.what, Presence) else "barrier"

    @property
    def positive(self) -> bool:
        """Whether it reports that the object was there."""
        if isinstance(self.what, Presence):
            return self.what.present != "never"
        return isinstance(self.what, Barrier) and self.what.reported is not None


class Observers:
    """All sensors of a run that observe over a time."""

    def __init__(
        self, spec: EnsembleSpec, sensors: Sensors, ensemble: Ensemble, scene: Scene
    ) -> None:
        """Set up for a run of an ensemble, drawn from `spec`, through a scene."""
        self._spec, self._ensemble, self._scene = spec, ensemble, scene
        looking: list[Presence | Barrier] = [*sensors.presences, *sensors.barriers]
        self._waiting = [_create_observer(what, spec) for what in looking]
        self.lines = [_create_observer(line, spec) for line in sensors.lines]
        self.all = (*self._waiting, *self.lines)
        self._step: Step | None = None
        self._begin: Begin | None = None
        # the last time in the step with known positions, and these positions
        self._last_positions: tuple[int, Places] | None = None
        self._cuts = 0  # number of parts of the step so far

    def drop_ended(self, time: int) -> None:
        """Drop the sensors that ended by a time."""
        self._waiting = [seen for seen in self._waiting if seen.end > time]

    def watched(self) -> list[Watched]:
        """Return the lines with their observations so far."""
        found = []
        for seen in self.lines:
            assert isinstance(seen.what, Line)
            stayed, when = seen.ready(self._ensemble.n).values()
            found.append(Watched(seen.what, stayed.to_numpy(), when.to_numpy()))
        return found

    def stops(self, after: int, until: int, step: Step | None = None) -> set[int]:
        """Return the times in (after, until] at which a sensor begins or ends [s after start].

        step: the step between the two times. While a sensor is active, positions are also fixed at
        the ends of the straight pieces of the step.
        """
        times = {time for seen in self._waiting for time in (seen.begin, seen.end)}
        if step is not None and self.looking(until):
            times |= set(curve.edges(step.elapsed, step.duration, step.pieces)[1:-1])
        return {time for time in times if after < time <= until}

    def looking(self, until: int) -> bool:
        """Return whether a sensor is active before a time."""
        return bool(self.lines) or any(seen.begin < until for seen in self._waiting)

    def moved(self, begin: Begin | None) -> None:
        """Store where the particles began the step just made."""
        self._begin = begin

    def before(self, step: Step) -> None:
        """Store the positions at the start of a step, if a sensor is active in it."""
        self._step, self._last_positions, self._cuts = step, None, 0
        end = step.elapsed + step.duration
        if self.looking(end):
            # Nothing moves before the run begins, though its first step may.
            self._last_positions = max(step.elapsed, 0), self._now()

    def _now(self) -> Places:
        return runtime.copy(self._ensemble.lon), runtime.copy(self._ensemble.lat)

    def cut(self, time: int, place: PositionsAt) -> None:
        """Observe until a time at which positions are computed, and continue from there."""
        if self._last_positions is None or time <= self._last_positions[0]:
            return
        lon, lat = place(self._ensemble, self._scene, None, time)
        places = runtime.upload(lon.astype(np.int32)), runtime.upload(lat.astype(np.int32))
        self._observe(
            time, places, [(seen, seen.ready(self._ensemble.n)) for seen in self._active(time)]
        )
        self._last_positions, self._cuts = (time, places), self._cuts + 1

    def watch(self, until: int) -> None:
        """Observe until the end of the step just made."""
        if self._last_positions is not None and until > self._last_positions[0]:
            places = self._ensemble.lon, self._ensemble.lat
            self._observe(
                until,
                places,
                [(seen, seen.ready(self._ensemble.n)) for seen in self._active(until)],
            )
        self._last_positions = None

    def _active(self, until: int) -> list[Observer]:
        """Return the sensors that are active from the last known positions until a time."""
        assert self._last_positions is not None
        return [
            seen
            for seen in (*self._waiting, *self.lines)
            if seen.begin <= self._last_positions[0] and until <= seen.end
        ]

    def _observe(
        self, until: int, places: Places, every: list[tuple[Observer, dict[str, Device]]]
    ) -> None:
        """Update columns of sensors from the last known positions until a time."""
        assert self._step is not None
        assert self._last_positions is not None
        since, before = self._last_positions
        window = Window(self._step.number, self._cuts, since, until - since)
        # drifting particles diffuse about their track
        k = math.sqrt(2 * self._spec.errors.diffusivity)
        for paths in self._paths(before, places, window):
            for seen, columns in every:
                observe.observe_along(
                    self._ensemble,
                    paths,
                    before,
                    places,
                    window,
                    k,
                    seen.shape,
                    seen.besides,
                    seen.report,
                    columns["stayed"],
                    columns.get("told", columns["stayed"]),  # not read with WHETHER
                )

    def _paths(self, before: Places, after: Places, window: Window) -> Iterator[Paths]:
        """Yield the paths of steering targets over the step, then those of drifting particles.

        The paths of drifting particles cover the window alone.
        """
        assert self._step is not None
        helm, e, scenarios = self._scene.helm(self._ensemble), self._ensemble, self._spec.scenarios
        if helm and self._begin and self._begin.helm:
            steered = helm.paths(self._begin.helm, self._step, range(len(scenarios)))
            if steered:
                yield steered
        drifts = e.batch(
            [number for number, own in enumerate(scenarios) if own.model in own.models]
        )
        if drifts.last > drifts.first:  # saves compiling the kernel if all scenarios steer
            begun = self._adrift_from(window.since, before)
            yield pieces.straight(
                e, drifts, begun, after, window.since, window.lasting, window.step
            )

    def _adrift_from(self, since: int, places: Places) -> Places:
        """Return where each particle's drift begins: at `places`, or where it went adrift later.

        since: time of `places` [s after start].
        """
        if self._begin is None or self._begin.helm is None:
            return places
        later = self._ensemble.release.to_numpy() > since
        began = self._begin.lon, self._begin.lat
        lon, lat = (
            np.where(later, new.to_numpy(), old.to_numpy())
            for new, old in zip(began, places, strict=True)
        )
        return runtime.upload(lon), runtime.upload(lat)

    def over(self, time: int) -> list[Observer]:
        """Remove and return the sensors that end at a time."""
        over = [seen for seen in self._waiting if seen.end == time]
        self._waiting = [seen for seen in self._waiting if seen.end != time]
        return over

    def so_far(self, time: int) -> Array | None:
        """Return the log likelihood (n,) of the reports of active sensors until a time; None: none.

        Within a step, it covers the time until positions were last known.
        """
        total: Array | None = None
        looking = [seen for seen in self._waiting if seen.begin < time]
        at_end = self._step is not None and time == self._step.elapsed + self._step.duration
        for seen in looking:
            columns = seen.columns
            if (
                at_end
                and self._last_positions is not None
                and time > self._last_positions[0]
                and seen in self._active(time)
            ):
                own = seen.ready(self._ensemble.n)
                columns = {name: runtime.copy(column) for name, column in own.items()}
                self._observe(time, (self._ensemble.lon, self._ensemble.lat), [(seen, columns)])
            likelihood = seen.likelihood(columns, over=False) if columns else None
            if likelihood is not None:
                total = likelihood if total is None else total + likelihood
        return total


def _create_observer(what: Presence | Barrier | Line, spec: EnsembleSpec) -> Observer:
    """Return the observer of a sensor, set up for a run."""
    if isinstance(what, Line):
        return Observer(what, 0, FOR_EVER, sensor_shape.of_line(what.points), observe.WHEN)
    begin, end = spec.period.elapsed(what.start), spec.period.elapsed(what.end)
    if isinstance(what, Presence):
        return Observer(
            what, begin, end, sensor_shape.of_field(what.field, stays=what.present == "throughout")
        )
    shape = sensor_shape.of_line(what.points)
    if what.reported is None:
        return Observer(what, begin, end, shape)
    report = float(notation.epoch(what.reported) - spec.period.epoch), what.error
    return Observer(what, begin, end, shape, observe.REPORT, report)
