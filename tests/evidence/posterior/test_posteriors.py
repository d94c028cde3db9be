"""Posteriors of what is not position: against NumPy by brute force, closed forms, and what
particles really did.
"""

from pathlib import Path

import numpy as np
import oracle
import pytest
from targets import HOUR, KNOT, NMI, triangle
from voyages import (
    AT_RISK,
    BRIDGE,
    CALM,
    CONTACT,
    COURSE,
    TENDER,
    YACHT,
    believed,
    load,
    moments,
    of,
)

from drift.case import file as case_file
from drift.engine.motion import simulate
from drift.engine.motion.steering import settled
from drift.engine.particles import ensemble as record
from drift.engine.particles.status import Status
from drift.evidence.posterior import marginal
from drift.pipeline import run_setup
from geo.array import Array
from kernels.runtime import runtime

HALF = 1.177410  # of a circular normal half lies within so many standard deviations: sqrt(2 ln 2)


def near(found: float, values: Array, weight: Array, ess: float) -> bool:
    """Whether a mean is within 3 standard errors, its own and the oracle's, of the oracle's
    weighted mean.
    """
    mean, std, own = moments(values, weight)
    return bool(abs(found - mean) < 3 * std * np.sqrt(1 / own + 1 / ess))


# What is settled at birth


def test_what_is_settled_is_what_the_targets_do(tmp_path: Path) -> None:
    """Courses and speeds are those of the columns at birth, arrivals those that come, destinations
    those reached.
    """
    case = load(tmp_path, YACHT, COURSE, TENDER, BRIDGE, n=8000)
    runtime.start()
    begin = run_setup.prepare(case, run_setup.open_for(case))
    ensemble, steering = begin.ensemble, begin.scene.steering
    own = settled.read_settled(ensemble, steering)
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
        ensemble.lat.to_numpy()[bridge] < np.radians(43.3) / np.pi * 2**31,
        own.destination[bridge] == 1,
    )


def test_copies_keep_what_was_settled(tmp_path: Path) -> None:
    """What is read after particles have been drawn again is what their ancestors had."""
    case = load(tmp_path, COURSE, BRIDGE, n=900)
    runtime.start()
    begin = run_setup.prepare(case, run_setup.open_for(case))
    before = settled.read_settled(begin.ensemble, begin.scene.steering)
    rng = np.random.default_rng(3)
    ancestors = np.concatenate([rng.integers(a, b, b - a) for a, b in begin.ensemble.scenarios])
    record.inherit(begin.ensemble.columns.values(), ancestors)
    after = settled.read_settled(begin.ensemble, begin.scene.steering)
    begin.scene.forcing.close()
    for name in ("speed", "course", "destination", "k", "arrival"):
        np.testing.assert_array_equal(getattr(after, name), getattr(before, name)[ancestors])


# Bayes


def along(far: Array, begin: tuple[float, float], end: tuple[float, float]) -> tuple[Array, Array]:
    """Return the places [deg] so many metres along a great circle from one place [deg] to another,
    by vectors.
    """
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
    case = load(
        tmp_path,
        YACHT,
        n=60_000,
        contact=CONTACT.format(name="seen", hours=14, lon=179.9, lat=43.9, error=14),
    )
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
            # A quantile's error, told as a share: sqrt(p (1 - p) / n). What lies below the found
            # ones has the levels' share.
            below = np.array([own[values <= q].sum() for q in found.quantiles[-1]]) / own.sum()
            level = np.array(marginal.LEVELS)
            assert (
                np.abs(below - level)
                < 3 * np.sqrt(level * (1 - level) * (1 / ess + 1 / moments(values, own)[2]))
            ).all()
    moved = of(posteriors, 1, "departure").mean[-1] - of(posteriors, 0, "departure").mean[-1]
    assert abs(moved) > 900  # the contact says something


def test_a_contact_on_the_time_of_distress(tmp_path: Path) -> None:
    """A yacht that may go adrift before it arrives is seen at 19 h, behind where it would be by
    then.

    Its law of distress, and the share that goes adrift at all, before and after, against NumPy:
    under way along the great circle, then with the current, whose way of 14 nmi at most is taken to
    be a great circle too.
    """
    at = (179.41, 43.14)
    case = load(
        tmp_path, AT_RISK, n=60_000,
        contact=CONTACT.format(name="seen", hours=19, lon=at[0], lat=at[1], error=13),
    )  # fmt: skip
    posteriors, _ = believed(case)
    rng, n = np.random.default_rng(23), 300_000
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
    lon, lat = oracle.moved(
        lon, lat, drifted * np.sin(np.radians(141)), drifted * np.cos(np.radians(141))
    )
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
    """A ship keeps watch in still water where a boat may have gone adrift on its voyage, and sees
    nothing.

    What is inside its zone for a share of the watch is missed with a chance of (1 - POD) to that
    power: docs/searches.md.
    """
    at = (179.77, 43.55)
    text = CALM.replace("0.9 kn", "0 kn").format(n=60_000) + VOYAGE.format(
        lon=at[0], lat=at[1]
    ).format(weight=1)
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
    rest = [
        still.format(name=f"boat {k}", weight=prior[k], lon=places[k], hours=1 + k)
        for k in range(3)
    ]
    calm = CALM.format(n=900).replace("0.9 kn", "0 kn")
    contacts = (("first", 5, 0.11, 61.4, 9.0), ("second", 9, -0.07, 61.2, 6.0))
    text = (
        calm
        + "".join(rest)
        + "".join(
            CONTACT.format(name=a, hours=b, lon=c, lat=d, error=e) for a, b, c, d, e in contacts
        )
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
    """Of a bridge to one of two destinations, with and without resampling between two contacts:
    within 3 errors.
    """
    contacts = [
        CONTACT.format(name=str(k), hours=h, lon=lon, lat=lat, error=55)
        for k, (h, lon, lat) in enumerate(((9, 179.6, 43.9), (15, -179.8, 44.2)))
    ]
    told = []
    for below in (0.0, 0.99):
        extra = f"[resampling]\nbelow = {below}\n"
        told.append(
            believed(load(tmp_path, BRIDGE, n=30_000, extra=extra, contacts="".join(contacts)))[0]
        )
    first, second = (of(posteriors, 2, "destination") for posteriors in told)
    p = first.table[-1, 0]
    assert 0.7 < p < 0.9999
    # Copies count as one: the effective number after the first contact bounds what they tell.
    ess = min(of(told[1], 1, "destination").ess[-1], first.ess[-1])
    assert abs(second.table[-1, 0] - p) < 3 * np.sqrt(2 * p * (1 - p) / ess)
    k = [of(posteriors, 2, "spread_rate") for posteriors in told]
    assert abs(k[0].mean[-1] - k[1].mean[-1]) < 3 * k[0].std[-1] * np.sqrt(2 / ess)
