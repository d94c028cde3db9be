"""Contacts of passive sonars against draws in float64 that share no code with ours: bearings with
their images, wedges, errors by relative bearing, received levels, a source that three contacts
share, an unknown that three share, doubt.

Densities are SciPy's; unknown and fluctuation are summed over fine grids. Tolerances are three
standard errors of the difference, by the delta method from the brute force's draws.
"""

import numpy as np
import pytest
from courses import HOUR, NMI, out_of, plane, rhumb, triangle
from scipy import stats

import drift

KN = NMI / HOUR
PARTICLES, DRAWS = 100_000, 100_000
START, OWN = (-20.0, 50.0), 8.0  # [deg]; [nmi]
COURSE, SPEED = (20.0, 60.0, 130.0, 3.0), (4.0, 8.0, 14.0, 2.0)
ARRAY, HEADING = (-19.3, 50.1), 25.0
TOW, AHEAD, PACE = (-19.8, 50.6), 200.0, 6.0  # [deg], [deg], [kn]
LEVELS, SPREADING, ABSORPTION = ((4.0, 132.0), (14.0, 142.0)), 16.0, 0.02
NOISE, GAIN, THRESHOLD, FLUCTUATION, UNKNOWN = (
    70.0,
    ((0.0, 4.0), (45.0, 9.0), (90.0, 14.0), (135.0, 11.0), (180.0, 6.0)),
    6.0,
    5.0,
    3.0,
)
STDS = ((0.0, 14.0), (90.0, 5.0))
SOURCE, SOURCE_STD, HEARD_STD = 50.0, 0.06, 0.03  # [Hz]
# time [h], bearing [deg], received level and its error [dB], frequency [Hz]
HEARD = (
    (2.0, 129.0, (68.0, 2.0), 50.15),
    (4.0, 15.0, (71.0, 3.0), 49.96),
    (6.0, 355.0, None, 49.92),
)
WEDGE = (5.0, 285.0, 60.0, 0.6)  # time [h], bearing, width [deg], belief

SONAR = f"""
[sensor.sonar]
source_level = {[[f"{v} kn", f"{level} dB"] for v, level in LEVELS]}
loss = {{ spreading = {SPREADING}, absorption = "{ABSORPTION} dB/km", to = "200 nmi" }}
noise = "{NOISE} dB"
threshold = "{THRESHOLD} dB"
fluctuation = "{FLUCTUATION} dB"
gain = {{ table = {[[at, f"{gain} dB"] for at, gain in GAIN]}, symmetric = true, mirrored = true }}
"""


def case() -> str:
    text = f"""
title = "heard"
start = "1972-10-12T06:00Z"
duration = "7 h"
particles = {PARTICLES}
seed = 5
clock.step = "1 h"
coast.source = "none"
output.trajectories = {PARTICLES}
[[scenario]]
name = "submarine"
position = {{ at = {list(START)}, std = "{OWN} nmi" }}
[[scenario.phase]]
course.course = {{ low = {COURSE[0]}, best = {COURSE[1]}, high = {COURSE[2]}, ratio = {COURSE[3]} }}
course.speed = {{ low = "{SPEED[0]} kn", best = "{SPEED[1]} kn", high = "{SPEED[2]} kn", ratio = {SPEED[3]} }}
[[sensor]]
name = "west array"
at = {list(ARRAY)}
heading = {HEADING}
{SONAR}unknown = "{UNKNOWN} dB"
[[sensor]]
name = "tow"
{SONAR}
[[contact]]
name = "towed"
time = "+{WEDGE[0]} h"
belief = {WEDGE[3]}
bearing = {{ sensor = "tow", from = {list(TOW)}, heading = {AHEAD}, bearing = {WEDGE[1]}, wedge = "{WEDGE[2]} deg" }}
frequency = {{ value = "49.93 Hz", std = "0.1 Hz", source = "50 Hz", source_std = "0.1 Hz", speed = "{PACE} kn" }}
"""
    for k, (time, bearing, level, frequency) in enumerate(HEARD):
        text += f"""
[[contact]]
name = "heard {k}"
time = "+{time} h"
bearing = {{ sensor = "west array", bearing = {bearing}, std = {[[at, f"{std} deg"] for at, std in STDS]} }}
frequency = {{ value = "{frequency} Hz", std = "{HEARD_STD} Hz", source = "{SOURCE} Hz", source_std = "{SOURCE_STD} Hz", source_group = "shaft" }}
"""
        if level:
            text += f'received_level = {{ value = "{level[0]} dB", std = "{level[1]} dB" }}\n'
    return text


def turned(angle):
    return (np.asarray(angle) + 180) % 360 - 180


def terms(way, speed, heading):
    """Return the level that arrives, and gain - noise - threshold, of targets at (east, north)
    [nmi] with a speed [kn].
    """
    metres = np.linalg.norm(way, axis=-1) * NMI
    bearing = np.degrees(np.arctan2(*way.T))
    arrives = (
        np.interp(speed, *np.array(LEVELS).T)
        - SPREADING * np.log10(metres)
        - ABSORPTION * metres / 1000
    )
    return (
        bearing,
        arrives,
        np.interp(np.abs(turned(bearing - heading)), *np.array(GAIN).T) - NOISE - THRESHOLD,
    )


def shift(way, course, speed, own=(0.0, 0.0), c=1500.0):
    """Return Doppler's factor of targets with a course [deg] and speed [kn]; own: velocity (east,
    north) [kn] of the sensor.
    """
    toward = way / np.linalg.norm(way, axis=-1, keepdims=True)
    velocity = (
        speed[:, None]
        * KN
        * np.column_stack([np.sin(np.radians(course)), np.cos(np.radians(course))])
    )
    return (c + toward @ (np.array(own) * KN)) / (c + np.sum(velocity * toward, axis=-1))


def brute():
    """Return draws of place at the end [deg], and log likelihoods: of the array's three contacts,
    and of the towed one.
    """
    rng = np.random.default_rng(7)
    lon, lat = out_of(OWN * rng.standard_normal((DRAWS, 2)), START)
    course, speed = triangle(rng, COURSE, DRAWS), triangle(rng, SPEED, DRAWS)

    def at(time, place):
        return plane(*rhumb(lon, lat, course, speed * time), place)

    # Sums of a normal density every 0.4 of its std are right to exp(-2 (pi / 0.4)^2), and what is
    # left of it is half as wide at least.
    step = np.linspace(-6, 6, 31)
    weight = stats.norm.pdf(step) / stats.norm.pdf(step).sum()
    likelihood = np.zeros((len(HEARD), DRAWS))  # of the first, the first two, all three
    shared, tones = np.ones((len(step), DRAWS)), []
    for k, (time, told, level, frequency) in enumerate(HEARD):
        way = at(time, ARRAY)
        bearing, arrives, gain = terms(way, speed, HEADING)
        relative = np.abs(turned(bearing - HEADING))
        std = np.interp(np.minimum(relative, 180 - relative), *np.array(STDS).T)
        both = [stats.norm.pdf(turned(bearing - b), scale=std) for b in (told, 2 * HEADING - told)]
        shared = shared * (np.degrees(1) * 0.5 * (both[0] + both[1]))
        for j, unit in enumerate(step):
            own = arrives + UNKNOWN * unit
            if level is None:
                shared[j] *= stats.norm.cdf((own + gain) / FLUCTUATION)
                continue
            # over the fluctuation, on a fine grid: heard and measured
            e = np.linspace(-6 * FLUCTUATION, 6 * FLUCTUATION, 361)
            if j == 0:
                table = (
                    np.linspace(arrives.min() - 20, arrives.max() + 20, 1201),
                    np.unique(np.round(gain, 1)),
                )
                cut = e[None, :, None] > -(table[0][:, None, None] + table[1][None, None, :])
                dense = stats.norm.pdf(e, scale=FLUCTUATION) * stats.norm.pdf(
                    level[0] - table[0][:, None] - e, scale=level[1]
                )
                sums = np.einsum("ae,aeg->ag", dense, cut) * (e[1] - e[0])
            g = np.searchsorted(table[1], np.round(gain, 1)).clip(0, len(table[1]) - 1)
            x = (own - table[0][0]) / (table[0][1] - table[0][0])
            i = x.astype(int)
            shared[j] *= (1 - (x - i)) * sums[i, g] + (x - i) * sums[i + 1, g]
        tones.append((shift(way, course, speed), frequency))
        d = np.stack([own for own, _ in tones], axis=-1)
        covariance = SOURCE_STD**2 * d[:, :, None] * d[:, None, :] + HEARD_STD**2 * np.eye(k + 1)
        off = np.array([f for _, f in tones]) - SOURCE * d
        quadratic = np.einsum("ni,ni->n", off, np.linalg.solve(covariance, off[..., None])[..., 0])
        heard = np.exp(-quadratic / 2) / np.sqrt(np.linalg.det(2 * np.pi * covariance))
        likelihood[k] = heard * (weight @ shared)
    time, told, width, _ = WEDGE
    way = at(time, TOW)
    bearing, arrives, gain = terms(way, speed, AHEAD)
    d = shift(
        way, course, speed, (PACE * np.sin(np.radians(AHEAD)), PACE * np.cos(np.radians(AHEAD)))
    )
    tow = stats.norm.cdf((arrives + gain) / FLUCTUATION) * stats.norm.pdf(
        49.93 - 50 * d, scale=np.hypot(0.1, 0.1 * d)
    )
    inside = [np.abs(turned(bearing - b)) <= width / 2 for b in (told, 2 * AHEAD - told)]
    tow = tow * 0.5 * (inside[0] + inside[1].astype(float)) / np.radians(width)
    return plane(*rhumb(lon, lat, course, speed * 7.0), START), likelihood, tow


@pytest.mark.thorough
def test_contacts_of_arrays(tmp_path):
    path = tmp_path / "case.toml"
    path.write_text(case())
    result = drift.run(drift.load(path))
    end, likelihood, tow = brute()
    first, second, third = likelihood
    belief = WEDGE[3]
    given = second * tow  # the towed array's contact is the third
    doubted = belief * tow / (given.sum() / second.sum()) + 1 - belief
    chain = [first, second, given, third * doubted]
    over = [np.ones(DRAWS), first, second, second * doubted]
    spread = np.sqrt(1 / DRAWS + 1 / PARTICLES)
    for update, after, before in zip(result.updates.all, chain, over, strict=True):
        ratio = after.mean() / before.mean()
        error = np.std(after / after.mean() - before / before.mean()) * spread
        evidence = np.log(ratio)
        assert update.log_evidence[-1] == pytest.approx(evidence, abs=3 * error), update.name
        assert error < 0.05
    tracks = result.trajectories
    ours = plane(*(x[:, -1] * (360 / 2**32) for x in (tracks.lon, tracks.lat)), START)
    own = tracks.weight[:, -1]
    weight = chain[-1] / chain[-1].sum()
    for k in range(2):
        for power in (1, 2):
            mean = weight @ end[:, k]
            values = (end[:, k] - mean) ** power
            error = np.std(weight * DRAWS * (values - weight @ values)) * spread
            found = own @ (ours[:, k] - mean) ** power / own.sum()
            assert abs(found - weight @ values) < 3 * error, (k, power)
