"""Diffusion, Ornstein-Uhlenbeck errors and jibing: closed forms, at three time steps."""

import numpy as np
import pytest

from drift.engine.motion.models.drift import COLUMNS
from drift.engine.particles import ensemble as record
from geo import sphere
from geo.grids.grid import Grid
from kernels.maths.noise import key
from kernels.step import advance as kernel
from kernels.step import prior as draw
from kernels.step.sample import Tiles

EVERYWHERE = kernel.Domain(-(2**31), -(2**30), 2**32 - 1, 2**31)
N = 100_000
HOURS = 24
AT = (np.radians(-179.9), np.radians(60.0))
NOWHERE: dict[str, tuple[int, int]] = {}


def drifted(
    physics: kernel.Physics, step: int, ranges=NOWHERE, tiles: Tiles | None = None, prepare=None, n: int = N,
    bias: float = 0.0, seed: int = 11,
):  # fmt: skip
    """Return the ensemble after HOURS, from one point; bias: standard deviation of the current's
    lasting error [m/s].
    """
    ensemble = record.empty(seed, (0, n), COLUMNS)
    for column, angle in ((ensemble.lon, AT[0]), (ensemble.lat, AT[1])):
        column.fill(int(sphere.to_binary(np.degrees(angle))))
    slots, words = (0, n, 0), key(seed)
    draw.draw_error(
        *slots,
        ensemble.own["current_bias_east"],
        ensemble.own["current_bias_north"],
        2,
        *words,
        bias,
    )
    draw.draw_error(
        *slots,
        ensemble.own["current_error_east"],
        ensemble.own["current_error_north"],
        0,
        *words,
        physics.current_std,
    )
    draw.draw_error(
        *slots,
        ensemble.own["wind_error_east"],
        ensemble.own["wind_error_north"],
        1,
        *words,
        physics.wind_std,
    )
    if prepare:
        prepare(ensemble)
    tiles = tiles or Tiles([])
    for k in range(HOURS * 3600 // step):
        clock = kernel.Step(k, k * step, step, 1)
        kernel.advance(
            ensemble,
            slots,
            tiles,
            ranges,
            physics,
            clock,
            kernel.Surroundings(EVERYWHERE, bias=bias > 0),
        )
    return ensemble


def offsets(ensemble: record.Ensemble) -> np.ndarray:
    """Return (east, north) [m] from the start, shape (2, n)."""
    lon, lat = (c.to_numpy() * sphere.UNIT for c in (ensemble.lon, ensemble.lat))
    return np.array(sphere.offset(*AT, lon, lat))


def close_to(sample: np.ndarray, variance: float, discretisation: float = 0.0) -> None:
    """Assert zero mean and a variance, within 4.5 standard errors and the stated relative error of
    the scheme.
    """
    n = sample.size
    assert abs(sample.mean()) < 4.5 * np.sqrt(variance / n)
    assert abs(sample.var() / variance - 1) < 4.5 * np.sqrt(2 / n) + discretisation


@pytest.mark.parametrize("step", [3600, 900])
def test_diffusion_spreads_as_2dt(step: int) -> None:
    diffusivity = 25.0
    for sample in offsets(drifted(kernel.Physics(diffusivity=diffusivity), step)):
        close_to(sample, 2 * diffusivity * HOURS * 3600)


@pytest.mark.parametrize("step", [3600, 900])
def test_current_errors_spread_as_an_integrated_ornstein_uhlenbeck_process(step: int) -> None:
    """Var x(t) = 2 s^2 T^2 (t/T - 1 + exp(-t/T)) (Uhlenbeck and Ornstein 1930); steps up to T/6 err
    by 0.5 % at most.
    """
    std, time = 0.2, 21_600.0
    t = HOURS * 3600 / time
    variance = 2 * std**2 * time**2 * (t - 1 + np.exp(-t))
    ensemble = drifted(kernel.Physics(current_std=std, current_time=time), step)
    for sample in offsets(ensemble):
        close_to(sample, variance, 0.005)
    for column in (ensemble.own["current_error_east"], ensemble.own["current_error_north"]):
        close_to(column.to_numpy().astype(float), std**2)


def uniform_wind(speed: float, east: float = 0.0) -> Tiles:
    """A steady wind [m/s] towards the north, and towards the east, everywhere."""
    tiles = Tiles([Grid(-180, -90, 360, 180, 2, 2)])
    values = np.zeros((2, 2, 2), np.float32)
    values[..., 0], values[..., 1] = east, speed
    tiles.place(0, values, later=False)
    tiles.place(0, values, later=True)
    tiles.blend([(0.0, 0.0)])
    return tiles


@pytest.mark.thorough
@pytest.mark.parametrize("step", [3600, 900])
def test_wind_errors_act_through_the_leeway(step: int) -> None:
    """With a slope s downwind and no crosswind, an error in the wind moves the object by s times
    its integral.
    """
    std, time, slope = 1.5, 21_600.0, 0.03
    t = HOURS * 3600 / time
    variance = (slope * std * time) ** 2 * 2 * (t - 1 + np.exp(-t))

    def windage(ensemble: record.Ensemble) -> None:
        ensemble.own["down_slope"].fill(slope)

    physics = kernel.Physics(wind_std=std, wind_time=time)
    ensemble = drifted(physics, step, {"wind": (0, 1)}, uniform_wind(8.0), windage)
    east, north = offsets(ensemble)
    close_to(east, variance, 0.005)
    close_to(north - slope * 8.0 * HOURS * 3600, variance, 0.005)


@pytest.mark.parametrize("which", ["current", "wind"])
def test_a_step_feels_the_mean_of_the_error_at_its_ends(which: str) -> None:
    """Path by path: the trapezoidal rule's error in the variance is that of the process between the
    lattice's points alone.
    """
    slope, step, n = 0.04, 3600, 5000
    physics = (
        kernel.Physics(0.3, 21_600.0)
        if which == "current"
        else kernel.Physics(wind_std=2.0, wind_time=21_600.0)
    )
    ensemble = record.empty(3, (0, n), COLUMNS)
    for column, angle in ((ensemble.lon, AT[0]), (ensemble.lat, AT[1])):
        column.fill(int(sphere.to_binary(np.degrees(angle))))
    columns = [ensemble.own[f"{which}_error_{axis}"] for axis in ("east", "north")]
    draw.draw_error(
        0, n, 0, *columns, int(which == "wind"), *key(3), 0.3 if which == "current" else 2.0
    )
    ensemble.own["down_slope"].fill(slope)
    before = np.array([column.to_numpy() for column in columns], np.float64)
    clock, ranges = kernel.Step(0, 0, step, 1), {"wind": (0, 1)}
    kernel.advance(
        ensemble,
        (0, n, 0),
        uniform_wind(5.0, -7.0),
        ranges,
        physics,
        clock,
        kernel.Surroundings(EVERYWHERE),
    )
    after = np.array([column.to_numpy() for column in columns], np.float64)
    mean = (before + after) / 2
    wind = np.array([[-7.0], [5.0]])
    way = step * (slope * wind + mean if which == "current" else slope * (wind + mean))
    bend = (
        (way**2).sum(axis=0) * np.tan(AT[1]) / sphere.RADIUS
    )  # of a way on the sphere off its tangent plane: 4 m at 4 km
    # and rounding: 9 mm of position, 1e-6 of the way
    assert (np.abs(offsets(ensemble) - way) < bend + 0.05).all()
    assert np.abs(after - before).std() * step > 100  # the ends differ by far more than that


@pytest.mark.parametrize("toward", [(8.0, 3.0), (-5.0, 7.0), (-2.0, -9.0), (6.0, -4.0)])
def test_a_line_leads_down_and_to_the_right_of_any_wind(toward: tuple[float, float]) -> None:
    """Slope W + offset along the wind, and along it turned clockwise by 90 degrees; the left line
    has its own numbers.
    """
    lines = {"down": (0.03, 0.02), "right": (0.012, 0.03), "left": (-0.02, -0.05)}

    def equip(ensemble: record.Ensemble) -> None:
        for name, (slope, offset) in lines.items():
            ensemble.own[f"{name}_slope"].fill(slope)
            ensemble.own[f"{name}_offset"].fill(offset)
        ensemble.own["side"].from_numpy(np.array([1, -1], np.int32))

    wind = np.array(toward)
    speed = np.hypot(*wind)
    down, right = wind / speed, np.array([wind[1], -wind[0]]) / speed
    moved = offsets(
        drifted(
            kernel.Physics(), 3600, {"wind": (0, 1)}, uniform_wind(toward[1], toward[0]), equip, 2
        )
    ).T
    for found, side in zip(moved, ("right", "left"), strict=True):
        rates = [slope * speed + offset for slope, offset in (lines["down"], lines[side])]
        way = (rates[0] * down + rates[1] * right) * HOURS * 3600
        # A constant course at 60 N against a plane tangent at its begin: 40 km^2 tan(60) / 2 R, 0.5
        # % of the way.
        assert np.hypot(*(found - way)) < 0.006 * np.hypot(*way)


def test_a_walk_near_the_pole_has_no_drift_of_its_own() -> None:
    """Brownian motion on a sphere is isotropic about its begin: the mean way north is 0, not D
    tan(lat) t / R = 770 m.
    """
    n, diffusivity = 400_000, 1e4
    at = (np.radians(31.0), np.radians(80.0))
    ensemble = record.empty(4, (0, n), COLUMNS)
    for column, angle in ((ensemble.lon, at[0]), (ensemble.lat, at[1])):
        column.fill(int(sphere.to_binary(np.degrees(angle))))
    for k in range(24):
        clock = kernel.Step(k, 3600 * k, 3600, 1)
        physics = kernel.Physics(diffusivity=diffusivity)
        kernel.advance(
            ensemble, (0, n, 0), Tiles([]), NOWHERE, physics, clock, kernel.Surroundings(EVERYWHERE)
        )
    lon, lat = (c.to_numpy() * sphere.UNIT for c in (ensemble.lon, ensemble.lat))
    way = np.array(sphere.offset(*at, lon, lat))
    assert diffusivity * np.tan(at[1]) * 86_400 / sphere.RADIUS > 9 * way[1].std() / np.sqrt(n)
    assert (np.abs(way.mean(axis=1)) < 4.5 * way.std(axis=1) / np.sqrt(n)).all()


@pytest.mark.thorough
def test_debris_jibes_and_walks_on_its_own() -> None:
    """It shares the errors of the forcing with its object slot by slot, to the bit; sides and walks
    are independent.
    """
    rate, n = 0.05 / 3600, 100_000
    physics = kernel.Physics(0.2, 21_600.0, 1.5, 21_600.0, 25.0, rate)
    found = []
    for debris in (0, 1, 2):
        ensemble = record.empty(11, (0, n), COLUMNS)
        for kind, which, std in (("current", 0, 0.2), ("wind", 1, 1.5)):
            columns = [ensemble.own[f"{kind}_error_{axis}"] for axis in ("east", "north")]
            draw.draw_error(0, n, 0, *columns, which, *key(11), std)
        tiles = uniform_wind(8.0, 3.0)  # no leeway: it moves by the current's error and its walk
        for k in range(12):
            place = kernel.Surroundings(EVERYWHERE, debris=debris)
            kernel.advance(
                ensemble,
                (0, n, 0),
                tiles,
                {"wind": (0, 1)},
                physics,
                kernel.Step(k, 3600 * k, 3600, 1),
                place,
            )
        found.append(ensemble)
    objects, *others = found
    same = ("current_error_east", "current_error_north", "wind_error_east", "wind_error_north")
    for other in others:
        for name in same:
            np.testing.assert_array_equal(
                other.columns[name].to_numpy(), objects.columns[name].to_numpy()
            )
    sides = np.array([ensemble.own["side"].to_numpy() for ensemble in found], np.float64)
    mean = np.exp(
        -2 * rate * 12 * 3600
    )  # of a side that began as +1; of the product of two that jibe apart, its square
    for a, b in ((0, 1), (0, 2), (1, 2)):
        assert abs((sides[a] * sides[b]).mean() - mean**2) < 4.5 / np.sqrt(n)
        way = [
            np.array(sphere.offset(0.0, 0.0, *(c.to_numpy() * sphere.UNIT for c in (e.lon, e.lat))))
            for e in (found[a], found[b])
        ]
        apart = way[0] - way[1]  # what they share drops out, two walks of variance 2 D t are left
        assert (
            np.abs(apart.var(axis=1) / (4 * 25.0 * 12 * 3600) - 1).max()
            < 4.5 * np.sqrt(2 / n) + 1e-3
        )


@pytest.mark.thorough
@pytest.mark.parametrize("step", [3600, 600])
def test_jibing_swaps_the_whole_line_at_its_rate(step: int) -> None:
    """Sides form a telegraph process: the mean of side(0) side(t) is exp(-2 r t) (Kac 1974)."""
    rate, n = 0.1 / 3600, 50_000

    def equip(ensemble: record.Ensemble) -> None:
        ensemble.own["right_slope"].fill(0.02)
        ensemble.own["right_offset"].fill(0.05)
        ensemble.own["left_slope"].fill(-0.01)
        ensemble.own["left_offset"].fill(0.03)

    still = drifted(kernel.Physics(), step, {"wind": (0, 1)}, uniform_wind(10.0), equip, 100)
    east = offsets(still)[0]
    # all on the right line: slope and offset of it
    assert east == pytest.approx(0.25 * HOURS * 3600, rel=1e-4)

    ensemble = drifted(
        kernel.Physics(jibe_rate=rate), step, {"wind": (0, 1)}, uniform_wind(10.0), equip, n
    )
    t = HOURS * 3600
    side, correlation = ensemble.own["side"].to_numpy(), np.exp(-2 * rate * t)
    assert abs(side.mean() - correlation) < 4.5 / np.sqrt(n)
    # Time on the right line: t/2 + (1 - exp(-2rt)) / 4r on average; 0.25 m/s there, -0.07 m/s on
    # the left.
    right = t / 2 + (1 - correlation) / (4 * rate)
    east = offsets(ensemble)[0]
    assert (
        abs(east.mean() - (0.25 * right - 0.07 * (t - right)))
        < 4.5 * east.std() / np.sqrt(n) + 0.32 * step / 2
    )


def test_no_thread_or_order_of_slots_matters() -> None:
    """The second half of the slots alone moves as it does within the whole: noise hangs on the
    slot, not on the launch.
    """
    physics = kernel.Physics(0.2, 21_600.0, diffusivity=10.0)
    whole = drifted(physics, 3600, n=2000, bias=0.1)
    halves = record.empty(11, (0, 2000), COLUMNS)
    for column, angle in ((halves.lon, AT[0]), (halves.lat, AT[1])):
        column.fill(int(sphere.to_binary(np.degrees(angle))))
    draw.draw_error(
        0,
        2000,
        0,
        halves.own["current_error_east"],
        halves.own["current_error_north"],
        0,
        *key(11),
        physics.current_std,
    )
    for slots in ((1000, 2000, 1000), (0, 1000, 0)):
        draw.draw_error(
            *slots,
            halves.own["current_bias_east"],
            halves.own["current_bias_north"],
            2,
            *key(11),
            0.1,
        )
        for k in range(HOURS):
            clock = kernel.Step(k, k * 3600, 3600, 1)
            kernel.advance(
                halves,
                slots,
                Tiles([]),
                NOWHERE,
                physics,
                clock,
                kernel.Surroundings(EVERYWHERE, bias=True),
            )
    assert (whole.lon.to_numpy() == halves.lon.to_numpy()).all()
    assert (whole.lat.to_numpy() == halves.lat.to_numpy()).all()


def test_another_seed_or_size_of_the_bias_compiles_nothing() -> None:
    drifted(kernel.Physics(0.2, 21_600.0), 3600, n=100, bias=0.1)
    kernels = kernel._advance._primal.compiled_kernels, draw._draw_error._primal.compiled_kernels
    before = [len(compiled) for compiled in kernels]
    drifted(kernel.Physics(0.2, 21_600.0), 3600, n=100, bias=0.3, seed=2**62 + 3)
    assert [len(compiled) for compiled in kernels] == before
