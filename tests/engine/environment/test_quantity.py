"""A quantity of forcing is one entry: two made-up ones, the drift of ice and the concentration of
ice, go from a case's text to tiles on the device.

Neither has a term in kernels.step.velocity, so nothing moves with them. The concentration is a
number, and recorded along the tracks.
"""

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from pydantic import Field, create_model
from small_case import STEADY, field

import drift
from drift.apps.cli import grammar
from drift.assess.verify import along
from drift.case import file as case_file
from drift.case.forcing.sources import ScalarTable, SourceTable
from drift.case.scenario.scenario import ScenarioTable
from drift.case.schema import CaseTable
from drift.engine.environment import domain
from drift.engine.motion.forcing import Forcing
from drift.pipeline import run_metadata, run_setup
from drift.tracking.tracks.records import Track
from geo import sphere
from geo.box import box_between
from geo.errors import UserError
from geo.forcing import describe, sources
from geo.forcing.quantity import QUANTITIES, Quantity, number_names, velocities
from kernels.step.features import FORCING

NAMES = ("eastward_sea_ice_velocity", "northward_sea_ice_velocity")
ICE = Quantity(
    spoken="drift of ice",
    key="floes",
    fastest=3.0,
    impossible=10.0,
    utmost=1.5,
    sigma=0.1,
    wanted="the ice's drift at the surface",
    fill=1,
    needed=False,
    standard_names=((*NAMES, "true"),),
)
COVER = Quantity(
    spoken="concentration of sea ice",
    key="covers",
    fastest=1.0,
    impossible=1.5,
    utmost=0.0,
    sigma=0.1,
    wanted="the share of the surface that ice covers",
    needed=False,
    standard_names=number_names("sea_ice_area_fraction"),
    usual_names=number_names("siconc", "aice"),
    scalar=True,
    unit="1",
)
SHARES = {"thin": 0.2, "dense": 0.6}
PACK = '[[ice]]\nname = "pack"\nconstant = { east = 0.2, north = -0.7 }\n'


@pytest.fixture(autouse=True)
def ice(monkeypatch: pytest.MonkeyPatch) -> None:
    """Add the quantities where CONTRIBUTING says that one is added; only a term in the kernel is
    missing.
    """
    monkeypatch.setitem(QUANTITIES, "ice", ICE)
    monkeypatch.setitem(QUANTITIES, "cover", COVER)
    names = (list[str] | None, None)
    story = create_model("ScenarioTable", __base__=ScenarioTable, floes=names, covers=names)
    many = Field(default_factory=list)
    table = create_model(
        "CaseTable",
        __base__=CaseTable,
        ice=(list[SourceTable], many),
        cover=(list[ScalarTable], many),
        scenario=(list[story], many),
    )
    monkeypatch.setattr(case_file, "CaseTable", table)


def case_of(folder: Path, sources: str, *changes: tuple[str, str]) -> drift.Case:
    text = STEADY.replace("[[wind]]", sources + "[[wind]]")
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path = folder / "case.toml"
    path.write_text(text, encoding="utf-8")
    return drift.load(path)


def test_a_case_has_it_and_a_scenario_names_its_sources(tmp_path: Path) -> None:
    case = case_of(tmp_path, PACK + PACK.replace("pack", "rival"))
    assert [(spec.name, spec.fill) for spec in case.forcing["ice"]] == [("pack", 1), ("rival", 1)]
    assert case.scenarios[0].sources["ice"] == ("pack", "rival")
    chosen = ('name = "boat"', 'name = "boat"\nfloes = ["rival"]')
    assert case_of(tmp_path, PACK + PACK.replace("pack", "rival"), chosen).scenarios[0].sources[
        "ice"
    ] == ("rival",)
    with pytest.raises(
        UserError, match=r'scenario "boat".floes: no source "rival"; there are: pack'
    ):
        case_of(tmp_path, PACK, chosen)
    with pytest.raises(
        UserError,
        match=r'ice "pack": constant: 30.01 m/s is too fast for a drift of ice; at most 3',
    ):
        case_of(tmp_path, PACK, ("east = 0.2", "east = 30.0"))
    flow = PACK.replace("constant = { east = 0.2, north = -0.7 }", 'analytic = "solid_rotation"')
    assert run_metadata.has_synthetic_forcing(case_of(tmp_path, flow))
    assert not run_metadata.has_synthetic_forcing(case)


def test_its_tiles_hold_what_its_sources_say(tmp_path: Path) -> None:
    case = case_of(tmp_path, PACK)
    sources = run_setup.open_for(case).scenarios[0]
    assert [source.name for source in sources.of("ice")] == ["pack"]
    forcing = Forcing([sources], 1)
    begin = int(case.start.astype("datetime64[s]").astype(int))
    forcing.set(begin, begin + 600)
    lon, lat = sphere.to_binary([-88.0]).astype(np.int32), sphere.to_binary([27.5]).astype(np.int32)
    sample = forcing.tiles.at(*forcing.ranges[0]["ice"], lon, lat, 0.0)
    forcing.close()
    np.testing.assert_array_equal(sample, np.array([[0.2, -0.7, 1]], np.float32))


def test_a_run_may_go_where_its_ice_takes_it(tmp_path: Path) -> None:
    def north(case: drift.Case) -> float:
        return domain.outermost_box(
            run_setup.ensemble_spec(case), run_setup.environment_spec(case)
        ).north

    more = north(case_of(tmp_path, PACK)) - north(case_of(tmp_path, ""))
    assert more == pytest.approx(math.degrees(ICE.utmost * 6 * 3600 / sphere.RADIUS), rel=1e-9)
    covered = case_of(tmp_path, "[[cover]]\nconstant = 0.4\n")
    assert north(covered) == north(case_of(tmp_path, ""))


@pytest.mark.parametrize("needed", [False, True])
def test_where_it_has_no_value_a_run_is_lost_only_if_it_is_needed(
    needed: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Ice five degrees east of all that drifts: a run without a term for it ends as one without
    ice, to the bit.
    """
    field(standard=NAMES, west=-83.0).to_netcdf(tmp_path / "ice.nc")
    monkeypatch.setitem(QUANTITIES, "ice", dataclasses.replace(ICE, needed=needed))
    wide = (
        "[[wind]]",
        "[domain]\nwest = -92.0\neast = -80.0\nsouth = 25.6\nnorth = 29.4\n[[wind]]",
    )
    case = case_of(tmp_path, '[[ice]]\nfiles = "ice.nc"\n', wide)
    if needed:
        with pytest.raises(
            UserError, match=r"\[\[ice\]\]: 100 % of the prior lies where there is no ice"
        ):
            drift.run(case)
        return
    icy, bare = (drift.run(one) for one in (case, case_of(tmp_path, "", wide)))
    np.testing.assert_array_equal(icy.trajectories.lon, bare.trajectories.lon)
    assert icy.forecast.probability.identical(bare.forecast.probability)


def test_a_file_of_it_is_understood(tmp_path: Path) -> None:
    field(standard=NAMES).to_netcdf(tmp_path / "ice.nc")
    assert [source.quantity for source in describe.open_quantities(str(tmp_path / "ice.nc"))] == [
        "ice"
    ]
    assert grammar.parser().parse_args(["info", "--as", "ice", "ice.nc"]).quantity == "ice"
    field(names=("a", "b"), standard=("x", "y")).to_netcdf(tmp_path / "other.nc")
    with pytest.raises(
        UserError,
        match="no current, wind, Stokes drift, drift of ice or concentration of sea ice found",
    ):
        describe.open_quantities(str(tmp_path / "other.nc"))


def test_drifters_are_compared_with_it(tmp_path: Path) -> None:
    """A drifter that goes with the current and the ice, east at 0.5 kn and 0.2 m/s, goes no way of
    its own.
    """
    chosen = ('name = "boat"', 'name = "boat"\nfloes = ["pack"]')
    case = case_of(tmp_path, PACK + PACK.replace("pack", "rival"), chosen)
    time = case.start.astype("datetime64[s]").astype(float) + 3600.0 * np.arange(4)
    track = Track("buoy", time, np.full(4, -88.0), np.full(4, 27.5), {})
    assert along.case_over_tracks(case, [track]).scenarios[0].sources["ice"] == ("pack",)
    (way,) = along.compare_displacements(case, [track], {}, 3 * 3600.0, 3.0).ways
    speed = np.array([0.5 * 1852 / 3600 + 0.2, -0.7])
    np.testing.assert_allclose(way.model[1:], np.broadcast_to(3600 * speed, (3, 2)), rtol=1e-5)


def cover(folder: Path, by_degree: float, name: str = "cover.nc", **attributes: str) -> None:
    """Write a file of concentrations that rise eastward from 88 degrees west; 0 west of there."""
    data = field(names=("a", "b"), standard=("x", "y"))
    share = by_degree * (data.lon + 88.0).clip(0.0) + 0 * data.a
    data = data.drop_vars(["a", "b"]).assign(siconc=share.transpose("time", "lat", "lon"))
    data.siconc.attrs = {"long_name": "Sea ice concentration", **attributes}
    data.to_netcdf(folder / name)


@pytest.mark.parametrize("unit", ["%", "1", "percent"])
def test_a_number_is_recorded_along_the_tracks(unit: str, tmp_path: Path) -> None:
    """It is linear between nodes, so bilinear interpolation is exact to the rounding of float32. No
    ice, 0 in half of the file at all times, is no land. The particles go east at 0.5 kn.
    """
    cover(tmp_path, 0.3 if unit == "1" else 30.0, units=unit)
    icy = drift.run(case_of(tmp_path, '[[cover]]\nfiles = "cover.nc"\nfill = 0\n'))
    recorded = icy.particles["cover"]
    assert (recorded.attrs["long_name"], recorded.attrs["units"]) == (COVER.spoken, "1")
    assert float(recorded.isel(time=-1).mean()) > float(recorded.isel(time=0).mean()) + 0.01
    np.testing.assert_allclose(recorded, 0.3 * (icy.particles["lon"] + 88.0).clip(0.0), atol=1e-5)
    bare = drift.run(case_of(tmp_path, ""))
    assert set(icy.particles) - set(bare.particles) == {"cover"}
    np.testing.assert_array_equal(icy.trajectories.lon, bare.trajectories.lon)


def test_each_scenario_has_its_own_numbers(tmp_path: Path) -> None:
    sources = "".join(
        f'[[cover]]\nname = "{name}"\nconstant = {share}\n' for name, share in SHARES.items()
    )
    other = STEADY[STEADY.index("[[scenario]]") :]
    text = "".join(
        other.replace('"boat"', f'"{name}"') + f'covers = ["{name}"]\n' for name in SHARES
    )
    result = drift.run(case_of(tmp_path, sources, (other, text)))
    for number, share in enumerate(SHARES.values()):
        own = result.particles["cover"].values[result.particles["scenario"].values == number]
        assert own.size > 50
        np.testing.assert_array_equal(own, np.float32(share))


def test_a_number_has_no_direction(tmp_path: Path) -> None:
    """A constant is a number; it is on no map of arrows, and drifters do not go with it."""
    case = case_of(tmp_path, "[[cover]]\nconstant = 0.4\n")
    result = drift.run(case)
    np.testing.assert_array_equal(result.particles["cover"], np.float32(0.4))
    assert "cover" not in result.flows
    assert "cover" not in velocities()
    with pytest.raises(UserError, match=r"constant: '0.4 m/s' must be a number"):
        case_of(tmp_path, '[[cover]]\nconstant = "0.4 m/s"\n')
    cover(tmp_path, 0.3, "wrong.nc", units="m s-1")
    with pytest.raises(UserError, match='units "m s-1" cannot be converted to "1"'):
        drift.run(case_of(tmp_path, '[[cover]]\nfiles = "wrong.nc"\n'))
    cover(tmp_path, 0.9, "much.nc", units="1")
    with pytest.raises(
        UserError, match=r"siconc can't be a concentration of sea ice: .*at most 1\. "
    ):
        drift.run(case_of(tmp_path, '[[cover]]\nfiles = "much.nc"\n'))
    cover(tmp_path, 0.3, units="1")
    (source,) = describe.open_quantities(str(tmp_path / "cover.nc"))
    assert any(line.startswith("  value    mean") for line in describe.describe(source))


def test_a_number_is_not_turned_at_a_pole(tmp_path: Path) -> None:
    """A field that depends on latitude alone, on a grid with a row at the pole and on a polar
    stereographic one.
    """
    lon, lat = np.arange(0.0, 360.0, 5.0), np.arange(80.0, 90.5, 0.5)
    share = ((lat[:, None] - 80) / 20 + 0 * lon)[None]
    attributes = {"standard_name": "sea_ice_area_fraction", "units": "1"}
    even = xr.Dataset(
        {"ice": (("time", "lat", "lon"), share, attributes)},
        {
            "time": [np.datetime64("2026-11-20", "ns")],
            "lat": ("lat", lat, {"standard_name": "latitude", "units": "degrees_north"}),
            "lon": ("lon", lon, {"standard_name": "longitude", "units": "degrees_east"}),
        },
    )
    x, y = np.meshgrid(np.linspace(-8.0, 8.0, 81), np.linspace(-8.0, 8.0, 81))
    colatitude = np.hypot(x, y)
    turned = xr.Dataset(
        {"ice": (("time", "y", "x"), ((10 - colatitude) / 20)[None], attributes)},
        {
            "time": even.time,
            "lat": (("y", "x"), 90 - colatitude, even.lat.attrs),
            "lon": (("y", "x"), np.degrees(np.arctan2(x, -y)), even.lon.attrs),
        },
    )
    for name, data in (("even.nc", even), ("turned.nc", turned)):
        data.to_netcdf(tmp_path / name)
        source = sources.open_source(
            "cover",
            str(tmp_path / name),
            steady=True,
            box=box_between(-180.0, 84.0, 180.0, 90.0),
        )
        values = source.read(0)[..., 0]
        there = np.broadcast_to(source.grid.lat[:, None], values.shape)
        known = np.isfinite(values)
        assert known.mean() > 0.9
        # linear between nodes 0.2 degrees apart, except at the tip of the cone, the pole
        np.testing.assert_allclose(values[known], (there[known] - 80) / 20, atol=0.2 / 20)


def test_every_quantity_has_its_entries() -> None:
    """The lists that CONTRIBUTING names, as they stand without the made-up quantities."""
    shipped = {name: QUANTITIES[name] for name in QUANTITIES if name not in ("ice", "cover")}
    assert FORCING.keys() == shipped.keys()
    for quantity in shipped.values():
        assert quantity.standard_names
        assert quantity.usual_names
    assert shipped.keys() <= CaseTable.model_fields.keys()
    assert {quantity.key for quantity in shipped.values()} <= ScenarioTable.model_fields.keys()
