"""drift track from the case to its files: what is written, and what is rejected."""

import csv
import json
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest
import shapely
import shapely.affinity
from doubtful_track import DOUBTFUL, EARTH, SMALL, SPACE
from one_thread import Process
from pyproj import Geod

import drift
from drift.apps.track import files, map, text
from drift.apps.track.record import Chased, Regained
from drift.case.tracking import tracking
from drift.tracking.tracker import holding, path
from geo import notation, sphere
from geo.errors import UserError
from geo.notation import KNOT


@pytest.fixture(scope="module")
def contact(tmp_path_factory: pytest.TempPathFactory) -> tuple[Regained, Path]:
    """The shipped case of 600 particles, and the folder of its files."""
    out = tmp_path_factory.mktemp("contact") / "out"
    return drift.track("lost_contact", out, changes=SMALL), out


@pytest.mark.thorough
def test_a_track_is_written(contact: tuple[Regained, Path]) -> None:
    found, out = contact
    names = {file.name for file in out.iterdir()}
    assert names == {
        "manifest.json", "path.csv", "path.gpx", "summary.json", "track.csv", "track.gpx", "track.png", "track_areas.geojson",
    }  # fmt: skip
    rows = list(csv.DictReader((out / "track.csv").read_text(encoding="utf-8").splitlines()))
    assert [row["time"] for row in rows] == sorted({row["time"] for row in rows})  # one a time
    assert len(rows) == len(np.unique(found.held.time))
    assert [row["detection"] for row in rows].count("yes") == 9
    assert rows[0]["lat"] == rows[0]["carried_lat"] == ""  # before the first detection
    seen = [row for row in rows if row["detection"] == "yes"]
    # at a detection it is the estimate itself, unless silence in the same second cuts that further
    same = [(row["carried_lat"], row["carried_lon"]) == (row["lat"], row["lon"]) for row in seen]
    assert sum(same) >= 8
    # from the last one on it goes on at one course and speed
    lon, lat = path.degrees(found.held.carried[-1])
    assert (rows[-1]["carried_lat"], rows[-1]["carried_lon"]) == (f"{lat:.4f}", f"{lon:.4f}")
    shown = json.loads((out / "summary.json").read_text(encoding="utf-8"))["track"]["shown"]
    assert shown[-1]["carried"] == {"lat": float(lat), "lon": float(lon)}
    last = rows[-1]
    lon, lat = path.degrees(found.held.place[-1])
    assert (float(last["lat"]), float(last["lon"])) == pytest.approx(
        (float(lat), float(lon)), abs=1e-4
    )
    root = ET.parse(out / "track.gpx").getroot()
    points = root.findall("g:trk/g:trkseg/g:trkpt", SPACE)
    assert len(points) == len(rows) - 1
    assert points[-1].findtext("g:time", namespaces=SPACE) == "2026-03-05T04:15:00Z" == last["time"]
    areas = json.loads((out / "track_areas.geojson").read_text(encoding="utf-8"))["features"]
    assert len(areas) == 2 * len(found.held.shown)
    for k, cloud in enumerate(one.cloud for one in found.held.shown):
        half, most = (shapely.geometry.shape(areas[2 * k + j]["geometry"]) for j in range(2))
        assert areas[2 * k]["properties"]["probability"] == 0.5
        own = next(row for row in rows if row["time"] == areas[2 * k]["properties"]["time"])
        for j, share in enumerate(("50", "90")):
            told = areas[2 * k + j]["properties"]
            assert told["area_nmi2"] == float(own[f"area_{share}_nmi2"])
            assert told["area_km2"] == pytest.approx(told["area_nmi2"] * 1.852**2, rel=1e-3)
            assert (
                told["name"]
                == f"{share} % area {notation.format_dtg(np.datetime64(own['time'][:-1]))}"
            )
        assert most.area > half.area
        there = shapely.Point(float(own["lon"]), float(own["lat"]))
        assert own["within_percent"] == (
            "50" if half.contains(there) else "90" if most.contains(there) else "none"
        )
        assert cloud is not None
        inside = cloud.weight[shapely.contains_xy(most, *path.degrees(cloud.place))].sum()
        assert inside > 0.85
    told = json.loads((out / "summary.json").read_text(encoding="utf-8"))["track"]
    assert told["lost"] == []
    assert [one["held"] for one in told["shown"]] == [True] * 5
    for one, (time, cloud) in zip(
        told["shown"], ((each.time, each.cloud) for each in found.held.shown), strict=True
    ):
        assert cloud is not None
        there = path.degrees(cloud.place)
        to = path.degrees(cloud.place + cloud.velocity)  # a second later
        course, _, made = EARTH.inv(*there, *to)
        own = found.held.course[found.held.row(time)]
        off = (course - np.degrees(own) + 180) % 360 - 180
        assert one["course_spread_deg"] == pytest.approx(
            np.sqrt((cloud.weight * off**2).sum()), abs=0.01
        )
        mean = (cloud.weight * made).sum()
        spread = np.sqrt((cloud.weight * (made - mean) ** 2).sum()) * 3600 / 1852
        assert one["speed_std_kn"] == pytest.approx(spread, rel=1e-3)
        row = next(row for row in rows if row["time"] == one["time"])
        for key in ("course_deg", "course_spread_deg", "speed_kn", "speed_std_kn"):
            assert row[key] == f"{one[key]:.1f}"
        words = text.track_facts(found)[notation.format_dtg(text.moment(found, time))]
        assert (
            f", course {round(one['course_deg']) % 360:03d} +- {one['course_spread_deg']:.0f}, "
            in words
        )
        assert f", {one['speed_kn']:.0f} +- {one['speed_std_kn']:.0f} kn; 50 %" in words
    assert (out / "track.png").stat().st_size > 50_000


@pytest.mark.thorough
def test_a_path_is_written(contact: tuple[Regained, Path]) -> None:
    found, out = contact
    assert isinstance(found.chased, Chased)
    rows = list(csv.DictReader((out / "path.csv").read_text(encoding="utf-8").splitlines()))
    assert [row["time"] for row in rows] == [
        f"2026-03-05T0{3 + m // 60}:{m % 60:02d}:00Z" for m in range(15, 76, 10)
    ]
    lon, lat = (np.array([float(row[key]) for row in rows]) for key in ("lon", "lat"))
    azimuth, _, made = Geod(a=sphere.RADIUS, b=sphere.RADIUS).inv(
        lon[:-1], lat[:-1], lon[1:], lat[1:]
    )
    # Four decimals of a degree: 8 m at either end, in 10 min
    np.testing.assert_allclose(
        [float(row["speed_kn"]) for row in rows[:-1]], made / 600 * 3600 / 1852, atol=0.1
    )
    assert (made / 600 * 3600 / 1852 < 25.1).all()
    fast = made > 1000
    off = (np.array([float(row["course_deg"] or 0) for row in rows[:-1]]) - azimuth + 180)[
        fast
    ] % 360 - 180
    assert (np.abs(off) < 1.5).all()
    assert (found.chased.judged[3:] != found.chased.found.met[3:]).all()  # another cloud of 600
    met = [float(row["within_reach_percent"]) for row in rows]
    assert met == sorted(met)
    assert 20 < met[-1] < 70
    assert rows[0]["planned"] == "yes"
    missed = replace(found, chased=replace(found.chased, judged=np.full(len(rows), np.nan)))
    assert "another cloud has lost the track" in text.track_facts(missed)["path"]
    assert files.path_table(missed).splitlines()[-1].endswith(",,no")
    assert files.summary_of_track(missed)["path"]["found"]
    near = files.summary_of_track(found)["path"]["could_be_within_reach"]
    assert near > met[-1] / 100
    assert (
        f" % of the particles within 5 nmi (at most {100 * near:.0f} % are reachable); "
        in text.track_facts(found)["path"]
    )
    route = ET.parse(out / "path.gpx").getroot().findall("g:rte/g:rtept", SPACE)
    assert [float(point.get("lat", "")) for point in route] == pytest.approx(lat, abs=1e-4)


@pytest.mark.usefixtures("alone")
@pytest.mark.thorough
def test_the_tracker_that_goes_a_path_is_not_drawn_on_the_legs_it_leaves(
    contact: tuple[Regained, Path], tmp_path: Path
) -> None:
    """With legs until the end of the case and a path from their tenth minute on; of another
    vessel's path, and of a log, all is drawn.
    """
    legs = '[tracker]\nat = "14N 077W"\nlegs = [{ course = 30, speed = "20 kn" }]\n'
    chase = '[pursuit]\nspeed = "25 kn"\nreach = "3 nmi"\nbegin = "10 min"\nstep = "5 min"\n'
    case = DOUBTFUL.replace('[tracker]\nat = "14N 077W"\n', legs) + chase
    (tmp_path / "c.toml").write_text(case, encoding="utf-8")
    (tmp_path / "d.csv").write_text(
        "time,sensor,bearing,range\n+2 min,radar,80,8\n", encoding="utf-8"
    )
    for changes, end in (({}, 600.0), ({"pursuit.at": "14 10N 077W"}, 1800.0)):
        found = drift.track(tmp_path / "c.toml", changes=changes)
        assert isinstance(found.chased, Chased)
        place, time = map._tracker_positions(found)
        assert time[-1] == end
        assert "uses only detections up to" not in text.track_facts(found).get(
            "warning", ""
        )  # of legs, which are no log
        went = EARTH.inv(-77, 14, *(float(x) for x in path.degrees(place[-1])))[2]
        assert went == pytest.approx(20 * KNOT * end, rel=1e-4)  # a rhumb line of 10 nmi at 14 N
    log, _ = contact
    assert map._tracker_positions(log)[1][-1] == min(
        log.held.study.tracker.time[-1], log.held.study.end
    )


@pytest.mark.thorough
def test_the_command_writes_the_same_bits_with_one_thread_and_two(
    contact: tuple[Regained, Path], one_thread: Process, tmp_path: Path
) -> None:
    words = ["track", "lost_contact", "--set", "particles=600", "--threads", "1", "--out", str(tmp_path / "one"), "--quiet"]  # fmt: skip
    assert (
        one_thread.ask("from drift.apps.cli import commands; answer = commands.main(given)", *words)
        == 0
    )
    made = []
    for out in (tmp_path / "one", contact[1]):
        features = json.loads((out / "track_areas.geojson").read_text(encoding="utf-8"))["features"]
        made.append(
            (
                features,
                *((out / name).read_bytes() for name in ("track.csv", "path.csv", "track.png")),
            )
        )
    assert made[0] == made[1]


def test_a_case_of_another_command_is_named() -> None:
    with pytest.raises(
        UserError,
        match='case "overdue_boat": is a case of drift run; shipped tracking cases: closing,',
    ):
        drift.track("overdue_boat")


@pytest.mark.usefixtures("alone")
def test_a_mean_beside_the_half_that_is_likeliest_and_a_track_that_is_found_again_are_told() -> (
    None
):
    """The area of 50 % of another time in its place holds no mean; losses by a radar whose silence
    is told of while the end has a track.
    """
    held = holding.hold(tracking.load("lost_contact", SMALL))
    k = held.row(held.shown[2].time)
    when = notation.format_dtg(text.moment(Regained(held), held.time[k]))
    assert held.within[k] == 0.5
    assert "outside the area" not in text.track_facts(Regained(held))[when]
    apart = tuple({0.5: held.areas[held.row(held.shown[0].time)][0.5], 0.9: own.get(0.9)} if j == k else own for j, own in enumerate(held.areas))  # fmt: skip
    assert (
        "W (a mean, outside the area of 50 %), course"
        in text.track_facts(Regained(replace(held, areas=apart)))[when]
    )
    lost = (holding.Loss(float(held.time[1]), held.study.sensors[:1]),)
    assert text.track_facts(Regained(replace(held, lost=lost)))["lost"].startswith(
        "found again since, but without the earlier information on course and speed: fewer than 10 %"
    )


def test_what_has_no_detections_is_refused_and_nothing_is_written(tmp_path: Path) -> None:
    with pytest.raises(
        UserError,
        match=r'"closing" has a .target. instead of detections: use drift experiment closing',
    ):
        drift.track("closing", tmp_path / "out")
    with pytest.raises(UserError, match="drift track lost_contact"):
        drift.experiment("lost_contact", tmp_path / "out")
    assert not (tmp_path / "out").exists()
    assert "lost_contact" in tracking.shipped()
    with pytest.raises(
        UserError,
        match=r"^lost_contact.toml: experiment: needs a \[target\]; this case has detections, for",
    ):
        drift.track("lost_contact", tmp_path / "out", changes={"experiment.runs": "3"})


@pytest.mark.usefixtures("alone")
@pytest.mark.thorough
def test_a_tracker_that_leaps_is_told(contact: tuple[Regained, Path], tmp_path: Path) -> None:
    """One latitude ten minutes off: 10 nmi more in 5 min and back, about 144 kn where it makes 25
    mostly.
    """
    log = (Path(drift.__file__).parents[1] / "cases" / "tracking" / "lost_contact.csv").read_text(
        encoding="utf-8"
    )
    (tmp_path / "d.csv").write_text(log.replace("14 02.569N", "14 12.569N"), encoding="utf-8")
    told = text.track_facts(
        drift.track("lost_contact", changes={**SMALL, "detections": f"'{tmp_path / 'd.csv'}'"})
    )["warning"]
    assert (
        "kn from 2026-03-05T02:05:00Z to 2026-03-05T02:10:00Z, mostly it makes 24 kn: check its latitudes"
        in told
    )
    assert "would make" not in text.track_facts(contact[0]).get("warning", "")
