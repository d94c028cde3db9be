"""Routes of searches, plans and results on the map: what they take, and the GPX file they save."""

from typing import Any

import pytest
import small_case
from desks import Server, check_strangers

GPX = '<?xml version="1.0"?><gpx version="1.1"><trk><trkseg/></trk></gpx>'
MOVE = {"at": [-5.3, 50.0], "turned": 10}
GOOD: dict[str, Any] = {
    "search": {"text": small_case.STEADY, "name": "case.toml"},
    "search/tracks": {},
    "search/gpx": {"name": "a.gpx", "text": GPX},
    "plan": {"run": "done"},
    "plan/pos": {"run": "done", "moves": {"A-1": MOVE}},
    "plan/keep": {"run": "done", "moves": {}, "area": "A-1", "text": ""},
    "result": {"run": "done", "scenario": None},
    "result/value": {"run": "done", "scenario": None, "time": 0, "at": [-5.3, 50.0]},
}


def bad(path: str, status: int = 400, /, **changes: Any) -> tuple[str, Any, int]:
    return path, {**GOOD[path], **changes}, status


BAD: dict[str, tuple[str, Any, int]] = {
    "half a search": ("search", {"text": ""}, 400),
    "a way out": bad("search", name="../case.toml"),
    "a key too many": bad("search/tracks", folder="/"),
    "a track outside": bad("search/gpx", name="../a.gpx"),
    "an absolute track": bad("search/gpx", name="/tmp/a.gpx"),
    "a hidden track": bad("search/gpx", name=".a.gpx"),
    "a case for a track": bad("search/gpx", name="a.toml"),
    "two endings": bad("search/gpx", name="a.gpx.toml"),
    "a device": bad("search/gpx", name="con.gpx"),
    "a track of no name": bad("search/gpx", name=7),
    "a track with a zero": bad("search/gpx", text=f"{GPX}\0"),
    "half a letter in a track": bad("search/gpx", text=f"{GPX}\ud800"),
    "a long track": bad("search/gpx", 413, text=GPX + " " * 2**20),
    "no track": bad("search/gpx", text="title = 1"),
    "a page for a track": bad("search/gpx", text=" " * 5000 + GPX),
    "entities": bad("search/gpx", text=f'<!DOCTYPE x [<!ENTITY y "z">]>{GPX}'),
    "a plan outside": bad("plan", run="../elsewhere"),
    "a plan of no name": bad("plan", run=None),
    "a plan and a path": bad("plan", path="/etc"),
    "no moves": bad("plan/pos", moves=[]),
    "many moves": bad("plan/pos", moves={f"A-{k}": MOVE for k in range(101)}),
    "a long name": bad("plan/pos", moves={"A" * 21: MOVE}),
    "half a move": bad("plan/pos", moves={"A-1": {"at": [0, 0]}}),
    "a move and more": bad("plan/pos", moves={"A-1": {**MOVE, "size": 2}}),
    "a move of words": bad("plan/pos", moves={"A-1": {**MOVE, "at": ["0", 0]}}),
    "a move of truths": bad("plan/pos", moves={"A-1": {**MOVE, "at": [True, 0]}}),
    "a move to the pole": bad("plan/pos", moves={"A-1": {**MOVE, "at": [0, 90]}}),
    "a turn too many": bad("plan/pos", moves={"A-1": {**MOVE, "turned": 361}}),
    "a turn of nothing": (
        "plan/pos",
        b'{"run": "done", "moves": {"A-1": {"at": [0, 0], "turned": NaN}}}',
        400,
    ),
    "no area": bad("plan/keep", area=None),
    "a long text": bad("plan/keep", 413, text="x" * (2**20 + 1)),
    "a result outside": bad("result", run="/etc"),
    "a scenario of numbers": bad("result", scenario=3),
    "an empty scenario": bad("result", scenario=""),
    "a negative time": bad("result/value", time=-1),
    "a true time": bad("result/value", time=True),
    "half a place": bad("result/value", at=[0]),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_requests(served: Server, name: str) -> None:
    """None of them starts a process or writes a file."""
    path, body, expected = BAD[name]
    before = sorted(one.name for one in served.folder.iterdir())
    status, _, data = served.ask("POST", f"/api/{path}", body)
    assert status == expected, data
    assert sorted(one.name for one in served.folder.iterdir()) == before
    assert not (served.folder.parent / "a.gpx").exists()


@pytest.mark.parametrize("path", GOOD)
def test_who_may_not(served: Server, path: str) -> None:
    check_strangers(served, path, GOOD[path])
    assert not (served.folder / "a.gpx").exists()


def test_a_track_is_saved_once(served: Server) -> None:
    assert served.json("POST", "/api/search/gpx", GOOD["search/gpx"]) == {"name": "a.gpx"}
    assert (served.folder / "a.gpx").read_text() == GPX
    for name in ("a.gpx", "link.gpx"):
        (served.folder / "link.gpx").unlink(missing_ok=True)
        (served.folder / "link.gpx").symlink_to(served.folder.parent / "new.gpx")
        body = {"name": name, "text": GPX + "<!-- other -->"}
        status, _, data = served.ask("POST", "/api/search/gpx", body)
        assert status == 409
        assert b"exists already; nothing was saved" in data
    assert (served.folder / "a.gpx").read_text() == GPX
    assert not (served.folder.parent / "new.gpx").exists()
    # a link is no track of the folder
    assert served.json("POST", "/api/search/tracks", {}) == {"files": ["a.gpx"]}


@pytest.mark.thorough
def test_what_is_no_plan_is_one_line(served: Server) -> None:
    """Results without a plan or a forecast, such as those of someone else."""
    for path in ("plan", "plan/keep"):
        told = served.json("POST", f"/api/{path}", GOOD[path])
        assert told["mistakes"] == ["done: holds no plan of units that the page can show"]
    for run in ("linked", "elsewhere", "half"):
        assert "mistakes" in served.json("POST", "/api/plan", {"run": run})


@pytest.mark.thorough
def test_what_is_no_forecast_is_one_line(served: Server) -> None:
    for path in ("result", "result/value"):
        told = served.json("POST", f"/api/{path}", GOOD[path])
        assert told["mistakes"] == ["done: holds no forecast that the page can show"]


def test_a_search_in_the_text(served: Server) -> None:
    """A parallel search of 6 by 3 nmi, 1 nmi apart: three legs of 5 nmi and two of 1 nmi."""
    text = f"""{small_case.STEADY}
[[sortie]]
name = "boat"
start = "+1 h"
speed = "14 kn"
sweep_width = "0.6 nmi"
pattern = {{ kind = "parallel", centre = "27 30N 088 00W", length = "6 nmi", width = "3 nmi", spacing = "1 nmi" }}
[[sortie]]
name = "wrong"
start = "+1 h"
"""
    told = served.json("POST", "/api/search", {"text": text, "name": "case.toml"})
    assert [row["values"]["name"] for row in told["rows"]["sortie"]] == ["boat", "wrong"]
    (number,) = told["shapes"]["sortie"]  # the other has a mistake
    boat = told["shapes"]["sortie"][number]
    assert number == "0"
    assert boat["track_nmi"] == 17.0
    assert boat["start"] == "2026-11-21T01:00:00Z"
    lats = [lat for _, lat in boat["legs"][0]["points"]]
    assert max(lats) - min(lats) == pytest.approx(5 / 60, abs=2e-4)  # 1 nmi is 1852 m, not 1 minute
