"""Routes as a case gives them."""

import re
from typing import Any

import numpy as np
import pytest
from pydantic import TypeAdapter, ValidationError

from drift.case.scenario.route import AsGiven, RouteTable
from drift.case.values import messages
from drift.engine.motion.steering.lanes import Network

# A square with a diagonal: A - B - C - D - A, and the one-way lane A to C, which is shorter than by
# B or D.
SQUARE = Network(
    ("A", "B", "C", "D"), *np.radians([[4.0, 5.1, 5.3, 3.9], [-10.0, -10.2, -8.9, -9.1]]), np.array([0, 1, 2, 3, 0]),
    np.array([1, 2, 3, 0, 2]), np.full(5, 3e3), np.array([False, False, False, False, True]),
)  # fmt: skip


def table(given: Any) -> RouteTable:
    return TypeAdapter(AsGiven).validate_python(given)


@pytest.mark.parametrize(
    ("given", "nodes"),
    [
        (["A", "D", "C"], "ADC"),
        ({"from": "A", "to": "C"}, "AC"),
        ({"from": "C", "to": "A"}, "CDA"),
        ({"from": "A", "via": ["B"], "to": "C"}, "ABC"),
        ({"from": "C", "via": ["B", "A"], "to": "C"}, "CBAC"),
    ],
)
def test_routes(given: Any, nodes: str) -> None:
    """From A to C it is 101 nmi straight, which is one-way; between them 138 nmi by D and 145 by B."""
    assert "".join(table(given).route(SQUARE).node) == nodes


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (["A", "D", "B"], 'route: no lane from "D" to "B"; from "D" lanes lead to "A", "C"; the shortest way to "B" is by'),
        ({"from": "A", "to": "A"}, 'route: it begins and ends at "A"; give two nodes'),
        ({"from": "A", "to": "E"}, 'route: no node "E" in the network; there are "A", "B", "C", "D"'),
    ],
)  # fmt: skip
def test_routes_that_are_not_there(given: Any, message: str) -> None:
    with pytest.raises(ValueError, match=f"^{re.escape(message)}"):
        table(given).route(SQUARE)


@pytest.mark.parametrize(
    "given", [{"from": "A"}, {}, {"nodes": ["A", "B"], "to": "C"}, {"via": ["B"], "to": "C"}]
)
def test_half_a_route(given: dict[str, Any]) -> None:
    with pytest.raises(ValidationError) as error:
        table(given)
    found = ", ".join(sorted(given)) or "nothing"
    assert messages.lines(error.value, {}) == (
        'give a list of nodes, or { from = "A", to = "B" }, and via = ["C"] for a path through others; found '
        + found,
    )
