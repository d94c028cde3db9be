"""Members as a case writes them: what they become, what is refused, and which errors hold beside
their spread.
"""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import drift
from drift.apps.check import check
from drift.apps.cli import commands
from drift.case.forcing import uncertainty
from drift.engine.environment import domain
from drift.engine.motion.errors.forcing_error import DEFAULT, MEMBERS, NOWHERE
from drift.pipeline import run_metadata, run_setup
from geo.errors import UserError

CASE = """
title = "members"
start = "2026-01-01T00:00Z"
duration = "6 h"
particles = 600
coast.source = "none"
{current}
[[wind]]
{wind}
[[scenario]]
name = "raft"
object = "LIFE-RAFT-DB-10"
position = {{ at = [5.0, 60.0], error = "1 nmi" }}
{more}
"""
WIND = 'constant = { speed = "12 kn", from = 240 }'
TYPED = "[[current]]\nmembers = [{ constant = { east = 0.1, north = 0 } }, { constant = { east = 0.2, north = 0 } }]"


def load(folder: Path, current: str = TYPED, wind: str = WIND, more: str = "") -> drift.Case:
    (folder / "case.toml").write_text(CASE.format(current=current, wind=wind, more=more))
    return drift.load(folder / "case.toml")


def file(folder: Path, members: int = 3) -> str:
    """Write a file with a dimension of members; return the current that it is."""
    dims = ("number", "time", "lat", "lon")
    values = np.linspace(0.1, 0.3, members)[:, None, None, None] * np.ones((members, 2, 21, 21))
    names = (("uo", "eastward"), ("vo", "northward"))
    xr.Dataset(
        {
            name: (
                dims,
                values.astype("f4"),
                {"units": "m s-1", "standard_name": f"{side}_sea_water_velocity"},
            )
            for name, side in names
        },
        coords={
            "time": ("time", [0, 12], {"units": "hours since 2026-01-01"}),
            "lat": ("lat", np.linspace(58, 62, 21), {"units": "degrees_north"}),
            "lon": ("lon", np.linspace(2, 8, 21), {"units": "degrees_east"}),
        },
    ).to_netcdf(folder / "ens.nc")
    return '[[current]]\nname = "ocean"\nfiles = "ens.nc"\nmembers = true'


@pytest.mark.parametrize(
    ("current", "told"),
    [
        ("members = []", "current 1.members: has 0 members; must have 2 to 1000"),
        ("members = [{ constant = { east = 0, north = 1 } }]", "has 1 member; must have 2 to 1000"),
        ("members = 3", "3 does not describe members; write true, the name of their dimension, or a list of tables"),
        ('members = ["a.nc", "b.nc"]', "does not describe members"),
        ("members = [{ add = true }, {}]", "member 1: add is the same for all members; give it beside members"),
        ("members = [{ constant = { east = 0 } }, {}]", r"member 1: constant: give speed and from"),
        ("members = [{}, {}]", "member 1: exactly one of files, dataset, constant, table, analytic must be given; found none"),
        (
            "constant = { east = 0, north = 1 }\nmembers = true",
            "members = true belongs to files and to a dataset; this source is constant: give a table for each member",
        ),
        ("members = [{ constant = { east = 0, north = 1 } }, { constant = { east = 0, north = 99 } }]", "member 2: constant: 99 m/s"),
        ('members = [{ files = "gone.nc" }, { files = "lost.nc" }]', 'member 1: no file "gone.nc"'),
    ],
)  # fmt: skip
def test_refusals(tmp_path: Path, current: str, told: str) -> None:
    with pytest.raises(UserError, match=told) as refused:
        load(tmp_path, f"[[current]]\n{current}")
    assert len(refused.value.lines) == 1


@pytest.mark.thorough
def test_members_of_a_built_in_flow_add_to_its_parameters(tmp_path: Path) -> None:
    flow = '[[current]]\nanalytic = "inertial"\nparameters = { mean_east = 0.2 }\nmembers = [{ parameters = { speed = 0.1 } }, { parameters = { speed = 0.3 } }]'
    case = load(tmp_path, flow)
    (spec,) = case.forcing["current"]
    assert [dict(part.parameters) for part in spec.parts] == [
        {"mean_east": 0.2, "speed": 0.1},
        {"mean_east": 0.2, "speed": 0.3},
    ]
    assert run_metadata.has_synthetic_forcing(case)
    told = check.check(case)
    assert "speed = 0.1, speed = 0.3" in told["current current 1"]
    assert told["members"].startswith(
        "2, all equally likely; each particle drifts in one of them throughout, about 300"
    )


def test_the_fastest_of_the_members_sets_the_domain(tmp_path: Path) -> None:
    def north(case: drift.Case) -> float:
        return domain.outermost_box(
            run_setup.ensemble_spec(case), run_setup.environment_spec(case)
        ).north

    assert (
        north(load(tmp_path, TYPED.replace("east = 0.2", "east = 6"))) > north(load(tmp_path)) + 0.1
    )


def test_the_spread_of_members_stands_for_the_default_error(tmp_path: Path) -> None:
    """Unless the case states one, which is added to it, or switches it off."""
    ocean = file(tmp_path)
    wind = '[uncertainty]\nwind = { std = "2 m/s" }\n'
    silent = load(tmp_path, ocean, more=wind)
    assert silent.current_error.std == 0
    assert silent.current_error.by[0] == MEMBERS
    assert (
        "no error of the current (the spread of its members represents it)"
        in run_metadata.describe_errors(silent)
    )
    assert not run_metadata.caution_banner(silent)
    stated = load(tmp_path, ocean, more=wind + 'current = { std = "0.1 m/s" }')
    assert stated.current_error.std == pytest.approx(0.1)
    assert run_metadata.describe_errors(stated).endswith(
        "; added to the spread of the members of the current"
    )
    none = load(tmp_path, ocean, more=wind + 'current = "none"')
    assert run_metadata.caution_banner(none) == "NO ERROR of current in this forecast"
    one = load(tmp_path, ocean.replace("members = true", "variables = { number = 0 }"))
    assert one.current_error.by[0] == DEFAULT
    assert one.current_error.std == uncertainty.CURRENT.std
    assert load(tmp_path).current_error.by[0] == NOWHERE


@pytest.mark.thorough
def test_what_a_run_tells_of_members(tmp_path: Path) -> None:
    """Without evidence all are as likely; the file's values are what they are called."""
    result = drift.run(load(tmp_path, file(tmp_path)), out=tmp_path / "out")
    table = result.tables["members"]
    assert table["name"].tolist() == [0, 1, 2]
    assert table["posterior"].to_numpy() == pytest.approx(1 / 3)
    assert (np.diff(table["lat"]) > 0).all()  # each further north than the one before
    assert (tmp_path / "out" / "members.csv").exists()
    assert result.summary["members"]["number"] == 3
    assert result.summary["members"]["effective"] == pytest.approx(3)
    assert "Members of the winds and currents" in (tmp_path / "out" / "report.html").read_text(
        encoding="utf-8"
    )


@pytest.mark.thorough
def test_a_dataset_with_members(tmp_path: Path) -> None:
    file(tmp_path)
    with xr.open_dataset(tmp_path / "ens.nc") as data:
        ocean = data.load()
    case = load(tmp_path, '[[current]]\ndataset = "ocean"\nmembers = true')
    result = drift.run(case, datasets={"ocean": ocean})
    assert len(result.tables["members"]) == 3


def test_many_forecasts_have_members_too(tmp_path: Path) -> None:
    """Each is to the bit the forecast of its case alone."""
    case = load(tmp_path, file(tmp_path))
    cases = [drift.vary(case, {"seed": seed}) for seed in (1, 2)]
    for one, alone in zip(drift.run_many(cases, maps=True), cases, strict=True):
        assert one.error is None
        assert one.forecast is not None
        np.testing.assert_array_equal(
            one.forecast.probability.values[-1], drift.run(alone).probability.values[-1]
        )


def test_info_takes_the_same_keys(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of files named from where one stands, a member each."""
    file(tmp_path)
    with xr.open_dataset(tmp_path / "ens.nc", decode_cf=False) as data:
        for k in range(3):
            data.isel(number=k, drop=True).to_netcdf(tmp_path / f"m_{k}.nc")
    monkeypatch.chdir(tmp_path)
    assert commands.main(["info", "m_0.nc", "m_1.nc", "m_2.nc", "--set", "members=true"]) == 0
    assert "3 members of an ensemble, by file: m_0, m_1, m_2" in capsys.readouterr().out
    assert commands.main(["info", "ens.nc"]) == 0
    assert (
        "3 members of an ensemble along number: 0, 1, 2; members = true to drift in all"
        in capsys.readouterr().out
    )
