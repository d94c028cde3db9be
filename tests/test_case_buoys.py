"""Shipped cases of sonar buoys against exact Bayes on a grid, by geodesics."""

from collections.abc import Callable
from typing import Any

import numpy as np
import oracle
import pyproj
import pytest
import xarray as xr
from case_answers import SIGMAS, flat
from case_draws import CASES, metres, place, table
from oracle import NMI, Array
from scipy import interpolate, stats

from drift.case import file as case_file
from drift.pipeline import flow

# a watch or contact, bearings [deg], ranges [m] to chances
Hearing = Callable[[dict[str, Any], Array, Array], Array]


def zoned(told: dict[str, Any], _: Array, far: Array) -> Array:
    """Return the chance of detection in zones of range."""
    chance = np.zeros(far.size)
    for inner, outer, pod in told["zones"]:
        chance[(far >= metres(inner)) & (far <= metres(outer))] = pod
    return chance


def by_ear(told: dict[str, Any], bearing: Array, far: Array) -> Array:
    """Return the chance with which a buoy of sound_channel hears at once: the sonar equation on
    SciPy's grid.
    """
    case = table("sound_channel")
    own = next(sensor for sensor in case["sensor"] if sensor["name"] == told["sensor"])
    with xr.open_dataset(CASES / own["sonar"]["loss"]["file"]) as data:
        x, y = place(own["at"])
        (k,) = np.flatnonzero(
            np.isclose(data["lon"], x, atol=1e-5) & np.isclose(data["lat"], y, atol=1e-5)
        )
        loss = data["loss"].isel(depth=0, place=int(k)).transpose("bearing", "range").values
        ranges, toward = data["range"].values, np.append(data["bearing"].values, 360.0)
    grid = interpolate.RegularGridInterpolator((toward, ranges), np.concatenate([loss, loss[:1]]))
    lost = grid(np.stack([bearing % 360, np.clip(far, ranges[0], ranges[-1])], axis=1))
    level, noise, least, spread = (
        float(text.split()[0])
        for text in (
            case["scenario"][0]["source_level"],
            *(own["sonar"][key] for key in ("noise", "threshold", "fluctuation")),
        )
    )
    return np.where(far <= ranges[-1], stats.norm.cdf((level - lost - noise - least) / spread), 0.0)


def bayes(name: str, spacing: float, chance: Hearing) -> tuple[Array, Array, Array]:
    """Return the posterior of a case of two buoys by Bayes on a grid [nmi]: masses, places [m]
    about 36N 070W, cell areas [m2].
    """
    geod = pyproj.Geod(a=oracle.R, b=oracle.R)
    side = np.arange(-170, 170, spacing) + spacing / 2
    east, north = (one.ravel() * NMI for one in np.meshgrid(side, side))
    lat = 36 + north / oracle.R / oracle.DEG
    lon = -70 + east / oracle.R / oracle.DEG / np.cos(36 * oracle.DEG)
    area = (spacing * NMI) ** 2 * np.cos(lat * oracle.DEG) / np.cos(36 * oracle.DEG)
    told = table(name)

    def seen(by: dict[str, Any], at: str) -> tuple[Array, Array]:
        """Return the chance of being detected at once, and the bearing [deg]."""
        x, y = place(at)
        bearing, _, far = geod.inv(np.full(lon.size, x), np.full(lon.size, y), lon, lat)
        return chance(by, np.asarray(bearing), np.asarray(far)), np.asarray(bearing)

    prior = told["scenario"][0]["position"]
    watch, contact = told["sortie"][0]["watch"], told["contact"][0]["bearing"]
    stands = {sensor["name"]: sensor for sensor in told.get("sensor", [])}
    x, y = (np.full(lon.size, one) for one in place(prior["at"]))
    far = np.asarray(geod.inv(x, y, lon, lat)[2])
    first, _ = seen(watch, stands.get(watch.get("sensor"), watch)["at"])
    heard, bearing = seen(contact, contact.get("from") or stands[contact["sensor"]]["at"])
    # What lies still for the hour is heard at once, or when its fluctuation jumps to where it is:
    # (1 - p) e^(-l p T).
    jumps = [float(sensor["sonar"]["jump_rate"].split()[0]) for sensor in stands.values()]
    missed = (1 - first) * np.exp(-(jumps[0] if jumps else 0.0) * first)
    off = (bearing - contact["bearing"] + 180) % 360 - 180
    likely = np.exp(
        -0.5 * (far / metres(prior["std"])) ** 2
        - 0.5 * (off / float(contact["std"].split()[0])) ** 2
    )
    mass = likely * missed * heard * area
    return mass / mass.sum(), np.stack([east, north], axis=1), area


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("name", "chance"), [("convergence_zones", zoned), ("sound_channel", by_ear)]
)
def test_buoys_are_bayes_on_a_grid(name: str, chance: Hearing) -> None:
    """Mean and share of each cell of a coarse grid, within standard errors of self-normalised
    weights.
    """
    mass, where, _ = bayes(name, 0.8, chance)
    loaded = case_file.load(
        name, {"particles": "100_000", "output": '{ every = "100 d", trajectories = 1_000_000 }'}
    )
    tracks = flow.run(loaded).trajectories
    places = flat(
        *(x[:, -1].astype(float) * 360 / 2**32 for x in (tracks.lon, tracks.lat)), (-70.0, 36.0)
    )
    weight = tracks.weight[:, -1] / tracks.weight[:, -1].sum()
    mean = weight @ places
    error = np.sqrt((weight**2) @ (places - mean) ** 2)
    assert (np.abs(mean - mass @ where) < SIGMAS * error).all(), (mean, mass @ where, error)
    edges = [np.linspace(-60, 60, 13) * NMI] * 2
    expected, found, squares = (
        np.histogram2d(*at.T, edges, weights=w)[0]
        for at, w in ((where, mass), (places, weight), (places, weight**2))
    )
    many = expected > 0.01
    assert many.sum() >= 6
    # Var of a share p by self-normalised weights: (1 - 2 p) sum w^2 inside + p^2 sum w^2
    variance = (1 - 2 * expected) * squares + expected**2 * (weight**2).sum()
    assert (np.abs(found - expected)[many] < SIGMAS * np.sqrt(variance[many])).all()
