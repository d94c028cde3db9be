"""End positions by OpenDrift's Leeway model on NorKyst and AROME after a day, jibing and all errors
on: CSV.

Run it in an environment of OpenDrift's own (it is no dependency of ours), or let
benchmarks/opendrift_spread.py run it:

    python benchmarks/opendrift_ends.py FOLDER_OF_NORKYST ENDS.csv [OBJECTS_PER_CLASS]

All objects of a class start at one point. Their leeway errors are OpenDrift's own, drawn by its
seed_elements: one normal number for the downwind line, drawn again until its slope is not negative,
and one for the crosswind line. Patched:

- Mirror. OpenDrift moves an object of positive crosswind leeway to the left of downwind
  (models/leeway.py: for a wind towards the north x = -crosswind); the field reports, and we, to the
  right. Its crosswind lines are negated here.
- Jibing ("line"). OpenDrift changes the sign of the crosswind slope and keeps the offset and the
  error, so that an object of another right than left line drifts on neither after its first jibe.
  Here it gets the other line whole: slope, offset and that line's own error, drawn independently at
  the start. The rate is OpenDrift's: -ln(1 - 0.04) an hour.
- Errors of current and wind. OpenDrift draws them again at each time step, so that their effect
  shrinks with the step. Here they are Ornstein-Uhlenbeck processes, their exact transition over
  each step, added to what its readers return.

The rows "slope" are the same without the second patch: OpenDrift's own jibing. Euler steps of 60 s
keep its own error small.
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
# [degrees] open water, a day's drift away from the coast and from the rims of both files
LON, LAT = 3.9, 60.1
CLASSES = ("PIW-1", "PIW-2", "PIW-4", "LIFE-RAFT-DB-10", "SAILBOAT-2", "FISHING-VESSEL-1")
CURRENT_STD, CURRENT_TIME = 0.1, 6 * 3600.0  # [m/s] a component, [s]
WIND_STD, WIND_TIME = 1.5, 6 * 3600.0
JIBE = 0.04  # probability in an hour


class Errors(Leeway):
    """Leeway with errors of current and wind that last, and, if asked for, jibes that change the
    whole line.
    """

    def prepare(self, rng: np.random.Generator, whole: bool) -> None:
        """Mirror the crosswind lines of what is seeded, draw the other side's errors and the first
        forcing errors.
        """
        e = self.elements_scheduled
        n = len(e.ID)
        table = [self.leewayprop[int(number)] for number in np.broadcast_to(e.object_type, n)]
        names = (("CWRSLOPE", "CWROFFSET", "CWRSTD"), ("CWLSLOPE", "CWLOFFSET", "CWLSTD"))
        self.side = np.array(e.orientation)  # 0 right, 1 left
        # side, object, what
        self.lines = np.array([[[row[name] for name in side] for row in table] for side in names])
        self.lines[:, :, 2] *= rng.standard_normal((2, n))
        self.lines[self.side, np.arange(n), 2] = e.crosswind_eps
        self.lines *= -1
        self.rng, self.whole = rng, whole
        self.error = rng.standard_normal((4, n)) * np.repeat((CURRENT_STD, WIND_STD), 2)[:, None]
        e.crosswind_slope, e.crosswind_offset, e.crosswind_eps = self.lines[
            self.side, np.arange(n)
        ].T
        e.jibe_probability = np.full(n, 0.0 if whole else JIBE)

    def update(self) -> None:
        """Move all objects by one step."""
        who = np.asarray(self.elements.ID)
        keep = np.exp(-STEP / np.repeat((CURRENT_TIME, WIND_TIME), 2))[:, None]
        std = np.repeat((CURRENT_STD, WIND_STD), 2)[:, None]
        old = self.error
        self.error = keep * old + std * np.sqrt(1 - keep**2) * self.rng.standard_normal(old.shape)
        mean = 0.5 * (old + self.error)[:, who]
        for row, name in enumerate(
            ("x_sea_water_velocity", "y_sea_water_velocity", "x_wind", "y_wind")
        ):
            self.environment[name] = self.environment[name] + mean[row]
        super().update()
        if self.whole:
            jibes = self.rng.random(self.side.size) < 1 - (1 - JIBE) ** (STEP / 3600)
            self.side = np.where(jibes, 1 - self.side, self.side)
            line = self.lines[self.side[who], who]
            (
                self.elements.crosswind_slope,
                self.elements.crosswind_offset,
                self.elements.crosswind_eps,
            ) = line.T


def ends(folder: Path, whole: bool, each: int) -> dict[str, np.ndarray]:
    """Return longitude and latitude [degrees] of those of each class that are afloat at the end,
    shape (n, 2).
    """
    files = ("norkyst800_subset_16Nov2015.nc", "arome_subset_16Nov2015.nc")
    model = Errors(loglevel=50)
    model.add_reader([reader_netCDF_CF_generic.Reader(str(folder / name)) for name in files])
    model.set_config("environment:constant:land_binary_mask", 0)
    model.set_config("drift:max_speed", 10)
    np.random.seed(20151116)  # noqa: NPY002 - what OpenDrift draws its leeway errors from
    keys = [p["OBJKEY"] for p in model.leewayprop.values()]
    for name in CLASSES:
        model.seed_elements(
            lon=LON, lat=LAT, number=each, time=START, object_type=keys.index(name) + 1
        )
    model.prepare(np.random.default_rng(20151117), whole)
    model.run(duration=timedelta(hours=HOURS), time_step=STEP, time_step_output=3600 * HOURS)
    who = np.asarray(model.elements.ID)
    lonlat = np.column_stack([model.elements.lon, model.elements.lat])
    return {name: lonlat[who // each == k] for k, name in enumerate(CLASSES)}


def main() -> None:
    """Write the file."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", nargs="?", type=Path)
    parser.add_argument("target", nargs="?", type=Path, default=Path("ends.csv"))
    parser.add_argument("each", nargs="?", type=int, default=4000)
    given = smallest.parse(parser, each=10)
    folder, each = given.folder or smallest.data() / "norkyst", given.each
    with given.target.open("w") as file:
        file.write(
            f"# OpenDrift {__version__} Leeway from {LAT} N {LON} E, {START:%Y-%m-%dT%H:%MZ}, {HOURS} h, Euler steps of {STEP} s, "
            "errors and jibing on, patched as benchmarks/opendrift_ends.py says, which made it\n"
        )
        file.write("jibing,class,lon,lat\n")
        for jibing in ("line", "slope"):
            for name, lonlat in ends(folder, jibing == "line", each).items():
                print(f"{jibing} {name}: {len(lonlat)} of {each} afloat", flush=True)
                for lon, lat in lonlat:
                    file.write(f"{jibing},{name},{lon:.5f},{lat:.5f}\n")


if __name__ == "__main__":
    main()
