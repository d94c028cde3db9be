"""The fingerprint of a run: all that its results follow from, so that nothing of another run is taken for its own."""

import hashlib

from drift import facts
from drift.case import said
from drift.job import Job
from drift.shards import machine, work
from geo.files import digest


def of(job: Job, many: int) -> dict[str, str]:
    """Return what the results of a run in so many shards follow from, by what it is."""
    told = facts.attributes(job.case, job.where)
    files = hashlib.sha256("".join(digest.of(path) for path in job.case.inputs).encode()).hexdigest()
    return {
        "the case": said.digest(job.case),
        "the seed": told["seed"],
        "the versions": ", ".join(f"{name} {version}" for name, version in machine.versions().items()),
        "the backend": told["backend"],
        "the forcing": f"{told['forcing']}; {files}",
        "the coast": told["coast"],
        "the processor's arithmetic": machine.arithmetic(),
        work.NUMBER: str(many),
    }
