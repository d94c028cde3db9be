"""Figures of single worlds, with strength borrowed from all worlds.

This is empirical Bayes for means over few particles.

A world's probability of something is estimated from its few hundred particles, and the likelihood
of many finds multiplies many such estimates: their noise would then decide between worlds. So each
is drawn toward what worlds like it have: a quadratic in the worlds' latent unknowns, fitted to all
worlds at once and corrected by each one's neighbours, is the mean of a prior whose width is
estimated from all worlds (Fay and Herriot 1979, doi:10.1080/01621459.1979.10482505; Clayton and
Kaldor 1987, doi:10.2307/2532003). Where the quadratic fits, a world's own particles hardly count;
elsewhere they decide.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import spatial, special

from geo.array import Real

NEIGHBOURS = 24  # nearest worlds that correct the quadratic
STEPS = 40  # most steps of Newton's method
# standard deviations: from one member of an ensemble to the next, so that neighbours are of one
# member
FAR = 1e3
SUREST = 1e9  # zeros and ones that a particle's chance says as much as, at most
RIDGE = 1.0  # inverse variance of a coefficient of the standardised latents
LEAST = 0.5  # particles, in all worlds together, that count as seen where none was
STEEPEST = 30.0  # largest log of a mean or of odds
EXCESS = (0.0, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0)  # variance of the prior in means
# variance of the prior in squared means
SQUARED = (1e-4, 0.01, 0.03, 0.1, 0.2, 0.4, 0.8, 1.6, 4.0, 10.0)


@dataclass(frozen=True)
class Likeness:
    """How worlds are alike.

    It holds terms (W, p) of a quadratic in their latents, and the nearest others of each (W, k).
    same: which of these are of the world's own member of an ensemble of winds and currents; None:
    there is none.
    """

    terms: Real
    near: npt.NDArray[np.int64]
    same: npt.NDArray[np.bool_] | None = None

    def nearby(self, values: Real) -> Real:
        """Return the sums of values (W,) over the nearest other worlds that are alike, (W,)."""
        others = values[self.near]
        return np.asarray(
            others.sum(1) if self.same is None else np.where(self.same, others, 0.0).sum(1)
        )


def likeness(latent: Real, member: npt.NDArray[np.int32] | None = None) -> Likeness:
    """Return how worlds of these latents (W, k) are alike. The quadratic has fewer terms where
    worlds are few.

    member: of an ensemble of winds and currents (W,), each of which has a mean of its own, and
    slopes where worlds are enough; only worlds of one member correct each other.
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
    return Likeness(np.concatenate(terms, axis=1), near, same)


def rates(total: Real, squares: Real, n: int, alike: Likeness, full: float = 1.0) -> Real:
    """Return every world's mean over its n particles (W,), drawn toward the means of worlds like
    it.

    total, squares: sums over a world's particles of values and of squared values, (W,). full: the
    value of a particle that counts in full, which is used where all sums are 0.

    Sums are taken as overdispersed Poisson in units of sum(squares) / sum(total).
    """
    unit = squares.sum() / total.sum() if squares.sum() > 0 else full
    count = total / unit
    worlds = count.size
    if count.sum() < LEAST:
        mean = np.full(worlds, LEAST / worlds)
    else:
        mean = _fit(alike.terms, count, POISSON, float(np.log(count.mean())))
    mean = mean * _nearby(count, mean, alike)
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


def _nearby(count: Real, mean: Real, alike: Likeness) -> Real:
    """Return factors (W,) by which the counts of the nearest other worlds correct means:
    gamma-Poisson, mean 1.
    """
    if not alike.near.shape[1]:
        return np.ones_like(mean)
    seen, meant = alike.nearby(count), np.maximum(alike.nearby(mean), 1e-300)
    shape = np.array([1 / v for v in SQUARED])[:, None]
    score = special.gammaln(seen + shape) - special.gammaln(shape) - seen * np.log1p(shape / meant)
    score -= shape * np.log1p(meant / shape)
    best = shape[score.sum(1).argmax(), 0]
    return np.asarray((best + seen) / (best + meant))


def share(mean: Real, variance: Real, n: int, alike: Likeness) -> Real:
    """Return every world's share (W,), drawn toward the shares of worlds like it (beta-binomial
    credibility).

    mean, variance: over the world's n particles of their chances, (W,).
    """
    if not mean.any():
        return mean
    sure = mean * (1 - mean)
    # without bound where the particles of each world have one chance
    ratio = sure.sum() / max(variance.sum(), 1e-300)
    size = n * float(np.clip(ratio, 1.0, SUREST))  # a sample of so many zeros and ones says as much
    middle = float(np.clip(mean.mean(), 1e-12, 1 - 1e-12))
    prior = _fit(alike.terms, mean, BINOMIAL, float(special.logit(middle)), size)
    if alike.near.shape[1]:
        rest = alike.nearby(mean - prior) / alike.near.shape[1]
        chance = (prior * (1 - prior)).mean() / (size * alike.near.shape[1])
        prior = np.clip(
            prior + max(1 - chance / max((rest**2).mean(), 1e-300), 0.0) * rest, 1e-12, 1 - 1e-12
        )
    excess = ((mean - prior) ** 2).sum() / max((prior * (1 - prior)).sum(), 1e-300)
    between = max(excess - 1 / size, 0.0)
    own = between / (between + 1 / size)  # credibility (Buhlmann 1967)
    return np.asarray(own * mean + (1 - own) * prior)


@dataclass(frozen=True)
class _Link:
    """A natural link: mean, variance of a value by its mean, and log-partition, by the linear
    predictor.
    """

    mean: Callable[[Real], Real]
    variance: Callable[[Real], Real]
    partition: Callable[[Real], Real]


POISSON = _Link(np.exp, lambda mu: mu, np.exp)
BINOMIAL = _Link(special.expit, lambda p: p * (1 - p), lambda eta: np.logaddexp(0, eta))


def _fit(terms: Real, value: Real, link: _Link, begin: float, size: float = 1.0) -> Real:
    """Return means (W,) of a generalised linear model: Newton's method, halved where it overshoots.

    begin: constant term to begin with. size: observations that each value is the mean of.
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
        while (ahead := score(beta + length * step)) < now and length > 1e-4:
            length /= 2
        if ahead <= now + 1e-7 * abs(now):
            break
        beta, now = beta + length * step, ahead
    return link.mean(np.clip(terms @ beta, -STEEPEST, STEEPEST))
