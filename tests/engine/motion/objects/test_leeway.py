"""The leeway table against the published figures and OpenDrift's transcription; the law of a
particle's own line.
"""

import numpy as np
import pytest
from places import DATA
from scipy import stats

from drift.engine.motion.models import drift as drift_model
from drift.engine.motion.models.drift import COLUMNS
from drift.engine.motion.objects import leeway
from drift.engine.particles import ensemble as record
from drift.engine.particles.ensemble import Slots
from geo import sphere
from geo.errors import UserError
from geo.grids.grid import Grid
from kernels.maths.noise import key
from kernels.step import advance
from kernels.step import prior as draw
from kernels.step.sample import Tiles

N = 100_000
EVERYWHERE = advance.Domain(-(2**31), -(2**30), 2**32 - 1, 2**31)


def figures(drifter: leeway.Drifter) -> list[float]:
    lines = (drifter.down, drifter.right, drifter.left)
    # %, cm/s, cm/s
    return [100 * value for line in lines for value in (line.slope, line.offset, line.std)]


def test_published_figures() -> None:
    # Allen and Plourde 1999, table 8-1, and Breivik and Allen 2008, table 1 for the person in the
    # water.
    assert figures(leeway.find_class("PIW-1")) == pytest.approx(
        [0.96, 0, 12, 0.54, 0, 9.4, -0.54, 0, 9.4]
    )
    raft = leeway.find_class("LIFE-RAFT-DB-10")
    assert figures(raft) == pytest.approx([3.52, -2.5, 6.1, 0.62, -3.0, 3.5, -0.45, -0.2, 3.6])
    assert raft.jibes
    assert raft.uses_wind


def test_every_figure_as_transcribed() -> None:
    source = DATA / "leeway" / "OBJECTPROP.DAT"
    if not source.is_file():
        pytest.skip(f"no {source}; set DRIFT_DATA")
    lines = source.read_text().splitlines()
    rows = [(lines[k].split()[0], lines[k + 1], lines[k + 2]) for k in range(0, 255, 3)]
    assert [name for name, _, _ in rows] == list(leeway.classes())[:85]
    for name, description, numbers in rows:
        drifter = leeway.find_class(name)
        assert figures(drifter) == pytest.approx(
            [float(text) for text in numbers.split()], abs=1e-12
        )
        assert drifter.level == description.strip().count(">")


def test_table_is_whole() -> None:
    sources = [drifter.source for drifter in leeway.classes().values()]
    assert sources[:85] == [leeway.COAST_GUARD] * 85
    assert leeway.COAST_GUARD not in sources[85:]
    assert (
        sum(
            d.left.slope != -d.right.slope or d.left.offset != -d.right.offset
            for d in leeway.classes().values()
        )
        > 15
    )
    assert all(drifter.description for drifter in leeway.classes().values())
    assert not leeway.find_class(
        "SLDMB"
    ).uses_wind  # the datum marker buoy is built to follow the water


def test_error_at_10_metres_per_second_is_the_regressions() -> None:
    line = leeway.find_class("PIW-3").right
    wind = np.array([0.0, 10.0, 20.0])
    np.testing.assert_allclose(
        line.slope_std * wind + line.offset_std, line.std * np.array([0.5, 1.0, 1.5])
    )


def test_find_in_any_case_and_water() -> None:
    assert leeway.find_class("sailboat-6B").name == "SAILBOAT-6b"
    assert leeway.find_class("Water") == leeway.WATER
    assert not leeway.WATER.uses_wind


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("LIFERAFT-DB-10", 'nearest is "LIFE-RAFT-DB-10"'),
        ("LIFE-RAFT-DB-99", "nearest is"),
        ("kayak", 'such as "PERSON-POWERED-VESSEL-1"'),
        ("zzzz", "See: drift objects"),
    ],
)
def test_unknown_class_is_refused_with_the_nearest(name: str, words: str) -> None:
    with pytest.raises(UserError, match=words):
        leeway.find_class(name)


def test_search_takes_every_word_and_looks_at_main_classes() -> None:
    assert [drifter.name for drifter in leeway.search_classes("life raft 15-50 LIGHT")] == [
        "LIFE-RAFT-DB-19"
    ]
    assert leeway.search_classes("") == list(leeway.classes().values())
    assert leeway.search_classes("raft spaceship") == []


def lines(drifter: leeway.Drifter, seed: int = 5) -> record.Ensemble:
    """Return an ensemble of N particles with their own lines of a class."""
    ensemble = record.empty(seed, (0, N), COLUMNS)
    drift_model.draw_leeway(ensemble, Slots(0, N, 0), key(seed), drifter)
    return ensemble


def cut(line: leeway.Line) -> stats.rv_continuous:
    """Return the standard normal law of xi, cut where the line's slope becomes negative."""
    return stats.truncnorm(-line.slope / line.slope_std, np.inf)


@pytest.mark.parametrize("name", ["PIW-1", "PIW-2", "SEPIRB", "LIFE-RAFT-DB-10"])
def test_downwind_lines_follow_the_normal_law_cut_at_slope_zero(name: str) -> None:
    """Slope against scipy's truncated normal: Kolmogorov-Smirnov (0.1 %), mean and variance; the
    offset moves with it.

    Of the raft, 11.5 standard deviations from slope 0, the law is the normal one to the last digit.
    """
    line = leeway.find_class(name).down
    ensemble = lines(leeway.find_class(name))
    slope, offset = (
        ensemble.own[f"down_{what}"].to_numpy().astype(float) for what in ("slope", "offset")
    )
    assert slope.min() >= 0
    law, xi = cut(line), (slope - line.slope) / line.slope_std
    assert stats.kstest(xi, law.cdf).statistic < 1.95 / np.sqrt(N)
    mean, variance, _, excess = (float(m) for m in law.stats("mvsk"))
    assert abs(xi.mean() - mean) < 4.5 * np.sqrt(variance / N)
    assert abs(xi.var() / variance - 1) < 4.5 * np.sqrt((excess + 2) / N)
    # float32: both are sums of two numbers, each rounded to a part in 2**24 of the larger.
    rounding = 2**-22 * (max(line.slope, abs(line.offset) / 10) / line.slope_std + 8)
    assert np.abs(offset - line.offset - line.offset_std * xi).max() < rounding * line.offset_std


def test_moments_of_the_two_classes_that_the_cut_changes_most() -> None:
    """At 10 m/s: a normal cut at -a/s has the mean l and the variance 1 - (a/s) l - l^2, l =
    phi(a/s) / Phi(a/s).
    """
    for name, mean, std in (("PIW-1", 0.110, 0.107), ("PIW-2", 0.0674, 0.0682)):
        line, ensemble = leeway.find_class(name).down, lines(leeway.find_class(name))
        ratio = line.slope / line.slope_std
        up = stats.norm.pdf(ratio) / stats.norm.cdf(ratio)
        exact = line.slope * 10 + line.std * up, line.std * np.sqrt(1 - ratio * up - up**2)
        assert exact == pytest.approx((mean, std), abs=5e-4)  # the figures of docs/leeway.md
        speed = (
            ensemble.own["down_slope"].to_numpy().astype(float) * 10
            + ensemble.own["down_offset"].to_numpy()
        )
        assert abs(speed.mean() - exact[0]) < 4.5 * exact[1] / np.sqrt(N)
        # The tails are lighter than the normal's, and so the standard error is smaller than this.
        assert speed.std() == pytest.approx(exact[1], rel=4.5 / np.sqrt(2 * N))


def test_crosswind_lines_keep_the_normal_law_whole() -> None:
    """The right line of PIW-2 has 0.15 +- 0.335 %: a third of the objects drift to the left of its
    mean's side.
    """
    line = leeway.find_class("PIW-2").right
    slope = lines(leeway.find_class("PIW-2")).own["right_slope"].to_numpy().astype(float)
    assert stats.kstest(
        (slope - line.slope) / line.slope_std, stats.norm.cdf
    ).statistic < 1.95 / np.sqrt(N)


def test_what_needs_no_second_draw_keeps_its_bits() -> None:
    """Cut or not, a particle whose first slope is not negative has the same line, to the last bit."""
    line = leeway.find_class("PIW-2").down
    whole, half = record.empty(5, (0, N), COLUMNS), lines(leeway.find_class("PIW-2"))
    figures = line.slope, line.offset, line.slope_std, line.offset_std
    draw.draw_object(
        0, N, 0, whole.own["down_slope"], whole.own["down_offset"], 0, *key(5), *figures, -np.inf
    )
    first = whole.own["down_slope"].to_numpy()
    share = stats.norm.cdf(-line.slope / line.slope_std)
    assert abs((first < 0).mean() - share) < 4.5 * np.sqrt(share * (1 - share) / N)
    for column in ("down_slope", "down_offset"):
        before, after = (which.own[column].to_numpy() for which in (whole, half))
        np.testing.assert_array_equal(before[first >= 0], after[first >= 0])
        assert (before[first < 0] != after[first < 0]).all()


def test_a_slope_that_never_passes_is_the_least_one() -> None:
    """No loop without end: 100 standard deviations below 0 every draw fails, and the line of slope
    0 is left.
    """
    ensemble = record.empty(5, (0, 1000), COLUMNS)
    draw.draw_object(
        0,
        1000,
        0,
        ensemble.own["down_slope"],
        ensemble.own["down_offset"],
        0,
        *key(5),
        -0.1,
        0.02,
        0.001,
        0.01,
        0.0,
    )
    assert (ensemble.own["down_slope"].to_numpy() == 0).all()
    np.testing.assert_allclose(ensemble.own["down_offset"].to_numpy(), 0.02 + 0.01 * 100, rtol=1e-5)


def adrift(ensemble: record.Ensemble, east: float, north: float) -> np.ndarray:
    """Return way east and north in an hour [m], shape (2, n), from one place in a steady wind [m/s]
    everywhere.
    """
    n = ensemble.n
    ensemble.lon.fill(int(sphere.to_binary(179.95)))
    ensemble.lat.fill(int(sphere.to_binary(-41.0)))
    tiles = Tiles([Grid(-180, -90, 360, 180, 2, 2)])
    for later in (False, True):
        tiles.place(0, np.full((2, 2, 2), (east, north), np.float32), later=later)
    tiles.blend([(0.0, 0.0)])
    step = advance.Step(0, 0, 3600, 1)
    advance.advance(
        ensemble,
        (0, n, 0),
        tiles,
        {"wind": (0, 1)},
        advance.Physics(),
        step,
        advance.Surroundings(EVERYWHERE),
    )
    lon, lat = (c.to_numpy() * sphere.UNIT for c in (ensemble.lon, ensemble.lat))
    return np.array(sphere.offset(np.radians(179.95), np.radians(-41.0), lon, lat))


@pytest.mark.parametrize("wind", [2.0, 10.0, 20.0])
@pytest.mark.parametrize("name", ["PIW-2", "PIW-3"])
def test_as_many_go_upwind_as_the_law_says(name: str, wind: float) -> None:
    """Share of particles that an hour of wind moves against it, by the engine, against the cut
    normal law.

    With (a, b) the line and s the slope's error, speed is a W + b + s (W + 10) xi.
    """
    line = leeway.find_class(name).down
    east, north = 0.6 * wind, -0.8 * wind
    way = adrift(lines(leeway.find_class(name)), east, north)
    down = (0.6 * way[0] - 0.8 * way[1]) / 3600
    share = cut(line).cdf(-(line.slope * wind + line.offset) / (line.slope_std * (wind + 10)))
    # positions: 9 mm in 3600 s
    assert abs((down < 0).mean() - share) < 4.5 * np.sqrt(share * (1 - share) / N) + 1e-4
    mean = line.slope * wind + line.offset + line.slope_std * (wind + 10) * cut(line).mean()
    assert abs(down.mean() - mean) < 4.5 * line.slope_std * (wind + 10) / np.sqrt(N) + 1e-5


def test_in_light_wind_lines_hold_as_published() -> None:
    """17 classes lead upwind below -offset/slope:

    PIW-3 at 1 m/s by 3.98 - 1.60 cm/s; no floor, no fade-out.
    """
    classes = leeway.classes()
    assert sum(drifter.lull > 0 for drifter in classes.values()) == 17
    assert leeway.find_class("PIW-3").lull == pytest.approx(3.98 / 1.6)
    assert leeway.find_class("SLDMB").lull == leeway.find_class("PIW-1").lull == 0
    ensemble = record.empty(5, (0, 1), COLUMNS)
    line = leeway.find_class("PIW-3").down
    ensemble.own["down_slope"].fill(line.slope)
    ensemble.own["down_offset"].fill(line.offset)
    for wind, speed in ((1.0, -0.0238), (3.98 / 1.6, 0.0), (5.0, 0.0402)):
        way = adrift(ensemble, 0.6 * wind, -0.8 * wind)
        # two positions of 9 mm, float32
        assert 0.6 * way[0] - 0.8 * way[1] == pytest.approx(3600 * speed, abs=0.05)
