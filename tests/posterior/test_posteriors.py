"""Posteriors of what is not position: against NumPy by brute force, closed forms, and what particles really did."""

import csv
import dataclasses
import io
from pathlib import Path

import numpy as np
import oracle
import pytest
from scipy import stats
from targets import HOUR, KNOT, NMI, triangle

import drift
from drift import start
from drift.case import file as case_file
from drift.case.record import Case
from drift.maps.imprint import Imprint, Setting
from drift.motion import settled, simulate
from drift.particles import ensemble as record
from drift.particles import partials
from drift.particles.status import Status
from drift.posterior import beliefs, marginal, tables
from drift.posterior import map as posterior_map
from drift.posterior.quantities import QUANTITIES
from drift.posterior.quantity import Quantity, Values
from drift.posterior.records import Posteriors
from geo.array import Array
from kernels import runtime

CALM = """
start = "2026-03-05T00:00Z"
duration = "30 h"
particles = {n}
[clock]
step = "1 h"
[coast]
source = "none"
[uncertainty]
diffusivity = 0
[[current]]
constant = {{ speed = "0.9 kn", toward = 141 }}
"""
YACHT = """
[[scenario]]
name = "yacht"
weight = {weight}
[[scenario.phase]]
[scenario.phase.voyage]
waypoints = [[178.3, 43.1], [-176.9, 44.2]]
departure = ["+1 h", "+9 h"]
speed = {{ low = "5 kn", best = "7 kn", high = "11 kn", ratio = 4 }}
"""
AT_RISK = f"""
{YACHT.replace("[[scenario.phase]]", 'object = "water"' + chr(10) + "[[scenario.phase]]")}
[scenario.distress]
between = ["+4 h", "+41 h"]
"""
TENDER = """
[[scenario]]
name = "tender"
weight = {weight}
object = "water"
position = {{ at = [178.3, 43.1], std = "3 nmi", time = "+2 h", until = "+6 h" }}
"""
COURSE = """
[[scenario]]
name = "course"
weight = {weight}
[scenario.position]
at = [178.3, 43.1]
std = "3 nmi"
[[scenario.phase]]
[scenario.phase.course]
course = {{ low = 330, best = 350, high = 65, ratio = 3 }}
speed = ["4 kn", "9 kn"]
"""
BRIDGE = """
[[scenario]]
name = "bridge"
weight = {weight}
[[scenario.phase]]
[scenario.phase.bridge]
k = "3 nmi/sqrt(h)"
k_spread = 1.6
[[scenario.phase.bridge.points]]
at = [178.3, 43.1]
std = "2 nmi"
time = ["+1 h", "+3 h"]
[[scenario.phase.bridge.destinations]]
at = [-179.2, 44.9]
std = "3 nmi"
time = ["+20 h", "+26 h"]
probability = 0.63
[[scenario.phase.bridge.destinations]]
at = [-178.8, 41.7]
std = "3 nmi"
time = ["+22 h", "+27 h"]
probability = 0.37
"""
CONTACT = """
[[contact]]
name = "{name}"
time = "+{hours} h"
position = {{ at = [{lon}, {lat}], error = "{error} nmi" }}
"""
HALF = 1.177410  # of a circular normal half lies within so many standard deviations: sqrt(2 ln 2)


def load(
    folder: Path, *parts: str, n: int = 4000, weights: tuple[float, ...] = (), extra: str = "", **more: object
) -> Case:
    """Return a case of parts, each scenario with its weight."""
    given = weights or (1.0,) * len(parts)
    text = "".join(part.format(weight=weight) for part, weight in zip(parts, given, strict=True))
    (folder / "case.toml").write_text(CALM.format(n=n) + extra + text + "".join(more.values()))  # type: ignore[arg-type]
    return case_file.load(folder / "case.toml")


def believed(case: Case) -> tuple[Posteriors, start.Start]:
    """Run a case without its products; return its posteriors, and its ensemble as it is at the end."""
    runtime.start()
    begin = start.prepare(case, start.open_for(case))
    held = start.beliefs(case, begin)
    assert held is not None
    search = start.search(case, begin, held)
    list(simulate.run(begin.ensemble, begin.scene, begin.clock, np.array([]), search=search))
    begin.scene.forcing.close()
    assert held.posteriors is not None
    return held.posteriors, begin


def of(posteriors: Posteriors, stage: int, name: str) -> marginal.Marginal:
    """Return the distribution of a quantity after an update."""
    number = [told.quantity.name for told in posteriors.told].index(name)
    return posteriors.stages[stage].marginals[number]


def sorted_quantiles(values: Array, weight: Array) -> Array:
    """Return the least values up to and with which weights add up to the levels, by sorting all of them."""
    order = np.argsort(values, kind="stable")
    up_to = np.cumsum(weight[order])
    return values[order][np.searchsorted(up_to, np.array(marginal.LEVELS) * up_to[-1])]


def moments(values: Array, weight: Array) -> tuple[float, float, float]:
    """Return mean, standard deviation and effective number."""
    mean = np.average(values, weights=weight)
    return mean, np.sqrt(np.average((values - mean) ** 2, weights=weight)), weight.sum() ** 2 / (weight**2).sum()


def near(found: float, values: Array, weight: Array, ess: float) -> bool:
    """Whether a mean is within 3 standard errors, its own and the oracle's, of the oracle's weighted mean."""
    mean, std, own = moments(values, weight)
    return bool(abs(found - mean) < 3 * std * np.sqrt(1 / own + 1 / ess))


# Sums


@pytest.fixture
def some() -> tuple[marginal.Weighted, Array, Array, np.random.Generator]:
    """Weights of 23,456 particles in four scenarios, the third of which has none left; where something holds."""
    rng = np.random.default_rng(7)
    bounds = (0, 9001, 9342, 14_000, 23_456)
    weight = rng.exponential(size=bounds[-1]) ** 3
    weight[bounds[2] : bounds[3]] = 0
    weight /= weight.max()
    scenario = np.repeat(np.arange(4), np.diff(bounds))
    blocks = partials.cut(bounds, bounds[:-1], (partials.BLOCK,) * 4)
    return marginal.weighted(weight, blocks), scenario, rng.random(bounds[-1]) < 0.7, rng


LAWS = {
    "normal": lambda rng, n: rng.normal(41.3, 2.2, n),
    "long tail": lambda rng, n: 3e5 + rng.lognormal(1.0, 2.5, n),
    "whole numbers": lambda rng, n: rng.integers(-3, 9, n).astype(float) ** 3,
    "nearly one value": lambda rng, n: np.where(rng.random(n) < 0.97, 5.5, rng.normal(0, 900, n)),
}


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("outside", [False, True])
def test_numbers_are_summed_and_ranked_exactly(law: str, outside: bool, some) -> None:  # type: ignore[no-untyped-def]
    """Mean, std, share, effective number and quantiles of each scenario and of all: sorting everything says the same.

    Also where values lie outside of the histogram: quantiles do not rest on its bins.
    """
    own, scenario, holds, rng = some
    values = LAWS[law](rng, scenario.size)
    low, high = np.quantile(values, [0.1, 0.6]) if outside else (values.min(), values.max())
    found = marginal.of_number(own, marginal.numbers(values, float(low), float(high)), holds)
    for row in range(5):
        mine = np.ones(scenario.size, bool) if row == 4 else scenario == row
        weight = np.where(holds & mine, own.weight, 0.0)
        if row == 2:
            assert np.isnan([found.share[row], found.mean[row], found.std[row], *found.quantiles[row]]).all()
            continue
        mean, std, ess = moments(values, weight)
        np.testing.assert_allclose(
            [found.mean[row], found.std[row], found.ess[row], found.share[row]],
            [mean, std, ess, weight.sum() / own.weight[mine].sum()],
            rtol=1e-9,
        )
        np.testing.assert_array_equal(found.quantiles[row], sorted_quantiles(values[weight > 0], weight[weight > 0]))
    np.testing.assert_allclose(found.table.sum(), found.share[-1], rtol=1e-12)


def test_angles_through_north(some) -> None:  # type: ignore[no-untyped-def]
    """Mean and std as scipy has them of as many copies as weights say; quantiles as of angles from -180 to 180."""
    own, scenario, holds, rng = some
    copies = rng.integers(0, 9, scenario.size).astype(float)
    own = marginal.weighted(copies / 8, own.blocks)
    degrees = rng.triangular(-48, 9, 77, scenario.size)
    turned = np.radians(degrees) + 2 * np.pi * rng.integers(0, 2, scenario.size)
    found = marginal.of_angle(own, marginal.angles(turned), holds)
    for row in (0, 1, 3, 4):
        mine = holds if row == 4 else holds & (scenario == row)
        repeated = np.radians(np.repeat(degrees[mine], copies[mine].astype(int)))
        assert found.mean[row] == pytest.approx(stats.circmean(repeated), rel=1e-10)
        assert found.std[row] == pytest.approx(stats.circstd(repeated), rel=1e-10)
        expected = sorted_quantiles(degrees[mine], copies[mine]) % 360
        np.testing.assert_allclose(np.degrees(found.quantiles[row]), expected, atol=1e-9)
    assert np.degrees(found.quantiles[-1, 0]) > 300 > np.degrees(found.quantiles[-1, -1])
    inside = (degrees % 360 >= 350) & holds
    bins = found.table[0, round(350 / 360 * 256) + 1 :].sum()  # the bins from 351.6 on
    assert bins == pytest.approx(copies[holds & (degrees % 360 >= 250 / 256 * 360)].sum() / copies.sum())
    assert bins < copies[inside].sum() / copies.sum()


def test_categories_are_summed_exactly(some) -> None:  # type: ignore[no-untyped-def]
    """Shares of each scenario's own weight; what a category means nothing for is missing from their sum."""
    own, scenario, holds, rng = some
    number = rng.integers(0, 3, scenario.size)
    found = marginal.of_category(own, np.where(holds, number, -1), holds, 3)
    for row in (0, 1, 3):
        mine = scenario == row
        expected = [own.weight[mine & holds & (number == k)].sum() / own.weight[mine].sum() for k in range(3)]
        np.testing.assert_allclose(found.table[row], expected, rtol=1e-12)
    np.testing.assert_allclose(found.share[-1], own.weight[holds].sum() / own.weight.sum(), rtol=1e-12)


# What is settled at birth


def test_what_is_settled_is_what_the_targets_do(tmp_path: Path) -> None:
    """Courses and speeds are those of the columns at birth, arrivals those that come, destinations those reached."""
    case = load(tmp_path, YACHT, COURSE, TENDER, BRIDGE, n=8000)
    runtime.start()
    begin = start.prepare(case, start.open_for(case))
    ensemble, steering = begin.ensemble, begin.scene.steering
    own = settled.read(ensemble, steering)
    parts = [slice(*slots) for slots in ensemble.scenarios]
    yacht, course, tender, bridge = parts
    np.testing.assert_array_equal(own.course[course], ensemble.own["course"].to_numpy()[course])
    for part in (yacht, course):
        np.testing.assert_array_equal(own.speed[part], ensemble.own["speed"].to_numpy()[part])
    assert [list(own.has[name]) for name in ("speed", "course", "destination", "k", "arrival")] == [
        [True, True, False, False], [False, True, False, False], [False, False, False, True],
        [False, False, False, True], [True, False, False, False],
    ]  # fmt: skip
    for name in ("speed", "course", "destination", "k"):
        assert (getattr(own, name)[tender] == 0).all()
    many = bridge.stop - bridge.start
    logs = np.log(own.k[bridge] / (3 * NMI / 60))
    assert abs(logs.mean()) < 3 * np.log(1.6) / np.sqrt(many)
    assert abs(logs.std() / np.log(1.6) - 1) < 3 / np.sqrt(2 * many)
    assert abs(own.destination[bridge].mean() - 0.37) < 3 * np.sqrt(0.63 * 0.37 / many)
    list(simulate.run(ensemble, begin.scene, begin.clock, np.array([])))
    begin.scene.forcing.close()
    status, since = ensemble.status.to_numpy(), ensemble.status_since.to_numpy()
    arrived = status[yacht] == Status.ARRIVED
    assert 0.2 < arrived.mean() < 0.999
    np.testing.assert_array_equal(since[yacht][arrived], own.arrival[yacht][arrived])
    assert (own.arrival[yacht][~arrived] > 30 * HOUR - 1).all()
    np.testing.assert_array_equal(
        ensemble.lat.to_numpy()[bridge] < np.radians(43.3) / np.pi * 2**31, own.destination[bridge] == 1
    )


def test_copies_keep_what_was_settled(tmp_path: Path) -> None:
    """What is read after particles have been drawn anew is what their ancestors had."""
    case = load(tmp_path, COURSE, BRIDGE, n=900)
    runtime.start()
    begin = start.prepare(case, start.open_for(case))
    before = settled.read(begin.ensemble, begin.scene.steering)
    rng = np.random.default_rng(3)
    ancestors = np.concatenate([rng.integers(a, b, b - a) for a, b in begin.ensemble.scenarios])
    record.inherit(begin.ensemble, ancestors)
    after = settled.read(begin.ensemble, begin.scene.steering)
    begin.scene.forcing.close()
    for name in ("speed", "course", "destination", "k", "arrival"):
        np.testing.assert_array_equal(getattr(after, name), getattr(before, name)[ancestors])


# Bayes


def along(far: Array, begin: tuple[float, float], end: tuple[float, float]) -> tuple[Array, Array]:
    """Return the places [deg] so many metres along a great circle from one place [deg] to another, by vectors."""
    a, b = (
        np.array([np.cos(y) * np.cos(x), np.cos(y) * np.sin(x), np.sin(y)])
        for x, y in (np.radians(begin), np.radians(end))
    )
    ahead = b - (a @ b) * a
    ahead /= np.linalg.norm(ahead)
    x, y, z = np.cos(far / oracle.R) * a[:, None] + np.sin(far / oracle.R) * ahead[:, None]
    return np.degrees(np.arctan2(y, x)), np.degrees(np.arcsin(z))


def apart(lon: Array, lat: Array, place: tuple[float, float]) -> Array:
    """Return distances [m] from a place (haversine)."""
    x, y, x0, y0 = (np.radians(v) for v in (lon, lat, *place))
    h = np.sin((y - y0) / 2) ** 2 + np.cos(y) * np.cos(y0) * np.sin((x - x0) / 2) ** 2
    return np.asarray(2 * oracle.R * np.arcsin(np.sqrt(h)))


PORTS = (178.3, 43.1), (-176.9, 44.2)
SEEN = (179.9, 43.9)  # off the way


def test_a_contact_on_departure_and_speed(tmp_path: Path) -> None:
    """Of a yacht seen at 14 h: the laws of departure and speed against a million draws by NumPy."""
    case = load(tmp_path, YACHT, n=60_000, contact=CONTACT.format(name="seen", hours=14, lon=179.9, lat=43.9, error=14))
    posteriors, _ = believed(case)
    rng, n = np.random.default_rng(19), 1_000_000
    departure = rng.uniform(1, 9, n) * HOUR
    speed = triangle(rng, 5 * KNOT, 7 * KNOT, 11 * KNOT, 4.0, n)
    far = np.maximum(14 * HOUR - departure, 0) * speed
    weight = np.exp(-0.5 * (apart(*along(far, *PORTS), SEEN) / (14 * NMI / HALF)) ** 2)
    for name, values in (("departure", departure), ("speed", speed)):
        for stage, own in ((0, np.ones(n)), (1, weight)):
            found = of(posteriors, stage, name)
            ess = found.ess[-1]
            assert near(found.mean[-1], values, own, ess)
            # A quantile's error, told as a share: sqrt(p (1 - p) / n). What lies below the found ones has the levels' share.
            below = np.array([own[values <= q].sum() for q in found.quantiles[-1]]) / own.sum()
            level = np.array(marginal.LEVELS)
            assert (
                np.abs(below - level) < 3 * np.sqrt(level * (1 - level) * (1 / ess + 1 / moments(values, own)[2]))
            ).all()
    moved = of(posteriors, 1, "departure").mean[-1] - of(posteriors, 0, "departure").mean[-1]
    assert abs(moved) > 900  # the contact says something


def test_a_contact_on_the_time_of_distress(tmp_path: Path) -> None:
    """A yacht that may go adrift before it arrives is seen at 19 h, behind where it would be by then.

    Its law of distress, and the share that goes adrift at all, before and after, against NumPy: under way along the great
    circle, then with the current, whose way of 14 nmi at most is taken to be a great circle too.
    """
    at = (179.41, 43.14)
    case = load(
        tmp_path, AT_RISK, n=60_000,
        contact=CONTACT.format(name="seen", hours=19, lon=at[0], lat=at[1], error=13),
    )  # fmt: skip
    posteriors, _ = believed(case)
    rng, n = np.random.default_rng(23), 1_000_000
    departure = rng.uniform(1, 9, n) * HOUR
    speed = triangle(rng, 5 * KNOT, 7 * KNOT, 11 * KNOT, 4.0, n)
    distress = rng.uniform(4, 41, n) * HOUR
    while (early := distress < departure).any():  # a time before the departure is drawn again
        distress[early] = rng.uniform(4, 41, early.sum()) * HOUR
    length = float(apart(*(np.array([x]) for x in PORTS[0]), PORTS[1])[0])
    before_port = distress < departure + length / speed
    adrift = before_port & (distress <= 30 * HOUR)  # later ones are beyond the run
    seconds = np.clip(np.minimum(distress, 19 * HOUR) - departure, 0, None)
    lon, lat = along(np.minimum(seconds * speed, length), *PORTS)
    drifted = np.where(before_port, np.clip(19 * HOUR - distress, 0, None), 0.0) * 0.9 * KNOT
    lon, lat = oracle.moved(lon, lat, drifted * np.sin(np.radians(141)), drifted * np.cos(np.radians(141)))
    weight = np.exp(-0.5 * (apart(lon, lat, at) / (13 * NMI / HALF)) ** 2)
    for stage, own in ((0, np.ones(n)), (1, weight)):
        found = of(posteriors, stage, "adrift")
        assert near(found.mean[-1], distress[adrift], own[adrift], found.ess[-1])
        share, ess = own[adrift].sum() / own.sum(), posteriors.stages[stage].ess
        error = np.sqrt(share * (1 - share) * (1 / ess + 1 / moments(speed, own)[2]))
        assert abs(found.share[-1] - share) < 3 * error
    assert abs(of(posteriors, 1, "adrift").share[-1] - of(posteriors, 0, "adrift").share[-1]) > 0.05
    assert of(posteriors, 1, "adrift").mean[-1] < of(posteriors, 0, "adrift").mean[-1] - HOUR


VOYAGE = """
[[scenario]]
name = "voyage"
weight = {{weight}}
object = "water"
[scenario.trackline]
waypoints = [[178.3, 43.1], [-176.9, 44.2]]
departure = "+1 h"
speed = "11 kn"
cross_track = "1 m"
[[sortie]]
name = "ship"
start = "+5 h"
end = "+9.5 h"
watch = {{{{ at = [{lon}, {lat}], zones = [["0 nmi", "25 nmi", 0.83]] }}}}
"""


def test_a_failed_sortie_on_the_time_of_distress(tmp_path: Path) -> None:
    """A ship keeps watch in still water where a boat may have gone adrift on its voyage, and sees nothing.

    What is inside its zone for a share of the watch is missed with a chance of (1 - POD) to that power: docs/search.md.
    """
    at = (179.77, 43.55)
    text = CALM.replace("0.9 kn", "0 kn").format(n=60_000) + VOYAGE.format(lon=at[0], lat=at[1]).format(weight=1)
    (tmp_path / "case.toml").write_text(text)
    posteriors, _ = believed(case_file.load(tmp_path / "case.toml"))
    length = float(apart(*(np.array([x]) for x in PORTS[0]), PORTS[1])[0])
    time = HOUR + (np.arange(500_000) + 0.5) / 500_000 * length / (11 * KNOT)
    near_ship = apart(*along((time - HOUR) * 11 * KNOT, *PORTS), at) < 25 * NMI
    inside = np.clip(9.5 * HOUR - np.maximum(time, 5 * HOUR), 0, None) / (4.5 * HOUR)
    missed = np.where(near_ship, (1 - 0.83) ** inside, 1.0)
    prior, after = (of(posteriors, stage, "adrift") for stage in (0, 1))
    for found, weight in ((prior, np.ones(time.size)), (after, missed)):
        mean, std, _ = moments(time, weight)
        assert abs(found.mean[-1] - mean) < 3 * std / np.sqrt(found.ess[-1])
        below = np.array([weight[time <= q].sum() for q in found.quantiles[-1]]) / weight.sum()
        level = np.array(marginal.LEVELS)
        assert (np.abs(below - level) < 3 * np.sqrt(level * (1 - level) / found.ess[-1])).all()
    assert after.mean[-1] - prior.mean[-1] > 600
    assert posteriors.stages[1].kind == "sortie"


def test_scenarios_by_the_product_of_their_evidence(tmp_path: Path) -> None:
    """Three boats lie still at known places; two contacts are normal about places: closed form.

    log weights are float32 sums of a few tens, so shares are right to 1e-5.
    """
    still = """
[[scenario]]
name = "{name}"
weight = {weight}
object = "water"
position = {{ at = [{lon}, 61.3], std = "1 mm", time = "+{hours} h" }}
"""
    places, prior = (-0.31, 0.02, 0.27), np.array([0.5, 0.2, 0.3])
    rest = [still.format(name=f"boat {k}", weight=prior[k], lon=places[k], hours=1 + k) for k in range(3)]
    calm = CALM.format(n=900).replace("0.9 kn", "0 kn")
    contacts = (("first", 5, 0.11, 61.4, 9.0), ("second", 9, -0.07, 61.2, 6.0))
    text = (
        calm
        + "".join(rest)
        + "".join(CONTACT.format(name=a, hours=b, lon=c, lat=d, error=e) for a, b, c, d, e in contacts)
    )
    (tmp_path / "case.toml").write_text(text)
    posteriors, _ = believed(case_file.load(tmp_path / "case.toml"))
    share = prior
    for stage, (_, _, lon, lat, error) in enumerate(contacts, 1):
        far = apart(np.array(places), np.full(3, 61.3), (lon, lat))
        share = share * np.exp(-0.5 * (far / (error * NMI / HALF)) ** 2)
        share = share / share.sum()
        np.testing.assert_allclose(of(posteriors, stage, "scenario").table[-1], share, rtol=1e-5)
        # Each goes adrift at a time of its own: the mean says the same.
        expected = share @ (np.arange(1, 4) * HOUR)
        assert of(posteriors, stage, "adrift").mean[-1] == pytest.approx(expected, rel=1e-5)


def test_particles_that_are_drawn_anew_tell_the_same(tmp_path: Path) -> None:
    """Of a bridge to one of two destinations, with and without resampling between two contacts: within 3 errors."""
    contacts = [
        CONTACT.format(name=str(k), hours=h, lon=lon, lat=lat, error=55)
        for k, (h, lon, lat) in enumerate(((9, 179.6, 43.9), (15, -179.8, 44.2)))
    ]
    told = []
    for below in (0.0, 0.99):
        extra = f"[resampling]\nbelow = {below}\n"
        told.append(believed(load(tmp_path, BRIDGE, n=30_000, extra=extra, contacts="".join(contacts)))[0])
    first, second = (of(posteriors, 2, "destination") for posteriors in told)
    p = first.table[-1, 0]
    assert 0.7 < p < 0.9999
    # Copies count as one: the effective number after the first contact bounds what they tell.
    ess = min(of(told[1], 1, "destination").ess[-1], first.ess[-1])
    assert abs(second.table[-1, 0] - p) < 3 * np.sqrt(2 * p * (1 - p) / ess)
    k = [of(posteriors, 2, "spread_rate") for posteriors in told]
    assert abs(k[0].mean[-1] - k[1].mean[-1]) < 3 * k[0].std[-1] * np.sqrt(2 / ess)


# Files


@pytest.fixture
def four(tmp_path: Path) -> Posteriors:
    """Four scenarios, one of which drifts alone, before and after a contact."""
    contact = CONTACT.format(name="seen", hours=14, lon=179.7, lat=44.0, error=40)
    text = load(tmp_path, AT_RISK, COURSE, TENDER, BRIDGE, weights=(0.4, 0.3, 0.1, 0.2), contact=contact)
    return believed(text)[0]


def rows(posteriors: Posteriors) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(tables.csv(posteriors, "run"))))


def test_the_table_is_whole(four: Posteriors) -> None:
    """Each quantity in the scenarios that have it and in all; shares of all are those of scenarios, weighted."""
    found = rows(four)
    having = {
        "scenario": set(), "departure": {"yacht", "course", "bridge"}, "speed": {"yacht", "course"}, "course": {"course"},
        "destination": {"yacht", "bridge"}, "adrift": {"yacht", "tender"}, "spread_rate": {"bridge"},
    }  # fmt: skip
    for stage in (0, 1):
        mine = [row for row in found if row["update"] == str(stage)]
        assert {row["name"] for row in mine} == {("before the first update", "seen")[stage]}
        scenario = {row["value"]: float(row["share"]) for row in mine if row["quantity"] == "scenario"}
        assert sum(scenario.values()) == pytest.approx(1)
        assert {row["quantity"] for row in mine} == set(having)
        for name, names in having.items():
            of_it = [row for row in mine if row["quantity"] == name]
            assert {row["scenario"] for row in of_it} == {*names, "all"}
            whole = sum(float(row["share"]) for row in of_it if row["scenario"] == "all")
            parts = sum(scenario[row["scenario"]] * float(row["share"]) for row in of_it if row["scenario"] != "all")
            assert whole == pytest.approx(parts if names else 1, rel=1e-6)
    times = [row for row in found if row["quantity"] == "departure" and row["scenario"] == "yacht"]
    for row in times:
        ends = np.array([row[name].rstrip("Z") for name in (*tables.QUANTILES, "mean")], "datetime64[s]")
        assert (np.diff(ends[:-1]) > np.timedelta64(0, "s")).all()
        hours = (ends - np.datetime64("2026-03-05T00:00:00")) / np.timedelta64(1, "h")
        assert hours.min() >= 1
        assert hours.max() <= 9
        assert 0.5 < float(row["std"]) < 8 / np.sqrt(12) + 0.1  # hours
    destinations = {row["value"] for row in found if row["quantity"] == "destination"}
    assert destinations == {"44-12.0N 176-54.0W", "44-54.0N 179-12.0W", "41-42.0N 178-48.0W"}
    assert len(tables.numbers(four)) == 2


def test_the_picture(four: Posteriors, tmp_path: Path) -> None:
    """Charts hold all but the tails, courses are cut away from their mean, and it is drawn."""
    stages = posterior_map.shown(four)
    for k, told in enumerate(four.told):
        own = posterior_map.panel(four, stages, k)
        for row, stage in zip(own.rows, stages, strict=True):
            share = stage.marginals[k].share[-1]
            assert share * (1 - 2.01 * posterior_map.TAILS) <= row.sum() <= share * (1 + 1e-9)
        assert (np.diff(own.edges) > 0).all()
        # Those that keep a course all depart at once, and stand out of the departures.
        alone = [] if own.lone is None else np.flatnonzero(own.lone).tolist()
        assert alone == ([0] if told.quantity.name == "departure" else [])
        if told.quantity.name == "course":
            low, high = np.degrees(own.edges[[0, -1]])
            assert low < 360 < high or low < 0 < high  # north is inside, and so is no turn of nothing
            assert 95 / 2 < high - low < 110
    setting = Setting(Imprint("Of a $ and a $", caution="SYNTHETIC"))
    posterior_map.draw(four, tmp_path / "posteriors.png", setting)
    assert (tmp_path / "posteriors.png").read_bytes().startswith(b"\x89PNG")


def test_many_values_and_many_updates(four: Posteriors) -> None:
    """Of a category the likeliest values and the others together; of updates the first row and the last."""
    many = dataclasses.replace(
        four, stages=(four.stages[0], *[dataclasses.replace(four.stages[1], number=k) for k in range(1, 40)])
    )
    assert [stage.number for stage in posterior_map.shown(many)] == [0, *range(29, 40)]
    table = np.random.default_rng(2).dirichlet(np.full(300, 0.2), 5)
    told = dataclasses.replace(four.told[0], labels=tuple(f"route {k}" for k in range(300)))
    own = posterior_map._of_category(told, table)
    assert len(own.names) == posterior_map.MOST_VALUES
    assert own.names[-1] == "289 others"
    np.testing.assert_allclose(own.rows.sum(axis=1), 1)
    kept = {f"route {k}" for k in np.argsort(table.max(axis=0))[-11:]}
    assert set(own.names[:-1]) == kept


def test_a_quantity_more_is_one_entry(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Such as the member of an ensemble of forcings: it is told and drawn with nothing else changed."""
    member = Quantity(
        "member", "Member", "category", lambda drawn: Values(np.arange(drawn.ensemble.n) % 5, drawn.scenario == 0),
        labels=lambda spec: tuple("abcde"),
    )  # fmt: skip
    monkeypatch.setattr(beliefs, "QUANTITIES", (*QUANTITIES, member))
    posteriors, _ = believed(load(tmp_path, YACHT, TENDER, n=1000))
    mine = [row for row in rows(posteriors) if row["quantity"] == "member"]
    assert [(row["scenario"], row["value"]) for row in mine] == [
        *(("yacht", x) for x in "abcde"),
        *(("all", x) for x in "abcde"),
    ]
    assert [float(row["share"]) for row in mine] == pytest.approx([0.2] * 5 + [0.1] * 5)


def test_what_is_told_of_runs_without_searches(tmp_path: Path) -> None:
    """Where something steers: its prior, in the summary too; where all drift and nothing was seen: nothing."""
    result = drift.run(load(tmp_path, YACHT, n=500))
    assert result.posteriors is not None
    assert [stage.kind for stage in result.posteriors.stages] == ["prior"]
    (summary,) = result.summary["posteriors"]
    assert set(summary["quantities"]) == {"departure", "speed"}
    assert 5 < summary["quantities"]["speed"]["q05"] < summary["quantities"]["speed"]["q95"] < 11
    alone = load(tmp_path, TENDER, n=500)
    assert drift.run(alone).posteriors is None


def test_nothing_uncertain_is_nothing_told(tmp_path: Path) -> None:
    """A drifter released at a known time, of one scenario, whose sides do not differ: there is no table."""
    still = TENDER.replace(', until = "+6 h"', "")
    contact = CONTACT.format(name="seen", hours=14, lon=178.5, lat=43.0, error=40)
    case = load(tmp_path, still, n=500, contact=contact)
    runtime.start()
    begin = start.prepare(case, start.open_for(case))
    held = start.beliefs(case, begin)
    begin.scene.forcing.close()
    assert held is not None
    assert held.posteriors is None
