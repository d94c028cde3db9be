"""Drifting buoys and reports on scene, which show the errors of current and wind where they are.

`buoy_errors` conditions the errors on the fixes of buoys and on reports; this module holds the
result for the steps of a run and has each particle share the errors of the places near it
(kernels.step.buoys, for which a report's place is a buoy that does not move). Why each particle draws
deviations of its own: it is one possible position of one object, with one possible course of the
errors at these places. In a spill the objects of one world share one course.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from drift.engine.motion.clock import Clock
from drift.engine.motion.errors import buoy_errors
from drift.engine.motion.errors.buoy_errors import Conditioned, Law, Sight
from drift.engine.particles.ensemble import Column, Device, Ensemble
from geo import sphere
from geo.array import Array
from kernels.maths import noise
from kernels.runtime import launch, rows, runtime
from kernels.step import buoys as kernel
from kernels.step.advance import Step
from kernels.step.errors import ROWS


@dataclass(frozen=True)
class BuoyTrack:
    """The believable fixes of one buoy.

    Attributes:
        name: unique in a case.
        time: UTC [s since 1970], ascending, (n,).
        lon: [deg], (n,).
        lat: [deg], (n,).
        fresh: whether a fix begins a stretch, across whose begin nothing is concluded, (n,).
        error: standard deviation of each component of a fix [m].
        windage: share of the wind that moves it.
        notes: on fixes that were left out.
    """

    name: str
    time: Array
    lon: Array
    lat: Array
    fresh: npt.NDArray[np.bool_]
    error: float
    windage: float
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class PointReport:
    """A wind or current that somebody on scene measured or estimated.

    Attributes:
        name: unique in a case.
        quantity: "wind" or "current".
        time: UTC [s since 1970], whole seconds.
        lon: [deg].
        lat: [deg].
        velocity: east and north [m/s], toward which it blows or flows.
        error: standard deviation of each component [m/s].
    """

    name: str
    quantity: str
    time: float
    lon: float
    lat: float
    velocity: tuple[float, float]
    error: float


def states(places: int, buoys: int, windy: bool, biased: bool) -> int:
    """Return the number of states of each component of the errors.

    Args:
        places: number of buoys and of the places of reports.
        buoys: number of buoys alone, which have displacements.
        windy: whether there are errors of the wind.
        biased: whether the current has a constant bias.
    """
    return places * (1 + int(windy) + int(biased)) + buoys


def _column_names(buoys: int, many: int) -> list[str]:
    """Return the names of the columns of deviations, of `many` states, and of distances."""
    states_of = [f"buoy_state_{k}_{side}" for k in range(many) for side in ("east", "north")]
    return states_of + [f"buoy_distance_{k}" for k in range(buoys)]


def columns(buoys: int, many: int) -> tuple[Column, ...]:
    """Return the columns of particles that share the errors of buoys, of `many` states; none for no
    buoys.
    """
    if not buoys:
        return ()
    found = []
    for name in _column_names(buoys, many):
        far = name.startswith("buoy_distance")
        meaning = (
            "distance from a buoy at the begin of the last step"
            if far
            else "deviation of the errors at buoys from their mean"
        )
        found.append(Column(name, np.float32, 0, "m" if far else "", meaning, "buoys"))
    for name in kernel.SHARED:
        own = name.startswith("own")
        meaning = "factor of its own normal" if own else "what buoys give of its normal"
        found.append(
            Column(name, np.float32, float(own), "", f"{meaning} in the last step", "shared")
        )
    return tuple(found)


@dataclass(frozen=True, eq=False)
class Buoys:
    """The errors at some buoys and reports given these, by steps of a run.

    Attributes:
        names: of the buoys, which are the first places.
        sights: what the reports show, each at one of the other places.
        law: the prior of the errors.
        given: the errors given all of them; its hypotheses are (scenario, member), member last.
        places: lon, lat of each place at the begin of each step [deg], (steps, m, 2).
        factors: Cholesky factors of the correlations between the places of the errors of current and
            wind in the middle of each step, (steps, 2, m, m).
        numbers: of the steps.
        edges: times of the steps [s after the run's start], (steps + 1,).
        windy: whether there are errors of the wind.
        members: of the forcing ensemble, 1 without one.
        worlds: whether the particles of a world share one deviation.
    """

    names: tuple[str, ...]
    sights: tuple[Sight, ...]
    law: Law
    given: Conditioned
    places: Array
    factors: Array
    numbers: tuple[int, ...]
    edges: Array
    windy: bool
    members: int
    worlds: bool

    @cached_property
    def rows(self) -> Mapping[int, int]:
        """The row of each step in the tables on the device, by its number."""
        return {number: row for row, number in enumerate(self.numbers, 1)}

    def parts(self, place: int, of_wind: bool) -> Array:
        """Return the share of each state in the error at a place [m/s], (states,).

        Args:
            place: number of the place.
            of_wind: of the wind's error, not of the current's.
        """
        states = self.given.moves.shape[1]
        return buoy_errors.parts_of_error(
            self.law, self.places.shape[1], states, self.windy, place, of_wind
        )

    def log_weights(self, scenario: Array, member: Array | None) -> Array:
        """Return what fixes and reports add to particles' log weights, (n,); 0 for the likeliest forcing.

        Args:
            scenario: number of each particle's scenario, (n,).
            member: of the forcing ensemble, (n,); None: there is no ensemble.
        """
        most = self.given.log_likelihood - self.given.log_likelihood.max()
        which = scenario * self.members + (0 if member is None else member)
        return np.asarray(most[which])


class Sharer:
    """Writes the innovations that one ensemble shares with buoys; holds the tables on the device."""

    def __init__(self, buoys: Buoys, ensemble: Ensemble) -> None:
        self._buoys, self._ensemble = buoys, ensemble
        given, m = buoys.given, buoys.places.shape[1]
        many = given.moves.shape[1]
        names, own = _column_names(m, many), ensemble.own
        halves = np.stack(
            [given.means[:-1], given.means[1:]], axis=2
        )  # (steps, hypotheses, 2, ...)
        mixes = np.linalg.inv(buoys.factors)
        x, y = sphere.to_binary(buoys.places[..., 0]), sphere.to_binary(buoys.places[..., 1])
        kicks = np.concatenate([given.first[None], given.kicks])
        drawn = (kicks != 0).any(axis=1)
        order = np.where(drawn, np.cumsum(drawn, axis=1) - 1, -1)
        self._tables = launch.pack(
            kernel.Tables,
            _padded(given.moves, np.float32),
            runtime.upload(kicks.astype(np.float32).ravel()),
            runtime.upload(order.astype(np.int32).ravel()),
            _padded(halves, np.float32),
            _padded(mixes, np.float32),
            _padded(np.stack([x, y], axis=-1), np.int32),
        )
        member = own["member"] if buoys.members > 1 else runtime.upload(np.zeros(1, np.int32))
        self._particles = launch.pack(
            kernel.Particles,
            *(ensemble.scenario, ensemble.world, member, ensemble.status, ensemble.release),
            *(ensemble.lon, ensemble.lat),
            *(rows.whole(own, each) for each in (ROWS, names, kernel.SHARED)),
        )
        law = buoys.law
        self._numbers = {
            "buoys": m,
            "states": many,
            "windy": int(buoys.windy),
            "biased": int(law.biased),
            "current_std": law.current_std,
            "wind_std": law.wind_std,
            "bias_std": law.bias_std,
            "current_length": law.current_length,
            "wind_length": law.wind_length,
            "members": buoys.members,
            "worlds": int(buoys.worlds),
        }

    def write(self, step: Step) -> None:
        """Write the innovations of the step that is about to be computed."""
        ensemble = self._ensemble
        row, lengths = self._buoys.rows[step.number], np.diff(self._buoys.edges)
        # the distance in the middle of the step is extrapolated
        ahead = 0.0 if row == 1 else 0.5 * lengths[row - 1] / lengths[row - 2]
        law = self._buoys.law
        numbers = kernel.Numbers(
            **self._numbers,
            current_keep=np.exp(-step.duration / law.current_time),
            wind_keep=np.exp(-step.duration / law.wind_time),
            begins=int(row == 1),
            ahead=float(ahead),
        )
        shift = ensemble.batch(range(len(ensemble.numbers))).shift
        kernel.share_errors(
            ensemble.n,
            shift,
            self._particles,
            self._tables,
            numbers,
            row,
            step.number,
            step.elapsed + step.duration,
            noise.key(ensemble.seed),
        )


def _padded(values: Array, kind: type) -> Device:
    """Return a table with one more row, of zeros, in front, flat on the device."""
    front = np.zeros((1, *values.shape[1:]))
    return runtime.upload(np.concatenate([front, values]).astype(kind).ravel())


def step_edges(clock: Clock) -> tuple[Array, tuple[int, ...]]:
    """Return the times of a run's steps [s after start], (steps + 1,), and their numbers."""
    steps = [timed.step for timed in clock.steps()]
    edges = [step.elapsed for step in steps] + [steps[-1].elapsed + steps[-1].duration]
    return np.array(edges, np.float64), tuple(step.number for step in steps)


def write_shared(
    buoys: Buoys | None, ensemble: Ensemble, step: Step, held: dict[Any, Any], key: Any
) -> None:
    """Write the shared innovations of a step, if there are buoys.

    held, key: where the tables are kept.
    """
    if buoys is None:
        return
    if key not in held or held[key][0][2] is not ensemble.layout:
        held[key] = (buoys, ensemble, ensemble.layout), Sharer(buoys, ensemble)
    held[key][1].write(step)
