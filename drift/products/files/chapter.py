"""Chapter: the output files, pictures, numbers and report items of one topic.

Each topic builds one; drift.pipeline.flow joins those of a run, and drift.products.files.writer
writes them. A topic keeps its files and its pictures in tables: the name of each, and the function
that makes it from the topic's data. A new file is a new row in such a table.
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

Stamped = Mapping[str, str]  # attributes of every file of a run, with its run_id
# content of a netCDF file, of a CSV or text file, of a JSON file
Contents = xr.Dataset | str | dict[str, Any]


@dataclass(frozen=True)
class OutputBundle:
    """The outputs of one topic of a run; files and pictures by name."""

    numbers: Mapping[str, Any] = field(default_factory=dict)  # for summary.json
    files: Mapping[str, Callable[[Stamped], Contents]] = field(default_factory=dict)
    # each draws into a path
    pictures: Mapping[str, Callable[[Path], None]] = field(default_factory=dict)
    # attributes to be added to every file of the run
    facts: Mapping[str, str] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()  # added to every file, as the attribute `warning`
    # Items of report.html; each returns records of drift.products.report.leaves.
    leaves: tuple[Callable[[], Sequence[Any]], ...] = ()
    # Files derived from the run's other files, written last; each writes to a path in their folder.
    digests: Mapping[str, Callable[[Path], None]] = field(default_factory=dict)


def bind_outputs(
    table: Mapping[str, Callable[Concatenate[T, P], R]], topic_data: T
) -> dict[str, Callable[P, R]]:
    """Return a table of files or pictures with the topic's data bound as their first argument."""
    return {name: partial(make, topic_data) for name, make in table.items()}


def join_contents(chapters: Iterable[OutputBundle]) -> OutputBundle:
    """Return one chapter with the outputs of several; later ones override equal names."""
    listed = list(chapters)
    return OutputBundle(
        numbers={name: value for chapter in listed for name, value in chapter.numbers.items()},
        files={name: make for chapter in listed for name, make in chapter.files.items()},
        pictures={name: draw for chapter in listed for name, draw in chapter.pictures.items()},
        digests={name: make for chapter in listed for name, make in chapter.digests.items()},
        leaves=tuple(leaf for chapter in listed for leaf in chapter.leaves),
        facts={name: value for chapter in listed for name, value in chapter.facts.items()},
        warnings=tuple(warning for chapter in listed for warning in chapter.warnings),
    )
