"""What the terminal says of the output that the map and the report show first."""

from typing import Any

from drift.apps.cli import outcome


def test_the_output_that_opens_is_named_unless_it_is_the_last() -> None:
    outputs = [
        {"time": time, "date_time_group": group, "area_nmi2": {"50%": area, "95%": 4.0 * area}}
        for time, group, area in (("a", "231200ZNOV26", 1234.4), ("b", "240030ZNOV26", 2000.0))
    ]
    numbers: dict[str, Any] = {"outputs": outputs, "opens": "a"}
    assert outcome._opening(numbers) == {
        "map.png, report.html": "open at 231200ZNOV26, areas then: 50% 1,234 nmi2, 95% 4,938 nmi2"
    }
    assert outcome._opening(numbers | {"opens": "b"}) == {}


def test_a_small_area_is_not_rounded_to_nothing() -> None:
    areas = outcome._areas({"area_nmi2": {"50%": 0.4567, "95%": 1234.4}})
    assert areas == {"50%": "0.457 nmi2", "95%": "1,234 nmi2"}
