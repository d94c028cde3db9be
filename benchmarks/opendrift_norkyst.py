"""Tracks of OpenDrift's Leeway model on the NorKyst and AROME files, errors and jibing off: an
oracle for a test.

Run it in an environment of OpenDrift's own (it is no dependency of ours):

    python benchmarks/opendrift_norkyst.py FOLDER_OF_NORKYST tests/data/opendrift_norkyst.csv

Half of the objects drift on the right line, half on the left one; Euler steps of 60 s keep its own
error small.
"""

import argparse
from datetime import datetime, timedelta
from pathlib import Path

import smallest

smallest.need("opendrift")  # whose environment need not hold ours
import numpy as np
from opendrift import __version__
from opendrift.models.leeway import Leeway
from opendrift.readers import reader_netCDF_CF_generic

START = datetime(2015, 11, 16, 6)
HOURS, STEP = 2 if smallest.ASKED else 24, 60
OBJECT = "LIFE-RAFT-DB-11"


def main() -> None:
    """Write the file."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", nargs="?", type=Path)
    parser.add_argument("target", nargs="?", type=Path, default=Path("opendrift_norkyst.csv"))
    given = smallest.parse(parser)
    folder = given.folder or smallest.data() / "norkyst"
    files = ("norkyst800_subset_16Nov2015.nc", "arome_subset_16Nov2015.nc")
    readers = [reader_netCDF_CF_generic.Reader(str(folder / name)) for name in files]
    model = Leeway(loglevel=50)
    model.add_reader(readers)
    model.set_config("environment:constant:land_binary_mask", 0)
    rng = np.random.default_rng(20151116)
    # Open water west of the coast, away from the edges of both files.
    lon, lat = rng.uniform(3.4, 4.2, 100), rng.uniform(60.0, 61.0, 100)
    number = list(model.leewayprop.values()).index(
        next(p for p in model.leewayprop.values() if p["OBJKEY"] == OBJECT)
    )
    model.seed_elements(lon=lon, lat=lat, time=START, object_type=number + 1)
    p, e = list(model.leewayprop.values())[number], model.elements_scheduled
    right = np.arange(lon.size) % 2 == 0
    e.orientation = np.where(right, 0, 1).astype(e.orientation.dtype)
    one = np.ones(lon.size)
    e.downwind_slope, e.downwind_offset = one * p["DWSLOPE"], one * p["DWOFFSET"]
    e.crosswind_slope = np.where(right, p["CWRSLOPE"], p["CWLSLOPE"])
    e.crosswind_offset = np.where(right, p["CWROFFSET"], p["CWLOFFSET"])
    e.downwind_eps, e.crosswind_eps, e.jibe_probability = 0 * one, 0 * one, 0 * one
    e.current_drift_factor = one
    model.run(duration=timedelta(hours=HOURS), time_step=STEP, time_step_output=3600 * HOURS)
    afloat = np.asarray(model.elements.ID)  # those that kept their forcing for the whole day
    end_lon, end_lat = np.full(lon.size, np.nan), np.full(lon.size, np.nan)
    end_lon[afloat], end_lat[afloat] = model.elements.lon, model.elements.lat
    with given.target.open("w") as file:
        file.write(
            f"# OpenDrift {__version__} Leeway, {OBJECT}, {START:%Y-%m-%dT%H:%MZ}, {HOURS} h, Euler steps of {STEP} s, "
            "errors and jibing off; made by benchmarks/opendrift_norkyst.py\n"
        )
        file.write("side,lon,lat,end_lon,end_lat\n")
        for row in zip(np.where(right, 1, -1), lon, lat, end_lon, end_lat, strict=True):
            if np.isnan(row[-1]):
                continue
            file.write("{:d},{:.6f},{:.6f},{:.6f},{:.6f}\n".format(*row))


if __name__ == "__main__":
    main()
