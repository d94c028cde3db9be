"""First maps that share waters are those that each case has alone."""

import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import small_case
import xarray as xr

from drift.apps.serve.answers import process, sketch_waters
from drift.case import file as case_file
from drift.engine.environment import environment
from geo.box import Box
from geo.forcing.reading import kept as kept_slices

MOVED = small_case.CASE.replace("27 30N 088 00W", "27 33N 087 56W")
FAR = small_case.CASE.replace("27 30N 088 00W", "26 30N 087 00W")


@pytest.fixture(autouse=True)
def no_waters(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sketch_waters, "_last", [])


def sketch(path: Path, text: str) -> dict[str, Any]:
    return process.ANSWERS["sketch"]({"path": str(path), "text": text}, lambda phase, share: None)


def test_a_shared_first_map_is_that_of_the_case_alone(tmp_path: Path) -> None:
    """Whether it lies in the waters of the one before, moved or not, or in others."""
    small_case.field().to_netcdf(tmp_path / "current.nc")
    path, texts = tmp_path / "case.toml", (small_case.CASE, MOVED, FAR)
    shared, regions = [], []
    for text in texts:
        shared.append(sketch(path, text))
        regions.append(sketch_waters._last[0].region)
    assert regions[0] is regions[1]
    assert regions[1] is not regions[2]
    for text, made in zip(texts[1:], shared[1:], strict=True):
        sketch_waters._last.clear()
        assert sketch(path, text) == made


def test_a_changed_file_is_read_again(tmp_path: Path) -> None:
    path, file = tmp_path / "case.toml", tmp_path / "current.nc"
    field = small_case.field()
    field.to_netcdf(file)
    before = sketch(path, small_case.CASE)
    with xr.set_options(keep_attrs=True):
        (-2 * field).to_netcdf(tmp_path / "new.nc")
    os.replace(tmp_path / "new.nc", file)
    after = sketch(path, small_case.CASE)
    assert after["likely"] != before["likely"]
    sketch_waters._last.clear()
    assert sketch(path, small_case.CASE) == after


def alone(path: Path, text: str) -> dict[str, Any]:
    """Return the first map that a process makes which has made none before."""
    sketch_waters._last.clear()
    return sketch(path, text)


def prepare(path: Path, text: str, tell: Callable[[str, float], None] | None = None) -> None:
    process.ANSWERS["prepare"](
        {"path": str(path), "text": text}, tell or (lambda phase, share: None)
    )


WIDE = """
[domain]
west = "%s"
east = "%s"
south = "10N"
north = "40N"
"""
SEVERAL = """
[[scenario]]
name = "raft"
object = "LIFE-RAFT-DB-10"
position = { at = "%s", std = "2 nmi" }
"""


def turbulent(west: float) -> xr.Dataset:
    """A current that differs from node to node and from hour to hour."""
    field = small_case.field(west=west)
    rng = np.random.default_rng(3)
    return field.map(lambda one: one.copy(data=rng.normal(0, 0.4, one.shape).astype(np.float32)))


CASES = {
    "near": (small_case.CASE, -90.0),
    "several scenarios": (small_case.CASE + SEVERAL % "27 36N 087 48W", -90.0),
    "wide": (small_case.CASE + WIDE % ("120W", "060W"), -90.0),
    "at the date line": (small_case.CASE.replace("088 00W", "179 57E"), 177.5),
    "wide, across it": (
        small_case.CASE.replace("088 00W", "179 57E")
        + WIDE % ("160E", "170W")
        + SEVERAL % "27 24N 179 48W",
        177.5,
    ),
}


@pytest.mark.thorough
@pytest.mark.parametrize("name", CASES)
def test_a_prepared_first_map_is_that_of_the_case_alone(name: str, tmp_path: Path) -> None:
    """Its second one too; and preparing reads all slices of the run, so that the map reads none."""
    text, west = CASES[name]
    turbulent(west).to_netcdf(tmp_path / "current.nc")
    path = tmp_path / "case.toml"
    expected = alone(path, text)
    sketch_waters._last.clear()
    prepare(path, text)
    region = sketch_waters._last[0].region
    opened = {key: value.read for key, value in region._cuts.items()}
    read: list[int] = []
    for key, part in region._cuts.items():
        region._cuts[key] = replace(part, read=lambda i, k=key: (read.append(i), opened[k](i))[1])
    assert sketch(path, text) == expected
    assert sketch_waters._last[0].region is region
    assert read == []
    assert sketch(path, text) == expected


@pytest.mark.thorough
def test_a_wide_case_keeps_no_more_than_it_reads(tmp_path: Path) -> None:
    """Another place in the same wide domain has the same waters, and the coast of its box."""
    text = small_case.STEADY.replace('coast.source = "none"', "") + WIDE % ("120W", "060W")
    path = tmp_path / "case.toml"
    moved = text.replace("27 30N 088 00W", "26 30N 087 00W")
    sketch(path, text)
    (kept,) = sketch_waters._last
    assert kept.region.box == environment.box_to_read(Box(-120, 10, -60, 40))
    made = sketch(path, moved)
    assert sketch_waters._last == [kept]
    assert len(kept.region._own) == 1
    assert made == alone(path, moved)


def test_slices_that_do_not_fit_are_not_read_ahead(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of six hours two are read, and the run that would read the others is not made."""
    turbulent(-90.0).to_netcdf(tmp_path / "current.nc")
    path, told = tmp_path / "case.toml", []
    prepare(path, small_case.CASE, lambda phase, share: told.append((phase, share)))
    hours = [share for phase, share in told if phase == "slices"]
    assert hours == pytest.approx(np.arange(1, 7) / 6)
    assert told[-1][0] == "map"
    (slice_, *_) = sketch_waters._last[0].region._finished._slices.values()
    # at most nine slices: seven of the run, and one more on each side
    monkeypatch.setattr(kept_slices, "MOST", 9 * slice_.nbytes * 0.4)
    sketch_waters._last.clear()
    told.clear()
    prepare(path, small_case.CASE, lambda phase, share: told.append((phase, share)))
    hours = [share for phase, share in told if phase == "slices"]
    assert hours == pytest.approx([1 / 6, 2 / 6])
    assert told[-1][0] == "slices"


def test_mistakes_are_not_the_business_of_what_prepares(tmp_path: Path) -> None:
    path = tmp_path / "case.toml"
    prepare(path, "a == 1")
    prepare(path, small_case.CASE)  # its file is missing
    turbulent(10.0).to_netcdf(tmp_path / "current.nc")  # elsewhere
    prepare(path, small_case.CASE)


def test_a_newer_text_interrupts_what_prepares(tmp_path: Path) -> None:
    """What has been read until then stays read."""

    def tell(phase: str, share: float) -> None:
        if phase == "slices" and share > 0.4:
            raise process.Cancelled

    turbulent(-90.0).to_netcdf(tmp_path / "current.nc")
    path = tmp_path / "case.toml"
    with pytest.raises(process.Cancelled):
        prepare(path, small_case.CASE, tell)
    assert sketch_waters._last[0].region._finished._slices


@pytest.mark.parametrize("text", process.warm_texts(), ids=["typed", "modelled"])
def test_the_cases_that_warm_a_process_can_be_read(text: str, tmp_path: Path) -> None:
    """They are run without a word about mistakes."""
    case = case_file.load_text(tmp_path / "warm.toml", text)
    assert case.sorties
    assert case.current_error.std > 0


def test_only_the_second_has_the_bias_of_a_model(tmp_path: Path) -> None:
    cases = [case_file.load_text(tmp_path / "warm.toml", text) for text in process.warm_texts()]
    assert [case.current_error.bias > 0 for case in cases] == [False, True]


def test_a_changed_coast_is_read_again(tmp_path: Path) -> None:
    """Land appears where the current of 0.5 kn carries what drifts for six hours."""
    land = '"Mainland","1",5\n%(w)s,27.0\n%(e)s,27.0\n%(e)s,28.0\n%(w)s,28.0\n%(w)s,27.0\n'
    coast, path = tmp_path / "coast.bna", tmp_path / "case.toml"
    text = small_case.STEADY.replace('"none"', f'"{coast}"')
    coast.write_text(land % {"w": -87.6, "e": -87.5})
    assert max(sketch(path, text)["ashore"]) == 0
    coast.write_text(land % {"w": -87.97, "e": -87.50})
    assert max(sketch(path, text)["ashore"]) > 0.5
