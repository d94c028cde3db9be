"""The reference of searches names every key that the tables have and no other, and examples in the documentation are TOML."""

import re
import sys
from typing import Any

import pytest
from places import ROOT
from pydantic import BaseModel

from drift.case import scenario
from drift.case.contact import BearingTable, ContactTable, PlaceTable, RangeTable
from drift.case.pattern import NEEDS, PatternTable, RegionTable
from drift.case.plan import PlanTable, ResamplingTable, UnitTable
from drift.case.sensor import ConditionsTable, SensorTable
from drift.case.sortie import MarkerTable, SortieTable, WatchTable

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

DOCS = ROOT / "docs"
PAGES = ("search.md", "search_keys.md")
HEADINGS: dict[str, type[BaseModel]] = {  # sections of search_keys.md, "chapter / section", and what they describe
    "[[sortie]]": SortieTable,
    "[[sortie]] / area": RegionTable,
    "[[sortie]] / pattern": PatternTable,
    "[[sortie]] / watch": WatchTable,
    "[[sortie]] / marker": MarkerTable,
    "How it sees": SensorTable,
    "How it sees / sweep_width": ConditionsTable,
    "[[contact]]": ContactTable,
    "[[contact]] / position": PlaceTable,
    "[[contact]] / bearing": BearingTable,
    "[[contact]] / range": RangeTable,
    "[[unit]]": UnitTable,
    "[plan]": PlanTable,
    "[resampling]": ResamplingTable,
}
CHECKED: dict[str, type[BaseModel]] = {
    "sortie": SortieTable, "contact": ContactTable, "unit": UnitTable, "plan": PlanTable, "resampling": ResamplingTable
}  # fmt: skip


def sections() -> dict[str, str]:
    """Return the text of search_keys.md by "chapter / section"."""
    found, chapter = {}, ""
    for part in re.split(r"^(?=##)", (DOCS / "search_keys.md").read_text(encoding="utf-8"), flags=re.MULTILINE)[1:]:
        heading, _, text = part.partition("\n")
        title = heading.lstrip("# ").replace("`", "")
        chapter = title if heading.startswith("## ") else chapter
        found[title if title == chapter else f"{chapter} / {title}"] = text
    return found


def rows(text: str, head: str) -> dict[str, list[str]]:
    """Return the rows of the table under a first heading by each name that stands in backticks in their first cell."""
    table = re.search(rf"^\| {head} \|.*\n\|[-|]+\n((?:\|.*\n)*)", text, flags=re.MULTILINE)
    assert table, f"no table headed {head}"
    cells = [[cell.strip() for cell in line.strip("|").split(" | ")] for line in table[1].splitlines()]
    return {name: row for row in cells for name in re.findall(r"`([^`]+)`", row[0])}


def keys(table: type[BaseModel]) -> set[str]:
    """Return the keys of a table as a case file writes them."""
    return {field.alias or name for name, field in table.model_fields.items()}


def blocks(page: str) -> list[str]:
    """Return the TOML blocks of a page."""
    return re.findall(r"^```toml\n(.*?)^```", (DOCS / page).read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)


@pytest.mark.parametrize("heading", HEADINGS)
def test_every_key_is_described(heading: str) -> None:
    """A row for each key of a table, and none for a key that it does not have."""
    expected = keys(HEADINGS[heading])
    if heading in ("[[sortie]]", "[[unit]]"):  # keys that they share stand in a chapter of their own
        expected -= keys(SensorTable)
    assert set(rows(sections()[heading], "key")) == expected


def test_keys_of_a_scenario() -> None:
    """Its chapter names the keys that searches add to it, and those of survival."""
    described = rows(sections()["[[scenario]]"], "key")
    assert set(described) == {"search_object", "survival"} <= keys(scenario.ScenarioTable)
    assert keys(scenario.SurvivalTable) <= set(re.findall(r"\w+", " ".join(described["survival"])))


def test_kinds_of_pattern() -> None:
    """The table of kinds says what each needs and may have."""
    described = rows(sections()["[[sortie]] / pattern"], "`kind`")
    found = {
        kind.strip('"'): tuple(tuple(re.findall(r"`([^`]+)`", cell)) for cell in row[1:])
        for kind, row in described.items()
    }
    assert found == NEEDS


@pytest.mark.parametrize("page", PAGES)
def test_examples_are_understood(page: str) -> None:
    """Every block is TOML, and its tables are accepted."""
    found = blocks(page)
    assert len(found) >= 3
    for block in found:
        parsed: dict[str, Any] = tomllib.loads(block)
        for name, table in CHECKED.items():
            given = parsed.get(name, [])
            for one in given if isinstance(given, list) else [given]:
                table.model_validate(one)
