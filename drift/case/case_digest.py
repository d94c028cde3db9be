"""The digest of all that a case says, however it was made: by a file, by a plan, in Python."""

import dataclasses
import hashlib
from pathlib import PurePath
from typing import Any

import numpy as np

from drift.case.record import Case

# where its files lie changes no result; tables are what the rest was made of
NAMES = ("path", "inputs", "tables")
# What stands in results, or is made of particles that have been moved.
MADE_AFTER = ("title", "text", "about", "areas", "grid", "trajectories", "opens", "expect")


def digest(case: Case, *, moves: bool = False) -> str:
    """Return the digest of all that a case says; its files count by their names, wherever they lie.

    moves: of what decides on how particles move and weigh, and of nothing that is made of them
    afterwards.
    """
    left_out = NAMES + MADE_AFTER if moves else NAMES
    all_of_it = {
        field.name: getattr(case, field.name)
        for field in dataclasses.fields(case)
        if field.name not in left_out
    }
    return hashlib.sha256(_words(all_of_it, frozenset(case.inputs), {}).encode()).hexdigest()


def _words(value: Any, paths: frozenset[str], known: dict[int, str]) -> str:
    """Return a value in words that say all of it, to the last bit.

    known: those of records, by their ids, which are gone through once however many share them.
    """
    if dataclasses.is_dataclass(value):
        if id(value) not in known:
            fields = {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}
            known[id(value)] = f"{type(value).__name__}{_words(fields, paths, known)}"
        return known[id(value)]
    if isinstance(value, dict):
        return (
            "{"
            + ",".join(f"{key}:{_words(part, paths, known)}" for key, part in value.items())
            + "}"
        )
    if isinstance(value, list | tuple):
        return "[" + ",".join(_words(part, paths, known) for part in value) + "]"
    if isinstance(value, np.ndarray):
        return f"{value.dtype.str}{value.shape}{value.tobytes().hex()}"
    if isinstance(value, float | np.floating):
        return float(value).hex()
    if isinstance(value, PurePath) or (isinstance(value, str) and value in paths):
        return PurePath(value).name
    return repr(value)
