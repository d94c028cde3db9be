"""The catalogue of providers: what ships, what a user adds, whom a fetch chooses."""

import re
import tomllib
from pathlib import Path

import numpy as np
import pytest
from places import ROOT

from drift.apps.fetch import catalogue, fetching
from drift.apps.fetch.fetching import SHIP, parse_box
from drift.apps.fetch.order import Order, Shipment
from geo.box import Box
from geo.errors import UserError
from geo.forcing.times.averages import STAMPS

NOW = np.datetime64("2026-11-22T12:00:00", "s")
DAY = np.timedelta64(86_400, "s")


def test_the_page_lists_what_ships() -> None:
    page = (ROOT / "docs" / "fetch.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| `(\w+)` \| (\w+) \|.*\| ([^|]+) \|$", page, re.M)
    shipped = catalogue.read_providers(Path("/dev/null"))
    assert {(name, quantity, who) for name, quantity, who in rows} == {
        (one.name, one.quantity, one.credentials) for one in shipped.values()
    }
    assert {one.protocol for one in shipped.values()} <= set(SHIP) == set(catalogue.PROTOCOLS)
    assert all(one.license for one in shipped.values())
    assert all(one.stamp in STAMPS for one in shipped.values())
    stated = re.search(r"^For means, `stamp`.*?\n\n", page, re.M | re.S)
    assert stated is not None
    means = {one.name for one in shipped.values() if one.stamp != "instant"}
    assert set(re.findall(r"`(\w+)`\s\(", stated[0])) == means


def test_the_tables_of_a_fetch_say_where_means_are_stamped(tmp_path: Path) -> None:
    for one in catalogue.read_providers(Path("/dev/null")).values():
        order = Order(one, Box(4, 59, 7, 61), NOW, NOW + DAY, 5.0, NOW)
        table = tomllib.loads(fetching._tables(tmp_path, [Shipment(order, ())]))[one.quantity][0]
        assert table.get("times") == (None if one.stamp == "instant" else {"stamp": one.stamp})


def test_those_that_suit_are_chosen() -> None:
    known = catalogue.read_providers(Path("/dev/null"))

    def names(box: Box, begin: np.datetime64, end: np.datetime64, *named: str) -> list[str]:
        return [
            p.name
            for p in catalogue.choose(known, ["current", "wind"], named, box, begin, end, NOW)
        ]

    assert names(Box(170, -45, 190, -30), NOW, NOW + DAY) == ["hycom_espc", "noaa_gfs"]
    past = np.datetime64("2020-05-01", "s")
    assert names(Box(4, 59, 7, 61), past, past + DAY) == ["hycom_gofs", "pacioos_gfs"]
    assert names(Box(4, 59, 7, 61), NOW, NOW + DAY, "meps", "norkyst") == ["norkyst", "meps"]
    assert names(Box(4, 59, 7, 61), NOW, NOW + DAY, "meps", "meps")[1] == "meps"
    with pytest.raises(UserError, match=r"meps: noaa_gfs is named for the wind already; name one"):
        names(Box(4, 59, 7, 61), NOW, NOW + DAY, "noaa_gfs", "meps")
    with pytest.raises(UserError, match="current: no provider without credentials covers this box"):
        names(Box(4, 59, 7, 61), np.datetime64("1950-01-01", "s"), np.datetime64("1950-01-02", "s"))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[a", "not valid TOML"),
        ("[a]\ntitle = 'x'", "quantity is missing"),
        ("a = 3", "is no table"),
        ("[a]\ncolour = 'x'", 'unknown key "colour"'),
        (
            "[a]\ntitle='x'\nquantity='current'\nprotocol='ftp'\nvariables=['u','v']",
            'protocol "ftp" is not known',
        ),
        (
            "[a]\ntitle='x'\nquantity='tea'\nprotocol='opendap'\nvariables=['u','v']",
            'quantity "tea" is not known',
        ),
        (
            "[a]\ntitle='x'\nquantity='wind'\nprotocol='opendap'\nvariables=['u']",
            "variables must be the names",
        ),
        (
            "[a]\ntitle='x'\nquantity='wind'\nprotocol='opendap'\nvariables=['u','v']\nstamp='noon'",
            'stamp "noon" is not known. Allowed: start, middle, end, instant',
        ),
        (
            "[a]\ntitle='x'\nquantity='wind'\nprotocol='opendap'\nvariables=['u','v']\naddress='file:///etc/passwd'",
            "begins with https",
        ),
        (
            "[a]\ntitle='x'\nquantity='wind'\nprotocol='opendap'\nvariables=['u','v']\naddress='https://ann:pw@a.org/x'",
            "contains no name or password",
        ),
    ],
)
def test_a_mistake_in_an_own_catalogue_is_told(tmp_path: Path, text: str, message: str) -> None:
    own = tmp_path / "own.toml"
    own.write_text(text)
    with pytest.raises(UserError, match=message):
        catalogue.read_providers(own)


def test_boxes() -> None:
    assert parse_box("170,-10,-170,5") == parse_box("170,-10,190,5") == Box(170, -10, 190, 5)
    assert parse_box("350,-10,370,5") == Box(-10, -10, 10, 5)
    assert parse_box("0,-80,360,80").east - parse_box("0,-80,360,80").west == 360
    for text in ("1,2,3", "a,b,c,d", "4,61,7,59", "nan,1,2,3"):
        with pytest.raises(UserError, match="box"):
            parse_box(text)
