"""The independent sampling units of two paired runs, and standard errors of differences.

The units of a search are its initial particles: each has its own random numbers, and its offspring
belong to it. The units of a spill are its worlds. Two runs on common random numbers draw their
units in pairs, and the pairs are independent. The influence of a unit on a figure is how much the
unit moves it. The variance of a difference of figures is the sum, over the pairs, of squared
differences of influence (the infinitesimal jackknife: Efron 1982, doi:10.1137/1.9781611970319,
chapter 6).

Particles of one scenario have one distribution, those of two scenarios do not. The number of
particles of each scenario is fixed, so its mean influence adds no variance. After resampling, units
are families (Chan and Lai 2013, doi:10.1214/13-AOS1172). The formula is for independent resampling;
systematic resampling varies less, so errors are then rather too large.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from drift.engine.particles.ensemble import Ensemble
from drift.engine.particles.snapshot import Snapshot
from geo.array import Array

# groups of units from which errors of maps are estimated; the relative error of such an error is
# an eighth, 1 / sqrt(2 (GROUPS - 1))
GROUPS = 32


@dataclass(frozen=True)
class SamplingUnits:
    """The independent sampling units, (u,): initial particles, or the worlds of a spill."""

    stratum: Array  # (u,) int: units of one stratum have the same distribution
    begun: Array  # (u,) bool: whether the unit had any weight at the start of the run
    worlds: bool

    @property
    def size(self) -> int:
        """Number of units."""
        return len(self.stratum)

    def of(self, snapshot: Snapshot) -> Array:
        """Return the unit of each particle of a snapshot, int (n,)."""
        if self.worlds:
            assert snapshot.world is not None
            return snapshot.world
        return np.arange(self.size) if snapshot.family is None else snapshot.family

    def error(self, influence: Array) -> float:
        """Return the standard error of a figure from the influence of each unit on it, (u,)."""
        active, strata = influence[self.begun], int(self.stratum.max(initial=0)) + 1
        stratum = self.stratum[self.begun]
        count = np.bincount(stratum, minlength=strata)
        mean = np.bincount(stratum, active, strata) / np.maximum(count, 1)
        spread = np.bincount(stratum, (active - mean[stratum]) ** 2, strata)
        return float(np.sqrt(np.sum(spread * count / np.maximum(count - 1, 1))))

    @property
    def group(self) -> Array:
        """The group of each unit, 0 to GROUPS - 1, (u,).

        The groups have the same number of units of every stratum, give or take one.
        """
        first = np.searchsorted(self.stratum, self.stratum)  # strata are ranges
        return np.asarray((np.arange(self.size) - first) % GROUPS)


def units_of_particles(ensemble: Ensemble) -> SamplingUnits:
    """Return the units of an ensemble at its start."""
    stratum = np.repeat(np.arange(len(ensemble.scenarios)), np.diff(ensemble.bounds))
    return SamplingUnits(stratum, ensemble.log_weight.to_numpy() > -np.inf, worlds=False)


def units_of_worlds(many: int) -> SamplingUnits:
    """Return the units of a spill with `many` worlds."""
    return SamplingUnits(np.zeros(many, np.int64), np.ones(many, bool), worlds=True)


def sum_by_unit(unit: Array, values: Array, units: SamplingUnits) -> Array:
    """Return the sums of particle values by unit, (u,).

    Args:
        unit: unit of each particle, (n,).
        values: values of the particles, (n,).
        units: the sampling units.

    Returns:
        Sums, (u,).
    """
    return np.bincount(unit, values, units.size)


@dataclass(frozen=True)
class Figure:
    """A figure of one run, and the influence of each unit on it."""

    value: float
    influence: Array  # (u,)


@dataclass(frozen=True)
class Difference:
    """A figure of both runs and their difference."""

    time: np.datetime64
    quantity: str
    name: str  # of the share, status, scenario, stretch or sortie
    unit: str
    a: float  # NaN if only the difference is meaningful, as for a shift
    b: float
    difference: float
    error: float  # standard error of the difference (sampling only)

    @property
    def plain(self) -> bool:
        """Whether the difference exceeds two standard errors."""
        return abs(self.difference) > 2 * self.error


def differences(
    time: np.datetime64,
    a: dict[tuple[str, str, str], Figure],
    b: dict[tuple[str, str, str], Figure],
    units: SamplingUnits,
    shifts: Sequence[str] = (),
) -> list[Difference]:
    """Return the differences of the figures that both runs have, by (quantity, name, unit).

    Args:
        time: time of the figures, UTC.
        a: figures of run A.
        b: figures of run B.
        units: the independent units of both runs.
        shifts: quantities of which only the difference is meaningful.

    Returns:
        A row for each figure that both runs have.
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
