"""Spreading by its closed form; absorption against another program and another formula fitted to
the same data.
"""

import math

import numpy as np
import pytest

from drift.evidence.sensors import spreading
from geo.errors import UserError

ZONES = [(50_000.0, 58_000.0, 12.0), (100_000.0, 115_000.0, 9.0)]


def by_hand(r: float, transition: float, alpha: float) -> float:
    """20 log10 r, then 10 log10 r from the transition on, and absorption; inside and outside zones,
    not at their edges.
    """
    total = (
        20 * math.log10(min(r, transition))
        + 10 * math.log10(max(r, transition) / transition)
        + alpha * r / 1000
    )
    return total - sum(gain for inner, outer, gain in ZONES if inner < r < outer)


def test_losses_are_those_of_the_formula_between_the_ranges_too() -> None:
    made = spreading.losses(200_000.0, transition=4000.0, absorption=0.06, zones=ZONES)
    assert made.loss.shape == (1, 1, made.range.size)
    assert made.range[0] == 1.0
    assert made.range[-1] == 200_000.0
    metres = np.geomspace(1.0, 200_000.0, 50_001)
    edge = (
        np.min([np.abs(metres - limit) for zone in ZONES for limit in zone[:2]], axis=0)
        <= spreading.EDGE / 2
    )
    assert 1 < edge.sum() < 200
    want = np.array([by_hand(r, 4000.0, 0.06) for r in metres])
    error = np.abs(np.interp(metres, made.range, made.loss[0, 0]) - want)
    assert error[~edge].max() < 0.05
    assert error[~edge].max() > 0.02  # no finer than it need be


@pytest.mark.parametrize("coefficient", [10.0, 15.0, 20.0, 40.0])
def test_other_coefficients(coefficient: float) -> None:
    made = spreading.losses(5e5, coefficient=coefficient)
    metres = np.geomspace(1.0, 5e5, 20_001)
    error = np.interp(metres, made.range, made.loss[0, 0]) - coefficient * np.log10(metres)
    assert np.abs(error).max() < 0.05


def test_zones_that_touch_go_straight_from_one_gain_to_the_next() -> None:
    made = spreading.losses(1e5, zones=[(20_000.0, 30_000.0, 5.0), (30_000.0, 40_000.0, 11.0)])
    metres = np.array([29_995.0, 29_997.5, 30_000.0, 30_005.0])
    gain = 20 * np.log10(metres) - np.interp(metres, made.range, made.loss[0, 0])
    np.testing.assert_allclose(gain, [5.0, 6.5, 8.0, 11.0], atol=0.05)


def ainslie_mccolm(f: float, t: float, s: float, z: float, ph: float) -> float:
    """Ainslie and McColm 1998, doi:10.1121/1.421258: [dB/km] of f [kHz], t [degrees Celsius], s, z
    [km].
    """
    f1, f2 = 0.78 * math.sqrt(s / 35) * math.exp(t / 26), 42 * math.exp(t / 17)
    return (
        0.106 * f1 * f**2 / (f**2 + f1**2) * math.exp((ph - 8) / 0.56)
        + 0.52 * (1 + t / 43) * (s / 35) * f2 * f**2 / (f**2 + f2**2) * math.exp(-z / 6)
        + 0.00049 * f**2 * math.exp(-(t / 27 + z / 17))
    )


# over which Ainslie and McColm state that their formula is within 10 % of Francois and Garrison's
RANGES = [
    [(t, 35.0, 0.0, 8.0) for t in (-2.0, 5.0, 15.0, 25.0, 35.0)],
    [(10.0, 35.0, 0.0, ph) for ph in (7.7, 8.0, 8.3)],
    [(10.0, s, 0.0, 8.0) for s in (5.0, 20.0, 35.0, 45.0)],
    [(10.0, 35.0, z, 8.0) for z in (0.0, 2.0, 4.0, 7.0)],
]


@pytest.mark.parametrize("water", [w for row in RANGES for w in row], ids=str)
def test_absorption_is_within_a_tenth_of_the_simplified_formula(
    water: tuple[float, float, float, float],
) -> None:
    t, s, z, ph = water
    for f in np.geomspace(0.1, 1000.0, 41):
        made = spreading.absorption(f * 1000, temperature=t, salinity=s, depth=z * 1000, ph=ph)
        assert made == pytest.approx(ainslie_mccolm(float(f), t, s, z, ph), rel=0.1)


def test_absorption_is_that_of_the_acoustics_toolbox() -> None:
    """9.732982808053584e-5 Np/m at 10 kHz, 10 degrees, 35 psu, pH 8, 1000 m: AttenMod's Franc_Garr,
    which its author checked against Francois and Garrison's table IV; 8685.889638 dB/km is 1 Np/m.
    """
    made = spreading.absorption(10_000.0, temperature=10.0, salinity=35.0, depth=1000.0, ph=8.0)
    assert made == pytest.approx(9.732982808053584e-5 * 8685.8896, rel=1e-7)


def test_absorption_has_no_step_at_20_degrees() -> None:
    """Two polynomials of pure water meet there, to the digits that Francois and Garrison print."""
    below, above = (spreading.absorption(1e6, temperature=t, salinity=0.0) for t in (20.0, 20.0001))
    assert below == pytest.approx(above, rel=1e-2)


BAD = {
    "largest": ({"largest": 10.0}, "largest range 10 m; allowed are 100 to 2e\\+07 m"),
    "coefficient": ({"coefficient": 2.0}, "coefficient 2 dB; allowed are 5 to 60"),
    "transition": ({"transition": 0.0}, "transition 0 m; allowed are 1 to"),
    "absorption": ({"absorption": -0.1}, "absorption -0.1 dB/km; allowed are 0 to 1000"),
    "not a number": ({"absorption": math.nan}, "absorption nan dB/km"),
    "zone reversed": ({"zones": [(6e4, 5e4, 10.0)]}, "convergence zone 60000 to 50000 m; allowed"),
    "zone beyond": ({"zones": [(9e4, 2e5, 10.0)]}, "at most the largest range, 100000 m"),
    "gain": ({"zones": [(5e4, 6e4, -10.0)]}, "has a gain of -10 dB; allowed are gains above 0"),
    "zones overlap": (
        {"zones": [(5e4, 7e4, 9.0), (2e4, 5.5e4, 9.0)]},
        "begins within the one before, which ends at 55000",
    ),
    "gain too high": (
        {"zones": [(20.0, 50.0, 40.0)]},
        "the loss is -12 dB at 25 m; a loss is at least 0",
    ),
}


@pytest.mark.parametrize("kind", BAD)
def test_what_is_no_formula_is_refused(kind: str) -> None:
    keys, said = BAD[kind]
    with pytest.raises(UserError, match=f"^array.loss: .*{said}") as caught:
        spreading.losses(**{"largest": 1e5, "name": "array.loss", **keys})
    assert len(caught.value.lines) == 1


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ({"frequency": 0.0}, "frequency 0 Hz; allowed are 10 to 1e\\+06: set frequency"),
        ({"temperature": 283.0}, "temperature 283 degrees Celsius; allowed are -2 to 35"),
        ({"salinity": 0.35e3}, "salinity 350 g/kg"),
        ({"depth": -10.0}, "depth -10 m"),
        ({"ph": 14.0}, "ph 14; allowed are 7 to 8.6"),
    ],
)
def test_water_that_is_no_sea_is_refused(keys: dict[str, float], said: str) -> None:
    with pytest.raises(UserError, match=said):
        spreading.absorption(**{"frequency": 1000.0, **keys})
