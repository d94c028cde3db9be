"""Many forecasts in one process: each is the one that a run of its case alone makes, to the bit,
and none hurts another.
"""

import json
import resource
from pathlib import Path

import model_writers
import numpy as np
import pytest
import writers
import xarray as xr

import drift
from drift.engine.environment import domain, environment
from drift.engine.particles.status import Status
from drift.pipeline import run_setup
from geo import sphere
from geo.errors import UserError
from geo.forcing.reading.kept import Kept
from geo.grids import fill

# maps are held against those of a run alone, made in the same way
pytestmark = pytest.mark.usefixtures("coarse_maps")

CASE = """
start = "2024-03-05T00:20Z"
duration = "5 h"
particles = 300
seed = 5
max_lost = 1.0
output.every = "4 h"
output.trajectories = 300
coast = {{ source = "{coast}" }}
current = [{{ files = "{current}", fill = 2 }}]
wind = [{{ table = [{{ time = "+0 h", speed = "9 m/s", from = 213 }}, {{ time = "+30 h", speed = "4 m/s", from = 155 }}] }}]
uncertainty.current = {{ std = "0.12 m/s", time = "5 h" }}
uncertainty.wind = {{ std = "1.3 m/s", time = "7 h" }}
uncertainty.diffusivity = "12 m2/s"
[[scenario]]
name = "raft"
object = "LIFE-RAFT-DB-11"
position = {{ at = [{lon}, {lat}], error = "2 nmi", until = "+40 min" }}
[[scenario]]
name = "debris"
object = "water"
weight = 0.4
position = {{ at = [{lon}, {lat}], std = ["3 km", "1 km"], orientation = 30 }}
"""


def middle() -> tuple[float, float]:
    """The middle of the fields that `writers` makes [deg]."""
    return sum(writers.LON) / 2, sum(writers.LAT) / 2


def islands(path: Path) -> str:
    """Write a ragged shore of short edges down-wind of the middle of the fields, and an islet."""
    lon, lat = middle()
    turn = np.linspace(0, 2 * np.pi, 90, endpoint=False)
    rings = []
    for x, y, size in ((lon + 0.14, lat + 0.11, 0.09), (lon - 0.12, lat + 0.02, 0.02)):
        ragged = size * (1 + 0.2 * np.sin(7 * turn) + 0.1 * np.cos(13 * turn))
        ring = np.stack([x + 1.5 * ragged * np.cos(turn), y + ragged * np.sin(turn)], 1).tolist()
        rings.append([[*ring, ring[0]]])
    path.write_text(json.dumps({"type": "MultiPolygon", "coordinates": rings}))
    return str(path)


def case(folder: Path, current: Path | str, coast: str = "none") -> drift.Case:
    lon, lat = middle()
    path = folder / "base.toml"
    path.write_text(CASE.format(current=current, coast=coast, lon=lon, lat=lat))
    return drift.load(path)


def varied(base: drift.Case) -> list[drift.Case]:
    """Cases that differ in start, place, seed, errors, object, outputs and length."""
    lon, lat = middle()
    return [
        base,
        drift.vary(base, {"scenario.0.position.at": [lon + 0.03, lat - 0.02], "seed": 8}),
        drift.vary(base, {"start": base.start + np.timedelta64(5000, "s"), "duration": "3 h"}),
        drift.vary(
            base,
            {"uncertainty.current": {"std": 0.3, "time": "11 h"}, "scenario.0.object": "PIW-1"},
        ),
        drift.vary(
            base,
            {
                "uncertainty": {},
                "scenario.1.position.std": ["6 km", "2 km"],
                "clock.step": "20 min",
            },
        ),
        drift.vary(
            base,
            {
                "seed": 2**62 + 1,
                "output.every": None,
                "output.times": ["+50 min", "+4 h"],
                "particles": 290,
            },
        ),
    ]


def same(one: drift.Brief, alone: drift.Result) -> None:
    """Hold a forecast of many against a run's own tracks, of all its particles."""
    tracks = alone.trajectories
    assert one.error is None
    assert tracks.slot.size == one.lon.shape[1]
    assert one.times.tolist() == tracks.time.tolist()
    for mine, theirs in ((one.lon, tracks.lon), (one.lat, tracks.lat)):
        assert (mine * (sphere.TURN / 360) == theirs.T).all()
    assert (one.status == tracks.status.T).all()
    assert (one.probability == tracks.weight.T).all()
    assert one.step == alone.summary["run"]["step_s"]


GRIDS = {
    "regular": writers.regular,
    "staggered": model_writers.roms,
    "triangles": model_writers.fvcom,
}


@pytest.mark.thorough
@pytest.mark.parametrize(
    "grid",
    ["staggered", *(pytest.param(g, marks=pytest.mark.thorough) for g in ("regular", "triangles"))],
)
def test_each_of_many_is_the_run_of_its_case_alone_to_the_bit(tmp_path: Path, grid: str) -> None:
    cases = varied(case(tmp_path, GRIDS[grid](tmp_path / "current.nc")))
    for one, own in zip(drift.run_many(cases), cases, strict=True):
        assert one.case is own
        same(one, drift.run(own))


def shore_of(value: float, path: Path) -> Path:
    """The regular grid with land east of a slanting line that runs through the clouds: zero there
    at all times, or missing.
    """
    with xr.open_dataset(writers.regular(path.with_name("all_wet.nc"))) as opened:
        sea = opened.load()
    east, north = (
        next(name for name in sea.data_vars if name.startswith(key)) for key in ("u", "v")
    )
    lon, lat = (
        sea[next(c for c in sea.coords if str(c).startswith(key))] for key in ("lon", "lat")
    )
    dry = (lon + 0.4 * (lat - middle()[1])) > middle()[0] + 0.05
    sea.assign({name: sea[name].where(~dry, value) for name in (east, north)}).to_netcdf(path)
    return path


OTHERS = {
    "rotated pole": model_writers.rotated,
    "curvilinear": model_writers.curved_true,
    "land as zero": lambda path: shore_of(0.0, path),
    "land as missing": lambda path: shore_of(np.nan, path),
}


@pytest.mark.thorough
@pytest.mark.parametrize(
    "grid",
    [pytest.param(grid, marks=[pytest.mark.thorough] * (grid == "curvilinear")) for grid in OTHERS],
)
def test_and_on_whatever_grid_and_shore(tmp_path: Path, grid: str) -> None:
    lon, lat = middle()
    base = case(
        tmp_path, OTHERS[grid](tmp_path / "current.nc"), islands(tmp_path / "islands.geojson")
    )
    cases = [base, drift.vary(base, {"seed": 9, "scenario.0.position.at": [lon + 0.02, lat]}), base]
    for one, own in zip(drift.run_many(cases), cases, strict=True):
        same(one, drift.run(own))


@pytest.mark.thorough
def test_what_is_ready_to_be_sampled_is_made_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Three slices, one current: ten cases that need the same part of it have each filled once, not
    ten times.
    """
    filled = []
    own = fill.fill
    monkeypatch.setattr(
        fill,
        "fill",
        lambda values, *given, **more: filled.append(values.shape) or own(values, *given, **more),
    )
    lon, lat = middle()
    base = case(tmp_path, shore_of(np.nan, tmp_path / "current.nc"))
    cases = [
        drift.vary(
            base,
            {"seed": k, "scenario.0.position.at": [lon + 0.001 * k, lat], "clock.step": "30 min"},
        )
        for k in range(10)
    ]
    parts = {
        environment.box_to_read(
            domain.bounds(run_setup.ensemble_spec(one), run_setup.environment_spec(one))
        )
        for one in cases
    }
    assert len(parts) == 1
    assert all(one.error is None for one in drift.run_many(cases))
    # the wind is a table, the same everywhere
    assert sum(shape[:2] > (2, 2) for shape in filled) == 3


@pytest.mark.thorough
def test_stranded_particles_too(tmp_path: Path) -> None:
    base = case(
        tmp_path, writers.regular(tmp_path / "current.nc"), islands(tmp_path / "islands.geojson")
    )
    cases = varied(base)
    made = list(drift.run_many(cases))
    # otherwise nothing is tested
    assert min(np.mean(one.status[-1] == Status.ASHORE) for one in made) > 0.02
    for one, own in zip(made, cases, strict=True):
        same(one, drift.run(own))


def bits(one: drift.Brief) -> list[bytes]:
    """All that a forecast of many holds, as bytes."""
    return [
        np.asarray(a).tobytes()
        for a in (one.times, one.lon, one.lat, one.status, one.probability, one.mean)
    ]


@pytest.mark.thorough
def test_neither_order_nor_company_matters(tmp_path: Path) -> None:
    lon, lat = middle()
    base = case(
        tmp_path, writers.projected(tmp_path / "current.nc"), islands(tmp_path / "islands.geojson")
    )
    far = drift.vary(
        base,
        {
            "scenario.0.position.at": [lon - 1.2, lat - 0.6],
            "scenario.1.position.at": [lon + 1.1, lat],
        },
    )
    cases = [*varied(base), far]
    forth, back = list(drift.run_many(cases)), list(drift.run_many(cases[::-1]))[::-1]
    assert [bits(one) for one in forth] == [bits(one) for one in back]
    assert bits(next(drift.run_many([cases[3]]))) == bits(forth[3])


def test_data_sets_are_told_apart(tmp_path: Path) -> None:
    """Two data sets: neither has a file, and the one is twice the other."""
    base = case(tmp_path, writers.regular(tmp_path / "current.nc"))
    with xr.open_dataset(tmp_path / "current.nc") as opened:
        sea = opened.load()
    names = [str(name) for name in sea.data_vars]
    datasets = {"slow": sea, "fast": sea.assign({name: 2 * sea[name] for name in names})}
    cases = [drift.vary(base, {"current": [{"dataset": name}]}) for name in datasets]
    slow, fast = drift.run_many(cases, datasets=datasets)
    assert slow.error is fast.error is None
    assert bits(slow) != bits(fast)
    assert bits(next(drift.run_many(cases[1:], datasets=datasets))) == bits(fast)


@pytest.mark.thorough
def test_one_that_is_refused_says_so_and_the_others_go_on(tmp_path: Path) -> None:
    lon, lat = middle()
    base = case(
        tmp_path, writers.regular(tmp_path / "current.nc"), islands(tmp_path / "islands.geojson")
    )
    base = drift.vary(base, {"max_lost": 0.2})
    outside = drift.vary(
        base, {"scenario.0.position.at": [lon + 40, lat], "scenario.1.position.at": [lon + 40, lat]}
    )
    on_land = drift.vary(base, {"scenario.0.position.at": [lon + 0.14, lat + 0.11]})
    too_late = drift.vary(base, {"start": base.start + np.timedelta64(40, "h")})
    no_file = drift.vary(base, {"current": [{"dataset": "roms"}]})
    wrong = {1: outside, 2: on_land, 3: too_late, 4: no_file}
    told: list[float] = []
    made = list(
        drift.run_many(
            [base, *wrong.values(), base], report=lambda phase, share: told.append(share)
        )
    )
    assert told == [k / 6 for k in range(1, 7)]
    assert bits(made[0]) == bits(made[5])
    for k, own in wrong.items():
        with pytest.raises(UserError) as refused:
            drift.run(own)
        assert str(made[k].error) == str(refused.value)
        assert made[k].case is own
        assert made[k].lon.size == 0


def test_what_is_asked_for_wrongly_is_told_at_once() -> None:
    with pytest.raises(UserError, match="maps"):
        drift.run_many([], maps="first")  # type: ignore[arg-type]
    with pytest.raises(UserError, match="backend"):
        drift.run_many([], backend="abacus")
    spill = next(drift.run_many([drift.load("gulf_containers")]))
    assert "[spill]" in str(spill.error)


@pytest.mark.thorough
def test_maps_are_those_of_a_run(tmp_path: Path) -> None:
    base = case(
        tmp_path, writers.regular(tmp_path / "current.nc"), islands(tmp_path / "islands.geojson")
    )
    alone = drift.run(base).forecast
    (all_of_them,), (last,), (none,) = (
        list(drift.run_many([base], maps=maps)) for maps in (True, "last", False)
    )
    assert none.forecast is None
    assert all_of_them.forecast is not None
    assert all_of_them.forecast.data.identical(alone.data)
    assert last.forecast is not None
    assert last.forecast.data.time.values.tolist() == alone.data.time.values[-1:].tolist()
    mapped = last.forecast.data.status_probability.sel(status=["adrift", "ashore"]).sum()
    # float32 cells
    assert float(last.forecast.probability.sum()) == pytest.approx(float(mapped), abs=1e-5)
    at_end = [float(alone.data[f"mean_{axis}"][-1]) for axis in ("lon", "lat")]
    assert none.mean[-1] == pytest.approx(at_end, abs=1e-9)


@pytest.mark.thorough
def test_maps_of_many_come_in_order_and_are_those_of_each_alone(tmp_path: Path) -> None:
    lon, lat = middle()
    base = case(
        tmp_path, writers.regular(tmp_path / "current.nc"), islands(tmp_path / "islands.geojson")
    )
    cases = [drift.vary(base, {"seed": k, "particles": 200 + 50 * k}) for k in range(4)]
    cases[2] = drift.vary(base, {"scenario.0.position.at": [lon + 0.14, lat + 0.11]})  # on land
    told: list[float] = []
    made = list(drift.run_many(cases, maps=True, report=lambda phase, share: told.append(share)))
    assert told == [0.25, 0.5, 0.75, 1.0]
    assert [one.case for one in made] == cases
    assert made[2].error is not None
    for one, own in zip(made, cases, strict=True):
        if own is not cases[2]:
            assert one.forecast is not None
            assert one.forecast.data.identical(drift.run(own).forecast.data)


@pytest.mark.thorough
def test_memory_does_not_grow_with_the_number_of_forecasts(tmp_path: Path) -> None:
    base = drift.vary(case(tmp_path, writers.regular(tmp_path / "current.nc")), {"particles": 3000})
    lon, lat = middle()
    cases = [
        drift.vary(
            base,
            {
                "seed": k,
                "scenario.0.position.at": [lon + 0.03 * (k % 8), lat],
                "clock.step": "30 min",
            },
        )
        for k in range(110)
    ]
    peaks = []
    for number, one in enumerate(drift.run_many(cases)):
        assert one.error is None
        if number in (29, 109):
            peaks.append(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
    # Each forecast has 24 columns of 3000 numbers of 4 bytes on the device: eighty that were never
    # freed would be 22 MiB.
    assert peaks[1] - peaks[0] < 10 * 1024


def test_what_lies_outside_a_kept_window_is_read_anew() -> None:
    """Rows and columns in any order, and with gaps: a window gives places for those that it has,
    and none where one is missing.
    """
    window = Kept((np.array([7, 4, 5]), np.array([0, 1, 9, 8])))
    rows, columns = window.part((np.array([5, 7]), np.array([9, 0]))) or ()
    assert (rows.tolist(), columns.tolist()) == ([2, 0], [2, 0])
    inside = np.array([0, 9])
    # in a gap, before the first, after the last, far off
    for outside in ([6], [3, 4], [8], [5, 40]):
        assert window.part((np.array(outside), inside)) is None
    assert window.part((np.array([4]), np.array([1, 5]))) is None
