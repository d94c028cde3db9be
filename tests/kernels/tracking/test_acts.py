"""Targets that act at times of their own, seek a tracker or flee from it: every act against pyproj,
SciPy and NumPy.
"""

from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from pyproj import Geod
from scipy import stats
from targets import KNOT, PERIOD, Fleet

from drift.engine.motion.steering.itinerary import Acts, Followed, Itinerary, Spread
from geo import sphere

FREE, SEEKING, HIDING = 1, 2, 3
GLOBE = Geod(a=sphere.RADIUS, b=sphere.RADIUS)
AT = (179.71, -60.8)  # the targets; the tracker crosses 180 degrees
# [s], [deg]; then it stays
VERTICES = ((0.0, 179.91, -61.3), (1100.0, -179.98, -61.28), (2000.0, -179.93, -61.33))
TRACKER = Followed(
    PERIOD.start,
    tuple(v[0] for v in VERTICES), tuple(np.radians(v[1]) for v in VERTICES), tuple(np.radians(v[2]) for v in VERTICES),
)  # fmt: skip
FASTEST = 33 * KNOT
LAW = Acts(
    Spread(np.radians(200), np.radians(380), np.radians(230), 3.0), Spread(4.0, 9.0, 7.0, 2.0), FASTEST, (180.0, 900.0),
    change=0.35, seek=0.25, hide=0.15, leave=0.3, spread=np.radians(25), tracker=TRACKER,
)  # fmt: skip
N, LASTING = 2500, 2400


def tracker(time: int) -> tuple[float, float, float, float]:
    """Return (lon, lat) [deg], course [rad] and speed [m/s] of the tracker at a time, by geodesics
    of the sphere.
    """
    for (t0, x0, y0), (t1, x1, y1) in pairwise(VERTICES):
        if t0 <= time < t1:
            toward, _, far = GLOBE.inv(x0, y0, x1, y1)
            x, y, _ = GLOBE.fwd(x0, y0, toward, far * (time - t0) / (t1 - t0))
            return x, y, np.radians(GLOBE.inv(x, y, x1, y1)[0]), far / (t1 - t0)
    return VERTICES[-1][1], VERTICES[-1][2], 0.0, 0.0


@cache
def acts(law: Acts = LAW) -> dict[str, np.ndarray]:
    """Return what each act found and made, a row each: steps are of a second, so that it is at a
    step's end.
    """
    fleet, found = Fleet(Itinerary((law,), land="ignore"), N, at=AT), []
    names = ("lon", "lat", "leg", "course", "speed", "to_time")
    before = {name: fleet[name] for name in names}
    last = np.zeros(N)
    for time in range(1, LASTING + 1):
        fleet.go(time, 1, time - 1)
        own = np.flatnonzero(before["to_time"] == time)
        now = {name: fleet[name] for name in names} if own.size else before
        for i in own:
            found.append(
                (
                    i,
                    time,
                    time - last[i],
                    before["leg"][i],
                    before["course"][i],
                    before["speed"][i],
                    *(now[n][i] for n in names),
                )
            )
        last[own] = time
        before = now
    keys = ("slot", "time", "waited", "was", "old_course", "old_speed", *names)
    return dict(zip(keys, np.array(found, float).T, strict=True))


def turned(angle: np.ndarray) -> np.ndarray:
    return (angle + np.pi) % (2 * np.pi) - np.pi


def sight(
    found: dict[str, np.ndarray], which: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return bearings to the tracker [rad], and what the tracker makes good across the line of
    sight, to its right, and along it, away [m/s].
    """
    bearing, across, away = [], [], []
    for k in np.flatnonzero(which):
        x, y, toward, speed = tracker(int(found["time"][k]))
        ahead, back, _ = GLOBE.inv(found["lon"][k], found["lat"][k], x, y)
        bearing.append(np.radians(ahead))
        across.append(speed * np.sin(toward - np.radians(back + 180)))
        away.append(speed * np.cos(toward - np.radians(back + 180)))
    return np.array(bearing), np.array(across), np.array(away)


def test_what_seeks_meets_the_tracker() -> None:
    """Across the line of sight both make good the same; who is too slow for that goes straight; the
    speed stays.
    """
    found = acts()
    seeks = found["leg"] == SEEKING
    assert seeks.sum() > 1000
    bearing, across, away = sight(found, seeks)
    speed, off = found["speed"][seeks], turned(found["course"][seeks] - bearing)
    np.testing.assert_array_equal(speed, found["old_speed"][seeks])
    able = np.abs(across) < speed  # to keep the bearing, and to come nearer by it
    able &= np.sqrt(np.maximum(speed**2 - across**2, 0)) > away
    assert 50 < (~able & (across != 0)).sum() < able.sum()
    # Half a unit of 9.3 mm in each position, on a line of sight of 3 km or more; single precision
    # of angles up to 2 pi.
    np.testing.assert_allclose(off[~able], 0, atol=1e-5)
    sure = np.abs(np.abs(across) - speed) > 1e-3  # arcsin is steep at 1
    assert (~able & (np.abs(across) < speed)).sum() > 20
    np.testing.assert_allclose(np.sin(off[able & sure]), (across / speed)[able & sure], atol=2e-5)
    assert (np.cos(off[able]) > 0).all()


def test_what_hides_flees_within_its_sector() -> None:
    found = acts()
    hides = found["leg"] == HIDING
    bearing, _, _ = sight(found, hides)
    off = turned(found["course"][hides] - bearing - np.pi)
    assert hides.sum() > 800
    assert np.abs(off).max() < LAW.spread + 1e-5
    assert stats.kstest(off / LAW.spread, stats.uniform(-1, 2).cdf).pvalue > 1e-3
    np.testing.assert_array_equal(found["speed"][hides], found["old_speed"][hides])


def test_what_is_free_keeps_its_course_or_takes_any() -> None:
    found = acts()
    free = (found["was"] == FREE) & (found["leg"] == FREE)
    kept = free & (found["course"] == found["old_course"])
    taken = free & ~kept
    assert (found["speed"][kept] == found["old_speed"][kept]).all()
    for values in (found["course"][taken] / (2 * np.pi), found["speed"][taken] / FASTEST):
        assert stats.kstest(values, "uniform").pvalue > 1e-3
    left = (found["was"] != FREE) & (found["leg"] == FREE)
    assert (found["course"][left] == found["old_course"][left]).all()


def test_how_often_each_act_is_made() -> None:
    """Binomial counts of the four acts, and of those who leave."""
    found = acts()
    was = found["was"] == FREE
    n, leg = was.sum(), found["leg"]
    same = found["course"] == found["old_course"]
    counts = {
        0.25: leg[was] == SEEKING,
        0.15: leg[was] == HIDING,
        0.35: (leg[was] == FREE) & ~same[was],
    }
    for share, those in counts.items():
        assert stats.binomtest(int(those.sum()), int(n), share).pvalue > 1e-3
    assert (
        stats.binomtest(int((leg[~was] == FREE).sum()), int((~was).sum()), LAW.leave).pvalue > 1e-3
    )
    assert set(zip(found["was"][~was], leg[~was], strict=True)) == {(2, 2), (2, 1), (3, 3), (3, 1)}


def test_clocks_are_private_and_uniform() -> None:
    """Waits are uniform between the least and the longest, the first one too; none depends on the
    one before.

    Of the acts within LASTING those early enough that the longest wait would have ended by then.
    """
    found = acts()
    early = found["time"] - found["waited"] <= LASTING - 900
    assert found["waited"].min() >= 180
    assert found["waited"].max() <= 900
    first = early & (found["time"] == found["waited"])
    assert first.sum() == N
    for those in (first, early & ~first):
        # Whole seconds: steps of 1/720 of the range, by half of which a step's law is off.
        distance = stats.kstest((found["waited"][those] - 180) / 720, "uniform").statistic
        assert distance < stats.kstwo.ppf(0.999, those.sum()) + 0.5 / 720
    order = np.lexsort((found["time"], found["slot"]))
    slot, waited = found["slot"][order], found["waited"][order]
    pairs = (slot[1:] == slot[:-1]) & (found["time"][order][1:] - waited[1:] <= LASTING - 900)
    assert abs(stats.spearmanr(waited[:-1][pairs], waited[1:][pairs]).statistic) < 4 / np.sqrt(
        pairs.sum()
    )


def brute(
    rng: np.random.Generator, law: Acts, n: int, until: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return where targets of a law without a lead are [m east, north of AT]: in a plane, each by
    itself, by NumPy.
    """
    x, y = np.zeros(n), np.zeros(n)
    course, speed = rng.uniform(0, 2 * np.pi, n), rng.uniform(0, law.fastest, n)
    time, free = np.zeros(n), np.ones(n, bool)
    to = sphere.offset(*np.radians(AT), law.tracker.lon[0], law.tracker.lat[0])  # type: ignore[union-attr]
    while (time < until).any():
        on = np.minimum(rng.uniform(*law.between, n), until - time)
        x, y, time = x + np.sin(course) * speed * on, y + np.cos(course) * speed * on, time + on
        u = rng.random(n)
        away = np.arctan2(x - to[0], y - to[1]) + rng.uniform(-1, 1, n) * law.spread
        free &= u <= 1 - law.hide
        fresh = free & (u < law.change)
        course = np.where(free, np.where(fresh, rng.uniform(0, 2 * np.pi, n), course), away)
        speed = np.where(fresh, rng.uniform(0, law.fastest, n), speed)
    return x, y


@pytest.mark.parametrize("step", [60, 700])
def test_where_they_are_after_two_hours_at_any_step(step: int) -> None:
    """Against particles in a plane, by Kolmogorov and Smirnov; over 60 nmi it is 1e-4 off, a
    hundredth of their spread.
    """
    still = Followed(
        PERIOD.start, (0.0, 8400.0), (np.radians(-179.9),) * 2, (np.radians(-61.0),) * 2
    )
    law = replace(
        LAW,
        course=Spread(0, 2 * np.pi, 1),
        speed=Spread(0, FASTEST, 1),
        seek=0.0,
        leave=0.0,
        tracker=still,
    )
    fleet = Fleet(Itinerary((law,), land="ignore"), 20_000, seed=9, at=AT).go(8400, step)
    found = sphere.offset(*np.radians(AT), np.radians(fleet["lon"]), np.radians(fleet["lat"]))
    expected = brute(np.random.default_rng(4), law, 100_000, 8400)
    for a, b in (*zip(found, expected, strict=True), (np.hypot(*found), np.hypot(*expected)), (found[0] - 2 * found[1], expected[0] - 2 * expected[1])):  # fmt: skip
        assert stats.ks_2samp(a, b).pvalue > 1e-3


def test_copies_act_apart_and_keep_what_they_are_about() -> None:
    """Two slots of one birth have one first course and clock; what they do then is by their slots."""
    law = replace(LAW, change=1.0, seek=0.0, hide=0.0, tracker=None)
    one = Fleet(Itinerary((law,), land="ignore"), 400, at=AT)
    for column in one.columns.values():
        values = column.to_numpy()
        values[200:] = values[:200]
        column.from_numpy(values)
    one.go(180, 60)
    assert (one["course"][200:] == one["course"][:200]).all()
    assert (one["to_time"][200:] == one["to_time"][:200]).all()
    one.go(960, 60, 180)
    assert not np.isin(one["course"][200:], one["course"][:200]).any()
