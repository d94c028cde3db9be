"""A chapter: what a topic hands out.

Each room has one; drift.pipeline.flow joins those of a run, drift.products.files.writer writes
them.

A room keeps its files and its pictures as tables: the name of each, and the function that makes it
from what the topic has found. A new file is a new row.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, Concatenate, ParamSpec, TypeVar

import xarray as xr

T = TypeVar("T")
P = ParamSpec("P")
R = TypeVar("R")

Stamped = Mapping[str, str]  # attributes that every file of a run carries, its run_id among them
# of a netCDF file, of a table or a text, of a JSON file
Contents = xr.Dataset | str | dict[str, Any]


@dataclass(frozen=True)
class Chapter:
    """What a topic adds to the results of a run; files and pictures by their names."""

    numbers: Mapping[str, Any] = field(default_factory=dict)  # for summary.json
    files: Mapping[str, Callable[[Stamped], Contents]] = field(default_factory=dict)
    # each draws to a path
    pictures: Mapping[str, Callable[[Path], None]] = field(default_factory=dict)
    # attributes that every file of the run is to carry
    facts: Mapping[str, str] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()  # what every file is to warn of, under `warning`
    # What the room shows in report.html, each returning records of drift.products.report.leaves.
    leaves: tuple[Callable[[], Sequence[Any]], ...] = ()
    # What is made from the run's other files, last of all; each writes to a path in their folder.
    digests: Mapping[str, Callable[[Path], None]] = field(default_factory=dict)


def bound(
    table: Mapping[str, Callable[Concatenate[T, P], R]], matter: T
) -> dict[str, Callable[P, R]]:
    """Return the rows of a table of files or of pictures with what the topic has found as their
    first argument.
    """
    return {name: partial(make, matter) for name, make in table.items()}


def join_contents(chapters: Iterable[Chapter]) -> Chapter:
    """Return all that several chapters hand out; of one name the last counts, warnings add up."""
    every = list(chapters)
    return Chapter(
        numbers={name: value for chapter in every for name, value in chapter.numbers.items()},
        files={name: make for chapter in every for name, make in chapter.files.items()},
        pictures={name: draw for chapter in every for name, draw in chapter.pictures.items()},
        digests={name: make for chapter in every for name, make in chapter.digests.items()},
        leaves=tuple(leaf for chapter in every for leaf in chapter.leaves),
        facts={name: value for chapter in every for name, value in chapter.facts.items()},
        warnings=tuple(warning for chapter in every for warning in chapter.warnings),
    )
