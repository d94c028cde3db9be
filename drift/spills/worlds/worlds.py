"""The worlds of a spill: draws of the unknowns that all its objects share.

Each unknown is a function of one or more latents, which are independent standard normals. So the
prior is a standard normal in every direction, cut to what is possible (releases in the stated area,
in water). Worlds can be drawn again from any density over the latents and weighted by the ratio of
the two densities (importance sampling; Cappe et al. 2004, "Population Monte Carlo",
doi:10.1198/106186004X12803). Works on NumPy float64, without the device.
"""

import hashlib
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import special

from drift.engine.motion.scenario import TrackPrior
from drift.engine.particles import members as dealt
from drift.engine.particles import partials
from drift.spills.worlds import releases
from drift.spills.worlds.records import Spill
from geo import sphere
from geo.array import Array, Real
from geo.errors import UserError
from kernels.maths import noise
from kernels.maths.noise import Purpose

IsLand = Callable[[Array, Array], Array]

# share of redrawn worlds that still come from the prior: keeps weights bounded (Hesterberg 1995)
DEFENSIVE = 0.1
TRIES = 400  # rounds of candidates before a release is rejected as lying on land


@dataclass(frozen=True)
class Worlds:
    """The unknowns of each world; arrays of shape (w,), sinking (w, classes)."""

    latent: Real  # (w, k) standard normals under the prior
    names: tuple[str, ...]  # names of the latents
    log_weight: Real  # log of the prior density over the density that the worlds were drawn from
    lon: npt.NDArray[np.int32]  # of the release [binary angle]
    lat: npt.NDArray[np.int32]
    release: npt.NDArray[np.int64]  # [s since 1970] when it begins
    windage: Real  # factor on all leeway
    current_east: Real  # [m/s] error of the current
    current_north: Real
    sinking: Real  # [s] half-life or median time of waterlogging, by class; inf: never
    reporting: Real  # factor on all reporting rates
    # member of an ensemble of winds and currents, ascending; None: no ensemble
    member: npt.NDArray[np.int32] | None = None
    members: int = 0  # size of that ensemble
    # of objects along a ship's track, (w, losses); None: they go adrift at the release's place
    loss_begin: npt.NDArray[np.int64] | None = None  # [s since 1970]
    loss_length: Real | None = None  # [s]
    clock: Real | None = None  # [s] by which the ship's clock was fast, (w,)

    @property
    def size(self) -> int:
        """Number of worlds."""
        return int(self.lon.size)

    def some(self, first: int, last: int) -> "Worlds":
        """Return the worlds from number `first` to before `last`."""
        columns: dict[str, Any] = {
            name: value[first:last]
            for name, value in vars(self).items()
            if isinstance(value, np.ndarray)
        }
        return replace(self, **columns)

    @property
    def digest(self) -> str:
        """Digest of all values of the worlds, to the last bit."""
        total = hashlib.blake2b(digest_size=16)
        for value in vars(self).values():
            total.update(
                np.ascontiguousarray(value).tobytes()
                if isinstance(value, np.ndarray)
                else repr(value).encode()
            )
        return total.hexdigest()


@dataclass(frozen=True)
class Proposal:
    """A density over latents to draw worlds from: a mixture of normals and a share of the prior."""

    centre: Real  # (m, k)
    share: Real  # (m,) sum 1
    covariance: Real  # (k, k) of each normal
    # (m,) member of the ensemble of each normal; None: no ensemble
    member: npt.NDArray[np.int32] | None = None
    members: int = 0  # size of the ensemble

    def draw(
        self, rng: np.random.Generator, count: int
    ) -> tuple[Real, npt.NDArray[np.int32] | None]:
        """Return latents, (count, k), and members of the ensemble, (count,), if there is one."""
        chosen = rng.choice(self.share.size, count, p=self.share)
        near = self.centre[chosen] + rng.multivariate_normal(
            np.zeros(self.centre.shape[1]), self.covariance, count
        )
        from_prior = rng.random(count) < DEFENSIVE
        latent = np.where(from_prior[:, None], rng.standard_normal(near.shape), near)
        if self.member is None:
            return latent, None
        return latent, np.where(
            from_prior, rng.integers(self.members, size=count), self.member[chosen]
        ).astype(np.int32)

    def log_density(self, latent: Real, member: npt.NDArray[np.int32] | None = None) -> Real:
        """Return the log density at latents (n, k), and at members (n,) of an ensemble if any.

        A constant is left out, the same one as in `_log_prior`.
        """
        factor = np.linalg.cholesky(self.covariance)
        scaled = np.linalg.solve(factor, latent.T).T
        centres = np.linalg.solve(factor, self.centre.T).T
        square = (scaled**2).sum(1)[:, None] + (centres**2).sum(1)[None] - 2 * scaled @ centres.T
        share = (
            self.share
            if self.member is None
            else np.where(self.member == np.asarray(member)[:, None], self.share, 0)
        )
        mixture = special.logsumexp(-0.5 * square, axis=1, b=share) - np.log(np.diag(factor)).sum()
        prior = _log_prior(latent, self.members)
        return np.asarray(
            np.logaddexp(math.log(1 - DEFENSIVE) + mixture, math.log(DEFENSIVE) + prior)
        )


def proposal_around(worlds: Worlds, weight: Real) -> Proposal:
    """Return a proposal around weighted worlds: a mixture of a normal at each.

    The width of the normals is by the rule of Silverman (1986, eq. 4.15).
    """
    weighted = np.flatnonzero(weight > 0)
    share, centre = weight[weighted] / weight[weighted].sum(), worlds.latent[weighted]
    effective, k = 1 / (share**2).sum(), centre.shape[1]
    mean = share @ centre
    spread = (centre - mean).T @ ((centre - mean) * share[:, None])
    width = (4 / ((k + 2) * effective)) ** (1 / (k + 4))
    covariance = width**2 * (spread + 1e-4 * np.eye(k))
    # Shrinking the centres keeps the variance of the mixture equal to theirs (West 1993).
    shrink = math.sqrt(1 - min(width, 0.95) ** 2)
    member = None if worlds.member is None else worlds.member[weighted]
    return Proposal(mean + shrink * (centre - mean), share, covariance, member, worlds.members)


def _log_prior(latent: Real, members: int = 0) -> Real:
    return np.asarray(-0.5 * (latent**2).sum(1) - (math.log(members) if members else 0.0))


def draw_worlds(
    spill: Spill,
    seed: int,
    is_land: IsLand,
    proposal: Proposal | None = None,
    count: int | None = None,
    members: int = 0,
) -> Worlds:
    """Draw worlds from the prior, or from a proposal, with importance weights.

    Args:
        spill: the spill, with the prior of its worlds.
        seed: seed of the run.
        is_land: function of int32 binary angles (lon, lat) to bool.
        proposal: density to draw from; None: the prior.
        count: number of worlds; None: as the spill says.
        members: number of members of an ensemble of winds and currents; worlds from the prior are
            dealt to them evenly.

    Returns:
        The worlds with their log weights.

    Raises:
        UserError: next to no release lies in water, or there are fewer worlds than members.
    """
    rng = noise.generator(seed, Purpose.WORLDS)
    model = _Model(spill)
    wanted = count or spill.worlds
    if wanted < members:
        raise UserError(
            f"[spill] worlds: {wanted} are too few for {members} members of the winds or "
            "currents; give more"
        )
    kept_latent: list[Real] = []
    kept_member: list[npt.NDArray[np.int32]] = []
    accepted = 0
    for _ in range(TRIES):
        member = None
        if proposal is None:
            latent = rng.standard_normal((wanted, len(model.names)))
        else:
            latent, member = proposal.draw(rng, wanted)
        lon, lat, possible = model.place(latent)
        possible &= ~is_land(lon, lat)
        kept_latent.append(latent[possible])
        if member is not None:
            kept_member.append(member[possible])
        accepted += int(possible.sum())
        if accepted >= wanted:
            break
    else:
        raise UserError(
            f"[spill]: its release lies on land, or in too thin an area: {accepted} of "
            f"{TRIES * wanted:,} draws lay in water; move or widen it, or check [coast] source"
        )
    latent = np.concatenate(kept_latent)[:wanted]
    if proposal is None:
        if not members:
            return model.worlds(latent, np.zeros(wanted))
        member = dealt.deal(wanted, members, partials.WORLDS)
        return replace(
            model.worlds(latent, dealt.even(member, members) + math.log(wanted)),
            member=member,
            members=members,
        )
    if not kept_member:
        return model.worlds(latent, _log_prior(latent) - proposal.log_density(latent))
    member = np.concatenate(kept_member)[:wanted]
    order = np.argsort(member, kind="stable")  # worlds of a member follow each other
    latent, member = latent[order], member[order]
    log_weight = _log_prior(latent, proposal.members) - proposal.log_density(latent, member)
    return replace(model.worlds(latent, log_weight), member=member, members=proposal.members)


class _Model:
    """Mapping from the latents of a spill to its unknowns; only uncertain ones have a latent."""

    def __init__(self, spill: Spill) -> None:
        self.spill = spill
        self.release = releases.release_law(spill.prior)
        names = [*self.release.names]
        names += ["windage"] if spill.windage_bias > 0 else []
        names += ["current_east", "current_north"] if spill.current_bias > 0 else []
        for kind in spill.kinds:
            if kind.sinking and kind.sinking.time[1] > kind.sinking.time[0]:
                names.append(f"sinking {kind.name}")
        names += ["reporting"] if spill.reporting_bias > 0 else []
        self.names = tuple(names)

    def latent_of(self, latent: Real, name: str) -> Real:
        """Return one latent by name, 0 if it does not exist."""
        return latent[:, self.names.index(name)] if name in self.names else np.zeros(len(latent))

    def place(
        self, latent: Real
    ) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.int32], npt.NDArray[np.bool_]]:
        """Return release positions [binary angle], and whether the prior allows them."""
        lon, lat, possible = self.release.place(partial(self.latent_of, latent))
        return sphere.to_binary(np.degrees(lon)), sphere.to_binary(np.degrees(lat)), possible

    def worlds(self, latent: Real, log_weight: Real) -> Worlds:
        """Return the worlds of latents."""
        spill = self.spill
        lon, lat, _ = self.place(latent)
        sinking = np.full((len(latent), len(spill.kinds)), np.inf)
        for k, kind in enumerate(spill.kinds):
            if kind.sinking:
                low, high = np.log(kind.sinking.time)
                sinking[:, k] = np.exp(
                    low
                    + (high - low) * special.ndtr(self.latent_of(latent, f"sinking {kind.name}"))
                )
        lost: dict[str, Any] = {}
        if isinstance(spill.prior, TrackPrior):
            losses = releases.losses(spill.prior, partial(self.latent_of, latent))
            lost = {
                "loss_begin": losses.begin,
                "loss_length": losses.length,
                "clock": losses.clock,
            }
        return Worlds(
            latent=latent,
            names=self.names,
            log_weight=log_weight,
            lon=lon,
            lat=lat,
            release=self.release.time(partial(self.latent_of, latent)),
            windage=np.exp(spill.windage_bias * self.latent_of(latent, "windage")),
            current_east=spill.current_bias * self.latent_of(latent, "current_east"),
            current_north=spill.current_bias * self.latent_of(latent, "current_north"),
            sinking=sinking,
            reporting=np.exp(spill.reporting_bias * self.latent_of(latent, "reporting")),
            **lost,
        )
