"""The words of our own dialect stand in no page, message or help: the field has a term for each.

What a reader sees is searched: pages, cases, templates, descriptions of files, the texts of the
report, and string literals of the program that are more than an identifier, with those below the
keys of a case, which the reference of keys shows. Names in backticks, such as `stories.png`, are
names and no prose.
"""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from places import ROOT

BANNED = {  # a pattern, and what to write instead
    r"anew": "again, new, resample, repopulate",
    r"(?<!dead )(?<!dead-)reckon(s|ed|ing)?": "compute, estimate",
    r"stor(y|ies)": "scenario",
    r"(no|some)body|whoever|who ever": "the particle, target or person, or the passive",
    r"houses?|rooms?|floors": "program, package, layer; space on a disk",
    r"alike": "uniform, equal, the same",
    r"lies? ashore|lying ashore": "stranded",
    r"particles? (that )?counts?|worlds? (that )?counts?|scenarios? that count": "effective particles, effective sample size",
    r"whom|who (follows|is followed|is sought|comes|has arrived|keeps|crosses)": "the particle, target, vessel or unit",
    r"what is believed": "posterior",
    r"laws|law of detection|fitted law": "detection function, distribution, model",
    r"told|tells?": "report, print, show, list",
    r"(?<!\")refus(es|ed|als?)": "reject, error",
}
OF_ARCHITECTURE = ("docs/architecture.md",)  # written elsewhere
PAGES = sorted(
    path
    for path in [ROOT / "README.md", *(ROOT / "docs").rglob("*.md")]
    if "generated" not in path.parts and str(path.relative_to(ROOT)) not in OF_ARCHITECTURE
)
TEXTS = sorted([*(ROOT / "cases").rglob("*.toml"), ROOT / "docs" / "generate" / "files.toml"])
SHOWN = sorted([*(ROOT / "drift").rglob("assets/*.html")])
SOURCES = sorted(
    path for package in ("drift", "geo", "kernels") for path in (ROOT / package).rglob("*.py")
)
WORD = re.compile(rf"\b({'|'.join(f'(?:{pattern})' for pattern in BANNED)})\b", flags=re.IGNORECASE)
IDENTIFIER = re.compile(r"[a-z0-9_./*-]*")


def found(text: str) -> list[str]:
    """Return each banned word of a text with what stands around it."""
    flat = re.sub(r"\s+", " ", text)
    return [flat[max(hit.start() - 60, 0) : hit.end() + 40] for hit in WORD.finditer(flat)]


def prose(page: str) -> str:
    """Return a page without names in backticks, names of files, and the targets of its links."""
    return re.sub(r"\]\([^)]*\)|\b[\w-]+\.(png|csv|toml)\b", "]", re.sub(r"`[^`\n]+`", "`", page))


def literals(source: str) -> Iterator[str]:
    """Yield the string literals of a program that a user may read: no docstring, no identifier, but
    the texts below keys.
    """
    tree = ast.parse(source)
    hidden = set()
    for node in ast.walk(tree):
        if (
            isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef)
            and ast.get_docstring(node, clean=False) is not None
        ):
            hidden.add(id(node.body[0].value))  # type: ignore[attr-defined]
    for node in ast.walk(tree):
        if not isinstance(node, ast.Constant) or id(node) in hidden:
            continue
        if isinstance(node.value, str) and not IDENTIFIER.fullmatch(node.value):
            yield prose(node.value)


@pytest.mark.parametrize(
    "text", ["Drawn anew.", "Hundreds of\nstories", "it reckons", "the particles that count"]
)
def test_banned_words_are_found(text: str) -> None:
    assert found(text)


@pytest.mark.parametrize(
    "text", ["by dead reckoning", "history", "`stories.png`", "[map](stories.md)", "a mushroom"]
)
def test_other_words_are_not(text: str) -> None:
    assert not found(prose(text))


@pytest.mark.parametrize("path", [*PAGES, *TEXTS], ids=lambda path: str(path.relative_to(ROOT)))
def test_no_page_has_banned_words(path: Path) -> None:
    assert found(prose(path.read_text(encoding="utf-8"))) == []


def test_no_page_of_the_program_has_banned_words() -> None:
    shown = {
        path.name: found(
            re.sub(
                r"<(script|style).*?</\1>|<[^>]*>",
                " ",
                path.read_text(encoding="utf-8"),
                flags=re.DOTALL,
            )
        )
        for path in SHOWN
    }
    assert {name: words for name, words in shown.items() if words} == {}


@pytest.mark.thorough
def test_no_message_has_banned_words() -> None:
    """In the strings of the program, --help among them."""
    read = {
        path: [word for text in literals(path.read_text(encoding="utf-8")) for word in found(text)]
        for path in SOURCES
    }
    assert {str(path.relative_to(ROOT)): words for path, words in read.items() if words} == {}
