"""A quantity of forcing is one entry: a made-up one, the drift of ice, goes from a case's text to
tiles on the device.

It has no term in kernels.step.velocity, so nothing moves with it.
"""

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest
from pydantic import Field, create_model

import drift
from drift.apps.cli import grammar
from drift.assess.verify import along
from drift.case import file as case_file
from drift.case.forcing.sources import SourceTable
from drift.case.scenario.scenario import ScenarioTable
from drift.case.schema import CaseTable
from drift.engine.environment import domain
from drift.engine.motion.forcing import Forcing
from drift.pipeline import run_metadata, run_setup
from drift.tracking.tracks.records import Track
from geo import sphere
from geo.errors import UserError
from geo.forcing import describe, quantities
from geo.forcing.quantity import QUANTITIES, Quantity
from kernels.step.features import FORCING
from tests.oracles.small_case import STEADY, field

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
)
PACK = '[[ice]]\nname = "pack"\nconstant = { east = 0.2, north = -0.7 }\n'


@pytest.fixture(autouse=True)
def ice(monkeypatch: pytest.MonkeyPatch) -> None:
    """Add the quantity where CONTRIBUTING says that one is added; only its term in the kernel is
    missing.
    """
    monkeypatch.setitem(QUANTITIES, "ice", ICE)
    monkeypatch.setitem(quantities.STANDARD, "ice", ((*NAMES, "true"),))
    monkeypatch.setitem(quantities.COMMON, "ice", ())
    monkeypatch.setitem(FORCING, "ice", 0)
    story = create_model("ScenarioTable", __base__=ScenarioTable, floes=(list[str] | None, None))
    many = Field(default_factory=list)
    table = create_model(
        "CaseTable", __base__=CaseTable, ice=(list[SourceTable], many), scenario=(list[story], many)
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
    with pytest.raises(UserError, match="no current, wind, Stokes drift or drift of ice found"):
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


def test_every_quantity_has_its_entries() -> None:
    """The lists that CONTRIBUTING names, as they stand without the made-up quantity."""
    shipped = {name: quantity for name, quantity in QUANTITIES.items() if name != "ice"}
    for entries in (FORCING, quantities.STANDARD, quantities.COMMON):
        assert entries.keys() - {"ice"} == shipped.keys()
    assert shipped.keys() <= CaseTable.model_fields.keys()
    assert {quantity.key for quantity in shipped.values()} <= ScenarioTable.model_fields.keys()
