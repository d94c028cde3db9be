"""The box that a case is opened for: what drifts from its priors stays inside, on the sphere, and
it is no larger than need be.
"""

from pathlib import Path

import numpy as np
import pytest
import trial_case
from pyproj import Geod

from drift.engine.environment import domain, environment
from drift.engine.motion.objects import leeway
from drift.pipeline import run_setup
from geo import sphere
from geo.box import Box

EARTH = Geod(a=sphere.RADIUS, b=sphere.RADIUS)


@pytest.mark.parametrize(("lon", "lat"), [(179.2, 63.0), (-12.0, -71.0), (3.0, 2.0)])
@pytest.mark.parametrize("name", ["water", "PERSON-POWERED-VESSEL-2"])
def test_the_reach_holds_what_drifts_as_fast_as_it_is_reckoned_with(
    tmp_path: Path, name: str, lon: float, lat: float
) -> None:
    """Currents of 2.5 m/s and winds of 25 m/s through the largest slope: geodesics of that length,
    all round, end in it.

    A box in longitude and latitude holds a cap; on the parallel nearest to the pole it is as wide
    as there, no wider.
    """
    hours = 30
    case = trial_case.load(
        tmp_path,
        duration=f"{hours} h",
        wind={"constant": {"speed": "9 m/s", "from": 200}},
        scenario={"object": name, "position": {"at": [lon, lat], "std": "3 km"}},
    )
    found = leeway.find_class(name)
    slope = max(abs(line.slope) for line in (found.down, found.right, found.left))
    far = (2.5 + 25 * slope) * hours * 3600
    box = domain.within_reach(run_setup.ensemble_spec(case))
    azimuth = np.linspace(0, 360, 721)
    x, y, _ = EARTH.fwd(np.full(721, lon), np.full(721, lat), azimuth, np.full(721, far))
    assert ((x - box.west) % 360 <= box.east - box.west).all()
    assert (y >= box.south).all()
    assert (y <= box.north).all()
    spread = 5 * 3000.0
    tall = np.degrees(2 * (far + spread) / sphere.RADIUS)
    assert box.north - box.south == pytest.approx(tall, rel=1e-6)
    nearest = abs(lat) + tall / 2
    assert box.east - box.west == pytest.approx(tall / np.cos(np.radians(nearest)), rel=1e-6)


@pytest.mark.parametrize(("hours", "tail"), [(24, 4), (240, 4), (240, "none")])
def test_the_reach_allows_for_errors_with_a_tail(
    tmp_path: Path, hours: int, tail: float | str
) -> None:
    """Four times three standard deviations of a displacement, found by summing the correlation of the
    error over all pairs of minutes; but never less than without a tail. Four times the latter would
    be 4,000 km in ten days.
    """
    std, bias, memory = 0.31, 0.08, 11 * 60.0  # [min]
    case = trial_case.load(
        tmp_path,
        duration=f"{hours} h",
        uncertainty={
            "current": {"std": std, "time": "11 h", "bias": bias, "tail": tail},
        },
        scenario={"position": {"at": [-12.0, 3.0], "std": "3 km"}},
    )
    length = hours * 3600.0
    lag = np.arange(1, 60 * hours)
    pairs = 60 * hours + 2 * ((60 * hours - lag) * np.exp(-lag / memory)).sum()
    spread = 60 * np.sqrt(std**2 * pairs + (bias * 60 * hours) ** 2)
    far = 3 * (std + bias) * length
    if tail != "none":
        far = max(far, 12 * spread)
    box = domain.within_reach(run_setup.ensemble_spec(case))
    tall = (box.north - box.south) / 2 * np.radians(sphere.RADIUS)
    assert tall == pytest.approx(2.5 * length + far + 15_000, rel=1e-5)
    assert (far > 3 * (std + bias) * length) == (tail != "none")


@pytest.mark.parametrize("seed", range(20))
def test_the_part_read_of_a_source_holds_the_box_and_little_more(seed: int) -> None:
    """Lines of the lattice are at most an eighth of the box apart: so much is added on each side at
    most.
    """
    rng = np.random.default_rng(seed)
    width, height = np.exp(rng.uniform(np.log(0.05), np.log([150, 60])))
    west, south = rng.uniform(-180, 180), rng.uniform(-89, 89 - height)
    box = Box(west, south, west + width, south + height)
    part = environment.box_to_read(box)
    for low, high, least, most, size in (
        (part.west, part.east, box.west, box.east, width),
        (part.south, part.north, box.south, box.north, height),
    ):
        assert least - size / 8 <= low <= least
        assert most <= high <= most + size / 8
    assert -180 <= part.west < 180
    assert -90 <= part.south < part.north <= 90
    # A little to the side nearly all need the same part; whoever needs it is served by it.
    assert (
        environment.box_to_read(
            Box(part.west, part.south, part.west + width, part.south + height)
        ).west
        == part.west
    )


def test_a_box_round_the_earth_is_read_whole() -> None:
    assert environment.box_to_read(Box(-180, -60, 180, 60)) == Box(-180, -60, 180, 60)
    assert environment.box_to_read(Box(1.5, -89, 360.7, 89)) == Box(-180, -90, 180, 90)


def test_common_part_of_boxes() -> None:
    assert domain._common(Box(-180, -90, 180, 90), Box(170, -10, 195, 5)) == Box(170, -10, 195, 5)
    assert domain._common(Box(150, -40, 260, 40), Box(-170, -10, -150, 50)) == Box(
        -170, -10, -150, 40
    )
    # two parts
    assert domain._common(Box(-175, -40, 175, 40), Box(170, -10, 195, 5)) == Box(-175, -40, 175, 40)
    assert domain._common(Box(0, 0, 10, 10), Box(-180, -90, 180, 90)) == Box(0, 0, 10, 10)
