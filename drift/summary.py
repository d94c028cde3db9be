"""What a run says about itself besides its forecast: the summary's numbers, and what every file carries."""

from importlib import metadata
from typing import Any

from drift.case.record import Case
from drift.motion import forcing_error
from drift.motion.ensemble import Account
from drift.motion.environment import Environment
from drift.motion.status import Status
from drift.start import Start
from geo.files import digest
from kernels import runtime

PACKAGES = ("casp-drift", "taichi", "numpy", "xarray", "netCDF4", "roaring-landmask")


def attributes(case: Case, where: Environment) -> dict[str, str]:
    """Return what every file carries: the case, the seed, versions, and what the forcing was."""
    versions = ", ".join(f"{name} {metadata.version(name)}" for name in PACKAGES)
    return {
        "title": case.title,
        "source": versions.split(",")[0],
        "versions": versions,
        "seed": str(case.seed),
        "backend": runtime.backend(),
        "forcing": "; ".join(f"{s.quantity} {s.name}: {s.fingerprint}" for s in where.sources),
        "coast": where.coast.source if where.coast else "none",
        "uncertainty": errors(case),
        "case": case.text,
    }


def errors(case: Case) -> str:
    """Return which errors of current and wind a run has, in a line, and who says so."""
    wind = case.wind_error if case.winds else None
    return forcing_error.words(case.current_error, wind, case.diffusivity, case.diffusivity_by)


def behaviour(case: Case) -> str:
    """Return what the coast does, in words."""
    coast = case.coast
    if coast.source == "none":
        return "none: particles pass over land"
    if coast.behaviour == "slide":
        return "slide: what reaches the shore goes on along it"
    if coast.behaviour == "refloat":
        return (
            f"refloat: what strands is afloat again with a half-life of {coast.half_life / 3600:g} h, once its drift leads off "
            f"the beach, {coast.offing:g} m off it"
        )
    return "strand: what reaches the shore stays there for good"


def input_file(path: str) -> dict[str, Any]:
    """Return what an input file was: its path, size and digest, so that a damaged or exchanged one can be told."""
    try:
        return {"path": path, "bytes": digest.size(path), "digest": digest.of(path)}
    except OSError as error:
        return {"path": path, "bytes": None, "digest": f"none: {error.strerror or 'gone'} by the end of the run"}


def numbers(
    case: Case,
    where: Environment,
    account: Account,
    start: Start,
    seconds: dict[str, float],
) -> dict[str, Any]:
    """Return the numbers of a run that are not in its forecast."""
    by_status = account.by_status.sum(axis=0)
    return {
        "run": {
            "start": str(case.start),
            "end": str(case.end),
            "particles": case.particles,
            "seed": case.seed,
            "step_s": start.clock.step,
            "step_errors_m_per_day": {str(k): v for k, v in start.trial.errors.items()} if start.trial else None,
            "scheme": case.scheme,
            "coast_behaviour": behaviour(case),
            "backend": runtime.backend(),
        },
        "uncertainty": {
            "told": errors(case),
            **forcing_error.numbers(case.current_error, case.wind_error, case.diffusivity, case.diffusivity_by),
        },
        "effective_sample_size": account.ess,
        "account": {status.name.lower(): float(by_status[status]) for status in Status},
        "scenario_weights": {
            s.name: {"prior": s.weight, "posterior": float(w), "prior_on_land": dry}
            for s, w, dry in zip(case.scenarios, account.by_status.sum(axis=1), start.dry, strict=True)
        },
        "forcing": [
            {
                "quantity": s.quantity,
                "name": s.name,
                "missing_share": s.missing,
                "understood": list(s.notes),
                "fingerprint": s.fingerprint,
            }
            for s in where.sources
        ],
        "inputs": [input_file(path) for path in case.inputs],
        "coast": {"source": where.coast.source if where.coast else "none", "notes": list(where.notes)},
        "wall_time_s": seconds,
    }
