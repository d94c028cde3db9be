"""Downloads that are killed, cut short or short of disk space: they go on, and nothing broken is
used.
"""

import io
import os
import re
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import hostile
import netCDF4
import numpy as np
import pytest
from ocean_servers import AXES, BEGIN, END, fetched, ocean, written
from places import ROOT

from drift.apps.cli import commands as cli
from drift.apps.fetch import opendap
from geo.errors import UserError


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
        assert "--yes fetches it" in capsys.readouterr().err
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
