"""Boxes between two longitudes: which way round they go, and that what a message names is taken."""

import re

import pytest

from geo.box import Box, box_between


@pytest.mark.parametrize(
    ("west", "east", "found"),
    [
        (4, 7, (4, 7)),
        (-98, -80, (-98, -80)),
        (170, -170, (170, 190)),
        (170, 190, (170, 190)),
        (190, 200, (-170, -160)),
        (350, 10, (-10, 10)),
        (0, 359, (0, 359)),
        (1, 276, (1, 276)),
        (-180, 180, (-180, 180)),
        (0, 360, (0, 360)),
    ],
)
def test_a_box_goes_eastward(west, east, found):
    assert box_between(west, -10, east, 20) == Box(found[0], -10, found[1], 20)


@pytest.mark.parametrize(
    ("west", "east", "width"), [(1, -84, 275), (1, -80, 279), (300, -90, 330), (-80, -100, 340)]
)
def test_the_long_way_is_refused_and_what_the_message_names_is_taken(west, east, width):
    with pytest.raises(
        ValueError, match=f"goes {width} degrees round the Earth, the long way"
    ) as refused:
        box_between(west, 24, east, 31)
    short, long = re.findall(r"west (-?\d+) and east (-?\d+)", str(refused.value))
    box, other = (box_between(float(a), 24, float(b), 31) for a, b in (short, long))
    assert box.east - box.west == 360 - width
    assert other.east - other.west == width
    assert (box.west - east) % 360 == (other.west - west) % 360 == 0
