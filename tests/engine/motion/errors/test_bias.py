"""The error of the current in whole runs: closed forms of what it does over two days, and what each
particle keeps of it.
"""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from scipy import stats

import drift
from geo import sphere

pytestmark = pytest.mark.usefixtures("coarse_maps")  # no number is read off a map

HOUR = 3600.0
STD, TIME, BIAS = 0.31, 11 * HOUR, 0.08  # the defaults
U, V = 0.2, -0.1  # [m/s]
N = 20_000
WINDOWS = ((0, 4), (24, 28), (44, 48))  # [h] over which velocities are measured
CASE = """
start = "2026-11-20T00:00Z"
duration = "48 h"
particles = {n}
clock.step = "{step} s"
output = {{ times = ["+0 h", "+4 h", "+24 h", "+28 h", "+44 h"], trajectories = {n} }}
coast.source = "none"
current = [{{ files = "sea.nc" }}]
{more}
[[scenario]]
name = "drifter"
object = "water"
position = {{ at = [11.0, 0.0], std = "1 m" }}
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A steady, uniform current on the equator, as a model's file: all that spreads is its error."""
    made = tmp_path_factory.mktemp("sea")
    lon, lat = np.arange(7.5, 15.1, 0.5), np.arange(-3.5, 3.6, 0.5)
    fields = {
        key: (
            ("time", "lat", "lon"),
            np.full((3, lat.size, lon.size), speed),
            {"standard_name": name, "units": "m s-1"},
        )
        for key, name, speed in (
            ("u", "eastward_sea_water_velocity", U),
            ("v", "northward_sea_water_velocity", V),
        )
    }
    hours = np.array(["2026-11-18", "2026-11-20", "2026-11-22"], "datetime64[ns]")
    xr.Dataset(fields, {"time": hours, "lat": lat, "lon": lon}).to_netcdf(made / "sea.nc")
    return made


def ran(
    folder: Path, more: str = "", step: int = 1800, n: int = N, back: bool = False
) -> np.ndarray:
    """Return every particle's displacement [m] beside the mean flow's from the start to each
    output, (2, n, 6).
    """
    text = CASE.format(n=n, step=step, more=more)
    if back:
        text = text.replace("+", "-").replace("duration", 'direction = "backward"\nduration')
    (folder / "trial.toml").write_text(text)
    tracks = drift.run(drift.load(folder / "trial.toml")).trajectories
    elapsed = (tracks.time - tracks.time[0]) / np.timedelta64(1, "s")
    ours = np.flatnonzero(np.isin(np.abs(elapsed), np.array([0, 4, 24, 28, 44, 48]) * HOUR))
    assert (len(tracks.lon), ours.size) == (n, 6)
    way = [
        (x - x[:, :1]).astype(float) * sphere.UNIT * sphere.RADIUS for x in (tracks.lon, tracks.lat)
    ]
    return (np.array(way) - np.array([U, V])[:, None, None] * elapsed)[..., ours]


def held(found: float, expected: float, error: float) -> None:
    assert abs(found - expected) < 3 * error


@pytest.mark.thorough
@pytest.mark.parametrize(("step", "back"), [(1800, False), (900, True)])
def test_the_default_error_spreads_and_lasts_as_its_closed_form(
    folder: Path, step: int, back: bool
) -> None:
    """Position and velocity of an Ornstein-Uhlenbeck process (Uhlenbeck and Ornstein 1930) about a
    constant, in 3 standard errors.

    A step of T / 22 errs by 0.1 % of the variance over 4 h, a tenth of one; cos(lat) on the way by
    0.01 %.
    """
    way = ran(folder, step=step, back=back)
    lag, gone = (
        TIME * np.expm1(-np.array([4, 24, 28, 44, 48]) * HOUR / TIME),
        np.array([4, 24, 28, 44, 48]) * HOUR,
    )
    variance = 2 * STD**2 * TIME * (gone + lag) + (BIAS * gone) ** 2
    for component in way:
        for k in (1, 4):  # 24 and 48 h
            held(component[:, k + 1].var(), variance[k], variance[k] * np.sqrt(2 / N))
            held(component[:, k + 1].mean(), 0.0, np.sqrt(variance[k] / N))
    velocity = np.array([way[..., 1], way[..., 3] - way[..., 2], way[..., 5] - way[..., 4]]) / (
        4 * HOUR
    )
    mean = variance[0] / (4 * HOUR) ** 2  # of a mean over 4 h
    for a in range(3):
        for component in velocity[a]:
            held(component.var(), mean, mean * np.sqrt(2 / N))
        for b in range(a):
            apart = (WINDOWS[a][0] - WINDOWS[b][0]) * HOUR
            x = 4 * HOUR / TIME
            kept = (
                STD**2 * np.exp(-apart / TIME) * np.expm1(x) * -np.expm1(-x) / x**2 + BIAS**2
            ) / mean
            for one, other in zip(velocity[a], velocity[b], strict=True):
                held(np.corrcoef(one, other)[0, 1], kept, (1 - kept**2) / np.sqrt(N))
        held(np.corrcoef(*velocity[a])[0, 1], 0.0, 1 / np.sqrt(N))


def test_each_particle_draws_its_own_bias_and_keeps_it(folder: Path) -> None:
    """The same velocity in all windows, to a metre of some 1,400; no two particles', and no two
    components', go together.
    """
    n = 5000
    way = ran(folder, 'uncertainty.current = { std = 0, bias = "0.1 m/s" }', n=n)
    ways = np.array([way[..., 1], way[..., 3] - way[..., 2], way[..., 5] - way[..., 4]])
    assert np.abs(ways - ways[0]).max() < 1.0
    bias = ways[0] / (4 * HOUR)
    assert len(np.unique(bias.T, axis=0)) > 0.999 * n  # told to 6e-7 m/s, the unit of positions
    for component in bias:
        assert stats.kstest(component, stats.norm(0, 0.1).cdf).pvalue > 0.003
        held(component.var(), 0.01, 0.01 * np.sqrt(2 / n))
        for apart in (1, 2, 64, n // 2):
            held(
                np.corrcoef(component[apart:], component[:-apart])[0, 1],
                0.0,
                1 / np.sqrt(n - apart),
            )
    held(np.corrcoef(*bias)[0, 1], 0.0, 1 / np.sqrt(n))


def test_a_bias_is_no_copy_of_the_error_that_each_particle_starts_with(folder: Path) -> None:
    """With an error that hardly changes the two add up to the sum of their variances: they are
    drawn apart.
    """
    way = ran(
        folder,
        'uncertainty.current = { std = "0.1 m/s", time = "9000 d", bias = "0.1 m/s" }',
        n=5000,
    )
    for component in way[..., -1] / (48 * HOUR):
        held(component.var(), 0.02, 0.02 * np.sqrt(2 / 5000))


def test_copies_keep_the_bias_of_what_they_were_drawn_from(folder: Path) -> None:
    """A sortie over the east at 12 h, then drawing again: every track, followed through its
    ancestors, still has one velocity.
    """
    sortie = """uncertainty.current = { std = 0, bias = "0.1 m/s" }
resampling.below = 0.99
[[sortie]]
name = "east"
start = "+11 h"
end = "+12 h"
law = "random"
pod = 0.95
area = { polygon = [[11.09, -2], [13, -2], [13, 2], [11.09, 2]] }"""
    way = ran(folder, sortie, n=2000)
    ways = np.array([way[..., 1], way[..., 3] - way[..., 2], way[..., 5] - way[..., 4]])
    assert len(np.unique(way[0, :, 1])) < 0.75 * 2000  # many are copies
    assert np.abs(ways - ways[0]).max() < 1.0
