"""Fetching by a GRIB filter: which run and lead time each time comes from, and fields as eccodes
made them.
"""

import socket
from dataclasses import replace
from pathlib import Path
from urllib.parse import parse_qs

import gribs
import hostile
import numpy as np
import pytest

import drift
from drift.apps.fetch import catalogue, fetching, grib_filter, parts
from drift.apps.fetch.order import Order
from geo.box import Box
from geo.errors import UserError
from geo.forcing import sources

OWN = """
[filter]
title = "filter"
quantity = "wind"
protocol = "grib_filter"
address = "{address}"
variables = ["UGRD", "VGRD"]
days_back = 9
days_ahead = 15
license = "free"
runs = {{ folder = "/gfs.%Y%m%d/%H/atmos", file = "gfs.t%Hz.f{{lead:03d}}", level = "10_m_above_ground", every = 6, delay = 5, steps = [[4, 1], [30, 3]] }}
"""
HOUR = np.timedelta64(3600, "s")
RUN = np.datetime64("2026-03-04T06:00:00")
NOW = RUN + np.timedelta64(5 * 3600 + 17 * 60, "s")  # that run is out, the next one is not


@pytest.fixture(autouse=True)
def hasty(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(fetching, "now", lambda: NOW)
    monkeypatch.setattr(parts, "PAUSE", 0.02)
    monkeypatch.setenv("HOME", str(tmp_path))


def speed(time: np.datetime64) -> float:
    """Return the east component that the server has at a time [m/s]: every hour another."""
    return float((time - np.datetime64("2026-01-01", "s")) / HOUR % 97) / 4


def messages(target: str, asked: list[tuple[np.datetime64, int]]) -> bytes:
    """Return u and v as GRIB of the box that is asked for, on a grid of 0.25 degrees."""
    query = {
        key: values[0]
        for key, values in parse_qs(target.partition("?")[2], keep_blank_values=True).items()
    }
    assert query["var_UGRD"] == query["var_VGRD"] == query["lev_10_m_above_ground"] == "on"
    assert query["subregion"] == ""
    _, day, hour, _ = query["dir"].split("/")
    run = np.datetime64(f"{day[4:8]}-{day[8:10]}-{day[10:12]}T{hour}:00:00", "s")
    assert query["file"].startswith(f"gfs.t{hour}z.f")
    lead = int(query["file"][-3:])
    asked.append((run, lead))
    west, east, south, north = (
        float(query[k]) for k in ("leftlon", "rightlon", "bottomlat", "toplat")
    )
    ni, nj = round((east - west) * 4) + 1, round((north - south) * 4) + 1
    keys = {
        "gridType": "regular_ll", "Ni": ni, "Nj": nj, "latitudeOfFirstGridPointInDegrees": north,
        "latitudeOfLastGridPointInDegrees": south, "longitudeOfFirstGridPointInDegrees": west % 360,
        "longitudeOfLastGridPointInDegrees": east % 360, "iDirectionIncrementInDegrees": 0.25,
        "jDirectionIncrementInDegrees": 0.25, "iScansNegatively": 0, "jScansPositively": 0, "jPointsAreConsecutive": 0,
        "dataDate": int(str(run)[:10].replace("-", "")), "dataTime": 100 * int(hour), "forecastTime": lead,
    }  # fmt: skip
    value = speed(run + lead * HOUR)
    return b"".join(
        gribs.pack("GRIB2", {**keys, "shortName": name}, np.full(ni * nj, one))
        for name, one in (("10u", value), ("10v", -value / 2))
    )


def fetched(
    tmp_path: Path, address: str, begin: np.datetime64, end: np.datetime64, box: tuple[float, ...]
):
    own = tmp_path / "own.toml"
    own.write_text(OWN.format(address=address), encoding="utf-8")
    return drift.fetch(
        box=box,
        begin=begin,
        end=end,
        providers=["filter"],
        out=tmp_path / "out",
        catalogue=own,
        timeout=5.0,
    )


def test_times_come_from_the_latest_run_that_has_them(tmp_path: Path) -> None:
    asked: list[tuple[np.datetime64, int]] = []
    begin, end = RUN - 8 * HOUR + np.timedelta64(60, "s"), RUN + 13 * HOUR

    def answer(connection: socket.socket, target: str) -> None:
        connection.sendall(hostile.http(messages(target, asked)))

    with hostile.serving(answer) as address:
        got = fetched(tmp_path, address, begin, end, (178.0, -40.0, 181.0, -38.5))
    # lead 5 of that run is not there: every third hour after 4
    past = [(RUN - 12 * HOUR, 4), (RUN - 12 * HOUR, 3)]
    assert set(asked) >= {(RUN, k) for k in (0, 1, 2, 3, 4, 6, 9, 12, 15)} | {
        (RUN - 6 * HOUR, k) for k in (0, 1, 2, 3, 4)
    }
    assert asked[0] in past
    files = [str(path) for path in got.files if path.suffix == ".nc"]
    source = sources.open_source("wind", files)
    assert source.times[0] <= begin
    assert source.times[-1] >= end
    assert source.grid.lon.min() <= 178.0
    assert np.ptp(source.grid.lon) < 6  # no jump at 180
    for k, time in enumerate(source.times.astype("datetime64[s]")):
        field = source.read(k)
        assert np.nanmax(np.abs(field[..., 0] - speed(time))) < 1e-5 * 25  # 24 bits a value
        assert np.nanmax(np.abs(field[..., 1] + speed(time) / 2)) < 1e-5 * 25


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"GRIB" + bytes(50), "sent half a message"),
        (b"<html>busy</html>", "sent a web page"),
        (b"data file is not present", "sent no GRIB: data file is not present"),
        (b"GRIB" + bytes(50) + b"7777", "stopped after 5 attempts"),
    ],
)
def test_what_is_no_field_is_never_used(tmp_path: Path, content: bytes, message: str) -> None:
    with (
        hostile.serving(hostile.always(hostile.http(content))) as address,
        pytest.raises(UserError) as refusal,
    ):
        fetched(tmp_path, address, RUN, RUN + 2 * HOUR, (4.0, 59.0, 7.0, 61.0))
    assert message in str(refusal.value)
    assert not (tmp_path / "out").exists()


def test_other_times_are_refused(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="filter has about"):
        fetched(tmp_path, "http://127.0.0.1:9", NOW - 30 * 24 * HOUR, NOW, (4.0, 59.0, 7.0, 61.0))
    with pytest.raises(UserError, match="is beyond the end of its last run"):
        fetched(tmp_path, "http://127.0.0.1:9", NOW, NOW + 60 * HOUR, (4.0, 59.0, 7.0, 61.0))


LEADS = (0, 1, 2, 3, 4, *range(6, 31, 3))  # hours after its begin that a run has, by OWN


@pytest.mark.parametrize("minutes", [0, 37, 299, 300, 317, 359, 360, 521, 660])
@pytest.mark.parametrize("begin", [-13.4, -8.0, 2.3, 5.2])
def test_no_run_is_asked_for_before_it_is_out(tmp_path: Path, minutes: int, begin: float) -> None:
    """By the hour: each from the last run that had begun by then and is out, where that run has it."""
    own = tmp_path / "own.toml"
    own.write_text(OWN.format(address="http://127.0.0.1:9"), encoding="utf-8")
    asked = RUN + np.timedelta64(60 * minutes, "s")
    first, last = (RUN + np.timedelta64(round(3600 * x), "s") for x in (begin, begin + 15.6))
    provider = catalogue.read_providers(own)["filter"]
    order = Order(provider, Box(4.0, 59.0, 7.0, 61.0), first, last, 5.0, asked)
    told = [
        (time, parse_qs(address.partition("?")[2]))
        for time, address in grib_filter._requests(order)
    ]
    asked_for = {
        key: {query[key][0] for _, query in told}
        for key in ("leftlon", "rightlon", "bottomlat", "toplat")
    }
    assert asked_for == {
        "leftlon": {"3.50"},
        "rightlon": {"7.50"},
        "bottomlat": {"58.50"},
        "toplat": {"61.50"},
    }  # two cells more
    runs = RUN + 6 * HOUR * np.arange(-6, 7)
    out = runs[runs + 5 * HOUR <= asked]  # five hours after they began
    expected = []
    for time in (RUN - 24 * HOUR) + HOUR * np.arange(72):
        run = out[out <= time].max()
        lead = int((time - run) / HOUR)
        if lead in LEADS:
            expected.append((time, run, lead))
    low = max(k for k, (time, *_) in enumerate(expected) if time <= first)
    high = min(k for k, (time, *_) in enumerate(expected) if time >= last)
    assert [time for time, _ in told] == [time for time, *_ in expected[low : high + 1]]
    for (_, query), (_, run, lead) in zip(told, expected[low : high + 1], strict=True):
        day, hour = str(run)[:10].replace("-", ""), str(run)[11:13]
        assert query["dir"] == [f"/gfs.{day}/{hour}/atmos"]
        assert query["file"] == [f"gfs.t{hour}z.f{lead:03d}"]


def test_parts_hold_all_times_and_are_known_again(tmp_path: Path) -> None:
    """At most twelve times each, of two components of 17 x 13 nodes in two bytes; others have keys
    of their own.
    """
    own = tmp_path / "own.toml"
    own.write_text(OWN.format(address="http://127.0.0.1:9"), encoding="utf-8")
    provider = catalogue.read_providers(own)["filter"]
    order = Order(provider, Box(4.0, 59.0, 7.0, 61.0), RUN - 20 * HOUR, RUN + 13 * HOUR, 5.0, NOW)
    parts_of = grib_filter.ship(order).parts
    times = [time for time, _ in grib_filter._requests(order)]
    assert np.concatenate([part.times for part in parts_of]).tolist() == [
        time.item() for time in times
    ]
    assert [len(part.times) for part in parts_of] == [12] * (len(times) // 12) + [len(times) % 12]
    assert grib_filter.ship(order).size == pytest.approx(len(times) * 2 * 17 * 13 * 2)
    changed = (
        replace(order, box=Box(4.0, 59.0, 7.25, 61.0)), replace(order, begin=RUN - 13 * HOUR),
        replace(order, asked=NOW + 6 * HOUR), replace(order, provider=replace(provider, name="other")),
    )  # fmt: skip
    keys = [{part.key for part in grib_filter.ship(one).parts} for one in (order, *changed)]
    assert keys[0] == {part.key for part in grib_filter.ship(replace(order, timeout=9.0)).parts}
    for k, other in enumerate(keys[1:], 1):
        assert len(keys[0] | other) > len(keys[0]), k
    for k in (1, 4):
        assert not keys[0] & keys[k]
