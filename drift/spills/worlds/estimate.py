"""Means and quantiles of groups over weighted worlds, with standard errors.

Worlds are the independent units: several realisations of a world are averaged to one value
beforehand. Weights add up to 1 over all worlds. A standard error includes the finite number of
worlds and of particles in them; it is NaN if too few worlds are effective.
"""

import numpy as np

from geo.array import Array

# worlds added for those that were not seen: the square of the two standard errors of an interval
UNSEEN = 4.0
# worlds on either side, by frequency of hits, from which the value of an unseen hit is estimated
ALIKE = 25.0
SLACK = 1e-9  # largest rounding error of a cumulative sum
ONE = 2**52  # share 1 in fixed point: sums are exact, and so are differences that wrap


def mean(value: Array, weight: Array, start: Array, squares: float) -> tuple[Array, Array]:
    """Return the mean over worlds and its standard error of every group, each (groups, k).

    The error is that of self-normalised importance sampling, sqrt(sum w^2 (x - mean)^2) (Owen 2013,
    Monte Carlo theory, eq. 9.8), times sqrt(m / (m - 1)) at m effective worlds: with equal weights
    the unbiased variance over W.

    Args:
        value: values of the worlds that are not 0, (n, k), group after group.
        weight: weights of these worlds, (n,).
        start: first row of each group, (groups,).
        squares: sum of the squared weights of all worlds.

    Returns:
        Means and standard errors.
    """
    count = np.diff(np.append(start, len(weight)))
    w = weight[:, None]
    average = np.add.reduceat(w * value, start)
    spread = np.add.reduceat((w * (value - np.repeat(average, count, axis=0))) ** 2, start)
    absent = np.maximum(squares - np.add.reduceat(weight**2, start), 0.0)
    spread += average**2 * absent[:, None]
    effective_worlds = 1 / squares
    factor = effective_worlds / (effective_worlds - 1) if effective_worlds > 1 + SLACK else np.nan
    return average, np.sqrt(spread * factor)


def unseen(hits: Array, count: Array, square: Array, many: float) -> Array:
    """Return the standard error of means due to worlds that were not sampled, (groups, k).

    It is to be added in squares. The spread over worlds ignores worlds that happened not to be
    drawn: where 3 of 2,000 worlds hit a group, 8 may be right, and those 5 may bring a hundred
    objects each where the 3 brought one. For a Poisson number k of hits, two errors sqrt(k + 4)
    cover the mean at least 95 % of the time, whatever it is, as two errors of a normal number do in
    95.4 % (at k = 0 they are the upper bound of Wilson's score interval, 1927,
    doi:10.1080/01621459.1927.10502953). What an unseen world would have added, w x, is the root
    mean square over the worlds that hit any of the groups hit about as rarely, ALIKE of them on
    either side if there are so many. This assumes that groups are rare for similar reasons.

    Args:
        hits: weight of the worlds with a value above 0, (groups, k).
        count: number of these worlds, (groups, k).
        square: sum over them of w (w x)^2, with weights w and values x, (groups, k).
        many: effective worlds.

    Returns:
        Standard errors.
    """
    order = np.argsort(hits, axis=0, kind="stable")
    parts = [np.take_along_axis(x, order, 0) for x in (count, hits, square)]
    reached, mass, moment = (
        np.concatenate([np.zeros((1, x.shape[1])), np.cumsum(x, axis=0)]) for x in parts
    )
    middle = (reached[1:] + reached[:-1]) / 2
    error = np.empty_like(square)
    for j in range(error.shape[1]):
        low = np.searchsorted(reached[:, j], middle[:, j] - ALIKE, side="right") - 1
        high = np.searchsorted(reached[:, j], middle[:, j] + ALIKE).clip(max=len(error))
        low = low.clip(0)
        weight = mass[high, j] - mass[low, j]
        size = np.divide(
            moment[high, j] - moment[low, j], weight, out=np.zeros(len(error)), where=weight > 0
        )
        error[order[:, j], j] = np.sqrt(UNSEEN * size.clip(0)) * (many / (many + UNSEEN))
    return error


def quantiles(
    value: Array, weight: Array, start: Array, shares: tuple[float, ...], many: Array | float
) -> tuple[Array, Array]:
    """Return the quantiles of every group and their standard errors, each (shares, groups).

    A quantile is the smallest value at which the distribution function reaches the share. Its error
    is half the distance between the quantiles at the share plus and minus the error of the
    distribution function, sqrt(p (1 - p) / many) (Woodruff 1952,
    doi:10.1080/01621459.1952.10483443); NaN where these leave 0..1.

    Args:
        value: values (n,), group after group and ascending within each.
        weight: weights on any scale, (n,).
        start: first row of each group, (groups,).
        shares: shares of the quantiles, 0 to 1.
        many: effective worlds of each group, or of all.

    Returns:
        Quantiles and standard errors.
    """
    count = np.diff(np.append(start, len(weight)))
    total = np.repeat(np.add.reduceat(weight, start), count)
    part = np.rint(weight / total * ONE).astype(np.int64)
    running = np.cumsum(part)
    running -= np.repeat(running[start] - part[start], count)

    def at(share: Array) -> Array:
        goal = np.maximum(np.rint((share - SLACK) * ONE).astype(np.int64), 1)
        short = np.add.reduceat((running < np.repeat(goal, count)).astype(np.int64), start)
        return np.asarray(value[start + np.minimum(short, count - 1)])

    many = np.broadcast_to(np.asarray(many, float), start.shape)
    values, errors = [], []
    for share in shares:
        error = np.sqrt(share * (1 - share) / many)
        low, high = share - error, share + error
        inside = (low >= -SLACK) & (high <= 1 + SLACK) & (many >= 2 - SLACK)
        values.append(at(np.full(start.shape, share)))
        width = at(np.clip(high, 0, 1)).astype(float) - at(np.clip(low, 0, 1))
        errors.append(np.where(inside, width / 2, np.nan))
    return np.array(values), np.array(errors)


def least_error(share: Array, many: float) -> Array:
    """Return the smallest standard error of a share seen in `many` effective worlds, any shape.

    A share of 0 or 1 is not certain: UNSEEN worlds of each kind are added. That is twice as many as
    Agresti and Coull add (1998, doi:10.1080/00031305.1998.10480550), who move the share itself too;
    so two errors have the right coverage for rare shares.
    """
    moved = (np.asarray(share) * many + UNSEEN) / (many + 2 * UNSEEN)
    return np.asarray(np.sqrt(moved * (1 - moved) / (many + 2 * UNSEEN)))
