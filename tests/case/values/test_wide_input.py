"""Texts and tables that are far too wide get a line at once: what took minutes takes no time."""

import time
import tomllib
from pathlib import Path

import pytest

from drift.case import file as case_file
from drift.case.values.rows import MOST_COLUMNS, Rows
from drift.case.values.toml_text import MOST_PARTS, parse_toml
from geo.errors import UserError

PARTS = 20_000
SOON = 1.5  # [s] on a busy machine; such keys took 15 s and more
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
    begun = time.perf_counter()
    with pytest.raises(ValueError, match=rf"more than {MOST_PARTS} parts .*line 2, column 1"):
        parse_toml(text)
    assert time.perf_counter() - begun < SOON


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
def test_the_search_for_such_keys_is_quick_on_any_line(letter: str) -> None:
    begun = time.perf_counter()
    with pytest.raises((ValueError, RecursionError), match=r"\w"):
        parse_toml(letter * (2**20 // len(letter)))
    assert time.perf_counter() - begun < SOON


def test_thousands_of_unknown_keys_are_counted() -> None:
    text = "\n".join(f"k{k} = 1" for k in range(20_000))
    begun = time.perf_counter()
    with pytest.raises(UserError) as caught:
        case_file.load_text(Path("case.toml"), text)
    assert time.perf_counter() - begun < 2 * SOON  # with the parsing by tomllib
    assert len(caught.value.lines) < 25
    assert 'unknown key "k0"' in str(caught.value)


def test_a_table_of_a_million_columns(tmp_path: Path) -> None:
    path = tmp_path / "ais.csv"
    path.write_text("time,lon,lat" + ",x" * 10**6 + "\n", encoding="utf-8")
    begun = time.perf_counter()
    with pytest.raises(UserError) as caught:
        Rows(str(path), ["time"], ["time", "lon", "lat"])
    assert time.perf_counter() - begun < SOON
    assert (
        f"ais.csv: the header has 1,000,003 columns; a table has at most {MOST_COLUMNS:,}"
        in str(caught.value)
    )
    path.write_text("time,lon,lat" + "," * (MOST_COLUMNS - 3) + "\n", encoding="utf-8")
    assert Rows(str(path), ["time"], ["time", "lon", "lat"]).columns == ["time", "lon", "lat"]
