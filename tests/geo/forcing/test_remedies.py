"""Every remedy that an error of forcing names works: the test meets the error, follows it, and gets
the field.

The field is linear in longitude, latitude and time, so that every node and slice has one right
value. A remedy that ran data backward, took another level or another variable would give another.
"""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import writers
import xarray as xr

from geo.errors import UserError
from geo.forcing import sources

EPOCH = np.datetime64("2024-03-10T00:00:00", "s")
HOUR = np.timedelta64(3600, "s")
LON, LAT = np.arange(-31.0, -28.9, 0.5), np.arange(39.0, 41.1, 0.5)
HOURLY = {"start": EPOCH, "interval": HOUR}
OWN = {"east": "uo", "north": "vo"}


def field(lon: Any, lat: Any, hour: Any) -> tuple[Any, Any]:
    """East and north [m/s]: all four derivatives in space differ."""
    return 0.3 + 0.05 * (lon + 30) + 0.02 * (lat - 40) + 0.01 * hour, -0.2 + 0.03 * (
        lon + 30
    ) - 0.04 * (lat - 40)


def base(hours: Any = range(4)) -> xr.Dataset:
    t = np.asarray(list(hours), float)[:, None, None]
    u, v = (
        np.broadcast_to(w, (t.size, LAT.size, LON.size)).copy() for w in field(LON, LAT[:, None], t)
    )
    return xr.Dataset(
        {
            "uo": (("time", "lat", "lon"), u, dict(writers.EAST)),
            "vo": (("time", "lat", "lon"), v, dict(writers.NORTH)),
        },
        {
            "time": ("time", t.ravel(), {"units": "hours since 2024-03-10"}),
            "lat": ("lat", LAT, {"units": "degrees_north"}),
            "lon": ("lon", LON, {"units": "degrees_east"}),
        },
    )


def about(data: xr.Dataset, names: str, **attributes: Any) -> xr.Dataset:
    """Change attributes of variables; None takes one out."""
    for name in names.split():
        for key, value in attributes.items():
            data[name].attrs.pop(key, None)
            if value is not None:
                data[name].attrs[key] = value
    return data


def stacked(
    data: xr.Dataset, dim: str, right: int, count: int = 3, **coordinate: Any
) -> xr.Dataset:
    """Add a dimension along which one index holds the field, and the others something else."""
    parts = [data[["uo", "vo"]] + 0.3 * (k - right) for k in range(count)]
    wide = xr.concat(parts, dim).transpose("time", dim, "lat", "lon")
    for name, own in (("uo", writers.EAST), ("vo", writers.NORTH)):
        wide[name].attrs = dict(own)
    for name in ("time", "lat", "lon"):
        wide[name].attrs = data[name].attrs
    return wide.assign_coords(
        {dim: (dim, coordinate["values"], coordinate.get("attrs", {}))} if coordinate else {}
    )


def twice(data: xr.Dataset) -> xr.Dataset:
    return data.assign(
        other_u=(data.uo + 1).assign_attrs(writers.EAST),
        other_v=(data.vo - 1).assign_attrs(writers.NORTH),
    )


def nameless(data: xr.Dataset) -> xr.Dataset:
    plain = data.rename({"lon": "a", "lat": "b"})
    return about(plain, "a b", units=None)


Files = Callable[[], list[xr.Dataset]]
# What is written, what the error says (with the remedy), and the remedies that it names.
CASES: dict[str, tuple[Files, str, list[dict[str, Any]]]] = {
    "no units": (lambda: [about(base(), "uo vo", units=None)], r'units = "m/s"', [{"units": "m/s"}]),
    "units that are none": (
        lambda: [about(base(), "uo vo", units="quux")], r"state them with \[\[current\]\] units", [{"units": "m/s"}]
    ),
    "names that nothing tells": (
        lambda: [about(base(), "uo vo", standard_name=None).rename({"uo": "p", "vo": "q"})],
        r"variables = \{ east = ..., north = ... \}", [{"variables": {"east": "p", "north": "q"}}],
    ),
    "several pairs": (
        lambda: [about(twice(base()).rename({"uo": "p", "vo": "q"}), "p", long_name="x")],
        r"several variables.*variables = \{ east", [{"variables": {"east": "p", "north": "q"}}],
    ),
    "a dimension of anything": (
        lambda: [stacked(base(), "draw", 1)], r"more than one draw; set \[\[current\]\] variables.draw to an index",
        [{"variables": {"draw": "1"}}],
    ),
    "members": (
        lambda: [stacked(base(), "member", 0)], r"variables.member to an index, or members = true",
        [{"variables": {"member": "0"}}, {"members": True}],
    ),
    "levels too deep": (
        lambda: [stacked(base(), "depth", 1, values=[10.0, 15.0, 20.0], attrs={"units": "m", "positive": "down"})],
        r"\[\[current\]\].*depth", [{"depth": 15.0}, {"variables": {"depth": "1"}}],
    ),
    "levels that nothing places": (
        lambda: [stacked(base(), "lev", 2)], r"variables.lev", [{"variables": {"lev": "2"}}]
    ),
    "places that nothing names": (
        lambda: [nameless(base())], r"variables = \{ lon = ..., lat = ... \}", [{"variables": {"lon": "a", "lat": "b"}}]
    ),
    "no dates": (
        lambda: [about(base(), "time", units="hours")], r"times = \{ start = ..., every = ... \}, or steady", [{"times": HOURLY}]
    ),
    "no dates, falling": (
        lambda: [about(base(), "time", units="hours").isel(time=slice(None, None, -1))],
        r"times = \{ start = ..., every = ... \}", [{"times": HOURLY}],
    ),
    "a climatology": (
        lambda: [about(base(), "time", climatology="x")], r"climatology.*times = \{ start", [{"times": HOURLY}]
    ),
    "dates that do not exist": (
        lambda: [about(base(), "time", units="days since 2023-02-29", calendar="360_day")], r"times = \{ start",
        [{"times": HOURLY}],
    ),
    "months": (lambda: [about(base(), "time", units="months since 2024-01-01")], r"no unit of time with a fixed length", [{"times": HOURLY}]),
    "a zone": (
        lambda: [about(base(), "time", units="hours since 2024-03-09 18:00 CST")], r'times = \{ zone = "-06:00" \}',
        [{"times": {"zone": "-06:00"}}, {"times": HOURLY}],
    ),
    "a zone or an hour": (
        lambda: [about(base(), "time", units="hours since 2024-03-10 -6")], r"may end in a zone or in a time of day.*zone = ",
        [{"times": {"zone": "UTC"}}],
    ),
    "a maximum": (
        lambda: [about(about(base(), "uo vo", standard_name=None).rename({"uo": "p", "vo": "q"}).merge(
            about(base() + 1, "uo vo", cell_methods="time: maximum", units="m s-1")), "uo", long_name="current u")],
        r"no velocity at a time; name others in \[\[current\]\] variables", [{"variables": {"east": "p", "north": "q"}}],
    ),
    "a lone slice": (lambda: [base([0])], r"one time only.*steady = true.*files of other times", [{"steady": True}]),
    "a lone slice without a date": (
        lambda: [about(base([0]), "time", units="h")], r"state steady = true to hold it constant", [{"steady": True}]
    ),
    "files of one slice without dates": (
        lambda: [about(base([k]), "time", units="h") for k in range(4)],
        r"for several such files \[\[current\]\] times = \{ start", [{"times": HOURLY}],
    ),
    "files in other units": (
        lambda: [base([0, 1]), about(base([2, 3]), "uo vo", units="M/S.")], r"state \[\[current\]\] units", [{"units": "m/s"}]
    ),
    "a mask that is not there": (
        lambda: [base()], r'no variable "wet".*variables.mask', [{"variables": {"mask": "none"}}]
    ),
    "one component named": (
        lambda: [about(base(), "uo vo", standard_name=None)], r"names one component; set north as well", [{"variables": OWN}]
    ),
    "axes of another kind": (lambda: [base()], r'variables.axes = "up": allowed are "true"', [{"variables": {"axes": "true"}}]),
    "one variable for both": (lambda: [base()], r"named as both components; set \[\[current\]\] variables.north", [{"variables": OWN}]),
    "an index beyond": (
        lambda: [stacked(base(), "draw", 1)], r"variables.draw = 7: it is an index, 0 to 2", [{"variables": {"draw": "1"}}]
    ),
    "a time that is not there": (lambda: [base()], r'no variable "when"; set \[\[current\]\] variables.time', [{"variables": {"time": "time"}}]),
    "bounds that contradict": (
        lambda: [about(base(), "time", bounds="tb").assign(tb=(("time", "nv"), np.full((4, 2), [50.0, 51.0])))],
        r'times = \{ stamp = "instant" \}', [{"times": {"stamp": "instant"}}],
    ),
    "some bounds": (
        lambda: [
            about(base([0, 1]), "time", bounds="tb").assign(tb=(("time", "nv"), [[-0.5, 0.5], [0.5, 1.5]])), base([2, 3])
        ],
        r'times.stamp = "start", "middle" or "end"', [{"times": {"stamp": "middle"}}, {"times": {"stamp": "instant"}}],
    ),
}  # fmt: skip
ASKED: dict[str, dict[str, Any]] = {  # what meets the error, where the file alone does not
    "a mask that is not there": {"variables": {"mask": "wet"}},
    "one component named": {"variables": {"east": "uo"}},
    "axes of another kind": {"variables": {"axes": "up"}},
    "one variable for both": {"variables": {"east": "uo", "north": "uo"}},
    "an index beyond": {"variables": {"draw": "7"}},
    "a time that is not there": {"variables": {"time": "when"}},
}


def check(source: sources.Source) -> None:
    """Hold all nodes of all slices to the field; of a steady source to that of EPOCH."""
    hours = (source.times - EPOCH) / HOUR if source.times.size else np.zeros(1)
    held = slice(1, -1) if source.edges else slice(None)
    assert list(hours[held]) == ([0.0, 1.0, 2.0, 3.0] if source.times.size else [0.0])
    for k in range(len(hours))[held]:
        expected = np.stack(
            np.broadcast_arrays(*field(source.grid.lon, source.grid.lat[:, None], hours[k])),
            axis=-1,
        )
        np.testing.assert_allclose(source.read(k), expected, atol=2e-6)


@pytest.mark.parametrize("kind", CASES)
def test_what_a_refusal_advises_gives_the_field(kind: str, tmp_path: Path) -> None:
    make, words, remedies = CASES[kind]
    paths = []
    for k, data in enumerate(make()):
        paths.append(tmp_path / f"f{k}.nc")
        data.to_netcdf(paths[-1])
    with pytest.raises(UserError) as caught:
        sources.open_source("current", paths, **ASKED.get(kind, {}))
    assert re.search(words, str(caught.value)), str(caught.value)
    for remedy in remedies:
        check(sources.open_source("current", paths, **remedy))


def test_more_files_are_the_other_remedies(tmp_path: Path) -> None:
    for k in range(4):
        base([k]).to_netcdf(tmp_path / f"a{k}.nc")
    # "one time only": files of other times
    check(sources.open_source("current", str(tmp_path / "a*.nc")))
    base()[["uo"]].to_netcdf(tmp_path / "u.nc")
    with pytest.raises(
        UserError,
        match=r"northward one is missing; name the files of both in \[\[current\]\] files",
    ):
        sources.open_source("current", tmp_path / "u.nc")
    base([4, 5])[["vo"]].to_netcdf(tmp_path / "late.nc")
    with pytest.raises(
        UserError,
        match=r"100000ZMAR24 to 100300ZMAR24.*no time in common; name files of the same times",
    ):
        sources.open_source("current", [tmp_path / "u.nc", tmp_path / "late.nc"])
    with pytest.raises(
        UserError, match=r"different numbers of slices, 4 and 2; name files of as many"
    ):
        sources.open_source("current", [tmp_path / "u.nc", tmp_path / "late.nc"], times=HOURLY)
    base()[["vo"]].to_netcdf(tmp_path / "v.nc")
    check(sources.open_source("current", [tmp_path / "u.nc", tmp_path / "v.nc"]))
