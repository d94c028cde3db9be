"""What a sensor with a table of POD has seen of each particle: the hazard of the places where it
was.

The table is by place, or by bearing and range round the sensor. Where the POD is P the hazard is
-log(1 - P) a unit of time. Particles and sensor go straight within a step. A stretch of way is
taken in parts, at most 256, of half a cell of the table at the most, beside the sensor of a quarter
of the distance, each with the POD in its middle, bilinear between the table's entries. Beyond the
table nothing is seen.
"""

from typing import Any, NamedTuple

import numpy as np
import taichi as ti

from kernels.evidence import listen
from kernels.evidence.listen import Ear, Stretch, f32x2
from kernels.maths import angles

# a sonar (kernels.evidence.listen); POD by bearing and range; POD by place
HEARD, ROUND, PLACES = range(3)
LEAST = 1e-12  # smallest chance of a miss that has a hazard
FAR = 4.0  # strays of a part of a bridge beyond which it does not come
WHOLE = 4294967296.0  # a turn [binary angle]


@ti.func
def where(kind: ti.template(), ear: Ear, time: ti.f32, lon: ti.i32, lat: ti.i32) -> f32x2:
    """Return where a place [binary angle] is for a table at a time: columns and rows by place, else
    (east, north) [m].
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
    """Return the end b of a way from a, where columns of the table go on round the world."""
    if ti.static(kind == PLACES):
        turn = WHOLE / ear.cell_lon
        b[0] -= ti.round((b[0] - a[0]) / turn) * turn
    return b


@ti.func
def near(kind: ti.template(), ear: Ear, a: f32x2, b: f32x2, stray: ti.f32) -> ti.i32:
    """Return whether a bridge from a to b that strays [m] so far may come to where the table has
    anything.
    """
    found = 0
    if ti.static(kind == PLACES):
        far = FAR * stray / ear.between
        turn = WHOLE / ear.cell_lon
        middle = 0.5 * (ear.rings - 1)
        # columns from the middle of the table, the short way round
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
def pod(kind: ti.template(), ear: Ear, pods: ti.template(), at: f32x2) -> ti.f32:
    """Return the POD at a place as `where` gives it; pods: (rays * rings,), by place (rows *
    columns,).
    """
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
    """Return what the hazard adds up to on a stretch of way from a to b (see `where`) in so many
    seconds.
    """
    total = 0.0
    if near(kind, ear, a, b, 0.0) == 1:
        d = b - a
        halves = 2.0 * ti.max(ti.abs(d[0]), ti.abs(d[1]))
        if ti.static(kind == ROUND):
            fine = 0.5 * ear.between
            if ear.rays > 1:  # beside the sensor the bearing changes fast
                share = ti.min(ti.max(-a.dot(d) / ti.max(d.dot(d), 1e-12), 0.0), 1.0)
                fine = ti.min(fine, ti.max(0.25 * (a + share * d).norm(), 0.03 * ear.between))
            halves = d.norm() / fine
        parts = ti.min(ti.max(ti.cast(ti.ceil(halves), ti.i32), 1), listen.MOST_PARTS)
        for k in range(parts):
            total -= ti.log(ti.max(1.0 - pod(kind, ear, pods, a + (k + 0.5) / parts * d), LEAST))
        total *= ear.rate * lasting / parts
    return total


class Pods(NamedTuple):
    """A table of POD at a time, on the host."""

    kind: int  # ROUND or PLACES
    # float32 (rays, rings), rays evenly round from north, rings evenly; or (rows, columns), both
    # ascending
    table: np.ndarray
    between: float  # [m] from ring to ring; by place the lesser side of a cell where it is least
    rate: float  # [1/s]: 1 / the time for which the POD is there
    nearest: float = 0.0  # [m] of the first ring
    middle: tuple[int, int] = (0, 0)  # lon, lat [binary angle] of the middle of the table by place
    # [binary angle] of lon and lat from column to column, and row to row
    cell: tuple[float, float] = (1.0, 1.0)


def ear(stretch: Stretch, pods: Pods) -> Any:
    """Return a sensor as kernels take it."""
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
