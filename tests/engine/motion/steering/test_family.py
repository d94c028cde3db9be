"""Families: lines and names of their scenarios made one, shares by axis, and how many scenarios
count.
"""

import itertools
import math

import numpy as np
import pytest

from drift.engine.motion.steering import family
from drift.engine.motion.steering.family import Axis, Family, InFamily

AXES = (
    Axis("route", ("north", "south")),
    Axis("speed", ("6 kn", "8 kn", "9 kn", "10 kn", "12 kn")),
)
TRANSIT = Family("transit", AXES, tuple(itertools.product(range(2), range(5))))
LEFT = Family("fewer", AXES, tuple(at for at in TRANSIT.stories if at != (1, 4)))
PLACES = {
    name: InFamily(own, at)
    for own in (TRANSIT, LEFT)
    for name, at in zip(own.names, own.stories, strict=True)
}


def lines(names: list[str], what: str) -> list[str]:
    return [f'scenario "{name}"{what}' for name in names]


def test_lines_of_all_of_some_values_and_of_any() -> None:
    north = [name for name in TRANSIT.names if "north" in name]
    slow = [name for name in TRANSIT.names if "6 kn" in name]
    odd = ["transit, north, 6 kn", "transit, south, 8 kn"]
    told = [
        *lines(TRANSIT.names, ".phase 1: is odd"), "start: is missing", *lines(north, ": has no current"), *lines(slow, ".vessel: x"),
        *lines(odd, ": y"), *lines(["transit, south, 12 kn"], ": z"), *lines(LEFT.names, ".phase 1: is odd"),
        'scenario "adrift": has no current',
    ]  # fmt: skip
    assert family.merge_lines(told, PLACES) == [
        'family "transit".phase 1: is odd',
        "start: is missing",
        'family "transit", route "north": has no current',
        'family "transit", speed "6 kn".vessel: x',
        'family "transit", 2 of its 10 scenarios, such as "transit, north, 6 kn": y',
        'family "transit", route "south", speed "12 kn": z',
        'family "fewer".phase 1: is odd',
        'scenario "adrift": has no current',
    ]


def test_names_that_hold_quotation_marks() -> None:
    name = 'the "Anna", north'
    places = {name: InFamily(Family('the "Anna"', (Axis("route", ("north",)),), ((0,),)), (0,))}
    assert family.merge_lines([f'scenario "{name}".phase 1: no', 'scenario "the": no'], places) == [
        'family "the "Anna"".phase 1: no', 'scenario "the": no'
    ]  # fmt: skip


def test_names_together() -> None:
    some = [name for name in TRANSIT.names if name.split(", ")[2] != "9 kn"]
    assert family.merge_names(TRANSIT.names, PLACES) == ["transit (10)"]
    assert family.merge_names(["adrift", *some], PLACES) == [
        "adrift",
        "transit, 6 kn, 8 kn, 10 kn and 1 more (8)",
    ]
    assert family.merge_names(TRANSIT.names[5:6], PLACES) == ["transit, south, 6 kn"]
    assert family.merge_names([TRANSIT.names[0], TRANSIT.names[6]], PLACES) == ["transit (2)"]


def test_shares_along_axes() -> None:
    """Two families whose axes bear one name are told together; a scenario that is in none has no
    value.
    """
    other = Family("loiter", (Axis("speed", ("2 kn", "8 kn")),), ((0,), (1,)))
    places = [
        InFamily(TRANSIT, (0, 1)),
        InFamily(TRANSIT, (1, 0)),
        InFamily(other, (0,)),
        InFamily(other, (1,)),
        None,
    ]
    route, speed = family.axes_of_scenarios(places)
    assert route.axis == AXES[0]
    assert speed.axis.labels == (*AXES[1].labels, "2 kn")
    probability = np.array([[0.4, 0.3, 0.1, 0.15, 0.05], [0.0, 0.0, 0.0, 1.0, 0.0]])
    np.testing.assert_allclose(route.shares(probability), [[0.4, 0.3], [0, 0]])
    np.testing.assert_allclose(
        speed.shares(probability), [[0.3, 0.55, 0, 0, 0, 0.1], [0, 1, 0, 0, 0, 0]]
    )
    # all go by one route
    assert (
        family.axes_of_scenarios([InFamily(TRANSIT, (0, k)) for k in range(5)])[0].axis.name
        == "speed"
    )


def test_how_many_count() -> None:
    assert family.effective_scenarios(np.full(300, 1 / 300)) == pytest.approx(300)
    assert family.effective_scenarios(np.array([0.0, 1.0])) == 1
    assert family.effective_scenarios(np.array([0.5, 0.25, 0.25])) == pytest.approx(
        math.sqrt(2) * 2
    )
    assert family.effective_scenarios(np.zeros(3)) == 0
