"""The tail of the current's errors: each particle's scale, and what it does to displacements."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats

import drift
from drift.engine.motion.errors import forcing_error
from drift.engine.motion.errors.forcing_error import ForcingError
from drift.pipeline import run_setup
from geo import sphere
from geo.errors import UserError
from kernels.maths import noise
from kernels.runtime import runtime
from kernels.step import errors

HOUR = 3600.0
STD, TIME, BIAS = 0.23, 5 * HOUR, 0.07
N = 10_000
CASE = """
start = "2026-11-20T00:00Z"
duration = "24 h"
particles = {n}
clock.step = "{step} s"
output = {{ times = ["+6 h"], trajectories = {n} }}
coast.source = "none"
current = [{{ constant = {{ east = 0.2, north = -0.1 }} }}]
uncertainty.current = {{ std = "0.23 m/s", time = "5 h", bias = "0.07 m/s"{tail} }}
[[scenario]]
name = "drifter"
object = "water"
position = {{ at = [11.0, 0.0], std = "0 m" }}
"""


def written(folder, tail=", tail = 4", *, n=N, step=1800, more="", back=False):
    """Return the case with a tail, in a folder."""
    text = CASE.format(n=n, step=step, tail=tail) + more
    if back:
        text = text.replace('"+', '"-').replace("duration", 'direction = "backward"\nduration')
    (folder / "case.toml").write_text(text)
    return drift.load(folder / "case.toml")


def scales(freedom: float, n: int = 20_000, first: int = 0) -> np.ndarray:
    """Return scales of n particles, of which the first has a number in the whole run."""
    runtime.start("cpu", None, n)
    rows = runtime.upload(np.ones(len(errors.ROWS) * n, np.float32))
    errors.draw_scales(0, n, first, rows, *noise.key(77), freedom)
    found = rows.to_numpy().reshape(len(errors.ROWS), n)
    for row in (0, 1, 4, 5):  # errors and biases of the current; the wind's stay
        assert np.array_equal(found[row], found[errors.CURRENT_SCALE])
    assert (found[2:4] == 1).all()
    return found[errors.CURRENT_SCALE]


@pytest.mark.parametrize("freedom", [3.0, 4.0, 9.5, 100.0])
def test_scales_are_those_of_student(freedom):
    """(freedom - 2) / s^2 is chi2 above its value at the largest scale."""
    found = scales(freedom)
    assert found.max() <= errors.LARGEST_SCALE
    law = stats.chi2(freedom)
    beyond = law.cdf((freedom - 2) / errors.LARGEST_SCALE**2)
    if freedom < 5:  # the figures of docs/errors.md
        many, lost = {3: (1900, 0.1), 4: (8200, 0.016)}[freedom]
        assert 1 / beyond == pytest.approx(many, rel=0.02)
        least = (freedom - 2) / errors.LARGEST_SCALE**2
        inverse = law.expect(lambda chi2: (freedom - 2) / chi2, ub=least)
        assert inverse == pytest.approx(lost, rel=0.05)
    uniform = (law.cdf((freedom - 2) / found.astype(float) ** 2) - beyond) / (1 - beyond)
    assert stats.kstest(uniform, "uniform").pvalue > 1e-3


def test_scales_depend_on_the_number_in_the_whole_run_alone():
    whole = scales(4.0, 3000)
    assert np.array_equal(scales(4.0, 1000, first=2000), whole[2000:])


@pytest.mark.parametrize(("step", "back"), [(1800, False), (450, False), (1800, True)])
def test_displacements_are_student_at_any_step(tmp_path, step, back):
    """The area of share p of Student's law in two dimensions holds p, and east and north share a
    scale; normal ones of the same variance would fail by far.
    """
    tracks = drift.run(written(tmp_path, step=step, back=back)).trajectories
    elapsed = (tracks.time - tracks.time[0]) / np.timedelta64(1, "s")
    for hours in (6, 24):
        k = int(np.flatnonzero(np.abs(elapsed) == hours * HOUR)[0])
        x, y = (
            (v[:, k] - v[:, 0]).astype(float) * sphere.UNIT * sphere.RADIUS
            for v in (tracks.lon, tracks.lat)
        )
        square = (x - 0.2 * elapsed[k]) ** 2 + (y + 0.1 * elapsed[k]) ** 2
        t = hours * HOUR
        variance = 2 * STD**2 * TIME * (t - TIME * (1 - math.exp(-t / TIME))) + BIAS**2 * t**2
        holds = 1 - (1 + square / (2 * variance)) ** -2.0  # 4 degrees of freedom
        assert stats.kstest(holds, "uniform").pvalue > 1e-3
        assert stats.kstest(-np.expm1(-square / (2 * variance)), "uniform").pvalue < 1e-30


def test_no_tail_changes_no_bit(tmp_path):
    runs = [drift.run(written(tmp_path, tail, n=500)) for tail in ("", ', tail = "none"')]
    assert np.array_equal(runs[0].trajectories.lon, runs[1].trajectories.lon)
    tailed = drift.run(written(tmp_path, n=500))
    assert not np.array_equal(tailed.trajectories.lon, runs[0].trajectories.lon)


def test_shards_have_the_same_bits(tmp_path):
    case = written(tmp_path, n=8200)
    alone = drift.run(case)
    parts = drift.run(case, tmp_path / "out", shards=2)
    assert np.array_equal(alone.trajectories.lon, parts.trajectories.lon)


def test_a_table_with_std_has_no_tail_of_its_own(tmp_path):
    assert math.isinf(written(tmp_path, "").current_error.tail)
    assert written(tmp_path, ", tail = 3").current_error.tail == 3


@pytest.mark.parametrize("tail", ["2.9", "101", '"heavy"', "true"])
def test_a_tail_out_of_range_is_rejected(tmp_path, tail):
    with pytest.raises(UserError, match='must be "none" or degrees of freedom, 3 to 100'):
        written(tmp_path, f", tail = {tail}")


def test_no_tail_beside_drifters(tmp_path):
    (tmp_path / "buoy.csv").write_text("time,lon,lat\n2026-11-20T00:00Z,11,0\n")
    with pytest.raises(UserError, match=r"uncertainty\.current\.tail: errors are conditioned on"):
        written(tmp_path, more='[[drifter]]\ntrack = "buoy.csv"\n')


def test_no_tail_in_a_spill():
    case = drift.load("gulf_containers")
    with pytest.raises(UserError, match=r"uncertainty\.current\.tail: objects of one world share"):
        drift.vary(case, {"uncertainty": {"current": {"std": "0.1 m/s", "tail": 4}}})


def test_particles_with_a_tail_are_not_guided_to_finds():
    """The guide's proposal is of normal errors; without a tail it would be fitted."""
    error = ForcingError(0.2, 6 * HOUR, tail=4.0)
    contact = SimpleNamespace(drifter="a paddle")
    case = SimpleNamespace(
        spill=None,
        resampling=SimpleNamespace(fills=False),
        contacts=[contact],
        drifters=(),
        reports=(),
        current_error=error,
    )
    assert run_setup.guide_of(case, None, None) is None


def test_what_an_error_does_to_a_position():
    """The table of docs/errors.md, in nautical miles, for the default."""
    default = ForcingError(0.31, 11 * HOUR, 0.08)
    for hours, miles in ((6, 3.4), (12, 6.4), (24, 11.3), (48, 18.8)):
        assert default.displacement(hours * HOUR) / 1852 == pytest.approx(miles, abs=0.05)


def test_the_tail_of_a_default_is_the_case_s():
    default = ForcingError(0.31, 11 * HOUR, 0.08, ("default",) * 3, tail=5.0)
    assert forcing_error.errors_in_words(default, None, 0.0, "default") == (
        "current 0.31 m/s over 11 h and 0.08 m/s that lasts (default), Student's with 5 degrees of "
        "freedom (case)"
    )
    mixed = ForcingError(0.31, 11 * HOUR, 0.1, ("default", "default", "case"), tail=5.0)
    assert forcing_error.errors_in_words(mixed, None, 0.0, "default") == (
        "current 0.31 m/s over 11 h (default) and 0.1 m/s that lasts, Student's with 5 degrees of "
        "freedom (case)"
    )
    wind = ForcingError(0.0, 1.0)
    summary = forcing_error.summary_of_errors(default, wind, 0.0, "default")
    assert summary["current"]["by"]["tail"] == "case"
    assert "tail" not in summary["wind"]["by"]


@pytest.mark.parametrize("more", ["", ', length = "9 km"', ', length = "9 km", time = "4 h"'])
def test_a_tail_without_a_size_of_the_error_is_rejected(tmp_path, more):
    text = CASE.format(n=N, step=1800, tail="")
    stated = 'std = "0.23 m/s", time = "5 h", bias = "0.07 m/s"'
    (tmp_path / "case.toml").write_text(text.replace(stated, f"tail = 4{more}"))
    with pytest.raises(UserError, match=r"uncertainty\.current: has no std"):
        drift.load(tmp_path / "case.toml")


def test_words_and_summary():
    error = ForcingError(0.2, 6 * HOUR, 0.1, tail=4.0)
    assert forcing_error.errors_in_words(error, None, 0.0, "default") == (
        "current 0.2 m/s over 6 h and 0.1 m/s that lasts, Student's with 4 degrees of freedom (case)"
    )
    wind = ForcingError(0.0, 1.0)
    summary = forcing_error.summary_of_errors(error, wind, 0.0, "default")
    assert summary["current"]["tail"] == 4
    assert "tail" not in summary["wind"]
