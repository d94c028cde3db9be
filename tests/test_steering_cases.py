"""Shipped cases of targets that steer, against a second opinion in plain float64
(tests/oracles/second_opinions/passages.py).

Had nothing been searched or seen: at two times, by scenario, what has become of them, where they
are on average, and second moments. Then, given all that was: the posterior of the scenarios, mean
and second moments. overdue_yacht goes on adrift: it stands in test_case_oracles.py.
"""

import functools

import numpy as np
import pytest
from oracle import R
from scipy import stats
from steered_cases import ORACLES, THEIRS, Array, Where, table
from steered_posteriors import END, POSTERIORS

from drift.case import file as case_file
from drift.engine.particles.status import Status
from drift.pipeline import flow

OURS = 16_000  # particles in all
COMPARED = (
    # numbers that the tests compare; together they are as sure as three standard errors hold one
    # (Bonferroni)
    400
)
SIGMAS = stats.norm.isf(stats.norm.sf(3.0) / COMPARED)  # 4.5
MIDWAY = {"cast_submarine": 19.0, "medsearch_transit": 97.0, "smuggler_bridge": 71.0}  # [h]


@functools.cache
def ours(name: str) -> dict[float, list[Where]]:
    """Return what drift.run says midway and at the end, by scenario, had nothing been searched or
    seen.
    """
    settings = {"particles": str(OURS), "expect": "{}", "resampling": "{}"}
    settings |= dict.fromkeys(("sortie", "contact", "look", "presence", "barrier"), "[]")
    output = f'{{ times = ["+{MIDWAY[name]:g} h"], trajectories = 1_000_000 }}'
    loaded = case_file.load(name, settings | {"output": output})
    tracks = flow.run(loaded).trajectories
    told: dict[float, list[Where]] = {}
    for hours in (MIDWAY[name], END[name]):
        (k,) = np.flatnonzero(
            tracks.time == loaded.start + np.timedelta64(round(hours * 3600), "s")
        )
        lon, lat = (x[:, k].astype(float) * 360 / 2**32 for x in (tracks.lon, tracks.lat))
        stories = [tracks.scenario == scenario for scenario in range(len(loaded.scenarios))]
        told[hours] = [Where(lon[here], lat[here], tracks.status[here, k]) for here in stories]
    return told


def numbers(told: Where, about: tuple[float, float]) -> tuple[list[str], Array, Array]:
    """Return names, values and standard errors: shares by status, and mean and second moments [m]
    in a plane about a place.
    """
    names, values, errors = [], [], []
    n = told.lon.size
    for status in Status:
        share = float((told.status == status).mean())
        names.append(status.name)
        values.append(share)
        errors.append(np.sqrt(share * (1 - share) / n))
    there = told.status != Status.PENDING
    x = (told.lon[there] - about[0]) * np.radians(R) * np.cos(np.radians(about[1]))
    y = (told.lat[there] - about[1]) * np.radians(R)
    a, b = x - x.mean(), y - y.mean()
    for what, values_of in (
        ("east", x),
        ("north", y),
        ("east 2", a * a),
        ("north 2", b * b),
        ("both", a * b),
    ):
        names.append(what)
        values.append(float(values_of.mean()))
        errors.append(float(values_of.std() / np.sqrt(there.sum())))
    return names, np.array(values), np.array(errors)


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("name", "hours"),
    [*END.items(), *(pytest.param(*one, marks=pytest.mark.thorough) for one in MIDWAY.items())],
)
def test_case_is_where_a_second_opinion_says(name: str, hours: float) -> None:
    rng = np.random.default_rng([20_260_603, int(hours)])
    theirs = ORACLES[name](rng, THEIRS[name], hours)
    found = ours(name)[hours]
    assert len(found) == len(theirs) == len(table(name)["scenario"])
    for number_of, (mine, their) in enumerate(zip(found, theirs, strict=True)):
        middle = float(their.lon.mean()), float(their.lat.mean())
        names, a, e = numbers(mine, middle)
        _, b, f = numbers(their, middle)
        apart = (a - b) / np.maximum(np.hypot(e, f), 1e-300)
        lines = [
            f"{what}: {p:.6g}, oracle {q:.6g}: {z:+.1f}"
            for what, p, q, z in zip(names, a, b, apart, strict=True)
        ]
        assert (np.abs(apart[a != b]) < SIGMAS).all(), (number_of, lines)


SEEN = {
    "cast_submarine": (12_000, 24_000),
    "medsearch_transit": (5_000, 40_000),
    "smuggler_bridge": (30_000, 30_000),
}  # particles: theirs, ours


@pytest.mark.thorough
@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=[pytest.mark.thorough] * (name != "cast_submarine"))
        for name in POSTERIORS
    ],
)
def test_what_was_seen_says_what_a_second_opinion_says(name: str) -> None:
    """Posterior of the scenarios, what has arrived, mean and second moments at the end, given all
    sensors and contacts.
    """
    n, particles = SEEN[name]
    theirs, chances = POSTERIORS[name](np.random.default_rng(20_260_606), n)
    settings = {"particles": str(particles), "resampling": "{}", "expect": "{}"}
    loaded = case_file.load(
        name, settings | {"output": '{ every = "100 d", trajectories = 1_000_000 }'}
    )
    tracks = flow.run(loaded).trajectories
    mine = [tracks.scenario == k for k in range(len(loaded.scenarios))]
    lon, lat = (x[:, -1].astype(float) * 360 / 2**32 for x in (tracks.lon, tracks.lat))
    found = told(
        [Where(lon[k], lat[k], tracks.status[k, -1]) for k in mine],
        [tracks.weight[k, -1].astype(float) for k in mine],
    )
    expected = told(theirs, chances)
    apart = (found[0] - expected[0]) / np.maximum(np.hypot(found[1], expected[1]), 1e-300)
    assert (np.abs(apart[found[0] != expected[0]]) < SIGMAS).all(), (found, expected, apart)
    before = np.array([one.get("weight", 1.0) for one in table(name)["scenario"]])[:-1]
    # what was seen says something of the scenarios, where there are several
    there = slice(0, before.size)
    assert not before.size or (np.abs(found[0][there] - before) > 10 * found[1][there]).any()


def told(where: list[Where], weight: list[Array]) -> tuple[Array, Array]:
    """Return the shares of all scenarios but the last and of what has arrived, mean place and
    second moments, with standard errors.

    They are ratios of weighted sums, linearised by scenario.
    """
    total, stories = sum(float(w.sum()) for w in weight), np.eye(len(where))[:, :-1]
    middle = [
        sum(w @ x for w, x in zip(weight, xs, strict=True)) / total
        for xs in zip(*((p.lon, p.lat) for p in where), strict=True)
    ]
    columns = []
    for story, one in zip(stories, where, strict=True):
        x, y = one.lon - middle[0], one.lat - middle[1]
        shares = np.tile(story, (x.size, 1))
        columns.append(
            np.column_stack(
                [shares, one.status == Status.ARRIVED, one.lon, one.lat, x * x, x * y, y * y]
            )
        )
    value = sum(w @ c for w, c in zip(weight, columns, strict=True)) / total
    variance = np.zeros(value.size)
    for w, c in zip(weight, columns, strict=True):
        left = w[:, None] * (c - value) / total
        variance += w.size * left.var(axis=0)
    return np.asarray(value), np.sqrt(variance)
