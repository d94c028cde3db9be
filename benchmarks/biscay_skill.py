"""How good are 24 h forecasts of a real drifter? Skill of the mean track, and how often the areas hold the drifter.

    python benchmarks/biscay_skill.py FOLDER_OF_BISCAY [--every 12] [--errors '{ current = { std = "0.12 m/s", time = "12 h" } }']

Without --errors the defaults hold.

Skill: Liu and Weisberg 2011, doi:10.1029/2010JC006837, eq. 1-2 with n = 1: 1 minus the sum of separations over the sum of
the drifter's own ways so far, at 3-hourly points, never below 0. Areas: the smallest `containment` at the drifter's place
after 24 h; an honest forecast has 50 % of them below 0.5 and 90 % below 0.9.
"""

import argparse
import tempfile
from pathlib import Path

import numpy as np

import drift
from geo import sphere

HOURS = np.arange(0, 25, 3)

CASE = """
start = "{start}Z"
duration = "24 h"
particles = 20000
output.every = "3 h"
current = [{{ name = "hycom", files = ["{folder}/hycom.gdp.u.nc", "{folder}/hycom.gdp.v.nc"] }}]
max_lost = 1.0
{errors}
[[scenario]]
name = "drifter"
object = "water"
position = {{ at = [{lon:.6f}, {lat:.6f}], std = "300 m" }}
"""


def fixes(path: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return times [s], lon and lat [deg] of the drifter, sorted, each time once."""
    rows = np.genfromtxt(path, delimiter=",", skip_header=2, usecols=(2, 3, 4), dtype=None, encoding="utf-8")
    seconds = np.array([np.datetime64(row[0].rstrip("Z"), "s").astype(int) for row in rows])
    seconds, first = np.unique(seconds, return_index=True)
    return seconds, np.array([rows[i][2] for i in first]), np.array([rows[i][1] for i in first])


def main() -> None:
    """Forecast from every start and print the scores."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("folder", type=Path)
    options.add_argument("--every", type=float, default=12.0)
    options.add_argument("--errors", help='the case\'s uncertainty, as TOML, or "none" in quotes; else by default')
    given = options.parse_args()
    when, lon, lat = fixes(next(given.folder.glob("gdp-*.csv")))
    skills, levels, lost = [], [], []
    for start in np.arange(when[0], when[-1] - 86_400, given.every * 3600).astype(int):
        at = start + HOURS * 3600
        gap = np.diff(when[np.searchsorted(when, at[0], "right") - 1 : np.searchsorted(when, at[-1]) + 1]).max()
        if gap > 3 * 3600:  # the drifter was silent: nothing to compare with
            continue
        x, y = np.interp(at, when, lon), np.interp(at, when, lat)
        text = CASE.format(
            start=np.datetime64(int(start), "s"), folder=given.folder.resolve(), lon=x[0], lat=y[0],
            errors=f"uncertainty = {given.errors}" if given.errors else "",
        )  # fmt: skip
        with tempfile.NamedTemporaryFile("w", suffix=".toml") as file:
            file.write(text)
            file.flush()
            result = drift.run(drift.load(file.name))
        data = result.forecast.data
        here = np.radians([data["mean_lon"].values, data["mean_lat"].values])
        apart = sphere.distance(*here, np.radians(x), np.radians(y))[1:]
        way = np.cumsum(sphere.distance(*np.radians([x[:-1], y[:-1], x[1:], y[1:]])))
        skills.append(max(0.0, 1 - apart.sum() / way.sum()))
        last = data["containment"].isel(time=-1).sel(lon=x[-1], lat=y[-1], method="nearest")
        inside = data.lon.min() <= x[-1] <= data.lon.max() and data.lat.min() <= y[-1] <= data.lat.max()
        levels.append(float(last) if inside else 1.0)
        lost.append(result.summary["account"]["outside"] + result.summary["account"]["left"])
        print(f"{np.datetime64(int(start), 's')}  skill {skills[-1]:.2f}  containment {levels[-1]:.2f}  "
              f"apart after 24 h {apart[-1] / 1000:.1f} km of {way[-1] / 1000:.1f} km")  # fmt: skip
    level = np.array(levels)
    print(f"{level.size} forecasts: skill mean {np.mean(skills):.2f}, median {np.median(skills):.2f}; drifter inside the "
          f"50 % area {np.mean(level <= 0.5):.0%}, 90 % area {np.mean(level <= 0.9):.0%} of the time; {np.mean(lost):.0%} of the probability left the current's box, and "
          "areas are shares of the rest")  # fmt: skip


if __name__ == "__main__":
    main()
