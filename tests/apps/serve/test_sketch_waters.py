"""First maps that share waters are those that each case has alone."""

import os
from pathlib import Path
from typing import Any

import pytest
import small_case
import xarray as xr

from drift.apps.serve.answers import process, sketch_waters

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


def test_a_wide_case_shares_nothing(tmp_path: Path) -> None:
    wide = (
        small_case.STEADY + '[domain]\nwest = "120W"\neast = "060W"\nsouth = "10N"\nnorth = "40N"\n'
    )
    sketch(tmp_path / "case.toml", wide)
    assert sketch_waters._last == []
