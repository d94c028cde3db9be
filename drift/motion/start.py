"""The start of a run: the initial ensemble, the scene that it moves through, and the clock it moves by."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from drift.case.record import Case
from drift.motion import ensemble as record
from drift.motion import prior, silence, simulate
from drift.motion.ensemble import Ensemble
from drift.motion.environment import Environment
from drift.motion.forcing import QUANTITIES, Forcing
from drift.motion.forcing_error import ForcingError
from drift.motion.scenario import Scenario
from drift.motion.simulate import Clock, Scene, Trial
from drift.spill import release
from drift.spill import worlds as drawn_worlds
from drift.spill.records import Spill
from drift.spill.worlds import Proposal, Worlds
from geo import notation, sphere
from geo.box import Box
from geo.coast import edges as shoreline
from geo.errors import UserError
from geo.forcing.sources import Source
from kernels import advance
from kernels import coast as device_coast

RENEWAL = 2**40  # between the seeds of a spill's rounds
LEAST_INTERVAL = 300  # [s] a lattice finer than that is not worth a node of forcing


@dataclass(frozen=True)
class Start:
    """All that the first step needs. dry: share of each scenario's prior on land; trial: why "auto" chose its step."""

    ensemble: Ensemble
    dry: tuple[float, ...]
    scene: Scene
    clock: Clock
    trial: Trial | None
    worlds: Worlds | None = None  # of a spill


def prepare(case: Case, where: Environment, shore: device_coast.DeviceCoast | None = None) -> Start:
    """Return the start of a case's run; close `scene.forcing` after it.

    shore: the coast, where it lies on the device already.
    Raises UserError when a prior lies on land or where there is no forcing, or when the step is too long.
    """
    shore = device_coast.upload(where.coast) if where.coast and not shore else shore
    worlds = None
    if case.spill:
        assert where.coast is not None  # environment.open_for
        worlds = drawn_worlds.draw(case.spill, case.seed, partial(shoreline.is_land, where.coast))
        ensemble = release.draw(case, case.spill, worlds, shore, case.seed)
        dry: tuple[float, ...] = (0.0,) * len(case.scenarios)
    else:
        drawn = prior.draw(case, shore)
        ensemble, dry = drawn.ensemble, drawn.dry
    forcing = Forcing(list(where.scenarios), case.direction)
    try:
        sinks = case.spill is not None and any(kind.sinking for kind in case.spill.kinds)
        bias = case.current_error.bias > 0
        place = advance.Place(domain(where), shore, _beach(case), bias, sinks, scheme=case.scheme)
        scene = Scene(forcing, tuple(physics(case, s) for s in case.scenarios), place)
        clock, trial = clock_of(case, where, ensemble, scene)
        _check_place(case, where, ensemble, scene, clock)
    except BaseException:
        forcing.close()
        raise
    return Start(ensemble, dry, scene, clock, trial, worlds)


def renew(case: Case, spill: Spill, where: Environment, before: Start, proposal: Proposal, number: int) -> Start:
    """Return the start of the same spill in new worlds, drawn from a proposal; number: of the renewal, from 1."""
    assert where.coast is not None
    before.scene.forcing.close()
    seed = (case.seed + number * RENEWAL) % 2**63
    worlds = drawn_worlds.draw(spill, seed, partial(shoreline.is_land, where.coast), proposal)
    ensemble = release.draw(case, spill, worlds, before.scene.place.coast, seed)
    scene = replace(before.scene, forcing=Forcing(list(where.scenarios), case.direction))
    return replace(before, ensemble=ensemble, scene=scene, worlds=worlds)


def physics(case: Case, scenario: Scenario) -> advance.Physics:
    """Return a scenario's physics; an error without spread is off."""
    wind = case.wind_error if scenario.object.uses_wind else ForcingError(0.0, 1.0)
    return advance.Physics(
        case.current_error.std, case.current_error.time, wind.std, wind.time, case.diffusivity, scenario.jibe_rate
    )


def _beach(case: Case) -> advance.Beach:
    coast = case.coast
    return advance.Beach(coast.half_life / math.log(2), coast.offing, coast.behaviour == "slide")


def domain(where: Environment) -> advance.Domain:
    """Return the box outside which a particle has left."""
    box = where.box
    west, south = (int(sphere.to_binary(x)) for x in (box.west, box.south))
    width = min(round((box.east - box.west) * sphere.TURN / 360), sphere.TURN - 1)
    return advance.Domain(west, south, width, round((box.north - box.south) * sphere.TURN / 360))


def land_of(scene: Scene) -> Callable[[npt.NDArray[Any], npt.NDArray[Any]], npt.NDArray[np.bool_]] | None:
    """Return what says whether points [binary angles] lie on land, asked on the device; None without a coast."""
    coast = scene.place.coast
    return None if coast is None else lambda lon, lat: ~device_coast.wet(coast, lon, lat)


def clock_of(case: Case, where: Environment, ensemble: Ensemble, scene: Scene) -> tuple[Clock, Trial | None]:
    """Return the clock: the case's step, or the largest whose error is small; on the lattice of the forcing's times."""
    times = [s.times.astype("datetime64[s]").astype(np.int64) for s in where.sources if s.times.size > 1]
    divisor, origin = _lattice(times)
    start = int(case.start.astype("datetime64[s]").astype(np.int64))
    duration = abs(int((case.end - case.start) / np.timedelta64(1, "s")))
    limits = {
        "a sixth of the decorrelation time of the current's errors": _sixth(case.current_error),
        "a sixth of the decorrelation time of the wind's errors": _sixth(case.wind_error),
        "the interval of the forcing": min((float(np.median(np.diff(t))) for t in times), default=np.inf),
    }
    reason, longest = min(limits.items(), key=lambda item: item[1])
    if case.step is None:
        ladder_clock = Clock(start, duration, case.direction, 1, 0)
        trial = simulate.choose_step(ensemble, scene, ladder_clock, divisor, origin, longest, case.tolerance)
        return Clock(start, duration, case.direction, trial.step, origin % trial.step), trial
    if case.step > longest:
        raise UserError(
            f"clock.step: {case.step} s is longer than {reason}, {longest:.0f} s: the result would depend on it; give at "
            'most that, or "auto"'
        )
    return Clock(start, duration, case.direction, case.step, origin % case.step), None


def _sixth(error: ForcingError) -> float:
    """Return the longest step [s] that an error's process allows."""
    return error.time / 6 if error.std > 0 else np.inf


def _lattice(times: list[npt.NDArray[np.int64]]) -> tuple[int, int]:
    """Return the interval [s] that steps should divide, and a point of the lattice [s since 1970].

    That is the common divisor of all sources' times; times that share none of use are left to interpolation.
    """
    for chosen in (times, [t for t in times if _common(t, int(t[0])) >= LEAST_INTERVAL]):
        if chosen:
            origin = int(chosen[0][0])
            divisor = _common(np.concatenate(chosen), origin)
            if divisor >= LEAST_INTERVAL:
                return divisor, origin
    return 3600, int(times[0][0]) // 3600 * 3600 if times else 0


def _common(times: npt.NDArray[np.int64], origin: int) -> int:
    return int(np.gcd.reduce(np.abs(times - origin)))


def _check_place(case: Case, where: Environment, ensemble: Ensemble, scene: Scene, clock: Clock) -> None:
    """Refuse a prior of which more than may be lost lies where there is no forcing."""
    low, high, _ = next(clock.steps())
    scene.forcing.set(low, high)
    lon, lat = ensemble.lon.to_numpy(), ensemble.lat.to_numpy()
    # What is released later may find a source that has nothing yet: the run itself judges it.
    probability = np.where(ensemble.release.to_numpy() <= clock.step, record.probability(ensemble), 0.0)
    story = "class" if case.spill else "scenario"
    _check_domain(case, where, ensemble, probability)
    for quantity in QUANTITIES:
        missing, told = 0.0, []
        for number, (scenario, sources, (first, last)) in enumerate(
            zip(case.scenarios, where.scenarios, ensemble.scenarios, strict=True)
        ):
            x, y, weight = lon[first:last], lat[first:last], probability[first:last]
            known = np.ones(last - first, bool)
            for of, term, valid in silence.terms(scene.forcing, number, x, y):
                lost = np.where(valid, 0.0, weight)
                if of == quantity:
                    known &= valid
                if of == quantity and lost.sum() > 0:
                    share, middle = lost.sum() / max(weight.sum(), 1e-300), _middle(x, y, lost)
                    silent = [source for source in sources.of(quantity) if source.name in term.names]
                    away = ", ".join(f'"{source.name}" {_away(source, *middle)}' for source in silent)
                    told.append(f'{share:.0%} of {story} "{scenario.name}", about {notation.position(*middle)}: {away}')
            missing += float(weight[~known].sum())
        if missing > case.max_lost:
            summed = any(key[0] == quantity for one in where.scenarios for key in one.added)
            raise UserError(
                f"[[{quantity}]]: {missing:.0%} of the prior lies where there is no {quantity} ({'; '.join(told)}); at most "
                f"{case.max_lost:.0%} may be lost (max_lost). "
                + ("A sum has no value where one of its terms has none. " if summed else "")
                + f"Add a source, or move the {story}"
            )


def _check_domain(case: Case, where: Environment, ensemble: Ensemble, probability: npt.NDArray[Any]) -> None:
    """Refuse a prior of which more than may be lost lies outside the domain."""
    west, south, width, height = domain(where)
    lon, lat = ensemble.lon.to_numpy().astype(np.int64), ensemble.lat.to_numpy().astype(np.int64)
    beyond = ((lon - west) % sphere.TURN > width) | (lat < south) | (lat > south + height)
    lost = np.where(beyond, probability, 0.0)
    if lost.sum() <= case.max_lost:
        return
    x, y = _middle(ensemble.lon.to_numpy(), ensemble.lat.to_numpy(), lost)
    box = where.box
    raise UserError(
        f"[domain]: {lost.sum():.0%} of the prior lies outside it, about {notation.position(x, y)}, from where it is "
        f"{_edge(box, x, y)} to its edge ({box.west:.2f}..{box.east:.2f} E {box.south:.2f}..{box.north:.2f} N); at most "
        f"{case.max_lost:.0%} may be lost (max_lost). Widen [domain], or leave it out"
    )


def _middle(lon: npt.NDArray[np.int32], lat: npt.NDArray[np.int32], weight: npt.NDArray[Any]) -> tuple[float, float]:
    """Return the weighted mean position (lon, lat) [deg] of points [binary angles]: that of their mean vector."""
    x, y = lon * sphere.UNIT, lat * sphere.UNIT
    mean = [float((weight * part).sum()) for part in (np.cos(y) * np.cos(x), np.cos(y) * np.sin(x), np.sin(y))]
    middle = math.atan2(mean[1], mean[0]), math.atan2(mean[2], math.hypot(mean[0], mean[1]))
    return math.degrees(middle[0]), math.degrees(middle[1])


def _away(source: Source, lon: float, lat: float) -> str:
    """Return how far and where the domain of a source lies from a point [deg]; what is missing inside it is land, or a gap."""
    grid = source.grid
    if source.domain is None:
        box = grid.box
        if (lon - box.west) % 360 <= box.east - box.west and box.south <= lat <= box.north:
            return "has no value there (land, or missing)"
        return f"begins {_edge(box, lon, lat)}"
    row, column = np.nonzero(source.domain)
    x, y = grid.lon[column], grid.lat[row]
    apart = sphere.distance(np.radians(lon), np.radians(lat), np.radians(x), np.radians(y))
    near = int(np.argmin(apart))
    if apart[near] < np.radians(max(grid.dlon, grid.dlat)) * sphere.RADIUS:
        return "has no value there (land, or missing)"
    return f"begins {notation.toward(lon, lat, float(x[near]), float(y[near]))}"


def _edge(box: Box, lon: float, lat: float) -> str:
    """Return how far and where the edge of a box is from a point [deg], to about a thousandth of the box's size."""
    share = np.linspace(0, 1, 1001)
    x, y = box.west + share * (box.east - box.west), box.south + share * (box.north - box.south)
    x, y = (
        np.concatenate([x, x, 0 * y + box.west, 0 * y + box.east]),
        np.concatenate([0 * x + box.south, 0 * x + box.north, y, y]),
    )
    near = int(np.argmin(sphere.distance(np.radians(lon), np.radians(lat), np.radians(x), np.radians(y))))
    return notation.toward(lon, lat, float(x[near]), float(y[near]))
