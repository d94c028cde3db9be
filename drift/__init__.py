"""Forecasts and search plans for objects adrift at sea.

    import drift
    case = drift.load("case.toml")      # or the name of a shipped case
    case = drift.vary(case, {"seed": 2})
    result = drift.run(case, out="out") # without out nothing is written
    result.probability                  # xarray.DataArray (time, lat, lon)
    result.washup                       # of a spill: xarray.Dataset by stretch of coast and time

| function | what |
|---|---|
| `load`, `vary`, `check` | read a case, change its keys, report how drift interprets it |
| `run`, `run_many`, `progress` | make one forecast, make many, show a progress bar |
| `plan`, `patrol` | plan the next search by units, plan patrols of a coast |
| `place`, `allocate` | place towed arrays, allocate beams to processors |
| `origin` | backtrack a spill from its finds to its release |
| `compare` | compare two cases on common random numbers: differences with standard errors |
| `budget` | divide the area of a forecast among its sources of spread |
| `verify`, `fit_errors` | verify forecasts with real drifters, fit the error model to them |
| `score` | score past cases by where the objects were found |
| `sensor_reach` | map where a sensor of a case would detect a target |
| `track`, `experiment` | reacquire a lost contact, run an experiment of many runs |
| `fetch`, `results`, `export` | download forcing, list results, convert them |
| `serve` | open the browser app |
"""

import lazy_loader as _lazy

from geo.errors import UserError

# The module of each public name. A name is imported at its first use (Scientific Python's SPEC 1),
# so that `drift --help` does not wait for Taichi. Type checkers read __init__.pyi.
_HOMES = {
    "planning.arrays.planner": ["place"],
    "planning.arrays.processing_plan": ["allocate"],
    "case.file": ["load", "vary"],
    "case.record": ["Case"],
    "apps.cli.progress": ["progress"],
    "assess.compare.contrast": ["compare"],
    "assess.budget.command": ["budget"],
    "apps.serve.server": ["serve"],
    "assess.verify.fitting": ["fit_errors"],
    "assess.verify.verification": ["verify"],
    "assess.score.command": ["score"],
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
