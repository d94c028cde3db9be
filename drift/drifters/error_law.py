"""The law of a model's errors along the tracks of real drifters, and how likely tracks are under it, exactly.

Between fixes a drifter moves by what the model says along its track, plus an error. Of each component (east, north) the
error is a sum of independent parts: a bias that each drifter keeps, an Ornstein-Uhlenbeck velocity, diffusion, and the
errors of the fixes at both ends. That is a linear Gaussian state space (position error, velocity error, bias), whose
likelihood a Kalman filter gives without approximation at any spacing of the fixes. What is linear in the model (windage,
mean error) is regressed at the same time, and integrated out with a flat prior: restricted maximum likelihood (Patterson
and Thompson 1971, doi:10.1093/biomet/58.3.545), which does not take a drifter's own bias for none where drifters are few.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[Any]

NAMES = ("std", "time", "bias", "diffusivity", "noise")
SMALL = 1e-2  # steps, in decorrelation times, below which a series replaces differences of nearly equal numbers


@dataclass(frozen=True)
class Law:
    """The errors of one component; a zero switches a part off."""

    std: float  # [m/s] of the Ornstein-Uhlenbeck velocity
    time: float  # [s] in which its correlation falls to 1/e
    bias: float  # [m/s] standard deviation, over drifters, of a velocity that each keeps
    diffusivity: float  # [m2/s]
    noise: float  # [m] standard deviation of a fix


@dataclass(frozen=True)
class Tracks:
    """Residuals of many drifters' fixes, padded to the longest; a stretch is a run of fixes without a long gap.

    step: seconds since the fix before, shape (drifters, fixes); 0 at a first fix. fresh: whether a fix begins a stretch.
    there: whether there is such a fix. data: since the stretch's begin, the way made beyond the model's, east and north
    [m], shape (drifters, fixes, 2). regressors: what each unknown of the mean adds to the way made, shape (drifters,
    fixes, 2, unknowns).
    """

    step: Array
    fresh: Array
    there: Array
    data: Array
    regressors: Array

    @property
    def increments(self) -> int:
        """Number of displacements between fixes, of which each has two components."""
        return int((self.there & ~self.fresh).sum())


@dataclass(frozen=True)
class Likelihood:
    """How likely tracks are under a law, the unknowns of the mean at their best.

    log: restricted log likelihood. mean: the unknowns (unknowns,), covariance: theirs under the law. own: log likelihood
    of each drifter at that mean, shape (drifters,). innovations: standardised errors of the forecasts of each fix from
    those before it, shape (drifters, fixes, 2), and log_variance of those forecasts (drifters, fixes); NaN where none is.
    pull: derivative of `own` by the unknowns, shape (drifters, unknowns).
    """

    log: float
    mean: Array
    covariance: Array
    own: Array
    innovations: Array
    log_variance: Array
    pull: Array


def _steps(std: Array, memory: Array, step: Array) -> tuple[Array, Array, Array, Array]:
    """Return by step [s]: phi, variance of the integral, its covariance with the end, variance of the end.

    Of an Ornstein-Uhlenbeck velocity v over a step, given v at its begin: v = phi v0 + e, integral = T (1 - phi) v0 + i,
    T the decorrelation time, `memory`. The moments of (i, e) are those of Uhlenbeck and Ornstein 1930
    (doi:10.1103/PhysRev.36.823), eq. 4 to 9.
    """
    a = step / memory
    lost = -np.expm1(-a)
    series = a**3 * (2 / 3 - a * (1 / 2 - a * (7 / 30 - a / 12)))
    integral = np.where(a < SMALL, series, 2 * a - 2 * lost - lost**2)
    return 1 - lost, std**2 * memory**2 * integral, std**2 * memory * lost**2, -(std**2) * np.expm1(-2 * a)


def spread(law: Law, step: npt.ArrayLike) -> Array:
    """Return the variance [m2] of a component of the error made over steps [s], its begin and end as uncertain as fixes."""
    step = np.asarray(step, np.float64)
    a = step / law.time
    series = a**2 * (1 / 2 - a * (1 / 6 - a * (1 / 24 - a / 120)))
    walk = 2 * law.std**2 * law.time**2 * np.where(a < SMALL, series, a + np.expm1(-a))
    return np.asarray(law.bias**2 * step**2 + walk + 2 * law.diffusivity * step + 2 * law.noise**2)


def correlation(law: Law, lag: npt.ArrayLike, span: float) -> Array:
    """Return the covariance [m2/s2] of mean velocity errors over spans [s] whose begins are `lag` [s] >= span apart.

    Without the errors of the fixes, which two spans share only where they touch.
    """
    lag, a = np.asarray(lag, np.float64), span / law.time
    within = (2 * np.sinh(a / 2) / a) ** 2 if a > SMALL else 1 + a**2 / 12
    return np.asarray(law.bias**2 + law.std**2 * np.exp(-lag / law.time) * within)


def likelihood(law: Law, tracks: Tracks) -> Likelihood:
    """Return how likely tracks are under a law (Kalman 1960; Durbin and Koopman 2012, section 4.3)."""
    return likelihoods([law], tracks)[0]


def likelihoods(laws: Sequence[Law], tracks: Tracks) -> list[Likelihood]:
    """Return how likely tracks are under each of several laws, all filtered side by side: hardly dearer than one."""
    drifters, fixes = tracks.step.shape
    unknowns = tracks.regressors.shape[-1]
    many = len(laws)
    std, memory, bias, walking, fixing = (
        np.repeat([getattr(law, name) for law in laws], drifters)[:, None] for name in NAMES
    )
    step = np.tile(tracks.step, (many, 1))
    phi, walk, cross, renewed = _steps(std, memory, step)
    move = np.zeros((fixes, many * drifters, 3, 3))  # of (position, velocity, bias) errors over a step
    noise = np.zeros_like(move)
    move[..., 0, 0] = move[..., 2, 2] = 1
    move[..., 0, 1], move[..., 0, 2], move[..., 1, 1] = (memory * (1 - phi)).T, step.T, phi.T
    noise[..., 0, 0] = (walk + 2 * walking * step).T
    noise[..., 0, 1] = noise[..., 1, 0] = cross.T
    noise[..., 1, 1] = renewed.T
    turned = np.swapaxes(move, -1, -2)
    columns = np.concatenate([tracks.data[..., None], tracks.regressors], axis=-1).reshape(drifters, fixes, -1)
    given = np.tile(columns.transpose(1, 0, 2), (1, many, 1))

    state = np.zeros((many * drifters, 3, given.shape[2]))
    cov = np.zeros((many * drifters, 3, 3))
    cov[:, 1, 1], cov[:, 2, 2] = std[:, 0] ** 2, bias[:, 0] ** 2
    fix = fixing[:, 0] ** 2
    innovations, variance = np.empty_like(given), np.empty((fixes, many * drifters))
    fresh = np.tile(tracks.fresh, (many, 1)).T
    seen = np.tile(tracks.there & ~tracks.fresh, (many, 1)).T
    begins = set(np.flatnonzero(fresh.any(axis=1)).tolist())
    for k in range(fixes):
        state = move[k] @ state
        cov = move[k] @ cov @ turned[k] + noise[k]
        if k in begins:  # a position is known from its fix alone, whatever was before a gap: velocity and bias are kept
            new = fresh[k]
            state[new, 0] = given[k][new]
            cov[new, 0, :] = cov[new, :, 0] = 0.0
            cov[new, 0, 0] = fix[new]
        variance[k] = cov[:, 0, 0] + fix
        innovations[k] = given[k] - state[:, 0]
        gain = np.where(seen[k], 1 / np.maximum(variance[k], 1e-300), 0.0)[:, None] * cov[:, 0]
        state = state + gain[:, :, None] * innovations[k][:, None, :]
        cov = cov - gain[:, :, None] * cov[:, 0][:, None, :]
    variance = np.maximum(variance, 1e-300)
    scaled = np.where(seen[..., None], innovations / np.sqrt(variance)[..., None], 0.0).transpose(1, 0, 2)
    logs = np.where(seen, np.log(variance), np.nan).T
    return [
        _regressed(scaled[these].reshape(drifters, fixes, 2, 1 + unknowns), logs[these])
        for these in (slice(k * drifters, (k + 1) * drifters) for k in range(many))
    ]


def _regressed(scaled: Array, log_variance: Array) -> Likelihood:
    """Return the likelihood of standardised forecast errors (drifters, fixes, 2, 1 + unknowns), the data first."""
    data, design = scaled[..., 0], scaled[..., 1:]
    flat = design.reshape(data.size, design.shape[-1])
    normal = flat.T @ flat
    covariance = np.linalg.pinv(normal)
    mean = covariance @ (flat.T @ data.ravel())
    left = data - design @ mean
    terms = (
        left**2
        + np.nan_to_num(log_variance)[..., None]
        + np.where(np.isnan(log_variance), 0, np.log(2 * np.pi))[..., None]
    )
    own = -0.5 * terms.sum(axis=(1, 2))
    sign, determinant = np.linalg.slogdet(normal) if mean.size else (1.0, 0.0)
    restricted = 0.5 * (mean.size * np.log(2 * np.pi) - determinant) if sign > 0 else -np.inf
    there = ~np.isnan(log_variance)
    innovations = np.where(there[..., None], left, np.nan)
    pull = np.einsum("dkc,dkcu->du", left, design)
    return Likelihood(float(own.sum() + restricted), mean, covariance, own, innovations, log_variance, pull)


def joined(pieces: Sequence[tuple[Array, Array, Array, Array]]) -> Tracks:
    """Return drifters as one record; of each: step (n,), fresh (n,), data (n, 2), regressors (n, 2, unknowns)."""
    longest = max((len(piece[0]) for piece in pieces), default=0)

    def padded(values: Array) -> Array:
        return np.concatenate([values, np.zeros((longest - len(values), *values.shape[1:]), values.dtype)])

    step, fresh, data, regressors = (np.stack([padded(piece[k]) for piece in pieces]) for k in range(4))
    there = np.arange(longest) < np.array([len(piece[0]) for piece in pieces])[:, None]
    return Tracks(step, fresh & there, there, data, regressors)
