"""Particles placed again at contacts, against Borovies' rules (2007, III.B.2) written out a second
time, on vectors, from what a run puts out.
"""

import math

import numpy as np
import pytest
from scipy import stats

import drift
from drift.evidence.filter import filling
from drift.evidence.filter.records import Contact, Fix
from geo import sphere
from geo.errors import UserError
from geo.polyline import Area

RADIUS, NMI, KNOT = 6371008.8, 1852.0, 1852 / 3600
PARTICLES, FASTEST = 6000, 32 * KNOT
RADAR = (179.72, -61.35)
CASE = f"""
title = "Lost boat"
start = "2026-03-05T00:07Z"
duration = "60 min"
particles = {PARTICLES}
seed = 5
clock.step = STEP
output.times = ["+20 min", "+22 min", "+45 min", "+47 min"]
output.trajectories = {PARTICLES}
coast.source = "none"
[resampling]
method = "METHOD"
below = 0.3
bulk = 0.2
fastest = "32 kn"
[[scenario]]
name = "boat"
position = {{ at = [179.6, -61.2], std = "2 nmi" }}
[[scenario.phase]]
course = {{ course = [20, 130], speed = ["14 kn", "24 kn"] }}
[[contact]]
name = "first"
time = "+20 min"
bearing = {{ from = [179.2, -61.25], bearing = 77, wedge = "30 deg", near = "6 nmi", far = "22 nmi" }}
[[contact]]
name = "second"
time = "+45 min"
bearing = {{ from = {list(RADAR)}, bearing = 341, wedge = "11 deg", near = "3 nmi", far = "14 nmi" }}
"""


def run(tmp_path, method, step="60", case=CASE):
    path = tmp_path / "case.toml"
    path.write_text(
        case.replace("METHOD", method).replace("STEP", step if step.isdigit() else f'"{step}"')
    )
    return drift.run(drift.load(path))


def vectors(tracks, minutes):
    column = int(np.searchsorted(tracks.time, tracks.time[0] + np.timedelta64(minutes, "m")))
    lon, lat = (
        np.asarray(x[:, column], float) * (2 * np.pi / 2**32) for x in (tracks.lon, tracks.lat)
    )
    place = np.stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)], axis=1)
    weight = np.asarray(tracks.weight[:, column], float)
    return place, weight / weight.sum()


def arc(a, b):
    return RADIUS * np.arctan2(np.linalg.norm(np.cross(a, b), axis=-1), (a * b).sum(axis=-1))


def bearing(origin, to):
    """Return the bearing [deg] of `to` from `origin`, unit vectors (..., 3)."""
    east = np.stack([-origin[..., 1], origin[..., 0], 0 * origin[..., 0]], axis=-1)
    east /= np.linalg.norm(east, axis=-1, keepdims=True)
    north = np.cross(origin, east)
    return np.degrees(np.arctan2((to * east).sum(-1), (to * north).sum(-1))) % 360


def apart(a, b):
    return np.abs((a - b + 180) % 360 - 180)


@pytest.mark.thorough
@pytest.mark.parametrize("method", ["position", "course", "combined"])
def test_what_a_contact_rules_out_is_placed_by_the_rules_of_the_paper(tmp_path, method):
    result = run(tmp_path, method)
    tracks = result.trajectories
    place, weight = vectors(tracks, 20)
    speed = arc(place, vectors(tracks, 22)[0]) / 120
    mean = weight @ place
    mean /= np.linalg.norm(mean)
    pace = weight @ speed  # of the particles' speeds, and not of their mean velocity
    place, weight = vectors(tracks, 45)
    later = vectors(tracks, 47)[0]
    speed, course = arc(place, later) / 120, bearing(place, later)

    lon, lat = np.radians(RADAR)
    sensor = np.array([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)])
    far = arc(sensor, place) / NMI
    assert apart(bearing(sensor[None], place), 341).max() < 5.5 + 0.01
    assert far.min() > 3 - 0.01
    assert far.max() < 14 + 0.01
    # alike in range, and not in area
    assert stats.kstest(far, stats.uniform(3, 11).cdf).pvalue > 0.01

    need = arc(mean, place) / (25 * 60)
    assert need.min() < pace < need.max()  # both sides of the window
    window = np.maximum(
        np.where(need < pace, need - (2 * pace - FASTEST), FASTEST - need), FASTEST * 0.1 / 32
    )
    expected = np.ones(PARTICLES) if method == "course" else window
    np.testing.assert_allclose(weight, expected / expected.sum(), rtol=2e-3)

    straight = apart(course, bearing(place, mean[None]) + 180) < 0.3
    error = 3 * math.sqrt(0.25 / PARTICLES)
    if method == "position":
        assert straight.mean() < 0.6 / 360 + error
        free = np.ones(PARTICLES, bool)
    else:
        assert abs(straight.mean() - (0.5 + 0.5 * 0.6 / 360)) < error
        free = ~straight
        exact = straight & (np.abs(speed - np.minimum(need, FASTEST)) < 0.01 * FASTEST)
        assert exact.sum() > 0.98 * straight.sum()
    assert stats.kstest(speed[free], stats.uniform(0, FASTEST).cdf).pvalue > 0.01
    assert stats.kstest(course[free], stats.uniform(0, 360).cdf).pvalue > 0.01

    first, second = result.updates.all
    assert (first.filled, second.filled) == ("", "contact")
    assert second.log_evidence[-1] == pytest.approx(-200, abs=10)  # nothing expected it


def test_what_survives_keeps_its_place_and_weighs_by_the_estimate(tmp_path):
    """Of 6,000 a tenth or so is in the second contact's box: those stay where they were."""
    case = CASE.replace(f"from = {list(RADAR)}", "from = [179.98, -61.25]")
    tracks = {
        method: run(
            tmp_path, method, case=case.replace('below = 0.3\nbulk = 0.2\nfastest = "32 kn"', rule)
        ).trajectories
        for method, rule in (
            ("systematic", ""),
            ("position", 'below = 0.3\nbulk = 0.2\nfastest = "32 kn"'),
        )
    }
    there, weighed = vectors(tracks["systematic"], 45)
    place, weight = vectors(tracks["position"], 45)
    left = weighed > 0
    assert 0.01 < left.mean() < 0.2
    assert np.array_equal(place[left], there[left])
    assert (arc(place, there)[~left] > 0).all()
    begin, share = vectors(tracks["position"], 20)
    pace = share @ (arc(begin, vectors(tracks["position"], 22)[0]) / 120)
    mean = share @ begin
    need = arc(mean / np.linalg.norm(mean), place) / 1500
    window = np.where(need < pace, need - (2 * pace - FASTEST), FASTEST - need)
    expected = np.maximum(np.where(left, FASTEST - pace, window), FASTEST * 0.1 / 32)
    np.testing.assert_allclose(weight, expected / expected.sum(), rtol=2e-3)


@pytest.mark.thorough
def test_it_does_not_depend_on_the_step(tmp_path):
    """What goes straight goes alike in any step."""
    fine, coarse = (run(tmp_path, "combined", step).trajectories for step in ("60", "20"))
    for minutes in (20, 45, 47):
        a, b = vectors(fine, minutes), vectors(coarse, minutes)
        assert arc(a[0], b[0]).max() < 3  # metres: rounding of courses
        np.testing.assert_allclose(a[1], b[1], rtol=1e-3)


def test_silence_that_leaves_too_few_loses_the_track_and_a_contact_finds_it_again(tmp_path):
    look = """
[[look]]
name = "all round"
time = "+30 min"
sees = "nothing"
at = [179.93, -61.17]
radius = "6 nmi"
"""
    result = run(tmp_path, "combined", case=CASE + look)
    assert [update.filled for update in result.updates.all] == ["", "lost", "contact"]
    assert not result.updates.all[1].resampled  # what little is left is not multiplied
    # what is placed again counts
    assert not any("effective after" in warning for warning in result.summary["warnings"])
    assert any("track is lost" in warning for warning in result.summary["warnings"])
    assert any(
        'after contact "second"' in w and "a heuristic, not a posterior" in w
        for w in result.summary["warnings"]
    )


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ('fastest = "32 kn"', "", "needs fastest"),
        ("below = 0.3", "", "needs 0 < bulk <= below"),
        ('method = "METHOD"', "", "bulk and fastest: only for method"),
        ('far = "22 nmi"', 'far = "22 nmi"', ""),
        ("clock.step = STEP", "clock.step = 420", "a step must end at each"),
        (
            'speed = ["14 kn", "24 kn"] }',
            'speed = "9 kn", until = "+40 min" }',
            'scenario "boat" drifts, follows',
        ),
        ('time = "+20 min"', 'time = "+0 min"', "at the start of the run"),
        ("time = ", "belief = 0.5\ntime = ", "no contact of the case allows it"),
        (
            "[resampling]",
            '[plan]\nbegin = "+50 min"\n[resampling]',
            "a plan needs particles of the posterior",
        ),
        (
            "[resampling]",
            '[[line]]\nname = "x"\npoints = [[179, -61], [179.5, -61]]\n[resampling]',
            "moves particles",
        ),
    ],
)
def test_what_cannot_be_placed_is_refused_in_a_line(tmp_path, old, new, told):
    assert old in CASE
    case = CASE.replace(old, new).replace("METHOD", "combined").replace("STEP", "60")
    path = tmp_path / "case.toml"
    path.write_text(case)
    if not told:
        drift.load(path)
        return
    with pytest.raises(UserError) as error:
        drift.run(drift.load(path))
    assert told in str(error.value)
    assert len(error.value.lines) == 1


def test_shards_are_refused(tmp_path):
    path = tmp_path / "case.toml"
    path.write_text(CASE.replace("METHOD", "combined").replace("STEP", "60"))
    with pytest.raises(UserError, match="run it in one piece"):
        drift.run(drift.load(path), shards=2)


def at(contact, n=40_000):
    """Return places (lon, lat) [rad] that a contact gives."""
    return filling.draw_positions(contact, n, np.random.default_rng(8))


def seen(kind, **more):
    return Contact("seen", np.datetime64("2026-03-05T00:00"), kind, **more)


def test_a_position_is_drawn_as_its_ellipse_lies():
    lon, lat = at(
        seen(
            "position",
            fixes=(Fix(179.99, 71.0),),
            major=3000.0,
            minor=800.0,
            orientation=math.radians(40),
        )
    )
    east, north = (
        ((lon - math.radians(179.99) + np.pi) % (2 * np.pi) - np.pi)
        * RADIUS
        * math.cos(math.radians(71)),
        (lat - math.radians(71)) * RADIUS,
    )
    c, s = math.cos(math.radians(40)), math.sin(math.radians(40))
    along, across = north * c + east * s, east * c - north * s
    # of a standard deviation, and that the plane is none
    tolerance = 3 / math.sqrt(2 * 40_000) + 0.003
    assert along.std() == pytest.approx(3000, rel=tolerance)
    assert across.std() == pytest.approx(800, rel=tolerance)
    assert abs(np.corrcoef(along, across)[0, 1]) < 3 / math.sqrt(40_000) + 0.003


def test_a_range_is_all_round_and_an_area_full():
    lon, lat = at(seen("range", sensor=(10.0, -60.0), range=9000.0, range_std=300.0))
    east, north = sphere.offset(math.radians(10), math.radians(-60), lon, lat)
    assert stats.kstest(np.hypot(east, north), stats.norm(9000, 300).cdf).pvalue > 0.01
    assert stats.kstest(np.arctan2(east, north), stats.uniform(-np.pi, 2 * np.pi).cdf).pvalue > 0.01
    ring = Area(
        (179.0, -179.0, 179.0), (60.0, 61.0, 62.0)
    )  # a triangle across 180: half of it west of the meridian through its middle
    lon, lat = at(seen("area", area=ring))
    x = (np.degrees(lon) - 179) % 360
    assert x.min() > -1e-3
    assert x.max() < 2 + 1e-3
    mean = np.stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)]).mean(
        axis=1
    )
    corners = np.radians([ring.lon, ring.lat])
    middle = np.stack(
        [
            np.cos(corners[1]) * np.cos(corners[0]),
            np.cos(corners[1]) * np.sin(corners[0]),
            np.sin(corners[1]),
        ]
    )
    middle = middle.mean(axis=1)  # of a small triangle the centroid is the mean of its corners
    apart_m = RADIUS * np.linalg.norm(mean / np.linalg.norm(mean) - middle / np.linalg.norm(middle))
    assert (
        apart_m < 3 * 45_000 / math.sqrt(40_000) + 200
    )  # places spread some 45 km; the sphere bends it by less than 200 m


@pytest.mark.thorough
def test_nothing_is_placed_on_land(tmp_path):
    """A box half of which is land is filled in its water; where a target minds no land it is filled
    all over.
    """
    (tmp_path / "coast.geojson").write_text(
        '{"type": "Polygon", "coordinates": [[[179.0, -61.6], [179.7, -61.6], [179.7, -60.5], [179.0, -60.5], [179.0, -61.6]]]}'
    )
    case = CASE.replace('coast.source = "none"', 'coast.source = "coast.geojson"').replace(
        "[179.6, -61.2]", "[179.85, -61.2]"
    )
    for land, dry in (("stop", False), ("ignore", True)):
        own = case.replace("[[scenario.phase]]", f'vessel.land = "{land}"\n[[scenario.phase]]')
        place, _ = vectors(run(tmp_path, "course", case=own).trajectories, 45)
        on_land = np.degrees(np.arctan2(place[:, 1], place[:, 0])) % 360 < 179.7 - 1e-6
        assert bool(on_land.mean() > 0.2) == dry
        assert dry or not on_land.any()


def test_what_finds_no_water_stays_ruled_out(tmp_path):
    """A second contact ashore places nobody, and the third finds all again."""
    (tmp_path / "coast.geojson").write_text(
        '{"type": "Polygon", "coordinates": [[[179.0, -61.6], [179.5, -61.6], [179.5, -60.5], [179.0, -60.5], [179.0, -61.6]]]}'
    )
    ashore = """
[[contact]]
name = "ashore"
time = "+30 min"
position = { at = [179.2, -61.1], std = "300 m" }
"""
    case = CASE.replace('coast.source = "none"', 'coast.source = "coast.geojson"')
    result = run(
        tmp_path,
        "combined",
        case=case.replace("[[scenario.phase]]", 'vessel.land = "stop"\n[[scenario.phase]]')
        + ashore,
    )
    assert [update.filled for update in result.updates.all] == ["", "lost", "contact"]
    _, weight = vectors(result.trajectories, 45)
    assert np.isfinite(weight).all()
    assert (weight > 0).mean() > 0.9
    assert np.isfinite(result.updates.log_evidence)


def test_what_acts_begins_anew(tmp_path):
    """A contact that contradicts all: nobody acts for 20 minutes then, whatever was due, all have
    by 25, and nobody hides any more.

    Before, all had fled on a course that acts turn by under a degree: with `change` they take any.
    """
    acting = (
        'behaviour = { course = [20, 130], speed = ["14 kn", "24 kn"], fastest = "32 kn", acts = ["20 min", "25 min"], '
        "change = 0.5, hide = 0.5, tracker = { at = [178.1, -61.9] } }"
    )
    case = CASE.replace('course = { course = [20, 130], speed = ["14 kn", "24 kn"] }', acting)
    case = case.replace('"60 min"', '"80 min"').replace("bearing = 341", "bearing = 205")
    case = case.replace(
        '"+20 min", "+22 min", "+45 min", "+47 min"',
        '"+46 min", "+55 min", "+64 min", "+71 min", "+79 min"',
    )
    tracks = run(tmp_path, "position", case=case).trajectories
    places = {minutes: vectors(tracks, minutes)[0] for minutes in (46, 55, 64, 71, 79)}
    ways = {(a, b): places[b] - places[a] for a, b in ((46, 55), (55, 64), (71, 79))}
    speeds = {key: arc(places[key[0]], places[key[1]]) / 60 / (key[1] - key[0]) for key in ways}
    # Rhumb lines bend in space by v^2 dt / (R cos lat) at most, 0.048 m/s at 32 kn and 61.35 S; an
    # act between turns many by metres a second.
    np.testing.assert_allclose(ways[46, 55] * RADIUS / 540, ways[55, 64] * RADIUS / 540, atol=0.05)
    # An act of hiding keeps the speed: half of all do, on the reciprocal of the bearing within 30
    # degrees; the others take any other.
    keeps = np.abs(speeds[71, 79] - speeds[55, 64]) < 0.01
    assert stats.binomtest(int(keeps.sum()), len(keeps), 0.5).pvalue > 1e-4
    lon, lat = np.radians([178.1, -61.9])
    tracker = np.array([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)])
    away = (
        bearing(places[71], places[79]),
        (bearing(places[71], np.broadcast_to(tracker, places[71].shape)) + 180) % 360,
    )
    fled = apart(*away)[keeps]
    # the bearing has turned since they acted, by 3 degrees in 6 minutes at most
    assert np.percentile(fled, 99) < 33
    assert stats.kstest(apart(*away)[~keeps] / 180, "uniform").pvalue > 1e-4
