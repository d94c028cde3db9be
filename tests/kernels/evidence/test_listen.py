"""What the kernels of listening make of places and times, where a closed form says it: targets and
sonars at rest.

Of a signal excess that stays the same, nothing is heard in a time T with probability (1 - p)
exp(-rate p T). The excess is that of pyproj's geodesics.
"""

from pathlib import Path

import numpy as np
import pyproj
import pytest
import sonars
import taichi as ti
from scipy import interpolate, special
from sonars import Sonar, run

from kernels.evidence import listen

Reals = ti.types.ndarray(dtype=ti.f32, ndim=1)
Reals2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
Ints = ti.types.ndarray(dtype=ti.i32)
RANGES = np.concatenate([[0, 500, 1000], np.arange(2000, 760_001.0, 2000)])
RADIALS = np.arange(0, 360, 24.0)
WATCH = '[[sortie]]\nname = "w"\nstart = "+0.4 h"\nend = "+4.9 h"\nwatch = { sensor = "ears" }\n'


def standing(at: tuple[float, float], **more: object) -> Sonar:
    """Return a sonar that stands, whose losses, noise and gains are those of no two bearings."""
    loss = 66 + 14 * np.log10(1 + RANGES / 1000) + 6 * np.sin(np.radians(RADIALS + 20))[:, None]
    sides, around = np.arange(0, 360, 20.0), np.arange(0, 360, 40.0)
    return Sonar(
        radials=RADIALS, ranges=RANGES, loss=np.round(loss, 3)[None], around=around, at=at, heading=77.0,
        noise=np.round(70 + 3 * np.sin(np.radians(around + 100)), 3)[None], sides=sides,
        gain=np.round(5 * np.cos(np.radians(sides - 40)), 3), **more,
    )  # fmt: skip


def scenario(name: str, at: tuple[float, float], std: str) -> str:
    return f'[[scenario]]\nname = "{name}"\nobject = "water"\nposition = {{ at = {list(at)}, std = "{std}" }}\n'


STILL = '[[current]]\nconstant = { speed = "0 kn", toward = 0 }\n'


@pytest.mark.parametrize("step", [pytest.param(7, marks=pytest.mark.thorough), 60])
@pytest.mark.parametrize(
    ("at", "middle", "std", "level"),
    [
        ((179.9, -31.7), (-179.8, -31.6), "20 nmi", 139.0),
        ((-20.0, 80.0), (-16.0, 80.5), "40 nmi", 165.0),
        ((100.0, 88.0), (-120.0, 88.2), "12 nmi", 184.0),
        ((-30.0, 36.0), (-30.01, 36.01), "0.7 nmi", 143.0),
        ((-30.0, 36.0), (-23.3, 39.2), "20 nmi", 187.0),
        ((-177.0, 52.0), (175.0, 49.0), "30 nmi", 177.0),
    ],
    ids=["antimeridian", "80 N", "over the pole", "2 km", "700 km", "600 km and the antimeridian"],
)
def test_signal_excess_anywhere(
    tmp_path: Path, at, middle, std: str, level: float, step: int
) -> None:
    """Log weights to 3e-4: of float32, 700 km are known to 0.1 m, and 360 degrees of gains are 0.1
    apart: 0.003 dB.
    """
    sonar = standing(at, levels={"here": level})
    ran = run(
        tmp_path,
        STILL + scenario("here", middle, std) + sonar.text(tmp_path) + WATCH,
        particles=400,
        step=step,
    )
    lon, lat = ran.first.T
    p = special.ndtr((sonar.excess(at, 77.0, 0.0, lon, lat) + level) / sonar.fluctuation)
    expected = np.log1p(-p) - sonar.rate * p * 4.5
    assert np.ptp(p) > 0.1
    # by the decibel
    slope = (1 / (1 - p) + 4.5) * np.exp(-0.5 * special.ndtri(p) ** 2) / np.sqrt(2 * np.pi) / 6
    off = np.abs(ran.said - expected)
    assert np.all(off < 0.01 * slope + 2e-5), (off / slope).max()


def test_it_hears_nothing_beyond_its_table(tmp_path: Path) -> None:
    """Not a bit changes, however loud what lies there is."""
    sonar = standing((-30.0, 36.0), levels={"here": 200.0})
    ran = run(
        tmp_path, STILL + scenario("here", (-20.5, 38.0), "9 nmi") + sonar.text(tmp_path) + WATCH
    )
    assert sonars.toward((-30.0, 36.0), *ran.first.T)[1].min() > RANGES[-1]
    assert (ran.said == 0).all()
    near = scenario("here", (-29.5, 36.0), "3 nmi")
    silent = standing((-30.0, 36.0), levels={"here": 60.0})
    assert (run(tmp_path, STILL + near + silent.text(tmp_path) + WATCH).said == 0).all()


def test_between_the_ends_of_a_part_nothing_is_louder_than_the_limits_say() -> None:
    """On straight parts as long as they allow, told in 200 places by SciPy's interpolation, on
    either side of the nearest point.
    """
    random = np.random.default_rng(5)
    rays, rings, sides, far = 12, 121, 360, 60_000.0
    smooth = 5 * np.sin(np.arange(rings) / 9 + random.random((rays, 1))) + 12 * np.log1p(
        np.arange(rings)
    )
    rough = np.where(np.arange(rings) % 40 < 10, 3 * random.random((rays, rings)), 0.0)
    losses = (60 + smooth + rough).astype(np.float32)
    gains = (
        4 * np.cos(np.arange(sides) / 9) + random.random(sides) * (np.arange(sides) < 60)
    ).astype(np.float32)
    tables = listen.Tables(
        losses, 0.0, far / (rings - 1), gains, np.zeros((1, 1)), np.zeros(1, np.float32), 6.0, 1e-3
    )
    longest, best, widest = np.split(listen.limits(tables).astype(float), [rings, 2 * rings])
    ring, turn = np.linspace(0, far, rings), np.linspace(0, 1, rays + 1)
    lost = interpolate.RegularGridInterpolator((turn, ring), np.vstack([losses, losses[:1]]))
    beyond, changed, parts = [], [], []
    for _ in range(3000):
        a = random.normal(0, 20_000, 2)
        ahead = random.uniform(0, 2 * np.pi)
        on = np.array([np.sin(ahead), np.cos(ahead)])
        away, aside = float(np.hypot(*a)), abs(float(a[0] * on[1] - a[1] * on[0]))
        if away > far - 20_000:
            continue
        bearing = np.arctan2(*a) % (2 * np.pi)
        wide = widest[int(bearing / (2 * np.pi) * sides)] * away
        part = min(longest[int(away / far * (rings - 1))], wide * away / (aside + wide))
        to_nearest = -float(a @ on)
        part = min(part, to_nearest) if to_nearest > 0 else part
        way = a + np.linspace(0, part, 200)[:, None] * on
        reach = np.hypot(*way.T)
        share = np.unwrap(np.arctan2(*way.T)) / (2 * np.pi)
        excess = np.interp(share, np.arange(sides) / sides, gains, period=1)
        excess -= lost(np.stack([share % 1, reach], axis=1))
        beyond.append(excess.max() - max(excess[0], excess[-1]))
        changed.append(abs(excess[-1] - excess[0]))
        parts.append(part)
        assert excess.max() <= best[int(reach.min() / (far / (rings - 1)))] + 1e-3
    # Losses by range, losses by bearing and gains each have their share.
    assert max(beyond) <= 3 * listen.HIDDEN + 1e-3
    assert max(changed) <= 3 * listen.STEEP + 1e-3
    assert max(beyond) > 0.5 * listen.HIDDEN  # and they are not as short as that nothing could be
    assert np.mean(np.array(parts) > far / (rings - 1)) > 0.2


@ti.kernel
def _out_of_reach(ear: listen.Ear, at: Ints, stray: Reals, found: Ints):
    for i in range(found.shape[0]):
        found[i] = listen.out_of_reach(ear, at[i, 0], at[i, 1], at[i, 2], at[i, 3], stray[i])


def track(begin: np.ndarray, end: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Return lon, lat [deg] on a way straight in longitude and latitude, (n, shares, 2), across the
    antimeridian too.
    """
    d = end - begin
    d[..., 0] = (d[..., 0] + 180) % 360 - 180
    return begin[:, None] + share[:, None] * d[:, None]


@pytest.mark.parametrize(("sonar", "target"), [(40e3, 3e3), (2e3, 30e3), (25e3, 25e3), (0.0, 0.0)])
def test_nothing_that_comes_into_reach_is_passed_over(sonar: float, target: float) -> None:
    """Both go so far [m], and the target strays from its way: how near they come anywhere on it, by
    pyproj.

    What is out of reach by all that they go in longitude and latitude, as if at the equator, and a
    ring of the table, is passed over.
    """
    random = np.random.default_rng(17)
    far, n, share = 60_000.0, 2000, np.linspace(0, 1, 33)
    loud = np.array([[190.0]], np.float32)
    tables = listen.Tables(np.full((4, 121), 70, np.float32), 0.0, far / 120, np.zeros(8, np.float32), loud, np.zeros(1, np.float32), 6.0, 1e-3)  # fmt: skip
    geod = pyproj.Geod(a=listen.sphere.RADIUS, b=listen.sphere.RADIUS)
    turn = 2**32 / 360
    for begin in ((179.7, 47.6), (-33.1, -62.3)):
        own = np.array([begin, geod.fwd(*begin, 63.0, sonar)[:2]])
        low, high = (tuple(int(v) for v in np.round(((x + 180) % 360 - 180) * turn)) for x in own)
        stretch = listen.Stretch(0.0, 3600.0, (low[0], low[1]), (high[0], high[1]))
        laid = listen.laid(stretch, tables, np.zeros(1, np.float32))
        away = random.uniform(0.7, 1.3, n) * far + random.uniform(-0.5, 4.0, n) * (sonar + target)
        ahead = np.where(
            random.random(n) < 0.5, random.uniform(30, 100, n), random.uniform(0, 360, n)
        )
        x, y, _ = geod.fwd(*(np.full(n, v) for v in begin), ahead, np.abs(away))
        to = geod.fwd(x, y, random.uniform(0, 360, n), np.full(n, target))[:2]
        stray = random.uniform(0, 4000, n).astype(np.float32)
        places = np.stack([x, y, *to], axis=1)
        at = np.round(
            np.where([True, False, True, False], (places + 180) % 360 - 180, places) * turn
        ).astype(np.int32)
        found = np.zeros(n, np.int32)
        _out_of_reach(laid.ear, at, stray, found)
        one, other = (
            track(places[:, :2], places[:, 2:].copy(), share),
            track(own[:1], own[1:].copy(), share),
        )
        other = np.broadcast_to(other, one.shape)
        apart = geod.inv(other[..., 0], other[..., 1], one[..., 0], one[..., 1])[2]
        least = apart.min(axis=1)
        assert not found[least - stray <= far].any()
        assert np.sum(least - stray <= far) > 100
        goes = sum(
            np.abs((d + 180) % 360 - 180).sum(axis=1)
            for d in (places[:, 2:] - places[:, :2], own[1:] - own[:1])
        )
        beyond = (
            apart[:, 0]
            > 1.01 * (far + stray + np.radians(goes) * listen.sphere.RADIUS)
            + far / 120
            + listen.MARGIN
        )
        assert found[beyond].all()
        assert beyond.sum() > 100


@ti.kernel
def _numbers(
    way: Reals2, speed: Reals, turn: Reals, level: Reals, paces: Reals, table: Reals, found: Reals2
):
    for i in range(found.shape[0]):
        found[i, 0] = listen.share_of_turn(listen.f32x2(way[i, 0], way[i, 1]))
        found[i, 1] = listen.level(level, paces, 1, speed[i])
        found[i, 2] = listen.round_table(table, 5, 3, 2, turn[i])


def test_bearings_levels_and_tables_between_their_entries() -> None:
    """Levels of the second of three scenarios, of whatever speed; the last of three columns of a
    table that goes round.
    """
    random = np.random.default_rng(6)
    n = 4000
    way, speed, turn = (
        random.normal(0, 9e3, (n, 2)),
        random.uniform(-1, 14, n),
        random.uniform(-9, 9, n),
    )
    way[:4] = [[0, 1], [1, 0], [0, -1], [-1, 0]]
    paces, levels, table = (
        np.array([1.5, 2.0, 6.5, 11.0]),
        random.uniform(130, 170, (3, 4)),
        random.uniform(60, 90, (5, 3)),
    )
    found = np.zeros((n, 3), np.float32)
    _numbers(
        *(
            np.ascontiguousarray(x, np.float32)
            for x in (way, speed, turn, levels.ravel(), paces, table.ravel())
        ),
        found,
    )
    bearing = np.arctan2(way[:, 0], way[:, 1]) / (2 * np.pi) % 1
    off = (found[:, 0] - bearing + 0.5) % 1 - 0.5
    assert np.abs(off).max() * 2 * np.pi < 1.25e-5  # the formula has 1.2e-5, its book says 1e-5
    assert ((found[:, 0] >= 0) & (found[:, 0] < 1)).all()
    np.testing.assert_allclose(found[:, 1], np.interp(speed, paces, levels[1]), rtol=1e-6)
    around = np.interp(
        turn % (2 * np.pi), np.linspace(0, 2 * np.pi, 6), np.append(table[:, 2], table[0, 2])
    )
    np.testing.assert_allclose(
        found[:, 2], around, atol=2e-4
    )  # an angle of 9 rad is known to 5e-7, and slopes are 24 a radian


@pytest.mark.parametrize("spread", [3.0, 4.0])
def test_reach_is_that_of_the_loudest_at_its_best(spread: float) -> None:
    """Of all scenarios and speeds, with the best of what is unknown and the best bearings: as far
    as 5.3 deviations below 0, to a ring.
    """
    random = np.random.default_rng(3)
    range_ = 300.0 + 250.0 * np.arange(500)
    losses = (60 + 18 * np.log10(range_ / 300) + random.uniform(-4, 4, (6, 1))).astype(np.float32)
    gains = random.uniform(-5, 5, 12).astype(np.float32)
    levels, offsets = (
        np.array([[61.0, 66.0], [49.0, 54.5]], np.float32),
        np.array([-5.0, 0.0, 4.5], np.float32),
    )
    tables = listen.Tables(
        losses, 300.0, 250.0, gains, levels, np.array([0.0, 9.0], np.float32), spread, 1e-3
    )
    laid = listen.laid(listen.Stretch(0.0, 600.0, (0, 0), (0, 0)), tables, offsets)
    best = 66.0 + 4.5 + gains.max() - losses.min(axis=0)
    farthest = range_[np.flatnonzero(best > -5.3 * spread)[-1]]
    assert 10e3 < farthest < range_[-1] - 1000
    assert farthest <= laid.ear.reach <= farthest + 250.0 + listen.MARGIN
