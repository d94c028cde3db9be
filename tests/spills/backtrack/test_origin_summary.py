"""What is printed and written of an origin says what its grid says."""

import csv
import io

import numpy as np
import pytest
from release_backward import DEGREE, HOUR, T0

from drift.spills.backtrack import backward, text


def test_figures_and_dataset_say_what_the_grid_says(tmp_path) -> None:
    lon, lat = np.linspace(-0.2, 0.2, 41), 50 + np.linspace(-0.3, 0.3, 61)
    time = T0 + HOUR * np.arange(10)
    east = (lon[None] + 0 * lat[:, None]) * DEGREE * np.cos(np.radians(50))
    north = (lat[:, None] - 50 + 0 * lon[None]) * DEGREE
    place = (
        np.exp(-((east / 3000) ** 2 + (north / 3000) ** 2) / 2) * np.cos(np.radians(lat))[:, None]
    )
    chance = np.ones((10, 1, 1)) * place / place.sum() / 10
    release = backward.Origin(
        lon, lat, time.astype("datetime64[s]"), chance, chance, (0.0, 50.0, T0 + 4.5 * HOUR),
        (3000.0, 3000.0, 10_000.0), (1.0, 1.0, 1.0), 10, 5.0,
    )  # fmt: skip
    said = backward.summary_of_origin(release)
    # A circular normal holds 1 - exp(-r^2 / 2 s^2); cells are 0.8 by 1.1 km.
    for share in (50, 90):
        radius = 3 * np.sqrt(-2 * np.log1p(-share / 100))
        assert said[f"radius_{share}_km"] == pytest.approx(radius, abs=0.6)
        assert said[f"area_{share}_km2"] == pytest.approx(np.pi * radius**2, rel=0.08)
    begin = np.datetime64(T0 - HOUR // 2, "s")
    for share in (10, 50, 90):
        assert said[f"time_{share}"] == f"{begin + np.timedelta64(share * HOUR // 10, 's')}Z"
    words = text.origin_facts(said)
    radius = said["radius_50_km"]
    assert words["half within"] == f"{radius / 1.852:.2f} nmi ({radius:.2f} km) of it"
    assert words["mean position"] == "50-00.0N 000-00.0E"
    assert (
        words["standard deviation"] == "1.62 nmi (3.00 km) east, 1.62 nmi (3.00 km) north, 2.78 h"
    )
    assert words["worlds"] == "5 of 10 effective"
    (row,) = csv.DictReader(io.StringIO(text.origin_csv(said, "run-s1")))
    for name, value in said.items():
        assert (
            row[name] == value
            if isinstance(value, str)
            else float(row[name]) == pytest.approx(value, rel=5e-6)
        )
    digits = [
        len(cell.lstrip("-0.").replace(".", "").partition("e")[0])
        for name, cell in row.items()
        if name.endswith(("km", "km2", "_h", "bit"))
    ]
    assert max(digits) <= 6
    data = backward.origin_dataset(release)
    assert float(data["probability"].sum()) == pytest.approx(1)
    assert data["probability"].dims == ("time", "lat", "lon")
    data.to_netcdf(tmp_path / "origin.nc")


def test_finds_that_say_nothing_beyond_the_prior_are_said_to() -> None:
    """The divergence of two normal laws on a fine grid is that of the closed form; below LITTLE
    that is a warning.
    """
    lat = np.linspace(-0.5, 0.5, 2001)
    prior = np.exp(-((lat / 0.1) ** 2) / 2)

    def release(centre: float, width: float) -> backward.Origin:
        chance = np.exp(-(((lat - centre) / width) ** 2) / 2)
        shares = [(law / law.sum()).reshape(1, -1, 1) for law in (prior, chance)]
        time = np.array([T0], "datetime64[s]")
        return backward.Origin(
            np.zeros(1),
            lat,
            time,
            *shares,
            (0.0, 0.0, float(T0)),
            (1.0, 1.0, 1.0),
            (1.0, 1.0, 1.0),
            500,
            400.0,
        )

    for centre, width in ((0.0, 0.1), (0.03, 0.09), (0.1, 0.05)):
        ratio, shift = width / 0.1, centre / 0.1
        exact = ((ratio**2 + shift**2 - 1) / 2 - np.log(ratio)) / np.log(2)
        told = release(centre, width)
        # Cut at five standard deviations: what is beyond holds 6e-7, and says at most 13 nats.
        assert backward.information_gain(told) == pytest.approx(exact, abs=2e-5)
        assert backward.summary_of_origin(told)["information_bit"] == backward.information_gain(
            told
        )
        assert any(
            "almost no information" in words for words in backward.origin_warnings(told)
        ) == (exact < backward.LITTLE)
