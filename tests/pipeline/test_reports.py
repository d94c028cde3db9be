"""Runs with winds and currents reported on scene, against closed forms and particles in NumPy."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from buoys import conditioned

import drift
from drift.case import file as case_file
from drift.engine.motion import simulate
from drift.engine.motion.errors.buoy_errors import Law, Sight, correlation
from drift.pipeline import report_effect, run_setup
from geo import sphere
from geo.errors import UserError
from geo.notation import KNOT
from kernels.runtime import runtime

HOUR = 3600.0
LON, LAT = 179.95, 0.02  # near the equator, where degrees are a plane; particles cross 180
METRES = np.radians(1.0) * sphere.RADIUS
STD, TIME, BIAS, ERROR = 0.22, 9 * HOUR, 0.06, 0.15  # of the current, and of a report of it [m/s]
N = 40_000
CASE = """
title = "A raft beside reports"
start = "2026-03-05T00:00Z"
duration = "{hours} h"
particles = {particles}
seed = {seed}
coast = {{ source = "none" }}
clock = {{ step = "{step}" }}
output = {{ every = "{hours} h" }}
[[current]]
constant = {{ speed = "0.4 kn", toward = 61 }}
[[wind]]
constant = {{ speed = "12 kn", from = 215 }}
[uncertainty]
current = {{ std = "0.22 m/s", time = "9 h", bias = "0.06 m/s", length = "{length}" }}
wind = {{ std = "2.3 m/s", time = "7 h", length = "{length}" }}
[[scenario]]
name = "raft"
object = {object}
position = {{ at = [179.95, 0.02], std = "500 m" }}
{more}
"""
CURRENT = 0.4 * KNOT * np.array([np.sin(np.radians(61)), np.cos(np.radians(61))])


def report(
    quantity: str, of: Any, at: tuple[float, float], time: float, error: float, name: str = "A"
) -> str:
    """Return the table of a report by components [m/s], made at a time [s after the start]."""
    moment = np.datetime64("2026-03-05T00:00:00") + np.timedelta64(int(time), "s")
    return (
        f'[[report]]\nname = "{name}"\n{quantity} = {{ east = {of[0]}, north = {of[1]} }}\n'
        f'at = [{at[0]}, {at[1]}]\ntime = "{moment}Z"\nerror = "{error} m/s"\n'
    )


def load(folder: Path, more: str, **keys: Any) -> drift.Case:
    """Return a case with reports."""
    words = {
        "hours": 16, "particles": N, "step": "30 min", "seed": 1, "length": "2000 km",
        "object": '"water"', **keys,
    }  # fmt: skip
    path = folder / "case.toml"
    path.write_text(words.pop("text", CASE).format(more=more, **words))
    return case_file.load(path)


def moved(folder: Path, more: str, **keys: Any) -> tuple[Any, np.ndarray]:
    """Return the start of a case's run, moved to its end, and its places there [m], (n, 2)."""
    case = load(folder, more, **keys)
    runtime.start()
    begin = run_setup.prepare(case, run_setup.open_for(case))
    list(simulate.run(begin.ensemble, begin.scene, begin.clock, np.empty(0)))
    begin.scene.forcing.close()
    lon = (begin.ensemble.lon.to_numpy() - sphere.to_binary(LON)).astype(np.int32)
    east, north = (
        np.degrees(x * sphere.UNIT) * METRES for x in (lon, begin.ensemble.lat.to_numpy())
    )
    return begin, np.stack([east, north - LAT * METRES], axis=-1)


def faded(time: float, memory: float, end: float) -> float:
    """Return the integral over a run of exp(-|t - time| / memory), by Gauss-Legendre in parts."""
    nodes, weights = np.polynomial.legendre.leggauss(24)
    total = 0.0
    for low, high in ((0.0, min(max(time, 0.0), end)), (min(max(time, 0.0), end), end)):
        t = low + (high - low) * (nodes + 1) / 2
        total += (high - low) / 2 * weights @ np.exp(-np.abs(t - time) / memory)
    return total


@pytest.mark.parametrize(
    ("time", "step"), [(-2.5 * HOUR, "30 min"), (7.25 * HOUR, "30 min"), (17.5 * HOUR, "1 h")]
)
def test_one_report_of_a_uniform_current(tmp_path: Path, time: float, step: str) -> None:
    """Where the errors are everywhere the same, displacements are normal, with known moments: before
    the run, within a step of it, and after it.
    """
    shown = np.array([0.31, -0.24])  # beyond the current
    more = report("current", CURRENT + shown, (179.97, 0.05), time, ERROR)
    _, own = moved(tmp_path, more, step=step)
    end = 16 * HOUR
    total = STD**2 + BIAS**2 + ERROR**2
    across = STD**2 * faded(time, TIME, end) + BIAS**2 * end
    mean = CURRENT * end + shown * across / total
    x = end / TIME
    alone = 2 * STD**2 * TIME**2 * (x - 1 + np.exp(-x)) + BIAS**2 * end**2 + 500**2
    variance = alone - across**2 / total
    # what is 50 km from the report is correlated with it by 0.996
    assert (np.abs(own.mean(axis=0) - mean) < 3.5 * np.sqrt(variance / N)).all()
    np.testing.assert_allclose(own.var(axis=0), variance, rtol=3.5 * np.sqrt(2 / N) + 4e-3)
    assert variance < 0.9 * alone


def test_a_report_of_the_wind_moves_what_feels_it(tmp_path: Path) -> None:
    """By its windage; the current's errors stay as they were."""
    shown, windage, error = np.array([4.1, 2.2]), 0.035, 1.4
    wind = 12 * KNOT * np.array([np.sin(np.radians(35)), np.cos(np.radians(35))])
    more = report("wind", wind + shown, (179.93, -0.01), 3.3 * HOUR, error)
    _, own = moved(tmp_path, more, object=f"{{ windage = {windage} }}")
    end, std, memory = 16 * HOUR, 2.3, 7 * HOUR
    across = std**2 * faded(3.3 * HOUR, memory, end)
    total = std**2 + error**2
    mean = (CURRENT + windage * wind) * end + windage * shown * across / total
    x, y = end / TIME, end / memory
    alone = 2 * STD**2 * TIME**2 * (x - 1 + np.exp(-x)) + BIAS**2 * end**2 + 500**2
    alone += windage**2 * 2 * std**2 * memory**2 * (y - 1 + np.exp(-y))
    variance = alone - (windage * across) ** 2 / total
    assert (np.abs(own.mean(axis=0) - mean) < 3.5 * np.sqrt(variance / N)).all()
    np.testing.assert_allclose(own.var(axis=0), variance, rtol=3.5 * np.sqrt(2 / N) + 4e-3)


def expected(sights: list[Sight], places: np.ndarray, law: Law, dt: float, hours: float) -> Any:
    """Return places [m] (n, 2) at the end of particles whose errors are drawn given reports.

    places: of the reports [m from the datum], (m, 2).
    """
    m, times = len(places), np.arange(0, hours * HOUR + dt / 2, dt)
    between = correlation(np.hypot(*(places[:, None] - places).T), law.current_length)
    mean, covariance, _ = conditioned(
        law, (between, np.eye(m)), np.zeros(0), np.zeros(0), [], times, sights
    )
    k = times.size
    pick = np.array(
        [[3 * m * t + j for j in range(m)] for t in range(k)] + [[2 * m + j for j in range(m)]]
    )
    own = covariance[np.ix_(pick.ravel(), pick.ravel())]
    root = np.linalg.cholesky(own + 1e-10 * np.eye(own.shape[0]))
    random = np.random.default_rng(11)
    drawn = np.einsum("ij,jnc->inc", root, random.normal(size=(own.shape[0], N, 2)))
    drawn = (mean[pick.ravel(), 0][:, None] + drawn).reshape(k + 1, m, N, 2)
    mix = np.linalg.inv(np.linalg.cholesky(between))
    place = random.normal(size=(N, 2)) * 500

    def shared(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return what the values at the reports give at the particles, and the share left."""
        near = correlation(
            np.hypot(*(place[None] - places[:, None]).transpose(2, 0, 1)), law.current_length
        )
        weight = mix @ near
        left = np.sqrt(1 - (weight**2).sum(axis=0))[:, None]
        return np.einsum("jn,jb,bnc->nc", weight, mix, values), left

    given, left = shared(drawn[-1])
    lasts = law.bias_std * (given + left * random.normal(size=(N, 2)))
    given, left = shared(drawn[0])
    present, keep = given + left * random.normal(size=(N, 2)), np.exp(-dt / law.current_time)
    for step in range(k - 1):
        given, left = shared((drawn[step + 1] - keep * drawn[step]) / np.sqrt(1 - keep**2))
        kick = given + left * random.normal(size=(N, 2))
        later = keep * present + np.sqrt(1 - keep**2) * kick
        place = place + dt * (CURRENT + lasts + law.current_std * 0.5 * (present + later))
        present = later
    return place


@pytest.mark.thorough
@pytest.mark.parametrize("step", ["30 min", "10 min"])
def test_a_cloud_that_passes_two_reports(tmp_path: Path, step: str) -> None:
    """Mean and covariance, at two steps; it is 3 km from one and passes the other."""
    places = np.array([[2_000.0, -2_200.0], [9_000.0, 6_500.0]])
    law = Law(STD, TIME, 8_000.0, BIAS, 0.0, 1.0, 1e5, 0.0)
    sights = [
        Sight(0, 1.25 * HOUR, False, np.array([[0.3, 0.1]]), 0.1),
        Sight(1, 6.0 * HOUR, False, np.array([[-0.2, 0.25]]), 0.05),
    ]
    more = "".join(
        report(
            "current", CURRENT + sight.excess[0],
            (LON + place[0] / METRES - 360 * (LON + place[0] / METRES > 180), LAT + place[1] / METRES),
            sight.time, sight.error, str(sight.place),
        )
        for sight, place in zip(sights, places, strict=True)
    )  # fmt: skip
    _, own = moved(tmp_path, more, step=step, length="8 km", hours=12)
    compare(own, expected(sights, places, law, 600.0, 12))


def compare(own: np.ndarray, other: np.ndarray) -> None:
    """Hold mean and covariance of two clouds to 3.5 standard errors of their difference."""
    for axis in range(2):
        error = np.hypot(own[:, axis].std(), other[:, axis].std()) / np.sqrt(len(own))
        assert abs(own[:, axis].mean() - other[:, axis].mean()) < 3.5 * error
    a, b = own - own.mean(axis=0), other - other.mean(axis=0)
    for i, j in ((0, 0), (0, 1), (1, 1)):
        one, two = a[:, i] * a[:, j], b[:, i] * b[:, j]
        error = np.hypot(one.std(), two.std()) / np.sqrt(len(own))
        assert abs(one.mean() - two.mean()) < 3.5 * error, (i, j)


MEMBERS = """members = [{{ constant = {{ speed = "0.4 kn", toward = 61 }} }}, {{ constant = {{ speed = "0.9 kn", toward = 40 }} }},
 {{ constant = {{ speed = "0.3 kn", toward = 200 }} }}]"""


def test_members_are_weighted_by_reports(tmp_path: Path) -> None:
    """By the normal density of the residual in each."""
    currents = [
        knots * KNOT * np.array([np.sin(np.radians(way)), np.cos(np.radians(way))])
        for knots, way in ((0.4, 61), (0.9, 40), (0.3, 200))
    ]
    seen = np.array([0.33, 0.21])
    text = CASE.replace('constant = {{ speed = "0.4 kn", toward = 61 }}', MEMBERS)
    more = report("current", seen, (179.97, 0.05), 2 * HOUR, ERROR)
    begin, _ = moved(tmp_path, more, text=text, particles=600, hours=3)
    weight = np.exp(begin.ensemble.log_weight.to_numpy().astype(float))
    found = np.bincount(begin.ensemble.own["member"].to_numpy(), weight)
    total = STD**2 + BIAS**2 + ERROR**2
    density = np.exp([-0.5 * ((seen - current) ** 2).sum() / total for current in currents])
    np.testing.assert_allclose(found / found.sum(), density / density.sum(), rtol=1e-5)
    assert density.max() < 0.9 * density.sum()


def test_a_scenario_without_wind_is_as_likely_as_before(tmp_path: Path) -> None:
    """A report of the wind says nothing of what does not feel it."""
    more = (
        report("wind", (9.0, 3.0), (179.93, -0.01), HOUR, 1.2)
        + """
[[scenario]]
name = "sunk low"
object = "water"
weight = 0.25
position = { at = [179.95, 0.02], std = "1 km" }
"""
    )
    begin, _ = moved(tmp_path, more, object="{ windage = 0.03 }", particles=400, hours=2)
    weight = np.exp(begin.ensemble.log_weight.to_numpy().astype(float))
    found = np.bincount(begin.ensemble.scenario.to_numpy(), weight)
    np.testing.assert_allclose(found / found.sum(), [0.8, 0.2], rtol=1e-5)


def test_reports_off_the_forcing_are_rejected(tmp_path: Path) -> None:
    """Where and when it has no value; what the message says of its times is true."""
    table = """table = [{{ time = "2026-03-04T22:00Z", speed = "0.4 kn", toward = 61 }},
 {{ time = "2026-03-05T20:00Z", speed = "0.6 kn", toward = 50 }}]"""
    text = CASE.replace('constant = {{ speed = "0.4 kn", toward = 61 }}', table)
    more = report("current", (0.3, 0.1), (179.97, 0.05), -3 * HOUR, ERROR)
    with pytest.raises(
        UserError,
        match=r'case.toml: report "A": the current of the case has no value at 042100ZMAR26; it lasts from 042200ZMAR26 to 052000ZMAR26',
    ):
        moved(tmp_path, more, text=text, particles=200, hours=2)
    moved(tmp_path, more.replace("T21:", "T22:"), text=text, particles=200, hours=2)


@pytest.mark.thorough
def test_the_summary_and_the_report_say_what_each_changed(tmp_path: Path) -> None:
    """Of a residual, and of one that is odd."""
    shown = np.array([0.2, 0.1])
    more = report("current", CURRENT + shown, (179.97, 0.05), HOUR, ERROR, "near")
    more += report("current", CURRENT + 6 * shown, (179.5, 0.9), 2 * HOUR, ERROR, "odd one")
    case = load(tmp_path, more, particles=2000, hours=6, length="8 km")
    result = drift.run(case)
    found = result.summary["reports"]
    near, odd = found["reports"]
    assert (near["name"], near["time"]) == ("near", "2026-03-05T01:00:00")
    assert near["residual_m_s"] == pytest.approx(np.hypot(*shown), rel=1e-6)
    assert near["residual_toward_deg"] == pytest.approx(np.degrees(np.arctan2(*shown)), abs=1e-4)
    total = STD**2 + BIAS**2 + ERROR**2
    assert near["expected_residual_m_s"] == pytest.approx(np.sqrt(total), rel=1e-9)
    # the other is 110 km away; the report's time is a step
    weight = (STD**2 + BIAS**2) / total
    assert near["correction_m_s"] == pytest.approx(weight * np.hypot(*shown), rel=1e-6)
    assert near["error_before_m_s"] == pytest.approx(np.hypot(STD, BIAS))
    left = np.sqrt((STD**2 + BIAS**2) * (1 - weight))
    assert near["error_left_m_s"] == pytest.approx(left, rel=1e-6)
    assert near["chance"] == pytest.approx(np.exp(-0.5 * (shown**2).sum() / total), rel=1e-6)
    assert odd["chance"] < 0.01
    (warning,) = [line for line in result.summary["warnings"] if "odd" in line]
    assert warning.startswith(
        'report "odd one" is odd: the current at 050200ZMAR26 differed from that of the case by 2.61 kn toward 063'
    )
    areas = found["area_nmi2"]
    assert areas["with"]["95%"] < 0.95 * areas["without"]["95%"]
    assert near["area_nmi2_without_it"]["95%"] > areas["with"]["95%"]
    assert odd["area_nmi2_without_it"]["95%"] == pytest.approx(areas["with"]["95%"], rel=0.1)
    layer, table = report_effect.reports_bundle(found, case.reports).leaves[0]()
    assert [f["properties"]["name"] for f in layer["features"]] == ["near", "odd one"]
    assert table["rows"][0][:4] == ["near", "current", "050100ZMAR26", "0.43 kn toward 063"]
