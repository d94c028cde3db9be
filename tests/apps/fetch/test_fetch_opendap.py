"""Fetching by OPeNDAP and ERDDAP from servers on this machine: values to the bit, resumption, and
every refusal.
"""

import io
import os
import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import hostile
import netCDF4
import numpy as np
import pyproj
import pytest
import writers
import xarray as xr
from hostile import Variable
from places import ROOT

import drift
from drift.apps.cli import commands as cli
from drift.apps.fetch import fetching, opendap, parts
from drift.apps.fetch.catalogue import Provider
from drift.apps.fetch.fetching import Fetched
from drift.apps.fetch.order import Order
from geo.box import Box
from geo.errors import UserError
from geo.forcing import sources

BEGIN, END = "2024-03-01T02:30Z", "2024-03-03T10:00Z"
TABLE = """
[trial]
title = "trial"
quantity = "current"
protocol = "{protocol}"
address = "{address}"
dataset = "sea"
variables = ["u", "v"]
license = "free"
"""


@pytest.fixture(autouse=True)
def hasty(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Wait little between attempts; ask for netrc and settings in a folder of the test."""
    monkeypatch.setattr(parts, "PAUSE", 0.02)
    monkeypatch.setenv("HOME", str(tmp_path))


def ocean(lon: np.ndarray, lat: np.ndarray, hours: int = 72) -> dict[str, Variable]:
    """Return a current, packed in 16 bits and in floats, each value another one."""
    rng = np.random.default_rng(7)
    shape = (hours, lat.size, lon.size)
    packed = rng.integers(-900, 900, shape).astype(np.int16)
    packed[:, 1, 2] = -32767
    u = {
        "units": "m s-1",
        "standard_name": "eastward_sea_water_velocity",
        "scale_factor": np.float32(0.001),
        "_FillValue": np.int16(-32767),
    }
    return {
        "time": Variable(
            ("time",), np.arange(hours) * 1.0, {"units": "hours since 2024-03-01 00:00:00"}
        ),
        "lat": Variable(
            ("lat",),
            lat.astype(np.float64),
            {"units": "degrees_north", "standard_name": "latitude"},
        ),
        "lon": Variable(
            ("lon",),
            lon.astype(np.float64),
            {"units": "degrees_east", "standard_name": "longitude"},
        ),
        "u": Variable(("time", "lat", "lon"), packed, u),
        "v": Variable(
            ("time", "lat", "lon"),
            rng.uniform(-0.9, 0.9, shape).astype(np.float32),
            {"units": "m s-1", "standard_name": "northward_sea_water_velocity"},
        ),
    }


# longitudes and latitudes as servers have them, and boxes with the longitudes of their nodes, west
# to east
AXES = {
    "plain": (np.arange(-30, 31, 1.5), np.arange(30, 50.1, 0.5), (-5, 35, 5, 40)),
    "0..360, descending": (np.arange(0, 360, 2.0), np.arange(80, -80.1, -2.0), (-9, 35, 11, 48)),
    "-180..180, across 180": (
        np.arange(-180, 180, 2.0),
        np.arange(-80, 80.1, 2.0),
        (171, -45, 190, -31),
    ),
    "0..360, across 180": (
        np.arange(0, 360, 2.0),
        np.arange(80, -80.1, -2.0),
        (171, -45, -170, -31),
    ),
    "74..434": (np.arange(74, 434, 2.0), np.arange(-80, 80.1, 2.0), (70, -10, 80, 5)),
    "whole": (np.arange(0, 360, 10.0), np.arange(-80, 80.1, 10.0), (-180, -70, 180, 70)),
}


def written(folder: Path, address: str, protocol: str = "opendap") -> Path:
    path = folder / "own.toml"
    path.write_text(TABLE.format(address=address, protocol=protocol), encoding="utf-8")
    return path


def fetched(folder: Path, address: str, box: tuple[float, ...], **more: object) -> Fetched:
    how = {
        "begin": BEGIN,
        "end": END,
        "providers": ["trial"],
        "out": folder / "out",
        "timeout": 5.0,
        **more,
    }
    protocol = str(how.pop("protocol", "opendap"))
    return drift.fetch(box=box, catalogue=written(folder, address, protocol), **how)


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("axes", "protocol"),
    [  # each way of counting by one protocol; by the other one too in the thorough stage
        pytest.param(axes, protocol, marks=[pytest.mark.thorough] * ((k + j) % 2))
        for k, axes in enumerate(AXES)
        for j, protocol in enumerate(("opendap", "erddap"))
    ],
)
def test_a_subset_is_the_source_to_the_bit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, axes: str, protocol: str
) -> None:
    lon, lat, box = AXES[axes]
    sea = ocean(lon, lat)
    monkeypatch.setattr(opendap, "PART", 9_000)  # several parts
    seen: list[str] = []
    with hostile.serving(hostile.speaking_dap(sea, seen)) as address:
        got = fetched(tmp_path, address, box, protocol=protocol)
    assert all(("/griddap/sea." in target) == (protocol == "erddap") for target in seen)
    files = sorted(path for path in got.files if path.suffix == ".nc")
    assert len(files) > 1
    hours = []
    for path in files:
        with netCDF4.Dataset(path) as data:
            data.set_auto_maskandscale(False)
            t = data["time"][:].astype(int)
            rows = np.array([int(np.flatnonzero(lat == y)[0]) for y in data["lat"][:]])
            columns = np.array(
                [int(np.flatnonzero((lon - x) % 360 == 0)[0]) for x in data["lon"][:]]
            )
            for name in ("u", "v"):
                expected = sea[name].values[np.ix_(t, rows, columns)]
                assert data[name].dtype == expected.dtype
                assert data[name][:].tobytes() == expected.tobytes()
            assert data["u"].getncattr("scale_factor") == np.float32(0.001)
            assert data["u"].getncattr("_FillValue") == np.int16(-32767)
            assert (np.diff(data["lon"][:]) > 0).all()
            # no jump at any seam
            assert np.diff(data["lon"][:]).max() == pytest.approx(lon[1] - lon[0])
            edges = data["lon"][0], data["lon"][-1], data["lat"][:].min(), data["lat"][:].max()
        hours += list(t)
    assert hours == list(range(2, 59))  # 02:30 lies between 2 and 3, 58 is the end
    west, south, east, north = box
    if axes != "whole":
        assert (west - edges[0]) % 360 < 3 * (lon[1] - lon[0])
        assert (edges[1] - east) % 360 < 3 * (lon[1] - lon[0])
        assert edges[1] - edges[0] >= (east - west) % 360
    assert edges[2] <= south
    assert edges[3] >= north
    source = sources.open_source("current", [str(path) for path in files])
    assert source.times.size == len(hours)


def by_component(served: list[dict[str, Variable]]) -> hostile.Answer:
    """Serve several datasets, each under its number."""
    return lambda connection, target: connection.sendall(
        hostile.good(served[int(target[1])], target[2:])
    )


def two(folder: Path, address: str, names: tuple[str, str], level: float) -> Path:
    """Write a catalogue of one product whose components have an address each."""
    root = address.rpartition("/")[0]
    text = TABLE.format(address="", protocol="opendap").replace(
        'address = ""', f'address = ["{root}/0/a", "{root}/1/b"]'
    )
    text = text.replace('["u", "v"]', f'["{names[0]}", "{names[1]}"]')
    path = folder / "two.toml"
    path.write_text(f"{text}level = {level}\n", encoding="utf-8")
    return path


@pytest.mark.thorough
def test_what_a_part_holds_is_what_it_is_known_by(monkeypatch: pytest.MonkeyPatch) -> None:
    """A part that is kept serves another order only if both hold the same: box, times, and the
    state of the dataset.
    """
    lon, lat, box = AXES["plain"]
    sea = ocean(lon, lat)
    u = sea["u"]
    monkeypatch.setattr(opendap, "PART", 9_000)
    with hostile.serving(hostile.speaking_dap(sea)) as address:

        def keys(where: tuple[float, ...], begin: str, said: dict[str, object]) -> list[str]:
            sea["u"] = replace(u, attributes={**u.attributes, **said})
            times = [np.datetime64(when.rstrip("Z"), "s") for when in (begin, END)]
            one = Provider("trial", "trial", "current", "opendap", ("u", "v"), (address,))
            shipment = opendap.ship(
                Order(
                    one,
                    Box(where[0], where[1], where[2], where[3]),
                    times[0],
                    times[1],
                    5.0,
                    times[0],
                )
            )
            return [part.key for part in shipment.parts]

        first = keys(box, BEGIN, {})
        assert len(set(first)) == len(first) > 2
        assert keys(box, BEGIN, {"history": "asked just now"}) == first
        assert keys(box, "2024-03-01T02:10Z", {}) == first  # between the same two times
        moved = (box[0] + 3, box[1], box[2] + 3, box[3])  # as many columns
        for other in (
            keys(moved, BEGIN, {}),
            keys(box, "2024-03-01T01:10Z", {})[:-1],
            keys(box, BEGIN, {"scale_factor": np.float32(0.002)}),
        ):
            assert not set(other) & set(first)


@pytest.mark.thorough
@pytest.mark.parametrize("level", [pytest.param(0, marks=pytest.mark.thorough), 2.4, -15])
def test_components_at_two_addresses_at_a_level(tmp_path: Path, level: float) -> None:
    """As HYCOM has them: each address holds one component, at depths of which the nearest is taken."""
    lon, lat, box = AXES["plain"]
    rng = np.random.default_rng(11)
    depths = np.array([0.0, 2.0, 4.0, 12.0])
    values = {
        name: rng.uniform(-1, 1, (72, 4, lat.size, lon.size)).astype(np.float32) for name in "uv"
    }
    sea = ocean(lon, lat)
    sea["depth"] = Variable(
        ("depth",), depths, {"units": "m", "positive": "down", "standard_name": "depth"}
    )
    served = [
        {n: v for n, v in sea.items() if n not in "uv"}
        | {name: Variable(("time", "depth", "lat", "lon"), values[name], sea["v"].attributes)}
        for name in "uv"
    ]
    with hostile.serving(by_component(served)) as address:
        got = drift.fetch(
            box=box, begin=BEGIN, end=END, providers=["trial"], out=tmp_path / "out", timeout=5.0,
            catalogue=two(tmp_path, address, ("u", "v"), level),
        )  # fmt: skip
    (path,) = (path for path in got.files if path.suffix == ".nc")
    wanted = {0: 0, 2.4: 1, -15: 3}[level]
    # a run takes nothing so deep for the surface by itself
    assert ('depth = "15 m"' in got.tables) == (level == -15)
    with netCDF4.Dataset(path) as data:
        t, rows, columns = (
            data["time"][:].astype(int), np.searchsorted(lat, data["lat"][:]), np.searchsorted(lon, data["lon"][:]),
        )  # fmt: skip
        assert list(data["depth"][:]) == [depths[wanted]]
        for name in "uv":
            assert np.array_equal(
                data[name][:, 0], values[name][np.ix_(t, [wanted], rows, columns)][:, 0]
            )


def test_a_curvilinear_grid_whose_components_lie_along_it(tmp_path: Path) -> None:
    """As MEPS has them: longitudes and latitudes in two dimensions, components along a projection's
    axes.
    """
    whole = writers.projected(tmp_path / "whole.nc")
    with xr.open_dataset(whole, decode_times=False) as data:
        to = pyproj.Proj(writers.STEREO)
        lon, lat = to(*np.meshgrid(data["X"].values, data["Y"].values), inverse=True)
        more = data.load().assign_coords(
            longitude=(("Y", "X"), lon, {"units": "degrees_east", "standard_name": "longitude"}),
            latitude=(("Y", "X"), lat, {"units": "degrees_north", "standard_name": "latitude"}),
        )
    more.to_netcdf(tmp_path / "both.nc")
    west, south, east, north = box = (3.2, 58.4, 4.7, 59.3)
    with hostile.serving(hostile.speaking_dap(hostile.held(tmp_path / "both.nc"))) as address:
        got = fetched(tmp_path, address, box, begin="2024-03-05T00:00Z", end="2024-03-05T05:00Z")
    files = [str(path) for path in got.files if path.suffix == ".nc"]
    source = sources.open_source("current", files, variables={"east": "u", "north": "v"})
    assert source.times.size == 3
    lon, lat = np.meshgrid(source.grid.lon, source.grid.lat)
    inside = (lon > west) & (lon < east) & (lat > south) & (lat < north)
    assert inside.sum() > 500
    # of the grid, which is larger than the box by its turn and two cells
    assert inside.mean() > 0.2
    for k in range(3):
        got_there = source.read(k)
        for axis, expected in enumerate(writers.field(lon, lat, 3.0 * k)):
            assert np.abs(got_there[..., axis] - expected)[inside].max() < writers.tolerance()


@pytest.mark.thorough
def test_components_at_other_points_are_refused(tmp_path: Path) -> None:
    """NEMO's grid_U and grid_V hold their own points under the same names."""
    served = [hostile.held(path) for path in writers.nemo(tmp_path)]
    names = [next(name for name, one in held.items() if one.values.ndim == 4) for held in served]
    with (
        hostile.serving(by_component(served)) as address,
        pytest.raises(UserError, match="are on different points"),
    ):
        drift.fetch(
            box=(3.2, 58.4, 4.7, 59.3), begin="2024-03-05T00:00Z", end="2024-03-05T05:00Z", providers=["trial"],
            out=tmp_path / "out", timeout=5.0, catalogue=two(tmp_path, address, (names[0], names[1]), 0),
        )  # fmt: skip


def test_a_run_reads_what_was_fetched(tmp_path: Path) -> None:
    lon, lat, box = AXES["-180..180, across 180"]
    with hostile.serving(hostile.speaking_dap(ocean(lon, lat))) as address:
        got = fetched(tmp_path, address, box)
    case = tmp_path / "case.toml"
    case.write_text(
        'title = "trial"\nstart = "2024-03-01T12:00Z"\nduration = "6 h"\nparticles = 500\ncoast.source = "none"\n'
        f"domain = {{ west = 171, south = -44, east = 189, north = -32 }}\n{got.tables}"
        '[[wind]]\nconstant = { speed = "10 kn", from = 270 }\n[uncertainty]\nwind = { std = "1 m/s", time = "6 h" }\n'
        '[[scenario]]\nname = "boat"\nobject = "PIW-1"\nposition = { at = "38 00S 179 57E", std = "1 nmi" }\n'
    )
    result = drift.run(drift.load(case))
    assert result.probability.sizes["time"] > 1
    assert result.summary["account"]["outside"] == 0


@pytest.mark.thorough
def test_what_was_killed_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A fetch is killed in the middle, without a chance to tidy up: the next one asks only for what
    is not there.
    """
    lon, lat, box = AXES["plain"]
    sea = ocean(lon, lat)
    seen: list[str] = []

    def slow(connection: socket.socket, target: str) -> None:
        seen.append(target)
        if ".dods?u[" in target:
            time.sleep(0.15)
        connection.sendall(hostile.good(sea, target))

    with hostile.serving(slow) as address:
        own = written(tmp_path, address)
        script = (
            "from drift.apps.fetch import opendap, fetching; opendap.PART = 3_000; import sys; from drift.apps.cli import commands; "
            "sys.exit(commands.main(sys.argv[1:]))"
        )
        asks = [
            "fetch",
            f"--box={','.join(map(str, box))}",
            "--from",
            BEGIN,
            "--to",
            END,
            "--provider",
            "trial",
        ]
        asks += ["--catalogue", str(own), "--out", str(tmp_path / "out")]
        environment = {**os.environ, "PYTHONPATH": str(ROOT), "HOME": str(tmp_path)}
        first = subprocess.Popen(
            [sys.executable, "-c", script, *asks],
            env=environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
        )
        until = time.monotonic() + 60
        while (
            time.monotonic() < until
            and first.poll() is None
            and len(list(tmp_path.glob(".drift-fetch-*/*.nc"))) < 6
        ):
            time.sleep(0.02)
        first.send_signal(signal.SIGKILL)
        first.communicate()
        assert not (tmp_path / "out").exists()
        (folder,) = tmp_path.glob(".drift-fetch-*")
        there = {path.name for path in folder.glob("*.nc") if "draft" not in path.name}
        assert len(there) >= 4
        spoilt = sorted(there)[0]
        # a disk that lost its end
        (folder / spoilt).write_bytes((folder / spoilt).read_bytes()[:-7])
        (folder / "half.draft.nc").write_bytes(b"half")
        before = len(seen)
        monkeypatch.setattr(opendap, "PART", 3_000)
        assert cli.main(asks) == 0
    told = capsys.readouterr().out
    listed = list((tmp_path / "out").glob("*.nc"))
    asked = sum(".dods?u[" in target for target in seen[before:])
    said = re.search(r"; (\d+) parts are already downloaded", told)
    assert said, told
    kept = int(said[1])
    assert len(there) - 2 <= kept < len(listed)
    assert asked == len(listed) - kept
    assert not list(tmp_path.glob(".drift-fetch-*"))
    hours = []
    for path in sorted(listed):
        with netCDF4.Dataset(path) as data:
            data.set_auto_maskandscale(False)
            t = data["time"][:].astype(int)
            hours += list(t)
            rows, columns = (
                np.searchsorted(axis, data[n][:]) for axis, n in ((lat, "lat"), (lon, "lon"))
            )
            assert data["u"][:].tobytes() == sea["u"].values[np.ix_(t, rows, columns)].tobytes()
    assert hours == list(range(2, 59))


def wrong(how: Callable[[socket.socket, str], None], when: str) -> hostile.Answer:
    """Return a server that is good except for what ends so."""
    sea = ocean(*AXES["plain"][:2])

    def answer(connection: socket.socket, target: str) -> None:
        if when in target.partition("?")[0]:
            how(connection, target)
        else:
            connection.sendall(hostile.good(sea, target))

    return answer


PAGE = b"<!DOCTYPE html><html><body>Please log in</body></html>"
REFUSALS = {
    "credentials": (
        hostile.always(hostile.http(b"", "401 Unauthorized")),
        ".dds",
        "asks for credentials (401)",
    ),
    "no such name": (
        hostile.always(hostile.http(b"no", "404 Not Found")),
        ".dds",
        "is not there (404)",
    ),
    "down": (
        hostile.always(hostile.http(b"no", "503 Service Unavailable")),
        ".dds",
        "failed (503 Service Unavailable)",
    ),
    "error": (
        hostile.always(hostile.http(b"Error {};", "500 Internal Server Error")),
        ".dds",
        "failed (500",
    ),
    "web page": (
        hostile.always(hostile.http(PAGE, "200 OK", "Content-Type: text/html")),
        ".dds",
        "sent a web page",
    ),
    "half": (
        hostile.always(hostile.http(b"Dataset {" + b" " * 999)[:-500]),
        ".dds",
        "sent an incomplete answer",
    ),
    "no HTTP": (hostile.always(b"\x00\x01 hello"), ".dds", "broke off"),
    "silent": (hostile.silent, ".dds", "did not answer for 0.7 s"),
    "another server": (
        hostile.always(hostile.http(b'{"hello": 1}')),
        ".dds",
        "not as OPeNDAP does",
    ),
    "values fail": (
        hostile.always(hostile.http(b"Error {};", "500 Internal Server Error")),
        ".dods",
        "stopped after 5",
    ),
    "values are a page": (hostile.always(hostile.http(PAGE)), ".dods", "sent a web page"),
}


@pytest.mark.parametrize(
    "kind",
    [
        pytest.param(
            kind, marks=[pytest.mark.thorough] * (kind in ("values fail", "values are a page"))
        )
        for kind in REFUSALS
    ],
)
def test_each_failure_is_one_line(tmp_path: Path, kind: str) -> None:
    how, when, message = REFUSALS[kind]
    begin = time.monotonic()
    with hostile.serving(wrong(how, when)) as address, pytest.raises(UserError) as refusal:
        fetched(tmp_path, address, AXES["plain"][2], timeout=0.7 if kind == "silent" else 5.0)
    assert message in str(refusal.value)
    assert len(refusal.value.lines) == 1
    assert not (tmp_path / "out").exists()
    assert time.monotonic() - begin < 60


def test_values_that_are_cut_short_are_never_used(tmp_path: Path) -> None:
    """Each part is cut short at its first asking; all is whole at last."""
    lon, lat, box = AXES["plain"]
    sea, halved = ocean(lon, lat), set()

    def answer(connection: socket.socket, target: str) -> None:
        content = hostile.good(sea, target)
        if ".dods" in target and ("?u" in target or "?v" in target) and target not in halved:
            halved.add(target)
            content = content[: len(content) // 2]
        connection.sendall(content)

    with hostile.serving(answer) as address:
        got = fetched(tmp_path, address, box)
    assert halved
    with netCDF4.Dataset(next(path for path in got.files if path.suffix == ".nc")) as data:
        data.set_auto_maskandscale(False)
        rows, columns = (
            np.searchsorted(axis, data[n][:]) for axis, n in ((lat, "lat"), (lon, "lon"))
        )
        t = data["time"][:].astype(int)
        assert data["v"][:].tobytes() == sea["v"].values[np.ix_(t, rows, columns)].tobytes()


def test_nobody_there(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as door:
        port = door.getsockname()[1]
    with pytest.raises(
        UserError, match=r"cannot be reached \(.*refused\); stopped after 5 attempts"
    ):
        fetched(tmp_path, f"http://127.0.0.1:{port}/sea", AXES["plain"][2])


@pytest.mark.parametrize(
    ("trouble", "times", "said"),
    [
        (socket.EAI_NONAME, 1, "no host is named sea.invalid"),
        (socket.EAI_AGAIN, 5, "stopped after"),
    ],
)
def test_a_name_that_nobody_has_is_asked_for_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, trouble: int, times: int, said: str
) -> None:
    """A name server that does not answer may answer later; one that says that there is no such name
    will say it again.
    """
    asked = []

    def look_up(*what: object, **_: object) -> object:
        asked.append(what)
        raise socket.gaierror(trouble, "made up")

    monkeypatch.setattr(socket, "getaddrinfo", look_up)
    with pytest.raises(UserError, match=said):
        fetched(tmp_path, "http://sea.invalid/sea", AXES["plain"][2])
    assert len(asked) == times


def test_a_case_is_not_read_where_box_and_times_are_said(tmp_path: Path) -> None:
    """One without a scenario yet, say; a time that counts from its start needs it."""
    case = tmp_path / "half.toml"
    case.write_text('start = "2026-11-21T00:00Z"\n[[scenario]]\n', encoding="utf-8")
    span = "2026-11-21T00:00Z", "2026-11-22T00:00Z"
    box, begin, end = fetching.ordered_span(case, "4,59,7,61", *span)
    assert (box.west, box.north, f"{begin}Z", f"{end}Z") == (
        4,
        61,
        "2026-11-21T00:00:00Z",
        "2026-11-22T00:00:00Z",
    )
    for given in ((None, *span), ("4,59,7,61", None, span[1]), ("4,59,7,61", span[0], "+6 h")):
        with pytest.raises(UserError, match=r"half.toml: scenario 1.name: is missing"):
            fetching.ordered_span(case, *given)


def test_netrc_is_used_and_told_to_nobody(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Name and password of ~/.netrc open the door; neither files nor lines hold them."""
    import base64

    sea, heads = ocean(*AXES["plain"][:2]), []
    token = base64.b64encode(b"ann:sesame").decode()

    def answer(connection: socket.socket, target: str) -> None:
        connection.sendall(hostile.good(sea, target))

    with socket.create_server(("127.0.0.1", 0)) as door:
        import threading

        def accept() -> None:
            while True:
                try:
                    connection, _ = door.accept()
                except OSError:
                    return
                with connection:
                    request = b""
                    while b"\r\n\r\n" not in request and (part := connection.recv(65536)):
                        request += part
                    heads.append(request)
                    target = hostile.unquote(request.split()[1].decode()) if request else ""
                    if f"Basic {token}".encode() in request:
                        answer(connection, target)
                    else:
                        refusal = hostile.http(
                            b"", "401 Unauthorized", 'WWW-Authenticate: Basic realm="sea"'
                        )
                        connection.sendall(refusal)

        threading.Thread(target=accept, daemon=True).start()
        address = f"http://127.0.0.1:{door.getsockname()[1]}/sea"
        (tmp_path / ".netrc").write_text("machine 127.0.0.1 login ann password sesame\n")
        (tmp_path / ".netrc").chmod(0o600)
        got = fetched(tmp_path, address, AXES["plain"][2])
        (tmp_path / ".netrc").write_text("machine 127.0.0.1 login ann password wrong\n")
        with pytest.raises(UserError, match="asks for credentials") as refusal:
            fetched(tmp_path, address, AXES["plain"][2], out=tmp_path / "other")
    assert "wrong" not in str(refusal.value)
    assert all(b"sesame" not in path.read_bytes() for path in got.files)
    assert "sesame" not in "".join(capsys.readouterr())


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"end": "2024-03-09T00:00Z"},
            "has 2024-03-01T00:00:00Z to 2024-03-03T23:00:00Z, not all of",
        ),
        ({"begin": "2024-02-01T00:00Z"}, "has 2024-03-01T00:00:00Z to"),
        (
            {"box": (100, 10, 110, 20)},
            "has nothing in this box: its grid goes from -30.00 to 30.00 E",
        ),
        ({"begin": END, "end": BEGIN}, "before it begins"),
        ({"largest": 10.0}, "more than the 10 bytes"),
        ({"providers": ["nobody"]}, "no such provider"),
        ({"quantities": ["wind"], "providers": ["trial"]}, "trial has no wind"),
        ({"box": (4, 61, 7, 59)}, "south must be less than north"),
    ],
)
def test_what_cannot_be_had_is_refused(
    tmp_path: Path, change: dict[str, object], message: str
) -> None:
    with hostile.serving(hostile.speaking_dap(ocean(*AXES["plain"][:2]))) as address:
        how = {"box": AXES["plain"][2], **change}
        with pytest.raises(UserError) as refusal:
            fetched(tmp_path, address, **how)
    assert message in str(refusal.value)
    assert not (tmp_path / "out").exists()


@pytest.mark.thorough
def test_a_disk_without_room_is_refused_before_and_in_the_middle(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import shutil
    from collections import namedtuple

    usage = namedtuple("usage", "total used free")
    with hostile.serving(hostile.speaking_dap(ocean(*AXES["plain"][:2]))) as address:
        with monkeypatch.context() as patch:
            patch.setattr(shutil, "disk_usage", lambda folder: usage(1, 1, 1000))
            with pytest.raises(UserError, match=r"has 1\.0 kB free, and .* are to be fetched"):
                fetched(tmp_path, address, AXES["plain"][2])
        with monkeypatch.context() as patch:
            make, left = opendap._make, [2]
            patch.setattr(opendap, "PART", 10_000)

            def full(*words: object) -> None:
                left[0] -= 1
                if left[0] < 0:
                    raise OSError(28, "No space left on device")
                make(*words)

            patch.setattr(opendap, "_make", full)
            with pytest.raises(UserError, match=r"disk full: .*; 2 of \d+ parts are kept"):
                fetched(tmp_path, address, AXES["plain"][2])
    assert not (tmp_path / "out").exists()


@pytest.mark.thorough
def test_the_command_asks_before_large_amounts_and_tells_all(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from drift.apps.fetch import fetching

    monkeypatch.setattr(fetching, "LARGEST", 1000.0)
    monkeypatch.setattr(sys, "stdin", io.StringIO())
    with hostile.serving(hostile.speaking_dap(ocean(*AXES["plain"][:2]))) as address:
        words = ["fetch", "--box=-5,35,5,40", "--from", BEGIN, "--to", END, "--provider", "trial"]
        words += ["--catalogue", str(written(tmp_path, address)), "--out", str(tmp_path / "out")]
        assert cli.main([*words, "--dry-run"]) == 0
        streams = capsys.readouterr()
        assert "to fetch" in streams.out
        assert " kB" in streams.out
        assert not list(tmp_path.glob(".drift*"))
        assert cli.main(words) == 2
        assert "add --yes to fetch it" in capsys.readouterr().err
        assert cli.main([*words, "--yes"]) == 0
        told = capsys.readouterr().out
        assert "[[current]]" in told
        assert "# trial; free" in told
        assert (tmp_path / "out" / "forcing.toml").read_text() in told
        assert cli.main([*words, "--yes"]) == 2
        assert "is not empty" in capsys.readouterr().err


@pytest.mark.thorough
def test_ctrl_c_keeps_what_is_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    make, left = opendap._make, [2]

    def leaving(*words: object) -> None:
        left[0] -= 1
        if left[0] == -1:
            raise KeyboardInterrupt
        make(*words)

    monkeypatch.setattr(opendap, "PART", 10_000)
    monkeypatch.setattr(opendap, "_make", leaving)
    with hostile.serving(hostile.speaking_dap(ocean(*AXES["plain"][:2]))) as address:
        words = ["fetch", "--box=-5,35,5,40", "--from", BEGIN, "--to", END, "--provider", "trial"]
        words += ["--catalogue", str(written(tmp_path, address)), "--out", str(tmp_path / "out")]
        assert cli.main(words) == 130
        assert (
            "downloaded parts are kept; the same command continues from there"
            in capsys.readouterr().err
        )
        assert not (tmp_path / "out").exists()
        assert cli.main(words) == 0
        assert "2 parts are already downloaded" in capsys.readouterr().out
