"""Where particles are inside a step: outputs, looks and shores between its ends, against closed
forms.
"""

import numpy as np
import pytest
import shapely

from drift.engine.motion import simulate, step_size
from drift.engine.motion.clock import Clock, off_lattice_times
from drift.engine.motion.forcing import Forcing, Sources
from drift.engine.motion.models.drift import COLUMNS, DRIFT
from drift.engine.motion.models.model import Motion
from drift.engine.motion.scene import Kept, Scene
from drift.engine.particles import ensemble as record
from drift.engine.particles.status import Status
from geo import sphere
from geo.box import Box
from geo.coast import edges as shoreline
from geo.coast.shore import Shore
from geo.forcing import sources
from geo.forcing.sources import Source
from geo.grids.grid import Grid
from kernels.runtime import runtime
from kernels.step import advance as kernel
from kernels.step import coast as device_coast
from kernels.step import curve

EVERYWHERE = kernel.Domain(-(2**31), -(2**30), 2**32 - 1, 2**31)
T0 = 1_795_000_000 // 3600 * 3600
SPEED, PERIOD = 2.4, 44_712.0  # [m/s], [s] a strong tide


def tide(hours: int) -> Source:
    """An M2 tide along a course of 30 degrees, known at full hours: linear in time between them."""
    time = 3600 * np.arange(hours + 1)
    speed = SPEED * np.sin(2 * np.pi * time / PERIOD)
    stamps = (T0 + time).astype("datetime64[s]")
    return sources.uniform_field(
        "current", stamps, speed * np.sin(np.radians(30)), speed * np.cos(np.radians(30))
    )


def way(time: np.ndarray) -> np.ndarray:
    """Return how far such a tide carries along its course by some times [m]: the area under its
    trapezia.
    """
    nodes = 3600 * np.arange(26)
    speed = SPEED * np.sin(2 * np.pi * nodes / PERIOD)
    area = np.concatenate([[0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * 3600)])
    k = np.minimum(time // 3600, len(nodes) - 2)
    rest = time - nodes[k]
    return area[k] + speed[k] * rest + 0.5 * (speed[k + 1] - speed[k]) * rest**2 / 3600


def scene(*currents: Source, direction: int = 1) -> Scene:
    place = kernel.Surroundings(EVERYWHERE)
    return Scene(
        Forcing([Sources({"current": currents})], direction),
        (Motion(DRIFT, kernel.Physics()),),
        place,
    )


def particles(n: int, lon: float, lat: float) -> record.Ensemble:
    runtime.start()
    ensemble = record.empty(5, (0, n), COLUMNS)
    ensemble.lon.fill(int(sphere.to_binary(lon)))
    ensemble.lat.fill(int(sphere.to_binary(lat)))
    return ensemble


@pytest.mark.parametrize("scheme", ["rk4", "rk2"])
def test_outputs_inside_a_step_lie_on_the_way_and_not_on_its_chord(scheme: str) -> None:
    """Linear in time between full hours: positions are exact at any time.

    The chord of an hour is up to 540 m off.
    """
    times = np.array([600, 1800, 3600, 9 * 3600 + 600, 10 * 3600 + 1234, 12 * 3600])
    place = scene(tide(25))
    place = Scene(place.forcing, place.motions, place.place._replace(scheme=scheme))
    moments = simulate.run(
        particles(1, 179.95, 1.0), place, Clock(T0, int(times[-1]), 1, 3600), times
    )
    for moment, expected in zip(moments, way(times), strict=True):
        # A steady course is a rhumb line on the sphere: longitude goes as tan(course) times
        # Mercator's latitude.
        lat = np.radians(1.0) + expected * np.cos(np.radians(30)) / sphere.RADIUS
        stretched = np.arctanh(np.sin(lat)) - np.arctanh(np.sin(np.radians(1.0)))
        lon = np.radians(179.95) + np.tan(np.radians(30)) * stretched
        east, north = sphere.offset(lon, lat, moment.lon * sphere.UNIT, moment.lat * sphere.UNIT)
        # 5 mm for the rounding of the start, of each step and of the output
        rounding = 5e-3 * (moment.elapsed // 3600 + 2)
        assert east[0] == pytest.approx(0.0, abs=rounding)
        assert north[0] == pytest.approx(0.0, abs=rounding)


def test_the_end_of_a_run_inside_a_step_is_right() -> None:
    """Ten minutes from 09:00 in that tide, with a step of an hour."""
    clock = Clock(T0 + 9 * 3600, 600, 1, 3600)
    (end,) = simulate.run(particles(1, -30.0, 40.0), scene(tide(25)), clock, np.array([600]))
    went = sphere.distance(
        *np.radians([-30.0, 40.0]), end.lon[0] * sphere.UNIT, end.lat[0] * sphere.UNIT
    )
    assert went == pytest.approx(abs(float(np.diff(way(np.array([32_400, 33_000])))[0])), abs=0.1)


def reversal(hours: int) -> Source:
    """A current of 2 m/s toward the north that turns to the south within each hour, and back within
    the next.
    """
    turning = 2.0 * (-1.0) ** np.arange(hours + 1)
    return sources.uniform_field(
        "current", (T0 + 3600 * np.arange(hours + 1)).astype("datetime64[s]"), 0 * turning, turning
    )


def wall(north: float) -> device_coast.DeviceCoast:
    """Land north of a parallel so many metres from 40 N."""
    south = 40 + np.degrees(north / sphere.RADIUS)
    box = Box(-31.5, 38.5, -28.5, 41.5)
    shore = Shore(np.array([shapely.box(-31.4, south, -28.6, 41.4)], object), "wall", (), box)
    return device_coast.upload(shoreline.build_coast(shore, Box(-31.2, 38.8, -28.8, 41.2)))


def north_of_40(moment: simulate.Moment) -> np.ndarray:
    """Return how far north of 40 N particles are [m]."""
    return (moment.lat * sphere.UNIT - np.radians(40)) * sphere.RADIUS


@pytest.mark.parametrize("law", ["tide", "reversal"])
def test_a_bent_way_is_followed_until_it_lands(law: str) -> None:
    """An hour in which the drift gathers way, or goes out by 1.8 km and comes back: landing times
    and places before them.

    The chord of the first is up to 523 m off; that of the second has no length.
    """
    turn = SPEED * np.sin(2 * np.pi * 3600 / PERIOD) / 3600  # [m/s2] of the tide in its first hour
    toward_wall = np.cos(np.radians(30))
    if law == "tide":
        source, away = tide(2), np.linspace(50, 1750, 18)
        lands = np.sqrt(2 * away / toward_wall / turn)
    else:
        source, away = reversal(2), np.append(np.linspace(50, 1750, 18), [1850, 3000])
        lands = 1800 * (1 - np.sqrt(np.maximum(1 - away / 1800, 0)))
        lands[away > 1800] = np.inf
    ensemble = particles(away.size, -30.0, 40.0)
    ensemble.lat.from_numpy(sphere.to_binary(40 - np.degrees(away / sphere.RADIUS)))
    place = scene(source)
    place = Scene(place.forcing, place.motions, place.place._replace(coast=wall(0.0)))
    times = np.arange(300, 3601, 300)
    for moment in simulate.run(ensemble, place, Clock(T0, 3600, 1, 3600), times):
        time = np.minimum(moment.elapsed, lands)
        north, speed = 0.5 * turn * time**2 * toward_wall, turn * time * toward_wall
        if law == "reversal":
            north, speed = 2 * time * (1 - time / 3600), np.abs(2 - time / 900)
        landed = moment.status == Status.ASHORE
        # The shore is met on straight pieces CHORD from the curve, so late or early by what the
        # drift takes for that; a landing is noted in whole seconds.
        late = curve.CHORD / np.maximum(speed, 1e-9) + 1
        sure = np.abs(lands - moment.elapsed) > late
        np.testing.assert_array_equal(landed[sure], (lands < moment.elapsed)[sure])
        # Before it lands it is on the way to where it does; 2 m/s at most
        assert np.abs(north_of_40(moment) + away - north).max() < curve.CHORD + 2.0
    assert np.isfinite(lands).sum() == (ensemble.status.to_numpy() == Status.ASHORE).sum()


@pytest.mark.thorough
def test_what_refloats_waits_for_the_drift_to_turn_off_the_beach_within_a_step() -> None:
    """Onto the beach until 01:24, off it by 0.6 m/s at 02:00: who is afloat then, and how far off,
    at steps of an hour.
    """
    n, half, offing, turns = 4000, 5400.0, 100.0, 5040  # [s], [m], [s]
    hours, north = np.arange(3), np.array([1.0, 0.4, -0.6])
    source = sources.uniform_field(
        "current", (T0 + 3600 * hours).astype("datetime64[s]"), 0 * north, north
    )
    ensemble = particles(n, -30.0, 40.0)
    place, beach = scene(source), kernel.Beach(half / np.log(2), offing)
    place = Scene(
        place.forcing, place.motions, place.place._replace(coast=wall(100.0), beach=beach)
    )
    moments = list(
        simulate.run(ensemble, place, Clock(T0, 7200, 1, 3600), np.array([600, 4900, 6000, 7200]))
    )
    since = ensemble.moving_since.to_numpy()
    for moment in moments:
        afloat = moment.status == Status.ADRIFT
        # 100 m at 1 m/s to the beach
        share = 1 - 2 ** (-(moment.elapsed - 100) / half) if moment.elapsed > turns else 0.0
        assert afloat.mean() == pytest.approx(share, abs=4 * 0.5 / np.sqrt(n))
        # What has waited for the turn sets off then; the rest does when its wait ends.
        assert (since[afloat] >= turns).all()
        led = 0.5 * (np.square(moment.elapsed - turns) - np.square(since[afloat] - turns)) / 3600
        off = 100 - north_of_40(moment)[afloat] - led
        # Inside the step what leads from the beach to the offing is spread over it; a second is 0.6
        # m.
        assert off.min(initial=0.0) > -0.7
        assert off.max(initial=0.0) < offing + 0.7
    assert np.abs(off - offing).max() < 0.7


def test_an_output_after_a_look_lies_on_the_way() -> None:
    """A look at 00:20 ties the way down: from there it leads on along the curve, not along the
    chord of the rest.
    """
    place, ensemble = scene(tide(25)), particles(1, -30.0, 40.0)
    ((low, high, step),) = Clock(T0, 3600, 1, 3600).steps()
    begin = place.advance(ensemble, low, high, step, keep=True)
    assert begin is not None
    kept = None
    for time in (1200, 2000, 2700):
        lon, lat = place.between(ensemble, begin, kept, step, time, T0)
        kept = kept or Kept(lon, lat, time)
        went = sphere.distance(
            *np.radians([-30.0, 40.0]), lon[0] * sphere.UNIT, lat[0] * sphere.UNIT
        )
        # float32 on 2 km, and roundings of 5 mm
        assert went == pytest.approx(way(np.array([time]))[0], abs=0.1)


def test_velocities_inside_a_step_are_those_of_the_drift() -> None:
    """A contact's speed and course meet the drift at its time, not the mean over the step."""
    place, ensemble = scene(tide(25)), particles(1, -30.0, 0.0)
    ((low, high, step),) = Clock(T0, 3600, 1, 3600).steps()
    begin = place.advance(ensemble, low, high, step, keep=True)
    assert begin is not None
    for time in (0, 600, 2700):
        east, north = place.velocity(ensemble, begin, step, time)
        speed = SPEED * np.sin(2 * np.pi * 3600 / PERIOD) * time / 3600
        # The ends of the hour are rounded to 5 mm.
        assert east[0] == pytest.approx(speed * np.sin(np.radians(30)), abs=0.01 / 3600)
        assert north[0] == pytest.approx(speed * np.cos(np.radians(30)), abs=0.01 / 3600)


def test_places_inside_a_step_are_of_third_order() -> None:
    """A steady whirl, its step halved: errors half-way in steps fall like the fourth power (of a
    fixed number of steps).
    """
    errors = []
    for step in (14_400, 7200):
        truth = {}
        for used in (step, step // 20):
            ensemble = particles(200, 0.0, 45.0)
            spread = np.random.default_rng(3).uniform(-0.08, 0.08, (2, 200))
            ensemble.lon.from_numpy(sphere.to_binary(spread[0]))
            ensemble.lat.from_numpy(sphere.to_binary(45 + spread[1]))
            clock = Clock(T0, step, 1, used, T0 % used)
            (truth[used],) = simulate.run(ensemble, scene(whirl()), clock, np.array([step // 2]))
        lon, lat = (
            [moment.lon * sphere.UNIT, moment.lat * sphere.UNIT] for moment in truth.values()
        )
        errors.append(float(np.sqrt(np.mean(sphere.distance(*lon, *lat) ** 2))))
    assert errors[1] > 1.0  # far beyond rounding
    assert np.log2(errors[0] / errors[1]) > 3.7


def whirl() -> Source:
    grid = Grid(-1.0, 44.0, 0.005, 0.005, 401, 401)
    lon, lat = np.meshgrid(
        grid.lon0 + grid.dlon * np.arange(401), grid.lat0 + grid.dlat * np.arange(401)
    )
    x, y = lon / 0.3, (lat - 45.0) / 0.2
    strength = np.exp(-(x**2 + y**2) / 2)
    values = np.stack([-1.5 * y * strength, 1.5 * x * strength], axis=-1).astype(np.float32)
    return Source(
        "current", "whirl", grid, np.array([], "datetime64[s]"), lambda i: values, 0.0, (), ""
    )


def test_a_table_that_turns_between_steps_is_followed_exactly() -> None:
    """Rows a minute apart at +30 h, and a step of an hour: steps are cut at rows.

    On their chord it was 900 m off.
    """
    seconds, north = np.array([0, 108_000, 108_060, 172_800]), np.array([0.3, 0.3, -0.2, -0.2])
    source = sources.uniform_field(
        "current", (T0 + seconds).astype("datetime64[s]"), 0 * north, north
    )
    times = [T0 + seconds]
    for direction, start in ((1, T0), (-1, T0 + 172_800)):
        clock = Clock(
            start, 172_800, direction, 3600, T0 % 3600, off_lattice_times(times, 3600, T0)
        )
        (end,) = simulate.run(
            particles(1, -40.0, 0.0), scene(source, direction=direction), clock, np.array([172_800])
        )
        expected = 0.3 * 108_000 + 0.05 * 60 - 0.2 * 64_740
        assert end.lat[0] * sphere.UNIT * sphere.RADIUS == pytest.approx(
            direction * expected, abs=0.5
        )


def test_a_cut_step_has_noise_of_its_own_and_covers_the_run() -> None:
    """Steps follow one another without gap or overlap, both ways, each with a key of its own."""
    for direction in (1, -1):
        for start in (T0, T0 + 417):
            clock = Clock(
                start,
                20_000,
                direction,
                3600,
                T0 % 3600,
                (T0 - 5000, T0 + 500, T0 + 501, T0 + 7200),
            )
            steps = list(clock.steps())
            assert len({step.number for _, _, step in steps}) == len(steps)
            ends = [step.elapsed + step.duration for _, _, step in steps]
            assert [step.elapsed for _, _, step in steps[1:]] == ends[:-1]
            assert steps[0][2].elapsed <= 0 < ends[0]
            assert steps[-1][2].elapsed < 20_000 <= ends[-1]
            for low, high, step in steps:
                assert high - low == step.duration
                assert low == (
                    start + step.elapsed if direction > 0 else start - step.elapsed - step.duration
                )
                assert not any(low < cut < high for cut in clock.breaks)
            inner = [end for end in range(20_000) if clock.ends(end)]
            assert set(ends[:-1]) == set(inner) - {0}


@pytest.mark.thorough
def test_the_step_is_tested_over_the_whole_run() -> None:
    """A whirl that spins up after 30 hours: a step chosen by the first day alone would be the
    longest.
    """
    grid = Grid(-1.0, 44.0, 0.02, 0.02, 101, 101)
    lon, lat = np.meshgrid(
        grid.lon0 + grid.dlon * np.arange(101), grid.lat0 + grid.dlat * np.arange(101)
    )
    x, y = lon / 0.15, (lat - 45.0) / 0.1
    strength = np.exp(-(x**2 + y**2) / 2)
    values = np.stack([-1.5 * y * strength, 1.5 * x * strength], axis=-1).astype(np.float32)
    times = (T0 + 3600 * np.arange(61)).astype("datetime64[s]")
    source = Source(
        "current", "late", grid, times, lambda i: values * np.float32(i >= 30), 0.0, (), ""
    )
    ensemble = particles(400, 0.0, 45.0)
    spread = np.random.default_rng(2).uniform(-0.08, 0.08, (2, 400))
    ensemble.lon.from_numpy(sphere.to_binary(spread[0]))
    ensemble.lat.from_numpy(sphere.to_binary(45 + spread[1]))
    calm, late = Clock(T0, 86_400, 1, 1), Clock(T0, 60 * 3600, 1, 1)
    assert step_size.choose_step(ensemble, scene(source), calm, 3600, T0, np.inf, 20.0).step == 3600
    trial = step_size.choose_step(
        record.sample(ensemble, np.arange(400)), scene(source), late, 3600, T0, np.inf, 20.0
    )
    assert trial.step < 3600
    ends = {}
    for step in (60, trial.step):
        own = record.sample(ensemble, np.arange(400))
        (end,) = simulate.run(
            own, scene(source), Clock(T0, 60 * 3600, 1, step, T0 % step), np.array([60 * 3600])
        )
        ends[step] = end.lon * sphere.UNIT, end.lat * sphere.UNIT
    # Richardson, over 30 hours of whirl
    assert (
        np.percentile(sphere.distance(*ends[60], *ends[trial.step]), 95) < 20.0 * 16 / 15 * 30 / 24
    )


def test_straight_pieces_are_as_long_as_chords_allow() -> None:
    """In a tide that turns by 3.4e-4 m/s2 at most, an hour bulges by a t^2 / 8 = 540 m; a piece by
    at most 1.2 times CHORD.
    """
    trial = step_size.choose_step(
        particles(200, -30.0, 40.0),
        scene(tide(25)),
        Clock(T0, 86_400, 1, 1),
        3600,
        T0,
        np.inf,
        20.0,
    )
    assert trial.step == 3600
    turn = np.abs(np.diff(SPEED * np.sin(2 * np.pi * 3600 * np.arange(25) / PERIOD))).max() / 3600
    assert turn * trial.straight**2 / 8 == pytest.approx(curve.CHORD, rel=0.2)
    still = sources.constant_field("current", 0.5, 0.2)
    calm = step_size.choose_step(
        particles(200, -30.0, 40.0), scene(still), Clock(T0, 86_400, 1, 1), 3600, T0, np.inf, 20.0
    )
    assert Clock(T0, 3600, 1, 3600, straight=calm.straight).steps().__next__()[2].pieces == 1
