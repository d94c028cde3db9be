"""Sums of sources: against an integration of our own, and what is said where a term is missing."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trial_case
import xarray as xr

import drift
from drift.apps.check import check
from drift.engine.particles.status import Status
from geo import sphere
from geo.errors import UserError
from geo.grids.grid import Grid
from kernels.step.sample import Tiles

START = np.datetime64("2026-11-21T18:00:00")
HOUR = 3600.0
LON, LAT = 179.6, -17.3  # [deg] the fields' middle: they lie across the antimeridian

# lon, lat [deg], time [s] -> m/s
Field = Callable[[np.ndarray, np.ndarray, float], tuple[np.ndarray, np.ndarray]]


def residual(lon: np.ndarray, lat: np.ndarray, time: float) -> tuple[np.ndarray, np.ndarray]:
    """A slow eddy that is not round, and grows."""
    x, y = (lon - LON) / 0.9, (lat - LAT) / 0.7
    grown = 0.35 * (1 + time / (40 * HOUR)) * np.exp(-(x**2 + y**2) / 3)
    return -y * grown + 0.11, 1.3 * x * grown - 0.07


def tide(lon: np.ndarray, lat: np.ndarray, time: float) -> tuple[np.ndarray, np.ndarray]:
    """An ellipse in 12.42 h whose phase runs along the coast."""
    phase = 2 * np.pi * time / (12.42 * HOUR) - 0.8 * (lon - LON) + 0.5 * (lat - LAT)
    return 0.45 * np.cos(phase), 0.25 * np.sin(phase) * (1 + 0.2 * (lat - LAT))


def stored(
    path: Path,
    field: Field,
    shape: tuple[int, int],
    spacing: tuple[float, float],
    hours: np.ndarray,
    land: bool = False,
) -> xr.Dataset:
    """Write a field on a regular grid round the middle, float64, and return it; land: north-east of
    the middle.
    """
    lon = LON + spacing[0] * (np.arange(shape[1]) - shape[1] // 2)
    lat = LAT + spacing[1] * (np.arange(shape[0]) - shape[0] // 2)
    x, y = np.meshgrid(lon, lat)
    u, v = (
        np.array(values) for values in zip(*(field(x, y, h * HOUR) for h in hours), strict=True)
    )
    if land:
        for values in (u, v):
            values[:, (x > LON + 0.9) & (y > LAT + 0.35)] = np.nan
    dims = ("time", "lat", "lon")
    data = xr.Dataset(
        {
            "uo": (dims, u, {"standard_name": "eastward_sea_water_velocity", "units": "m s-1"}),
            "vo": (dims, v, {"standard_name": "northward_sea_water_velocity", "units": "m s-1"}),
        },
        {
            "time": ("time", hours * HOUR, {"units": "seconds since 2026-11-21 18:00:00"}),
            "lat": ("lat", lat, {"units": "degrees_north"}),
            "lon": ("lon", (lon + 180) % 360 - 180, {"units": "degrees_east"}),
        },
    )
    data.to_netcdf(path)
    return data


def integrated(
    data: list[xr.Dataset], starts: list[tuple[float, float]], hours: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return where a sum of fields leads (lon, lat) [deg], (2, n), in hours of either sign, and how
    long the ways are [m].

    Runge-Kutta of order 4 in float64 at 2 min, bilinear in space and linear in time in the values
    as they are stored.
    """
    fields = [
        (np.stack([d.uo.values, d.vo.values]), [float(d[n][0]) for n in ("lon", "lat", "time")],
         [float((d[n][1] - d[n][0] + 180) % 360 - 180) if n == "lon" else float(d[n][1] - d[n][0]) for n in ("lon", "lat", "time")])
        for d in data
    ]  # fmt: skip

    def sampled(
        values: np.ndarray, first: list[float], step: list[float], here: np.ndarray, time: float
    ) -> np.ndarray:
        scaled = ((here[0] - first[0] + 180) % 360 - 180) / step[0], (here[1] - first[1]) / step[1]
        x, y, t = (*scaled, np.full(here.shape[1], (time - first[2]) / step[2]))
        sizes = (values.shape[3], values.shape[2], values.shape[1])
        i, j, k = (
            np.clip(np.floor(z).astype(int), 0, n - 2)
            for z, n in zip((x, y, t), sizes, strict=True)
        )
        total = np.zeros((2, here.shape[1]))
        for a in (0, 1):
            for b in (0, 1):
                for c in (0, 1):
                    weight = abs(1 - a - x + i) * abs(1 - b - y + j) * abs(1 - c - t + k)
                    total += weight * values[:, k + c, j + b, i + a]
        return total

    def rate(here: np.ndarray, time: float) -> np.ndarray:
        east, north = sum(sampled(*field, here, time) for field in fields)
        return np.degrees(np.array([east / np.cos(np.radians(here[1])), north]) / sphere.RADIUS)

    place, way, step = np.array(starts).T, np.zeros(len(starts)), np.copysign(120.0, hours)
    for n in range(round(hours * HOUR / step)):
        time = n * step - (hours * HOUR if hours < 0 else 0)
        k1 = rate(place, time)
        k2 = rate(place + 0.5 * step * k1, time + 0.5 * step)
        k3 = rate(place + 0.5 * step * k2, time + 0.5 * step)
        k4 = rate(place + step * k3, time + step)
        move = step / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        way += (
            np.hypot(move[0] * np.cos(np.radians(place[1])), move[1]) * np.pi / 180 * sphere.RADIUS
        )
        place = place + move
    return place, way


STARTS = [(179.2, -17.45), (179.95, -17.1), (-179.9, -17.5), (179.5, -16.95)]


def case_of(
    folder: Path, sources: str, starts: list[tuple[float, float]] = STARTS, **more: object
) -> drift.Case:
    box = {"west": 177.0, "east": -177.0, "south": -20.0, "north": -14.0}
    given = {"start": "211800ZNOV26", "max_lost": 0.2, "domain": box, **more}
    scenarios = [
        {"name": f"water {k}", "object": "water", "position": {"at": at, "std": "0 m"}}
        for k, at in enumerate(starts)
    ]
    return trial_case.load(
        folder,
        sources,
        duration="24 h",
        particles=10,
        uncertainty="none",
        clock={"step": "10 min"},
        current=None,
        scenario=scenarios,
        **given,
    )


RESIDUAL = '[[current]]\nname = "residual"\nfiles = "residual.nc"\n'
TIDE = '[[current]]\nname = "tide"\nfiles = "tide.nc"\nadd = true\n'


@pytest.fixture(scope="module")
def both(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[xr.Dataset]]:
    """A residual current every 3 h with land in it, and a tide on another grid every 20 min, as
    files.
    """
    folder = tmp_path_factory.mktemp("sum")
    slow = stored(
        folder / "residual.nc",
        residual,
        (61, 71),
        (0.05, 0.04),
        np.arange(0.0, 25.0, 3.0),
        land=True,
    )
    fast = stored(folder / "tide.nc", tide, (47, 53), (0.07, 0.06), np.arange(0.0, 24.5, 1 / 3))
    return folder, [slow, fast]


@pytest.mark.thorough
@pytest.mark.parametrize(
    "direction", ["forward", pytest.param("backward", marks=pytest.mark.thorough)]
)
def test_a_sum_moves_as_an_integration_of_our_own_does(
    both: tuple[Path, list[xr.Dataset]], direction: str
) -> None:
    """24 h through both grids, across the antimeridian.

    Rounding of 144 steps to 9.3 mm and of a position on a grid of 71 nodes in float32 (4e-6 cells
    of 5 km, in fields whose vector changes by 0.5 m/s over 40 km: 3e-7 m/s, 0.03 m in a day) come
    to 0.1 m; a Runge-Kutta step across a cell's edge, where the slope of the field jumps by h u'' =
    5 km x 0.5 m/s / (40 km)^2 = 1.6e-6 /s, errs by up to (jump / 8) x speed x dt^2 = 0.04 m, some
    forty times a day with either sign: 0.3 m.
    """
    folder, fields = both
    when = {"forward": "211800ZNOV26", "backward": "221800ZNOV26"}[direction]
    tracks = drift.run(
        case_of(folder, RESIDUAL + TIDE, direction=direction, start=when)
    ).trajectories
    there, way = integrated(fields, STARTS, 24 if direction == "forward" else -24)
    one = [int(np.flatnonzero(tracks.scenario == number)[0]) for number in range(len(STARTS))]
    ours = np.array([sphere.to_degrees(z[one, -1]) for z in (tracks.lon, tracks.lat)])
    away = sphere.distance(*np.radians(there), *np.radians(ours))
    assert (way > 15_000).all()
    assert (away < 0.5).all()


def test_the_groups_of_a_range_add_up_and_a_silent_group_is_no_zero() -> None:
    """Two sources by priority, then two that are added: by hand at every combination of what is
    missing.
    """
    wide, grids = Grid(178.0, -20.0, 1.0, 1.0, 5, 5), 4
    tiles = Tiles([wide] * grids, [2, 2, 3, 4])
    for tile in range(grids):
        values = np.zeros((5, 5, 2), np.float32)
        values[...] = np.array([2.0**tile, -(3.0**tile)], np.float32)
        values[:, tile] = np.nan  # the cells to both sides of a column of its own
        for later in (False, True):
            tiles.place(tile, values, later=later)
    tiles.blend([(0.0, 0.5)] * grids)
    lon, lat = sphere.to_binary(178.5 + np.arange(4)), sphere.to_binary(np.full(4, -18.3))
    found = tiles.at(0, 4, lon, lat, 0.4)
    # cell 0 misses tiles 0 and 1, cell 1 tiles 1 and 2, cell 2 tiles 2 and 3, cell 3 tile 3
    assert found[:, 2].tolist() == [0, 0, 0, 0]
    assert tiles.at(0, 3, lon, lat, 0.4).tolist()[3] == pytest.approx([1 + 4, -1 - 9, 1])
    # the first of two has no time: the second stands in
    tiles.blend([None, (0.0, 0.5), (0.0, 0.5), (0.0, 0.5)])
    assert tiles.at(0, 3, lon, lat, 0.4).tolist()[3] == pytest.approx([2 + 4, -3 - 9, 1])
    # an added one has no time: nothing does
    tiles.blend([(0.0, 0.5), (0.0, 0.5), None, (0.0, 0.5)])
    assert (tiles.at(0, 4, lon, lat, 0.4)[:, 2] == 0).all()
    assert tiles.at(0, 2, lon, lat, 0.4)[:, 2].tolist() == [0, 1, 1, 1]


def test_every_kind_is_added_and_a_scenario_takes_what_it_names(tmp_path: Path) -> None:
    """0.5 m/s east, a report that falls from 0.4 to 0 m/s north, and a constant 0.1 m/s west: each
    by itself and together.
    """
    sources = """
[[current]]
name = "set"
constant = { east = 0.5, north = 0.0 }
[[current]]
name = "falling"
add = true
table = [ { time = "+0 h", east = 0.0, north = 0.4 }, { time = "+24 h", east = 0.0, north = 0.0 } ]
[[current]]
name = "back"
add = true
constant = { east = -0.1, north = 0.0 }
"""
    case = case_of(tmp_path, sources, [(10.0, 0.0)] * 3, max_lost=1.0, domain=None)
    named = {"scenario.0.currents": ["set"], "scenario.1.currents": ["falling", "set"]}
    tracks = drift.run(drift.vary(case, named)).trajectories
    day = 24 * HOUR
    for number, (u, v) in enumerate([(0.5, 0.0), (0.5, 0.2), (0.4, 0.2)]):
        one = int(np.flatnonzero(tracks.scenario == number)[0])
        lon, lat = (
            np.radians(float(sphere.to_degrees(z[one, -1]))) for z in (tracks.lon, tracks.lat)
        )
        # on the equator within 17 km of it, cos(lat) differs from 1 by less than 4e-6
        assert sphere.offset(np.radians(10.0), 0.0, lon, lat) == pytest.approx(
            [u * day, v * day], abs=1.0
        )


def test_a_place_without_a_term_ends_a_particle_and_the_refusal_names_the_term(
    both: tuple[Path, list[xr.Dataset]], tmp_path: Path
) -> None:
    folder, fields = both
    small = fields[1].isel(lon=slice(0, 27))  # to the middle: east of it there is no tide
    small.to_netcdf(folder / "narrow.nc")
    narrow = TIDE.replace("tide.nc", "narrow.nc")
    with pytest.raises(
        UserError, match=r'50\.0 % of the prior .* no current .*"tide" begins .* A sum has no value'
    ) as refused:
        check.check(case_of(folder, RESIDUAL + narrow))
    assert "residual" not in str(refused.value)
    # a tide over land is no current: the residual one is missing
    dry = RESIDUAL + "fill = 0\n" + TIDE
    with pytest.raises(
        UserError,
        match=r'25\.0 % of the prior .*"residual" has no value there.* A sum has no value',
    ):
        check.check(case_of(folder, dry, [*STARTS[:3], (-179.2, -16.8)]))
    # toward the edge of the tide's grid, a kilometre away
    edge = float(small.lon[-1])
    with pytest.raises(
        UserError, match=r'100 % ran out of forcing \(no value: current "tide" 100 %\)'
    ):
        drift.run(case_of(folder, RESIDUAL + narrow, [(edge - 0.01, -17.5)]))
    result = drift.run(case_of(folder, RESIDUAL + narrow, [(edge - 0.01, -17.5)], max_lost=1.0))
    assert (result.trajectories.status[:, -1] == Status.OUTSIDE).all()


def test_each_term_must_last_as_long_as_the_run_and_its_holes_are_told(
    both: tuple[Path, list[xr.Dataset]],
) -> None:
    folder, fields = both
    fields[1].isel(time=slice(0, 40)).to_netcdf(folder / "short.nc")
    short = TIDE.replace("tide.nc", "short.nc")
    with pytest.raises(
        UserError,
        match=r'current "tide" lasts from 211800ZNOV26 to 220700ZNOV26.*54% of the run .* add = true',
    ):
        drift.run(case_of(folder, RESIDUAL + short))
    fields[0].isel(time=slice(0, 5)).to_netcdf(folder / "first.nc")
    with pytest.raises(
        UserError,
        match=r'current "residual" lasts from .*50% of the run is covered.* or add another',
    ):
        drift.run(case_of(folder, RESIDUAL.replace("residual.nc", "first.nc") + TIDE))
    fields[1].isel(time=[*range(30), *range(45, 74)]).to_netcdf(folder / "holed.nc")
    holed = RESIDUAL + TIDE.replace("tide.nc", "holed.nc")
    with pytest.raises(UserError, match=r"no data from 220340ZNOV26 to 220900ZNOV26.* add = true"):
        check.check(case_of(folder, holed))
    told = check.check(case_of(folder, holed, max_lost=1.0))
    assert "no values between 220340ZNOV26 and 220900ZNOV26" in told["current tide"]
    assert "added to the other sources of [[current]]" in told["current tide"]
    assert "missing" in told["current residual"]
    assert "within 177.7" in told["current tide"]


@pytest.mark.parametrize(
    ("sources", "named", "message"),
    [
        (TIDE, "", 'current "tide": add = true, and there is no'),
        (
            RESIDUAL + TIDE,
            '["tide"]',
            r'all of these have add = true; also name the sources to which they are added: "residual"',
        ),
        (
            RESIDUAL + TIDE,
            '["residual", "tide", "tide"]',
            r'"tide" has add = true and is named twice',
        ),
        (RESIDUAL + TIDE.replace("true", '"yes please"'), "", r'current "tide".add'),
    ],
)
def test_a_sum_without_a_base_is_refused(
    both: tuple[Path, list[xr.Dataset]], sources: str, named: str, message: str
) -> None:
    folder, _ = both
    chosen = f"currents = {named}" if named else ""

    def load() -> None:
        trial_case.load(folder, chosen, sources, current=None)

    with pytest.raises(UserError, match=message):
        load()
