"""Winds and currents at given places and times, on the host, for arrows on maps and in the report.

Particles use the same slices on the device (drift.engine.motion.forcing); here they are sampled at
a few hundred places.
"""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from drift.engine.motion.forcing import Sources
from geo import notation, sphere
from geo.array import Array
from geo.box import Box
from geo.forcing.quantity import scalars, velocities
from geo.forcing.reading.stream import Bracket, Slices
from geo.forcing.sources import Source
from geo.grids.grid import Grid, sample

ACROSS = 14  # arrows along the longer side of a map


def ambient_at(
    sources: Sources, quantity: str, times: npt.NDArray[np.datetime64], lon: Array, lat: Array
) -> Array:
    """Return velocity east and north [m/s] at places and times, (t, m, 2); NaN where there is no
    value.

    As for particles, the first source in order of priority with a value at a place is used, and
    each added source must have a value too. For a forcing ensemble it is the mean of the members.

    Args:
        sources: of a scenario.
        quantity: such as "wind".
        times: UTC, (t,).
        lon: of the places [deg], (m,).
        lat: of the places [deg], (m,).
    """
    moments = notation.epochs(times).tolist()
    total = np.full((len(moments), len(lon), 2), np.nan)
    with ThreadPoolExecutor(1) as pool:
        for number, term in enumerate(sources.terms(quantity)):
            values = np.full_like(total, np.nan)
            for source, cells in _tiles(sources, quantity, term):
                members = [Slices(member, cells, 1, pool) for member in source.members]
                for k, moment in enumerate(moments):
                    missing = np.isnan(values[k]).any(axis=1)
                    if missing.any():
                        place = source.grid, moment, lon[missing], lat[missing]
                        values[k, missing] = sum(
                            _values_at_time(slices, *place) for slices in members
                        ) / len(members)
            total = values if number == 0 else total + values
    return total


@dataclass(frozen=True)
class Flow:
    """Velocity of a quantity east and north [m/s], (t, m, 2), at places [deg] (m,) and times (t,).

    It is NaN where there is no value.
    """

    time: npt.NDArray[np.datetime64]
    lon: Array
    lat: Array
    velocity: Array


def over(sources: Sources, box: Box, times: npt.NDArray[np.datetime64]) -> dict[str, Flow]:
    """Return the velocities of each quantity in a box, at places ACROSS along its longer side."""
    lon, lat = lattice(box, ACROSS)
    there = [quantity for quantity in velocities() if sources.of(quantity)]
    return {
        quantity: Flow(times, lon, lat, ambient_at(sources, quantity, times, lon, lat))
        for quantity in there
    }


def scalars_along(
    scenarios: Sequence[Sources],
    times: npt.NDArray[np.datetime64],
    scenario: Array,
    lon: Array,
    lat: Array,
) -> dict[str, Array]:
    """Return each scalar of the forcing along tracks, (m, t); NaN where it has no value.

    For a forcing ensemble it is the mean of the members, as in `ambient_at`.

    Args:
        scenarios: the sources of each scenario.
        times: UTC, (t,).
        scenario: number of each track's scenario, (m,).
        lon: of the tracks [binary angle], (m, t).
        lat: of the tracks [binary angle], (m, t).
    """
    lon, lat = sphere.to_degrees(lon), sphere.to_degrees(lat)
    values: dict[str, Array] = {}
    for quantity in scalars():
        for number, sources in enumerate(scenarios):
            own = np.flatnonzero(scenario == number)
            if not own.size or not sources.of(quantity):
                continue
            along = values.setdefault(quantity, np.full(lon.shape, np.nan))
            for k in range(len(times)):
                place = lon[own, k], lat[own, k]
                along[own, k] = ambient_at(sources, quantity, times[k : k + 1], *place)[0, :, 0]
    return values


def lattice(box: Box, across: int) -> tuple[Array, Array]:
    """Return places (lon, lat) [deg] (m,) evenly spaced in a box, `across` along its longer
    side.
    """
    high = box.north - box.south
    wide = (box.east - box.west) * np.cos(np.radians((box.north + box.south) / 2))
    step = max(high, wide, 1e-3) / across
    rows, columns = (max(int(side / step), 1) for side in (high, wide))
    lat = box.south + (np.arange(rows) + 0.5) * high / rows
    lon = box.west + (np.arange(columns) + 0.5) * (box.east - box.west) / columns
    x, y = np.meshgrid(lon, lat)
    return x.ravel(), y.ravel()


def _tiles(sources: Sources, quantity: str, term: Sequence[Source]) -> list[tuple[Source, int]]:
    """Return the sources of a term with their fill depths [cells]: several first unfilled, then
    filled.
    """
    filled = [(source, sources.cells.get((quantity, source.name), 0)) for source in term]
    return [*((source, 0) for source in term), *filled] if len(term) > 1 else filled


def _values_at_time(slices: Slices, grid: Grid, moment: int, lon: Array, lat: Array) -> Array:
    """Return the values of a source at a time [s since 1970] and places [deg] (m,), (m, 2)."""
    for low, high, end in (
        (moment, moment + 1, 0),
        (moment - 1, moment, 1),
    ):  # the last time of a source belongs to the interval before it
        bracket = slices.bracket(low, high)
        if bracket is not None:
            weight = (bracket.low, bracket.high)[end]
            return sample(grid, _blended(slices, bracket, weight), lon, lat)
    return np.full((len(lon), 2), np.nan)


def _blended(slices: Slices, bracket: Bracket, weight: float) -> Array:
    earlier = slices.get(bracket.earlier)
    return (
        earlier
        if weight == 0
        else np.asarray((1 - weight) * earlier + weight * slices.get(bracket.later))
    )
