"""drift: forecasts and search plans for things adrift at sea.

import drift case = drift.load("case.toml")      # or the name of a shipped case result =
drift.run(case)            # or drift.run(case, out=Path("results")) drift.run(case,
datasets={"roms": data})  # xarray.Datasets for the sources with dataset = "roms" with
drift.progress(case) as report: drift.run(case, report=report)  # a bar on a terminal or in a
notebook result.probability                  # xarray.DataArray (time, lat, lon) cases =
[drift.vary(case, {"seed": k}) for k in range(100)] for one in drift.run_many(cases): ...  # many
forecasts, forcing and coast opened once result.washup                       # of a spill:
xarray.Dataset by stretch of coast and time drift.results("results")            # paths of a
finished run's files, once all are as it wrote them drift.export("results", "kml")      # the same
for other programs: kml, kmz, gpx, geotiff, rtz, gif drift.compare(case, drift.vary(case, {...}))  #
what-if on common random numbers: b less a, with standard errors drift.verify(case, "drifters.csv",
out="results")  # forecasts of real drifters, and how they went: see drift.verify
drift.fit_errors(case, "drifters.csv")  # the errors of a case that suit drifters: see
drift.fit_errors drift.fetch("my.toml", out="forcing")  # winds and currents for a case from
providers; see drift fetch --list drift.check(case)                   # how a case was understood,
nothing run plan, result = drift.plan(case)     # the next search by the case's units; of a spill:
drift.patrol; of towed arrays: drift.place plan, result = drift.allocate(case) # which beams of
arrays to process when, where processors are few drift.sensor_reach(case, "array", out="reach")  #
where a sensor of the case would hear or see a target drift.experiment("closing")         # many
runs of any case, in several ways, and how their figures scatter drift.track("lost_contact")
# a target followed by the detections there are: its track and areas drift.serve("cases")
# edit, run and read cases in the browser drift.origin(case)                  # of a spill: where it
may have come from, backward from its finds
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
