"""How good are forecasts of real drifters? Five experiments, four ocean models, scored blind.

    python benchmarks/skill.py FOLDER [--json FILE] [--every 96] [--particles 1000] [--smallest]
        [--only TEXT] [--opendrift PYTHON]

FOLDER is the folder `data` of github.com/nsoontie/velocity-error: hourly positions of drifters with
the modelled current and wind at each. The fifth experiment, a drifter in the Bay of Biscay, ships
with the tests. Windage is stated by kind of drifter, not fitted: 3.5 % of the wind for floats at the
surface, 1 % for those partly submerged, 0 for a drogue at 15 m.

From the start of each track and every 96 h on, `drift verify` forecasts 48 h with the model's values
along the drifter's track, with four sets of errors: none (the model alone), the defaults, and errors
fitted on the other experiments (leave one out), normal and with a tail: the std, time and bias with
the largest mean log score of their displacements, each experiment counting once. Printed for each,
at 6, 12, 24 and 48 h: the shares that areas held, scores and separations, beside staying put.

--only: forecast the experiments whose names hold TEXT alone. --opendrift: also score OpenDrift's
OceanDrift with the same currents, starts and scores; PYTHON is the interpreter of an environment in
which `import opendrift` works (benchmarks/opendrift_skill.py).

Then the laws alone, in closed form: the log score, energy score and shares of a normal law and of
Student's, fitted on the other experiments in the same way. --smallest: the Bay of Biscay alone.
"""

import argparse
import json
import subprocess
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import smallest
import xarray as xr
from scipy import optimize, special, stats

import drift
from drift.assess.verify import error_law, scores
from drift.assess.verify.error_law import Law
from drift.assess.verify.verification import Verification
from drift.case.forcing.uncertainty import CURRENT
from drift.case.tracking import reading
from drift.tracking.tracks.records import Track
from geo import sphere

HOURS, SHARES = (6, 12, 24, 48), (0.5, 0.75, 0.9, 0.95)
NAMES = {"current_east": "u", "current_north": "v"}
START = 100.0  # [m] radius that holds half of the errors of the starts
SLICE = Path(__file__).parents[1] / "tests" / "data" / "biscay_drifter" / "drifter_6203641.csv"
WINDAGE = {
    **dict.fromkeys(("Pacific Gyre CARTHE", "MetOcean CODE/Davis", "IOS SCT", "UBC"), 0.01),
    **dict.fromkeys(("ISMER Stokes drift tracker", "iSphere", "Xeos OSKER", "osker"), 0.035),
    "SVP": 0.0,
}
CASE = """start = "2020-09-10T00:00Z"
duration = "48 h"
[coast]
source = "none"
[[scenario]]
name = "drifter"
object = "water"
position = { at = [0, 0], error = "100 m" }
"""
NORMAL = float("inf")  # degrees of freedom of Student's law that is normal
FREEDOM = (3.0, 4.0, 6.0)
TAIL = 4.0  # of forecasts


@dataclass(frozen=True)
class Sample:
    """The drifters of an experiment beside one model."""

    experiment: str
    model: str
    tracks: list[Track]


def samples(folder: Path | None) -> Iterator[Sample]:
    """Yield the drifters of each experiment beside each model; folder: None for the slice alone."""
    if folder is not None:
        for experiment, model, name, word in (
            ("St. Lawrence, Sep 2020", "CIOPS-East 2", "TREX-CIOPSEv2-relocatable1km", ""),
            ("St. Lawrence, Sep 2020", "GSL500", "TREX-GSL500-relocatable1km", ""),
            ("St. Lawrence, Sep 2021", "CIOPS-East 1.5", "TREX2021oskers-CIOPSEv1p5-mshydro", ""),
            ("St. Lawrence, Sep 2021", "CIOPS-East 2", "TREX2021oskers-CIOPSEv2-mshydro", ""),
            ("Scotian Shelf, from Mar 2019", "CIOPS-East 2", "bioSVPs-CIOPSEv2", "20190328"),
            ("Scotian Shelf, from Nov 2019", "CIOPS-East 2", "bioSVPs-CIOPSEv2", "20191104"),
        ):
            paths = sorted(path for path in (folder / name).glob("*.nc") if word in path.name)
            if not paths:
                raise SystemExit(
                    f"{folder / name} has no tracks: give the folder data of velocity-error"
                )
            yield Sample(experiment, model, [hourly(path) for path in paths])
    slice_of = reading.read_drifters(SLICE, list(NAMES))
    tracks = [
        Track(t.name, t.time, t.lon, t.lat, {NAMES[key]: t.columns[key] for key in NAMES})
        for t in slice_of
    ]
    yield Sample("Bay of Biscay, Mar 2021", "HYCOM3D", tracks)


def hourly(path: Path) -> Track:
    """Return a drifter's track; its columns u, v are current plus windage times wind [m/s]."""
    with xr.open_dataset(path) as data:
        time = data["time"].values.astype("datetime64[s]").astype(np.float64)
        kind = str(data.attrs.get("obs_drifter_type", data.attrs.get("obs_model")))
        columns = {}
        for name, way in (("u", "ueast"), ("v", "vnorth")):
            columns[name] = data[f"{way}_ocean"].values.astype(float)
            if WINDAGE[kind] > 0:
                columns[name] += WINDAGE[kind] * data[f"{way}_atmos"].values
        lon, lat = data["lon"].values.astype(float), data["lat"].values.astype(float)
        return Track(path.stem[18:], time, lon, lat, columns)


def excesses(sample: Sample) -> np.ndarray:
    """Return displacements beyond the model at HOURS, from every 24th hour on, (n, 4, 2) [m]."""
    found = []
    for track in sample.tracks:
        for begin in np.arange(np.ceil(track.time[0]), track.time[-1] - 48 * 3600 + 1, 24 * 3600):
            part = (track.time >= begin - 3600) & (track.time <= begin + 49 * 3600)
            if np.diff(track.time[part]).max(initial=0) > 3.1 * 3600:
                continue
            when = begin + 3600.0 * np.arange(49)
            model = np.stack([np.interp(when, track.time, track.columns[c]) for c in "uv"], -1)
            if not np.isfinite(model).all():
                continue
            lon, lat = (np.radians(x) for x in track.at(when))
            moved = np.stack(sphere.offset(lon[0], lat[0], lon, lat), -1)
            steps = 0.5 * (model[1:] + model[:-1]) * 3600
            found.append((moved[1:] - np.cumsum(steps, axis=0))[np.array(HOURS) - 1])
    return np.array(found).reshape(-1, len(HOURS), 2)


def variances(std: float, time: float, bias: float) -> np.ndarray:
    """Return the variance of a component of the displacement at HOURS [m2], with the start's."""
    law = Law(std, time, bias, 0.0, 0.0)
    return error_law.error_variance(law, 3600.0 * np.array(HOURS)) + START**2 / (2 * np.log(2))


def log_density(square: np.ndarray, variance: np.ndarray, freedom: float) -> np.ndarray:
    """Return the log density [1/km2] of Student's law in two dimensions, of a variance a component.

    square: squared distance from the middle [m2].
    """
    if freedom == NORMAL:
        return np.log(1e6 / (2 * np.pi * variance)) - square / (2 * variance)
    wide = variance * (freedom - 2) / freedom
    return np.log(1e6 / (2 * np.pi * wide)) - (freedom / 2 + 1) * np.log1p(
        square / (freedom * wide)
    )


def containments(square: np.ndarray, variance: np.ndarray, freedom: float) -> np.ndarray:
    """Return the share of the smallest area that holds a displacement."""
    if freedom == NORMAL:
        return -np.expm1(-square / (2 * variance))
    wide = variance * (freedom - 2) / freedom
    return 1 - (1 + square / (freedom * wide)) ** (-freedom / 2)


def energy_scores(square: np.ndarray, variance: np.ndarray, freedom: float) -> np.ndarray:
    """Return the energy score [m]: Rice's mean distance, averaged over 60 quantiles of the scale."""
    scale = np.ones(1)
    if freedom != NORMAL:
        scale = np.sqrt((freedom - 2) / stats.chi2.ppf((np.arange(60) + 0.5) / 60, freedom))
    apart = np.zeros_like(square)
    for one in scale:
        wide = one**2 * variance
        q = square / (2 * wide)
        rice = (1 + q) * special.i0e(q / 2) + q * special.i1e(q / 2)
        apart += np.sqrt(np.pi * wide / 2) * rice / scale.size
    among = np.hypot(scale[:, None], scale).mean() * np.sqrt(np.pi * variance / 2)
    return apart - among / 2


def fitted(others: Sequence[Sequence[np.ndarray]], freedom: float) -> tuple[float, float, float]:
    """Return std, time and bias (SI) with the largest mean log score of other experiments.

    others: squared distances (n, 4) [m2] beside each model, by experiment; each experiment counts
    once.
    """

    def cost(point: np.ndarray) -> float:
        variance = variances(*np.exp(point))
        means = [
            np.mean([log_density(square, variance, freedom).mean() for square in models])
            for models in others
        ]
        return -float(np.mean(means))

    begin = np.log([0.2, 9 * 3600.0, 0.08])
    found = optimize.minimize(
        cost, begin, method="Nelder-Mead", options={"fatol": 1e-4, "xatol": 1e-2}
    )
    std, time, bias = np.exp(found.x)
    return float(std), float(time), float(bias)


def verified(sample: Sample, error: Any, every: float, particles: int) -> Verification:
    """Return the verification of a sample with errors of the current."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "case.toml"
        path.write_text(CASE)
        case = drift.load(path, along=["current"])
        case = drift.vary(case, {"uncertainty": error})
        return drift.verify(
            case, sample.tracks, every=every * 3600, hours=48, error=START, columns=NAMES,
            particles=particles,
        )  # fmt: skip


def row(found: Verification, lead: int) -> dict[str, Any]:
    """Return the scores of a verification at a lead [h]; distances in km."""
    at, column = list(found.leads).index(lead), list(found.hours).index(lead)
    points = (found.hours <= lead) & (found.hours % 3 == 0)
    clipped = [
        scores.skill(a[points], w[points]) for a, w in zip(found.apart, found.way, strict=True)
    ]
    free, staying = (
        [
            scores.unclipped_skill(a[points], w[points])
            for a, w in zip(apart, found.way, strict=True)
        ]
        for apart in (found.apart, found.waiting)
    )
    return {
        "hours": lead,
        "forecasts": found.skill.size,
        "held": {f"{share:.0%}": found.held(at, share).mean for share in SHARES},
        "held_error": {f"{share:.0%}": found.held(at, share).error for share in SHARES},
        "energy_km": float(found.energy[:, at].mean()) / 1000,
        "log": float(found.log[:, at].mean()),
        "log_median": float(np.median(found.log[:, at])),
        "ss_unclipped": float(np.mean(free)),
        "ss_clipped": float(np.mean(clipped)),
        "ss_staying": float(np.mean(staying)),
        "apart_km": float(found.apart[:, column].mean()) / 1000,
        "staying_km": float(found.waiting[:, column].mean()) / 1000,
    }


def opendrift_settings() -> dict[str, tuple[float, float]]:
    """Return current_uncertainty [m/s] and horizontal_diffusivity [m2/s] by name of a setting.

    The last two have the std of our default error, and the diffusivity std^2 time to which that
    error's spread tends.
    """
    diffusivity = CURRENT.std**2 * CURRENT.time
    return {
        "OpenDrift, defaults": (0.0, 0.0),
        f"OpenDrift, current_uncertainty {CURRENT.std:.2f} m/s": (CURRENT.std, 0.0),
        f"OpenDrift, horizontal_diffusivity {diffusivity:,.0f} m2/s": (0.0, diffusivity),
    }


def opendrift_scores(
    sample: Sample, python: Path, every: float, particles: int
) -> Iterator[tuple[str, Verification]]:
    """Yield the name of each setting of OpenDrift, and its verification from the same starts."""
    found = verified(sample, "none", every, particles)
    begins, currents = [], []
    for start, number in zip(found.start, found.drifter, strict=True):
        when = start + 3600.0 * np.arange(49)
        track = next(
            one
            for one in sample.tracks
            if one.name == found.names[number]
            and one.time[0] <= start
            and one.time[-1] >= when[-1] - 3600
        )
        known = np.isfinite(track.columns["u"] + track.columns["v"])
        currents.append([np.interp(when, track.time[known], track.columns[c][known]) for c in "uv"])
        begins.append([float(x) for x in track.at(start)])
    rng = np.random.default_rng(45)
    spread = START / np.sqrt(2 * np.log(2))
    off = spread * rng.standard_normal((2, len(begins), particles))
    x, y = np.radians(np.array(begins)).T
    lon, lat = sphere.destination(x[:, None], y[:, None], *off)
    east, north = np.swapaxes(np.array(currents), 0, 1)
    for name, (std, diffusivity) in opendrift_settings().items():
        with tempfile.TemporaryDirectory() as folder:
            source, target = Path(folder) / "forecasts.npz", Path(folder) / "clouds.npz"
            ones = np.ones(len(begins))
            np.savez(
                source, start=found.start, east=east, north=north, lon=np.degrees(lon),
                lat=np.degrees(lat), std=std * ones, diffusivity=diffusivity * ones,
            )  # fmt: skip
            worker = Path(__file__).with_name("opendrift_skill.py")
            subprocess.run([python, worker, source, target], check=True, stdout=subprocess.DEVNULL)
            clouds = np.load(target)
            yield name, scored(found, clouds["lon"], clouds["lat"])


def scored(found: Verification, lons: Any, lats: Any) -> Verification:
    """Return a verification with the scores of other clouds, from the same starts.

    lons, lats: of the particles [deg], (forecasts, particles, times every 3 h from the start).
    """
    apart = np.empty_like(found.apart)
    at_leads = np.empty((3, *found.containment.shape))
    weight = np.full(lons.shape[1], 1 / lons.shape[1])
    for n in range(lons.shape[0]):
        for k, hour in enumerate(found.hours):
            lon, lat = (each[n, :, round(hour / 3)] for each in (lons, lats))
            # the mean position on the sphere, as of a forecast
            phi, theta = np.radians(lat), np.radians(lon)
            mean = [np.mean(np.cos(phi) * np.cos(theta)), np.mean(np.cos(phi) * np.sin(theta))]
            middle = np.arctan2(mean[1], mean[0]), np.arctan2(np.sin(phi).mean(), np.hypot(*mean))
            here = np.radians([found.lon[n, k], found.lat[n, k]])
            apart[n, k] = sphere.distance(*middle, *here)
            x, y = scores.relative_to(found.lon[n, k], found.lat[n, k], lon, lat)
            for lead in np.flatnonzero(found.leads == hour):
                at_leads[:, n, lead] = (
                    scores.containment(x, y, weight),
                    scores.energy_score(x, y, weight),
                    scores.log_score(x, y, weight),
                )
    return replace(found, apart=apart, containment=at_leads[0], energy=at_leads[1], log=at_leads[2])


def print_row(sample: Sample, name: str, found: Verification, lead: int) -> dict[str, Any]:
    """Print a row of the table of forecasts; return it."""
    one = row(found, lead)
    held = " / ".join(f"{100 * share:.0f}" for share in one["held"].values())
    without = name in ("none", "OpenDrift, defaults")  # a cloud no wider than its start
    if without:
        held = "-"
    log = "-" if without else f"{one['log']:.2f}, {one['log_median']:.2f}"
    print(
        f"| {sample.experiment}, {sample.model} | {name} | {lead} h | {one['forecasts']:,} | {held} "
        f"| {one['energy_km']:.1f} km | {log} | {one['ss_unclipped']:.2f} | {one['ss_clipped']:.2f} "
        f"| {one['apart_km']:.1f} km | {one['staying_km']:.1f} km, {one['ss_staying']:.2f} |",
        flush=True,
    )
    return {"experiment": sample.experiment, "model": sample.model, "errors": name, **one}


def table_of_forecasts(
    everything: list[Sample],
    every: float,
    particles: int,
    squares: Any,
    opendrift: Path | None = None,
) -> list:
    """Print a row for each sample, set of errors and lead; return them."""
    print(
        "| experiment, model | errors | after | forecasts | 50 / 75 / 90 / 95 % areas held | energy score | log score, median "
        "| SS* | SS | apart | staying put: apart, SS* |\n|" + "---|" * 11
    )
    rows = []
    for sample in everything:
        laws: dict[str, Any] = {"none": "none", "default": {}}
        others = [models for name, models in squares.items() if name != sample.experiment]
        for freedom in (NORMAL, TAIL) if others else ():
            std, time, bias = fitted(others, freedom)
            own = {"std": std, "time": time, "bias": bias}
            own |= {} if freedom == NORMAL else {"tail": freedom}
            words = "" if freedom == NORMAL else f", tail {freedom:g}"
            laws[f"fitted: {std:.2f} m/s, {time / 3600:.0f} h, {bias:.2f} m/s{words}"] = {
                "current": own
            }
        for name, error in laws.items():
            found = verified(sample, error, every, particles)
            rows += [print_row(sample, name, found, lead) for lead in HOURS]
        if opendrift is not None:
            for name, found in opendrift_scores(sample, opendrift, every, particles):
                rows += [print_row(sample, name, found, lead) for lead in HOURS]
    return rows


def table_of_laws(squares: Any) -> list:
    """Print the laws' scores in closed form, each fitted on the other experiments; return them."""
    print(
        "\n| left out | law | std, time, bias | log score | energy score | 50 / 75 / 90 / 95 % ellipses held |\n|"
        + "---|" * 6
    )
    rows = []
    for name, models in squares.items():
        others = [other for key, other in squares.items() if key != name]
        laws = {"default": (CURRENT.std, CURRENT.time, CURRENT.bias, NORMAL)}
        for freedom in (NORMAL, *FREEDOM) if others else ():
            words = "normal" if freedom == NORMAL else f"Student, {freedom:g}"
            laws[words] = (*fitted(others, freedom), freedom)
        for law, (std, time, bias, freedom) in laws.items():
            variance = variances(std, time, bias)
            log, energy, held = (
                np.mean([values(square).mean(axis=0) for square in models], axis=0)
                for values in (
                    lambda square: log_density(square, variance, freedom),  # noqa: B023
                    lambda square: energy_scores(square, variance, freedom) / 1000,  # noqa: B023
                    lambda square: np.stack([containments(square, variance, freedom) <= p for p in SHARES], -1),  # noqa: B023
                )
            )  # fmt: skip
            rows.append(
                {
                    "left_out": name, "law": law, "std": std, "time": time, "bias": bias, "log": log.tolist(),
                    "energy_km": energy.tolist(), "held": held.tolist(),
                }
            )  # fmt: skip
            told = " / ".join(f"{100 * share:.0f}" for share in held.mean(axis=0))
            print(
                f"| {name} | {law} | {std:.2f} m/s, {time / 3600:.1f} h, {bias:.2f} m/s | {log.mean():.2f} "
                f"| {energy.mean():.1f} km | {told} |"
            )
    for law in dict.fromkeys(one["law"] for one in rows):
        own = [one for one in rows if one["law"] == law]
        held = np.mean([np.mean(one["held"], axis=0) for one in own], axis=0)
        print(
            f"| mean of {len(own)} | {law} | | {np.mean([one['log'] for one in own]):.2f} "
            f"| {np.mean([one['energy_km'] for one in own]):.1f} km | {' / '.join(f'{100 * x:.0f}' for x in held)} |"
        )
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("folder", type=Path, nargs="?")
    parser.add_argument("--json", type=Path, help="also write the rows there")
    parser.add_argument("--every", type=float, default=96.0, help="[h] from start to start")
    parser.add_argument("--particles", type=int, default=1000)
    parser.add_argument("--only", default="", help="part of the names of experiments to forecast")
    parser.add_argument("--opendrift", type=Path, help="interpreter of OpenDrift's environment")
    args = smallest.parse(parser, every=120.0, particles=500)
    if args.folder is None and not smallest.ASKED:
        parser.error("give the folder data of velocity-error, or --smallest")
    everything = list(samples(args.folder))
    squares: dict[str, list[np.ndarray]] = {}
    for sample in everything:
        square = (excesses(sample) ** 2).sum(axis=-1)
        squares.setdefault(sample.experiment, []).append(square)
    laws = table_of_laws(squares)
    chosen = [sample for sample in everything if args.only in sample.experiment]
    forecasts = table_of_forecasts(chosen, args.every, args.particles, squares, args.opendrift)
    if args.json:
        args.json.write_text(json.dumps({"forecasts": forecasts, "laws": laws}, indent=1))


if __name__ == "__main__":
    main()
