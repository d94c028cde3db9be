"""A line of elements against closed forms, quadrature over the sphere, and sums of plane waves."""

import math

import numpy as np
import pytest
from scipy import integrate

from drift.evidence.sensors import line_array
from drift.evidence.sensors.records import Gain
from geo.errors import UserError

C = 1500.0


def pattern(elements: int, kd: float, cos_a: np.ndarray, cos_s: float) -> np.ndarray:
    """The answer to a plane wave, summed element by element: |sum of exp(i k x)|^2 / n^2."""
    phase = kd * np.arange(elements)[:, None] * (np.atleast_1d(cos_a) - cos_s)[None]
    return np.abs(np.exp(1j * phase).sum(axis=0) / elements) ** 2


def interpolated(gain: Gain, beam: int, bearing: np.ndarray) -> np.ndarray:
    return np.interp(bearing, gain.bearing, gain.beams[beam], period=2 * np.pi)


@pytest.mark.parametrize("elements", [2, 7, 48])
def test_half_a_wavelength_apart_the_gain_is_the_number_of_elements_at_every_steering(
    elements: int,
) -> None:
    gain = line_array.of_line(elements, 1.5, 500.0, sound_speed=C)
    for steered in np.linspace(0, np.pi, 31):
        assert line_array.directivity(elements, np.pi, np.cos(steered)) == pytest.approx(
            10 * np.log10(elements), abs=1e-9
        )
    # A peak may lie between two bearings: at n x / 2 = 0.035 the pattern has fallen by 0.0018 dB.
    short = 10 * np.log10(elements) - gain.beams.max(axis=1)
    assert short.max() < 0.0019
    assert short.min() > -1e-5


@pytest.mark.parametrize("wavelengths", [0.11, 0.35, 0.5, 0.8, 1.3])
@pytest.mark.parametrize("cosine", [0.0, 0.4, -0.77, 1.0])
def test_directivity_is_the_mean_of_the_pattern_over_the_sphere(
    wavelengths: float, cosine: float
) -> None:
    kd, n = 2 * math.pi * wavelengths, 12
    mean = (
        integrate.quad(
            lambda u: pattern(n, kd, np.array([u]), cosine)[0], -1, 1, limit=500, epsabs=1e-10
        )[0]
        / 2
    )
    assert line_array.directivity(n, kd, cosine) == pytest.approx(-10 * math.log10(mean), abs=1e-6)


def test_a_beam_is_its_directivity_and_the_pattern() -> None:
    n, d, f = 24, 2.0, 300.0
    kd = 2 * math.pi * f * d / C
    steered = np.radians([0.0, 35.0, 90.0, 160.0])
    gain = line_array.of_line(n, d, f, sound_speed=C, steered=steered)
    np.testing.assert_allclose(gain.steered, steered, atol=1e-12)
    assert gain.mirrored
    for k, s in enumerate(steered):
        want = 10 * np.log10(np.maximum(pattern(n, kd, np.cos(gain.bearing), math.cos(s)), 1e-4))
        np.testing.assert_allclose(
            gain.beams[k], line_array.directivity(n, kd, math.cos(s)) + want, atol=1e-3
        )
        assert gain.beams[k].min() == pytest.approx(
            line_array.directivity(n, kd, math.cos(s)) - 40.0, abs=1e-4
        )


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("elements", "spacing", "frequency"),
    [(2, 1.5, 500.0), (32, 1.5, 500.0), (96, 3.0, 180.0), (16, 4.0, 700.0)],
)
def test_straight_lines_between_bearings_err_by_less_than_a_tenth_within_20_db(
    elements: int, spacing: float, frequency: float
) -> None:
    kd = 2 * math.pi * frequency * spacing / C
    gain = line_array.of_line(elements, spacing, frequency, sound_speed=C)
    bearing = np.linspace(0, 2 * np.pi, 60_001)
    worst = 0.0
    for beam in {0, 1, len(gain.beams) // 3, len(gain.beams) // 2, len(gain.beams) - 1}:
        cos_s = math.cos(gain.steered[beam])
        with np.errstate(divide="ignore"):
            loss = 10 * np.log10(pattern(elements, kd, np.cos(bearing), cos_s))
        error = np.abs(
            interpolated(gain, beam, bearing) - line_array.directivity(elements, kd, cos_s) - loss
        )
        worst = max(worst, error[loss > -20].max())
    assert worst < 0.1


@pytest.mark.parametrize(
    ("elements", "wavelengths"), [(2, 0.5), (8, 0.5), (64, 0.5), (64, 0.2), (40, 0.7)]
)
def test_neighbouring_beams_cross_at_3_db_or_higher(elements: int, wavelengths: float) -> None:
    kd = 2 * math.pi * wavelengths
    gain = line_array.of_line(elements, wavelengths * C / 500.0, 500.0, sound_speed=C)
    cosines = np.cos(gain.steered)
    np.testing.assert_allclose(np.diff(cosines, 2), 0, atol=1e-12)  # equally spaced
    np.testing.assert_allclose([cosines[0], cosines[-1]], [1, -1])
    middle = pattern(elements, kd, np.array([(cosines[0] + cosines[1]) / 2]), cosines[0])[0]
    assert 10 * math.log10(middle) > -3.02
    best = (gain.beams - gain.beams.max(axis=1)[:, None]).max(axis=0)
    assert best.min() > -3.02  # at every bearing
    assert len(gain.beams) == math.ceil(2 * elements * wavelengths / 0.886) + 1


def test_port_and_starboard_are_the_same() -> None:
    gain = line_array.of_line(20, 1.5, 400.0)
    np.testing.assert_array_equal(gain.beams[:, 1:], gain.beams[:, :0:-1])
    assert gain.bearing[0] == 0
    assert gain.bearing[-1] < 2 * np.pi
    assert (np.diff(gain.bearing) > 0).all()


def test_a_table_is_taken_in_order_round_the_circle() -> None:
    rows = [[-30.0, 4.0], [0.0, 10.0], [30.0, 5.0], [60, 1], [90, 0], [120, -1], [150, -2], [180, -3], [210, 1.5], [240, 2],
            [270, 3], [300, 3.5], [360.0, 10.0]]  # fmt: skip
    gain = line_array.of_table(rows)
    np.testing.assert_allclose(np.degrees(gain.bearing), np.arange(0, 360, 30))
    np.testing.assert_allclose(gain.beams, [[10, 5, 1, 0, -1, -2, -3, 1.5, 2, 3, 3.5, 4]])
    assert not gain.mirrored
    assert np.isnan(gain.steered).all()


def test_a_symmetric_table_holds_on_both_sides() -> None:
    gain = line_array.of_table(
        [[180.0, 0.0], [0.0, 9.0], [45.0, 6.0], [90.0, 3.0], [135.0, 1.0]],
        symmetric=True,
        mirrored=True,
    )
    np.testing.assert_allclose(np.degrees(gain.bearing), np.arange(0, 360, 45))
    np.testing.assert_allclose(gain.beams, [[9, 6, 3, 1, 0, 1, 3, 6]])
    assert gain.mirrored


def test_one_row_holds_all_round() -> None:
    gain = line_array.of_table([[17.0, 6.0]])
    assert gain.beams.tolist() == [[6.0]]


HALF = [[a, 3.0] for a in range(0, 181, 30)]
BAD_TABLES = {
    "half a circle": (HALF, {}, "between the bearings 180 and 0 degrees: a gap of 180"),
    "a bearing forgotten": (
        [[a, 3.0] for a in range(0, 360, 20) if a not in (100, 120)], {}, r"between the bearings 80 and 140 .*\(20\)"
    ),
    "twice": ([[a, 3.0] for a in range(0, 360, 30)] + [[30.0, 5.0]], {}, "bearing 30 degrees stands twice"),
    "no rows": ([], {}, "at least one"),
    "three columns": ([[0.0, 1.0, 2.0]], {}, r"rows of \[relative bearing in degrees, gain in dB\]"),
    "missing": ([[0.0, math.nan]], {}, "1 numbers of the table of gains are missing"),
    "no gain": ([[0.0, 150.0]], {}, "a gain of 150 dB at 0 degrees; allowed are -100 to 80 dB"),
    "symmetric beyond": ([*HALF, [190.0, 3.0]], {"symmetric": True}, "bearings from 0 to 180 degrees; given is 190"),
    "symmetric without its end": (HALF[:-1], {"symmetric": True}, "goes from 0 to 180 degrees; given are 0 to 150"),
}  # fmt: skip


@pytest.mark.parametrize("kind", BAD_TABLES)
def test_tables_that_are_no_pattern_are_refused(kind: str) -> None:
    rows, keys, said = BAD_TABLES[kind]
    with pytest.raises(UserError, match=said) as caught:
        line_array.of_table(rows, name="hull", **keys)
    assert str(caught.value).startswith("hull: ")
    assert len(caught.value.lines) == 1


BAD_LINES = {
    "one element": ({"elements": 1}, "elements 1; allowed are 2 to 2000: set elements"),
    "spacing": ({"spacing": 0.0}, "spacing 0 m; allowed"),
    "frequency": ({"frequency": math.nan}, "frequency nan Hz"),
    "speed": ({"sound_speed": 340.0}, "sound_speed 340 m/s; allowed are 1300 to 1700"),
    "floor": ({"floor": 3.0}, "floor 3 dB; allowed are -120 to -20"),
    "too far apart": (
        {"spacing": 20.0},
        "are 6.67 wavelengths apart at 500 Hz; allowed are at most 2",
    ),
    "beams": ({"beams": 0}, "0 beams; allowed are 1 to"),
    "steered": ({"steered": []}, "steered at one relative bearing or more"),
    "too large": ({"elements": 2000}, "need a table of .* values; at most 25,000,000"),
}


@pytest.mark.parametrize("kind", BAD_LINES)
def test_lines_that_are_no_array_are_refused(kind: str) -> None:
    keys, said = BAD_LINES[kind]
    with pytest.raises(UserError, match=said):
        line_array.of_line(**{"elements": 32, "spacing": 1.5, "frequency": 500.0, **keys})
