"""OpenDrift's part of benchmarks/peers.py: Leeway, or OceanDrift with the current only."""

import json
import sys
import time
from datetime import datetime, timedelta
from importlib import metadata
from pathlib import Path

import numpy as np
from opendrift.models.leeway import Leeway
from opendrift.models.oceandrift import OceanDrift
from opendrift.readers import reader_netCDF_CF_generic

job = json.loads(sys.argv[1])
folder, n, leeway = Path(job["folder"]), job["particles"], job["object"] is not None
model = (Leeway if leeway else OceanDrift)(loglevel=50)
model.add_reader(
    [reader_netCDF_CF_generic.Reader(str(folder / name)) for name in ("cur.nc", "wnd.nc")]
)
start = {"time": datetime.fromisoformat(job["start"])}
if leeway:
    keys = [one["OBJKEY"] for one in model.leewayprop.values()]
    start["object_type"] = keys.index(job["object"]) + 1
else:
    model.set_config("environment:constant:land_binary_mask", 0)
    model.set_config("drift:advection_scheme", "runge-kutta4")
    model.set_config("drift:vertical_mixing", False)
    start["wind_drift_factor"] = 0
lon, lat = np.load(folder / "starts.npy")[:, :n]
model.seed_elements(lon=lon, lat=lat, **start)
begun = time.perf_counter()
model.run(
    duration=timedelta(hours=job["hours"]),
    time_step=job["step"],
    time_step_output=job["every"],
)
ran = time.perf_counter() - begun
if job["picture"]:
    model.plot(filename=job["picture"])
end = model.elements
print(
    json.dumps(
        {
            "version": metadata.version("opendrift"),
            "run_s": ran,
            "particles": len(end.lon),
            "lon": float(np.mean(end.lon, dtype=float)),
            "lat": float(np.mean(end.lat, dtype=float)),
        }
    )
)
