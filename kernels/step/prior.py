"""Draw initial positions and release times from a position report, an area or a trackline.

All positions are in water. Each slot tries up to TRIES candidates of its own random stream and
keeps the first one in water: the prior conditioned on water. The number of candidates gives the
share of the prior that was on land.

first, last: the slots, from the first to before the last; number: of the first one in the whole
run, the key of its noise.
"""

from typing import Any

import taichi as ti

from kernels.maths import angles, noise, sphere
from kernels.runtime import rows
from kernels.step.coast import Coast, Ints, Reals, is_wet

TRIES = 4096  # even a prior with only 1 % of water fails with a probability of 1e-18 only
# most draws of a slope: at least half of all draws pass, so that all fail with probability 2**-64
# at most
REDRAWS = 64
# leeway lines of an object: the first draw of line k has number k in its stream, the next one k +
# LINES
LINES = 3

# hazard across a track: at so many places, to so many standard deviations on either side
ACROSS, WIDEST = 33, 4.0

f32x2 = ti.types.vector(2, ti.f32)
I64s = ti.types.ndarray(dtype=ti.i64, ndim=1)


@ti.func
def _wrapped_normal(
    lon: ti.i32, lat: ti.i32, n: f32x2, major: ti.f32, minor: ti.f32, orientation: ti.f32
):
    """Return a position displaced by a bivariate normal in the tangent plane.

    orientation: of the major axis, clockwise from north [rad].
    """
    along, across = major * n[0], minor * n[1]
    s, c = angles.sincos(orientation)
    return sphere.exponential(lon, lat, along * s + across * c, along * c - across * s)


@ti.kernel
def draw_position(
    coastal: ti.template(),
    first: ti.i32,
    last: ti.i32,
    number: ti.i32,
    lon: Ints,
    lat: Ints,
    tries: I64s,
    seed0: ti.u32,
    seed1: ti.u32,
    lon0: ti.i32,
    lat0: ti.i32,
    major: ti.f32,
    minor: ti.f32,
    orientation: ti.f32,
    nearest: ti.f32,
    farthest: ti.f32,
    bearing: ti.f32,
    sector: ti.f32,
    coast: Coast,
):
    """Draw positions [binary angle] around (lon0, lat0): bivariate normal plus a displacement.

    major, minor [m] and orientation [rad from north]: standard deviations of the report. nearest,
    farthest [m]: range of the displacement's uniform distance; bearing, sector [rad]: begin and
    width of its uniform direction. tries[0] += candidates drawn, tries[1] += slots without a
    candidate in water.
    """
    for i in range(first, last):
        found = 0
        k = 0
        while found == 0 and k < TRIES:
            w = noise.noise_words(seed0, seed1, noise.STREAM_PRIOR, number + i - first, k)
            x, y = _wrapped_normal(lon0, lat0, noise.normals(w[0], w[1]), major, minor, orientation)
            if farthest > 0.0:
                length = nearest + (farthest - nearest) * noise.uniform(w[2])
                angle = bearing + sector * noise.uniform(w[3])
                s, c = angles.sincos(angle)
                x, y = sphere.exponential(x, y, length * s, length * c)
            k += 1
            found = 1
            if ti.static(coastal):
                found = is_wet(x, y, coast)
            lon[i], lat[i] = x, y
        tries[0] += k
        tries[1] += 1 - found


@ti.func
def inside_ring(
    lon: ti.i32, lat: ti.i32, west: ti.i32, vertices: ti.template(), first: ti.i32, n: ti.i32
):
    """Return 1 inside a polygon, else 0.

    vertices: [lon0, lat0, lon1, ...], of which n from number `first` on belong to the polygon;
    west: a longitude west of all of it, by less than a turn.

    Crossings are counted exactly, in 64-bit integers.
    """
    x, y = ti.cast(ti.cast(lon - west, ti.u32), ti.i64), ti.cast(lat, ti.i64)
    odd = 0
    for j in range(n):
        k = j + 1 if j + 1 < n else 0
        a, b = 2 * (first + j), 2 * (first + k)
        xa = ti.cast(ti.cast(vertices[a] - west, ti.u32), ti.i64)
        xb = ti.cast(ti.cast(vertices[b] - west, ti.u32), ti.i64)
        ya, yb = ti.cast(vertices[a + 1], ti.i64), ti.cast(vertices[b + 1], ti.i64)
        if (ya > y) != (yb > y):
            # The edge crosses the point's parallel; count it if the crossing lies east of the
            # point.
            turn = (xb - xa) * (y - ya) - (x - xa) * (yb - ya)
            if (turn > 0) == (yb > ya):
                odd = 1 - odd
    return odd


@ti.kernel
def draw_area(
    coastal: ti.template(),
    first: ti.i32,
    last: ti.i32,
    number: ti.i32,
    lon: Ints,
    lat: Ints,
    tries: I64s,
    seed0: ti.u32,
    seed1: ti.u32,
    vertices: Ints,
    west: ti.i32,
    south: ti.i32,
    width: ti.u32,
    height: ti.u32,
    broadest: ti.f32,
    coast: Coast,
):
    """Draw positions uniform in true area inside a polygon.

    The polygon's sides are straight in lon-lat, so that parallels stay parallels.

    west, south, width, height: its bounding box [binary angle]; broadest: the largest cos(lat) in
    it. tries[0] += candidates inside the polygon, tries[1] += slots without a candidate in water.
    """
    for i in range(first, last):
        # counted here and added once: particles leave this loop at different times
        found, inside = 0, 0
        k = 0
        while found == 0 and k < 16 * TRIES:
            w = noise.noise_words(seed0, seed1, noise.STREAM_PRIOR, number + i - first, k)
            k += 1
            x = west + ti.cast(ti.cast(w[0], ti.u64) * ti.cast(width, ti.u64) >> ti.u64(32), ti.i32)
            y = south + ti.cast(
                ti.cast(w[1], ti.u64) * ti.cast(height, ti.u64) >> ti.u64(32), ti.i32
            )
            # Uniform in lon and lat, thinned by cos(lat): uniform on the sphere without rounding of
            # sin(lat).
            if (
                noise.uniform(w[2]) * broadest < sphere.cos_lat(y)
                and inside_ring(x, y, west, vertices, 0, vertices.shape[0] // 2) == 1
            ):
                inside += 1
                found = 1
                if ti.static(coastal):
                    found = is_wet(x, y, coast)
                lon[i], lat[i] = x, y
        tries[0] += inside
        tries[1] += 1 - found


@ti.func
def _first_from(proposed: ti.template(), u: ti.f32):
    """Return the first cell whose cumulated probability reaches u."""
    low, high = 0, proposed.shape[0] - 2
    while low < high:
        middle = (low + high) // 2
        if proposed[middle + 1] < u:
            low = middle + 1
        else:
            high = middle
    return low


@ti.func
def _hazard_at(hazard: ti.template(), row: ti.i32, along: ti.f32, aside: ti.f32):
    """Return the hazard at a share of a cell along the track, bilinear.

    aside: distance across the track [standard deviations]; beyond WIDEST as there.
    """
    a = ti.min(ti.max(along, 0.0), 1.0)
    column = (aside + WIDEST) * ((ACROSS - 1) / (2.0 * WIDEST))
    column = ti.min(ti.max(column, 0.0), ACROSS - 1.0)
    j = ti.min(ti.cast(column, ti.i32), ACROSS - 2)
    b = column - j
    at = row * ACROSS + j
    near = (1.0 - b) * hazard[at] + b * hazard[at + 1]
    far = (1.0 - b) * hazard[at + ACROSS] + b * hazard[at + ACROSS + 1]
    return (1.0 - a) * near + a * far


@ti.kernel
def draw_trackline(
    coastal: ti.template(),
    first: ti.i32,
    last: ti.i32,
    number: ti.i32,
    lon: Ints,
    lat: Ints,
    release: Ints,
    tries: I64s,
    seed0: ti.u32,
    seed1: ti.u32,
    points: Ints,
    courses: Reals,
    lengths: Reals,
    ends: Reals,
    cross_track: ti.f32,
    earliest: ti.f32,
    latest: ti.f32,
    mode: ti.f32,
    departure: ti.i32,
    voyage: ti.f32,
    tilted: ti.template(),
    law: Reals,
    proposed: Reals,
    most: Reals,
    hazard: Reals,
    coast: Coast,
):
    """Draw the share of the voyage completed at the time of distress, and the position there.

    The position gets a cross-track error. points [lon0, lat0, ...]: begins of short great-circle
    pieces; courses [rad], lengths [m] and ends (share of the voyage completed at the piece's end),
    one per piece. The share is uniform over [earliest, latest], or triangular with its peak at mode
    if mode >= 0. release [s after start] = departure + share * voyage. cross_track: standard
    deviation [m].

    tilted: the density is multiplied by a hazard. The time between earliest and latest has n cells,
    with law and proposed (n + 1): the cumulated law of the share, and of the cells as they are
    proposed, by the greatest hazard in each, most (n). hazard ((n + 1) * ACROSS): at the ends of
    the cells, from -WIDEST to WIDEST standard deviations across the track. A candidate is kept in
    proportion to its hazard; only what is kept counts as tried.
    """
    for i in range(first, last):
        found = 0
        k = 0
        kept = 0
        while found == 0 and k < TRIES:
            w = noise.noise_words(seed0, seed1, noise.STREAM_PRIOR, number + i - first, k)
            k += 1
            u = noise.uniform(w[0])
            which = 0
            if ti.static(tilted):
                which = _first_from(proposed, u)
                share_of_cell = (u - proposed[which]) / ti.max(
                    proposed[which + 1] - proposed[which], 1e-30
                )
                u = law[which] + share_of_cell * (law[which + 1] - law[which])
            share = earliest + (latest - earliest) * u
            if mode >= 0.0:
                peak = (mode - earliest) / (latest - earliest)
                t = ti.sqrt(u * peak) if u < peak else 1.0 - ti.sqrt((1.0 - u) * (1.0 - peak))
                share = earliest + (latest - earliest) * t
            low, high = 0, ends.shape[0] - 1
            while low < high:
                middle = (low + high) // 2
                if ends[middle] < share:
                    low = middle + 1
                else:
                    high = middle
            begin = 0.0
            if low > 0:
                begin = ends[low - 1]
            along = lengths[low] * (share - begin) / ti.max(ends[low] - begin, 1e-12)
            s, c = angles.sincos(courses[low])
            x, y = sphere.exponential(points[2 * low], points[2 * low + 1], along * s, along * c)
            aside = noise.normals(w[2], w[3])[0]
            off = cross_track * aside
            x, y = sphere.exponential(x, y, off * c, -off * s)
            found = 1
            if ti.static(tilted):
                passed = (share - earliest) / ti.max(latest - earliest, 1e-30)
                there = _hazard_at(hazard, which, passed * most.shape[0] - which, aside)
                if noise.uniform(w[1]) * most[which] >= there:
                    found = 0
            kept += found
            if ti.static(coastal):
                if found == 1:
                    found = is_wet(x, y, coast)
            lon[i], lat[i] = x, y
            release[i] = departure + ti.cast(ti.round(share * voyage), ti.i32)
        tries[0] += kept
        tries[1] += 1 - found


@ti.kernel
def draw_release(
    first: ti.i32,
    last: ti.i32,
    number: ti.i32,
    release: Ints,
    seed0: ti.u32,
    seed1: ti.u32,
    earliest: ti.i32,
    latest: ti.i32,
):
    """Draw release times [s after start], uniform over the whole seconds of [earliest, latest]."""
    for i in range(first, last):
        w = noise.noise_words(seed0, seed1, noise.STREAM_PRIOR, number + i - first, -1)
        span = ti.cast(latest - earliest + 1, ti.u64)
        release[i] = earliest + ti.cast(ti.cast(w[0], ti.u64) * span >> ti.u64(32), ti.i32)


@ti.kernel
def _draw_object(
    first: ti.i32,
    last: ti.i32,
    number: ti.i32,
    slope: Reals,
    slope_at: ti.i32,
    offset: Reals,
    offset_at: ti.i32,
    line: ti.i32,
    seed0: ti.u32,
    seed1: ti.u32,
    mean_slope: ti.f32,
    mean_offset: ti.f32,
    slope_std: ti.f32,
    offset_std: ti.f32,
    least: ti.f32,
):
    """See `draw_object`; slope_at, offset_at: first element of the column in its array."""
    for i in range(first, last):
        own, n = least, (least - mean_slope) / ti.max(slope_std, 1e-30)
        k, found = 0, 0
        while found == 0 and k < REDRAWS:
            w = noise.noise_words(
                seed0, seed1, noise.STREAM_OBJECT, number + i - first, line + k * LINES
            )
            drawn = noise.normals(w[0], w[1])[0]
            k += 1
            if mean_slope + slope_std * drawn >= least:
                own, n, found = mean_slope + slope_std * drawn, drawn, 1
        slope[slope_at + i] = own
        offset[offset_at + i] = mean_offset + offset_std * n


def draw_object(
    first: int,
    last: int,
    number: int,
    slope: Any,
    offset: Any,
    line: int,
    seed0: int,
    seed1: int,
    mean_slope: float,
    mean_offset: float,
    slope_std: float,
    offset_std: float,
    least: float,
) -> None:
    """Draw each particle's slope and offset [m/s] of one leeway line, from one normal number.

    The standard deviation at wind speed W is slope_std W + offset_std (Breivik and Allen 2008,
    doi:10.1016/j.jmarsys.2007.02.010). A slope below `least` is drawn again together with its
    offset, which truncates the normal distribution there (docs/leeway.md). At most half of the
    distribution may lie below. A slope that fails REDRAWS times is set to `least`.
    """
    law = mean_slope, mean_offset, slope_std, offset_std, least
    _draw_object(
        first, last, number, *rows.located(slope), *rows.located(offset), line, seed0, seed1, *law
    )


@ti.kernel
def draw_side(
    first: ti.i32, last: ti.i32, number: ti.i32, side: Ints, seed0: ti.u32, seed1: ti.u32
):
    """Draw the side to which each object first drifts off the wind: +1 right or -1 left, evenly."""
    for i in range(first, last):
        w = noise.noise_words(seed0, seed1, noise.STREAM_OBJECT, number + i - first, -1)
        side[i] = 1 - 2 * ti.cast(w[0] >> ti.u32(31), ti.i32)


@ti.kernel
def _draw_error(
    first: ti.i32,
    last: ti.i32,
    number: ti.i32,
    east: Reals,
    east_at: ti.i32,
    north: Reals,
    north_at: ti.i32,
    which: ti.i32,
    seed0: ti.u32,
    seed1: ti.u32,
    std: ti.f32,
):
    """See `draw_error`; east_at, north_at: first element of the column in its array."""
    for i in range(first, last):
        w = noise.noise_words(seed0, seed1, noise.STREAM_ERROR, number + i - first, which)
        n = noise.normals(w[0], w[1])
        east[east_at + i], north[north_at + i] = std * n[0], std * n[1]


def draw_error(
    first: int,
    last: int,
    number: int,
    east: Any,
    north: Any,
    which: int,
    seed0: int,
    seed1: int,
    std: float,
) -> None:
    """Draw errors [m/s], normal with standard deviation `std` per component.

    which: 0 for errors of the current, 1 for errors of the wind, 2 for biases of the current.
    """
    _draw_error(
        first, last, number, *rows.located(east), *rows.located(north), which, seed0, seed1, std
    )


@ti.kernel
def draw_objects(
    coastal: ti.template(),
    first: ti.i32,
    last: ti.i32,
    number: ti.i32,
    per_world: ti.i32,
    lon: Ints,
    lat: Ints,
    release: Ints,
    world: Ints,
    tries: I64s,
    seed0: ti.u32,
    seed1: ti.u32,
    world_lon: Ints,
    world_lat: Ints,
    world_release: Ints,
    scatter: ti.f32,
    lasting: ti.f32,
    coast: Coast,
):
    """Draw the objects of worlds, per_world slots each, around the world's release [binary angle].

    They are released from the time of the world's release on. The slots are those of one class,
    from its first world here on; number: of its first slot in the whole run, for the random
    numbers.

    scatter [m]: standard deviation of a component; lasting [s]: duration over which releases are
    uniform. tries[0] += candidates drawn, tries[1] += slots without a candidate in water, which
    start at their world's release itself.
    """
    for i in range(first, last):
        k = (i - first) // per_world
        world[i] = k
        found = 0
        tried = 0
        while found == 0 and tried < TRIES:
            w = noise.noise_words(seed0, seed1, noise.STREAM_RELEASE, number + i - first, tried)
            tried += 1
            n = noise.normals(w[0], w[1]) * scatter
            x, y = sphere.exponential(world_lon[k], world_lat[k], n[0], n[1])
            found = 1
            if ti.static(coastal):
                found = is_wet(x, y, coast)
            lon[i], lat[i] = x, y
            release[i] = world_release[k] + ti.cast(lasting * noise.uniform(w[2]), ti.i32)
        if found == 0:
            lon[i], lat[i] = world_lon[k], world_lat[k]
        tries[0] += tried
        tries[1] += 1 - found


@ti.kernel
def draw_lost(
    coastal: ti.template(),
    first: ti.i32,
    last: ti.i32,
    number: ti.i32,
    per_world: ti.i32,
    lon: Ints,
    lat: Ints,
    release: Ints,
    world: Ints,
    tries: I64s,
    seed0: ti.u32,
    seed1: ti.u32,
    world_lon: Ints,
    world_lat: Ints,
    begin: Ints,
    length: Reals,
    clock: Reals,
    ends: Reals,
    points: Ints,
    steps: Reals,
    times: Ints,
    parts: Reals,
    scatter: ti.f32,
    coast: Coast,
):
    """Draw the objects of worlds, each at the ship's place on its track at its own release time.

    As draw_objects; begin [s after start] and length [s] of each loss, world after world; clock
    [s]: by how much the ship's is fast in a world; ends: sums of the shares of the losses.

    points [binary angle] and steps [m] (east, north): starts and vectors of the track's pieces;
    times [s after start], by the ship's clock: of their starts and of the last end, whole seconds,
    to which `parts` [s] are added.
    """
    for i in range(first, last):
        k = (i - first) // per_world
        world[i] = k
        found = 0
        tried = 0
        while found == 0 and tried < TRIES:
            w = noise.noise_words(seed0, seed1, noise.STREAM_RELEASE, number + i - first, tried)
            tried += 1
            u = noise.uniform(w[3])
            loss = 0
            while loss < ends.shape[0] - 1 and u >= ends[loss]:
                loss += 1
            at = k * ends.shape[0] + loss
            release[i] = begin[at] + ti.cast(length[at] * noise.uniform(w[2]), ti.i32)
            low, high = 0, times.shape[0] - 2
            whole = ti.cast(ti.floor(clock[k]), ti.i32)
            shown = release[i] + whole
            part = clock[k] - ti.cast(whole, ti.f32)
            while low < high:
                middle = (low + high + 1) // 2
                if times[middle] < shown or (times[middle] == shown and parts[middle] <= part):
                    low = middle
                else:
                    high = middle - 1
            past = ti.cast(shown - times[low], ti.f32) + part
            lasts = ti.cast(times[low + 1] - times[low], ti.f32) + (parts[low + 1] - parts[low])
            share = (past - parts[low]) / lasts
            if low == 0:  # before the track begins
                share = ti.max(share, 0.0)
            if low == times.shape[0] - 2:  # after it has ended
                share = ti.min(share, 1.0)
            x, y = sphere.exponential(
                points[2 * low],
                points[2 * low + 1],
                share * steps[2 * low],
                share * steps[2 * low + 1],
            )
            n = noise.normals(w[0], w[1]) * scatter
            x, y = sphere.exponential(x, y, n[0], n[1])
            found = 1
            if ti.static(coastal):
                found = is_wet(x, y, coast)
            lon[i], lat[i] = x, y
        if found == 0:
            lon[i], lat[i] = world_lon[k], world_lat[k]
        tries[0] += tried
        tries[1] += 1 - found


@ti.kernel
def _draw_immersion(
    first: ti.i32,
    last: ti.i32,
    number: ti.i32,
    slope: Reals,
    slope_at: ti.i32,
    seed0: ti.u32,
    seed1: ti.u32,
    low: ti.f32,
    high: ti.f32,
    ratio: ti.f32,
):
    """See `draw_immersion`; slope_at: first element of the column in its array."""
    for i in range(first, last):
        w = noise.noise_words(seed0, seed1, noise.STREAM_OBJECT, number + i - first, -2)
        immersion = low + (high - low) * noise.uniform(w[0])
        slope[slope_at + i] = ratio * ti.sqrt((1.0 - immersion) / immersion)


def draw_immersion(
    first: int,
    last: int,
    number: int,
    slope: Any,
    seed0: int,
    seed1: int,
    low: float,
    high: float,
    ratio: float,
) -> None:
    """Draw each object's immersion I, uniform in [low, high], and write its downwind slope.

    The slope is ratio * sqrt((1 - I) / I).
    """
    _draw_immersion(first, last, number, *rows.located(slope), seed0, seed1, low, high, ratio)


@ti.kernel
def _scale_windage(
    first: ti.i32, last: ti.i32, column: Reals, column_at: ti.i32, world: Ints, factor: Reals
):
    """See `scale_windage`; column_at: first element of the column in its array."""
    for i in range(first, last):
        column[column_at + i] *= factor[world[i]]


def scale_windage(first: int, last: int, column: Any, world: Any, factor: Any) -> None:
    """Multiply a column of leeway by the factor of each particle's world, in place."""
    _scale_windage(first, last, *rows.located(column), world, factor)


@ti.kernel
def draw_sinking(
    first: ti.i32,
    last: ti.i32,
    number: ti.i32,
    sink_time: Ints,
    release: Ints,
    world: Ints,
    seed0: ti.u32,
    seed1: ti.u32,
    time: Reals,
    spread: ti.f32,
):
    """Draw when each object sinks [s after start].

    The time afloat is lognormal with median time[world] [s], or follows a constant hazard.

    spread: standard deviation of the time's logarithm; 0 for a hazard of half-life time[world]. An
    infinite time means never.
    """
    for i in range(first, last):
        w = noise.noise_words(seed0, seed1, noise.STREAM_OBJECT, number + i - first, -3)
        after = time[world[i]]
        if spread > 0.0:
            after *= ti.exp(spread * noise.normals(w[0], w[1])[0])
        else:
            # per half-life: 1 / ln 2
            after *= -ti.log(noise.uniform(w[0])) * ti.f32(1.4426950408889634)
        sink_time[i] = ti.cast(ti.min(ti.cast(release[i], ti.f32) + after, 2.0e9), ti.i32)
