"""Damaged GRIB and libraries that crash or hang: one line, and no wait."""

import os
import select
import signal
import subprocess
import sys
import threading
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from grib_messages import LAMBERT, REGULAR, pair, refusal, worst, written
from pace import Watch

from drift.engine.motion import forcing as engine
from geo import waiting
from geo.errors import UserError
from geo.files import decoder, messages
from geo.files.child import FAREWELL
from geo.forcing import sources


@pytest.mark.thorough
def test_nothing_is_written_beside_a_file_and_nothing_is_imported_here(tmp_path: Path) -> None:
    written(tmp_path / "a.grib", pair(REGULAR))
    code = "import sys; from geo.forcing import sources; s = sources.open_source('wind', sys.argv[1], steady=True); s.read(0); print('eccodes' in sys.modules)"
    told = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path / "a.grib")],
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert told.stdout.strip() == "False", told.stderr
    assert told.stderr == ""
    assert [p.name for p in tmp_path.iterdir()] == ["a.grib"]


def test_truncated_files(tmp_path: Path) -> None:
    for edition in (1, 2):
        whole = b"".join(pair(REGULAR, edition=edition))
        for length in (5, 40, 150, len(whole) // 2 - 3, len(whole) // 2 + 60, len(whole) - 1):
            told = refusal("wind", written(tmp_path / "cut.grib", [whole[:length]]), steady=True)
            assert "cut.grib" in told
            assert "damaged" in told
            assert "[[wind]] files" in told


def test_bytes_between_messages(tmp_path: Path) -> None:
    one, two = pair(REGULAR)
    heading = b"\r\r\nUXUK98 EGRR 050000\r\r\n"
    path = written(tmp_path / "a.grib", [heading, one, b"\r\n", heading, two, bytes(300)])
    assert worst(sources.open_source("wind", path, steady=True))[0] < 1e-5
    late = written(
        tmp_path / "late.grib", [bytes(9000), one]
    )  # no other backend of xarray's is asked, cfgrib above all
    assert "unknown format" in refusal("wind", late, steady=True)
    assert not list(tmp_path.glob("*.idx"))
    # a message whose first bytes are damaged
    lost = written(tmp_path / "b.grib", [one, b"grib" + two[4:], one])
    assert "belong to no message" in refusal("wind", lost, steady=True)


def outcome(path: Path, quantity: str = "wind") -> str:
    """What reading all of a file comes to: "read", or one line that names it or the key that does."""
    try:
        source = sources.open_source(quantity, path, lenient=True)
        for k in range(max(1, len(source.times))):
            source.read(k)
    except UserError as error:
        one = "\n" not in str(error) and (
            path.name in str(error) or f"[[{quantity}]]" in str(error)
        )
        return "refused" if one else f"refused badly: {error}"
    return "read"


def test_damaged_bytes_never_end_the_process(tmp_path: Path) -> None:
    """A slice of what benchmarks do at length: any bytes changed, wherever they stand."""
    random = np.random.default_rng(7)
    files = [b"".join(pair(LAMBERT, along=True)), b"".join(pair(REGULAR, edition=1))]
    seen = set()
    for k in range(20):
        damaged = bytearray(files[k % 2])
        for at in random.integers(0, len(damaged) if k % 4 < 2 else 250, 4):
            damaged[at] = random.integers(256)
        seen.add(outcome(written(tmp_path / f"{k}.grib", [bytes(damaged)])))
    assert seen == {"read", "refused"}


@pytest.mark.thorough
def test_a_library_that_crashes_or_hangs_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = written(tmp_path / "a.grib", pair(REGULAR))
    raw = messages.whole(messages.split_messages(str(path))[0])
    first = decoder._running().process
    first.kill()
    first.wait()
    # a helper that went away between two questions is started again
    assert decoder.values(raw).size == 900
    assert decoder._running().process.pid != first.pid

    os.kill(decoder._running().process.pid, 19)  # stopped: it will never answer
    monkeypatch.setattr(decoder, "LIMIT", 0.3)
    with pytest.raises(decoder.DecodeError, match="did not answer within"):
        decoder.values(raw)
    monkeypatch.undo()

    helper = decoder._running().process
    os.kill(helper.pid, 19)
    killer = threading.Timer(0.3, helper.kill)
    killer.start()
    with pytest.raises(decoder.DecodeError, match=r"the GRIB library crashed \(SIGKILL\)"):
        decoder.values(raw)
    killer.join()
    assert decoder.values(raw).size == 900


@pytest.mark.thorough
@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
@pytest.mark.parametrize("size", [100, 2**20])  # the second is more than fits into a pipe
def test_closing_forcing_does_not_wait_for_a_library_that_hangs(size: int, tmp_path: Path) -> None:
    raw = pair(REGULAR)[0]
    stopped = decoder._running()
    os.kill(stopped.process.pid, signal.SIGSTOP)
    still = replace(
        sources.constant_field("wind", 7.0, -3.0), read=lambda i: decoder.values(bytes(size))
    )
    winds = engine.Forcing([engine.Sources({"wind": (still,)})], 1)
    reading = winds._slices[0][0]._request(0)
    time.sleep(0.5)
    assert reading.running()
    watch = Watch()
    winds.close()
    assert watch.seconds() < 2
    assert isinstance(reading.exception(), waiting.WaitInterrupted)
    assert stopped.process.returncode == -signal.SIGKILL
    assert decoder.values(raw).size == 900  # another one is started


@pytest.mark.thorough
@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
@pytest.mark.parametrize("name", ["SIGINT", "SIGKILL"])
def test_a_signal_ends_a_wait_for_a_library_that_hangs(name: str, tmp_path: Path) -> None:
    """Within two seconds, and the process that hangs soon after ours, even where that is killed."""
    path = written(tmp_path / "a.grib", pair(REGULAR))
    os.mkfifo(tmp_path / "held")  # open in the process that hangs, for as long as that lives
    hanging = f"lambda *_: (os.write(os.open({str(tmp_path / 'held')!r}, os.O_WRONLY), b'asked'), time.sleep(600))"
    start = f"import os, time; from geo.files import decoder; decoder._answer = {hanging}; decoder.serve()"
    code = (
        "import sys; from drift.apps.cli.commands import main; from geo.files import decoder; "
        f"decoder.START = {start!r}; sys.exit(main(['info', sys.argv[1]]))"
    )
    held = os.open(tmp_path / "held", os.O_RDONLY | os.O_NONBLOCK)
    ours = subprocess.Popen(
        [sys.executable, "-c", code, str(path)], stderr=subprocess.PIPE, text=True
    )
    try:
        assert select.select([held], [], [], 60)[0]
        assert os.read(held, 5) == b"asked"
        watch = Watch()
        ours.send_signal(getattr(signal, name))
        _, told = ours.communicate(timeout=30)
        assert watch.seconds() < 2
        assert select.select([held], [], [], FAREWELL + 10)[0]
        assert os.read(held, 1) == b""
    finally:
        ours.kill()
        os.close(held)
    if name == "SIGINT":
        assert ours.returncode == 130
        assert told.strip().splitlines()[-1].startswith("drift: interrupted")


@pytest.mark.skipif(os.name != "posix", reason="limits of POSIX")
def test_limits_hold_under_a_limit_of_the_system() -> None:
    """A soft limit cannot be more than a finite hard one, which once left the process without any."""
    code = (
        "import resource as r; from geo.files.child import limit; most = 2**40\n"
        "r.setrlimit(r.RLIMIT_AS, (most, most)); r.setrlimit(r.RLIMIT_FSIZE, (2**20, 2**20))\n"
        "limit(RLIMIT_AS=2**33, RLIMIT_FSIZE=2**30, RLIMIT_NONE=1)\n"
        "print([r.getrlimit(n)[0] for n in (r.RLIMIT_AS, r.RLIMIT_FSIZE, r.RLIMIT_CORE)])"
    )
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert told.stdout.strip() == str([2**33, 2**20, 0]), told.stderr
