"""The sources of a forecast's spread, and a case in which some of them are switched off.

A source that is off has one value for all particles: its mean, or the likeliest one. The random
numbers of the others stay the same.
"""

from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np

from drift.case.record import Case
from drift.engine.environment.environment import Environment
from drift.engine.motion.forcing_error import ForcingError
from drift.engine.motion.leeway import Drifter, Line
from drift.engine.motion.own_motion import OwnMotion
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
        "get the wind on scene",
    ),
    Source(
        "leeway",
        "leeway",
        "each object has the mean leeway of its class",
        "ask what exactly is adrift, and narrow the class of the object",
    ),
    Source(
        "side",
        "side of the wind",
        "the object drifts midway between the right and the left of the wind, and does not jibe",
        "ask how it lies to the wind; if nobody knows, search on both sides",
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
    objects = [scenario.object for scenario in likely]
    has = {
        "scenarios": len(likely) > 1,
        "members": len(where.members) > 1,
        "start": any(_has_spread(scenario) for scenario in likely),
        "current": case.current_error.std + case.current_error.bias > 0,
        "wind": case.wind_error.std > 0 and any(drifter.uses_wind for drifter in objects),
        "leeway": any(_mean_leeway(drifter) != drifter for drifter in objects),
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
    changed = case
    if "current" in off:
        # Without an error of the current there is nothing that a buoy could correct.
        changed = replace(changed, current_error=_without_error(case.current_error), drifters=())
    if "wind" in off:
        changed = replace(changed, wind_error=_without_error(case.wind_error))
    if "diffusion" in off:
        changed = replace(changed, diffusivity=0.0)
    scenarios = []
    for scenario in changed.scenarios:
        own = scenario
        if "leeway" in off:
            own = replace(own, object=_mean_leeway(own.object))
        if "side" in off:
            own = replace(own, object=_midway(own.object), jibe_rate=0.0)
        scenarios.append(own)
    return replace(changed, scenarios=tuple(scenarios))


def _without_error(error: ForcingError) -> ForcingError:
    return replace(error, std=0.0, bias=0.0)


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


def describe_off(found: Collection[Source]) -> str:
    """Return what "off" means for each source, in one line."""
    return "; ".join(f"{source.name}: {source.off}" for source in found)
