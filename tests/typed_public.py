"""What mypy, which reads this file, must know of the public face: no name is Any. It is not run."""

from collections.abc import Iterator
from pathlib import Path
from typing import assert_type

import xarray as xr

import drift
from drift.apps.fetch.fetching import Fetched
from drift.assess.compare.record import Contrast
from drift.planning.search.records import Plan
from drift.spills.backtrack.backward import Origin

case = drift.load(Path("case.toml"))
assert_type(case, drift.Case)
assert_type(drift.vary(case, {"seed": 3}), drift.Case)
with drift.progress(case) as report:
    drift.run(case, report=report)
result = drift.run(case, out="results", datasets={"roms": xr.Dataset()})
assert_type(result, drift.Result)
assert_type(result.probability, xr.DataArray)
assert_type(result.washup, xr.Dataset | None)
assert_type(result.save("later"), drift.Result)
assert_type(drift.plan(case), tuple[Plan, drift.Result])
assert_type(drift.origin(case), Origin)
assert_type(drift.compare(case, case), Contrast)
assert_type(drift.check(case), dict[str, str])
assert_type(drift.run_many([case]), Iterator[drift.Brief])
assert_type(drift.results("results"), list[Path])
assert_type(drift.export("results", "kml"), list[Path])
assert_type(drift.fetch("my.toml", out="forcing"), Fetched)
assert_type(drift.__version__, str)
