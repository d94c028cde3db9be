"""What a case states comes back as written; what is computed says nothing false at 0 and at 1."""

import math
from decimal import Decimal

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from geo import notation
from geo.notation import KNOT, NMI

SHARES = st.floats(0, 1, allow_subnormal=False)  # which a processor may take for 0


@pytest.mark.parametrize(
    ("share", "digits", "text"),
    [
        (0, 1, "0 %"), (1, 1, "100 %"), (1e-300, 1, "< 0.1 %"), (0.00049, 1, "< 0.1 %"), (0.00051, 1, "0.1 %"),
        (0.9994, 1, "99.9 %"), (0.9996, 1, "> 99.9 %"), (1 - 1e-6, 1, "> 99.9 %"), (1 - 2**-53, 1, "100 %"),
        (0.004, 0, "< 1 %"), (0.996, 0, "> 99 %"), (0.5, 0, "50 %"), (math.nan, 1, "unknown"),
    ],
)  # fmt: skip
def test_a_computed_share_in_percent(share, digits, text):
    assert notation.percent(share, digits) == text
    assert notation.percent(share, digits, "") == text.removesuffix(" %").replace(" ", "")


@given(SHARES, st.integers(0, 3))
def test_no_computed_share_is_said_to_be_what_it_is_not(share, digits):
    text = notation.percent(share, digits)
    value, unit = Decimal(text.strip("<> %")), Decimal(10) ** -digits
    if text.startswith("<"):
        assert 0 < 100 * share < value == unit
    elif text.startswith(">"):
        assert value == 100 - unit < 100 * share < 100
    elif text == "0 %":
        assert share == 0
    elif text == "100 %":
        assert share >= 1 - notation.ROUNDING
    else:
        assert abs(Decimal(100 * share) - value) <= unit / 2 * Decimal("1.000001")


@pytest.mark.parametrize(
    ("value", "text"), [(0, "0.00"), (1, "1.00"), (1e-9, "<0.01"), (0.999, ">0.99"), (0.37, "0.37")]
)
def test_a_computed_probability_as_a_decimal(value, text):
    assert notation.probability(value) == text


@given(
    st.decimals("0.001", "9999", places=3, allow_nan=False),
    st.sampled_from([KNOT, NMI, 3600.0, 86_400.0, 0.3048]),
)
def test_a_stated_number_comes_back_as_written(stated, unit):
    """Whatever the unit that it was converted from and back to."""
    assert Decimal(notation.number(float(stated) * unit / unit)) == stated
    assert Decimal(notation.hundredths(float(stated) / 100)) == stated


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.25 / KNOT, "0.486"), (math.exp(0.3), "1.35"), (math.exp(0.7), "2.014"), (-math.pi / 1000, "-0.003142"),
        (10_000 / 7, "1429"), (1_000_000 / 7, "142857"), (99_999.99 + 1e-7, "100000"),
    ],
)  # fmt: skip
def test_a_derived_number_has_four_digits(value, text):
    assert notation.number(value) == text


def test_a_derived_number_has_the_digits_asked_for():
    assert notation.number(100 / 3, 3) == "33.3"


@given(st.integers(0, 35_999))
def test_a_stated_bearing_comes_back_as_written(hundredths):
    angle = math.degrees(math.radians(hundredths / 100))
    assert Decimal(notation.bearing(angle)) == Decimal(hundredths) / 100
    assert len(notation.bearing(angle).partition(".")[0]) == 3


@given(st.integers(-8_999_999, 8_999_999), st.integers(-17_999_999, 17_999_999))
def test_a_stated_position_comes_back_to_a_metre(lat, lon):
    """Of five decimals of degrees, which are four of minutes at most."""
    text = notation.stated_position(lon / 1e5, lat / 1e5)
    for part, units in zip(text.split(), (lat, lon), strict=True):
        degrees, _, minutes = part[:-1].partition("-")
        assert Decimal(degrees) + Decimal(minutes) / 60 == pytest.approx(
            Decimal(abs(units)) / 100_000, abs=Decimal("1e-7")
        )


@pytest.mark.parametrize(
    ("lon", "lat", "text"),
    [
        (4.33, 60.17, "60-10.2N 004-19.8E"),
        (-(10.125 / 60), 60 + 10.255 / 60, "60-10.255N 000-10.125W"),
    ],
)
def test_a_stated_position_has_the_decimals_that_it_needs(lon, lat, text):
    assert notation.stated_position(lon, lat) == text


def test_a_stated_time_keeps_its_seconds():
    assert notation.stated_time(np.datetime64("2026-11-21T18:30:15")) == "2026-11-21T18:30:15Z"
    assert notation.stated_time(np.datetime64("2026-11-21T18:30:00")) == "211830ZNOV26"
