"""Release from finds ashore: by the law of arrivals, and what patrols that missed nothing rule out."""

import numpy as np
import pytest
import shapely
from release_backward import (
    BOX,
    DEGREE,
    DIFFUSIVITY,
    HOUR,
    SPILL,
    T0,
    case_of,
    environment,
    figures,
    origin,
)
from scipy import stats

from geo import sphere
from geo.box import Box
from geo.coast import edges as shoreline
from geo.coast import segments
from geo.coast.shore import Shore
from geo.forcing import sources

JAGGED = np.concatenate([[-1.4], np.arange(-1.0, 1.0, 0.004), [1.4]])
COAST_RATE, REMOVAL, SPEED, SHORE_D = 0.5 / 86_400, 0.1 / 86_400, 0.1, 20.0
FOUND = 100 * HOUR
ASHORE = (
    SPILL[: SPILL.index("[[current]]")].replace(f"{DIFFUSIVITY} m2/s", f"{SHORE_D} m2/s")
    + f"""
[[current]]
name = "onshore"
constant = {{ east = "{SPEED} m/s", north = "0 m/s" }}
[spill]
objects = 1
worlds = 50
windage_bias = 0
area = {{ polygon = [[-0.30, -0.1], [-0.02, -0.1], [-0.02, 0.15], [-0.30, 0.15]], until = "+72 h" }}
reporting = {{ rate = {{ wild = "0.5 /day" }}, removal = "0.1 /day" }}
[[spill.class]]
name = "drum"
object = "water"
[[find]]
stretch = "STRETCH"
time = "+{FOUND // HOUR} h"
"""
)


def straight() -> shoreline.Coast:
    """Return land east of lon 0 with a straight shore."""
    shape = shapely.Polygon([(1.4, 1.4), (1.4, -1.4), *[(0.0, lat) for lat in JAGGED]])
    return shoreline.build_coast(
        Shore(np.array([shape], object), "test", (), BOX), Box(-1.2, -1.2, 1.2, 1.2)
    )


@pytest.mark.thorough
@pytest.mark.parametrize("count", [1, pytest.param(4, marks=pytest.mark.thorough)])
def test_finds_ashore_tell_the_release_by_the_law_of_arrivals(tmp_path, count: int) -> None:
    """Arrivals at a straight shore follow the inverse Gaussian law, waits the exponential:
    quadrature over both.

    Finds of one stretch and time that share no error multiply the same likelihood.
    """
    coast = straight()
    cut = segments.cut_coast(coast, 10_000.0)
    on, _ = segments.nearest_segment(cut, coast, 0.0, 0.04)
    text = ASHORE.replace("STRETCH", cut.name[on]).replace("objects = 1", f"objects = {count}")
    case = case_of(tmp_path, text + (count - 1) * text[text.index("[[find]]") :])
    found = origin(
        case, environment(sources.constant_field("current", SPEED, 0.0), coast), cut, count * [on],
        worlds=200, per_find=400, cells=24, times=12,
    )  # fmt: skip
    edge = shoreline.shoreline_edges(coast)[cut.of_edge == on]
    south, north = np.sort(edge[:, [1, 3]].ravel())[[0, -1]] * (360 / sphere.TURN) * DEGREE
    away, y0 = -found.lon * DEGREE, found.lat * DEGREE
    arrival = (np.arange(800) + 0.5) * FOUND / 800
    weight = np.exp(-(COAST_RATE + REMOVAL) * (FOUND - arrival))
    times = found.time.astype(np.int64) - T0
    chance = np.zeros((times.size, y0.size, away.size))
    for k, t in enumerate(times):
        age = arrival[arrival > t] - t
        law = stats.invgauss(2 * SHORE_D / (SPEED * away), scale=away**2 / (2 * SHORE_D)).pdf(
            age[:, None]
        )
        spread = np.sqrt(2 * SHORE_D * age)[:, None]
        along = stats.norm.cdf((north - y0) / spread) - stats.norm.cdf((south - y0) / spread)
        chance[k] = np.einsum("a,ax,ay->yx", weight[arrival > t], law, along)
    chance = found.prior * (chance / chance.max()) ** count
    chance /= chance.sum()
    expected = np.array(
        [
            -(chance.sum((0, 1)) * away).sum(),
            (chance.sum((0, 2)) * y0).sum(),
            (chance.sum((1, 2)) * times).sum(),
        ]
    )
    mean, error, std = figures(found)
    # Kernels of width h that keep mean and variance change a density of standard deviation s by a
    # share h^2 / (2 s^2) times a function of place that is 0 for a normal density and otherwise of
    # order one. The mean shifts by as large a share of s at most, find by find. The shore, at which
    # tracks begin, leaves about 100 of 400 particles, so the share is 1 / (2 sqrt(100)), 5 %, and
    # this law has up to two thirds of it. By Silverman's rule for one world it is 11 %.
    smoothing = 0.033 * count * std
    assert (np.abs(mean - expected) < 3 * error + smoothing).all()
    assert (3 * error + smoothing < 0.055 * count * std).all()


@pytest.mark.thorough
def test_a_patrol_that_misses_nothing_rules_out_earlier_landings(tmp_path) -> None:
    """Arrivals before it are out: releases after it keep their odds, and those long before lose
    theirs.
    """
    coast = straight()
    cut = segments.cut_coast(coast, 10_000.0)
    on, _ = segments.nearest_segment(cut, coast, 0.0, 0.04)
    text, passed = ASHORE.replace("STRETCH", cut.name[on]), 50 * HOUR
    patrol = f'[[patrol]]\nname = "p"\nstretches = ["{cut.name[on]}"]\ntime = "+{passed // HOUR} h"\ndetection = 1\n'
    where = environment(sources.constant_field("current", SPEED, 0.0), coast)
    before, after = (
        origin(
            case_of(tmp_path, said), where, cut, [on], worlds=50, per_find=100, cells=20, times=9
        )
        for said in (text, text + patrol)
    )
    late = before.time.astype(np.int64) - T0 > passed
    ratio = after.probability[late].sum((1, 2)) / before.probability[late].sum((1, 2))
    assert 1.05 < ratio[0] == pytest.approx(ratio, rel=1e-4)
    assert after.probability[0].sum() < 0.9 * before.probability[0].sum()
