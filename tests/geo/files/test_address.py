"""Addresses: a good server's values are those of the file; a bad one costs one line, and never more
than its time-out.
"""

import os
import signal
import socket
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import hostile
import netCDF4
import numpy as np
import pytest
import trial_case
from pace import Watch

import drift
from drift.engine.motion import forcing as engine
from geo import waiting
from geo.errors import UserError
from geo.files import address, dataset
from geo.files.child import FAREWELL
from geo.forcing import sources

SEA = hostile.sea()
SHORT = 1.0  # [s] a time-out for tests: a good server on this machine answers in milliseconds


def written(path: Path, variables: dict[str, hostile.Variable]) -> Path:
    """Write what a server holds with plain netCDF4."""
    with netCDF4.Dataset(path, "w") as file:
        file.set_auto_maskandscale(False)
        for name, one in variables.items():
            for dim, size in zip(one.dims, one.values.shape, strict=True):
                if dim not in file.dimensions:
                    file.createDimension(dim, size)
            given = dict(one.attributes)
            made = file.createVariable(
                name, one.values.dtype, one.dims, fill_value=given.pop("_FillValue", None)
            )
            made.set_auto_maskandscale(False)
            made.setncatts(given)
            made[:] = one.values
    return path


@pytest.fixture(autouse=True)
def none_left() -> object:
    """No process of an address is left behind by a test."""
    yield
    address._open.clear()


def case_file(folder: Path, url: str, more: str = "") -> Path:
    return trial_case.write(
        folder,
        f'[[current]]\nfiles = "{url}"\n{more}',
        start="2024-03-01T00:00Z",
        duration="2 h",
        clock={"step": "10 min"},
        current=None,
        scenario={"position": {"at": "38 30S 179 30W", "error": "1 km"}},
    )


@pytest.mark.thorough
def test_a_server_s_values_are_those_of_the_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Bit for bit, read in many pieces, and right against the formula to half a step of the
    packing.
    """
    monkeypatch.setattr(address, "PIECE", 64)
    file = written(tmp_path / "sea.nc", SEA)
    with hostile.serving(hostile.speaking_dap(SEA)) as url:
        here, there = sources.open_source("current", file), sources.open_source("current", url)
        assert (there.grid, there.missing, there.notes) == (here.grid, here.missing, here.notes)
        assert (there.times == here.times).all()
        for i in range(4):
            np.testing.assert_array_equal(there.read(i), here.read(i))
        k, y, x = 3, 5, 6
        expected = (
            0.31 + 0.05 * np.sin(0.9 * (177.5 + 0.75 * x)) + 0.02 * (-41 + 0.5 * y + 38) - 0.03 * k
        )
        assert abs(there.read(k)[y, x, 0] - expected) <= 0.0005 + 1e-6
        assert np.isnan(there.read(0)[2, 3]).all()


def test_a_server_is_asked_for_what_is_needed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a field of 1.3 MB a box takes one hyperslab a slice and component, which every index and
    step reach rightly.
    """
    wide, seen = hostile.sea(130, 270), []
    with hostile.serving(hostile.speaking_dap(wide, seen)) as url:
        data = dataset.open_one(url, "current")
        del seen[:]
        v = wide["v"].values
        np.testing.assert_array_equal(data["v"][2, 7:90, 30:60].values, v[2, 7:90, 30:60])
        assert seen == ["/sea.dods?v[2][7:89][30:59]"] or seen == [
            "/sea.dods?v[2:1:2][7:1:89][30:1:59]"
        ], seen
        np.testing.assert_array_equal(
            data["v"][1, 80:3:-7, [5, 2, 9]].values, v[1, 80:3:-7, [5, 2, 9]].T
        )
        np.testing.assert_array_equal(data["v"][-1, 11].values, v[-1, 11])
        assert data["v"][:, 4:4].values.shape == (4, 0, 270)


def test_threads_share_one_dataset() -> None:
    wide = hostile.sea(130, 270)
    with hostile.serving(hostile.speaking_dap(wide)) as url, ThreadPoolExecutor(4) as pool:
        data = dataset.open_one(url, "current")
        read = list(pool.map(lambda k: data["v"][k % 4, k : k + 60].values, range(12)))
    for k, values in enumerate(read):
        np.testing.assert_array_equal(values, wide["v"].values[k % 4, k : k + 60])


@pytest.mark.thorough
def test_a_process_that_ended_is_started_anew_on_the_same_data() -> None:
    held = dict(SEA)
    with hostile.serving(
        lambda connection, target: hostile.speaking_dap(held)(connection, target)
    ) as url:
        data = dataset.open_one(url, "current")
        first = address._open[url]._child.process
        first.kill()
        first.wait()
        np.testing.assert_array_equal(data["v"].values, SEA["v"].values)
        assert address._open[url]._child.process.pid != first.pid
        held["v"] = replace(
            SEA["v"], values=SEA["v"].values[..., :5], dims=("time", "lat", "short")
        )
        address._open[url].close()
        with pytest.raises(UserError, match="holds other variables than when it was opened"):
            data["u"].load()


def test_pieces_cover_an_array_once() -> None:
    for shape, most in (
        ((4, 7, 9), 10),
        ((4, 7, 9), 1),
        ((5,), 2),
        ((), 3),
        ((3, 0), 5),
        ((2, 3, 4), 1000),
    ):
        hits = np.zeros(shape, int)
        for piece in address.pieces(shape, most):
            assert hits[piece].size <= most
            hits[piece] += 1
        assert (hits == 1).all()


BROKEN = {
    "silent": (hostile.silent, r"did not answer for 1 s \(the timeout of its source\)"),
    "dripping": (hostile.dripping(SEA), "did not answer for"),
    "404": (hostile.always(hostile.http(b"", "404 Not Found")), "cannot open the address"),
    "redirecting": (hostile.redirecting, "cannot open the address"),
    "a web page": (
        hostile.always(hostile.http(b"<html><body>hello</body></html>")),
        "cannot open the address",
    ),
    "no attributes": (
        lambda c, t: c.sendall(
            hostile.http(b"Attributes { u {") if ".das" in t else hostile.good(SEA, t)
        ),
        "does not describe its values",
    ),
    "a huge axis": (
        lambda c, t: c.sendall(hostile.good(SEA, t).replace(b"time = 4", b"time = 2000000000")),
        "cannot open the address|claims to hold 2,000,000,000 values along time",
    ),
}


@pytest.mark.parametrize("kind", BROKEN)
def test_a_bad_server_is_one_line(kind: str) -> None:
    answer, message = BROKEN[kind]
    with hostile.serving(answer) as url, pytest.raises(UserError, match=message) as raised:
        sources.open_source("current", url, timeout=SHORT)
    assert url in str(raised.value)
    assert str(raised.value).endswith("set [[current]] files or timeout")


@pytest.mark.thorough
def test_a_server_that_never_accepts_is_one_line() -> None:
    with hostile.never_accepting() as url, pytest.raises(UserError, match="did not answer for"):
        dataset.open_one(url, "current", SHORT)


def test_a_crash_of_the_library_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    crash = "import os, signal; from geo.files import address_server as s; s._open = lambda a: os.kill(os.getpid(), signal.SIGSEGV);"
    monkeypatch.setattr(address, "START", f"{crash} s.main(sys.argv[1])")
    with pytest.raises(
        UserError, match=r"the library that reads it crashed \(SIGSEGV\); set \[\[wind\]\] files"
    ):
        dataset.open_one("http://127.0.0.1:9/sea", "wind", SHORT)


@pytest.mark.thorough
def test_a_server_that_falls_silent_between_slices_is_one_line() -> None:
    wide, quiet = hostile.sea(130, 270), threading.Event()

    def answer(connection: object, target: str) -> None:
        (hostile.silent if quiet.is_set() else hostile.speaking_dap(wide))(connection, target)

    with hostile.serving(answer) as url:
        source = sources.open_source("current", url, timeout=SHORT)
        quiet.set()
        # The process that reads gives up after as long as this one does: which of the two says so
        # is a matter of load.
        with pytest.raises(
            UserError,
            match=r"^[^\n]*did not answer for 1 s[^\n]*; set \[\[current\]\] files or timeout$",
        ):
            source.read(3)
        quiet.clear()
        assert np.isfinite(source.read(3)).any()


def test_closing_forcing_does_not_wait_for_a_server() -> None:
    asked, left = threading.Event(), threading.Event()

    def read(i: int) -> np.ndarray:
        asked.set()
        try:
            while True:  # as a wait for a server does
                waiting.check_wait()
                time.sleep(0.01)
        finally:
            left.set()

    still = sources.constant_field("current", 0.2, 0.1)
    winds = engine.Forcing([engine.Sources({"current": (replace(still, read=read),)})], 1)
    winds._slices[0][0]._request(0)
    assert asked.wait(5)
    watch = Watch()
    winds.close()
    assert left.is_set()
    assert watch.seconds() < 2


@pytest.mark.thorough
@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
def test_a_process_of_an_address_ends_with_ours_even_when_that_is_killed() -> None:
    came, gone = threading.Event(), threading.Event()

    def answer(connection: object, target: str) -> None:
        came.set()
        hostile.silent(connection, target)
        gone.set()

    with hostile.serving(answer) as url:
        ours = subprocess.Popen(
            [
                sys.executable,
                "-c",
                f"from geo.files import dataset; dataset.open_one({url!r}, 'wind')",
            ]
        )
        assert came.wait(60)
        ours.kill()
        ours.wait()
        # the connection was closed: the process that held it has ended
        assert gone.wait(FAREWELL + 10)


@pytest.mark.thorough
@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
@pytest.mark.parametrize(
    ("command", "number", "status"),
    [
        ("info", signal.SIGINT, 130),
        pytest.param("run", signal.SIGTERM, 143, marks=pytest.mark.thorough),
    ],
)
def test_signals_end_a_wait_for_a_server(
    tmp_path: Path, command: str, number: int, status: int
) -> None:
    """Within two seconds;

    `run` waits in the thread that reads ahead: the server falls silent after the first slices.
    """
    wide, waits = hostile.sea(130, 270), threading.Event()

    def answer(connection: object, target: str) -> None:
        late = ".dods" in target and any(f"{name}[3" in target for name in "uv")
        if command != "run" or late:
            waits.set()
            hostile.silent(connection, target)
        hostile.speaking_dap(wide)(connection, target)

    with hostile.serving(answer) as url:
        what = [url] if command == "info" else [str(case_file(tmp_path, url))]
        if command == "run":
            what += ["--out", str(tmp_path / "out")]
        ours = subprocess.Popen(
            [sys.executable, "-m", "drift", command, *what],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        try:
            assert waits.wait(60), ours.communicate(timeout=1)
            time.sleep(0.1)
            watch = Watch()
            ours.send_signal(number)
            _, told = ours.communicate(timeout=30)
            assert watch.seconds() < 2
        finally:
            ours.kill()
    assert ours.returncode == status
    assert (
        told.strip()
        .splitlines()[-1]
        .startswith("drift: interrupted" if status == 130 else "drift: terminated on request")
    )
    assert "Traceback" not in told


def test_the_time_out_is_the_case_s(tmp_path: Path) -> None:
    spec = drift.load(case_file(tmp_path, "http://127.0.0.1:9/sea", 'timeout = "0.5 min"')).forcing[
        "current"
    ][0]
    assert spec.timeout == 30
    assert (
        drift.load(case_file(tmp_path, "http://127.0.0.1:9/sea")).forcing["current"][0].timeout
        == address.TIMEOUT
    )
    for wrong in ('"0.5 s"', '"2 h"', '"soon"'):
        with pytest.raises(UserError, match="timeout"):
            drift.load(case_file(tmp_path, "http://127.0.0.1:9/sea", f"timeout = {wrong}"))


@pytest.mark.parametrize("length", [pytest.param(0.5, marks=pytest.mark.thorough), 0.999, 1.2])
def test_values_of_another_length_are_never_used(length: float) -> None:
    """A whole answer in HTTP, whose values are not whole: the netCDF library gives what is in
    memory.
    """

    def answer(connection: socket.socket, target: str) -> None:
        head, gap, body = hostile.good(SEA, target).partition(b"\r\n\r\n")
        if ".dods?u" in target:
            text, mark, values = body.partition(b"\nData:\n")
            whole = values * 2
            connection.sendall(hostile.http(text + mark + whole[: int(length * len(values))]))
        else:
            connection.sendall(head + gap + body)

    with (
        hostile.serving(answer) as url,
        pytest.raises(UserError, match=r"came with .* bytes in place of"),
    ):
        sources.open_source("current", url, timeout=SHORT)


@pytest.mark.thorough
def test_values_that_are_whole_at_the_second_asking_are_read() -> None:
    asked: set[str] = set()

    def answer(connection: socket.socket, target: str) -> None:
        content = hostile.good(SEA, target)
        connection.sendall(
            content if target in asked or ".dods" not in target else content[: len(content) // 2]
        )
        asked.add(target)

    with hostile.serving(answer) as url:
        data = dataset.open_one(url, "current")
        np.testing.assert_array_equal(data["v"][2].values, SEA["v"].values[2])


# the last one aborts the library, netCDF 4.10.1
@pytest.mark.parametrize("seed", [pytest.param(4, marks=pytest.mark.thorough), 1936])
def test_damaged_answers_are_one_line(seed: int) -> None:
    """A slice of benchmarks/fuzz_server.py."""
    _, answer = hostile.mutated(SEA, seed)
    with hostile.serving(answer) as url, pytest.raises(UserError) as raised:
        sources.open_source("current", url, timeout=SHORT)
    assert "\n" not in str(raised.value)
