"""Clouds and units for tests of plans: positions by a low-discrepancy sequence, so that a cloud's
noise is small.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy import special
from scipy.stats import qmc

import drift
from drift.evidence.filter.records import Law, PlanSpec, Unit
from drift.planning.search import optimiser
from drift.planning.search.planning_tracks import Tracks
from geo import sphere

NMI, HOUR = 1852.0, 3600.0
BEGIN = np.datetime64("2024-03-20T06:00:00", "s")
PLACE = (179.98, -41.0)  # across the antimeridian, south, lon unlike lat


# The sea of cases on which plans are tried, but for their scenarios and units.
SEA = """
[output]
every = "{every} h"
[clock]
step = "30 min"
[coast]
source = "none"
[[current]]
constant = { speed = "0.6 kn", toward = 70 }
[uncertainty]
diffusivity = "20 m2/s"
"""


# How little the optimiser tries where a test asks what a plan says of itself, not how good it is.
FEW_TRIALS = {
    "FEW": 1000,
    "MORE": 1500,
    "BEGINNINGS": 1,
    "KICKS": 1,
    "ROUNDS": 2,
    "DRAWN": 192,
    "CHILDREN": 32,
}


@contextmanager
def after_few_trials() -> Iterator[None]:
    """Plan after few trials."""
    with pytest.MonkeyPatch.context() as patch:
        for name, number in FEW_TRIALS.items():
            patch.setattr(optimiser, name, number)
        yield


@pytest.fixture(scope="module")
def few_trials() -> Iterator[None]:
    """Plans after few trials, in a whole file of tests."""
    with after_few_trials():
        yield


def loaded(folder: Path, text: str) -> drift.Case:
    """Return the case that a text describes, in a file of a folder."""
    (folder / "case.toml").write_text(text)
    return drift.load(folder / "case.toml")


def cloud(
    m: int,
    std: float,
    *,
    hours: float = 4.0,
    bins: int = 4,
    drift: tuple[float, float] = (0.0, 0.0),
) -> Tracks:
    """Return a circular normal cloud of a standard deviation [m] that drifts [m/s] as one."""
    points = np.clip(qmc.Sobol(2, scramble=True, rng=3).random(m), 1e-9, 1 - 1e-9)
    x, y = std * special.ndtri(points).T
    return tracks(x, y, hours, bins, drift)


def tracks(
    x: np.ndarray, y: np.ndarray, hours: float, bins: int, drift: tuple[float, float]
) -> Tracks:
    """Return particles that start at (x, y) [m] of PLACE and drift [m/s] as one."""
    time = np.linspace(0, hours * HOUR, bins + 1)[:, None]
    lon, lat = sphere.destination(*np.radians(PLACE), x + drift[0] * time, y + drift[1] * time)
    begin = float(BEGIN.astype(np.int64))
    m = len(x)
    return Tracks(
        time=begin + time[:, 0],
        lon=sphere.to_binary(np.degrees(lon)),
        lat=sphere.to_binary(np.degrees(lat)),
        adrift=np.ones(lon.shape, bool),
        weight=np.full(m, 1 / m),
        scenario=np.zeros(m, np.int32),
        release=np.full(m, begin),
    )


def moving(
    m: int, std: float, error: float, convergence: float, hours: float, key: int = 5
) -> Tracks:
    """Return a normal cloud of a standard deviation [m] that an error [m/s] of 6 h spreads, in a
    current that converges [1/s].

    It diverges across that by half as much, and drifts. The motion is that of an Ornstein-Uhlenbeck
    process in float64.
    """
    rng = np.random.default_rng(key)
    bins, steps = int(min(48, hours * 12)), 4
    dt = hours * HOUR / bins / steps
    place, velocity = std * rng.standard_normal((2, m)), error * rng.standard_normal((2, m))
    keep = np.exp(-dt / (6 * HOUR))
    at = [place]
    for k in range(bins * steps):
        later = keep * velocity + error * np.sqrt(1 - keep**2) * rng.standard_normal((2, m))
        flow = np.array([[0.3], [-0.2]]) + convergence * np.array([[-1.0], [0.5]]) * place
        place, velocity = place + dt * ((velocity + later) / 2 + flow), later
        if (k + 1) % steps == 0:
            at.append(place)
    still = tracks(*place, hours, bins, (0.0, 0.0))
    x, y = np.moveaxis(np.array(at), 1, 0)
    lon, lat = (
        sphere.to_binary(np.degrees(v)) for v in sphere.destination(*np.radians(PLACE), x, y)
    )
    return replace(still, lon=lon, lat=lat)


def steered(
    time: np.ndarray, x: np.ndarray, y: np.ndarray, turn: np.ndarray | float = np.inf
) -> Tracks:
    """Return particles that steer, at x, y [m] of PLACE at times [s], (edges, m), until each goes
    adrift [s].
    """
    still = tracks(x[0], y[0], 1.0, len(time) - 1, (0.0, 0.0))
    lon, lat = (
        sphere.to_binary(np.degrees(v)) for v in sphere.destination(*np.radians(PLACE), x, y)
    )
    begin = float(BEGIN.astype(np.int64))
    return replace(
        still, time=begin + time, lon=lon, lat=lat, turn=np.broadcast_to(begin + turn, x.shape[1:])
    )


def unit(speed: float, hours: float, width: float, law: Law, **more: object) -> Unit:
    """Return a unit based in the middle that searches for some hours: speed [m/s], sweep width [m]."""
    told: dict[str, object] = {
        "name": "A", "kind": "Aircraft", "base": PLACE, "return_to": PLACE, "ready": BEGIN, "search_speed": speed,
        "transit_speed": 1e7, "endurance": hours * HOUR / 0.85, "law": law, "sweep_width": (width,), "daylight": False,
    }  # fmt: skip
    return Unit(**{**told, **more})  # type: ignore[arg-type]


def spec(hours: float = 4.0, **more: object) -> PlanSpec:
    """Return a plan of some hours."""
    return PlanSpec(BEGIN, BEGIN + np.timedelta64(round(hours * HOUR), "s"), **more)  # type: ignore[arg-type]


def speed_for(u: float, std: float, hours: float, width: float) -> float:
    """Return the speed at which W v T = u^2 pi s^2."""
    return u * u * np.pi * std * std / (width * hours * HOUR)
