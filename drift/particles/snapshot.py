"""The particles at one time, as products see them, and their mean positions."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from drift.particles import partials, status
from drift.particles.partials import Blocks
from geo import sphere
from geo.array import Array
from geo.cells import ONE


@dataclass(frozen=True)
class Snapshot:
    """The particles at one time; probability is normalised, sum 1 over all statuses; arrays of shape (n,)."""

    time: np.datetime64  # UTC
    lon: npt.NDArray[np.int32]  # binary angle
    lat: npt.NDArray[np.int32]
    probability: npt.NDArray[np.float64]
    status: npt.NDArray[np.int32]  # drift.particles.status.Status
    scenario: npt.NDArray[np.int32]
    family: Array | None = None  # int: the particle of the beginning from which it descends; None: itself
    world: Array | None = None  # int: the world whose unknowns it shares; None: there are none
    cut: Blocks | None = None  # blocks by which sums are made; None: by slots alone

    @property
    def blocks(self) -> Blocks:
        """The blocks by which sums over particles are made."""
        return self.cut or partials.whole(len(self.lon))


def mapped(snapshot: Snapshot) -> Array:
    """Return which particles are on the map, bool (n,).

    They are adrift, under way or at rest, with a probability that cells can hold.
    """
    return np.asarray(status.on_map(snapshot.status) & (snapshot.probability > 0.5 / ONE))


@dataclass(frozen=True)
class Means:
    """Mean positions [deg], NaN where there is no probability: the vector mean on the sphere."""

    all: tuple[float, float]  # all that is on the map
    adrift: tuple[float, float]  # the datum: what moves, adrift or under way
    scenario: Array  # (scenarios, 2), all that is on the map


def means(snapshot: Snapshot, scenarios: int) -> Means:
    """Return the mean positions of a snapshot."""
    code = snapshot.scenario.astype(np.int64) * 2 + np.isin(snapshot.status, status.AT_REST)
    sums = _vectors(snapshot, code, 2 * scenarios).reshape(3, scenarios, 2)
    return Means(
        _position(sums.sum(axis=(1, 2))),
        _position(sums[:, :, 0].sum(axis=1)),
        np.array([_position(sums[:, i].sum(axis=1)) for i in range(scenarios)]).reshape(scenarios, 2),
    )


def means_by(snapshot: Snapshot, code: Array, many: int) -> Array:
    """Return the mean positions [deg] of all that is on the map, by code (n,), 0 to many - 1: (many, 2)."""
    return np.array([_position(vector) for vector in _vectors(snapshot, code, many).T]).reshape(many, 2)


def _vectors(snapshot: Snapshot, code: Array, many: int) -> Array:
    """Return the sums of weighted unit vectors to what is on the map, by code (n,), (3, many)."""
    lon, lat, weight = (
        snapshot.lon * sphere.UNIT,
        snapshot.lat * sphere.UNIT,
        np.where(mapped(snapshot), snapshot.probability, 0.0),
    )
    flat = weight * np.cos(lat)
    vector = flat * np.cos(lon), flat * np.sin(lon), weight * np.sin(lat)
    return snapshot.blocks.table(code, many, *vector)


def _position(vector: Array) -> tuple[float, float]:
    """Return (lon, lat) [deg] of a direction; NaN for none."""
    x, y, z = vector
    if not np.hypot(np.hypot(x, y), z) > 0:
        return np.nan, np.nan
    return float(np.degrees(np.arctan2(y, x))), float(np.degrees(np.arctan2(z, np.hypot(x, y))))
