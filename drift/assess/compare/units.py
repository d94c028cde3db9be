"""What was drawn independently in a run, and what chance does to a difference of two runs that
share it.

The units of a search are its particles as they began: each has its own random numbers, and its
offspring count with it. Those of a spill are its worlds. Two runs on common random numbers draw
their units in pairs, which are independent of each other. A figure's influence says how much each
unit moves it; the variance of a difference of figures is that of the differences of influence,
summed over the pairs (the infinitesimal jackknife: Efron 1982, doi:10.1137/1.9781611970319, chapter
6). Particles of a scenario are drawn from one law, those of two are not: the mean influence of each
scenario, whose number of particles is fixed, is no chance. Where particles were drawn again, units
are families (Chan and Lai 2013, doi:10.1214/13-AOS1172): a systematic draw varies less than the
independent one that this holds for, so that errors are then rather too large.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from drift.engine.particles.ensemble import Ensemble
from drift.engine.particles.snapshot import Snapshot
from geo.array import Array

# of units, by which errors of maps are told: they err by an eighth themselves, 1 / sqrt(2 (GROUPS -
# 1))
GROUPS = 32


@dataclass(frozen=True)
class Units:
    """What was drawn independently, (u,): particles as they began, or the worlds of a spill."""

    stratum: Array  # (u,) int: units of one stratum are drawn from one law
    begun: Array  # (u,) bool: whether it had any weight when the run began
    worlds: bool

    @property
    def size(self) -> int:
        """How many there are."""
        return len(self.stratum)

    def of(self, snapshot: Snapshot) -> Array:
        """Return the unit of each particle of a snapshot, int (n,)."""
        if self.worlds:
            assert snapshot.world is not None
            return snapshot.world
        return np.arange(self.size) if snapshot.family is None else snapshot.family

    def error(self, influence: Array) -> float:
        """Return the standard error of a figure from the influence of each unit on it, (u,)."""
        own, many = influence[self.begun], int(self.stratum.max(initial=0)) + 1
        stratum = self.stratum[self.begun]
        count = np.bincount(stratum, minlength=many)
        mean = np.bincount(stratum, own, many) / np.maximum(count, 1)
        spread = np.bincount(stratum, (own - mean[stratum]) ** 2, many)
        return float(np.sqrt(np.sum(spread * count / np.maximum(count - 1, 1))))

    @property
    def group(self) -> Array:
        """The group, 0 to GROUPS - 1, of each unit, (u,): each has as many of every stratum, give
        or take one.
        """
        first = np.searchsorted(self.stratum, self.stratum)  # strata are ranges
        return np.asarray((np.arange(self.size) - first) % GROUPS)


def of_particles(ensemble: Ensemble) -> Units:
    """Return the units of an ensemble that has just been drawn."""
    stratum = np.repeat(np.arange(len(ensemble.scenarios)), np.diff(ensemble.bounds))
    return Units(stratum, ensemble.log_weight.to_numpy() > -np.inf, worlds=False)


def of_worlds(many: int) -> Units:
    """Return the units of a spill of so many worlds."""
    return Units(np.zeros(many, np.int64), np.ones(many, bool), worlds=True)


def summed(unit: Array, values: Array, units: Units) -> Array:
    """Return the sums of values (n,) of particles by unit, (u,)."""
    return np.bincount(unit, values, units.size)


@dataclass(frozen=True)
class Figure:
    """A number of one run, and how much each unit moves it."""

    value: float
    influence: Array  # (u,)


@dataclass(frozen=True)
class Difference:
    """A figure of both runs and their difference."""

    time: np.datetime64
    quantity: str
    name: str  # of what: a share, a status, a scenario, a stretch, a sortie
    unit: str
    a: float  # NaN: it is a difference by itself, like a shift
    b: float
    difference: float
    error: float  # standard error of the difference, of chance alone

    @property
    def plain(self) -> bool:
        """Whether the difference is more than two standard errors."""
        return abs(self.difference) > 2 * self.error


def differences(
    time: np.datetime64,
    a: dict[tuple[str, str, str], Figure],
    b: dict[tuple[str, str, str], Figure],
    units: Units,
    shifts: Sequence[str] = (),
) -> list[Difference]:
    """Return the differences of figures that both runs have, by (quantity, name, unit).

    shifts: quantities of which neither run has a value of its own.
    """
    rows = []
    for key in (key for key in a if key in b):
        one, other, alone = a[key], b[key], key[0] in shifts
        values = (np.nan, np.nan) if alone else (one.value, other.value)
        error = units.error(other.influence - one.influence)
        if not np.isfinite(other.value - one.value):
            error = np.nan
        rows.append(Difference(time, *key, *values, other.value - one.value, error))
    return rows
