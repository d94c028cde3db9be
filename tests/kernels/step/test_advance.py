"""The point functions of a step, each over arrays against its closed form in float64: errors, walk,
leeway, integrator, divergence.
"""

import numpy as np
import pytest
import taichi as ti
from scipy import stats

from geo import sphere
from geo.grids.grid import Grid
from kernels.step import errors, integrate, velocity
from kernels.step.coast import Ints, Reals
from kernels.step.features import CURRENT, STOKES, WIND
from kernels.step.sample import Sea, Tiles

RNG = np.random.default_rng(23)
EPS = 2.0**-24  # half the distance from 1 to the next float32: what one operation may err
RADIUS, UNIT = sphere.RADIUS, sphere.UNIT
f32x2 = ti.types.vector(2, ti.f32)
f32x4 = ti.types.vector(4, ti.f32)


def reals(*values: np.ndarray) -> list[np.ndarray]:
    return [np.ascontiguousarray(v, np.float32) for v in values]


@ti.kernel
def _transition(
    east: Reals, north: Reals, std: ti.f32, time: ti.f32, dt: ti.f32, a: Reals, b: Reals, out: Reals
):
    for i in range(east.shape[0]):
        new = errors.transition(
            f32x2(east[i], north[i]), std, errors.kept(time, dt), f32x2(a[i], b[i])
        )
        out[2 * i], out[2 * i + 1] = new[0], new[1]


@pytest.mark.parametrize(
    ("std", "time", "dt"), [(0.31, 39_600.0, 900.0), (1.7, 21_600.0, 3600.0), (0.2, 60.0, 86_400.0)]
)
def test_an_error_forgets_itself_at_its_rate(std: float, time: float, dt: float) -> None:
    """x exp(-dt / T) + s sqrt(1 - exp(-2 dt / T)) n, in float64; 1 - k^2 loses digits as k nears 1:
    an error of eps / (1 - k^2).
    """
    east, north, a, b = reals(*RNG.normal(0, 1, (4, 3000)))
    out = np.zeros(6000, np.float32)
    _transition(east, north, std, time, dt, a, b, out)
    keep, kick = np.exp(-dt / time), std * np.sqrt(-np.expm1(-2 * dt / time))
    for got, old, n in ((out[::2], east, a), (out[1::2], north, b)):
        exact = keep * old.astype(float) + kick * n.astype(float)
        bound = (
            8
            * EPS
            * (
                np.abs(old * keep) * (1 + dt / time)
                + np.abs(kick * n) * (1 + 1 / -np.expm1(-2 * dt / time))
            )
        )
        assert (np.abs(got - exact) <= bound + 1e-30).all()


@ti.kernel
def _jibed(rate: ti.f32, dt: Reals, uniform: Reals, out: Ints):
    for i in range(dt.shape[0]):
        out[i] = ti.cast(errors.jibed(rate, dt[i], uniform[i]), ti.i32)


def test_it_jibes_where_a_poisson_number_is_odd() -> None:
    """The threshold of the uniform number is the sum of SciPy's odd Poisson probabilities, to eight
    roundings.
    """
    rate = 2.3e-4
    dt = np.repeat(reals(np.array([60.0, 900.0, 3600.0, 21_600.0]))[0], 5000)
    odd = stats.poisson.pmf(np.arange(1, 400, 2)[:, None], rate * dt.astype(float)).sum(axis=0)
    for factor, expected in ((1 - 1e-4, 1), (1 + 1e-4, 0)):
        out = np.zeros(dt.size, np.int32)
        _jibed(rate, dt, reals(odd * factor)[0], out)
        assert (out == expected).all()


@ti.kernel
def _walked(lat: Ints, east: Reals, north: Reals, out: Reals):
    for i in range(lat.shape[0]):
        way = errors.walked(
            f32x2(east[i], north[i]), ti.cos(lat[i] * ti.f32(UNIT)), ti.sin(lat[i] * ti.f32(UNIT))
        )
        out[2 * i], out[2 * i + 1] = way[0], way[1]


@pytest.mark.parametrize("degrees", [-63.7, 4.2, 48.5, 79.0])
def test_a_walk_is_the_exponential_map_to_second_order(degrees: float) -> None:
    """Against the great circle in float64: what is left is of third order in walk / R, times the
    powers of tan(lat) + 1.
    """
    east, north = reals(*RNG.normal(0, 700, (2, 2000)))
    lat = sphere.to_binary(np.full(2000, degrees)).astype(np.int32)
    out = np.zeros(4000, np.float32)
    _walked(lat, east, north, out)
    phi, x, y = np.radians(degrees), east.astype(float) / RADIUS, north.astype(float) / RADIUS
    arc = np.hypot(x, y)
    up = np.cos(arc) * np.cos(phi) - np.sinc(arc / np.pi) * y * np.sin(phi)
    dlon = np.arctan2(np.sinc(arc / np.pi) * x, up)
    dlat = np.arcsin(np.cos(arc) * np.sin(phi) + np.sinc(arc / np.pi) * y * np.cos(phi)) - phi
    t = 1 + abs(np.tan(phi))
    rounding = 8 * EPS * arc / np.cos(phi)
    assert (np.abs(out[1::2] * UNIT - dlat) <= arc**3 * t**2 + rounding).all()
    # East, the map's term of second order, tan(lat) dx dy, is left out: a walk's east and north are
    # independent, so its mean is 0.
    first = np.abs(x * y) * t / np.cos(phi)
    assert (
        np.abs(out[::2] * UNIT - dlon) <= 1.01 * first + arc**3 * t**2 / np.cos(phi) + rounding
    ).all()


@ti.kernel
def _leeway(line: Reals, east: Reals, north: Reals, out: Reals):
    for i in range(east.shape[0]):
        own = f32x4(line[4 * i], line[4 * i + 1], line[4 * i + 2], line[4 * i + 3])
        way = velocity.leeway(own, east[i], north[i])
        out[2 * i], out[2 * i + 1] = way[0], way[1]


def test_leeway_is_downwind_and_to_the_right_of_it() -> None:
    """By compass: the wind blows towards a bearing; downwind is along it, to the right is a quarter
    turn clockwise.
    """
    n = 5000
    line = RNG.normal([0.03, 0.04, 0.01, 0.02], 0.01, (n, 4))
    speed, bearing = RNG.uniform(0.5, 30, n), RNG.uniform(0, 2 * np.pi, n)
    east, north = reals(speed * np.sin(bearing), speed * np.cos(bearing))
    out = np.zeros(2 * n, np.float32)
    _leeway(*reals(line.reshape(-1)), east, north, out)
    down, right = line[:, 0] * speed + line[:, 1], line[:, 2] * speed + line[:, 3]
    turned = bearing + np.pi / 2
    assert np.abs(out[::2] - down * np.sin(bearing) - right * np.sin(turned)).max() < 3 * 16 * EPS
    assert np.abs(out[1::2] - down * np.cos(bearing) - right * np.cos(turned)).max() < 3 * 16 * EPS
    still = np.zeros(2, np.float32)
    _leeway(*reals(line[0]), *reals(np.zeros(1), np.zeros(1)), still)
    assert (still == 0).all()  # no wind, no way: the offset has no direction


@ti.kernel
def _drift(
    features: ti.template(),
    sea: Sea,
    line: f32x4,
    error: f32x4,
    lon: Ints,
    lat: Ints,
    fraction: ti.f32,
    out: Reals,
):
    for i in range(lon.shape[0]):
        own = velocity.Drifter(line=line, error=error, member=0, asks=1.0)
        r = velocity.drift(features, sea, own, lon[i], lat[i], fraction)
        for k in ti.static(range(3)):
            out[3 * i + k] = r[k]


@pytest.mark.parametrize(
    "features", [CURRENT, CURRENT | STOKES, CURRENT | WIND, CURRENT | WIND | STOKES]
)
def test_a_drift_is_the_sum_of_what_is_asked_for_and_known_where_all_of_it_is(
    features: int,
) -> None:
    """Uniform fields, one of which ends at 10 E: current, error, Stokes drift, and leeway in the
    wind with its error.
    """
    grid = Grid(5.0, 40.0, 1.0, 1.0, 11, 8)
    fields = ((0.31, -0.22), (7.0, 4.0), (0.05, 0.11))  # current, wind, Stokes drift
    tiles = Tiles([grid] * 3)
    for tile, (u, v) in enumerate(fields):
        values = np.broadcast_to(np.array([u, v], np.float32), (8, 11, 2)).copy()
        if tile == 2:
            values[:, 5:] = np.nan
        tiles.place(tile, values, later=False)
        tiles.place(tile, values, later=True)
    tiles.blend([(0.2, 0.7)] * 3)
    line, error = (0.031, 0.02, 0.012, -0.01), (0.07, -0.03, 1.1, -0.6)
    lon, lat = (
        sphere.to_binary([6.3, 11.7]).astype(np.int32),
        sphere.to_binary([42.1, 44.4]).astype(np.int32),
    )
    out = np.zeros(6, np.float32)
    sea = tiles.sea({"current": (0, 1), "wind": (1, 2), "stokes": (2, 3)})
    _drift(features, sea, f32x4(*line), f32x4(*error), lon, lat, 0.4, out)
    wind = np.array(fields[1]) + error[2:]
    speed = np.hypot(*wind)
    down, right = (
        (line[0] + line[1] / speed) * wind,
        (line[2] + line[3] / speed) * np.array([wind[1], -wind[0]]),
    )
    expected = (
        np.array(fields[0])
        + error[:2]
        + bool(features & STOKES) * np.array(fields[2])
        + bool(features & WIND) * (down + right)
    )
    np.testing.assert_allclose(out[:2], expected, atol=16 * EPS)
    assert out[2] == 1
    assert out[5] == (0 if features & STOKES else 1)


@pytest.mark.parametrize(("scheme", "order"), [(integrate.MIDPOINT, 2), (integrate.CLASSICAL, 4)])
def test_a_tableau_meets_the_conditions_of_its_order(scheme: tuple, order: int) -> None:
    """Sum b c^(k-1) = 1 / k for k to the order (Hairer, Norsett and Wanner 1993, II.1), and for
    order 4 those of its trees.
    """
    c, b = (np.array(x) for x in scheme)
    for k in range(1, order + 1):
        assert (b * c ** (k - 1)).sum() == pytest.approx(1 / k, rel=1e-15)
    if order == 4:
        a = np.diag(c[1:], -1)  # a stage starts along the one before
        assert b @ a @ c == pytest.approx(1 / 6, rel=1e-15)
        assert b @ (c * (a @ c)) == pytest.approx(1 / 8, rel=1e-15)
        assert b @ a @ c**2 == pytest.approx(1 / 12, rel=1e-15)
        assert b @ a @ a @ c == pytest.approx(1 / 24, rel=1e-15)


SHEAR = (0.9, 40.0, -0.4)  # [m/s], [1/rad], [m/s]: u = U (1 + K lat) cos t, v = V
KNOWN = 0.0008  # [rad] of latitude north of which nothing is known


@ti.func
def shear(features: ti.template(), sea: ti.template(), own: ti.template(), lon, lat, fraction):
    """A flow that grows with latitude and turns with the step, known south of KNOWN only where
    features says so.
    """
    phi = ti.cast(lat, ti.f32) * ti.f32(UNIT)
    valid = 1.0
    if ti.static(features):
        valid = ti.cast(phi < KNOWN, ti.f32)
    u = ti.f32(SHEAR[0]) * (1.0 + ti.f32(SHEAR[1]) * phi) * (1.0 - fraction)
    return ti.Vector([u, own * (0.5 + fraction), valid])


@ti.kernel
def _integrate(
    scheme: ti.template(),
    ends: ti.template(),
    speed: ti.f32,
    dt: ti.f32,
    lat: Ints,
    east: Reals,
    north: Reals,
    out: Reals,
):
    for i in range(lat.shape[0]):
        phi = lat[i] * ti.f32(UNIT)
        way = integrate.Way(last=f32x2(0.0), total=f32x2(0.0), valid=1.0, sets_off=1.0)
        for stage in range(ti.static(scheme)):  # a scheme of order 2 or 4 has as many stages
            entry = integrate.tableau(
                ti.static(integrate.CLASSICAL if scheme == 4 else integrate.MIDPOINT), stage
            )
            way = integrate.lead(
                shear, True, ends, 0, speed, way, 12345, lat[i], ti.cos(phi), ti.sin(phi), dt, 0.125 + entry[0] * 0.5,
                entry, f32x2(east[i], north[i]),
            )  # fmt: skip
        led = integrate.led(way)
        out[4 * i], out[4 * i + 1], out[4 * i + 2], out[4 * i + 3] = (
            led[0],
            led[1],
            way.valid,
            way.sets_off,
        )


def stages(
    scheme: tuple, lat: float, dt: float, speed: float, known: float
) -> tuple[float, float, float]:
    """Return (dlon, dlat) [rad] and whether all stages know the flow, in float64."""
    dlon = dlat = total_lon = total_lat = 0.0
    for at, part in zip(*scheme, strict=True):
        phi, fraction = lat + at * dlat, 0.125 + 0.5 * at
        if phi >= known:
            return dlon, dlat, 0.0
        u = SHEAR[0] * (1 + SHEAR[1] * phi) * (1 - fraction)
        dlon, dlat = u * dt / RADIUS / np.cos(phi), speed * (0.5 + fraction) * dt / RADIUS
        total_lon, total_lat = total_lon + part * dlon, total_lat + part * dlat
    return total_lon, total_lat, 1.0


@pytest.mark.parametrize(("order", "scheme"), [(2, integrate.MIDPOINT), (4, integrate.CLASSICAL)])
@pytest.mark.parametrize("dt", [3600.0, -2700.0])
def test_a_step_is_that_of_its_scheme_in_float64(order: int, scheme: tuple, dt: float) -> None:
    """Both ways in time; where a stage finds nothing, the way is that of the last that did.

    Stages start on whole units.
    """
    speed = 1.1 if dt > 0 else -1.1
    lat = np.round(np.linspace(-1e-4, KNOWN * 1.1, 300) / UNIT).astype(np.int32)
    zeros = np.zeros(300, np.float32)
    for ends in (False, True):
        out = np.zeros(1200, np.float32)
        _integrate(order, ends, speed, dt, lat, zeros, zeros, out)
        exact = np.array([stages(scheme, y * UNIT, dt, speed, KNOWN if ends else 1.0) for y in lat])
        got = out.reshape(-1, 4)
        same = got[:, 2] == exact[:, 2]
        assert same.sum() >= 298  # a stage within a unit of the limit may fall on either side
        way = np.abs(exact[same][:, :2]).max() / UNIT
        # of a stage that starts a unit off
        shift = SHEAR[0] * SHEAR[1] * UNIT * abs(dt) / RADIUS / UNIT
        assert np.abs(got[same, :2] - exact[same][:, :2] / UNIT).max() <= 4 * shift + 32 * EPS * way
        assert (got[:, 3] == 1).all()
        assert ends == (exact[:, 2] == 0).any()


def test_a_particle_sets_off_where_the_drift_leads_off_the_beach() -> None:
    """The first stage decides: its velocity, at the step's begin, along the way off the beach;
    forward and backward in time.
    """
    angle = np.linspace(0, 2 * np.pi, 721)[:-1] + 1e-3
    lat = np.full(angle.size, round(2e-4 / UNIT), np.int32)
    east, north = reals(np.cos(angle), np.sin(angle))
    out = np.zeros(4 * angle.size, np.float32)
    _integrate(4, False, -0.7, 1800.0, lat, east, north, out)
    u, v = SHEAR[0] * (1 + SHEAR[1] * 2e-4) * (1 - 0.125), -0.7 * 0.625
    along = u * np.cos(angle) + v * np.sin(angle)
    clear = np.abs(along) > 1e-6
    assert ((out[3::4] == 1) == (along > 0))[clear].all()
    _integrate(
        4,
        True,
        -0.7,
        1800.0,
        np.full(angle.size, round(2 * KNOWN / UNIT), np.int32),
        east,
        north,
        out,
    )
    assert (out[3::4] == 0).all()  # nor where nothing is known


@ti.func
def spreading(features: ti.template(), sea: ti.template(), own: ti.template(), lon, lat, fraction):
    """u = 3 sin(2 lon + 1), v = 2 sin(lat - 0.4) [m/s], known everywhere, or west of the prime
    meridian alone.
    """
    x, y = ti.cast(lon, ti.f32) * ti.f32(UNIT), ti.cast(lat, ti.f32) * ti.f32(UNIT)
    valid = 1.0
    if ti.static(features):
        valid = ti.cast(lon < 0, ti.f32)
    return ti.Vector([3.0 * ti.sin(2.0 * x + 1.0), 2.0 * ti.sin(y - 0.4), valid])


@ti.kernel
def _divergence(ends: ti.template(), lon: Ints, lat: Ints, out: Reals):
    for i in range(lon.shape[0]):
        out[i] = integrate.divergence(spreading, ends, 0, 0, lon[i], lat[i], 0.3)


def test_a_divergence_is_that_on_the_sphere() -> None:
    """du/dlon / (R cos) + dv/dlat / R - v tan / R: differences over 400 m of 3 m/s are right to
    three roundings of it.
    """
    n = 3000
    x, y = RNG.uniform(-1.5, 1.5, n), RNG.uniform(-1.3, 1.3, n)
    lon, lat = np.round(x / UNIT).astype(np.int32), np.round(y / UNIT).astype(np.int32)
    out = np.zeros(n, np.float32)
    _divergence(False, lon, lat, out)
    u_x, v_y = 6 * np.cos(2 * x + 1), 2 * np.cos(y - 0.4)
    exact = (u_x / np.cos(y) + v_y - 2 * np.sin(y - 0.4) * np.tan(y)) / RADIUS
    # Coordinates, cast to float32, err by eps of themselves; sines of them by as much, and by their
    # own rounding.
    noise = (3 * (2 * 1.5 + 1) + 2 * 1.7 + 8) * EPS * 2 * 2 / 400.0
    assert np.abs(out - exact).max() < noise + 200.0 * 12 / RADIUS**2 / np.cos(1.3)
    _divergence(True, lon, lat, out)
    assert (out[lon > 300 / RADIUS / UNIT / np.cos(1.3)] == 0).all()
