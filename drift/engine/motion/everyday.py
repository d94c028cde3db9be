"""Everyday words for what is adrift, and what of the sweep width tables goes with a leeway class.

Works from the project's own tables, data/everyday_words.csv and data/search_objects.csv.
"""

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from functools import lru_cache
from importlib import resources


@dataclass(frozen=True)
class Meaning:
    """The leeway classes that everyday words stand for; note: why, where none is exactly that."""

    classes: frozenset[str]
    note: str


@dataclass(frozen=True)
class SearchObjects:
    """Objects of the sweep width tables; by: what tells which, "" where there is one."""

    names: tuple[str, ...]
    by: str

    @property
    def words(self) -> str:
        """The objects in a few words."""
        if len(self.names) == 1:
            return self.names[0]
        return f"{self.names[0]} to {self.names[-1]}, by {self.by}"


@lru_cache(maxsize=1)
def _meanings() -> dict[str, tuple[str, str]]:
    """Return the patterns of classes, and the note, by word or phrase."""
    return {
        words: (row["classes"], row["note"])
        for row in _rows("everyday_words.csv")
        for words in row["words"].split("|")
    }


def everyday_words() -> tuple[str, ...]:
    """Return all words and phrases that stand for classes."""
    return tuple(_meanings())


def parts(text: str) -> list[str]:
    """Return the words of a text, in lower case; those that together are a phrase of the table as
    one.
    """
    single, found = text.lower().split(), list[str]()
    while single:
        size = next((k for k in (3, 2) if _known(" ".join(single[:k]))), 1)
        found.append(" ".join(single[:size]))
        single = single[size:]
    return found


def meaning(word: str, classes: Sequence[str]) -> Meaning | None:
    """Return what a word or phrase, singular or plural, stands for among some classes;

    None for nothing.
    """
    key = _known(word)
    if key is None:
        return None
    patterns, note = _meanings()[key]
    return Meaning(frozenset(_matching(patterns, classes)), note)


def search_objects_of(text: str, classes: Sequence[str]) -> tuple[str, ...] | None:
    """Return what of the sweep width tables goes with a word or phrase, () for nothing;

    None where it is no such word.
    """
    meant = meaning(" ".join(text.lower().split()), classes)
    if meant is None:
        return None
    found = (search_objects(name) for name in classes if name in meant.classes)
    return tuple(dict.fromkeys(name for one in found if one for name in one.names))


def search_objects(name: str) -> SearchObjects | None:
    """Return what of the sweep width tables goes with a class;

    None where nothing of its size is in them.
    """
    for row in _rows("search_objects.csv"):
        if _matching(row["classes"], (name,)):
            return SearchObjects(tuple(row["objects"].split("|")), row["by"])
    return None


def _known(word: str) -> str | None:
    spelled = (word, word.replace("-", " "), word.replace("-", ""))
    return next(
        (key for one in spelled for key in (one, one.removesuffix("s")) if key in _meanings()), None
    )


def _matching(patterns: str, classes: Sequence[str]) -> list[str]:
    """Return the classes that any of some patterns fit, which are set apart by blanks."""
    return [
        name for name in classes if any(fnmatchcase(name, pattern) for pattern in patterns.split())
    ]


@lru_cache(maxsize=2)
def _rows(name: str) -> list[dict[str, str]]:
    text = resources.files("drift.data").joinpath(name).read_text(encoding="utf-8")
    return list(csv.DictReader(line for line in text.splitlines() if not line.startswith("#")))
