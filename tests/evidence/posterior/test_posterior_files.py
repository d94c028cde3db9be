"""What is told of posteriors: the table, the picture, and where there is nothing to tell."""

import csv
import dataclasses
import io
from pathlib import Path

import numpy as np
import pytest
from voyages import AT_RISK, BRIDGE, CONTACT, COURSE, TENDER, YACHT, believed, load

import drift
from drift.evidence.posterior import beliefs, tables
from drift.evidence.posterior import map as posterior_map
from drift.evidence.posterior.quantities import QUANTITIES
from drift.evidence.posterior.quantity import Quantity, Values
from drift.evidence.posterior.records import Posteriors
from drift.pipeline import run_setup
from drift.products.maps.imprint import Imprint, Setting
from kernels.runtime import runtime


@pytest.fixture(scope="module")
def four(tmp_path_factory: pytest.TempPathFactory) -> Posteriors:
    """Four scenarios, one of which drifts alone, before and after a contact."""
    contact = CONTACT.format(name="seen", hours=14, lon=179.7, lat=44.0, error=40)
    text = load(
        tmp_path_factory.mktemp("four"),
        AT_RISK,
        COURSE,
        TENDER,
        BRIDGE,
        weights=(0.4, 0.3, 0.1, 0.2),
        contact=contact,
    )
    return believed(text)[0]


def rows(posteriors: Posteriors) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(tables.csv(posteriors, "run"))))


def test_the_table_is_whole(four: Posteriors) -> None:
    """Each quantity in the scenarios that have it and in all; shares of all are those of scenarios,
    weighted.
    """
    found = rows(four)
    having = {
        "scenario": set(), "departure": {"yacht", "course", "bridge"}, "speed": {"yacht", "course"}, "course": {"course"},
        "destination": {"yacht", "bridge"}, "adrift": {"yacht", "tender"}, "spread_rate": {"bridge"},
    }  # fmt: skip
    for stage in (0, 1):
        mine = [row for row in found if row["update"] == str(stage)]
        assert {row["name"] for row in mine} == {("before the first update", "seen")[stage]}
        scenario = {
            row["value"]: float(row["share"]) for row in mine if row["quantity"] == "scenario"
        }
        assert sum(scenario.values()) == pytest.approx(1)
        assert {row["quantity"] for row in mine} == set(having)
        for name, names in having.items():
            of_it = [row for row in mine if row["quantity"] == name]
            assert {row["scenario"] for row in of_it} == {*names, "all"}
            whole = sum(float(row["share"]) for row in of_it if row["scenario"] == "all")
            parts = sum(
                scenario[row["scenario"]] * float(row["share"])
                for row in of_it
                if row["scenario"] != "all"
            )
            assert whole == pytest.approx(parts if names else 1, rel=1e-6)
    times = [row for row in found if row["quantity"] == "departure" and row["scenario"] == "yacht"]
    for row in times:
        ends = np.array(
            [row[name].rstrip("Z") for name in (*tables.QUANTILES, "mean")], "datetime64[s]"
        )
        assert (np.diff(ends[:-1]) > np.timedelta64(0, "s")).all()
        hours = (ends - np.datetime64("2026-03-05T00:00:00")) / np.timedelta64(1, "h")
        assert hours.min() >= 1
        assert hours.max() <= 9
        assert 0.5 < float(row["std"]) < 8 / np.sqrt(12) + 0.1  # hours
    destinations = {row["value"] for row in found if row["quantity"] == "destination"}
    assert destinations == {"44-12.0N 176-54.0W", "44-54.0N 179-12.0W", "41-42.0N 178-48.0W"}
    assert len(tables.summary_of_posteriors(four)) == 2


def test_the_picture(four: Posteriors, tmp_path: Path) -> None:
    """Charts hold all but the tails, courses are cut away from their mean, and it is drawn."""
    stages = posterior_map.shown(four)
    for k, told in enumerate(four.told):
        own = posterior_map.panel(four, stages, k)
        for row, stage in zip(own.rows, stages, strict=True):
            share = stage.marginals[k].share[-1]
            assert share * (1 - 2.01 * posterior_map.TAILS) <= row.sum() <= share * (1 + 1e-9)
        assert (np.diff(own.edges) > 0).all()
        # Those that keep a course all depart at once, and stand out of the departures.
        alone = [] if own.lone is None else np.flatnonzero(own.lone).tolist()
        assert alone == ([0] if told.quantity.name == "departure" else [])
        if told.quantity.name == "course":
            low, high = np.degrees(own.edges[[0, -1]])
            # north is inside, and so is no turn of nothing
            assert low < 360 < high or low < 0 < high
            assert 95 / 2 < high - low < 110
    setting = Setting(Imprint("Of a $ and a $", caution="SYNTHETIC"))
    posterior_map.plot_posteriors(four, tmp_path / "posteriors.png", setting)
    assert (tmp_path / "posteriors.png").read_bytes().startswith(b"\x89PNG")


def test_many_values_and_many_updates(four: Posteriors) -> None:
    """Of a category the likeliest values and the others together; of updates the first row and the
    last.
    """
    many = dataclasses.replace(
        four,
        stages=(
            four.stages[0],
            *[dataclasses.replace(four.stages[1], number=k) for k in range(1, 40)],
        ),
    )
    assert [stage.number for stage in posterior_map.shown(many)] == [0, *range(29, 40)]
    table = np.random.default_rng(2).dirichlet(np.full(300, 0.2), 5)
    told = dataclasses.replace(four.told[0], labels=tuple(f"route {k}" for k in range(300)))
    own = posterior_map._of_category(told, table)
    assert len(own.names) == posterior_map.MOST_VALUES
    assert own.names[-1] == "289 others"
    np.testing.assert_allclose(own.rows.sum(axis=1), 1)
    kept = {f"route {k}" for k in np.argsort(table.max(axis=0))[-11:]}
    assert set(own.names[:-1]) == kept


def test_a_quantity_more_is_one_entry(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Such as the member of an ensemble of forcings: it is told and drawn with nothing else
    changed.
    """
    member = Quantity(
        "member", "Member", "category", lambda drawn: Values(np.arange(drawn.ensemble.n) % 5, drawn.scenario == 0),
        labels=lambda spec: tuple("abcde"),
    )  # fmt: skip
    monkeypatch.setattr(beliefs, "QUANTITIES", (*QUANTITIES, member))
    posteriors, _ = believed(load(tmp_path, YACHT, TENDER, n=1000))
    mine = [row for row in rows(posteriors) if row["quantity"] == "member"]
    assert [(row["scenario"], row["value"]) for row in mine] == [
        *(("yacht", x) for x in "abcde"),
        *(("all", x) for x in "abcde"),
    ]
    assert [float(row["share"]) for row in mine] == pytest.approx([0.2] * 5 + [0.1] * 5)


def test_what_is_told_of_runs_without_searches(tmp_path: Path) -> None:
    """Where something steers: its prior, in the summary too; where all drift and nothing was seen:
    nothing.
    """
    result = drift.run(load(tmp_path, YACHT, n=500))
    assert result.posteriors is not None
    assert [stage.kind for stage in result.posteriors.stages] == ["prior"]
    (summary,) = result.summary["posteriors"]
    assert set(summary["quantities"]) == {"departure", "speed"}
    assert 5 < summary["quantities"]["speed"]["q05"] < summary["quantities"]["speed"]["q95"] < 11
    alone = load(tmp_path, TENDER, n=500)
    assert drift.run(alone).posteriors is None


def test_nothing_uncertain_is_nothing_told(tmp_path: Path) -> None:
    """A drifter released at a known time, of one scenario, whose sides do not differ: there is no
    table.
    """
    still = TENDER.replace(', until = "+6 h"', "")
    contact = CONTACT.format(name="seen", hours=14, lon=178.5, lat=43.0, error=40)
    case = load(tmp_path, still, n=500, contact=contact)
    runtime.start()
    begin = run_setup.prepare(case, run_setup.open_for(case))
    held = run_setup.beliefs(case, begin)
    begin.scene.forcing.close()
    assert held is not None
    assert held.posteriors is None
