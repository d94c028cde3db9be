"""The fingerprint of a run: all that its results follow from, so that nothing of another run is
taken for its own.
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
    """Return what the results of a case's run in so many shards follow from, by what it is."""
    told = run_metadata.attributes(case, where)
    files = hashlib.sha256(
        "".join(digest.digest_of(path) for path in case.inputs).encode()
    ).hexdigest()
    return {
        **of_machine(),
        "the case": case_digest.digest(case, moves=True),
        "the seed": told["seed"],
        work.BACKEND: ": ".join(told[name] for name in ("backend", "device") if name in told),
        "the forcing": f"{told['forcing']}; {files}",
        "the coast": told["coast"],
        work.NUMBER: str(many),
    }


def of_machine() -> dict[str, str]:
    """Return what of it is the same for all runs on a machine."""
    return {
        "the versions": version.told(),
        "the processor's arithmetic": machine.arithmetic(),
    }
