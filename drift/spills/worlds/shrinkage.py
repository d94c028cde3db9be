"""Estimates for single worlds that borrow strength from all worlds (empirical Bayes).

A world's probabilities are estimated from its few hundred particles, and the likelihood of many
finds multiplies many such estimates: their noise would then decide between worlds. So each estimate
is drawn toward a prior mean from all worlds: a quadratic in the worlds' latents, fitted to all
worlds at once and corrected by each world's neighbours. The width of this prior is estimated from
all worlds too (Fay and Herriot 1979, doi:10.1080/01621459.1979.10482505; Clayton and Kaldor 1987,
doi:10.2307/2532003). Where the quadratic fits well, a world's own particles hardly count; elsewhere
they decide.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import spatial, special

from geo.array import Real

NEIGHBOURS = 24  # nearest worlds that correct the quadratic
STEPS = 40  # most steps of Newton's method
# [standard deviations] distance between ensemble members, so that neighbours are of one member
FAR = 1e3
SUREST = 1e9  # largest number of zeros and ones to which a particle's chance is equivalent
RIDGE = 1.0  # inverse variance of a coefficient of the standardised latents
LEAST = 0.5  # [particles] assumed count over all worlds if none was counted
STEEPEST = 30.0  # largest log of a mean or of odds
EXCESS = (0.0, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0)  # prior variance in units of the mean
# prior variance in units of the squared mean
SQUARED = (1e-4, 0.01, 0.03, 0.1, 0.2, 0.4, 0.8, 1.6, 4.0, 10.0)


@dataclass(frozen=True)
class WorldSimilarity:
    """Similarity of worlds: regression terms of each, and its nearest neighbours.

    terms: (W, p) of a quadratic in the latents. near: the nearest other worlds of each, (W, k).
    same: which of these have the world's own member of an ensemble of winds and currents; None: no
    ensemble.
    """

    terms: Real
    near: npt.NDArray[np.int64]
    same: npt.NDArray[np.bool_] | None = None

    def nearby(self, values: Real) -> Real:
        """Return the sums of values (W,) over each world's neighbours of the same member, (W,)."""
        others = values[self.near]
        return np.asarray(
            others.sum(1) if self.same is None else np.where(self.same, others, 0.0).sum(1)
        )


def world_similarity(latent: Real, member: npt.NDArray[np.int32] | None = None) -> WorldSimilarity:
    """Return the similarity of worlds by their latents.

    The quadratic has fewer terms if worlds are few. Each member of an ensemble of winds and
    currents has its own mean, and its own slopes if there are enough worlds; neighbours are of one
    member.

    Args:
        latent: latents of the worlds, (W, k).
        member: members of the ensemble, (W,); None: no ensemble.

    Returns:
        Regression terms and neighbours of each world.
    """
    worlds = len(latent)
    spread = latent.std(0)
    z = (latent - latent.mean(0))[:, spread > 1e-9] / spread[spread > 1e-9]
    k = z.shape[1]
    terms = [np.ones((worlds, 1)), z]
    if (k + 1) * (k + 2) <= worlds // 5:
        first, second = np.triu_indices(k)
        terms.append(z[:, first] * z[:, second])
    elif 10 * k <= worlds // 2:
        terms.append(z**2)
    count = min(NEIGHBOURS, worlds // 20) if k else 0
    same = None
    if member is not None:
        own = (member[:, None] == np.unique(member)).astype(float)
        own = (own - own.mean(0)) / np.maximum(own.std(0), 1e-9)
        terms.append(own)
        if own.shape[1] * k <= worlds // 10:
            terms.append((own[:, :, None] * z[:, None]).reshape(worlds, -1))
        z = np.column_stack([z, FAR * member])
        count = min(count, worlds // (2 * own.shape[1]))
    near = (
        spatial.cKDTree(z).query(z, range(2, count + 2))[1]
        if count
        else np.zeros((worlds, 0), np.int64)
    )
    if member is not None:
        same = member[near] == member[:, None]
    return WorldSimilarity(np.concatenate(terms, axis=1), near, same)


def shrink_means(
    total: Real, squares: Real, n: int, similarity: WorldSimilarity, full: float = 1.0
) -> Real:
    """Return each world's mean over its n particles, (W,), drawn toward that of similar worlds.

    Sums are modelled as overdispersed Poisson in units of sum(squares) / sum(total).

    Args:
        total: sums of values over a world's particles, (W,).
        squares: sums of squared values, (W,).
        n: number of particles of a world.
        similarity: similarity of the worlds.
        full: largest value of a particle, which is the unit if all sums are 0.

    Returns:
        Means, (W,).
    """
    unit = squares.sum() / total.sum() if squares.sum() > 0 else full
    count = total / unit
    worlds = count.size
    if count.sum() < LEAST:
        mean = np.full(worlds, LEAST / worlds)
    else:
        mean = _fit(similarity.terms, count, POISSON, float(np.log(count.mean())))
    mean = mean * _nearby(count, mean, similarity)
    best, shape, rate = -np.inf, mean, np.ones(worlds)
    for c in EXCESS:
        for a in SQUARED:
            r = 1 / (c + a * mean)
            s = mean * r
            score = (
                special.gammaln(count + s)
                - special.gammaln(s)
                + s * np.log(r)
                - (s + count) * np.log1p(r)
            ).sum()
            if score > best:
                best, shape, rate = score, s, r
    return np.asarray((shape + count) / (rate + 1) * (unit / n))


def _nearby(count: Real, mean: Real, similarity: WorldSimilarity) -> Real:
    """Return factors (W,) by which the neighbours' counts correct means: gamma-Poisson, mean 1."""
    if not similarity.near.shape[1]:
        return np.ones_like(mean)
    neighbour_count, neighbour_mean = (
        similarity.nearby(count),
        np.maximum(similarity.nearby(mean), 1e-300),
    )
    shape = np.array([1 / v for v in SQUARED])[:, None]
    score = (
        special.gammaln(neighbour_count + shape)
        - special.gammaln(shape)
        - neighbour_count * np.log1p(shape / neighbour_mean)
    )
    score -= shape * np.log1p(neighbour_mean / shape)
    best = shape[score.sum(1).argmax(), 0]
    return np.asarray((best + neighbour_count) / (best + neighbour_mean))


def shrink_shares(mean: Real, variance: Real, n: int, similarity: WorldSimilarity) -> Real:
    """Return each world's share, drawn toward that of similar worlds (beta-binomial model).

    Args:
        mean: mean of the chances of a world's particles, (W,).
        variance: variance of these chances, (W,).
        n: number of particles of a world.
        similarity: similarity of the worlds.

    Returns:
        Shares, (W,).
    """
    if not mean.any():
        return mean
    binomial_variance = mean * (1 - mean)
    # infinite if all particles of a world have the same chance
    ratio = binomial_variance.sum() / max(variance.sum(), 1e-300)
    size = n * float(np.clip(ratio, 1.0, SUREST))  # equivalent sample size of zeros and ones
    middle = float(np.clip(mean.mean(), 1e-12, 1 - 1e-12))
    prior = _fit(similarity.terms, mean, BINOMIAL, float(special.logit(middle)), size)
    if similarity.near.shape[1]:
        rest = similarity.nearby(mean - prior) / similarity.near.shape[1]
        chance = (prior * (1 - prior)).mean() / (size * similarity.near.shape[1])
        prior = np.clip(
            prior + max(1 - chance / max((rest**2).mean(), 1e-300), 0.0) * rest, 1e-12, 1 - 1e-12
        )
    excess = ((mean - prior) ** 2).sum() / max((prior * (1 - prior)).sum(), 1e-300)
    between = max(excess - 1 / size, 0.0)
    credibility = between / (between + 1 / size)  # credibility (Buhlmann 1967)
    return np.asarray(credibility * mean + (1 - credibility) * prior)


@dataclass(frozen=True)
class _Link:
    """A natural link: mean, variance (by the mean) and log-partition, by the linear predictor."""

    mean: Callable[[Real], Real]
    variance: Callable[[Real], Real]
    partition: Callable[[Real], Real]


POISSON = _Link(np.exp, lambda mu: mu, np.exp)
BINOMIAL = _Link(special.expit, lambda p: p * (1 - p), lambda eta: np.logaddexp(0, eta))


def _fit(terms: Real, value: Real, link: _Link, begin: float, size: float = 1.0) -> Real:
    """Return fitted means (W,) of a generalised linear model, by Newton's method with step halving.

    begin: initial constant term. size: number of observations of which each value is the mean.
    """
    ridge = np.full(terms.shape[1], RIDGE)
    ridge[0] = 1e-9
    beta = np.zeros(terms.shape[1])
    beta[0] = begin

    def score(b: Real) -> float:
        eta = np.clip(terms @ b, -STEEPEST, STEEPEST)
        return float(
            size * (value * eta - link.partition(eta)).sum() - 0.5 * (ridge[1:] * b[1:] ** 2).sum()
        )

    now = score(beta)
    for _ in range(STEPS):
        mu = link.mean(np.clip(terms @ beta, -STEEPEST, STEEPEST))
        hessian = size * (terms * link.variance(mu)[:, None]).T @ terms + np.diag(ridge)
        step = np.linalg.solve(
            hessian, size * terms.T @ (value - mu) - ridge * np.append(0.0, beta[1:])
        )
        length = 1.0
        while (next_score := score(beta + length * step)) < now and length > 1e-4:
            length /= 2
        if next_score <= now + 1e-7 * abs(now):
            break
        beta, now = beta + length * step, next_score
    return link.mean(np.clip(terms @ beta, -STEEPEST, STEEPEST))
