"""Test a fitted error law on held-out drifters: log likelihood, and coverage of ellipses."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from drift.assess.verify import along, error_law
from drift.assess.verify.along import Displacements
from drift.assess.verify.error_law import Law, Likelihood
from drift.tracking.tracks import clusters
from drift.tracking.tracks.clusters import Estimate
from geo.array import Array

# [s] length of a block of one drifter's track; longer than the correlation time of errors
BLOCK = 3 * 86_400.0
LEADS = (3.0, 6.0, 12.0, 24.0)  # [h]
SHARES = (0.5, 0.9)
DAY = 86_400.0


@dataclass(frozen=True)
class Halves:
    """The displacements that are fitted, those held out, and how they were divided, in words."""

    fitted: tuple[Displacements, ...]
    held: tuple[Displacements, ...]
    how: str


@dataclass(frozen=True)
class Coverage:
    """How often the ellipse of a stated share holds the displacement over some hours."""

    hours: float
    share: float
    held: Estimate


@dataclass(frozen=True)
class HoldOut:
    """How well a law fitted to one half suits both halves.

    own, other: log likelihood per increment of the fitted half and of the held-out half.
    increments, coverage: of the held-out half.
    """

    how: str
    law: Law
    own: float
    other: float
    increments: int
    coverage: tuple[Coverage, ...]


def split_halves(ways: Sequence[Displacements]) -> Halves:
    """Split displacements in halves: every other drifter, or every other block of days of one.

    Drifters are in the order of their first fixes.
    """
    if len(ways) > 1:
        order = sorted(ways, key=lambda way: float(way.time[0]))
        return Halves(
            tuple(order[0::2]), tuple(order[1::2]), f"every other of {len(ways)} drifters"
        )
    (way,) = ways
    block = (way.time - way.time[0]) // BLOCK % 2
    how = f"every other {BLOCK / DAY:g} days of the one drifter"
    return Halves((_part(way, block == 0),), (_part(way, block == 1),), how)


def _part(way: Displacements, keep: Array) -> Displacements:
    """Return the displacements between kept fixes; omitted fixes begin a new stretch."""
    index = np.flatnonzero(keep)
    fresh = way.fresh[index] | (np.diff(index, prepend=-2) > 1)
    time = way.time[index]
    observed, model = (
        np.where(fresh[:, None], 0.0, values[index]) for values in (way.observed, way.model)
    )
    wind = None if way.wind is None else np.where(fresh[:, None], 0.0, way.wind[index])
    return Displacements(
        way.name, time, np.diff(time, prepend=time[:1]), fresh, observed, model, wind
    )


def score_hold_out(law: Law, best: Likelihood, halves: Halves, wind: bool) -> HoldOut:
    """Return how a law fitted to one half, with its windage and mean error, suits both halves."""
    tracks = along.residuals(halves.held, wind)
    excess = tracks.data - tracks.regressors @ best.mean
    residual = replace(tracks, data=excess, regressors=tracks.regressors[..., :0])
    other = error_law.likelihood(law, residual)
    fitted = along.residuals(halves.fitted, wind)
    return HoldOut(
        halves.how,
        law,
        float(best.own.sum()) / max(fitted.increments, 1),
        float(other.own.sum()) / max(tracks.increments, 1),
        tracks.increments,
        coverage(law, halves.held, excess),
    )


def coverage(law: Law, ways: Sequence[Displacements], excess: Array) -> tuple[Coverage, ...]:
    """Return the coverage of consecutive displacements over each of LEADS.

    The ellipse of a bivariate normal with equal variances holds a share p within -2 log(1 - p)
    variances.

    Args:
        law: the error law under test.
        ways: held-out displacements of the drifters.
        excess: how far the drifters went beyond the model since the start of each stretch [m],
            (drifters, fixes, 2).

    Returns:
        The coverage for each lead and each of SHARES.
    """
    result = []
    for hours in LEADS:
        square, drifters, days = [], [], []
        for number, way in enumerate(ways):
            begin = 0
            for k in range(way.time.size):
                if way.fresh[k]:
                    begin = k
                elif way.time[k] - way.time[begin] >= hours * 3600 - 60:
                    error = excess[number, k] - excess[number, begin]
                    square.append(
                        float(error @ error)
                        / float(error_law.error_variance(law, way.time[k] - way.time[begin]))
                    )
                    drifters.append(number)
                    days.append(int(way.time[begin] // DAY))
                    begin = k
        for share in SHARES:
            inside = np.array(square) <= -2 * np.log1p(-share)
            result.append(Coverage(hours, share, clusters.mean(inside, drifters, days, share=True)))
    return tuple(result)
