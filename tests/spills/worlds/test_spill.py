"""A whole spill, from case to washup, against an independent sampler of its closed form; finds; a
renewal of worlds.
"""

from pathlib import Path

import numpy as np
import pytest
from spills import METRE, case_of, sampled

import drift
from drift.spills.worlds import renewal, washup

pytestmark = pytest.mark.usefixtures("coarse_maps")  # no number is read off a map


@pytest.fixture(scope="module")
def straight(tmp_path_factory: pytest.TempPathFactory) -> drift.Result:
    return drift.run(case_of(tmp_path_factory.mktemp("straight")))


@pytest.mark.thorough
def test_arrival_times_and_numbers_on_a_straight_coast_are_those_of_the_closed_form(
    straight,
) -> None:
    """All within three standard errors as the products state them, added to the sampler's own."""
    data, worlds = straight.washup, 20_000
    rng = np.random.default_rng(11)
    time, place = sampled(worlds, 60, rng)
    seconds = (data["time"].values - data["start"].values) / np.timedelta64(1, "s")
    fates = [str(f) for f in data["fate"].values]
    for k, until in enumerate(seconds):
        number = (time <= until).sum(1)
        total = data["total"].values[fates.index("ashore"), k]
        error = np.hypot(
            data["total_se"].values[fates.index("ashore"), k], number.std() / np.sqrt(worlds)
        )
        assert abs(total - number.mean()) <= 3 * error + 1e-9
    # Stretch by stretch at the end of the run.
    tested = 0
    for k in range(data.sizes["segment"]):
        at = data.isel(segment=k, time=-1)
        length = float(at["length"])
        middle = float(at["lat"]) / METRE
        here = (time <= seconds[-1]) & (np.abs(place - middle) < length / 2)
        number = here.sum(1)
        if number.mean() < 0.5 or abs(float(at["lon"])) > 1e-6:
            continue
        tested += 1
        expected_error = np.hypot(float(at["expected_se"]), number.std() / np.sqrt(worlds))
        assert abs(float(at["expected"]) - number.mean()) < 3 * expected_error
        some = (number > 0).mean()
        some_error = np.hypot(float(at["probability_se"]), np.sqrt(some * (1 - some) / worlds))
        assert abs(float(at["probability"]) - some) < 3 * some_error + 1e-9
        first = np.where(here, time, np.inf).min(1)
        came = np.sort(first[np.isfinite(first)])
        for share, found in zip(data["quantile"].values, at["first_arrival"].values, strict=True):
            seconds_in = float(found) - data["start"].values.astype("datetime64[s]").astype(float)
            below = np.searchsorted(came, seconds_in) / came.size
            many = float(at["effective_arrivals"])
            assert abs(below - share) < 3 * np.sqrt(
                share * (1 - share) * (1 / many + 1 / came.size)
            )
    assert tested >= 3


@pytest.mark.thorough
def test_every_world_adds_up(straight) -> None:
    total = straight.washup["world_total"].values
    assert (total.sum(-1) == 60).all()


@pytest.mark.thorough
def test_finds_draw_the_forecast_to_where_they_were_and_the_odd_one_is_called_odd(
    tmp_path: Path, straight
) -> None:
    """Objects found in the north say that the current sets north; one far in the south is noticed."""
    finds = "\n".join(
        f'[[find]]\nname = "{name}"\nat = [0.0, {lat}]\ntime = "+{hours} h"'
        for name, lat, hours in (
            ("one", 0.09, 40),
            ("two", 0.10, 44),
            ("three", 0.09, 50),
            ("odd", -0.30, 55),
        )
    )
    rate = '[spill.reporting]\nrate = { wild = "0.5 /day" }'
    result = drift.run(case_of(tmp_path, f"{rate}\n{finds}", worlds=600))
    told = {surprise.find.name: surprise for surprise in result.aftermath.surprises}
    assert told["odd"].tail < 0.02 < told["two"].tail
    numbers = renewal.summary_of_spill(result.aftermath)["spill"]
    assert [find["odd"] for find in numbers["finds"]] == [False, False, False, True]
    # The map's particles are those of the washup: what is afloat, ashore and sunk of those not
    # found or destroyed. Both are Monte Carlo: three standard errors of the washup's.
    data, account = result.washup.isel(time=-1), result.summary["account"]
    total, error = (
        dict(zip(data["fate"].values.tolist(), data[f"total{x}"].values.tolist(), strict=True))
        for x in ("", "_se")
    )
    left = total["afloat"] + total["ashore"] + total["sunk"] + total["pending"] + total["gone"]
    for fate, status in (("afloat", "adrift"), ("ashore", "ashore"), ("sunk", "sunk")):
        assert abs(account[status] - total[fate] / left) < 3 * error[fate] / left
    without = drift.run(
        case_of(tmp_path, f"{rate}\n" + finds.split('[[find]]\nname = "odd"')[0], worlds=600)
    )
    before, after = (
        one.aftermath.worlds.current_north @ one.aftermath.posterior.weight
        for one in (straight, without)
    )
    assert after > before + 0.005

    def north_of(data, lat: float) -> float:
        at = data.isel(time=-1)
        return float(
            at["expected"].values[at["lat"].values > lat].sum() / at["expected"].values.sum()
        )

    assert north_of(without.washup, 0.09) > north_of(straight.washup, 0.09) + 0.05
    assert (without.washup["world_total"].values.sum(-1) == 60).all()
    assert (
        without.washup["world_total"].values[
            ..., [str(f) for f in without.washup["fate"].values].index("found")
        ]
        == 3
    ).all()


@pytest.mark.thorough
def test_worlds_are_drawn_anew_where_too_few_count(tmp_path: Path) -> None:
    """A release that is vague by 40 km and ten finds close together: few worlds of 500 count, then
    enough do.
    """
    finds = "\n".join(
        f'[[find]]\nat = [0.0, {0.2 + 0.01 * k}]\ntime = "+{40 + 2 * k} h"' for k in range(10)
    )
    rate = '[spill.reporting]\nrate = { wild = "0.5 /day" }'
    case = case_of(tmp_path, f"{rate}\n{finds}", worlds=500, per_world=100)
    text = (
        case.path.read_text()
        .replace('std = "4 km"', 'std = "40 km"')
        .replace("0.04 m/s", "0.08 m/s")
    )
    case.path.write_text(text)
    after = drift.run(drift.load(case.path)).aftermath
    print(after.rounds)
    assert after.rounds[0] < renewal.FEWEST < after.rounds[-1]
    assert after.posterior.effective == after.rounds[-1]
    assert (after.worlds.log_weight != 0).any()
    # Importance weights correct for where the new worlds were drawn: the release stays within the
    # prior's reach.
    lat = after.worlds.lat * 360 / 2**32 / METRE
    assert abs(after.posterior.weight @ lat - 0.03 / METRE) < 3 * 40_000


def test_washup_of_no_world_is_that_of_all_when_weights_are_even(straight) -> None:
    assert straight.aftermath.posterior.effective == pytest.approx(1500)
    assert straight.washup.sizes["world"] == 1500
    assert (
        list(washup.worst_stretches(straight.washup, 2))
        == sorted(
            range(straight.washup.sizes["segment"]),
            key=lambda k: -straight.washup["expected"].values[-1, k],
        )[:2]
    )
