"""A transit on a network of lanes, as in MEDSEARCH: every posterior against a sum over entry, speed
and side in float64.

Richardson, Corwin and others, "Early maritime applications of particle filtering", section 4.3.
Nothing here is drawn: the likelihood of each entry time, speed of advance and side of the lane is
known in closed form, and added up on a grid of their laws. It shares no code with ours: its great
circles, corners and crossings are made of vectors.

What a run of n_k particles of scenario k says of a share or a mean R = sum pi_k E_k[L g] / sum pi_k
E_k[L] has the standard error sqrt(sum pi_k^2 Var_k[L (g - R)] / n_k) / sum pi_k E_k[L] (delta
method), which is here known, too. Tolerances are three of them, and what halving the grid changes.
"""

import csv
import io
import itertools
from dataclasses import dataclass

import numpy as np
import pytest

import drift
from drift.evidence.posterior import tables

RADIUS, NMI = 6_371_008.8, 1852.0
HOUR = 3600.0
PARTICLES = 60_000

NODES = {
    "In": (-40.0, 33.0),
    "North": (-37.6, 34.2),
    "South": (-37.9, 31.9),
    "Mid": (-36.5, 32.3),
    "Out": (-34.9, 33.4),
}
WIDTHS = {
    ("In", "North"): 10,
    ("North", "Out"): 6,
    ("In", "South"): 8,
    ("South", "Mid"): 12,
    ("Mid", "Out"): 7,
    ("South", "Out"): 9,
}
ENTRY = (0.0, 3.0, 10.0, 4.0)  # [h] low, best, high, ratio
STORIES = {  # route, prior, and law of the speed [kn]
    "by the north": (("In", "North", "Out"), 0.5, (6.0, 9.0, 14.0, 5.0)),
    "by the south": (("In", "South", "Out"), 0.3, (6.0, 9.0, 14.0, 5.0)),
    "round about": (("In", "South", "Mid", "Out"), 0.2, (5.0, 10.0, 12.0, 3.0)),
}
DIP = ((-37.3, 32.2), 22.0, 14.0, 0.05)  # place, radius [nmi], time [h], false alarms
# it ends amid the northern lane; from, to [h], detection
PICKET = (((-39.0, 34.02), (-38.73, 33.61)), 6.0, 15.0, 0.8)
ARRAY = (((-35.6, 34.3), (-35.45, 33.3), (-35.8, 32.2)), 18.0, 44.0, 0.7)
REPORT = (29.0, 1.5, 0.01)  # time, error [h], false alarms [1/h]

HEAD = f"""
title = "A transit"
start = "1978-03-06T00:00Z"
duration = "60 h"
particles = {PARTICLES}
seed = 12
clock.step = "1 h"
output.times = ["+60 h"]
coast.source = "none"
[[look]]
name = "dip"
time = "+{DIP[2]} h"
at = {list(DIP[0])}
radius = "{DIP[1]} nmi"
sees = "nothing"
law = {{ exponential = 2 }}
false_alarms = {DIP[3]}
[[barrier]]
name = "picket"
points = {[list(at) for at in PICKET[0]]}
start = "+{PICKET[1]} h"
end = "+{PICKET[2]} h"
detection = {PICKET[3]}
[[barrier]]
name = "array"
points = {[list(at) for at in ARRAY[0]]}
start = "+{ARRAY[1]} h"
end = "+{ARRAY[2]} h"
detection = {ARRAY[3]}
reported = "+{REPORT[0]} h"
error = "{REPORT[1]} h"
false_alarms = "{REPORT[2]} /h"
"""
STORY = """
[[scenario]]
name = "{name}"
weight = {weight}
[[scenario.phase]]
[scenario.phase.lanes]
network = "network.toml"
route = {route}
entry = {{ earliest = "+{entry[0]} h", best = "+{entry[1]} h", latest = "+{entry[2]} h", ratio = {entry[3]} }}
speed = {{ low = "{speed[0]} kn", best = "{speed[1]} kn", high = "{speed[2]} kn", ratio = {speed[3]} }}
"""


def vector(lon, lat):
    lon, lat = np.radians(lon), np.radians(lat)
    return np.stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)], axis=-1)


def angle(a, b):
    return np.arctan2(np.linalg.norm(np.cross(a, b), axis=-1), np.sum(a * b, axis=-1))


def unit(a):
    return a / np.linalg.norm(a, axis=-1, keepdims=True)


def triangle(law, many):
    """Return midpoints of equal intervals and the probability of each, under a truncated triangle."""
    low, mode, high, ratio = law
    edges = np.linspace(low, high, many + 1)

    def up_to(x):
        flat = 2 / (1 + ratio)
        rise = np.where(
            x < mode,
            (x - low) ** 2 / ((high - low) * (mode - low)),
            1 - (high - x) ** 2 / ((high - low) * (high - mode)),
        )
        return flat * (x - low) / (high - low) + (1 - flat) * rise

    return (edges[1:] + edges[:-1]) / 2, np.diff(up_to(edges))


def course_at(route, side):
    """Return where sides (m,) pass the nodes of a route, unit vectors (m, k, 3), and how far along
    [nmi] its middle they are (k,).
    """
    place = vector(*np.array([NODES[name] for name in route]).T)
    half = np.array([WIDTHS[pair] / 2 for pair in itertools.pairwise(route)]) * NMI / RADIUS
    # The pole of each leg is to port of it, so that minus the pole is to starboard, wherever on the
    # leg one is.
    starboard = -unit(np.cross(place[:-1], place[1:]))
    passed = []
    for j, at in enumerate(place):
        before, after = starboard[max(j - 1, 0)], starboard[min(j, len(half) - 1)]
        across = unit(before + after)  # the bisector; both lie in the tangent plane
        mean = (half[max(j - 1, 0)] + half[min(j, len(half) - 1)]) / 2
        # cos(turn / 2); no turn here is sharper than a right angle
        reach = mean / np.sum(across * after)
        passed.append(np.cos(side * reach)[:, None] * at + np.sin(side * reach)[:, None] * across)
    along = np.append(0.0, np.cumsum(angle(place[:-1], place[1:]))) * RADIUS / NMI
    return np.stack(passed, axis=1), along


def crossings(passed, along, points):
    """Return how far along [nmi] the middle each side is where it crosses the pieces of a line, (m,
    crossings); NaN: it does not.
    """
    line = vector(*np.array(points).T)
    found = []
    for j in range(passed.shape[1] - 1):
        for a, b in itertools.pairwise(line):
            p, q = passed[:, j], passed[:, j + 1]
            meet = unit(np.cross(np.cross(p, q), np.cross(a, b)))
            meet = meet * np.sign(np.sum(meet * (a + b), axis=-1))[:, None]
            way, done = angle(p, q), angle(p, meet)
            on_way = np.isclose(done + angle(meet, q), way, rtol=0, atol=1e-12)
            on_line = np.isclose(angle(a, meet) + angle(meet, b), angle(a, b), rtol=0, atol=1e-12)
            found.append(
                np.where(
                    on_way & on_line, along[j] + done / way * (along[j + 1] - along[j]), np.nan
                )
            )
    return np.stack(found, axis=-1)


def ends(route):
    """Return the sides at which a barrier ends: there the likelihood jumps, and cells of the grid
    must end too.
    """
    side = np.linspace(-1, 1, 20_001)
    passed, along = course_at(route, side)
    met = [~np.isnan(crossings(passed, along, watch[0])).all(axis=1) for watch in (PICKET, ARRAY)]
    return np.concatenate([side[np.flatnonzero(np.diff(own.astype(int)))] + 5e-5 for own in met])


def first_touch(where, entry, speed, begin, end):
    """Return when [h] a line is first crossed while it is manned; inf: not."""
    when = entry[..., None] + where / speed[..., None]
    return np.where((when >= begin) & (when < end), when, np.inf).min(axis=-1)


@dataclass
class Exact:
    """The sum: what one cell of the grid is, its prior probability and what each update multiplies
    it by.
    """

    scenario: np.ndarray
    entry: np.ndarray
    speed: np.ndarray
    prior: np.ndarray
    factors: tuple[np.ndarray, ...]
    # what a cell holds of the entry [h], and of the speed [kn] of each scenario
    cells: tuple[float, np.ndarray]

    def likelihood(self, update):
        """Return what all updates up to one have made of each cell."""
        return np.prod(self.factors[:update], axis=0) if update else np.ones_like(self.prior)

    def evidence(self, update):
        weights = self.prior * self.likelihood(update)
        return np.array(
            [
                *(
                    weights[self.scenario == k].sum() / self.prior[self.scenario == k].sum()
                    for k in range(3)
                ),
                weights.sum(),
            ]
        )

    def mean(self, update, values, only=None):
        """Return the mean of values after an update, of one scenario or all, and the standard error
        that the run's has.
        """
        likelihood = self.likelihood(update)
        weights = self.prior * likelihood * (True if only is None else self.scenario == only)
        mean = (weights * values).sum() / weights.sum()
        variance = 0.0
        for k, (_, share, _) in enumerate(STORIES.values()):
            if only in (None, k):
                own = self.scenario == k
                off, prior = (likelihood * (values - mean))[own], self.prior[own] / share
                spread = (prior * off**2).sum() - (prior * off).sum() ** 2
                variance += share**2 * spread / (PARTICLES * share)
        return mean, np.sqrt(variance) / weights.sum()


def exact(entries, speeds, sides):
    """Return the sum on a grid of so many entry times, speeds and sides."""
    columns = []
    for number, (route, weight, law) in enumerate(STORIES.values()):
        entry, p_entry = triangle(ENTRY, entries)
        speed, p_speed = triangle(law, speeds)
        edges = np.sort(np.append(np.linspace(-1, 1, sides + 1), ends(route)))
        side = (edges[1:] + edges[:-1]) / 2
        e, v = (x[:, :, None] for x in np.meshgrid(entry, speed, indexing="ij"))
        prior = weight * p_entry[:, None, None] * p_speed[None, :, None] * np.diff(edges) / 2
        passed, along = course_at(route, side)

        # The look: where each is at its time, on the great circle from node to node, by its share
        # of the middle.
        done = np.broadcast_to(np.clip((DIP[2] - e) * v, 0, along[-1]), prior.shape)
        leg = np.clip(np.searchsorted(along, done, side="right") - 1, 0, len(along) - 2)
        p, q = (passed[np.arange(side.size), leg + k] for k in (0, 1))
        way, share = angle(p, q), (done - along[leg]) / (along[leg + 1] - along[leg])
        at = (
            np.sin((1 - share) * way)[..., None] * p + np.sin(share * way)[..., None] * q
        ) / np.sin(way)[..., None]
        far = angle(at, vector(*DIP[0])) * RADIUS / NMI / DIP[1]
        assert ENTRY[2] < DIP[2]  # all are under way
        seen = DIP[3] + (1 - DIP[3]) * np.exp(-(far**2))
        picket, array = (
            first_touch(crossings(passed, along, points), e, v, begin, end)
            for points, begin, end, _ in (PICKET, ARRAY)
        )
        report = (
            np.exp(-(((REPORT[0] - array) / REPORT[1]) ** 2) / 2) / np.sqrt(2 * np.pi) / REPORT[1]
        )
        told = ARRAY[3] * report + REPORT[2] * (1 - ARRAY[3] * np.isfinite(array))
        # the report is a density, per second
        factors = (1 - seen, 1 - PICKET[3] * np.isfinite(picket), told / HOUR)
        whole = [
            np.full(prior.shape, number),
            *np.broadcast_arrays(e, v, prior)[:2],
            prior,
            *factors,
        ]
        columns.append([x.ravel() for x in whole])
    scenario, entry, speed, prior, *factors = (
        np.concatenate(rows) for rows in zip(*columns, strict=True)
    )
    widths = np.array([(law[2] - law[0]) / speeds for _, _, law in STORIES.values()])
    return Exact(
        scenario, entry, speed, prior, tuple(factors), ((ENTRY[2] - ENTRY[0]) / entries, widths)
    )


@pytest.fixture(scope="module")
def sums():
    """The sum, and the same on a grid half as fine."""
    return exact(120, 120, 12), exact(60, 60, 6)


@pytest.fixture(scope="module")
def told(tmp_path_factory):
    """The run's updates, and the rows of its posteriors.csv by update, quantity, scenario and
    value.
    """
    folder = tmp_path_factory.mktemp("transit")
    nodes = [f'[[node]]\nname = "{name}"\nat = {list(at)}\n' for name, at in NODES.items()]
    lanes = [
        f'[[lane]]\nfrom = "{a}"\nto = "{b}"\nwidth = "{wide} nmi"\n'
        for (a, b), wide in WIDTHS.items()
    ]
    (folder / "network.toml").write_text("".join(nodes + lanes))
    stories = [
        STORY.format(name=name, weight=weight, route=list(route), entry=ENTRY, speed=speed).replace(
            "'", '"'
        )
        for name, (route, weight, speed) in STORIES.items()
    ]
    (folder / "case.toml").write_text(HEAD + "".join(stories))
    result = drift.run(drift.load(folder / "case.toml"))
    rows = csv.DictReader(io.StringIO(tables.csv(result.posteriors, "run")))
    return result.updates, {
        (int(row["update"]), row["quantity"], row["scenario"], row["value"]): row for row in rows
    }


def agree(found, expected, error, coarse):
    assert abs(found - expected) < 3 * error + abs(expected - coarse), (
        found,
        expected,
        error,
        coarse,
    )


@pytest.mark.parametrize("update", [1, 2, 3])
def test_scenarios_and_evidence(sums, told, update):
    fine, coarse = sums
    for k, name in enumerate(STORIES):
        is_k = [s.scenario == k for s in sums]
        expected, error = fine.mean(update, is_k[0])
        found = float(told[1][update, "scenario", "all", name]["share"])
        agree(found, expected, error, coarse.mean(update, is_k[1])[0])
        assert error < 0.004
    evidence = np.cumsum([u.log_evidence[-1] for u in told[0].all])[update - 1]
    expected, half = np.log(fine.evidence(update)[-1]), np.log(coarse.evidence(update)[-1])
    likelihood = fine.likelihood(update)
    spread = sum(
        (fine.prior[own] * likelihood[own] ** 2).sum()
        - (fine.prior[own] * likelihood[own]).sum() ** 2 / fine.prior[own].sum()
        for own in (fine.scenario == k for k in range(3))
    )
    agree(evidence, expected, np.sqrt(spread / PARTICLES) / np.exp(expected), half)


@pytest.mark.parametrize("update", [0, 1, 2, 3])
@pytest.mark.parametrize("only", [None, 0, 1, 2])
def test_entry_and_speed(sums, told, update, only):
    fine, coarse = sums
    scenario = "all" if only is None else list(STORIES)[only]
    begin = np.datetime64("1978-03-06T00:00")

    def number(cell, quantity):
        if quantity == "speed":
            return float(cell)
        return (np.datetime64(cell.rstrip("Z")) - begin) / np.timedelta64(1, "h")

    quantities = (
        ("speed", lambda s: s.speed, lambda s: s.cells[1][s.scenario]),
        ("departure", lambda s: s.entry, lambda s: s.cells[0]),
    )
    for quantity, of, cell in quantities:
        row = told[1][update, quantity, scenario, ""]
        expected, error = fine.mean(update, of(fine), only)
        agree(
            number(row["mean"], quantity), expected, error, coarse.mean(update, of(coarse), only)[0]
        )
        second, error = fine.mean(update, (of(fine) - expected) ** 2, only)
        agree(
            float(row["std"]) ** 2,
            second,
            error,
            coarse.mean(update, (of(coarse) - expected) ** 2, only)[0],
        )
        for level in (5, 25, 50, 75, 95):
            # How much of the exact posterior lies below the run's quantile; a cell that it cuts
            # counts by its share.
            at = number(row[f"q{level:02}"], quantity)
            below = []
            for own in sums:
                below.append(
                    own.mean(update, np.clip((at - of(own)) / cell(own) + 0.5, 0, 1), only)
                )
            agree(level / 100, below[0][0], below[0][1], below[1][0])


def test_effective_number(sums, told):
    fine, _ = sums
    for update, seen in enumerate(told[0].all, 1):
        likelihood = fine.likelihood(update)
        mean, square = ((fine.prior * likelihood**power).sum() for power in (1, 2))
        assert seen.ess_after == pytest.approx(PARTICLES * mean**2 / square, rel=0.02)
    assert told[0].all[-1].ess_after > 10_000
