"""Real drifters, one held out: how much nearer its neighbours' tracks bring the forecast.

    python benchmarks/buoy_neighbours.py FOLDER [--near 10] [--most 3] [--smallest]

FOLDER holds netCDF files of drifters with hourly positions and velocities of drifter, ocean and
wind, such as those of github.com/nsoontie/velocity-error (data/TREX-CIOPSEv2-relocatable1km: 248
tracks of the MEOPAR-TREX experiment of 2020, with the CIOPS-East model). From every 24th hour of
each track, the drifter's displacement beyond the model (with a windage by kind of drifter) is
forecast: without neighbours (no error, with the prior's spread), and from the residuals of the
nearest others within so many kilometres, by the case's default errors (docs/drifters.md). The
neighbours report until the time of the forecast, as buoys on scene do.

Printed by hours: cases; median separation without and with neighbours; area that should hold 50 and
95 %, without and with; and the shares that it held. --smallest runs on tracks made here.
"""

import argparse
from collections import defaultdict
from pathlib import Path

import numpy as np
import smallest
import xarray as xr

from drift.case.forcing.uncertainty import CURRENT
from drift.engine.motion.errors import buoy_errors
from drift.engine.motion.errors.buoy_errors import Fixes, Law
from geo import sphere

HOURS = (6, 12, 24, 48)
LAW = Law(CURRENT.std, CURRENT.time, CURRENT.length, CURRENT.bias, 0.0, 1.0, 1e5, 0.0)
FIX = 100.0  # [m] error of positions, which were resampled to hours


def read(folder: Path) -> list[dict]:
    """Return the tracks: hour since 1970, lon, lat [rad], residual velocity (n, 2) by kind."""
    tracks = []
    for path in sorted(folder.glob("*.nc")):
        with xr.open_dataset(path) as data:
            if "ueast_atmos" not in data:
                continue
            time = data["time"].values.astype("datetime64[s]").astype(np.int64)
            own = {
                name: np.stack([data[f"ueast_{name}"].values, data[f"vnorth_{name}"].values], -1)
                for name in ("drifter", "ocean", "atmos")
            }
            tracks.append(
                {
                    "hour": np.rint(time / 3600).astype(int),
                    "lon": np.radians(data["lon"].values),
                    "lat": np.radians(data["lat"].values),
                    "kind": str(data.attrs.get("obs_drifter_type")),
                    **own,
                }
            )
    return tracks


def with_residuals(tracks: list[dict]) -> list[dict]:
    """Add each track's residual velocity [m/s], after the windage of its kind by least squares."""
    kinds = defaultdict(list)
    for track in tracks:
        kinds[track["kind"]].append(track)
    for own in kinds.values():
        wind = np.concatenate([t["atmos"].ravel() for t in own])
        off = np.concatenate([(t["drifter"] - t["ocean"]).ravel() for t in own])
        known = np.isfinite(wind + off)
        windage = wind[known] @ off[known] / (wind[known] @ wind[known])
        for track in own:
            track["residual"] = track["drifter"] - track["ocean"] - windage * track["atmos"]
    return [track for track in tracks if np.isfinite(track["residual"]).all(axis=1).mean() > 0.9]


def made() -> list[dict]:
    """Return tracks with the default errors, near each other, for --smallest."""
    random = np.random.default_rng(1)
    hours, many = 60, 6
    place = random.normal(size=(many, 2)) * 4000
    apart = np.hypot(*(place[:, None] - place).T)
    factor = np.linalg.cholesky(buoy_errors.correlation(apart, LAW.current_length))
    keep = np.exp(-3600 / LAW.current_time)
    own = random.normal(size=(many, 2))
    errors = []
    for _ in range(hours):
        errors.append(LAW.current_std * factor @ own)
        own = keep * own + np.sqrt(1 - keep**2) * random.normal(size=(many, 2))
    return [
        {
            "hour": np.arange(hours),
            "lon": np.full(hours, place[k, 0] / sphere.RADIUS),
            "lat": np.full(hours, place[k, 1] / sphere.RADIUS),
            "residual": np.stack([error[k] for error in errors]),
        }
        for k in range(many)
    ]


def excess(track: dict, first: int, hours: int) -> np.ndarray | None:
    """Return the displacement [m] beyond the model by hour, (hours + 1, 2); None where unknown."""
    begin = int(np.searchsorted(track["hour"], first))
    part = slice(begin, begin + hours + 1)
    there = track["hour"][part]
    whole = there.size == hours + 1 and there[0] == first and there[-1] == first + hours
    residual = track["residual"][part]
    if not whole or not np.isfinite(residual).all():
        return None
    steps = 0.5 * (residual[1:] + residual[:-1]) * 3600
    return np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])


def forecast(
    own: dict, others: list[dict], first: int, hours: int, gone: list[np.ndarray]
) -> tuple[np.ndarray, float]:
    """Return the mean displacement beyond the model (2,) [m] and the variance of a component."""
    edges = np.arange(hours + 1) * 3600.0
    fresh = np.arange(hours + 1) == 0
    fixes = [Fixes(edges[:1], fresh[:1], np.zeros((1, 1, 2)), 1.0, 0.0)]
    fixes += [Fixes(edges, fresh, one[None], FIX, 0.0) for one in gone]
    lon, lat = (
        np.stack([t[name][np.searchsorted(t["hour"], first + np.arange(hours))] for t in (own, *others)], -1)
        for name in ("lon", "lat")
    )  # fmt: skip
    apart = sphere.distance(lon[:, :, None], lat[:, :, None], lon[:, None], lat[:, None])
    m = len(fixes)
    matrix = buoy_errors.correlation(apart, LAW.current_length) * (1 - 1e-6) + 1e-6 * np.eye(m)
    given = buoy_errors.condition(LAW, edges, (np.linalg.cholesky(matrix), None), fixes)
    cov = given.first @ given.first.T
    for move, kick in zip(given.moves, given.kicks, strict=True):
        cov = move @ cov @ move.T + kick @ kick.T
    state = given.first.shape[0] - m  # X of the one held out
    return given.means[-1, 0, state], float(cov[state, state])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("folder", type=Path, nargs="?")
    parser.add_argument("--near", type=float, default=10.0, help="[km] farthest neighbour")
    parser.add_argument("--most", type=int, default=3, help="neighbours used")
    args = smallest.parse(parser)
    if args.folder is None and not args.smallest:
        parser.error("give the folder of drifters, or --smallest")
    tracks = made() if args.smallest else with_residuals(read(args.folder))
    print(f"{len(tracks)} tracks; up to {args.most} neighbours within {args.near:g} km")
    print("  h  cases   km without  with   50% km2 without  with  held   95% without  with  held")
    for hours in HOURS:
        rows = []
        for own in tracks:
            for first in range(int(own["hour"][0]), int(own["hour"][-1]) - hours + 1, 24):
                gone = excess(own, first, hours)
                if gone is None:
                    continue
                at = int(np.searchsorted(own["hour"], first))
                near = []
                for other in tracks:
                    k = int(np.searchsorted(other["hour"], first))
                    if other is own or k >= other["hour"].size or other["hour"][k] != first:
                        continue
                    km = sphere.distance(own["lon"][at], own["lat"][at], other["lon"][k], other["lat"][k]) / 1000  # fmt: skip
                    if km <= args.near and (theirs := excess(other, first, hours)) is not None:
                        near.append((float(km), other, theirs))
                if not near:
                    continue
                near = sorted(near, key=lambda one: one[0])[: args.most]
                mean, variance = forecast(
                    own, [o for _, o, _ in near], first, hours, [e for *_, e in near]
                )
                _, prior = forecast(own, [], first, hours, [])
                rows.append((np.hypot(*gone[-1]), np.hypot(*(gone[-1] - mean)), prior, variance))
        if not rows:
            print(f"{hours:3d}      0")
            continue
        alone, beside, prior, variance = np.array(rows).T
        areas = []
        for share in (0.5, 0.95):
            scale = -2 * np.log(1 - share)
            held = (beside**2 <= scale * variance).mean()
            areas.append(
                f"{np.pi * scale * prior.mean() / 1e6:9,.0f} {np.pi * scale * variance.mean() / 1e6:9,.0f} {held:5.0%}"
            )
        print(
            f"{hours:3d} {len(rows):6d}  {np.median(alone) / 1000:9.2f} {np.median(beside) / 1000:6.2f}   {'   '.join(areas)}"
        )


if __name__ == "__main__":
    main()
