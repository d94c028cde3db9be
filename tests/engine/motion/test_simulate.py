"""The clock: lattice, releases, outputs, both directions, nodes inside steps, the choice of the
step.
"""

from dataclasses import replace

import numpy as np
import pytest

from drift.engine.motion import simulate, step_size
from drift.engine.motion.clock import Clock
from drift.engine.motion.forcing import Forcing, Sources
from drift.engine.motion.models.drift import COLUMNS, DRIFT
from drift.engine.motion.models.model import Motion
from drift.engine.motion.scene import Begin, Scene
from drift.engine.motion.step_size import LADDER
from drift.engine.particles import ensemble as record
from drift.engine.particles.status import Status
from geo import sphere
from geo.forcing import sources
from geo.forcing.sources import Source
from geo.grids.grid import Grid
from kernels.runtime import runtime
from kernels.step import advance as kernel
from kernels.step.sample import Tiles

EVERYWHERE = kernel.Domain(-(2**31), -(2**30), 2**32 - 1, 2**31)
T0 = 1_795_000_000 // 3600 * 3600  # [s since 1970] a full hour in November 2026
STILL = kernel.Physics()


def stamps(seconds: list[int]) -> np.ndarray:
    return (T0 + np.array(seconds)).astype("datetime64[s]")


def ensemble_at(lon: float, lat: float, release: list[int]) -> record.Ensemble:
    n = len(release)
    ensemble = record.empty(5, (0, n), COLUMNS)
    ensemble.lon.fill(int(sphere.to_binary(lon)))
    ensemble.lat.fill(int(sphere.to_binary(lat)))
    ensemble.release.from_numpy(np.array(release, np.int32))
    return ensemble


def world(*currents: Source, direction: int = 1, physics: kernel.Physics = STILL) -> Scene:
    return Scene(
        Forcing([Sources({"current": currents})], direction),
        (Motion(DRIFT, physics),),
        kernel.Surroundings(EVERYWHERE),
    )


def moved(moment: simulate.Moment, lon: float, lat: float) -> np.ndarray:
    here = np.radians([lon, lat])
    return np.array(sphere.offset(*here, moment.lon * sphere.UNIT, moment.lat * sphere.UNIT))


@pytest.mark.parametrize("direction", [1, -1])
@pytest.mark.parametrize("start", [T0, T0 + 417])
def test_every_particle_drifts_exactly_from_its_release_to_the_output(
    direction: int, start: int
) -> None:
    """In a uniform current the way is speed times time, wherever start, releases and outputs fall
    on the lattice.
    """
    release, outputs = [0, 1000, 5000, 9001], [0, 777, 3600, 8000, 10_000]
    ensemble = ensemble_at(179.99, 10.0, release)
    clock = Clock(start, 10_000, direction, 900)
    place = world(sources.constant_field("current", 0.6, -0.4), direction=direction)
    for moment, t in zip(
        simulate.run(ensemble, place, clock, np.array(outputs)), outputs, strict=True
    ):
        lasted = direction * np.maximum(t - np.array(release), 0)
        east, north = moved(moment, 179.99, 10.0)
        # x y tan(lat) / R of the parallel's curve
        assert east == pytest.approx(0.6 * lasted, abs=1.0)
        assert north == pytest.approx(-0.4 * lasted, abs=1.0)
        assert (
            moment.status == np.where(np.array(release) > t, Status.PENDING, Status.ADRIFT)
        ).all()


def test_more_outputs_and_another_start_of_the_lattice_change_no_bit() -> None:
    physics = kernel.Physics(0.2, 21_600.0, diffusivity=20.0)
    ends = []
    for outputs in ([36_000], [0, 1, 555, 7200, 20_001, 36_000]):
        ensemble = ensemble_at(5.0, 60.0, list(range(0, 20_000, 10)))
        place = world(sources.constant_field("current", 0.1, 0.3), physics=physics)
        ends.append(
            list(simulate.run(ensemble, place, Clock(T0, 36_000, 1, 600), np.array(outputs)))[-1]
        )
    assert (ends[0].lon == ends[1].lon).all()
    assert (ends[0].lat == ends[1].lat).all()
    # The same particles in a run that begins two hours earlier: noise is keyed by the lattice step,
    # not by the run's.
    earlier = ensemble_at(5.0, 60.0, [r + 7200 for r in range(0, 20_000, 10)])
    place = world(sources.constant_field("current", 0.1, 0.3), physics=physics)
    (end,) = simulate.run(earlier, place, Clock(T0 - 7200, 43_200, 1, 600), np.array([43_200]))
    assert (end.lon == ends[0].lon).all()


def test_a_current_that_changes_in_time_is_integrated_exactly_also_off_the_lattice() -> None:
    """Piecewise linear in time: the way is the area under the trapezia, also where nodes fall
    inside steps.
    """
    seconds, speed = [0, 5000, 9000, 20_000], np.array([0.2, 1.0, -0.4, 0.8])
    source = sources.uniform_field("current", stamps(seconds), speed, -speed)
    fine = np.arange(0, 18_001)
    area = np.trapezoid(np.interp(fine, seconds, speed), fine) if hasattr(np, "trapezoid") else None
    area = area if area is not None else np.trapz(np.interp(fine, seconds, speed), fine)  # noqa: NPY201 - NumPy 1
    for step, phase, off in ((1000, 0, 1.0), (900, 300, 40.0)):
        ensemble = ensemble_at(-20.0, 0.0, [0])
        (end,) = simulate.run(
            ensemble,
            world(source),
            Clock(T0, 18_000, 1, step, (T0 + phase) % step),
            np.array([18_000]),
        )
        east, north = moved(end, -20.0, 0.0)
        # Lattice points on all nodes: exact. Off them a step that holds a kink sees a chord: kink *
        # step^2 / 8 each.
        assert east[0] == pytest.approx(area, abs=off)
        assert north[0] == pytest.approx(-area, abs=off)


def test_particles_end_loudly_where_and_when_forcing_ends() -> None:
    source = sources.uniform_field("current", stamps([-3600, 7200]), [0.5, 0.5], [0.0, 0.0])
    ensemble = ensemble_at(0.0, 50.0, [0, 5000])
    first, second = simulate.run(
        ensemble, world(source), Clock(T0, 14_400, 1, 600), np.array([7200, 14_400])
    )
    assert (first.status == Status.ADRIFT).all()
    assert (second.status == Status.OUTSIDE).all()
    # it stays where it was last known: a missing current is not a zero one
    assert (second.lon == first.lon).all()
    assert (ensemble.status_since.to_numpy() == 7200).all()


def test_a_hole_in_the_times_is_missing_and_the_next_source_fills_it() -> None:
    hole = sources.uniform_field(
        "current", stamps([0, 600, 1200, 9000, 9600]), [1.0] * 5, [0.0] * 5
    )
    backup = sources.constant_field("current", 0.0, 2.0, name="backup")
    ensemble = ensemble_at(0.0, 0.0, [0])
    (end,) = simulate.run(ensemble, world(hole, backup), Clock(T0, 9600, 1, 600), np.array([9600]))
    east, north = moved(end, 0.0, 0.0)
    assert east[0] == pytest.approx(1800, abs=0.5)
    assert north[0] == pytest.approx(2 * 7800, abs=0.5)


def test_missing_values_near_the_coast_come_from_the_next_source_before_they_are_filled() -> None:
    """Priority: the first source where it is wet, then the second one as it is, then the first one
    filled.
    """
    grid = Grid(0.0, 50.0, 0.1, 0.1, 21, 11)
    values = np.zeros((11, 21, 2), np.float32)
    values[..., 0] = 1.0
    values[:, 11:] = np.nan
    first = Source(
        "current", "first", grid, np.array([], "datetime64[s]"), lambda i: values, 0.5, (), ""
    )
    other = values.copy()
    other[...] = np.nan
    other[:6, :, :] = (0.0, 3.0)
    second = replace(first, name="second", read=lambda i: other)
    place = Scene(
        Forcing(
            [
                Sources(
                    {"current": (first, second)},
                    cells={("current", "first"): 3, ("current", "second"): 0},
                )
            ],
            1,
        ),
        (Motion(DRIFT, STILL),),
        kernel.Surroundings(EVERYWHERE),
    )
    place.forcing.set(T0, T0 + 600)
    first_tile, last_tile = place.forcing.ranges[0]["current"]
    lon, lat = (
        sphere.to_binary([0.55, 1.25, 1.25, 1.75]),
        sphere.to_binary([50.25, 50.25, 50.85, 50.85]),
    )
    found = place.forcing.tiles.at(first_tile, last_tile, lon, lat, 0.0)
    assert found[:3, :2] == pytest.approx(np.array([[1, 0], [0, 3], [1, 0]]), abs=1e-6)
    assert found[:, 2].tolist() == [1, 1, 1, 0]


@pytest.mark.parametrize("silent", ["current", "stokes", "wind"])
def test_what_one_quantity_does_not_know_is_not_zero(silent: str) -> None:
    """Where current, Stokes drift or wind has no value a particle ends, though the others have
    theirs; elsewhere all add up.
    """
    grid = Grid(-30.0, 30.0, 1.0, 1.0, 5, 4)
    speeds = {"current": (0.3, -0.2), "stokes": (0.1, 0.25), "wind": (8.0, 5.0)}
    tiles = Tiles([grid] * 3)
    for row, (name, speed) in enumerate(speeds.items()):
        values = np.zeros((4, 5, 2), np.float32) + np.array(speed, np.float32)
        if name == silent:
            values[:, 3:] = np.nan
        for later in (False, True):
            tiles.place(row, values, later=later)
    tiles.blend([(0.0, 0.0)] * 3)
    ensemble = ensemble_at(-29.5, 31.5, [0, 0])
    ensemble.lon.from_numpy(sphere.to_binary([-29.5, -26.5]))
    ensemble.own["down_slope"].fill(0.03)
    ranges = {"current": (0, 1), "wind": (2, 3), "stokes": (1, 2)}
    kernel.advance(
        ensemble,
        (0, 2, 0),
        tiles,
        ranges,
        STILL,
        kernel.Step(0, 0, 1800, 1),
        kernel.Surroundings(EVERYWHERE),
    )
    assert list(ensemble.status.to_numpy()) == [Status.ADRIFT, Status.OUTSIDE]
    lon, lat = (column.to_numpy()[0] * sphere.UNIT for column in (ensemble.lon, ensemble.lat))
    way = np.array(sphere.offset(*np.radians([-29.5, 31.5]), lon, lat))
    expected = 1800 * (
        np.array(speeds["current"]) + np.array(speeds["stokes"]) + 0.03 * np.array(speeds["wind"])
    )
    assert np.abs(way - expected).max() < 0.2  # 1.2 km at 31 N: way^2 tan(lat) / R


def test_rival_forcing_is_a_matter_of_the_scenario() -> None:
    ensemble = record.empty(1, (0, 3, 5), COLUMNS)
    place = Scene(
        Forcing(
            [
                Sources({"current": (sources.constant_field("current", *speed),)})
                for speed in ((1.0, 0.0), (0.0, 1.0))
            ],
            1,
        ),
        (Motion(DRIFT, STILL),) * 2,
        kernel.Surroundings(EVERYWHERE),
    )
    (end,) = simulate.run(ensemble, place, Clock(T0, 3600, 1, 600), np.array([3600]))
    east, north = moved(end, 0.0, 0.0)
    assert east == pytest.approx([3600] * 3 + [0] * 2, abs=0.1)
    assert north == pytest.approx([0] * 3 + [3600] * 2, abs=0.1)


def eddy(name: str = "eddy") -> Source:
    """A steady whirl of 0.1 degrees in radius: fine enough that long steps fail."""
    grid = Grid(-1.0, 44.0, 0.02, 0.02, 101, 101)
    lon, lat = np.meshgrid(
        grid.lon0 + grid.dlon * np.arange(101), grid.lat0 + grid.dlat * np.arange(101)
    )
    x, y = (lon - 0.0) / 0.15, (lat - 45.0) / 0.1
    strength = np.exp(-(x**2 + y**2) / 2)
    values = np.stack([-1.5 * y * strength, 1.5 * x * strength], axis=-1).astype(np.float32)
    return Source(
        "current", name, grid, np.array([], "datetime64[s]"), lambda i: values, 0.0, (), ""
    )


def test_the_step_chosen_is_the_largest_that_keeps_its_tolerance() -> None:
    """Against the truth: a run at 30 s.

    The error of the chosen step is under the tolerance, that of the next is not.
    """
    n = 400
    start = np.random.default_rng(2).uniform(-0.08, 0.08, (2, n))

    def fresh() -> record.Ensemble:
        ensemble = record.empty(1, (0, n), COLUMNS)
        ensemble.lon.from_numpy(sphere.to_binary(start[0]))
        ensemble.lat.from_numpy(sphere.to_binary(45 + start[1]))
        return ensemble

    place = world(eddy())
    clock = Clock(T0, 86_400, 1, 1)
    trial = step_size.choose_step(fresh(), place, clock, 3600, 0, np.inf, 20.0)
    ends = {}
    for step in (30, trial.step, 3600):
        (end,) = simulate.run(fresh(), place, replace(clock, step=step), np.array([86_400]))
        ends[step] = end.lon * sphere.UNIT, end.lat * sphere.UNIT
    error = {k: np.percentile(sphere.distance(*ends[k], *ends[30]), 95) for k in ends}
    assert trial.step < 3600
    # Richardson: the coarse track errs by 16/15 of the difference
    assert error[trial.step] < 20.0 * 16 / 15 + 1.0
    assert error[3600] > 20.0
    coarser = [s for s in LADDER if s > trial.step and s in trial.errors]
    assert all(trial.errors[s] > 20.0 for s in coarser)
    loose = step_size.choose_step(fresh(), place, clock, 3600, 0, np.inf, 1e6)
    assert loose.step == 3600
    # the errors' decorrelation
    assert step_size.choose_step(fresh(), place, clock, 3600, 0, 1000.0, 1e6).step == 900
    # divides 45 minutes
    assert step_size.choose_step(fresh(), place, clock, 2700, 0, np.inf, 1e6).step == 900


def test_what_refloats_within_a_step_lies_ashore_until_it_does() -> None:
    """Outputs inside a step of an hour: on the beach at 1000 s, half of its way made half-way
    between 2000 s and the end.
    """
    ensemble = record.empty(1, (0, 1), COLUMNS)
    ensemble.status.fill(int(Status.ASHORE))

    class Tide(Scene):
        """A scene in which the particle floats off at 2000 s and goes 16,000 units north."""

        def advance(
            self,
            ensemble: record.Ensemble,
            low: int,
            high: int,
            step: object,
            keep: bool = False,
            count: int = 1,
        ) -> Begin:
            begin = Begin(
                runtime.copy(ensemble.lon), runtime.copy(ensemble.lat), None, runtime.empty(4)
            )
            ensemble.status.fill(int(Status.ADRIFT))
            ensemble.moving_since.fill(2000)
            ensemble.lat.fill(16_000)
            return begin

    moments = list(
        simulate.run(
            ensemble,
            Tide(None, (Motion(DRIFT, STILL),), kernel.Surroundings(EVERYWHERE)),
            Clock(0, 3600, 1, 3600),
            np.array([1000, 2800, 3600]),
        )
    )
    assert [int(moment.status[0]) for moment in moments] == [
        Status.ASHORE,
        Status.ADRIFT,
        Status.ADRIFT,
    ]
    assert [int(moment.lat[0]) for moment in moments] == [0, 8000, 16_000]
