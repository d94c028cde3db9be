"""A result in Python and in a notebook, against the files of the same run as other libraries read
them.
"""

import dataclasses
import json
import re
from base64 import b64decode
from io import BytesIO
from pathlib import Path

import matplotlib.image
import numpy as np
import pandas as pd
import pint
import pytest
import shapely
import xarray as xr
from pyproj import Geod

import drift
from drift.pipeline.result import _parse_csv
from geo import sphere

CASE = """
title = "A <b>raft</b> east of Fiji"
start = "160600ZNOV15"
duration = "9 h"
particles = 3000
seed = 3
[output]
every = "3 h"
[[current]]
constant = { speed = "0.8 kn", toward = 75 }
[[wind]]
constant = { speed = "12 kn", from = 250 }
[uncertainty]
current = { std = "0.2 m/s", time = "5 h" }
wind = { std = "1.5 m/s", time = "6 h" }
[[scenario]]
name = "raft"
object = "LIFE-RAFT-DB-11"
search_object = "Raft 4 person"
position = { at = [179.93, -19.2], error = "3 nmi" }
[[contact]]
name = "strobe"
time = "161100ZNOV15"
position = { at = [179.98, -19.22], error = "6 nmi" }
"""


@pytest.fixture(scope="module")
def ran(tmp_path_factory: pytest.TempPathFactory) -> tuple[drift.Result, Path]:
    folder = tmp_path_factory.mktemp("result")
    (folder / "case.toml").write_text(CASE, encoding="utf-8")
    return drift.run(drift.load(folder / "case.toml")).save(folder / "results"), folder / "results"


@pytest.mark.thorough
def test_tables_are_those_of_the_files(ran: tuple[drift.Result, Path]) -> None:
    result, folder = ran
    assert set(result.tables) == {"track", "ashore", "sorties", "posteriors"} & {
        path.stem for path in folder.glob("*.csv")
    }
    for name, table in result.tables.items():
        written = pd.read_csv(folder / f"{name}.csv")
        assert list(table.columns) == list(written.columns)
        numbers = written.select_dtypes("number").columns
        pd.testing.assert_frame_equal(table[numbers], written[numbers])
    times = result.tables["track"]["time"]
    assert (times.to_numpy() == xr.open_dataset(folder / "forecast.nc")["time"].values).all()


@pytest.mark.thorough
def test_times_of_all_join(ran: tuple[drift.Result, Path]) -> None:
    """Tables, areas, particles and maps have times of one kind: UTC as xarray has it."""
    result, _ = ran
    maps = result.probability.indexes["time"]
    assert {
        table["time"].dtype for table in [*result.tables.values(), result.areas] if "time" in table
    } == {maps.dtype}
    areas, track = result.areas, result.tables["track"].set_index("time")
    assert len(areas.join(track, on="time", how="inner")) == len(areas) > 0
    assert track.index.equals(maps)
    assert result.probability.sel(time=areas["time"].iloc[-1]).equals(result.probability[-1])
    assert (
        track["area_95_nmi2"].to_xarray().broadcast_like(result.particles["weight"]).notnull().all()
    )
    first = result.tables["ashore"]["first_time"]
    assert first.dtype == maps.dtype


def test_columns_of_times_are_times_whatever_they_are_called() -> None:
    """Those of washup.csv and lines.csv are named by shares; words stay words, and nothing at all
    stays empty.
    """
    frame = _parse_csv("first_50,time,value\n2026-01-02T03:04:05Z,,2026-01-02T03:04:05Z\n,,word\n")
    assert list(map(str, frame.dtypes)) == [
        "datetime64[ns]",
        "datetime64[ns]",
        str(frame["value"].dtype),
    ]
    assert frame["first_50"][0] == pd.Timestamp("2026-01-02T03:04:05")
    assert frame["value"][1] == "word"
    assert frame.isna().sum().tolist() == [1, 2, 0]


@pytest.mark.thorough
def test_particles_are_those_of_the_file(ran: tuple[drift.Result, Path]) -> None:
    result, folder = ran
    # the Earth, a number of no meaning by itself
    written = xr.open_dataset(folder / "particles.nc").drop_vars("crs")
    xr.testing.assert_allclose(result.particles.drop_attrs(), written.drop_attrs())
    result.particles.to_netcdf(folder.parent / "tracks.nc")  # no particle has ended: times are NaT
    again = xr.open_dataset(folder.parent / "tracks.nc")
    assert again["time_ended"].isnull().all()
    xr.testing.assert_allclose(again.drop_attrs(), result.particles.drop_attrs())
    frame = result.particles.to_dataframe().reset_index()
    assert len(frame) == result.particles.sizes["trajectory"] * result.particles.sizes["time"]


def test_areas_are_shapes_of_their_size(ran: tuple[drift.Result, Path]) -> None:
    """By geodesics on the sphere; a polygon's chords and the cells that an outline cuts leave a few
    percent.
    """
    areas = ran[0].areas
    assert areas.crs.to_epsg() == 4326
    geod = Geod(a=sphere.RADIUS, b=sphere.RADIUS)
    for row in areas.itertuples():
        area = sum(
            abs(geod.geometry_area_perimeter(part)[0]) for part in shapely.get_parts(row.geometry)
        )
        assert area / 1852**2 == pytest.approx(row.area_nmi2, rel=0.03)
    assert areas.geometry.total_bounds[0] < 180 < areas.geometry.total_bounds[2]  # no jump


@pytest.mark.thorough
def test_the_map_is_map_png(ran: tuple[drift.Result, Path]) -> None:
    """Pixel for pixel but for the transparency, and another output time is another map."""
    result, folder = ran
    drawn = BytesIO()
    figure = result.plot()
    figure.savefig(drawn, format="png", dpi=140)
    same = matplotlib.image.imread(folder / "map.png")
    whole = matplotlib.image.imread(BytesIO(drawn.getvalue()))
    np.testing.assert_array_equal(whole[..., :3], same)
    assert np.all(whole[..., 3] == 1)
    early = BytesIO()
    result.plot("2015-11-16T09:00:00Z").savefig(early, format="png", dpi=140)
    assert early.getvalue() != drawn.getvalue()
    with pytest.raises(
        drift.UserError,
        match="is not an output time of this run; it has 5, the first and last are 2015-11-16T06:00:00Z, 2015-11-16T15",
    ):
        result.plot("2015-11-16T10:00:00Z")
    with pytest.raises(drift.UserError, match="is not an output time"):
        result.plot("tomorrow")


def test_reprs_are_a_few_lines_that_tell_what_it_is(ran: tuple[drift.Result, Path]) -> None:
    """Of every public record that holds arrays; the result's figures are those of its tables."""
    result = ran[0]
    brief = next(drift.run_many([result.case]))
    told = {
        "case": repr(result.case), "result": repr(result), "brief": repr(brief),
    }  # fmt: skip
    for text in told.values():
        assert len(text) < 700
        assert text.count("\n") < 10
        assert result.case.title in text
    assert told["case"].splitlines()[1:] == [
        "  2015-11-16T06:00:00Z to 2015-11-16T15:00:00Z, 5 outputs, 3,000 particles, seed 3",
        "  1 scenario: raft; 1 contact>",
    ]
    track = result.tables["track"].iloc[-1]
    assert f"50 % area: {track['area_50_nmi2']:,.0f} nmi²" in told["result"]
    assert track["mean_position"] in told["result"]
    assert told["brief"].endswith(f": {len(brief.times)} outputs, 3,000 particles>")


def test_a_notebook_shows_it(ran: tuple[drift.Result, Path]) -> None:
    """Names from the case are text, and the picture is inside."""
    shown = ran[0]._repr_html_()
    assert "A &lt;b&gt;raft&lt;/b&gt; east of Fiji" in shown
    assert "<b>" not in shown
    picture = b64decode(re.search(r"data:image/png;base64,([^']+)", shown)[1])
    assert matplotlib.image.imread(BytesIO(picture)).shape[1] > 800
    mean = ran[0].tables["track"]["mean_position"].iloc[-1]
    assert mean in shown


@pytest.mark.thorough
def test_a_result_is_saved_as_the_run_would_have_written_it(
    ran: tuple[drift.Result, Path], tmp_path: Path
) -> None:
    """The same files, the same bytes in tables, the same keys in the same order."""
    result, folder = ran
    drift.run(result.case, tmp_path / "now")
    assert [path.name for path in drift.results(tmp_path / "now")] == [
        path.name for path in drift.results(folder)
    ]
    for path in folder.glob("*.csv"):
        assert (tmp_path / "now" / path.name).read_bytes() == path.read_bytes()
    names = [
        list(json.loads((at / "summary.json").read_text(encoding="utf-8")))
        for at in (folder, tmp_path / "now")
    ]
    assert names[0] == names[1]


def test_a_folder_of_results_is_replaced_only_if_asked(
    ran: tuple[drift.Result, Path], tmp_path: Path
) -> None:
    result, folder = ran
    assert len(drift.results(folder)) > 10
    with pytest.raises(drift.UserError, match=r"overwrite = True"):
        result.save(folder)
    with pytest.raises(drift.UserError, match="part of a plan"):
        dataclasses.replace(result, saved=None).save(tmp_path / "plan")


def test_maps_are_one_netcdf_file(ran: tuple[drift.Result, Path], tmp_path: Path) -> None:
    result, folder = ran
    for _ in range(2):  # the second takes the place of the first, as xarray's
        result.to_netcdf(tmp_path / "maps.nc")
    with (
        xr.open_dataset(tmp_path / "maps.nc") as own,
        xr.open_dataset(folder / "forecast.nc") as written,
    ):
        xr.testing.assert_equal(own, written)
        assert {name for name in written.attrs if written.attrs[name] != own.attrs[name]} <= {
            "history",
            "date_created",
        }
    with pytest.raises(drift.UserError, match="cannot be written"):
        result.to_netcdf(tmp_path / "missing" / "maps.nc")


def test_tables_have_units_of_their_numbers(ran: tuple[drift.Result, Path]) -> None:
    """As pint reads them; all but numbers of rows, and those of posteriors, whose unit is a column."""
    result, _ = ran
    ureg = pint.UnitRegistry()
    ureg.define("degrees_east = degree")
    ureg.define("degrees_north = degree")
    for name, table in result.tables.items():
        units = table.attrs["units"]
        assert all(ureg.Unit(unit if unit != "1" else "") is not None for unit in units.values())
        bare = set(table.dropna(axis=1, how="all").select_dtypes("number").columns) - set(units)
        assert not {
            column
            for column in bare
            if not re.fullmatch(r"update|rank|mean|std|q\d\d|value", column)
        }, name
    assert result.tables["track"].attrs["units"]["area_95_nmi2"] == "nmi**2"
    assert result.tables["track"].attrs["units"]["mean_lon"] == "degrees_east"
