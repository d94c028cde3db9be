"""drift track from the case to its files: what is written, what is said, and what is refused."""

import csv
import hashlib
import json
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest
import shapely
import shapely.affinity
from one_thread import Process
from pyproj import Geod

import drift
from drift.apps.cli import commands
from drift.apps.track import chase, files, map, text
from drift.apps.track.record import Chased, Regained
from drift.case.tracking import tracking
from drift.tracking.tracker import detections, doubts, holding, path, pursuit, said
from drift.tracking.tracker.detections import Detections
from drift.tracking.tracker.following import Clouds, World
from drift.tracking.tracker.pursuit import Pursuit
from geo import notation, sphere
from geo.box import Box
from geo.coast import shore
from geo.errors import UserError
from geo.notation import KNOT, NMI

EARTH = Geod(a=sphere.RADIUS, b=sphere.RADIUS)
SMALL = {"particles": "600"}
SPACE = {"g": "http://www.topografix.com/GPX/1/1"}


@pytest.fixture(scope="module")
def contact(tmp_path_factory: pytest.TempPathFactory) -> tuple[Regained, Path]:
    """The shipped case of 600 particles, and the folder of its files."""
    out = tmp_path_factory.mktemp("contact") / "out"
    return drift.track("lost_contact", out, changes=SMALL), out


@pytest.fixture
def alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have one cloud of other random numbers in place of nine, where nothing is asked of them: they
    are most of the time.
    """
    monkeypatch.setattr(holding, "OTHERS", 1)


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
    assert rows[0]["lat"] == ""  # before the first detection
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
        assert "planned on what was known" not in text.track_facts(found).get(
            "warning", ""
        )  # of legs, which are no log
        went = EARTH.inv(-77, 14, *(float(x) for x in path.degrees(place[-1])))[2]
        assert went == pytest.approx(20 * KNOT * end, rel=1e-4)  # a rhumb line of 10 nmi at 14 N
    log, _ = contact
    assert map._tracker_positions(log)[1][-1] == min(
        log.held.study.tracker.time[-1], log.held.study.end
    )


@pytest.mark.usefixtures("alone")
@pytest.mark.thorough
def test_a_path_keeps_off_the_land_there_is(tmp_path: Path) -> None:
    """From Kingston round the east of Jamaica to the north: no point of the path is on land, of
    which the straight way has much.
    """
    moved = {
        **SMALL, "pursuit.aim": "avoid", "pursuit.at": "17 50N 076 35W", "pursuit.to": "18 12N 076 14W", "pursuit.speed": "50 kn",
        "pursuit.step": "6 min",
    }  # fmt: skip
    found = drift.track("lost_contact", changes=moved)
    assert isinstance(found.chased, Chased)
    way = found.chased.found.path
    lon, lat = path.degrees(way.at(np.linspace(way.time[0], way.time[-1], 4000))[0])
    land = shapely.union_all(shore.read_land("gshhg", Box(-77.5, 17.0, -75.5, 19.0)).polygons)
    assert shapely.LineString(
        [(-76 - 35 / 60, 17 + 50 / 60), (-76 - 14 / 60, 18 + 12 / 60)]
    ).intersects(land)
    assert not shapely.contains_xy(land, lon, lat).any()
    there = Geod(a=sphere.RADIUS, b=sphere.RADIUS).inv(
        lon[-1], lat[-1], -76 - 14 / 60, 18 + 12 / 60
    )[2]
    assert there < 50 * 1852 / 10 / 4  # within its cell


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("box", "least"),
    [
        pytest.param(Box(15.0, 55.2, 15.35, 55.42), 5, marks=pytest.mark.thorough),
        pytest.param(Box(179.8, -17.0, 180.2, -16.6), 3, marks=pytest.mark.thorough),
        (Box(11.4, 78.85, 12.4, 79.05), 3),
    ],
)  # Ertholmene, islets smaller than a cell; Fiji, across 180; Svalbard
def test_no_path_crosses_land_from_or_to_harbours_either(box: Box, least: int) -> None:
    """Begins and ends within 400 m of the shore, by pyproj's geodesics on the full polygons, in
    steps of 50 m; at no more than 20 knots.
    """
    wide = Box(box.west - 1, box.south - 1, box.east + 1, box.north + 1)
    land = shapely.union_all([
        shapely.intersection(shapely.affinity.translate(one, turn), shapely.box(wide.west, wide.south, wide.east, wide.north))
        for one in shore.read_land("gshhg", wide).polygons for turn in (-360, 0, 360)
    ])  # fmt: skip
    shapely.prepare(land)
    rng, ends = np.random.default_rng(8), []
    coast = shapely.intersection(
        land.boundary, shapely.box(box.west, box.south, box.east, box.north)
    )
    while len(ends) < 12:
        at = coast.interpolate(rng.random(), normalized=True)
        lon, lat, _ = EARTH.fwd(at.x, at.y, rng.uniform(0, 360), rng.uniform(50, 400))
        lon = float(sphere.near_degrees(np.array(lon), at.x))
        if not shapely.contains_xy(land, lon, lat):
            ends.append((lon, lat))

    def ashore(*places: tuple[float, float]) -> bool:
        """Whether any of a great circle between two places is on land."""
        way = np.array(
            [
                *places,
                *EARTH.npts(
                    *places[0], *places[1], int(EARTH.inv(*places[0], *places[1])[2] / 50) + 1
                ),
            ]
        )
        return bool(
            shapely.contains_xy(land, sphere.near_degrees(way[:, 0], box.west), way[:, 1]).any()
        )

    ways = np.broadcast_to(
        path.vector(*np.radians([[box.west, box.east], [box.south, box.north]])), (9, 2, 3)
    )
    found, refused = [0, 0], []
    for k, (start, to) in enumerate(zip(ends[::2], ends[1::2], strict=True)):
        aim = {"aim": "avoid", "to": tuple(np.radians(to))} if k % 2 else {"aim": "meet"}
        asked = Pursuit(start=tuple(np.radians(start)), speed=20 * KNOT, reach=3 * NMI, begin=0.0, interval=600.0 if k % 3 else 300.0, steps=8, **aim)  # fmt: skip
        try:
            made = pursuit.pursue(
                asked, lambda _: (ways, np.ones(2)), chase.land_about(asked, chase.land())
            )
        except ValueError as error:
            refused.append(str(error))
            continue
        way = made.path
        assert way.time[-1] <= asked.times[len(made.met) - 1] + 0.1  # where its looks say it is
        places = list(zip(*path.degrees(way.place), strict=True))
        for one, other, lasting in zip(places, places[1:], np.diff(way.time), strict=False):
            assert EARTH.inv(*one, *other)[2] <= 20 * KNOT * lasting * (1 + 1e-4) + 0.01
            assert not ashore(one, other)
        assert k % 2 == 0 or EARTH.inv(*places[-1], *to)[2] < 0.01
        found[k % 2] += 1
    assert all("there is no way on cells of" in words for words in refused)
    assert sum(found) >= least


def test_where_there_is_no_land_nothing_is_closed() -> None:
    asked = tracking.load("lost_contact", {"pursuit.at": "40 00S 120 00W"})
    assert asked.pursuit is not None
    barrier = chase.land_about(asked.pursuit, chase.land())
    assert not barrier.in_squares(
        np.array([[-120.0, -119.0]]), np.array([[-40.0, -40.0]]), 1e4
    ).any()
    begin, end = path.vector(*np.radians([[-120.0, -119.0], [-40.0, -40.0]]))
    assert barrier.on_legs(begin, end[None]).tolist() == [False]
    chase.check_pursuit(asked, chase.land())


def test_legs_are_great_circles() -> None:
    """Along 70 degrees over 2 of longitude they rise by 2^2 / 8 x sin 70 cos 70 rad, 0.0028
    degrees, where a chart has a straight line.
    """
    begin, end = path.vector(*np.radians([[10.0, 12.0], [70.0, 70.0]]))
    for south, north, met in (
        (70.0015, 70.01, True),
        (69.99, 70.0015, False),
        (70.0040, 70.01, False),
    ):
        for turn in (0, 360):
            land = shapely.box(10.9 + turn, south, 11.1 + turn, north)
            barrier = chase.Shore(lambda box, land=land: [land], 11.0)
            assert barrier.on_legs(begin, np.stack([end, begin, end])).tolist() == [met, False, met]


@pytest.mark.parametrize(
    ("lon", "lat"), [(-77.2, 18.1), (178.8, -17.6), (16.0, 78.2)]
)  # Jamaica; Fiji, across 180; Svalbard
def test_a_square_is_closed_where_there_is_land_in_it_and_open_away_from_it(
    lon: float, lat: float
) -> None:
    """By squares of pyproj's geodesics on the full polygons; none is closed farther from land than
    15 % of its size.
    """
    asked = tracking.load(
        "lost_contact",
        {"pursuit.at": f"{abs(lat)}{'N' if lat > 0 else 'S'} {abs(lon)}{'E' if lon > 0 else 'W'}"},
    )
    assert asked.pursuit is not None
    closed = chase.land_about(asked.pursuit, chase.land()).in_squares
    rng, half = np.random.default_rng(4), 1500.0
    east, north = rng.uniform(-90_000, 90_000, (2, 400))
    x, y, _ = EARTH.fwd(
        np.full(400, lon),
        np.full(400, lat),
        np.degrees(np.arctan2(east, north)),
        np.hypot(east, north),
    )
    shut = closed(x, y, half)
    land = [
        polygon
        for box in (Box(-79.5, 16.5, -75, 19.7), Box(177, -19, 181, -16), Box(8, 76.5, 30, 80.5))
        for polygon in shore.read_land("gshhg", box).polygons
    ]
    tree = shapely.STRtree(
        [shapely.affinity.translate(polygon, turn) for polygon in land for turn in (-360, 0, 360)]
    )

    def touches(size: float) -> np.ndarray:
        ways = np.arange(0, 360, 5)
        reach = size / np.maximum(
            np.abs(np.cos(np.radians(ways))), np.abs(np.sin(np.radians(ways)))
        )
        rings = []
        for a, b in zip(x, y, strict=True):
            to = EARTH.fwd(np.full(72, a), np.full(72, b), ways, reach)
            rings.append(shapely.Polygon(np.stack([sphere.near_degrees(to[0], a), to[1]], axis=1)))
        found = np.zeros(len(x), bool)
        found[tree.query(rings, predicate="intersects")[0]] = True
        return found

    assert 30 < shut.sum() < 370
    assert shut[touches(half)].all()
    assert not shut[~touches(1.15 * half)].any()


@pytest.mark.thorough
def test_what_flees_reacts_to_the_path_and_what_another_vessel_does_not_matter_to_it() -> None:
    always = {**SMALL, "method.0.hide": "1", "method.0.change": "0", "method.0.leave": "0"}
    asked = tracking.load("lost_contact", always)
    assert asked.pursuit is not None
    forecast = holding.onward(asked, asked.seed)
    chased = asked.pursuit
    lon, lat = np.degrees(chased.start)
    ways = [
        path.through(
            [chased.begin, chased.times[-1]], *np.radians([[lon, lon + east], [lat, lat + 0.3]])
        )
        for east in (-0.3, 0.3)
    ]
    (one, weight), (two, same) = (forecast(way) for way in ways)
    np.testing.assert_array_equal(weight, same)
    np.testing.assert_array_equal(one[0], two[0])  # the same particles, until they act
    assert path.degrees(one[-1])[0].mean() > path.degrees(two[-1])[0].mean() + 0.02  # away from it
    elsewhere = holding.onward(
        replace(asked, pursuit=replace(chased, start=(0.0, 0.0))), asked.seed
    )
    np.testing.assert_array_equal(elsewhere(ways[0])[0], elsewhere(ways[1])[0])


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        (
            {"pursuit.begin": "60 min"},
            "pursuit: begin 050300ZMAR26 is before the last detection, 050309ZMAR26",
        ),
        (
            {"pursuit.lasting": "3 h"},
            "pursuit: it would last until 050615ZMAR26, the case until 050415ZMAR26",
        ),
        (
            {"pursuit.begin": "80 min"},
            "pursuit: the tracker has no position at 050320ZMAR26; give at, or another begin",
        ),
        (
            {"pursuit.step": "90 min"},
            "pursuit: begins 050315ZMAR26, and the case ends 050415ZMAR26: no step of 90 min fits between",
        ),
        (
            {"pursuit.begin": "3 h"},
            "pursuit: begins 050500ZMAR26, and the case ends 050415ZMAR26: no step of 10 min fits between",
        ),
        ({"pursuit.lasting": "5 min"}, "pursuit: it lasts less than a step"),
        ({"pursuit.step": "10 s"}, "360 steps make"),
        ({"pursuit.aim": "avoid"}, "a path that avoids goes to a place"),
        (
            {"pursuit.aim": "avoid", "pursuit.to": "16 00N 076 00W"},
            "out of reach: 105.9 nmi from where it begins, which is 255 min at 25 kn, and its 6 steps last 60 min",
        ),
        (
            {"pursuit.aim": "avoid", "pursuit.to": "18 10N 076 40W", "pursuit.speed": "250 kn"},
            "pursuit: the destination is on land, at 18-10.0N 076-40.0W",
        ),
        (
            {"pursuit.at": "18 10N 077 00W"},
            "pursuit: the vessel begins on land, at 18-10.0N 077-00.0W",
        ),
        ({"pursuit.replan": "1.5"}, "pursuit.replan"),
    ],
)
def test_a_pursuit_that_cannot_be_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], changes: dict[str, str], words: str
) -> None:
    with pytest.raises(UserError) as refusal:
        drift.track("lost_contact", tmp_path / "out", changes={**SMALL, **changes})
    assert any(words in line for line in refusal.value.lines), refusal.value.lines
    assert not (tmp_path / "out").exists()
    asked = ["check", "lost_contact", *(f"--set={key}={value}" for key, value in changes.items())]
    assert commands.main(asked) == 2
    assert words in capsys.readouterr().err


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        (
            {"sensor.1.on": "true", "sensor.1.reach": "60 nmi", "sensor.1.grace": "1 s"},
            "no track is held when it begins",
        ),
        # Jamaica lies between: 61 nmi straight on, 150 round its west, and an hour for it at 65 kn.
        pytest.param(
            {
                "pursuit.aim": "avoid",
                "pursuit.at": "17 30N 077 10W",
                "pursuit.to": "18 31N 077 10W",
                "pursuit.speed": "65 kn",
                "pursuit.begin": "75 min",
            },
            "there is no way on cells of 2.7 nmi, a quarter of a step (a shorter one has finer cells): "
            "land lies between, or it is too far for the time",
            marks=pytest.mark.thorough,
        ),
    ],
)
def test_a_path_that_cannot_be_leaves_the_track(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], changes: dict[str, str], words: str
) -> None:
    asked = [
        "track",
        "lost_contact",
        "--set=particles=200",
        *(f"--set={key}={value}" for key, value in changes.items()),
    ]
    assert commands.main([*asked, "--out", str(tmp_path / "out")]) == 0
    assert f"no path: {words}" in capsys.readouterr().out
    names = {file.name for file in (tmp_path / "out").iterdir()}
    assert names == {
        "manifest.json",
        "summary.json",
        "track.csv",
        "track.gpx",
        "track.png",
        "track_areas.geojson",
    }
    told = json.loads((tmp_path / "out" / "summary.json").read_text(encoding="utf-8"))["track"]
    assert told["path"] == {"found": False, "why": words}


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


@pytest.mark.thorough
def test_a_lost_track_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Every particle is too slow for the detections: what is drawn again stays, until radar finds
    nothing there.
    """
    (tmp_path / "d.csv").write_text(
        "time,sensor,bearing,range\n+1 min,radar,40,9\n", encoding="utf-8"
    )
    case = """
title = "x"
start = "2026-03-05T02:00Z"
duration = "60 min"
detections = "d.csv"
particles = 400
[tracker]
at = "14N 077W"
[[sensor]]
name = "radar"
reach = "18 nmi"
range_ambiguity = 0.05
bearing_ambiguity = 1
sweep = "12 s"
[[method]]
name = "m"
fastest = "32 kn"
"""
    (tmp_path / "c.toml").write_text(case, encoding="utf-8")
    assert commands.main(["track", str(tmp_path / "c.toml"), "--out", str(tmp_path / "out")]) == 0
    said = capsys.readouterr().out
    assert "no track is held" in said
    assert (
        "fewer than 10 % of the particles were left by sensors that detected nothing at 050206ZMAR26 by radar (within 18 nmi, grace 5 min)"
        in said
    )
    assert "found again since" not in said
    assert (tmp_path / "out" / "track.png").exists()
    found = drift.track(tmp_path / "c.toml")
    assert files.summary_of_track(found)["shown"][-1] == {
        "time": "2026-03-05T03:00:00Z", "held": False, "others_holding": 0,
    }  # fmt: skip
    assert files.summary_of_track(found)["lost"] == [
        {"time": "2026-03-05T02:06:00Z", "sensors": ["radar"]}
    ]


def test_a_mean_beside_the_half_that_is_likeliest_and_a_track_that_is_found_again_are_told(
    contact: tuple[Regained, Path],
) -> None:
    """The area of 50 % of another time in its place holds no mean; losses by a radar whose silence
    is told of while the end has a track.
    """
    held = contact[0].held
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


@pytest.mark.usefixtures("alone")
def test_a_mean_that_lies_in_no_area_is_no_place(tmp_path: Path) -> None:
    """After a range alone the mean is on the tracker: track.csv says so, track.gpx leaves it out,
    and what is said calls it no single position.
    """
    (tmp_path / "d.csv").write_text(
        "time,sensor,bearing,range\n+2 min,radar,,8\n+12 min,radar,70,8\n", encoding="utf-8"
    )
    (tmp_path / "c.toml").write_text(DOUBTFUL, encoding="utf-8")
    changes = {"particles": "1500", "show": "['5 min', '12 min']"}
    found = drift.track(tmp_path / "c.toml", tmp_path / "out", changes=changes)
    rows = list(
        csv.DictReader((tmp_path / "out" / "track.csv").read_text(encoding="utf-8").splitlines())
    )
    within = {row["time"][11:16]: row["within_percent"] for row in rows}
    assert list(within) == [
        "00:00",
        "00:02",
        "00:05",
        "00:10",
        "00:12",
        "00:15",
        "00:20",
        "00:25",
        "00:30",
    ]
    assert [within[minute] for minute in ("00:00", "00:02", "00:05", "00:10")] == [
        "",
        "none",
        "none",
        "none",
    ]
    assert {within[minute] for minute in ("00:12", "00:15", "00:20")} <= {"50", "90"}
    root = ET.parse(tmp_path / "out" / "track.gpx").getroot()
    points = [
        point.findtext("g:time", namespaces=SPACE) or ""
        for point in root.findall("g:trk/g:trkseg/g:trkpt", SPACE)
    ]
    assert [point[11:16] for point in points] == [
        minute for minute, share in within.items() if share not in {"", "none"}
    ]
    assert [
        point.findtext("g:name", namespaces=SPACE) for point in root.findall("g:wpt", SPACE)
    ] == ["050012ZMAR26"]
    told = text.track_facts(found)
    assert (
        "no single position (the mean, 13-59.9N 077-00.0W, is outside the areas), any course"
        in told["050005ZMAR26"]
    )
    assert "no single position" not in told["050012ZMAR26"]
    shown = json.loads((tmp_path / "out" / "summary.json").read_text(encoding="utf-8"))["track"][
        "shown"
    ]
    assert [one["within"] for one in shown] == [None, pytest.approx(0.5, abs=0.41)]


DOUBTFUL = """
title = "t"
start = "2026-03-05T00:00Z"
duration = "30 min"
detections = "d.csv"
particles = 40
land = "ignore"
[tracker]
at = "14N 077W"
[[sensor]]
name = "radar"
reach = "18 nmi"
range_ambiguity = 0.05
bearing_ambiguity = 1
on = false
[[method]]
name = "first"
fastest = "32 kn"
[[method]]
name = "second"
fastest = "40 kn"
"""


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
def test_what_must_be_doubted_is_told(tmp_path: Path) -> None:
    """A plot on the other side 3 minutes later needs 16 nmi less both boxes' slack, 8 nmi x
    hypot(0.05, 1 deg) each, in 3 min: 303 kn.
    """
    (tmp_path / "c.toml").write_text(DOUBTFUL, encoding="utf-8")
    (tmp_path / "d.csv").write_text(
        "time,sensor,bearing,range\n+2 min,radar,80,8\n+5 min,radar,260,8\n", encoding="utf-8"
    )
    told = text.track_facts(drift.track(tmp_path / "c.toml"))["warning"]
    speed = (16 - 2 * 8 * np.hypot(0.05, np.radians(1))) / 0.05
    assert (
        f"the plot of 050005ZMAR26 needs {speed:,.0f} kn from the one before, fastest is 32 kn"
        in told
    )
    assert "areas depend on chance: that of " in told
    assert 'followed by "first" only, the first of 2 methods' in told
    # before it is followed too
    checked = said.tracking_facts(tracking.load(tmp_path / "c.toml"))["warning"]
    assert checked.startswith(f"the plot of 050005ZMAR26 needs {speed:,.0f} kn")
    assert "areas" not in checked
    twice = "time,sensor,bearing,range\n+2 min,radar,80,8\n+2 min,radar,80,8\n+2 min,radar,80,7.9\n"
    for own in (
        twice,
        twice.replace(",80,8\n", ",0,8\n", 1)
        .replace(",80,8\n", ",360,8\n", 1)
        .replace(",80,", ",0,"),
    ):
        (tmp_path / "d.csv").write_text(own, encoding="utf-8")
        assert said.tracking_facts(tracking.load(tmp_path / "c.toml"))["warning"] == (
            "the plot of 050002ZMAR26 by radar stands 2 times: check for one that is missing"
        )
    (tmp_path / "d.csv").write_text(
        "time,sensor,bearing,range\n+2 min,radar,80,8\n+12 min,radar,70,8\n", encoding="utf-8"
    )
    inland = {"land": "turn", "tracker.at": "'15 30N 091 00W'"}  # Guatemala
    told = text.track_facts(drift.track(tmp_path / "c.toml", changes=inland))["warning"]
    assert told.startswith(
        "100 % of the box of the plot of 050002ZMAR26 is land: check its bearing and range"
    )
    assert (
        "no track is held from 050002ZMAR26, 050012ZMAR26 on, as there is no water in the box of the detection"
        in told
    )
    plots = (tmp_path / "d.csv").read_text(encoding="utf-8")
    # by bearing alone
    (tmp_path / "d.csv").write_text(plots.replace(",8\n", ",\n"), encoding="utf-8")
    told = text.track_facts(drift.track(tmp_path / "c.toml", changes=inland))["warning"]
    assert (
        "no track is held from 050002ZMAR26, 050012ZMAR26 on, as there is no water in the box of the detection: check position"
        in told
    )
    (tmp_path / "d.csv").write_text(plots, encoding="utf-8")
    plan = {"sensor.0.on": "{ every = '10 min', lasting = '2 min', begin = '121 s' }"}
    assert not any(
        "radar was off" in words
        for words in doubts.doubts_about(tracking.load(tmp_path / "c.toml", plan))
    )  # a second early
    plan = {"sensor.0.on": "{ every = '10 min', lasting = '2 min' }"}
    told = text.track_facts(drift.track(tmp_path / "c.toml", changes=plan))["warning"]
    assert "radar was off" not in told  # at 0002 and 0012 it still turns
    (tmp_path / "d.csv").write_text(
        "time,sensor,bearing,range\n+3 min,radar,80,8\n", encoding="utf-8"
    )
    told = text.track_facts(drift.track(tmp_path / "c.toml", changes=plan))["warning"]
    assert "radar was off when it detected something at 050003ZMAR26: check when it is on" in told
    # its silence is not to count
    assert "was off" not in text.track_facts(drift.track(tmp_path / "c.toml"))["warning"]
    told = text.track_facts(drift.track(tmp_path / "c.toml", changes={"particles": "1"}))["warning"]
    assert (
        "areas depend on chance: that of 50 % at 050003ZMAR26 contains 0 % of 9 other clouds"
        in told
    )
    many = {"particles": "2000"}
    told = text.track_facts(drift.track(tmp_path / "c.toml", changes=many))["warning"]
    assert "needs" not in told
    assert "areas depend on chance" not in told


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


def test_clouds_that_disagree_on_whether_a_track_is_held_are_told() -> None:
    """Clouds of one particle, each followed alone by the random numbers of a run of its own:
    whichever the first, the others are told.
    """
    asked = replace(
        tracking.load("lost_contact", {"particles": "1", "show": "['45 min', '100 min']"}),
        pursuit=None,
    )
    held = holding.hold(asked)
    assert isinstance(asked.target, Detections)
    told = detections.ordered(
        asked.sensors, asked.target, asked.tracker, np.array([2700.0, 6000.0]), asked.end
    )
    kept = []
    for run in range(10):
        alone = Clouds([World(asked.tracker, told)], asked.methods[:1], 1, asked.seed, run=run)
        kept.append(
            [len(alone.go(time).particles(0, 0, time).weight) > 0 for time in (2700.0, 6000.0)]
        )
    kept = np.array(kept)
    assert 0 < kept[1:, 0].sum() < 9
    said = text.track_facts(Regained(held))["warning"]
    for when, own, others in zip(
        ("050245ZMAR26", "050340ZMAR26"), kept[0], kept[1:].T, strict=True
    ):
        many, what = (9 - others.sum(), "no") if own else (others.sum(), "a")
        assert (
            f"at {when} {many} of 9 clouds with other random numbers hold {what} track" in said
        ) == (many > 0)


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
            late = f"known at its start, 050030ZMAR26, but the tracker's log continues until {end}: looks since then only affect the track"
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


@pytest.mark.usefixtures("alone")
@pytest.mark.thorough
def test_a_path_does_not_change_the_track(tmp_path: Path) -> None:
    """With a log that knows the vessel to where it begins the track is the same, bit for bit, with
    a pursuit and without.
    """
    case = (Path(drift.__file__).parents[1] / "cases" / "tracking" / "lost_contact.toml").read_text(
        encoding="utf-8"
    )
    (tmp_path / "lost_contact.csv").write_text(
        (Path(drift.__file__).parents[1] / "cases" / "tracking" / "lost_contact.csv").read_text(
            encoding="utf-8"
        ),
        encoding="utf-8",
    )
    found = []
    for name, body in (
        ("with", case.replace('begin = "75 min"\n', "")),
        ("without", case[: case.index("[pursuit]")]),
    ):
        (tmp_path / f"{name}.toml").write_text(body, encoding="utf-8")
        found.append(drift.track(tmp_path / f"{name}.toml", changes={"particles": "100"}))
    assert isinstance(found[0].chased, Chased)
    assert found[1].chased is None
    np.testing.assert_array_equal(found[0].held.place, found[1].held.place)
