"""Changes of state on the way: when they come, what drifts then, and where it leads."""

from pathlib import Path

import numpy as np
import pytest
import trial_case
from changing import FAR, HOUR, HULL, KEEL, PLAIN, TOWARD, W, case, column, end_of, within
from filtered import run
from scipy import integrate, stats

from drift.engine.particles.ensemble import Ensemble
from drift.engine.particles.status import Status
from geo import sphere


@pytest.mark.thorough
@pytest.mark.parametrize("step", ["5 min", "40 min"])
@pytest.mark.parametrize("wind", [{}, {"wind": "19 m/s", "width": "1.7 m/s"}], ids=["rate", "wind"])
def test_a_constant_hazard_by_its_closed_form(
    tmp_path: Path, step: str, wind: dict[str, str]
) -> None:
    ensemble = end_of(
        tmp_path,
        [{"name": "capsized", "rate": "0.13/h", "object": HULL, **wind}],
        clock={"step": step},
    )
    rate = 0.13 / (1 + np.exp(2 / 1.7)) if wind else 0.13
    came, state = column(ensemble, "changed_1"), column(ensemble, "state")
    assert within((state == 1).mean(), 1 - np.exp(-rate * 6), ensemble.n)
    law = stats.truncexpon(6 * rate, scale=HOUR / rate)
    assert stats.kstest(came[state == 1], law.cdf).pvalue > 1e-3
    assert ((came < 6 * HOUR) == (state == 1)).all()


@pytest.mark.thorough
def test_a_change_comes_at_the_same_second_at_any_step(tmp_path: Path) -> None:
    """Whole seconds; the sum of the hazard rounds in its last digits."""
    change = {"name": "capsized", "rate": "0.4/h", "object": HULL}
    by_wind = change | {"wind": "16 m/s"}
    sinks = {"name": "sunk", "rate": "0.4/h", "sinks": True}
    for own, most in ((change, 0.0), (by_wind, 1.0), (sinks, 0.0)):
        fine, coarse = (
            column(end_of(tmp_path, [own], clock={"step": step}), "changed_1")
            for step in ("5 min", "1 h")
        )
        assert np.abs(fine - coarse).max() <= most


@pytest.mark.parametrize("step", ["10 min", "1 h"])
def test_a_wind_that_rises_by_its_integral(tmp_path: Path, step: str) -> None:
    """The wind grows from 6 to 24 m/s in 9 h, and turns: shares and times by quadrature."""
    table = [
        {"time": "+0 h", "speed": "6 m/s", "from": 210},
        {"time": "+9 h", "speed": "24 m/s", "from": 243},
    ]
    change = {"name": "swamped", "rate": "0.7/h", "wind": "15 m/s", "width": "2.1 m/s"}
    ensemble = end_of(
        tmp_path, [change], duration="9 h", clock={"step": step}, wind={"table": table}
    )
    begin, end = (
        speed * np.array([np.sin(np.radians(origin)), np.cos(np.radians(origin))])
        for speed, origin in ((6, 210), (24, 243))
    )
    hours = np.linspace(0, 9, 901)
    wind = np.hypot(*(begin[:, None] + hours / 9 * (end - begin)[:, None]))
    spent = integrate.cumulative_simpson(0.7 / (1 + np.exp((15 - wind) / 2.1)), x=hours, initial=0)
    came, state = column(ensemble, "changed_1") / HOUR, column(ensemble, "state")
    assert within((state == 1).mean(), 1 - np.exp(-spent[-1]), ensemble.n)
    law = (1 - np.exp(-spent)) / (1 - np.exp(-spent[-1]))
    assert stats.kstest(came[state == 1], lambda t: np.interp(t, hours, law)).pvalue > 1e-3


@pytest.mark.parametrize("step", ["6 min", "1 h"])
def test_it_drifts_in_each_state_for_as_long_as_that_lasts(tmp_path: Path, step: str) -> None:
    """Every particle by itself: downwind by the slopes of its states, whatever the step.

    Where a particle was at the begin comes from the same case without wind. Tolerance: 5 mm a step
    of rounding, and 1 in 10^4 of the way for the curvature of the Earth.
    """
    changes = [
        {"name": "capsized", "rate": "0.3/h", "object": HULL},
        {"name": "swamped", "from": "capsized", "rate": "0.5/h", "leeway": 0.4},
    ]
    ensemble = end_of(tmp_path, changes, clock={"step": step})
    begin = end_of(tmp_path, [], duration="1 h", wind=None, scenario={"object": "water"})
    lon, lat, first_lon, first_lat = (
        column(which, name) * sphere.UNIT for which in (ensemble, begin) for name in ("lon", "lat")
    )
    capsized, swamped = (np.minimum(column(ensemble, f"changed_{k}"), 6 * HOUR) for k in (1, 2))
    assert min((capsized < 6 * HOUR).sum(), (swamped < 6 * HOUR).sum()) > 500
    way = W * (0.03 * capsized + 0.011 * (swamped - capsized) + 0.4 * 0.011 * (6 * HOUR - swamped))
    east, north = sphere.offset(first_lon, first_lat, lon, lat)
    along = east * np.sin(TOWARD) + north * np.cos(TOWARD)
    assert np.abs(along - way).max() < 5e-3 * 60 + 1e-4 * way.max()


def test_changes_that_compete_and_follow_one_another(tmp_path: Path) -> None:
    """Capsized or swamped first, and swamped from both: occupation by the matrix exponential."""
    from scipy.linalg import expm

    changes = [
        {"name": "capsized", "rate": "0.25/h", "object": HULL},
        {"name": "swamped", "from": ["unchanged", "capsized"], "rate": "0.15/h", "leeway": 0.5},
        {"name": "sunk", "from": "swamped", "rate": "0.4/h", "wind": "17 m/s", "sinks": True},
    ]
    ensemble = end_of(tmp_path, changes, duration="8 h", clock={"step": "24 min"}, particles=8000)
    rates = np.zeros((4, 4))
    for here, there, rate in ((0, 1, 0.25), (0, 2, 0.15), (1, 2, 0.15), (2, 3, 0.2)):
        rates[here, there] += rate
        rates[here, here] -= rate
    wanted = expm(8 * rates)[0]
    state = column(ensemble, "state")
    for number, share in enumerate(wanted):
        assert within((state == number).mean(), share, ensemble.n), number
    status, since = column(ensemble, "status"), column(ensemble, "status_since")
    assert ((status == Status.SUNK) == (state == 3)).all()
    assert (status[state < 3] == Status.ADRIFT).all()
    np.testing.assert_array_equal(since[state == 3], column(ensemble, "changed_3")[state == 3])


@pytest.fixture(scope="module")
def capsized_and_left(tmp_path_factory: pytest.TempPathFactory) -> Ensemble:
    """The end of a run in which a raft capsizes, persons are in the water later, and sink."""
    changes = [
        {"name": "capsized", "at": ["+1 h", "+3 h"], "leeway": 0.5},
        {
            "name": "in the water",
            "from": "capsized",
            "after": {"low": "20 min", "best": "50 min", "high": "2 h", "ratio": 5},
            "object": "PIW-1",
        },
        {"name": "sunk", "from": "in the water", "at": "+330 min", "sinks": True},
    ]
    folder = tmp_path_factory.mktemp("left")
    return end_of(folder, changes, clock={"step": "30 min"}, particles=8000)


@pytest.mark.thorough
def test_times_that_the_case_gives(capsized_and_left: Ensemble) -> None:
    """At a time, in a window, and after the begin of a state: a triangle by its distribution."""
    ensemble = capsized_and_left
    first, second, third = (column(ensemble, f"changed_{k}") for k in (1, 2, 3))
    assert stats.kstest(first / HOUR, stats.uniform(1, 2).cdf).pvalue > 1e-3
    low, best, high = 1 / 3, 5 / 6, 2.0
    flat = stats.uniform(low, high - low)
    peak = stats.triang((best - low) / (high - low), low, high - low)
    law = lambda t: 2 / 6 * flat.cdf(t) + 4 / 6 * peak.cdf(t)  # noqa: E731
    assert stats.kstest((second - first) / HOUR, law).pvalue > 1e-3
    np.testing.assert_array_equal(third, 5.5 * HOUR)  # the edge of a step
    assert (column(ensemble, "status") == Status.SUNK).all()


def test_the_lines_of_the_new_class_are_its_published_ones(capsized_and_left: Ensemble) -> None:
    """Means and spreads of the slopes that are drawn at the change: of PIW-1, from its row."""
    from drift.engine.motion.objects import leeway

    ensemble = capsized_and_left
    for name in ("down", "right", "left"):
        line = getattr(leeway.find_class("PIW-1"), name)
        slope, offset = (column(ensemble, f"{name}_{what}") for what in ("slope", "offset"))
        least = 0 if name == "down" else -np.inf
        wanted = stats.truncnorm(
            (least - line.slope) / line.slope_std, np.inf, line.slope, line.slope_std
        )
        assert stats.kstest(slope, wanted.cdf).pvalue > 1e-3, name
        xi = (slope - line.slope) / line.slope_std
        # float32: the slope's rounding, divided by its spread
        bound = 4e-7 * abs(line.slope / line.slope_std) * line.offset_std + 1e-6
        assert np.abs(offset - line.offset - line.offset_std * xi).max() < bound


@pytest.mark.thorough
def test_a_change_that_never_comes_moves_no_bit(tmp_path: Path) -> None:
    errors = {"uncertainty": {"current": {"std": "0.2 kn"}, "wind": {"std": "3 kn"}}}
    plain = {**PLAIN, **errors, "scenario": {"object": "LIFE-RAFT-DB-10"}}
    bare = run(trial_case.load(tmp_path, **plain))[1]
    never = {"name": "sunk", "rate": "1e-30/h", "wind": "40 m/s", "width": "1 m/s", "sinks": True}
    changing = end_of(tmp_path, [never], **errors, scenario={"object": "LIFE-RAFT-DB-10"})
    for name in bare.columns:
        np.testing.assert_array_equal(column(bare, name), column(changing, name), name)


def test_the_wind_that_counts_has_its_error(tmp_path: Path) -> None:
    """The hazard's mean over a normal error of the wind, far above that in the mean wind.

    In an hour the error hardly changes (its decorrelation takes 4 d). Mean probability by
    quadrature over two components.
    """
    change = {"name": "sunk", "rate": "0.9/h", "wind": "26 m/s", "width": "1 m/s", "sinks": True}
    uncertainty = {"current": {"std": 0}, "wind": {"std": "5 m/s", "time": "96 h"}}
    tables = {"uncertainty": uncertainty, "scenario": {"object": "LIFE-RAFT-DB-10"}}
    ensemble = end_of(tmp_path, [change], duration="1 h", particles=20_000, **tables)
    node, weight = np.polynomial.hermite_e.hermegauss(60)
    speed = np.hypot(W + 5 * node[:, None], 5 * node[None, :])
    chance = 1 - np.exp(-0.9 / (1 + np.exp(26 - speed)))
    wanted = weight @ chance @ weight / weight.sum() ** 2
    assert within((column(ensemble, "state") == 1).mean(), float(wanted), ensemble.n)
    steady = 1 - np.exp(-0.9 / (1 + np.exp(26 - W)))
    assert wanted > 20 * steady


def test_positions_by_brute_force(tmp_path: Path) -> None:
    """Means and spread of the cloud against 200,000 objects in NumPy, downwind."""
    change = {"name": "capsized", "rate": "0.5/h", "wind": "16 m/s", "object": HULL}
    tables = {"scenario": {"position": {"at": "27 30N 088 00W", "std": "1 m"}}}
    ensemble = end_of(tmp_path, [change], **tables, clock={"step": "45 min"})
    rng = np.random.default_rng(8)
    wait = rng.exponential(1 / (0.5 / (1 + np.exp(-1 / 2.5))), 200_000)
    hours = np.minimum(wait, 6)
    wanted = W * HOUR * (0.03 * hours + 0.011 * (6 - hours))
    lon, lat = (column(ensemble, name) * sphere.UNIT for name in ("lon", "lat"))
    east, north = sphere.offset(np.radians(-88.0), np.radians(27.5), lon, lat)
    along = east * np.sin(TOWARD) + north * np.cos(TOWARD)
    error = np.hypot(along.std() / np.sqrt(along.size), wanted.std() / np.sqrt(wanted.size))
    assert abs(along.mean() - wanted.mean()) < FAR * error
    fourth = ((wanted - wanted.mean()) ** 4).mean() / wanted.var() ** 2
    spread = np.sqrt((fourth - 1) * (1 / along.size + 1 / wanted.size)) * wanted.var()
    assert abs(along.var() - wanted.var()) < FAR * spread


def test_debris_does_not_change(tmp_path: Path) -> None:
    """A find of debris beside a raft that capsizes runs, and its particles keep their lines."""
    own = case(
        tmp_path,
        [{"name": "capsized", "at": "+1 h", "object": HULL}],
        '[[contact]]\nname = "oar"\ntime = "+4 h"\nof = "PERSON-POWERED-VESSEL-1"\n'
        '[contact.position]\nat = "27 40N 087 40W"\nerror = "9 nmi"',
        scenario={"object": KEEL},
    )
    search, ensemble, _ = run(own)
    assert (column(ensemble, "state") == 1).all()
    (beside,) = search._debris.values()
    assert "state" not in beside.ensemble.own
