"""What the kernels of listening make of places and times, where a closed form says it: targets and sonars at rest.

Of a signal excess that stays the same, nothing is heard in a time T with probability (1 - p) exp(-rate p T). The excess is
that of pyproj's geodesics.
"""

from pathlib import Path

import numpy as np
import pytest
import sonars
from scipy import interpolate, special
from sonars import Sonar, run

from kernels import listen

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


@pytest.mark.parametrize("step", [7, 60])
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
def test_signal_excess_anywhere(tmp_path: Path, at, middle, std: str, level: float, step: int) -> None:
    """Log weights to 3e-4: of float32, 700 km are known to 0.1 m, and 360 degrees of gains are 0.1 apart: 0.003 dB."""
    sonar = standing(at, levels={"here": level})
    ran = run(tmp_path, STILL + scenario("here", middle, std) + sonar.text(tmp_path) + WATCH, particles=400, step=step)
    lon, lat = ran.first.T
    p = special.ndtr((sonar.excess(at, 77.0, 0.0, lon, lat) + level) / sonar.fluctuation)
    expected = np.log1p(-p) - sonar.rate * p * 4.5
    assert np.ptp(p) > 0.1
    slope = (1 / (1 - p) + 4.5) * np.exp(-0.5 * special.ndtri(p) ** 2) / np.sqrt(2 * np.pi) / 6  # by the decibel
    off = np.abs(ran.said - expected)
    assert np.all(off < 0.01 * slope + 2e-5), (off / slope).max()


def test_it_hears_nothing_beyond_its_table(tmp_path: Path) -> None:
    """Not a bit changes, however loud what lies there is."""
    sonar = standing((-30.0, 36.0), levels={"here": 200.0})
    ran = run(tmp_path, STILL + scenario("here", (-20.5, 38.0), "9 nmi") + sonar.text(tmp_path) + WATCH)
    assert sonars.toward((-30.0, 36.0), *ran.first.T)[1].min() > RANGES[-1]
    assert (ran.said == 0).all()
    near = scenario("here", (-29.5, 36.0), "3 nmi")
    silent = standing((-30.0, 36.0), levels={"here": 60.0})
    assert (run(tmp_path, STILL + near + silent.text(tmp_path) + WATCH).said == 0).all()


def test_between_the_ends_of_a_part_nothing_is_louder_than_the_limits_say() -> None:
    """On straight parts as long as they allow, told in 200 places by SciPy's interpolation, on either side of the nearest point."""
    random = np.random.default_rng(5)
    rays, rings, sides, far = 12, 121, 360, 60_000.0
    smooth = 5 * np.sin(np.arange(rings) / 9 + random.random((rays, 1))) + 12 * np.log1p(np.arange(rings))
    rough = np.where(np.arange(rings) % 40 < 10, 3 * random.random((rays, rings)), 0.0)
    losses = (60 + smooth + rough).astype(np.float32)
    gains = (4 * np.cos(np.arange(sides) / 9) + random.random(sides) * (np.arange(sides) < 60)).astype(np.float32)
    tables = listen.Tables(losses, 0.0, far / (rings - 1), gains, np.zeros((1, 1)), np.zeros(1, np.float32), 6.0, 1e-3)
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
