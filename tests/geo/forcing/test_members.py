"""Ensembles in files: members along a dimension or by file, held against the values that were
written; and refusals.
"""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

from geo.array import Array
from geo.box import Box
from geo.errors import UserError
from geo.forcing import describe, sources
from geo.forcing.reading import memory

LON, LAT = np.linspace(4.0, 6.0, 9), np.linspace(59.0, 61.0, 11)
HOURS = np.arange(0, 10, 3)
RNG = np.random.default_rng(4)
# members, components, ...
VALUES = RNG.normal(0, 0.3, (5, 2, HOURS.size, LAT.size, LON.size)).astype(np.float32)
NAMES = (("uo", "eastward_sea_water_velocity"), ("vo", "northward_sea_water_velocity"))


def dataset(
    values: Array, dims: tuple[str, ...], hours: Array = HOURS, lon: Array = LON, **more: Any
) -> xr.Dataset:
    """Return a file of currents; values: (2, ...) over dims."""
    coords = {
        "time": ("time", hours, {"units": "hours since 2026-01-01"}),
        "lat": ("lat", LAT, {"units": "degrees_north"}),
        "lon": ("lon", lon, {"units": "degrees_east"}),
        **more,
    }
    fields = {
        name: (dims, own, {"units": "m s-1", "standard_name": standard})
        for (name, standard), own in zip(NAMES, values, strict=True)
    }
    return xr.Dataset(fields, coords={k: v for k, v in coords.items() if k in dims or k in more})


def together(dim: str = "number", values: Array = VALUES, **more: Any) -> xr.Dataset:
    """Return a dataset with a dimension of members."""
    return dataset(values.swapaxes(0, 1), (dim, "time", "lat", "lon"), **more)


def apart(folder: Path, values: Array = VALUES) -> list[list[str]]:
    """Write a file for each member; return the files of each."""
    paths = [folder / f"run_{k}.nc" for k in range(len(values))]
    for path, own in zip(paths, values, strict=True):
        dataset(own, ("time", "lat", "lon")).to_netcdf(path)
    return [[str(path)] for path in paths]


def held(source: sources.Source, values: Array = VALUES) -> None:
    """Hold every slice of every member against the values, which are on a regular grid already."""
    assert len(source.members) == len(values)
    for member, own in zip(source.members, values, strict=True):
        for i in range(len(source.times)):
            np.testing.assert_array_equal(member.read(i), np.moveaxis(own[:, i], 0, -1))


@pytest.mark.parametrize(
    "dim", ["number", "realization", "member", "ensemble", "ens", "ensemble_member"]
)
def test_members_along_a_dimension(tmp_path: Path, dim: str) -> None:
    together(dim).to_netcdf(tmp_path / "a.nc")
    source = sources.open_source("current", tmp_path / "a.nc", members=True)
    held(source)
    assert [member.label for member in source.members] == list("01234")
    assert any(f"5 members of an ensemble along {dim}" in note for note in source.notes)


def test_a_dimension_is_known_by_its_standard_name_or_by_the_case(tmp_path: Path) -> None:
    numbers = np.array([1, 2, 3, 7, 9])
    together("e", e=("e", numbers, {"standard_name": "realization"})).to_netcdf(tmp_path / "a.nc")
    source = sources.open_source("current", tmp_path / "a.nc", members=True)
    held(source)
    assert [member.label for member in source.members] == ["1", "2", "3", "7", "9"]
    together("draw").to_netcdf(tmp_path / "b.nc")
    held(sources.open_source("current", tmp_path / "b.nc", members="draw"))
    with pytest.raises(UserError, match=r"there are no members.*draw = 5.*members = \"\.\.\.\""):
        sources.open_source("current", tmp_path / "b.nc", members=True)
    with pytest.raises(UserError, match=r'has "drew".*draw = 5'):
        sources.open_source("current", tmp_path / "b.nc", members="drew")


def test_files_of_members_along_a_dimension_are_joined_in_time(tmp_path: Path) -> None:
    for k, part in enumerate((slice(0, 2), slice(2, 4))):
        dataset(
            VALUES[..., part, :, :].swapaxes(0, 1), ("number", "time", "lat", "lon"), HOURS[part]
        ).to_netcdf(tmp_path / f"{k}.nc")
    paths = [str(tmp_path / f"{k}.nc") for k in range(2)]
    held(sources.open_source("current", paths, members=True, entries=[[path] for path in paths]))


def test_members_by_file(tmp_path: Path) -> None:
    entries = apart(tmp_path)
    source = sources.open_source(
        "current", [path for (path,) in entries], members=True, entries=entries
    )
    held(source)
    assert [member.label for member in source.members] == [f"run_{k}" for k in range(5)]


def test_a_dataset_in_memory_may_have_members() -> None:
    held(sources.open_source("current", memory.NamedDataset("roms", together()), members=True))


def test_a_part_of_shared_files_has_their_members(tmp_path: Path) -> None:
    together().to_netcdf(tmp_path / "a.nc")
    opened = sources.open_shared("current", tmp_path / "a.nc", members=True)
    box = Box(4.4, 59.4, 5.6, 60.6)
    part, alone = (
        sources.part_of_source(sources.keep(opened, box), box),
        sources.open_source("current", tmp_path / "a.nc", members=True, box=box),
    )
    assert part.grid == alone.grid
    for one, other in zip(part.members, alone.members, strict=True):
        np.testing.assert_array_equal(one.read(2), other.read(2))


def test_members_have_the_times_that_all_have(tmp_path: Path) -> None:
    """Runs that begin at different hours."""
    entries = []
    for k in range(3):
        dataset(VALUES[k], ("time", "lat", "lon"), HOURS + 3 * k).to_netcdf(tmp_path / f"{k}.nc")
        entries.append([str(tmp_path / f"{k}.nc")])
    source = sources.open_source(
        "current", [path for (path,) in entries], members=True, entries=entries
    )
    assert (
        source.times.tolist()
        == (
            np.datetime64("2026-01-01", "s") + np.array([6, 9]) * np.timedelta64(3600, "s")
        ).tolist()
    )
    for k, member in enumerate(source.members):
        for i in range(2):
            np.testing.assert_array_equal(
                member.read(i), np.moveaxis(VALUES[k][:, 2 - k + i], 0, -1)
            )
    dataset(VALUES[0], ("time", "lat", "lon"), HOURS + 9).to_netcdf(tmp_path / "late.nc")
    entries[2] = [str(tmp_path / "late.nc")]
    with pytest.raises(UserError, match=r"have 1 time in common; must have two at least"):
        sources.open_source("current", [path for (path,) in entries], members=True, entries=entries)


def test_steady_members(tmp_path: Path) -> None:
    entries = []
    for k in range(2):
        dataset(VALUES[k][:, 0], ("lat", "lon")).to_netcdf(tmp_path / f"{k}.nc")
        entries.append([str(tmp_path / f"{k}.nc")])
    source = sources.open_source(
        "current", [p for (p,) in entries], members=True, entries=entries, steady=True
    )
    for k, member in enumerate(source.members):
        np.testing.assert_array_equal(member.read(0), np.moveaxis(VALUES[k][:, 0], 0, -1))


def test_members_on_a_curved_grid_share_its_weights(tmp_path: Path) -> None:
    """Each is what it is alone, to the bit."""
    x, y = np.meshgrid(np.arange(12) * 0.1, np.arange(10) * 0.1)
    lon, lat = 5 + x * 0.9 + y * 0.3, 60 - 0.2 * x + 0.8 * y
    values = RNG.normal(0, 0.3, (3, 2, 2, *lon.shape)).astype(np.float32)
    entries = []
    for k in range(3):
        data = xr.Dataset(
            {
                name: (("time", "y", "x"), values[k, side], {"units": "m s-1", "standard_name": standard})
                for side, (name, standard) in enumerate(NAMES)
            },
            coords={
                "time": ("time", [0, 3], {"units": "hours since 2026-01-01"}),
                "lon": (("y", "x"), lon), "lat": (("y", "x"), lat),
            },
        )  # fmt: skip
        data.to_netcdf(tmp_path / f"{k}.nc")
        entries.append([str(tmp_path / f"{k}.nc")])
    source = sources.open_source(
        "current", [path for (path,) in entries], members=True, entries=entries
    )
    for (path,), member in zip(entries, source.members, strict=True):
        np.testing.assert_array_equal(member.read(1), sources.open_source("current", path).read(1))


def test_a_member_that_lacks_something_is_one_line(tmp_path: Path) -> None:
    """What is missing, in which member and file, and what is allowed."""
    written = apart(tmp_path)
    data = dataset(VALUES[2], ("time", "lat", "lon"))

    def refusal(changed: xr.Dataset, number: int) -> str:
        changed.to_netcdf(tmp_path / f"wrong_{number}.nc")
        entries = [*written[:2], [str(tmp_path / f"wrong_{number}.nc")], *written[3:]]
        with pytest.raises(UserError) as refused:
            sources.open_source(
                "current", [path for (path,) in entries], members=True, entries=entries
            )
        assert len(refused.value.lines) == 1
        return str(refused.value)

    wrong = (
        (data.drop_vars("vo"), "the northward one is missing"),
        (data.drop_vars(["uo", "vo"]), "no current"),
        (dataset(VALUES[2], ("time", "lat", "lon"), lon=LON + 0.01), "must have one grid"),
        (dataset(np.full_like(VALUES[2], np.nan), ("time", "lat", "lon")), "no value"),
    )
    for number, (changed, why) in enumerate(wrong):
        told = refusal(changed, number)
        assert f"member 3 of 5 (wrong_{number})" in told
        assert why in told
    paths, entries = [path for (path,) in written], written
    with pytest.raises(
        UserError, match=r"there are no members.*several files; name a file for each member"
    ):
        sources.open_source("current", paths[0], members=True, entries=entries[:1])


def test_a_member_without_values_along_a_dimension_is_one_line(tmp_path: Path) -> None:
    values = VALUES.copy()
    values[3, 1] = np.nan
    together(values=values).to_netcdf(tmp_path / "a.nc")
    with pytest.raises(
        UserError, match=r'member 4 of 5 \(number = 3\) holds no value of "vo".*must have both'
    ) as refused:
        sources.open_source("current", tmp_path / "a.nc", members=True)
    assert len(refused.value.lines) == 1
    half = together()
    half["vo"] = half["vo"].isel(number=slice(0, 4)).rename(number="ens")
    half.to_netcdf(tmp_path / "b.nc")
    with pytest.raises(
        UserError,
        match=r"uo has 5 along number and vo has 4 along ens; both components must have the same",
    ):
        sources.open_source("current", tmp_path / "b.nc", members=True)


def test_members_along_two_dimensions_are_not_paired(tmp_path: Path) -> None:
    """As many as there are of each: nothing says which of them go together."""
    data = together()
    data["vo"] = data["vo"].rename(number="ens")
    data.to_netcdf(tmp_path / "a.nc")
    with pytest.raises(UserError, match=r"uo has 5 along number and vo has 5 along ens"):
        sources.open_source("current", tmp_path / "a.nc", members=True)


def test_points_of_members_may_differ_by_what_rounding_leaves(tmp_path: Path) -> None:
    entries = []
    for k in range(3):
        dataset(VALUES[k], ("time", "lat", "lon"), lon=LON + 2e-6 * k).to_netcdf(
            tmp_path / f"{k}.nc"
        )
        entries.append([str(tmp_path / f"{k}.nc")])
    source = sources.open_source(
        "current", [path for (path,) in entries], members=True, entries=entries
    )
    held(source, VALUES[:3])


@pytest.mark.parametrize(
    "gone",
    [slice(0, 1), slice(0, 3), slice(1, 4)],
    ids=["first", "all but the last", "all but the first"],
)
def test_a_member_that_has_values_at_one_end_is_taken(tmp_path: Path, gone: slice) -> None:
    """A run that begins later than the others, or ends sooner, has missing values there."""
    values = VALUES.copy()
    values[3, 1, gone] = np.nan
    together(values=values).to_netcdf(tmp_path / "a.nc")
    values[3, 0, gone] = np.nan  # a current of one component is none
    held(sources.open_source("current", tmp_path / "a.nc", members=True), values)


def test_members_have_land(tmp_path: Path) -> None:
    """A little of a slice is enough: most of it may be missing."""
    values = VALUES.copy()
    values[..., 2:, :] = np.nan
    together(values=values).to_netcdf(tmp_path / "a.nc")
    held(sources.open_source("current", tmp_path / "a.nc", members=True), values)


def test_members_must_be_asked_for(tmp_path: Path) -> None:
    together().to_netcdf(tmp_path / "a.nc")
    with pytest.raises(
        UserError, match=r"variables\.number to an index, or members = true to drift in each"
    ):
        sources.open_source("current", tmp_path / "a.nc")
    one = sources.open_source("current", tmp_path / "a.nc", variables={"number": 3})
    assert one.members == (one,)
    np.testing.assert_array_equal(one.read(1), np.moveaxis(VALUES[3][:, 1], 0, -1))


def test_info_tells_of_members(tmp_path: Path) -> None:
    together().to_netcdf(tmp_path / "a.nc")
    (source,) = describe.open_quantities(str(tmp_path / "a.nc"))
    assert any(
        "5 members of an ensemble along number: 0, 1, 2, ..., 4; members = true" in n
        for n in source.notes
    )


def test_the_fingerprint_tells_members_from_one(tmp_path: Path) -> None:
    together().to_netcdf(tmp_path / "a.nc")
    one = sources.open_source("current", tmp_path / "a.nc", variables={"number": 0})
    every = sources.open_source("current", tmp_path / "a.nc", members=True)
    assert one.fingerprint != every.fingerprint
