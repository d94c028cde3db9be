"""First touch of a step with the coast, and whether a point is in the water.

The geometry is in exact integers, on the grid of geo.coast.edges.

Steps and shoreline edges are straight lines between lattice points of binary-angle lon-lat. Signs
of determinants are computed in 64-bit integers, so no answer depends on rounding; steps and edges
must be shorter than 2**29 units (45 degrees). A point on an edge is land, and a step that touches
an edge has crossed it. Everything outside the grid is water.
"""

import functools
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import taichi as ti

from geo.coast import edges as shore_grid
from kernels.runtime import launch, runtime

# lon0, lat0, shift, nx, ny, reference x, reference y of geo.coast.edges.Coast; then where edges,
# their numbers and the lines begin in `shoreline`.
Frame = ti.types.vector(10, ti.i32)
EDGES_AT, NUMBERS_AT, LINES_AT = 7, 8, 9  # indices of the last three
Bytes = ti.types.ndarray(dtype=ti.u8, ndim=1)
Ints = ti.types.ndarray(dtype=ti.i32, ndim=1)
Reals = ti.types.ndarray(dtype=ti.f32, ndim=1)

ONE = 1 << 30  # a whole step, in the fixed point of crossing fractions
NEVER = ONE + 1


Coast = ti.types.argpack(
    cell=Bytes,  # (ny * nx,)
    # Concatenated: where the edges of each cell begin in the list (ny * nx + 1,); edges as listed
    # by cell (4 * n,); the number of each (n,); the line of each number (4 * m,).
    shoreline=Ints,
    frame=Frame,
)


@dataclass(frozen=True, eq=False)
class DeviceCoast:
    """A geo.coast.Coast on the device."""

    pack: ti.ArgPack  # a `Coast`: what kernels take


def upload(coast: shore_grid.Coast) -> DeviceCoast:
    """Return the device copy of a coast."""
    tables = [
        np.ravel(a)
        for a in (coast.start, coast.edge, coast.edge_id, shore_grid.shoreline_edges(coast))
    ]
    begins = np.cumsum([table.size for table in tables[:-1]]).tolist()
    frame = Frame(
        [coast.lon0, coast.lat0, coast.shift, coast.nx, coast.ny, *coast.reference, *begins]
    )
    shoreline = runtime.upload(np.concatenate(tables, dtype=np.int32, casting="same_kind"))
    return DeviceCoast(launch.pack(Coast, runtime.upload(coast.cell), shoreline, frame))


@functools.cache
def open_sea() -> DeviceCoast:
    """Return a coast without cells, a placeholder for kernels compiled without a coast."""
    return DeviceCoast(
        launch.pack(Coast, runtime.empty(1, ti.u8), runtime.empty(1, ti.i32), Frame([0] * Frame.n))
    )


@ti.func
def is_wet(lon, lat, coast: ti.template()):
    """Return 1 if a point [binary angles] lies in the water of a `Coast`, else 0.

    The edges between the point and the reference point of its cell are counted: if their number is
    odd, the two lie on different sides of the shore. An end of an edge on the line from the
    reference to the point counts as right of it (half-open), so a line through a vertex crosses
    once or not at all.
    """
    cell, line = ti.static(coast.cell, coast.shoreline)
    frame = coast.frame
    shift = frame[2]
    column = ti.cast(ti.bit_shr(ti.cast(lon - frame[0], ti.u32), shift), ti.i32)
    row = ti.cast((ti.cast(lat, ti.i64) - frame[1]) >> shift, ti.i32)
    wet = 1
    if column < frame[3] and row >= 0 and row < frame[4]:
        c = row * frame[3] + column
        if cell[c] >= ti.u8(128):
            wet = 0
        rlon = frame[0] + (column << shift) + frame[5]
        rlat = frame[1] + (row << shift) + frame[6]
        px = ti.cast(lon - rlon, ti.i64)
        py = ti.cast(lat - rlat, ti.i64)
        on_edge = 0
        for e in range(line[c], line[c + 1]):
            k = frame[EDGES_AT] + 4 * e
            ax = ti.cast(line[k] - rlon, ti.i64)
            ay = ti.cast(line[k + 1] - rlat, ti.i64)
            bx = ti.cast(line[k + 2] - rlon, ti.i64)
            by = ti.cast(line[k + 3] - rlat, ti.i64)
            side_a = px * ay - py * ax
            side_b = px * by - py * bx
            of_reference = ax * by - ay * bx
            of_point = of_reference + side_a - side_b
            if of_point == 0:
                if ti.min(ax, bx) <= px <= ti.max(ax, bx) and ti.min(ay, by) <= py <= ti.max(
                    ay, by
                ):
                    on_edge = 1
            elif (side_a > 0) != (side_b > 0) and (of_reference > 0) != (of_point > 0):
                wet = 1 - wet
        if on_edge == 1:
            wet = 0
    return wet


@ti.func
def _fraction(sx, sy, ax, ay, bx, by):
    """Return the share of step (0, 0)-(sx, sy) at its first touch of edge A-B, in units of 2**-30.

    NEVER without a touch.
    """
    at = NEVER
    side_a = sx * ay - sy * ax
    side_b = sx * by - sy * bx
    of_start = ax * by - ay * bx
    of_stop = of_start + side_a - side_b
    apart = (side_a > 0 and side_b > 0) or (side_a < 0 and side_b < 0)
    if not (apart or (of_start > 0 and of_stop > 0) or (of_start < 0 and of_stop < 0)):
        num = of_start
        den = side_b - side_a
        if den == 0:  # step and edge on one line: the nearer end of the edge
            along_a = sx * ax + sy * ay
            along_b = sx * bx + sy * by
            den = sx * sx + sy * sy
            num = ti.min(along_a, along_b)
        if den < 0:
            num = -num
            den = -den
        if 0 <= num <= den:
            while den >= ti.cast(1, ti.i64) << 33:  # make room for the 30 bits of the fraction
                num = num >> 2
                den = den >> 2
            at = ti.cast((num << 30) // den, ti.i32)
    return at


@ti.func
def _first(lon, lat, sx, sy, coast: ti.template()):
    """Return (fraction in 2**-30, index in the list of edges) of a step's first touch.

    The cells on the step are visited row by row: in each row, the columns between where the step
    enters and leaves it.
    """
    line = ti.static(coast.shoreline)
    frame = coast.frame
    shift = frame[2]
    around = (1 << (32 - shift)) - 1  # columns in a turn, less one: a mask that wraps longitude
    x0 = ti.cast(ti.cast(lon - frame[0], ti.u32), ti.i64)
    y0 = ti.cast(lat, ti.i64) - frame[1]
    row = ti.cast(y0 >> shift, ti.i32)
    last = ti.cast((y0 + sy) >> shift, ti.i32)
    x_in = x0
    best = NEVER
    struck = -1
    going = 1
    while going == 1:
        x_out = x0 + sx
        if row != last:
            top = ti.cast(row + (1 if sy > 0 else 0), ti.i64) << shift
            x_out = x0 + (sx * (top - y0)) // sy
        if row >= 0 and row < frame[4]:
            left = ti.cast(ti.min(x_in, x_out) >> shift, ti.i32)
            right = ti.cast(ti.max(x_in, x_out) >> shift, ti.i32)
            for k in range(left, right + 1):
                column = k & around
                if column < frame[3]:
                    c = row * frame[3] + column
                    for e in range(line[c], line[c + 1]):
                        first = frame[EDGES_AT] + 4 * e
                        at = _fraction(
                            sx,
                            sy,
                            ti.cast(line[first] - lon, ti.i64),
                            ti.cast(line[first + 1] - lat, ti.i64),
                            ti.cast(line[first + 2] - lon, ti.i64),
                            ti.cast(line[first + 3] - lat, ti.i64),
                        )
                        if at < best:
                            best = at
                            struck = e
        x_in = x_out
        if row == last:
            going = 0
        row += 1 if sy > 0 else -1
    return best, struck


# Poleward of this latitude [binary angle, 84.5 degrees], no shore can be reached by sea.
POLEWARD = 1_008_000_000


@ti.func
def clearance(lon, lat, coast: ti.template()):
    """Return a distance [binary angle] along each axis within which no move meets the coast.

    0 means unknown. It costs one look-up of a cell's byte, and no branch.
    """
    frame = coast.frame
    column = ti.cast(ti.bit_shr(ti.cast(lon - frame[0], ti.u32), frame[2]), ti.i32)
    row = ti.cast((ti.cast(lat, ti.i64) - frame[1]) >> frame[2], ti.i32)
    inside = (column < frame[3]) & (row >= 0) & (row < frame[4])
    away = ti.cast(coast.cell[ti.select(inside, row * frame[3] + column, 0)], ti.i32) & 127
    # A move of k cell widths ends at most k cells away, wherever in the cell it begins; k < away is
    # clear.
    return ti.select(inside, (away - 1) << frame[2], 0)


@ti.func
def is_clear(lon, lat, reach, coast: ti.template()):
    """Return 1 if no move of at most `reach` units along each axis can meet the coast."""
    return (reach == 0) | (reach <= clearance(lon, lat, coast))


@ti.func
def first_crossing(lon, lat, dlon, dlat, coast: ti.template()):
    """Return (hit, lon, lat, fraction, edge_id): the end of a step (dlon, dlat) from water.

    Without a hit: (0, the step's end, 1.0, -1). With a hit: the last lattice point [binary angles]
    in water before the crossing (verified: the path to it touches no edge; at worst the start), the
    crossing's fraction of the step, and the number of the shoreline edge. In open sea it costs one
    look-up: a cell's byte holds the distance of the coast. A kernel that needs it several times
    should call it in a loop: each call in the source costs half a second of compilation.
    """
    hit = 0
    stop_lon = lon + dlon
    stop_lat = lat + dlat
    fraction = ti.cast(1.0, ti.f32)
    number = -1
    reach = ti.max(abs(dlon), abs(dlat))
    if not is_clear(lon, lat, reach, coast):
        sx = ti.cast(dlon, ti.i64)
        sy = ti.cast(dlat, ti.i64)
        along = reach  # length of the step up to the point tried, along its longer side
        back = 0
        seeking = 1
        while seeking == 1:
            at, struck = _first(lon, lat, sx, sy, coast)
            if at == NEVER:
                seeking = 0
            elif back == 0:
                hit = 1
                fraction = ti.cast(at, ti.f32) * ti.cast(1.0 / ONE, ti.f32)
                number = coast.shoreline[coast.frame[NUMBERS_AT] + struck]
                along = ti.cast((ti.cast(at, ti.i64) * reach) >> 30, ti.i32)
                back = 1
            else:
                along -= back
                back *= 2
            if hit == 1 and seeking == 1:
                if along <= 0:
                    along = 0
                    seeking = 0
                # Round towards the start. The point may still lie across an edge, so the path to it
                # is tested as a step.
                sx = ti.cast(abs(dlon), ti.i64) * along // reach
                sy = ti.cast(abs(dlat), ti.i64) * along // reach
                if dlon < 0:
                    sx = -sx
                if dlat < 0:
                    sy = -sy
        stop_lon = lon + ti.cast(sx, ti.i32)
        stop_lat = lat + ti.cast(sy, ti.i32)
    return hit, stop_lon, stop_lat, fraction, number


@ti.kernel
def _wet(lon: Ints, lat: Ints, wet: Ints, coast: Coast):
    for i in range(lon.shape[0]):
        wet[i] = is_wet(lon[i], lat[i], coast)


@ti.kernel
def _crossings(
    lon: Ints,
    lat: Ints,
    dlon: Ints,
    dlat: Ints,
    hit: Ints,
    stop_lon: Ints,
    stop_lat: Ints,
    fraction: Reals,
    number: Ints,
    coast: Coast,
):
    for i in range(lon.shape[0]):
        hit[i], stop_lon[i], stop_lat[i], fraction[i], number[i] = first_crossing(
            lon[i], lat[i], dlon[i], dlat[i], coast
        )


@ti.kernel
def _meets(lon: Ints, lat: Ints, dlon: Ints, dlat: Ints, fraction: Reals, coast: Coast):
    for i in range(lon.shape[0]):
        met = ti.f32(ti.math.inf)
        if not is_clear(lon[i], lat[i], ti.max(abs(dlon[i]), abs(dlat[i])), coast):
            at, _ = _first(
                lon[i], lat[i], ti.cast(dlon[i], ti.i64), ti.cast(dlat[i], ti.i64), coast
            )
            if at != NEVER:
                met = ti.cast(at, ti.f32) * ti.cast(1.0 / ONE, ti.f32)
        # written for every step: a graphics card copies the whole array back, but not to the card
        fraction[i] = met


class Crossings(NamedTuple):
    """Ends of steps, shape (n,) each."""

    hit: np.ndarray  # bool
    lon: np.ndarray  # int32, where the step ends [binary angle]
    lat: np.ndarray
    fraction: np.ndarray  # float32, of the step, where the crossing is; 1 without one
    edge_id: np.ndarray  # int32, -1 without a crossing


def wet(coast: DeviceCoast, lon: np.ndarray, lat: np.ndarray) -> np.ndarray:
    """Return whether points [binary angles], shape (n,), lie in water."""
    lon, lat = (np.ascontiguousarray(a, np.int32) for a in (lon, lat))
    out = np.ones(lon.size, np.int32)
    if lon.size:
        _wet(*runtime.residents(lon, lat), out, coast.pack)
    return out == 1


def meets(
    coast: DeviceCoast, lon: np.ndarray, lat: np.ndarray, dlon: np.ndarray, dlat: np.ndarray
) -> np.ndarray:
    """Return the share of each step at its first touch of the coast; inf without a touch.

    Steps start at wet points. Points and steps are binary angles of shape (n,).
    """
    steps = [np.ascontiguousarray(a, np.int32) for a in (lon, lat, dlon, dlat)]
    fraction = np.full(steps[0].size, np.inf, np.float32)
    if fraction.size:
        _meets(*runtime.residents(*steps), fraction, coast.pack)
    return fraction


def crossings(
    coast: DeviceCoast, lon: np.ndarray, lat: np.ndarray, dlon: np.ndarray, dlat: np.ndarray
) -> Crossings:
    """Return the ends of steps from wet points [binary angles], shape (n,).

    A step ends at the coast if it meets it.
    """
    steps = [np.ascontiguousarray(a, np.int32) for a in (lon, lat, dlon, dlat)]
    n = steps[0].size
    hit, stop_lon, stop_lat, number = (np.zeros(n, np.int32) for _ in range(4))
    fraction = np.ones(n, np.float32)
    if n:
        _crossings(
            *runtime.residents(*steps), hit, stop_lon, stop_lat, fraction, number, coast.pack
        )
    return Crossings(hit == 1, stop_lon, stop_lat, fraction, number)
