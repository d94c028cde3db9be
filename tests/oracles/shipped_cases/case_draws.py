"""What shipped cases state, read as it stands: places, objects and the particles drawn from them."""

import csv
import re
import tomllib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import oracle
import shapely
from oracle import HOUR, NMI, Array, Cloud, Coast, Errors, Field
from places import ROOT

CASES = ROOT / "cases"
START = {
    "overdue_boat": "2026-11-21T18:30",
    "overdue_yacht": "2026-10-14T18:00",
    "gulf_containers": "1973-11-01T12:00",
    "norkyst_raft": "2015-11-16T00:00",
    "washington_piw": "2023-03-02T12:00",
    "washington_drums": "2023-03-02T12:00",
    "biscay_drifter": "2021-03-13T00:00",
    "paria_boat": "2017-04-23T00:00",
    "paria": "2017-04-23T12:00",
}
MODEL = Errors((0.31, 11 * HOUR), (2.0, 12 * HOUR))  # the defaults of docs/errors.md
MODEL_BIAS = 0.08


def table(name: str) -> dict[str, Any]:
    """Return a case's tables as written."""
    return tomllib.loads((CASES / f"{name}.toml").read_text())


def place(text: str) -> tuple[float, float]:
    """Return longitude and latitude [deg] of a text like 27 54.5N 088 34.0W or 45.0420N 2.7662W."""
    (lat, ns), (lon, ew) = re.findall(r"([\d. ]+)([NSEW])", text)
    degrees = [sum(float(part) / 60**k for k, part in enumerate(one.split())) for one in (lat, lon)]
    return degrees[1] * (-1 if ew == "W" else 1), degrees[0] * (-1 if ns == "S" else 1)


def metres(text: str) -> float:
    """Return a length like 5 nmi in metres."""
    value, unit = text.split()
    return float(value) * {"nmi": NMI, "m": 1.0, "km": 1000.0}[unit]


def normal(
    rng: np.random.Generator, at: str, n: int, along: float, across: float, turn: float
) -> tuple[Array, Array]:
    """Return places about a reported one; standard deviations [m] along and across a direction [deg
    from north].
    """
    a, b = along * rng.standard_normal(n), across * rng.standard_normal(n)
    s, c = np.sin(np.radians(turn)), np.cos(np.radians(turn))
    lon, lat = place(at)
    return oracle.moved(np.full(n, lon), np.full(n, lat), a * s + b * c, a * c - b * s)


def inside(rng: np.random.Generator, corners: list[str], n: int) -> tuple[Array, Array]:
    """Return places uniform in true area inside a polygon with straight sides in longitude and
    latitude.
    """
    shape = shapely.Polygon([place(one) for one in corners])
    west, south, east, north = shape.bounds
    lon, lat = np.empty(0), np.empty(0)
    while lon.size < n:
        x, sine = rng.uniform(west, east, n), rng.uniform(*np.sin(np.radians([south, north])), n)
        y = np.degrees(np.arcsin(sine))
        keep = shapely.contains_xy(shape, x, y)
        lon, lat = np.append(lon, x[keep]), np.append(lat, y[keep])
    return lon[:n], lat[:n]


def leeway(rng: np.random.Generator, n: int, name: str) -> tuple[Array, Array, Array]:
    """Return leeway lines of n objects of a class of the project's table, read as it stands."""
    text = (CASES.parent / "drift" / "data" / "leeway.csv").read_text()
    rows = csv.DictReader(line for line in text.splitlines() if not line.startswith("#"))
    row = next(row for row in rows if row["name"] == name)
    numbers = {
        key: float(row[key]) for key in row if key.rpartition("_")[2] in ("slope", "offset", "std")
    }
    return oracle.lines(rng, n, numbers)


def cloud(
    rng: np.random.Generator,
    where: tuple[Array, Array],
    release: tuple[float, float] | Array,
    name: str | None,
    bias: float,
    coast: Coast | None,
    again: Callable[[int], tuple[Array, Array]],
) -> Cloud:
    """Return particles in water: what lies on land is drawn again. release: earliest and latest
    [s]; name: None for water.
    """
    lon, lat = where
    n = lon.size
    while coast is not None and (dry := coast.on_land(lon, lat)).any():
        x, y = again(n)
        lon[dry], lat[dry] = x[dry], y[dry]
    times = release if isinstance(release, np.ndarray) else rng.uniform(*release, n)
    still = np.zeros((2, n))
    down, right, left = leeway(rng, n, name) if name else (still, still, still)
    side = rng.choice([-1, 1], n)
    return Cloud(
        lon,
        lat,
        times,
        down,
        right,
        left,
        side,
        bias * rng.standard_normal((2, n)),
        np.full(n, np.inf),
    )


@dataclass(frozen=True)
class World:
    """What a case drifts in, and one cloud a scenario, all by the oracle."""

    clouds: list[Cloud]
    duration: float
    current: Field
    wind: Field | None
    errors: Errors
    coast: Coast | None
    step: float = 1200.0


def start(name: str) -> np.datetime64:
    """Return when a case starts."""
    return np.datetime64(START[name], "ns")


def since_2000(name: str) -> float:
    """Return a case's start on the clock of the built-in flows [s]."""
    return float((start(name) - np.datetime64("2000-01-01T00:00", "ns")) / np.timedelta64(1, "s"))
