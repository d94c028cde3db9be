"""Case pacsearch, 300 scenarios, four arrays and two contacts, against a second opinion that draws
what is heard (tests/oracles/second_opinions/pacific.py).
"""

import itertools

import numpy as np
import pacific
import pytest
from scipy import stats

from drift.case import file as case_file
from drift.pipeline import flow

OURS = 30_000
THEIRS = (150_000, 12_000)  # drawn, and followed
AXES = (10, 6, 5)  # routes, speeds, departures
# numbers; together they are as sure as three standard errors hold one (Bonferroni)
COMPARED = 4 + 6 * sum(AXES) + 2
SIGMAS = stats.norm.isf(stats.norm.sf(3.0) / COMPARED)
Array = np.ndarray


def shares(submarines: pacific.Submarines) -> tuple[Array, Array]:
    """Return the probability of each value of each axis, and its standard error."""
    weight = submarines.weight / submarines.weight.sum()
    found = [np.bincount(submarines.axes[:, k], weight, many) for k, many in enumerate(AXES)]
    squares = [np.bincount(submarines.axes[:, k], weight**2, many) for k, many in enumerate(AXES)]
    share, square = np.concatenate(found), np.concatenate(squares)
    return share, np.sqrt((1 - 2 * share) * square + share**2 * (weight**2).sum())


@pytest.mark.thorough
def test_pacsearch_is_what_a_second_opinion_says() -> None:
    """Evidence of each watch, routes, speeds and departures after each update, and the mean
    position at the end.
    """
    settings = {"particles": str(OURS), "resampling": "{}", "expect": "{}"}
    settings["output"] = '{ every = "100 d", trajectories = 1_000_000 }'
    result = flow.run(case_file.load("pacsearch", settings))
    routes = pacific.CASE["family"][0]["axis"]["route"]["values"]
    stories = np.array(list(itertools.product(*map(range, AXES))))
    for story, scenario in zip(stories, result.case.scenarios, strict=True):
        assert scenario.name.startswith(f"transit, {routes[story[0]]}, ")
    updates = list(result.updates.all)
    theirs = list(pacific.believed(np.random.default_rng(20_261_123), *THEIRS))
    apart, compared = [], 0

    def compare(what: str, mine: float, error: float, other: float, further: float) -> None:
        nonlocal compared
        compared += 1
        off = (mine - other) / np.hypot(error, further)
        if abs(off) > SIGMAS:
            apart.append(f"{what}: {mine:.5g}, oracle {other:.5g}: {off:+.1f} errors")

    ours = {
        update.name if update.pos is None else f"{update.name} hears nothing": update
        for update in updates
    }
    assert len(ours) == len(updates) == len(theirs)
    for their in theirs:
        own = ours[their.name if np.isnan(their.pos) else f"{their.name} hears nothing"]
        if own.pos is not None:
            pos = float(own.pos[-1])
            compare(
                f"POS {their.name}",
                pos,
                np.sqrt(pos * (1 - pos) / own.ess_before),
                their.pos,
                their.error,
            )
        values = np.concatenate(
            [np.bincount(stories[:, k], own.posterior, many) for k, many in enumerate(AXES)]
        )
        errors = np.sqrt(values * (1 - values) / own.ess_after)
        for k, row in enumerate(zip(values, errors, *shares(their.submarines), strict=True)):
            compare(f"value {k} after {their.name}", *row)
    tracks = result.trajectories
    weight = tracks.weight[:, -1] / tracks.weight[:, -1].sum()
    last = theirs[-1].submarines
    belief = last.weight / last.weight.sum()
    ends = [x[:, -1].astype(float) * 360 / 2**32 for x in (tracks.lon, tracks.lat)]
    for name, end, other in zip(("lon", "lat"), ends, last.at(168.0), strict=True):
        x, y = (np.mod(z, 360) if name == "lon" else z for z in (end, other))
        means, errors = [], []
        for value, share in ((x, weight), (y, belief)):
            means.append(float(share @ value))
            errors.append(float(np.sqrt(share**2 @ (value - means[-1]) ** 2)))
        compare(name, means[0], errors[0], means[1], errors[1])
    assert compared == COMPARED
    assert not apart, apart
