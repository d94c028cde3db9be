"""Quantities, positions and times as written; oracles are definitions (BIPM, ICAO) and published
zone tables.
"""

import math
import re
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drift.case.values import units
from geo import notation


@pytest.mark.parametrize(
    ("text", "unit", "expected"),
    [
        ("12 kn", "m/s", 12 * 1852 / 3600),
        ("12kn", "m/s", 12 * 1852 / 3600),
        ("1_000 m", "m", 1000),
        ("0.6 nmi", "m", 0.6 * 1852),
        ("3 h", "s", 10_800),
        ("2 d", "s", 172_800),
        ("15 min", "s", 900),
        ("10 m2/s", "m^2/s", 10),
        ("10 m^2/s", "m^2/s", 10),
        ("10 m**2/s", "m^2/s", 10),
        ("36 km/h", "m/s", 10),
        ("25 cm/s", "m/s", 0.25),
        ("3 %", "", 0.03),
        ("0.04 / h", "1/s", 0.04 / 3600),
        ("0.04 per hour", "1/s", 0.04 / 3600),
        ("120 nmi2", "m^2", 120 * 1852**2),
        ("-2.5e1 cm/s", "m/s", -0.25),
        ("5 m s-1", "m/s", 5),
        (7, "m/s", 7),
        ("7", "m/s", 7),
    ],
)
def test_quantity_is_si(text: object, unit: str, expected: float) -> None:
    assert units.quantity(text, unit, "quantity", "1 x") == pytest.approx(expected, rel=1e-12)


def test_usual_units_are_those_of_pint(monkeypatch: pytest.MonkeyPatch) -> None:
    """To the bit: a run does not depend on which of the two was asked."""
    usual = dict(units.USUAL)
    monkeypatch.setattr(units, "USUAL", {})
    for (name, unit), factor in usual.items():
        assert units.quantity(f"1 {name}", unit, "quantity", "1 x") == factor


@pytest.mark.parametrize(
    ("value", "unit", "words"),
    [
        ("12 parsecs", "s", "another kind"),
        ("5 kg", "m", "another kind"),
        ("5 nm", "m", "write nmi"),
        ("5 NM", "m", "write nmi"),
        ("5 furlonks", "m", 'no unit "furlonks"'),
        ("five h", "s", "write it like"),
        ("", "s", "write it like"),
        (True, "s", "is not a"),
        (None, "s", "is not a"),
        ([1], "s", "is not a"),
        (math.nan, "s", "not finite"),
        (math.inf, "s", "not finite"),
        ("5 __class__", "m/s", "no unit"),
    ],
)
def test_wrong_quantity_is_refused(value: object, unit: str, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        units.quantity(value, unit, "quantity", "1 x")


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("12 nmi/sqrt(h)", 12 * 1852 / 60),
        ("12nmi/sqrt(h)", 12 * 1852 / 60),
        ("12 nmi / sqrt( h )", 12 * 1852 / 60),
        ("12 nmi per sqrt(hour)", 12 * 1852 / 60),
        ("12 nmi/sqrt h", 12 * 1852 / 60),
        ("12 nmi/h^0.5", 12 * 1852 / 60),
        ("12 nmi/h**.5", 12 * 1852 / 60),
        ("12 nmi/h^(1/2)", 12 * 1852 / 60),
        ("12 nmi h^-0.5", 12 * 1852 / 60),
        ("12 nmi h-1/2", 12 * 1852 / 60),
        ("12 nmi/√h", 12 * 1852 / 60),
        ("3.7e2 m/sqrt(s)", 370),
        ("370 m/s^0.5", 370),
        ("2 km/sqrt(d)", 2000 / math.sqrt(86_400)),
        (370, 370),
        ("370", 370),
        (0, 0),
        ("0 nmi/sqrt(h)", 0),
    ],
)
def test_spread_rate_is_metres_over_the_root_of_seconds(text: object, expected: float) -> None:
    assert units.spread_rate(text) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(
    ("value", "words"),
    [
        ("12 nmi/h", "no length over the square root of a time"),
        ("12 kn", "no length over the square root of a time"),
        ("12 m2/s", "no length over the square root of a time"),
        ("12 nmi", "no length over the square root of a time"),
        ("12 nmi/h^0.6", "no length over the square root of a time"),
        ("12 nm/sqrt(h)", 'the unit "nm" can be misread; write nmi'),
        ("12 M/sqrt(h)", "can be misread"),
        ("12 kg/sqrt(h)", "another kind"),
        ("12 nmi/sqrt(nmi)", "another kind"),
        ("12 nmi/sqrt(hrz)", 'no unit "hrz"'),
        ("-12 nmi/sqrt(h)", "must be at least 0"),
        (-1.5, "must be at least 0"),
        ("twelve nmi/sqrt(h)", "write it like"),
        ("", "write it like"),
        (True, "is not a"),
        (None, "is not a"),
        (math.nan, "not finite"),
        ("1e308 Mm/sqrt(s)", "not finite"),
    ],
)
def test_wrong_spread_rate_is_refused(value: object, words: str) -> None:
    with pytest.raises(ValueError, match=re.escape(words)):
        units.spread_rate(value)


@pytest.mark.parametrize(
    "text",
    [
        "27 30.5N 088 15.0W",
        "27-30.5N 088-15.0W",
        "27°30.5'N 88°15'W",
        "27°30.5′N, 88°15′W",
        "27°30'30\"N 88°15'00\"W",
        "27 30 30N 088 15 00W",
        "N27 30.5 W088 15.0",
        "088 15.0W 27 30.5N",
        "27 30.5n 088 15.0w",
        "27.50833333333333N 88.25W",
        "27.50833333333333 N, 88.25 W",
        [-88.25, 27.50833333333333],
        [271.75, 27.50833333333333],
        {"lat": 27.50833333333333, "lon": "088 15W"},
    ],
)
def test_one_position_however_written(text: object) -> None:
    lon, lat = units.position(text)
    assert (lon, lat) == pytest.approx((-88.25, 27 + 30.5 / 60), abs=1e-10)


@pytest.mark.parametrize(
    ("value", "words"),
    [
        ("95 00N 010 00E", "outside -90 to 90"),
        ([10, 95], r"latitude 95 is outside.*order is \[lon, lat\]"),
        ("45 00N 181 00E", "outside -180 to 180"),
        ("27.5 -88.25", "ambiguous"),
        ("27 30 88 15", "ambiguous"),
        ("27 30N 88 15N", "has two latitudes and no longitude"),
        ("27 30E 088 15W", "has two longitudes and no latitude"),
        ("60N", "has a latitude and lacks its longitude, E or W"),
        ("5 20E", "has a longitude and lacks its latitude, N or S"),
        ("", "is empty"),
        (" \t", "is empty"),
        ("harbour", "holds no number"),
        ("60 10N 5 20E, the harbour", '"THE", which is neither a number nor'),
        ("60 10 North 5 20E", '"NORTH", which is neither'),
        ("27 30,5N 088 15,0W", "decimal comma; with a point it is 30.5"),
        ("160 10N 020 20E", "been exchanged"),
        ("20 10E, 88 15N 5 30W", "has 3 letters"),
        ("27 60.0N 088 15W", "below 60"),
        ("27.5 30N 088 15W", "decimals"),
        ("-27 30N 088 15W", "sign"),
        ("N27 30N 088 15W", "has 3 letters of N, S, E and W"),
        ("somewhere", "holds no number"),
        ([1, 2, 3], "lon, lat"),
        (5, "not a position"),
        ({"lon": 1}, "exactly the keys"),
        ([math.nan, 5], "outside"),
        ([True, 5], "not a longitude"),
    ],
)
def test_wrong_or_ambiguous_position_is_refused(value: object, words: str) -> None:
    with pytest.raises(ValueError, match=words) as refusal:
        units.position(value)
    assert ("ambiguous" in str(refusal.value)) == (
        words == "ambiguous"
    )  # that word is for what can be read in two ways


@given(st.floats(-179.9999, 179.9999), st.floats(-89.9999, 89.9999))
def test_position_there_and_back(lon: float, lat: float) -> None:
    def written(angle: float, letters: str) -> str:
        size = abs(angle)
        return f"{int(size)} {60 * (size % 1):.6f}{letters[angle < 0]}".replace(
            " 60.000000", " 59.999999"
        )

    back = units.position(f"{written(lat, 'NS')} {written(lon, 'EW')}")
    assert back == pytest.approx((lon, lat), abs=1e-6 / 60 * 1.01)


def test_antimeridian_is_one_meridian() -> None:
    assert units.position("10 00N 180 00E") == units.position("10 00N 180 00W") == (-180.0, 10.0)


@pytest.mark.parametrize(
    "text",
    [
        "211830ZNOV26",
        "21 1830Z NOV 26",
        "211830znov2026",
        "2026-11-21T18:30Z",
        "2026-11-21 18:30:00+00:00",
        "2026-11-21T20:30+02:00",
        "211330RNOV26",  # R is UTC-5
        "212030BNOV26",  # B is UTC+2
        "220630MNOV26",  # M is UTC+12
        "210630YNOV26",  # Y is UTC-12
        "220430KNOV26",  # K is UTC+10: there is no J
        datetime(2026, 11, 21, 18, 30, tzinfo=UTC),
    ],
)
def test_one_time_however_written(text: object) -> None:
    assert units.time(text) == np.datetime64("2026-11-21T18:30:00")


@pytest.mark.parametrize(
    ("value", "words"),
    [
        ("2026-11-21T18:30", "no zone"),
        (datetime(2026, 11, 21), "no zone"),
        ("211830JNOV26", "zone J"),
        ("211830Z", "lacks"),
        ("311830ZNOV26", "does not exist"),
        ("212530ZNOV26", "does not exist"),
        ("211830ZNUV26", 'no month "NUV"'),
        ("yesterday", "is not a time"),
        (20261121, "is not a time"),
        ("+6 kn", "another kind"),
        ("+200000 d", "century"),
        ("9000-01-01T00:00Z", "1800 to 2200"),
        ("+4", r'"\+4" has no unit; write it like "\+4 min"'),
        ("-0.5", r'"-0.5" has no unit'),
    ],
)
def test_wrong_or_ambiguous_time_is_refused(value: object, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        units.time(value)


def test_interval_is_relative_to_the_start() -> None:
    start = np.datetime64("2026-11-21T18:30:00")
    assert units.resolve(units.time("+6 h"), start) == np.datetime64("2026-11-22T00:30:00")
    assert units.resolve(units.time("-45 min"), start) == np.datetime64("2026-11-21T17:45:00")


@given(st.datetimes(datetime(1801, 1, 1), datetime(2200, 12, 30)), st.integers(-12, 12))
def test_group_there_and_back(moment: datetime, hours: int) -> None:
    moment = moment.replace(second=0, microsecond=0)
    expected = np.datetime64(moment, "s")
    assert units.time(notation.format_dtg(expected)) == expected
    letters = "YXWVUTSRQPONZABCDEFGHIKLM"  # UTC-12 to UTC+12 (ACP 121)
    local = moment + timedelta(hours=hours)
    text = f"{local:%d%H%M}{letters[hours + 12]}{notation.MONTHS[local.month - 1]}{local.year}"
    assert units.time(text) == expected
