"""Particles guided toward finds of debris that would leave few of them any weight.

If the position of a find is known to 0.2 nmi and errors of the current have spread debris over 10
nmi, the find fits one particle in thousands. Therefore the unknowns that an object and its debris
share (position of the release, errors of current and wind, bias of the current) are drawn from a
proposal that uses the finds. The weight of each particle is prior over proposal (importance
sampling with a defensive mixture: Hesterberg 1995, doi:10.1080/00401706.1995.10484303). The
posterior is still that of the case.

All shared unknowns are Gaussian: standard normals xi, which move debris by s = H xi [m] at the
times of the finds (drift.evidence.filter.debris.responses). A particle keeps the xi' of its streams
except for their projection on the rows of H: s' = H xi' becomes s, and xi = xi' + H^T S^+ (s - s'),
S = H H^T. With probability PRIOR_SHARE, s is drawn from the prior N(0, S). Otherwise it is drawn
from the distribution of s given the finds, with the model that s moves debris by M (s - s') from
where xi' takes it. That position is computed: before the run, the debris is moved once without a
coast, so that its own leeway, its random walk and the shear of the forcing are included. Where M
errs by more than the find does, another pass moves the debris from the s of the pass before, and
draws s by where it then arrives. All that the proposal density q depends on besides the rest of
xi', such as the s of earlier passes, are auxiliary variables of the proposal. So the weight N(s; 0,
S) / q(s) is exact, however wrong M is, and at most 1 / PRIOR_SHARE. The run itself weights debris
that strands.

Weights are scaled so that each block of particles has its share of the prior. This also accounts
for the part of a prior that is on land, where the weight is 0.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from drift.engine.motion import guided, prior
from drift.engine.motion.clock import Clock
from drift.engine.motion.ensemble_spec import EnsembleSpec
from drift.engine.motion.forcing import Forcing
from drift.engine.motion.scenario import PositionPrior, Scenario
from drift.engine.motion.scene import Scene
from drift.engine.particles import ensemble as record
from drift.engine.particles import life
from drift.engine.particles.ensemble import Ensemble
from drift.engine.particles.status import Status
from drift.evidence.filter.debris import debris
from drift.evidence.filter.debris.proposal import Part, Proposal
from drift.evidence.filter.debris.responses import Responses
from drift.evidence.filter.records import Contact
from geo import sphere
from geo.array import Array
from kernels.maths import noise
from kernels.maths.noise import Purpose
from kernels.runtime import runtime
from kernels.step import advance
from kernels.step import coast as device_coast
from kernels.step import guide as kernel
from kernels.step import prior as draws

PRIOR_SHARE = 0.3  # of the particles, drawn from the prior
GOLDEN = 0.6180339887498949  # deals slots evenly to the parts of the mixture, by their numbers

Flow = Callable[[], Forcing]  # opens the forcing of a run once more; the caller closes it


class Find(NamedTuple):
    """A contact of debris that guides particles."""

    contact: Contact
    time: int  # [s after start]
    lon: float  # [rad] of its mean place
    lat: float
    covariance: Array  # [m2] (2, 2) of its error, east and north


class Fit(NamedTuple):
    """The estimated response of a scenario's debris to s, from a pilot run, for each find."""

    inverse: Array  # (finds, 2, 2) inverse of M
    close: Array  # [m2] (finds, 2, 2) covariance of the finds, in terms of s
    error: Array  # [m2] (finds, 2, 2) the same plus the error of M: R of the proposal
    # [m] (finds, 2) mean offset of debris from the find, less s; for debris that is not adrift then
    mean: Array
    spread: Array  # [m2] (finds, 2, 2) covariance of that offset


Fits = tuple[Fit | None, ...]  # by scenario; None: its particles are not guided


@dataclass(frozen=True, eq=False)
class Guide:
    """The guiding of the particles of a run: the same for all of its shards."""

    finds: tuple[Find, ...]
    responses: Responses
    passes: tuple[Fits, ...]  # one or several: each starts from the positions of the one before

    def spec(self, spec: EnsembleSpec) -> EnsembleSpec:
        """Return the proposal from which guided particles are drawn."""
        return replace(spec, guiding=len(self.finds))

    def scene(self, scene: Scene) -> Scene:
        """Return the scene in which guided particles move."""
        return replace(scene, guided=self.responses.guided, place=scene.place._replace(guided=True))

    @property
    def numbers(self) -> dict[str, Any]:
        """The entry in the summary: the names of the finds, and the share of particles drawn from
        the prior.
        """
        return {"finds": [find.contact.name for find in self.finds], "prior_share": PRIOR_SHARE}

    @property
    def subsets(self) -> list[list[int]]:
        """The finds of each part of the proposal: all, and each alone if any may be false."""
        every = list(range(len(self.finds)))
        doubtful = any(f.contact.belief < 1 or f.contact.false_density > 0 for f in self.finds)
        return [every, *([k] for k in every if doubtful and len(every) > 1)]


class Way(NamedTuple):
    """Positions of debris without a coast at the times of finds, and the s that led there."""

    lon: Array  # int32 binary angle (finds, n)
    lat: Array
    known: Array  # bool (finds, n): whether it was adrift then
    shared: Array  # [m] (n, 2 finds) s of its particles
    apart: Array  # [m] (n, 2 finds) from each find


class Trial(NamedTuple):
    """The arguments of a pilot run."""

    spec: EnsembleSpec
    scene: Scene
    clock: Clock
    flow: Flow


def finds_of(spec: EnsembleSpec, contacts: Sequence[Contact]) -> tuple[Find, ...]:
    """Return the contacts that may guide particles: positions of debris, in order of time."""
    chosen = (c for c in contacts if c.drifter is not None and c.guide and c.kind == "position")
    return tuple(_find(spec, contact) for contact in chosen)


def _find(spec: EnsembleSpec, contact: Contact) -> Find:
    """Return a contact with the mean and covariance over all its fixes."""
    share = np.array([fix.share for fix in contact.fixes])
    lon = np.radians([fix.lon for fix in contact.fixes])
    lat = np.radians([fix.lat for fix in contact.fixes])
    apart = np.stack(sphere.offset(lon[0], lat[0], lon, lat), axis=1)
    mean = share @ apart
    between = (share[:, None] * (apart - mean)).T @ (apart - mean)
    own = _axes_covariance(contact.major, contact.minor, contact.orientation)
    x, y = sphere.destination(lon[0], lat[0], mean[0], mean[1])
    return Find(contact, spec.period.elapsed(contact.time), float(x), float(y), own + between)


def _axes_covariance(major: float, minor: float, orientation: float) -> Array:
    """Return the covariance (east, north) of standard deviations along and across an axis.

    Args:
        major: standard deviation along the axis [m].
        minor: standard deviation across it [m].
        orientation: of the axis, clockwise from north [rad].

    Returns:
        Covariance [m2], shape (2, 2).
    """
    s, c = np.sin(orientation), np.cos(orientation)
    turned = np.array([[s, c], [c, -s]])
    return np.asarray(turned @ np.diag([major**2, minor**2]) @ turned.T)


def place_covariance(scenario: Scenario) -> Array:
    """Return the covariance [m2] (2, 2) of a release that is guided too.

    It is 0 unless the prior is a plain position report.
    """
    own = scenario.prior
    if isinstance(own, PositionPrior) and own.displacement is None:
        return _axes_covariance(own.major, own.minor, own.orientation)
    return np.zeros((2, 2))


def guide_particles(guide: Guide, trial: Trial, ensemble: Ensemble) -> Ensemble:
    """Guide newly drawn particles, in place, and set their importance weights.

    Args:
        guide: the finds, and the response of debris to the shared unknowns.
        trial: what the particles are drawn from, and the forcing and steps of their run.
        ensemble: particles of a run or of a shard of it, as
            `drift.engine.motion.prior.draw_ensemble` returns them.

    Returns:
        The ensemble, with the columns that guide it.
    """
    ensemble = with_columns(guide, ensemble)
    wet = ensemble.lon.to_numpy(), ensemble.lat.to_numpy()
    _free_places(guide, trial, ensemble)
    before = ensemble.log_weight.to_numpy().astype(np.float64)
    for number, fits in enumerate(guide.passes):
        way = debris_way(guide, trial, ensemble, moved=number > 0)
        last = number == len(guide.passes) - 1
        log_weight = before + pull_particles(
            guide, fits, trial.spec, ensemble, way, number=number, last=last
        )
    lon, lat = ensemble.lon.to_numpy(), ensemble.lat.to_numpy()
    coast = trial.scene.place.coast
    if coast is not None:
        dry = ~device_coast.wet(coast, lon, lat)
        log_weight[dry] = -np.inf
        for column, old, new in zip((ensemble.lon, ensemble.lat), wet, (lon, lat), strict=True):
            column.from_numpy(np.where(dry, old, new))
    for span in ensemble.blocks.spans:
        total = np.logaddexp.reduce(log_weight[span])
        if np.isfinite(total):
            log_weight[span] += np.logaddexp.reduce(before[span]) - total
    ensemble.log_weight.from_numpy(log_weight.astype(np.float32))
    return ensemble


def with_columns(guide: Guide, ensemble: Ensemble) -> Ensemble:
    """Return an ensemble with the columns that guide it, set to zero."""
    columns = guided.columns(len(guide.finds))
    return replace(ensemble, own={**ensemble.own, **record.filled(columns, ensemble.n)})


def _free_places(guide: Guide, trial: Trial, ensemble: Ensemble) -> None:
    """Draw guided releases as if there were no land; those on land later get weight 0."""
    if trial.scene.place.coast is None:
        return
    free = prior.draw_ensemble(trial.spec, None, ensemble.layout, still=True).ensemble
    for name in ("lon", "lat"):
        values = ensemble.columns[name].to_numpy().copy()
        drawn = free.columns[name].to_numpy()
        for fit, scenario, (first, last) in zip(
            guide.passes[0], trial.spec.scenarios, ensemble.scenarios, strict=True
        ):
            if fit is not None and place_covariance(scenario).any():
                values[first:last] = drawn[first:last]
        ensemble.columns[name].from_numpy(values)


def debris_way(guide: Guide, trial: Trial, ensemble: Ensemble, *, moved: bool) -> Way:
    """Return the positions of debris at the times of the finds, computed without a coast.

    Args:
        guide: the finds, and the response of debris to the shared unknowns.
        trial: the scene and the steps of the run.
        ensemble: the particles of the objects, which do not move.
        moved: whether they have been guided: s then follows from their columns, else from their
            streams alone.
    """
    place = trial.scene.place._replace(coast=None, beach=advance.Beach(), guided=moved)
    finds, clock = guide.finds, trial.clock
    lon = np.zeros((len(finds), ensemble.n), np.int32)
    lat, known = lon.copy(), np.zeros(lon.shape, bool)
    forcing = trial.flow()
    try:
        scene = replace(
            trial.scene,
            forcing=forcing,
            place=place,
            steering=None,
            guided=guide.responses.guided if moved else None,
        )
        kinds = debris.of_contacts(
            trial.spec, [(f.time, f.contact) for f in finds], scene, ensemble, copied=True
        )
        for low, high, step in clock.steps():
            if step.elapsed >= guide.responses.guided.until:
                break
            forcing.set(low, high)
            end = step.elapsed + step.duration
            for drifter, kind in kinds.items():
                due = [
                    k for k, f in enumerate(finds) if f.contact.drifter == drifter and f.time <= end
                ]
                due = [k for k in due if finds[k].time > step.elapsed]
                if kind.last <= step.elapsed:
                    continue
                begin = kind.scene.advance(kind.ensemble, low, high, step, keep=bool(due))
                for k in due:
                    known[k] = life.read_lives(kind.ensemble).at(finds[k].time) == Status.ADRIFT
                    if finds[k].time == end or begin is None:
                        lon[k], lat[k] = kind.ensemble.lon.to_numpy(), kind.ensemble.lat.to_numpy()
                    else:
                        args = kind.ensemble, begin, None, step, finds[k].time, clock.start
                        lon[k], lat[k] = kind.scene.between(*args)
    finally:
        forcing.close()
    apart = np.empty((ensemble.n, 2 * len(finds)))
    for k, find in enumerate(finds):
        x, y = lon[k] * sphere.UNIT, lat[k] * sphere.UNIT
        apart[:, 2 * k], apart[:, 2 * k + 1] = sphere.offset(find.lon, find.lat, x, y)
    return Way(lon, lat, known, _shared(guide, trial.spec, ensemble, moved), apart)


def _shared(guide: Guide, spec: EnsembleSpec, ensemble: Ensemble, moved: bool) -> Array:
    """Return s of particles from their streams and columns [m], (n, 2 finds).

    moved: whether the particles have been guided.
    """
    answers, many = guide.responses, len(guide.finds)
    rows = answers.rows_of(ensemble.release.to_numpy())
    sums, begins = runtime.empty(2 * many * ensemble.n), runtime.upload(rows)
    table = runtime.upload(answers.guided.responses.ravel())
    key = noise.key(ensemble.seed)
    numbers = runtime.upload(np.array([*answers.guided.numbers, 0], np.int32))
    for slots in ensemble.slots:
        kernel.project(*slots, begins, numbers, answers.rows, many, table, sums, *key)
    total = sums.to_numpy().astype(np.float64).reshape(ensemble.n, many, 2)
    if moved:  # their columns hold all of s except the pulls on the noise of their steps
        pull = np.stack([_pair(ensemble, f"pull_{k}") for k in range(many)], axis=1)
        total += np.einsum("nfg,ngc->nfc", answers.noise[rows], pull)
    for kind, name in enumerate(("current_error", "wind_error")):
        if answers.stds[kind] > 0:
            response = answers.state[:, rows, kind].T / answers.stds[kind]
            total += response[:, :, None] * _pair(ensemble, name)[:, None, :]
    total += answers.lasting[:, rows].T[:, :, None] * _pair(ensemble, "current_bias")[:, None, :]
    for scenario, (first, last) in zip(spec.scenarios, ensemble.scenarios, strict=True):
        own = scenario.prior
        if isinstance(own, PositionPrior) and place_covariance(scenario).any():
            x = ensemble.lon.to_numpy()[first:last] * sphere.UNIT
            y = ensemble.lat.to_numpy()[first:last] * sphere.UNIT
            total[first:last] += np.stack(sphere.offset(own.lon, own.lat, x, y), axis=1)[:, None, :]
    return np.asarray(total.reshape(ensemble.n, 2 * many))


def _pair(ensemble: Ensemble, name: str) -> Array:
    """Return a column of east and north components, float64 (n, 2)."""
    pair = [ensemble.own[f"{name}_{way}"].to_numpy() for way in ("east", "north")]
    return np.stack(pair, axis=1).astype(np.float64)


def pull_particles(
    guide: Guide,
    fits: Fits,
    spec: EnsembleSpec,
    ensemble: Ensemble,
    way: Way,
    *,
    number: int,
    last: bool,
) -> Array:
    """Draw s and write the columns that produce it.

    Args:
        guide: the finds, and the response of debris to the shared unknowns.
        fits: the fitted response of debris, by scenario.
        spec: what the particles are drawn from.
        ensemble: particles, whose columns change.
        way: positions of their debris, and their present s.
        number: of the pass, from 0.
        last: whether s is final: drawn from the prior for PRIOR_SHARE of the particles.

    Returns:
        Log weights, prior over proposal, shape (n,).
    """
    answers, many = guide.responses, len(guide.finds)
    rows = answers.rows_of(ensemble.release.to_numpy())
    late = np.asarray(answers.lasting[:, rows].min(axis=0) <= 0)  # released after a find: unguided
    known = np.asarray(way.known.all(axis=0))
    choice = ((ensemble.places + 0.5) * GOLDEN) % 1.0
    normals = _normals(ensemble, 2 * many, 2 * many * number)
    pull, log_weight = np.zeros((ensemble.n, 2 * many)), np.zeros(ensemble.n)
    place = np.zeros((ensemble.n, 2))
    for scenario, fit, (first, end) in zip(spec.scenarios, fits, ensemble.scenarios, strict=True):
        if fit is None or first == end:
            continue
        release = place_covariance(scenario)
        for row in np.unique(rows[first:end]):
            covariance = answers.covariance(int(row), release)
            for which in (True, False):
                mine = (rows == row) & (known == which) & ~late
                own = first + np.flatnonzero(mine[first:end])
                if not own.size:
                    continue
                y, proposal = _proposal(
                    guide,
                    fit if last else fit._replace(error=fit.close),
                    covariance,
                    way,
                    own,
                    which,
                )
                s, log_weight[own] = proposal.draw(y, choice[own], normals[own], prior=last)
                pull[own] = (s - way.shared[own]) @ proposal.inverse
        place[first:end] = pull[first:end].reshape(-1, many, 2).sum(axis=1) @ release
        _move_release(scenario, ensemble, place, (first, end))
    for k, names in enumerate(guided.pull_names(many)):
        for component, name in enumerate(names):
            total = ensemble.own[name].to_numpy() + pull[:, 2 * k + component]
            ensemble.own[name].from_numpy(total.astype(np.float32))
    _shift_errors(answers, ensemble, rows, pull.reshape(-1, many, 2))
    return log_weight


def _proposal(
    guide: Guide, fit: Fit, covariance: Array, way: Way, own: Array, known: bool
) -> tuple[Array, Proposal]:
    """Return the finds relative to some particles [m] (k, 2 finds), and the proposal from them.

    known: whether the positions of their debris are known.
    """
    many = len(guide.finds)
    seen, error = np.empty((own.size, many, 2)), np.array(fit.error)
    for k in range(many):
        if known:
            apart = way.apart[own, 2 * k : 2 * k + 2]
            seen[:, k] = way.shared[own, 2 * k : 2 * k + 2] - apart @ fit.inverse[k].T
        else:
            seen[:, k] = -fit.mean[k]
            error[k] = error[k] + fit.spread[k]
    parts = []
    for subset in guide.subsets:
        block = np.zeros((2 * len(subset), 2 * len(subset)))
        for at, k in enumerate(subset):
            block[2 * at : 2 * at + 2, 2 * at : 2 * at + 2] = error[k]
        chosen = np.concatenate([[2 * k, 2 * k + 1] for k in subset])
        parts.append(Part(chosen, block))
    return seen.reshape(own.size, 2 * many), Proposal(covariance, parts, PRIOR_SHARE)


def _normals(ensemble: Ensemble, pairs: int, first: int) -> Array:
    """Return standard normals of each particle, (n, 2 pairs), by its number in the run.

    first: number of the first of these pairs.
    """
    found = np.empty((ensemble.n, 2 * pairs))
    east, north = runtime.empty(ensemble.n), runtime.empty(ensemble.n)
    key = noise.key(ensemble.seed, Purpose.GUIDE)
    for number in range(pairs):
        for slots in ensemble.slots:
            draws.draw_error(*slots, east, north, first + number, *key, 1.0)
        found[:, 2 * number], found[:, 2 * number + 1] = east.to_numpy(), north.to_numpy()
    return found


def _move_release(scenario: Scenario, ensemble: Ensemble, by: Array, span: tuple[int, int]) -> None:
    """Move the releases of a scenario's slots by offsets [m] (n, 2).

    The offsets are east and north in the tangent plane of the position report.
    """
    own, (first, last) = scenario.prior, span
    if not isinstance(own, PositionPrior) or not by[first:last].any():
        return
    lon, lat = ensemble.lon.to_numpy().copy(), ensemble.lat.to_numpy().copy()
    x, y = lon[first:last] * sphere.UNIT, lat[first:last] * sphere.UNIT
    east, north = sphere.offset(own.lon, own.lat, x, y)
    x, y = sphere.destination(own.lon, own.lat, east + by[first:last, 0], north + by[first:last, 1])
    lon[first:last], lat[first:last] = (sphere.to_binary(np.degrees(angle)) for angle in (x, y))
    ensemble.lon.from_numpy(lon)
    ensemble.lat.from_numpy(lat)


def _shift_errors(answers: Responses, ensemble: Ensemble, rows: Array, pull: Array) -> None:
    """Add the effect of pulls (n, finds, 2) to the initial errors and biases."""
    shifts = {
        name: std * np.einsum("fn,nfc->nc", answers.state[:, rows, kind], pull)
        for kind, (name, std) in enumerate(
            zip(("current_error", "wind_error"), answers.stds, strict=True)
        )
    }
    bias = answers.bias**2 * np.einsum("fn,nfc->nc", answers.lasting[:, rows], pull)
    for name, by in (shifts | {"current_bias": bias}).items():
        total = _pair(ensemble, name) + by
        for component, way in enumerate(("east", "north")):
            ensemble.own[f"{name}_{way}"].from_numpy(total[:, component].astype(np.float32))
