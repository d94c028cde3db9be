"""drift: forecasts and search plans for objects adrift at sea.

    import drift
    case = drift.load("case.toml")      # or the name of a shipped case
    case = drift.vary(case, {"seed": 2})
    result = drift.run(case, out="out") # without out nothing is written
    result.probability                  # xarray.DataArray (time, lat, lon)
    result.washup                       # of a spill: xarray.Dataset by stretch of coast and time

| function | what |
|---|---|
| `load`, `vary`, `check` | read a case, change keys of it, report how it was understood |
| `run`, `run_many`, `progress` | a forecast, many forecasts that share their forcing, a progress bar |
| `plan`, `patrol`, `place`, `allocate` | the next search by units, patrols of a coast, towed arrays, beams |
| `origin` | where a spill may have come from, backward from its finds |
| `compare` | two cases on common random numbers: differences with standard errors |
| `verify`, `fit_errors` | forecasts of real drifters against their tracks, and errors that fit them |
| `sensor_reach` | where a sensor of a case would detect a target |
| `track`, `experiment` | a contact that was lost, followed; many runs, and how their figures scatter |
| `fetch`, `results`, `export`, `serve` | forcing from providers, files of a run, other formats, browser |
"""

import lazy_loader as _lazy

from geo.errors import UserError

# Where public names live. Each is imported at its first use (Scientific Python's SPEC 1), so that
# `drift --help` does not wait for Taichi; their types stand in __init__.pyi.
_HOMES = {
    "planning.arrays.planner": ["place"],
    "planning.arrays.processing_plan": ["allocate"],
    "case.file": ["load", "vary"],
    "case.record": ["Case"],
    "apps.cli.progress": ["progress"],
    "assess.compare.contrast": ["compare"],
    "apps.serve.server": ["serve"],
    "assess.verify.fitting": ["fit_errors"],
    "assess.verify.verification": ["verify"],
    "assess.experiment.command": ["experiment"],
    "apps.export.exporter": ["export"],
    "pipeline.flow": ["origin", "run", "trace"],
    "pipeline.many": ["Brief", "run_many"],
    "products.files.publication": ["results"],
    "planning.patrols.patrol": ["patrol"],
    "planning.search.planner": ["plan"],
    "apps.check.check": ["check"],
    "apps.fetch.fetching": ["fetch"],
    "apps.sensor.command": ["sensor_reach"],
    "apps.track.command": ["track"],
    "pipeline.result": ["Result"],
    "version": ["__version__"],
}
__getattr__, _, _names = _lazy.attach(__name__, submod_attrs=_HOMES)
__all__ = [*_names, "UserError"]


def __dir__() -> list[str]:
    """Return the public names."""
    return __all__
