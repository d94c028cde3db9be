"""What-if on common random numbers: nothing is nothing, a shift is its speed by time, refusals,
files, errors of differences.
"""

import csv
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import small_case
import spills
import xarray as xr
from scipy import stats

import drift
from drift.apps.cli import commands as cli
from drift.assess.compare import chapter, figures, pairing, report, text, units
from drift.assess.compare.maps import paired_maps
from drift.assess.compare.units import GROUPS, SamplingUnits
from drift.engine.particles.snapshot import Snapshot
from drift.engine.particles.status import Status
from drift.pipeline import flow
from drift.products.maps.imprint import Imprint, Setting
from drift.products.maps.marks import Mark
from geo import cells, sphere
from geo.cells import Cells

SEARCH = (
    small_case.STEADY.replace('object = "PIW-1"', 'object = "PIW-1"\nweight = 0.7')
    + """
[[scenario]]
name = "raft"
weight = 0.3
object = "LIFE-RAFT-DB-11"
position = { at = "27 35N 087 56W", std = "2 nmi" }
[[sortie]]
name = "first"
start = "+2 h"
end = "+4 h"
sweep_width = "0.5 nmi"
speed = "60 kn"
area = { centre = "27 31N 087 55W", length = "6 nmi", width = "6 nmi", orientation = 90 }
[uncertainty]
current = { std = "0.1 m/s", time = "3 h" }
"""
)
HOURS = 6
# differences of maps are made on a grid of their own
pytestmark = pytest.mark.usefixtures("coarse_maps")


def case_of(folder: Path, text: str, name: str = "trial", **changes: object) -> drift.Case:
    path = folder / f"{name}.toml"
    path.write_text(text)
    return drift.vary(
        drift.load(path), {key.replace("__", "."): value for key, value in changes.items()}
    )


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


def test_a_constant_current_more_moves_the_mean_by_its_way(tmp_path: Path) -> None:
    """East 0.2 and north -0.1 m/s for six hours: 4320 and -2160 m, on a sphere, for each particle
    of its own latitude.
    """
    a = case_of(
        tmp_path,
        small_case.STEADY,
        particles=4000,
        current__0__constant={"east": 0.1, "north": 0.05},
    )
    b = drift.vary(a, {"current.0.constant": {"east": 0.3, "north": -0.05}})
    found = drift.compare(a, b)
    (east,), (north,) = (found.at(found.times[-1], name) for name in figures.SHIFT)
    # Parallels bend: x^2 tan(lat) / 2R = 0.8 m; and a degree of longitude widens by y tan(lat) / R
    # = 0.02 % southward.
    assert east.difference == pytest.approx(0.2 * 3600 * HOURS, abs=2.0)
    assert north.difference == pytest.approx(-0.1 * 3600 * HOURS, abs=2.0)
    # Pairs keep together: what is left of the error is that of the widening, 0.02 % of 3 km /
    # sqrt(4000), not 3 km / sqrt(4000).
    assert max(east.error, north.error) < 0.1
    first = found.at(found.times[0], "area")
    assert [(row.difference, row.error) for row in first] == [(0.0, 0.0)] * len(first)


def test_a_dataset_belongs_to_the_case_that_names_it(tmp_path: Path) -> None:
    """0.3 m/s east and north from a dataset in memory, and the same velocity as a constant of the
    other case, which names no dataset.
    """
    named = small_case.CASE.replace('files = "current.nc"', 'dataset = "sea"')
    constant = f"constant = {{ speed = {0.3 * 2**0.5}, toward = 45 }}"
    a = case_of(tmp_path, named, "a")
    b = case_of(tmp_path, small_case.CASE.replace('files = "current.nc"', constant), "b")
    found = drift.compare(a, b, datasets={"sea": small_case.field()})
    for row in found.at(found.times[-1], figures.SHIFT):
        assert abs(row.difference) < 0.1  # 9 km of way, of which float32 keeps seven digits


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
    assert "mean of B from that of A" in (out / "compare.txt").read_text()
    assert cli.main([*words, "--out", str(out)]) == 2  # no result is overwritten unless asked
    assert cli.main(words[:2]) == 2
    assert "nothing to compare with" in capsys.readouterr().err


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
    assert not cautions[0].startswith("SYNTHETIC")
    assert cautions[1] == cautions[2]
    assert cautions[1].startswith("SYNTHETIC")


@pytest.mark.thorough
def test_steps_that_end_elsewhere_share_no_errors_and_this_is_said(tmp_path: Path) -> None:
    """The same current in files whose times are twenty minutes apart: the difference is none but
    for chance.
    """
    field = small_case.field()
    field.to_netcdf(tmp_path / "current.nc")
    field.assign_coords(time=field.time + np.timedelta64(20, "m")).to_netcdf(tmp_path / "later.nc")
    a = case_of(
        tmp_path,
        small_case.CASE,
        particles=2000,
        uncertainty__current={"std": "0.2 m/s", "time": "3 h"},
    )
    assert drift.compare(a, a).notes == ()
    found = drift.compare(a, drift.vary(a, {"current.0.files": "later.nc"}))
    assert len(found.notes) == 1
    assert "are not common to both" in found.notes[0]
    for name in figures.SHIFT:
        (row,) = found.at(found.times[-1], name)
        assert row.error > 10
        assert abs(row.difference) < 4 * row.error  # one in 16,000


def test_backward_against_backward(tmp_path: Path) -> None:
    text = small_case.STEADY.replace('duration = "6 h"', 'duration = "6 h"\ndirection = "backward"')
    a = case_of(tmp_path, text, particles=500, start="2026-11-21T06:00Z", uncertainty="none")
    found = drift.compare(a, drift.vary(a, {"current.0.constant": {"east": 0.5, "north": 0.0}}))
    assert found.times[0] > found.times[-1]
    (east,) = found.at(found.times[-1], "mean, east")
    assert east.difference == pytest.approx(-(0.5 - 0.5 * 1852 / 3600) * 3600 * HOURS, abs=2.0)


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


# --- standard errors against repeated seeds, on clouds made here ---

SEEDS = 200
STRATA = (700, 300)
GRID = Cells(-(2**20), -(2**20), 2**16, 2**16, 32, 32)  # 0.6 km, 20 km across


def cloud(seed: int) -> tuple[Snapshot, Snapshot, SamplingUnits]:
    """Two clouds of pairs: of one law within each of two strata, weighted at random, b wider and
    farther east than a.
    """
    rng = np.random.default_rng(seed)
    n, stratum = sum(STRATA), np.repeat([0, 1], STRATA)
    x, y = rng.normal(0, 2500, n) + 1500 * stratum, rng.normal(0, 1500, n)
    more = rng.normal(0, 300, (2, n))
    base = np.repeat([0.6 / STRATA[0], 0.4 / STRATA[1]], STRATA)
    snapshots = []
    for east, north, miss in ((x, y, 0.5), (1.1 * x + 500 + more[0], y + more[1], 0.7)):
        weight = base * np.where(north > 0, miss, 1.0)
        lon, lat = sphere.destination(0.0, 0.0, east, north)
        status = np.where(east > 3000, Status.ASHORE, Status.ADRIFT).astype(np.int32)
        binary = (sphere.to_binary(np.degrees(angle)) for angle in (lon, lat))
        time = np.datetime64("2026-11-21T00:00:00")
        snapshots.append(
            Snapshot(time, *binary, weight / weight.sum(), status, stratum.astype(np.int32))
        )
    return snapshots[0], snapshots[1], SamplingUnits(stratum, np.ones(n, bool), worlds=False)


def bounds(n: int) -> tuple[float, float]:
    """Return what a standard deviation of n normal values is of its own, 99.8 % of the time:
    chi-square.
    """
    return tuple(np.sqrt(stats.chi2.ppf([0.001, 0.999], n - 1) / (n - 1)))


def test_standard_errors_are_the_spread_over_seeds() -> None:
    found: dict[tuple[str, str], list[tuple[float, float]]] = {}
    for seed in range(SEEDS):
        a, b, drawn = cloud(seed)
        told = [
            figures.status_shares(snapshot, ("one", "two"), drawn)
            | figures.mean_position(snapshot, drawn, (0.0, 0.0))
            for snapshot in (a, b)
        ]
        for row in units.differences(a.time, told[0], told[1], drawn, figures.SHIFT):
            found.setdefault((row.quantity, row.name), []).append((row.difference, row.error))
    low, high = bounds(SEEDS)
    checked = 0
    for key, pairs in found.items():
        differences, errors = np.array(pairs).T
        spread = differences.std(ddof=1)
        if spread > 1e-12:
            checked += 1
            assert low < spread / np.sqrt(np.mean(errors**2)) < high, key
    assert checked == 6  # two statuses, two scenarios, east and north


@pytest.mark.thorough
def test_standard_errors_of_maps_are_the_spread_over_seeds() -> None:
    """Pooled over the cells that have anything; of independent cells, of which there are tens, the
    ratio is nearer to 1.
    """
    seeds = 60
    pairs = []
    for seed in range(seeds):
        a, b, drawn = cloud(seed)
        made = paired_maps(a, b, drawn, GRID, None, 40.0)
        pairs.append((made.difference, made.error))
        on = cells.index_of_cells(a.lon, a.lat, GRID) >= 0  # a few lie off it
        assert made.a.sum() == pytest.approx(a.probability[on].sum())
    differences, errors = np.stack(pairs, axis=1)
    spread, error = differences.var(axis=0, ddof=1), np.mean(errors**2, axis=0)
    busy = spread > 0.05 * spread.max()
    low, high = bounds(seeds)
    assert low < np.sqrt(spread[busy].sum() / error[busy].sum()) < high


def test_groups_have_as_many_of_every_stratum() -> None:
    drawn = cloud(0)[2]
    count = np.zeros((2, GROUPS), int)
    np.add.at(count, (drawn.stratum, drawn.group), 1)
    assert np.ptp(count, axis=1).max() <= 1


def test_means_of_strata_are_no_chance() -> None:
    """Influences that are level within each stratum have no error; what never had a weight does not
    count.
    """
    drawn = cloud(0)[2]
    level = np.where(drawn.stratum == 0, 3.0, -1.0)
    assert drawn.error(level) == pytest.approx(0.0, abs=1e-12)
    rng = np.random.default_rng(1)
    noise = rng.normal(size=drawn.size)
    expected = np.sqrt(sum(n * noise[drawn.stratum == k].var(ddof=1) for k, n in enumerate(STRATA)))
    assert drawn.error(level + noise) == pytest.approx(expected)
    spare = replace(drawn, begun=np.arange(drawn.size) % 2 == 0)
    half = np.sqrt(
        sum(
            n / 2 * noise[(drawn.stratum == k) & spare.begun].var(ddof=1)
            for k, n in enumerate(STRATA)
        )
    )
    assert spare.error(level + noise) == pytest.approx(half)


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
