"""A yacht on a voyage, in distress at a constant rate, then adrift; a sortie in vain; overdue:
against brute force in float64.

The brute force shares no code with ours: great circles of vectors, every two minutes of the sortie
for each yacht, its hazard by the way between yacht and aircraft in a plane about both. Tolerances
are three standard errors of the difference: the variance of one draw (delta method, from the brute
force's draws) over the number of its draws plus that over the number of the run's.
"""

import itertools

import numpy as np
import pytest

import drift

RADIUS, NMI, HOUR = 6_371_008.8, 1852.0, 3600.0
PARTICLES, DRAWS = 25_000, 25_000
WAY = ((-30.0, 40.0), (-28.2, 41.1), (-26.9, 40.6))
SPEED = (4.0, 5.5, 8.0, 3.0)  # [kn] low, best, high, ratio
LATEST, CROSS, RATE, OVERDUE = 3.0, 3.0, 0.03, 40.0  # [h], [nmi], [1/h], [h]
# [h], place
FLOWN = (
    (18.0, (-28.95, 40.4)),
    (18.5, (-28.2, 41.2)),
    (19.0, (-28.05, 40.8)),
    (19.5, (-28.75, 40.75)),
)
ADRIFT, UNDER_WAY = 3.0, 7.0  # [nmi] sweep widths
CURRENT, WIND, WINDAGE = (0.6, 63.0), (14.0, 213.0), 0.03  # kn toward, kn from
TIMES = (17.0, 38.0, 50.0)  # [h] before the sortie, after it, and overdue

HARBOUR = (
    WAY[0],
    9.0,
    (1.0, 3.0),
    0.9,
    0.05,
)  # a field: place, radius, times, detection, false alarms: in it throughout
FIELD = (
    (-29.1, 40.65),
    (12.0, 7.0),
    25.0,
    (8.0, 14.0),
    0.8,
    0.1,
)  # another: place, sides, turned, ...: in it at some time
PICKET = (((-28.75, 40.55), (-28.55, 41.05)), (10.0, 20.0), 0.85)  # a barrier that is silent

CASE = f"""
title = "A yacht"
start = "2026-06-01T00:00Z"
duration = "50 h"
particles = {PARTICLES}
seed = 9
clock.step = "15 min"
output.times = {[f"+{t} h" for t in TIMES]}
output.trajectories = {PARTICLES}
coast.source = "none"
uncertainty = "none"
[[current]]
constant = {{ speed = "{CURRENT[0]} kn", toward = {CURRENT[1]} }}
[[wind]]
constant = {{ speed = "{WIND[0]} kn", from = {WIND[1]} }}
[[scenario]]
name = "yacht"
object = {{ windage = "{100 * WINDAGE} %" }}
distress = {{ rate = "{RATE}/h" }}
overdue = "+{OVERDUE} h"
[[scenario.phase]]
[scenario.phase.voyage]
waypoints = {[list(at) for at in WAY]}
departure = ["+0 h", "+{LATEST} h"]
speed = {{ low = "{SPEED[0]} kn", best = "{SPEED[1]} kn", high = "{SPEED[2]} kn", ratio = {SPEED[3]} }}
cross_track = "{CROSS} nmi"
""".replace("'", '"')
SORTIE = f"""
[[sortie]]
name = "aircraft"
sweep_width = "{ADRIFT} nmi"
sweep_width_under_way = "{UNDER_WAY} nmi"
waypoints = {[[f"+{time} h", list(at)] for time, at in FLOWN]}
""".replace("'", '"')
SENSORS = f"""
[[presence]]
name = "harbour"
at = {list(HARBOUR[0])}
radius = "{HARBOUR[1]} nmi"
start = "+{HARBOUR[2][0]} h"
end = "+{HARBOUR[2][1]} h"
present = "throughout"
detection = {HARBOUR[3]}
false_alarms = {HARBOUR[4]}
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
name = "picket"
points = {[list(at) for at in PICKET[0]]}
start = "+{PICKET[1][0]} h"
end = "+{PICKET[1][1]} h"
detection = {PICKET[2]}
"""


def until(hours):
    """Return the case until so many hours, in which nobody is overdue yet, and of which no tracks
    are kept.
    """
    text = CASE.replace('duration = "50 h"', f'duration = "{hours} h"').replace(
        f'overdue = "+{OVERDUE} h"\n', ""
    )
    start, end = text.index("output.times"), text.index("coast.source")
    return text[:start] + text[end:]


def vector(lon, lat):
    lon, lat = np.radians(lon), np.radians(lat)
    return np.stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)], axis=-1)


def degrees(v):
    return np.degrees(np.arctan2(v[..., 1], v[..., 0])), np.degrees(
        np.arctan2(v[..., 2], np.hypot(v[..., 0], v[..., 1]))
    )


def unit(v):
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def angle(a, b):
    return np.arctan2(np.linalg.norm(np.cross(a, b), axis=-1), np.sum(a * b, axis=-1))


def between(a, b, share):
    """Return the place at a share of the great circle from a to b."""
    way = angle(a, b)[..., None]
    share = np.asarray(share)[..., None]
    return (np.sin((1 - share) * way) * a + np.sin(share * way) * b) / np.sin(way)


class Yachts:
    """So many yachts, drawn from the prior; what is known of each for ever."""

    def __init__(self, n, seed):
        rng = np.random.default_rng(seed)
        self.departure = rng.uniform(0, LATEST, n)
        low, best, high, ratio = SPEED
        peaked = rng.random(n) >= 2 / (1 + ratio)
        self.speed = np.where(peaked, rng.triangular(low, best, high, n), rng.uniform(low, high, n))
        self.distress = self.departure + rng.exponential(1 / RATE, n)
        middle = vector(*np.array(WAY).T)
        starboard = -unit(np.cross(middle[:-1], middle[1:]))
        across = unit(np.stack([starboard[0], starboard[0] + starboard[1], starboard[1]]))
        mitre = np.array([1.0, np.sum(across[1] * starboard[1]), 1.0])
        off = (rng.normal(0, CROSS * NMI / RADIUS, n)[:, None] / mitre)[:, :, None]
        self.passed = np.cos(off) * middle + np.sin(off) * across
        self.along = np.append(0, np.cumsum(angle(middle[:-1], middle[1:]))) * RADIUS / NMI
        self.arrival = self.departure + self.along[-1] / self.speed
        current, wind = (
            np.array([np.sin(np.radians(a)), np.cos(np.radians(a))])
            for a in (CURRENT[1], WIND[1] + 180)
        )
        self.set = CURRENT[0] * current + WINDAGE * WIND[0] * wind  # [kn] east, north

    def at(self, time):
        """Return where they are [deg], and which are adrift."""
        adrift = (self.distress < self.arrival) & (self.distress < time)
        done = np.clip(
            (np.where(adrift, self.distress, time) - self.departure) * self.speed, 0, self.along[-1]
        )
        leg = (done >= self.along[1]).astype(int)
        share = (done - self.along[leg]) / np.diff(self.along)[leg]
        every = np.arange(done.size)
        lon, lat = degrees(between(self.passed[every, leg], self.passed[every, leg + 1], share))
        hours = np.where(adrift, time - self.distress, 0)
        rise = self.set[1] * hours / 60
        # Of a rhumb the longitude is the integral of 1 / cos(lat): that of the middle errs by 1e-6
        # over 30 nmi.
        return (
            lon + self.set[0] * hours / 60 / np.cos(np.radians(lat + rise / 2)),
            lat + rise,
            adrift,
        )


def plane(lon, lat, about):
    """Return (east, north) [nmi] of places [deg] about one."""
    return (lon - about[0]) * 60 * np.cos(np.radians((lat + about[1]) / 2)), (lat - about[1]) * 60


def missed(yachts, pace=120.0):
    """Return the chance that the aircraft misses each: inverse cube, W^2 / (8 pi r^3) for each mile
    of relative way.
    """
    hazard = np.zeros(yachts.speed.size)
    for (begin, a), (end, b) in itertools.pairwise(FLOWN):
        many = round((end - begin) * HOUR / pace)
        flown = np.stack(
            degrees(between(vector(*a), vector(*b), np.arange(many + 1) / many)), axis=-1
        )
        seen = (yachts.at(time) for time in np.linspace(begin, end, many + 1))
        off = (
            (np.stack(plane(*at, about), axis=-1), adrift)
            for (*at, adrift), about in zip(seen, flown, strict=True)
        )
        for (before, _), (after, adrift) in itertools.pairwise(off):
            way = after - before
            length = np.linalg.norm(way, axis=-1)
            first, last = (np.sum(x * way, axis=-1) / length for x in (before, after))
            abeam = np.abs(before[:, 0] * way[:, 1] - before[:, 1] * way[:, 0]) / length
            integral = (last / np.hypot(last, abeam) - first / np.hypot(first, abeam)) / abeam**2
            hazard += np.where(adrift, ADRIFT, UNDER_WAY) ** 2 / (8 * np.pi) * integral
    return np.exp(-hazard)


@pytest.fixture(scope="module")
def yachts():
    """Brute force: the yachts, and the chance that the sortie misses each."""
    drawn = Yachts(DRAWS, 3)
    return drawn, missed(drawn)


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    """The run."""
    path = tmp_path_factory.mktemp("yacht") / "case.toml"
    path.write_text(CASE + SORTIE)
    return drift.run(drift.load(path))


def weighted(weights, values):
    """Return the mean of values, and the variance of one draw."""
    mean = (weights * values).sum() / weights.sum()
    return mean, np.mean((weights * (values - mean)) ** 2) / np.mean(weights) ** 2


def agree(found, weights, values, what, draws=DRAWS):
    expected, variance = weighted(weights, values)
    error = np.sqrt(variance / draws + variance / PARTICLES)
    assert abs(found - expected) < 3 * error, (what, found, expected, error)


@pytest.mark.thorough
def test_evidence(yachts, result):
    drawn, chance = yachts
    late = ~((drawn.arrival < OVERDUE) & (drawn.distress > drawn.arrival))
    sortie, overdue = result.updates.all
    agree(np.exp(sortie.log_evidence[-1]), np.ones(DRAWS), chance, "sortie")
    agree(np.exp(overdue.log_evidence[-1]), chance, late, "overdue")


@pytest.mark.parametrize("when", range(len(TIMES)))
@pytest.mark.thorough
def test_places_and_distress(yachts, result, when):
    drawn, chance = yachts
    late = ~((drawn.arrival < OVERDUE) & (drawn.distress > drawn.arrival))
    weights = (np.ones(DRAWS), chance, chance * late)[when]
    tracks, time = result.trajectories, TIMES[when]
    at = np.searchsorted(tracks.time, tracks.time[0] + np.timedelta64(round(time * HOUR), "s"))
    own = tracks.weight[:, at]
    assert own.size == PARTICLES
    lon, lat = (x[:, at] * (360 / 2**32) for x in (tracks.lon, tracks.lat))
    here, (x, y, adrift) = np.stack(plane(lon, lat, WAY[1])), drawn.at(time)
    there = np.stack(plane(x, y, WAY[1]))
    floats = tracks.status[:, at] == 0
    agree(own @ floats, weights, adrift, "adrift")
    mean = (weights * there).sum(axis=1) / weights.sum()
    for states, its, what in ((floats, adrift, "adrift"), (~floats, ~adrift, "under way")):
        for k in range(2):
            agree(
                own @ (states * (here[k] - mean[k])),
                weights,
                its * (there[k] - mean[k]),
                (what, "mean", k),
            )
        for j, k in ((0, 0), (0, 1), (1, 1)):
            ours = states * (here[j] - mean[j]) * (here[k] - mean[k])
            theirs = its * (there[j] - mean[j]) * (there[k] - mean[k])
            agree(own @ ours, weights, theirs, (what, "second moment", j, k))
    for hour in (4, 10, 15, 18.25, 18.75, 19.25, 25, 35):
        if hour < time:
            ours = floats & (tracks.release < hour * HOUR)
            agree(own @ ours, weights, adrift & (drawn.distress < hour), ("distress", hour))


@pytest.mark.thorough
def test_speed_and_departure(yachts, result):
    drawn, chance = yachts
    late = ~((drawn.arrival < OVERDUE) & (drawn.distress > drawn.arrival))
    of = {told.quantity.name: k for k, told in enumerate(result.posteriors.told)}
    for stage, weights in zip(
        result.posteriors.stages, (np.ones(DRAWS), chance, chance * late), strict=True
    ):
        for name, values, one in (
            ("speed", drawn.speed, NMI / HOUR),
            ("departure", drawn.departure, HOUR),
        ):
            found = stage.marginals[of[name]]
            agree(found.mean[-1] / one, weights, values, (name, stage.number))
            for level, at in zip(
                (0.05, 0.25, 0.5, 0.75, 0.95), found.quantiles[-1] / one, strict=True
            ):
                agree(level, weights, values <= at, (name, stage.number, level))


def ways(yachts, begin, end, about):
    """Give pieces of way, of ten minutes from begin to end [h]: both ends, (east, north) [nmi] of a
    place.
    """
    places = (
        plane(*yachts.at(time)[:2], about)
        for time in np.linspace(begin, end, round((end - begin) * 6) + 1)
    )
    yield from itertools.pairwise(np.stack(place, axis=-1) for place in places)


@pytest.mark.thorough
def test_fields_and_a_barrier_that_see_both_states(tmp_path):
    """Some are not yet under way when a field is first listened in, some go adrift in the next one,
    and at the barrier.
    """
    path = tmp_path / "case.toml"
    path.write_text(until(21.0) + SENSORS)
    updates = drift.run(drift.load(path)).updates.all
    drawn = Yachts(DRAWS, 4)

    stayed = drawn.departure <= HARBOUR[2][0]
    for a, b in ways(drawn, *HARBOUR[2], HARBOUR[0]):
        stayed &= (np.linalg.norm(a, axis=-1) < HARBOUR[1]) & (
            np.linalg.norm(b, axis=-1) < HARBOUR[1]
        )

    touched, half = np.zeros(DRAWS, bool), np.array(FIELD[1]) / 2
    s, c = np.sin(np.radians(FIELD[2])), np.cos(np.radians(FIELD[2]))
    own = np.array([[c, -s], [s, c]])  # width lies to the right of the direction, height along
    for a, b in ways(drawn, *FIELD[3], FIELD[0]):
        x, way = a @ own.T, (b - a) @ own.T
        shares = np.sort(
            np.stack([(-half - x) / way, (half - x) / way]), axis=0
        )  # of the way, where it is in each strip
        touched |= np.maximum(shares[0].max(axis=-1), 0) < np.minimum(shares[1].min(axis=-1), 1)

    crossed = np.zeros(DRAWS, bool)
    near, far = (np.stack(plane(*at, PICKET[0][0]), axis=-1) for at in PICKET[0])
    for a, b in ways(drawn, *PICKET[1], PICKET[0][0]):
        first, last = ((p - near) @ np.array([(far - near)[1], -(far - near)[0]]) for p in (a, b))
        met = a + (first / np.where(first == last, 1, first - last))[:, None] * (b - a)
        along = (met - near) @ (far - near) / np.sum((far - near) ** 2)
        crossed |= (first * last < 0) & (along > 0) & (along < 1)

    likelihoods = (
        HARBOUR[4] + (1 - HARBOUR[4]) * HARBOUR[3] * stayed,
        FIELD[5] + (1 - FIELD[5]) * FIELD[4] * touched,
        1 - PICKET[2] * crossed,
    )
    assert (drawn.distress < PICKET[1][1])[crossed].mean() > 0.1
    weights = np.ones(DRAWS)
    for update, likelihood in zip(updates, likelihoods, strict=True):
        agree(np.exp(update.log_evidence[-1]), weights, likelihood, update.name)
        weights = weights * likelihood


@pytest.mark.thorough
def test_a_pod_in_place_of_a_sweep_width_holds_in_both_states(tmp_path):
    """An area that holds all of them all the time finds each with its POD, whether it is under way
    or adrift.
    """
    path = tmp_path / "case.toml"
    everywhere = "[[-31, 39], [-25.5, 39], [-25.5, 42.5], [-31, 42.5]]"
    path.write_text(
        until(31.0).replace(f"particles = {PARTICLES}", "particles = 2000")
        + f'[[sortie]]\nname = "boats"\nstart = "+10 h"\nend = "+30 h"\npod = 0.3\narea = {{ polygon = {everywhere} }}\n'
    )
    (sortie,) = drift.run(drift.load(path)).updates.all
    assert np.exp(sortie.log_evidence[-1]) == pytest.approx(0.7, abs=1e-5)
