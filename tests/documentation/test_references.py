"""References tell all that there is, once: what nothing is said of fails the build."""

import re
from pathlib import Path

import pytest
from generate import commands, files, keys, objects
from places import ROOT

import drift
from drift.apps.cli import commands as cli
from drift.case.values import fields

pytestmark = pytest.mark.documentation

DOCS = ROOT / "docs"


class Silent(fields.Table):
    """A table with a key of which nothing is said."""

    strange: float = 0.0


def test_every_key_stands_there_once() -> None:
    anchors = re.findall(r"^`[^`]+`\{#([^}]+)\}", keys.page(DOCS), flags=re.MULTILINE)
    assert len(anchors) == len(set(anchors)) == keys.count()


def test_a_key_of_which_nothing_is_said_is_refused() -> None:
    with pytest.raises(LookupError, match=r"Silent\.strange: neither a string below it nor a page"):
        keys.rows(Silent, DOCS)


def test_a_column_of_which_nothing_is_said_is_refused(tmp_path: Path) -> None:
    """And one that is described and not there."""
    said = files.told()["columns"]
    table = tmp_path / "track.csv"
    table.write_text("time,strange\n", encoding="utf-8")
    with pytest.raises(LookupError, match="column strange is not described"):
        files.columns(table, said)
    table.write_text("time,run_id\n", encoding="utf-8")
    with pytest.raises(LookupError, match="has no column"):
        files.columns(table, said)


def test_every_command_and_name_stands_there() -> None:
    page = commands.page()
    assert re.findall(r"^## `drift ([\w-]+)`", page, flags=re.MULTILINE) == list(
        commands.subcommands(commands.grammar.parser())
    )
    assert set(cli.COMMANDS) == set(commands.subcommands(commands.grammar.parser()))
    page = objects.page()
    for name in drift.__all__:
        assert name.startswith("__") or re.search(rf"\}} drift\.{name}\b", page), name
