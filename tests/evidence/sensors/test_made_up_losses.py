"""Losses of made-up water: the parabolic equation against closed forms, normal modes and rays; and
the shipped files.
"""

from pathlib import Path

import netCDF4
import numpy as np
import pytest
from generate import losses
from places import ROOT
from scipy import integrate, linalg, optimize, special

FREQUENCY = 50.0
WAVE_NUMBER = 2 * np.pi * FREQUENCY / losses.REFERENCE
NMI = 1852.0
FOLDER = ROOT / "cases" / "losses"
AXIS, BOTTOM = 1050.0, 5200.0  # [m] of the Sargasso's southern water


def test_between_two_mirrors_it_is_the_sum_of_modes() -> None:
    """An ideal waveguide:

    Jensen et al. 2011, Computational Ocean Acoustics, equation 2.161, with H0 at every range.
    """
    grid = losses.Grid(points=512, bottom=np.inf, deepest=2000.0, step=100.0)
    source, receiver, steps = 300.0, float(grid.depth[99]), 300
    start = losses.source(grid, source, FREQUENCY, steepest=np.radians(105))  # no angle fades
    still = np.zeros((1, 511), complex)
    found = losses.march(grid, start[None], lambda r: still, FREQUENCY, steps, receiver)[0]
    r = grid.step * np.arange(1, steps + 1)
    kz = np.arange(1, int(WAVE_NUMBER * 2000 / np.pi) + 1) * np.pi / 2000
    kr = np.sqrt(WAVE_NUMBER**2 - kz**2)
    waves = special.hankel1(0, kr * r[:, None])
    pressure = np.abs(
        2j * np.pi / 2000 * (np.sin(kz * source) * np.sin(kz * receiver) * waves).sum(axis=1)
    )
    # H0 far off errs by 1 / (8 kr r) for each mode: so much at the most, which the steepest mode
    # alone comes to.
    error = (
        2
        * np.pi
        / 2000
        * (np.sqrt(2 / (np.pi * kr * r[:, None])) / (8 * kr * r[:, None])).sum(axis=1)
    )
    assert np.all(np.abs(np.sqrt(found) - pressure) < error + 1e-9)
    assert np.all(
        np.abs(20 * np.log10(np.sqrt(found) / pressure))[20:][pressure[20:] > 1e-4] < 0.02
    )


def test_under_a_mirror_it_is_the_sound_and_its_image() -> None:
    # with its bottom, which returns nothing here: it has the speed of the water
    grid = losses.Grid(step=100.0)
    still = losses.slowness(grid, np.full((1, grid.points - 1), losses.REFERENCE))
    start = losses.source(grid, 100.0, FREQUENCY)
    found = losses.march(grid, start[None], lambda r: still, FREQUENCY, 100, 150.0)[0]
    r = 100.0 * np.arange(1, 101)
    near, far = np.hypot(r, 50.0), np.hypot(r, 250.0)
    pressure = np.abs(np.exp(1j * WAVE_NUMBER * near) / near - np.exp(1j * WAVE_NUMBER * far) / far)
    lost = 10 * np.log10(found) - 20 * np.log10(pressure)
    flat = r > 250 / np.tan(np.radians(60))  # what is steeper fades
    assert np.all(np.abs(lost[flat & (r > 500)]) < 0.1)


def sound_speed(depth: np.ndarray | float) -> np.ndarray:
    """Return Munk's canonical profile about AXIS, written out again [m/s]."""
    eta = (np.asarray(depth) - AXIS) / 650
    return 1492 * (1 + 0.00737 * (np.exp(-eta) - (1 - eta)))


def test_munks_profile_gives_the_modes_of_its_eigenvalues() -> None:
    """Zones by trapped modes, from the tridiagonal eigenvalue problem of the Helmholtz equation in
    depth, second order.
    """
    grid, source, receiver = losses.Grid(step=75.0), 100.0, 100.0
    n, steps = 4000, round(70 * NMI / 75)
    depth = np.arange(1, n) * 7680 / n
    dz = 7680 / n
    k2 = (2 * np.pi * FREQUENCY / sound_speed(depth)) ** 2
    slowest = 2 * np.pi * FREQUENCY / float(sound_speed(BOTTOM - 100))
    values, modes = linalg.eigh_tridiagonal(
        k2 - 2 / dz**2, np.full(n - 2, 1 / dz**2), select="v", select_range=(slowest**2, k2.max())
    )
    modes /= np.sqrt(dz)
    at = [np.array([np.interp(z, depth, mode) for mode in modes.T]) for z in (source, receiver)]
    r = grid.step * np.arange(1, steps + 1)
    kr = np.sqrt(values)
    waves = np.exp(1j * kr * r[:, None]) / np.sqrt(kr * r[:, None])
    pressure = np.sqrt(2 * np.pi) * (at[0] * at[1] * waves).sum(axis=1)
    index = losses.slowness(grid, sound_speed(grid.depth)[None])
    start = losses.source(grid, source, FREQUENCY)
    found = losses.march(grid, start[None], lambda r: index, FREQUENCY, steps, receiver)[0]
    window = 0.8 * NMI / grid.step
    ours = -10 * np.log10(losses.smoothed(found * r, window))
    theirs = -10 * np.log10(losses.smoothed(np.abs(pressure) ** 2 * r, window))
    for zone in (30, 60):
        near = np.abs(r / NMI - zone) < 5
        peak, expected = (r[near][np.argmin(level[near])] for level in (ours, theirs))
        # The splitting errs in kr by about (n - 1) theta^2 / 2, 1e-3 at most here (n - 1 < 0.04,
        # theta < 13 degrees).
        assert abs(peak - expected) < 2e-3 * expected + grid.step
        assert abs(ours[near].min() - theirs[near].min()) < 0.1
        assert (
            np.abs(ours - theirs)[near & (theirs < theirs[near].min() + 3)].max() < 0.5
        )  # a flank of 10 dB a mile, shifted


def ray(angle: float, depth: float = 100.0) -> tuple[float, float, float]:
    """Return ranges [nmi] of a ray's lower and upper half cycles from a depth, and how deep it
    turns [m].
    """
    fastest = float(sound_speed(depth)) / np.cos(angle)

    def across(low: float, high: float) -> float:
        def slope(t: float) -> float:
            speed = float(sound_speed(low + (high - low) * (1 - np.cos(t)) / 2))
            return (high - low) / 2 * np.sin(t) * speed / np.sqrt(max(fastest**2 - speed**2, 1e-9))

        return float(integrate.quad(slope, 0, np.pi, limit=200)[0])

    turn = optimize.brentq(lambda z: float(sound_speed(z)) - fastest, AXIS, 9000)
    top = (
        0.0
        if sound_speed(0.0) < fastest
        else optimize.brentq(lambda z: float(sound_speed(z)) - fastest, 0, depth)
    )
    return 2 * across(depth, turn) / NMI, 2 * across(top, depth) / NMI, turn


@pytest.mark.parametrize("zone", [1, 2])
def test_zones_of_the_shipped_file_lie_at_the_caustics_of_rays(zone: int) -> None:
    rays = np.array([ray(angle) for angle in np.radians(np.arange(0.3, 16, 0.2))])
    down, up = rays[rays[:, 2] < BOTTOM, :2].T
    caustics = [(zone * down + k * up).min() for k in (zone - 1, zone, zone + 1)]
    with netCDF4.Dataset(FOLDER / "sargasso.nc") as data:
        r = data["range"][:] / NMI
        loss = data["loss"][0, 0, np.flatnonzero(data["bearing"][:] == 180)[0]]
    near = np.abs(r - 30 * zone) < 10
    peak = float(r[near][np.argmin(loss[near])])
    assert min(caustics) - 0.4 < peak < max(caustics) + 0.4  # the window of range
    assert abs(peak - 30 * zone) < 1.5  # as in figures 1 and 2


@pytest.mark.parametrize(
    ("name", "depths", "places"), [("sargasso.nc", 1, 2), ("north_pacific.nc", 2, 9)]
)
def test_shipped_files_are_small_and_say_what_they_are(name: str, depths: int, places: int) -> None:
    path: Path = FOLDER / name
    assert path.stat().st_size < 150_000
    with netCDF4.Dataset(path) as data:
        assert "NOT measured" in data.source
        assert "made-up" in data.history
        loss, bearing, r = data["loss"], data["bearing"], data["range"]
        assert loss.dimensions == ("depth", "place", "bearing", "range")
        assert loss.shape[:2] == (depths, places)
        assert (loss.units, bearing.units, r.units) == ("dB", "degree", "m")
        assert np.allclose(np.diff(bearing[:]), 360 / len(bearing))
        assert np.all(np.diff(r[:]) > 0)
        table = loss[:]
        assert not np.ma.is_masked(table)
        assert 40 < table.min() < table.max() < losses.WORST


def test_the_water_differs_by_bearing() -> None:
    with netCDF4.Dataset(FOLDER / "sargasso.nc") as data:
        loss, bearing, r = data["loss"][0, 0], data["bearing"][:], data["range"][:] / NMI
    second = (r > 55) & (r < 65)
    # beyond the front
    assert loss[bearing == 0][0, second].min() > loss[bearing == 180][0, second].min() + 5
    assert abs(loss[bearing == 90] - loss[bearing == 270]).max() < 0.05  # the front runs east


def test_one_radial_of_a_file_is_what_the_script_makes() -> None:
    survey = losses.SURVEYS["sargasso.nc"]
    short = losses.Survey(
        survey.title, survey.water, survey.law, survey.places, 2, 40.0, 0.25, 0.4, survey.depths
    )
    r, loss = losses.radials(short, survey.places[1], 100.0, losses.Grid())
    with netCDF4.Dataset(FOLDER / "sargasso.nc") as data:
        kept = data["loss"][0, 1, ::12, : len(r)]
    assert (
        np.abs(loss - kept)[:, :-8].max() < 0.0051
    )  # a hundredth of a decibel is kept; the last ranges know no more beyond
