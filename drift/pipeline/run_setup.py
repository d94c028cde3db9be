"""Set up a run: translate a case into the engine's records, and open environment and scene.

The engine's packages take the records made here and never see a `Case`.
"""

import contextlib
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from drift.case.record import Case
from drift.engine.environment import coastline, domain, environment, hazards, lost
from drift.engine.environment.environment import Common, Environment
from drift.engine.environment.environment_spec import Coast, EnvironmentSpec
from drift.engine.environment.silence import AtEnd
from drift.engine.motion import changes, prior, step_size
from drift.engine.motion.clock import Clock
from drift.engine.motion.ensemble_spec import EnsembleSpec, Release
from drift.engine.motion.errors import buoys as on_scene
from drift.engine.motion.errors.buoys import Buoys
from drift.engine.motion.forcing import Forcing
from drift.engine.motion.models import by_name as models
from drift.engine.motion.period import ClockSpec
from drift.engine.motion.scene import Scene
from drift.engine.motion.spool import SnapshotStore
from drift.engine.motion.step_size import Trial
from drift.engine.particles import ensemble as record
from drift.engine.particles import partials, snapshot, weights
from drift.engine.particles.columns import Columns
from drift.engine.particles.ensemble import Ensemble
from drift.evidence.filter.account import UpdateCallback
from drift.evidence.filter.debris import guide as guides
from drift.evidence.filter.debris import pilot
from drift.evidence.filter.debris.guide import Guide
from drift.evidence.filter.debris.guide import Trial as Lead
from drift.evidence.filter.filter import SearchFilter
from drift.evidence.filter.meeting import Reduction
from drift.evidence.filter.updates import Update
from drift.evidence.posterior.beliefs import Beliefs
from drift.evidence.posterior.source import Particles
from drift.evidence.sensors import in_water, unknown
from drift.pipeline import buoys as buoy_errors_at
from drift.spills.worlds import release, renewal
from drift.spills.worlds import worlds as drawn_worlds
from drift.spills.worlds.worlds import Proposal, Worlds
from geo import notation
from geo.coast import edges as shoreline
from geo.coast.segments import Segments
from geo.coast.shore import Shore
from geo.errors import UserError
from kernels.evidence import jumps
from kernels.maths import noise
from kernels.maths.noise import Purpose
from kernels.runtime import devices, memory, runtime
from kernels.step import advance
from kernels.step import coast as device_coast

# at the peak of a run in one piece of drifting objects: 96 on the device, the rest on the host
BYTES_PER_PARTICLE = 250
ON_CARD, ASIDE = (
    200,
    80,
)  # [bytes] on a graphics card (about 130 measured), and for the two lists that a coast needs
# [bytes] in addition; a search of six sorties was measured at 510 in total
SEARCHED, SORTIE, STEERING, DEBRIS = 250, 12, 200, 150


@dataclass(frozen=True, kw_only=True)
class Setup:
    """The scene, clock and priors of a run, without its particles."""

    spec: EnsembleSpec  # the prior from which the particles are drawn
    dry: tuple[float, ...]  # share of each scenario's prior that is on land
    scene: Scene
    clock: Clock
    trial: Trial | None  # errors by step length, from which step = "auto" chose
    guide: Guide | None = None  # proposal toward the finds of debris; None: no such finds


@dataclass(frozen=True, kw_only=True)
class Start(Setup):
    """The setup of a run with its initial ensemble."""

    ensemble: Ensemble
    worlds: Worlds | None = None  # of a spill


def ensemble_spec(case: Case) -> EnsembleSpec:
    """Return the prior from which the ensemble of a case is drawn."""
    return EnsembleSpec(
        period=case.period,
        scenarios=case.scenarios,
        errors=case.errors,
        particles=case.particles,
        seed=case.seed,
        resampling=case.resampling.method if case.resampling.below > 0 else None,
        debris=tuple(contact.drifter for contact in case.contacts if contact.drifter is not None),
        release=Release(case.spill.release_std, case.spill.windage_bias) if case.spill else None,
        counts=case.counts,
        buoys=(buoy_errors_at.places_of(case), buoy_errors_at.states_of(case)),
    )


def spec_of(case: Case, where: Environment) -> EnsembleSpec:
    """Return the prior of a case, with its hazards and the members of its forcing ensemble."""
    tilted = hazards.with_hazards(
        case.scenarios, where.scenarios, case.direction, len(where.members)
    )
    return replace(ensemble_spec(case), members=where.members, scenarios=tilted)


def environment_spec(case: Case) -> EnvironmentSpec:
    """Return the specification of the environment of a case: forcing, coast and domain."""
    return EnvironmentSpec(case.forcing, case.coast, case.domain, case.max_lost)


def clock_spec(case: Case) -> ClockSpec:
    """Return the step, integration scheme and tolerance of a case."""
    return ClockSpec(case.step, case.scheme, case.tolerance)


def open_for(
    case: Case,
    datasets: Mapping[str, Any] | None = None,
    seen: Callable[[Shore], Shore] | None = None,
    common: Common | None = None,
) -> Environment:
    """Open the environment of a case: forcing, land and coast.

    Args:
        case: the case.
        datasets: the xarray.Datasets that its sources name, by name.
        seen: simplifies the land's polygons; None: full detail.
        common: sources and coast shared with other cases; None: nothing is shared.

    Raises:
        UserError: as `drift.engine.environment.environment.open_for`.
    """
    asked = environment_spec(case)
    held = environment.hold(asked, datasets, case.path.name)
    where = environment.open_for(ensemble_spec(case), asked, held, seen, common)
    if where.coast is not None:
        in_water.check_sonars_in_water(
            case.named_sensors.values(), coastline.land_reader(where.coast, case.coast)
        )
    return where


def prepare(case: Case, where: Environment, shore: device_coast.DeviceCoast | None = None) -> Start:
    """Set up a case's run in one piece; the caller closes `scene.forcing`.

    Args:
        case: the case.
        where: its environment.
        shore: its coast, if already uploaded to the device.

    Raises:
        UserError: a prior lies on land or outside the forcing, the step is too long, or memory does
            not suffice.
    """
    _check_memory(case)
    spec = spec_of(case, where)
    shore = device_coast.upload(where.coast) if where.coast and not shore else shore
    drawn_first = draw_prior_worlds(case, where) if case.spill else None
    if case.spill and drawn_first:
        ensemble = with_buoy_columns(
            case,
            release.draw_release(
                case.spill, drawn_first, case.period, case.errors, shore, case.seed
            ),
        )
        dry: tuple[float, ...] = (0.0,) * len(case.scenarios)
    else:
        drawn = prior.draw_ensemble(spec, shore)
        ensemble, dry = drawn.ensemble, prior.shares_on_land(spec, drawn.tried, shore)
    setup = build_setup(case, where, shore, ensemble, dry)
    with closed_on_failure(setup):
        setup = add_buoys(setup, buoys_of(case, where, setup.clock))
        if drawn_first is None:
            weigh_by_buoys(setup.scene.buoys, ensemble)
        else:
            drawn_first = weigh_worlds_by_buoys(setup.scene.buoys, drawn_first)
        lacks = lost.prior_without_forcing(where.box, ensemble, setup.scene, setup.clock)
        lost.check_prior(spec, where, case.max_lost, setup.scene, lacks)
        setup = replace(setup, guide=guide_of(case, where, setup))
        begun = Start(**vars(setup), ensemble=ensemble, worlds=drawn_first)
        return apply_guide(case, where, begun)


def _lead_of(case: Case, where: Environment, setup: Setup) -> Lead:
    """Return the input of the pilot run that fits the guide."""
    return Lead(
        setup.spec, setup.scene, setup.clock, lambda: Forcing(list(where.scenarios), case.direction)
    )


def guide_of(case: Case, where: Environment, setup: Setup) -> Guide | None:
    """Fit the guide of particles toward finds of debris; None if the case has none that guide."""
    if case.spill or case.resampling.fills or not any(contact.drifter for contact in case.contacts):
        return None
    # The proposal knows nothing of the errors that buoys and reports share, nor of scales.
    if buoy_errors_at.places_of(case) or case.current_error.tailed:
        return None
    return pilot.fit(_lead_of(case, where, setup), case.contacts)


def buoys_of(case: Case, where: Environment, clock: Clock) -> Buoys | None:
    """Return the errors at the buoys and reports of a case, given these; None without any."""
    return buoy_errors_at.condition_on_buoys(case, where, clock)


def add_buoys(setup: Setup, buoys: Buoys | None) -> Setup:
    """Return a setup whose particles share the errors at buoys."""
    return replace(setup, scene=buoy_errors_at.share_with_buoys(setup.scene, buoys))


def weigh_by_buoys(buoys: Buoys | None, ensemble: Ensemble) -> None:
    """Multiply the weights of particles by the likelihood of buoys' tracks in their forcing, in
    place.
    """
    if buoys is None or buoys.given.log_likelihood.size == 1:
        return
    member = ensemble.own["member"].to_numpy() if buoys.members > 1 else None
    more = buoys.log_weights(ensemble.scenario.to_numpy(), member)
    log_weight = ensemble.log_weight.to_numpy()
    ensemble.log_weight.from_numpy((log_weight + more).astype(np.float32))


def weigh_worlds_by_buoys(buoys: Buoys | None, worlds: Worlds) -> Worlds:
    """Return worlds of a spill weighted by the likelihood of buoys' tracks in their forcing."""
    if buoys is None or worlds.member is None:
        return worlds
    more = buoys.log_weights(np.zeros_like(worlds.member), worlds.member)
    return replace(worlds, log_weight=worlds.log_weight + more)


def with_buoy_columns(case: Case, ensemble: Ensemble) -> Ensemble:
    """Return an ensemble with the columns in which it shares the errors at buoys, if any."""
    if not (places := buoy_errors_at.places_of(case)):
        return ensemble
    columns = on_scene.columns(places, buoy_errors_at.states_of(case))
    return replace(ensemble, own={**ensemble.own, **record.filled(columns, ensemble.n)})


def apply_guide(case: Case, where: Environment, begin: Start) -> Start:
    """Return a start whose particles are guided toward the finds of debris, if there is a guide."""
    if begin.guide is None:
        return begin
    ensemble = guides.guide_particles(begin.guide, _lead_of(case, where, begin), begin.ensemble)
    return replace(
        begin,
        spec=begin.guide.spec(begin.spec),
        scene=begin.guide.scene(begin.scene),
        ensemble=ensemble,
    )


def extra_bytes_per_particle(case: Case) -> int:
    """Return the bytes per particle for search, steering and debris, in addition to drifting."""
    debris = len({contact.drifter for contact in case.contacts} - {None})
    steers = any(scenario.itinerary for scenario in case.scenarios)
    searched = SEARCHED + SORTIE * len(case.sorties) if _is_weighted_by_evidence(case) else 0
    return searched + STEERING * steers + DEBRIS * debris + _listening(case) + _of_buoys(case)


def _of_buoys(case: Case) -> int:
    """Return the bytes per particle of the errors at buoys and reports, twice at the peak."""
    if not (places := buoy_errors_at.places_of(case)):
        return 0
    return 8 * (2 * buoy_errors_at.states_of(case) + 2 * places + 6)


def _listening(case: Case) -> int:
    """Return the bytes per particle while most sonars listen at once, with one copy for an
    output."""
    watches = [
        (s, 4 * (1 + 2 * jumps.STAIRS) * len(unknown.values(s.sensor)[0]))
        for s in case.sorties
        if s.sensor is not None
    ]
    at_once = [
        sum(size for s, size in watches if s.start <= one.start < s.end) for one, _ in watches
    ]
    return max(at_once, default=0) + max((size for _, size in watches), default=0)


def _check_memory(case: Case) -> None:
    need, free = (
        case.particles * (BYTES_PER_PARTICLE + extra_bytes_per_particle(case)),
        memory.free(),
    )
    remedy = "take fewer, or leave it to drift run to move them in shards that fit"
    if need > free:
        raise UserError(
            f"{case.path.name}: {case.particles:,} particles in one piece take {notation.format_bytes(need)}, and {notation.format_bytes(free)} "
            f"of memory are free; {remedy}"
        )
    # querying the card takes as long as a small forecast, so only large runs do
    card = runtime.room() if need > devices.LEAST else None
    check_array_size(card, case, case.particles, case.path.name, remedy)


def bytes_on_card(case: Case) -> int:
    """Return the bytes on a graphics card per particle of the piece being moved."""
    # the search object and the classes of debris
    kinds = 1 + len({contact.drifter for contact in case.contacts} - {None})
    return ON_CARD + extra_bytes_per_particle(case) + ASIDE * kinds * (case.coast.source != "none")


def check_array_size(card: int | None, case: Case, particles: int, what: str, remedy: str) -> None:
    """Reject a piece with more particles than one array can index or the graphics card can hold.

    Args:
        card: free memory of the graphics card [bytes]; None: particles are on the processor.
        case: the case of the run.
        particles: number of particles in one piece.
        what: beginning of the message.
        remedy: end of the message.

    Raises:
        UserError: the piece is too large.
    """
    rows = (
        advance.ASIDE if card is not None and case.coast.source != "none" else len(advance.LEEWAY)
    )
    if places := buoy_errors_at.places_of(case):
        rows = max(rows, 2 * (buoy_errors_at.states_of(case) + places))
    # Taichi cannot allocate an array of 2^31 numbers, and int32 cannot index it
    most = (2**31 - 2) // rows
    if particles > most:
        raise UserError(
            f"{what}: {particles:,} particles at once; at most {most:,} can be moved in one piece; {remedy}"
        )
    need = devices.LEAST + particles * bytes_on_card(case)
    if card is not None and need > card:
        raise UserError(
            f"{what}: {particles:,} particles at once take {math.ceil(10 * need / 2**30) / 10:g} GiB of the graphics card, "
            f"of which {card / 2**30:.1f} GiB are free; {remedy}"
        )


def draw_prior_worlds(case: Case, where: Environment) -> Worlds:
    """Return the worlds of a spill, drawn from their prior."""
    assert case.spill is not None
    assert where.coast is not None  # environment.open_for
    return drawn_worlds.draw_worlds(
        case.spill, case.seed, partial(shoreline.is_land, where.coast), members=len(where.members)
    )


def build_setup(
    case: Case,
    where: Environment,
    shore: device_coast.DeviceCoast | None,
    some: Ensemble,
    dry: tuple[float, ...],
) -> Setup:
    """Return the scene and clock of a run; `some` is the ensemble, or a sample, that sets the
    step."""
    scene = scene_of(case, where, shore)
    try:
        anew = [contact.time for contact in case.contacts] if case.resampling.fills else []
        clock, trial = step_size.clock_of(
            case.period,
            clock_spec(case),
            case.errors,
            where.sources,
            some,
            scene,
            anew,
            needs_whole_ensemble(case),
        )
    except BaseException:
        scene.forcing.close()
        raise
    return Setup(spec=spec_of(case, where), dry=dry, scene=scene, clock=clock, trial=trial)


def scene_of(case: Case, where: Environment, shore: device_coast.DeviceCoast | None) -> Scene:
    """Return the scene of a case's run; close its forcing after it. shore: the coast on the device."""
    sinks = case.spill is not None and any(kind.sinking for kind in case.spill.kinds)
    sinks |= any(one.sinks for scenario in case.scenarios for one in scenario.changes)
    changing = changes.any_changes(case.scenarios)
    beach, bias = _beach(case.coast), case.current_error.bias > 0
    place = advance.Surroundings(
        domain.binary(where.box),
        shore,
        beach,
        bias,
        sinks,
        scheme=case.scheme,
        polar=domain.is_polar(where.box),
        changes=tuple(changes.rows(s.changes) for s in case.scenarios) if changing else (),
    )
    steering = models.steering(case.scenarios, case.period, case.errors)
    forcing = Forcing(list(where.scenarios), case.direction)
    return Scene(forcing, models.motions(case.errors, case.scenarios), place, steering)


@contextlib.contextmanager
def closed_on_failure(setup: Setup) -> Iterator[None]:
    """Close the forcing of a run if an exception leaves the context."""
    try:
        yield
    except BaseException:
        setup.scene.forcing.close()
        raise


def stretches(case: Case, where: Environment, drawn: Worlds | None) -> Segments | None:
    """Return the stretches of coast by which a spill's washup is reported; None without a spill.

    Args:
        case: the case of the run.
        where: its environment.
        drawn: the worlds of the spill.

    Raises:
        UserError: finds or patrols are inconsistent with the coast or the period.
    """
    if not (case.spill and where.coast and drawn):
        return None
    return renewal.stretches_of_spill(case.period, case.spill, where.coast, drawn)


def restart_from_proposal(
    case: Case, where: Environment, before: Start, proposal: Proposal, number: int
) -> Start:
    """Return the start of a spill in new worlds drawn from a proposal.

    Args:
        case: the case of the spill.
        where: its environment.
        before: the start of the first round.
        proposal: the distribution of the new worlds.
        number: number of the renewal, from 1.
    """
    assert case.spill is not None
    drawn, seed = renewed(case, where, proposal, number, before.scene.buoys)
    ensemble = with_buoy_columns(
        case,
        release.draw_release(
            case.spill, drawn, case.period, case.errors, before.scene.place.coast, seed
        ),
    )
    again = replace(before.scene, forcing=Forcing(list(where.scenarios), case.direction))
    return replace(before, ensemble=ensemble, scene=again, worlds=drawn)


def renewed(
    case: Case, where: Environment, proposal: Proposal, number: int, buoys: Buoys | None
) -> tuple[Worlds, int]:
    """Return new worlds drawn from a proposal, and the seed of their objects.

    Args:
        case: the case of the spill.
        where: its environment.
        proposal: the distribution of the new worlds.
        number: number of the renewal, from 1.
        buoys: drifting buoys, which tell of the members of a forcing ensemble; None: none.
    """
    assert case.spill is not None
    assert where.coast is not None
    seed = noise.seed_for(case.seed, Purpose.RENEWAL, number)
    drawn = drawn_worlds.draw_worlds(
        case.spill, seed, partial(shoreline.is_land, where.coast), proposal
    )
    return weigh_worlds_by_buoys(buoys, drawn), seed


def beliefs(case: Case, begin: Start) -> Beliefs | None:
    """Return the recorder of the posteriors of non-position variables.

    None without itineraries and observations.
    """
    if not reports_posteriors(case):
        return None
    first = Columns.held(
        begin.ensemble.blocks, {"log_weight": begin.ensemble.log_weight.to_numpy()}
    )
    return Beliefs(begin.spec, first, Particles(begin.spec, begin.ensemble, begin.scene.steering))


def build_search_filter(
    case: Case,
    begin: Start,
    beliefs: Beliefs | None = None,
    noted: UpdateCallback | None = None,
    meeting: Reduction | None = None,
    *,
    resumed: bool = False,
) -> SearchFilter | None:
    """Return the search filter of a case; None if it has no search, observation or sensor line.

    Args:
        case: the case of the run.
        begin: its initial ensemble, scene and clock.
        beliefs: records the posteriors after each update.
        noted: called after each update.
        meeting: the reduction across the shards of the run; None: the run is in one piece.
        resumed: whether the filter goes on from a stored state, see `SearchFilter`.
    """
    if not (_is_weighted_by_evidence(case) or case.sensors.lines):
        return None
    return SearchFilter(
        begin.spec,
        case.sorties,
        case.contacts,
        case.resampling,
        begin.ensemble,
        begin.scene,
        case.sensors,
        combined_update_callback(beliefs, noted),
        (case.plan.begin,) if case.units else (),
        meeting,
        resumed,
    )


def combined_update_callback(
    beliefs: Beliefs | None, noted: UpdateCallback | None
) -> UpdateCallback | None:
    """Return the update callback that records posteriors, then calls `noted`."""
    if beliefs is None:
        return noted

    def note(update: Update, columns: Columns) -> None:
        beliefs.note(update.name, update.kind, update.time, columns.named("after", "log_weight"))
        if noted is not None:
            noted(update, columns)

    return note


def reports_posteriors(case: Case) -> bool:
    """Return whether posteriors of non-position variables are reported for a case."""
    steers = any(scenario.itinerary for scenario in case.scenarios)
    return not case.spill and (steers or _is_weighted_by_evidence(case))


def _is_weighted_by_evidence(case: Case) -> bool:
    """Return whether any search or observation, negative ones included, weights the particles."""
    overdue = any(s.itinerary and s.itinerary.overdue is not None for s in case.scenarios)
    return bool(overdue or case.sorties or case.contacts or case.sensors.telling)


def needs_whole_ensemble(case: Case) -> bool:
    """Return True if any output needs a reduction over the whole ensemble."""
    return (
        _is_weighted_by_evidence(case)
        or bool(case.sensors.lines)
        or reports_posteriors(case)
        or reports_search_status(case)
    )


def reports_search_status(case: Case) -> bool:
    """Return True if search status is broken down by time adrift."""
    return not case.spill and bool(
        case.sorties or any(scenario.survival for scenario in case.scenarios)
    )


def check_end(
    case: Case,
    where: Environment,
    begin: Setup,
    snapshots: SnapshotStore,
    unsearched: Columns | None,
) -> None:
    """Reject a run that lost more probability than the case allows.

    A thorough unsuccessful search shifts weight to the unsearched area; that must not count as lost
    probability, so weights without the sorties are used.

    Args:
        case: the case of the run.
        where: its environment.
        begin: its scene and clock.
        snapshots: its particles at the output times.
        unsearched: the column `unsearched`, log weights as if no sortie had been flown; None: the
            weights of the run.

    Raises:
        UserError: more than `max_lost` left the domain or its forcing.
    """
    unit = weights.normalising_scale(unsearched, "unsearched") if unsearched else None

    def ends() -> Iterator[AtEnd]:
        for part in snapshots.outputs[-1].parts():
            place = part.blocks.places
            if unsearched and unit:
                first = int(place.min())
                own = unsearched.read["unsearched"](first, int(place.max()) + 1)[place - first]
                part = replace(part, probability=unit.shares(own))
            yield AtEnd(part, *snapshots.at_end(("status_since",), place))

    if unsearched is None:
        (sums,) = snapshots.deal(snapshots.outputs[-1:], [snapshot.status_sums])
    else:
        sums = [snapshot.status_sums(end.snapshot) for end in ends()]
    status = partials.merge_partials(sums).total[:, 0]
    lost.check_end(where, case.max_lost, begin.scene, begin.clock, status, ends)


def _beach(coast: Coast) -> advance.Beach:
    """Return the beaching parameters of a coast; the mean residence time is half-life / ln 2."""
    return advance.Beach(coast.half_life / math.log(2), coast.offing, coast.behaviour == "slide")
