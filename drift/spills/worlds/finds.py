"""What finds and patrols say about a spill: a likelihood for every world, and what follows from it.

With F of N objects found, L = N! / (N - F)! * product over finds of (1 - d) g * (1 - (1 - d) q)^(N
- F): g is the density with which an object that was not destroyed is found there and then, q its
probability of having been found by now, d the share destroyed at once. L is a product over classes.
It is summed over N, over d, over the class of finds where that is unknown, and over which finds are
not from this spill. g and q come from a world's particles and are noisy:
drift.spills.worlds.shrinkage draws them toward those of other worlds.

A find at sea enters by g alone, for nobody knows where else at sea people looked.

A find that is not from this spill with probability p has the density p / (1 - p) * B, where B is
what true finds have on average before any find. On the coast the E_s finds that are expected on
stretch s of length l_s and reporting rate h_s lie E_s / (l_s h_s) dense, which is sum(E_s^2 / (l_s
h_s)) / sum(E_s) where a true find lies on average: B is that, times l_s h_s of the find's own
stretch, evenly over the time since the first release. So it is of the coast that the spill comes
to, and not of the domain: coast without any E_s, however long, leaves it as it is. By a patrol they
are spread over its stretches as their length; at sea over an ellipse as wide as what is adrift,
which is the same mean for a normal law. Without finds and without patrols L is 1: that nothing was
found says nothing either.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import numpy.typing as npt
from scipy import special

from drift.engine.particles import partials, weights
from drift.engine.particles.status import Status
from drift.spills.worlds import exposure, shrinkage
from drift.spills.worlds.exposure import Exposure, Reporting, Walk
from drift.spills.worlds.fates import Adrift, Fates, Source
from geo import sphere
from geo.array import Real
from geo.errors import UserError

Counts = tuple[int, ...]  # finds that are ours, by class
Standing = Callable[[Fates], Real]  # how many objects each particle stands for, (n,)
# The rows of a stretch, and how likely each is found there; and the stretches where any can be.
Law = tuple[Callable[[Exposure, int], tuple[slice, Real]], Sequence[int]]

FAR = 6.0  # radii beyond which a find at sea has no weight
SAMPLE = 2000  # particles from which the surprise of a find at sea is estimated
TOGETHER = 256  # worlds whose numbers are summed over at a time


@dataclass(frozen=True)
class AtSea:
    """A place at sea [deg].

    radius: error of the position, one standard deviation of each component [m]. chance: of being
    seen there.
    """

    lon: float
    lat: float
    radius: float
    chance: float


@dataclass(frozen=True)
class Detection:
    """An object found.

    kind: number of its class, None: unknown. place: number of its stretch, or at sea. time [s after
    start]; latest: found at an unknown time not later than that. by: number of the patrol, None:
    the public. false: probability that it is none of ours.
    """

    name: str
    kind: int | None
    place: int | AtSea
    time: int
    latest: bool = False
    by: int | None = None
    false: float = 0.0


@dataclass(frozen=True)
class Numbers:
    """The number of objects, their classes and the share destroyed at once, with prior
    probabilities.
    """

    objects: npt.NDArray[np.int64]  # (m,)
    objects_prior: Real
    shares: Real  # (classes,) of the objects, sum 1
    destroyed: Real  # (k,)
    destroyed_prior: Real

    @property
    def by_class(self) -> npt.NDArray[np.int64]:
        """Objects of every class, (m, classes): whole numbers that add up, largest remainders
        first.
        """
        exact = self.objects[:, None] * self.shares
        whole = np.floor(exact + 1e-9).astype(np.int64)
        rank = np.argsort(np.argsort(whole - exact, axis=1, kind="stable"), axis=1, kind="stable")
        return np.asarray(whole + (rank < (self.objects - whole.sum(1))[:, None]))


@dataclass(frozen=True)
class Known:
    """All that is known of a spill up to `now` [s after start]."""

    numbers: Numbers
    finds: tuple[Detection, ...]
    patrols: tuple[Walk, ...]
    reporting: Reporting
    length: Real  # (S,) of the stretches [m]
    now: float
    usual: Real | None = None  # (finds,) B of each; None: of the worlds at hand, see usual()


@dataclass(frozen=True)
class Posterior:
    """Worlds weighed by finds, and their unknown numbers.

    log_likelihood, weight: (W,). effective: number of worlds that count. objects, destroyed:
    posteriors of the numbers' grids. counts: possible numbers of our finds by class; chosen: their
    probabilities (len(counts), W). share: chance to have been found of every world and class, (W,
    classes), drawn toward other worlds'. alien: probability that each find is none of ours, given
    all, (finds,).
    """

    known: Known
    log_likelihood: Real
    weight: Real
    effective: float
    objects: Real
    destroyed: Real
    counts: tuple[Counts, ...]
    chosen: Real
    share: Real
    alien: Real


@dataclass(frozen=True)
class Surprise:
    """How far a find was to be expected, given all before it.

    probability: that the next find turns up on this stretch (at sea: within its radius of this
    place, if at sea). tail: that it turns up on a stretch (at a place) at most as probable as this.
    A find with a small tail is odd.
    """

    find: Detection
    probability: float
    tail: float


@dataclass(frozen=True)
class _Said:
    """Sums over the particles of each class and world, of values and of their squares.

    density: of being found as each find was, (finds, 2, classes, W). found: of having been found by
    each of some times, (times, 2, classes, W). each: particles of a class in a world, (classes,).
    """

    density: Real
    found: Real
    each: npt.NDArray[np.int64]


@dataclass(frozen=True)
class _Evidence:
    """The finds' densities by class and world, logs (finds, classes, W); alien: of none of ours,
    (finds,).
    """

    density: Real
    alien: Real
    alike: shrinkage.Likeness
    prior: Real  # (W,) log weights of the worlds before any find, normalised


def posterior(
    fates: Source,
    known: Known,
    latent: Real,
    log_weight: Real,
    member: npt.NDArray[np.int32] | None = None,
) -> Posterior:
    """Return what finds and patrols say about every world.

    latent: (W, k) unknowns of the worlds, any scale. log_weight: (W,) of the worlds before any
    find. member: (W,) of an ensemble of winds and currents; None: there is none. Raises UserError
    when there are more finds than objects.
    """
    said = _said(fates, known, [(known.now, False)])
    evidence = _evidence(fates, known, said, latent, log_weight, member)
    if not known.finds and not known.patrols:
        return _weigh(known, said, evidence, (), 0)
    ours = tuple(k for k, find in enumerate(known.finds) if find.false < 1)
    weighed, alien = _weigh(known, said, evidence, ours, 0), np.zeros(len(known.finds))
    whole = special.logsumexp(evidence.prior + weighed.log_likelihood)
    # Bayes, over the worlds: L without it, times its density as a false one
    for k, find in enumerate(known.finds):
        if np.isfinite(evidence.alien[k]):
            others = _weigh(
                known, said, evidence, tuple(j for j in ours if j != k), 0
            ).log_likelihood
            alien[k] = np.exp(
                min(evidence.alien[k] + special.logsumexp(evidence.prior + others) - whole, 0.0)
            )
        elif find.false >= 1:
            alien[k] = 1.0
    return replace(weighed, alien=alien)


def found(part: Fates, known: Known) -> Real:
    """Return the chance of each of some particles to have been found by now, (n,)."""
    if not known.finds and not known.patrols:
        return np.zeros(part.world.size)
    return exposure.found(exposure.expose(part, known.reporting, known.patrols), known.now)


def usual(fates: Source, known: Known, log_weight: Real) -> Real:
    """Return B of every find that may be false, (finds,): how densely finds of ours lie on average,
    before any; else 0.

    log_weight: (W,) of the worlds before any find. What others leave on the shore does not change
    when worlds are drawn again: it is computed once, from the worlds first drawn.
    """
    if not any(0 < find.false < 1 for find in known.finds):
        return np.zeros(len(known.finds))
    return _usual(fates, known, _prior(fates, log_weight))


def tempered(log_likelihood: Real, least: float, log_weight: Real | float = 0.0) -> float:
    """Return the largest exponent in (0, 1] at which the likelihood leaves `least` effective
    worlds: bisection.

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
    fates: Source,
    known: Known,
    latent: Real,
    log_weight: Real,
    member: npt.NDArray[np.int32] | None = None,
) -> tuple[Surprise, ...]:
    """Return for every find, in order of time, how probable its place was before it.

    What is given then are the finds and patrols before it.
    """
    said = _said(fates, known, [(find.time, True) for find in known.finds])
    evidence = _evidence(fates, known, said, latent, log_weight, member)
    standing: dict[int, Standing] = {}
    before: tuple[int, ...] = ()
    for number in sorted(range(len(known.finds)), key=lambda k: known.finds[k].time):
        standing[number] = _expected(
            fates, known.finds[number].kind, _weigh(known, said, evidence, before, number)
        )
        if known.finds[number].false < 1:
            before = (*before, number)
    ashore = [k for k in standing if not isinstance(known.finds[k].place, AtSea)]
    rates = _ashore(fates, known, [(standing[k], _law(known, known.finds[k])) for k in ashore])
    rate, odds = dict(zip(ashore, rates, strict=True)), dict[int, tuple[float, float]]()
    for k, of_each in standing.items():
        place = known.finds[k].place
        odds[k] = (
            _odds_at_sea(fates, k, place, of_each)
            if isinstance(place, AtSea)
            else _odds(rate[k], place)
        )
    return tuple(Surprise(known.finds[k], *odds[k]) for k in standing)


def _per_class(fates: Source, classes: int) -> npt.NDArray[np.int64]:
    return np.pad(fates.counts, (0, classes - len(fates.counts)))


def _standing(fates: Source, numbers: Numbers, probability: Real) -> Real:
    """Return how many objects each particle of a class stands for on average, (classes,)."""
    return np.asarray(
        probability @ numbers.by_class / np.maximum(_per_class(fates, numbers.shares.size), 1)
    )


def _expected(fates: Source, kind: int | None, weighed: Posterior) -> Standing:
    """Return how many objects of a class, or of all, each particle stands for."""
    each = _standing(fates, weighed.known.numbers, weighed.objects)
    if kind is not None:
        each = np.where(np.arange(each.size) == kind, each, 0.0)
    weight = weighed.weight
    return lambda part: np.asarray(each[part.kind] * weight[part.world])


def _by_world(part: Fates, slot: npt.NDArray[np.int32], value: Real, classes: int) -> Real:
    """Return sums of values and of their squares by class and world, (2, classes, worlds that are
    here).
    """
    cell = part.kind[slot] * part.many + (part.world[slot] - part.here.start)
    sums = [
        np.bincount(cell, values, classes * part.many).astype(float) for values in (value, value**2)
    ]
    return np.reshape(sums, (2, classes, part.many))


def _said(fates: Source, known: Known, times: Sequence[tuple[float, bool]]) -> _Said:
    """Return what the particles say of their worlds.

    times: by which they have been found, and whether without patrols at that very time.
    """
    classes = known.numbers.shares.size
    density, by_then = (
        np.zeros((len(of), 2, classes, fates.worlds)) for of in (known.finds, times)
    )
    for part in fates.parts() if known.finds or known.patrols else ():
        exposed = exposure.expose(part, known.reporting, known.patrols)
        every = np.arange(part.world.size, dtype=np.int32)
        for k in range(len(known.finds)):
            density[k, :, :, part.here] = _by_world(part, *_found_there(known, exposed, k), classes)
        for k, (time, before) in enumerate(times):
            chance = exposure.found(exposed, time, before)
            by_then[k, :, :, part.here] = _by_world(part, every, chance, classes)
    return _Said(density, by_then, _per_class(fates, classes))


def _ashore(fates: Source, known: Known, asked: Sequence[tuple[Standing, Law]]) -> list[Real]:
    """Return how many objects are expected to be found on each stretch, (S,) for each that is
    asked.

    asked: what particles stand for, and the law by which they are found.
    """
    tables: list[list[partials.Partial]] = [[] for _ in asked]
    for part in fates.parts() if asked else ():
        exposed = exposure.expose(part, known.reporting, known.patrols)
        for (standing, (law, segments)), table in zip(asked, tables, strict=True):
            value = np.zeros(exposed.slot.size)
            for s in np.intersect1d(segments, exposed.touched):
                rows, chance = law(exposed, int(s))
                value[rows] = chance
            value = standing(part)[exposed.slot] * value
            sums = part.blocks.partial(
                value, code=exposed.segment, many=known.length.size, slots=exposed.slot
            )
            table.append(sums)
    return [partials.merged(table).total[:, 0] for table in tables]


def _evidence(
    fates: Source,
    known: Known,
    said: _Said,
    latent: Real,
    log_weight: Real,
    member: npt.NDArray[np.int32] | None = None,
) -> _Evidence:
    classes = known.numbers.shares.size
    alike, prior = shrinkage.likeness(latent, member), _prior(fates, log_weight)
    usually = known.usual if known.usual is not None else _usual(fates, known, prior)
    density = np.full((len(known.finds), classes, fates.worlds), -np.inf)
    alien = np.full(len(known.finds), -np.inf)
    for k, find in enumerate(known.finds):
        sums, squares = said.density[k]
        for c in range(classes) if find.kind is None else [find.kind]:
            density[k, c] = np.log(
                shrinkage.rates(sums[c], squares[c], int(said.each[c]), alike, _full(known, find))
            )
        if 0 < find.false < 1:
            alien[k] = special.logit(find.false) + np.log(usually[k])
    return _Evidence(density, alien, alike, prior)


def _found_there(
    known: Known, exposed: Exposure, number: int
) -> tuple[npt.NDArray[np.int32], Real]:
    """Return slots and their densities of being found as a find was."""
    find = known.finds[number]
    if isinstance(find.place, AtSea):
        slot, distance = _around(exposed.fates.adrift[number], find.place)
        area = 2 * np.pi * find.place.radius**2
        return slot, find.place.chance / area * np.exp(-0.5 * (distance / find.place.radius) ** 2)
    rows, value = _law(known, find)[0](exposed, find.place)
    return exposed.slot[rows], value


def _law(known: Known, find: Detection) -> Law:
    """Return the law by which particles are found ashore as in a find."""
    if find.by is not None:
        return partial(exposure.searched, patrol=find.by), known.patrols[find.by].segments
    if find.latest:
        return partial(exposure.reported, until=find.time), range(known.length.size)
    return partial(exposure.public, time=find.time), range(known.length.size)


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
    lon_lat = (
        np.radians(place.lon),
        lat,
        adrift.lon[slot] * sphere.UNIT,
        adrift.lat[slot] * sphere.UNIT,
    )
    distance = sphere.distance(*lon_lat)
    kept = distance <= FAR * place.radius
    return slot[kept], distance[kept]


def _prior(fates: Source, log_weight: Real) -> Real:
    """Return the log weights of the worlds before any find, normalised, (W,)."""
    shares = weights.shares(np.broadcast_to(np.asarray(log_weight, float), fates.worlds))
    return np.asarray(np.log(shares + 1e-300))


def _usual(fates: Source, known: Known, prior: Real) -> Real:
    """Return B of every find that may be false, (finds,), at least 1e-300; 0 of the others."""
    doubtful = {k: find for k, find in enumerate(known.finds) if 0 < find.false < 1}
    density, numbers = np.zeros(len(known.finds)), known.numbers
    if not doubtful:
        return density
    each, weight = _standing(fates, numbers, numbers.objects_prior), np.exp(prior)
    left = 1 - numbers.destroyed_prior @ numbers.destroyed

    def standing(part: Fates) -> Real:
        return np.asarray(each[part.kind] * weight[part.world] * left)

    begun = float(min(part.release.min() for part in fates.parts()))
    patrols = {find.by: _law(known, find) for find in doubtful.values() if find.by is not None}
    all_reported: Law = partial(exposure.reported, until=known.now), range(known.length.size)
    public, *by_patrol = _ashore(
        fates, known, [(standing, law) for law in (all_reported, *patrols.values())]
    )
    expected = dict(zip(patrols, by_patrol, strict=True))
    for k, find in doubtful.items():
        if isinstance(find.place, AtSea):
            density[k] = _dense_at_sea(fates, k, find.place, standing)
        elif find.by is not None:
            places = list(known.patrols[find.by].segments)
            share = known.length[find.place] / known.length[places].sum()
            density[k] = sum(expected[find.by][s] for s in places) * share
        else:
            there = float(known.length[find.place] * known.reporting.rate[find.place])
            lasting = (find.time - begun) if find.latest else 1.0
            density[k] = _dense(known, public) * there * lasting / max(known.now - begun, 1.0)
    return np.where([k in doubtful for k in range(density.size)], np.maximum(density, 1e-300), 0.0)


def _dense(known: Known, expected: Real) -> float:
    """Return how many public finds of ours there are by metre of coast and reporting rate where one
    lies on average.

    It is the mean over the finds expected (S,), not over the coast, of which there is as much as
    the domain happens to hold.
    """
    there = expected > 0
    exposures = (known.length * known.reporting.rate)[there]
    return float((expected[there] ** 2 / exposures).sum() / max(expected.sum(), 1e-300))


def _dense_at_sea(fates: Source, number: int, place: AtSea, standing: Standing) -> float:
    """Return how many of ours are found by square metre of an even ellipse as wide as what is
    adrift.
    """
    lon, lat = np.radians(place.lon), np.radians(place.lat)

    def there(part: Fates) -> tuple[npt.NDArray[np.intp], Real, Real, Real]:
        """Return the slots of what is adrift, what each stands for, and where it is from the place
        [m].
        """
        adrift, each = part.adrift[number], standing(part)
        at = np.flatnonzero((adrift.status == Status.ADRIFT) & (each > 0))
        return (
            at,
            each[at],
            *sphere.offset(lon, lat, adrift.lon[at] * sphere.UNIT, adrift.lat[at] * sphere.UNIT),
        )

    many, sums = 0, []
    for part in fates.parts():
        at, weight, x, y = there(part)
        many += at.size
        sums.append(part.blocks.partial(weight, weight**2, weight * x, weight * y, slots=at))
    if many < 3:
        return 0.0
    total, squares, east, north = partials.merged(sums).total[0]
    sums = []
    for part in fates.parts():
        at, weight, x, y = there(part)
        x, y = x - east / total, y - north / total
        sums.append(
            part.blocks.partial(*(weight * a * b for b in (x, y) for a in (x, y)), slots=at)
        )
    square = partials.merged(sums).total[0].reshape(2, 2)
    spread = square / (total - squares / total) + place.radius**2 * np.eye(2)  # as numpy.cov has it
    return float(place.chance * total / (4 * np.pi * np.sqrt(np.linalg.det(spread))))


def _weigh(
    known: Known, said: _Said, evidence: _Evidence, ours: tuple[int, ...], then: int
) -> Posterior:
    """Return the posterior given some of the finds, and what had been found by one of the times."""
    numbers = known.numbers
    classes, worlds = numbers.shares.size, evidence.prior.size
    mean, square = said.found[then] / np.maximum(said.each, 1)[:, None]
    share = np.empty((worlds, classes))
    for c in range(classes):
        spread = np.maximum(square[c] - mean[c] ** 2, 0)
        share[:, c] = shrinkage.share(mean[c], spread, int(said.each[c]), evidence.alike)
    counted = _counted(evidence, ours, classes, worlds)
    size = np.full((len(counted), worlds), -np.inf)
    objects = np.full((worlds, numbers.objects.size), -np.inf)
    destroyed = np.full((worlds, numbers.destroyed.size), -np.inf)
    for k, (counts, log) in enumerate(counted.items()):
        for own in together(worlds):
            joint = log[own, None, None] + joint_of(numbers, counts, share[own])
            size[k, own] = special.logsumexp(joint, axis=(1, 2))
            objects[own] = np.logaddexp(objects[own], special.logsumexp(joint, axis=2))
            destroyed[own] = np.logaddexp(destroyed[own], special.logsumexp(joint, axis=1))
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
            partials.over_worlds(
                weight[:, None] * np.nan_to_num(np.exp(log - log_likelihood[:, None]))
            )
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
        share,
        np.zeros(len(known.finds)),
    )


def _counted(
    evidence: _Evidence, ours: tuple[int, ...], classes: int, worlds: int
) -> dict[Counts, Real]:
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


def together(worlds: int) -> Iterator[slice]:
    """Yield ranges of worlds: what is summed over their numbers takes up to 8 kB a world."""
    return (slice(first, min(first + TOGETHER, worlds)) for first in range(0, worlds, TOGETHER))


def joint_of(numbers: Numbers, counts: Counts, share: Real) -> Real:
    """Return the log of prior times likelihood of so many finds of each class, without densities.

    Its shape is (W, objects, destroyed). share: probability that an object of a class that was not
    destroyed has been found, (W, classes).
    """
    with np.errstate(divide="ignore"):
        joint = np.log(numbers.objects_prior)[:, None] + np.log(numbers.destroyed_prior)
        left = np.log1p(-numbers.destroyed)
    joint = np.repeat(joint[None], len(share), axis=0)
    for c, found in enumerate(counts):
        total = numbers.by_class[:, c, None]
        lost = total < found
        remain = np.maximum(total - found, 0)
        ways = (
            special.gammaln(total + 1.0)
            - special.gammaln(remain + 1.0)
            + special.xlogy(found, np.exp(left))
        )
        unseen = np.log1p(-np.minimum((1 - numbers.destroyed) * share[:, c, None, None], 1 - 1e-15))
        joint = joint + np.where(lost, -np.inf, ways) + remain * unseen
    return np.asarray(joint)


def remaining(weighed: Posterior) -> Real:
    """Return the mean number of objects (W, classes) of each world that are neither destroyed nor
    found.
    """
    numbers, left = weighed.known.numbers, np.zeros_like(weighed.share)
    destroyed = numbers.destroyed
    for counts, chosen in zip(weighed.counts, weighed.chosen, strict=True):
        for own in together(len(left)):
            joint = joint_of(numbers, counts, weighed.share[own])
            peak = joint.max((1, 2), keepdims=True)
            mass = np.exp(joint - np.where(np.isfinite(peak), peak, 0.0))
            mass *= (chosen[own] / np.maximum(mass.sum((1, 2)), 1e-300))[:, None, None]
            for c, found in enumerate(counts):
                share = np.minimum(weighed.share[own, c, None, None], 1 - 1e-15)
                alive = (1 - destroyed) * (1 - share) / (1 - (1 - destroyed) * share)
                left[own, c] += (
                    mass * np.maximum(numbers.by_class[:, c, None] - found, 0) * alive
                ).sum((1, 2))
    return left


def _odds(rate: Real, place: int) -> tuple[float, float]:
    """Return the probability of a find's stretch, and that of all at most as probable; rate: finds
    expected, (S,).
    """
    if not rate.sum() > 0:
        return 0.0, 0.0
    rate = rate / rate.sum()
    mine = rate[place]
    return float(mine), float(rate[rate <= mine * (1 + 1e-9)].sum())


def _odds_at_sea(
    fates: Source, number: int, place: AtSea, standing: Standing
) -> tuple[float, float]:
    """Return the probability within a radius of a place, and that of particles where it is at most
    as dense.
    """

    def here(part: Fates) -> Real:
        return np.where(part.adrift[number].status == Status.ADRIFT, standing(part), 0.0)

    sums = partials.merged([part.blocks.partial(here(part)) for part in fates.parts()])
    total = float(np.cumsum(sums.sums[:, 0, 0])[-1])
    if not total > 0:
        return 0.0, 0.0
    goal = (np.arange(SAMPLE) + 0.5) / SAMPLE * total  # an even sample, by weight
    lon, lat, of = np.zeros(SAMPLE), np.zeros(SAMPLE), np.full(SAMPLE, np.inf)
    for part in fates.parts():
        running, adrift = part.blocks.running(here(part), sums), part.adrift[number]
        for own, block in zip(part.blocks.spans, part.blocks.number, strict=True):
            at = np.searchsorted(running[own], goal)
            # blocks don't come in the order of the whole run
            first = (at < own.stop - own.start) & (block < of)
            of[first] = block
            lon[first], lat[first] = (
                values[own][at[first]] * sphere.UNIT for values in (adrift.lon, adrift.lat)
            )
    x, y = sphere.offset(np.radians(place.lon), np.radians(place.lat), lon, lat)
    radius = 2 * place.radius**2
    mine = float(np.exp(-(x**2 + y**2) / radius).mean())
    dense = np.array(
        [np.exp(-((x - a) ** 2 + (y - b) ** 2) / radius).mean() for a, b in zip(x, y, strict=True)]
    )
    return min(mine / 2, 1.0), float((dense - 1 / SAMPLE <= mine).mean())
