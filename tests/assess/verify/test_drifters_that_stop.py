"""Drifters that stop, at sea and by a shore."""

import math

import numpy as np
import pytest
from verified_drifters import RADIUS

from drift.assess.verify import grounding, starts
from drift.engine.environment.environment_spec import Coast
from drift.tracking.tracks import records as drifter_records
from drift.tracking.tracks.records import Believed, Track
from geo.errors import UserError

SQUARE = """{"type": "FeatureCollection", "features": [{"type": "Feature", "properties": {}, "geometry": {"type": "Polygon",
"coordinates": [[[-48, 40.2], [-32, 40.2], [-32, 44], [-48, 44], [-48, 40.2]]]}}]}"""


def test_what_becomes_of_a_drifter_that_stops(tmp_path):
    """Hourly fixes at 39.9 N to 40.2 N, where the land begins, by 10 h; then still.

    What follows differs.
    """
    (tmp_path / "land.geojson").write_text(SQUARE)
    shore = Coast(str(tmp_path / "land.geojson"), "strand")
    hour, begin = 3600.0, 1.6e9

    def track(name, hours, aground, lat=40.2):
        """Fixes at these hours: northward up to lat at 10 h, there until `aground`, then back
        southward.
        """
        back = 0.03 * (np.maximum(10 - hours, 0) + np.maximum(hours - aground, 0))
        return Track(name, begin + hour * hours, np.full(hours.size, -40.0), lat - back)

    to_the_end = track("a", np.arange(60.0), 60)
    silent_there = track("b", np.arange(30.0), 30)
    refloats = track("c", np.arange(60.0), 29)
    moored = track("d", np.arange(60.0), 60, lat=39.9)  # 33 km off
    carried = track("e", np.append(np.arange(30.0), np.arange(90.0, 99.0)), 30)
    ends_off = track("f", np.arange(10.0), 10)  # its last fix is 3.3 km off
    tracks = [to_the_end, silent_there, refloats, moored, carried, ends_off]
    believed = drifter_records.believed(tracks)
    assert [int(mask.sum()) for mask in believed.aground] == [50, 20, 20, 50, 20, 0]
    settings = 5 * hour, 24 * hour, 3 * hour, 3.0  # starts at 0, 5, 10 .. h
    stranded = starts.mark_stranded(believed, shore)
    found, left, early = starts.find_starts(stranded, *settings)
    hours_of = {name: [] for name in "abcdef"}
    for one in found:
        hours_of[tracks[one.track].name].append(
            ((one.time - begin) / hour, (one.until - begin) / hour)
        )
    seen = [(0.0, np.inf), (5.0, np.inf)]
    assert hours_of["a"] == seen
    # 29 h is the last fix and the end of the second
    assert hours_of["b"] == [(0.0, np.inf), (5.0, np.inf)]
    assert hours_of["c"] == [*seen, (30.0, np.inf), (35.0, np.inf)]
    assert hours_of["d"] == []
    assert hours_of["e"] == seen
    assert hours_of["f"] == []
    # e is aground until it is seen again
    assert (left.aground, left.stopped, left.gap) == (10 + 4 + 4 + 16, 12, 0)
    # c from 40 h on (4 starts), d never, e from 90 h on (2), f both
    assert left.ended == len(early) == 4 + 2 + 2
    lon, lat, aground = stranded.position(
        starts.Start(1, int(begin)), begin + hour * np.array([9.0, 9.5, 11.0, 29.0])
    )
    assert aground.tolist() == [False, False, True, True]
    assert lat == pytest.approx([40.17, 40.185, 40.2, 40.2], abs=1e-4)
    late = starts.find_starts(stranded, 5 * hour, 40 * hour, 3 * hour, 3.0)[0]
    # held to the end
    assert [one.until for one in late if one.track in (1, 4)] == [begin + 29 * hour] * 4
    lon, lat, aground = stranded.position(late[2], begin + hour * np.array([40.0, 44.0]))
    assert np.stack([lon, lat, aground]) == pytest.approx(
        np.array([[-40.0] * 2, [40.2] * 2, [1.0] * 2])
    )
    notes = []
    _, counts = starts.known_starts(stranded, shore, *settings, notes)
    assert counts == {
        "aground at the start": 34,
        "track ends too early": left.ended,
        "stopped off any shore": 12,
    }
    assert any(f"{left.ended} starts left out: the drifter's track ends before the forecast does, 2 of them" in note
               for note in notes)  # fmt: skip
    # As its note says, what ends near the shore may be counted as aground there.
    ashore = starts.mark_stranded(believed, shore, ends_aground=True)
    held, rest, _ = starts.find_starts(ashore, *settings)
    assert rest.ended == left.ended - 2  # c and e end far off
    assert [one.until for one in held if one.track == 5] == [begin + 9 * hour] * 2
    # Still for 4 h on the shore is aground, and not 4 h in slack water farther off.
    spell = np.append(np.arange(10.0), np.arange(10.0, 30.0))
    for lat, times in ((40.2, 5), (40.15, 0)):
        (mask,) = starts.mark_stranded(
            drifter_records.believed([track("g", spell, 14, lat)]), shore
        ).ashore
        assert (np.flatnonzero(mask).tolist(), mask.sum()) == (list(range(10, 15))[:times], times)
    with pytest.raises(UserError, match="no drifter can be followed"):
        starts.known_starts(starts.mark_stranded(Believed((), (), ()), shore), shore, *settings, [])
    without = starts.mark_stranded(believed, Coast("none", "strand"))
    assert not any(mask.any() for mask in without.ashore)
    assert {one.track for one in starts.find_starts(without, *settings)[0]} == {2}  # from 30 h on


def test_distances_off_a_shore(tmp_path):
    """Off a meridian and a parallel, and over the corner, by the sphere's radius; across the
    antimeridian too.
    """
    (tmp_path / "land.geojson").write_text(SQUARE.replace("-48", "176").replace("-32", "184"))
    shore = Coast(str(tmp_path / "land.geojson"), "strand")
    lon = np.array([180.0, -178.0, -175.97, 175.97, 178.0, 170.0])
    lat = np.array([40.17, 40.15, 42.0, 40.17, 41.0, 41.0])
    found = grounding.distance_from_shore(shore, lon, lat, 6000.0)
    degree = np.radians(1.0) * RADIUS
    squeeze = math.cos(math.radians(42.0)), math.cos(math.radians(40.185))
    expected = [
        0.03 * degree,
        0.05 * degree,
        0.03 * degree * squeeze[0],
        0.03 * degree * math.hypot(1, squeeze[1]),
    ]
    assert found[:4] == pytest.approx(expected, rel=0.02)
    assert found[4:].tolist() == [0.0, np.inf]
