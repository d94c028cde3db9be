"""Exports of the page: the same bytes as drift export, one file to mail, and who may not."""

import base64
import hashlib
import io
import zipfile
from pathlib import Path
from typing import Any

import pytest
import trial_case
from desks import Server

import drift
from drift.apps.serve import users
from drift.apps.serve.answers import export_answers, process
from drift.apps.serve.routes import export_routes
from geo.errors import UserError

RUN = "raft é (1)"  # letters that a header needs spelled otherwise


def ask(folder: Path, kind: str) -> tuple[str, bytes]:
    told = process.ANSWERS["export"]({"folder": str(folder), "run": RUN, "format": kind}, print)
    return told["suffix"], base64.b64decode(told["content"])


def state(folder: Path) -> dict[str, str]:
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in folder.rglob("*")
        if path.is_file()
    }


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("results")
    path = trial_case.write(place, particles=2000)
    drift.run(drift.load(path), place / RUN)
    return place


def test_formats_are_those_of_the_command(folder: Path, tmp_path: Path) -> None:
    """Each as `drift export` writes it; a result stays as it is."""
    assert export_routes.FORMATS == export_answers.FORMATS
    before = state(folder)
    for kind in ("kml", "geojson", "sitrep"):
        drift.export(folder / RUN, kind, tmp_path / kind)
        expected = {
            path.name: path.read_bytes()
            for path in (tmp_path / kind).iterdir()
            if path.name != "manifest.json"
        }
        suffix, content = ask(folder, kind)
        if len(expected) == 1:
            ((name, data),) = expected.items()
            assert (suffix, content) == (Path(name).suffix, data)
            continue
        assert suffix == f"-{kind}.zip"
        with zipfile.ZipFile(io.BytesIO(content)) as packed:
            assert {name: packed.read(name) for name in packed.namelist()} == expected
    assert state(folder) == before


def test_one_file_to_mail(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The report, the summary, the map, the areas and the case, which can be run again."""
    suffix, content = ask(folder, "mail")
    assert suffix == ".zip"
    assert len(content) < export_answers.LARGEST_MAIL
    with zipfile.ZipFile(io.BytesIO(content)) as packed:
        held = {name: packed.read(name) for name in packed.namelist()}
    assert held["report.html"] == (folder / RUN / "report.html").read_bytes()
    assert held["map.png"] == (folder / RUN / "map.png").read_bytes()
    assert {"summary.txt", "forecast.kml", "areas.geojson"} <= held.keys()
    again = folder / "mailed.toml"
    again.write_bytes(held["case.toml"])
    assert drift.load(again).title == drift.load(folder / "case.toml").title
    again.unlink()
    # without room for the report: all that fits, and the summary says what is missing
    monkeypatch.setattr(export_answers, "LARGEST_MAIL", 400_000)
    _, content = ask(folder, "mail")
    assert len(content) <= 400_000
    with zipfile.ZipFile(io.BytesIO(content)) as packed:
        assert "report.html" not in packed.namelist()
        assert "areas.geojson" in packed.namelist()
        words = packed.read("summary.txt").decode()
    assert "too large to mail: report.html" in words


def test_what_is_not_offered(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Routes without a plan, a file that is too large, and no path of this machine in a message."""
    with pytest.raises(UserError, match="no plan") as caught:
        ask(folder, "rtz")
    assert str(folder) not in str(caught.value)
    monkeypatch.setattr(export_answers, "LARGEST", 1000)
    with pytest.raises(UserError, match="make it with drift export"):
        ask(folder, "kml")


BAD: dict[str, Any] = {
    "no format": {"run": "a"},
    "an unknown one": {"run": "a", "format": "exe"},
    "a list": {"run": "a", "format": ["kml"]},
    "a way out": {"run": "../elsewhere", "format": "kml"},
    "a path": {"run": "/etc", "format": "kml"},
    "a hidden folder": {"run": ".git", "format": "kml"},
    "a device": {"run": "con", "format": "kml"},
    "a number": {"run": 5, "format": "kml"},
    "another key": {"run": "a", "format": "kml", "out": "/tmp"},
}


@pytest.mark.parametrize("name", BAD)
def test_bad_requests(served: Server, name: str) -> None:
    assert served.ask("POST", "/api/export", BAD[name])[0] == 400


def test_who_may_not(served: Server) -> None:
    good = {"run": "done", "format": "kml"}
    for changes in ({"Cookie": None}, {"Origin": "http://evil.example"}):
        assert served.ask("POST", "/api/export", good, **changes)[0] in (401, 403)
    assert served.ask("GET", "/api/export")[0] == 405


def test_guests_may_not(folder: Path) -> None:
    people = (users.User("ANNA"), users.User("PRESS", guest=True))
    with Server(folder, people=people) as served:
        guest = {"Authorization": f"Bearer {people[1].token}", "Cookie": None}
        request = {"run": RUN, "format": "kml"}
        assert served.ask("POST", "/api/export", request, **guest)[0] == 403


@pytest.mark.thorough
def test_a_file_over_the_line(folder: Path) -> None:
    """Its name is the result's; a link and a folder without results are refused."""
    (folder / "linked").symlink_to(folder / RUN)
    (folder / "empty").mkdir()
    before = state(folder / RUN)
    with Server(folder) as served:
        status, headers, data = served.ask("POST", "/api/export", {"run": RUN, "format": "kml"})
        assert status == 200
        name = "raft%20%C3%A9%20%281%29.kml"
        assert headers["content-disposition"] == f"attachment; filename*=UTF-8''{name}"
        assert headers["content-type"] == "application/vnd.google-earth.kml+xml"
        assert data.startswith(b"<?xml")
        for other in ("linked", "empty", "absent"):
            answer = served.ask("POST", "/api/export", {"run": other, "format": "mail"})
            assert b"is not a complete result of this folder" in answer[2]
    assert state(folder / RUN) == before
