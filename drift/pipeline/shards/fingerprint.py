"""The fingerprint of a run: all inputs that determine its results.

Stored shards are reused only if their run has the same fingerprint.
"""

import hashlib

from drift import version
from drift.case import case_digest
from drift.case.record import Case
from drift.engine.environment.environment import Environment
from drift.pipeline import run_metadata
from drift.pipeline.shards import machine, work
from geo.files import digest


def fingerprint_of(case: Case, where: Environment, many: int) -> dict[str, str]:
    """Return the fingerprint of a run in `many` shards: a value for each input, by its name."""
    attributes = run_metadata.file_attributes(case, where)
    files = hashlib.sha256(
        "".join(digest.digest_of(path) for path in case.inputs).encode()
    ).hexdigest()
    return {
        **of_machine(),
        "the case": case_digest.digest(case, moves=True),
        "the seed": attributes["seed"],
        work.BACKEND: ": ".join(
            attributes[name] for name in ("backend", "device") if name in attributes
        ),
        "the forcing": f"{attributes['forcing']}; {files}",
        "the coast": attributes["coast"],
        work.NUMBER: str(many),
    }


def of_machine() -> dict[str, str]:
    """Return the part of the fingerprint that depends on the machine: versions and arithmetic."""
    return {
        "the versions": version.told(),
        "the processor's arithmetic": machine.arithmetic(),
    }
