"""Where a sensor hears, against pyproj's geodesics and SciPy's interpolation of the tables as they
were written.
"""

import csv
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from pyproj import Geod
from scipy.interpolate import RegularGridInterpolator
from scipy.stats import norm

import drift
from drift.apps.cli import commands as cli
from drift.apps.sensor import reach as reaching
from drift.apps.sensor import text
from geo import sphere
from geo.errors import UserError

PAINTS = False
NMI = 1852.0
GLOBE = Geod(a=sphere.RADIUS, b=sphere.RADIUS)
BEARINGS, RANGES = np.arange(0.0, 360.0, 30.0), np.arange(0.0, 60.1, 0.5) * NMI
NOISE = [(0, 70.0), (60, 66.0), (120, 67.5), (180, 74.0), (240, 73.0), (300, 71.0)]
GAIN = [(0, 12.0), (60, 9.0), (120, 3.0), (180, 7.0), (240, 2.0), (300, 5.0)]
LEVEL, THRESHOLD, SIGMA, UNKNOWN = 152.0, -1.5, 5.0, 3.0
HEADING = (
    # hearing.Ear lays gains out again by true bearing: between bearings of the table it would round
    # corners off
    120.0
)
CASE = f"""
title = "Two in the water"
start = "2026-11-21T00:00Z"
duration = "24 h"
output.every = "12 h"
coast.source = "none"
[[current]]
name = "sea"
constant = {{ speed = "0.5 kn", toward = 90 }}
[[scenario]]
name = "loud"
weight = 2
object = "water"
source_level = "{LEVEL:g} dB"
position = {{ at = "36 00N 070 00W", std = "10 nmi" }}
[[scenario]]
name = "by speed"
object = "water"
source_level = [["4 kn", 138], ["12 kn", 150]]
position = {{ at = "36 00N 070 00W", std = "10 nmi" }}
"""
SONAR = f"""
[sensor.sonar]
loss = {{ file = "tl.nc" }}
noise = {[list(row) for row in NOISE]}
gain = {[list(row) for row in GAIN]}
threshold = {THRESHOLD}
fluctuation = {SIGMA}
unknown = {UNKNOWN}
"""
TOWED = """
[[sortie]]
name = "tow"
start = "+2 h"
end = "+11 h"
speed = "8 kn"
waypoints = ["10 00S 179 30E", "09 30S 179 30W"]
watch = { sensor = "array" }
"""
PLACES = {
    "atlantic": (-70.0, 36.0),
    "antimeridian": (179.8, -17.0),
    "north": (25.0, 89.7),
    "south": (-60.0, -88.2),
}


def losses() -> Any:
    far = np.maximum(RANGES, 100.0)[None, :]
    turn = np.radians(BEARINGS)[:, None]
    return (
        20 * np.log10(far)
        + 5 * np.cos(turn)
        + 3 * np.sin(2 * turn)
        - 9 * np.exp(-(((far / NMI - 30) / 3) ** 2))
    )


def write(tmp_path: Path, *more: str) -> Path:
    table = xr.Dataset(
        {"tl": (("bearing", "range"), losses(), {"units": "dB"})},
        {
            "bearing": ("bearing", BEARINGS, {"units": "degree"}),
            "range": ("range", RANGES, {"units": "m"}),
        },
    )
    table.to_netcdf(tmp_path / "tl.nc")
    pod = xr.Dataset(
        {
            "pod": (
                ("bearing", "range"),
                np.linspace(0.9, 0.2, 12)[:, None] * [1.0, 1.0, 0.5, 0.0],
                {"units": "1"},
            )
        },
        {
            "bearing": ("bearing", BEARINGS, {"units": "degree"}),
            "range": ("range", np.array([0.0, 5.0, 8.0, 12.0]) * NMI, {"units": "m"}),
        },
    )
    pod.to_netcdf(tmp_path / "pod.nc")
    path = tmp_path / "case.toml"
    path.write_text(CASE + "".join(more))
    return path


def array(place: tuple[float, float] | None = None) -> str:
    at = "" if place is None else f"at = [{place[0]}, {place[1]}]\nheading = {HEADING}\n"
    return f'[[sensor]]\nname = "array"\n{at}{SONAR}'


def circle(rows: list[tuple[float, float]], at: Any) -> Any:
    bearing, value = np.array(rows).T
    return np.interp(at % 360, [*bearing, 360.0], [*value, value[0]])


def excess(place: tuple[float, float], lon: Any, lat: Any) -> Any:
    """Signal excess [dB]; NaN beyond the table."""
    azimuth, _, far = GLOBE.inv(
        np.full(lon.shape, place[0]), np.full(lon.shape, place[1]), lon, lat
    )
    azimuth = np.asarray(azimuth) % 360
    closed = np.concatenate([losses(), losses()[:1]])
    table = RegularGridInterpolator(
        ([*BEARINGS, 360.0], RANGES), closed, bounds_error=False, fill_value=np.nan
    )
    loss = table(np.stack([azimuth, far], axis=-1))
    return LEVEL - loss - (circle(NOISE, azimuth) - circle(GAIN, azimuth - HEADING)) - THRESHOLD


@pytest.mark.thorough
@pytest.mark.parametrize(
    "where",
    [
        pytest.param(where, marks=[pytest.mark.thorough] * (where in ("atlantic", "north")))
        for where in PLACES
    ],
)
def test_the_grid_is_the_sonar_equation(tmp_path: Path, where: str) -> None:
    """Between even tables that are as fine as the ones written: to single precision of losses of
    about 100 dB.
    """
    place = PLACES[where]
    found = drift.sensor_reach(drift.load(write(tmp_path, array(place))), "array", tmp_path / "out")
    assert {"sensor.png", "sensor.nc", "sensor.csv"} <= {
        path.name for path in drift.results(tmp_path / "out")
    }
    with xr.open_dataset(tmp_path / "out" / "sensor.nc") as data:
        lon, lat = np.meshgrid(data.lon, data.lat)
        assert data.signal_excess.dims == data.pod.dims == ("lat", "lon")
        assert np.all(np.diff(data.lon) > 0)
        cells = np.random.default_rng(3).integers(lon.size, size=4000)
        expected = excess(place, lon.ravel()[cells], lat.ravel()[cells])
        got, pod = data.signal_excess.values.ravel()[cells], data.pod.values.ravel()[cells]
    heard = np.isfinite(expected) & np.isfinite(got)
    assert heard.sum() > 300
    np.testing.assert_allclose(got[heard], expected[heard], atol=1e-3)
    # 16 values or fewer stand for the unknown; its mixture of normal distributions is a normal
    # distribution.
    chance = norm.cdf(np.nan_to_num(expected, nan=-np.inf) / math.hypot(SIGMA, UNKNOWN))
    np.testing.assert_allclose(pod, chance, atol=2e-3)
    # Nothing above 1 % lies beyond the map, nor is the map much larger than that.
    edge = found.around.pod[:, -1].max()
    assert edge <= 0.0101 or found.extent > RANGES[-1]


def test_ranges_of_half_the_looks_are_where_the_excess_is_nothing(tmp_path: Path) -> None:
    """The zone at 30 nmi of the table is one of its own, and each of its edges is a root of the
    equation.
    """
    place = PLACES["atlantic"]
    found = drift.sensor_reach(drift.load(write(tmp_path, array(place))), "array")
    for bearing in (0, 77, 215):
        for edge in [
            e for zone in reaching.zones(found.range, found.around.pod[bearing]) for e in zone
        ]:
            if 0 < edge < found.range[-1]:
                lon, lat, _ = GLOBE.fwd(*place, bearing, edge)
                # Within a step of the ranges the equation is straight to a hundredth of a decibel
                # or so.
                assert abs(excess(place, np.array([lon]), np.array([lat]))[0]) < 0.1


@pytest.mark.thorough
def test_a_towed_array_is_where_its_sortie_has_it(tmp_path: Path) -> None:
    """Four hours at 8 knots along the geodesic, and the array lies along it."""
    case = drift.load(write(tmp_path, array(), TOWED))
    asked = drift.sensor_reach(case, "array", time="+6 h").question
    ahead, _, _ = GLOBE.inv(179.5, -10.0, -179.5, -9.5)
    lon, lat, back = GLOBE.fwd(179.5, -10.0, ahead, 4 * 8 * NMI)
    assert asked.place == pytest.approx((lon, lat), abs=1e-6)
    assert math.degrees(asked.heading) == pytest.approx((back + 180) % 360, abs=1e-3)
    assert drift.sensor_reach(case, "array").question.time == np.datetime64("2026-11-21T02:00")


@pytest.mark.thorough
def test_the_source_is_the_one_that_is_asked_for(tmp_path: Path) -> None:
    case = drift.load(write(tmp_path, array(PLACES["atlantic"])))
    levels = [
        drift.sensor_reach(case, "array", **asked).question.level
        for asked in ({}, {"scenario": "by speed"}, {"scenario": "by speed", "speed": "8 kn"})
    ]
    assert levels == pytest.approx([LEVEL, 138.0, 144.0], abs=1e-4)


def test_a_table_of_pod(tmp_path: Path) -> None:
    """By bearing and range as it stands; nothing is said of signal excess."""
    case = drift.load(
        write(
            tmp_path,
            '[[sensor]]\nname = "radar"\nat = "36 00N 070 00W"\npod = { file = "pod.nc" }\n',
        )
    )
    drift.sensor_reach(case, "radar", tmp_path / "out")
    rows = list(csv.DictReader((tmp_path / "out" / "sensor.csv").read_text().splitlines()))
    pod = {(int(row["bearing_deg"]), float(row["range_nmi"])): float(row["pod"]) for row in rows}
    assert pod[0, 4.0] == pytest.approx(0.9, abs=1e-4)
    # half of 0.5 to 0, to the step between ranges
    assert pod[330, 10.0] == pytest.approx(0.2 * 0.25, abs=2e-3)
    assert {row["signal_excess_db"] for row in rows} == {""}
    with xr.open_dataset(tmp_path / "out" / "sensor.nc") as data:
        assert "signal_excess" not in data


def test_the_command_tells_and_writes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = write(tmp_path, array(PLACES["atlantic"]))
    assert cli.main(["sensor", str(path), "array", "--out", str(tmp_path / "out"), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["sensor"]["name"] == "array"
    assert told["sensor"]["source_level_db"] == LEVEL
    assert told["sensor"]["range_50_nmi"]["min"] <= told["sensor"]["range_50_nmi"]["median"]
    assert cli.main(["sensor", str(path), "array", "--out", str(tmp_path / "out")]) == 2
    assert "--overwrite" in capsys.readouterr().err
    assert drift.check(drift.load(path))['sensor "array"'].startswith("sonar")


WRONG: dict[str, tuple[str, dict[str, Any], str]] = {
    "another name": (
        "",
        {"name": "aray"},
        'no sensor "aray" in case.toml; did you mean "array"? there are: array',
    ),
    "no place": (
        "towed",
        {},
        'where is sensor "array"? Neither its table (at) nor a sortie gives a position; give at',
    ),
    "no heading": (
        "towed",
        {"at": "36 00N 070 00W"},
        'sensor "array" has an array: give its heading, like 045',
    ),
    "two places": ("", {"at": "36 00N 070 00W"}, 'sensor "array" has the position of its table'),
    "no position": ("towed", {"at": "here"}, "at: "),
    "a beam too many": ("", {"beams": [2]}, "beams: beams [2] must be numbers from 1 to 1"),
    "no scenario": ("", {"scenario": "lowd"}, 'scenario: no scenario "lowd"; did you mean "loud"?'),
    "a speed in metres": ("", {"speed": "8 m"}, "speed: "),
    "no time": ("", {"time": "noon"}, "time: "),
    "a heading beyond the circle": (
        "towed",
        {"at": "36 00N 070 00W", "heading": "400"},
        "heading: ",
    ),
}


@pytest.mark.parametrize("what", WRONG)
def test_what_does_not_fit_is_refused_in_a_line(tmp_path: Path, what: str) -> None:
    kind, asked, message = WRONG[what]
    case = drift.load(write(tmp_path, array(None if kind else PLACES["atlantic"])))
    with pytest.raises(UserError) as caught:
        drift.sensor_reach(case, **{"name": "array", **asked})
    assert len(caught.value.lines) == 1
    assert caught.value.lines[0].startswith(message)


def test_beams_that_are_no_numbers(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = write(tmp_path, array(PLACES["atlantic"]))
    assert cli.main(["sensor", str(path), "array", "--beams", "port"]) == 2
    assert '--beams "port" must be numbers' in capsys.readouterr().err


def test_a_time_before_and_after_the_run_may_be_asked_for(tmp_path: Path) -> None:
    case = drift.load(write(tmp_path, array(PLACES["atlantic"])))
    assert drift.sensor_reach(
        case, "array", time="+900 h"
    ).question.time == case.start + np.timedelta64(900, "h")


@pytest.mark.thorough
def test_each_question_has_a_run_id_of_its_own(tmp_path: Path) -> None:
    """The same sensor of the same case at two times; asked again, the first has its id again."""
    case = drift.load(write(tmp_path, array(PLACES["atlantic"])))
    found = []
    for number, hours in enumerate((2, 3, 2)):
        out = tmp_path / str(number)
        drift.sensor_reach(case, "array", out, time=f"+{hours} h")
        with xr.open_dataset(out / "sensor.nc") as data:
            found.append(data.attrs["run_id"])
    assert found[0] == found[2] != found[1]


def test_a_sonar_that_hears_the_same_all_round_needs_no_heading(tmp_path: Path) -> None:
    lines = [line for line in SONAR.splitlines() if not line.startswith("gain")]
    case = drift.load(
        write(
            tmp_path,
            '[[sensor]]\nname = "buoy"\nat = "36 00N 070 00W"\n',
            "\n".join([*lines, "gain = 9", ""]),
        )
    )
    question = drift.sensor_reach(case, "buoy").question
    assert not question.has_array
    assert "array on" not in text.described(question)
