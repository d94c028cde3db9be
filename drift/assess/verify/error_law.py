"""The statistical law of a model's errors along real drifters' tracks, and its likelihood.

Between fixes a drifter moves by the model's displacement along its track plus an error. In each
component (east, north) the error is a sum of independent parts: a constant bias of each drifter, an
Ornstein-Uhlenbeck velocity, diffusion, and the errors of the fixes at both ends. That is a linear
Gaussian state space (position error, velocity error, bias), whose likelihood a Kalman filter gives
exactly for any spacing of the fixes. Linear unknowns (windage, mean error) are regressed at the
same time and integrated out with a flat prior. This is restricted maximum likelihood (Patterson and
Thompson 1971, doi:10.1093/biomet/58.3.545), which does not underestimate the bias if drifters are
few.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from geo.array import Array

NAMES = ("std", "time", "bias", "diffusivity", "noise")
# below this step (in decorrelation times) a series replaces differences of nearly equal numbers
SMALL = 1e-2


@dataclass(frozen=True)
class Law:
    """The error law of one component; a part that is zero is switched off."""

    std: float  # [m/s] of the Ornstein-Uhlenbeck velocity
    time: float  # [s] decorrelation time: its correlation falls to 1/e
    bias: (
        float  # [m/s] standard deviation, over drifters, of each drifter's constant velocity error
    )
    diffusivity: float  # [m2/s]
    noise: float  # [m] standard deviation of a fix


@dataclass(frozen=True)
class Tracks:
    """Residuals of many drifters' fixes, padded to the longest track.

    A stretch is a run of fixes without a long gap. step: time since the previous fix [s], shape
    (drifters, fixes); 0 at a first fix. fresh: whether a fix begins a stretch. there: whether a fix
    is one of the drifter's, not padding. data: how far the drifter went beyond the model since the
    start of the stretch, east and north [m], shape (drifters, fixes, 2). regressors: derivative of
    that by each unknown of the mean, shape (drifters, fixes, 2, unknowns).
    """

    step: Array
    fresh: Array
    there: Array
    data: Array
    regressors: Array

    @property
    def increments(self) -> int:
        """Number of displacements between fixes; each has two components."""
        return int((self.there & ~self.fresh).sum())


@dataclass(frozen=True)
class Likelihood:
    """The likelihood of tracks under a law, with the most likely unknowns of the mean.

    log: restricted log likelihood. mean: the unknowns, (unknowns,); covariance: of their errors
    under the law. own: log likelihood of each drifter at that mean, (drifters,). innovations:
    standardised errors of the prediction of each fix from those before it, (drifters, fixes, 2);
    log_variance: of these predictions, (drifters, fixes); both are NaN where there is no
    prediction. score: derivative of `own` by the unknowns, (drifters, unknowns).
    """

    log: float
    mean: Array
    covariance: Array
    own: Array
    innovations: Array
    log_variance: Array
    score: Array


def _steps(std: Array, memory: Array, step: Array) -> tuple[Array, Array, Array, Array]:
    """Return phi, var(i), cov(i, e) and var(e) of an Ornstein-Uhlenbeck velocity, each by step [s].

    A step that begins with the velocity v0 ends with v = phi v0 + e, and the velocity's integral
    over it is T (1 - phi) v0 + i, where T is the decorrelation time, `memory`. The moments of (i,
    e) are those of Uhlenbeck and Ornstein 1930 (doi:10.1103/PhysRev.36.823), eq. 4 to 9.
    """
    a = step / memory
    lost = -np.expm1(-a)
    series = a**3 * (2 / 3 - a * (1 / 2 - a * (7 / 30 - a / 12)))
    integral = np.where(a < SMALL, series, 2 * a - 2 * lost - lost**2)
    return (
        1 - lost,
        std**2 * memory**2 * integral,
        std**2 * memory * lost**2,
        -(std**2) * np.expm1(-2 * a),
    )


def error_variance(law: Law, step: npt.ArrayLike) -> Array:
    """Return the variance [m2] of one component of the error over steps between two fixes.

    Args:
        law: error law of the component.
        step: time between the fixes [s], any shape.

    Returns:
        Variances, with the errors of both fixes, of the shape of `step`.
    """
    step = np.asarray(step, np.float64)
    a = step / law.time
    series = a**2 * (1 / 2 - a * (1 / 6 - a * (1 / 24 - a / 120)))
    walk = 2 * law.std**2 * law.time**2 * np.where(a < SMALL, series, a + np.expm1(-a))
    return np.asarray(law.bias**2 * step**2 + walk + 2 * law.diffusivity * step + 2 * law.noise**2)


def correlation(law: Law, lag: npt.ArrayLike, span: float) -> Array:
    """Return the covariance [m2/s2] of mean velocity errors over two spans.

    Errors of the fixes are left out, because two spans share a fix only if they touch.

    Args:
        law: error law of a component.
        lag: time from the start of one span to that of the other [s], at least `span`.
        span: duration of both spans [s].

    Returns:
        Covariances, of the shape of `lag`.
    """
    lag, a = np.asarray(lag, np.float64), span / law.time
    within = (2 * np.sinh(a / 2) / a) ** 2 if a > SMALL else 1 + a**2 / 12
    return np.asarray(law.bias**2 + law.std**2 * np.exp(-lag / law.time) * within)


def likelihood(law: Law, tracks: Tracks) -> Likelihood:
    """Return the likelihood of tracks under a law.

    Kalman 1960; Durbin and Koopman 2012, section 4.3.
    """
    return likelihoods([law], tracks)[0]


def likelihoods(laws: Sequence[Law], tracks: Tracks) -> list[Likelihood]:
    """Return the likelihood of tracks under several laws, hardly slower than for one."""
    drifters, fixes = tracks.step.shape
    unknowns = tracks.regressors.shape[-1]
    count = len(laws)
    std, memory, bias, diffusivity, fix_std = (
        np.repeat([getattr(law, name) for law in laws], drifters)[:, None] for name in NAMES
    )
    step = np.tile(tracks.step, (count, 1))
    phi, walk, cross, renewed = _steps(std, memory, step)
    # of (position, velocity, bias) errors over a step
    move = np.zeros((fixes, count * drifters, 3, 3))
    noise = np.zeros_like(move)
    move[..., 0, 0] = move[..., 2, 2] = 1
    move[..., 0, 1], move[..., 0, 2], move[..., 1, 1] = (memory * (1 - phi)).T, step.T, phi.T
    noise[..., 0, 0] = (walk + 2 * diffusivity * step).T
    noise[..., 0, 1] = noise[..., 1, 0] = cross.T
    noise[..., 1, 1] = renewed.T
    transposed = np.swapaxes(move, -1, -2)
    columns = np.concatenate([tracks.data[..., None], tracks.regressors], axis=-1).reshape(
        drifters, fixes, -1
    )
    observed = np.tile(columns.transpose(1, 0, 2), (1, count, 1))

    state = np.zeros((count * drifters, 3, observed.shape[2]))
    cov = np.zeros((count * drifters, 3, 3))
    cov[:, 1, 1], cov[:, 2, 2] = std[:, 0] ** 2, bias[:, 0] ** 2
    fix_variance = fix_std[:, 0] ** 2
    innovations, variance = np.empty_like(observed), np.empty((fixes, count * drifters))
    fresh = np.tile(tracks.fresh, (count, 1)).T
    used = np.tile(tracks.there & ~tracks.fresh, (count, 1)).T
    begins = set(np.flatnonzero(fresh.any(axis=1)).tolist())
    for k in range(fixes):
        state = move[k] @ state
        cov = move[k] @ cov @ transposed[k] + noise[k]
        if k in begins:  # after a gap only the fix determines the position; velocity and bias stay
            new = fresh[k]
            state[new, 0] = observed[k][new]
            cov[new, 0, :] = cov[new, :, 0] = 0.0
            cov[new, 0, 0] = fix_variance[new]
        variance[k] = cov[:, 0, 0] + fix_variance
        innovations[k] = observed[k] - state[:, 0]
        gain = np.where(used[k], 1 / np.maximum(variance[k], 1e-300), 0.0)[:, None] * cov[:, 0]
        state = state + gain[:, :, None] * innovations[k][:, None, :]
        cov = cov - gain[:, :, None] * cov[:, 0][:, None, :]
    variance = np.maximum(variance, 1e-300)
    scaled = np.where(used[..., None], innovations / np.sqrt(variance)[..., None], 0.0).transpose(
        1, 0, 2
    )
    logs = np.where(used, np.log(variance), np.nan).T
    return [
        _regressed(scaled[rows].reshape(drifters, fixes, 2, 1 + unknowns), logs[rows])
        for rows in (slice(k * drifters, (k + 1) * drifters) for k in range(count))
    ]


def _regressed(scaled: Array, log_variance: Array) -> Likelihood:
    """Return the likelihood from standardised prediction errors.

    scaled: (drifters, fixes, 2, 1 + unknowns), the data first.
    """
    data, design = scaled[..., 0], scaled[..., 1:]
    flat = design.reshape(data.size, design.shape[-1])
    normal = flat.T @ flat
    covariance = np.linalg.pinv(normal)
    mean = covariance @ (flat.T @ data.ravel())
    residual = data - design @ mean
    terms = (
        residual**2
        + np.nan_to_num(log_variance)[..., None]
        + np.where(np.isnan(log_variance), 0, np.log(2 * np.pi))[..., None]
    )
    own = -0.5 * terms.sum(axis=(1, 2))
    sign, determinant = np.linalg.slogdet(normal) if mean.size else (1.0, 0.0)
    restricted = 0.5 * (mean.size * np.log(2 * np.pi) - determinant) if sign > 0 else -np.inf
    present = ~np.isnan(log_variance)
    innovations = np.where(present[..., None], residual, np.nan)
    score = np.einsum("dkc,dkcu->du", residual, design)
    return Likelihood(
        float(own.sum() + restricted), mean, covariance, own, innovations, log_variance, score
    )


def join_drifters(pieces: Sequence[tuple[Array, Array, Array, Array]]) -> Tracks:
    """Return the residuals of several drifters as one record.

    pieces: (step (n,), fresh (n,), data (n, 2), regressors (n, 2, unknowns)) of each.
    """
    longest = max((len(piece[0]) for piece in pieces), default=0)

    def padded(values: Array) -> Array:
        return np.concatenate(
            [values, np.zeros((longest - len(values), *values.shape[1:]), values.dtype)]
        )

    step, fresh, data, regressors = (
        np.stack([padded(piece[k]) for piece in pieces]) for k in range(4)
    )
    there = np.arange(longest) < np.array([len(piece[0]) for piece in pieces])[:, None]
    return Tracks(step, fresh & there, there, data, regressors)
