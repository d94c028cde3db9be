"""The particles at one time, as products read them, and their mean positions.

A snapshot holds all particles or a part of them (whole blocks). Products process an `Output` part
by part, so that memory holds one part at a time.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

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

    The probabilities of all particles of an output, in all statuses, add up to 1.
    """

    time: np.datetime64  # UTC
    lon: npt.NDArray[np.int32]  # binary angle
    lat: npt.NDArray[np.int32]
    probability: npt.NDArray[np.float64]
    status: npt.NDArray[np.int32]  # drift.engine.particles.status.Status
    scenario: npt.NDArray[np.int32]
    # int: number of the initial particle from which it descends; None: itself
    family: Array | None = None
    world: Array | None = None  # int: the world whose unknowns it shares; None: there are none
    # int: the forcing ensemble member in which it drifts; None: there is no ensemble
    member: Array | None = None
    # blocks in which sums are computed; None: derived from the scenarios, which are contiguous
    cut: Blocks | None = None

    @property
    def blocks(self) -> Blocks:
        """The blocks in which sums over particles are computed."""
        return self.cut or partials.of_scenarios(self.scenario)

    @property
    def n(self) -> int:
        """Number of particles."""
        return len(self.lon)

    def parts(self) -> "Iterable[Snapshot]":
        """Return the snapshot as the only part of an output."""
        return (self,)


class Output(Protocol):
    """All particles at one time, readable part by part any number of times; a Snapshot is
    one too.
    """

    @property
    def time(self) -> np.datetime64:
        """Time of the output, UTC."""

    @property
    def n(self) -> int:
        """Number of particles in all parts."""

    def parts(self) -> Iterable[Snapshot]:
        """Return the parts; no two of them share a block."""


Question = Callable[
    [Any], Any
]  # of an Output; what it returns can be merged with that of other particles


class Deal(Protocol):
    """Answers a question about each of some outputs, here or by workers."""

    def __call__(
        self, outputs: Sequence[Output], questions: Sequence[Question]
    ) -> Iterator[Sequence[Any]]:
        """Yield the answers to each output's question: of parts of its particles, in their order.

        Args:
            outputs: the particles at some times.
            questions: one for each output; they can be sent to another process.
        """


def answer_here(
    outputs: Sequence[Output], questions: Sequence[Question]
) -> Iterator[Sequence[Any]]:
    """Yield the answer to each output's question of all its particles: a `Deal` of this process."""
    return ([question(output)] for output, question in zip(outputs, questions, strict=True))


def total(output: Output, sums: Callable[[Snapshot], Partial]) -> Partial:
    """Return sums over all particles of an output; sums: computes those of one part."""
    return partials.merge_partials([sums(part) for part in output.parts()])


def mapped(snapshot: Snapshot) -> Array:
    """Return which particles are on the map, bool (n,).

    They are adrift, under way or at rest, and their probability is large enough for the fixed-point
    deposits in cells.
    """
    return np.asarray(status.on_map(snapshot.status) & (snapshot.probability > tally.LEAST))


def swarm(snapshot: Snapshot) -> Swarm:
    """Return the particles as the kernels in kernels.step.tally take them."""
    return Swarm(snapshot.lon, snapshot.lat, snapshot.probability, snapshot.status, KINDS)


def status_sums(output: Output) -> Partial:
    """Return the summed probability of each status."""
    return total(output, _status_sums_of_part)


def _status_sums_of_part(part: Snapshot) -> Partial:
    return part.blocks.partial(part.probability, code=part.status, many=len(status.Status))


@dataclass(frozen=True)
class Means:
    """Mean positions [deg], vector means on the sphere; NaN where there is no probability."""

    all: tuple[float, float]  # all particles on the map
    adrift: tuple[float, float]  # the datum: moving particles, adrift or under way
    scenario: Array  # (scenarios, 2), all particles on the map


def vectors(snapshot: Snapshot) -> Partial:
    """Return summed unit vectors of the moving particles and of those at rest, from which `means`
    computes mean positions.
    """
    return vectors_by(snapshot, status.at_rest(snapshot.status).astype(np.int64), 2)


def vectors_by(snapshot: Snapshot, code: Array, many: int) -> Partial:
    """Return the weighted sums of unit vectors of particles on the map, by code (n,), 0 to many -
    1.
    """
    lon, lat = snapshot.lon * sphere.UNIT, snapshot.lat * sphere.UNIT
    weight = np.where(mapped(snapshot), snapshot.probability, 0.0)
    flat = weight * np.cos(lat)
    return snapshot.blocks.partial(
        flat * np.cos(lon), flat * np.sin(lon), weight * np.sin(lat), code=code, many=many
    )


def places(of: Partial) -> Array:
    """Return mean positions (lon, lat) [deg] by code, (many, 2), from the sums of `vectors_by`."""
    return np.array([_position(vector) for vector in of.total]).reshape(-1, 2)


def means(of: Partial) -> Means:
    """Return mean positions from the sums of `vectors`."""
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
