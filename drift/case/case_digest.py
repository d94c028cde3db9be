"""The digest of a case's contents, whether it was made from a file, by a plan or in Python."""

import dataclasses
import hashlib
from pathlib import PurePath
from typing import Any

import numpy as np

from drift.case.record import Case

# the location of files does not affect results; `tables` is the source of the other fields
NAMES = ("path", "inputs", "tables")
# Fields that only affect products made after the particles have been moved.
MADE_AFTER = ("title", "text", "about", "areas", "grid", "trajectories", "opens", "expect")


def digest(case: Case, *, moves: bool = False) -> str:
    """Return the digest of a case's contents; files count by name, not by location.

    Args:
        case: the case.
        moves: whether only fields count that affect the motion and weights of particles.
    """
    left_out = NAMES + MADE_AFTER if moves else NAMES
    contents = {
        field.name: getattr(case, field.name)
        for field in dataclasses.fields(case)
        if field.name not in left_out
    }
    return hashlib.sha256(_exact_text(contents, frozenset(case.inputs), {}).encode()).hexdigest()


def _exact_text(value: Any, paths: frozenset[str], known: dict[int, str]) -> str:
    """Return a complete text form of a value, exact to the last bit.

    `known` caches the text of records by their ids, so that shared records are visited once.
    """
    if dataclasses.is_dataclass(value):
        if id(value) not in known:
            fields = {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}
            known[id(value)] = f"{type(value).__name__}{_exact_text(fields, paths, known)}"
        return known[id(value)]
    if isinstance(value, dict):
        return (
            "{"
            + ",".join(f"{key}:{_exact_text(part, paths, known)}" for key, part in value.items())
            + "}"
        )
    if isinstance(value, list | tuple):
        return "[" + ",".join(_exact_text(part, paths, known) for part in value) + "]"
    if isinstance(value, np.ndarray):
        return f"{value.dtype.str}{value.shape}{value.tobytes().hex()}"
    if isinstance(value, float | np.floating):
        return float(value).hex()
    if isinstance(value, PurePath) or (isinstance(value, str) and value in paths):
        return PurePath(value).name
    return repr(value)
