"""Forecasts of drifters against drifters simulated here in float64, and what files of drifters are
understood as.
"""

import csv
import json
import math
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr
from scipy import stats

import drift
from drift.apps.cli import commands
from drift.assess.verify import chapter as verification_chapter
from drift.assess.verify import grounding, scores, starts, verification
from drift.assess.verify import text as verification_text
from drift.case.tracking import reading
from drift.engine.environment.environment_spec import Coast
from drift.tracking.tracks import records as drifter_records
from drift.tracking.tracks.records import Believed, Track
from geo.errors import UserError

RADIUS = 6_371_008.8  # [m] of the sphere
EAST, NORTH = 0.31, -0.17  # [m/s] a current that is the same everywhere

CASE = """
title = "Simulated drifters"
start = "2021-03-01T00:00Z"
duration = "24 h"
clock.step = "30 min"
coast.source = "none"
current = [{{ name = "known", constant = {{ east = {east}, north = {north} }} }}]
[uncertainty]
current = {{ std = "{std} m/s", time = "{time} h" }}
diffusivity = "{diffusivity} m2/s"
[[scenario]]
name = "drifter"
object = "water"
position = {{ at = [1.0, 45.0], std = "1 nmi" }}
"""


def case(tmp_path, std=0.26, time=7.0, diffusivity=25.0, east=EAST, north=NORTH):
    file = tmp_path / "case.toml"
    file.write_text(
        CASE.format(std=std, time=time, diffusivity=diffusivity, east=east, north=north)
    )
    return drift.load(file)


def carried(lon, lat, seconds, east=EAST, north=NORTH):
    """Return where a steady east and north [m/s] lead [deg]: a rhumb line on the sphere, in closed
    form.
    """
    begin, end = np.radians(lat), np.radians(lat) + north * seconds / RADIUS
    stretched = np.arcsinh(np.tan(end)) - np.arcsinh(np.tan(begin))
    return lon + np.degrees(east / north * stretched), np.degrees(end)


def simulated(count, seed, std=0.26, time=7.0, diffusivity=25.0, error=600.0, hours=24):
    """Return tracks with hourly fixes of what drifts in the known current with errors; the first
    fix alone is in error.

    The errors' displacements are drawn hour by hour from their exact joint law (Uhlenbeck and
    Ornstein 1930).
    """
    rng = np.random.default_rng(seed)
    dt, memory = 3600.0, time * 3600
    fall = math.exp(-dt / memory)
    var_x = std**2 * memory**2 * (2 * dt / memory - 3 + 4 * fall - fall**2) + 2 * diffusivity * dt
    cov = np.array([[var_x, std**2 * memory * (1 - fall) ** 2], [0, std**2 * (1 - fall**2)]])
    cov[1, 0] = cov[0, 1]
    factor = np.linalg.cholesky(cov)
    velocity = rng.normal(0, std, (2, count))
    moved = np.zeros((hours + 1, 2, count))
    for k in range(hours):
        noise = np.einsum("ij,jcn->icn", factor, rng.standard_normal((2, 2, count)))
        moved[k + 1] = moved[k] + memory * (1 - fall) * velocity + noise[0]
        velocity = fall * velocity + noise[1]
    tracks = []
    start = np.datetime64("2021-03-01T05:00", "s").astype(int)
    scatter = rng.normal(0, error / math.sqrt(2 * math.log(2)), (2, count))
    for n in range(count):
        times = start + 3 * 86_400 * n + dt * np.arange(hours + 1)  # each on days of its own
        lon, lat = carried(
            -30.0 + rng.uniform(0, 50), rng.uniform(-58, 58), times - times[0] + 1e-9
        )
        lat = lat + np.degrees(moved[:, 1, n] / RADIUS)
        lon = lon + np.degrees(moved[:, 0, n] / RADIUS / np.cos(np.radians(lat)))
        lat[0] += np.degrees(scatter[1, n] / RADIUS)
        lon[0] += np.degrees(scatter[0, n] / RADIUS / np.cos(np.radians(lat[0])))
        tracks.append(Track(f"buoy {n}", times, lon, lat))
    return tracks


COUNT = 80


@pytest.mark.thorough
def test_areas_hold_what_they_say_and_ranks_are_uniform(tmp_path):
    """Within three standard errors of independent forecasts; ranks by Kolmogorov and Smirnov at 1
    in 1,000.
    """
    made = drift.verify(case(tmp_path), simulated(COUNT, 5), error=600.0, particles=800)
    assert made.skill.size == COUNT
    assert made.leads.tolist() == [6, 12, 24]
    for lead in range(3):
        for share in (0.5, 0.75, 0.9, 0.95):
            held = made.held(lead, share)
            assert abs(held.mean - share) < 3 * math.sqrt(share * (1 - share) / COUNT)
            assert held.error >= 0.99 * math.sqrt(held.mean * (1 - held.mean) / COUNT)
        for ranks in (made.containment, made.along, made.across):
            assert stats.kstest(ranks[:, lead], "uniform").pvalue > 1e-3
    assert "as stated" in verification_text.headline(made)
    # means of squares of n normals of variance s2 per component: relative standard error 1 /
    # sqrt(n) of the sum of both
    ratio = (made.apart[:, -1] ** 2).mean() / (made.spread[:, -1] ** 2).mean()
    assert abs(ratio - 1) < 3 / math.sqrt(COUNT)


@pytest.mark.thorough
def test_errors_a_third_as_large_hold_what_the_closed_form_says(tmp_path):
    """A round normal law a third as wide: its area of share p holds 1 - (1 - p)^(1/9) of the true
    law.

    The area's radius is r with r^2 = -2 (s / 3)^2 log(1 - p), and 1 - exp(-r^2 / 2 s^2) lies within
    it.
    """
    third = case(tmp_path, std=0.26 / 3, diffusivity=25.0 / 9)
    made = drift.verify(third, simulated(COUNT, 5), error=200.0, particles=800)
    for lead in range(3):
        for share in (0.5, 0.9, 0.95):
            expected = 1 - (1 - share) ** (1 / 9)
            assert abs(made.held(lead, share).mean - expected) < 3 * math.sqrt(
                expected * (1 - expected) / COUNT
            )
    assert "too small" in verification_text.headline(made)
    assert verification_text.headline(made) in repr(made)
    assert len(repr(made)) < 3000  # figures, and no arrays


def apart(lon1, lat1, lon2, lat2):
    """Return great-circle distances [m] by the haversine formula."""
    a, b, c, d = (np.radians(angle) for angle in (lon1, lat1, lon2, lat2))
    h = np.sin((d - b) / 2) ** 2 + np.cos(b) * np.cos(d) * np.sin((c - a) / 2) ** 2
    return 2 * RADIUS * np.arcsin(np.sqrt(h))


def test_skill_and_separation_without_errors(tmp_path):
    """A drifter that goes another way than the current, across the antimeridian: all distances
    follow from both ways.
    """
    begin = np.datetime64("2021-03-01T05:20", "s").astype(int)
    time = begin + np.cumsum([0, *np.random.default_rng(3).integers(900, 9000, 45)])
    lon, lat = carried(179.9, 44.2, time - begin + 1e-9, east=0.22, north=-0.09)
    track = Track("7", time.astype(float), (lon + 180) % 360 - 180, lat)
    made = drift.verify(
        case(tmp_path, std=0.0, diffusivity=0.0),
        [track],
        hours=18,
        every=6 * 3600.0,
        error=0.5,
        particles=1000,
    )
    last = time[-1] - 18 * 3600
    assert made.start.tolist() == list(range(begin, last + 1, 6 * 3600))
    hours = np.arange(3.0, 18.1, 3.0)
    assert made.hours.tolist() == hours.tolist()
    for n, start in enumerate(made.start):
        x, y = carried(
            179.9, 44.2, start - begin + 3600 * np.append(0.0, hours) + 1e-9, east=0.22, north=-0.09
        )
        u, v = carried(x[0], y[0], 3600 * hours)
        separation, persistence = apart(u, v, x[1:], y[1:]), apart(x[0], y[0], x[1:], y[1:])
        way = np.cumsum(apart(x[:-1], y[:-1], x[1:], y[1:]))
        # positions are whole multiples of 9.3 mm, a step; a chord between fixes 2.5 h apart leaves
        # the rhumb line by less than (way / 2)^2 tan(lat) / (2 R) = 0.1 m; the mean of 1000 starts
        # of std 0.42 m is off by 13 mm
        assert made.apart[n] == pytest.approx(separation, abs=1.0)
        assert made.waiting[n] == pytest.approx(persistence, abs=1.0)
        assert made.way[n] == pytest.approx(way, abs=2.0)
        assert made.skill[n] == pytest.approx(
            1 - separation.sum() / way.sum(), abs=2.0 * 6 / way.sum() * 2
        )
    assert (made.containment > 0.999).all()  # far outside
    # the current goes faster, and a drifter that heads less to the south lies to the left of it
    u, v = EAST / math.hypot(EAST, NORTH), NORTH / math.hypot(EAST, NORTH)
    difference = np.array([0.22 - EAST, -0.09 - NORTH])
    ahead, right = difference @ (u, v), difference @ (v, -u)
    assert (made.along[:, -1] > 0.5).all() == (ahead > 0)
    assert (made.across[:, -1] > 0.5).all() == (right > 0)
    told = verification_text.verification_facts(made)
    assert ("left" in told["rank across the drift"]) == (right < 0)
    assert ("slower" in told["rank along the drift"]) == (ahead < 0)


def test_containment_is_uniform_whatever_the_law():
    """The drifter as one more draw from a bent, clustered law, with a tenth of all at one place, as
    on a beach.
    """
    rng = np.random.default_rng(14)
    found = []
    for _ in range(300):
        x = rng.normal(0, 3000, 401)
        y = x**2 / 5000 + rng.normal(0, 300, 401)
        y[rng.random(401) < 0.3] -= 9000
        found.append(scores.containment(x[1:] - x[0], y[1:] - y[0], np.full(400, 1 / 400)))
    assert stats.kstest(found, "uniform").pvalue > 1e-3


def test_of_places_as_dense_as_the_drifters_half_counts() -> None:
    """All at one place are alike: the drifter's rank among them is in the middle, as that of places
    equal in a coordinate.
    """
    still = np.zeros(50)
    assert scores.containment(still, still, np.full(50, 1 / 50)) == pytest.approx(0.5)
    values = np.array([-3.0, 0.0, 0.0, 0.0, 2.0])
    assert scores.rank(values, np.full(5, 0.2)) == pytest.approx((1 + (3 + 1) / 2) / 6)


def test_columns_along_the_track_are_a_current_by_time(tmp_path):
    """The same forecast, particle for particle, as of a case that has the columns' values as a
    table of its own.
    """
    track = simulated(1, 9, hours=30)[0]
    u = 0.2 + 0.1 * np.sin(np.arange(31) / 3.1)
    v = -0.1 + 0.2 * np.cos(np.arange(31) / 2.3)
    given = Track("9", track.time, track.lon, track.lat, {"ue": u, "vn": v})
    base = case(tmp_path)
    columns = {"current_east": "ue", "current_north": "vn"}
    made = drift.verify(base, [given], columns=columns, every=3600.0 * 100, particles=600)
    rows = [
        {"time": f"{np.datetime64(int(t), 's')}Z", "east": float(a), "north": float(b)}
        for t, a, b in zip(track.time[:25], u, v, strict=False)
    ]
    other = drift.verify(
        drift.vary(base, {"current": [{"name": "t", "table": rows}]}),
        [given],
        every=3600.0 * 100,
        particles=600,
    )
    assert np.array_equal(made.apart, other.apart)
    assert np.array_equal(made.containment, other.containment)
    with pytest.raises(UserError, match='no column "w"'):
        drift.verify(base, [given], columns={"current_east": "ue", "current_north": "w"})


@pytest.mark.parametrize("job", [drift.verify, drift.fit_errors])
def test_what_does_not_drift_is_refused(tmp_path, job):
    base = case(tmp_path)
    steaming = replace(base, scenarios=(replace(base.scenarios[0], model="steaming"),))
    with pytest.raises(UserError) as caught:
        job(steaming, simulated(2, 3))
    assert str(caught.value) == (
        f'{base.path.name}: scenario "drifter" has motion = "steaming"; '
        'drifters can only be compared with motion = "drift"'
    )


@pytest.mark.parametrize(
    ("stated", "words", "spread"),
    [
        (
            None,
            "current 0.31 m/s over 11 h and 0.08 m/s that lasts (default)",
            (0.31, 11 * 3600.0, 0.08),
        ),
        (
            {"current": {"std": 0.0, "bias": 0.3}},
            "current 0.3 m/s that lasts (case)",
            (0.0, 1.0, 0.3),
        ),
        ("none", "no error of the current (case)", (0.0, 1.0, 0.0)),
    ],
)
def test_columns_of_a_model_err_as_its_files_would(tmp_path, stated, words, spread):
    """What is told of the errors is what particles have: after t, 2 s^2 T (t - T (1 - exp(-t / T)))
    + b^2 t^2 a component.
    """
    track = simulated(1, 9, hours=30)[0]
    given = Track(
        "9", track.time, track.lon, track.lat, {"ue": np.full(31, 0.2), "vn": np.full(31, -0.1)}
    )
    base = drift.vary(case(tmp_path), {"uncertainty": stated})
    columns = {"current_east": "ue", "current_north": "vn"}
    made = drift.verify(base, [given], columns=columns, every=3600.0 * 100, particles=4000)
    assert verification_text.assumed_errors(made).startswith(words)
    std, memory, bias = spread
    t = 86_400.0
    walk = 2 * std**2 * memory * (t - memory * (1 - math.exp(-t / memory)))
    expected = 2 * (walk + bias**2 * t**2 + (100 / math.sqrt(2 * math.log(2))) ** 2)
    # a mean square of 4,000 pairs of normals: relative standard error 1 / sqrt(4,000)
    assert abs(made.spread[0, -1] ** 2 / expected - 1) < 3 / math.sqrt(4000)


GDP = """platform_code,platform_type,time,latitude,longitude,sst
,,UTC,degrees_north,degrees_east,Deg C
62,BUOY,2021-03-03T18:00:00Z,44.6818,-2.5441,13.09
62,BUOY,2021-03-03T20:00:00Z,44.7000,357.4400,13.09
62,BUOY,2021-03-03T19:00:00Z,44.6900,-2.5500,13.09
62,BUOY,2021-03-03T19:00:00Z,44.6900,-2.5500,13.09
62,BUOY,2021-03-03T19:00:00Z,44.6920,-2.5500,13.09
62,BUOY,2021-03-03T21:00:00Z,95.0,-2.5500,13.09
62,BUOY,2021-03-03T21:30:00Z,46.0,-2.5500,13.09
62,BUOY,2021-03-03T22:00:00Z,44.7100,-2.5700,13.09
63,BUOY,2021-03-03T22:00:00Z,44.0,-3.0,13.09
"""


def test_a_table_is_understood_and_what_is_refused_is_counted(tmp_path):
    file = tmp_path / "gdp.csv"
    file.write_text(GDP)
    raw = reading.read_drifters(file, ["sst"])
    assert [(track.name, track.time.size) for track in raw] == [("62", 8), ("63", 1)]
    assert raw[0].columns["sst"].tolist() == [13.09] * 8
    found = drifter_records.believed(raw)
    (track,) = found.tracks
    begin = np.datetime64("2021-03-03T18:00", "s").astype(int)
    assert ((track.time - begin) / 3600).tolist() == [0, 1, 2, 4]
    assert track.lon == pytest.approx([-2.5441, -2.55, -2.56, -2.57])
    assert track.lat == pytest.approx([44.6818, 44.69, 44.70, 44.71])
    told = "; ".join(found.notes)
    for words in ("1 fixes left out without a time or with an impossible", "1 fixes left out that repeat", "1 fixes left out at another place",
                  "1 fixes left out that need more than 3 m/s", "fewer than two fixes: 63"):  # fmt: skip
        assert words in told


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("2021-03-03 18:00:30", "2021-03-03T18:00:30"),
        ("2021-03-03T19:30:30+01:30", "2021-03-03T18:00:30"),
        ("2021-03-03 13:00:30-05", "2021-03-03T18:00:30"),
        ("2021/03/03 18:00:30", "2021-03-03T18:00:30"),
        ("1614794430", "2021-03-03T18:00:30"),
        ("03-Mar-2021 18:00:30", "2021-03-03T18:00:30"),
        ("031800ZMAR21", "2021-03-03T18:00:00"),
        ("20210303T180030", "2021-03-03T18:00:30"),
    ],
)
def test_forms_of_time(tmp_path, text, expected):
    file = tmp_path / "a.csv"
    file.write_text(f"id;time;lon;lat\na;{text};1.5;2.5\n")
    (track,) = reading.read_drifters(file)
    assert track.time.tolist() == [np.datetime64(expected, "s").astype(int)]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a,b\n1,2\n", "no column of time"),
        ("id,time,lon,lat\na,03/04/2021 18:00,1,2\n", "two ways"),
        ("id,time,lon,lat\na,yesterday,1,2\n", "not a time"),
        ("id,time,lon,lat\na,2021-03-03 18:00 CET,1,2\n", '"2021-03-03 18:00 CET" is not a time'),
        (
            "id,time,lon,lat\na,2021-03-03T18:00Z,5 30.0 W,46.5\n",
            'column of lon, "lon": the first has "5 30.0 W"',
        ),
        (
            "id,time,lon,lat\na,2021-03-03T18:00Z,-5.5,NaN\n",
            "no row has a number in its column of lat",
        ),
        ("id,time,lon,lat\n", "no table"),
        ("\0\x01", "no table"),
    ],
)
def test_what_is_no_table_of_drifters_is_one_line(tmp_path, text, words):
    file = tmp_path / "a.csv"
    file.write_text(text)
    with pytest.raises(UserError, match=words):
        reading.read_drifters(file)
    with pytest.raises(UserError, match="cannot be read"):
        reading.read_drifters(tmp_path / "none.csv")


@pytest.mark.parametrize(
    "text",
    [
        "ID,time (UTC),longitude (degrees_east),latitude (degrees_north)\nb,2021-03-03T18:00:00Z,354.5,46.25\na,2021-03-03T18:30:00Z,2,3\nb,2021-03-03T19:00:00Z,355,47\n",
        "Buoy;Date Time [UTC];Lon [deg];Lat [deg]\nb;2021-03-03 18:00;354,5;46,25\na;2021-03-03 18:30;2;3\nb;2021-03-03 19:00;355,0;47\n",
    ],
)
def test_units_in_a_header_and_decimal_commas(tmp_path, text):
    file = tmp_path / "a.csv"
    file.write_text(text)
    first, second = reading.read_drifters(file)
    assert (first.name, second.name) == ("b", "a")
    assert (first.lon.tolist(), first.lat.tolist()) == ([354.5, 355.0], [46.25, 47.0])
    assert (first.time - second.time[0]).tolist() == [-1800.0, 1800.0]


def test_a_drifter_of_which_no_fix_is_left_is_told(tmp_path):
    file = tmp_path / "a.csv"
    file.write_text(
        "id,time,lon,lat\na,2021-03-03T18:00Z,1,2\na,2021-03-03T19:00Z,1,2.01\nb,2021-03-03T18:00Z,1,200\n"
    )
    found = drifter_records.believed(reading.read_drifters(file))
    assert [track.name for track in found.tracks] == ["a"]
    assert found.notes[-1] == "1 track left out with fewer than two fixes: b"


def test_a_fix_is_wrong_that_is_both_reached_and_left_too_fast():
    """2 km in 5 min between fixes that agree with all others: which of the two errs nobody knows,
    and both stay.
    """
    seconds, metres = (
        np.array([0, 3600, 3900, 7200, 10_800.0]),
        np.array([0, 1000, 3000, 4000, 5000.0]),
    )
    track = Track("a", 1.6e9 + seconds, np.full(5, -5.5), 46.0 + np.degrees(metres / RADIUS))
    assert drifter_records.believed([track]).notes == ()
    spike = replace(track, lat=track.lat + np.degrees(np.array([0, 0, 20_000, 0, 0]) / RADIUS))
    (left,) = drifter_records.believed([spike]).tracks
    assert (left.time - 1.6e9).tolist() == [0, 3600, 7200, 10_800]


def test_a_name_that_promises_netcdf(tmp_path):
    file = tmp_path / "a.nc"
    file.write_text("id,time,lon,lat\n")
    with pytest.raises(UserError, match="is no netCDF file"):
        reading.read_drifters(file)


def test_every_layout_of_trajectories_gives_the_same_tracks(tmp_path):
    lon, lat = np.array([1.0, 2, 3, 10, 11]), np.array([5.0, 6, 7, 50, 51])
    time = np.array(
        ["2021-03-01T00", "2021-03-01T01", "2021-03-01T03", "2021-03-02T00", "2021-03-02T05"],
        "datetime64[ns]",
    )
    meta = {
        "lon": {"standard_name": "longitude"},
        "lat": {"standard_name": "latitude"},
        "time": {"standard_name": "time"},
    }

    def padded(values, fill):
        return np.array([values[:3], [*values[3:], fill]])

    names = ("trajectory", np.array(["a", "b"]), {"cf_role": "trajectory_id"})
    obs = {
        "lon": ("obs", lon, meta["lon"]),
        "lat": ("obs", lat, meta["lat"]),
        "time": ("obs", time, meta["time"]),
    }
    two = {
        key: (("trajectory", "obs"), padded(values, fill), meta[key])
        for key, values, fill in (
            ("lon", lon, np.nan),
            ("lat", lat, np.nan),
            ("time", time, np.datetime64("NaT", "ns")),
        )
    }
    layouts = {
        "ragged": {
            **obs,
            "name": names,
            "count": ("trajectory", np.array([3, 2]), {"sample_dimension": "obs"}),
        },
        "gdp": {
            **obs,
            "ID": ("trajectory", np.array(["a", "b"])),
            "rowsize": ("trajectory", np.array([3, 2])),
        },
        "indexed": {
            **obs,
            "name": names,
            "which": ("obs", np.array([0, 0, 0, 1, 1]), {"instance_dimension": "trajectory"}),
        },
        "padded": {**two, "drifter_names": names},
        "turned": {
            **{k: (v[0][::-1], v[1].T, v[2]) for k, v in two.items()},
            "drifter_names": names,
        },
    }
    for name, variables in layouts.items():
        file = tmp_path / f"{name}.nc"
        xr.Dataset(variables).to_netcdf(file)
        tracks = reading.read_drifters(file)
        assert [track.name for track in tracks] == ["a", "b"], name
        assert tracks[0].lon.tolist() == [1, 2, 3], name
        assert tracks[1].lat.tolist() == [50, 51], name
        assert np.diff(tracks[0].time).tolist() == [3600, 7200], name
        assert tracks[1].time[0] == np.datetime64("2021-03-02", "s").astype(int), name


def test_the_buoy_that_stranded_on_hopen_is_aground_from_then_on(data):
    """UIB-2022-TILL-01 stranded on 2022-10-18 about 20:30 UTC, as its owners say; the other drifted
    on.
    """
    found = drifter_records.believed(reading.read_drifters(data / "barents" / "barents.nc"))
    told = drifter_records.words_for_spells(found.tracks, found.aground)
    assert "UIB-2022-TILL-01 from 2022-10-18T20:" in told
    assert "TILL-02" not in told
    late = found.tracks[0].time > np.datetime64("2022-10-18T21:00", "s").astype(int)
    afloat = found.tracks[0].time[late & ~found.aground[0]]
    assert (afloat > np.datetime64("2022-11-01", "s").astype(int)).all()


def test_the_command_writes_results_that_are_whole(tmp_path, capsys):
    case(tmp_path)
    rows = ["id,time,lon,lat"]
    for track in simulated(3, 2):
        rows += [
            f"{track.name},{np.datetime64(int(t), 's')}Z,{x},{y}"
            for t, x, y in zip(track.time, track.lon, track.lat, strict=True)
        ]
    (tmp_path / "buoys.csv").write_text("\n".join(rows))
    out = tmp_path / "out"
    told = [
        "--drifters",
        str(tmp_path / "buoys.csv"),
        "--error",
        "600 m",
        "--particles",
        "500",
        "--out",
        str(out),
    ]
    assert commands.main(["verify", str(tmp_path / "case.toml"), *told]) == 0
    said = capsys.readouterr().out
    assert "the 90 % area held" in said
    assert "few" in said
    assert {path.name for path in drift.results(out)} == {
        *verification_chapter.FILES,
        *verification_chapter.PICTURES,
        "summary.json",
        "manifest.json",
    }
    listed = list(csv.DictReader((out / "verify.csv").read_text().splitlines()))
    assert len(listed) == 3 * 3
    summary = json.loads((out / "summary.json").read_text())["verification"]
    with xr.open_dataset(out / "verify.nc") as stored:
        assert stored["containment"].shape == (3, 3)
        assert stored.attrs["uncertainty"].startswith(
            "current 0.26 m/s over 7 h (case); diffusivity 25 m2/s (case); start 600 m"
        )
        share = float((stored["containment"][:, -1] <= 0.9).mean())
    assert summary["leads"][-1]["held"]["90%"]["mean"] == pytest.approx(share)
    assert share == pytest.approx(
        np.mean([float(row["containment"]) <= 0.9 for row in listed if row["lead_h"] == "24"])
    )
    for wrong, words in (
        (["--error", "3 kn"], "--error"),
        (["--every", "1 s"], "--every"),
        (["--hours", "1.5"], "--hours"),
        (["--columns", "current_east=u"], "without its other"),
        (["--columns", "tide=u"], "must be one of"),
        (["--particles", "20"], "--particles"),
        (["--hours", "200"], "no drifter can be followed"),
    ):
        assert (
            commands.main(["verify", str(tmp_path / "case.toml"), *told, "--overwrite", *wrong])
            == 2
        )
        assert words in capsys.readouterr().err


def test_no_forecast_begins_ends_or_passes_in_a_silence():
    """Hourly fixes from 0 to 3 h and from 9 to 40 h, and one at 50 h: only what stays within 9 to
    40 h is forecast.
    """
    hours = np.array([0, 1, 2, 3, *range(9, 41), 50.0])
    track = Track("a", 1.6e9 + 3600 * hours, 0.001 * hours, 45.0 + 0.001 * hours)
    stranded = starts.mark_stranded(
        Believed((track,), (), (np.zeros(37, bool),)), Coast("none", "strand")
    )
    for length, begins, silent, ended in (
        (24, [12], 8, 0),
        (6, [12, 18, 24, 30], 5, 0),
        (1, [0, 12, 18, 24, 30, 36], 3, 0),
    ):
        found, left, _ = starts.find_starts(stranded, 6 * 3600.0, length * 3600.0, 3 * 3600.0, 3.0)
        assert [(one.track, (one.time - 1.6e9) / 3600, one.until) for one in found] == [
            (0, x, np.inf) for x in begins
        ]
        assert (left.gap, left.ended, left.aground, left.stopped) == (silent, ended, 0, 0)


SQUARE = """{"type": "FeatureCollection", "features": [{"type": "Feature", "properties": {}, "geometry": {"type": "Polygon",
"coordinates": [[[-48, 40.2], [-32, 40.2], [-32, 44], [-48, 44], [-48, 40.2]]]}}]}"""


def test_what_becomes_of_a_drifter_that_stops(tmp_path):
    """Hourly fixes at 39.9 N to 40.2 N, where the land begins, by 10 h; then still.

    What follows differs.
    """
    (tmp_path / "land.geojson").write_text(SQUARE)
    shore = Coast(str(tmp_path / "land.geojson"), "strand")
    hour, begin = 3600.0, 1.6e9

    def track(name, hours, aground, lat=40.2):
        """Fixes at these hours: northward up to lat at 10 h, there until `aground`, then back
        southward.
        """
        back = 0.03 * (np.maximum(10 - hours, 0) + np.maximum(hours - aground, 0))
        return Track(name, begin + hour * hours, np.full(hours.size, -40.0), lat - back)

    to_the_end = track("a", np.arange(60.0), 60)
    silent_there = track("b", np.arange(30.0), 30)
    refloats = track("c", np.arange(60.0), 29)
    moored = track("d", np.arange(60.0), 60, lat=39.9)  # 33 km off
    carried = track("e", np.append(np.arange(30.0), np.arange(90.0, 99.0)), 30)
    ends_off = track("f", np.arange(10.0), 10)  # its last fix is 3.3 km off
    tracks = [to_the_end, silent_there, refloats, moored, carried, ends_off]
    believed = drifter_records.believed(tracks)
    assert [int(mask.sum()) for mask in believed.aground] == [50, 20, 20, 50, 20, 0]
    settings = 5 * hour, 24 * hour, 3 * hour, 3.0  # starts at 0, 5, 10 .. h
    stranded = starts.mark_stranded(believed, shore)
    found, left, early = starts.find_starts(stranded, *settings)
    hours_of = {name: [] for name in "abcdef"}
    for one in found:
        hours_of[tracks[one.track].name].append(
            ((one.time - begin) / hour, (one.until - begin) / hour)
        )
    seen = [(0.0, np.inf), (5.0, np.inf)]
    assert hours_of["a"] == seen
    # 29 h is the last fix and the end of the second
    assert hours_of["b"] == [(0.0, np.inf), (5.0, np.inf)]
    assert hours_of["c"] == [*seen, (30.0, np.inf), (35.0, np.inf)]
    assert hours_of["d"] == []
    assert hours_of["e"] == seen
    assert hours_of["f"] == []
    # e is aground until it is seen again
    assert (left.aground, left.stopped, left.gap) == (10 + 4 + 4 + 16, 12, 0)
    # c from 40 h on (4 starts), d never, e from 90 h on (2), f both
    assert left.ended == len(early) == 4 + 2 + 2
    lon, lat, aground = stranded.position(
        starts.Start(1, int(begin)), begin + hour * np.array([9.0, 9.5, 11.0, 29.0])
    )
    assert aground.tolist() == [False, False, True, True]
    assert lat == pytest.approx([40.17, 40.185, 40.2, 40.2], abs=1e-4)
    late = starts.find_starts(stranded, 5 * hour, 40 * hour, 3 * hour, 3.0)[0]
    # held to the end
    assert [one.until for one in late if one.track in (1, 4)] == [begin + 29 * hour] * 4
    lon, lat, aground = stranded.position(late[2], begin + hour * np.array([40.0, 44.0]))
    assert np.stack([lon, lat, aground]) == pytest.approx(
        np.array([[-40.0] * 2, [40.2] * 2, [1.0] * 2])
    )
    notes = []
    _, counts = starts.known_starts(stranded, shore, *settings, notes)
    assert counts == {
        "aground at the start": 34,
        "track ends too early": left.ended,
        "stopped off any shore": 12,
    }
    assert any(f"{left.ended} starts left out: the drifter's track ends before the forecast does, 2 of them" in note
               for note in notes)  # fmt: skip
    # As its note says, what ends near the shore may be counted as aground there.
    ashore = starts.mark_stranded(believed, shore, ends_aground=True)
    held, rest, _ = starts.find_starts(ashore, *settings)
    assert rest.ended == left.ended - 2  # c and e end far off
    assert [one.until for one in held if one.track == 5] == [begin + 9 * hour] * 2
    # Still for 4 h on the shore is aground, and not 4 h in slack water farther off.
    spell = np.append(np.arange(10.0), np.arange(10.0, 30.0))
    for lat, times in ((40.2, 5), (40.15, 0)):
        (mask,) = starts.mark_stranded(
            drifter_records.believed([track("g", spell, 14, lat)]), shore
        ).ashore
        assert (np.flatnonzero(mask).tolist(), mask.sum()) == (list(range(10, 15))[:times], times)
    with pytest.raises(UserError, match="no drifter can be followed"):
        starts.known_starts(starts.mark_stranded(Believed((), (), ()), shore), shore, *settings, [])
    without = starts.mark_stranded(believed, Coast("none", "strand"))
    assert not any(mask.any() for mask in without.ashore)
    assert {one.track for one in starts.find_starts(without, *settings)[0]} == {2}  # from 30 h on


def test_distances_off_a_shore(tmp_path):
    """Off a meridian and a parallel, and over the corner, by the sphere's radius; across the
    antimeridian too.
    """
    (tmp_path / "land.geojson").write_text(SQUARE.replace("-48", "176").replace("-32", "184"))
    shore = Coast(str(tmp_path / "land.geojson"), "strand")
    lon = np.array([180.0, -178.0, -175.97, 175.97, 178.0, 170.0])
    lat = np.array([40.17, 40.15, 42.0, 40.17, 41.0, 41.0])
    found = grounding.distance_from_shore(shore, lon, lat, 6000.0)
    degree = np.radians(1.0) * RADIUS
    squeeze = math.cos(math.radians(42.0)), math.cos(math.radians(40.185))
    expected = [
        0.03 * degree,
        0.05 * degree,
        0.03 * degree * squeeze[0],
        0.03 * degree * math.hypot(1, squeeze[1]),
    ]
    assert found[:4] == pytest.approx(expected, rel=0.02)
    assert found[4:].tolist() == [0.0, np.inf]


def test_forecasts_that_overlap_share_a_cluster_but_no_random_number(tmp_path):
    """Of 25 h, begun a day apart: clusters of two days. Each has a seed of its own."""
    made = drift.verify(
        case(tmp_path), simulated(1, 9, hours=96), hours=25, every=86_400.0, particles=500
    )
    assert made.start.size == 3
    assert made.block.tolist() == (made.start // (2 * 86_400)).tolist()
    assert np.unique(made.block).size == 2
    track, hours = simulated(1, 9, hours=96)[0], np.array([3.0, 25.0])
    seeds = {
        verification._case(case(tmp_path), track, begin, hours, 100.0, 500, {}, k).seed
        for k, begin in enumerate(made.start.tolist())
    }
    assert len(seeds) == 3


def test_lost_probability_is_not_judged():
    held = verification.Estimate(0.2, 0.01, 50, 5, 20)
    assert "too small" in verification_text.verdict(0.9, held, 0.01)
    assert "not to be judged" in verification_text.verdict(0.9, held, 0.3)


def test_skill_of_liu_and_weisberg():
    """1 - (sum of separations / sum of ways so far), by hand; never below 0."""
    assert scores.skill(np.array([1.0, 3.0, 2.0]), np.array([4.0, 6.0, 10.0])) == pytest.approx(0.7)
    assert scores.skill(np.array([10.0, 30.0, 2.0]), np.array([4.0, 6.0, 10.0])) == 0


def test_columns_stand_for_forcing_that_the_case_does_not_have(tmp_path, capsys):
    """The same forecasts as beside a constant that is not used; for the object's wind too."""
    text = CASE.format(std=0.26, time=7.0, diffusivity=25.0, east=EAST, north=NORTH)
    text = text.replace('object = "water"', 'object = { windage = "2 %" }')
    wind = "wind = [{ constant = { east = 1, north = 0 } }]\n"
    (tmp_path / "whole.toml").write_text(text.replace("[uncertainty]", f"{wind}[uncertainty]"))
    line = next(line for line in text.splitlines() if line.startswith("current = [{"))
    (tmp_path / "bare.toml").write_text(text.replace(line, ""))
    track = simulated(1, 9, hours=30)[0]
    rows = ["id,time,lon,lat,u,v,a,b"]
    rows += [
        f"9,{np.datetime64(int(t), 's')}Z,{x},{y},0.2,{0.1 * math.sin(k)},{3 * math.cos(k)},-4"
        for k, (t, x, y) in enumerate(zip(track.time, track.lon, track.lat, strict=True))
    ]
    (tmp_path / "buoy.csv").write_text("\n".join(rows))
    columns = "current_east=u,current_north=v,wind_east=a,wind_north=b"
    whole = drift.verify(
        drift.load(tmp_path / "whole.toml"),
        tmp_path / "buoy.csv",
        columns=reading.parse_columns(columns),
        particles=500,
    )
    told = [
        "verify",
        str(tmp_path / "bare.toml"),
        "--drifters",
        str(tmp_path / "buoy.csv"),
        "--particles",
        "500",
    ]
    assert (
        commands.main([*told, "--columns", columns, "--out", str(tmp_path / "out"), "--quiet"]) == 0
    )
    listed = list(csv.DictReader((tmp_path / "out" / "verify.csv").read_text().splitlines()))
    assert [float(row["containment"]) for row in listed] == whole.containment.ravel().round(
        4
    ).tolist()
    assert [float(row["spread_m"]) for row in listed] == whole.spread[:, [1, 3, 7]].ravel().round(
        1
    ).tolist()
    fit = ["fit-errors", str(tmp_path / "bare.toml"), "--drifters", str(tmp_path / "buoy.csv")]
    assert commands.main([*fit, "--columns", columns.replace("=u,", "=x,")]) == 2
    assert (
        'no column "x"; its columns are id, time, lon, lat, u, v, a, b' in capsys.readouterr().err
    )
    # nothing gives a current
    assert commands.main([*fit, "--columns", "wind_east=a,wind_north=b"]) == 2
    assert "has no current" in capsys.readouterr().err
    loaded = drift.load(tmp_path / "bare.toml", along=["current", "wind"])
    with pytest.raises(
        UserError, match="loaded with along = current, but no columns for it were given"
    ):
        drift.verify(loaded, [track])
