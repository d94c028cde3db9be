"""What many cases may share of their waters, and what not: sources, coasts and boxes, against cases
that have their own.
"""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely
import small_case
import xarray as xr

import drift
from drift.engine.environment.environment_spec import Coast
from drift.engine.environment.forcing_spec import ForcingSpec, Slices
from drift.pipeline import run_setup, shared_forcing
from drift.pipeline.shared_forcing import Files, SharedRegion
from geo.box import Box
from geo.coast import edges, shore
from geo.errors import UserError
from geo.forcing.reading import memory

SPEC = ForcingSpec("sea", "current", dataset="roms", units="m/s")


def held() -> dict[str, memory.NamedDataset]:
    """Return a data set whose components have no units, at two depths."""
    data = small_case.field()
    for name in data.data_vars:
        del data[name].attrs["units"]
    deep = xr.concat(
        [data, 0.5 * data],
        xr.DataArray([1.0, 40.0], dims="depth", name="depth", attrs={"units": "m"}),
        join="outer",
    )
    return memory.wrap_datasets({"roms": deep.transpose("time", "depth", "lat", "lon")})


@pytest.mark.parametrize(
    ("change", "factor"),
    [
        ({"units": "kn"}, 1852 / 3600), ({"units": "cm/s"}, 0.01), ({"depth": 40.0}, 0.5), ({"steady": True}, 1.0), ({"plausible": True}, 1.0),
        ({"variables": {"depth": "1"}}, 0.5), ({"variables": {"east": "vo", "north": "uo"}}, 1.0), ({"timeout": 7.0}, 1.0),
        ({"times": Slices(np.datetime64("2026-11-20T20:00:00", "s"), np.timedelta64(1800, "s"))}, 1.0),
    ],
)  # fmt: skip
def test_sources_that_are_read_in_another_way_are_others(
    change: dict[str, object], factor: float
) -> None:
    """One data set, two readings: each is what it is alone, in either order."""
    other = replace(SPEC, **change)  # type: ignore[arg-type]
    for pair in ((SPEC, other), (other, SPEC)):
        files = Files(held())
        opened = [files.open(one) for one in pair]
        assert opened[0] is not opened[1]
        box = Box(-89.0, 26.0, -87.0, 28.0)
        for one, own in zip(pair, opened, strict=True):
            read = shared_forcing.sources.part_of_source(
                shared_forcing.sources.keep(own, box), box
            ).read(0)
            assert np.abs(read).max() == pytest.approx(
                0.3 * (factor if one is other else 1.0), rel=1e-5
            )


def test_sources_that_differ_in_name_or_in_what_is_made_of_them_are_one() -> None:
    files = Files(held())
    first = files.open(SPEC)
    for change in ({"name": "other"}, {"fill": 9}, {"add": True}):
        assert files.open(replace(SPEC, **change)) is first  # type: ignore[arg-type]


def test_what_cannot_be_opened_is_refused_each_time_in_the_same_words() -> None:
    files = Files(held())
    told = []
    for name in ("sea", "sea", "other"):
        with pytest.raises(UserError) as refused:
            files.open(replace(SPEC, name=name, units="stone"))
        told.append(refused.value.lines)
    assert told[0] == told[1] == told[2]


def case(tmp_path: Path, lon: float = -88.0, lat: float = 27.5, hours: float = 6.0) -> drift.Case:
    text = small_case.STEADY.replace("27 30N 088 00W", f"{lat} {lon}").replace(
        '"6 h"', f'"{hours} h"'
    )
    text = text.replace(f'at = "{lat} {lon}"', f"at = [{lon}, {lat}]")
    (tmp_path / "case.toml").write_text(text, encoding="utf-8")
    return drift.load(tmp_path / "case.toml")


def island(path: Path) -> str:
    turn = np.linspace(0, 2 * np.pi, 40, endpoint=False)
    ring = np.stack([-87.6 + 0.13 * np.cos(turn), 27.8 + 0.08 * np.sin(turn)], axis=1).tolist()
    path.write_text(
        json.dumps({"type": "Polygon", "coordinates": [[*ring, ring[0]]]}), encoding="utf-8"
    )
    return str(path)


def test_a_coast_is_shared_only_where_it_would_be_the_same(tmp_path: Path) -> None:
    """Not of cells coarser than those that a case has alone, nor where box or prior reach beyond
    it.
    """
    spec, asked = (
        run_setup.ensemble_spec(case(tmp_path)),
        run_setup.environment_spec(case(tmp_path)),
    )
    asked = replace(asked, coast=Coast(island(tmp_path / "land.json"), "strand"))
    box = Box(-89.3, 26.7, -86.9, 28.6)
    near, wide = (
        SharedRegion(one, Files({}))
        for one in (Box(-90.0, 26.0, -86.0, 29.0), Box(-121.0, 3.0, -55.0, 51.0))
    )
    assert (
        edges.build_coast(shore.read_land(asked.coast.source, wide.box, False), wide.box).shift
        > edges.FINEST
    )
    coast = near.coast(spec, asked, box)[1]
    assert coast is not None
    assert coast.shift == edges.FINEST
    assert near.coast(spec, asked, box)[1] is coast  # made once
    alone = edges.build_coast(shore.read_land(asked.coast.source, box, False), box)
    here = np.random.default_rng(3).uniform([[-87.9], [27.5]], [[-87.3], [28.1]], (2, 400))
    at = [np.round(v * 2**32 / 360).astype(np.int64) for v in here]
    own, other = (edges.is_land(one, *at) for one in (coast, alone))
    np.testing.assert_array_equal(own, other)
    exact = shapely.contains_xy(shapely.from_geojson((tmp_path / "land.json").read_text()), *here)
    assert (own == exact).mean() > 0.99  # but for who stands on the line
    # the last one's east is crossed by the prior
    beyond = Box(-89.3, 26.7, -84.0, 28.6), Box(-89.3, 26.7, -88.0, 28.6)
    for region, one in ((wide, box), (near, beyond[0]), (near, beyond[1])):
        land, own = region.coast(spec, asked, one)
        assert own is not coast
        assert land.box == shore.read_land(asked.coast.source, one, False).box
        assert (own is None) == (land.polygons.size == 0)
        assert own is None or own.shift == edges.build_coast(land, one).shift
        assert region.coast(spec, asked, one)[1] is own  # made once
        assert region.shore(own) is None  # of another region
    assert wide._lands == {}  # the land of an ocean is not even read


def test_no_land_is_shared_too(tmp_path: Path) -> None:
    """However wide the waters are: no coast has no cells."""
    spec, asked = (
        run_setup.ensemble_spec(case(tmp_path)),
        run_setup.environment_spec(case(tmp_path)),
    )
    found = SharedRegion(Box(-121.0, 3.0, -55.0, 51.0), Files({})).coast(
        spec, asked, Box(-89.3, 26.7, -86.9, 28.6)
    )
    assert found[1] is None


@pytest.mark.parametrize("seed", range(20))
def test_the_smallest_box_about_two(seed: int) -> None:
    """Of all turns of the second that with the least width; both are within it, and neither in what
    is a little less.
    """
    random = np.random.default_rng(seed)
    pair = []
    for _ in range(2):
        west, south = random.uniform(-180, 180), random.uniform(-70, 60)
        pair.append(Box(west, south, west + random.uniform(1, 60), south + random.uniform(1, 9)))
    a, b = pair
    joined = shared_forcing._smallest_common_box(a, b)
    widths = [max(a.east, b.east + turn) - min(a.west, b.west + turn) for turn in (-360, 0, 360)]
    assert -180 <= joined.west < 180
    assert joined.south == min(a.south, b.south)
    assert joined.north == max(a.north, b.north)
    middle = [box.west + box.east for box in pair]
    turn = min((-360, 0, 360), key=lambda turn: abs(middle[1] + 2 * turn - middle[0]))
    assert joined.east - joined.west == pytest.approx(widths[(-360, 0, 360).index(turn)])
    # what rounding leaves
    joined = replace(joined, west=joined.west - 1e-9, east=joined.east + 1e-9)
    for one in pair:
        assert shared_forcing.lies_inside(one, joined)
        for side, change in (("west", 0.5), ("east", -0.5), ("south", 0.5), ("north", -0.5)):
            less = replace(joined, **{side: getattr(joined, side) + change})
            edge = getattr(one, side)
            apart = (
                (edge - getattr(joined, side) + 180) % 360 - 180
                if side in ("west", "east")
                else edge - getattr(joined, side)
            )
            assert shared_forcing.lies_inside(one, less) == (abs(apart) > 0.5)


def test_near_cases_share_their_waters_and_far_ones_do_not(tmp_path: Path) -> None:
    places = [
        (-88.0, 27.5),
        (-87.1, 28.2),
        (179.3, -41.0),
        (-88.4, 26.9),
        (-179.2, -40.2),
        (-60.0, 4.4),
    ]
    found = shared_forcing.share_regions([case(tmp_path, *place) for place in places], {})
    numbers = [next(k for k, one in enumerate(found) if one is own) for own in found]
    assert numbers == [0, 0, 2, 0, 2, 5]
    assert found[2].box.east > 180


def test_parts_that_were_asked_for_last_are_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of three places two are kept: a part is cut once, as long as no two others are asked for
    after it.
    """
    made: list[Box] = []
    cut = shared_forcing.sources.part_of_source
    monkeypatch.setattr(shared_forcing, "CUTS", 2)
    monkeypatch.setattr(
        shared_forcing.sources,
        "part_of_source",
        lambda source, box: (made.append(box), cut(source, box))[1],
    )
    shared = SharedRegion(Box(-90.0, 26.0, -86.0, 29.0), Files(held()))
    a, b, c = (Box(-89.0 + k, 26.2 + 0.3 * k, -88.2 + k, 27.1 + 0.3 * k) for k in range(3))
    for box in (a, b, a, c, a, b):
        part = shared.source(replace(SPEC, name="mine"), box)
        assert part.name == "mine"
        alone = cut(shared_forcing.sources.keep(Files(held()).open(SPEC), shared.box), box)
        assert part.grid == alone.grid
        np.testing.assert_array_equal(part.read(3), alone.read(3))
    assert made == [a, b, c, b]
