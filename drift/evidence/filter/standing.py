"""The status of a search after an update: release time of the object, and unsearched share.

Release times are binned by weight. A few numbers, computed from millions of particles, are enough
for the probability of survival at any time.
"""

from dataclasses import dataclass

import numpy as np

from drift.engine.particles import partials, weights
from drift.engine.particles.columns import Columns
from geo.array import Array

# Bins of release times, each with its own mean: WITHIN bins in the run (6 minutes each for a window
# of 40 h), AFTER bins in the month after it, for reports about the future, and one bin for later
# releases or none.
WITHIN, AFTER, MONTH = 400, 99, 30 * 86_400.0
BINS = WITHIN + AFTER + 1


@dataclass(frozen=True)
class SearchStatus:
    """Probability by scenario and time of release, given all evidence; S scenarios, B bins."""

    time: np.datetime64
    # [s after start] mean of each bin, (S, B); of objects whose state changes, the bins for each of
    # the survival times that start at it, one after the other
    release: Array
    mass: Array  # probability, (S, B); adds up to 1
    # probability of never having been in a searched area, given each scenario, then of all; (S +
    # 1,)
    never: Array
    effective: float  # number of effective particles


def search_status(
    time: np.datetime64, columns: Columns, effective: float, duration: float
) -> SearchStatus:
    """Return the status of a search.

    Args:
        time: of the status.
        columns: `release` [s after start], `log_weight`, perhaps `law`, the number of the survival
            time that counts from the release, and after any sortie `never`, the share of
            each particle never searched.
        effective: number of effective particles.
        duration: of the run [s].
    """
    unit = weights.normalising_scale(columns, "log_weight")
    ends = [
        (float(release.min()), float(release.max(initial=0, where=release <= duration)))
        for _, release in columns.parts("release")
    ]
    first, last = min(low for low, _ in ends), max(high for _, high in ends)
    sums, unsearched = [], []
    laws = 1 + max(
        (int(law.max(initial=0)) for _, law in columns.parts("law") if law is not None), default=0
    )
    names = ("release", "log_weight", "never", "law")
    for blocks, release, log_weight, never, law in columns.parts(*names):
        weight = unit.shares(log_weight)
        inside = np.minimum((release - first) / max(last - first, 1.0) * WITHIN, WITHIN - 1)
        beyond = WITHIN + np.minimum((release - duration) / MONTH * AFTER, AFTER)
        bins, many = (
            np.where(release <= duration, inside, beyond).astype(np.int64),
            BINS,
        )
        if law is not None:
            bins, many = bins + many * law, many * laws
        sums.append(blocks.partial(weight, weight * release, code=bins, many=many))
        if never is not None:
            unsearched.append(blocks.partial(weight * never))
    mass, when = np.moveaxis(partials.merge_partials(sums).by_scenario, -1, 0)
    when = np.divide(when, mass, out=np.full_like(when, first), where=mass > 0)
    share, free = mass.sum(axis=1), np.ones(len(mass))
    if unsearched:
        np.divide(
            partials.merge_partials(unsearched).by_scenario[:, 0, 0],
            share,
            out=free,
            where=share > 0,
        )
    return SearchStatus(time, when, mass, np.append(free, share @ free), effective)
