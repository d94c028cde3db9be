"""Legs that sorties fly: the particle filter against brute force and closed forms."""

import dataclasses
import math

import numpy as np
import pytest
from filtered import (
    FLOW,
    METRES,
    NMI,
    SQUARE,
    STILL,
    filter_of,
    flown,
    hours,
    legs,
    load,
    run,
    seconds,
)

from drift.engine.motion import simulate
from drift.evidence.filter.records import (
    Law,
    Sortie,
    Watch,
)
from drift.pipeline import run_setup
from geo import sphere
from geo.errors import UserError
from geo.polyline import Area, Legs
from kernels.runtime import runtime


def test_two_overlapping_sorties_by_brute_force(tmp_path):
    """Inverse cube along two tracks at once, the field drifting at 2 kn: the hazard integrated in
    steps of 0.5 s.
    """
    first = legs([(-9000, -3000), (8000, -2500), (8200, 1500), (-8500, 2000)], 0.4, 20.0)
    second = legs([(5000, -6000), (4000, 6000), (-4000, 6500), (-3000, -6000)], 0.9, 11.0)
    widths = (1200.0, 700.0)
    sorties = tuple(
        flown(f"{k}", t, Law(), w)
        for k, (t, w) in enumerate(zip((first, second), widths, strict=True))
    )
    case = load(tmp_path, FLOW, sorties=sorties)
    _, still, _ = run(load(tmp_path, FLOW))
    _, ensemble, _ = run(case)
    hazard = np.zeros(ensemble.n)
    release = ensemble.release.to_numpy()
    # each particle's exact track: the end, less the current's great-circle rhumb; 3 h at 2 kn are
    # 11 km
    speed = 2 * NMI / 3600 * np.array([math.sin(math.radians(60)), math.cos(math.radians(60))])
    lon_end, lat_end = (c.to_numpy() for c in (ensemble.lon, ensemble.lat))
    lon_end = (lon_end.astype(np.int64) % 2**32) * (360 / 2**32)
    lat_end = sphere.to_degrees(lat_end)
    end, dt = seconds(3.0), 0.5
    for track, width in zip((first, second), widths, strict=True):
        a = width**2 / (4 * math.pi)
        every = np.arange(track.time[0] + dt / 2, track.time[-1], dt)[:, None]
        for k in range(len(track.time) - 1):
            t = every[np.searchsorted(track.time, every[:, 0]) == k + 1]
            share = (t - track.time[k]) / (track.time[k + 1] - track.time[k])
            corners = np.radians([track.lon[k], track.lat[k], track.lon[k + 1], track.lat[k + 1]])
            way = np.array(sphere.offset(*corners))
            x, y = sphere.destination(corners[0], corners[1], share * way[0], share * way[1])
            back = t - end
            lat = lat_end + speed[1] * back / METRES
            middle = np.radians(0.5 * (lat + lat_end))
            lon = lon_end + speed[0] * back / (METRES * np.cos(middle))  # a rhumb line, to 1e-7
            r = sphere.distance(x, y, np.radians(lon), np.radians(lat))
            # per unit of relative track: the sensor's velocity less the current
            ground = way / (track.time[k + 1] - track.time[k])
            relative = np.hypot(*(ground - speed))
            hazard += np.where(release <= t - seconds(0), a / (2 * r**3) * relative * dt, 0.0).sum(
                axis=0
            )
    found = still.log_weight.to_numpy() - ensemble.log_weight.to_numpy()
    ordinary = hazard < 8  # beyond, steps of 10 m are too coarse for the brute force
    assert ordinary.sum() > 350
    np.testing.assert_allclose(found[ordinary], hazard[ordinary], rtol=0.01, atol=2e-4)


@pytest.mark.parametrize(
    "law",
    [
        Law(),
        Law("definite_range"),
        Law("m_beta", 0.6),
        Law("curve", 1.0, (0.0, 400.0, 900.0), (0.9, 0.5, 0.0)),
    ],
)
def test_splitting_a_leg_changes_no_weight(tmp_path, law):
    """The same straight tracks cut into short legs, on a moving field: the same weights."""
    whole = legs([(-9000, -1000), (9000, -1000)], 0.3, 9.0)
    share = np.sort(np.concatenate([[0.0, 1.0], np.random.default_rng(2).uniform(0, 1, 12)]))
    way = np.array(
        sphere.offset(*np.radians([whole.lon[0], whole.lat[0], whole.lon[1], whole.lat[1]]))
    )
    x, y = sphere.destination(
        math.radians(whole.lon[0]), math.radians(whole.lat[0]), way[0] * share, way[1] * share
    )
    time = whole.time[0] + share * (whole.time[1] - whole.time[0])
    cut = Legs(
        tuple(time),
        tuple(np.degrees(np.unwrap(x))),
        tuple(np.degrees(y)),
        (True,) * (len(share) - 1),
    )
    results = []
    for track in (whole, cut):
        _, ensemble, _ = run(load(tmp_path, FLOW, sorties=(flown("sweep", track, law, 900.0),)))
        results.append(ensemble.log_weight.to_numpy())
    # While it drifts by 2 km a particle's north turns by 5e-4: a metre of lateral range, on the
    # steepest part of a law 2.5e-3.
    np.testing.assert_allclose(
        400 * np.exp(results[0]), 400 * np.exp(results[1]), rtol=0, atol=2.5e-3
    )
    assert len(np.unique(results[0])) > 1


@pytest.mark.parametrize("coverage", [0.5, 0.9, 1.7])
@pytest.mark.parametrize("kind", ["inverse_cube", "definite_range", "m_beta", "curve"])
def test_endless_sweeps_average_to_the_law(tmp_path, kind, coverage):
    """Parallel sweeps far beyond a field, at a spacing W / C, find b(C) of what is uniform in it."""
    n, high = 20_000, 0.1 * METRES  # of the field: a whole number of spacings
    spacing = high / round(high * coverage / 1000.0)
    width = coverage * spacing
    law = {
        "inverse_cube": Law(),
        "definite_range": Law("definite_range"),
        "m_beta": Law("m_beta", 0.7),
        # a triangle of height 0.8: W is its integral over both sides, so that it ends at W / 0.8
        "curve": Law("curve", 1.0, (0.0, width / 0.8), (0.8, 0.0)),
    }[kind]
    lines = (np.arange(-30, 31) + 0.137) * spacing
    points = [
        (x, y)
        for k, y in enumerate(lines)
        for x in ((-45_000, 45_000) if k % 2 == 0 else (45_000, -45_000))
    ]
    track = legs(points, 0.0, 2000.0)
    case = load(tmp_path, STILL + SQUARE, particles=n, sorties=(flown("sweep", track, law, width),))
    if kind == "definite_range" and coverage > 1:  # it was there and was missed: impossible
        with pytest.raises(UserError, match='sortie "sweep" contradicts every scenario'):
            run(case)
        return
    search, _, _ = run(case)
    # b(C), written out
    looks = coverage / 0.7
    offset = (np.arange(4000) + 0.5) / 4000 * spacing
    tracks = np.arange(-60, 61) * spacing
    triangle = np.maximum(0.8 - np.abs(offset[:, None] - tracks) * 0.8 / (width / 0.8), 0)
    expected = {
        "inverse_cube": math.erf(math.sqrt(math.pi) / 2 * coverage),
        "definite_range": min(coverage, 1.0),
        "m_beta": 1 - 0.3 ** math.floor(looks) * (1 - 0.7 * (looks - math.floor(looks))),
        "curve": 1 - np.prod(1 - triangle, axis=1).mean(),
    }[kind]
    found = float(search.updates.all[0].pos[-1])
    # 20,000 uniform places, POD between 0 and 1; the hazard of lines beyond 30 spacings is 1e-3 of
    # it all
    assert found == pytest.approx(expected, abs=4 * math.sqrt(expected * (1 - expected) / n) + 1e-3)


@pytest.mark.parametrize("completed", [1.0, 0.35])
def test_zones_in_closed_form(tmp_path, completed):
    """A watch with a convergence zone: an object in it all the time is missed with 1 - POD, one
    that crosses it by its share.

    Of a watch that was kept for a part of its time the hazard is that part.
    """
    watch = Watch((0.0, 20_000.0), (5000.0, 24_000.0), (0.5, 0.8))
    still = Legs((seconds(0.5), seconds(2.5)), (180.0, 180.0), (60.0, 60.0), (True,))
    sortie = Sortie(
        "buoy",
        "",
        hours(0.5),
        hours(2.5),
        Law(),
        (1.0,),
        legs=still,
        watch=watch,
        completed=completed,
    )
    text = (
        FLOW.replace("179.9", "179.4")
        .replace("59.95", "59.75")
        .replace("60.05", "60.25")
        .replace('until = "+1 h"', "")
    )
    _, ensemble, _ = run(load(tmp_path, text, sorties=(sortie,)))
    # the way of each particle past the buoy, by distances at 2,000 times
    speed = 2 * NMI / 3600 * np.array([math.sin(math.radians(60)), math.cos(math.radians(60))])
    lon_end = (ensemble.lon.to_numpy().astype(np.int64) % 2**32) * (360 / 2**32)
    lat_end = sphere.to_degrees(ensemble.lat.to_numpy())
    hazard = np.zeros(ensemble.n)
    times = (np.arange(2000) + 0.5) / 2000 * 2 + 0.5
    for t in times:
        back = 3600 * (t - 3.0)
        lat = lat_end + speed[1] * back / METRES
        lon = lon_end + speed[0] * back / (METRES * np.cos(np.radians(0.5 * (lat + lat_end))))
        r = sphere.distance(np.pi, np.radians(60), np.radians(lon), np.radians(lat))
        hazard += np.where(r < 5000, -math.log(0.5), 0) + np.where(
            (r >= 20_000) & (r < 24_000), -math.log(0.2), 0
        )
    found = np.log(np.full(ensemble.n, 1 / 400)) - ensemble.log_weight.to_numpy()
    np.testing.assert_allclose(
        found, completed * hazard / 2000, atol=4 * 1.61 / 2000 + 1e-3
    )  # an edge is told to one time of 2,000
    assert np.ptp(found) > completed


def test_a_pattern_that_drifts_with_its_marker(tmp_path):
    """In a uniform current a search in the frame of its datum does what it does on still water."""
    track = legs([(-4000, -2000), (4000, -2000), (4000, 2000), (-4000, 2000)], 1.2, 10.0)
    sortie = dataclasses.replace(
        flown("square", track, Law(), 900.0), frame="datum", datum=(180.0, 60.0)
    )
    begin = FLOW.replace('until = "+1 h"', "")
    where = load(tmp_path, begin)
    _, moved, _ = run(dataclasses.replace(where, sorties=(sortie,)))
    _, ground, _ = run(
        dataclasses.replace(where, sorties=(dataclasses.replace(sortie, frame="ground"),))
    )
    # where each particle was when the search began: there the still one waits
    case = load(tmp_path, begin.replace("2 kn", "0 kn"))
    case = dataclasses.replace(case, sorties=(sortie,))
    runtime.start()
    start_of = run_setup.prepare(case, run_setup.open_for(case))
    back = -3600 * 1.8 * 2 * NMI / 3600
    turn = math.radians(60)
    lat = sphere.to_degrees(moved.lat.to_numpy()) + math.cos(turn) * back / METRES
    middle = np.radians(0.5 * (lat + sphere.to_degrees(moved.lat.to_numpy())))
    lon = sphere.to_degrees(moved.lon.to_numpy()) + math.sin(turn) * back / (
        METRES * np.cos(middle)
    )
    start_of.ensemble.lon.from_numpy(sphere.to_binary(lon))
    start_of.ensemble.lat.from_numpy(sphere.to_binary(lat))
    search = filter_of(case, start_of)
    list(
        simulate.run(
            start_of.ensemble, start_of.scene, start_of.clock, np.array([0]), search=search
        )
    )
    start_of.scene.forcing.close()
    still = start_of.ensemble.log_weight.to_numpy()
    np.testing.assert_allclose(
        np.exp(moved.log_weight.to_numpy()), np.exp(still), rtol=0, atol=2.5e-3 / 400
    )
    assert np.abs(np.exp(ground.log_weight.to_numpy()) - np.exp(still)).max() > 0.5 / 400


def test_a_track_beside_its_area_has_a_pod(tmp_path):
    """What is seen outside the outline counts as searched: POC is never below POS."""
    beside = Area((179.99, 180.0, 180.0, 179.99), (60.2, 60.2, 60.21, 60.21))
    track = legs([(-9000, 0), (9000, 0)], 0.4, 20.0)
    sortie = dataclasses.replace(flown("astray", track, Law(), 2000.0), area=beside)
    update = run(load(tmp_path, STILL + SQUARE, sorties=(sortie,)))[0].updates.all[0]
    assert update.pos[-1] > 0.1
    assert update.poc[-1] == pytest.approx(update.pos[-1])
