"""What the worlds of a spill are drawn as, and what their objects are given: moments against the
stated priors.
"""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import stats

import drift
from drift.engine.motion.objects import leeway
from drift.spills.worlds import release, worlds
from drift.spills.worlds.worlds import Proposal
from geo import sphere
from geo.box import Box
from geo.coast import edges as shoreline
from geo.coast.shore import Shore
from kernels.step import coast as device_coast

WORLDS = 40_000
CASE = """
start = "2026-11-21T06:00Z"
duration = "2 d"
[[current]]
constant = { speed = "0.3 m/s", toward = 70 }
[[wind]]
constant = { speed = "9 m/s", from = 200 }
[spill]
objects = 40
worlds = %d
per_world = 30
windage_bias = 0.3
current_bias = "0.07 m/s"
release_duration = "5 h"
release_std = "300 m"
%s
[[spill.class]]
name = "raft"
object = "LIFE-RAFT-DB-10"
share = 0.75
[[spill.class]]
name = "box"
object = { immersion = [0.4, 0.8] }
share = 0.25
sinking = { half_life = ["1 d", "4 d"] }
"""
POSITION = """
[spill.position]
at = [-179.95, 58.0]
std = ["6 km", "2 km"]
orientation = 35
time = "+2 h"
until = "+8 h"
"""
AREA = """
[spill.area]
polygon = [[170, 56], [-175, 56], [-178, 72], [173, 72]]
"""


def spill_of(folder: Path, place: str, count: int = WORLDS) -> Any:
    (folder / "case.toml").write_text(CASE % (count, place))
    return drift.load(folder / "case.toml")


def at_sea(lon: Any, lat: Any) -> Any:
    return np.zeros(np.shape(lon), bool)


def within(found: float, expected: float, error: float) -> None:
    assert abs(found - expected) < 4.5 * error, (found, expected, error)


def test_worlds_follow_the_stated_priors(tmp_path: Path) -> None:
    """Release: a normal of axes turned clockwise from north; its time uniform; windage lognormal;
    errors of the current normal.
    """
    case = spill_of(tmp_path, POSITION)
    drawn = worlds.draw_worlds(case.spill, 7, at_sea)
    n = drawn.size
    way = np.array(
        sphere.offset(
            *np.radians([-179.95, 58.0]), drawn.lon * sphere.UNIT, drawn.lat * sphere.UNIT
        )
    )
    turn = np.radians(35)
    major, minor = np.array([np.sin(turn), np.cos(turn)]), np.array([np.cos(turn), -np.sin(turn)])
    cov = 6000.0**2 * np.outer(major, major) + 2000.0**2 * np.outer(minor, minor)
    found = np.cov(way)
    error = np.sqrt((np.outer(np.diag(cov), np.diag(cov)) + cov**2) / n)
    assert (np.abs(found - cov) < 4.5 * error).all()
    hours = (drawn.release - case.start.astype("datetime64[s]").astype(np.int64)) / 3600
    assert stats.kstest(hours, "uniform", args=(2, 6)).pvalue > 1e-4
    assert stats.kstest(np.log(drawn.windage) / 0.3, "norm").pvalue > 1e-4
    assert stats.kstest(drawn.current_east / 0.07, "norm").pvalue > 1e-4
    assert stats.kstest(drawn.current_north / 0.07, "norm").pvalue > 1e-4
    within(np.corrcoef(drawn.current_east, drawn.current_north)[0, 1], 0.0, 1 / np.sqrt(n))
    assert np.isinf(drawn.sinking[:, 0]).all()
    assert stats.kstest(np.log(drawn.sinking[:, 1] / 86_400) / np.log(4), "uniform").pvalue > 1e-4


def test_an_area_of_releases_is_uniform_on_the_sphere(tmp_path: Path) -> None:
    """Across the antimeridian, 56 to 72 N: counts by latitude go as width times cos(lat), which is
    far from uniform in degrees.
    """
    case = spill_of(tmp_path, AREA)
    drawn = worlds.draw_worlds(case.spill, 7, at_sea)
    lat = sphere.to_degrees(drawn.lat)
    fine = np.linspace(56, 72, 40_001)
    density = ((15 - 4 * (fine - 56) / 16) - 2 * (fine - 56) / 16) * np.cos(
        np.radians(fine)
    )  # 15 degrees wide below, 9 above
    law = np.concatenate([[0.0], np.cumsum((density[1:] + density[:-1]) / 2)])
    assert stats.kstest(lat, lambda at: np.interp(at, fine, law / law[-1])).pvalue > 1e-4


def test_worlds_drawn_anew_weigh_as_their_prior(tmp_path: Path) -> None:
    """Importance weights have mean 1 under the proposal, and weighted moments are the prior's:
    standard normals.
    """
    case = spill_of(tmp_path, POSITION)
    random = np.random.default_rng(3)
    k = worlds.draw_worlds(case.spill, 1, at_sea, count=50).latent.shape[1]
    factor = 0.5 * random.standard_normal((k, k))
    proposal = Proposal(
        0.7 * random.standard_normal((3, k)),
        np.array([0.5, 0.3, 0.2]),
        factor @ factor.T + 0.4 * np.eye(k),
    )
    drawn = worlds.draw_worlds(case.spill, 9, at_sea, proposal)
    weight = np.exp(drawn.log_weight)
    assert weight.std() > 0.3
    for value, expected in (
        (np.ones(drawn.size), 1.0),
        (drawn.latent[:, 0], 0.0),
        (drawn.latent[:, 1] ** 2, 1.0),
    ):
        product = weight * value
        within(product.mean(), expected, product.std() / np.sqrt(drawn.size))


@pytest.fixture(scope="module")
def released(tmp_path_factory: pytest.TempPathFactory) -> Any:
    case = spill_of(tmp_path_factory.mktemp("spill"), POSITION, 2000)
    drawn = worlds.draw_worlds(case.spill, 7, at_sea)
    land = shoreline.build_coast(Shore(np.array([], object), "none"), Box(178, 57, 183, 59))
    return (
        case,
        drawn,
        release.draw_release(
            case.spill, drawn, case.period, case.errors, device_coast.upload(land), 7
        ),
    )


def test_a_world_scales_all_the_leeway_of_its_objects(released: Any) -> None:
    """Slopes and offsets alike, on all lines: in the ratio of the published ones after division by
    the world's factor.
    """
    _, drawn, ensemble = released
    first, last = ensemble.scenarios[0]
    raft = leeway.find_class("LIFE-RAFT-DB-10")
    factor = drawn.windage[ensemble.world.to_numpy()[first:last]]
    # the downwind line is cut at 0: tests/engine/motion/objects/test_leeway.py
    for side in ("right", "left"):
        line = getattr(raft, side)
        for what in ("slope", "offset"):
            own = ensemble.own[f"{side}_{what}"].to_numpy()[first:last] / factor
            mean, std = getattr(line, what), getattr(line, f"{what}_std")
            within(own.mean(), mean, std / np.sqrt(own.size))
            within(own.std() / std, 1.0, 1 / np.sqrt(2 * own.size))


def test_classes_have_their_shares_and_objects_their_times(released: Any) -> None:
    """Weights of a class add up to its share; an object goes adrift within `release_duration` of
    its world; it lies about its world's release.
    """
    _, drawn, ensemble = released
    weight = np.exp(ensemble.log_weight.to_numpy().astype(np.float64))
    for (first, last), share in zip(ensemble.scenarios, (0.75, 0.25), strict=True):
        assert weight[first:last].sum() == pytest.approx(share, rel=1e-5)
    world = ensemble.world.to_numpy()
    case = released[0]
    late = ensemble.release.to_numpy() - (drawn.release[world] - case.period.epoch)
    assert stats.kstest(late / 3600, "uniform", args=(0, 5)).pvalue > 1e-4
    at = [drawn.lon[world] * sphere.UNIT, drawn.lat[world] * sphere.UNIT]
    way = np.array(
        sphere.offset(
            *at, ensemble.lon.to_numpy() * sphere.UNIT, ensemble.lat.to_numpy() * sphere.UNIT
        )
    )
    assert np.abs(way.std(axis=1) / 300 - 1).max() < 4.5 / np.sqrt(2 * way.shape[1])


def test_boxes_drift_by_their_immersion(released: Any) -> None:
    """The share under water is uniform between objects (Daniel et al. 2002):

    I = 1 / (1 + (slope / ratio)^2).
    """
    _, drawn, ensemble = released
    first, last = ensemble.scenarios[1]
    slope = (
        ensemble.own["down_slope"].to_numpy()[first:last]
        / drawn.windage[ensemble.world.to_numpy()[first:last]]
    )
    immersion = 1 / (1 + (slope / np.sqrt(1.225 / 1025)) ** 2)
    # the ratio is kept to four digits: 0.0346 for 0.03457, 2e-3 of 1 - I
    assert (
        stats.kstest(immersion, "uniform", args=(0.4, 0.4)).statistic
        < 1.95 / np.sqrt(immersion.size) + 3e-3
    )
