"""The steering model: targets that follow an itinerary until they go adrift, if they do.

See docs/targets.md; the kernel is kernels.steering.steer.
"""

import weakref
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from drift.engine.motion.errors.forcing_error import ForcingError
from drift.engine.motion.forcing import Forcing
from drift.engine.motion.period import Period
from drift.engine.motion.steering import itinerary_tables
from drift.engine.motion.steering.itinerary import Itinerary
from drift.engine.particles.ensemble import NEVER, Column, Device, Ensemble
from drift.engine.particles.status import Status
from geo import sphere
from geo.array import Array
from kernels.runtime import batch, rows, runtime
from kernels.runtime.batch import Batch
from kernels.steering import felt, itinerary, pieces, steer
from kernels.steering.pieces import Paths, Room
from kernels.step import advance as kernel
from kernels.step.coast import DeviceCoast

_ARRAYS = dict.fromkeys(steer.WHOLE, "steer_whole") | dict.fromkeys(steer.REAL, "steer_real")
_COLUMNS = (
    Column("birth", np.int32, 0, "", "initial slot: the key of its initial random choices"),
    Column("departure", np.int32, NEVER, "s", "when it gets under way"),
    Column("phase", np.int32, 0, "", "number of its phase among those of all itineraries"),
    Column("leg", np.int32, 0, "", "number of its next way point in the phase"),
    Column("to_lon", np.int32, 0, "binary angle", "longitude of its next way point"),
    Column("to_lat", np.int32, 0, "binary angle", "latitude of its next way point"),
    Column(
        "to_time", np.int32, NEVER, "s", "when it reaches its next way point, or changes its course"
    ),
    Column("phase_end", np.int32, NEVER, "s", "when its phase ends, if a time limits it"),
    Column("course", np.float32, 0, "rad", "its course, if it keeps one, clockwise from north"),
    Column("speed", np.float32, 0, "m/s", "its speed, if one is drawn"),
    Column(
        "set_lon",
        np.int32,
        0,
        "binary angle",
        "distance east of its dead-reckoned place, caused by the current",
    ),
    Column("set_lat", np.int32, 0, "binary angle", "the same, north"),
    Column("set_rate_lon", np.float32, 0, "binary angle/s", "speed of that set, east"),
    Column("set_rate_lat", np.float32, 0, "binary angle/s", "the same, north"),
)
COLUMNS = tuple(replace(column, array=_ARRAYS[column.name]) for column in _COLUMNS)


EVERYWHERE = kernel.Domain(-(2**31), -(2**30), 2**32 - 1, 2**31)


class Steering(NamedTuple):
    """The itineraries of a run by scenario; None for scenarios that only drift."""

    itineraries: tuple[Itinerary | None, ...]
    period: Period
    error: ForcingError  # of the current, for scenarios that do not compensate it

    @property
    def scenarios(self) -> tuple[int, ...]:
        """Numbers of the scenarios that steer."""
        return tuple(k for k, own in enumerate(self.itineraries) if own is not None)

    def adrift(self, scenario: int) -> bool:
        """Return whether anything of a scenario is adrift at some time."""
        own = self.itineraries[scenario]
        return own is None or own.distress is not None

    @property
    def feel(self) -> tuple[int, ...]:
        """Numbers of the scenarios that do not compensate the current."""
        return tuple(
            k
            for k, own in enumerate(self.itineraries)
            if own is not None and own.currents == "felt"
        )


class Helm:
    """Moves the steering targets of one ensemble in one scene."""

    def __init__(
        self,
        ensemble: Ensemble,
        steering: Steering,
        domain: kernel.Domain,
        coast: DeviceCoast | None,
        scenarios: tuple[int, ...] | None = None,
        whole: "Helm | None" = None,
    ) -> None:
        """Write the itineraries to the device.

        Args:
            ensemble: of the targets.
            steering: itineraries of the run.
            domain: of the run.
            coast: on the device; None without one.
            scenarios: numbers of those to steer; None: all that steer.
            whole: the helm of which this is a part; None: it is complete.
        """
        self.batch: Batch = ensemble.batch(steering.scenarios if scenarios is None else scenarios)
        self.plan: Any = (
            whole.plan if whole else itinerary_tables.plan(steering.itineraries, steering.period)
        )
        self._ensemble, self._steering, self._domain = ensemble, steering, domain
        self._coast = (
            coast if any(own and own.land != "ignore" for own in steering.itineraries) else None
        )
        self._parts: dict[tuple[int, ...], Helm] = {}
        # a reference cycle would keep the columns until garbage collection
        self._of = weakref.ref(whole or self)
        self._pieces_recorded = False  # whether the track pieces of the step last kept are recorded
        self._kept: dict[str, Device] = {}

    @property
    def _whole(self) -> "Helm":
        """The helm of which this is a part, which must outlive it."""
        whole = self._of()
        assert whole is not None
        return whole

    @cached_property
    def adrift(self) -> tuple[int, ...]:
        """Numbers of the scenarios whose particles may be adrift at some time."""
        return tuple(k for k in range(len(self._steering.itineraries)) if self._steering.adrift(k))

    @cached_property
    def _move(self) -> kernel.Move:
        e = self._ensemble
        move: kernel.Move = steer.mover(
            columns(e), self.batch, self.plan, e.seed, self._domain, self._coast
        )
        return move

    def some(self, scenarios: Sequence[int]) -> "Helm | None":
        """Return the helm of those of some scenarios that steer; None if none does."""
        asked = set(scenarios)
        chosen = tuple(k for k in self.batch.scenarios if k in asked)
        if chosen == self.batch.scenarios or not chosen:
            return self if chosen else None
        if chosen not in self._parts:
            self._parts[chosen] = Helm(
                self._ensemble, self._steering, self._domain, self._coast, chosen, self._whole
            )
        return self._parts[chosen]

    def paths(
        self,
        kept: Mapping[str, Device],
        step: kernel.Step,
        scenarios: Sequence[int],
        chosen: Array | None = None,
    ) -> Paths | None:
        """Return the target paths of some scenarios in the last step; None if none of these steers.

        They are valid until `keep` is called for another step. chosen: which targets, bool (n,);
        None: all.
        """
        part = self.some(scenarios)
        if part is None:
            return None
        own = part.batch if chosen is None else batch.among(part.batch, chosen)
        return pieces.steered(own, self._made(kept, step), step)

    def born(self, tries: Device) -> None:
        """Draw where and when targets begin and go adrift: see kernels.steering.steer.born."""
        e = self._ensemble
        steer.born(columns(e), self.batch, self.plan, e.seed, self._domain, self._coast, tries)

    def feel(self, forcing: Forcing, step: kernel.Step) -> None:
        """Compute the current set of the targets that do not compensate it, over the step
        to come.
        """
        e, error = self._ensemble, self._steering.error
        same: dict[tuple[int, int], list[int]] = {}
        for number in self._steering.feel:
            same.setdefault(forcing.ranges[number]["current"], []).append(number)
        for ranges, scenarios in same.items():
            part = self.some(scenarios)
            if part:
                felt.feel(
                    columns(e),
                    part.batch,
                    self.plan,
                    e.seed,
                    self._coast,
                    e.own,
                    forcing.tiles,
                    {"current": ranges},
                    error.std,
                    error.time,
                    step,
                )

    def move(self, step: kernel.Step, note: bool = False) -> None:
        """Move the targets over a step, each until its distress.

        note: also record the track pieces; `keep` must have been called, because pieces that do not
        fit are recomputed from the kept columns.
        """
        if not note:
            self._move(step)
            return
        e = self._ensemble
        self._pieces_recorded = steer.move_targets(
            columns(e), self.batch, self.plan, e.seed, self._domain, self._coast, step, self._room
        )

    def keep(self) -> dict[str, Device]:
        """Return a copy of the current columns, from which tracks inside the next step are
        recomputed.

        It is valid until the next call.
        """
        self._pieces_recorded = False
        own = columns(self._ensemble)
        before = {name: rows.located(column)[0] for name, column in self._kept.items()}
        self._kept = rows.rebuilt(own, lambda name, array: runtime.copy(array, before.get(name)))
        return self._kept

    @cached_property
    def _room(self) -> Room:
        return Room(self._ensemble.n)

    def _made(self, kept: Mapping[str, Device], step: kernel.Step) -> Device:
        """Return the track pieces of all steering targets in the last step, computed once for all
        sensors.
        """
        whole = self._whole
        if not whole._pieces_recorded:
            steer.write_pieces(
                kept, whole.batch, whole.plan, self._ensemble.seed, self._coast, step, whole._room
            )
            whole._pieces_recorded = True
        return whole._room.pack

    def velocity(
        self, kept: Mapping[str, Device], step: kernel.Step, time: int
    ) -> tuple[Array, Array]:
        """Return (east, north) [m/s] of targets at a time inside the last step, (n,); 0 if not
        under way.
        """
        e = self._ensemble
        begin = runtime.copy(kept["lon"]), runtime.copy(kept["lat"])
        found = runtime.empty(e.n), runtime.empty(e.n)
        steer.inside(
            kept,
            self.batch,
            self.plan,
            e.seed,
            self._domain,
            self._coast,
            step,
            begin,
            step.elapsed,
            time,
            0,
            found,
        )
        return found[0].to_numpy(), found[1].to_numpy()

    def inside(
        self,
        kept: Mapping[str, Device],
        begin: tuple[Array, Array],
        since: int,
        step: kernel.Step,
        time: int,
        moment: int,
    ) -> tuple[Array, Array]:
        """Return lon, lat [binary angle] (n,) at a time inside the last step; see
        kernels.steering.steer.inside.
        """
        e = self._ensemble
        lon, lat = (runtime.upload(x) for x in begin)
        steer.inside(
            kept,
            self.batch,
            self.plan,
            e.seed,
            self._domain,
            self._coast,
            step,
            (lon, lat),
            since,
            time,
            moment,
        )
        return lon.to_numpy(), lat.to_numpy()


def columns(ensemble: Ensemble) -> dict[str, Device]:
    """Return the columns that the kernel takes, by name."""
    every = ensemble.columns
    return {name: every[name] for name in steer.COLUMNS}


def place_targets(ensemble: Ensemble, slots: Array, new: Mapping[str, Array], time: int) -> None:
    """Place targets that keep a course or act at random times, under way at the end of a step.

    Targets with a new course, and those whose own time has passed, get the new time of their next
    change. The others keep theirs, since that process has no memory. None of them seeks or evades a
    tracker.

    Args:
        ensemble: changed in place.
        slots: of the targets, (m,).
        new: lon, lat, course [rad], speed [m/s], change [s after start], by name, (m,) each.
        time: at which a step ends [s after start].
    """
    every = ensemble.columns
    due = every["to_time"].to_numpy()[slots]
    values = {
        "lon": sphere.to_binary(np.degrees(new["lon"])),
        "lat": sphere.to_binary(np.degrees(new["lat"])),
        "course": new["course"],
        "speed": new["speed"],
        "leg": itinerary.FREE,
        "to_time": np.where((due > time) & ~new["fresh"], due, np.minimum(new["change"], NEVER)),
        "status": int(Status.UNDER_WAY),
        "edge": -1,
        "departure": np.minimum(every["departure"].to_numpy()[slots], time),
    }
    for name, own in values.items():
        column = every[name].to_numpy()
        column[slots] = own
        every[name].from_numpy(column)


def draw_targets(ensemble: Ensemble, steering: Steering, coast: DeviceCoast | None) -> Array:
    """Draw the targets of all scenarios that steer; return (drawn, without water), int64
    (scenarios, 2).
    """
    tries = runtime.upload(np.zeros(2 * len(steering.itineraries), np.int64))
    Helm(ensemble, steering, EVERYWHERE, coast).born(tries)
    return np.asarray(tries.to_numpy().reshape(-1, 2))


def steering(
    itineraries: Sequence[Itinerary | None], period: Period, error: ForcingError
) -> Steering | None:
    """Return the itineraries that a run's scenarios follow; None if none steers; error: of the
    current.
    """
    return (
        Steering(tuple(itineraries), period, error)
        if any(own is not None for own in itineraries)
        else None
    )
