"""Of a run of 10^9 particles is said at once what it needs: before anything is drawn."""

import shutil
import time
from collections import namedtuple
from dataclasses import replace

import pytest
import trial_case

import drift
from drift.apps.check import outlook
from drift.apps.cli import commands
from drift.case import file as case_file
from drift.pipeline.shards import divide
from geo.errors import UserError
from kernels.runtime import memory

Usage = namedtuple("Usage", "total used free")


@pytest.fixture
def full_disk(monkeypatch):
    monkeypatch.setattr(shutil, "disk_usage", lambda _: Usage(2e9, 1e9, 1e9))


def written(tmp_path, particles: int):
    return trial_case.write(
        tmp_path, duration="1 h", particles=particles, output={"trajectories": 0}
    )


def test_what_is_needed(tmp_path):
    """Two outputs of 17 to 40 bytes a particle are 34 to 80 GB; 10^9 at 8e6 a second take 125 s."""
    words = outlook.shard_needs(case_file.load(written(tmp_path, 10**9)))
    assert words.startswith("1,000,000,000 particles are moved in ")
    size = float(words.partition(" shards. They need ")[2].partition(" GiB of disk")[0])
    assert 34e9 / 2**30 < size < 80e9 / 2**30
    assert "about 2 min on two cores" in words
    assert outlook.shard_needs(case_file.load(written(tmp_path, 10**5))) is None


def test_no_room_is_refused_before_anything_is_drawn(tmp_path, full_disk):
    begun = time.process_time()
    with pytest.raises(
        UserError,
        match=r"the particles at all output times need .* GiB, and 953.7 MiB are free; free some space",
    ):
        drift.run(case_file.load(written(tmp_path, 10**9)), out=tmp_path / "out")
    assert time.process_time() - begun < 30  # [s]; to draw them once takes minutes


def test_the_command_line_says_it_first(tmp_path, full_disk, capsys):
    assert (
        commands.main(["run", str(written(tmp_path, 10**9)), "--out", str(tmp_path / "out")]) == 2
    )
    first, *_ = capsys.readouterr().err.splitlines()
    assert first.startswith("drift: 1,000,000,000 particles are moved in ")


def test_one_piece_that_no_memory_holds_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(memory, "free", lambda: 8 * 2**30)
    case = case_file.load(written(tmp_path, 10**9))
    filled = replace(case, resampling=replace(case.resampling, method="position", bulk=0.1))
    asked = r'1,000,000,000 in one piece, as \[resampling\] method = "position" asks for, take .* GiB of memory, and 8.0 GiB'
    with pytest.raises(UserError, match=asked):
        divide.number_of_shards(filled, None, None)
