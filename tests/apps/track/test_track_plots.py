"""Plots, sweeps and logs of drift track: on land, within a second, by a tracker inland, and at the
end of a case.
"""

import csv
import hashlib
import json
from pathlib import Path

import numpy as np
import pytest
import shapely
import shapely.affinity
from doubtful_track import DOUBTFUL, EARTH

import drift
from drift.apps.track import files, map, text
from drift.case.tracking import tracking
from drift.tracking.tracker import doubts, path, said
from geo.box import Box
from geo.coast import shore
from geo.notation import KNOT, NMI


def test_what_silence_loses_in_the_second_of_a_plot_is_not_said_to_have_had_no_water(
    tmp_path: Path,
) -> None:
    """Eyes see something to 20 nmi on a bearing, and a radar nothing within 19.9: of the box half a
    per cent is left.
    """
    (tmp_path / "d.csv").write_text(
        "time,sensor,bearing,range\n+2 min,eyes,70,\n", encoding="utf-8"
    )
    eyes = '[[sensor]]\nname = "eyes"\nreach = "20 nmi"\nrange_ambiguity = 1\nbearing_ambiguity = 2\non = false\n[[method]]'
    (tmp_path / "c.toml").write_text(DOUBTFUL.replace("[[method]]", eyes, 1), encoding="utf-8")
    changes = {"sensor.0.on": "true", "sensor.0.reach": "19.9 nmi", "sensor.0.sweep": "12 s"}
    told = text.track_facts(drift.track(tmp_path / "c.toml", changes=changes))
    assert "at 050002ZMAR26 by radar (within 19.9 nmi, grace 5 min)" in told["lost"]
    assert "no water" not in told["warning"]
    same = text.track_facts(
        drift.track(tmp_path / "c.toml", changes={**changes, "sensor.0.reach": "20 nmi"})
    )
    assert "050002ZMAR26" not in same.get("lost", "")  # then the radar's log is not whole


@pytest.mark.usefixtures("alone")
@pytest.mark.parametrize("first", ["radar", "ears"])
def test_what_is_drawn_anew_in_the_second_of_a_sweep_is_cut_by_what_that_did_not_see(
    tmp_path: Path, first: str
) -> None:
    """A bearing to 60 nmi, and in its second a radar that sees 10 nmi far and nothing there,
    whichever stands first in the file.
    """
    ears = '[[sensor]]\nname = "ears"\nreach = "60 nmi"\nrange_ambiguity = 0.8\nbearing_ambiguity = 5\nhears = true\n'
    case = DOUBTFUL.replace("particles = 40", "particles = 3000").replace("on = false", "")
    mark = "[[sensor]]" if first == "ears" else "[[method]]"
    (tmp_path / "c.toml").write_text(case.replace(mark, ears + mark, 1), encoding="utf-8")
    (tmp_path / "d.csv").write_text(
        "time,sensor,bearing,range\n+6 min,ears,211,\n", encoding="utf-8"
    )
    radar = f"sensor.{0 if first == 'radar' else 1}"
    changes = {f"{radar}.reach": "10 nmi", f"{radar}.sweep": "12 s", "show": "['6 min', '10 min']"}
    cloud = drift.track(tmp_path / "c.toml", changes=changes).held.shown[0].cloud
    assert cloud is not None
    lon, lat = path.degrees(cloud.place)
    apart = EARTH.inv(np.full(len(lon), -77.0), np.full(len(lon), 14.0), lon, lat)[2] / NMI
    assert apart.min() > 10
    # of ranges drawn from 0 to 60 nmi
    assert len(lon) == pytest.approx(3000 * 50 / 60, abs=3 * np.sqrt(3000 * 5 / 36))


PLOTS = """
title = "x"
start = "2026-03-05T00:00Z"
duration = "35 min"
every = "35 min"
show = ["35 min"]
particles = 8000
detections = "d.csv"
land = "ignore"
[[sensor]]
name = "fix"
reach = "20 nmi"
range_ambiguity = 0
bearing_ambiguity = 0.01
sweep = "12 s"
on = false
[[sensor]]
name = "radar"
reach = "20 nmi"
range_ambiguity = 0.3
bearing_ambiguity = 20
sweep = "12 s"
on = false
[[sensor]]
name = "eyes"
reach = "20 nmi"
range_ambiguity = 1
bearing_ambiguity = 180
sweep = "12 s"
on = false
[[method]]
name = "m"
fastest = "32 kn"
"""


@pytest.mark.thorough
@pytest.mark.usefixtures("alone")
def test_what_a_plot_leaves_of_the_cloud_is_told(tmp_path: Path) -> None:
    """A fix, and from there two plots on either side, 10 min apart: the share of the cloud in their
    boxes, in the plane.

    The second has a tenth of it and less drawn again too, of whom nobody knew a course; the third
    is told of, and not what another sensor has at the same time.
    """
    lon, lat, _ = EARTH.fwd(-30.0, 40.0, 37.0, 5 * NMI)
    there = f"{lat:.6f},{lon:.6f}"
    (tmp_path / "d.csv").write_text(
        "time,sensor,bearing,range,lat,lon\n"
        f"+1 min,fix,37,5,40,-30\n+11 min,radar,100,2,{there}\n+21 min,radar,280,2,{there}\n+21 min,eyes,,2,{there}\n"
        f"+31 min,eyes,,9,{there}\n",
        encoding="utf-8",
    )
    (tmp_path / "c.toml").write_text(PLOTS, encoding="utf-8")
    found = drift.track(tmp_path / "c.toml", tmp_path / "out")
    rows = list(
        csv.DictReader((tmp_path / "out" / "track.csv").read_text(encoding="utf-8").splitlines())
    )
    left = {row["time"][14:16]: row["left_percent"] for row in rows if row["left_percent"]}
    assert list(left) == ["11", "21", "31"]
    n, draw = 8000, np.random.default_rng(4)
    first = 1.2 / (32 / 6) * 40 / 360
    # Of those drawn from the second's box each has the speed it needs as its weight, and who was in
    # it 32 kn less the last estimate.
    many, pace = 400_000, found.held.speed[found.held.row(60.0)] / KNOT
    far = draw.uniform(1.4, 2.6, many)
    # [nmi], the second's bearing ahead
    begin = far * np.exp(1j * np.radians(draw.uniform(-20, 20, many)))
    weight, old = (1 - first) * (6 * far - (2 * pace - 32)), first * (32 - pace)
    own = draw.uniform(size=many) < 0.5
    way = np.where(
        own, begin, draw.uniform(0, 32 / 6, many) * np.exp(2j * np.pi * draw.uniform(size=many))
    )
    end = -(begin + way)
    inside = (np.abs(end) > 1.4) & (np.abs(end) < 2.6) & (np.abs(np.angle(end)) < np.radians(20))
    second = (weight * inside).mean() / (weight.mean() + old)
    assert 0.005 < second < 0.1
    exact = found.held.left[np.searchsorted(found.held.time, (660, 1260))]
    assert [left["11"], left["21"]] == [f"{100 * share:.1f}" for share in exact]
    for told, share in zip(exact, (first, second), strict=True):
        assert told == pytest.approx(
            share, abs=3 * np.sqrt(share * (1 - share) * (1 / n + 1 / many))
        )
    assert float(left["31"]) > 90
    assert [round(held / 60) for held in found.held.time[found.held.anew]] == [21]
    words = text.track_facts(found)
    assert words["repopulated"].startswith(
        f"at 050021ZMAR26 ({100 * float(found.held.left[found.held.anew][0]):.2g} %), because fewer than bulk, 10 % of "
    )
    assert ": half of the new particles take any course" in words["repopulated"]
    assert json.loads((tmp_path / "out" / "summary.json").read_text(encoding="utf-8"))["track"][
        "drawn_anew"
    ] == [{"time": "2026-03-05T00:21:00Z", "left": float(found.held.left[found.held.anew][0])}]
    none = drift.track(tmp_path / "c.toml", changes={"method.0.fill": "position", "particles": "100", "sensor.1.bearing_ambiguity": "0.001"})  # fmt: skip
    assert ": all of the new particles take any course" in text.track_facts(none)["repopulated"]
    # Another plot at the second's time, all round from 2 to 2.6 nmi: of what that left and drew its
    # share by weight, not by number.
    plots = (tmp_path / "d.csv").read_text(encoding="utf-8")
    (tmp_path / "d.csv").write_text(plots.replace("+21 min,radar", f"+11 min,sharp,,2.3,{there}\n+21 min,radar"), encoding="utf-8")  # fmt: skip
    sharp = '[[sensor]]\nname = "sharp"\nreach = "20 nmi"\nrange_ambiguity = 0.130434783\nbearing_ambiguity = 180\non = false\n'
    (tmp_path / "c.toml").write_text(
        PLOTS.replace("[[method]]", sharp + "[[method]]"), encoding="utf-8"
    )
    both = drift.track(tmp_path / "c.toml")
    share = ((weight * (far > 2)).mean() + old / 2) / (weight.mean() + old)
    assert abs(share - 0.5) > 0.06
    together = both.held.left[both.held.row(660.0)] / exact[0]
    assert together == pytest.approx(
        share, abs=3 * np.sqrt(share * (1 - share) * (1 / n + 1 / many))
    )
    assert both.held.drawn[both.held.row(660.0)]
    # As advised, a lower bulk keeps what was in the box of the second, which goes on into that of
    # another ahead.
    (tmp_path / "d.csv").write_text(
        plots.replace("radar,280,2,", "radar,100,4,").replace("eyes,,2,", "eyes,,4,"),
        encoding="utf-8",
    )
    kept = drift.track(tmp_path / "c.toml", changes={"method.0.bulk": "0.01"})
    assert "repopulated" not in text.track_facts(kept)
    assert kept.held.left[np.searchsorted(kept.held.time, 1260)] == 1


@pytest.mark.thorough
def test_a_plot_on_land_leaves_nothing_and_draws_nothing(tmp_path: Path) -> None:
    """The third, wholly on land: it left none of the cloud, that is told, and nothing is said to be
    drawn again from it.
    """
    (tmp_path / "c.toml").write_text(DOUBTFUL, encoding="utf-8")
    log = (
        "time,sensor,bearing,range\n+2 min,radar,120,4\n+12 min,radar,118,5\n+20 min,radar,350,8\n"
    )
    (tmp_path / "d.csv").write_text(log, encoding="utf-8")
    off = {"land": "turn", "tracker.at": "'36 00N 005 30W'"}  # Tarifa is north of it
    found = drift.track(tmp_path / "c.toml", tmp_path / "out", changes=off)
    row = next(row for row in csv.DictReader((tmp_path / "out" / "track.csv").read_text(encoding="utf-8").splitlines()) if row["time"][14:16] == "20")  # fmt: skip
    assert (row["left_percent"], row["particles"]) == ("0.0", "0")
    assert found.held.drawn[found.held.row(1200.0)]
    assert files.summary_of_track(found)["drawn_anew"] == []
    assert "no track is held from 050020ZMAR26 on" in text.track_facts(found)["warning"]
    # Two at once on either side begin a track: what the first drew was no cloud that the second
    # could contradict.
    (tmp_path / "d.csv").write_text(
        "time,sensor,bearing,range\n+2 min,radar,120,4\n+2 min,radar,300,4\n", encoding="utf-8"
    )
    held = drift.track(tmp_path / "c.toml").held
    assert np.isnan(held.left[held.row(120.0)])
    assert not held.drawn[held.row(120.0)]
    # In the second of the third another is in water: nothing is left of what was held, and it is
    # drawn again.
    (tmp_path / "d.csv").write_text(f"{log}+20 min,radar,140,6\n", encoding="utf-8")
    found = drift.track(tmp_path / "c.toml", changes=off)
    assert files.summary_of_track(found)["drawn_anew"] == [
        {"time": "2026-03-05T00:20:00Z", "left": 0.0}
    ]


@pytest.mark.thorough
def test_plots_on_land_and_a_tracker_inland_are_told(tmp_path: Path) -> None:
    """Off Anholt, by the full shoreline and geodesics of pyproj: a plot on the island, one off it,
    one by bearing alone.
    """
    (tmp_path / "c.toml").write_text(DOUBTFUL, encoding="utf-8")
    log = (
        "time,sensor,bearing,range\n+2 min,radar,216,6.2\n+5 min,radar,206,6.3\n+9 min,radar,211,\n"
    )
    (tmp_path / "d.csv").write_text(log, encoding="utf-8")
    at = {"tracker.at": "'56 47.5N 11 41.5E'", "land": "turn", "sensor.0.bearing_ambiguity": "10"}
    asked = tracking.load(tmp_path / "c.toml", at)
    land = shapely.union_all(shore.read_land("gshhg", Box(11.0, 56.4, 12.2, 57.0)).polygons)
    shares, middles = [], (np.arange(40) + 0.5) / 40
    for bearing, far in ((216, 6.2), (206, 6.3)):
        ways, ranges = np.meshgrid(bearing - 10 + 20 * middles, far * NMI * (0.95 + 0.1 * middles))
        lon, lat, _ = EARTH.fwd(
            np.full(ways.shape, 11 + 41.5 / 60), np.full(ways.shape, 56 + 47.5 / 60), ways, ranges
        )
        shares.append(shapely.contains_xy(land, lon, lat).mean())
    assert 0.5 < shares[0] < 1
    assert 0 < shares[1] < 0.5
    told = doubts.ashore(asked)
    assert list(told) == [120.0, 300.0]  # of a bearing alone nothing is said
    assert list(told.values()) == pytest.approx(shares, abs=1 / 1600)  # one place of the grid
    line = f"{100 * told[120.0]:.0f} % of the box of the plot of 050002ZMAR26 is land: check its bearing and range, and the tracker's position"
    assert doubts.doubts_about(asked) == [line]
    assert said.tracking_facts(asked)["warning"] == line
    assert doubts.doubts_about(tracking.load(tmp_path / "c.toml", {**at, "land": "ignore"})) == []
    west = tracking.load(
        tmp_path / "c.toml", {**at, "tracker.at": "'56 47.5N 9 41.5E'"}
    )  # Jutland: of a longitude one figure is wrong
    assert doubts.doubts_about(west)[-1] == (
        "the tracker is on land at 050000ZMAR26, 56-47.5N 009-41.5E: check latitudes and longitudes, unless it flies"
    )
    # A box ends at the sensor's reach.
    (tmp_path / "d.csv").write_text(log.replace("206,6.3", "206,6.1"), encoding="utf-8")
    short = doubts.ashore(tracking.load(tmp_path / "c.toml", {**at, "sensor.0.reach": "6.2 nmi"}))
    ways, ranges = np.meshgrid(
        206 + 20 * middles, NMI * (0.95 * 6.2 + (6.2 - 0.95 * 6.2) * middles)
    )
    lon, lat, _ = EARTH.fwd(
        np.full(ways.shape, 11 + 41.5 / 60), np.full(ways.shape, 56 + 47.5 / 60), ways, ranges
    )
    assert short[120.0] == pytest.approx(shapely.contains_xy(land, lon, lat).mean(), abs=1 / 1600)
    assert abs(short[120.0] - told[120.0]) > 5 / 1600
    followed = tracking.load("fast_boat", {"target.at": "'18 10N 77 20W'"})  # Jamaica
    assert [words[:31] for words in doubts.doubts_about(followed)] == [
        "the target is on land at 050000"
    ]
    quay = tracking.load(
        tmp_path / "c.toml", {**at, "tracker.at": "'56 42.6N 11 31.8E'"}
    )  # 600 to 1000 m from the water
    assert shapely.contains_xy(land, 11.53, 56.71)
    assert not any("tracker is on land" in words for words in doubts.doubts_about(quay))


LOGGED = """
title = "t"
start = "2026-03-05T00:00Z"
duration = "60 min"
detections = "d.csv"
particles = 100
land = "ignore"
[[sensor]]
name = "radar"
reach = "5.6 nmi"
range_ambiguity = 0.1
bearing_ambiguity = 3
grace = "25 min"
[[method]]
name = "one"
fastest = "32 kn"
"""


@pytest.mark.thorough
@pytest.mark.usefixtures("alone")
def test_a_log_that_ends_with_the_case_counts_to_its_end_with_a_path_too(tmp_path: Path) -> None:
    """The boat was at the edge of the radar's reach: whether silence after the path's begin counts
    makes another track.
    """
    chase = '[pursuit]\nspeed = "20 kn"\nreach = "2 nmi"\nbegin = "30 min"\nstep = "5 min"\n'
    found, runs = {}, set()
    for until in ("+59 min", "+60 min"):
        rows = f"time,sensor,bearing,range,lat,lon\n+10 min,radar,40,5,10 00N,20 00W\n{until},,,,10 00N,20 00W\n"
        (tmp_path / "d.csv").write_text(rows, encoding="utf-8")
        for more in ("", chase):
            (tmp_path / "c.toml").write_text(LOGGED + more, encoding="utf-8")
            track = drift.track(tmp_path / "c.toml", tmp_path / until if more else None)
            found[until, more] = track.held.place[:-2]
            end = "050059ZMAR26" if until == "+59 min" else "050100ZMAR26"
            # the whole of the log is drawn
            assert map._tracker_positions(track)[1][-1] == (3540 if until == "+59 min" else 3600)
            late = f"detections up to its start, 050030ZMAR26, but the tracker's log continues until {end}: looks since then only affect the track"
            assert (late in text.track_facts(track).get("warning", "")) == bool(more)
        told = json.loads((tmp_path / until / "summary.json").read_text(encoding="utf-8"))
        assert told["inputs"] == f"d.csv: sha256:{hashlib.sha256(rows.encode()).hexdigest()}"
        runs.add(told["run_id"])
    for until in ("+59 min", "+60 min"):
        assert np.isfinite(found[until, ""][-1]).all()
        np.testing.assert_array_equal(found[until, ""], found[until, chase])
    assert len(runs) == 2  # another log is another run
    (tmp_path / "c.toml").write_text(LOGGED.replace("[[sensor]]", '[tracker]\nat = "10 00N 20 00W"\n[[sensor]]', 1), encoding="utf-8")  # fmt: skip
    (tmp_path / "d.csv").write_text(
        "time,sensor,bearing,range\n+10 min,radar,40,5\n", encoding="utf-8"
    )
    alone = drift.track(tmp_path / "c.toml").held.place[:-2]
    np.testing.assert_array_equal(alone, found["+60 min", ""])
    with (tmp_path / "c.toml").open("a", encoding="utf-8") as file:
        file.write(chase)
    # nobody knows where it is from then on
    assert (drift.track(tmp_path / "c.toml").held.place[-3] != alone[-1]).any()
