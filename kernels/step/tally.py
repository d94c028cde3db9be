"""Sums over particles by block of slots, and fixed-point amounts by cell of a map.

One thread sums a block, slot after slot, and amounts in cells are integers: results have the same
bits on any number of threads. Sums need float64 sines and 64-bit atomics, which Vulkan and Metal
lack on many graphics cards; there NumPy computes them.
"""

import itertools
import math
from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
import taichi as ti

from geo import cells as fixed_point
from geo import sphere
from geo.array import Array
from geo.cells import Cells
from kernels.maths import doubles
from kernels.runtime import runtime
from kernels.runtime.dtypes import NUMPY

ABLE = ("cpu", "cuda")  # backends that have both
LEAST = 0.5 / fixed_point.ONE  # probabilities above it are not 0 in fixed point
HIDDEN, MOVING, RESTING = 0, 1, 2  # how a status counts on a map
# Sums of a block: probability, its square; weight (probability on the map), its square; weight
# times cosine and sine of the longitude; weight times x, y, z of moving, then of resting particles;
# probability by status, then its square.
PROBABILITY, WEIGHT, DIRECTION, VECTORS, STATUS = (
    slice(0, 2),
    slice(2, 4),
    slice(4, 6),
    slice(6, 12),
    slice(12, None),
)
# 1.5 * 2^52: adding it rounds a float64 of up to 2^51 to an integer
WHOLE = 6755399441055744.0

Reals = ti.types.ndarray(dtype=ti.f64, ndim=1)
Wide = ti.types.ndarray(dtype=ti.i64, ndim=1)
Bytes = ti.types.ndarray(dtype=ti.u8, ndim=1)
Ints = ti.types.ndarray(dtype=ti.i32, ndim=1)


class Swarm(NamedTuple):
    """Particles, and how each of their statuses counts on a map."""

    lon: Array  # int32 binary angle (n,)
    lat: Array
    probability: Array  # float64 (n,)
    status: Array  # int32 (n,)
    kinds: Array  # int32 (statuses,): HIDDEN, MOVING or RESTING


class Summed(NamedTuple):
    """Sums of blocks of particles."""

    sums: Array  # float64 (k, 12 + 2 * statuses)
    lightest: Array  # float64 (k,) least weight that is not 0; 1 where there is none
    heaviest: Array  # float64 (k,)


def able() -> bool:
    """Return whether the running backend can compute sums; otherwise NumPy does."""
    return runtime.backend() in ABLE


def summed(swarm: Swarm, edges: Array) -> Summed:
    """Return the sums of each block of particles.

    Args:
        swarm: the particles.
        edges: first slot of each block and, last, n; shape (k + 1,).
    """
    many, statuses = len(edges) - 1, len(swarm.kinds)
    columns = STATUS.start + 2 * statuses
    sums, extremes = np.zeros(many * columns), np.zeros(2 * many)
    if able() and many:
        own = [runtime.resident(values) for values in swarm]
        _sum(edges.astype(np.int32), *own, statuses, sums, extremes)
        least, most = extremes.reshape(2, many)
        return Summed(sums.reshape(many, columns), least, most)
    return _summed(swarm, edges)


@ti.kernel
def _sum(
    edges: Ints,
    lon: Ints,
    lat: Ints,
    probability: Reals,
    status: Ints,
    kinds: Ints,
    statuses: ti.i32,
    sums: Reals,
    extremes: Reals,
):
    """Sum each block separately."""
    many = edges.shape[0] - 1
    for b in range(many):
        row = b * (STATUS.start + 2 * statuses)
        total = ti.Vector([ti.f64(0.0)] * 12)
        lightest, heaviest = ti.f64(1.0), ti.f64(0.0)
        for i in range(edges[b], edges[b + 1]):
            p, kind = probability[i], kinds[status[i]]
            total[0] += p
            total[1] += p * p
            sums[row + STATUS.start + status[i]] += p
            sums[row + STATUS.start + statuses + status[i]] += p * p
            if kind != HIDDEN and p > LEAST:
                sin_lon, cos_lon = doubles.sincos(ti.cast(lon[i], ti.f64) * ti.f64(sphere.UNIT))
                sin_lat, cos_lat = doubles.sincos(ti.cast(lat[i], ti.f64) * ti.f64(sphere.UNIT))
                total[2] += p
                total[3] += p * p
                total[4] += p * cos_lon
                total[5] += p * sin_lon
                x, y, z = p * cos_lat * cos_lon, p * cos_lat * sin_lon, p * sin_lat
                if kind == MOVING:
                    total[6] += x
                    total[7] += y
                    total[8] += z
                else:
                    total[9] += x
                    total[10] += y
                    total[11] += z
                lightest = ti.min(lightest, p)
                heaviest = ti.max(heaviest, p)
        for k in ti.static(range(12)):
            sums[row + k] = total[k]
        extremes[b] = lightest
        extremes[many + b] = heaviest


def _summed(swarm: Swarm, edges: Array) -> Summed:
    """Return the sums of `summed`, computed by NumPy."""
    many, statuses, p = len(edges) - 1, len(swarm.kinds), swarm.probability
    kind = np.where(p > LEAST, swarm.kinds[swarm.status], HIDDEN)
    lon, lat = swarm.lon * sphere.UNIT, swarm.lat * sphere.UNIT
    weight = np.where(kind != HIDDEN, p, 0.0)
    flat = weight * np.cos(lat)
    vector = flat * np.cos(lon), flat * np.sin(lon), weight * np.sin(lat)
    values = [p, p * p, weight, weight * weight, weight * np.cos(lon), weight * np.sin(lon)]
    values += [np.where(kind == way, axis, 0.0) for way in (MOVING, RESTING) for axis in vector]
    cell = np.repeat(np.arange(many), np.diff(edges)) * statuses + swarm.status
    by_status = [
        np.bincount(cell, own, many * statuses).reshape(many, statuses) for own in (p, p * p)
    ]
    spans = [slice(a, b) for a, b in itertools.pairwise(edges)]
    first = np.array([[own[span].sum() for own in values] for span in spans]).reshape(
        many, len(values)
    )
    seen = np.where(kind != HIDDEN, p, 1.0)
    return Summed(
        np.concatenate([first, *by_status], axis=1),
        np.array([seen[span].min(initial=1.0) for span in spans]),
        np.array([weight[span].max(initial=0.0) for span in spans]),
    )


class Marks(NamedTuple):
    """Categories by which a map separates particles."""

    group: Array  # int32 (n,) 0 .. groups - 1
    medium: Array  # int32 (statuses,) of each status, 0 .. media - 1
    scenario: Array  # int32 (n,)
    shown: Array  # index of each scenario among those shown


def held(parts: Iterable[Swarm], window: Cells) -> Array:
    """Return the cells of a map that contain particles: flat indices, ascending."""
    many = window.nlon * window.nlat
    marks = _zeros(many, ti.u8)
    for part in parts:
        if able():
            _mark(*map(runtime.resident, part), *_bounds(window), marks)
        else:
            marks[_found(part, window)[1]] = 1
    return np.flatnonzero(_read(marks, many))


def laid(
    parts: Iterable[tuple[Swarm, Marks]],
    window: Cells,
    cells: Array,
    groups: int,
    media: int,
    shown: int,
    heaviest: float,
) -> tuple[Array, Array, Array]:
    """Return the probability in the cells of a map, in fixed point.

    Args:
        parts: particles with their categories on the map.
        window: cells of the map.
        cells: flat indices of the occupied cells, ascending (h,).
        groups: number of groups.
        media: number of media.
        shown: number of scenarios that are shown.
        heaviest: largest probability of a particle, the unit of the sums of squares; 0: no squares.

    Returns:
        Weights by group and medium, squared weights likewise, and weights by scenario and medium:
            int64, shapes (groups, media, h), (groups, media, h), (shown, media, h). Sums that are
            not computed are zero: squares if heaviest is 0, scenarios if only one is shown.
    """
    place = np.full(window.nlon * window.nlat, -1, np.int32)
    place[cells] = np.arange(cells.size)
    # A particle's sums are adjacent in memory: weights and squares of a cell.
    shape, alone = (cells.size, groups, media, 2), (cells.size, shown, media)
    sums, by_scenario = _zeros(math.prod(shape)), _zeros(math.prod(alone))
    lying = runtime.resident(place) if able() else place
    for swarm, marks in parts:
        if able():
            own = map(runtime.resident, (*swarm, *marks))
            _lay(*own, *_bounds(window), lying, groups, media, shown, heaviest, sums, by_scenario)
            continue
        slot, cell, amount = _found(swarm, window)
        medium, p = marks.medium[swarm.status[slot]], swarm.probability[slot]
        code = ((place[cell] * groups + marks.group[slot]) * media + medium) * 2
        np.add.at(sums, code, amount)
        if heaviest > 0:
            np.add.at(sums, code + 1, fixed_point.to_fixed_point(p * (p / heaviest)))
        if shown > 1:
            code = (place[cell] * shown + marks.shown[marks.scenario[slot]]) * media + medium
            np.add.at(by_scenario, code, amount)
    both = np.moveaxis(_read(sums, math.prod(shape)).reshape(shape), 0, -1)
    return (
        both[:, :, 0],
        both[:, :, 1],
        np.moveaxis(_read(by_scenario, math.prod(alone)).reshape(alone), 0, -1),
    )


def _zeros(many: int, kind: Any = ti.i64) -> Any:
    # Taichi 1.7.4 zeroes whole words of 32 bits only: bytes beyond the last word would keep old
    # contents.
    return runtime.empty(many + -many % 4, kind) if able() else np.zeros(many, NUMPY[kind])


def _read(sums: Any, many: int) -> Array:
    return sums if isinstance(sums, np.ndarray) else np.asarray(sums.to_numpy()[:many])


def _bounds(window: Cells) -> tuple[int, ...]:
    """Return the grid's corner, cell size and shape as kernels take them."""
    corner = window.lon0 % sphere.TURN, window.lat0 % sphere.TURN
    return *corner, window.width, window.height, window.nlon, window.nlat


def _found(swarm: Swarm, window: Cells) -> tuple[Array, Array, Array]:
    """Return the slots of particles on the map, their cells and their fixed-point probabilities."""
    slot = np.flatnonzero((swarm.kinds[swarm.status] != HIDDEN) & (swarm.probability > LEAST))
    cell = fixed_point.index_of_cells(swarm.lon[slot], swarm.lat[slot], window)
    slot, cell = slot[cell >= 0], cell[cell >= 0]
    return slot, cell, fixed_point.to_fixed_point(swarm.probability[slot])


@ti.func
def _cell(
    lon: ti.i32,
    lat: ti.i32,
    west: ti.u32,
    south: ti.u32,
    width: ti.u32,
    height: ti.u32,
    nlon: ti.u32,
    nlat: ti.u32,
) -> ti.i32:
    """Return the flat index of a position's cell, -1 off the grid; see geo.cells.index_of_cells."""
    x, y = (ti.cast(lon, ti.u32) - west) // width, (ti.cast(lat, ti.u32) - south) // height
    found = -1
    if x < nlon and y < nlat:  # unsigned differences of positions west or south are large
        found = ti.cast(y * nlon + x, ti.i32)
    return found


@ti.func
def _fixed(probability: ti.f64) -> ti.i64:
    """Return a probability in fixed point (see geo.cells.to_fixed_point)."""
    return ti.cast(
        probability * ti.f64(float(fixed_point.ONE)) + ti.f64(WHOLE) - ti.f64(WHOLE), ti.i64
    )


@ti.kernel
def _mark(
    lon: Ints,
    lat: Ints,
    probability: Reals,
    status: Ints,
    kinds: Ints,
    west: ti.u32,
    south: ti.u32,
    width: ti.u32,
    height: ti.u32,
    nlon: ti.u32,
    nlat: ti.u32,
    marks: Bytes,
):
    """Mark the occupied cells of a map."""
    for i in range(lon.shape[0]):
        if kinds[status[i]] != HIDDEN and probability[i] > LEAST:
            cell = _cell(lon[i], lat[i], west, south, width, height, nlon, nlat)
            if cell >= 0:
                marks[cell] = ti.u8(1)


@ti.kernel
def _lay(
    lon: Ints,
    lat: Ints,
    probability: Reals,
    status: Ints,
    kinds: Ints,
    group: Ints,
    medium: Ints,
    scenario: Ints,
    shown: Ints,
    west: ti.u32,
    south: ti.u32,
    width: ti.u32,
    height: ti.u32,
    nlon: ti.u32,
    nlat: ti.u32,
    place: Ints,
    groups: ti.i32,
    media: ti.i32,
    of: ti.i32,
    heaviest: ti.f64,
    sums: Wide,
    by_scenario: Wide,
):
    """Add particles to the cells of a map."""
    for i in range(lon.shape[0]):
        p = probability[i]
        if kinds[status[i]] != HIDDEN and p > LEAST:
            cell = _cell(lon[i], lat[i], west, south, width, height, nlon, nlat)
            if cell >= 0:
                amount, own, where = _fixed(p), medium[status[i]], place[cell]
                code = ((where * groups + group[i]) * media + own) * 2
                ti.atomic_add(sums[code], amount)
                if heaviest > 0.0:
                    ti.atomic_add(sums[code + 1], _fixed(p * (p / heaviest)))
                if of > 1:
                    ti.atomic_add(
                        by_scenario[(where * of + shown[scenario[i]]) * media + own], amount
                    )
