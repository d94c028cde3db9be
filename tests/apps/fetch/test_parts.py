"""Parts that an interrupted download leaves: which of them count, and who may work on them."""

import json
from pathlib import Path
from types import SimpleNamespace

import netCDF4
import numpy as np
import pytest

from drift.apps.fetch import parts
from drift.apps.fetch.catalogue import Provider
from drift.apps.fetch.order import Order, Part, Shipment
from drift.products.files import hidden
from geo.box import Box
from geo.errors import UserError

FIRST = np.datetime64("2026-02-11T00:00:00", "s")
HOURS = FIRST + np.arange(3) * np.timedelta64(3600, "s")


def current(path: Path) -> None:
    """Write a current at three hours."""
    with netCDF4.Dataset(path, "w") as data:
        for name, units, values in (
            ("time", "hours since 2026-02-11", [0.0, 1.0, 2.0]),
            ("latitude", "degrees_north", [-41.5, -41.0]),
            ("longitude", "degrees_east", [179.0, 179.5, 180.0, 180.5]),
        ):
            data.createDimension(name, len(values))
            axis = data.createVariable(name, "f8", (name,))
            axis.units = units
            axis[:] = values
        for name, value in (("uo", 0.3), ("vo", -0.2)):
            field = data.createVariable(name, "f4", ("time", "latitude", "longitude"))
            field.units = "m s-1"
            field[:] = value


def shipment(times: np.ndarray | None) -> Shipment:
    """Return a shipment of one part, from which these times are expected."""
    provider = Provider(
        name="trial",
        title="trial",
        quantity="current",
        protocol="opendap",
        address=("http://localhost",),
        dataset="sea",
        variables=("uo", "vo"),
        license="free",
    )
    box = Box(179.0, -41.5, 180.5, -41.0)
    order = Order(provider, box, HOURS[0], HOURS[-1], timeout=1.0, asked=FIRST)
    return Shipment(order, (Part("one", current, times, size=1000.0),))


def fetch(folder: Path, times: np.ndarray | None) -> list[str]:
    """Fetch the shipment's part into a folder; return what was said on the way."""
    told: list[str] = []
    with parts.locked_parts(folder) as there:
        parts.fetch(folder, [shipment(times)], there, lambda name, share: None, told.append)
    return told


@pytest.mark.parametrize("times", [HOURS, None], ids=["as asked for", "the provider's own"])
def test_a_part_with_the_times_that_were_asked_for_is_kept(
    tmp_path: Path, times: np.ndarray | None
) -> None:
    assert fetch(tmp_path / "parts", times) == []
    with parts.locked_parts(tmp_path / "parts") as there:
        assert list(there) == ["one"]


@pytest.mark.parametrize("wrong", [HOURS[:2], HOURS + np.timedelta64(1800, "s")])
def test_a_part_with_other_times_is_asked_for_again_and_then_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, wrong: np.ndarray
) -> None:
    monkeypatch.setattr(parts, "ATTEMPTS", 2)
    complaint = "a part of trial came with other times than were asked for; stopped after 2"
    with pytest.raises(UserError, match=complaint):
        fetch(tmp_path / "parts", wrong)
    with parts.locked_parts(tmp_path / "parts") as there:
        assert there == {}


def test_two_downloads_of_one_request_do_not_mix(tmp_path: Path) -> None:
    """The second one ends in a line, and the first one's unfinished part stays as it is."""
    pytest.importorskip("fcntl", reason="folders are not locked on Windows")
    folder = tmp_path / "parts"
    with parts.locked_parts(folder):
        (folder / "one.draft.nc").write_bytes(b"half")
        with (
            pytest.raises(UserError, match=r"another `drift fetch` is already downloading"),
            parts.locked_parts(folder),
        ):
            pass
        assert (folder / "one.draft.nc").read_bytes() == b"half"
    with hidden.folder_lock(folder, 0.0) as free:
        assert free


def test_only_whole_parts_are_kept(tmp_path: Path) -> None:
    """What was altered, is not in the list, or is only half there is removed."""
    folder = tmp_path / "parts"
    fetch(folder, HOURS)
    listed = json.loads((folder / parts.LIST).read_text(encoding="utf-8"))
    (folder / "altered.nc").write_bytes(b"other bytes than those of the list")
    (folder / parts.LIST).write_text(json.dumps({**listed, "altered": listed["one"], "gone": "0"}))
    for name in ("two.draft.nc", "not in the list.nc", "parts.json.draft"):
        (folder / name).write_bytes(b"half")
    (folder / "a folder").mkdir()
    with parts.locked_parts(folder) as there:
        assert there == listed
    assert {path.name for path in folder.iterdir()} == {"one.nc", parts.LIST, "a folder"}


@pytest.mark.parametrize(("free", "fits"), [(1100, True), (1099, False)])
def test_a_disk_without_room_for_a_tenth_more_is_refused_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, free: int, fits: bool
) -> None:
    monkeypatch.setattr(parts.shutil, "disk_usage", lambda folder: SimpleNamespace(free=free))
    if fits:
        fetch(tmp_path / "parts", HOURS)
    else:
        with pytest.raises(UserError, match=r"has 1\.1 kB free, and 1\.0 kB are to be fetched"):
            fetch(tmp_path / "parts", HOURS)
    assert (tmp_path / "parts" / "one.nc").exists() == fits
