"""What users call things, in the files that others open: no cell runs, no markup breaks, no two
names become one.
"""

import csv
import io
import json
import warnings
import xml.etree.ElementTree as ET
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
import searches
import small_case
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st

from drift.case import file as case_file
from drift.case import spill
from drift.forecast import tracks as forecast_tracks
from drift.planning.search.products import files as plan_files
from drift.products.files import formats, writer
from drift.products.files.chapter import OutputBundle
from drift.products.maps import page
from geo.errors import UserError

RUNS = ["=1+1", "+1+1", "-cmd|' /C calc'!A0", "@SUM(A1)", "\t=1", "\r=1", "  =1", "＝1", "=HYPERLINK(\"http://x\",\"y\")"]  # fmt: skip
SAFE = ["boat", "raft, alone", 'the "x"', "a=b", "1-2", "", "28-42.0N 087-30.0W", "it's", "ø☃"]


def cells(rows: list[list[object]]) -> list[list[str]]:
    return list(csv.reader(io.StringIO(formats.csv_text(["name"], rows))))[1:]


@pytest.mark.parametrize("text", RUNS)
def test_a_text_that_a_spreadsheet_would_run_has_an_apostrophe(text: str) -> None:
    """OWASP, CSV injection: cells that begin with = + - @, a tab or a carriage return."""
    ((cell,),) = cells([[text]])
    assert cell[0] == "'"
    assert cell[1:].strip() == text.strip()
    heading = formats.csv_text([text], []).splitlines()
    assert heading[0].lstrip('"').startswith("'")


@pytest.mark.parametrize("text", SAFE)
def test_other_texts_stay_as_they_are(text: str) -> None:
    assert cells([[text, "x"]]) == [[text, "x"]]


def test_values_are_written_by_one_rule() -> None:
    """Digits for numbers, empty cells for what is unknown, ISO 8601, yes and no; then the run_id."""
    times = [np.datetime64("2026-11-21T18:30:00"), np.datetime64("NaT", "s")]
    row = [3, 2 / 3, np.float32(0.25), np.nan, np.inf, None, True, np.bool_(False), *times, "x"]
    names = [f"c{k}" for k in range(len(row))]
    head, cells = csv.reader(
        io.StringIO(formats.csv_text(names, [row], run="abc-s1", digits=".3g"))
    )
    assert head == [*names, "run_id"]
    day = "2026-11-21T18:30:00Z"
    assert cells == ["3", "0.667", "0.25", "", "", "", "yes", "no", day, "", "x", "abc-s1"]
    assert formats.csv_text(["c"], [[np.inf]]) == "c\ninf\n"


@given(
    st.floats(allow_nan=False, allow_infinity=False, allow_subnormal=False) | st.integers(),
    st.sampled_from(["", ".6f", ".8g", "+.3e"]),
)
def test_numbers_stay_numbers(value: float, form: str) -> None:
    """As numbers or as texts made of them, negative ones too. (Taichi has subnormal numbers flushed
    to zero.)
    """
    told = format(value, form) if form else repr(value)
    ((number, text),) = cells([[value, told]])
    assert float(number) == float(value)
    assert text == told


@given(
    st.lists(st.lists(st.text(st.characters(exclude_categories=["Cs"])), min_size=1), min_size=1)
)
def test_a_cell_is_one_line_and_none_runs(rows: list[list[str]]) -> None:
    text = formats.csv_text(["name"], rows)  # type: ignore[arg-type]
    assert len(text.split("\n")) == len(rows) + 2
    for row in csv.reader(io.StringIO(text)):
        for cell in row:
            assert not cell.startswith(("=", "@", "\t", "\r"))
            assert not cell.startswith(("+", "-")) or float(cell) == float(cell)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('name = "boat"', 'name = "all"'),
        ('name = "boat"', 'name = "ALL"'),
        ('name = "boat"', 'name = " All "'),
    ],
)
def test_a_scenario_is_not_called_all(old: str, new: str, tmp_path: Path) -> None:
    """The table of sorties has a row "all" beside those of the scenarios; spreadsheets find it
    whatever its case.
    """
    (tmp_path / "trial.toml").write_text(small_case.STEADY.replace(old, new))
    with pytest.raises(UserError, match=r"all scenarios together"):
        case_file.load(tmp_path / "trial.toml")


def test_flags_are_words_and_each_another(tmp_path: Path) -> None:
    """CF 1.11, 3.5: flag_meanings is a list of words of letters, digits and _-.+@, separated by
    blanks.
    """
    names = ["raft alone", "raft_alone", "raft  alone", "raft_alone_2", "a,b", "a;b", "x-1.5+@"]
    found = forecast_tracks._flags(names)
    assert len(set(found)) == len(found) == len(names) == len(" ".join(found).split())
    assert found[0] == "raft_alone"
    assert found[-1] == "x-1.5+@"
    assert all(letter.isalnum() or letter in "_-.+@" for word in found for letter in word)


HARD = 'A & B <b onclick="x">"\'</b> ]]> \x07\x7f $\\foo$'


def test_hard_names_in_gpx_kml_and_geojson() -> None:
    """XML's and HTML's own letters come back as they were given; what XML cannot hold is left out."""
    plan = searches.plan(179.9, -61.0, rounds=1)
    first = plan.taskings[0]
    hard = replace(
        plan, taskings=(replace(first, unit=replace(first.unit, name=HARD)), *plan.taskings[1:])
    )
    shown = HARD.replace("\x07", "")
    for made in (plan_files.gpx(hard, HARD, "run"), plan_files.kml(hard, HARD, "run")):
        texts = [element.text or "" for element in ET.fromstring(made).iter()]
        assert shown in texts
        assert f"A-1 {shown}" in texts
    kml = ET.fromstring(plan_files.kml(hard, HARD, "run"))
    told = next(
        e.text for e in kml.iter() if e.tag.endswith("description") and "onclick" in (e.text or "")
    )

    class Reader(HTMLParser):
        """What a viewer of KML makes of a description."""

        tags = 0
        text = ""

        def handle_starttag(self, tag: str, attrs: object) -> None:
            self.tags += 1

        def handle_data(self, data: str) -> None:
            self.text += data

    reader = Reader()
    reader.feed(told or "")
    reader.close()
    assert reader.tags == 0
    assert reader.text.startswith(shown)
    shapes = json.dumps(formats.plain(plan_files.geojson(hard, {"title": HARD})))
    assert json.loads(shapes)["title"] == HARD
    assert shapes.isascii()


def test_a_dollar_in_a_name_is_no_formula(tmp_path: Path) -> None:
    """Matplotlib refuses the formula "$\\foo$", and the picture was lost."""

    def draw(path: Path) -> None:
        figure, canvas = page.figure(1, 1)
        figure.text(0.1, 0.1, HARD.replace("\x07", ""))
        page.save(canvas, path, HARD, None, 20)

    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Glyph")
        page.warn_on_failure(draw)(tmp_path / "map.png")
    assert (tmp_path / "map.png").stat().st_size > 100


def test_titles_in_netcdf_and_json_come_back(tmp_path: Path) -> None:
    attributes = {"title": '=1+1 "a" <b> & ø☃', "seed": "7"}
    files = {"x.nc": lambda stamped: xr.Dataset({"a": ("n", np.arange(3), {"long_name": "a"})})}
    writer.write(tmp_path / "out", [OutputBundle(files=files, facts=attributes)])
    with xr.open_dataset(tmp_path / "out" / "x.nc") as back:
        assert back.attrs["title"] == attributes["title"]
    assert (
        json.loads((tmp_path / "out" / "summary.json").read_text())["title"] == attributes["title"]
    )


@pytest.mark.parametrize(
    ("names", "wrong"), [(("drum", "se"), "se"), (("drum", "drum_se"), "drum_se")]
)
def test_no_class_takes_the_heading_of_another_column(names: tuple[str, str], wrong: str) -> None:
    """washup.csv has expected, expected_se, and expected_NAME, expected_NAME_se of each class: one
    overwrote the other.
    """
    table = {"objects": 10, "position": {"at": "27 30N 088 00W", "std": "1 nmi"}}
    kinds = [{"name": name, "share": 0.5, "object": "PIW-1"} for name in names]
    with pytest.raises(ValueError, match=f'class "{wrong}": this name is that of a standard error'):
        spill.SpillTable.model_validate({**table, "class": kinds})
    kinds[1]["name"] = "case"
    assert len(spill.SpillTable.model_validate({**table, "class": kinds}).kinds) == 2
