"""Of many scenarios the likeliest are shown by themselves; what is said of the others together is
what all of them say.
"""

import clouds
import numpy as np
import pytest

from drift.engine.particles.snapshot import Snapshot
from drift.evidence.filter import updates as search_updates
from drift.evidence.filter.updates import Update, Updates
from drift.forecast import build, effective, likeliest
from drift.forecast.products import dataset, tables
from geo import sphere

MANY = 17
WEIGHTS = np.random.default_rng(4).gamma(0.8, size=MANY)
NAMES = [f"story {k}" for k in range(MANY)]


def test_the_largest_at_any_time_counts_and_one_other_is_no_others() -> None:
    first, last = WEIGHTS / WEIGHTS.sum(), np.roll(WEIGHTS, 5) / WEIGHTS.sum()
    shown = likeliest.likeliest_scenarios([first, last])
    largest = np.maximum(first, last)
    assert sorted(largest[list(shown.alone)]) == sorted(largest)[-10:]
    assert list(shown.alone) == sorted(shown.alone)
    assert sorted([*shown.alone, *shown.rest]) == list(range(MANY))
    assert shown.names(NAMES)[-1] == "7 others"
    assert likeliest.likeliest_scenarios(np.ones(11)).rest == ()
    assert likeliest.likeliest_scenarios(np.ones(12)).alone == tuple(range(10))


def test_sums_and_means_of_the_others() -> None:
    shown, values = (
        likeliest.likeliest_scenarios(WEIGHTS),
        np.random.default_rng(5).normal(size=(3, MANY)),
    )
    rest = [k for k in range(MANY) if k not in shown.alone]
    np.testing.assert_allclose(
        shown.sums(values)[:, -1], [sum(row[k] for k in rest) for row in values]
    )
    np.testing.assert_allclose(
        shown.means(values, WEIGHTS)[:, -1],
        [np.average([row[k] for k in rest], weights=WEIGHTS[rest]) for row in values],
    )
    assert (np.bincount(shown.place)[-1], shown.place[shown.alone[3]]) == (len(rest), 3)


@pytest.fixture(scope="module")
def snapshots() -> list[Snapshot]:
    """Seventeen scenarios, each about a place of its own; some have become likelier by the second
    output.
    """
    random, n = np.random.default_rng(6), 6800
    scenario = np.repeat(np.arange(MANY, dtype=np.int32), n // MANY)
    lon = 4.0 + 0.02 * scenario + random.normal(0, 0.05, n)
    lat = 58.0 + 0.03 * np.cos(scenario) + random.normal(0, 0.03, n)
    made = []
    for k, weight in enumerate((WEIGHTS, np.roll(WEIGHTS, 5))):
        probability = weight[scenario] / weight[scenario].sum()
        places = (
            sphere.to_binary(lon + 0.1 * k).astype(np.int32),
            sphere.to_binary(lat).astype(np.int32),
        )
        when = np.datetime64("2026-11-21T06:00") + np.timedelta64(k, "h")
        made.append(clouds.at(when, *places, probability, np.zeros(n, np.int32), scenario))
    return made


def test_maps_of_the_likeliest_and_of_all_others_add_up(snapshots: list[Snapshot]) -> None:
    made = build.build_forecast(snapshots, scenarios=NAMES)
    data, shown = made.data, dataset.displayed_scenarios(made.data)
    share = data["scenario_probability"].values
    np.testing.assert_allclose(
        share, [np.bincount(s.scenario, s.probability) for s in snapshots], rtol=1e-12
    )
    assert data["scenario_probability"].shape == (2, MANY)
    assert data["probability_by_scenario"].dims == ("time", "mapped_scenario", "lat", "lon")
    assert list(data["mapped_scenario"].values) == [*(NAMES[k] for k in shown.alone), "7 others"]
    np.testing.assert_allclose(
        data["probability_by_scenario"].sum("mapped_scenario"),
        data["probability"],
        rtol=1e-5,
        atol=1e-12,
    )
    np.testing.assert_allclose(
        data["probability_by_scenario"].sum(["lat", "lon"]), shown.sums(share), rtol=1e-4
    )  # of float32 in thousands of cells
    last = tables.summary_of_forecast(made)["outputs"][-1]["scenarios"]
    assert len(last) == 11
    assert last["7 others"]["probability"] == pytest.approx(share[-1, list(shown.rest)].sum())
    assert len(tables.summary_of_forecast(made)["scenarios"]) == MANY
    # ten equal scenarios and one more keep their maps: it is the same map, whoever is shown
    few = build.build_forecast(
        [
            clouds.at(s.time, s.lon, s.lat, s.probability, s.status, s.scenario * 5 // MANY)
            for s in snapshots
        ],
        scenarios=NAMES[:5],
    )
    np.testing.assert_allclose(few.data["probability"], data["probability"], rtol=1e-6, atol=1e-15)
    assert few.data["probability_by_scenario"].dims == ("time", "scenario", "lat", "lon")


def test_effective_numbers_of_families_by_scenario() -> None:
    """By brute force: the weights of a family add up within each scenario, one over the sum of
    squared shares.
    """
    random = np.random.default_rng(7)
    family, code = np.sort(random.integers(0, 40, 900)), random.integers(0, MANY + 3, 900)
    weight = random.gamma(0.3, size=900) * 1e-190  # whose squares underflow
    found = effective.effective_by_code(code, MANY + 4, weight, family)
    for k in range(MANY + 4):
        mass = [weight[(code == k) & (family == f)].sum() for f in range(40)]
        share = np.array(mass) / max(sum(mass), 1e-300)
        assert found[k] == pytest.approx(1 / (share**2).sum() if sum(mass) else 0.0)


def test_updates_of_the_others_are_those_of_their_mixture() -> None:
    """Two sorties by the law of total probability: evidence, POS, cumulative POS and posterior of
    the others as one.
    """
    random, prior = np.random.default_rng(8), WEIGHTS / WEIGHTS.sum()
    miss = random.uniform(0.2, 0.9, (2, MANY))
    before, so_far, every = prior, np.ones(MANY + 1), []
    for k, own in enumerate(miss):
        with_all = np.append(own, own @ before)
        so_far = so_far * with_all
        before = before * own / with_all[-1]
        every.append(
            Update(
                f"{k}", "sortie", np.datetime64("2026-11-21"), np.log(with_all), before, 9.0, 8.0, poc=0.5 + 0.5 * (1 - with_all),
                pos=1 - with_all, cumulative=1 - so_far,
            )
        )  # fmt: skip
    whole = Updates(tuple(NAMES), prior, tuple(every))
    told, shown = (
        search_updates.merge_unlikely_scenarios(whole),
        search_updates.displayed_scenarios_of(whole),
    )
    rest = list(shown.rest)
    first = (prior[rest] * miss[0, rest]).sum() / prior[rest].sum()
    both = (prior[rest] * miss[0, rest] * miss[1, rest]).sum() / prior[rest].sum()
    assert told.scenarios[-1] == "7 others"
    assert told.prior[-1] == pytest.approx(prior[rest].sum())
    assert told.all[0].log_evidence[-2] == pytest.approx(np.log(first))
    assert told.all[1].log_evidence[-2] == pytest.approx(np.log(both / first))
    assert told.all[1].pos[-2] == pytest.approx(1 - both / first)
    assert told.all[1].cumulative[-2] == pytest.approx(1 - both)
    assert told.all[1].posterior[-1] == pytest.approx(before[rest].sum())
    np.testing.assert_allclose(told.all[1].cumulative[:-2], every[1].cumulative[list(shown.alone)])
    assert told.all[1].cumulative[-1] == pytest.approx(every[1].cumulative[-1])
    assert search_updates.merge_unlikely_scenarios(told) is told  # eleven are few
