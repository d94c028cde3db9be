"""Digests of input files against hashlib, and damaged bytes against a file's own checksums."""

import hashlib
import json
from pathlib import Path

import netCDF4
import numpy as np
import pytest
import trial_case
import writers

import drift
from geo.errors import UserError
from geo.files import digest
from geo.forcing import sources

GPX = """<gpx version="1.1" xmlns="http://www.topografix.com/GPX/1/1"><rte>
<rtept lat="60.01" lon="4.55"/><rtept lat="59.98" lon="4.66"/></rte></gpx>"""


def current(path: Path, **storage: object) -> Path:
    """A current on 40 x 60 nodes, in chunks, as netCDF-4."""
    lon, lat = np.linspace(3.0, 6.0, 60), np.linspace(59.0, 61.0, 40)
    x, y = np.meshgrid(lon, lat)
    with netCDF4.Dataset(path, "w") as data:
        for name, values in (("lat", lat), ("lon", lon)):
            data.createDimension(name, len(values))
            data.createVariable(name, "f8", (name,))[:] = values
        for name, values, said in (
            ("uo", np.sin(x) - 0.1 * y + 6.0, writers.EAST),
            ("vo", np.cos(2 * y) * 0.3, writers.NORTH),
        ):
            variable = data.createVariable(
                name, "f4", ("lat", "lon"), chunksizes=(20, 30), **storage
            )
            variable.setncatts(said)
            variable[:] = values
    return path


def test_digests_are_sha256_of_all_that_is_there(tmp_path: Path) -> None:
    path = tmp_path / "a.bin"
    path.write_bytes(np.random.default_rng(2).bytes(9_000_017))  # more than two chunks
    assert digest.digest_of(str(path)) == f"sha256:{hashlib.sha256(path.read_bytes()).hexdigest()}"
    path.write_bytes(path.read_bytes()[:-1] + b"x")
    assert digest.digest_of(str(path)) == f"sha256:{hashlib.sha256(path.read_bytes()).hexdigest()}"
    with pytest.raises(OSError, match="gone"):
        digest.digest_of(str(tmp_path / "gone"))
    store = tmp_path / "a.zarr"
    (store / "u").mkdir(parents=True)
    (store / "u" / "0").write_bytes(b"12")
    before = digest.digest_of(str(store)), digest.size(str(store))
    assert before[1] == 2
    (store / "u" / "0").rename(store / "u" / "1")
    assert digest.digest_of(str(store)) != before[0]


@pytest.mark.thorough
def test_a_summary_holds_the_digest_of_every_input_file(tmp_path: Path) -> None:
    files = [current(tmp_path / "current.nc"), tmp_path / "boat.gpx"]
    files[1].write_text(GPX)
    boat = {
        "name": "boat",
        "speed": "8 kn",
        "start": "+30 min",
        "sweep_width": "0.4 nmi",
        "track": "boat.gpx",
    }
    case = trial_case.load(
        tmp_path,
        start="2026-03-01T00:00Z",
        duration="3 h",
        particles=50,
        current={"files": files[0], "steady": True},
        scenario={"position": {"at": [4.6, 60.0], "error": "3 nmi"}},
        sortie=[boat],
    )
    drift.run(case, out=tmp_path / "out")
    inputs = json.loads((tmp_path / "out" / "summary.json").read_text())["inputs"]
    wanted = {
        str(f.resolve()): (f"sha256:{hashlib.sha256(f.read_bytes()).hexdigest()}", f.stat().st_size)
        for f in files
    }
    assert {i["path"]: (i["digest"], i["bytes"]) for i in inputs} == wanted


def test_bytes_damaged_under_a_checksum_are_noticed(tmp_path: Path) -> None:
    """With Fletcher-32 no damage of values passes; without, it does, and only the digest tells."""
    whole = current(tmp_path / "a.nc", fletcher32=True)
    bare = current(tmp_path / "b.nc")
    true = sources.open_source("current", whole, steady=True).read(0)
    rng = np.random.default_rng(7)
    for name, noticed in ((whole, True), (bare, False)):
        content = bytearray(name.read_bytes())
        with netCDF4.Dataset(name) as data:
            chunk = np.ascontiguousarray(data["vo"][20:, 30:]).tobytes()
        begin = bytes(content).index(chunk)
        for k in range(12):
            # the lowest byte of a number: plausible all the same
            at = begin + int(rng.integers(len(chunk) // 4)) * 4
            damaged = bytearray(content)
            damaged[at] ^= 1 << int(rng.integers(8))
            (tmp_path / f"{k}.nc").write_bytes(damaged)
            if noticed:
                with pytest.raises(
                    UserError, match=rf"{k}\.nc: cannot read slice 0 of vo .*damaged"
                ):
                    sources.open_source("current", tmp_path / f"{k}.nc", steady=True)
            else:
                assert (
                    np.abs(
                        sources.open_source("current", tmp_path / f"{k}.nc", steady=True).read(0)
                        - true
                    ).max()
                    > 0
                )
            assert digest.digest_of(str(tmp_path / f"{k}.nc")) != digest.digest_of(str(name))
