"""Files of lane networks: what is read of them, in both formats, and one line for each mistake."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import drift
from cases import __file__ as cases
from drift.case.scenario import network
from drift.case.scenario.network import Chart
from drift.engine.motion.steering import lanes
from geo.errors import UserError

NMI = 1852.0
TOML = """
title = "three nodes"
node = [
    { name = "West", at = "35 54.0N 006 12.0W" },
    { name = "Middle", at = [-4.5, 36.1] },
    { name = "East", at = { lon = "000 30.0E", lat = "37 06.0N" } },
    { name = "South", at = [-3.25, 35.4] },
]
[[lane]]
from = "West"
to = "Middle"
width = "2.5 nmi"
one_way = true
[[lane]]
through = ["East", "Middle", "South"]
width = 9000
[[area]]
name = "Box"
polygon = [[-1.0, 36.5], [0.75, 36.4], [0.5, 37.0]]
"""
PLACES = {"West": (-6.2, 35.9), "Middle": (-4.5, 36.1), "East": (0.5, 37.1), "South": (-3.25, 35.4)}


def feature(kind: str, coordinates: Any, **keys: Any) -> dict[str, Any]:
    return {
        "type": "Feature",
        "geometry": {"type": kind, "coordinates": coordinates},
        "properties": keys,
    }


def line(a: str, b: str, **keys: Any) -> dict[str, Any]:
    return feature("LineString", [[*PLACES[a], 12.0], PLACES[b]], **{"from": a, "to": b, **keys})


def geojson() -> list[dict[str, Any]]:
    """Return the features of the same network, with heights and an empty property, as programs
    write them.
    """
    ring = [[-1.0, 36.5], [0.75, 36.4], [0.5, 37.0], [-1.0, 36.5]]
    return [
        line("West", "Middle", width="2.5 nmi", one_way=True),
        *(feature("Point", [*place, 0.0], name=name) for name, place in PLACES.items()),
        line("East", "Middle", width=9000, one_way=None),
        line("Middle", "South", width=9000),
        feature("Polygon", [ring], name="Box"),
    ]


def read(folder: Path, content: str | list[dict[str, Any]], suffix: str = "") -> Chart:
    """Return a file's network."""
    path = folder / f"trial{suffix or ('.toml' if isinstance(content, str) else '.geojson')}"
    text = (
        content
        if isinstance(content, str)
        else json.dumps({"type": "FeatureCollection", "features": content})
    )
    path.write_text(text, encoding="utf-8")
    return network.read_network(path)


def mistakes(folder: Path, content: str | list[dict[str, Any]], suffix: str = "") -> list[str]:
    """Return the lines of refusal, each without the file's name, with which it must begin."""
    with pytest.raises(UserError) as error:
        read(folder, content, suffix)
    name = f'network "trial{suffix or (".toml" if isinstance(content, str) else ".geojson")}": '
    assert all(line.startswith(name) and "\n" not in line for line in error.value.lines)
    return [line.removeprefix(name) for line in error.value.lines]


@pytest.mark.parametrize("content", [TOML, geojson()], ids=["toml", "geojson"])
def test_what_is_read(tmp_path: Path, content: str | list[dict[str, Any]]) -> None:
    chart = read(tmp_path, content)
    found = chart.network
    assert found.name == tuple(PLACES)
    expected = np.radians([*PLACES.values()]).T
    assert np.allclose([found.lon, found.lat], expected, rtol=0, atol=1e-12)
    ends = [(found.name[a], found.name[b]) for a, b in zip(found.start, found.end, strict=True)]
    assert ends == [("West", "Middle"), ("East", "Middle"), ("Middle", "South")]
    assert found.width.tolist() == [2.5 * NMI, 9000.0, 9000.0]
    assert found.one_way.tolist() == [True, False, False]
    assert chart.areas == {"Box": ((-1.0, 36.5), (0.75, 36.4), (0.5, 37.0))}
    assert lanes.route(found, ["West", "Middle", "South"]).node == ("West", "Middle", "South")


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ('from = "West"', 'from = "Wset"', [
            'lane "Wset - Middle": no node "Wset"; nearest is "West"',
            'node "West": no lane begins or ends there; leave it out, or add a lane',
        ]),
        ('to = "Middle"', 'to = "West"', ['lane "West - West": leads from a node to itself; name two nodes']),
        ('"2.5 nmi"', '"0 nmi"', ['''lane "West - Middle".width: width '0 nmi' must be above 0 m''']),
        ('"2.5 nmi"', '"2.5 kn"', ['lane "West - Middle".width: "2.5 kn" is not a width: "kn" is a unit of another kind; write it like "5 nmi"']),
        ('width = 9000', 'width = -9000', ["lane 2.width: width -9000 must be above 0 m"]),
        ('width = 9000', '', ["lane 2.width: is missing and has no default"]),
        ('width = 9000', 'wide = 9000', [
            'lane 2: unknown key "wide"; did you mean "width"? Allowed: from, to, through, width, one_way'
        ]),
        ('one_way = true', 'one_way = true\nthrough = ["West", "East"]', [
            'lane "West - Middle": give from and to, or through (a list of nodes); found from, through, to'
        ]),
        ('to = "Middle"\n', '', ["lane 1: give from and to, or through (a list of nodes); found from"]),
        ('["East", "Middle", "South"]', '["East"]', [
            "lane 2: through names 1 node; at least 2 are needed"
        ]),
        ('["East", "Middle", "South"]', '["East", "Middle", "South", "East", "Middle"]', [
            'lane "East - Middle": another lane leads there already; leave one out, or make both one_way'
        ]),
        ('["East", "Middle", "South"]', '["East", "Middle", "West", "South"]', [
            'lane "Middle - West": another lane leads there already; leave one out, or make both one_way'
        ]),
        ('name = "South"', 'name = "East"', [
            'node "East": 2 nodes have this name; give each its own',
            'lane "Middle - South": no node "South"; add it, or name another',
        ]),
        ('[-3.25, 35.4]', '[-4.5, 36.1]', [
            'lane "Middle - South": has no length, because both nodes have the same position; move one, or leave it out'
        ]),
        ('[-3.25, 35.4]', '[175.0, -36.1]', ['lane "Middle - South": is 10,783 nmi long; at most 5,000: put nodes between']),
        ('[-3.25, 35.4]', '[-3.25, 95.4]', ['node "South".at: latitude 95.4 is outside -90 to 90 (the order is [lon, lat])']),
        ('[-1.0, 36.5], [0.75, 36.4]', '[-1.0, 36.5]', ['area "Box": polygon has 2 corners; at least 3 are needed']),
        ('[0.5, 37.0]]', '[0.5, 37.0], [0.3, 36.0]]', [
            'area "Box": polygon crosses itself near [0.384, 36.421] (lon, lat); give its corners in order'
        ]),
        ('[[area]]', '[[area]]\nname = "Box"\npolygon = [[1, 2], [3, 2], [2, 3]]\n[[area]]', [
            'area "Box": 2 areas have this name; give each its own'
        ]),
        ('[[lane]]', '[[lanes]]', [
            'unknown key "lanes"; did you mean "lane"? Allowed: title, node, lane, area',
        ]),
        ('title = ', 'titel = ', ['unknown key "titel"; did you mean "title"? Allowed: title, node, lane, area']),
        ('[[lane]]', '[[lane]', ["not valid TOML: "]),
    ],
)  # fmt: skip
def test_mistakes_in_toml(tmp_path: Path, old: str, new: str, expected: list[str]) -> None:
    assert old in TOML
    found = mistakes(tmp_path, TOML.replace(old, new))
    if expected == ["not valid TOML: "]:
        assert found[0].startswith(expected[0])
    else:
        assert found == expected


def test_all_mistakes_are_found_at_once(tmp_path: Path) -> None:
    text = TOML.replace('"East", "Middle", "South"', '"East", "Est", "East", "East"').replace(
        'to = "Middle"', 'to = "Nowhere"'
    )
    assert mistakes(tmp_path, text) == [
        'lane "West - Nowhere": no node "Nowhere"; add it, or name another',
        'lane "East - Est": no node "Est"; nearest is "East"',
        'lane "Est - East": no node "Est"; nearest is "East"',
        'lane "East - East": leads from a node to itself; name two nodes',
        'node "Middle": no lane begins or ends there; leave it out, or add a lane',
        'node "South": no lane begins or ends there; leave it out, or add a lane',
    ]


def test_one_way_lanes_in_both_directions_are_two_lanes(tmp_path: Path) -> None:
    back = '[[lane]]\nfrom = "Middle"\nto = "West"\nwidth = "1 nmi"\none_way = true\n'
    found = read(tmp_path, TOML + back).network
    assert lanes.route(found, ["West", "Middle", "West"]).half[[0, 2]].tolist() == [
        1.25 * NMI,
        0.5 * NMI,
    ]


LINE = line("West", "Middle", width="2.5 nmi")


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({**LINE, "geometry": {"type": "LineString", "coordinates": [[-6.2, 35.9], [-5, 36], [-4.5, 36.1]]}},
         'lane "West - Middle": its line has 3 points; a lane is straight from node to node: put a node at each bend'),
        ({**LINE, "geometry": {"type": "LineString", "coordinates": [[-6.2, 35.9], [-4.5, 36.4]]}},
         'lane "West - Middle": its line ends 18 nmi from the node "Middle"; move one to the other'),
        ({**LINE, "geometry": {"type": "MultiPoint", "coordinates": []}},
         "feature 1: MultiPoint; a Point (node), a LineString (lane) or a Polygon (area) is needed"),
        ({**LINE, "geometry": {"type": "LineString", "coordinates": [[-6.2, 35.9], None]}},
         'lane "West - Middle": its line has the end null; write [lon, lat] in degrees'),
        ({**LINE, "geometry": None},
         "feature 1: no geometry; a Point (node), a LineString (lane) or a Polygon (area) is needed"),
        ("lane", "feature 1: no geometry; a Point (node), a LineString (lane) or a Polygon (area) is needed"),
        (feature("Polygon", [[[0, 1], [2, 1], [1, 3]], [[1, 1.5], [1.2, 1.5], [1, 2]]], name="Ring"),
         "feature 1: a polygon that is not one ring; an area has no holes"),
        (feature("LineString", LINE["geometry"]["coordinates"], **{"from": "West", "to": "Middle"}),
         'lane "West - Middle".width: is missing and has no default'),
        (feature("LineString", LINE["geometry"]["coordinates"], **{"from": "Wset", "to": "Middle", "width": 9}),
         'lane "Wset - Middle": no node "Wset"; nearest is "West"'),
        (feature("Point", "here", name="Here"), 'node "Here".at: position "here" holds no number; write it like "27 30.5N 088 15.0W"'),
        (feature("Point", [1.0], name="Here"), 'node "Here".at: [1.0] is not a position; write [lon, lat] in degrees'),
        (feature("Point", [1.0, 2.0], name="Here", colour="red"), 'node "Here": unknown key "colour"; allowed: name, at'),
    ],
)  # fmt: skip
def test_mistakes_in_geojson(tmp_path: Path, change: Any, expected: str) -> None:
    assert mistakes(tmp_path, [change, *geojson()[1:]])[0] == expected


@pytest.mark.parametrize(
    ("text", "suffix", "expected"),
    [
        ("{", ".json", "not valid JSON: "),
        ('{"features": ["\\ud800"]}', ".json", "not valid JSON: "),
        ("[]", ".json", "is not a GeoJSON FeatureCollection: it has no list of features"),
        (TOML, ".txt", "is neither .toml nor .geojson; give a network in one of these"),
        ("", ".toml", "node: is missing and has no default"),
        ('{"features": []}', ".geojson", "node: is missing and has no default"),
    ],
)
def test_files_that_are_no_networks(tmp_path: Path, text: str, suffix: str, expected: str) -> None:
    assert mistakes(tmp_path, text, suffix)[0].startswith(expected)


def test_files_that_cannot_be_read(tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r'^network "gone.toml": cannot be read: No such file'):
        network.read_network(tmp_path / "gone.toml")
    (tmp_path / "bytes.toml").write_bytes(b"\xff\xfe\x00a")
    with pytest.raises(UserError, match=r'^network "bytes.toml": is not text in UTF-8$'):
        network.read_network(tmp_path / "bytes.toml")


SOUTH = ("Alboran Island south", "Oran", "Algiers", "Annaba", "Galite")
NORTH = ("Alboran Island north", "Cabo de Gata", "Cartagena", "Formentera", "Menorca")
MESSINA = ("Stromboli", "Gioia", "Peloro, southbound", "Ganzirri, southbound", "Messina, southbound", "Capo dell'Armi",
           "Capo Spartivento", "Ionian Sea west", "Ionian Sea")  # fmt: skip
LIGURIA = ("Gulf of Lion", "Ligurian Sea", "Cap Corse", "Capraia", "Montecristo", "Tyrrhenian Sea")
CHANNEL = (
    "Adventure Bank",
    "Gela",
    "Malta Channel",
    "Capo Passero",
    "Ionian Sea west",
    "Ionian Sea",
)
MALTA = ("Cap Bon", "Pantelleria south", "Linosa", "Malta south", "Medina Bank")
SARDINIA = ("Sardinia south-west", "Sardinia south")
CRETE = ("Gavdos", "Crete south-east", "Levantine Sea west", "Levantine Sea")
AEGEAN = ("Matapan", "Antikythira", "Sea of Crete")
ROUTES = {  # the area to which each way leads, and the nodes after the strait
    "Ionian, Sicilian Channel": ("Ionian patrol", (*SOUTH, "Cap Bon", *CHANNEL)),
    "Ionian, Marettimo": ("Ionian patrol", (*SOUTH, "Marettimo", *CHANNEL)),
    "Ionian, Messina": ("Ionian patrol", (*NORTH, *SARDINIA, "Ustica", *MESSINA)),
    "Ionian, Liguria": ("Ionian patrol", (*NORTH, *LIGURIA, *MESSINA)),
    "Levant, Malta": ("Levantine patrol", (*SOUTH, *MALTA, *CRETE)),
    "Levant, Channel": ("Levantine patrol", (*SOUTH, "Cap Bon", *CHANNEL, *CRETE)),
    "Levant, Messina": ("Levantine patrol", (*NORTH, *SARDINIA, "Ustica", *MESSINA, *CRETE)),
    "Levant, Aegean": ("Levantine patrol", (
        *SOUTH, "Cap Bon", *CHANNEL, *AEGEAN, "Dia", "Kasos Strait", "Levantine Sea west", "Levantine Sea"
    )),
    "Sirte, Malta": ("Sirte patrol", (*SOUTH, *MALTA, "Sirte")),
    "Sirte, Channel": ("Sirte patrol", (*SOUTH, "Cap Bon", *CHANNEL, "Medina Bank", "Sirte")),
    "Sirte, Messina": ("Sirte patrol", (*NORTH, *SARDINIA, "Ustica", *MESSINA, "Medina Bank", "Sirte")),
    "Crete, Channel": ("Cretan patrol", (*SOUTH, "Cap Bon", *CHANNEL, *AEGEAN)),
    "Crete, Messina": ("Cretan patrol", (*NORTH, *SARDINIA, "Ustica", *MESSINA, *AEGEAN)),
}  # fmt: skip
STRAIT = ("Cape Spartel", "Tarifa, eastbound", "Ceuta, eastbound", "Alboran Sea west")


@pytest.fixture(scope="module")
def mediterranean() -> Chart:
    return network.read_network(Path(cases).parent / "networks" / "mediterranean.toml")


@pytest.mark.parametrize("name", ROUTES)
def test_ways_through_the_mediterranean(mediterranean: Chart, name: str) -> None:
    """Each ends in its area with its whole corridor, and is longer than the great circle, by less
    than two thirds.
    """
    import shapely

    area, nodes = ROUTES[name]
    route = lanes.route(mediterranean.network, [*STRAIT, *nodes])
    ends = np.degrees(lanes.displaced(route, np.linspace(-1, 1, 9)))[:, :, -1]
    assert shapely.contains_xy(shapely.Polygon(mediterranean.areas[area]), *ends).all()
    p = np.array(
        [
            [np.cos(y) * np.cos(x), np.cos(y) * np.sin(x), np.sin(y)]
            for x, y in zip(route.lon, route.lat, strict=True)
        ]
    )
    straight = 6_371_008.8 * np.arccos(p[0] @ p[-1])
    assert straight < route.along[-1] < 5 / 3 * straight


def test_the_mediterranean_network(mediterranean: Chart) -> None:
    """From the strait every node can be reached and left again, in the straits by the right-hand
    side alone.
    """
    found = mediterranean.network
    assert len(found.name) >= 40
    assert len(mediterranean.areas) == 4
    for name in found.name[1:]:
        lanes.shortest(found, "Cape Spartel", name)
        lanes.shortest(found, name, "Cape Spartel")
    assert "Tarifa, eastbound" in lanes.shortest(found, "Cape Spartel", "Oran")
    assert "Tarifa, westbound" in lanes.shortest(found, "Oran", "Cape Spartel")
    assert {"Scilla, northbound", "Reggio, northbound"} <= {
        *lanes.shortest(found, "Capo Spartivento", "Stromboli")
    }


def test_a_network_is_an_input_of_its_case() -> None:
    """So that summary.json records its digest; named by twelve scenarios, it is one file."""
    assert drift.load("medsearch_transit").inputs == (
        str(Path(cases).parent / "networks" / "mediterranean.toml"),
    )


def test_the_example_of_the_documentation(tmp_path: Path) -> None:
    """Its blocks are what they say: a network, and two routes that differ."""
    page = (Path(__file__).parents[3] / "docs" / "targets.md").read_text(encoding="utf-8")
    found = read(
        tmp_path, page.split("## Lane networks")[1].split("```toml\n")[1].split("```")[0]
    ).network
    assert lanes.shortest(found, "Strait", "Cape") == ("Strait", "Island north", "Cape")
    assert lanes.shortest(found, "Cape", "Strait") == ("Cape", "Island south", "Strait")
    assert lanes.route(found, ["Strait", "Island south", "Cape"]).node == (
        "Strait",
        "Island south",
        "Cape",
    )
