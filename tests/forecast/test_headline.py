"""The sentences on top of the report, of clouds whose densest place is known."""

import re

import numpy as np
import pytest

from drift.engine.particles.snapshot import Snapshot
from drift.engine.particles.status import Status
from drift.forecast.build import build_forecast
from drift.forecast.products.headline import forecast_headline
from geo import sphere
from kernels.runtime import runtime

N = 4001
TIMES = np.array(["2026-11-23T12:00", "2026-11-23T18:00"], "datetime64[s]")


def words(
    lon_deg: float, lat_deg: float, ashore: float = 0.0, opens: np.datetime64 | None = None
) -> str:
    """Return the headline of two clouds: at the second time all but a fifth lie within 1 km of a
    place, at the first 3 deg north of it.
    """
    runtime.start()
    random = np.random.default_rng(11)
    outputs = []
    for time, north in zip(TIMES, (3.0, 0.0), strict=True):
        lon, lat = random.normal(lon_deg, 0.004, N), random.normal(lat_deg + north, 0.004, N)
        lon[: N // 5], lat[: N // 5] = (
            random.normal(lon_deg + 1.5, 0.2, N // 5),
            random.normal(lat_deg, 0.2, N // 5),
        )
        # over a wider stretch; what drifts 1 deg north of it is denser
        stranded = np.arange(N) >= (1 - ashore) * N
        lat[stranded] = lat_deg + 6 * (lat[stranded] - lat_deg - north)
        if ashore:
            lat[N // 5 :][~stranded[N // 5 :]] += 1
        status = np.where(stranded, Status.ASHORE, Status.ADRIFT).astype(np.int32)
        places = (
            np.rint(sphere.wrap_degrees(x) * sphere.TURN / 360).astype(np.int32) for x in (lon, lat)
        )
        outputs.append(Snapshot(time, *places, np.full(N, 1 / N), status, np.zeros(N, np.int32)))
    return forecast_headline(build_forecast(outputs, scenarios=["a"]).data, opens)


@pytest.mark.parametrize(
    ("place", "told"),
    [
        # Hirtshals lies at 57.589 N, 9.967 E.
        ((9.96, 57.95), "near 57-57.0N 009-57.6E, nmi north of Hirtshals"),
        ((-150.4, 0.02), "near 00-01.2N 150-24.0W"),  # no town within 500 km
    ],
    ids=["off Hirtshals", "amid the Pacific"],
)
def test_it_names_the_densest_place_and_not_the_mean(place: tuple[float, float], told: str) -> None:
    found = words(*place)
    assert found.startswith("At 231800ZNOV26 it is most likely near ")
    minutes = [float(part[-5:-1]) for part in told.split(",")[0].split()[1:]]
    said = [
        float(part.rstrip(".,")[-5:-1])
        for part in found.split(" near ")[1].split(",")[0].split(". ")[0].split()[:2]
    ]
    # [minutes] cells are finer than the cloud of 1 km
    assert np.abs(np.subtract(said, minutes)).max() < 0.5
    assert told.partition(", ")[2] in found
    if "Hirtshals" in told:
        assert float(found.split(" nmi north")[0].split()[-1]) == pytest.approx(
            60 * (57.95 - 57.589), abs=1
        )
    assert "holds 50 % of the probability" in found
    assert "ashore" not in found


def test_it_opens_at_the_time_that_is_asked_for() -> None:
    assert words(9.96, 57.95, opens=TIMES[0]).startswith(
        "At 231200ZNOV26 it is most likely near 60-5"
    )


def test_it_tells_what_is_ashore_and_where_if_that_is_most() -> None:
    found = words(9.96, 57.6, ashore=0.6)
    assert " most likely ashore near 57-3" in found
    assert re.search(r"60.0 % is ashore, [\d.]+ % within 2.5 nmi of this place", found)
    # what drifts lies 1 deg north of the town, where nothing strands
    assert re.search(
        r"Afloat it is most likely near 58-3\S+ 009-5\S+, \d+ nmi \S+ of \w+\.$", found
    )
    assert "(near Hirtshals)" in found
    assert re.search(r"An area of \S+ nmi², with about \S+ nmi of coast, holds 50 %", found)


def test_the_coast_stands_beside_the_sea_if_most_is_afloat() -> None:
    """A twentieth is ashore: the cell with most of all is of the coast, but it is not named first."""
    found = words(9.96, 57.6, ashore=0.05)
    assert re.search(r"^At 231800ZNOV26 it is most likely near 58-3", found)
    assert re.search(
        r"5.0 % is ashore, most likely near 57-3\S+ \S+ \(near Hirtshals\): [1-5]\.\d % within 2.5 nmi\.$",
        found,
    )
