"""The particles at one time, as products see them, and their mean positions.

A snapshot holds all of them, or a part: whole blocks. What is made of all particles takes them part
by part, so that memory holds one part, however many particles there are.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from drift.engine.particles import partials, status
from drift.engine.particles.partials import Blocks, Partial
from geo import sphere
from geo.array import Array
from kernels.step import tally
from kernels.step.tally import Swarm

KINDS = np.array(
    [
        tally.RESTING
        if code in status.AT_REST
        else tally.MOVING
        if code in status.ON_MAP
        else tally.HIDDEN
        for code in status.Status
    ],
    np.int32,
)


@dataclass(frozen=True)
class Snapshot:
    """The particles at one time, or a part of them; arrays of shape (n,).

    probability is normalised: of all particles, in all statuses, it adds up to 1.
    """

    time: np.datetime64  # UTC
    lon: npt.NDArray[np.int32]  # binary angle
    lat: npt.NDArray[np.int32]
    probability: npt.NDArray[np.float64]
    status: npt.NDArray[np.int32]  # drift.engine.particles.status.Status
    scenario: npt.NDArray[np.int32]
    # int: the particle of the beginning from which it descends; None: itself
    family: Array | None = None
    world: Array | None = None  # int: the world whose unknowns it shares; None: there are none
    # int: of an ensemble of forcings in which it drifts; None: there is none
    member: Array | None = None
    # blocks by which sums are made; None: those of scenarios that stand one after the other
    cut: Blocks | None = None

    @property
    def blocks(self) -> Blocks:
        """The blocks by which sums over particles are made."""
        return self.cut or partials.of_scenarios(self.scenario)

    @property
    def n(self) -> int:
        """Number of particles."""
        return len(self.lon)

    def parts(self) -> "Iterable[Snapshot]":
        """Return itself, as an output that is read in one part."""
        return (self,)


class Output(Protocol):
    """The particles at one time, read part by part, as often as is asked; a Snapshot is one too."""

    @property
    def time(self) -> np.datetime64:
        """When it is, UTC."""

    @property
    def n(self) -> int:
        """Number of particles of all parts."""

    def parts(self) -> Iterable[Snapshot]:
        """Return its parts, which have no block in common."""


def total(output: Output, sums: Callable[[Snapshot], Partial]) -> Partial:
    """Return sums over all particles of an output; sums: those of a part."""
    return partials.merged([sums(part) for part in output.parts()])


def mapped(snapshot: Snapshot) -> Array:
    """Return which particles are on the map, bool (n,).

    They are adrift, under way or at rest, with a probability that cells can hold.
    """
    return np.asarray(status.on_map(snapshot.status) & (snapshot.probability > tally.LEAST))


def swarm(snapshot: Snapshot) -> Swarm:
    """Return the particles as their sums are made of them."""
    return Swarm(snapshot.lon, snapshot.lat, snapshot.probability, snapshot.status, KINDS)


@dataclass(frozen=True)
class Means:
    """Mean positions [deg], NaN where there is no probability: the vector mean on the sphere."""

    all: tuple[float, float]  # all that is on the map
    adrift: tuple[float, float]  # the datum: what moves, adrift or under way
    scenario: Array  # (scenarios, 2), all that is on the map


def vectors(snapshot: Snapshot) -> Partial:
    """Return what mean positions are made of: summed unit vectors of what moves and of what is at
    rest.
    """
    return vectors_by(snapshot, status.at_rest(snapshot.status).astype(np.int64), 2)


def vectors_by(snapshot: Snapshot, code: Array, many: int) -> Partial:
    """Return the summed unit vectors to what is on the map, by weight and by code (n,), 0 to many -
    1.
    """
    lon, lat = snapshot.lon * sphere.UNIT, snapshot.lat * sphere.UNIT
    weight = np.where(mapped(snapshot), snapshot.probability, 0.0)
    flat = weight * np.cos(lat)
    return snapshot.blocks.partial(
        flat * np.cos(lon), flat * np.sin(lon), weight * np.sin(lat), code=code, many=many
    )


def places(of: Partial) -> Array:
    """Return mean positions [deg] by code from sums that `vectors_by` gave, (many, 2)."""
    return np.array([_position(vector) for vector in of.total]).reshape(-1, 2)


def means(of: Partial) -> Means:
    """Return mean positions from sums that `vectors` gave."""
    moving, rest = of.total
    by_scenario = of.by_scenario.sum(axis=1)
    return Means(
        _position(moving + rest),
        _position(moving),
        np.array([_position(vector) for vector in by_scenario]).reshape(-1, 2),
    )


def _position(vector: Array) -> tuple[float, float]:
    """Return (lon, lat) [deg] of a direction; NaN for none."""
    x, y, z = vector
    if not np.hypot(np.hypot(x, y), z) > 0:
        return np.nan, np.nan
    return float(np.degrees(np.arctan2(y, x))), float(np.degrees(np.arctan2(z, np.hypot(x, y))))
