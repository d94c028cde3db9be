"""Hazards of distress: the prior's density in time, multiplied by a hazard.

The density is proportional to the trackline's own one times the hazard at the place and time, also
across the track. Particles are drawn from that product (kernels.step.prior), so that their weights
stay equal, the scenario keeps its weight, and no shard needs to know of another. The above is of
tracklines; for targets under way see drift.engine.motion.steering.distress.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from statistics import NormalDist
from typing import NamedTuple

import numpy as np

from drift.engine.environment.along_track import sample_forcing
from drift.engine.motion.forcing import Forcing, Sources
from drift.engine.motion.prior import PIECE
from drift.engine.motion.scenario import Hazard, Scenario, Tilt, TracklinePrior
from geo import notation, sphere
from geo.array import Array
from geo.errors import UserError
from geo.grids import grid as grids
from kernels.step.prior import ACROSS, WIDEST

CELLS = 1024  # of the voyage; between their ends the hazard is linear
# least share of candidates that must be kept: below it, 1 particle in 1e8 finds no place
LEAST_KEPT = 0.005


class Lattice(NamedTuple):
    """Places at the ends of the cells of a voyage, (CELLS + 1, ACROSS)."""

    time: Array  # [s since 1970], whole, (CELLS + 1,)
    lon: Array  # [rad]
    lat: Array


def with_hazards(
    scenarios: Sequence[Scenario], sources: Sequence[Sources], direction: int, members: int
) -> tuple[Scenario, ...]:
    """Return the scenarios, those with a hazard with its tilt in their prior.

    Args:
        scenarios: of the run.
        sources: winds and currents of each scenario.
        direction: of the run, 1 or -1.
        members: number of members of the forcing ensemble, 0 without one.

    Raises:
        UserError: a hazard has no value on the trackline, or is 0 all along it.
    """
    if all(scenario.hazard is None for scenario in scenarios):
        return tuple(scenarios)
    tilted = []
    for number, scenario in enumerate(scenarios):
        hazard, prior = scenario.hazard, scenario.prior
        if hazard is None:
            tilted.append(scenario)
            continue
        place = f'scenario "{scenario.name}".hazard'
        if hazard.wind is not None and members:
            raise UserError(
                f"{place}: the wind has {members} members, and a hazard by wind takes one wind; give winds "
                "without members, or a field of hazard in a file"
            )
        if scenario.itinerary is not None:
            opened = partial(_under_way, hazard, list(sources), direction, number)
            tilted.append(replace(scenario, hazard_under_way=opened))
            continue
        assert isinstance(prior, TracklinePrior)  # drift.case.scenario.scenario
        points = _lattice(prior)
        if hazard.wind is None:
            values = _of_field(hazard, points, place)
        else:
            wind = _wind(list(sources), direction, number, points)
            values = _of_wind(hazard.wind, wind, points, place)
        tilted.append(replace(scenario, prior=replace(prior, tilt=_tilt_of(prior, values, place))))
    return tuple(tilted)


@contextmanager
def _under_way(
    hazard: Hazard, sources: list[Sources], direction: int, scenario: int
) -> Iterator[Callable[[int, Array, Array], Array]]:
    """Yield a function of a time [s since 1970] and places [binary angle]: hazards, NaN for none."""
    forcing = Forcing(sources, direction) if hazard.wind is not None else None

    def values(time: int, lon: Array, lat: Array) -> Array:
        if forcing is None:
            return _values_of_field(hazard, time, sphere.to_degrees(lon), sphere.to_degrees(lat))
        assert hazard.wind is not None
        times = np.full(lon.size, float(time))
        wind = sample_forcing(forcing, scenario, ["wind"], times, lon, lat)["wind"]
        return _by_wind(hazard.wind, np.hypot(wind[:, 0], wind[:, 1]))

    try:
        yield values
    finally:
        if forcing is not None:
            forcing.close()


def _lattice(prior: TracklinePrior) -> Lattice:
    """Return the places and times at which a hazard is taken along a voyage and across it."""
    share = prior.low + (prior.high - prior.low) * np.arange(CELLS + 1) / CELLS
    lon, lat = sphere.track(prior.lon, prior.lat, PIECE)
    east, north = sphere.offset(lon[:-1], lat[:-1], lon[1:], lat[1:])
    ends = np.concatenate([[0.0], np.cumsum(np.hypot(east, north))])
    way = share * ends[-1]
    piece = np.clip(np.searchsorted(ends, way) - 1, 0, east.size - 1)
    course = np.arctan2(east, north)[piece]
    sin, cos = np.sin(course), np.cos(course)
    along = way - ends[piece]
    x, y = sphere.destination(lon[piece], lat[piece], along * sin, along * cos)
    off = prior.cross_track * np.linspace(-WIDEST, WIDEST, ACROSS)
    x, y = sphere.destination(x[:, None], y[:, None], off * cos[:, None], -off * sin[:, None])
    lasts = float((prior.arrival - prior.departure) / np.timedelta64(1, "s"))
    time = np.rint(float(notation.epoch(prior.departure)) + share * lasts)
    return Lattice(time, x, y)


def _tilt_of(prior: TracklinePrior, hazard: Array, place: str) -> Tilt:
    """Return the tables from which a trackline with a hazard is drawn.

    Args:
        prior: of the scenario.
        hazard: on its `_lattice`, at least 0, (CELLS + 1, ACROSS).
        place: start of error messages.

    Raises:
        UserError: the hazard is 0 almost everywhere.
    """
    if hazard.max() <= 0:
        raise UserError(
            f"{place}: it is 0 all along the trackline, so that distress is impossible; check the hazard, the "
            "waypoints and the times, or leave the scenario out"
        )
    relative = hazard / hazard.max()
    passed = np.arange(CELLS + 1) / CELLS
    law = passed if prior.mode is None else _triangular(passed, prior)
    most = np.maximum(relative[:-1], relative[1:]).max(axis=1)
    mass = np.diff(law) * most
    proposed = np.concatenate([[0.0], np.cumsum(mass)])
    # shares of the normal law between the middles of places across the track
    middles = np.linspace(-WIDEST, WIDEST, 2 * ACROSS - 1)[1::2]
    across = np.diff([0.0, *map(NormalDist().cdf, middles), 1.0])
    ends = relative @ across
    kept = float(np.sum(np.diff(law) * (ends[:-1] + ends[1:]) / 2))
    if kept < LEAST_KEPT * proposed[-1]:
        raise UserError(
            f"{place}: almost all of it lies {WIDEST:g} standard deviations of cross_track off the trackline; check "
            "the hazard, the waypoints and cross_track"
        )
    tables = law, proposed / proposed[-1], most, relative.ravel()
    return Tilt(*(np.ascontiguousarray(table, np.float32) for table in tables))


def _triangular(passed: Array, prior: TracklinePrior) -> Array:
    """Return the cumulated triangular law of the share at parts of [low, high]."""
    assert prior.mode is not None
    peak = (prior.mode - prior.low) / (prior.high - prior.low)
    rising = passed < peak
    base = np.where(rising, peak, max(1 - peak, np.finfo(float).tiny))
    return np.where(rising, passed**2 / base, 1 - (1 - passed) ** 2 / base)


def _wind(sources: list[Sources], direction: int, number: int, points: Lattice) -> Array:
    """Return wind speeds [m/s] on a lattice, NaN where there is no wind."""
    forcing = Forcing(sources, direction)
    try:
        lon, lat = (sphere.to_binary(np.degrees(angle)).ravel() for angle in points[1:])
        time = np.repeat(points.time, ACROSS)
        wind = sample_forcing(forcing, number, ["wind"], time, lon, lat)["wind"]
    finally:
        forcing.close()
    return np.asarray(np.hypot(wind[:, 0], wind[:, 1]).reshape(points.lon.shape))


def _of_wind(law: tuple[float, float], wind: Array, points: Lattice, place: str) -> Array:
    """Return the hazard of wind speeds on a lattice."""
    missing = np.isnan(wind)
    if missing.any():
        raise UserError(
            f"{place}: the case has no wind at {_first(missing, points)}, on the trackline; give winds that cover it"
        )
    return _by_wind(law, wind)


def _by_wind(law: tuple[float, float], wind: Array) -> Array:
    at, width = law
    return np.asarray(1 / (1 + np.exp(np.clip((at - wind) / width, None, 500.0))))


def _values_of_field(hazard: Hazard, time: float, lon: Array, lat: Array) -> Array:
    """Return the hazard of a field at a time [s since 1970] and places [deg]; NaN for none."""
    assert hazard.grid is not None
    values = grids.sample(hazard.grid, _at_time(hazard, time), lon, lat)
    missing = np.isnan(values)
    if hazard.depth is not None:
        values = np.where(values < hazard.depth, 1.0, hazard.deeper)
    return np.where(missing, np.nan if hazard.outside is None else hazard.outside, values)


def _of_field(hazard: Hazard, points: Lattice, place: str) -> Array:
    """Return the hazard of a field on a lattice."""
    values = np.stack(
        [
            _values_of_field(hazard, time, np.degrees(lon), np.degrees(lat))
            for time, lon, lat in zip(*points, strict=True)
        ]
    )
    missing = np.isnan(values)
    if missing.any():
        raise UserError(
            f"{place}: {hazard.name} has no value at {_first(missing, points)}, on the trackline; give a file that "
            "covers it, or set hazard.outside to the hazard that holds there"
        )
    return values


def _at_time(hazard: Hazard, time: float) -> Array:
    """Return a field at a time [s since 1970], linear between its times; NaN before and after."""
    assert hazard.values is not None
    assert hazard.times is not None
    if not hazard.times.size:
        return np.asarray(hazard.values[0])
    known = notation.epochs(hazard.times).astype(float)
    if not known[0] <= time <= known[-1]:
        return np.full(hazard.values[0].shape, np.nan)
    k = min(int(np.searchsorted(known, time, side="right")) - 1, known.size - 2)
    part = (time - known[k]) / (known[k + 1] - known[k])
    return np.asarray((1 - part) * hazard.values[k] + part * hazard.values[k + 1])


def _first(missing: Array, points: Lattice) -> str:
    """Return the first place and time of a lattice that is missing, in words."""
    row, column = np.unravel_index(int(np.argmax(missing)), missing.shape)
    lon, lat = (float(np.degrees(angle[row, column])) for angle in points[1:])
    when = np.datetime64(int(points.time[row]), "s")
    return f"{notation.stated_position(lon, lat)} on {notation.format_dtg(when)}"
