"""Our spread after a day beside that of OpenDrift's Leeway, jibing and all errors on, six classes
on NorKyst and AROME.

    python benchmarks/opendrift_spread.py [FOLDER_OF_NORKYST [ENDS.csv]] [--opendrift PYTHON]

Without ENDS.csv the tests' are taken, 500 objects of each class. With the interpreter of an
environment that holds OpenDrift, ENDS.csv is made first (benchmarks/opendrift_ends.py, which says
what of OpenDrift was patched). One table for each way of jibing: the distance of the means in
metres, as a share of the way and in standard errors; how much longer our axes of the covariance are
and by how much they are turned, with standard errors by bootstrap; the energy distance with the 95
% quantile of its law under equality, by permutation. Of the same law are two samples whose energy
distance lies under that quantile, 19 times of 20.
"""

import argparse
import subprocess
import tempfile
from pathlib import Path

import numpy as np
import smallest
from scipy.spatial.distance import cdist

import drift
from drift.engine.motion import simulate
from drift.pipeline import run_setup
from geo import sphere
from kernels.runtime import runtime

CLASSES = ("PIW-1", "PIW-2", "PIW-4", "LIFE-RAFT-DB-10", "SAILBOAT-2", "FISHING-VESSEL-1")
LON, LAT = 3.9, 60.1  # [degrees]
CASE = """
start = "2015-11-16T06:00Z"
duration = "24 h"
particles = {particles}
seed = {seed}
clock.step = 600
current = [{{ files = "{folder}/norkyst800_subset_16Nov2015.nc" }}]
wind = [{{ files = "{folder}/arome_subset_16Nov2015.nc" }}]
coast.source = "none"
[uncertainty]
current = {{ std = "0.1 m/s", time = "6 h" }}
wind = {{ std = "1.5 m/s", time = "6 h" }}
diffusivity = 0
"""
SCENARIO = """
[[scenario]]
name = "{name}"
object = "{name}"
position = {{ at = [{lon}, {lat}], std = "1 m" }}
jibe = {jibe}
"""
JIBE = -np.log(1 - 0.04)  # [1/h] OpenDrift's: the chance of a jibe in an hour is 4 %
PERMUTATIONS, BOOTSTRAPS = (20, 20) if smallest.ASKED else (400, 400)
ENDS = Path(__file__).parents[1] / "tests" / "data" / "opendrift_spread.csv"


def ours(folder: str, each: int, seed: int = 1) -> dict[str, np.ndarray]:
    """Return end positions of each class east and north of the start [m], shape (each, 2), of a
    case as a user writes it.
    """
    text = CASE.format(folder=Path(folder).resolve(), particles=each * len(CLASSES), seed=seed)
    text += "".join(SCENARIO.format(name=name, lon=LON, lat=LAT, jibe=JIBE) for name in CLASSES)
    with tempfile.NamedTemporaryFile("w", suffix=".toml") as file:
        file.write(text)
        file.flush()
        case = drift.load(file.name)
    run = run_setup.prepare(case, run_setup.open_for(case))
    (end,) = simulate.run(run.ensemble, run.scene, run.clock, np.array([86_400]))
    xy = plane(end.lon * sphere.UNIT, end.lat * sphere.UNIT)
    return {name: xy[a:b] for name, (a, b) in zip(CLASSES, run.ensemble.scenarios, strict=True)}


def plane(lon: np.ndarray, lat: np.ndarray) -> np.ndarray:
    """Return metres east and north of the start, along great circles, shape (n, 2), of positions
    [rad].
    """
    return np.column_stack(sphere.offset(np.radians(LON), np.radians(LAT), lon, lat))


def axes(xy: np.ndarray) -> tuple[float, float, float]:
    """Return the standard deviations along the major and the minor axis [m] and the major one's
    angle from east [degrees].
    """
    variance, vectors = np.linalg.eigh(np.cov(xy.T))
    return *np.sqrt(variance[::-1]), np.degrees(np.arctan2(vectors[1, 1], vectors[0, 1])) % 180  # type: ignore[return-value]


def against(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return by how much a's axes are longer than b's, as shares, and turned against them
    [degrees].
    """
    (p, q, angle), (r, s, other) = axes(a), axes(b)
    return np.array([p / r - 1, q / s - 1, (angle - other + 90) % 180 - 90])


def energy(a: np.ndarray, b: np.ndarray, rng: np.random.Generator) -> tuple[float, float]:
    """Return the energy distance [m] of two samples (Szekely and Rizzo 2013) and its 95 % quantile
    under equality.
    """
    apart = cdist(np.concatenate([a, b]), np.concatenate([a, b]))
    label = np.concatenate([np.full(len(a), 1 / len(a)), np.full(len(b), -1 / len(b))])
    labels = np.column_stack([label, *(rng.permutation(label) for _ in range(PERMUTATIONS))])
    values = -np.einsum("ik,ik->k", labels, apart @ labels)
    return float(values[0]), float(np.quantile(values[1:], 0.95))


def main() -> None:
    """Print a table for each way of jibing in the file."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", nargs="?")
    parser.add_argument("ends", nargs="?", default=ENDS)
    parser.add_argument("--opendrift", metavar="PYTHON")
    given = smallest.parse(parser)
    given.folder = given.folder or str(smallest.data() / "norkyst")
    if given.opendrift and given.ends == ENDS:
        parser.error("--opendrift: say where its ends are to be written")
    if given.opendrift:
        script = Path(__file__).with_name("opendrift_ends.py")
        subprocess.run([given.opendrift, str(script), given.folder, given.ends], check=True)
    runtime.start()
    rows = np.genfromtxt(
        given.ends, delimiter=",", names=True, skip_header=1, dtype=None, encoding="utf-8"
    )
    # as the tests' are
    how = rows["jibing"] if "jibing" in rows.dtype.names else np.full(len(rows), "line")
    lonlat = plane(np.radians(rows["lon"]), np.radians(rows["lat"]))
    mine = ours(given.folder, int((rows["class"] == CLASSES[0]).sum() / len(np.unique(how))))
    rng = np.random.default_rng(1)
    for jibing in np.unique(how):
        print(f"\nOpenDrift's jibing: {jibing}")
        print(
            f"{'class':18}{'way km':>7}{'means apart':>24}{'axes km':>13}{'major':>17}{'minor':>17}{'turned':>15}{'energy m (95 %)':>18}"
        )
        for name in CLASSES:
            a, b = mine[name], lonlat[(how == jibing) & (rows["class"] == name)]
            apart = a.mean(axis=0) - b.mean(axis=0)
            sigma = np.sqrt(
                apart @ np.linalg.solve(np.cov(a.T) / len(a) + np.cov(b.T) / len(b), apart)
            )
            way, (major, minor, _) = np.hypot(*b.mean(axis=0)), axes(b)
            turns = [
                against(a[rng.integers(len(a), size=len(a))], b[rng.integers(len(b), size=len(b))])
                for _ in range(BOOTSTRAPS)
            ]
            found, error = against(a, b), np.std(turns, axis=0)
            distance, null = energy(a, b, rng)
            print(
                f"{name:18}{way / 1000:7.1f}{np.hypot(*apart):9.0f} m{np.hypot(*apart) / way:7.2%}{sigma:6.1f}"
                f"{major / 1000:7.1f}{minor / 1000:6.1f}"
                + "".join(
                    f"{x:+8.1%} +-{e:6.1%}" for x, e in zip(found[:2], error[:2], strict=True)
                )
                + f"{found[2]:+7.1f} +-{error[2]:5.1f}{distance:9.1f} ({null:.1f})"
            )


if __name__ == "__main__":
    main()
