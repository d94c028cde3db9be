"""The worlds of a spill: what all its objects share and nobody knows, drawn once a world.

The unknowns are drawn as independent standard normals.

Each unknown is a function of one or more latent normals, so a prior is a standard normal in every direction, cut to
what is possible (releases in the stated area, in water); worlds can be drawn anew from any density over the latents and
weighted by the ratio of the two (importance sampling; Cappe et al. 2004, "Population Monte Carlo",
doi:10.1198/106186004X12803). Works on NumPy float64; nothing here touches the device.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
import numpy.typing as npt
from scipy import special

from drift.spill import releases
from drift.spill.records import Spill
from geo import sphere
from geo.array import Array, Real
from geo.errors import UserError
from kernels import noise
from kernels.noise import Purpose

IsLand = Callable[[Array, Array], Array]

DEFENSIVE = 0.1  # share of renewed worlds that still come from the prior: keeps weights bounded (Hesterberg 1995)
TRIES = 400  # rounds of candidates before a release is refused as lying on land


@dataclass(frozen=True)
class Worlds:
    """What each world is like; arrays of shape (w,), sinking (w, classes)."""

    latent: Real  # (w, k) standard normals under the prior
    names: tuple[str, ...]  # names of the latents
    log_weight: Real  # log of the prior over the density that the worlds were drawn from
    lon: npt.NDArray[np.int32]  # of the release [binary angle]
    lat: npt.NDArray[np.int32]
    release: npt.NDArray[np.int64]  # [s since 1970] when it begins
    windage: Real  # factor on all leeway
    current_east: Real  # [m/s] error of the current
    current_north: Real
    sinking: Real  # [s] half-life or median time of waterlogging, by class; inf: never
    reporting: Real  # factor on all reporting rates

    @property
    def size(self) -> int:
        """Number of worlds."""
        return int(self.lon.size)


@dataclass(frozen=True)
class Proposal:
    """A density over latents to draw worlds from: a mixture of normals, and a share of the prior."""

    centre: Real  # (m, k)
    share: Real  # (m,) sum 1
    covariance: Real  # (k, k) of each normal

    def draw(self, rng: np.random.Generator, count: int) -> Real:
        """Return latents, shape (count, k)."""
        chosen = rng.choice(self.share.size, count, p=self.share)
        near = self.centre[chosen] + rng.multivariate_normal(np.zeros(self.centre.shape[1]), self.covariance, count)
        return np.where(rng.random(count)[:, None] < DEFENSIVE, rng.standard_normal(near.shape), near)

    def log_density(self, latent: Real) -> Real:
        """Return the logarithm of the density at latents (n, k).

        A constant is left out, the same one as in `_log_prior`.
        """
        factor = np.linalg.cholesky(self.covariance)
        scaled = np.linalg.solve(factor, latent.T).T
        centres = np.linalg.solve(factor, self.centre.T).T
        square = (scaled**2).sum(1)[:, None] + (centres**2).sum(1)[None] - 2 * scaled @ centres.T
        mixture = special.logsumexp(-0.5 * square, axis=1, b=self.share) - np.log(np.diag(factor)).sum()
        return np.asarray(np.logaddexp(math.log(1 - DEFENSIVE) + mixture, math.log(DEFENSIVE) + _log_prior(latent)))


def around(worlds: Worlds, weight: Real) -> Proposal:
    """Return a density about weighted worlds: a normal at each.

    The normals are as wide as the rule of Silverman (1986, eq. 4.15) has it.
    """
    kept = np.flatnonzero(weight > 0)
    share, centre = weight[kept] / weight[kept].sum(), worlds.latent[kept]
    effective, k = 1 / (share**2).sum(), centre.shape[1]
    mean = share @ centre
    spread = (centre - mean).T @ ((centre - mean) * share[:, None])
    width = (4 / ((k + 2) * effective)) ** (1 / (k + 4))
    covariance = width**2 * (spread + 1e-4 * np.eye(k))
    # The centres are drawn in, so that the mixture is as wide as they were (West 1993).
    shrink = math.sqrt(1 - min(width, 0.95) ** 2)
    return Proposal(mean + shrink * (centre - mean), share, covariance)


def _log_prior(latent: Real) -> Real:
    return np.asarray(-0.5 * (latent**2).sum(1))


def draw(
    spill: Spill, seed: int, is_land: IsLand, proposal: Proposal | None = None, count: int | None = None
) -> Worlds:
    """Return worlds from the prior, or from a proposal and weighted for it.

    is_land: int32 binary angles (lon, lat) -> bool. Raises UserError when next to no release lies in water.
    """
    rng = noise.generator(seed, Purpose.WORLDS)
    model = _Model(spill)
    wanted = count or spill.worlds
    kept: list[Real] = []
    have = 0
    for _ in range(TRIES):
        latent = rng.standard_normal((wanted, len(model.names))) if proposal is None else proposal.draw(rng, wanted)
        lon, lat, possible = model.place(latent)
        possible &= ~is_land(lon, lat)
        kept.append(latent[possible])
        have += int(possible.sum())
        if have >= wanted:
            break
    else:
        raise UserError(
            f"[spill]: its release lies on land, or in too thin an area: {have} of {TRIES * wanted:,} draws lay in "
            "water; move or widen it, or check [coast] source"
        )
    latent = np.concatenate(kept)[:wanted]
    log_weight = np.zeros(wanted) if proposal is None else _log_prior(latent) - proposal.log_density(latent)
    return model.worlds(latent, log_weight)


class _Model:
    """How the latents of a spill become its unknowns; only what is uncertain has a latent."""

    def __init__(self, spill: Spill) -> None:
        self.spill = spill
        self.release = releases.law(spill.prior)
        names = [*self.release.names]
        names += ["windage"] if spill.windage_bias > 0 else []
        names += ["current_east", "current_north"] if spill.current_bias > 0 else []
        for kind in spill.kinds:
            if kind.sinking and kind.sinking.time[1] > kind.sinking.time[0]:
                names.append(f"sinking {kind.name}")
        names += ["reporting"] if spill.reporting_bias > 0 else []
        self.names = tuple(names)

    def of(self, latent: Real, name: str) -> Real:
        """Return one latent, 0 where there is none."""
        return latent[:, self.names.index(name)] if name in self.names else np.zeros(len(latent))

    def place(self, latent: Real) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.int32], npt.NDArray[np.bool_]]:
        """Return releases [binary angle] and whether they are possible by the stated prior."""
        lon, lat, possible = self.release.place(partial(self.of, latent))
        return sphere.to_binary(np.degrees(lon)), sphere.to_binary(np.degrees(lat)), possible

    def worlds(self, latent: Real, log_weight: Real) -> Worlds:
        """Return the worlds of latents."""
        spill = self.spill
        lon, lat, _ = self.place(latent)
        sinking = np.full((len(latent), len(spill.kinds)), np.inf)
        for k, kind in enumerate(spill.kinds):
            if kind.sinking:
                low, high = np.log(kind.sinking.time)
                sinking[:, k] = np.exp(low + (high - low) * special.ndtr(self.of(latent, f"sinking {kind.name}")))
        return Worlds(
            latent=latent,
            names=self.names,
            log_weight=log_weight,
            lon=lon,
            lat=lat,
            release=self.release.time(partial(self.of, latent)),
            windage=np.exp(spill.windage_bias * self.of(latent, "windage")),
            current_east=spill.current_bias * self.of(latent, "current_east"),
            current_north=spill.current_bias * self.of(latent, "current_north"),
            sinking=sinking,
            reporting=np.exp(spill.reporting_bias * self.of(latent, "reporting")),
        )
