"""Fetching from, and running on, a server of pydap's, which shares no code with ours: values as
they are in the file.
"""

import socket
import subprocess
import sys
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import netCDF4
import numpy as np
import pytest
import writers

import drift
from geo.forcing import sources

pytestmark = pytest.mark.conformance

OWN = """
[pydap]
title = "pydap"
quantity = "current"
protocol = "opendap"
address = "{address}"
variables = ["uo", "vo"]
"""


# Its own handler of netCDF files fails at parts of them (3.5.9), so the program serves arrays of
# the file.
SERVER = """
import sys
from wsgiref.simple_server import make_server
import netCDF4
from pydap.handlers.lib import BaseHandler
from pydap.model import BaseType, DatasetType, GridType

path, port, kind = sys.argv[1:]
sea = DatasetType("sea")
with netCDF4.Dataset(path) as data:
    data.set_auto_maskandscale(False)
    def held(name):
        one = data[name]
        return BaseType(name, one[:], dims=one.dimensions, attributes={k: one.getncattr(k) for k in one.ncattrs()})
    for name in ("time", "longitude", "latitude"):
        sea[name] = held(name)
    for name in ("uo", "vo"):
        if kind == "grid":
            sea[name] = GridType(name, dims=data[name].dimensions, attributes=held(name).attributes)
            sea[name][name] = held(name)
            for axis in data[name].dimensions:
                sea[name][axis] = held(axis)
        else:
            sea[name] = held(name)
make_server("127.0.0.1", int(port), BaseHandler(sea)).serve_forever()
"""


@contextmanager
def serving(path: Path, kind: str) -> Iterator[str]:
    """Serve a file in a process; give its address."""
    with socket.create_server(("127.0.0.1", 0)) as door:
        port = door.getsockname()[1]
    said = subprocess.DEVNULL
    server = subprocess.Popen(
        [sys.executable, "-c", SERVER, str(path), str(port), kind], stdout=said, stderr=said
    )
    address = f"http://127.0.0.1:{port}/sea"
    try:
        for _ in range(150):
            try:
                urllib.request.urlopen(f"{address}.dds", timeout=5).close()
                break
            except OSError:
                time.sleep(0.2)
        yield address
    finally:
        server.terminate()
        server.wait(30)


@pytest.mark.parametrize("kind", ["array", "grid"])
def test_a_subset_from_pydap_is_the_file_to_the_bit(tmp_path: Path, kind: str) -> None:
    """Longitudes of 0 to 360, dimensions in the order (time, longitude, latitude)."""
    whole = writers.east_of_zero(tmp_path / "east.nc")
    with netCDF4.Dataset(whole) as data:
        data.set_auto_maskandscale(False)
        names = ("time", "longitude", "latitude", "uo", "vo")
        hours, lon, lat, u, v = (data[name][:] for name in names)
    zero = np.datetime64("2024-03-05", "s")
    begin, end = (zero + int(hours[k]) * np.timedelta64(3600, "s") for k in (0, 1))
    box = (float(lon[10]), float(np.sort(lat)[10]), float(lon[20]), float(np.sort(lat)[20]))
    with serving(whole, kind) as address:
        own = tmp_path / "own.toml"
        own.write_text(OWN.format(address=address), encoding="utf-8")
        got = drift.fetch(
            box=box,
            begin=begin,
            end=end,
            providers=["pydap"],
            out=tmp_path / "out",
            catalogue=own,
            timeout=20.0,
        )
        variables = {"east": "uo", "north": "vo"}
        here, there = (
            sources.open_source("current", str(one), variables=variables)
            for one in (whole, address)
        )
        for k in range(hours.size):
            np.testing.assert_array_equal(there.read(k), here.read(k))
    (path,) = (path for path in got.files if path.suffix == ".nc")
    with netCDF4.Dataset(path) as data:
        data.set_auto_maskandscale(False)
        i, j = (
            np.searchsorted(lon, data["longitude"][:]),
            [int(np.flatnonzero(lat == y)[0]) for y in data["latitude"][:]],
        )
        assert 10 < len(i) < lon.size
        assert np.array_equal(lon[i], data["longitude"][:])
        for name, values in (("uo", u), ("vo", v)):
            assert data[name][:].tobytes() == values[:2][np.ix_(range(2), i, j)].tobytes()
    assert sources.open_source("current", str(path)).times.size == 2
