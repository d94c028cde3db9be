"""The drift of a life raft off Norway for a day against OpenDrift's Leeway model, errors and jibing off."""

from pathlib import Path

import numpy as np

from drift import ensemble as record
from drift import forecast, leeway
from drift.forcing import Forcing, Sources
from drift.forecast import Clock, Scene
from drift.status import Status
from geo import forcing, sphere
from geo.box import Box
from kernels import advance as kernel

TRACKS = Path(__file__).parent / "data" / "opendrift_norkyst.csv"
EVERYWHERE = kernel.Domain(-(2**31), -(2**30), 2**32 - 1, 2**31)


def test_a_raft_ends_within_one_percent_of_where_opendrift_has_it(data: Path) -> None:
    """Median separation under 1 % of the way, largest under 3 %, among those whose forcing lasts the day in both.

    OpenDrift 1.14 moves an object of positive crosswind leeway to the *left* of downwind (model/leeway.py: for a wind
    towards the north x = -crosswind), where the field reports and we have it to the right: its lines are mirrored here.
    """
    rows = np.genfromtxt(TRACKS, delimiter=",", names=True, skip_header=1)
    box, folder = Box(1, 59, 8, 64), data / "norkyst"
    current = forcing.open_source("current", [str(folder / "norkyst800_subset_16Nov2015.nc")], box=box)
    wind = forcing.open_source("wind", [str(folder / "arome_subset_16Nov2015.nc")], box=box)
    ensemble = record.empty(1, (0, len(rows)))
    ensemble.lon.from_numpy(sphere.to_binary(rows["lon"]))
    ensemble.lat.from_numpy(sphere.to_binary(rows["lat"]))
    raft = leeway.find("LIFE-RAFT-DB-11")
    for name, mirror in (("down", 1), ("right", -1), ("left", -1)):
        line = getattr(raft, name)
        getattr(ensemble, f"{name}_slope").fill(mirror * line.slope)
        getattr(ensemble, f"{name}_offset").fill(mirror * line.offset)
    ensemble.side.from_numpy(rows["side"].astype(np.int32))
    sources = Sources((current,), (wind,), cells={("current", current.name): 3})
    world = Scene(Forcing([sources], 1), (kernel.Physics(),), kernel.Place(EVERYWHERE))
    start = int(np.datetime64("2015-11-16T06:00:00", "s").astype(int))
    (end,) = forecast.run(ensemble, world, Clock(start, 86_400, 1, 600), np.array([86_400]))
    world.forcing.close()
    afloat = end.status == Status.ADRIFT  # no coast here: three of 88 run inland, deeper than currents are filled
    assert afloat.mean() > 0.95
    lon, lat, end_lon, end_lat = (np.radians(rows[name]) for name in ("lon", "lat", "end_lon", "end_lat"))
    apart = sphere.distance(end.lon * sphere.UNIT, end.lat * sphere.UNIT, end_lon, end_lat)[afloat]
    share = apart / sphere.distance(lon, lat, end_lon, end_lat)[afloat]
    print(f"median {np.median(share):.4f}, largest {share.max():.4f} of the way, {afloat.sum()} rafts")
    assert np.median(share) < 0.01
    assert share.max() < 0.03
