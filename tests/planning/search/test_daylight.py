"""Daylight against printed examples, and where the sun does not rise or set."""

import numpy as np
import pytest

from drift.planning.search.boats import daylight
from drift.planning.search.boats.availability import Availability


def seconds(text: str) -> float:
    return float(np.datetime64(text, "s").astype(np.int64))


def test_sun_of_meeus() -> None:
    """Meeus 1998, examples 25.a and 28.b: 13 October 1992, 0h TD: declination -7.78507 degrees,
    equation of time 13 min 42.6 s.
    """
    declination, ahead = daylight.sun(seconds("1992-10-13T00:00:00") - 59)  # TD was 59 s ahead
    assert np.degrees(declination) == pytest.approx(-7.78507, abs=0.01)
    assert ahead == pytest.approx(13 * 60 + 42.6, abs=2)


@pytest.mark.parametrize(
    ("time", "declination"),
    [("2024-03-20T03:06:00", 0.0), ("2024-06-20T20:51:00", 23.436), ("2025-09-22T18:19:00", 0.0)],
)
def test_equinox_and_solstice(time: str, declination: float) -> None:
    """Equinoxes and a solstice at the minute that almanacs print: a degree of declination takes 2.5
    days at an equinox.
    """
    assert np.degrees(daylight.sun(seconds(time))[0]) == pytest.approx(declination, abs=0.01)


def test_extremes_of_the_equation_of_time() -> None:
    """It runs from -14 min 14 s about 11 February to 16 min 26 s about 3 November."""
    days = seconds("2023-01-01T12:00:00") + 86_400.0 * np.arange(365)
    ahead = daylight.sun(days)[1]
    assert np.min(ahead) == pytest.approx(-(14 * 60 + 14), abs=5)
    assert np.max(ahead) == pytest.approx(16 * 60 + 26, abs=5)
    assert int(np.argmin(ahead)) in range(39, 44)
    assert int(np.argmax(ahead)) in range(304, 309)


def test_sunrise_is_the_hour_angle_of_the_printed_declination() -> None:
    """cos H = (sin(-0.833) - sin phi sin d) / (cos phi cos d) with declination and equation of time
    of almanacs.
    """
    lon, lat, declination, ahead = -105.0, 40.0, 23.436, -(1 * 60 + 48)  # 21 June 2010 at Boulder
    h = np.degrees(
        np.arccos(
            (np.sin(np.radians(-0.833)) - np.sin(np.radians(lat)) * np.sin(np.radians(declination)))
            / (np.cos(np.radians(lat)) * np.cos(np.radians(declination)))
        )
    )
    noon = seconds("2010-06-21T12:00:00") + 105 * 240 - ahead
    ((rise, down),) = daylight.windows(noon - 43_200, noon + 43_200, lon, lat)
    assert rise == pytest.approx(noon - h * 240, abs=20)
    assert down == pytest.approx(noon + h * 240, abs=20)


def test_windows_are_cut_and_cross_the_antimeridian() -> None:
    begin = seconds("2024-03-20T00:00:00")
    # noon at 00:07 UTC: the day began before
    found = daylight.windows(begin, begin + 3 * 86_400, 179.9, 0.0)
    assert found[0][0] == begin
    assert len(found) == 4
    assert found[1][0] == pytest.approx(begin + 18 * 3600 + 7.5 * 60 - 3.3 * 60, abs=60)
    other = daylight.windows(begin, begin + 3 * 86_400, -180.1, 0.0)
    np.testing.assert_allclose(found, other, atol=1)


def test_polar_day_and_night() -> None:
    june, december = seconds("2024-06-20T00:00:00"), seconds("2024-12-20T00:00:00")
    assert daylight.windows(june, june + 86_400, 15.0, 78.0) == [(june, june + 86_400)]
    assert daylight.windows(december, december + 86_400, 15.0, 78.0) == []


def test_a_search_begins_as_soon_and_lasts_as_long_as_the_days_allow() -> None:
    """By every second: it waits for the first day that is not over, and ends with that day or after
    its own time.
    """
    days, longest = ((40, 130), (200, 260), (300, 420)), 75
    earliest = np.arange(0, 450, 7)
    begin, lasting = Availability((0.1, 0.9), 0.0, 50.0, days, longest).slot(earliest)
    for wish, start, length in zip(earliest, begin, lasting, strict=True):
        day = next((set(range(*day)) for day in days if day[1] > wish), set())
        open_seconds = [second for second in sorted(day) if second >= wish][:longest]
        assert length == len(open_seconds)
        assert not open_seconds or start == open_seconds[0]
