"""What lies ashore: how much of a POS it is, and a sensor that does not see it, in closed form on a
straight coast.

A current, or a course, of 1 knot leads east to a shore. All begin anywhere within 20 nautical miles
of it, so that the share ashore is the time in hours over 20. A sortie of an hour, from the tenth
on, would find 40 % of what it sees all the while.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

import drift
from drift.case import file as case_file

pytestmark = pytest.mark.usefixtures("coarse_maps")  # no number is read off a map

N = 8_000
CASE = """
title = "onto the beach"
start = "2026-03-05T00:00Z"
duration = "12 h"
particles = {n}
uncertainty = "none"
coast = {{ source = "land.geojson" }}
clock = {{ step = {step} }}
[[current]]
constant = {{ speed = "1 kn", toward = 90 }}
[[scenario]]
name = "target"
area = {{ polygon = [[0.666667, -0.1], [0.999999, -0.1], [0.999999, 0.1], [0.666667, 0.1]] }}
{moves}
[[sortie]]
name = "all of it"
start = "+10 h"
end = "+11 h"
area = {{ centre = [0.9, 0.0], length = "90 nmi", width = "90 nmi" }}
pod = 0.4
ashore = {ashore}
"""
LAND = {"type": "Polygon", "coordinates": [[[1, -2], [2, -2], [2, 2], [1, 2], [1, -2]]]}
MOVES = {
    "adrift": 'object = "water"',
    "under way": 'vessel = { land = "stop" }\n[[scenario.phase]]\ncourse = { course = 90, speed = "1 kn" }',
}


def ran(folder: Path, **given: Any) -> drift.Result:
    (folder / "land.geojson").write_text(json.dumps(LAND), encoding="utf-8")
    path = folder / "case.toml"
    path.write_text(CASE.format(n=N, **given), encoding="utf-8")
    return drift.run(case_file.load(path))


@pytest.mark.parametrize("moves", MOVES)
@pytest.mark.parametrize(
    ("ashore", "pos", "on_shore"),
    [("true", 0.4, 0.4 * 11 / 20), ("false", 0.4 * 9.5 / 20, 0.4 * 0.5 / 20)],
)
def test_pos_afloat_and_ashore(
    tmp_path: Path, moves: str, ashore: str, pos: float, on_shore: float
) -> None:
    """What is not seen ashore is seen until it lands: half of the hour, of the twentieth that lands
    in it.
    """
    result = ran(tmp_path, moves=MOVES[moves], ashore=ashore, step=2700)
    (update,) = result.summary["search"]["updates"]
    for figure, expected in (("pos", pos), ("pos_ashore", on_shore)):
        # The share of particles that are ashore, or land within the hour, is binomial: three
        # standard errors.
        error = 0.4 * 3 * np.sqrt(0.25 / N)
        assert update[figure]["all"] == pytest.approx(
            expected, abs=error if ashore == "false" or figure != "pos" else 1e-4
        )


@pytest.mark.thorough
@pytest.mark.parametrize("moves", MOVES)
@pytest.mark.parametrize("ashore", ["true", "false"])
def test_a_table_of_pod_afloat_and_ashore(tmp_path: Path, moves: str, ashore: str) -> None:
    """A hazard of -log(0.6) an hour: of what lands at u of the hour and is not seen there 1 -
    0.6^u, u uniform, 1 + 0.4 / log(0.6) on average.
    """
    table = xr.DataArray(
        np.full((3, 3), 0.4), {"lat": [-1.0, 0.0, 1.0], "lon": [0.0, 1.0, 2.0]}, ("lat", "lon")
    )
    table.assign_attrs(units="1").to_dataset(name="pod").to_netcdf(tmp_path / "pod.nc")
    head, _, _ = CASE.partition("[[sortie]]")
    watch = """[[sensor]]
name = "radar"
pod = {{ file = "pod.nc" }}
[[sortie]]
name = "all of it"
start = "+10 h"
end = "+11 h"
ashore = {ashore}
watch.sensor = "radar"
"""
    (tmp_path / "land.geojson").write_text(json.dumps(LAND), encoding="utf-8")
    (tmp_path / "case.toml").write_text(
        (head + watch).format(n=N, moves=MOVES[moves], ashore=ashore, step=2700)
    )
    (update,) = drift.run(case_file.load(tmp_path / "case.toml")).summary["search"]["updates"]
    landing = 1 + 0.4 / np.log(0.6)
    pos = 0.4 if ashore == "true" else (0.4 * 9 + landing) / 20
    error = 1e-4 if ashore == "true" else 0.4 * 3 * np.sqrt(0.25 / N)
    assert update["pos"]["all"] == pytest.approx(pos, abs=error)
