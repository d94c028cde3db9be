"""Brownian bridges to one of two destinations, a field, a barrier that ends midway, a field at the
end: against small steps in float64.

The brute force is one of paths in a plane about the middle of all (it bends distances there by less
than 1e-4), in steps of 60 s: within a step an edge that both its ends lie on one side of is touched
with probability exp(-2 d1 d2 / (K^2 dt)); near the end of the barrier steps are cut in 16.
Tolerances are three standard errors of the difference: the variance of one draw (delta method, from
the brute force's draws) over the number of its draws plus that over the number of the run's; with
resampling twice that of the run (Chopin 2004: it adds at most as much as the weights have before
it).
"""

import numpy as np
import pytest

import drift

RADIUS, NMI, HOUR = 6_371_008.8, 1852.0, 3600.0
PARTICLES, DRAWS, STEP = 25_000, 16_000, 60 / 3600
MIDDLE = (-179.95, -35.1)
# place, axes [nmi], orientation, departs at 0 to this [h]
FROM = ((179.2, -35.2), (3.0, 6.0), 30.0, 2.0)
DISC = ((-178.9, -34.6), 8.0, (16.0, 20.0), 0.6)  # a destination: place, radius, times, probability
# another: place, sides, orientation, time and error
BOX = ((-179.5, -36.2), (10.0, 6.0), 40.0, (17.0, 1.0), 0.4)
K, FACTOR = 5.0, 1.3  # [nmi/sqrt(h)], a standard deviation of it as a factor
FIELD = (
    (179.75, -35.05),
    (14.0, 8.0),
    30.0,
    (5.0, 8.0),
    0.8,
    0.1,
)  # place, sides, turned, times, detection, false alarms
# its first point lies amid the ways
BARRIER = (((-179.8, -35.15), (-179.6, -34.6)), (10.0, 13.0), 0.9)
# place, radius, times: some have arrived in it
BUOYS = ((-178.95, -34.5), 7.0, (16.0, 22.0), 0.7, 0.05)
TIMES = (9.0, 14.0, 23.0)  # [h]

CASE = f"""
title = "Two destinations"
start = "2026-03-05T00:00Z"
duration = "23 h"
particles = {PARTICLES}
seed = 21
clock.step = "30 min"
output.times = {[f"+{t} h" for t in TIMES]}
output.trajectories = {PARTICLES}
coast.source = "none"
[[scenario]]
name = "smuggler"
[[scenario.phase]]
[scenario.phase.bridge]
k = "{K} nmi/sqrt(h)"
k_spread = {FACTOR}
points = [{{ at = {list(FROM[0])}, std = ["{FROM[1][0]} nmi", "{FROM[1][1]} nmi"], orientation = {FROM[2]}, time = ["+0 h", "+{FROM[3]} h"] }}]
[[scenario.phase.bridge.destinations]]
at = {list(DISC[0])}
radius = "{DISC[1]} nmi"
time = ["+{DISC[2][0]} h", "+{DISC[2][1]} h"]
probability = {DISC[3]}
[[scenario.phase.bridge.destinations]]
at = {list(BOX[0])}
box = ["{BOX[1][0]} nmi", "{BOX[1][1]} nmi"]
orientation = {BOX[2]}
time = {{ at = "+{BOX[3][0]} h", std = "{BOX[3][1]} h" }}
probability = {BOX[4]}
[[presence]]
name = "field"
at = {list(FIELD[0])}
width = "{FIELD[1][0]} nmi"
height = "{FIELD[1][1]} nmi"
turned = {FIELD[2]}
start = "+{FIELD[3][0]} h"
end = "+{FIELD[3][1]} h"
present = "sometime"
detection = {FIELD[4]}
false_alarms = {FIELD[5]}
[[barrier]]
name = "barrier"
points = {[list(at) for at in BARRIER[0]]}
start = "+{BARRIER[1][0]} h"
end = "+{BARRIER[1][1]} h"
detection = {BARRIER[2]}
[[presence]]
name = "buoys"
at = {list(BUOYS[0])}
radius = "{BUOYS[1]} nmi"
start = "+{BUOYS[2][0]} h"
end = "+{BUOYS[2][1]} h"
present = "never"
detection = {BUOYS[3]}
false_alarms = {BUOYS[4]}
"""


def plane(lon, lat):
    """Return (east, north) [nmi] of places [deg] from MIDDLE: the great circle there, by its length
    and bearing (n, 2).
    """
    lon, lat, at = np.radians(lon) - np.radians(MIDDLE[0]), np.radians(lat), np.radians(MIDDLE[1])
    x = np.cos(lat) * np.sin(lon)
    y = np.cos(at) * np.sin(lat) - np.sin(at) * np.cos(lat) * np.cos(lon)
    z = np.sin(at) * np.sin(lat) + np.cos(at) * np.cos(lat) * np.cos(lon)
    far = np.arctan2(np.hypot(x, y), z) * RADIUS / NMI
    return np.stack([x, y], axis=-1) * (far / np.hypot(x, y))[..., None]


def axes(turned):
    """Return the directions (east, north) that are along and to the right of a direction [deg]."""
    s, c = np.sin(np.radians(turned)), np.cos(np.radians(turned))
    return np.array([[s, c], [c, -s]])


def box_touched(a, b, spread):
    """Return how likely a piece from a to b touches the field, given its ends; spread: K^2 dt."""
    own = axes(FIELD[2])[::-1]  # width lies to the right, height along
    half = np.array(FIELD[1]) / 2
    x, y = ((p - plane(*FIELD[0])) @ own.T for p in (a, b))
    inside = (np.abs(x) < half).all(axis=-1) | (np.abs(y) < half).all(axis=-1)
    chance = np.ones(len(a))
    for axis in range(2):
        for side in (-1, 1):
            before, after = side * x[:, axis] - half[axis], side * y[:, axis] - half[axis]
            beyond = (before > 0) & (after > 0)
            chance = np.where(beyond, chance * np.exp(-2 * before * after / spread), chance)
    return np.where(inside, 1.0, chance)


def disc_touched(a, b, spread):
    """Return the same of the buoys."""
    x, y = (np.linalg.norm(p - plane(*BUOYS[0]), axis=-1) - BUOYS[1] for p in (a, b))
    return np.where(
        (x < 0) | (y < 0), 1.0, np.exp(-2 * np.maximum(x, 0) * np.maximum(y, 0) / spread)
    )


def line_touched(a, b, spread):
    """Return the same of the barrier, whose near end is looked at closely elsewhere."""
    first, last = (plane(*at) for at in BARRIER[0])
    long = np.linalg.norm(last - first)
    along, across = (last - first) / long, np.array([[0, 1], [-1, 0]]) @ (last - first) / long
    (u, v), (s, t) = (((p - first) @ along, (p - first) @ across) for p in (a, b))
    # where it is nearest to the line, or crosses it
    share = np.abs(v) / np.maximum(np.abs(v) + np.abs(t), 1e-12)
    on = (u + share * (s - u) > 0) & (u + share * (s - u) < long)
    return np.where(on, np.where(v * t < 0, 1.0, np.exp(-2 * v * t / spread)), 0.0)


class Paths:
    """Paths that are drawn step by step."""

    def __init__(self, n, seed):
        self.rng = rng = np.random.default_rng(seed)
        self.k = K * np.exp(np.log(FACTOR) * rng.standard_normal(n))
        self.now = plane(*FROM[0]) + (rng.standard_normal((n, 2)) * FROM[1]) @ axes(FROM[2])
        self.time = rng.uniform(0, FROM[3], n)
        self.to = (rng.random(n) >= DISC[3]).astype(int)
        turn, far = rng.uniform(0, 2 * np.pi, n), DISC[1] * np.sqrt(rng.random(n))
        disc = plane(*DISC[0]) + far[:, None] * np.stack([np.sin(turn), np.cos(turn)], axis=-1)
        box = plane(*BOX[0]) + (rng.uniform(-0.5, 0.5, (n, 2)) * BOX[1]) @ axes(BOX[2])
        self.end = np.where(self.to[:, None] == 0, disc, box)
        self.arrival = np.where(
            self.to == 0, rng.uniform(*DISC[2], n), BOX[3][0] + BOX[3][1] * rng.standard_normal(n)
        )

    def step(self, until):
        """Go on to a time; return where they were, and K^2 dt."""
        rest = self.arrival - self.time
        dt = np.clip(until - self.time, 0, rest)
        share = np.divide(dt, rest, out=np.ones_like(dt), where=rest > 0)[:, None]
        noise = self.rng.standard_normal(self.now.shape)
        before = self.now
        self.now = (
            before
            + share * (self.end - before)
            + self.k[:, None] * np.sqrt(dt[:, None] * (1 - share)) * noise
        )
        self.time = np.maximum(self.time, np.minimum(until, self.arrival))
        return before, np.maximum(self.k**2 * dt, 1e-12)

    def watch(self, begin, end, touched, near=None):
        """Return the probability of each path that it touches something between two times."""
        self.step(begin)
        stayed = np.ones(self.k.size)
        for until in np.linspace(begin, end, round((end - begin) / STEP) + 1)[1:]:
            before, spread = self.step(until)
            chance = touched(before, self.now, spread)
            if near is not None:
                close = np.flatnonzero(np.linalg.norm(before - near, axis=-1) < 6 * np.sqrt(spread))
                a, b, left = before[close], self.now[close], spread[close]
                missed = np.ones(close.size)
                for k in range(16, 0, -1):
                    noise = (
                        self.rng.standard_normal(a.shape)
                        * np.sqrt(spread[close] / 16 * (1 - 1 / k))[:, None]
                    )
                    middle = a + (b - a) / k + noise
                    missed *= 1 - touched(a, middle, left / 16)
                    a = middle
                chance[close] = 1 - missed
            stayed *= 1 - chance
        return 1 - stayed


@pytest.fixture(scope="module")
def brute():
    """Likelihoods of the three sensors, and where paths are at TIMES."""
    paths, places = Paths(DRAWS, 8), []

    def note(time):
        paths.step(time)
        places.append(paths.now)

    field = FIELD[5] + (1 - FIELD[5]) * FIELD[4] * paths.watch(*FIELD[3], box_touched)
    note(TIMES[0])
    barrier = 1 - BARRIER[2] * paths.watch(*BARRIER[1], line_touched, plane(*BARRIER[0][0]))
    note(TIMES[1])
    buoys = 1 - BUOYS[4] - (1 - BUOYS[4]) * BUOYS[3] * paths.watch(*BUOYS[2], disc_touched)
    note(TIMES[2])
    return paths, (field, barrier, buoys), places


@pytest.fixture(scope="module", params=["", "resampling.below = 0.95\n"], ids=["", "resampled"])
def run(request, tmp_path_factory):
    """The run, and what a particle counts less for being drawn again."""
    path = tmp_path_factory.mktemp("bridge") / "case.toml"
    path.write_text(request.param + CASE)
    result = drift.run(drift.load(path))
    assert any(update.resampled for update in result.updates.all) == bool(request.param)
    return result, 2.0 if request.param else 1.0


def agree(found, weights, values, worse, what):
    expected = (weights * values).sum() / weights.sum()
    variance = np.mean((weights * (values - expected)) ** 2) / np.mean(weights) ** 2
    error = np.sqrt(variance / DRAWS + worse * variance / PARTICLES)
    assert abs(found - expected) < 3 * error + 1e-9, (what, found, expected, error)


@pytest.mark.thorough
def test_evidence(brute, run):
    (_, seen, _), (result, worse) = brute, run
    before = np.ones(DRAWS)
    for update, likelihood in zip(result.updates.all, seen, strict=True):
        agree(np.exp(update.log_evidence[-1]), before, likelihood, worse, update.name)
        before = before * likelihood


@pytest.mark.thorough
def test_places(brute, run):
    (paths, seen, places), (result, worse) = brute, run
    tracks = result.trajectories
    for when, there in enumerate(places):
        if worse > 1 and when < 2:
            # the tracks of what is drawn again later are no sample of what was known before that
            continue
        at = np.searchsorted(
            tracks.time, tracks.time[0] + np.timedelta64(round(TIMES[when] * HOUR), "s")
        )
        weights, own = np.prod(seen[: when + 1], axis=0), tracks.weight[:, at]
        here = plane(*(x[:, at] * (360 / 2**32) for x in (tracks.lon, tracks.lat)))
        middle = np.average(there, axis=0, weights=weights)
        ours, theirs = here - middle, there - middle
        for k in range(2):
            agree(own @ ours[:, k], weights, theirs[:, k], worse, (when, "mean", k))
        for j, k in ((0, 0), (0, 1), (1, 1)):
            agree(
                own @ (ours[:, j] * ours[:, k]),
                weights,
                theirs[:, j] * theirs[:, k],
                worse,
                (when, "second", j, k),
            )
        agree(
            own @ (tracks.status[:, at] == 7),
            weights,
            paths.arrival <= TIMES[when],
            worse,
            (when, "arrived"),
        )


@pytest.mark.thorough
def test_destination_and_k(brute, run):
    (paths, seen, _), (result, worse) = brute, run
    of = {told.quantity.name: k for k, told in enumerate(result.posteriors.told)}
    for number, stage in enumerate(result.posteriors.stages):
        weights = np.prod(seen[:number], axis=0) * np.ones(DRAWS)
        agree(
            stage.marginals[of["destination"]].table[-1][0],
            weights,
            paths.to == 0,
            worse,
            (number, "destination"),
        )
        found, one = stage.marginals[of["spread_rate"]], NMI / np.sqrt(HOUR)
        agree(found.mean[-1] / one, weights, paths.k, worse, (number, "K"))
        for level, at in zip((0.05, 0.25, 0.5, 0.75, 0.95), found.quantiles[-1] / one, strict=True):
            agree(level, weights, paths.k <= at, worse, (number, "K", level))


SHARP = """
title = "Copies"
start = "2026-03-05T00:00Z"
duration = "20 h"
particles = 20000
seed = 4
clock.step = "30 min"
output.times = ["+5 h", "+9 h", "+20 h"]
output.trajectories = 20000
coast.source = "none"
resampling.below = 0.5
[[scenario]]
name = "smuggler"
[[scenario.phase]]
[scenario.phase.bridge]
k = "6 nmi/sqrt(h)"
points = [{ at = [179.2, -35.2], time = "+0 h" }]
destinations = [
    { at = [-178.9, -34.6], time = "+17 h", probability = 0.7 },
    { at = [-179.5, -36.2], time = "+15 h", probability = 0.3 },
]
[[look]]
name = "sharp"
time = "+5 h"
at = [179.65, -35.3]
radius = "2.5 nmi"
sees = "something"
"""


def test_copies_keep_their_destination_and_part(tmp_path):
    path = tmp_path / "case.toml"
    path.write_text(SHARP)
    result = drift.run(drift.load(path))
    assert result.updates.all[0].ess_after < 2_000  # each that is left has ten copies or more
    tracks = result.trajectories
    at = [plane(*(x[:, k] * (360 / 2**32) for x in (tracks.lon, tracks.lat))) for k in (1, 2, 3)]
    born = np.unique(
        np.stack([tracks.lon[:, 1], tracks.lat[:, 1]], axis=-1), axis=0, return_inverse=True
    )[1].ravel()
    to = (np.linalg.norm(at[2] - plane(-179.5, -36.2), axis=-1) < 0.1).astype(int)
    assert np.all((np.linalg.norm(at[2] - plane(-178.9, -34.6), axis=-1) < 0.1) == (to == 0))
    own = [np.unique(to[born == k]).size for k in range(born.max() + 1)]
    # all copies of one arrive where it was bound
    assert np.array_equal(own, np.ones(born.max() + 1))
    # At 9 h each is, about its own bridge from 5 h on, normal with variance K^2 4 h (T - 9 h) / (T
    # - 5 h), whatever its copies are.
    end, last = (
        np.array([plane(-178.9, -34.6), plane(-179.5, -36.2)])[to],
        np.array([17.0, 15.0])[to][:, None],
    )
    off = at[1] - at[0] - (end - at[0]) * 4 / (last - 5)
    z = off / (6 * np.sqrt(4 * (last - 9) / (last - 5)))
    n = z.size
    assert abs(z.mean()) < 3 / np.sqrt(n)
    assert abs((z**2).mean() - 1) < 3 * np.sqrt(2 / n) + 2e-4
    order = np.argsort(born, kind="stable")
    pairs = np.flatnonzero(np.diff(born[order]) == 0)
    product = z[order[pairs]] * z[order[pairs + 1]]
    assert pairs.size > 15_000
    assert abs(product.mean()) < 3 / np.sqrt(product.size)
