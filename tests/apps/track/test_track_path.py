"""Paths of drift track: round land, what flees, and pursuits that cannot be."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely
import shapely.affinity
from doubtful_track import EARTH, SMALL
from pyproj import Geod

import drift
from drift.apps.cli import commands
from drift.apps.track import chase
from drift.apps.track.record import Chased
from drift.case.tracking import tracking
from drift.tracking.tracker import holding, path, pursuit
from drift.tracking.tracker.pursuit import Pursuit
from geo import sphere
from geo.box import Box
from geo.coast import shore
from geo.errors import UserError
from geo.notation import KNOT, NMI


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
    assert all("there is no path on cells of" in words for words in refused)
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


@pytest.mark.thorough
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
            "there is no path on cells of 2.7 nmi, a quarter of a step (a shorter one has finer cells): "
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
