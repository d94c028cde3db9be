"""Figures over weighted worlds: means and quantiles of groups, with standard errors.

Worlds are the independent units: several realisations of a world are averaged before they come here
as its one value. Weights add up to 1 over all worlds. A standard error holds what the worlds and
the particles in them leave open; it is NaN where too few worlds count.
"""

import numpy as np

from geo.array import Array

# worlds that may have been missed: the square of the two standard errors that are to hold
UNSEEN = 4.0
# worlds on either side, in order of how often a group is hit, that tell how much one of them brings
ALIKE = 25.0
SLACK = 1e-9  # by which a cumulative sum may miss a share through rounding
ONE = 2**52  # share 1 in fixed point: sums are exact, and differences too where they wrap


def mean(value: Array, weight: Array, start: Array, squares: float) -> tuple[Array, Array]:
    """Return the mean over worlds and its standard error of every group, each (groups, k).

    value: of the worlds that are not 0, (n, k), group after group. weight: theirs, (n,). start:
    first row of each group, (groups,). squares: sum of the squared weights of all worlds.

    The error is that of self-normalised importance sampling, sqrt(sum w^2 (x - mean)^2) (Owen 2013,
    Monte Carlo theory, eq. 9.8), times sqrt(m / (m - 1)) at m effective worlds: with equal weights
    the unbiased variance over W.
    """
    count = np.diff(np.append(start, len(weight)))
    w = weight[:, None]
    average = np.add.reduceat(w * value, start)
    spread = np.add.reduceat((w * (value - np.repeat(average, count, axis=0))) ** 2, start)
    absent = np.maximum(squares - np.add.reduceat(weight**2, start), 0.0)
    spread += average**2 * absent[:, None]
    many = 1 / squares
    factor = many / (many - 1) if many > 1 + SLACK else np.nan
    return average, np.sqrt(spread * factor)


def unseen(hits: Array, count: Array, square: Array, many: float) -> Array:
    """Return what worlds that were not seen leave open of a mean, (groups, k).

    It is a standard error, to be added in squares.

    hits, count: weight and number of the worlds that are not 0, (groups, k). square: sum over them
    of w (w x)^2, w their weights and x their values. many: effective worlds.

    The spread over worlds cannot know of those that did not come: 3 of 2,000 seen may be 8 in
    truth, and those 5 may bring a hundred objects each where the 3 brought one. Of a Poisson number
    k of hits two errors sqrt(k + 4) hold the mean at least 95 % of the time, whatever it is, two of
    a normal number 95.4 % (at k = 0 they are the upper bound of Wilson's score interval, 1927,
    doi:10.1080/01621459.1927.10502953). What a missed world would have added, w x, is taken as the
    root mean square over the worlds that hit any of the groups hit about as rarely, ALIKE of them
    on either side where there are so many: groups that are rare for similar reasons are taken as
    similar.
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

    value: (n,), group after group and ascending within each. weight: (n,), of any scale. start:
    (groups,) first of each group. many: effective worlds of each group.

    A quantile is the smallest value at which the distribution function reaches the share. Its error
    is half the way between the quantiles at the share plus and minus that of the distribution
    function, sqrt(p (1 - p) / many) (Woodruff 1952, doi:10.1080/01621459.1952.10483443); NaN where
    these leave 0..1.
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
    """Return the least standard error that a share seen in `many` effective worlds can have, any
    shape.

    A share of 0 or 1 is not certain: UNSEEN worlds of each kind are added, twice as many as by
    Agresti and Coull (1998, doi:10.1080/00031305.1998.10480550), who move the share itself too: two
    errors then hold as they say of rare ones.
    """
    moved = (np.asarray(share) * many + UNSEEN) / (many + 2 * UNSEEN)
    return np.asarray(np.sqrt(moved * (1 - moved) / (many + 2 * UNSEEN)))
