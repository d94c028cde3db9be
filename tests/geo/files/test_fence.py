"""The fence: what a case that came from elsewhere may open.

Each attack is made on the function that opens the file.
"""

import os
import re
import shutil
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyogrio
import pytest
import shapely
import small_case
import xarray as xr
from places import ROOT

import drift
from drift.case import file as case_file
from drift.case.forcing import sources
from geo.box import Box
from geo.coast import shore
from geo.errors import UserError
from geo.files import dataset, digest, fence, small
from geo.grids import projection

BOX = Box(-90.0, 25.0, -86.0, 29.0)
OUT = "outside the folders|may not be"


@pytest.fixture
def fenced(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder that may be read, with a secret beside it and links to that in it."""
    inside, secret = tmp_path / "inside", tmp_path / "secret"
    inside.mkdir()
    secret.mkdir()
    (secret / "wind.txt").write_text("secret", encoding="utf-8")
    small_case.field().to_netcdf(secret / "current.nc")
    shutil.copy(secret / "current.nc", inside / "current.nc")
    (inside / "link.nc").symlink_to(secret / "current.nc")
    (inside / "folder").symlink_to(secret)
    (secret / "x.zarr").mkdir()
    (inside / "x.zarr").mkdir()
    (inside / "x.zarr" / "zarr.json").symlink_to(secret / "wind.txt")
    monkeypatch.setenv("A_SECRET", "hunter2")
    held = fence.Fence((inside.resolve(),), frozenset({"thredds.example.org", "localhost:8080"}))
    monkeypatch.setenv(fence.NAME, fence.fence_text(held))
    return inside


@pytest.mark.parametrize(
    "written",
    [
        "/etc/passwd", "../secret/current.nc", "./../secret/current.nc", "../inside-too/x.nc", "link.nc", "folder/current.nc", "folder/*.nc",
        "*/current.nc", "../*/current.nc", "*/../../secret/current.nc", "**/../../secret/*.nc", "/etc/pass*", "~/.ssh/id_rsa",
        "~root/.bashrc", "[.][.]/secret/current.nc/../current.nc", "${A_SECRET}", "$A_SECRET/x.nc", "/proc/self/environ", "/dev/fd/0",
        "file:///etc/passwd", "http://169.254.169.254/latest/meta-data", "https://localhost/x", "http://localhost:22/x",
        "http://thredds.example.org@evil.org/x", "http://thredds.example.org\\@evil.org/", "dods://thredds.example.org/x",
        "http://thredds.example.org/x#mode=zarr,file", "HTTP://EVIL.ORG/x", "s3://bucket/x", "http://[::1]/x", "http://evil.org?thredds.example.org",
    ],
)  # fmt: skip
def test_no_name_of_a_source_leads_out(fenced: Path, written: str) -> None:
    """Neither a path nor a pattern nor an address, and what it is refused for does not tell what is
    there.
    """
    with pytest.raises((UserError, ValueError), match=OUT) as refused:
        sources.matching_files(written, fenced)
    assert "hunter2" not in str(refused.value)


def test_what_is_inside_may_be_read(fenced: Path) -> None:
    assert sources.matching_files("current.nc", fenced) == [str((fenced / "current.nc").resolve())]
    assert sources.matching_files("cur*.nc", fenced) == [str((fenced / "current.nc").resolve())]
    for address in ("https://thredds.example.org/dap/x.nc?u[0:1]", "http://thredds.example.org:8443/x", "http://localhost:8080/x"):  # fmt: skip
        assert sources.matching_files(address, fenced) == [address]
    assert "uo" in dataset.open_one(str(fenced / "current.nc"), "current")


OPENERS: dict[str, Callable[[Path], object]] = {
    "a file of winds or currents": lambda folder: dataset.open_one(
        str(folder / "link.nc"), "current"
    ),
    "through a folder's link": lambda folder: dataset.open_one(
        str(folder / "folder" / "current.nc"), "current"
    ),
    "a Zarr store with a link in it": lambda folder: dataset.open_one(
        str(folder / "x.zarr"), "current"
    ),
    "an address": lambda folder: dataset.open_one("http://127.0.0.1:1/x", "current"),
    "a small file": lambda folder: small.read_small_file(folder / "folder" / "wind.txt"),
    "a digest": lambda folder: digest.digest_of(str(folder / "link.nc")),
    "a shoreline": lambda folder: shore.read_land(str(folder / "folder" / "wind.txt"), BOX),
    "a case": lambda folder: case_file.load(folder / "folder" / "wind.txt"),
}


@pytest.mark.parametrize("opener", OPENERS)
def test_where_a_file_is_opened_the_fence_is_asked_again(fenced: Path, opener: str) -> None:
    """So that what was exchanged after the case was read is refused too."""
    with pytest.raises(UserError, match=OUT):
        OPENERS[opener](fenced)


def test_a_file_exchanged_while_it_is_opened_is_refused(
    fenced: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The name is in order when it is looked at, and leads out when it is opened."""
    path = fenced / "case.toml"
    path.write_text("title = 1", encoding="utf-8")
    opened = os.open

    def exchange(name: Path, *how: int) -> int:
        if Path(name) == path:
            path.unlink()
            path.symlink_to(fenced.parent / "secret" / "wind.txt")
            handle = opened(name, *how)
            path.unlink()
            path.write_text("title = 1", encoding="utf-8")
            return handle
        return opened(name, *how)

    monkeypatch.setattr(os, "open", exchange)
    if not os.path.exists("/proc/self/fd"):
        pytest.skip("this system does not tell what is open")
    with pytest.raises(UserError, match=OUT):
        small.read_small_file(path)


SQUARE = '{"type": "Polygon", "coordinates": [[[-88, 26], [-87, 26], [-87, 27], [-88, 26]]]}'
VIRTUAL = '<OGRVRTDataSource><OGRVRTLayer name="l"><SrcDataSource>{secret}</SrcDataSource></OGRVRTLayer></OGRVRTDataSource>'
PROGRAM = '{{"type": "gdal_streamed_alg", "command_line": "gdal vector pipeline ! read {secret} ! {more}"}}'
PROGRAMS = {
    "a virtual file": ("coast.geojson", VIRTUAL),
    "a virtual file in an archive that is none": ("x.zip!v.vrt", SQUARE.replace("{", "{{").replace("}", "}}")),
    "a program that reads": ("coast.toml", PROGRAM.replace("! {more}", "")),
    "a program that writes": ("coast.json", PROGRAM.replace("{more}", "partition {out} --field x --format CSV")),
    "a program further down": ("coast.json", " " * 900 + PROGRAM.replace("! {more}", "")),
    "a program as a shape": ("coast.json", '{{"type": "FeatureCollection", "features": [' + PROGRAM.replace("! {more}", "") + "]}}"),
    "another service": ("coast.json", '{{"type": "TopoJSON", "objects": {{}}}}'),
}  # fmt: skip


@pytest.mark.parametrize("kind", PROGRAMS)
@pytest.mark.parametrize("raised", [True, False])
def test_no_shoreline_is_a_program(
    fenced: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str, raised: bool
) -> None:
    """GDAL would open what it names, run what it says, or look into an archive; with a fence or
    without.
    """
    name, content = PROGRAMS[kind]
    out = tmp_path / "written"
    (tmp_path / "secret" / "land.geojson").write_text(SQUARE, encoding="utf-8")
    (fenced / "v.vrt").write_text(
        VIRTUAL.format(secret=tmp_path / "secret" / "land.geojson"), encoding="utf-8"
    )
    with zipfile.ZipFile(fenced / "x.zip", "w") as archive:
        archive.write(fenced / "v.vrt", "v.vrt")
    (fenced / name).write_text(
        content.format(secret=tmp_path / "secret" / "land.geojson", out=out, more=""), "utf-8"
    )
    if not raised:
        monkeypatch.delenv(fence.NAME)
    if name.endswith("!v.vrt"):  # read for what it is
        assert len(shore.read_land(str(fenced / name), BOX).polygons) == 1
    else:
        with pytest.raises(UserError, match="cannot be read"):
            shore.read_land(str(fenced / name), BOX)
    assert not out.exists()


def test_a_shapefile_s_files_are_inside(fenced: Path) -> None:
    pyogrio.raw.write(
        fenced / "a.shp", np.array([shapely.to_wkb(shapely.from_geojson(SQUARE))]), [], [], geometry_type="Polygon",
        crs="EPSG:4326",
    )  # fmt: skip
    assert len(shore.read_land(str(fenced / "a.shp"), BOX).polygons) == 1
    (fenced / "a.dbf").unlink()
    (fenced / "a.dbf").symlink_to(fenced.parent / "secret" / "wind.txt")
    with pytest.raises(UserError, match=OUT):
        shore.read_land(str(fenced / "a.shp"), BOX)


def test_a_shapefile_is_not_looked_for_in_an_archive(fenced: Path) -> None:
    """The reader of shapefiles takes x.zip!a.shp for a.shp in x.zip, wherever a link leads from
    there.
    """
    shapes = np.array([shapely.to_wkb(shapely.from_geojson(SQUARE))])
    pyogrio.raw.write(fenced / "a.shp", shapes, [], [], geometry_type="Polygon", crs="EPSG:4326")
    with zipfile.ZipFile(fenced.parent / "secret" / "x.zip", "w") as archive:
        for part in fenced.glob("a.*"):
            archive.write(part, part.name)
    (fenced / "x.zip").symlink_to(fenced.parent / "secret" / "x.zip")
    shutil.copy(fenced / "a.shp", fenced / "x.zip!a.shp")
    with pytest.raises(UserError, match='has no "!"'):
        shore.read_land(str(fenced / "x.zip!a.shp"), BOX)


@pytest.mark.parametrize("name", ["+init=/etc/passwd:root", "+proj=utm +nadgrids=/etc/passwd"])
def test_a_reference_system_inside_a_shoreline(fenced: Path, name: str) -> None:
    named = '{"crs": {"type": "name", "properties": {"name": "' + name + '"}}, ' + SQUARE[1:]
    (fenced / "coast.json").write_text(named, encoding="utf-8")
    with pytest.raises(UserError, match=OUT):
        shore.read_land(str(fenced / "coast.json"), BOX)


def test_a_store_whose_folders_are_links(fenced: Path) -> None:
    """A link to a folder of links: what these lead to would be read."""
    store, inner = fenced / "y.zarr", fenced / "inner"
    store.mkdir()
    inner.mkdir()
    (store / "zarr.json").write_text("{}", encoding="utf-8")
    (store / "u").symlink_to(inner)
    (inner / "0").symlink_to(fenced.parent / "secret" / "wind.txt")
    for opener in (
        lambda: dataset.open_one(str(store), "current"),
        lambda: digest.digest_of(str(store)),
    ):
        with pytest.raises(UserError, match=OUT):
            opener()


@pytest.mark.parametrize("key", ["proj4", "crs_wkt", "spatial_ref"])
def test_a_reference_system_inside_a_file(fenced: Path, key: str) -> None:
    """One that a netCDF file brings along is asked too."""
    data = xr.Dataset({"m": ((), 0, {key: f"+init={fenced.parent}/secret/wind.txt:x"})})
    data["u"] = (("y", "x"), np.zeros((2, 2)), {"grid_mapping": "m"})
    with pytest.raises(UserError, match=OUT):
        projection.crs_of(data, "u", {}, [])


@pytest.mark.parametrize(
    "crs", ["+init=/etc/passwd:root", "+proj=utm +nadgrids=/etc/passwd", "/etc/passwd", "c:\\x"]
)
def test_a_reference_system_that_names_a_file(fenced: Path, crs: str) -> None:
    with pytest.raises(UserError, match=OUT):
        fence.check_crs(crs)
    fence.check_crs("EPSG:32631")


@pytest.mark.parametrize("written", ["", "{", "[]", '{"folders": 3}', '{"folders": ["/"]}', "null"])
def test_a_fence_that_cannot_be_read_is_closed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, written: str
) -> None:
    monkeypatch.setenv(fence.NAME, written)
    with pytest.raises(UserError, match=OUT):
        fence.check(tmp_path)


def test_every_key_that_names_a_file_goes_through_the_fence() -> None:
    """No part of the engine that reads a case opens a path by itself: all names pass
    `sources.matching`.
    """
    others = (
        "sources.py",
        "bridge.py",
        "template.py",
    )  # the last two serve `drift bridge` and `drift new`, which are not served
    for path in (
        path for path in (ROOT / "drift" / "case").rglob("*.py") if path.name not in others
    ):
        text = path.read_text(encoding="utf-8")
        assert not re.search(r"glob\.glob|expanduser|\bopen\(|read_bytes\(|os\.environ", text), path


KEYS = {  # every key of a case that names a file, in a shipped case that has its table
    "current.0.files": "norkyst_raft", "wind.0.files": "norkyst_raft", "coast.source": "overdue_boat", "coast.lakes": "overdue_boat",
    "depth.file": "overdue_boat", "sortie.0.actual": "overdue_boat", "sortie.0.track": "overdue_boat", "sortie.0.marker.track": "overdue_boat",
    "scenario.0.phase.0.lanes.network": "medsearch_transit", "spill.stretches.file": "gulf_containers",
}  # fmt: skip

ALONGSIDE = {
    "sortie.0.track": {"sortie.0.pattern": None},
    "sortie.0.marker.track": {"sortie.0.frame": "datum"},
}


def _changed(place: Path, key: str, written: str) -> None:
    if key.startswith("sortie"):
        drift.vary(drift.load(place), {key: written, **ALONGSIDE.get(key, {})})
    else:
        drift.load(place, {key: f'"{written}"'})


@pytest.mark.parametrize("key", KEYS)
@pytest.mark.parametrize("written", ["/etc/passwd", "../etc/../../etc/passwd", "/no/such/file"])
def test_every_key_that_names_a_file(
    fenced: Path, monkeypatch: pytest.MonkeyPatch, key: str, written: str
) -> None:
    """It is refused, whether the file is there or not."""
    name = KEYS[key]
    shutil.copytree(ROOT / "cases", fenced / "cases")
    monkeypatch.setenv("DRIFT_DATA", str(fenced))
    place = fenced / "cases" / f"{name}.toml"
    with pytest.raises(UserError, match=OUT) as refused:
        _changed(place, key, written)
    assert any(written in line and re.search(OUT, line) for line in refused.value.lines)
