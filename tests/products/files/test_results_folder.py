"""A folder of results is whole or absent: failures, killed runs, what overwriting removes, and what
is rejected.
"""

import hashlib
import subprocess
import sys
import textwrap
from pathlib import Path
from types import MappingProxyType

import numpy as np
import pytest
import xarray as xr
from places import ROOT

from drift.products.files import writer
from drift.products.files.chapter import OutputBundle
from geo.errors import UserError

ATTRIBUTES = {
    "title": "test",
    "seed": "7",
    "source": "casp-drift 0",
    "case": "[case]\ntitle = 'test'",
}


def ink(path):
    path.write_bytes(b"png")


def write_little(folder, pictures=MappingProxyType({"map.png": ink}), **more):
    """Write results that are quickly made, for those who look at the folder: the writer knows no
    topic.
    """
    files = {
        "forecast.nc": lambda stamped: xr.Dataset({"x": ("n", np.arange(3.0))}),
        "track.csv": lambda stamped: "time,\n",
    }
    return writer.write(
        folder, [OutputBundle(files=files, pictures=pictures, facts=ATTRIBUTES)], **more
    )


def test_a_failure_leaves_nothing(tmp_path):
    def fail(path: Path) -> None:
        path.write_bytes(b"half")
        raise RuntimeError("no ink")

    with pytest.raises(RuntimeError, match="no ink"):
        write_little(tmp_path / "out", pictures={"map.png": fail})
    assert list(tmp_path.iterdir()) == []


def test_a_kill_leaves_no_half_file(tmp_path):
    """The process dies while it draws: the target does not exist, and the next run is not
    disturbed.
    """
    program = """
        import os, sys
        from pathlib import Path
        from drift.products.files import writer
        from drift.products.files.chapter import OutputBundle
        files, pictures = {"track.csv": lambda stamped: "time"}, {"map.png": lambda path: os._exit(9)}
        writer.write(Path(sys.argv[1]), [OutputBundle(files=files, pictures=pictures)])
    """
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(program), str(tmp_path / "out")],
        cwd=ROOT,
        capture_output=True,
        check=False,
    )
    assert done.returncode == 9, done.stderr
    assert not (tmp_path / "out").exists()
    writer.check_folder(tmp_path / "out")


def test_overwrite_replaces_ours_and_keeps_the_rest(tmp_path):
    folder = tmp_path / "out"
    write_little(folder)
    (folder / "notes.txt").write_text("mine")
    (folder / "track.csv").write_text("old")
    with pytest.raises(UserError, match=r"is not empty; .*overwrite = True"):
        write_little(folder)
    assert (folder / "track.csv").read_text() == "old"
    write_little(folder, overwrite=True)
    assert (folder / "notes.txt").read_text() == "mine"
    assert (folder / "track.csv").read_text().startswith("time,")
    assert [p.name for p in tmp_path.iterdir()] == ["out"]


def test_overwrite_takes_away_what_only_an_earlier_run_wrote(tmp_path):
    folder = tmp_path / "out"
    write_little(folder, pictures={f"{name}.png": ink for name in ("map", "old", "edited")})
    (folder / "edited.png").write_bytes(b"mine now")
    (folder / "other.png").write_bytes(b"png")
    write_little(folder, overwrite=True)
    assert not (folder / "old.png").exists()
    assert (folder / "edited.png").read_bytes() == b"mine now"
    assert (folder / "other.png").exists()


@pytest.mark.parametrize(
    "names",
    [
        '[{"name": "../mine", "size": 4, "sha256": "%s"}]',
        '[{"name": "a/mine", "size": 4, "sha256": "%s"}]',
        '[{"name": "..", "size": 4, "sha256": "%s"}]',
        "[1]",
        "7",
        "{",
    ],
)
def test_a_foreign_manifest_takes_nothing_away(tmp_path, names):
    folder = tmp_path / "out"
    (folder / "a").mkdir(parents=True)
    for path in (tmp_path / "mine", folder / "a" / "mine"):
        path.write_bytes(b"mine")
    digest = hashlib.sha256(b"mine").hexdigest()
    held = f'{{"run_id": "x", "files": {names.replace("%s", digest)}}}'
    (folder / "manifest.json").write_text(held)
    with pytest.raises(UserError, match=r'"manifest.json" is in the way'):
        write_little(folder, overwrite=True)
    assert (tmp_path / "mine").exists()
    assert (folder / "a" / "mine").exists()
    assert (folder / "manifest.json").read_text() == held
    assert {path.name for path in folder.iterdir()} == {"a", "manifest.json"}


def test_refused_folders(tmp_path):
    (tmp_path / "file").write_text("x")
    with pytest.raises(UserError, match="is not a folder"):
        writer.check_folder(tmp_path / "file")
    with pytest.raises(UserError, match="cannot write"):
        writer.check_folder(tmp_path / "file" / "out")
    (tmp_path / "empty").mkdir()
    writer.check_folder(tmp_path / "empty")
    writer.check_folder(tmp_path / "a" / "b" / "c")
    assert not (tmp_path / "a").exists()


def test_an_empty_folder_is_filled(tmp_path):
    (tmp_path / "out").mkdir()
    write_little(tmp_path / "out")
    assert (tmp_path / "out" / "forecast.nc").exists()


def test_a_run_that_another_has_overtaken_leaves_its_results_alone(tmp_path):
    def meanwhile(path: Path) -> None:
        (tmp_path / "out").mkdir()
        (tmp_path / "out" / "forecast.nc").write_text("the other's")

    with pytest.raises(UserError, match="in the meantime"):
        write_little(tmp_path / "out", pictures={"map.png": meanwhile})
    assert [path.name for path in tmp_path.iterdir()] == ["out"]
    assert (tmp_path / "out" / "forecast.nc").read_text() == "the other's"


@pytest.mark.parametrize(
    "trouble", [OSError(28, "No space left on device"), RuntimeError("NetCDF: HDF error")]
)
def test_a_full_disk_leaves_nothing(tmp_path, monkeypatch, trouble):
    """What netCDF4 and HDF5 raise on a file system of 100 kB."""

    def full(self: xr.Dataset, store: object, **more: object) -> None:
        raise trouble

    monkeypatch.setattr(xr.Dataset, "dump_to_store", full)
    with pytest.raises(UserError, match=r"cannot be written \(.*free some space"):
        write_little(tmp_path / "above" / "out")
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_is_there_is_staged_in_itself_not_beside_it(tmp_path):
    """It may be a mount: what is beside it lies on another file system, where a rename fails."""
    (tmp_path / "out").mkdir()
    seen = []
    pictures = {"map.png": lambda path: (seen.append(path.parents[2]), path.write_bytes(b"png"))}
    write_little(tmp_path / "out", pictures=pictures)
    assert seen == [tmp_path / "out"]
