"""Effect of the shore on a step: touches on the way, time of landing, sliding, refloating.

Where a step meets the shore is exact (kernels.step.coast). What happens there is computed in
float32 metres on the plane tangent at the particle, with the shore near it approximated by a
straight line.
"""

import taichi as ti

from kernels.maths import noise, sphere
from kernels.step import curve
from kernels.step.coast import EDGES_AT, LINES_AT, first_crossing, is_clear

METRES = sphere.RADIUS * sphere.UNIT  # [m] of a binary angle unit along a meridian
# [m] distance that a sliding particle keeps from the shore, so that rounding does not strand it
OFF = 0.5
# [m] standard deviation of a walk's pieces near the shore, which resolves islets and channels of
# that size
PIECE = 150.0
MOST_PIECES = 64
# [m] length of the pieces of a path that may slide: after a corner, the rest of a piece continues
# along the old edge
SLID = 50.0
CORNERS = 6  # most edges that a step slides along

f32x2 = ti.types.vector(2, ti.f32)
f32x3 = ti.types.vector(3, ti.f32)


@ti.func
def nearest(lon, lat, reach, c, coast: ti.template()) -> f32x3:
    """Return (distance, east, north) [m] from a point to the nearest shore within reach [m].

    c: cosine of the latitude. A distance above reach means that there is none.
    """
    line = ti.static(coast.shoreline)
    frame = coast.frame
    shift = frame[2]
    around = (1 << (32 - shift)) - 1
    tall = ti.cast(reach * ti.f32(1.0 / METRES), ti.i64) + 1
    wide = ti.cast(reach / (c * ti.f32(METRES)), ti.i64) + 1
    x0 = ti.cast(ti.cast(lon - frame[0], ti.u32), ti.i64)
    y0 = ti.cast(lat, ti.i64) - frame[1]
    best, east, north = reach * reach * 1.0001 + 1e-6, 0.0, 0.0
    limit = best
    for row in range(
        ti.cast((y0 - tall) >> shift, ti.i32), ti.cast((y0 + tall) >> shift, ti.i32) + 1
    ):
        if row >= 0 and row < frame[4]:
            for k in range(
                ti.cast((x0 - wide) >> shift, ti.i32), ti.cast((x0 + wide) >> shift, ti.i32) + 1
            ):
                column = k & around
                if column < frame[3]:
                    i = row * frame[3] + column
                    for e in range(line[i], line[i + 1]):
                        first = frame[EDGES_AT] + 4 * e
                        ax = ti.cast(line[first] - lon, ti.f32) * (c * ti.f32(METRES))
                        ay = ti.cast(line[first + 1] - lat, ti.f32) * ti.f32(METRES)
                        dx = ti.cast(line[first + 2] - line[first], ti.f32) * (c * ti.f32(METRES))
                        dy = ti.cast(line[first + 3] - line[first + 1], ti.f32) * ti.f32(METRES)
                        t = ti.min(ti.max(-(ax * dx + ay * dy) / (dx * dx + dy * dy), 0.0), 1.0)
                        px, py = ax + t * dx, ay + t * dy
                        square = px * px + py * py
                        if square < best:
                            best, east, north = square, px, py
    distance = ti.sqrt(best)
    if best >= limit:
        distance = 2.0 * reach + 1.0
    return f32x3(distance, east, north)


@ti.func
def facing(lon, lat, c, number, coast: ti.template()) -> f32x3:
    """Return (distance [m], east, north) of a point from an edge's straight line.

    (east, north): unit normal of the line, towards the point.
    """
    line = ti.static(coast.shoreline)
    first = coast.frame[LINES_AT] + 4 * number
    ax = ti.cast(line[first] - lon, ti.i64)
    ay = ti.cast(line[first + 1] - lat, ti.i64)
    ex = ti.cast(line[first + 2] - line[first], ti.i64)
    ey = ti.cast(line[first + 3] - line[first + 1], ti.i64)
    turn = ey * ax - ex * ay  # exact: its sign tells on which side the point lies
    dx, dy = ti.cast(ex, ti.f32) * c, ti.cast(ey, ti.f32)
    length = ti.sqrt(dx * dx + dy * dy)
    left = 1.0 if turn > 0 else -1.0
    away = ti.abs(ti.cast(turn, ti.f32)) * c / length * ti.f32(METRES)
    return f32x3(away, -left * dy / length, left * dx / length)


@ti.func
def touch(lon, lat, dlon, dlat, chance, c, coast: ti.template()):
    """Return (touched, before, after, east, north): whether the bridge over a step met the shore.

    The step ends in water.

    A Brownian bridge over a time t between points at distances d1 and d2 on one side of a line
    meets it with probability exp(-d1 d2 / (D t)) (Karatzas and Shreve 1991, eq. 4.3.40). With
    chance [m2] = -D t log(u), u uniform, it meets the line where d1 d2 < chance. The line is the
    shore's tangent at the point nearest to either end. before, after: d1, d2 [m]; east, north: the
    line's unit normal towards the water.
    """
    sx = ti.cast(dlon, ti.f32) * (c * ti.f32(METRES))
    sy = ti.cast(dlat, ti.f32) * ti.f32(METRES)
    # if the bridge met the shore, one of its ends lies within this distance
    reach = ti.sqrt(chance)
    touched, before, after, nx, ny = 0, 0.0, 0.0, 0.0, 0.0
    for end in range(2):
        if touched == 0:
            p = nearest(lon + end * dlon, lat + end * dlat, reach, c, coast)
            if p[0] <= reach and p[0] > 1e-3:
                nx, ny = -p[1] / p[0], -p[2] / p[0]
                other = p[0] + (sx * nx + sy * ny) * (1.0 - 2.0 * end)
                if other > 0.0 and p[0] * other < chance:
                    touched = 1
                    before, after = p[0], other
                    if end == 1:
                        before, after = other, p[0]
    return touched, before, after, nx, ny


@ti.func
def landing(fraction, before, variance, normal, uniform):
    """Return the share of a step [1] after which a random walk first meets a line.

    fraction: the share after which its straight path meets the line. before: distance [m] to the
    line at the step's begin; variance [m2]: 2 D t of the walk over the step. In the clock s = share
    / (1 - share) a bridge is Brownian motion with drift, so s is inverse Gaussian with mean
    fraction / (1 - fraction) and shape before^2 / variance; sampled after Michael, Schucany and
    Haas 1976 (doi:10.1080/00031305.1976.10479147). The same distribution holds for a bridge that
    comes back, to its mirror image.
    """
    share = fraction
    if variance > 0.0 and fraction < 0.9999 and before > 0.0:
        mean = fraction / (1.0 - fraction)
        k = 0.5 * mean * variance / (before * before) * normal * normal  # mean y / (2 shape)
        root = mean / (1.0 + k + ti.sqrt(k * (k + 2.0)))  # the smaller root, without cancellation
        s = root
        if uniform > mean / (mean + root):
            s = mean * mean / root
        share = s / (1.0 + s)
    return share


@ti.func
def pushed(sx, sy, before, nx, ny, chance) -> f32x2:
    """Return a step (sx, sy) [m] pushed off the shore's line by as much as it went over it.

    The line lies at distance `before` [m] and has the normal (nx, ny). chance [m2]: see `touch`; 0
    without diffusion. With diffusion, the lowest point of the bridge over the step is drawn from
    its distribution, and the push makes the motion a reflected Brownian motion in a half-plane,
    exact in distribution (Lepingle 1995, doi:10.1016/0378-4754(93)E0083-H). Without diffusion the
    push is the projection onto the shore.
    """
    after = before + sx * nx + sy * ny
    lowest = 0.5 * (before + after - ti.sqrt((before - after) * (before - after) + 4.0 * chance))
    push = OFF - ti.min(lowest, 0.0)
    return f32x2(sx + push * nx, sy + push * ny)


@ti.func
def along(sx, sy, nx, ny) -> f32x2:
    """Return the rest of a step (sx, sy) [m] that has met another edge: it follows that edge.

    nx, ny: the edge's unit normal.
    """
    inward = sx * nx + sy * ny
    return f32x2(sx + (OFF - inward) * nx, sy + (OFF - inward) * ny)


@ti.func
def leave(lon, lat, c, offing, number, coast: ti.template()):
    """Return (lon, lat, east, north) of a particle that leaves the beach.

    (lon, lat) lies `offing` [m] straight off the beach, or half-way to another shore that is
    nearer; (east, north): unit vector off the beach.
    """
    f = facing(lon, lat, c, number, coast)
    move_x = ti.cast(ti.round(offing * f[1] / (c * ti.f32(METRES))), ti.i32)
    move_y = ti.cast(ti.round(offing * f[2] / ti.f32(METRES)), ti.i32)
    x, y, hit = lon, lat, 1
    for _ in range(2):  # first the full distance, then half the distance to the shore that it met
        if hit == 1:
            hit, x, y, _part, _number = first_crossing(lon, lat, move_x, move_y, coast)
            move_x, move_y = (x - lon) // 2, (y - lat) // 2
    return x, y, f[1], f[2]


@ti.func
def piece(j, pieces, rest_lon, rest_lat, v, c, seed0, seed1, slot, step):
    """Return (dlon, dlat, chance) of piece j of a random walk; chance: see `touch`.

    v: variance [m2] of each piece. rest_lon, rest_lat: remaining displacement; the last piece takes
    all of it, which makes the walk a Brownian bridge. seed0, seed1, slot, step: the key of its
    noise.
    """
    w = noise.further(seed0, seed1, noise.STREAM_COAST, slot, step, 2 * j)
    left = ti.cast(pieces - j, ti.f32)
    dlon, dlat = rest_lon, rest_lat
    if j < pieces - 1 and v == 0.0:  # as without a walk
        dlon, dlat = rest_lon // (pieces - j), rest_lat // (pieces - j)
    elif j < pieces - 1:
        n = noise.normals(w[0], w[1]) * ti.sqrt(v * (left - 1.0) / left)
        dlon = ti.cast(
            ti.round(ti.cast(rest_lon, ti.f32) / left + n[0] / (c * ti.f32(METRES))), ti.i32
        )
        dlat = ti.cast(ti.round(ti.cast(rest_lat, ti.f32) / left + n[1] / ti.f32(METRES)), ti.i32)
    chance = -0.5 * v * ti.log(noise.uniform(w[2]))
    return dlon, dlat, chance


@ti.func
def mirrored(dlon, dlat, after, nx, ny, c):
    """Return (dlon, dlat) of a step that ends before the shore's line, mirrored at the line.

    after: distance [m] of its end from the line; nx, ny: the line's normal.
    """
    away_lon = ti.cast(ti.round(2.0 * after * nx / (c * ti.f32(METRES))), ti.i32)
    away_lat = ti.cast(ti.round(2.0 * after * ny / ti.f32(METRES)), ti.i32)
    return dlon - away_lon, dlat - away_lat


@ti.func
def is_far(walks: ti.template(), lon, lat, dlon, dlat, off, c, variance, coast: ti.template()):
    """Return whether a step is too far from the shore for `meet` to change it.

    off: largest departure of the path from its chord [binary angle units].
    """
    span = ti.max(ti.abs(dlon), ti.abs(dlat)) + off
    if ti.static(walks):
        # Beyond 2.9 standard deviations of the walk, a bridge comes back with probability below
        # 2^-24.
        span += ti.cast(2.9 * ti.sqrt(variance) / (c * ti.f32(METRES)), ti.i32) + 1
    return is_clear(lon, lat, span, coast)


@ti.func
def meet(
    walks: ti.template(),
    slides: ti.template(),
    lon,
    lat,
    dlon,
    dlat,
    bend,
    c,
    variance,
    seed0,
    seed1,
    slot,
    step,
    coast: ti.template(),
):
    """Return (met, lon, lat, part, edge number): the end of a step (dlon, dlat) from water.

    met: whether it ends on the shore. The step is not `is_far`.

    bend: departure of the path from its chord (kernels.step.curve). The path is divided into
    straight pieces, so that a curved path meets the shore where small steps meet it.

    walks: whether the step is a random walk of variance [m2] = 2 D t, with the noise of a slot and
    a step. A walk is a Brownian bridge in pieces of standard deviation PIECE at most, so that a
    shore smaller than the step's spread is met as often as with small steps; each piece is tested
    for a crossing and for a touch. part: share of the step [1] after which the shore is met.

    slides: whether a particle that meets the shore continues along it instead of ending there: it
    is `pushed` off the shore's line and led `along` each further edge in turn.
    """
    k = ti.f32(METRES)
    pieces = curve.pieces(bend, c, MOST_PIECES)
    bent = pieces > 1
    if ti.static(walks):
        pieces = ti.min(
            ti.max(ti.cast(ti.ceil(variance / (PIECE * PIECE)), ti.i32), pieces), MOST_PIECES
        )
    if ti.static(slides):
        way = f32x2(ti.cast(dlon, ti.f32) * c, ti.cast(dlat, ti.f32)).norm() * k
        pieces = ti.min(
            ti.max(ti.cast(ti.ceil(way * ti.f32(1.0 / SLID)), ti.i32), pieces), MOST_PIECES
        )
    v = variance / ti.cast(pieces, ti.f32)
    x, y, rest_lon, rest_lat = lon, lat, dlon, dlat
    off_lon, off_lat = 0, 0  # departure of the path from its chord so far
    met, part, number = 0, ti.cast(1.0, ti.f32), -1
    for j in range(pieces):
        if met == 0:
            move_lon, move_lat, chance = rest_lon, rest_lat, ti.cast(0.0, ti.f32)
            if ti.static(walks):
                move_lon, move_lat, chance = piece(
                    j, pieces, rest_lon, rest_lat, v, c, seed0, seed1, slot, step
                )
            elif pieces > 1:
                move_lon, move_lat = rest_lon // (pieces - j), rest_lat // (pieces - j)
            rest_lon, rest_lat = rest_lon - move_lon, rest_lat - move_lat
            if bent:
                off = curve.off_chord(bend, ti.cast(j + 1, ti.f32) / ti.cast(pieces, ti.f32))
                to_lon, to_lat = (
                    ti.cast(ti.round(off[0]), ti.i32),
                    ti.cast(ti.round(off[1]), ti.i32),
                )
                move_lon, move_lat = move_lon + to_lon - off_lon, move_lat + to_lat - off_lat
                off_lon, off_lat = to_lon, to_lat

            # The first attempt is the piece itself; later ones are the piece as changed by the
            # shore.
            x_from, y_from, way_lon, way_lat, going = x, y, move_lon, move_lat, 1
            x_end, y_end, before, share, struck = (
                x,
                y,
                ti.cast(0.0, ti.f32),
                ti.cast(1.0, ti.f32),
                -1,
            )
            sx, sy = ti.cast(move_lon, ti.f32) * (c * k), ti.cast(move_lat, ti.f32) * k
            for attempt in range(ti.static(1 + CORNERS if slides else 2 if walks else 1)):
                if going == 1:
                    hit, x_stop, y_stop, at, edge = first_crossing(
                        x_from, y_from, way_lon, way_lat, coast
                    )
                    going = 0
                    if attempt == 0:
                        met, x_end, y_end, share, struck = hit, x_stop, y_stop, at, edge
                        after, nx, ny = (
                            ti.cast(0.0, ti.f32),
                            ti.cast(0.0, ti.f32),
                            ti.cast(0.0, ti.f32),
                        )
                        if hit == 1:
                            if ti.static(walks or slides):
                                f = facing(x, y, c, edge, coast)
                                before, nx, ny = f[0], f[1], f[2]
                        elif ti.static(walks):
                            met, before, after, nx, ny = touch(
                                x, y, move_lon, move_lat, chance, c, coast
                            )
                            if ti.static(not slides):
                                # the bridge's mirror image goes ashore where it touched
                                if met == 1:
                                    way_lon, way_lat = mirrored(
                                        move_lon, move_lat, after, nx, ny, c
                                    )
                                    going = 1
                        if ti.static(slides):
                            if met == 1:
                                s = pushed(sx, sy, before, nx, ny, chance)
                                sx, sy, going = s[0], s[1], 1
                    elif ti.static(slides):
                        x_end, y_end = x_stop, y_stop
                        if hit == 1:
                            sx -= ti.cast(x_stop - x_from, ti.f32) * (c * k)
                            sy -= ti.cast(y_stop - y_from, ti.f32) * k
                            f = facing(x_stop, y_stop, c, edge, coast)
                            s = along(sx, sy, f[1], f[2])
                            sx, sy, going = s[0], s[1], 1
                            x_from, y_from = x_stop, y_stop
                    else:
                        met = hit  # past the end of a spit there may be water
                        if hit == 1:
                            x_end, y_end, share, struck = x_stop, y_stop, at, edge
                    if ti.static(slides):
                        way_lon, way_lat = (
                            ti.cast(ti.round(sx / (c * k)), ti.i32),
                            ti.cast(ti.round(sy / k), ti.i32),
                        )
            if ti.static(slides):
                met = 0
            elif met == 1:
                if ti.static(walks):
                    w = noise.further(seed0, seed1, noise.STREAM_COAST, slot, step, 2 * j + 1)
                    n = noise.normals(w[0], w[1])
                    share = landing(share, before, v, n[0], noise.uniform(w[2]))
                part = (ti.cast(j, ti.f32) + share) / ti.cast(pieces, ti.f32)
                number = struck
            x, y = x_end, y_end
    return met, x, y, part, number
