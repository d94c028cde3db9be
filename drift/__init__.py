"""drift: forecasts and search plans for things adrift at sea.

import drift
case = drift.load("case.toml")      # or the name of a shipped case
result = drift.run(case)            # or drift.run(case, out=Path("results"))
drift.run(case, datasets={"roms": data})  # xarray.Datasets for the sources with dataset = "roms"
result.probability                  # xarray.DataArray (time, lat, lon)
cases = [drift.vary(case, {"seed": k}) for k in range(100)]
for one in drift.run_many(cases): ...  # many forecasts, forcing and coast opened once: see drift.many
result.washup                       # of a spill: xarray.Dataset by stretch of coast and time
drift.results("results")            # paths of a finished run's files, once all are as it wrote them
drift.verify(case, "drifters.csv", out="results")  # forecasts of real drifters, and how they went: see drift.drifters.verification
drift.fit_errors(case, "drifters.csv")  # the errors of a case that suit drifters: see drift.drifters.fitting
drift.trace(case)                   # of a spill: where it may have come from, backward from its finds
"""

from importlib import import_module
from typing import Any

# Public names and where they live; found on first use, so that `drift --help` does not wait for Taichi.
_HOMES = {
    "Brief": "drift.many",
    "Case": "drift.case.record",
    "Result": "drift.flow",
    "UserError": "geo.errors",
    "fit_errors": "drift.drifters.fitting",
    "load": "drift.case.file",
    "results": "drift.output.publication",
    "run": "drift.flow",
    "run_many": "drift.many",
    "trace": "drift.flow",
    "vary": "drift.case.file",
    "verify": "drift.drifters.verification",
}
__all__ = [
    "Brief",
    "Case",
    "Result",
    "UserError",
    "fit_errors",
    "load",
    "results",
    "run",
    "run_many",
    "trace",
    "vary",
    "verify",
]


def __dir__() -> list[str]:
    """Return the public names."""
    return __all__


def __getattr__(name: str) -> Any:
    """Return a public name."""
    if name not in _HOMES:
        raise AttributeError(f"module 'drift' has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)
