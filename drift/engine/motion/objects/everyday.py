"""Everyday words for search objects, and the sweep width objects that match a leeway class.

It uses the project's tables data/everyday_words.csv and data/search_objects.csv.
"""

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from functools import lru_cache
from importlib import resources


@dataclass(frozen=True)
class Meaning:
    """The leeway classes that an everyday word covers; note: why, if no class matches exactly."""

    classes: frozenset[str]
    note: str


@dataclass(frozen=True)
class SearchObjects:
    """Objects of the sweep width tables; by: the property that selects among them, "" if there is
    one.
    """

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
    """Return the class patterns and the note of each everyday word or phrase."""
    return {
        words: (row["classes"], row["note"])
        for row in _rows("everyday_words.csv")
        for words in row["words"].split("|")
    }


def everyday_words() -> tuple[str, ...]:
    """Return all everyday words and phrases of the table."""
    return tuple(_meanings())


def split_words(text: str) -> list[str]:
    """Return the words of a text in lower case; a phrase of the table counts as one word."""
    single, found = text.lower().split(), list[str]()
    while single:
        size = next((k for k in (3, 2) if _word_in_table(" ".join(single[:k]))), 1)
        found.append(" ".join(single[:size]))
        single = single[size:]
    return found


def classes_of_word(word: str, classes: Sequence[str]) -> Meaning | None:
    """Return the classes that a word or phrase (singular or plural) covers; None if it is not in
    the table.
    """
    key = _word_in_table(word)
    if key is None:
        return None
    patterns, note = _meanings()[key]
    return Meaning(frozenset(_matching(patterns, classes)), note)


def search_objects_of(text: str, classes: Sequence[str]) -> tuple[str, ...] | None:
    """Return the sweep width objects for a word or phrase, () if none match; None for an unknown
    word.
    """
    meant = classes_of_word(" ".join(text.lower().split()), classes)
    if meant is None:
        return None
    found = (search_objects(name) for name in classes if name in meant.classes)
    return tuple(dict.fromkeys(name for one in found if one for name in one.names))


def search_objects(name: str) -> SearchObjects | None:
    """Return the sweep width objects for a leeway class; None if the tables have nothing of its
    size.
    """
    for row in _rows("search_objects.csv"):
        if _matching(row["classes"], (name,)):
            return SearchObjects(tuple(row["objects"].split("|")), row["by"])
    return None


def _word_in_table(word: str) -> str | None:
    spelled = (word, word.replace("-", " "), word.replace("-", ""))
    return next(
        (key for one in spelled for key in (one, one.removesuffix("s")) if key in _meanings()), None
    )


def _matching(patterns: str, classes: Sequence[str]) -> list[str]:
    """Return the classes that match any of several patterns separated by blanks."""
    return [
        name for name in classes if any(fnmatchcase(name, pattern) for pattern in patterns.split())
    ]


@lru_cache(maxsize=2)
def _rows(name: str) -> list[dict[str, str]]:
    text = resources.files("drift.data").joinpath(name).read_text(encoding="utf-8")
    return list(csv.DictReader(line for line in text.splitlines() if not line.startswith("#")))
