"""Looks, presences, barriers and lines in runs of drifting particles, against paths in steps of 45
s in NumPy.
"""

import functools
import itertools
import math

import numpy as np
import pytest
from scipy import stats

from drift.case import file as case_file
from drift.engine.motion import simulate
from drift.evidence.filter.detection import looks
from drift.evidence.filter.records import Field, Look, Sight
from drift.pipeline import run_setup
from geo import sphere
from geo.errors import UserError
from kernels.runtime import runtime

NMI, KNOT = 1852.0, 1852.0 / 3600
LON, LAT = 179.9, -31.7  # what drifts crosses the antimeridian
D = 900.0  # [m2/s]
HOURS = 12
SETTING = f"""
start = "2026-11-21T00:00Z"
duration = "{HOURS} h"
particles = 16000
output.every = "{HOURS} h"
[clock]
step = "STEP"
[coast]
source = "none"
[[current]]
constant = {{ speed = "0.8 kn", toward = 61 }}
[uncertainty]
diffusivity = "{D} m2/s"
[[scenario]]
name = "early"
object = "water"
weight = 0.7
position = {{ at = [{LON}, {LAT}], std = "4 nmi" }}
[[scenario]]
name = "late"
object = "water"
weight = 0.3
position = {{ at = [{LON}, {LAT}], std = "4 nmi", time = "+1 h", until = "+6 h" }}
"""
VELOCITY = 0.8 * KNOT * np.array([math.sin(math.radians(61)), math.cos(math.radians(61))])


def at(east, north):
    """Return a position [deg] so far [nmi] from where the objects begin."""
    lon, lat = sphere.destination(math.radians(LON), math.radians(LAT), east * NMI, north * NMI)
    return [round(float(np.degrees(lon)), 9), round(float(np.degrees(lat)), 9)]


@functools.cache
def paths():
    """Return (places, release) of 2 x 4,000 paths in steps of 45 s [nmi], (2, n, m + 1, 2), and
    [h], (2, n).
    """
    n, dt = 4_000, 45.0
    steps = round(HOURS * 3600 / dt)
    random = np.random.default_rng(41)
    release = np.stack([np.zeros(n), random.uniform(1, 6, n)])
    moves = random.normal(size=(2, n, steps, 2), scale=math.sqrt(2 * D * dt)).astype(np.float32)
    moves += (VELOCITY * dt).astype(np.float32)
    moves[(np.arange(steps) * dt / 3600)[None, None] < release[:, :, None]] = 0
    places = np.concatenate(
        [random.normal(size=(2, n, 1, 2), scale=4 * NMI), moves], axis=2
    ).cumsum(axis=2)
    return places / NMI, release


def slices(begin, end, every):
    """Return which fine places lie from one time to another [h], in steps so many times as long."""
    return slice(round(begin * 80), round(end * 80) + 1, every)


def inside(places, release, begin, end, every, within):
    """Return (n,) pairs: whether paths are in a field throughout, and at some time."""
    part = slices(begin, end, every)
    there = np.arange(HOURS * 80 + 1)[None, None, part] / 80 >= release[..., None]
    found = within(places[:, :, part]) & there
    return found.all(axis=2), found.any(axis=2)


def meets(places, release, begin, end, every, corners):
    """Return the time [h] at which each path first crosses a line of straight parts, inf: never."""
    part = slices(begin, end, every)
    a, b = places[:, :, part][:, :, :-1], places[:, :, part][:, :, 1:]

    def side(u, v, w):
        return (v[..., 0] - u[..., 0]) * (w[..., 1] - u[..., 1]) - (v[..., 1] - u[..., 1]) * (
            w[..., 0] - u[..., 0]
        )

    found = np.zeros(a.shape[:-1], bool)
    for p, q in itertools.pairwise(corners):
        found |= ((side(p, q, a) > 0) != (side(p, q, b) > 0)) & (
            (side(a, b, p) > 0) != (side(a, b, q) > 0)
        )
    first = begin + (found.argmax(axis=2) + 0.5) * every / 80
    return np.where(found.any(axis=2), first, np.inf)


def turned(places, middle, degrees):
    """Return places [nmi] about a middle, in axes turned clockwise."""
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    east, north = places[..., 0] - middle[0], places[..., 1] - middle[1]
    return np.stack([east * c - north * s, east * s + north * c], axis=-1)


def in_box(places):
    return (np.abs(turned(places, (5.0, 2.0), 33)) < [4.0, 2.5]).all(axis=-1)


def in_circle(places):
    return np.hypot(places[..., 0] - 2.0, places[..., 1] - 1.0) < 9.0


BENT = np.array([[5.0, 9.0], [6.5, 3.0], [3.0, -2.0]])


@functools.cache
def barred(every):
    """Return the time [h] at which each path first crosses the barrier, inf: never."""
    return meets(*paths(), 1.7, 9.1, every, BENT)


CASES = {
    "never in a box": (
        f'[[presence]]\nname = "x"\nat = {at(5.0, 2.0)}\nwidth = "8 nmi"\nheight = "5 nmi"\nturned = 33\n'
        'start = "+2.3 h"\nend = "+5.6 h"\npresent = "never"\ndetection = 0.9\n',
        lambda x, r, every: 1 - 0.9 * inside(x, r, 2.3, 5.6, every, in_box)[1],
    ),
    "throughout in a circle": (
        f'[[presence]]\nname = "x"\nat = {at(2.0, 1.0)}\nradius = "9 nmi"\n'
        'start = "+2.3 h"\nend = "+6.6 h"\npresent = "throughout"\nfalse_alarms = 0.03\n',
        lambda x, r, every: 0.03 + 0.97 * inside(x, r, 2.3, 6.6, every, in_circle)[0],
    ),
    "sometime in a box": (
        f'[[presence]]\nname = "x"\nat = {at(5.0, 2.0)}\nwidth = "8 nmi"\nheight = "5 nmi"\nturned = 33\n'
        'start = "+4 h"\nend = "+7 h"\npresent = "sometime"\ndetection = 0.8\nfalse_alarms = 0.02\n',
        lambda x, r, every: 0.02 + 0.98 * 0.8 * inside(x, r, 4, 7, every, in_box)[1],
    ),
    "no report of a barrier": (
        f'[[barrier]]\nname = "x"\npoints = {[at(*p) for p in BENT]}\nstart = "+1.7 h"\nend = "+9.1 h"\ndetection = 0.85\n',
        lambda x, r, every: 1 - 0.85 * np.isfinite(barred(every)),
    ),
    "a report of a barrier": (
        f'[[barrier]]\nname = "x"\npoints = {[at(*p) for p in BENT]}\nstart = "+1.7 h"\nend = "+9.1 h"\ndetection = 0.85\n'
        'reported = "+5.2 h"\nerror = "40 min"\nfalse_alarms = "0.01 /h"\n',
        lambda x, r, every: _reported(barred(every)),
    ),
}  # fmt: skip


@functools.cache
def exact_of(name):
    """Return how likely what a sensor says is on each fine path, (2, n); what 45 s miss is found
    from what 180 s miss.
    """
    likelihood = CASES[name][1]
    return 2.0 * likelihood(*paths(), 1) - likelihood(*paths(), 4)


def _reported(first):
    """Return the density [1/s] of a report at 5.2 h, right to 40 min, and of one false report in
    100 h.
    """
    hit = np.isfinite(first)
    density = stats.norm.pdf(np.where(hit, first, 0), 5.2, 40 / 60) / 3600
    return 0.85 * hit * density + 0.01 / 3600 * (1 - 0.85 * hit)


def run(tmp_path, text, step="1 h", **overrides):
    """Run a case with sensors; return what was told of it, and its ensemble."""
    path = tmp_path / "case.toml"
    path.write_text(SETTING.replace("STEP", step) + text)
    case = case_file.load(path, overrides)
    runtime.start()
    begin = run_setup.prepare(case, run_setup.open_for(case))
    search = run_setup.build_search_filter(case, begin)
    outputs = case.period.seconds(case.outputs)
    moments = list(simulate.run(begin.ensemble, begin.scene, begin.clock, outputs, search=search))
    begin.scene.forcing.close()
    return search.updates, begin.ensemble, moments


@pytest.mark.parametrize("step", ["2 h", "30 min"])
@pytest.mark.parametrize("name", CASES)
@pytest.mark.thorough
def test_what_a_sensor_says_is_as_likely_as_on_fine_paths(tmp_path, name: str, step: str) -> None:
    """By scenario, whatever the step, in which it begins and ends."""
    text, exact = CASES[name][0], exact_of(name)
    updates, ensemble, _ = run(tmp_path, text, step)
    (update,) = updates.all
    assert update.kind == ("barrier" if "barrier" in name else "presence")
    for scenario in range(2):
        mean, spread = exact[scenario].mean(), exact[scenario].std() / math.sqrt(exact.shape[1])
        # the run's particles are more and give probabilities, which spread no more than what
        # happens
        slots = ensemble.bounds[scenario + 1] - ensemble.bounds[scenario]
        error = spread * math.sqrt(1 + exact.shape[1] / slots)
        assert error < 0.07 * mean
        # 3.5, for of twenty comparisons one in twenty suites would have one beyond 3
        assert abs(math.exp(update.log_evidence[scenario]) - mean) < 3.5 * error, scenario
    whole = np.exp(update.log_evidence[:2]) @ [0.7, 0.3]
    assert math.exp(update.log_evidence[2]) == pytest.approx(whole, rel=1e-4)  # of float32 weights
    assert update.posterior[0] == pytest.approx(
        0.7 * math.exp(update.log_evidence[0]) / whole, rel=1e-4
    )


@pytest.mark.thorough
def test_a_line_is_told_and_changes_no_weight(tmp_path) -> None:
    """Probability and 5, 50, 95 % of the first crossing by scenario, against fine paths; weights
    keep their bits.
    """
    text = f'[[line]]\nname = "sound"\npoints = {[at(*p) for p in BENT]}\n'
    updates, ensemble, _ = run(tmp_path, text)
    assert updates.all == ()
    weight = ensemble.log_weight.to_numpy()
    # as they were drawn
    assert all((weight[a:b] == weight[a]).all() for a, b in ensemble.scenarios)
    (crossing,) = updates.crossings.all
    places, release = paths()
    fine, coarse = (meets(places, release, 0, HOURS, every, BENT) for every in (1, 4))
    for scenario in range(2):
        hit = 2.0 * np.isfinite(fine[scenario]) - np.isfinite(coarse[scenario])
        error = hit.std() / math.sqrt(hit.size)
        assert abs(crossing.probability[scenario] - hit.mean()) < 3 * math.hypot(
            error, crossing.error[scenario]
        )
        times = np.sort(fine[scenario][np.isfinite(fine[scenario])])
        told = (crossing.first[scenario] - np.datetime64("2026-11-21T00:00:00")) / np.timedelta64(
            1, "h"
        )
        for share, time in zip((0.05, 0.5, 0.95), told, strict=True):
            # the share of fine paths that have crossed by then; those of 45 s are a little late
            found = np.searchsorted(times, time) / times.size
            assert abs(found - share) < 3 * math.sqrt(share * (1 - share) / times.size * 1.3) + 0.01
    assert crossing.mass.sum(axis=1) == pytest.approx(crossing.probability)
    assert crossing.probability[2] == pytest.approx([0.7, 0.3] @ crossing.probability[:2])


def test_a_look_is_bayes(tmp_path) -> None:
    """A turned box at a time inside a step, positive and negative, by each law written out; what is
    not released is not seen.
    """
    middle, wide, high, turn = (4.0, 2.0), 9.0, 6.0, 33
    places, release = paths()
    x = turned(places[:, :, round(3.7 * 80)], middle, turn)
    far = np.maximum(np.abs(x[..., 0]) / wide * 2, np.abs(x[..., 1]) / high * 2)
    chances = {
        '"cookie_cutter"': (far <= 1).astype(float),
        "{ linear = 0.95 }": 1 - 0.95 * np.minimum(far, 1),
        "{ exponential = 2 }": np.exp(-(far**2)),
        "{ table = [[0, 0.9], [0.7, 0.5], [1.4, 0.1]] }": np.interp(
            far, [0, 0.7, 1.4], [0.9, 0.5, 0.1], right=0
        ),
    }
    for law, chance in chances.items():
        seen = np.where(release < 3.7, chance, 0.0)
        for sees, exact in (("something", 0.05 + 0.95 * seen), ("nothing", 0.95 - 0.95 * seen)):
            text = (
                f'[[look]]\nname = "dip"\ntime = "+3.7 h"\nat = {at(*middle)}\nwidth = "{wide} nmi"\nheight = "{high} nmi"\n'
                f'turned = {turn}\nsees = "{sees}"\nlaw = {law}\nfalse_alarms = 0.05\n'
            )
            (update,) = run(tmp_path, text, particles="10000")[0].all
            for scenario in range(2):
                error = exact[scenario].std() / math.sqrt(exact.shape[1]) * math.sqrt(2)
                assert (
                    abs(math.exp(update.log_evidence[scenario]) - exact[scenario].mean())
                    < 3 * error
                )


def test_a_circle_and_a_box_have_the_distance_of_equation_13() -> None:
    """By hand, at 61 N: half way to the edge is 0.5 in a circle, and in a turned box that of the
    nearer side.
    """
    lon, lat = np.radians([10.0, 61.0])
    places = sphere.destination(
        lon, lat, np.array([0.0, 3000.0, 1000.0]), np.array([0.0, 0.0, 2000.0])
    )
    x, y = (sphere.to_binary(np.degrees(angle)) for angle in places)
    np.testing.assert_allclose(
        looks.distance(Field(10.0, 61.0, radius=6000.0), x, y),
        [0, 0.5, math.sqrt(5) / 6],
        atol=1e-5,
    )
    # its height lies east and west
    box = Field(10.0, 61.0, width=8000.0, height=10000.0, turned=math.pi / 2)
    np.testing.assert_allclose(looks.distance(box, x, y), [0, 0.6, 0.5], atol=1e-5)
    look = Look("x", np.datetime64("2026-11-21"), box, True, Sight("linear", 0.5))
    there = np.array([True, True, False])
    np.testing.assert_allclose(
        np.exp(looks.log_likelihood(look, x, y, there)), [1, 0.7, 0], atol=1e-5
    )


def test_outputs_show_what_a_field_has_said_so_far(tmp_path) -> None:
    """At the end of a step within its time a silent field has lost what it has not heard; a report
    to come changes nothing.
    """
    text, _ = CASES["never in a box"]
    _, ensemble, moments = run(tmp_path, text.replace("5.6", "9.4"), **{"output.every": "3 h"})
    places, release = paths()
    exact = 1 - 0.9 * inside(places, release, 2.3, 6, 1, in_box)[1][0]
    by_time = {moment.elapsed // 3600: moment.log_weight for moment in moments}
    first = slice(*ensemble.scenarios[0])

    def mean(hour):
        return (
            np.exp(by_time[hour][first].astype(float)).mean()
            / np.exp(by_time[0][first].astype(float)).mean()
        )

    assert mean(6) == pytest.approx(exact.mean(), abs=4 * exact.std() / math.sqrt(exact.size))
    assert mean(3) > mean(6) > mean(9) > 0.3
    shown = run(tmp_path, CASES["a report of a barrier"][0], **{"output.every": "3 h"})[2]
    assert (shown[2].log_weight == shown[0].log_weight).all()


@pytest.mark.thorough
def test_outputs_and_silent_sensors_change_no_bit(tmp_path) -> None:
    """More outputs leave the answer as it is; a line leaves the weights of a sensor as they are."""
    text, _ = CASES["no report of a barrier"]
    plain = run(tmp_path, text)[1].log_weight.to_numpy()
    more = run(tmp_path, text, **{"output.every": "40 min"})[1].log_weight.to_numpy()
    line = run(tmp_path, text + f"[[line]]\npoints = {[at(0, -20), at(25, 12)]}\n")[
        1
    ].log_weight.to_numpy()
    assert (plain == more).all()
    assert (plain == line).all()
    assert len(np.unique(plain)) > 1000


def test_copies_keep_what_a_field_has_heard(tmp_path) -> None:
    """Resampling within the time of a barrier: the evidence of all stays that of fine paths."""
    look = f'[[look]]\nname = "dip"\ntime = "+4 h"\nat = {at(3.0, 1.5)}\nradius = "5 nmi"\nsees = "something"\n'
    text, _ = CASES["no report of a barrier"]
    updates, _, _ = run(tmp_path, look + text, **{"resampling.below": "0.6"})
    assert updates.all[0].resampled
    places, release = paths()
    seen = (np.hypot(*(places[:, :, 320] - [3.0, 1.5]).T).T < 5.0) & (release < 4)
    exact = exact_of("no report of a barrier")
    for scenario in range(2):
        own = exact[scenario][seen[scenario]]
        found = math.exp(updates.all[1].log_evidence[scenario])
        assert abs(found - own.mean()) < 3.5 * own.std() / math.sqrt(own.size)


def test_what_contradicts_everything_is_refused(tmp_path) -> None:
    text = f'[[look]]\nname = "dip"\ntime = "+4 h"\nat = {at(300.0, 1.5)}\nradius = "5 nmi"\nsees = "something"\n'
    with pytest.raises(UserError, match='look "dip" contradicts every scenario'):
        run(tmp_path, text)
