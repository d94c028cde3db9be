"""Zarr stores that would run code when they are read, and stores that are damaged."""

import json
import os
import pickle
from contextlib import suppress
from pathlib import Path
from typing import Any

import numcodecs
import numpy as np
import pytest
import writers
import xarray as xr
from numcodecs import registry

from geo.errors import UserError
from geo.files import dataset, zarr_store

PICKLE = {"id": "pickle", "protocol": 4}
TEXT = {"id": "vlen-utf8"}
ARRAYS: dict[str, dict[str, Any]] = {
    "filter": {"compressor": None, "filters": [TEXT, PICKLE]},
    "compressor": {"compressor": PICKLE, "filters": [TEXT]},
}


class Owned:
    """An object whose pickle runs a program when it is loaded: one that makes a file."""

    def __init__(self, mark: Path) -> None:
        self.mark = mark

    def __reduce__(self) -> tuple[Any, ...]:
        return os.system, (f"touch '{self.mark}'",)


def hostile(place: Path, kind: str, *, together: bool = False) -> Path:
    """Write a Zarr 2 store whose array runs code when it is read; together: its metadata stand in
    one file alone.
    """
    layout = {
        "zarr_format": 2,
        "shape": [1],
        "chunks": [1],
        "order": "C",
        "dtype": "|O",
        "fill_value": None,
    }
    array = layout | ARRAYS[kind]
    (place / "lat").mkdir(parents=True)
    (place / "lat" / "0").write_bytes(pickle.dumps(Owned(place.parent / "OWNED")))
    parts = {
        ".zgroup": {"zarr_format": 2}, ".zattrs": {}, "lat/.zarray": array, "lat/.zattrs": {"_ARRAY_DIMENSIONS": ["lat"]}
    }  # fmt: skip
    for name, part in parts.items():
        if not together or name == ".zgroup":
            (place / name).write_text(json.dumps(part), encoding="utf-8")
    if together:
        (place / ".zmetadata").write_text(
            json.dumps({"zarr_consolidated_format": 1, "metadata": parts}), encoding="utf-8"
        )
    return place


@pytest.fixture
def trusting(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let numcodecs decode pickles, as releases before 0.16.6 do, and later ones that are told to."""
    if hasattr(numcodecs.pickles, "ALLOW_UNSAFE_PICKLE_DECODE"):
        monkeypatch.setattr(numcodecs.pickles, "ALLOW_UNSAFE_PICKLE_DECODE", True)
    monkeypatch.setenv(zarr_store.UNSAFE, "1")


def opened_plainly(place: Path) -> None:
    """Open and read a store as xarray alone does."""
    with xr.open_dataset(place, engine="zarr") as data:
        data.load()


@pytest.mark.filterwarnings("ignore")
@pytest.mark.usefixtures("trusting")
@pytest.mark.parametrize("kind", ARRAYS)
@pytest.mark.parametrize("together", [False, True])
def test_no_code_of_a_store_runs(tmp_path: Path, kind: str, together: bool) -> None:
    """xarray alone runs it, which shows that the store is hostile; drift rejects it before a codec
    is built.
    """
    before = registry.codec_registry.get("pickle")
    store = hostile(tmp_path / "a.zarr", kind, together=together)
    with pytest.raises(UserError, match=r"pickle|Python objects") as refused:
        dataset.open_one(str(store), "current")
    assert f"{store}/{'.zmetadata' if together else 'lat/.zarray'}" in str(refused.value)
    assert not (tmp_path / "OWNED").exists()
    assert zarr_store.UNSAFE not in os.environ
    # other programs in this process keep theirs
    assert registry.codec_registry.get("pickle") is before
    with suppress(Exception):  # what the code returns is no value
        opened_plainly(store)
    assert (tmp_path / "OWNED").exists()


@pytest.mark.filterwarnings("ignore")
@pytest.mark.usefixtures("trusting")
def test_a_store_that_changes_after_it_was_looked_at_runs_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The library itself cannot build the codec meanwhile."""
    store = hostile(tmp_path / "a.zarr", "filter")
    monkeypatch.setattr(zarr_store, "check", lambda folder: None)
    with pytest.raises(UserError, match='codec "pickle" runs code'):
        dataset.open_one(str(store), "current")
    assert not (tmp_path / "OWNED").exists()


@pytest.mark.parametrize(
    ("array", "said"),
    [
        (
            {"codecs": [{"name": "numcodecs.pickle", "configuration": {}}]},
            'the codec "numcodecs.pickle"',
        ),
        ({"dtype": "<f4", "filters": [{"id": "delta", "dtype": "|O"}]}, "of Python objects"),
        ({"dtype": [["a", "<f4"], ["b", "|O"]], "filters": []}, "of Python objects"),
        ({"dtype": "|O", "filters": [{"id": "msgpack2"}]}, "of Python objects"),
        ({"dtype": "object", "filters": [{"id": "vlen-utf8"}]}, "of Python objects"),
    ],
)
def test_codecs_and_types_of_objects_are_refused(
    tmp_path: Path, array: dict[str, Any], said: str
) -> None:
    (tmp_path / "lat").mkdir()
    (tmp_path / ".zgroup").write_text('{"zarr_format": 2}', encoding="utf-8")
    (tmp_path / "lat" / ".zarray").write_text(json.dumps(array), encoding="utf-8")
    with pytest.raises(UserError, match=r"lat/\.zarray") as refused:
        zarr_store.check(str(tmp_path))
    assert said in str(refused.value)


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("edition", [2, 3])
def test_texts_and_attributes_are_read(tmp_path: Path, edition: int) -> None:
    """Names of stations, and attributes that only look like codecs."""
    names = np.array(["Hollum", "Nes"], object)
    data = xr.Dataset({"station": ("x", names)}, attrs={"id": "pickle", "dtype": "object"})
    data.to_zarr(tmp_path / "a.zarr", zarr_format=edition, consolidated=edition == 2)
    assert list(dataset.open_one(str(tmp_path / "a.zarr"), "current")["station"].values) == [
        "Hollum",
        "Nes",
    ]


DAMAGE = {
    "lat/.zarray": b'{"zarr_format": 2, "shape": [4',
    ".zmetadata": b"\xff\xfe",
    "uo/.zattrs": b"[1, 2]",
    "lon/0": b"no chunk",
    ".zgroup": None,
}


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", DAMAGE)
def test_what_is_damaged_is_named(tmp_path: Path, name: str) -> None:
    from geo.forcing import sources

    store = tmp_path / "a.zarr"
    with xr.open_dataset(writers.regular(tmp_path / "a.nc"), decode_times=False) as data:
        data.to_zarr(store, zarr_format=2, consolidated=True)
    content = DAMAGE[name]
    if content is None:
        (store / name).unlink()
    else:
        (store / name).write_bytes(content)
    with pytest.raises(UserError) as refused:
        sources.open_source("current", str(store))
    place = name.removesuffix("/0")
    assert f'"{store / place}": ' in str(refused.value)
    assert refused.value.lines == (str(refused.value),)


@pytest.mark.parametrize("field", ["id", "codec"])
def test_deep_metadata_are_refused_in_a_line(tmp_path: Path, field: str) -> None:
    (tmp_path / ".zgroup").write_text(
        '{"' + field + '":' + "[" * 100_000 + "]" * 100_000 + "}", encoding="utf-8"
    )
    with pytest.raises(UserError, match="is no JSON"):
        zarr_store.check(str(tmp_path))
