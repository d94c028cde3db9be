"""Every shipped case against a second opinion in plain float64 (tests/oracles/oracle.py): drift
without sorties and finds, then sorties.

No oracle is had for worlds that finds weigh (gulf_containers) and for what refloats (paria): here
they run without. The areas of what is partly ashore are none either: they hold cells of the map
along a line.
"""

import csv
import itertools
import re
import tomllib
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import oracle
import passages
import pytest
import shapely
import shipped
import xarray as xr
from oracle import DAY, HOUR, KNOT, NMI, Array, Cloud, Coast, Errors, Field
from places import ROOT
from scipy import interpolate, stats

from drift.case import file as case_file
from drift.engine.particles.status import Status
from drift.pipeline import flow

CASES = ROOT / "cases"
OURS, THEIRS = 10_000, 2_500  # particles, in all; a scenario
HALF = np.sqrt(2 * np.log(2))  # radius that holds half of a round normal, in standard deviations
# numbers that this file compares; three standard errors on each would be exceeded by chance once in
# three files
COMPARED = 170
SIGMAS = stats.norm.isf(
    stats.norm.sf(3.0) / COMPARED
)  # 4.3: all of them together are as sure as three hold one (Bonferroni)
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
    geod = oracle.pyproj.Geod(a=oracle.R, b=oracle.R)
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
    wind = oracle.breeze(zero, -88.7)
    errors = Errors((0.31, 11 * HOUR), (2.0, 12 * HOUR))
    return World(
        clouds, 54 * HOUR, oracle.gulf(zero, -94, 23, -83, 32), wind, errors, coast, 1800.0
    )


def norkyst_raft(rng: np.random.Generator, n: int, data: Path) -> World:
    """A raft on two projections' planes."""
    coast, begin = oracle.gshhg(1, 58, 8, 63), start("norkyst_raft")
    with (
        xr.open_dataset(data / "norkyst" / "norkyst800_subset_16Nov2015.nc") as sea,
        xr.open_dataset(data / "norkyst" / "arome_subset_16Nov2015.nc") as air,
    ):
        u, v = (sea[k].values[:, 0].astype(float) for k in "uv")
        current = oracle.projected(
            oracle.after(sea, begin),
            sea["X"].values,
            sea["Y"].values,
            u,
            v,
            sea["projection_stere"].attrs["proj4"],
        )
        u, v = (air[f"{k}_wind_10m"].values.astype(float) for k in "xy")
        wind = oracle.projected(
            oracle.after(air, begin), air["x"].values.astype(float), air["y"].values.astype(float), u, v,
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
            parts[k] = oracle.axes(oracle.after(sea, begin), lon, lat, values, values)

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
            made.append(oracle.axes(oracle.after(file, start("washington_piw")), lon, lat, u, v))
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
            oracle.axes(
                oracle.after(whole, start(name)), lon, lat, whole[u].values, whole[v].values
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
    current = oracle.gulf(zero, -99, 23, -83, 32)
    return World(clouds, 10 * DAY, current, oracle.breeze(zero, -91.0), errors, coast, 3600.0)


def overdue_yacht(rng: np.random.Generator, n: int) -> list[tuple[Array, Array, Array, Array]]:
    """Return where the yachts of three scenarios are at the end (lon, lat), what has become of
    each, and when it arrived [s]; never: inf.

    Under way along great circles, until the distress; then adrift, where they were.
    """
    told, zero = table("overdue_yacht"), since_2000("overdue_yacht")
    coast = oracle.gshhg(-92, 24, -81, 32)
    current, wind = oracle.gulf(zero, -94, 22, -80, 32), oracle.breeze(zero, -88.7)
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


@pytest.mark.thorough
def test_yachts_are_where_a_second_opinion_says() -> None:
    """Shares, means and second moments 84 h after the departure, under way, adrift, ashore and in
    port.
    """
    theirs = overdue_yacht(np.random.default_rng(20_260_605), 3_000)
    settings = {"particles": "24_000", "output": '{ every = "100 d", trajectories = 1_000_000 }'}
    result = flow.run(case_file.load("overdue_yacht", settings))
    assert shipped.misses(result) == []
    tracks = result.trajectories
    kinds = (Status.ADRIFT, Status.ASHORE, Status.UNDER_WAY, Status.ARRIVED)

    def told(lon: Array, lat: Array, fate: Array) -> tuple[Array, Array]:
        x, y = flat(lon, lat, (-85.0, 28.8)).T
        a, b = x - x.mean(), y - y.mean()
        columns = np.stack([*(fate == kind for kind in kinds), x, y, a * a, b * b, a * b], axis=1)
        return columns.mean(axis=0), columns.std(axis=0) / np.sqrt(lon.size)

    for number, (x, y, fate, _) in enumerate(theirs):
        mine = tracks.scenario == number
        lon, lat = (at[mine, -1].astype(float) * 360 / 2**32 for at in (tracks.lon, tracks.lat))
        (here, e), (there, f) = told(lon, lat, tracks.status[mine, -1]), told(x, y, fate)
        apart = (here - there) / np.maximum(np.hypot(e, f), 1e-300)
        assert (np.abs(apart[here != there]) < SIGMAS).all(), (number, here, there, apart)


FATES = {
    oracle.ADRIFT: Status.ADRIFT,
    oracle.ASHORE: Status.ASHORE,
    oracle.OUTSIDE: Status.OUTSIDE,
    oracle.SUNK: Status.SUNK,
}


@dataclass(frozen=True)
class Told:
    """Where the particles of one scenario are at the end: places [m] in a plane, what became of
    each, and its world's number.
    """

    places: Array  # (n, 2)
    became: Array  # (n,) of FATES
    world: Array  # (n,) particles of one number are not independent


def theirs(world: World, rng: np.random.Generator, about: tuple[float, float]) -> list[Told]:
    """Return what the oracle says, a scenario each."""
    told = []
    for one in world.clouds:
        lon, lat, became = oracle.run(
            rng,
            one,
            world.duration,
            world.current,
            world.wind,
            world.errors,
            world.coast,
            world.step,
        )
        codes = np.array([FATES[fate] for fate in became])
        told.append(Told(flat(lon, lat, about), codes, np.arange(lon.size)))
    return told


def flat(lon: Array, lat: Array, about: tuple[float, float]) -> Array:
    """Return positions [deg] in an even-distance plane about one [m], shape (n, 2)."""
    scale = oracle.R * np.pi / 180
    return np.stack(
        [(lon - about[0]) * scale * np.cos(np.radians(about[1])), (lat - about[1]) * scale], axis=1
    )


def ours(
    name: str, about: tuple[float, float], settings: dict[str, str]
) -> tuple[list[Told], list[Array]]:
    """Return what drift.run says without finds, and the weights of its particles, by scenario."""
    spill = "spill" in table(name)
    few = {"spill.worlds": "1000", "spill.per_world": "20"} if spill else {"particles": str(OURS)}
    output = '{ every = "100 d", trajectories = 1_000_000 }'
    loaded = case_file.load(name, few | {"find": "[]", "output": output} | settings)
    result = flow.run(loaded)
    if name in shipped.COMPARED:
        assert shipped.misses(result) == []
    tracks = result.trajectories
    told, weights = [], []
    for number in range(len(loaded.scenarios)):
        here = tracks.scenario == number
        lon, lat = (x[here, -1].astype(float) * 360 / 2**32 for x in (tracks.lon, tracks.lat))
        slot = tracks.slot[here] - tracks.slot[here].min()
        # a class has its particles world after world
        world = slot // (len(slot) // 1000) if spill else slot
        told.append(Told(flat(lon, lat, about), tracks.status[here, -1], world))
        weights.append(tracks.weight[here, -1].astype(float))
    return told, weights


def mean_and_error(values: Array, world: Array) -> tuple[Array, Array]:
    """Return the mean of columns and its standard error between worlds, shape (k,)."""
    count = np.bincount(world)
    sums = np.stack([np.bincount(world, column) for column in values.T], axis=1)[count > 0]
    count = count[count > 0]
    mean = sums.sum(axis=0) / count.sum()
    left = sums - count[:, None] * mean
    return mean, np.sqrt((left**2).sum(axis=0)) / count.sum()


def numbers(told: Told) -> tuple[Array, Array]:
    """Return shares adrift, ashore, outside, sunk; mean place; second moments about it; and their
    standard errors.
    """
    shares = mean_and_error(
        np.stack([told.became == fate for fate in FATES.values()], axis=1) + 0.0, told.world
    )
    there = (told.became == Status.ADRIFT) | (told.became == Status.ASHORE)
    xy, world = told.places[there], told.world[there]
    mean = mean_and_error(xy, world)
    x, y = (xy - mean[0]).T
    second = mean_and_error(np.stack([x * x, y * y, x * y], axis=1), world)
    return np.concatenate([shares[0], mean[0], second[0]]), np.concatenate(
        [shares[1], mean[1], second[1]]
    )


NAMES = (
    "adrift",
    "ashore",
    "outside",
    "sunk",
    "mean east",
    "mean north",
    "variance east",
    "variance north",
    "covariance",
)
BUILT_IN = ("overdue_boat", "gulf_containers")
UNSEARCHED = (
    "gulf_containers",
    "washington_piw",
    "biscay_drifter",
    "paria_boat",
    "paria",
    "washington_drums",
)


def agrees(ours: list[Told], theirs: list[Told]) -> None:
    """Shares, means and second moments by scenario; no room beside standard errors of the
    difference.
    """
    for a, b in zip(ours, theirs, strict=True):
        (here, e), (there, f) = numbers(a), numbers(b)
        apart = (here - there) / np.maximum(np.hypot(e, f), 1e-300)
        told = [
            f"{NAMES[k]}: {here[k]:.5g}, oracle {there[k]:.5g}: {z:+.1f} errors"
            for k, z in enumerate(apart)
        ]
        assert (np.abs(apart[here != there]) < SIGMAS).all(), told


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


@pytest.mark.thorough
@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=[pytest.mark.thorough] * (name != "washington_piw"))
        for name in UNSEARCHED
    ],
)
def test_case_is_what_a_second_opinion_says(
    name: str, request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch
) -> None:
    rng = np.random.default_rng(20_260_601)
    world, about = world_of(name, rng, request, monkeypatch)
    settings = {"sortie": "[]"} | ({"coast": "{}"} if name == "paria" else {})
    agrees(ours(name, about, settings)[0], theirs(world, rng, about))


def searched(
    name: str, world: World, rng: np.random.Generator, about: tuple[float, float]
) -> tuple[list[Told], list[Array]]:
    """Return what the oracle says of a case with its sorties: particles, and by scenario the chance
    that each was missed.

    How the sorties were flown (turning points, times, sweep widths by the tables) is the case's;
    what they say is not.
    """
    loaded, begin = case_file.load(name), start(name)
    origin = float((begin - np.datetime64(0, "s")) / np.timedelta64(1, "s"))
    told, chances = [], []
    for number, one in enumerate(world.clouds):
        tracks: list[Array] = []
        lon, lat, became = oracle.run(
            rng,
            one,
            world.duration,
            world.current,
            world.wind,
            world.errors,
            world.coast,
            world.step,
            tracks,
        )
        places, chance = np.array(tracks), np.ones(lon.size)
        for sortie in loaded.sorties:
            if sortie.legs is None:
                first, last = (
                    (t - begin) / np.timedelta64(1, "s") for t in (sortie.start, sortie.end)
                )
                shape, times = shapely.Polygon(sortie.area.ring), np.linspace(first, last, 41)
                within = np.zeros(lon.size)
                for t in 0.5 * (times[:-1] + times[1:]):
                    k = int(t // world.step)
                    x, y = places[k] + (t / world.step - k) * (places[k + 1] - places[k])
                    within += shapely.contains_xy(shape, x, y) / 40
                chance *= np.exp(-sortie.coverage[number] * within)
                continue
            time = np.array(sortie.legs.time) - origin
            unit, searching = (
                np.stack([sortie.legs.lon, sortie.legs.lat], axis=1),
                np.array(sortie.legs.searching),
            )
            if sortie.frame == "datum":
                time, unit, searching = drifting(world, time, unit, searching, sortie.datum)
            spread = 0.0 if np.isinf(sortie.shape) else sortie.shape**-0.5
            chance *= oracle.missed(
                oracle.exposure(places, world.step, time, unit, searching),
                sortie.sweep_width[number],
                spread,
            )
        codes = np.array([FATES[fate] for fate in became])
        chances.append(np.where(codes == Status.OUTSIDE, 1.0, chance))
        told.append(Told(flat(lon, lat, about), codes, np.arange(lon.size)))
    return told, chances


def drifting(
    world: World, time: Array, unit: Array, searching: Array, datum: tuple[float, float]
) -> tuple[Array, Array, Array]:
    """Return turning points, more of them, of legs that drift as water does from a datum."""
    fine = np.unique(np.concatenate([time, np.linspace(time[0], time[-1], 33)]))
    still = np.zeros((2, 1))
    marker = [np.array(datum)]
    for a, b in itertools.pairwise(fine):
        x, y = (np.array([one]) for one in marker[-1])
        cloud = Cloud(
            x, y, np.array([a]), still, still, still, np.ones(1), still, np.full(1, np.inf)
        )
        shifted: Field = lambda t, lon, lat, a=a: world.current(t + a, lon, lat)  # noqa: E731
        end = oracle.run(
            np.random.default_rng(0), replace(cloud, release=np.zeros(1)), b - a, shifted, None,
            Errors((0, 1), (0, 1)), None, b - a,
        )  # fmt: skip
        marker.append(np.array([end[0][0], end[1][0]]))
    way = np.array(marker) - np.array(datum)
    points = np.stack([np.interp(fine, time, one) for one in unit.T], axis=1) + way
    return (
        fine,
        points,
        searching[np.searchsorted(time, 0.5 * (fine[:-1] + fine[1:]), side="right") - 1],
    )


def posterior(told: list[Told], weights: list[Array]) -> tuple[Array, Array]:
    """Return shares, mean, second moments, and posteriors of the scenarios, with their standard
    errors.

    Ratios of weighted sums, so linearised; scenarios are strata: how many particles each has is not
    left to chance.
    """
    w = np.concatenate(weights)
    w = w / w.sum()
    became, places = (
        np.concatenate([getattr(one, k) for one in told]) for k in ("became", "places")
    )
    stratum = np.repeat(np.arange(len(told)), [one.became.size for one in told])
    there = (became == Status.ADRIFT) | (became == Status.ASHORE)
    mean = (w * there) @ places / (w @ there)
    x, y = (places - mean).T
    fates = np.stack([became == fate for fate in FATES.values()], axis=1)
    stories = np.eye(len(told))[stratum, :-1]  # the last one follows from the others
    found, errors = [], []
    for columns, of in (
        (fates, 1.0),
        (places, there),
        (np.stack([x * x, y * y, x * y], axis=1), there),
        (stories, 1.0),
    ):
        share = w * of
        value = share @ columns / share.sum()
        left = share[:, None] * (columns - value) / share.sum()
        for number in range(len(told)):
            left[stratum == number] -= left[stratum == number].mean(axis=0)
        found.append(value)
        errors.append(np.sqrt((left**2).sum(axis=0)))
    return np.concatenate(found), np.concatenate(errors)


@pytest.mark.thorough
@pytest.mark.parametrize(
    "name", ["overdue_boat", pytest.param("norkyst_raft", marks=pytest.mark.thorough)]
)
def test_case_and_its_sorties_are_what_a_second_opinion_says(
    name: str, request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch
) -> None:
    # As they drift, then given that all sorties failed: shares, mean, second moments and posteriors
    # of the scenarios.
    rng = np.random.default_rng(20_260_602)
    world, about = world_of(name, rng, request, monkeypatch)
    told, chances = searched(name, world, rng, about)
    prior = [
        one["weight"] if len(world.clouds) > 1 else 1.0
        for one in ({"weight": 1} | s for s in table(name)["scenario"])
    ]
    there, f = posterior(told, [p * c / c.size for p, c in zip(prior, chances, strict=True)])
    tracks, here = ours(name, about, {})
    agrees(tracks, told)
    mine, e = posterior(tracks, here)
    apart = (mine - there) / np.maximum(np.hypot(e, f), 1e-300)
    names = (*NAMES, *(one["name"] for one in table(name)["scenario"]))
    lines = [
        f"{names[k]}: {mine[k]:.5g}, oracle {there[k]:.5g}: {z:+.1f} errors"
        for k, z in enumerate(apart)
    ]
    assert (np.abs(apart[mine != there]) < SIGMAS).all(), lines


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
    geod = oracle.pyproj.Geod(a=oracle.R, b=oracle.R)
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
