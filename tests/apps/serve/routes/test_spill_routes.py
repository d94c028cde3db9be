"""Routes of spills: what they take, the tracks they save, and the places of finds on the shore."""

import base64
from importlib import resources
from pathlib import Path
from typing import Any

import pytest
import small_case
import xarray as xr
from desks import Server, check_strangers

GPX = '<?xml version="1.0"?><gpx version="1.1"><trk><trkseg/></trk></gpx>'
CSV = "time,lon,lat\n2026-11-28T00:00:00Z,4.6,53.5\n"
ZOE = resources.files("cases").joinpath("zoe_containers.toml").read_text()
GOOD: dict[str, Any] = {
    "spill": {"text": small_case.STEADY, "name": "case.toml"},
    "spill/turn": {"text": small_case.STEADY, "spill": True},
    "spill/tracks": {},
    "spill/track": {"name": "ais.csv", "text": CSV},
    "washup": {"run": "done"},
    "washup/keep": {"run": "done", "patrol": "north", "text": ""},
}


def bad(path: str, status: int = 400, /, **changes: Any) -> tuple[str, Any, int]:
    return path, {**GOOD[path], **changes}, status


BAD: dict[str, tuple[str, Any, int]] = {
    "half a spill": ("spill", {"text": ""}, 400),
    "a way out": bad("spill", name="../case.toml"),
    "a turn of words": bad("spill/turn", spill="yes"),
    "a turn of 1": bad("spill/turn", spill=1),
    "a turn of no text": bad("spill/turn", text=3),
    "a key too many": bad("spill/tracks", folder="/"),
    "a track outside": bad("spill/track", name="../ais.csv"),
    "a hidden track": bad("spill/track", name=".ais.csv"),
    "a case for a track": bad("spill/track", name="ais.toml"),
    "a file of netCDF as text": bad("spill/track", name="ais.nc"),
    "a track with a zero": bad("spill/track", text=f"{CSV}\0"),
    "a long track": bad("spill/track", 413, text=CSV + " " * 2**20),
    "a page for a track": bad("spill/track", name="a.gpx", text="<html></html>"),
    "entities": bad("spill/track", name="a.gpx", text=f'<!DOCTYPE x [<!ENTITY y "z">]>{GPX}'),
    "a result outside": bad("washup", run="../elsewhere"),
    "a result of no name": bad("washup", run=None),
    "a result and a path": bad("washup", path="/etc"),
    "no patrol": bad("washup/keep", patrol=None),
    "a long patrol": bad("washup/keep", patrol="x" * 2000),
    "a long text": bad("washup/keep", 413, text="x" * (2**20 + 1)),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_requests(served: Server, name: str) -> None:
    """None of them starts a process or writes a file."""
    path, body, expected = BAD[name]
    before = sorted(one.name for one in served.folder.iterdir())
    status, _, data = served.ask("POST", f"/api/{path}", body)
    assert status == expected, data
    assert sorted(one.name for one in served.folder.iterdir()) == before


@pytest.mark.parametrize("path", GOOD)
def test_who_may_not(served: Server, path: str) -> None:
    check_strangers(served, path, GOOD[path])
    assert not (served.folder / "ais.csv").exists()


def test_tracks_are_saved_once(served: Server) -> None:
    assert served.json("POST", "/api/spill/track", GOOD["spill/track"]) == {"name": "ais.csv"}
    assert (served.folder / "ais.csv").read_text() == CSV
    status, _, data = served.ask("POST", "/api/spill/track", {"name": "ais.csv", "text": "other"})
    assert status == 409
    assert b"exists already; nothing was saved" in data
    assert (served.folder / "ais.csv").read_text() == CSV
    (served.folder / "ship.nc").write_bytes(b"CDF")
    served.json("POST", "/api/spill/track", {"name": "ship.gpx", "text": GPX})
    told = served.json("POST", "/api/spill/tracks", {})
    assert told == {"files": ["ais.csv", "ship.gpx", "ship.nc"]}


@pytest.mark.thorough
def test_a_spill_in_the_text(served: Server) -> None:
    """The ship's way points, and where a loss may lie: from 1900Z to 2330Z, between two of them.

    A find in the open sea has the message of a run; the others lie within 3 km of the shore.
    """
    text = ZOE.replace('"53 26.2N 005 26.4E"', '"53 40N 005 26.4E"')
    told = served.json("POST", "/api/spill", {"text": text, "name": "zoe.toml"})
    shapes = told["shapes"]
    assert shapes["track"][0] == [4.25, pytest.approx(53 + 25 / 60, abs=1e-5)]
    assert len(shapes["track"]) == 5
    first, second = shapes["losses"]
    assert first["period"] == "011900ZJAN19 to 012330ZJAN19"
    # 1900Z is two of three hours on the way from 004 15E to 005 00E, 2330Z the point at 006 00E
    assert first["points"][0][0] == pytest.approx(4.25 + 2 / 3 * 0.75, abs=1e-4)
    assert first["points"][-1][0] == pytest.approx(6.0, abs=1e-5)
    assert len(second["points"]) == 3  # with the point at 0200Z
    finds = shapes["finds"]
    assert "off the coast; the nearest coast is at" in finds["0"]["mistake"]
    assert "say at_sea = true" in finds["0"]["mistake"]
    for k in ("1", "2"):
        assert finds[k]["mistake"] is None
        assert 0 < finds[k]["off_shore"] < 3000
    at_sea = text.replace('time = "020930ZJAN2019"', 'time = "020930ZJAN2019"\nat_sea = true')
    told = served.json("POST", "/api/spill", {"text": at_sea, "name": "zoe.toml"})
    assert told["shapes"]["finds"]["0"]["mistake"] is None


def test_rows_are_drawn_where_the_case_has_mistakes(served: Server) -> None:
    text = ZOE.replace('start = "011700ZJAN2019"', "") + (
        '\n[[patrol]]\nname = "p"\nbetween = ["53 26N 005 20E", "53 27N 005 30E"]\n'
        '[[patrol_unit]]\nname = "q"\nbase = "53 25N 005 20E"\nreach = "10 nmi"\n'
        '[[patrol_unit]]\nname = "r"\nbase = "53 25 005 20E"\n[[patrol_unit]]\nname = "s"\n'
    )
    shapes = served.json("POST", "/api/spill", {"text": text, "name": "zoe.toml"})["shapes"]
    assert len(shapes["track"]) == 5
    assert shapes["losses"] == []
    assert shapes["patrols"]["0"]["points"][1] == [5.5, 53.45]
    assert shapes["teams"] == {"0": {"at": [5.33333, 53.41667], "reach": 18520.0}}
    turned = served.json("POST", "/api/spill/turn", GOOD["spill/turn"])
    assert "[spill]" in turned["text"]


@pytest.mark.thorough
def test_what_is_no_spill_is_one_line(served: Server) -> None:
    told = served.json("POST", "/api/washup", GOOD["washup"])
    assert told["mistakes"] == ["done: holds no stretches of coast that the page can show"]
    told = served.json("POST", "/api/washup/keep", GOOD["washup/keep"])
    assert told["mistakes"] == ["done: holds no patrols that the page can show"]


def ship(tmp_path: Path) -> bytes:
    path = tmp_path / "made.nc"
    xr.Dataset({"lon": ("time", [4.6, 4.7]), "lat": ("time", [53.5, 53.6])}).to_netcdf(
        path, engine="scipy"
    )
    return path.read_bytes()


def test_a_track_in_netcdf_is_saved_byte_by_byte(served: Server, tmp_path: Path) -> None:
    data = ship(tmp_path)
    text = base64.b64encode(data).decode()
    assert served.json("POST", "/api/spill/track", {"name": "ship.nc", "text": text})
    assert (served.folder / "ship.nc").read_bytes() == data
    status, _, answer = served.ask("POST", "/api/spill/track", {"name": "SHIP.nc", "text": text})
    assert (status, b"exists already" in answer) == (409, True)


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("time,lon,lat", "is sent in base64"),
        (base64.b64encode(b"<gpx>" * 9).decode(), "begins with neither CDF nor HDF"),
        ("Q0RGAQ==\u00e9", "is sent in base64"),
        ("", "begins with neither CDF nor HDF"),
    ],
)
def test_what_is_no_netcdf(served: Server, text: str, line: str) -> None:
    status, _, answer = served.ask("POST", "/api/spill/track", {"name": "ship.nc", "text": text})
    assert (status, line in answer.decode()) == (400, True), answer
    assert not (served.folder / "ship.nc").exists()
