"""Results of every kind, small, which all tests of conformance read."""

from pathlib import Path

import finished
import numpy as np
import plans
import pytest
import spills

import drift
from drift.planning.search import optimiser

FIND = '[[find]]\nat = [-0.1, 0.03]\ntime = "+20 h"\nat_sea = true\nradius = "20 km"\n'
TRACK = [(0.0, 0.0), (0.02, 0.01), (0.05, 0.01), (0.07, 0.03)]


@pytest.fixture(scope="session")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with those of a plan (plan), a spill, its origin, a verification, and exports of
    plan and spill by format.
    """
    folder = tmp_path_factory.mktemp("written")
    with pytest.MonkeyPatch.context() as patch:
        for name, number in plans.FEW_TRIALS.items():
            patch.setattr(optimiser, name, number)
        finished.plan(folder).rename(folder / "plan")
    spill = spills.case_of(folder, duration="1 d", objects=20, worlds=60, per_world=30)
    drift.run(spill, folder / "spill")
    (folder / "found.toml").write_text((folder / "case.toml").read_text() + FIND)
    drift.origin(drift.load(folder / "found.toml"), folder / "origin")
    start = np.datetime64("2026-06-01T20:00", "s")
    rows = [
        f"b,{start + np.timedelta64(8 * k, 'h')}Z,{179.9 + x},{-41 + y}"
        for k, (x, y) in enumerate(TRACK)
    ]
    (folder / "buoys.csv").write_text("\n".join(["id,time,lon,lat", *rows]))
    (folder / "water.toml").write_text(
        finished.CASE[: finished.CASE.index('[[scenario]]\nname = "drift')]
    )
    water = drift.load(folder / "water.toml")
    drift.verify(water, folder / "buoys.csv", folder / "verify", particles=500, gap=9 * 3600.0)
    for name in ("kml", "gpx"):
        drift.export(folder / "plan", name, folder / name)
        drift.export(folder / "spill", name, folder / f"spill-{name}")
    return folder
