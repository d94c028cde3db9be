"""The domain of a run: the box outside which a particle counts as departed.

By default it contains everything that a drifting object can reach.
"""

import math
from collections.abc import Callable, Sequence

import numpy as np

from drift.engine.environment.environment_spec import EnvironmentSpec
from drift.engine.environment.forcing_spec import ForcingSpec
from drift.engine.motion.ensemble_spec import EnsembleSpec
from drift.engine.motion.models import drift
from drift.engine.motion.models.by_name import model_of
from drift.engine.motion.scenario import Scenario
from geo import sphere
from geo.box import Box
from geo.forcing.quantity import QUANTITIES, Quantity
from kernels.step import advance

FASTEST_CURRENT = 2.5  # [m/s] with which a domain is computed where the case states none
STRONGEST_WIND = 25.0  # [m/s]
POLEWARD = 89.0  # [deg] a domain that reaches beyond holds the pole: there meridians meet
# [deg2] size of a box above which computing what can be reached saves work
VAST = 4_000.0
FARTHEST = 7.0  # standard deviations beyond which practically no particle is drawn
SPREADS = 5.0  # standard deviations of a prior inside its box
SCALE = 4.0  # of a tail: with 4 degrees of freedom, larger for 1 of 530 particles


def bounds(spec: EnsembleSpec, asked: EnvironmentSpec) -> Box:
    """Return the box outside which a particle of a run counts as departed."""
    box = asked.domain or within_reach(spec)
    if (box.east - box.west) * (box.north - box.south) > VAST:
        box = _common(box, outermost_box(spec, asked))
    if is_polar(box):
        south, north = (
            (-90.0 if box.south < -POLEWARD else box.south),
            (90.0 if box.north > POLEWARD else box.north),
        )
        return Box(-180.0, south, 180.0, north)
    return box


def is_polar(box: Box) -> bool:
    """Return whether a box is so near to a pole that it must contain the pole."""
    return max(-box.south, box.north) > POLEWARD


def binary(box: Box) -> advance.Domain:
    """Return a domain in binary angles, as the kernels take it."""
    west, south = (int(sphere.to_binary(x)) for x in (box.west, box.south))
    width = min(round((box.east - box.west) * sphere.TURN / 360), sphere.TURN - 1)
    return advance.Domain(west, south, width, round((box.north - box.south) * sphere.TURN / 360))


def middle(spec: EnsembleSpec) -> tuple[float, float]:
    """Return the middle (lon, lat) [deg] of the first scenario's prior; near a pole, constants
    refer to it.
    """
    x, y, _ = next(extent for scenario in spec.scenarios for extent in scenario.extents(0.0))
    return float(sphere.wrap_degrees(np.degrees(np.mean(x)))), float(np.degrees(np.mean(y)))


def within_reach(spec: EnsembleSpec) -> Box:
    """Return the box that contains every prior and everything reachable from it by the end of the
    run.
    """

    def carried(leeway: float) -> float:
        speed = FASTEST_CURRENT + leeway + _error_speed(spec, 3)
        if spec.release:
            speed += leeway * (math.exp(2 * spec.release.windage_bias) - 1)
        return speed

    objects = [(model_of(s).forced, model_of(s).usual(s, STRONGEST_WIND)) for s in _drifting(spec)]
    debris = [(True, drift.usual(drifter, STRONGEST_WIND)) for drifter in spec.debris]
    return around(spec, _fastest_of(spec, objects + debris, carried), SPREADS)


def _error_speed(spec: EnsembleSpec, spreads: float) -> float:
    """Return the mean speed over a run [m/s] that boxes allow for errors of the current.

    With a tail it is SCALE times that of the displacement, which grows with the square root of time,
    if that is more. SCALE times the first one would make a run of ten days span an ocean.

    Args:
        spec: of the ensemble.
        spreads: number of standard deviations.
    """
    error, duration = spec.errors.current, spec.period.duration
    speed = spreads * (error.std + error.bias)
    if error.tailed:
        speed = max(speed, spreads * SCALE * error.displacement(duration) / duration)
    return speed


def outermost_box(spec: EnsembleSpec, asked: EnvironmentSpec) -> Box:
    """Return a box that practically no particle of a run leaves.

    It assumes speeds that no sea sustains, or those of the case if they are higher, and extreme
    errors. With N particles about N exp(-FARTHEST**2 / 2) are drawn from farther out: one of ten
    million in a thousand runs, and with a tail up to three of ten million in a run. A particle that
    leaves the box nevertheless counts as having left the domain.
    """
    utmost = {
        name: _fastest(asked.forcing.get(name, ()), quantity)
        for name, quantity in QUANTITIES.items()
    }
    wind = utmost["wind"] + FARTHEST * spec.errors.wind.std

    def carried(leeway: float) -> float:
        speed = (
            sum(utmost[name] for name, quantity in QUANTITIES.items() if not quantity.in_air)
            + leeway
        )
        speed += _error_speed(spec, FARTHEST)
        if spec.release:
            speed += leeway * math.exp(FARTHEST * spec.release.windage_bias)
        return speed + FARTHEST * math.sqrt(2 * spec.errors.diffusivity / spec.period.duration)

    objects = [
        (model_of(s).forced, model_of(s).fastest(s, wind, FARTHEST)) for s in _drifting(spec)
    ]
    debris = [(True, drift.fastest(drifter, wind, FARTHEST)) for drifter in spec.debris]
    return around(spec, _fastest_of(spec, objects + debris, carried), FARTHEST)


def _drifting(spec: EnsembleSpec) -> list[Scenario]:
    """Return the scenarios whose objects are adrift at some time."""
    return [s for s in spec.scenarios if s.model in s.models]


def _fastest_of(
    spec: EnsembleSpec, drifting: Sequence[tuple[bool, float]], carried: Callable[[float], float]
) -> float:
    """Return the highest speed [m/s] at which a particle can leave its scenario's extent.

    drifting: whether each drifting object is forced, and its speed through the water; carried:
    converts that speed to one over ground. Steering targets leave the extent on a course, or by a
    current that is not compensated.
    """
    speeds = [carried(speed) if forced else speed for forced, speed in drifting]
    for own in (s.itinerary for s in spec.scenarios if s.itinerary):
        speeds.append(carried(own.fastest) if own.currents == "felt" else own.fastest)
    return max(speeds)


def _fastest(specs: Sequence[ForcingSpec], quantity: Quantity) -> float:
    """Return the highest speed of a quantity [m/s]: the larger of the case's constants and its
    usual maximum.

    It is 0 for a scalar, and for a quantity that no scenario needs and the case does not have.
    """
    if quantity.scalar or (not specs and not quantity.needed):
        return 0.0
    parts = [part for spec in specs for part in spec.parts]
    typed = [spec.constant for spec in parts if spec.constant is not None]
    typed += [
        row
        for spec in parts
        if spec.table
        for row in zip(spec.table.east, spec.table.north, strict=True)
    ]
    return max([quantity.utmost, *(math.hypot(east, north) for east, north in typed)])


def around(spec: EnsembleSpec, fastest: float, spreads: float) -> Box:
    """Return the box reached from all priors at a drift speed [m/s].

    spreads: number of standard deviations of the priors that it contains.
    """
    lon: list[np.ndarray] = []
    lat: list[np.ndarray] = []
    spread = 0.0
    for scenario in spec.scenarios:
        for x, y, far in scenario.extents(spreads):
            spread = max(spread, far)
            # Each prior's longitudes are unwrapped: shift them by whole turns next to the first
            # prior's.
            about = lon[0].mean() if lon else x.mean()
            lon.append(x - 2 * np.pi * np.round((x.mean() - about) / (2 * np.pi)))
            lat.append(y)
    if spec.release:
        spread += spreads * spec.release.release_std
    grown = np.degrees((spread + fastest * spec.period.duration) / sphere.RADIUS)
    x, y = np.degrees(np.concatenate(lon)), np.degrees(np.concatenate(lat))
    # a box beyond this latitude spans all longitudes
    highest = min(float(np.abs(y).max() + grown), POLEWARD)
    west = float(sphere.wrap_degrees(x.min()))
    tight = Box(west, float(y.min()), west + max(float(np.ptp(x)), 1e-6), float(y.max()))
    return tight.grown(float(grown / np.cos(np.radians(highest))), float(grown))


def _common(box: Box, other: Box) -> Box:
    """Return the intersection of two boxes; the first box if that is empty or has two parts."""
    south, north = max(box.south, other.south), min(box.north, other.north)
    if other.east - other.west >= 360:
        spans = [(box.west, box.east)]
    elif box.east - box.west >= 360:
        spans = [(other.west, other.east)]
    else:
        sides = (
            (max(box.west, other.west + k), min(box.east, other.east + k)) for k in (-360, 0, 360)
        )
        spans = [(west, east) for west, east in sides if west < east]
    if south >= north or len(spans) != 1:
        return box
    ((west, east),) = spans
    start = sphere.wrap_degrees(west)
    return Box(start, south, start + east - west, north)
