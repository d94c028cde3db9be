"""Every place where a box is given from west to east: which way round, the long way rejected, its
remedies taken.
"""

import re
from collections.abc import Callable

import pytest

from drift.apps.cli import given
from drift.apps.fetch import fetching
from drift.case.schema import DomainTable
from drift.case.values.grid import GridTable

WIDTH: dict[str, Callable[[float, float], float]] = {
    "domain": lambda west, east: _wide(DomainTable(west=west, east=east, south=24, north=31).box()),
    "grid": lambda west, east: (
        GridTable(west=west, east=east, south=24, north=31, spacing="0.5 deg").cells().nlon / 2
    ),
    "--box": lambda west, east: _wide(fetching.parse_box(f"{west},24,{east},31")),
    "--without": lambda west, east: _wide(given.parse_box(f"{west},24,{east},31")),
}


def _wide(box) -> float:
    return box.east - box.west


@pytest.mark.parametrize("place", WIDTH)
def test_boxes_go_eastward_and_not_the_long_way_unsaid(place: str) -> None:
    width = WIDTH[place]
    for west, east, wide in (
        (-98, -80, 18),
        (170, -170, 20),
        (170, 190, 20),
        (190, 200, 10),
        (0, 359, 359),
        (-180, 180, 360),
    ):
        assert width(west, east) == pytest.approx(wide)
    with pytest.raises(
        Exception, match="west 1 to east -84 goes 275 degrees round the Earth, the long way"
    ) as refused:
        width(1, -84)
    short, long = re.findall(r"west (-?\d+) and east (-?\d+)", str(refused.value))
    assert width(*map(float, short)) == pytest.approx(85)
    assert width(*map(float, long)) == pytest.approx(275)
