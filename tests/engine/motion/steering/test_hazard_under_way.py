"""Distress of targets under way by a hazard: each one's time against the integral of law times
hazard along its own track, in float64 and by great circles of the test's own.

A time of distress, put through its own distribution, is uniform between 0 and 1.
"""

from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import hazards
import numpy as np
import pytest
import trial_case
from scipy import stats

import drift
from drift.engine.motion import prior
from drift.engine.motion.steering import distress
from drift.engine.particles.status import Status
from drift.pipeline import run_setup
from geo import sphere
from geo.errors import UserError
from kernels.runtime import runtime

N = 1200
# two legs of 62 and 71 km across 180 degrees
CORNERS = [(179.41, -16.37), (179.93, -16.11), (-179.59, -16.53)]
VOYAGE = {
    "waypoints": [list(corner) for corner in CORNERS],
    "speed": ["4 kn", "9 kn"],
    "departure": ["+1 h", "+5 h"],
}
LON, LAT = np.linspace(178.9, 181.1, 34), np.linspace(-17.7, -14.7, 40)
HOURS = np.array([0.0, 7.0, 16.0, 48.0])
NEVER = 2**31 - 1


@pytest.fixture(autouse=True)
def _started() -> None:
    runtime.start()


def field() -> np.ndarray:
    """Return a hazard (time, lat, lon) that is no plane and changes with time."""
    x, y = np.meshgrid(LON - LON[0], LAT - LAT[0])
    place = 0.1 + np.sin(2.1 * x + 2.3 * y + 0.4) ** 2 * np.exp(0.4 * y)
    return place * np.array([1.0, 2.6, 0.7, 1.9])[:, None, None] + 0.05 * x * HOURS[:, None, None]


def load(folder: Path, key: Any, hazard: Any, phases: Any = None, **more: Any) -> drift.Case:
    hazards.write(folder / "risk.nc", field(), LON, LAT, hours=HOURS)
    own = {
        "position": None,
        "distress": key,
        "hazard": hazard,
        "phase": phases or [{"voyage": VOYAGE}],
        **more.pop("own", {}),
    }
    tables = {"particles": N, "duration": "40 h", "clock": {"step": 1800}, **more}
    return trial_case.load(folder, scenario=own, **tables)


def drawn(case: drift.Case) -> dict[str, np.ndarray]:
    """Return the columns of the targets before the run."""
    begun = run_setup.prepare(case, run_setup.open_for(case))
    begun.scene.forcing.close()
    own = begun.ensemble.columns
    names = ("release", "departure", "speed", "lon", "lat", "to_lon", "to_lat", "log_weight")
    return {name: own[name].to_numpy().astype(float) for name in names}


@cache
def field_between() -> Any:
    """Return the field as a function of hours, latitude and longitude."""
    from scipy.interpolate import RegularGridInterpolator

    return RegularGridInterpolator((HOURS, LAT, LON), field())


def hazard_of_field(seconds: np.ndarray, lon: np.ndarray, lat: np.ndarray) -> np.ndarray:
    return field_between()(np.stack([seconds / 3600, lat, (lon - LON[0]) % 360 + LON[0]], axis=-1))


def along(corners: Any, seconds: np.ndarray, speed: float) -> tuple[np.ndarray, np.ndarray]:
    """Return places [deg] of a ship at times after its departure, by slerp from corner to corner."""
    lengths = [
        hazards.RADIUS * np.arccos(np.clip(np.dot(*hazards.great_circle(a, b, np.array([0, 1.0]))), -1, 1))
        for a, b in pairwise(corners)
    ]  # fmt: skip
    ends = np.concatenate([[0.0], np.cumsum(lengths)])
    way = np.clip(seconds * speed, 0, ends[-1])
    leg = np.clip(np.searchsorted(ends, way, side="right") - 1, 0, len(lengths) - 1)
    at = np.zeros((way.size, 3))
    for k, (a, b) in enumerate(pairwise(corners)):
        at[leg == k] = hazards.great_circle(a, b, (way[leg == k] - ends[k]) / lengths[k])
    return np.degrees(np.arctan2(at[:, 1], at[:, 0])), np.degrees(np.arcsin(at[:, 2]))


def length(corners: Any) -> float:
    return sum(
        hazards.RADIUS * np.arccos(np.dot(*hazards.great_circle(a, b, np.array([0, 1.0]))))
        for a, b in pairwise(corners)
    )


def transformed(
    own: dict, law: Any, hazard: Any, corners: Any, end: float, some: Any = None
) -> np.ndarray:
    """Return each distress in time put through its own distribution, of those before arrival.

    law: density at times, of a departure and a speed. some: which targets; None: all.
    """
    found = []
    for k in range(own["release"].size):
        departure, speed = own["departure"][k], own["speed"][k]
        ways = corners(k)
        until = min(departure + length(ways) / speed, end)
        if own["release"][k] >= until or (some is not None and not some[k]):
            continue
        edges = np.linspace(departure, until, 401)
        time = (edges[1:] + edges[:-1]) / 2
        density = law(time, departure, speed) * hazard(time, *along(ways, time - departure, speed))
        whole = np.concatenate([[0.0], np.cumsum(density)])
        found.append(np.interp(own["release"][k], edges, whole / whole[-1]))
    return np.array(found)


def triangle(low: float, high: float, mode: float, ratio: float) -> Any:
    """Return the density of a truncated triangle."""
    flat = 2 / (1 + ratio)
    bare = 1 - flat
    top = 2 / (high - low)

    def density(x: np.ndarray) -> np.ndarray:
        risen = np.interp(x, [low, mode, high], [0.0, top, 0.0], left=0.0, right=0.0)
        return bare * risen + flat * ((x >= low) & (x <= high)) / (high - low)

    return density


WHEN, WHERE = triangle(2, 30, 9, 5), triangle(0.13, 0.94, 0.71, 3)
LONG = length(CORNERS)
LAWS: dict[str, tuple[Any, Any]] = {
    "between": (
        {"between": {"earliest": "+2 h", "best": "+9 h", "latest": "+30 h", "ratio": 5}},
        lambda t, departure, speed: WHEN(t / 3600),
    ),
    "rate": (
        {"rate": "0.11/h"},
        lambda t, departure, speed: np.exp(-0.11 * (t - departure) / 3600),
    ),
    "part": (
        {"part": {"low": 0.13, "best": 0.71, "high": 0.94, "ratio": 3}},
        lambda t, departure, speed: WHERE((t - departure) * speed / LONG),
    ),
}


@pytest.mark.parametrize("kind", LAWS)
def test_each_time_has_the_density_of_law_times_hazard_on_its_own_track(
    kind: str, tmp_path: Path
) -> None:
    key, law = LAWS[kind]
    own = drawn(load(tmp_path, key, {"file": "risk.nc"}))
    plain = drawn(load(tmp_path, key, None))
    assert np.ptp(own["log_weight"]) == 0
    # whether it goes adrift before it arrives is left to the law
    arrival = own["departure"] + length(CORNERS) / own["speed"]
    end = 40 * 3600.0
    for name in ("departure", "speed", "lon", "lat"):
        assert np.array_equal(own[name], plain[name])
    sure = np.abs(plain["release"] - arrival) > 2  # whole seconds
    stays = sure & ((plain["release"] > arrival) | (plain["release"] > end))
    assert np.array_equal(own["release"][stays], plain["release"][stays])
    assert (own["release"][sure & ~stays] < np.minimum(arrival, end)[sure & ~stays] + 1).all()
    u = transformed(own, law, hazard_of_field, lambda k: CORNERS, end)
    assert u.size > 0.3 * N
    assert stats.kstest(u, "uniform").pvalue > 1e-3
    # the test notices a hazard that is left out
    flat = transformed(own, law, lambda t, x, y: np.ones_like(t), lambda k: CORNERS, end)
    assert stats.kstest(flat, "uniform").pvalue < 1e-6


@pytest.mark.thorough
def test_a_target_beside_its_track_meets_the_hazard_there(tmp_path: Path) -> None:
    """By the wind's law too: a wind that rises and falls, the same everywhere."""
    one = {**VOYAGE, "waypoints": VOYAGE["waypoints"][:2], "cross_track": "21 km"}
    key = {"rate": "0.2/h"}
    phases = [{"voyage": one}]
    own = drawn(load(tmp_path, key, {"file": "risk.nc"}, phases, particles=2000))

    def corners(k: int) -> list[tuple[float, float]]:
        return [
            tuple(float(sphere.to_degrees(np.int32(own[name][k]))) for name in names)
            for names in (("lon", "lat"), ("to_lon", "to_lat"))
        ]  # type: ignore[return-value]

    def law(t: np.ndarray, departure: float, speed: float) -> np.ndarray:
        return np.exp(-0.2 * (t - departure) / 3600)

    # its speed is that along the middle of the track: the two lines beside it have its length
    u = transformed(own, law, hazard_of_field, corners, 40 * 3600.0)
    assert stats.kstest(u, "uniform").pvalue > 1e-3
    # the test notices that the hazard is that of the other side
    left = sphere.to_degrees(own["lat"].astype(np.int32)) > CORNERS[0][1] + 0.1

    def mirrored(k: int) -> list[tuple[float, float]]:
        pairs = zip(CORNERS, corners(k), strict=False)
        return [(2 * a[0] - b[0] % 360, 2 * a[1] - b[1]) for a, b in pairs]

    other = transformed(own, law, hazard_of_field, mirrored, 40 * 3600.0, left)
    assert stats.kstest(other, "uniform").pvalue < 1e-3

    table = [
        {"time": f"+{h} h", "speed": f"{w} m/s", "from": 200} for h, w in ((0, 4), (9, 17), (40, 5))
    ]
    by_wind = load(
        tmp_path, key, {"wind": "11 m/s", "width": "1.7 m/s"}, phases, wind={"table": table}
    )
    own = drawn(by_wind)
    u = transformed(
        own, law,
        lambda t, x, y: 1 / (1 + np.exp((11 - np.interp(t / 3600, [0, 9, 40], [4, 17, 5])) / 1.7)),
        corners, 40 * 3600.0,
    )  # fmt: skip
    assert stats.kstest(u, "uniform").pvalue > 1e-3


def test_a_hazard_that_is_the_same_everywhere_changes_no_law(tmp_path: Path) -> None:
    """However high it is; and a target in a later phase is still on its track."""
    later = [{"voyage": {**VOYAGE, "waypoints": VOYAGE["waypoints"][k : k + 2]}} for k in (0, 1)]
    case = load(tmp_path, {"rate": "0.11/h"}, {"file": "risk.nc"}, later)
    hazards.write(tmp_path / "risk.nc", np.full((LAT.size, LON.size), 3.7), LON, LAT)
    own = drawn(drift.load(case.path))
    plain = drawn(load(tmp_path, {"rate": "0.11/h"}, None, later))
    goes = plain["release"] < 30 * 3600
    assert stats.ks_2samp(own["release"][goes], plain["release"][goes]).pvalue > 1e-3


def test_a_shard_draws_its_slice_of_the_whole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And neither the step nor the outputs matter."""
    monkeypatch.setattr(distress, "CELLS", 60)
    law, hazard = {"rate": "0.11/h"}, {"file": "risk.nc"}
    case = load(tmp_path, law, hazard, particles=9000)
    spec = run_setup.spec_of(case, run_setup.open_for(case))
    whole = prior.draw_ensemble(spec, None).ensemble.columns["release"].to_numpy()
    for shard in prior.layout(spec).shards(3):
        part = prior.draw_ensemble(spec, None, shard).ensemble
        assert np.array_equal(part.columns["release"].to_numpy(), whole[part.places])
    more = {"clock": {"step": 120}, "output": {"every": "1 h"}}
    assert np.array_equal(
        drawn(load(tmp_path, law, hazard, particles=9000, **more))["release"], whole
    )


def test_targets_go_adrift_where_the_hazard_is(tmp_path: Path) -> None:
    """The run itself: only in the west, where the hazard is not 0. Nothing moves them after that."""
    west = np.broadcast_to((LON < 179.7).astype(float), (LAT.size, LON.size))
    one = {**VOYAGE, "waypoints": VOYAGE["waypoints"][:2], "cross_track": "2 km"}
    still = {"constant": {"speed": "0 kn", "toward": 90}}
    case = load(
        tmp_path, {"part": [0.0, 1.0]}, {"file": "risk.nc"}, [{"voyage": one}],
        particles=300, duration="20 h", current=still, uncertainty={"current": "none"},
    )  # fmt: skip
    hazards.write(tmp_path / "risk.nc", west, LON, LAT)
    tracks = drift.run(drift.load(case.path)).trajectories
    adrift = tracks.status[:, -1] == int(Status.ADRIFT)
    assert adrift.sum() > 150
    lon = sphere.to_degrees(tracks.lon[adrift, -1])
    # the field falls to 0 in a cell of its own, and a cell of time at 9 kn is 0.1 km
    edge = LON[LON >= 179.7][0]
    assert 179.3 < lon.min() < 179.5
    assert edge - 0.05 < lon.max() < edge + 0.01


REFUSED = {
    "loiters": {"phase": [{"loiter": {"polygon": [[179, -16], [179.5, -16], [179.2, -15.5]], "speed": "5 kn", "leg": "9 km"}}],
                "position": {"at": [179.2, -15.8], "error": "1 km"}},
    "acts at random times": {"phase": [{"behaviour": {"fastest": "9 kn", "acts": ["3 min", "9 min"], "change": 0.2}}],
                             "position": {"at": [179.2, -15.8], "error": "1 km"}},
    "changes its course": {"phase": [{"course": {"course": 71, "speed": "5 kn", "change": "2 h"}}],
                           "position": {"at": [179.2, -15.8], "error": "1 km"}},
    "is a Brownian bridge": {"phase": [{"bridge": {"k": "3 nmi/sqrt(h)", "points": [
        {"at": [179.2, -16.2], "time": "+0 h"}, {"at": [179.9, -16.0], "time": "+20 h"}]}}]},
    "way point of uncertain place or time": {"phase": [{"track": {"points": [
        {"at": [179.2, -16.2], "after": "0 h"}, {"at": [179.9, -16.0], "after": ["15 h", "19 h"]}]}}]},
    "currents is felt": {"vessel": {"currents": "felt"}},
}  # fmt: skip


@pytest.mark.parametrize("words", REFUSED)
def test_a_track_that_chance_decides_on_the_way_has_none(words: str, tmp_path: Path) -> None:
    with pytest.raises(UserError) as caught:
        load(tmp_path, {"rate": "0.1/h"}, {"file": "risk.nc"}, own=REFUSED[words])
    assert words in str(caught.value)
    assert "needs a track that is settled at departure" in str(caught.value)
    assert len(caught.value.lines) == 1


def test_after_a_part_of_a_settled_voyage_chance_may_decide(tmp_path: Path) -> None:
    phases = [{"voyage": VOYAGE}, *REFUSED["loiters"]["phase"]]
    assert (
        drawn(load(tmp_path, {"part": [0.2, 0.8]}, {"file": "risk.nc"}, phases))["release"].size
        == N
    )
    with pytest.raises(UserError, match="phase 2 loiters"):
        load(tmp_path, {"rate": "0.1/h"}, {"file": "risk.nc"}, phases)


def test_values_that_are_missing_or_0_are_named(tmp_path: Path) -> None:
    case = load(tmp_path, {"part": [0.0, 1.0]}, {"file": "risk.nc"})
    values = np.ones((LAT.size, LON.size))
    hazards.write(tmp_path / "risk.nc", values[:, LON < 180], LON[LON < 180], LAT)
    with pytest.raises(
        UserError,
        match=r"has no value about 16-\d\d\.\dS 17\d-\d\d\.\dE on .*, on the track of a target; .*outside",
    ):
        drawn(drift.load(case.path))
    slow = np.broadcast_to((LAT > -16.2).astype(float)[:, None], values.shape)
    hazards.write(tmp_path / "risk.nc", slow, LON, LAT)
    with pytest.raises(UserError, match=r"is 0 all along the tracks of [\d,]+ of 1,200 targets"):
        drawn(load_again(case, tmp_path))


def load_again(case: drift.Case, folder: Path) -> drift.Case:
    """Return the case with its distress in the part of the voyage that is south of 16.2 S."""
    path = folder / "case.toml"
    path.write_text(path.read_text().replace("[0.0, 1.0]", "[0.9, 1.0]"))
    return drift.load(path)
