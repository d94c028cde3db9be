"""The point functions of the shore against plane geometry in float64, shapely, and the laws of
Brownian motion by SciPy.
"""

import numpy as np
import pytest
import shapely
import taichi as ti
from plane_shores import ANGLE, COS, EPS, LAT, METRE, REACH, about, binary, built, straight, wavy
from scipy import stats

from geo import sphere
from geo.coast import edges as shoreline
from kernels.step import coast as device_coast
from kernels.step import shore
from kernels.step.coast import Coast, Ints, Reals

RNG = np.random.default_rng(31)


@ti.kernel
def _nearest(lon: Ints, lat: Ints, reach: ti.f32, coast: Coast, out: Reals):
    for i in range(lon.shape[0]):
        p = shore.nearest(lon[i], lat[i], reach, ti.cos(lat[i] * ti.f32(sphere.UNIT)), coast)
        for k in ti.static(range(3)):
            out[3 * i + k] = p[k]


def test_the_nearest_point_of_the_shore_is_shapelys() -> None:
    """Distance and place on the tangent plane; float32 of ways up to REACH and edges beyond it."""
    coast = built(wavy(RNG), shapely.Point(-1500, 700).buffer(40))
    lon, lat = binary(RNG.uniform(-5000, 400, 600), RNG.uniform(-8000, 8000, 600))
    out = np.zeros(1800, np.float32)
    _nearest(lon, lat, REACH, device_coast.upload(coast).pack, out)
    for x, y, got in zip(lon, lat, out.reshape(-1, 3), strict=True):
        lines = shapely.linestrings(about(coast, x, y))
        way = shapely.shortest_line(shapely.Point(0, 0), shapely.union_all(lines))
        distance = way.length
        if distance > REACH * (1 + 1e-4):
            assert got[0] > REACH
        elif distance < REACH * (1 - 1e-4):
            bound = 16 * EPS * 4 * REACH
            assert got[0] == pytest.approx(distance, abs=bound)
            off = shapely.MultiLineString(list(lines)).distance(shapely.Point(got[1], got[2]))
            assert off < bound
            assert np.hypot(got[1], got[2]) == pytest.approx(distance, abs=bound)


@ti.kernel
def _facing(lon: Ints, lat: Ints, number: Ints, coast: Coast, out: Reals):
    for i in range(lon.shape[0]):
        f = shore.facing(lon[i], lat[i], ti.cos(lat[i] * ti.f32(sphere.UNIT)), number[i], coast)
        for k in ti.static(range(3)):
            out[3 * i + k] = f[k]


def test_the_line_of_an_edge_faces_the_point() -> None:
    """Distance from the straight line through an edge, and its unit normal, which leads from the
    line to the point.
    """
    coast = built(wavy(RNG))
    edges = shoreline.shoreline_edges(coast)
    lon, lat = binary(RNG.uniform(-4000, 4000, 500), RNG.uniform(-8000, 8000, 500))
    number = RNG.integers(0, len(edges), 500).astype(np.int32)
    out = np.zeros(1500, np.float32)
    _facing(lon, lat, number, device_coast.upload(coast).pack, out)
    for x, y, e, (away, east, north) in zip(
        lon, lat, number, out.reshape(-1, 3).astype(float), strict=True
    ):
        a, b = about(coast, x, y)[e]
        along = (b - a) / np.hypot(*(b - a))
        foot = a - (a @ along) * along  # of the perpendicular from the point
        assert away == pytest.approx(np.hypot(*foot), rel=16 * EPS, abs=1e-3)
        assert np.hypot(east, north) == pytest.approx(1, abs=8 * EPS)
        assert np.allclose(
            away * np.array([east, north]), -foot, rtol=0, atol=32 * EPS * np.hypot(*foot) + 1e-3
        )


@ti.kernel
def _touch(
    lon: Ints, lat: Ints, dlon: Ints, dlat: Ints, chance: Reals, c: ti.f32, coast: Coast, out: Reals
):
    for i in range(lon.shape[0]):
        touched, before, after, nx, ny = shore.touch(
            lon[i], lat[i], dlon[i], dlat[i], chance[i], c, coast
        )
        out[5 * i], out[5 * i + 1], out[5 * i + 2], out[5 * i + 3], out[5 * i + 4] = (
            touched,
            before,
            after,
            nx,
            ny,
        )


def test_a_bridge_touches_a_straight_shore_where_the_product_of_its_distances_falls_short() -> None:
    """d1 d2 < chance, from either end; the line's normal leads to the water."""
    n = 4000
    coast = built(straight())
    normal = -np.array([np.cos(ANGLE), -np.sin(ANGLE)])
    distance = RNG.uniform(20, 900, (2, n))
    run = RNG.uniform(-800, 800, (2, n))
    at = [
        d[:, None] * normal + s[:, None] * np.array([np.sin(ANGLE), np.cos(ANGLE)])
        for d, s in zip(distance, run, strict=True)
    ]
    (lon, lat), (to_lon, to_lat) = (binary(*p.T) for p in at)
    # A latitude off LAT, a metre of longitude has another length: the distances are those at LAT
    # within this share.
    slack = 2 * 1700 / sphere.RADIUS * np.tan(np.radians(LAT)) * 2000 + 0.1
    chance = (distance[0] * distance[1] * RNG.uniform(0.3, 1.7, n)).astype(np.float32)
    out = np.zeros(5 * n, np.float32)
    _touch(lon, lat, to_lon - lon, to_lat - lat, chance, COS, device_coast.upload(coast).pack, out)
    touched, before, after, east, north = out.reshape(-1, 5).T
    product = distance[0] * distance[1]
    clear = np.abs(chance - product) > slack * distance.sum(axis=0)
    assert clear.sum() > 0.8 * n
    assert ((touched == 1) == (product < chance))[clear].all()
    hit = touched == 1
    assert np.abs(before - distance[0])[hit].max() < slack
    assert np.abs(after - distance[1])[hit].max() < slack
    assert np.abs(east - normal[0])[hit].max() < 1e-3
    assert np.abs(north - normal[1])[hit].max() < 1e-3


@ti.kernel
def _landing(
    fraction: ti.f32, before: ti.f32, variance: ti.f32, normal: Reals, uniform: Reals, out: Reals
):
    for i in range(normal.shape[0]):
        out[i] = shore.landing(fraction, before, variance, normal[i], uniform[i])


@pytest.mark.parametrize(
    ("fraction", "before", "sigma"), [(0.3, 400.0, 150.0), (0.85, 60.0, 210.0), (0.05, 900.0, 80.0)]
)
def test_a_landing_is_inverse_gaussian_in_the_bridges_clock(
    fraction: float, before: float, sigma: float
) -> None:
    """share / (1 - share), by Kolmogorov and Smirnov; without diffusion it is the share of the
    straight way.
    """
    n = 40_000
    normal, uniform = RNG.normal(size=n).astype(np.float32), RNG.uniform(size=n).astype(np.float32)
    out = np.zeros(n, np.float32)
    _landing(fraction, before, sigma**2, normal, uniform, out)
    mean, shape = fraction / (1 - fraction), before**2 / sigma**2
    assert stats.kstest(
        out / (1 - out.astype(float)), stats.invgauss(mean / shape, scale=shape).cdf
    ).statistic < 1.95 / np.sqrt(n)
    _landing(fraction, before, 0.0, normal, uniform, out)
    assert (out == np.float32(fraction)).all()


@ti.kernel
def _pushed(sx: Reals, sy: Reals, before: Reals, nx: ti.f32, ny: ti.f32, chance: Reals, out: Reals):
    for i in range(sx.shape[0]):
        s = shore.pushed(sx[i], sy[i], before[i], nx, ny, chance[i])
        t = shore.along(sx[i], sy[i], nx, ny)
        out[4 * i], out[4 * i + 1], out[4 * i + 2], out[4 * i + 3] = s[0], s[1], t[0], t[1]


def test_a_step_is_pushed_by_the_lowest_point_of_its_bridge() -> None:
    """Below a line the bridge's lowest point m has the law exp(-2 (a - m)(b - m) / v): (a - m)(b -
    m) is the chance. Along: none is left.
    """
    n = 5000
    nx, ny = np.sin(0.7), np.cos(0.7)
    sx, sy = RNG.normal(0, 300, (2, n)).astype(np.float32)
    before, chance = (
        RNG.uniform(1, 500, n).astype(np.float32),
        RNG.exponential(4e4, n).astype(np.float32),
    )
    chance[::4] = 0
    out = np.zeros(4 * n, np.float32)
    _pushed(sx, sy, before, nx, ny, chance, out)
    got = out.reshape(-1, 4).astype(float)
    a, b = before.astype(float), before + sx * nx + sy * ny
    push = (got[:, 0] - sx) * nx + (got[:, 1] - sy) * ny
    # none along the shore
    assert np.abs((got[:, 0] - sx) * ny - (got[:, 1] - sy) * nx).max() < 32 * EPS * 2000
    lowest = shore.OFF - push
    below = lowest < -0.01
    product = (a - lowest) * (b - lowest)
    slack = 64 * EPS * 2000 * (np.abs(a - lowest) + np.abs(b - lowest)) + 1
    assert (np.abs(product - chance) < slack)[below].all()
    assert (a * b > chance - slack)[~below].all()
    assert 0.2 < below.mean() < 0.9
    still = below & (chance == 0)
    # without diffusion it ends on the line, but for OFF
    assert np.abs(b + push - shore.OFF)[still].max() < 0.01
    assert np.abs(got[:, 2] * nx + got[:, 3] * ny - shore.OFF).max() < 0.01
    assert np.abs((got[:, 2] - sx) * ny - (got[:, 3] - sy) * nx).max() < 0.01


@ti.kernel
def _leave(
    lon: Ints,
    lat: Ints,
    offing: ti.f32,
    number: Ints,
    c: ti.f32,
    coast: Coast,
    x: Ints,
    y: Ints,
    out: Reals,
):
    for i in range(lon.shape[0]):
        x[i], y[i], out[2 * i], out[2 * i + 1] = shore.leave(
            lon[i], lat[i], c, offing, number[i], coast
        )


@pytest.mark.parametrize(("width", "expected"), [(900.0, 300.0), (200.0, 100.0)])
def test_what_refloats_leaves_straight_off_the_beach_or_half_way_over(
    width: float, expected: float
) -> None:
    """300 m off, unless another shore lies nearer: then half-way there, to a unit each way and the
    half of one metre it began off.
    """
    off = -np.array([np.cos(ANGLE), -np.sin(ANGLE)])
    other = shapely.transform(straight(), lambda p: -p + width * off)
    coast = built(straight(), other)
    beach = 1.0 * off[:, None] + RNG.uniform(-3000, 3000, 50) * np.array(
        [[np.sin(ANGLE)], [np.cos(ANGLE)]]
    )
    lon, lat = binary(*beach)
    ends = about(coast, 0, int(sphere.to_binary(LAT)))
    own = int(
        np.argmin(
            np.abs(ends @ off).max(axis=1) + (np.hypot(*(ends[:, 1] - ends[:, 0]).T) < 20_000) * 1e9
        )
    )
    x, y, out = np.zeros(50, np.int32), np.zeros(50, np.int32), np.zeros(100, np.float32)
    _leave(
        lon, lat, 300.0, np.full(50, own, np.int32), COS, device_coast.upload(coast).pack, x, y, out
    )
    way = np.stack([(x - lon) * METRE * COS, (y - lat) * METRE])
    assert np.abs(off @ way - expected).max() < 2.0
    assert np.abs(off[::-1] * [1, -1] @ way).max() < 0.5
    np.testing.assert_allclose(out.reshape(-1, 2), np.tile(off, (50, 1)), atol=1e-3)


@ti.kernel
def _pieces(
    pieces: ti.i32,
    v: ti.f32,
    dlon: ti.i32,
    dlat: ti.i32,
    seed: ti.u32,
    east: Ints,
    north: Ints,
    chance: Reals,
):
    for i in range(east.shape[0] // pieces):
        rest_lon, rest_lat = dlon, dlat
        for j in range(pieces):
            k = i * pieces + j
            east[k], north[k], chance[k] = shore.piece(
                j,
                pieces,
                rest_lon,
                rest_lat,
                v,
                COS,
                seed,
                ti.u32(3),
                i,
                5,
            )
            rest_lon, rest_lat = rest_lon - east[k], rest_lat - north[k]


def test_the_pieces_of_a_walk_are_a_brownian_bridge() -> None:
    """They add up to the step; each has the mean of an equal share and the covariance v (1 - 1/m),
    -v/m; within 4.5 standard errors.
    """
    n, pieces, v, step = 40_000, 4, 130.0**2, (90_000, -50_000)
    east, north, chance = (
        np.zeros(n * pieces, np.int32),
        np.zeros(n * pieces, np.int32),
        np.zeros(n * pieces, np.float32),
    )
    _pieces(pieces, v, *step, 11, east, north, chance)
    for moves, whole, unit in ((east, step[0], METRE * COS), (north, step[1], METRE)):
        each = moves.reshape(n, pieces)
        assert (each.sum(axis=1) == whole).all()
        apart = (each - whole / pieces) * unit
        expected = v * (np.eye(pieces) - 1 / pieces)
        found = apart.T @ apart / n
        # of a product of normals
        spread = np.sqrt((np.outer(np.diag(expected), np.diag(expected)) + expected**2) / n)
        assert (np.abs(found - expected) < 4.5 * spread).all()
        assert (np.abs(apart.mean(axis=0)) < 4.5 * np.sqrt(np.diag(expected) / n)).all()
    assert stats.kstest(chance, stats.expon(scale=v / 2).cdf).statistic < 1.95 / np.sqrt(
        chance.size
    )


@ti.kernel
def _mirrored(dlon: Ints, dlat: Ints, after: Reals, nx: ti.f32, ny: ti.f32, x: Ints, y: Ints):
    for i in range(dlon.shape[0]):
        x[i], y[i] = shore.mirrored(dlon[i], dlat[i], after[i], nx, ny, COS)


def test_a_mirrored_step_ends_as_far_behind_the_line() -> None:
    """The line half-way between both ends is the shore's: they differ along its normal alone, by
    twice the distance, to two units.
    """
    dlon, dlat = RNG.integers(-200_000, 200_000, (2, 2000)).astype(np.int32)
    after, angle = RNG.uniform(1, 900, 2000).astype(np.float32), 2.2
    x, y = np.zeros(2000, np.int32), np.zeros(2000, np.int32)
    _mirrored(dlon, dlat, after, np.cos(angle), np.sin(angle), x, y)
    way = np.stack([(x - dlon) * METRE * COS, (y - dlat) * METRE])
    assert np.abs(np.array([np.cos(angle), np.sin(angle)]) @ way + 2 * after).max() < 2 * METRE
    assert np.abs(np.array([-np.sin(angle), np.cos(angle)]) @ way).max() < 2 * METRE
