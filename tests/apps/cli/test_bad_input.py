"""Bad input, through the command line: one clear line, exit status 2, nothing written."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import netCDF4
import numpy as np
import pytest
from small_case import CASE, STEADY, field

from drift.apps.cli.commands import main
from drift.products.files import publication


def truncated(path: Path) -> None:
    field().to_netcdf(path)
    path.write_bytes(path.read_bytes()[:3000])


def nothing_but_nan(path: Path) -> None:
    data = field()
    (data * np.nan).assign_attrs(data.attrs).map(
        lambda v: v.assign_attrs(data[v.name].attrs)
    ).to_netcdf(path)


def without_units(path: Path) -> None:
    data = field()
    for name in ("uo", "vo"):
        del data[name].attrs["units"]
    data.to_netcdf(path)


def winds(path: Path) -> None:
    field(("u10", "v10"), ("eastward_wind", "northward_wind")).to_netcdf(path)


FILES: dict[str, tuple[Callable[[Path], object], str]] = {
    "not a netCDF file": (lambda path: path.write_text("hello"), "current.nc"),
    "truncated": (truncated, "current.nc"),
    "current file that holds a wind": (winds, "wind"),
    "NaN everywhere": (nothing_but_nan, "missing"),
    "absent units": (without_units, "units"),
    "too early": (
        lambda path: field(hours=np.arange(-50, -30)).to_netcdf(path),
        "(0% of the run is covered",
    ),
    "ends halfway": (
        lambda path: field(hours=np.arange(7)).to_netcdf(path),
        "(50% of the run is covered",
    ),
    "elsewhere": (lambda path: field(west=120.0).to_netcdf(path), "no overlap"),
    "half of the prior outside": (
        lambda path: field(west=-88.0).to_netcdf(path),
        "53.6 % of the prior",
    ),
}


def refused(tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str, *arguments: str) -> str:
    """Return the one line with which a run is refused; nothing may have been written."""
    (tmp_path / "trial.toml").write_text(text)
    before = sorted(tmp_path.iterdir())
    status = main(["run", str(tmp_path / "trial.toml"), "--out", str(tmp_path / "out"), *arguments])
    captured = capsys.readouterr()
    assert status == 2
    assert sorted(tmp_path.iterdir()) == before
    assert captured.out == ""
    (line,) = captured.err.strip().splitlines()
    assert line.startswith("drift: ")
    assert "Traceback" not in line
    return line


@pytest.mark.parametrize("kind", FILES)
def test_forcing(kind: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write, word = FILES[kind]
    write(tmp_path / "current.nc")
    line = refused(tmp_path, capsys, CASE)
    print(line)
    assert word.lower() in line.lower()


def test_no_wind_in_the_wind_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    field().to_netcdf(tmp_path / "current.nc")
    text = CASE.replace('constant = { speed = "10 kn", from = 270 }', 'files = "current.nc"')
    line = refused(tmp_path, capsys, text)
    assert "wind" in line
    assert "current" in line


def test_missing_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert "current.nc" in refused(tmp_path, capsys, CASE)


def test_position_on_land_says_where_the_nearest_water_is(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    field().to_netcdf(tmp_path / "current.nc")
    square = '{"type": "Polygon", "coordinates": [[[-88.2, 27], [-87.9, 27], [-87.9, 28], [-88.2, 28], [-88.2, 27]]]}'
    (tmp_path / "shore.geojson").write_text(square)
    line = refused(tmp_path, capsys, CASE.replace('"none"', '"shore.geojson"'))
    # 0.1 degrees of longitude east of it, at 27.5 N: 5.3 nmi.
    assert "27-30.0N 088-00.0W" in line
    assert "5.3 nmi" in line
    assert "087-5" in line


def test_output_folder_not_empty(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    field().to_netcdf(tmp_path / "current.nc")
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "mine.txt").write_text("keep")
    assert "--overwrite" in refused(tmp_path, capsys, CASE)
    assert (tmp_path / "out" / "mine.txt").read_text() == "keep"


def test_backend_that_is_not_there(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    field().to_netcdf(tmp_path / "current.nc")
    line = refused(tmp_path, capsys, CASE, "--backend", "metal")
    assert "metal" in line
    assert "cpu" in line


@pytest.mark.thorough
def test_a_run_that_loses_too_much_fails_and_one_that_may_does_not(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """3 h at 0.3 m/s is 3.2 km; a prior 3 km from the rim of the forcing loses about half of what
    is there.
    """
    field(west=-93.02 + 0.05).to_netcdf(tmp_path / "current.nc")
    text = CASE.replace('"1 nmi"', '"500 m"')
    line = refused(tmp_path, capsys, text)
    assert "max_lost" in line
    assert (
        main(
            [
                "run",
                str(tmp_path / "trial.toml"),
                "--out",
                str(tmp_path / "out"),
                "--set",
                "max_lost=1.0",
            ]
        )
        == 0
    )
    assert (tmp_path / "out" / "forecast.nc").is_file()


def no_level(path: Path) -> None:
    field().expand_dims(depth=[0.0]).isel(depth=slice(0, 0)).to_netcdf(path)


def no_row(path: Path) -> None:
    field().isel(lat=slice(0, 0)).to_netcdf(path)


def words_for_times(path: Path) -> None:
    data = field()
    words = (
        "time",
        data.time.dt.strftime("%Y-%m-%dT%H").values,
        {"units": "hours since 2026-11-20"},
    )
    data.assign_coords(time=words).to_netcdf(path)


def levels_unknown(path: Path) -> None:
    field().expand_dims(depth=[np.nan, np.nan]).to_netcdf(path)


def endless_units(path: Path) -> None:
    data = field()
    data["uo"].attrs["units"] = "9**9**9"
    data.to_netcdf(path)


def truncated_64(path: Path) -> None:
    """A classic file of the fifth kind, of which netCDF reads what is missing as zeros."""
    with netCDF4.Dataset(path, "w", format="NETCDF3_64BIT_DATA") as file:
        for name, variable in field().variables.items():
            for dim, size in zip(variable.dims, variable.shape, strict=True):
                if dim not in file.dimensions:
                    file.createDimension(dim, size)
            held = file.createVariable(name, "f8", variable.dims)
            held.setncatts(
                variable.attrs if name != "time" else {"units": "hours since 2026-11-20 21:00"}
            )
            held[:] = variable.values if name != "time" else np.arange(13)
    path.write_bytes(path.read_bytes()[:-9000])


MORE_FILES: dict[str, tuple[Callable[[Path], object], str]] = {
    "no level": (no_level, "depth"),
    "no row": (no_row, "lat"),
    "times in words": (words_for_times, "no numbers"),
    "levels without depths": (levels_unknown, "variables.depth"),
    "units that take for ever": (endless_units, "9**9**9"),
    "classic 64-bit file truncated": (truncated_64, "truncated"),
    "a loop of links": (lambda path: path.symlink_to(path), "links"),
    "a pipe": (lambda path: os.mkfifo(path), "neither a file"),
}


@pytest.mark.parametrize("kind", MORE_FILES)
def test_forcing_that_once_ended_in_a_traceback(
    kind: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write, word = MORE_FILES[kind]
    write(tmp_path / "current.nc")
    assert word in refused(tmp_path, capsys, CASE)


@pytest.mark.parametrize(
    ("keys", "word"),
    [
        ('{ lon = "uo" }', "variables.lon"),
        ('{ east = "uo", north = "uo" }', "both components"),
        ('{ mask = "none_such" }', "none_such"),
        ('{ angle = "none_such" }', "none_such"),
    ],
)
def test_variables_that_do_not_fit(
    keys: str, word: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    field().to_netcdf(tmp_path / "current.nc")
    assert word in refused(
        tmp_path, capsys, CASE.replace('"current.nc"', f'"current.nc"\nvariables = {keys}')
    )


@pytest.mark.parametrize(
    ("old", "new", "word"),
    [
        ('"6 h"', '"6 m**9**9**9"', "no unit"),
        ('"6 h"', "9" * 400, "too large"),
        ("500", "9" * 4000, "too large"),
        ("500", "9" * 5000, "not valid TOML"),
        ("500", "[" * 5000, "not valid TOML"),
        ('"trial"', '"a\\u0000b"', "title"),
        ('"boat"', '"a\\nb"', "name"),
        ('"10 kn"', '"5 9**9**9"', "speed"),
        (
            "position",
            "area = { polygon = [[-100, 10], [100, 10], [100, 20], [-100, 20]] }\n#",
            "direction round the Earth",
        ),
        (
            "position",
            "area = { polygon = [[-88, 27], [-87, 27], [-87, 27.000001]] }\n#",
            "narrower",
        ),
        (
            "position",
            "trackline = { waypoints = [[-88, 27], [-87, 27]], speed = 1e-300, cross_track = 1 }\n#",
            "century",
        ),
        ('constant = { speed = "10 kn", from = 270 }', f'files = "{"a" * 5000}.nc"', "too long"),
        ('constant = { speed = "10 kn", from = 270 }', 'files = "~no_such_user/x.nc"', "no file"),
    ],
)
def test_case_files(
    old: str, new: str, word: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    line = refused(tmp_path, capsys, STEADY.replace(old, new))
    assert word.lower() in line.lower()
    assert len(line) < 1300


def test_a_setting_that_is_not_text(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert "UTF-8" in refused(tmp_path, capsys, STEADY, "--set", "title=\udcff")


SHORES: dict[str, tuple[str, str, str]] = {
    "a table": ("shore.csv", "a,b\n1,2\n", "cannot be read"),
    "a ring of two points": (
        "shore.geojson",
        '{"type": "Polygon", "coordinates": [[[1, 1], [2, 2]]]}',
        "cannot be read",
    ),
    "map bounds of nothing": ("shore.bna", '"Map Bounds","1",0\n', "Map Bounds"),
    "a count without end": ("shore.bna", f'"1","1",{"9" * 5000}\n', "not a .bna record"),
}


@pytest.mark.parametrize("kind", SHORES)
def test_shorelines(kind: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    name, text, word = SHORES[kind]
    (tmp_path / name).write_text(text)
    assert word in refused(tmp_path, capsys, STEADY.replace('"none"', f'"{name}"'))


def test_a_case_file_with_a_byte_order_mark_is_read(tmp_path: Path) -> None:
    (tmp_path / "trial.toml").write_text(STEADY, encoding="utf-8-sig")
    assert main(["check", str(tmp_path / "trial.toml")]) == 0


def test_a_name_in_brackets_is_shown(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "trial.toml").write_text(STEADY.replace('"air"', '"[/x]"'))
    assert main(["check", str(tmp_path / "trial.toml")]) == 0
    assert "[/x]" in capsys.readouterr().out


@pytest.mark.parametrize("name", ["loop", "n" * 300, "x\udcff"])
def test_output_folders(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    if name == "loop":
        (tmp_path / name).symlink_to(tmp_path / name)
    assert "--out" in refused(tmp_path, capsys, STEADY, "--out", str(tmp_path / name))


RUNS = """
import sys
from drift.apps.cli import commands
for _ in range(3):
    print(commands.main(), file=sys.stderr, flush=True)
commands.leave()
"""


@pytest.mark.thorough
@pytest.mark.skipif(os.name != "posix", reason="signals and HOME of POSIX")
def test_a_signal_while_files_are_written_leaves_nothing(tmp_path: Path) -> None:
    """Results of before stay as they were; an exception inside HDF5 once left the process waiting
    for its own lock.

    One process, without a home and with its output closed: it is stopped three times, and then
    comes to its end.
    """
    (tmp_path / "trial.toml").write_text(STEADY)
    with publication.staged(tmp_path / "out") as stage:
        (stage.new / "forecast.nc").write_text("old")
        publication.publish(stage, "old")
    words = ["run", "trial.toml", "--out", "out", "--overwrite", "--set", "output.every=1200"]
    without = {name: value for name, value in os.environ.items() if name != "HOME"}
    run = subprocess.Popen(
        [sys.executable, "-c", RUNS, *words], cwd=tmp_path, text=True, env=without, stderr=subprocess.PIPE,
        preexec_fn=lambda: (os.close(1), signal.signal(signal.SIGHUP, signal.SIG_DFL)),
    )  # fmt: skip
    assert run.stderr is not None
    for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
        while run.poll() is None and not list(
            (tmp_path / "out").glob(".drift-partial-*/new/forecast.nc")
        ):
            time.sleep(0.005)
        run.send_signal(number)
        assert run.stderr.readline().startswith("drift: ")
        assert run.stderr.readline() == f"{128 + number}\n"
        assert sorted(path.name for path in (tmp_path / "out").iterdir()) == [
            "forecast.nc",
            "manifest.json",
        ]
        assert (tmp_path / "out" / "forecast.nc").read_text() == "old"
        assert publication.results(tmp_path / "out")
    _, told = run.communicate(timeout=60)
    assert (run.returncode, told) == (0, "")
    assert "map.png" in {path.name for path in publication.results(tmp_path / "out")}


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full")
def test_a_full_standard_output() -> None:
    with open("/dev/full", "w") as full:
        command = [sys.executable, "-m", "drift", "objects", "raft"]
        done = subprocess.run(
            command, stdout=full, stderr=subprocess.PIPE, text=True, timeout=60, check=False
        )
    assert done.returncode == 2
    (line,) = done.stderr.strip().splitlines()
    assert line.startswith("drift: cannot write to standard output")
