"""A vessel under way, then adrift: where it is, and when its distress was, against NumPy by brute
force.
"""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from targets import HOUR, KNOT, NMI, triangle

from drift.case import file as case_file
from drift.engine.motion import simulate
from drift.engine.particles import ensemble as record
from drift.engine.particles.status import Status
from drift.evidence.filter.records import Contact, Fix, Law, Resampling, Sortie
from drift.pipeline import run_setup
from geo import sphere
from geo.polyline import Legs
from kernels.runtime import runtime

BEGIN = np.datetime64("2026-03-05T00:00:00")
POINTS = [(-40.0, 43.0), (-39.2, 43.35), (-38.1, 43.2)]
YACHT = """
title = "yacht"
start = "2026-03-05T00:00Z"
end = "+48 h"
particles = {n}
coast = {{ source = "none" }}
clock = {{ step = {step} }}
[[current]]
constant = {{ speed = "0.6 kn", toward = 130 }}
[[scenario]]
name = "yacht"
object = "water"
vessel = {{ land = "ignore" }}
distress = {{ rate = "0.5 /day" }}
{overdue}
[[scenario.phase]]
voyage = {{ waypoints = {points}, speed = {{ low = "4 kn", best = "5 kn", high = "8 kn", ratio = 5 }}, departure = ["+1 h", "+4 h"] }}
"""
CURRENT = 0.6 * KNOT * np.array([np.sin(np.radians(130)), np.cos(np.radians(130))])


def case_of(tmp_path: Path, n: int, step: int, overdue: str = "", **changes: Any) -> Any:
    path = tmp_path / "yacht.toml"
    points = [list(p) for p in POINTS]
    path.write_text(YACHT.format(n=n, step=step, overdue=overdue, points=points))
    return replace(case_file.load(path), **changes)


def run(case: Any, outputs: Any = ()) -> tuple[Any, Any, list[Any]]:
    runtime.start()
    begin = run_setup.prepare(case, run_setup.open_for(case))
    search = run_setup.build_search_filter(case, begin)
    moments = list(
        simulate.run(begin.ensemble, begin.scene, begin.clock, np.array(outputs), search=search)
    )
    begin.scene.forcing.close()
    return search, begin.ensemble, moments


class Yachts:
    """The same yachts in NumPy: departure, speed, distress; the current carries what is adrift as
    on a plane.
    """

    def __init__(self, n: int, seed: int) -> None:
        rng = np.random.default_rng(seed)
        self.points = np.radians(np.array(POINTS))
        self.far = np.append(
            0.0, np.cumsum(sphere.distance(*self.points[:-1].T, *self.points[1:].T))
        )
        self.departure = rng.uniform(1, 4, n) * HOUR
        self.speed = triangle(rng, 4, 5, 8, 5, n) * KNOT
        self.distress = self.departure + rng.exponential(2 * 24 * HOUR, n)
        self.arrival = self.departure + self.far[-1] / self.speed
        self.safe = self.distress > self.arrival

    def on_way(self, made: Any) -> Any:
        """Return (lon, lat) [rad] after so much of the voyage [m]."""
        made = np.clip(made, 0, self.far[-1])
        k = np.minimum(np.searchsorted(self.far, made, side="right") - 1, len(self.far) - 2)
        way = np.array(
            [sphere.offset(*a, *b) for a, b in zip(self.points[:-1], self.points[1:], strict=True)]
        )
        share = (made - self.far[k]) / np.diff(self.far)[k]
        return np.array(sphere.destination(*self.points[k].T, *(way[k].T * share)))

    def at(self, time: Any) -> Any:
        """Return (lon, lat) [rad] at a time [s]."""
        stop = np.where(self.safe, np.inf, self.distress)
        place = self.on_way((np.minimum(time, stop) - self.departure) * self.speed)
        drifted = np.maximum(time - stop, 0.0)
        # Loxodrome of a constant current: north along, east over the mean cosine.
        lat = place[1] + CURRENT[1] * drifted / sphere.RADIUS
        east = CURRENT[0] * drifted / (sphere.RADIUS * np.cos(0.5 * (lat + place[1])))
        return np.array([place[0] + east, lat])


@pytest.mark.thorough
@pytest.mark.parametrize("step", [3600, 10_800])
def test_the_position_law_at_distress_and_later(tmp_path: Path, step: int) -> None:
    """Positions 7 h, 20 h and 44 h on, and where it was at its distress; statuses in their shares."""
    n = 20_000
    times = [25_000, 72_000, 158_400]
    _, ensemble, moments = run(case_of(tmp_path, n, step), times)
    oracle = Yachts(400_000, 3)
    for moment in moments:
        true = oracle.at(float(moment.elapsed))
        east, north = sphere.offset(
            *np.radians(POINTS[1]), moment.lon * sphere.UNIT, moment.lat * sphere.UNIT
        )
        x, y = sphere.offset(*np.radians(POINTS[1]), *true)
        departed = oracle.departure <= moment.elapsed
        shares = {
            Status.PENDING: ~departed,
            Status.ARRIVED: oracle.safe & (oracle.arrival <= moment.elapsed),
            Status.ADRIFT: ~oracle.safe & (oracle.distress <= moment.elapsed),
        }
        for status, those in shares.items():
            p = those.mean()
            assert abs((moment.status == status).mean() - p) <= 4 * np.sqrt(p * (1 - p) / n) + 1e-9
        for found, truth in ((east, x), (north, y)):
            error = truth.std() * np.hypot(1 / np.sqrt(n), 1 / np.sqrt(truth.size))
            assert abs(found.mean() - truth.mean()) < 3.5 * error
            fourth = ((truth - truth.mean()) ** 4).mean()
            assert abs(found.var() - truth.var()) < 3.5 * np.sqrt((fourth - truth.var() ** 2) / n)
    release = ensemble.release.to_numpy()
    adrift = ensemble.status.to_numpy() == Status.ADRIFT
    own = ~oracle.safe & (oracle.distress <= 48 * HOUR)
    error = oracle.distress[own].std() / np.sqrt(adrift.sum())
    assert abs(release[adrift].mean() - oracle.distress[own].mean()) < 3.5 * error


@pytest.mark.thorough
def test_overdue_and_a_failed_sortie_change_when_the_distress_was(tmp_path: Path) -> None:
    """Not in port at 30 h, and not seen by a leg along its track at 14 h: the posterior of the time
    of distress.
    """
    n, many = 60_000, 120_000
    legs = np.radians(np.array([(-39.6, 43.2), (-38.7, 43.33)]))
    first = float((BEGIN + np.timedelta64(14, "h")).astype("datetime64[s]").astype(np.int64))
    length = float(sphere.distance(*legs[0], *legs[1]))
    last = first + length / (90 * KNOT)
    end = BEGIN + np.timedelta64(int(np.ceil(last - first)) + 14 * HOUR, "s")
    flown = Legs((first, last), *(tuple(np.degrees(x)) for x in legs.T), (True,))
    sortie = Sortie(
        "s",
        "",
        BEGIN + np.timedelta64(14, "h"),
        end,
        Law(),
        (1.0 * NMI,),
        width_under_way=(9.0 * NMI,),
        legs=flown,
    )
    case = case_of(tmp_path, n, 3600, 'overdue = "+30 h"', sorties=(sortie,))
    search, ensemble, _ = run(case)
    oracle = Yachts(many, 8)
    time = np.linspace(0, last - first, 60)
    way = np.array(sphere.offset(*legs[0], *legs[1]))
    sensor = np.array(sphere.destination(*legs[0], *(way[:, None] * time / time[-1])))
    hazard = np.zeros(many)
    before = None
    for t, x, y in zip(time, *sensor, strict=True):
        apart = np.array(sphere.offset(x, y, *oracle.at(14 * HOUR + t)))
        if before is not None:
            width = np.where(oracle.distress <= 14 * HOUR + t, 1.0, 9.0) * NMI
            way = apart - before
            d = np.hypot(*way)
            # Of a straight piece the integral of ds / (2 (c^2 + s^2)^1.5) is s / (2 c^2 (c^2 +
            # s^2)^0.5): c abeam, s along.
            beam = np.maximum(np.abs(way[0] * apart[1] - way[1] * apart[0]) / d, 1.0)
            ends = np.array([(way * before).sum(axis=0), (way * apart).sum(axis=0)]) / d
            share = ends / np.hypot(beam, ends)
            hazard += width**2 / (4 * np.pi) * (share[1] - share[0]) / (2 * beam**2)
        before = apart
    missed = np.exp(-hazard) * (oracle.departure <= (14 * HOUR)) + 1.0 * (
        oracle.departure > (14 * HOUR)
    )
    overdue = ~(oracle.safe & (oracle.arrival <= 30 * HOUR))
    found = [float(np.exp(update.log_evidence[-1])) for update in search.updates.all]
    for value, truth in zip(
        found, (missed.mean(), (missed * overdue).mean() / missed.mean()), strict=True
    ):
        assert abs(value - truth) < 3 * np.sqrt(truth * (1 - truth)) * np.hypot(
            1 / np.sqrt(n), 1 / np.sqrt(many)
        )
    weight = missed * overdue
    adrift_by = np.array([6, 9, 12, 15, 18]) * HOUR
    p = record.probability(ensemble)
    release = ensemble.release.to_numpy()
    for t in adrift_by:
        truth = (weight * (oracle.distress <= t) * ~oracle.safe).sum() / weight.sum()
        told = p[(release <= t) & (ensemble.status.to_numpy() != Status.ARRIVED)].sum()
        error = np.sqrt(truth * (1 - truth)) * np.hypot(
            np.sqrt((p**2).sum()), 1 / np.sqrt(many * weight.mean())
        )
        assert abs(told - truth) <= 3 * error


def test_debris_begins_at_its_own_distress(tmp_path: Path) -> None:
    """Debris found at 20 h: only where it can have drifted from distresses before is it likely;
    both drift alike.
    """
    n = 20_000
    oracle = Yachts(400_000, 5)
    place = oracle.at(20.0 * HOUR)[:, (~oracle.safe) & (oracle.distress < 10 * HOUR)].mean(axis=1)
    fix = Contact(
        "d", BEGIN + np.timedelta64(20, "h"), "position", fixes=(Fix(*np.degrees(place)),), major=9e3, minor=6e3,
        orientation=0.6,
    )  # fmt: skip
    case = case_of(tmp_path, n, 3600)
    case = replace(case, contacts=(replace(fix, drifter=case.scenarios[0].object),))
    search, *_ = run(case)
    there = ~oracle.safe & (oracle.distress <= 20 * HOUR)
    east, north = sphere.offset(*place, *oracle.at(20.0 * HOUR))
    c, s = np.cos(0.6), np.sin(0.6)
    along, across = north * c + east * s, east * c - north * s
    inside = there & (np.abs(along) < 6 * 9e3) & (np.abs(across) < 6 * 6e3)
    density = (
        np.exp(-0.5 * ((along / 9e3) ** 2 + (across / 6e3) ** 2)) / (2 * np.pi * 9e3 * 6e3) * inside
    )
    found = np.exp(search.updates.all[0].log_evidence[-1])
    assert abs(found - density.mean()) < 3 * density.std() * np.hypot(
        1 / np.sqrt(n), 1 / np.sqrt(density.size)
    )


def test_resampled_yachts_go_on(tmp_path: Path) -> None:
    """A contact near the first leg under way, then resampling: all slots live on, and the result is
    no other.
    """
    fix = Contact(
        "c",
        BEGIN + np.timedelta64(7, "h"),
        "position",
        fixes=(Fix(-39.5, 43.2),),
        major=6e3,
        minor=4e3,
    )
    plain, drawn = (
        run(
            case_of(
                tmp_path, 20_000, 3600, contacts=(fix,), resampling=Resampling("systematic", below)
            ),
            [120_000],
        )
        for below in (0.0, 0.9)
    )
    assert drawn[0].updates.all[0].resampled
    means = []
    for _, ensemble, moments in (plain, drawn):
        p = record.probability(ensemble)
        values = np.array(
            [
                moments[0].lon * sphere.UNIT,
                moments[0].lat * sphere.UNIT,
                ensemble.release.to_numpy() < 30 * HOUR,
            ]
        )
        mean = (values * p).sum(axis=1)
        means.append(
            (
                mean,
                np.sqrt(((values - mean[:, None]) ** 2 * p).sum(axis=1) * (plain_ess(plain)) ** -1),
            )
        )
    assert (np.abs(means[0][0] - means[1][0]) < 4 * np.sqrt(2) * means[0][1]).all()


def plain_ess(plain: Any) -> float:
    return float(1 / (record.probability(plain[1]) ** 2).sum())


def test_a_contact_carries_course_and_speed(tmp_path: Path) -> None:
    """A radar contact at 9.2 h, inside a step: of yachts at one place it tells the fast from the
    slow, and the drifting.
    """
    n = 30_000
    course = float(
        np.degrees(np.arctan2(*sphere.offset(*np.radians(POINTS[0]), *np.radians(POINTS[1]))))
    )
    fix = Contact(
        "c", BEGIN + np.timedelta64(33_120, "s"), "position", fixes=(Fix(-39.5, 43.22),), major=12e3, minor=9e3,
        course=np.radians(course + 4), course_std=np.radians(9), speed=5.6 * KNOT, speed_std=0.5 * KNOT,
    )  # fmt: skip
    search, ensemble, _ = run(case_of(tmp_path, n, 7200, contacts=(fix,)))
    oracle = Yachts(400_000, 21)
    when = 33_120.0
    here, later = oracle.at(when), oracle.at(when + 10)
    way = np.array(sphere.offset(*here, *later)) / 10
    moving = np.hypot(*way)
    turn = np.arctan2(*way) - fix.course
    turn = (turn + np.pi) % (2 * np.pi) - np.pi

    def normal(x: Any, std: float) -> Any:
        return np.exp(-0.5 * (x / std) ** 2) / (std * np.sqrt(2 * np.pi)) * (np.abs(x) <= 6 * std)

    north, east = sphere.offset(np.radians(-39.5), np.radians(43.22), *here)[::-1]
    likelihood = normal(north, 12e3) * normal(east, 9e3) * (oracle.departure <= when)
    likelihood = (
        likelihood * normal(turn, fix.course_std) * normal(moving - fix.speed, fix.speed_std)
    )
    found = np.exp(search.updates.all[0].log_evidence[-1])
    error = likelihood.std() * np.hypot(1 / np.sqrt(n), 1 / np.sqrt(likelihood.size))
    assert abs(found - likelihood.mean()) < 3 * error
    p = record.probability(ensemble)
    speed = ensemble.own["speed"].to_numpy()
    truth = (likelihood * oracle.speed).sum() / likelihood.sum()
    spread = np.sqrt((likelihood * (oracle.speed - truth) ** 2).sum() / likelihood.sum())
    effective = np.hypot(np.sqrt((p**2).sum()), np.sqrt((likelihood**2).sum()) / likelihood.sum())
    assert abs((p * speed).sum() - truth) < 3 * spread * effective
