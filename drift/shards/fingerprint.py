"""The fingerprint of a run: all that its results follow from, so that nothing of another run is taken for its own."""

import dataclasses
import hashlib
from pathlib import PurePath
from typing import Any

import numpy as np

from drift import facts
from drift.case.record import Case
from drift.job import Job
from drift.shards import machine, work
from geo.files import digest

NAMES = ("path", "inputs")  # of a case: where its files lie, which changes no result


def of(job: Job, many: int) -> dict[str, str]:
    """Return what the results of a run in so many shards follow from, by what it is."""
    told = facts.attributes(job.case, job.where)
    files = hashlib.sha256("".join(digest.of(path) for path in job.case.inputs).encode()).hexdigest()
    return {
        "the case": of_case(job.case),
        "the seed": told["seed"],
        "the versions": ", ".join(f"{name} {version}" for name, version in machine.versions().items()),
        "the backend": told["backend"],
        "the forcing": f"{told['forcing']}; {files}",
        "the coast": told["coast"],
        "the processor's arithmetic": machine.arithmetic(),
        work.NUMBER: str(many),
    }


def of_case(case: Case) -> str:
    """Return the digest of all that a case says, however it was made: by a file, by a plan, in Python."""
    said = {field.name: getattr(case, field.name) for field in dataclasses.fields(case) if field.name not in NAMES}
    return hashlib.sha256(_words(said).encode()).hexdigest()


def _words(value: Any) -> str:
    """Return a value in words that say all of it, to the last bit."""
    if dataclasses.is_dataclass(value):
        return f"{type(value).__name__}{_words({f.name: getattr(value, f.name) for f in dataclasses.fields(value)})}"
    if isinstance(value, dict):
        return "{" + ",".join(f"{key}:{_words(part)}" for key, part in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ",".join(_words(part) for part in value) + "]"
    if isinstance(value, np.ndarray):
        return f"{value.dtype.str}{value.shape}{value.tobytes().hex()}"
    if isinstance(value, float | np.floating):
        return float(value).hex()
    return value.name if isinstance(value, PurePath) else repr(value)
