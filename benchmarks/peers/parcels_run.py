"""Parcels' part of benchmarks/peers.py: the current only, by its RK4."""

import json
import sys
import time
from pathlib import Path

import matplotlib
import numpy as np
import parcels
import xarray as xr

matplotlib.use("Agg")
from matplotlib import pyplot

job = json.loads(sys.argv[1])
folder, n = Path(job["folder"]), job["particles"]
# Eager: a field that fits in memory is fastest so. Without a file's attributes of the axes Parcels
# does not find them.
data = xr.open_dataset(folder / "cur.nc").load().rename(lon="longitude", lat="latitude")
for name, axis in {"longitude": "X", "latitude": "Y", "time": "T"}.items():
    data[name].attrs["axis"] = axis
fields = {"U": data["uo"].rename("U"), "V": data["vo"].rename("V")}
fieldset = parcels.FieldSet.from_sgrid_conventions(
    parcels.convert.copernicusmarine_to_sgrid(fields=fields), mesh="spherical"
)
lon, lat = np.load(folder / "starts.npy")[:, :n]
particles = parcels.ParticleSet(
    fieldset, x=lon, y=lat, t=np.full(n, np.datetime64(job["start"], "ns"))
)
path = Path(job["out"]) / "tracks.parquet"
begun = time.perf_counter()
with parcels.ParticleFile(path, outputdt=np.timedelta64(job["every"], "s")) as file:
    particles.execute(
        parcels.kernels.AdvectionRK4,
        dt=np.timedelta64(job["step"], "s"),
        runtime=np.timedelta64(job["hours"], "h"),
        output_file=file,
        verbose_progress=False,
    )
ran = time.perf_counter() - begun
if job["picture"]:
    tracks = parcels.read_particlefile(path)
    pyplot.scatter(tracks["x"], tracks["y"], c=tracks["t"], s=1)
    pyplot.savefig(job["picture"])
print(
    json.dumps(
        {
            "version": parcels.__version__,
            "run_s": ran,
            "particles": len(particles),
            "lon": float(np.mean(np.asarray(particles.x), dtype=float)),
            "lat": float(np.mean(np.asarray(particles.y), dtype=float)),
        }
    )
)
