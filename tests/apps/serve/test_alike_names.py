"""Names that some system takes for one, and what a browser sends of a ship's track in netCDF."""

import base64
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import small_case
import xarray as xr
from desks import Server

from drift.apps.serve import names, shelf, users
from drift.apps.serve.answers import process
from drift.apps.serve.fields import search_fields
from geo.errors import UserError

ALIKE = {
    "case": ("Boat.toml", "boat.toml"),
    "normal form": ("caf\u00e9.toml", "cafe\u0301.toml"),
    "full width": ("boat.toml", "\uff42\uff4f\uff41\uff54.toml"),
    "a ligature": ("off.toml", "o\ufb00.toml"),
    "sharp s": ("gross.toml", "gro\u00df.toml"),
    "Kelvin": ("k.toml", "\u212a.toml"),
}


@pytest.mark.parametrize("kind", ALIKE)
def test_a_new_case_has_a_name_that_no_system_mixes_up(tmp_path: Path, kind: str) -> None:
    first, second = ALIKE[kind]
    assert names.folded(first) == names.folded(second)
    shelf.save(tmp_path, first, "title = 1", None)
    with pytest.raises(shelf.Conflict):
        shelf.save(tmp_path, second, "title = 2", None)
    assert [one.name for one in tmp_path.iterdir()] == [first]
    if not names.plain(second):  # no name of a case at all
        return
    # one that was there before can still be changed
    (tmp_path / second).write_text("title = 3", encoding="utf-8")
    shelf.save(tmp_path, second, "title = 4", shelf.digest(b"title = 3"))
    assert (tmp_path / second).read_text(encoding="utf-8") == "title = 4"


@pytest.mark.parametrize("given", [("Anna", "ANNA"), ("k", "\u212a")])
def test_users_alike(given: tuple[str, str]) -> None:
    with pytest.raises(UserError, match="is given twice"):
        users.users_of(given[:1], given[1:])


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


def test_a_number_that_is_none_names_its_field() -> None:
    with pytest.raises(UserError, match=r"spill\.class\.0\.number: inf is too large a number"):
        search_fields.check_value("spill.class.0.number", [1, float("inf")])


def test_bases_of_units_are_on_the_map() -> None:
    """In degrees, by the number of the row; a row without a base has none, and does not hide it."""
    unit = '\n[[unit]]\nname = "{}"\nkind = "Boat"\nsearch_speed = "14 kn"\nendurance = "4 h"\nsweep_width = "0.5 nmi"\n'
    text = small_case.STEADY + unit.format("one") + 'base = ""\n' + unit.format("two")
    text += 'base = "50 06.0N 005 30.0W"\n[plan]\nbegin = "+2 h"\nuntil = "+5 h"\n'
    request = {"do": "search", "text": text, "path": "/nowhere/case.toml"}
    told: Any = process._answer(request, threading.Event())["answer"]
    assert list(told["shapes"]["unit"]) == [1]
    assert told["shapes"]["unit"][1] == pytest.approx([-5.5, 50.1], abs=1e-5)
    found: Any = process._answer(request | {"do": "check"}, threading.Event())["answer"]
    beside = {one["field"]: one["message"] for one in found["messages"]}
    assert "unit.0.base" in beside
    assert "the place is missing: type it, or press the button" in beside["unit.0.base"]


HOUR = np.timedelta64(3600, "s")
OUTPUTS = np.datetime64("2026-11-21T18:30", "s") + np.arange(5) * 3 * HOUR


@pytest.mark.parametrize(
    ("hours", "shown"), [(-0.1, None), (0, 0), (1.4, 0), (1.6, 1), (11.9, 4), (12.1, None)]
)
def test_a_first_map_opens_at_the_present(hours: float, shown: int | None) -> None:
    now = OUTPUTS[0] + np.timedelta64(round(3600 * hours), "s")
    found = process.present(OUTPUTS, now)
    assert found == (None if shown is None else OUTPUTS[shown])
