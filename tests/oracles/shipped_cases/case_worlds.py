"""The oracle's worlds of the shipped cases: particles, forcing, errors and coast."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import oracle
import oracle_forcing
import passages
import pyproj
import pytest
import xarray as xr
from case_answers import FATES, THEIRS
from case_draws import (
    MODEL,
    MODEL_BIAS,
    World,
    cloud,
    inside,
    metres,
    normal,
    place,
    since_2000,
    start,
    table,
)
from oracle import DAY, HOUR, KNOT, NMI, Array, Cloud, Coast, Errors, Field

from drift.engine.particles.status import Status

HALF = np.sqrt(2 * np.log(2))  # radius that holds half of a round normal, in standard deviations


def overdue_boat(rng: np.random.Generator, n: int) -> World:
    """Three scenarios in the built-in Gulf."""
    told, zero = table("overdue_boat"), since_2000("overdue_boat")
    coast = oracle.gshhg(-93, 25, -84, 31)
    report, swamped, passage = told["scenario"]

    def first(n: int) -> tuple[Array, Array]:
        std = metres(report["position"]["error"]) / HALF
        lon, lat = normal(rng, report["position"]["at"], n, std, std, 0)
        far, to = rng.uniform(0, 10 * NMI, n), np.radians(rng.uniform(90, 200, n))
        return oracle.moved(lon, lat, far * np.sin(to), far * np.cos(to))

    def second(n: int) -> tuple[Array, Array]:
        return inside(rng, swamped["area"]["polygon"], n)

    legs = np.array([place(one) for one in passage["trackline"]["waypoints"]])
    geod = pyproj.Geod(a=oracle.R, b=oracle.R)
    course, _, length = geod.inv(*legs[:-1].T, *legs[1:].T)
    ends = np.concatenate([[0.0], np.cumsum(length)])
    share = rng.triangular(0, 0.6, 1, n)

    def third(n: int) -> tuple[Array, Array]:
        leg = np.searchsorted(ends[1:-1], share * ends[-1])
        lon, lat, back = geod.fwd(*legs[leg].T, course[leg], share * ends[-1] - ends[leg])
        to, off = np.radians(np.asarray(back) - 180), 2 * NMI * rng.standard_normal(n)
        return oracle.moved(np.asarray(lon), np.asarray(lat), off * np.cos(to), -off * np.sin(to))

    def made(draw: Callable[[int], tuple[Array, Array]], release: Any, name: str) -> Cloud:
        return cloud(rng, draw(n), release, name, 0.08, coast, draw)

    clouds = [
        made(first, (7.5 * HOUR, 7.5 * HOUR), report["object"]),
        made(second, (4 * HOUR, 10 * HOUR), swamped["object"]),
        made(third, share * ends[-1] / (8 * KNOT), passage["object"]),
    ]
    wind = oracle_forcing.breeze(zero, -88.7)
    errors = Errors((0.31, 11 * HOUR), (2.0, 12 * HOUR))
    return World(
        clouds, 54 * HOUR, oracle_forcing.gulf(zero, -94, 23, -83, 32), wind, errors, coast, 1800.0
    )


def norkyst_raft(rng: np.random.Generator, n: int, data: Path) -> World:
    """A raft on two projections' planes."""
    coast, begin = oracle.gshhg(1, 58, 8, 63), start("norkyst_raft")
    with (
        xr.open_dataset(data / "norkyst" / "norkyst800_subset_16Nov2015.nc") as sea,
        xr.open_dataset(data / "norkyst" / "arome_subset_16Nov2015.nc") as air,
    ):
        u, v = (sea[k].values[:, 0].astype(float) for k in "uv")
        current = oracle_forcing.projected(
            oracle_forcing.after(sea, begin),
            sea["X"].values,
            sea["Y"].values,
            u,
            v,
            sea["projection_stere"].attrs["proj4"],
        )
        u, v = (air[f"{k}_wind_10m"].values.astype(float) for k in "xy")
        wind = oracle_forcing.projected(
            oracle_forcing.after(air, begin), air["x"].values.astype(float), air["y"].values.astype(float), u, v,
            air["projection_lambert"].attrs["proj4"],
        )  # fmt: skip
    told = table("norkyst_raft")["scenario"][0]

    def draw(n: int) -> tuple[Array, Array]:
        return normal(rng, told["position"]["at"], n, 2 * NMI, 1 * NMI, 340)

    one = cloud(rng, draw(n), (0, 0), told["object"], MODEL_BIAS, coast, draw)
    return World([one], 24 * HOUR, current, wind, MODEL, coast)


def biscay_drifter(rng: np.random.Generator, n: int, data: Path) -> World:
    """A water particle; u and v on their own points, 12 hours apart."""
    begin, told = start("biscay_drifter"), table("biscay_drifter")["scenario"][0]
    parts = {}
    for k in "uv":
        with xr.open_dataset(data / "biscay" / f"hycom.gdp.{k}.nc") as sea:
            lon, lat = sea["lon"].values[0].astype(float), sea["lat"].values[:, 0].astype(float)
            assert np.ptp(sea["lon"].values, axis=0).max() == 0  # its curved grid has straight axes
            assert np.ptp(sea["lat"].values, axis=1).max() == 0
            values = sea[k].values[:, 0].astype(float)
            parts[k] = oracle_forcing.axes(
                oracle_forcing.after(sea, begin), lon, lat, values, values
            )

    def current(t: Any, x: Array, y: Array) -> tuple[Array, Array]:
        u, v = parts["u"](t, x, y)[0], parts["v"](t, x, y)[1]
        return u + 0 * v, v + 0 * u

    def draw(n: int) -> tuple[Array, Array]:
        return normal(rng, told["position"]["at"], n, 300, 300, 0)

    return World(
        [cloud(rng, draw(n), (0, 0), None, MODEL_BIAS, None, draw)],
        12 * HOUR,
        current,
        None,
        MODEL,
        None,
    )


def washington(data: Path) -> tuple[Field, Field]:
    """HYCOM and GFS."""
    made = []
    for name, k in (("gridded_current", "water"), ("gridded_wind", "air")):
        with xr.open_dataset(data / "washington" / f"{name}.nc") as file:
            u, v = (file[f"{k}_{c}"].values.astype(float) for c in "uv")
            lon, lat = (file[c].values.astype(float) for c in ("lon", "lat"))
            made.append(
                oracle_forcing.axes(
                    oracle_forcing.after(file, start("washington_piw")), lon, lat, u, v
                )
            )
    return made[0], made[1]


def washington_piw(rng: np.random.Generator, n: int, data: Path) -> World:
    """Two scenarios of a person off Washington."""
    coast, told = oracle.gshhg(-127, 46, -122, 50), table("washington_piw")["scenario"]
    jacket, suit = (one["position"] for one in told)

    def first(n: int) -> tuple[Array, Array]:
        return normal(rng, jacket["at"], n, 3 * NMI / HALF, 1.5 * NMI / HALF, 20)

    def second(n: int) -> tuple[Array, Array]:
        return normal(rng, suit["at"], n, 2 * NMI / HALF, 2 * NMI / HALF, 0)

    clouds = [
        cloud(rng, draw(n), window, one["object"], MODEL_BIAS, coast, draw)
        for one, draw, window in zip(told, (first, second), ((0, 0), (0, 3 * HOUR)), strict=True)
    ]
    return World(clouds, 36 * HOUR, *washington(data), MODEL, coast)


def paria_forcing(data: Path, name: str) -> tuple[Field, Field]:
    """Mercator and ECMWF, one file a day."""
    made = []
    for pattern, u, v in (("Sea_Med_slice_*", "uo", "vo"), ("Wind_Med_slice_*", "U10M", "V10M")):
        files = []
        for path in sorted((data / "paria").glob(f"{pattern}_Paria.nc")):
            with xr.open_dataset(path) as one:
                files.append((one.isel(depth=0) if "depth" in one.dims else one)[[u, v]].load())
        whole = xr.concat(files, "time")
        lon, lat = (whole[c].values.astype(float) for c in ("lon", "lat"))
        made.append(
            oracle_forcing.axes(
                oracle_forcing.after(whole, start(name)), lon, lat, whole[u].values, whole[v].values
            )
        )
    return made[0], made[1]


def paria_boat(rng: np.random.Generator, n: int, data: Path) -> World:
    """Two scenarios of a fishing boat."""
    coast, told = oracle.gshhg(-67, 8, -61, 14), table("paria_boat")["scenario"]

    def first(n: int) -> tuple[Array, Array]:
        return inside(rng, told[0]["area"]["polygon"], n)

    def second(n: int) -> tuple[Array, Array]:
        return normal(rng, told[1]["position"]["at"], n, 4 * NMI / HALF, 4 * NMI / HALF, 0)

    clouds = [
        cloud(rng, draw(n), window, one["object"], MODEL_BIAS, coast, draw)
        for one, draw, window in zip(told, (first, second), ((0, 12 * HOUR), (0, 0)), strict=True)
    ]
    return World(clouds, 72 * HOUR, *paria_forcing(data, "paria_boat"), MODEL, coast)


def objects(
    rng: np.random.Generator, n: int, spill: dict[str, Any], kind: dict[str, Any], coast: Coast, window: float,
    lasting: float, bias: float,
) -> Cloud:  # fmt: skip
    """Return one object of one class in each of n worlds."""
    std = metres(spill["position"]["error"]) / HALF

    def draw(n: int) -> tuple[Array, Array]:
        lon, lat = normal(rng, spill["position"]["at"], n, std, std, 0)
        while (dry := coast.on_land(lon, lat)).any():
            x, y = normal(rng, spill["position"]["at"], n, std, std, 0)
            lon[dry], lat[dry] = x[dry], y[dry]
        s = metres(spill["release_std"])
        return oracle.moved(lon, lat, s * rng.standard_normal(n), s * rng.standard_normal(n))

    release = rng.uniform(0, window, n) + rng.uniform(0, lasting, n)
    one = cloud(rng, draw(n), release, None, bias, coast, draw)
    under = rng.uniform(*kind["object"]["immersion"], n)
    slope = (
        np.sqrt(1.225 / 1025)
        * np.sqrt((1 - under) / under)
        * np.exp(spill["windage_bias"] * rng.standard_normal(n))
    )
    sinks = np.full(n, np.inf)
    for law, times in kind.get("sinking", {}).items():
        if law == "spread":
            continue
        low, high = (float(x.split()[0]) * {"d": DAY, "h": HOUR}[x.split()[1]] for x in times)
        middle = np.exp(rng.uniform(np.log(low), np.log(high), n))
        spread = np.log(kind["sinking"].get("spread", 1.5))
        after = middle * np.exp(spread * rng.standard_normal(n))
        sinks = release + (
            middle * rng.exponential(1 / np.log(2), n) if law == "half_life" else after
        )
    return replace(one, down=np.stack([slope, 0 * slope]), sinks=sinks)


def washington_drums(rng: np.random.Generator, n: int, data: Path) -> World:
    """Drums, each class of a world of its own."""
    spill = table("washington_drums")["spill"]
    coast = oracle.bna(data / "washington" / "wa_coast.bna", -127, 46, -122, 50)
    clouds = [
        objects(rng, n, spill, kind, coast, 2 * HOUR, 0.5 * HOUR, MODEL_BIAS)
        for kind in spill["class"]
    ]
    return World(clouds, 36 * HOUR, *washington(data), MODEL, coast)


def paria(rng: np.random.Generator, n: int, data: Path) -> World:
    """Containers, which stay where they strand."""
    spill, coast = table("paria")["spill"], oracle.gshhg(-67, 8, -61, 14)
    clouds = [
        objects(rng, n, spill, kind, coast, 6 * HOUR, 1 * HOUR, MODEL_BIAS)
        for kind in spill["class"]
    ]
    return World(clouds, 5 * DAY, *paria_forcing(data, "paria"), MODEL, coast, 1800.0)


def gulf_containers(rng: np.random.Generator, n: int) -> World:
    """Containers of 1973 in the built-in Gulf."""
    spill, zero = table("gulf_containers")["spill"], since_2000("gulf_containers")
    coast = oracle.gshhg(-99, 23, -83, 32)
    clouds = [
        objects(rng, n, spill, kind, coast, 6 * HOUR, 2 * HOUR, 0.08) for kind in spill["class"]
    ]
    errors = Errors((0.12, 12 * HOUR), (1.5, 6 * HOUR), 10.0)
    current = oracle_forcing.gulf(zero, -99, 23, -83, 32)
    return World(
        clouds, 10 * DAY, current, oracle_forcing.breeze(zero, -91.0), errors, coast, 3600.0
    )


def overdue_yacht(rng: np.random.Generator, n: int) -> list[tuple[Array, Array, Array, Array]]:
    """Return where the yachts of three scenarios are at the end (lon, lat), what has become of
    each, and when it arrived [s]; never: inf.

    Under way along great circles, until the distress; then adrift, where they were.
    """
    told, zero = table("overdue_yacht"), since_2000("overdue_yacht")
    coast = oracle.gshhg(-92, 24, -81, 32)
    current, wind = oracle_forcing.gulf(zero, -94, 22, -80, 32), oracle_forcing.breeze(zero, -88.7)
    begin, until = start("overdue_yacht"), 84 * HOUR

    def after(text: str) -> float:
        day, hour, minute = int(text[:2]), int(text[2:4]), int(text[4:6])
        return float((day - 14) * DAY + (hour - 18) * HOUR + minute * 60)

    assert begin == np.datetime64("2026-10-14T18:00", "ns")
    found = []
    for story in told["scenario"]:
        voyage = story["phase"][0]["voyage"]
        points = [place(one) for one in voyage["waypoints"]]
        side = rng.standard_normal(n)
        lon, lat, along = passages.aside(
            points, [2 * metres(voyage["cross_track"])] * (len(points) - 1), side
        )
        speed = voyage["speed"]
        if isinstance(speed, dict):
            low, best, high = (float(speed[k].split()[0]) for k in ("low", "best", "high"))
            pace = passages.triangle(rng, n, low, best, high, speed["ratio"]) * KNOT
        else:
            pace = rng.uniform(*(float(one.split()[0]) for one in speed), n) * KNOT
        time = rng.uniform(0, 3 * HOUR, n)[:, None] + along / pace[:, None]
        distress, arrived = np.full(n, np.inf), time[:, -1]
        if "part" in story.get("distress", {}):
            distress = time[:, 0] + rng.uniform(0, 1, n) * along[-1] / pace
        elif "distress" in story:
            law = story["distress"]["between"]
            times = (after(law[k]) for k in ("earliest", "best", "latest"))
            distress = passages.triangle(rng, n, *times, law["ratio"])
        x, y = passages.passed(lon, lat, time, np.minimum(distress, until))
        fate = np.where(arrived < np.minimum(distress, until), Status.ARRIVED, Status.UNDER_WAY)
        if np.isfinite(distress).any():
            goes = distress < arrived
            one = cloud(
                rng,
                (x[goes], y[goes]),
                distress[goes],
                story["object"],
                0.08,
                None,
                lambda n: (np.empty(n),) * 2,
            )
            x[goes], y[goes], became = oracle.run(
                rng, one, until, current, wind, MODEL, coast, 1800.0
            )
            fate[goes] = [FATES[str(kind)] for kind in became]
        found.append((x, y, fate, np.where(fate == Status.ARRIVED, arrived, np.inf)))
    return found


BUILT_IN = ("overdue_boat", "gulf_containers")


def world_of(
    name: str,
    rng: np.random.Generator,
    request: pytest.FixtureRequest,
    monkeypatch: pytest.MonkeyPatch,
) -> tuple[World, tuple[float, float]]:
    """Return the oracle's world of a case, and the place [deg] about which both are laid flat."""
    if name in BUILT_IN:
        world = globals()[name](rng, THEIRS)
    else:
        data = request.getfixturevalue("data")
        monkeypatch.setenv("DRIFT_DATA", str(data))
        world = globals()[name](rng, THEIRS, data)
    return world, (float(world.clouds[0].lon.mean()), float(world.clouds[0].lat.mean()))
