"""Objects lost along a ship's track, against worlds drawn and weighed in NumPy float64."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import drift
from drift.spills.worlds import release, unknowns, worlds
from geo import sphere
from geo.box import Box
from geo.coast import edges as shoreline
from geo.coast.shore import Shore
from geo.errors import UserError
from kernels.step import coast as device_coast

CASE = """
start = "2026-11-21T06:00Z"
duration = "2 d"
[[current]]
constant = {{ speed = "0.3 m/s", toward = 70 }}
[[wind]]
constant = {{ speed = "9 m/s", from = 200 }}
[spill]
objects = 40
worlds = {worlds}
per_world = 30
{spill}
[[spill.class]]
name = "raft"
object = "LIFE-RAFT-DB-10"
"""
TRACK = """clock_error = "9 min"
track = [
    { at = [178.2, 57.3], time = "+1 h" },
    { at = [-178.9, 58.4], time = "+8 h" },
    { at = [-176.1, 58.1], time = "+14 h" },
]
"""
LOSSES = """[[spill.loss]]
begin = ["+2 h", "+5 h"]
length = ["20 min", "3 h"]
share = 0.7
[[spill.loss]]
begin = "+10 h"
length = "90 min"
share = 0.3
"""


def load(folder: Path, spill: str = TRACK + LOSSES, count: int = 3000) -> Any:
    (folder / "case.toml").write_text(CASE.format(worlds=count, spill=spill))
    return drift.load(folder / "case.toml")


def at_sea(lon: Any, lat: Any) -> Any:
    return np.zeros(np.shape(lon), bool)


def unit(lon: Any, lat: Any) -> Any:
    lon, lat = np.radians(lon), np.radians(lat)
    return np.stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)], -1)


def ship(hours: Any) -> Any:
    """Return unit vectors of the ship's places: great circles at constant speed, by slerp."""
    corners, times = unit([178.2, -178.9, -176.1], [57.3, 58.4, 58.1]), np.array([1.0, 8.0, 14.0])
    leg = np.clip(np.searchsorted(times, hours, side="right") - 1, 0, 1)
    share = ((hours - times[leg]) / (times[leg + 1] - times[leg]))[:, None]
    angle = np.arccos((corners[leg] * corners[leg + 1]).sum(-1))[:, None]
    a, b = np.sin((1 - share) * angle), np.sin(share * angle)
    return (a * corners[leg] + b * corners[leg + 1]) / np.sin(angle)


def test_objects_go_overboard_where_the_ship_was(tmp_path: Path) -> None:
    """Across 180 degrees; each object by its own time, and its world's clock."""
    case = load(tmp_path)
    drawn = worlds.draw_worlds(case.spill, 7, at_sea)
    assert drawn.loss_begin is not None
    assert drawn.loss_length is not None
    assert drawn.clock is not None
    water = shoreline.build_coast(Shore(np.array([], object), "none"), Box(177, 56, 185, 60))
    coast = device_coast.upload(water)
    period = case.period
    ensemble = release.draw_release(case.spill, drawn, period, case.errors, coast, 3)
    world, time = ensemble.world.to_numpy(), ensemble.release.to_numpy()
    begin = drawn.loss_begin - period.epoch
    past = time[:, None] - begin[world]
    inside = (past >= 0) & (past <= drawn.loss_length[world])
    assert (inside.sum(axis=1) == 1).all()
    n = time.size
    assert abs(inside[:, 0].mean() - 0.7) < 4 * np.sqrt(0.21 / n)
    share = (past / drawn.loss_length[world])[inside]
    assert abs(share.mean() - 0.5) < 4 / np.sqrt(12 * n) + 1e-3  # whole seconds
    places = unit(*(sphere.to_degrees(x.to_numpy()) for x in (ensemble.lon, ensemble.lat)))
    expected = ship((time + drawn.clock[world]) / 3600)
    # vectors of up to 20 km in float32, clocks of up to 1080 s to 6e-5 s at 8.5 m/s, and binary
    # angles of 1 cm
    assert (np.linalg.norm(places - expected, axis=1) * sphere.RADIUS).max() < 0.1
    assert np.ptp(drawn.clock) > 0.95 * 1080
    assert np.abs(drawn.clock).max() <= 540


def test_begin_and_length_follow_a_find(tmp_path: Path) -> None:
    """Weights of a likelihood of begin and length: posterior means against a lattice."""
    case = load(tmp_path, count=40_000)
    drawn = worlds.draw_worlds(case.spill, 7, at_sea)
    columns = unknowns._columns(drawn, case.start, ["raft"])
    begin, length = (columns[f"loss 1, {name}"][1] for name in ("begin", "length"))

    def density(begin: Any, length: Any) -> Any:
        """Of an object lost at 5.5 h, as a find would say."""
        return ((begin < 5.5) & (begin + length > 5.5)) / length

    edges = np.arange(2000) + 0.5
    b, d = np.meshgrid(2 + 3 * edges / 2000, 1 / 3 + 8 / 3 * edges / 2000)
    for found, lattice in ((begin, b), (length, d)):
        weight, exact = density(begin, length), density(b, d)
        mean = np.average(found, weights=weight)
        spread = np.sqrt((weight**2 * (found - mean) ** 2).sum()) / weight.sum()
        assert abs(mean - np.average(lattice, weights=exact)) < 4 * spread
    assert columns["loss 2, begin"][1] == pytest.approx(10.0)


@pytest.mark.thorough
def test_origin_has_no_track(tmp_path: Path) -> None:
    find = '[[find]]\nat = [-179.0, 58.0]\ntime = "+20 h"\nat_sea = true\n'
    case = load(tmp_path, TRACK + LOSSES + find, 100)
    with pytest.raises(UserError, match="track: drift origin goes back to one place"):
        drift.origin(case)


BAD = {
    "one point": ('    { at = [-178.9, 58.4], time = "+8 h" },\n    { at = [-176.1, 58.1], time = "+14 h" },\n', "", "at least 2"),
    "not ascending": ('"+8 h"', '"+15 h"', "times must ascend"),
    "fast": ("[-178.9, 58.4]", "[-150.0, 58.4]", "at most 50 m/s"),
    "late": ('"+10 h"', '"+13 h"', "the ship's track must cover"),
    "early": ('["+2 h", "+5 h"]', '["+1 h", "+5 h"]', "the ship's track must cover"),
    "negative": ('"90 min"', '"-90 min"', "length"),
    "backward": ('["+2 h", "+5 h"]', '["+5 h", "+2 h"]', "from the earlier to the later"),
    "shares": ("share = 0.3", "share = 0.2", "add up to 1"),
    "both": (
        "clock_error",
        'trackline = { waypoints = [[178, 57], [179, 58]], speed = "9 kn", cross_track = 1 }\nclock_error',
        "trackline and track",
    ),
    "duration": ("clock_error", 'release_duration = "1 h"\nclock_error', "release_duration"),
    "no loss": (LOSSES, "", "needs a [[spill.loss]]"),
    "no track": (TRACK, "position = { at = [179, 58], error = 500 }\n", "loss belongs to track"),
}  # fmt: skip


@pytest.mark.parametrize("kind", BAD)
def test_bad_tracks(kind: str, tmp_path: Path) -> None:
    old, new, message = BAD[kind]
    text = TRACK + LOSSES
    assert old in text
    with pytest.raises(UserError) as refused:
        load(tmp_path, text.replace(old, new), 60)
    assert message in str(refused.value)
