"""Every example of the documentation: how-to pages and that of bridges are run, all are held
against grammar, schema and names.

Tutorials are run when the site is built, for the pictures that they show: test_site.py.
"""

import ast
import re
import tomllib
from pathlib import Path
from typing import Annotated, Any, get_origin

import pytest
from generate import examples, keys
from places import ROOT
from pydantic import BaseModel, ConfigDict, create_model

import drift
from drift.apps.cli import grammar
from drift.apps.fetch import catalogue
from drift.case import schema
from drift.case.scenario import catalogue as object_catalogue
from drift.case.scenario import itinerary, network
from drift.case.tracking import bridge, tracking
from geo.errors import UserError

pytestmark = [pytest.mark.documentation, pytest.mark.timeout(1800)]

DOCS = ROOT / "docs"
HOWTO = sorted((DOCS / "howto").glob("*.md"))
RUN = [*HOWTO, DOCS / "bridges.md", DOCS / "tracking.md"]
PAGES = sorted(
    [
        ROOT / "README.md",
        ROOT / "CONTRIBUTING.md",
        *DOCS.glob("*.md"),
        *(DOCS / "tutorials").glob("*.md"),
        *HOWTO,
    ]
)
FILES: tuple[type[BaseModel], ...] = (
    schema.CaseTable,
    network.NetworkTable,
    bridge.BridgeTable,
    tracking.TrackingTable,
    object_catalogue.CatalogueTable,
)


def name(page: Path) -> str:
    return str(page.relative_to(ROOT))


@pytest.mark.parametrize("page", RUN, ids=name)
def test_examples_are_run(
    page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    """In order, in a folder of their own; what they are shown to print is what they print."""
    monkeypatch.chdir(tmp_path)
    count = examples.perform(page, {"__name__": "__main__"})
    with capsys.disabled():
        print(f"\n{name(page)}: {count} examples run")


def commands(page: Path) -> list[examples.Command]:
    found = [
        one
        for block in examples.blocks(page)
        if block.kind in ("console", "sh", "")
        for one in examples.listed(block)
    ]
    return [one for one in found if re.match(r"drift \S", one.text)]


@pytest.mark.parametrize("page", [page for page in PAGES if commands(page)], ids=name)
def test_commands_are_of_the_grammar(page: Path) -> None:
    for command in commands(page):
        given = grammar.parser().parse_args(
            [word for word in command.words[1:] if word not in ("|", "head")]
        )
        assert given.command or given.version or given.print_completion, command.text


def tables(page: Path) -> list[examples.Block]:
    return [block for block in examples.blocks(page) if block.kind == "toml"]


@pytest.mark.parametrize("page", [page for page in PAGES if tables(page)], ids=name)
def test_tables_are_understood(page: Path) -> None:
    """Each key of a block is one of a case, of a network, of a bridge or of a tracking case, and
    what it holds is taken there.
    """
    for block in tables(page):
        parsed: dict[str, Any] = itinerary.insert_shared_tables(tomllib.loads(block.text))
        known = any(understood(parsed, model) for model in FILES) or is_catalogue(block.text)
        assert known, f"{name(page)}, line {block.line}"


def is_catalogue(text: str) -> bool:
    """Return whether a block is one of providers, as `drift fetch --catalogue` takes it."""
    try:
        return bool(catalogue._parse_catalogue(text, "page"))
    except UserError:
        return False


def understood(parsed: dict[str, Any], model: type[BaseModel]) -> bool:
    """Return whether a piece of a file is one of a model's: its keys are, and values that are no
    tables are taken.
    """
    fields = {field.alias or key: field for key, field in model.model_fields.items()}
    return parsed.keys() <= fields.keys() and all(
        taken(fields[key], value) for key, value in parsed.items()
    )


def taken(field: Any, value: Any) -> bool:
    given = value if isinstance(value, list) else [value]
    models = keys.inner(field.annotation)
    if models and get_origin(field.annotation) is dict:  # tables by name
        given = list(value.values())
    if models and all(isinstance(one, dict) for one in given):
        return all(any(understood(one, model) for model in models) for one in given)
    kind: Any = field.annotation
    for one in field.metadata:
        kind = Annotated[kind, one]
    create_model("One", value=(kind, ...), __config__=ConfigDict(arbitrary_types_allowed=True))(
        value=value
    )
    return True


def scripts(page: Path) -> list[examples.Block]:
    return [block for block in examples.blocks(page) if block.kind == "python"]


@pytest.mark.parametrize("page", [page for page in PAGES if scripts(page)], ids=name)
def test_python_names_what_is_there(page: Path) -> None:
    """Every block is Python, and takes from drift what drift has."""
    for block in scripts(page):
        for node in ast.walk(ast.parse(block.text)):
            if (
                isinstance(node, ast.Attribute)
                and isinstance(node.value, ast.Name)
                and node.value.id == "drift"
            ):
                assert node.attr in {*drift.__all__, "flow", "bridges", "case"}, (
                    f"{name(page)}, line {block.line}: drift.{node.attr}"
                )
