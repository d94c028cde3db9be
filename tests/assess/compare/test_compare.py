"""What-if on common random numbers: nothing is nothing, what is rejected, and what the files hold."""

import csv
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import spills
import xarray as xr
from compared_cases import SEARCH, case_of

import drift
from drift.apps.cli import commands as cli
from drift.assess.compare import chapter, pairing, report, text
from drift.pipeline import flow
from drift.products.maps.imprint import Imprint, Setting
from drift.products.maps.marks import Mark
from geo.box import Box

# differences of maps are made on a grid of their own
pytestmark = pytest.mark.usefixtures("coarse_maps")


@pytest.fixture(scope="module")
def search(tmp_path_factory: pytest.TempPathFactory) -> drift.Case:
    return case_of(tmp_path_factory.mktemp("search"), SEARCH, particles=3000)


@pytest.mark.thorough
def test_a_case_against_itself_is_zero_in_every_number(search: drift.Case) -> None:
    found = drift.compare(search, search)
    assert {row.quantity for row in found.rows} == {
        "status", "scenario", "mean, east", "mean, north", "area", "POS", "cumulative POS"
    }  # fmt: skip
    rows = [row for row in found.rows if np.isfinite(row.difference)]
    assert len(rows) > 40
    assert {(row.difference, row.error) for row in rows} == {(0.0, 0.0)}
    for name in ("difference", "difference_error"):
        assert not found.data[name].values.any()
    np.testing.assert_array_equal(found.data["probability_a"], found.data["probability_b"])
    # The map is all of the probability that lies on it; at the start too.
    np.testing.assert_allclose(found.data["probability_a"].sum(("lat", "lon")), 1.0, atol=1e-5)


@pytest.mark.thorough
def test_differences_are_a_table_with_units(search: drift.Case) -> None:
    found = drift.compare(search, drift.vary(search, {"scenario.0.position.std": "2 nmi"}))
    table = found.differences
    assert list(table) == [
        "time",
        "quantity",
        "name",
        "unit",
        "a",
        "b",
        "difference",
        "standard_error",
    ]
    assert set(table["unit"]) == {"1", "m", "m2"}
    areas = table[(table["quantity"] == "area") & (table["name"] == "50%")].set_index("time")
    of_a = found.a.forecast.data["containment_area"].sel(share=0.5).to_series()
    assert (areas["a"] == of_a[areas.index]).all()  # their times join, and areas are in m2
    assert areas["difference"].equals(areas["b"] - areas["a"])
    assert (areas["standard_error"] > 0).all()


@pytest.mark.thorough
def test_runs_are_those_of_drift_run(search: drift.Case) -> None:
    """A is not changed by what it is compared with: its particles, weights and POS are those of its
    run alone.
    """
    alone, found = (
        drift.run(search),
        drift.compare(search, drift.vary(search, {"wind.0.constant.from": 200})),
    )
    for name in ("mean_lon", "mean_lat", "status_probability", "scenario_probability"):
        own, other = (result.forecast.data[name].values for result in (alone, found.a))
        np.testing.assert_allclose(own, other, rtol=0, atol=1e-12)
    assert (
        alone.summary["search"]["updates"][0]["pos"]
        == found.a.summary["search"]["updates"][0]["pos"]
    )


def test_particles_and_random_numbers_are_those_of_the_first_case(search: drift.Case) -> None:
    """B's own seed and number of particles do not count, and A stays what it was."""
    a, b = pairing.pair_cases(search, drift.vary(search, {"seed": 77, "particles": 500}))
    assert search.seed != 77
    for case in (a, b):
        assert (case.seed, case.particles, sum(case.counts)) == (search.seed, 3000, 3000)


@pytest.mark.thorough
def test_weights_of_scenarios_alone_change_what_they_say(search: drift.Case) -> None:
    """B keeps A's slots whatever its weights are: before anything is seen the difference is exact,
    and has no error.
    """
    b = drift.vary(search, {"scenario.0.weight": 0.2, "scenario.1.weight": 0.8})
    paired = pairing.pair_cases(search, b)
    assert paired[0].counts == paired[1].counts == (2100, 900)
    found = drift.compare(search, b)
    rows = {row.name: row for row in found.at(found.times[0], "scenario")}
    assert rows["raft"].difference == pytest.approx(0.5, abs=1e-6)
    assert rows["raft"].error == pytest.approx(0.0, abs=1e-8)
    pos = next(row for row in found.of_run if row.quantity == "POS")
    assert (pos.a, pos.b) == tuple(
        pytest.approx(result.summary["search"]["updates"][0]["pos"]["all"])
        for result in (found.a, found.b)
    )
    assert 0 < pos.error < 0.02
    assert pos.difference == pos.b - pos.a


@pytest.mark.thorough
def test_families_count_together_where_particles_are_drawn_anew(search: drift.Case) -> None:
    a = drift.vary(search, {"resampling": {"below": 0.99}, "sortie.0.sweep_width": "2 nmi"})
    found = drift.compare(a, drift.vary(a, {"wind.0.constant.speed": "12 kn"}))
    assert found.a.updates is not None
    assert found.a.updates.all[0].resampled
    (east,) = found.at(found.times[-1], "mean, east")
    assert 0 < east.error < abs(east.difference)


@pytest.mark.thorough
def test_files_hold_what_was_found(
    search: drift.Case, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    words = [
        "compare",
        str(search.path),
        "--set",
        "particles=2000",
        "--set-b",
        "wind.0.constant.speed=14 kn",
    ]
    assert cli.main([*words, "--out", str(out)]) == 0
    told = capsys.readouterr().out
    assert f"Results in {out}" in told
    assert "wind.0.constant.speed=14 kn" in told
    made = {path.name for path in drift.results(out)}
    assert made == {
        *chapter.FILES,
        *chapter.PICTURES,
        "report.html",
        "summary.json",
        "manifest.json",
    }
    with open(out / "compare.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    summary = json.loads((out / "summary.json").read_text())
    with xr.open_dataset(out / "compare.nc") as data:
        assert data.attrs["Conventions"] == "CF-1.11, ACDD-1.3"
        assert len(rows) == len(summary["compare"]["differences"]) == data.sizes["figure"]
        np.testing.assert_allclose(
            data["difference"], data["probability_b"] - data["probability_a"], atol=1e-7
        )  # of float32
        for k, (row, figure) in enumerate(
            zip(rows, summary["compare"]["differences"], strict=True)
        ):
            assert row["quantity"] == figure["quantity"] == str(data["figure_quantity"].values[k])
            if row["difference"]:
                assert float(row["difference"]) == pytest.approx(
                    figure["difference"], rel=1e-8, abs=1e-300
                )
                assert float(data["figure_error"][k]) == figure["standard_error"]
    assert summary["a"]["run"]["seed"] == summary["b"]["run"]["seed"]
    assert "mean of B relative to that of A" in (out / "compare.txt").read_text()
    assert cli.main([*words, "--out", str(out)]) == 2  # no result is overwritten unless asked
    assert cli.main(words[:2]) == 2
    assert "nothing to compare with" in capsys.readouterr().err


@pytest.mark.thorough
def test_the_report_says_where_the_cases_began(search: drift.Case) -> None:
    """Once where they began alike, else of each; the cases of `drift compare` go through
    facts.setting, as maps do.
    """
    found = drift.compare(search, drift.vary(search, {"scenario.0.position.at": "27 40N 088 10W"}))
    here, there = (Setting(Imprint("a"), marks=[Mark(lon, 27.5, "LKP")]) for lon in (-88.0, -88.1))
    for begun, names in (
        ((here, here), ["it"]),
        ((here, there), ["A", "B"]),
        ((Setting(Imprint("a")),) * 2, []),
    ):
        titles = [leaf["title"] for leaf in report.comparison_leaves(found, begun)]
        assert [title for title in titles if "began" in title] == [
            f"Where {name} began" for name in names
        ]


@pytest.mark.thorough
def test_the_picture_bears_the_caution_of_either_case(
    search: drift.Case, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shown: list[Setting] = []
    monkeypatch.setattr(
        flow, "publish_outputs", lambda out, chapters, setting, **more: shown.append(setting)
    )
    made_up = {"wind.0": {"name": "air", "analytic": "breeze"}}
    other = drift.vary(search, made_up)
    for a, b in ((search, search), (other, search), (search, other)):
        drift.compare(a, b, out=tmp_path / "out")
    cautions = [setting.imprint.caution for setting in shown]
    assert cautions[0] == "NO ERROR of wind in this forecast"
    assert cautions[1] == "SYNTHETIC wind or current: not for operations"
    assert cautions[1] == cautions[2]


@pytest.mark.thorough
def test_a_grid_of_the_first_case_is_that_of_both(search: drift.Case) -> None:
    grid = {"west": -88.3, "south": 27.2, "east": -87.4, "north": 27.9, "spacing": "1 nmi"}
    a = drift.vary(search, {"output.grid": grid})
    found = drift.compare(a, search)
    for result in (found.a, found.b):
        np.testing.assert_array_equal(found.data["lon"], result.forecast.data["lon"])
        np.testing.assert_array_equal(found.data["lat"], result.forecast.data["lat"])
    assert a.grid is not None
    assert found.data.sizes["lon"] == a.grid.nlon


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"start": "2026-11-21T01:00Z"}, "it begins at 210100ZNOV26, and trial.toml at 210000ZNOV26; make start equal"),
        ({"duration": "7 h"}, "it ends at 210700ZNOV26"),
        ({"output": {"every": "5 h"}}, "only one of it and trial.toml has an output at 210500ZNOV26; make"),
        ({"output": {"areas": [50, 90]}}, "its areas are 50, 90 %, those of trial.toml 50, 75, 95 %"),
        ({"direction": "backward", "sortie": []}, "it runs backward, and trial.toml forward"),
        ({"resampling": {"method": "kahn", "below": 0.5}}, 'resampling.method "kahn" reserves spare slots'),
    ],
)  # fmt: skip
def test_cases_that_do_not_compare_are_refused_in_a_line(
    search: drift.Case, changes: dict[str, Any], words: str
) -> None:
    if "direction" in changes:
        changes = {**changes, "start": "2026-11-21T06:00Z"}
    other = drift.vary(search, changes)
    with pytest.raises(drift.UserError) as refusal:
        drift.compare(search, other)
    lines = refusal.value.lines
    assert len(lines) == 1 + ("start" in changes and "direction" not in changes)
    assert words in lines[0]


def test_other_numbers_of_scenarios_are_refused(search: drift.Case) -> None:
    tables = [dict(table, weight=1.0) for table in search.tables["scenario"][:1]]
    with pytest.raises(
        drift.UserError, match=r"it has 1 scenarios, and trial\.toml 2, which share the particles"
    ):
        drift.compare(search, drift.vary(search, {"scenario": tables}))


@pytest.fixture(scope="module")
def spill(tmp_path_factory: pytest.TempPathFactory) -> drift.Case:
    return spills.case_of(
        tmp_path_factory.mktemp("spill"), worlds=300, per_world=60, duration="2 d"
    )


def test_a_spill_against_a_search_is_refused(search: drift.Case, spill: drift.Case) -> None:
    with pytest.raises(drift.UserError, match=r"it is a spill, and trial\.toml is a search"):
        drift.compare(search, spill)


@pytest.mark.parametrize(
    ("one", "other", "both"),
    [
        ((1, 50, 3, 52), (2, 51, 4, 55), (1, 50, 4, 55)),
        ((1, 50, 3, 52), (-2, 48, 2, 51), (-2, 48, 3, 52)),
        ((1, 50, 9, 55), (2, 51, 4, 52), (1, 50, 9, 55)),
        ((178, -10, 181, -8), (-179.5, -9, -178, -7), (178, -10, 182, -7)),
        ((-179.5, -9, -178, -7), (178, -10, 181, -8), (178, -10, 182, -7)),
        ((-170, 1, 20, 2), (10, 0, 195, 3), (-180, 0, 180, 3)),
    ],
    ids=["north-east", "south-west", "inside", "across 180", "from its east", "all round"],
)
def test_two_spills_have_the_box_that_holds_both(
    spill: drift.Case,
    one: tuple[float, ...],
    other: tuple[float, ...],
    both: tuple[float, ...],
) -> None:
    """West, south, east and north [deg]."""
    given = (replace(spill, domain=Box(*sides)) for sides in (one, other))
    for case in pairing.pair_cases(*given):
        assert case.domain == Box(*both)


@pytest.mark.thorough
def test_washup_of_spills(spill: drift.Case, tmp_path: Path) -> None:
    """A world's objects on a stretch in both runs: the error is that of the mean of paired worlds."""
    same = drift.compare(spill, spill)
    assert {(row.difference, row.error) for row in same.of_run} == {(0.0, 0.0)}
    b = drift.vary(spill, {"current.0.constant.speed": "0.28 m/s"})
    found = drift.compare(spill, b, tmp_path / "out")
    washup = [result.washup for result in (found.a, found.b)]
    assert washup[0] is not None
    assert washup[1] is not None
    total, *rows = found.of_run
    each = [
        data["world_total"].sel(fate="ashore").isel(time=-1).values.astype(float) for data in washup
    ]
    assert (total.a, total.b) == tuple(pytest.approx(values.mean()) for values in each)
    paired = (each[1] - each[0]).std(ddof=1) / np.sqrt(len(each[0]))
    apart = np.hypot(*(values.std(ddof=1) for values in each)) / np.sqrt(len(each[0]))
    assert total.error == pytest.approx(paired, rel=1e-6)
    assert total.error < 0.5 * apart  # which is what common random numbers are for
    assert sum(row.difference for row in rows) == pytest.approx(total.difference, abs=0.01)
    for side, data in zip(("a", "b"), washup, strict=True):
        expected = data["expected"].isel(time=-1).values
        assert sorted(getattr(row, side) for row in rows) == pytest.approx(sorted(expected))


@pytest.mark.thorough
def test_what_both_sides_are_given_is_told(spill: drift.Case, tmp_path: Path) -> None:
    """Finds weigh both sides of a comparison: in words, in the table and in the report; without
    them there is nothing to tell.
    """
    find = {"find": [{"name": "one", "at": [0.0, 0.05], "time": "+40 h"}]}
    patrol = {
        "patrol": [
            {
                "name": "first",
                "between": [[0.0, -0.1], [0.0, 0.1]],
                "time": "+30 h",
                "detection": 0.2,
            }
        ]
    }
    a, b = (drift.vary(spill, {"spill.worlds": 60, **more}) for more in ({**find, **patrol}, find))
    found = drift.compare(a, b, tmp_path / "out")
    assert found.given == ("1 find and 1 patrol", "1 find")
    words = text.comparison_facts(found)["given"]
    assert words.startswith("A is weighted by 1 find and 1 patrol, B by 1 find")
    assert "--set find='[]' --set patrol='[]'" in words
    with open(tmp_path / "out" / "compare.csv", newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert {(row["given_a"], row["given_b"]) for row in rows} == {found.given}
    for name in ("compare.txt", "report.html"):
        assert words in (tmp_path / "out" / name).read_text().replace("\\u0027", "'")
    free = drift.compare(*(drift.vary(case, {"find": [], "patrol": []}) for case in (a, b)))
    assert free.given == ("nothing", "nothing")
    assert "given" not in text.comparison_facts(free)


UNIT = """
[[unit]]
name = "aircraft"
kind = "Aircraft"
base = "28 00N 088 00W"
ready = "+0 h"
search_speed = "120 kn"
transit_speed = "180 kn"
endurance = "40 min"
altitude = "500 ft"
daylight = false
sweep_width = "0.3 nmi"
[plan]
begin = "+4 h"
until = "+6 h"
particles = 1000
"""


@pytest.mark.thorough
def test_the_next_search_of_each_is_planned_and_compared(
    tmp_path: Path, search: drift.Case
) -> None:
    a = case_of(tmp_path, SEARCH + UNIT, particles=1500)
    same = drift.compare(a, a, plan=True)
    (row,) = [row for row in same.of_run if row.quantity == "POS of the next plan"]
    assert same.plans is not None
    assert row.a == row.b == pytest.approx(same.plans[0].pos)
    assert (row.difference, row.error) == (0.0, 0.0)
    found = drift.compare(a, drift.vary(a, {"scenario.1.position.std": "6 nmi"}), plan=True)
    (row,) = [row for row in found.of_run if row.quantity == "POS of the next plan"]
    assert found.plans is not None
    assert (row.a, row.b) == tuple(pytest.approx(plan.pos) for plan in found.plans)
    assert row.a == pytest.approx(same.plans[0].pos)
    assert 0 < row.error < 0.02
    with pytest.raises(drift.UserError, match="has no \\[\\[unit\\]\\] to plan with"):
        drift.compare(search, search, plan=True)
