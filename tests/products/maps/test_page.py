"""Names that stand beside each other and are too long."""

import itertools

import pytest

from drift.products.maps import page

STORIES = [
    f"transit, {route}, {v}-{v + 1} kn, +{t} h"
    for route, v, t in itertools.product(("north", "south"), (9, 12), (0, 12))
]


def test_names_with_room_stay_as_they_are() -> None:
    assert page.shorten_names(["adrift", *STORIES], 40) == ["adrift", *STORIES]


def test_what_names_share_is_left_out_first() -> None:
    short = page.shorten_names(["adrift since its last report", *STORIES], 26)
    assert short[0] == "adrift since its last …"
    assert short[1:] == [name.replace("transit,", "…") for name in STORIES]
    assert page.shorten_names(STORIES[:4], 20) == [
        name.replace("transit, north,", "…") for name in STORIES[:4]
    ]


@pytest.mark.parametrize("letters", [8, 12, 17, 23, 30])
def test_those_that_differ_still_do(letters: int) -> None:
    names = [*STORIES, "adrift since its last report", "a story of one word only", *STORIES[:2]]
    short = page.shorten_names(names, letters)
    assert max(map(len, short)) <= letters
    assert short[-2:] == short[:2]
    if letters >= 23:  # in fewer there is no room for all that differs
        assert len({*short}) == len({*names})
