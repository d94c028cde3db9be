"""Hazard of detection by a sensor with a table of POD, along the paths of particles.

The table is by place, or by bearing and range from the sensor. Where the POD is P, the hazard is
-log(1 - P) per unit of time. Particles and sensor move straight within a step. A straight stretch
is split into at most 256 parts, each no longer than half a cell of the table; close to the sensor
no longer than a quarter of the distance. Each part uses the POD at its midpoint, interpolated
bilinearly. The POD is zero outside the table.
"""

from typing import Any, NamedTuple

import numpy as np
import taichi as ti

from kernels.evidence import listen
from kernels.evidence.listen import Ear, Stretch, f32x2
from kernels.maths import angles

# kinds of sensor: sonar (kernels.evidence.listen); POD by bearing and range; POD by place
HEARD, ROUND, PLACES = range(3)
LEAST = 1e-12  # least probability of a miss, which bounds the hazard
FAR = 4.0  # a bridge stays within this many times its spread K sqrt(dt)
WHOLE = 4294967296.0  # full circle [binary angle]


@ti.func
def where(kind: ti.template(), ear: Ear, time: ti.f32, lon: ti.i32, lat: ti.i32) -> f32x2:
    """Return table coordinates of a position [binary angle] at a time [s].

    (column, row) for a table by place; otherwise (east, north) [m] from the sensor.
    """
    found = f32x2(0.0)
    if ti.static(kind == PLACES):
        x, y = ti.cast(lon - ear.lon, ti.f32), ti.cast(lat - ear.lat, ti.f32)
        found = f32x2(
            x / ear.cell_lon + 0.5 * (ear.rings - 1), y / ear.cell_lat + 0.5 * (ear.rays - 1)
        )
    else:
        found = listen.to(ear, time, lon, lat)
    return found


@ti.func
def onward(kind: ti.template(), ear: Ear, a: f32x2, b: f32x2) -> f32x2:
    """Return end b of a stretch from a, unwrapped so that columns continue round the world."""
    if ti.static(kind == PLACES):
        turn = WHOLE / ear.cell_lon
        b[0] -= ti.round((b[0] - a[0]) / turn) * turn
    return b


@ti.func
def near(kind: ti.template(), ear: Ear, a: f32x2, b: f32x2, stray: ti.f32) -> ti.i32:
    """Return 1 if a bridge from a to b with this spread [m] may come within the table.

    a, b: table coordinates, see `where`.
    """
    found = 0
    if ti.static(kind == PLACES):
        far = FAR * stray / ear.between
        turn = WHOLE / ear.cell_lon
        middle = 0.5 * (ear.rings - 1)
        # columns from the table's middle, the shorter way round
        x = 0.5 * (a[0] + b[0]) - middle
        x -= ti.round(x / turn) * turn
        wide = ti.abs(x) - 0.5 * ti.abs(b[0] - a[0]) <= middle + far
        low, high = ti.min(a[1], b[1]), ti.max(a[1], b[1])
        if wide and low <= ear.rays - 1 + far and high >= -far:
            found = 1
    else:
        d = b - a
        share = ti.min(ti.max(-a.dot(d) / ti.max(d.dot(d), 1e-12), 0.0), 1.0)
        if (a + share * d).norm() < ear.nearest + ear.between * (ear.rings - 1) + FAR * stray:
            found = 1
    return found


@ti.func
def _pod(kind: ti.template(), ear: Ear, pods: ti.template(), at: f32x2) -> ti.f32:
    """Return the POD at table coordinates; pods: (rays * rings,) or (rows * columns,)."""
    found = 0.0
    if ti.static(kind == PLACES):
        turn = WHOLE / ear.cell_lon
        x, y = at[0], at[1]
        x -= ti.round((x - 0.5 * (ear.rings - 1)) / turn) * turn
        if x >= 0.0 and x <= ear.rings - 1.0 and y >= 0.0 and y <= ear.rays - 1.0:
            i, j = (
                ti.min(ti.cast(x, ti.i32), ear.rings - 2),
                ti.min(ti.cast(y, ti.i32), ear.rays - 2),
            )
            u, v, k = x - i, y - j, j * ear.rings + i
            low = pods[k] + u * (pods[k + 1] - pods[k])
            high = pods[k + ear.rings] + u * (pods[k + ear.rings + 1] - pods[k + ear.rings])
            found = low + v * (high - low)
    else:
        ring = (at.norm() - ear.nearest) / ear.between
        if ring <= ear.rings - 1.0:
            ring = ti.max(ring, 0.0)
            bearing, k = angles.atan2(at[0], at[1]), ti.min(ti.cast(ring, ti.i32), ear.rings - 2)
            low = listen.round_table(pods, ear.rays, ear.rings, k, bearing)
            high = listen.round_table(pods, ear.rays, ear.rings, k + 1, bearing)
            found = low + (ring - k) * (high - low)
    return found


@ti.func
def hazard(
    kind: ti.template(), ear: Ear, pods: ti.template(), a: f32x2, b: f32x2, lasting: ti.f32
) -> ti.f32:
    """Return the hazard accumulated on a stretch from a to b (see `where`) in `lasting` seconds."""
    total = 0.0
    if near(kind, ear, a, b, 0.0) == 1:
        d = b - a
        halves = 2.0 * ti.max(ti.abs(d[0]), ti.abs(d[1]))
        if ti.static(kind == ROUND):
            fine = 0.5 * ear.between
            if ear.rays > 1:  # close to the sensor the bearing changes fast
                share = ti.min(ti.max(-a.dot(d) / ti.max(d.dot(d), 1e-12), 0.0), 1.0)
                fine = ti.min(fine, ti.max(0.25 * (a + share * d).norm(), 0.03 * ear.between))
            halves = d.norm() / fine
        parts = ti.min(ti.max(ti.cast(ti.ceil(halves), ti.i32), 1), listen.MOST_PARTS)
        for k in range(parts):
            total -= ti.log(ti.max(1.0 - _pod(kind, ear, pods, a + (k + 0.5) / parts * d), LEAST))
        total *= ear.rate * lasting / parts
    return total


class Pods(NamedTuple):
    """Table of POD at one time, on the host."""

    kind: int  # ROUND or PLACES
    # float32, (rays, rings): bearings evenly spaced from north, ranges evenly spaced; or (rows,
    # columns), latitude and longitude ascending
    table: np.ndarray
    between: float  # [m] between rings; by place the shortest side of any cell
    rate: float  # [1/s] 1 / the time of exposure to which the POD refers
    nearest: float = 0.0  # [m] range of the first ring
    middle: tuple[int, int] = (0, 0)  # lon, lat of the table's middle [binary angle], by place
    # [binary angle] spacing of columns and of rows
    cell: tuple[float, float] = (1.0, 1.0)


def ear(stretch: Stretch, pods: Pods) -> Any:
    """Return the sensor and its table's geometry as the `Ear` that kernels take."""
    rays, rings = pods.table.shape
    place, to = (stretch.place, stretch.to) if pods.kind == ROUND else (pods.middle, pods.middle)
    return Ear(
        lon=place[0],
        lat=place[1],
        to_lon=to[0],
        to_lat=to[1],
        begin=stretch.begin,
        end=stretch.end,
        rays=rays,
        rings=rings,
        nearest=pods.nearest,
        between=pods.between,
        dense=1.0 / pods.between,
        paces=1,
        spread=1.0,
        unit=1.0,
        rate=pods.rate,
        turns=1,
        reach=0.0,
        moves=0.0,
        cell_lon=pods.cell[0],
        cell_lat=pods.cell[1],
    )
