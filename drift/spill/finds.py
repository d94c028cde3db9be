"""What finds and patrols say about a spill: a likelihood for every world, and what follows from it.

With F of N objects found, L = N! / (N - F)! * product over finds of (1 - d) g * (1 - (1 - d) q)^(N - F): g is the
density with which an object that was not destroyed is found there and then, q its probability of having been found by
now, d the share destroyed at once. L is a product over classes. It is summed over N, over d, over the class of finds
where that is unknown, and over which finds are not from this spill. g and q come from a world's particles and are
noisy: drift.spill.shrinkage draws them toward those of other worlds.

A find at sea enters by g alone, for nobody knows where else at sea people looked.

A find that is not from this spill with probability p has the density p / (1 - p) * B, where B is what true finds have
on average before any find. On the coast the E_s finds that are expected on stretch s of length l_s and reporting rate
h_s lie E_s / (l_s h_s) dense, which is sum(E_s^2 / (l_s h_s)) / sum(E_s) where a true find lies on average: B is that,
times l_s h_s of the find's own stretch, evenly over the time since the first release. So it is of the coast that the
spill comes to, and not of the domain: coast without any E_s, however long, leaves it as it is. By a patrol they are
spread over its stretches as their length; at sea over an ellipse as wide as what is adrift, which is the same mean for a
normal law. Without finds and without patrols L is 1: that nothing was found says nothing either.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import special

from drift.particles import partials, weights
from drift.particles.partials import Blocks
from drift.particles.status import Status
from drift.spill import exposure, shrinkage
from drift.spill.exposure import Exposure, Reporting, Walk
from drift.spill.fates import Fates
from geo import sphere
from geo.array import Real
from geo.errors import UserError

Counts = tuple[int, ...]  # finds that are ours, by class

FAR = 6.0  # radii beyond which a find at sea has no weight
SAMPLE = 2000  # particles from which the surprise of a find at sea is estimated


@dataclass(frozen=True)
class AtSea:
    """A place at sea [deg].

    radius: error of the position, one standard deviation of each component [m]. chance: of being seen there.
    """

    lon: float
    lat: float
    radius: float
    chance: float


@dataclass(frozen=True)
class Detection:
    """An object found.

    kind: number of its class, None: unknown. place: number of its stretch, or at sea. time [s after start]; latest:
    found at an unknown time not later than that. by: number of the patrol, None: the public. false: probability that it
    is none of ours.
    """

    name: str
    kind: int | None
    place: int | AtSea
    time: int
    latest: bool = False
    by: int | None = None
    false: float = 0.0


@dataclass(frozen=True)
class Adrift:
    """Where all particles are at the time of a find at sea: binary angles and status, (n,)."""

    lon: npt.NDArray[np.int32]
    lat: npt.NDArray[np.int32]
    status: npt.NDArray[np.int32]


@dataclass(frozen=True)
class Numbers:
    """The number of objects, their classes and the share destroyed at once, with prior probabilities."""

    objects: npt.NDArray[np.int64]  # (m,)
    objects_prior: Real
    shares: Real  # (classes,) of the objects, sum 1
    destroyed: Real  # (k,)
    destroyed_prior: Real

    @property
    def by_class(self) -> npt.NDArray[np.int64]:
        """Objects of every class, (m, classes): whole numbers that add up, largest remainders first."""
        exact = self.objects[:, None] * self.shares
        whole = np.floor(exact + 1e-9).astype(np.int64)
        rank = np.argsort(np.argsort(whole - exact, axis=1, kind="stable"), axis=1, kind="stable")
        return np.asarray(whole + (rank < (self.objects - whole.sum(1))[:, None]))


@dataclass(frozen=True)
class Known:
    """All that is known of a spill up to `now` [s after start]; adrift: by number of the find at sea."""

    numbers: Numbers
    finds: tuple[Detection, ...]
    patrols: tuple[Walk, ...]
    reporting: Reporting
    length: Real  # (S,) of the stretches [m]
    now: float
    adrift: Mapping[int, Adrift]
    usual: Real | None = None  # (finds,) B of each; None: of the worlds at hand, see usual()


@dataclass(frozen=True)
class Posterior:
    """Worlds weighed by finds, and their unknown numbers.

    log_likelihood, weight: (W,). effective: number of worlds that count. objects, destroyed: posteriors of the numbers'
    grids. counts: possible numbers of our finds by class; chosen: their probabilities (len(counts), W). found: chance
    of every particle to have been found, (n,); share: of every world and class, (W, classes), drawn toward other
    worlds'. alien: probability that each find is none of ours, given all, (finds,).
    """

    known: Known
    log_likelihood: Real
    weight: Real
    effective: float
    objects: Real
    destroyed: Real
    counts: tuple[Counts, ...]
    chosen: Real
    found: Real
    share: Real
    alien: Real


@dataclass(frozen=True)
class Surprise:
    """How far a find was to be expected, given all before it.

    probability: that the next find turns up on this stretch (at sea: within its radius of this place, if at sea).
    tail: that it turns up on a stretch (at a place) at most as probable as this. A find with a small tail is odd.
    """

    find: Detection
    probability: float
    tail: float


@dataclass(frozen=True)
class _Evidence:
    """The finds' densities by class and world, logs (finds, classes, W); alien: of none of ours, (finds,)."""

    density: Real
    alien: Real
    alike: shrinkage.Likeness
    prior: Real  # (W,) log weights of the worlds before any find, normalised


def posterior(
    fates: Fates, known: Known, latent: Real, log_weight: Real, member: npt.NDArray[np.int32] | None = None
) -> Posterior:
    """Return what finds and patrols say about every world.

    latent: (W, k) unknowns of the worlds, any scale. log_weight: (W,) of the worlds before any find. member: (W,) of an
    ensemble of winds and currents; None: there is none.
    Raises UserError when there are more finds than objects.
    """
    exposed = exposure.expose(fates, known.reporting, known.patrols)
    evidence = _evidence(known, exposed, latent, log_weight, member)
    if not known.finds and not known.patrols:
        return _weigh(known, exposed, evidence, (), np.zeros(fates.world.size))
    ours = tuple(k for k, find in enumerate(known.finds) if find.false < 1)
    found = exposure.found(exposed, known.now)
    weighed, alien = _weigh(known, exposed, evidence, ours, found), np.zeros(len(known.finds))
    whole = special.logsumexp(evidence.prior + weighed.log_likelihood)
    for k, find in enumerate(known.finds):  # Bayes, over the worlds: L without it, times its density as a false one
        if np.isfinite(evidence.alien[k]):
            others = _weigh(known, exposed, evidence, tuple(j for j in ours if j != k), found).log_likelihood
            alien[k] = np.exp(min(evidence.alien[k] + special.logsumexp(evidence.prior + others) - whole, 0.0))
        elif find.false >= 1:
            alien[k] = 1.0
    return replace(weighed, alien=alien)


def usual(fates: Fates, known: Known, log_weight: Real) -> Real:
    """Return B of every find that may be false, (finds,): how densely finds of ours lie on average, before any; else 0.

    log_weight: (W,) of the worlds before any find. What others leave on the shore does not change when worlds are drawn
    anew: it is reckoned once, from the worlds first drawn.
    """
    if not any(0 < find.false < 1 for find in known.finds):
        return np.zeros(len(known.finds))
    exposed = exposure.expose(fates, known.reporting, known.patrols)
    return _usual(known, exposed, _prior(fates, log_weight))


def tempered(log_likelihood: Real, least: float, log_weight: Real | float = 0.0) -> float:
    """Return the largest exponent in (0, 1] at which the likelihood leaves `least` effective worlds: bisection.

    log_weight: of the worlds before. The exponent is tiny where even these leave fewer.
    """

    def enough(power: float) -> bool:
        return weights.effective(weights.shares(power * log_likelihood + log_weight)) >= least

    if enough(1.0):
        return 1.0
    low, high = -12.0, 0.0  # bounds of the exponent's decimal logarithm
    for _ in range(50):
        middle = (low + high) / 2
        low, high = (middle, high) if enough(10**middle) else (low, middle)
    return float(10**low)


def surprises(
    fates: Fates, known: Known, latent: Real, log_weight: Real, member: npt.NDArray[np.int32] | None = None
) -> tuple[Surprise, ...]:
    """Return for every find, in order of time, how probable its place was before it.

    What is given then are the finds and patrols before it.
    """
    exposed = exposure.expose(fates, known.reporting, known.patrols)
    evidence = _evidence(known, exposed, latent, log_weight, member)
    surprises_in_order: list[Surprise] = []
    before: tuple[int, ...] = ()
    for number in sorted(range(len(known.finds)), key=lambda k: known.finds[k].time):
        find = known.finds[number]
        weighed = _weigh(known, exposed, evidence, before, exposure.found(exposed, find.time, before=True))
        surprises_in_order.append(Surprise(find, *_odds(known, exposed, weighed, number)))
        if find.false < 1:
            before = (*before, number)
    return tuple(surprises_in_order)


def _per_class(fates: Fates, classes: int) -> npt.NDArray[np.int64]:
    return np.asarray(np.bincount(fates.kind, minlength=classes) // fates.worlds)


def _standing(fates: Fates, numbers: Numbers, probability: Real) -> Real:
    """Return how many objects each particle of a class stands for on average, (classes,)."""
    return np.asarray(probability @ numbers.by_class / np.maximum(_per_class(fates, numbers.shares.size), 1))


def _by_world(fates: Fates, slot: npt.NDArray[np.int32], value: Real, classes: int) -> Real:
    """Return sums by class and world, (classes, W)."""
    cell = fates.kind[slot] * fates.worlds + fates.world[slot]
    sums = np.bincount(cell, value, classes * fates.worlds).astype(float)
    return np.asarray(sums.reshape(classes, fates.worlds))


def _blocks(fates: Fates) -> Blocks:
    """Return the blocks by which sums over particles are made: whole worlds of a class."""
    each = np.bincount(fates.kind) // fates.worlds
    bounds = [0, *(int(n) for n in np.cumsum(each * fates.worlds))]
    return partials.cut(bounds, bounds[:-1], [max(int(n), 1) * partials.WORLDS for n in each])


def _total(fates: Fates, slot: npt.NDArray[Any], value: Real) -> float:
    """Return the sum of values of some particles."""
    return _blocks(fates).total(value, slot)


def _evidence(
    known: Known, exposed: Exposure, latent: Real, log_weight: Real, member: npt.NDArray[np.int32] | None = None
) -> _Evidence:
    fates, numbers = exposed.fates, known.numbers
    classes = numbers.shares.size
    n, alike = _per_class(fates, classes), shrinkage.likeness(latent, member)
    prior = _prior(fates, log_weight)
    usually = known.usual if known.usual is not None else _usual(known, exposed, prior)
    density = np.full((len(known.finds), classes, fates.worlds), -np.inf)
    alien = np.full(len(known.finds), -np.inf)
    for k, find in enumerate(known.finds):
        slot, value = _found_there(known, exposed, k)
        sums = _by_world(fates, slot, value, classes)
        squares = _by_world(fates, slot, value**2, classes)
        for c in range(classes) if find.kind is None else [find.kind]:
            density[k, c] = np.log(shrinkage.rates(sums[c], squares[c], int(n[c]), alike, _full(known, find)))
        if 0 < find.false < 1:
            alien[k] = special.logit(find.false) + np.log(usually[k])
    return _Evidence(density, alien, alike, prior)


def _found_there(known: Known, exposed: Exposure, number: int) -> tuple[npt.NDArray[np.int32], Real]:
    """Return slots and their densities of being found as a find was."""
    find = known.finds[number]
    if isinstance(find.place, AtSea):
        slot, distance = _around(known.adrift[number], find.place)
        area = 2 * np.pi * find.place.radius**2
        return slot, find.place.chance / area * np.exp(-0.5 * (distance / find.place.radius) ** 2)
    if find.by is not None:
        rows, value = exposure.searched(exposed, find.place, find.by)
    elif find.latest:
        rows, value = exposure.reported(exposed, find.place, find.time)
    else:
        rows, value = exposure.public(exposed, find.place, find.time)
    return exposed.slot[rows], value


def _full(known: Known, find: Detection) -> float:
    """Return the density with which an object is found that is in the very place at the very time."""
    if isinstance(find.place, AtSea):
        return find.place.chance / (2 * np.pi * find.place.radius**2)
    if find.by is not None:
        return known.patrols[find.by].detection
    return 1.0 if find.latest else max(float(known.reporting.rate[find.place]), 1e-300)


def _around(adrift: Adrift, place: AtSea) -> tuple[npt.NDArray[np.int32], Real]:
    """Return the slots adrift near a place at sea, and their distances from it [m]."""
    lat = np.radians(place.lat)
    reach = FAR * place.radius / sphere.RADIUS
    near = (adrift.status == Status.ADRIFT) & (np.abs(adrift.lat * sphere.UNIT - lat) <= reach)
    slot = np.flatnonzero(near).astype(np.int32)
    lon_lat = np.radians(place.lon), lat, adrift.lon[slot] * sphere.UNIT, adrift.lat[slot] * sphere.UNIT
    distance = sphere.distance(*lon_lat)
    kept = distance <= FAR * place.radius
    return slot[kept], distance[kept]


def _prior(fates: Fates, log_weight: Real) -> Real:
    """Return the log weights of the worlds before any find, normalised, (W,)."""
    shares = weights.shares(np.broadcast_to(np.asarray(log_weight, float), fates.worlds))
    return np.asarray(np.log(shares + 1e-300))


def _usual(known: Known, exposed: Exposure, prior: Real) -> Real:
    """Return B of every find that may be false, (finds,), at least 1e-300; 0 of the others."""
    fates, numbers = exposed.fates, known.numbers
    each = _standing(fates, numbers, numbers.objects_prior)
    standing = (each[fates.kind] * np.exp(prior)[fates.world]) * (1 - numbers.destroyed_prior @ numbers.destroyed)
    doubtful = {k: find for k, find in enumerate(known.finds) if 0 < find.false < 1}
    public = any(find.by is None and not isinstance(find.place, AtSea) for find in doubtful.values())
    dense = _dense(known, exposed, standing) if public else 0.0
    begun = float(fates.release.min())
    density = np.zeros(len(known.finds))
    for k, find in doubtful.items():
        if isinstance(find.place, AtSea):
            density[k] = _dense_at_sea(known.adrift[k], find.place, standing, _blocks(fates))
        elif find.by is not None:
            places = known.patrols[find.by].segments
            finds = [exposure.searched(exposed, s, find.by) for s in places]
            expected = sum(_total(fates, slot := exposed.slot[rows], standing[slot] * chance) for rows, chance in finds)
            density[k] = expected * known.length[find.place] / known.length[list(places)].sum()
        else:
            there = float(known.length[find.place] * known.reporting.rate[find.place])
            density[k] = dense * there * ((find.time - begun) if find.latest else 1.0) / max(known.now - begun, 1.0)
    return np.where([k in doubtful for k in range(density.size)], np.maximum(density, 1e-300), 0.0)


def _dense(known: Known, exposed: Exposure, standing: Real) -> float:
    """Return how many public finds of ours there are by metre of coast and reporting rate where one lies on average.

    It is the mean over the finds expected, not over the coast, of which there is as much as the domain happens to hold.
    """
    expected = np.zeros(known.length.size)
    for s in np.flatnonzero(np.diff(exposed.bounds)):
        rows, chance = exposure.reported(exposed, int(s), known.now)
        slot = exposed.slot[rows]
        expected[s] = _total(exposed.fates, slot, standing[slot] * chance)
    there = expected > 0
    exposures = (known.length * known.reporting.rate)[there]
    return float((expected[there] ** 2 / exposures).sum() / max(expected.sum(), 1e-300))


def _dense_at_sea(adrift: Adrift, place: AtSea, standing: Real, blocks: Blocks) -> float:
    """Return how many of ours are found by square metre of an even ellipse as wide as what is adrift."""
    at = np.flatnonzero((adrift.status == Status.ADRIFT) & (standing > 0))
    if at.size < 3:
        return 0.0
    middle = np.radians(place.lon), np.radians(place.lat)
    x, y = sphere.offset(*middle, adrift.lon[at] * sphere.UNIT, adrift.lat[at] * sphere.UNIT)
    weight = standing[at]
    total, squares = blocks.total(weight, at), blocks.total(weight**2, at)
    x, y = (values - blocks.total(weight * values, at) / total for values in (x, y))
    square = [[blocks.total(weight * a * b, at) for a in (x, y)] for b in (x, y)]
    spread = np.array(square) / (total - squares / total) + place.radius**2 * np.eye(2)  # as numpy.cov has it
    return float(place.chance * total / (4 * np.pi * np.sqrt(np.linalg.det(spread))))


def _weigh(known: Known, exposed: Exposure, evidence: _Evidence, ours: tuple[int, ...], found: Real) -> Posterior:
    """Return the posterior given some of the finds, and every particle's chance of having been found by then."""
    fates, numbers = exposed.fates, known.numbers
    classes, worlds = numbers.shares.size, fates.worlds
    n = _per_class(fates, classes)
    every = np.arange(fates.world.size, dtype=np.int32)
    mean = _by_world(fates, every, found, classes) / np.maximum(n, 1)[:, None]
    square = _by_world(fates, every, found**2, classes) / np.maximum(n, 1)[:, None]
    share = np.empty((worlds, classes))
    for c in range(classes):
        share[:, c] = shrinkage.share(mean[c], np.maximum(square[c] - mean[c] ** 2, 0), int(n[c]), evidence.alike)
    counted = _counted(evidence, ours, classes, worlds)
    size = np.full((len(counted), worlds), -np.inf)
    objects = np.full((worlds, numbers.objects.size), -np.inf)
    destroyed = np.full((worlds, numbers.destroyed.size), -np.inf)
    for k, (counts, log) in enumerate(counted.items()):
        joint = log[:, None, None] + joint_of(numbers, counts, share)
        size[k] = special.logsumexp(joint, axis=(1, 2))
        objects = np.logaddexp(objects, special.logsumexp(joint, axis=2))
        destroyed = np.logaddexp(destroyed, special.logsumexp(joint, axis=1))
    log_likelihood = special.logsumexp(size, axis=0)
    if not np.isfinite(log_likelihood).any():
        fewest = min(sum(counts) for counts in counted)
        raise UserError(
            f"{fewest} objects were found, but not so many of their classes were spilled "
            f"({numbers.objects.max()} in all); raise [spill] objects, or give finds a probability of being false"
        )
    weight = weights.shares(log_likelihood + evidence.prior)
    with np.errstate(invalid="ignore"):
        chosen = np.nan_to_num(np.exp(size - log_likelihood), nan=0.0)
        objects, destroyed = (
            partials.over_worlds(weight[:, None] * np.nan_to_num(np.exp(log - log_likelihood[:, None])))
            for log in (objects, destroyed)
        )
    return Posterior(
        known,
        log_likelihood,
        weight,
        weights.effective(weight),
        objects,
        destroyed,
        tuple(counted),
        chosen,
        found,
        share,
        np.zeros(len(known.finds)),
    )


def _counted(evidence: _Evidence, ours: tuple[int, ...], classes: int, worlds: int) -> dict[Counts, Real]:
    """Return the log of the summed densities (W,) of all ways to have so many finds of each class."""
    ways: dict[Counts, Real] = {(0,) * classes: np.zeros(worlds)}
    for k in ours:
        ahead: dict[Counts, Real] = {}

        def add(counts: Counts, log: Real, ahead: dict[Counts, Real] = ahead) -> None:
            ahead[counts] = np.logaddexp(ahead[counts], log) if counts in ahead else log

        for counts, log in ways.items():
            for c in np.flatnonzero(np.isfinite(evidence.density[k]).any(axis=1)):
                more = (*counts[:c], counts[c] + 1, *counts[c + 1 :])
                add(more, log + evidence.density[k, c])
            if np.isfinite(evidence.alien[k]):
                add(counts, log + evidence.alien[k])
        ways = ahead
    return ways


def joint_of(numbers: Numbers, counts: Counts, share: Real) -> Real:
    """Return the log of prior times likelihood of so many finds of each class, without densities.

    Its shape is (W, objects, destroyed). share: probability that an object of a class that was not destroyed has been
    found, (W, classes).
    """
    with np.errstate(divide="ignore"):
        joint = np.log(numbers.objects_prior)[:, None] + np.log(numbers.destroyed_prior)
        left = np.log1p(-numbers.destroyed)
    joint = np.repeat(joint[None], len(share), axis=0)
    for c, found in enumerate(counts):
        total = numbers.by_class[:, c, None]
        lost = total < found
        remain = np.maximum(total - found, 0)
        ways = special.gammaln(total + 1.0) - special.gammaln(remain + 1.0) + special.xlogy(found, np.exp(left))
        unseen = np.log1p(-np.minimum((1 - numbers.destroyed) * share[:, c, None, None], 1 - 1e-15))
        joint = joint + np.where(lost, -np.inf, ways) + remain * unseen
    return np.asarray(joint)


def remaining(weighed: Posterior) -> Real:
    """Return the mean number of objects (W, classes) of each world that are neither destroyed nor found."""
    numbers, left = weighed.known.numbers, np.zeros_like(weighed.share)
    destroyed = numbers.destroyed
    for counts, chosen in zip(weighed.counts, weighed.chosen, strict=True):
        joint = joint_of(numbers, counts, weighed.share)
        peak = joint.max((1, 2), keepdims=True)
        mass = np.exp(joint - np.where(np.isfinite(peak), peak, 0.0))
        mass *= (chosen / np.maximum(mass.sum((1, 2)), 1e-300))[:, None, None]
        for c, found in enumerate(counts):
            share = np.minimum(weighed.share[:, c, None, None], 1 - 1e-15)
            alive = (1 - destroyed) * (1 - share) / (1 - (1 - destroyed) * share)
            left[:, c] += (mass * np.maximum(numbers.by_class[:, c, None] - found, 0) * alive).sum((1, 2))
    return left


def _odds(known: Known, exposed: Exposure, weighed: Posterior, number: int) -> tuple[float, float]:
    """Return the probability of a find's place, and that of all places at most as probable."""
    find, fates, numbers = known.finds[number], exposed.fates, known.numbers
    each = _standing(fates, numbers, weighed.objects)
    if find.kind is not None:
        each = np.where(np.arange(each.size) == find.kind, each, 0.0)
    standing = each[fates.kind] * weighed.weight[fates.world]
    if isinstance(find.place, AtSea):
        return _odds_at_sea(known.adrift[number], find.place, standing, _blocks(fates))
    rate = np.zeros(known.length.size)
    for s in range(rate.size) if find.by is None else known.patrols[find.by].segments:
        if find.by is not None:
            rows, value = exposure.searched(exposed, s, find.by)
        else:
            rows, value = (exposure.reported if find.latest else exposure.public)(exposed, s, find.time)
        slot = exposed.slot[rows]
        rate[s] = _total(fates, slot, standing[slot] * value)
    if not rate.sum() > 0:
        return 0.0, 0.0
    rate /= rate.sum()
    mine = rate[find.place]
    return float(mine), float(rate[rate <= mine * (1 + 1e-9)].sum())


def _odds_at_sea(adrift: Adrift, place: AtSea, standing: Real, blocks: Blocks) -> tuple[float, float]:
    """Return the probability within a radius of a place, and that of particles where it is at most as dense."""
    running = blocks.running(np.where(adrift.status == Status.ADRIFT, standing, 0.0))
    if not running[-1] > 0:
        return 0.0, 0.0
    some = np.searchsorted(running, (np.arange(SAMPLE) + 0.5) / SAMPLE * running[-1])  # an even sample, by weight
    middle = np.radians(place.lon), np.radians(place.lat)
    x, y = sphere.offset(*middle, adrift.lon[some] * sphere.UNIT, adrift.lat[some] * sphere.UNIT)
    radius = 2 * place.radius**2
    mine = float(np.exp(-(x**2 + y**2) / radius).mean())
    dense = np.array([np.exp(-((x - a) ** 2 + (y - b) ** 2) / radius).mean() for a, b in zip(x, y, strict=True)])
    return min(mine / 2, 1.0), float((dense - 1 / SAMPLE <= mine).mean())
