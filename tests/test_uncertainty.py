"""Diffusion, Ornstein-Uhlenbeck errors and jibing: closed forms, at three time steps."""

import numpy as np
import pytest

from drift import ensemble as record
from geo import sphere
from geo.grid import Grid
from kernels import advance as kernel
from kernels import prior as draw
from kernels.noise import key
from kernels.sample import Tiles

EVERYWHERE = kernel.Domain(-(2**31), -(2**30), 2**32 - 1, 2**31)
N = 200_000
HOURS = 24
AT = (np.radians(-179.9), np.radians(60.0))
NOWHERE = (0, 0, 0, 0, 0, 0)


def drifted(
    physics: kernel.Physics, step: int, ranges=NOWHERE, tiles: Tiles | None = None, prepare=None, n: int = N,
    bias: float = 0.0, seed: int = 11,
):  # fmt: skip
    """Return the ensemble after HOURS, from one point; bias: standard deviation of the current's lasting error [m/s]."""
    ensemble = record.empty(seed, (0, n))
    for column, angle in ((ensemble.lon, AT[0]), (ensemble.lat, AT[1])):
        column.fill(int(sphere.to_binary(np.degrees(angle))))
    slots, words = (0, n), key(seed)
    draw.draw_error(*slots, ensemble.current_bias_east, ensemble.current_bias_north, 2, *words, bias)
    draw.draw_error(*slots, ensemble.current_error_east, ensemble.current_error_north, 0, *words, physics.current_std)
    draw.draw_error(*slots, ensemble.wind_error_east, ensemble.wind_error_north, 1, *words, physics.wind_std)
    if prepare:
        prepare(ensemble)
    tiles = tiles or Tiles([])
    for k in range(HOURS * 3600 // step):
        clock = kernel.Step(k, k * step, step, 1)
        kernel.advance(ensemble, slots, tiles, ranges, physics, clock, kernel.Place(EVERYWHERE, bias=bias > 0))
    return ensemble


def offsets(ensemble: record.Ensemble) -> np.ndarray:
    """Return (east, north) [m] from the start, shape (2, n)."""
    lon, lat = (c.to_numpy() * sphere.UNIT for c in (ensemble.lon, ensemble.lat))
    return np.array(sphere.offset(*AT, lon, lat))


def close_to(sample: np.ndarray, variance: float, discretisation: float = 0.0) -> None:
    """Assert zero mean and a variance, within 4.5 standard errors and the stated relative error of the scheme."""
    n = sample.size
    assert abs(sample.mean()) < 4.5 * np.sqrt(variance / n)
    assert abs(sample.var() / variance - 1) < 4.5 * np.sqrt(2 / n) + discretisation


@pytest.mark.parametrize("step", [3600, 1800, 900])
def test_diffusion_spreads_as_2dt(step: int) -> None:
    diffusivity = 25.0
    for sample in offsets(drifted(kernel.Physics(diffusivity=diffusivity), step)):
        close_to(sample, 2 * diffusivity * HOURS * 3600)


@pytest.mark.parametrize("step", [3600, 1800, 900])
def test_current_errors_spread_as_an_integrated_ornstein_uhlenbeck_process(step: int) -> None:
    """Var x(t) = 2 s^2 T^2 (t/T - 1 + exp(-t/T)) (Uhlenbeck and Ornstein 1930); steps up to T/6 err by 0.5 % at most."""
    std, time = 0.2, 21_600.0
    t = HOURS * 3600 / time
    variance = 2 * std**2 * time**2 * (t - 1 + np.exp(-t))
    ensemble = drifted(kernel.Physics(current_std=std, current_time=time), step)
    for sample in offsets(ensemble):
        close_to(sample, variance, 0.005)
    for column in (ensemble.current_error_east, ensemble.current_error_north):
        close_to(column.to_numpy().astype(float), std**2)


def uniform_wind(speed: float) -> Tiles:
    """A steady wind towards the north, everywhere."""
    tiles = Tiles([Grid(-180, -90, 360, 180, 2, 2)])
    values = np.zeros((2, 2, 2), np.float32)
    values[..., 1] = speed
    tiles.place(0, values, later=False)
    tiles.place(0, values, later=True)
    tiles.blend([(0.0, 0.0)])
    return tiles


@pytest.mark.parametrize("step", [3600, 900])
def test_wind_errors_act_through_the_leeway(step: int) -> None:
    """With a slope s downwind and no crosswind, an error in the wind moves the object by s times its integral."""
    std, time, slope = 1.5, 21_600.0, 0.03
    t = HOURS * 3600 / time
    variance = (slope * std * time) ** 2 * 2 * (t - 1 + np.exp(-t))

    def windage(ensemble: record.Ensemble) -> None:
        ensemble.down_slope.fill(slope)

    physics = kernel.Physics(wind_std=std, wind_time=time)
    ensemble = drifted(physics, step, (0, 0, 0, 1, 0, 0), uniform_wind(8.0), windage)
    east, north = offsets(ensemble)
    close_to(east, variance, 0.005)
    close_to(north - slope * 8.0 * HOURS * 3600, variance, 0.005)


@pytest.mark.parametrize("step", [3600, 600])
def test_jibing_swaps_the_whole_line_at_its_rate(step: int) -> None:
    """Sides form a telegraph process: the mean of side(0) side(t) is exp(-2 r t) (Kac 1974)."""
    rate, n = 0.1 / 3600, 100_000

    def equip(ensemble: record.Ensemble) -> None:
        ensemble.right_slope.fill(0.02)
        ensemble.right_offset.fill(0.05)
        ensemble.left_slope.fill(-0.01)
        ensemble.left_offset.fill(0.03)

    still = drifted(kernel.Physics(), step, (0, 0, 0, 1, 0, 0), uniform_wind(10.0), equip, n)
    east = offsets(still)[0]
    assert east == pytest.approx(0.25 * HOURS * 3600, rel=1e-4)  # all on the right line: slope and offset of it

    ensemble = drifted(kernel.Physics(jibe_rate=rate), step, (0, 0, 0, 1, 0, 0), uniform_wind(10.0), equip, n)
    t = HOURS * 3600
    side, correlation = ensemble.side.to_numpy(), np.exp(-2 * rate * t)
    assert abs(side.mean() - correlation) < 4.5 / np.sqrt(n)
    # Time on the right line: t/2 + (1 - exp(-2rt)) / 4r on average; 0.25 m/s there, -0.07 m/s on the left.
    right = t / 2 + (1 - correlation) / (4 * rate)
    east = offsets(ensemble)[0]
    assert abs(east.mean() - (0.25 * right - 0.07 * (t - right))) < 4.5 * east.std() / np.sqrt(n) + 0.32 * step / 2


def test_no_thread_or_order_of_slots_matters() -> None:
    """The second half of the slots alone moves as it does within the whole: noise hangs on the slot, not on the launch."""
    physics = kernel.Physics(0.2, 21_600.0, diffusivity=10.0)
    whole = drifted(physics, 3600, n=2000, bias=0.1)
    halves = record.empty(11, (0, 2000))
    for column, angle in ((halves.lon, AT[0]), (halves.lat, AT[1])):
        column.fill(int(sphere.to_binary(np.degrees(angle))))
    draw.draw_error(0, 2000, halves.current_error_east, halves.current_error_north, 0, *key(11), physics.current_std)
    for slots in ((1000, 2000), (0, 1000)):
        draw.draw_error(*slots, halves.current_bias_east, halves.current_bias_north, 2, *key(11), 0.1)
        for k in range(HOURS):
            clock = kernel.Step(k, k * 3600, 3600, 1)
            kernel.advance(halves, slots, Tiles([]), NOWHERE, physics, clock, kernel.Place(EVERYWHERE, bias=True))
    assert (whole.lon.to_numpy() == halves.lon.to_numpy()).all()
    assert (whole.lat.to_numpy() == halves.lat.to_numpy()).all()


def test_another_seed_or_size_of_the_bias_compiles_nothing() -> None:
    drifted(kernel.Physics(0.2, 21_600.0), 3600, n=100, bias=0.1)
    kernels = kernel._advance._primal.compiled_kernels, draw.draw_error._primal.compiled_kernels
    before = [len(compiled) for compiled in kernels]
    drifted(kernel.Physics(0.2, 21_600.0), 3600, n=100, bias=0.3, seed=2**62 + 3)
    assert [len(compiled) for compiled in kernels] == before
