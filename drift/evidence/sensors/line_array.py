"""Array gain by relative bearing: theory of a line of equal elements, or a table.

A line of n elements with spacing d, summed with delays for a steering angle s from its axis, has
for a plane wave from the angle a the response AF = sin(n x / 2) / (n sin(x / 2)), x = k d (cos a -
cos s), k = 2 pi f / c. In isotropic noise its gain in the steering direction is the directivity
index DI = 10 log10(n^2 / sum over all pairs of cos(x_s (i - j)) sinc(k d (i - j))), x_s = k d cos s
(Urick 1983, Principles of Underwater Sound, chapter 3; Van Trees 2002, Optimum Array Processing,
section 2.6). Its gain elsewhere is DI + 20 log10 |AF|. Sound is assumed to arrive in the horizontal
plane of the array, and noise from all of the sphere.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.special import diric

from drift.evidence.sensors import circle
from drift.evidence.sensors.records import Gain
from geo.array import Array
from geo.errors import UserError

SPEED = 1500.0  # [m/s]
# [dB] lowest gain relative to the beam's peak; leakage in a real array fills the nulls of theory
FLOOR = -40.0
# wavelengths by aperture: width in cos(a) of a long line's beam between its points of -3 dB
HALF_POWER = 0.886
# largest step of n x / 2 between bearings: linear interpolation errs by 0.07 dB at 20 dB below a
# long line's peak
STEP = 0.07
MOST_VALUES = 25_000_000  # values of a table of beams and bearings, 100 MB
MOST_ELEMENTS = 2000
AGREE = 0.1  # [dB] largest difference between duplicate bearings of a table
PLAUSIBLE = (-100.0, 80.0)  # [dB] gains of a table


def of_line(
    elements: int,
    spacing: float,
    frequency: float,
    *,
    sound_speed: float = SPEED,
    beams: int | None = None,
    steered: Sequence[float] | None = None,
    floor: float = FLOOR,
    name: str = "array",
) -> Gain:
    """Return the gain of a line array of equal elements.

    Neighbouring beams cross at -3 dB or higher if their number is not given: 1.13 n beams at half a
    wavelength (n orthogonal beams cross at -3.9 dB). Since a line cannot tell port from starboard,
    the gain is mirrored. Linear interpolation between its bearings errs by less than 0.1 dB within
    20 dB of a peak.

    Args:
        elements: number of elements.
        spacing: between neighbours [m].
        frequency: of the sound [Hz].
        sound_speed: [m/s].
        beams: number of beams, equally spaced in the cosine from dead ahead to dead astern.
        steered: relative bearings of the beams [rad], instead of `beams`.
        floor: lowest gain relative to each beam's peak [dB].
        name: start of error messages.

    Raises:
        UserError: a value out of range, or a table that would be too large.
    """
    _check(elements, spacing, frequency, sound_speed, floor, name)
    kd = 2.0 * math.pi * frequency / sound_speed * spacing
    cosines = _steering(elements, kd, beams, steered, name)
    step = STEP * np.sinc(1.0 / elements)  # a short line has steeper nulls at that level
    half = max(90, math.ceil(math.pi * elements * kd / 2.0 / step))  # bearings of a half circle
    if 2 * half * len(cosines) > MOST_VALUES:
        raise UserError(
            f"{name}: {len(cosines)} beams of {elements} elements at {frequency:g} Hz need a table of "
            f"{2 * half * len(cosines):,} values; at most {MOST_VALUES:,} are made: set fewer elements or beams"
        )
    bearing = np.arange(2 * half) * (math.pi / half)
    cos_half = np.cos(bearing[: half + 1])
    table = np.empty((len(cosines), 2 * half), np.float32)
    for k, cosine in enumerate(cosines):
        answer = np.abs(diric(kd * (cos_half - cosine), elements))
        with np.errstate(divide="ignore"):
            one = directivity(elements, kd, cosine) + np.maximum(20.0 * np.log10(answer), floor)
        table[k, : half + 1] = one
        table[k, half + 1 :] = one[-2:0:-1]
    return Gain(bearing, table, np.arccos(cosines), mirrored=True)


def directivity(elements: int, kd: float, cosine: float) -> float:
    """Return the directivity index [dB] of a line array.

    Args:
        elements: number of elements.
        kd: 2 pi spacing / wavelength.
        cosine: of the steering angle from the axis.
    """
    m = np.arange(1, elements)
    pairs = (elements - m) * np.sinc(m * kd / np.pi) * np.cos(m * kd * cosine)
    return 10.0 * math.log10(elements / (1.0 + 2.0 / elements * float(pairs.sum())))


def of_table(
    rows: Sequence[Sequence[float]],
    *,
    symmetric: bool = False,
    mirrored: bool = False,
    name: str = "array",
) -> Gain:
    """Return the gain of a table with one beam.

    Args:
        rows: [relative bearing in degrees, gain in dB].
        symmetric: whether the rows go from 0 to 180 degrees and hold on either side.
        mirrored: whether the array cannot tell port from starboard.
        name: start of error messages.

    Raises:
        UserError: values missing or out of range, or bearings that do not close the circle.
    """
    table = np.array([list(row) for row in rows if len(row) == 2], np.float64).reshape(-1, 2)
    if len(table) != len(rows) or not len(rows):
        raise UserError(
            f"{name}: a table of gains has rows of [relative bearing in degrees, gain in dB], and at least one"
        )
    bearing, gain = table.T
    if not np.isfinite(table).all():
        raise UserError(
            f"{name}: {np.sum(~np.isfinite(table))} numbers of the table of gains are missing; fill them in"
        )
    wrong = (gain < PLAUSIBLE[0]) | (gain > PLAUSIBLE[1])
    if wrong.any():
        raise UserError(
            f"{name}: a gain of {gain[wrong][0]:g} dB at {bearing[wrong][0]:g} degrees; allowed are {PLAUSIBLE[0]:g} to "
            f"{PLAUSIBLE[1]:g} dB: mend the table"
        )
    if symmetric:
        bearing, gain = _both_sides(bearing, gain, name)
    radians, gain = circle.close_circle(bearing, gain, 0, name, AGREE, "dB")
    return Gain(radians, gain[None].astype(np.float32), np.array([math.nan]), mirrored)


def _both_sides(bearing: Array, gain: Array, name: str) -> tuple[Array, Array]:
    """Return the rows of a half circle with their mirror images."""
    if bearing.min() < -circle.SAME or bearing.max() > 180.0 + circle.SAME:
        worst = bearing.min() if bearing.min() < 0 else bearing.max()
        raise UserError(
            f"{name}: a symmetric table has bearings from 0 to 180 degrees; given is {worst:g}: leave it out"
        )
    inside = (bearing > circle.SAME) & (bearing < 180.0 - circle.SAME)
    if bearing.min() > circle.SAME or bearing.max() < 180.0 - circle.SAME:
        raise UserError(
            f"{name}: a symmetric table goes from 0 to 180 degrees; given are {bearing.min():g} to {bearing.max():g}: add "
            "the bearings at its ends"
        )
    return np.concatenate((bearing, 360.0 - bearing[inside])), np.concatenate((gain, gain[inside]))


def _steering(
    elements: int, kd: float, beams: int | None, steered: Sequence[float] | None, name: str
) -> NDArray[np.float64]:
    """Return the cosines of the steering angles of beams."""
    if steered is not None:
        given = np.asarray(steered, np.float64).reshape(-1)
        if not given.size or not np.isfinite(given).all():
            raise UserError(
                f"{name}: beams are steered at one relative bearing or more, each a number: set steered"
            )
        return np.cos(given)
    if beams is None:
        beams = max(2, math.ceil(2.0 * elements * kd / (2.0 * math.pi * HALF_POWER)) + 1)
    if not 1 <= beams <= 10 * MOST_ELEMENTS:
        raise UserError(
            f"{name}: {beams} beams; allowed are 1 to {10 * MOST_ELEMENTS:,}: set beams"
        )
    return np.linspace(1.0, -1.0, beams) if beams > 1 else np.zeros(1)  # a single beam looks abeam


def _check(
    elements: int, spacing: float, frequency: float, sound_speed: float, floor: float, name: str
) -> None:
    for key, value, low, high, unit in (
        ("elements", elements, 2, MOST_ELEMENTS, ""),
        ("spacing", spacing, 1e-4, 1000.0, " m"),
        ("frequency", frequency, 1.0, 1e6, " Hz"),
        ("sound_speed", sound_speed, 1300.0, 1700.0, " m/s"),
        ("floor", floor, -120.0, -20.0, " dB"),
    ):
        if not low <= value <= high:
            raise UserError(
                f"{name}: {key} {value:g}{unit}; allowed are {low:g} to {high:g}{unit}: set {key}"
            )
    wavelengths = spacing * frequency / sound_speed
    if wavelengths > 2.0:
        raise UserError(
            f"{name}: elements {spacing:g} m apart are {wavelengths:.3g} wavelengths apart at {frequency:g} Hz; allowed are at "
            "most 2 (above half a wavelength a beam looks in several directions): set spacing or frequency"
        )
