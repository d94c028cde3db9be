"""Texts and tables that are far too wide get a line before they are read: that took minutes."""

import tomllib
from pathlib import Path

import netCDF4
import pytest

from drift.case import file as case_file
from drift.case.tracking import reading
from drift.case.values import gpx
from drift.case.values.rows import MOST_COLUMNS, Rows
from drift.case.values.toml_text import MOST_PARTS, parse_toml
from geo.errors import UserError

PARTS = 20_000
DEEP = {
    "a key": "{} = 1",
    "a table": "[{}]\nx = 1",
    "a list of tables": "[[ {} ]]\nx = 1",
    "a key of an inline table": "x = {{ {} = 1 }}",
}


@pytest.mark.parametrize("part", ["a", '"a b"', "'.'", "a-1_"])
@pytest.mark.parametrize("joined", [".", " . ", "\t."])
@pytest.mark.parametrize("where", DEEP)
def test_a_key_of_too_many_parts(part: str, joined: str, where: str) -> None:
    text = "title = 1\n" + DEEP[where].format(joined.join([part] * PARTS))
    with pytest.raises(ValueError, match=rf"more than {MOST_PARTS} parts .*line 2, column 1"):
        parse_toml(text)


@pytest.mark.parametrize(
    "text",
    [
        ".".join(["a"] * MOST_PARTS) + " = 1",
        'title = "' + "A sentence. And one more... " * 500 + '"',
        'title = """\n' + "2.5, 3.5, -1.25, see a.b.c\n" * 500 + '"""',
        "x = [" + "1.5, 2.25, " * 5000 + "]",
        'x = "' + "." * 5000 + '"',
    ],
    ids=["as many as may be", "sentences", "lines", "numbers", "dots"],
)
def test_what_is_no_such_key(text: str) -> None:
    assert parse_toml(text) == tomllib.loads(text)


@pytest.mark.parametrize("letter", ["x", '"', "'", "a.", '"a"', "[", "'\""])
def test_the_search_for_such_keys_ends_on_any_line(letter: str) -> None:
    """A search that starts again at each letter would take hours here."""
    with pytest.raises((ValueError, RecursionError), match=r"\w"):
        parse_toml(letter * (2**20 // len(letter)))


def test_thousands_of_unknown_keys_are_counted() -> None:
    text = "\n".join(f"k{k} = 1" for k in range(20_000))
    with pytest.raises(UserError) as caught:
        case_file.load_text(Path("case.toml"), text)
    assert len(caught.value.lines) < 25
    assert 'unknown key "k0"' in str(caught.value)


def test_a_table_of_a_million_columns(tmp_path: Path) -> None:
    path = tmp_path / "ais.csv"
    path.write_text("time,lon,lat" + ",x" * 10**6 + "\n", encoding="utf-8")
    with pytest.raises(UserError) as caught:
        Rows(str(path), ["time"], ["time", "lon", "lat"])
    assert (
        f"ais.csv: the header has 1,000,003 columns; a table has at most {MOST_COLUMNS:,}"
        in str(caught.value)
    )
    path.write_text("time,lon,lat" + "," * (MOST_COLUMNS - 3) + "\n", encoding="utf-8")
    assert Rows(str(path), ["time"], ["time", "lon", "lat"]).columns == ["time", "lon", "lat"]


def test_a_track_that_is_empty_for_the_most_part(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A few kB on disk, 96 MB in memory: no value was written, so the file holds none."""
    monkeypatch.setattr(reading, "LARGEST", 2**20)
    path = tmp_path / "ship.nc"
    with netCDF4.Dataset(path, "w") as file:
        file.createDimension("time", 4 * 10**6)
        for name in ("time", "lon", "lat"):
            file.createVariable(
                name, "f8", ("time",), zlib=True, chunksizes=(10**6,), fill_value=1.0
            )
        file["time"].units = "seconds since 2026-01-01"
    assert path.stat().st_size < 10**5
    monkeypatch.setattr(reading, "_tracks", None)  # it is refused before its values are read
    with pytest.raises(UserError, match=r"ship\.nc.*has [\d,]+ bytes, and 96,000,000 in memory"):
        reading.read_drifters(path)


@pytest.mark.parametrize("inside", ["<a>{}</a>", '<a b="{}"/>'])
def test_a_gpx_file_that_is_deep_or_long(tmp_path: Path, inside: str) -> None:
    path = tmp_path / "ship.gpx"
    before, after = inside.split("{}")
    path.write_text(f"<gpx>{before * 60_000}{after * 60_000}</gpx>", encoding="utf-8")
    with pytest.raises(UserError, match=r"ship\.gpx"):
        gpx.read_gpx(path)
