"""The model of what steers: targets that follow an itinerary, until they go adrift if they do.

docs/targets.md; the kernel is kernels.steering.steer.
"""

import weakref
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from drift.engine.motion.forcing import Forcing
from drift.engine.motion.forcing_error import ForcingError
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
    Column(
        "birth", np.int32, 0, "", "slot in which it was born: the key of what is settled at birth"
    ),
    Column("departure", np.int32, NEVER, "s", "when it gets under way"),
    Column("phase", np.int32, 0, "", "number of its phase among those of all itineraries"),
    Column("leg", np.int32, 0, "", "number of its next way point in the phase"),
    Column("to_lon", np.int32, 0, "binary angle", "longitude of its next way point"),
    Column("to_lat", np.int32, 0, "binary angle", "latitude of its next way point"),
    Column(
        "to_time", np.int32, NEVER, "s", "when it reaches its next way point, or changes its course"
    ),
    Column("phase_end", np.int32, NEVER, "s", "when its phase is over, where a time says so"),
    Column("course", np.float32, 0, "rad", "its course, where it keeps one, clockwise from north"),
    Column("speed", np.float32, 0, "m/s", "its speed, where one is drawn"),
    Column(
        "set_lon",
        np.int32,
        0,
        "binary angle",
        "how far the current has set it east of its dead-reckoned place",
    ),
    Column("set_lat", np.int32, 0, "binary angle", "the same, north"),
    Column("set_rate_lon", np.float32, 0, "binary angle/s", "how fast it sets it east"),
    Column("set_rate_lat", np.float32, 0, "binary angle/s", "the same, north"),
)
COLUMNS = tuple(replace(column, array=_ARRAYS[column.name]) for column in _COLUMNS)


EVERYWHERE = kernel.Domain(-(2**31), -(2**30), 2**32 - 1, 2**31)


class Steering(NamedTuple):
    """The itineraries of a run: one a scenario, None for those that only drift."""

    itineraries: tuple[Itinerary | None, ...]
    period: Period
    error: ForcingError  # of the current, which some feel

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
        """Numbers of the scenarios that do not make good the current."""
        return tuple(
            k
            for k, own in enumerate(self.itineraries)
            if own is not None and own.currents == "felt"
        )


class Helm:
    """What steers the targets of one ensemble in one scene."""

    def __init__(
        self,
        ensemble: Ensemble,
        steering: Steering,
        domain: kernel.Domain,
        coast: DeviceCoast | None,
        scenarios: tuple[int, ...] | None = None,
        whole: "Helm | None" = None,
    ) -> None:
        """Lay out the itineraries on the device; scenarios: numbers of those that it steers, by
        default all that do.

        whole: of which it is a part, if it is one.
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
        # a cycle of these would keep the columns until garbage is collected
        self._of = weakref.ref(whole or self)
        self._noted = False  # whether the pieces of way of the step last kept are in the room
        self._kept: dict[str, Device] = {}

    @property
    def _whole(self) -> "Helm":
        """What it is a part of, which outlives it."""
        whole = self._of()
        assert whole is not None
        return whole

    @cached_property
    def adrift(self) -> tuple[int, ...]:
        """Numbers of the run's scenarios of which anything is adrift at some time."""
        return tuple(k for k in range(len(self._steering.itineraries)) if self._steering.adrift(k))

    @cached_property
    def _move(self) -> kernel.Move:
        e = self._ensemble
        move: kernel.Move = steer.mover(
            columns(e), self.batch, self.plan, e.seed, self._domain, self._coast
        )
        return move

    def some(self, scenarios: Sequence[int]) -> "Helm | None":
        """Return what steers those of some scenarios that steer; None: none does."""
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
        """Return the paths of the targets of some scenarios in the step just made; None: none of
        these steers.

        They hold until the columns of another step are kept. chosen: which of the targets, bool
        (n,); None: all.
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
        """Ask the current how fast it sets those off over the step about to be made that do not
        make it good.
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
        """Move the targets over a step, each until its distress; note: the pieces of way that they
        make, too.

        Columns must have been kept, then: they are asked where there is no room for all pieces.
        """
        if not note:
            self._move(step)
            return
        e = self._ensemble
        self._noted = steer.move_targets(
            columns(e), self.batch, self.plan, e.seed, self._domain, self._coast, step, self._room
        )

    def keep(self) -> dict[str, Device]:
        """Return the columns as they are now, from which ways inside the step that comes are made
        again.

        They hold until the columns of another step are kept.
        """
        self._noted = False
        own = columns(self._ensemble)
        before = {name: rows.located(column)[0] for name, column in self._kept.items()}
        self._kept = rows.rebuilt(own, lambda name, array: runtime.copy(array, before.get(name)))
        return self._kept

    @cached_property
    def _room(self) -> Room:
        return Room(self._ensemble.n)

    def _made(self, kept: Mapping[str, Device], step: kernel.Step) -> Device:
        """Return the pieces of way of all that steers in the step just made; they are made once for
        all sensors.
        """
        whole = self._whole
        if not whole._noted:
            steer.write_pieces(
                kept, whole.batch, whole.plan, self._ensemble.seed, self._coast, step, whole._room
            )
            whole._noted = True
        return whole._room.pack

    def velocity(
        self, kept: Mapping[str, Device], step: kernel.Step, time: int
    ) -> tuple[Array, Array]:
        """Return (east, north) [m/s] of targets at a time inside the step just made, (n,); 0 of
        what is not under way.
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
        """Return lon, lat [binary angle] (n,) at a time inside the step just made; see
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
    """Place targets that keep a course or act again, under way at a time at which a step ends [s
    after start].

    slots: (m,); new: lon, lat, course [rad], speed [m/s], change [s after start]: when those change
    their course or act next that are fresh, or whose own time for it is past. The others keep
    theirs: it has no memory. None seeks or hides.
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
    """Draw the targets of all scenarios that steer; return (drawn, without water) by scenario,
    int64 (scenarios, 2).
    """
    tries = runtime.upload(np.zeros(2 * len(steering.itineraries), np.int64))
    Helm(ensemble, steering, EVERYWHERE, coast).born(tries)
    return np.asarray(tries.to_numpy().reshape(-1, 2))


def steering(
    itineraries: Sequence[Itinerary | None], period: Period, error: ForcingError
) -> Steering | None:
    """Return what a run's scenarios have of itineraries;

    None: nothing steers. error: of the current.
    """
    return (
        Steering(tuple(itineraries), period, error)
        if any(own is not None for own in itineraries)
        else None
    )
