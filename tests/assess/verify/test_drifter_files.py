"""Files of drifters: what they are understood as, and what is rejected."""

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr
from verified_drifters import RADIUS

from drift.case.tracking import reading
from drift.tracking.tracks import records as drifter_records
from drift.tracking.tracks.records import Track
from geo.errors import UserError

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
