"""An audit of the numerics against oracles that are not our code."""

from pathlib import Path

import numpy as np
import pytest
import shapely
import xarray as xr
from scipy.integrate import solve_ivp

import drift
from drift import start
from drift.motion import ensemble as record
from drift.motion import simulate
from drift.motion.clock import Clock
from drift.motion.drift import COLUMNS, DRIFT
from drift.motion.forcing import Forcing, Sources
from drift.motion.model import Motion
from drift.motion.scene import Scene
from drift.motion.status import Status
from geo import sphere
from geo.box import Box
from geo.coast import edges as shoreline
from geo.coast.shore import Shore
from geo.forcing import sources
from geo.grids.grid import Grid
from kernels import advance as kernel
from kernels import coast as device_coast
from kernels import sphere as device_sphere
from kernels.sample import Tiles

EVERYWHERE = kernel.Domain(-(2**31), -(2**30), 2**32 - 1, 2**31)
T0 = 1_795_000_000 // 86_400 * 86_400  # [s since 1970] a midnight in November 2026
STILL = kernel.Physics()
TEXT = """
title = "audit"
start = "2026-11-21T00:00Z"
duration = "{duration}"
particles = 2000
max_lost = 1.0
coast.source = "{coast}"
{more}
[[current]]
{current}
[[scenario]]
name = "s"
{object}
{prior}
"""


def ensemble_at(lon: float, lat: float, release: list[int]) -> record.Ensemble:
    ensemble = record.empty(5, (0, len(release)), COLUMNS)
    ensemble.lon.fill(int(sphere.to_binary(lon)))
    ensemble.lat.fill(int(sphere.to_binary(lat)))
    ensemble.release.from_numpy(np.array(release, np.int32))
    return ensemble


def world(current: sources.Source, direction: int = 1, physics: kernel.Physics = STILL, coast=None, domain=EVERYWHERE):
    return Scene(
        Forcing([Sources(current=(current,))], direction), (Motion(DRIFT, physics),), kernel.Place(domain, coast)
    )


def case_of(folder: Path, **changes: str) -> drift.Case:
    usual = {
        "duration": "24 h",
        "coast": "none",
        "more": "",
        "current": "constant = { speed = '0.5 m/s', toward = 90 }",
        "object": 'object = "water"',
        "prior": 'position = { at = [-20.0, 10.0], std = "500 m" }',
    }
    (folder / "case.toml").write_text(TEXT.format(**{**usual, **changes}))
    return drift.load(folder / "case.toml")


@pytest.mark.parametrize(("lat", "east", "north"), [(88.9, 1.0, 0.0), (-88.9, 0.5, -0.02), (88.0, 2.0, 0.1)])
def test_steps_of_an_hour_close_to_the_pole(lat: float, east: float, north: float) -> None:
    """Against Dormand and Prince in float64, across the antimeridian: 12 roundings of 5 mm and float32 steps."""
    ensemble = ensemble_at(179.9, lat, [0])
    (end,) = simulate.run(
        ensemble, world(sources.constant("current", east, north)), Clock(T0, 43_200, 1, 3600), np.array([43_200])
    )
    exact = solve_ivp(
        lambda t, y: [east / (sphere.RADIUS * np.cos(y[1])), north / sphere.RADIUS],
        (0, 43_200),
        np.radians([179.9, lat]),
        "DOP853",
        rtol=1e-12,
        atol=1e-15,
    ).y[:, -1]
    assert sphere.distance(*exact, end.lon[0] * sphere.UNIT, end.lat[0] * sphere.UNIT) < 0.1


def test_the_exponential_map_holds_to_the_antipode() -> None:
    """Relative error of a float32 map: a few units of 6e-8 of the arc, wherever it starts, poles included."""
    rng = np.random.default_rng(0)
    n = 50_000
    lon = rng.integers(-(2**31), 2**31, n).astype(np.int32)
    lat = sphere.to_binary(np.degrees(np.arcsin(rng.uniform(-1, 1, n))))
    lat[:100], lat[100:200] = 2**30, -(2**30)
    length, angle = 10 ** rng.uniform(0, 7.3, n), rng.uniform(0, 2 * np.pi, n)
    east, north = (length * np.sin(angle)).astype(np.float32), (length * np.cos(angle)).astype(np.float32)
    x, y = lon.copy(), lat.copy()
    device_sphere.displace(x, y, east, north)
    exact = sphere.destination(lon * sphere.UNIT, lat * sphere.UNIT, east, north)
    error = sphere.distance(*exact, x * sphere.UNIT, y * sphere.UNIT)
    # 2 m at the antimeridian: float32 of an angle of pi has a spacing of 2.4e-7 rad, which is 1.5 m
    assert (error < 0.02 + np.minimum(1e-6 * length, 6.0)).all()


@pytest.mark.parametrize("lon0", [0.0, -180.0, 20.3, 359.9])
@pytest.mark.parametrize("nlon", [361, 4321])
def test_no_unit_of_longitude_falls_between_the_ends_of_a_global_tile(lon0: float, nlon: int) -> None:
    grid = Grid(lon0, -1.0, 360 / (nlon - 1), 1.0, nlon, 3)
    tiles = Tiles([grid])
    wave = np.stack([np.sin(np.radians(grid.lon)), np.cos(np.radians(grid.lon))], axis=-1)
    values = np.broadcast_to(wave, (3, nlon, 2)).astype(np.float32)
    tiles.place(0, values, later=False)
    tiles.place(0, values, later=True)
    tiles.blend([(0.0, 0.0)])
    near = int(sphere.to_binary(lon0)) + np.arange(-600, 600)
    lon = ((near + 2**31) % 2**32 - 2**31).astype(np.int32)
    found = tiles.at(0, 1, lon, np.zeros(lon.size, np.int32), 0.0)
    assert (found[:, 2] == 1).all()
    # bilinear: h^2 / 8 of the second derivative; float32 coordinates: 2^-24 of a turn
    bound = np.radians(grid.dlon) ** 2 / 8 + 2 * np.pi * 2**-24 + 1e-6
    assert np.abs(found[:, 0] - np.sin(lon * sphere.UNIT)).max() < bound


def test_a_tile_just_east_of_a_particle_is_silent() -> None:
    grid = Grid(179.7, 50.0, 0.1, 0.1, 7, 7)
    tiles = Tiles([grid])
    for later in (False, True):
        tiles.place(0, np.ones((7, 7, 2), np.float32), later=later)
    tiles.blend([(0.0, 0.0)])
    lon = (sphere.to_binary(179.7) - np.array([0, 1, 2, 1000, 10**6])).astype(np.int32)
    found = tiles.at(0, 1, lon, np.full(5, int(sphere.to_binary(50.3)), np.int32), 0.0)
    assert found[:, 2].tolist() == [1, 0, 0, 0, 0]


@pytest.mark.parametrize("direction", [1, -1])
def test_every_output_before_and_after_the_end_of_the_forcing(direction: int) -> None:
    """Uniform flow: position is speed times time from release to the end of the last step that has forcing."""
    times = (T0 + np.array([-20_000, 20_000])).astype("datetime64[s]")
    source = sources.table("current", times, [1.0, 1.0], [0.0, 0.0])
    release = np.array([0, 100, 3000, 5000])
    ensemble = ensemble_at(0.0, 0.0, release.tolist())
    outputs = np.arange(0, 25_001, 250)
    moments = list(simulate.run(ensemble, world(source, direction), Clock(T0 + 417, 25_000, direction, 900), outputs))
    ended = ensemble.status_since.to_numpy()
    assert (np.abs(ended - (20_000 - 417 * direction)) < 900).all()
    lasted = np.maximum(np.minimum(outputs[:, None], ended) - release, 0)
    way = direction * sphere.RADIUS * sphere.UNIT * np.array([m.lon for m in moments])
    assert way == pytest.approx(lasted, abs=0.5)
    outside = np.array([m.status for m in moments]) == Status.OUTSIDE
    assert (outside == (outputs[:, None] >= ended)).all()


def test_a_slice_that_cannot_be_read_stops_the_run_and_only_where_it_is_needed() -> None:
    def read(i: int) -> np.ndarray:
        if i == 3:
            raise OSError("slice 3 is broken")
        return np.ones((2, 2, 2), np.float32)

    times = (T0 + 3600 * np.arange(6)).astype("datetime64[s]")
    source = sources.Source("current", "x", sources.EVERYWHERE, times, read, 0.0, (), "")
    place = world(source)
    list(simulate.run(ensemble_at(0, 0, [0]), place, Clock(T0, 7200, 1, 600), np.array([7200])))
    with pytest.raises(OSError, match="slice 3"):
        list(simulate.run(ensemble_at(0, 0, [0]), place, Clock(T0, 14_400, 1, 600), np.array([14_400])))
    place.forcing.close()


def test_account_of_wild_weights() -> None:
    """float64 sums as the oracle; blocks of 1024 float32 terms: relative error below 1024 * 6e-8."""
    rng = np.random.default_rng(1)
    n = 50_001
    ensemble = record.empty(1, (0, 1000, 1000, 30_000, n), COLUMNS)
    weight = rng.normal(0, 30, n).astype(np.float32)
    weight[rng.random(n) < 0.3] = -np.inf
    weight[:1000] = -np.inf
    status = rng.integers(0, 6, n).astype(np.int32)
    ensemble.log_weight.from_numpy(weight)
    ensemble.status.from_numpy(status)
    p = np.exp(weight.astype(float) - weight.max())
    p /= p.sum()
    exact = [[p[a:b][status[a:b] == s].sum() for s in range(6)] for a, b in ensemble.scenarios]
    account = record.account(ensemble)
    assert account.by_status == pytest.approx(np.array(exact), rel=6e-5, abs=1e-12)
    assert account.ess == pytest.approx(1 / (p * p).sum(), rel=6e-5)


def test_nobody_inland_where_land_lies_across_the_antimeridian() -> None:
    land = [shapely.box(178, -5, 180, 5), shapely.box(-180, -5, -178, 5)]
    box = Box(-180, -80, 180, 88)
    coast = shoreline.build(Shore(np.array(land), "test", (), box), box)
    rng = np.random.default_rng(0)
    lon, lat = sphere.to_binary(180 + rng.uniform(-5, 5, 5000)), sphere.to_binary(rng.uniform(-8, 8, 5000))
    wet = ~shoreline.is_land(coast, lon, lat)
    ensemble = record.empty(3, (0, int(wet.sum())), COLUMNS)
    ensemble.lon.from_numpy(lon[wet])
    ensemble.lat.from_numpy(lat[wet])
    place = world(
        sources.constant("current", 1.0, -0.5),
        physics=kernel.Physics(diffusivity=2000.0),
        coast=device_coast.upload(coast),
    )
    for moment in simulate.run(ensemble, place, Clock(T0, 172_800, 1, 21_600), np.array([40_000, 172_800])):
        x, y = (np.asarray(sphere.to_degrees(a)) for a in (moment.lon, moment.lat))
        assert not shapely.contains_properly(shapely.union_all(land), shapely.points(x, y)).any()
    assert (ensemble.status.to_numpy() == Status.ASHORE).sum() > 300


# Known defects.


def test_an_onshore_drift_strands_whatever_the_step(tmp_path: Path) -> None:
    """0.6 m/s straight onto a wall 7 km away: all are ashore after 12 h; nothing is ever outside of the forcing."""
    lon, lat = np.arange(-1, 0.5001, 0.005), np.arange(49.3, 50.7, 0.005)
    east = np.full((2, lat.size, lon.size), 0.3, np.float32)
    east[:, :, lon > 1e-4] = np.nan
    name = {"uo": "eastward_sea_water_velocity", "vo": "northward_sea_water_velocity"}
    data = {
        k: (("time", "lat", "lon"), v, {"standard_name": name[k], "units": "m s-1"})
        for k, v in (("uo", east), ("vo", 0 * east))
    }
    hours = ("time", np.array([0, 48]), {"units": "hours since 2026-11-21", "standard_name": "time"})
    axes = {
        "lon": ("lon", lon, {"standard_name": "longitude", "units": "degrees_east"}),
        "lat": ("lat", lat, {"standard_name": "latitude", "units": "degrees_north"}),
    }
    xr.Dataset(data, {"time": hours, **axes}).to_netcdf(tmp_path / "current.nc")
    corners = [[0, 48], [2, 48], [2, 52], [0, 52], [0, 48]]
    (tmp_path / "land.geojson").write_text(
        '{"type": "FeatureCollection", "features": [{"type": "Feature", "properties": {}, '
        f'"geometry": {{"type": "Polygon", "coordinates": [{corners}]}}}}]}}'
    )
    case = case_of(
        tmp_path,
        duration="12 h",
        coast="land.geojson",
        more='domain = { west = -0.9, east = 0.4, south = 49.4, north = 50.6 }\nuncertainty = "none"',
        current='files = "current.nc"\n[[wind]]\nconstant = { speed = "10 m/s", from = 270 }',
        object='object = { windage = "3 %" }',
        prior='position = { at = [-0.1, 50.0], std = "500 m" }',
    )
    account = drift.run(case).summary["account"]
    assert account["outside"] == 0
    assert account["ashore"] == pytest.approx(1.0)


def test_a_wind_of_the_same_name_leaves_the_fill_of_a_current_alone(tmp_path: Path) -> None:
    same = 'name = "model"\nconstant = { speed = "0.5 m/s", toward = 90 }\n'
    case = case_of(tmp_path, current=f"fill = 5\n{same}[[wind]]\nfill = 0\n{same}")
    assert start.open_for(case).scenarios[0].cells["current", "model"] == 5


def test_the_reach_holds_the_great_circle_between_waypoints(tmp_path: Path) -> None:
    prior = """[scenario.trackline]
    waypoints = [[140.0, 35.0], [-125.0, 48.0]]
    departure = "2026-11-17T00:00Z"
    speed = "20 kn"
    cross_track = "1 nmi"
    distress = { between = ["2026-11-21T01:00Z", "2026-11-21T06:00Z"] }"""
    assert drift.run(case_of(tmp_path, prior=prior)).summary["account"]["adrift"] == pytest.approx(1.0)


def test_the_account_is_of_the_end_of_the_run() -> None:
    """1 m/s for 4000 s does not leave a box whose edge is 5000 m away."""
    edge = round(5000 / (sphere.UNIT * sphere.RADIUS))
    box = kernel.Domain(int(sphere.to_binary(-1)), int(sphere.to_binary(-1)), edge + int(sphere.to_binary(1)), 2**24)
    ensemble = ensemble_at(0.0, 0.0, [0])
    place = world(sources.constant("current", 1.0, 0.0), domain=box)
    (end,) = simulate.run(ensemble, place, Clock(T0, 4000, 1, 3600), np.array([4000]))
    assert end.status[0] == Status.ADRIFT
    assert record.account(ensemble, end.status).by_status[0, Status.ADRIFT] == 1


def test_a_step_too_long_for_the_correlation_of_errors_is_refused(tmp_path: Path) -> None:
    """At a step of three decorrelation times the spread would come out 1.6 times too large."""
    more = "clock = { step = 3600 }\nuncertainty = { current = { std = 0.3, time = 1200 } }"
    with pytest.raises(drift.UserError, match=r"clock\.step: 3600 s is longer than a sixth of .*, 200 s"):
        drift.run(case_of(tmp_path, more=more))


def test_a_step_longer_than_the_forcing_interval_is_refused(tmp_path: Path) -> None:
    """A current of 0, 4, 0 kn within 12 h: a step of 12 h would see both zeros and nothing of what lies between."""
    rows = ", ".join(f'{{ time = "+{h} h", speed = "{s} kn", toward = 90 }}' for h, s in ((0, 0), (6, 4), (12, 0)))
    case = case_of(tmp_path, duration="12 h", current=f"table = [{rows}]", more='clock = { step = "12 h" }')
    with pytest.raises(drift.UserError, match="longer than the interval of the forcing, 21600 s"):
        drift.run(case)


def test_the_spread_at_an_output_inside_a_step() -> None:
    """2 D t at any t, not only on the lattice; 20,000 draws: 1 % standard error, 5 % allowed."""
    lon, lat = -179.99, 61.0
    ensemble = ensemble_at(lon, lat, [0] * 20_000)
    place = world(sources.constant("current", 0.0, 0.0), physics=kernel.Physics(diffusivity=100.0))
    (early,) = simulate.run(ensemble, place, Clock(T0, 3600, 1, 3600), np.array([600]))
    way = np.array(sphere.offset(*np.radians([lon, lat]), early.lon * sphere.UNIT, early.lat * sphere.UNIT))
    assert way.var(axis=1) == pytest.approx(2 * 100 * 600, rel=0.05)
    assert abs(np.corrcoef(way)[0, 1]) < 4.5 / np.sqrt(20_000)


def test_the_lattice_holds_the_times_of_all_sources(tmp_path: Path) -> None:
    """A current on full hours and a wind at half past: steps of 30 minutes, so that neither bends inside one."""
    rows = {
        start: ", ".join(
            f'{{ time = "{np.datetime64("2026-11-20T23:00") + np.timedelta64(start + 60 * h, "m")}Z", speed = "{3 + h % 2} {unit}", {word} = 70 }}'
            for h in range(9)
        )
        for start, unit, word in ((0, "kn", "toward"), (30, "m/s", "from"))
    }
    case = case_of(
        tmp_path,
        duration="6 h",
        current=f"table = [{rows[0]}]\n[[wind]]\ntable = [{rows[30]}]",
        more='clock = { tolerance = "2000 m" }',
        object='object = "LIFE-RAFT-DB-10"',
    )
    assert drift.run(case).summary["run"]["step_s"] == 1800
