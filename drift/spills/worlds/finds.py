"""Likelihood of a spill's finds and patrols for every world, and the posterior of the worlds.

With F of N objects found, L = N! / (N - F)! * product over finds of (1 - d) g * (1 - (1 - d) q)^(N
- F). Here d is the share destroyed at once, g the density with which an object that was not
destroyed is found at the place and time of the find, and q its probability of having been found by
now. L is a product over classes. It is summed over N, over d, over the class of finds where that is
unknown, and over which finds are not from this spill. g and q are estimated from a world's
particles and are noisy: drift.spills.worlds.shrinkage draws them toward those of other worlds.

A find at sea enters by g alone, because nobody knows where else at sea people looked.

A find that is not from this spill with probability p gets the density p / (1 - p) * B, where B is
the mean density of true finds before any find. On the coast, let E_s be the number of finds
expected on stretch s, of length l_s and reporting rate h_s. Their density is E_s / (l_s h_s); its
mean over true finds is sum(E_s^2 / (l_s h_s)) / sum(E_s). B is this mean times l_s h_s of the
find's own stretch, uniform over the time since the first release. So B depends on the coast that
the spill reaches, and not on the domain: coast without any E_s, however long, does not change it.
Finds by a patrol are spread over its stretches in proportion to their length. Finds at sea are
spread over an ellipse as wide as the particles adrift, which gives the same mean for a normal
distribution. Without finds and patrols L is 1: then the absence of reports is no evidence.
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
from drift.spills.worlds.fates import Adrift, Fates, FatesSource
from geo import sphere
from geo.array import Real
from geo.errors import UserError

Counts = tuple[int, ...]  # finds that are from this spill, by class
ObjectsPerParticle = Callable[
    [Fates], Real
]  # number of objects that each particle represents, (n,)
# A function of exposure and stretch: the stretch's rows, and each row's chance of the find; and the
# stretches to which it applies.
FindLaw = tuple[Callable[[Exposure, int], tuple[slice, Real]], Sequence[int]]

FAR = 6.0  # [radii] a particle farther from a find at sea does not count
SAMPLE = 2000  # particles from which the surprise of a find at sea is estimated
TOGETHER = 256  # worlds in one batch of the sum over numbers of objects


@dataclass(frozen=True)
class AtSea:
    """A find's place at sea [deg].

    radius: standard deviation of each component of the position [m]. chance: of being seen there.
    """

    lon: float
    lat: float
    radius: float
    chance: float


@dataclass(frozen=True)
class Detection:
    """An object found.

    kind: number of its class, None: unknown. place: number of its stretch, or a place at sea. time
    [s after start]; latest: found at an unknown time not later than that. by: number of the patrol,
    None: the public. false: probability that it is not from this spill.
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
    """Prior of the number of objects and of the share destroyed, and the shares of classes."""

    objects: npt.NDArray[np.int64]  # (m,)
    objects_prior: Real
    shares: Real  # (classes,) of the objects, sum 1
    destroyed: Real  # (k,)
    destroyed_prior: Real

    @property
    def by_class(self) -> npt.NDArray[np.int64]:
        """Objects of every class, (m, classes): integers that add up, by the largest remainders."""
        exact = self.objects[:, None] * self.shares
        whole = np.floor(exact + 1e-9).astype(np.int64)
        rank = np.argsort(np.argsort(whole - exact, axis=1, kind="stable"), axis=1, kind="stable")
        return np.asarray(whole + (rank < (self.objects - whole.sum(1))[:, None]))


@dataclass(frozen=True)
class SpillEvidence:
    """The evidence on a spill up to `now` [s after start]."""

    numbers: Numbers
    finds: tuple[Detection, ...]
    patrols: tuple[Walk, ...]
    reporting: Reporting
    length: Real  # (S,) of the stretches [m]
    now: float
    usual: Real | None = None  # (finds,) B of each; None: computed from the worlds, see usual()


@dataclass(frozen=True)
class Posterior:
    """Posterior weights of the worlds, and the posterior of their numbers of objects.

    log_likelihood, weight: (W,). effective: effective sample size of the worlds. objects,
    destroyed: posteriors of the numbers' grids. counts: possible numbers of finds from this spill,
    by class; chosen: their probabilities, (len(counts), W). share: probability of having been
    found, by world and class, (W, classes), drawn toward that of other worlds. unrelated: posterior
    probability that each find is not from this spill, (finds,).
    """

    known: SpillEvidence
    log_likelihood: Real
    weight: Real
    effective: float
    objects: Real
    destroyed: Real
    counts: tuple[Counts, ...]
    chosen: Real
    share: Real
    unrelated: Real


@dataclass(frozen=True)
class Surprise:
    """How probable a find was, given all evidence before it.

    probability: that the next find is on this stretch; at sea, that it is within its radius of this
    place, if it is at sea. tail: that it is on a stretch (at a place) at most as probable as this
    one. A find with a small tail is odd.
    """

    find: Detection
    probability: float
    tail: float


@dataclass(frozen=True)
class _WorldSums:
    """Sums over the particles of each class and world, of values and of their squares.

    density: density of being found as each find was, (finds, 2, classes, W). found: probability of
    having been found by each of some times, (times, 2, classes, W). each: particles of a class in a
    world, (classes,).
    """

    density: Real
    found: Real
    each: npt.NDArray[np.int64]


@dataclass(frozen=True)
class _Evidence:
    """Log densities of the finds by class and world, (finds, classes, W).

    unrelated: log density of each find if it is not from this spill, (finds,).
    """

    density: Real
    unrelated: Real
    similarity: shrinkage.WorldSimilarity
    prior: Real  # (W,) log weights of the worlds before any find, normalised


def posterior(
    fates: FatesSource,
    known: SpillEvidence,
    latent: Real,
    log_weight: Real,
    member: npt.NDArray[np.int32] | None = None,
) -> Posterior:
    """Return the posterior of the worlds given all finds and patrols.

    Args:
        fates: fates of all particles.
        known: the finds, the patrols and the prior of the numbers of objects.
        latent: unknowns of the worlds on any scale, (W, k).
        log_weight: log weights of the worlds before any find, (W,).
        member: members of an ensemble of winds and currents, (W,); None: no ensemble.

    Returns:
        Weights of the worlds, and the posterior of their numbers of objects.

    Raises:
        UserError: there are more finds than objects.
    """
    world_sums = _sums_by_world(fates, known, [(known.now, False)])
    evidence = _evidence(fates, known, world_sums, latent, log_weight, member)
    if not known.finds and not known.patrols:
        return _posterior_given(known, world_sums, evidence, (), 0)
    possible = tuple(k for k, find in enumerate(known.finds) if find.false < 1)
    weighed, unrelated = (
        _posterior_given(known, world_sums, evidence, possible, 0),
        np.zeros(len(known.finds)),
    )
    log_evidence = special.logsumexp(evidence.prior + weighed.log_likelihood)
    # Bayes over the worlds: the likelihood without the find, times its density as a false find
    for k, find in enumerate(known.finds):
        if np.isfinite(evidence.unrelated[k]):
            without_find = _posterior_given(
                known, world_sums, evidence, tuple(j for j in possible if j != k), 0
            ).log_likelihood
            unrelated[k] = np.exp(
                min(
                    evidence.unrelated[k]
                    + special.logsumexp(evidence.prior + without_find)
                    - log_evidence,
                    0.0,
                )
            )
        elif find.false >= 1:
            unrelated[k] = 1.0
    return replace(weighed, unrelated=unrelated)


def found(part: Fates, known: SpillEvidence) -> Real:
    """Return the probability of each of some particles of having been found by now, (n,)."""
    if not known.finds and not known.patrols:
        return np.zeros(part.world.size)
    return exposure.found_probability(
        exposure.expose(part, known.reporting, known.patrols), known.now
    )


def usual(fates: FatesSource, known: SpillEvidence, log_weight: Real) -> Real:
    """Return B of each find that may be false: the prior mean density of true finds.

    Finds of other origin do not change when worlds are drawn again, so B is computed once, from the
    worlds of the first round.

    Args:
        fates: fates of all particles.
        known: finds and patrols.
        log_weight: log weights of the worlds before any find, (W,).

    Returns:
        B of each find, (finds,); 0 for finds that cannot be false.
    """
    if not any(0 < find.false < 1 for find in known.finds):
        return np.zeros(len(known.finds))
    return _mean_densities(fates, known, _log_prior(fates, log_weight))


def tempering_exponent(log_likelihood: Real, least: float, log_weight: Real | float = 0.0) -> float:
    """Return the largest exponent in (0, 1] that leaves `least` effective worlds, by bisection.

    Args:
        log_likelihood: of the worlds, (W,).
        least: effective number of worlds to keep.
        log_weight: log weights of the worlds before the finds, (W,).

    Returns:
        The exponent of the likelihood; tiny if the worlds had fewer effective ones before.
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
    fates: FatesSource,
    known: SpillEvidence,
    latent: Real,
    log_weight: Real,
    member: npt.NDArray[np.int32] | None = None,
) -> tuple[Surprise, ...]:
    """Return how probable the place of each find was given the evidence before it, by time.

    Arguments are as for `posterior`.
    """
    world_sums = _sums_by_world(fates, known, [(find.time, True) for find in known.finds])
    evidence = _evidence(fates, known, world_sums, latent, log_weight, member)
    multiplicity: dict[int, ObjectsPerParticle] = {}
    earlier: tuple[int, ...] = ()
    for number in sorted(range(len(known.finds)), key=lambda k: known.finds[k].time):
        multiplicity[number] = _posterior_multiplicity(
            fates,
            known.finds[number].kind,
            _posterior_given(known, world_sums, evidence, earlier, number),
        )
        if known.finds[number].false < 1:
            earlier = (*earlier, number)
    ashore = [k for k in multiplicity if not isinstance(known.finds[k].place, AtSea)]
    rates = _expected_by_stretch(
        fates, known, [(multiplicity[k], _find_law(known, known.finds[k])) for k in ashore]
    )
    rate, odds = dict(zip(ashore, rates, strict=True)), dict[int, tuple[float, float]]()
    for k, multiplicity_of_particles in multiplicity.items():
        place = known.finds[k].place
        odds[k] = (
            _surprise_at_sea(fates, k, place, multiplicity_of_particles)
            if isinstance(place, AtSea)
            else _surprise_ashore(rate[k], place)
        )
    return tuple(Surprise(known.finds[k], *odds[k]) for k in multiplicity)


def _particles_per_class(fates: FatesSource, classes: int) -> npt.NDArray[np.int64]:
    return np.pad(fates.counts, (0, classes - len(fates.counts)))


def _mean_multiplicity(fates: FatesSource, numbers: Numbers, probability: Real) -> Real:
    """Return the mean number of objects that a particle of each class represents, (classes,)."""
    return np.asarray(
        probability
        @ numbers.by_class
        / np.maximum(_particles_per_class(fates, numbers.shares.size), 1)
    )


def _posterior_multiplicity(
    fates: FatesSource, kind: int | None, weighed: Posterior
) -> ObjectsPerParticle:
    """Return the expected number of objects (of a class or all) that each particle represents."""
    each = _mean_multiplicity(fates, weighed.known.numbers, weighed.objects)
    if kind is not None:
        each = np.where(np.arange(each.size) == kind, each, 0.0)
    weight = weighed.weight
    return lambda part: np.asarray(each[part.kind] * weight[part.world])


def _by_world(part: Fates, slot: npt.NDArray[np.int32], value: Real, classes: int) -> Real:
    """Return sums of values and of their squares, (2, classes, worlds of the part)."""
    cell = part.kind[slot] * part.many + (part.world[slot] - part.here.start)
    sums = [
        np.bincount(cell, values, classes * part.many).astype(float) for values in (value, value**2)
    ]
    return np.reshape(sums, (2, classes, part.many))


def _sums_by_world(
    fates: FatesSource, known: SpillEvidence, times: Sequence[tuple[float, bool]]
) -> _WorldSums:
    """Return the sums over particles that the likelihood of each world needs.

    times: by which particles have been found, and whether patrols at that very time are left out.
    """
    classes = known.numbers.shares.size
    density, by_then = (
        np.zeros((len(of), 2, classes, fates.worlds)) for of in (known.finds, times)
    )
    for part in fates.parts() if known.finds or known.patrols else ():
        exposed = exposure.expose(part, known.reporting, known.patrols)
        every = np.arange(part.world.size, dtype=np.int32)
        for k in range(len(known.finds)):
            density[k, :, :, part.here] = _by_world(
                part, *_find_densities(known, exposed, k), classes
            )
        for k, (time, before) in enumerate(times):
            chance = exposure.found_probability(exposed, time, before)
            by_then[k, :, :, part.here] = _by_world(part, every, chance, classes)
    return _WorldSums(density, by_then, _particles_per_class(fates, classes))


def _expected_by_stretch(
    fates: FatesSource, known: SpillEvidence, requests: Sequence[tuple[ObjectsPerParticle, FindLaw]]
) -> list[Real]:
    """Return the expected number of finds on each stretch, (S,), for each request.

    A request is the number of objects that each particle represents, and the law by which it is
    found.
    """
    tables: list[list[partials.Partial]] = [[] for _ in requests]
    for part in fates.parts() if requests else ():
        exposed = exposure.expose(part, known.reporting, known.patrols)
        for (multiplicity, (law, segments)), table in zip(requests, tables, strict=True):
            value = np.zeros(exposed.slot.size)
            for s in np.intersect1d(segments, exposed.touched):
                rows, chance = law(exposed, int(s))
                value[rows] = chance
            value = multiplicity(part)[exposed.slot] * value
            sums = part.blocks.partial(
                value, code=exposed.segment, many=known.length.size, slots=exposed.slot
            )
            table.append(sums)
    return [partials.merge_partials(table).total[:, 0] for table in tables]


def _evidence(
    fates: FatesSource,
    known: SpillEvidence,
    world_sums: _WorldSums,
    latent: Real,
    log_weight: Real,
    member: npt.NDArray[np.int32] | None = None,
) -> _Evidence:
    classes = known.numbers.shares.size
    similarity, prior = shrinkage.world_similarity(latent, member), _log_prior(fates, log_weight)
    mean_density = known.usual if known.usual is not None else _mean_densities(fates, known, prior)
    density = np.full((len(known.finds), classes, fates.worlds), -np.inf)
    unrelated = np.full(len(known.finds), -np.inf)
    for k, find in enumerate(known.finds):
        sums, squares = world_sums.density[k]
        for c in range(classes) if find.kind is None else [find.kind]:
            density[k, c] = np.log(
                shrinkage.shrink_means(
                    sums[c],
                    squares[c],
                    int(world_sums.each[c]),
                    similarity,
                    _largest_density(known, find),
                )
            )
        if 0 < find.false < 1:
            unrelated[k] = special.logit(find.false) + np.log(mean_density[k])
    return _Evidence(density, unrelated, similarity, prior)


def _find_densities(
    known: SpillEvidence, exposed: Exposure, number: int
) -> tuple[npt.NDArray[np.int32], Real]:
    """Return slots, and their densities of being found in the way of a find."""
    find = known.finds[number]
    if isinstance(find.place, AtSea):
        slot, distance = _near(exposed.fates.adrift[number], find.place)
        area = 2 * np.pi * find.place.radius**2
        return slot, find.place.chance / area * np.exp(-0.5 * (distance / find.place.radius) ** 2)
    rows, value = _find_law(known, find)[0](exposed, find.place)
    return exposed.slot[rows], value


def _find_law(known: SpillEvidence, find: Detection) -> FindLaw:
    """Return the law by which particles ashore are found in the way of a find."""
    if find.by is not None:
        return partial(exposure.patrol_probability, patrol=find.by), known.patrols[find.by].segments
    if find.latest:
        return partial(exposure.reported_probability, until=find.time), range(known.length.size)
    return partial(exposure.report_density, time=find.time), range(known.length.size)


def _largest_density(known: SpillEvidence, find: Detection) -> float:
    """Return the density of a find for an object that is at its place and time with certainty."""
    if isinstance(find.place, AtSea):
        return find.place.chance / (2 * np.pi * find.place.radius**2)
    if find.by is not None:
        return known.patrols[find.by].detection
    return 1.0 if find.latest else max(float(known.reporting.rate[find.place]), 1e-300)


def _near(adrift: Adrift, place: AtSea) -> tuple[npt.NDArray[np.int32], Real]:
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
    inside = distance <= FAR * place.radius
    return slot[inside], distance[inside]


def _log_prior(fates: FatesSource, log_weight: Real) -> Real:
    """Return the normalised log weights of the worlds before any find, (W,)."""
    shares = weights.shares(np.broadcast_to(np.asarray(log_weight, float), fates.worlds))
    return np.asarray(np.log(shares + 1e-300))


def _mean_densities(fates: FatesSource, known: SpillEvidence, prior: Real) -> Real:
    """Return B of each find that may be false, (finds,), at least 1e-300; 0 for other finds."""
    doubtful = {k: find for k, find in enumerate(known.finds) if 0 < find.false < 1}
    density, numbers = np.zeros(len(known.finds)), known.numbers
    if not doubtful:
        return density
    each, weight = _mean_multiplicity(fates, numbers, numbers.objects_prior), np.exp(prior)
    surviving = 1 - numbers.destroyed_prior @ numbers.destroyed

    def multiplicity(part: Fates) -> Real:
        return np.asarray(each[part.kind] * weight[part.world] * surviving)

    first_release = float(min(part.release.min() for part in fates.parts()))
    patrols = {find.by: _find_law(known, find) for find in doubtful.values() if find.by is not None}
    all_reported: FindLaw = (
        partial(exposure.reported_probability, until=known.now),
        range(known.length.size),
    )
    public, *by_patrol = _expected_by_stretch(
        fates, known, [(multiplicity, law) for law in (all_reported, *patrols.values())]
    )
    expected = dict(zip(patrols, by_patrol, strict=True))
    for k, find in doubtful.items():
        if isinstance(find.place, AtSea):
            density[k] = _density_at_sea(fates, k, find.place, multiplicity)
        elif find.by is not None:
            places = list(known.patrols[find.by].segments)
            share = known.length[find.place] / known.length[places].sum()
            density[k] = sum(expected[find.by][s] for s in places) * share
        else:
            there = float(known.length[find.place] * known.reporting.rate[find.place])
            lasting = (find.time - first_release) if find.latest else 1.0
            density[k] = (
                _density_ashore(known, public)
                * there
                * lasting
                / max(known.now - first_release, 1.0)
            )
    return np.where([k in doubtful for k in range(density.size)], np.maximum(density, 1e-300), 0.0)


def _density_ashore(known: SpillEvidence, expected: Real) -> float:
    """Return the mean density of public finds by metre of coast and reporting rate.

    The mean is over the expected finds (S,), not over the coast, whose length depends on the
    domain.
    """
    there = expected > 0
    exposures = (known.length * known.reporting.rate)[there]
    return float((expected[there] ** 2 / exposures).sum() / max(expected.sum(), 1e-300))


def _density_at_sea(
    fates: FatesSource, number: int, place: AtSea, multiplicity: ObjectsPerParticle
) -> float:
    """Return the density of finds [1/m2] in a uniform ellipse as wide as the particles adrift."""
    lon, lat = np.radians(place.lon), np.radians(place.lat)

    def adrift_near(part: Fates) -> tuple[npt.NDArray[np.intp], Real, Real, Real]:
        """Return slots adrift, the objects each represents, and their offset from the place [m]."""
        adrift, each = part.adrift[number], multiplicity(part)
        at = np.flatnonzero((adrift.status == Status.ADRIFT) & (each > 0))
        return (
            at,
            each[at],
            *sphere.offset(lon, lat, adrift.lon[at] * sphere.UNIT, adrift.lat[at] * sphere.UNIT),
        )

    many, sums = 0, []
    for part in fates.parts():
        at, weight, x, y = adrift_near(part)
        many += at.size
        sums.append(part.blocks.partial(weight, weight**2, weight * x, weight * y, slots=at))
    if many < 3:
        return 0.0
    total, squares, east, north = partials.merge_partials(sums).total[0]
    sums = []
    for part in fates.parts():
        at, weight, x, y = adrift_near(part)
        x, y = x - east / total, y - north / total
        sums.append(
            part.blocks.partial(*(weight * a * b for b in (x, y) for a in (x, y)), slots=at)
        )
    square = partials.merge_partials(sums).total[0].reshape(2, 2)
    spread = square / (total - squares / total) + place.radius**2 * np.eye(2)  # as numpy.cov has it
    return float(place.chance * total / (4 * np.pi * np.sqrt(np.linalg.det(spread))))


def _posterior_given(
    known: SpillEvidence,
    world_sums: _WorldSums,
    evidence: _Evidence,
    ours: tuple[int, ...],
    time_index: int,
) -> Posterior:
    """Return the posterior given some of the finds, and the chances of being found by a time.

    ours: numbers of the finds; time_index: index of the time.
    """
    numbers = known.numbers
    classes, worlds = numbers.shares.size, evidence.prior.size
    mean, square = world_sums.found[time_index] / np.maximum(world_sums.each, 1)[:, None]
    share = np.empty((worlds, classes))
    for c in range(classes):
        spread = np.maximum(square[c] - mean[c] ** 2, 0)
        share[:, c] = shrinkage.shrink_shares(
            mean[c], spread, int(world_sums.each[c]), evidence.similarity
        )
    counted = _log_density_by_counts(evidence, ours, classes, worlds)
    size = np.full((len(counted), worlds), -np.inf)
    objects = np.full((worlds, numbers.objects.size), -np.inf)
    destroyed = np.full((worlds, numbers.destroyed.size), -np.inf)
    for k, (counts, log) in enumerate(counted.items()):
        for batch in world_ranges(worlds):
            joint = log[batch, None, None] + log_joint_of_numbers(numbers, counts, share[batch])
            size[k, batch] = special.logsumexp(joint, axis=(1, 2))
            objects[batch] = np.logaddexp(objects[batch], special.logsumexp(joint, axis=2))
            destroyed[batch] = np.logaddexp(destroyed[batch], special.logsumexp(joint, axis=1))
    log_likelihood = special.logsumexp(size, axis=0)
    if not np.isfinite(log_likelihood).any():
        fewest = min(sum(counts) for counts in counted)
        raise UserError(
            f"{fewest} objects were found, but fewer of their classes were spilled "
            f"({numbers.objects.max()} in all); raise [spill] objects, or give finds a "
            "probability of being false"
        )
    weight = weights.shares(log_likelihood + evidence.prior)
    with np.errstate(invalid="ignore"):
        chosen = np.nan_to_num(np.exp(size - log_likelihood), nan=0.0)
        objects, destroyed = (
            partials.sum_over_worlds(
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


def _log_density_by_counts(
    evidence: _Evidence, ours: tuple[int, ...], classes: int, worlds: int
) -> dict[Counts, Real]:
    """Return the log density of the finds for each number of true finds by class, (W,) each.

    The densities are summed over all assignments of finds to classes, or to other origins.
    """
    by_counts: dict[Counts, Real] = {(0,) * classes: np.zeros(worlds)}
    for k in ours:
        ahead: dict[Counts, Real] = {}

        def add(counts: Counts, log: Real, ahead: dict[Counts, Real] = ahead) -> None:
            ahead[counts] = np.logaddexp(ahead[counts], log) if counts in ahead else log

        for counts, log in by_counts.items():
            for c in np.flatnonzero(np.isfinite(evidence.density[k]).any(axis=1)):
                more = (*counts[:c], counts[c] + 1, *counts[c + 1 :])
                add(more, log + evidence.density[k, c])
            if np.isfinite(evidence.unrelated[k]):
                add(counts, log + evidence.unrelated[k])
        by_counts = ahead
    return by_counts


def world_ranges(worlds: int) -> Iterator[slice]:
    """Yield ranges of worlds in batches: the sum over their numbers takes up to 8 kB a world."""
    return (slice(first, min(first + TOGETHER, worlds)) for first in range(0, worlds, TOGETHER))


def log_joint_of_numbers(numbers: Numbers, counts: Counts, share: Real) -> Real:
    """Return the log of prior times likelihood of the numbers of finds by class, without densities.

    Args:
        numbers: prior of the numbers of objects.
        counts: number of true finds by class.
        share: probability that an object of a class that was not destroyed has been found, (W,
            classes).

    Returns:
        Logs, (W, objects, destroyed).
    """
    with np.errstate(divide="ignore"):
        joint = np.log(numbers.objects_prior)[:, None] + np.log(numbers.destroyed_prior)
        left = np.log1p(-numbers.destroyed)
    joint = np.repeat(joint[None], len(share), axis=0)
    for c, found in enumerate(counts):
        total = numbers.by_class[:, c, None]
        impossible = total < found
        remain = np.maximum(total - found, 0)
        log_ways = (
            special.gammaln(total + 1.0)
            - special.gammaln(remain + 1.0)
            + special.xlogy(found, np.exp(left))
        )
        unseen = np.log1p(-np.minimum((1 - numbers.destroyed) * share[:, c, None, None], 1 - 1e-15))
        joint = joint + np.where(impossible, -np.inf, log_ways) + remain * unseen
    return np.asarray(joint)


def remaining_objects(weighed: Posterior) -> Real:
    """Return the mean number of objects of each world neither destroyed nor found, (W, classes)."""
    numbers, left = weighed.known.numbers, np.zeros_like(weighed.share)
    destroyed = numbers.destroyed
    for counts, chosen in zip(weighed.counts, weighed.chosen, strict=True):
        for batch in world_ranges(len(left)):
            joint = log_joint_of_numbers(numbers, counts, weighed.share[batch])
            peak = joint.max((1, 2), keepdims=True)
            mass = np.exp(joint - np.where(np.isfinite(peak), peak, 0.0))
            mass *= (chosen[batch] / np.maximum(mass.sum((1, 2)), 1e-300))[:, None, None]
            for c, found in enumerate(counts):
                share = np.minimum(weighed.share[batch, c, None, None], 1 - 1e-15)
                alive = (1 - destroyed) * (1 - share) / (1 - (1 - destroyed) * share)
                left[batch, c] += (
                    mass * np.maximum(numbers.by_class[:, c, None] - found, 0) * alive
                ).sum((1, 2))
    return left


def _surprise_ashore(rate: Real, place: int) -> tuple[float, float]:
    """Return the probability of a find's stretch, and that of all stretches at most as probable.

    rate: expected finds, (S,).
    """
    if not rate.sum() > 0:
        return 0.0, 0.0
    rate = rate / rate.sum()
    own = rate[place]
    return float(own), float(rate[rate <= own * (1 + 1e-9)].sum())


def _surprise_at_sea(
    fates: FatesSource, number: int, place: AtSea, multiplicity: ObjectsPerParticle
) -> tuple[float, float]:
    """Return the probability of a place at sea, and that of all places at most as probable.

    The first is the probability within the find's radius of the place.
    """

    def adrift_weight(part: Fates) -> Real:
        return np.where(part.adrift[number].status == Status.ADRIFT, multiplicity(part), 0.0)

    sums = partials.merge_partials(
        [part.blocks.partial(adrift_weight(part)) for part in fates.parts()]
    )
    total = float(np.cumsum(sums.sums[:, 0, 0])[-1])
    if not total > 0:
        return 0.0, 0.0
    goal = (np.arange(SAMPLE) + 0.5) / SAMPLE * total  # a systematic sample by weight
    lon, lat, block_of = np.zeros(SAMPLE), np.zeros(SAMPLE), np.full(SAMPLE, np.inf)
    for part in fates.parts():
        running, adrift = part.blocks.running(adrift_weight(part), sums), part.adrift[number]
        for own, block in zip(part.blocks.spans, part.blocks.number, strict=True):
            at = np.searchsorted(running[own], goal)
            # parts do not hold the blocks in the order of the whole run
            first = (at < own.stop - own.start) & (block < block_of)
            block_of[first] = block
            lon[first], lat[first] = (
                values[own][at[first]] * sphere.UNIT for values in (adrift.lon, adrift.lat)
            )
    x, y = sphere.offset(np.radians(place.lon), np.radians(place.lat), lon, lat)
    radius = 2 * place.radius**2
    here = float(np.exp(-(x**2 + y**2) / radius).mean())
    dense = np.array(
        [np.exp(-((x - a) ** 2 + (y - b) ** 2) / radius).mean() for a, b in zip(x, y, strict=True)]
    )
    return min(here / 2, 1.0), float((dense - 1 / SAMPLE <= here).mean())
