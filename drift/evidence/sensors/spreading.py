"""Transmission loss by formulas: spreading, absorption and convergence zones.

The loss does not depend on bearing and place.
"""

import math
from collections.abc import Sequence

import numpy as np

from drift.evidence.sensors.records import Losses
from geo.array import Array
from geo.errors import UserError

NEAREST = 1.0  # [m] the range to which source levels refer, where the loss is 0 dB
ERROR = 0.04  # [dB] largest error of linear interpolation between the ranges of a table
EDGE = 10.0  # [m] width over which the gain of a convergence zone rises and falls
CYLINDRICAL = 10.0  # [dB] for ten times the range, beyond the transition
FARTHEST = 2.0e7  # [m] half way round the Earth

# Values of the oceans, and frequencies about those of Francois and Garrison's measurements.
ALLOWED = {
    "frequency": (10.0, 1.0e6, "Hz"),
    "temperature": (-2.0, 35.0, "degrees Celsius"),
    "salinity": (0.0, 45.0, "g/kg"),
    "depth": (0.0, 10_000.0, "m"),
    "ph": (7.0, 8.6, ""),
}


def losses(
    largest: float,
    *,
    coefficient: float = 20.0,
    transition: float | None = None,
    absorption: float = 0.0,
    zones: Sequence[tuple[float, float, float]] = (),
    name: str = "spreading",
) -> Losses:
    """Return the losses of a formula up to a largest range: one bearing, no places.

    loss = coefficient log10(r / 1 m) up to the transition, 10 log10 beyond it (Urick 1983,
    Principles of Underwater Sound, section 5.3), + absorption r, - the gain of the convergence
    zones. Linear interpolation between the ranges errs by at most 0.04 dB.

    Args:
        largest: largest range [m].
        coefficient: of spreading up to the transition [dB].
        transition: range beyond which spreading is cylindrical [m]; None: nowhere.
        absorption: [dB/km].
        zones: inner and outer limit [m] and gain [dB] of each convergence zone; the gain rises and
            falls over the 10 m about a limit.
        name: start of error messages.

    Raises:
        UserError: a value out of range, or a negative loss.
    """
    _check(largest, coefficient, transition, absorption, zones, name)
    ratio = math.exp(math.sqrt(8.0 * ERROR * math.log(10.0) / max(coefficient, CYLINDRICAL)))
    count = math.ceil(math.log(largest / NEAREST) / math.log(ratio)) + 1
    corners = [
        limit + side * EDGE / 2
        for inner, outer, _ in zones
        for limit in (inner, outer)
        for side in (-1.0, 1.0)
    ]
    corners += [] if transition is None else [transition]
    metres = np.concatenate(
        (np.geomspace(NEAREST, largest, count), [c for c in corners if NEAREST < c < largest])
    )
    metres = np.unique(metres)
    table = _loss_at(
        metres, coefficient=coefficient, transition=transition, absorption=absorption, zones=zones
    )
    if table.min() < 0.0:
        k = int(np.argmin(table))
        raise UserError(
            f"{name}: the loss is {table[k]:.3g} dB at {metres[k]:.6g} m; a loss is at least 0 dB: make the gain of its "
            "convergence zone smaller"
        )
    return Losses(
        np.zeros(1), metres, table.astype(np.float32)[None, None], np.empty(0), np.empty(0), name
    )


def _loss_at(
    metres: Array,
    *,
    coefficient: float = 20.0,
    transition: float | None = None,
    absorption: float = 0.0,
    zones: Sequence[tuple[float, float, float]] = (),
) -> Array:
    """Return the formula's loss [dB] at ranges [m] of at least 1 m; see `losses`."""
    knee = math.inf if transition is None else transition
    near = coefficient * np.log10(np.minimum(metres, knee) / NEAREST)
    total = (
        near + CYLINDRICAL * np.log10(np.maximum(metres / knee, 1.0)) + absorption * metres / 1000.0
    )
    for inner, outer, gain in zones:
        rise, fall = (np.clip((metres - limit) / EDGE + 0.5, 0.0, 1.0) for limit in (inner, outer))
        total = total - gain * (rise - fall)
    return np.asarray(total)


def absorption(
    frequency: float,
    *,
    temperature: float = 10.0,
    salinity: float = 35.0,
    depth: float = 0.0,
    ph: float = 8.0,
    name: str = "absorption",
) -> float:
    """Return the absorption of sound in sea water [dB/km].

    Francois and Garrison 1982, part II, doi:10.1121/1.388673: the sum of boric acid, magnesium
    sulphate and pure water. It holds for all oceans from 200 Hz to 1 MHz and is accurate to about 5
    %. Below 200 Hz, where absorption is at most 0.01 dB/km, it is extrapolated.

    Args:
        frequency: [Hz].
        temperature: [degrees Celsius].
        salinity: [g/kg].
        depth: [m].
        ph: acidity (pH).
        name: start of error messages.

    Raises:
        UserError: a value out of range.
    """
    given = {
        "frequency": frequency,
        "temperature": temperature,
        "salinity": salinity,
        "depth": depth,
        "ph": ph,
    }
    for key, value in given.items():
        low, high, unit = ALLOWED[key]
        if not low <= value <= high:
            raise UserError(
                f"{name}: {key} {value:g}{' ' * bool(unit)}{unit}; allowed are {low:g} to {high:g}: set {key}"
            )
    f, t, s, d = frequency / 1000.0, temperature, salinity, depth
    kelvin = 273.0 + t
    c = 1412.0 + 3.21 * t + 1.19 * s + 0.0167 * d  # [m/s]
    boric = 8.86 / c * 10.0 ** (0.78 * ph - 5.0)
    f1 = 2.8 * math.sqrt(s / 35.0) * 10.0 ** (4.0 - 1245.0 / kelvin)  # [kHz]
    sulphate = 21.44 * s / c * (1.0 + 0.025 * t) * (1.0 - 1.37e-4 * d + 6.2e-9 * d * d)
    f2 = 8.17 * 10.0 ** (8.0 - 1990.0 / kelvin) / (1.0 + 0.0018 * (s - 35.0))  # [kHz]
    if t <= 20.0:
        water = 4.937e-4 - 2.59e-5 * t + 9.11e-7 * t**2 - 1.50e-8 * t**3
    else:
        water = 3.964e-4 - 1.146e-5 * t + 1.45e-7 * t**2 - 6.5e-10 * t**3
    water *= 1.0 - 3.83e-5 * d + 4.9e-10 * d * d
    total = f * f * (boric * f1 / (f1**2 + f * f) + sulphate * f2 / (f2**2 + f * f) + water)
    return float(total)


def _check(
    largest: float,
    coefficient: float,
    transition: float | None,
    absorption: float,
    zones: Sequence[tuple[float, float, float]],
    name: str,
) -> None:
    """Reject parameters out of range, and overlapping zones."""
    for key, value, low, high, unit in (
        ("largest range", largest, 100.0, FARTHEST, " m"),
        ("coefficient", coefficient, 5.0, 60.0, " dB"),
        ("transition", largest if transition is None else transition, NEAREST, FARTHEST, " m"),
        ("absorption", absorption, 0.0, 1000.0, " dB/km"),
    ):
        if not low <= value <= high:
            raise UserError(
                f"{name}: {key} {value:g}{unit}; allowed are {low:g} to {high:g}{unit}: set {key}"
            )
    before = -math.inf
    for inner, outer, gain in sorted(zones):
        told = f"{name}: convergence zone {inner:g} to {outer:g} m"
        if not (inner >= EDGE and outer - inner >= EDGE and outer <= largest):
            raise UserError(
                f"{told}; allowed are an inner limit of at least {EDGE:g} m, an outer one {EDGE:g} m beyond it or more, and "
                f"at most the largest range, {largest:g} m: set its zones"
            )
        if not 0.0 < gain <= 60.0:
            raise UserError(
                f"{told} has a gain of {gain:g} dB; allowed are gains above 0 and up to 60 dB: set its zones"
            )
        if inner < before:
            raise UserError(
                f"{told} begins within the one before, which ends at {before:g} m: set its zones apart"
            )
        before = outer
