"""The sources of a forecast's spread, and a case in which some of them are switched off.

A source that is off has one value for all particles: its mean, or the likeliest one. The random
numbers of the others stay the same.
"""

import math
from collections.abc import Callable, Collection
from dataclasses import dataclass, replace

import numpy as np

from drift.case.record import Case
from drift.engine.environment.environment import Environment
from drift.engine.motion.errors.forcing_error import ForcingError
from drift.engine.motion.models.own_motion import OwnMotion
from drift.engine.motion.objects.leeway import Drifter, Line
from drift.engine.motion.scenario import PositionPrior, Scenario
from drift.engine.particles.ensemble import Ensemble
from drift.engine.particles.members import COLUMN as MEMBER
from geo import sphere
from geo.array import Array
from geo.errors import UserError


@dataclass(frozen=True)
class Source:
    """A source of spread."""

    key: str
    name: str
    off: str  # the meaning of "off"
    advice: str  # how to reduce it


SOURCES = (
    Source(
        "scenarios",
        "scenarios",
        "all particles are in the scenario with the highest prior probability",
        "find out which scenario is true: ask for witnesses, calls and plans",
    ),
    Source(
        "members",
        "members of the ensemble",
        "all particles drift in the first member",
        "find out which member fits the wind and current on scene, for instance with a buoy",
    ),
    Source(
        "start",
        "start",
        "all particles of a scenario start at one place and time, in the middle of its prior",
        "ask for the position and its time again",
    ),
    Source(
        "current",
        "current error",
        "the current is exactly that of the forcing",
        "drop a buoy on scene, or get a better current",
    ),
    Source(
        "wind",
        "wind error",
        "the wind is exactly that of the forcing",
        "get the wind on scene, and add it to the case as a [[report]]",
    ),
    Source(
        "leeway",
        "leeway",
        "each object has the mean leeway of its class",
        "ask what exactly is adrift, and narrow the class of the object",
    ),
    Source(
        "changes",
        "changes of state",
        "the object stays in the state in which it went adrift",
        "find out in which state it drifts: afloat, swamped or capsized",
    ),
    Source(
        "side",
        "side of the wind",
        "the object drifts midway between the right and the left of the wind, and does not jibe",
        "ask how it lies to the wind; if that is unknown, search on both sides",
    ),
    Source(
        "diffusion",
        "diffusion",
        "there is no random walk",
        "it can't be reduced: search early",
    ),
)


def check_case(case: Case) -> None:
    """Raise UserError unless all objects of a case only drift, and are no spill."""
    name = f"{case.path.name}: drift budget"
    if case.spill:
        raise UserError(
            f"{name}: is for search objects, and this case has a [spill]; see unknowns.csv of drift run"
        )
    for scenario in case.scenarios:
        if scenario.itinerary is not None:
            raise UserError(
                f'{name}: scenario "{scenario.name}" steers; all scenarios must be adrift from '
                "the start: remove the phases, or the scenario"
            )
        if scenario.model != "drift" or isinstance(scenario.motion, OwnMotion):
            raise UserError(
                f'{name}: scenario "{scenario.name}" has a motion of its own, whose spread is '
                'unknown; only motion = "drift" can be divided'
            )


def present_sources(case: Case, where: Environment) -> tuple[Source, ...]:
    """Return the sources of spread that a case has.

    Args:
        case: of objects that drift.
        where: its environment.
    """
    likely = [scenario for scenario in case.scenarios if scenario.weight > 0]
    objects = [drifter for scenario in likely for drifter in scenario.objects]
    has = {
        "scenarios": len(likely) > 1,
        "members": len(where.members) > 1,
        "start": any(_has_spread(scenario) for scenario in likely),
        "current": case.current_error.std + case.current_error.bias > 0,
        "wind": case.wind_error.std > 0 and any(scenario.uses_wind for scenario in likely),
        "leeway": any(_mean_leeway(drifter) != drifter for drifter in objects),
        "changes": any(scenario.changes for scenario in likely),
        "side": any(drifter.jibes for drifter in objects),
        "diffusion": case.diffusivity > 0,
    }
    return tuple(source for source in SOURCES if has[source.key])


def _has_spread(scenario: Scenario) -> bool:
    """Return whether a scenario's start is uncertain in place or time."""
    prior = scenario.prior
    if not isinstance(prior, PositionPrior):
        return True
    timed = prior.release_start != prior.release_end
    return timed or prior.major > 0 or prior.displacement is not None


def case_without(case: Case, off: Collection[str]) -> Case:
    """Return a case whose errors, leeway and side of the wind are off where `off` names them."""
    current, wind = case.current_error, case.wind_error
    drifters, reports = case.drifters, case.reports
    # Where an error is off there is nothing that buoys and reports could correct.
    if "current" in off:
        current, drifters = _without_error(current), ()
        reports = tuple(report for report in reports if report.quantity != "current")
    if "wind" in off:
        wind = _without_error(wind)
        reports = tuple(report for report in reports if report.quantity != "wind")
    return replace(
        case,
        current_error=current,
        wind_error=wind,
        diffusivity=0.0 if "diffusion" in off else case.diffusivity,
        drifters=drifters,
        reports=reports,
        scenarios=tuple(_scenario_without(scenario, off) for scenario in case.scenarios),
    )


def _scenario_without(scenario: Scenario, off: Collection[str]) -> Scenario:
    """Return a scenario without changes of state, leeway or sides, where `off` names them."""
    found = scenario
    if "changes" in off:
        found = replace(found, changes=())
    if "leeway" in off:
        found = _with_objects(found, _mean_leeway)
    if "side" in off:
        found = replace(_with_objects(found, _midway), jibe_rate=0.0)
    return found


def _with_objects(scenario: Scenario, change: Callable[[Drifter], Drifter]) -> Scenario:
    """Return a scenario with another object in each of its states."""
    changes = tuple(
        one if one.object is None else replace(one, object=change(one.object))
        for one in scenario.changes
    )
    return replace(scenario, object=change(scenario.object), changes=changes)


def _without_error(error: ForcingError) -> ForcingError:
    return replace(error, std=0.0, bias=0.0, tail=math.inf)


def _mean_leeway(drifter: Drifter) -> Drifter:
    """Return an object without differences between particles."""

    def mean(line: Line) -> Line:
        return replace(line, std=0.0, spread=0.0)

    return replace(
        drifter,
        down=mean(drifter.down),
        right=mean(drifter.right),
        left=mean(drifter.left),
        immersion=None,
    )


def _midway(drifter: Drifter) -> Drifter:
    """Return an object whose right and left line have their common mean, and their own spread."""
    slope = (drifter.right.slope + drifter.left.slope) / 2
    offset = (drifter.right.offset + drifter.left.offset) / 2
    right, left = (
        replace(line, slope=slope, offset=offset) for line in (drifter.right, drifter.left)
    )
    return replace(drifter, right=right, left=left)


def hold_ensemble(case: Case, ensemble: Ensemble, off: Collection[str]) -> None:
    """Give all particles one start, one member or one scenario where `off` names it, in place.

    Args:
        case: of the ensemble.
        ensemble: at its start.
        off: keys of sources.
    """
    if "members" in off and MEMBER.name in ensemble.own:
        ensemble.own[MEMBER.name].from_numpy(np.zeros(ensemble.n, np.int32))
    if "scenarios" in off:
        first, last = ensemble.scenarios[int(np.argmax([s.weight for s in case.scenarios]))]
        log_weight = np.full(ensemble.n, -np.inf, np.float32)
        log_weight[first:last] = ensemble.log_weight.to_numpy()[first:last]
        ensemble.log_weight.from_numpy(log_weight)
    if "start" in off:
        _hold_start(case, ensemble)


def _hold_start(case: Case, ensemble: Ensemble) -> None:
    """Move all particles of each scenario to the particle nearest their mean position, in place.

    A mean position may be on land or outside the area of the prior; a particle's never is.
    """
    lon, lat, release = (
        column.to_numpy() for column in (ensemble.lon, ensemble.lat, ensemble.release)
    )
    for scenario, (first, last) in zip(case.scenarios, ensemble.scenarios, strict=True):
        if first == last:
            continue
        own = slice(first, last)
        nearest = first + _nearest_to_mean(lon[own], lat[own])
        lon[own], lat[own] = lon[nearest], lat[nearest]
        # Along a trackline the place gives the time. Otherwise the two are independent.
        moving = scenario.prior is not None and scenario.prior.moving
        release[own] = release[nearest] if moving else int(np.median(release[own]))
    for column, values in ((ensemble.lon, lon), (ensemble.lat, lat), (ensemble.release, release)):
        column.from_numpy(values)


def _nearest_to_mean(lon: Array, lat: Array) -> int:
    """Return the number of the position [binary angle] nearest the mean of all, (n,)."""
    places = np.stack(sphere.vector(lon * sphere.UNIT, lat * sphere.UNIT), axis=1)
    apart = places - places.mean(axis=0)
    return int(np.argmin((apart**2).sum(axis=1)))


def _describe_off(found: Collection[Source]) -> str:
    """Return what "off" means for each source, in one line."""
    return "; ".join(f"{source.name}: {source.off}" for source in found)
