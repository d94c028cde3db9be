"""Sweep widths against the published tables, row by row, and their corrections against the printed
factors.
"""

import csv
import itertools
import re
from importlib import resources
from pathlib import Path

import pytest

from drift.evidence.filter.detection import sweep_width
from drift.evidence.filter.detection.sweep_width import FOOT, KINDS, KNOT, NMI, Conditions
from geo.errors import UserError


def rows(name: str) -> list[dict[str, str]]:
    text = resources.files("drift.data").joinpath(name).read_text(encoding="utf-8")
    return list(csv.DictReader(line for line in text.splitlines() if not line.startswith("#")))


def test_the_project_s_tables_are_the_source_s(data: Path) -> None:
    for ours, theirs in (
        ("sweep_width", "sweep_width"),
        ("sweep_width_corrections", "corrections"),
    ):
        with (data / "sweep_width" / f"{theirs}.csv").open(encoding="utf-8", newline="") as file:
            assert rows(f"{ours}.csv") == list(csv.DictReader(file))


def test_every_row_holds_from_its_visibility_up_to_the_next_one() -> None:
    table = rows("sweep_width.csv")
    assert len(table) == 2832
    for row, after in itertools.pairwise([*table, table[0]]):
        same = [row[key] == after[key] for key in ("object", "unit", "height")]
        visibility, expected = float(row["visibility_nmi"]), float(row["sweep_width_nmi"])
        upto = float(after["visibility_nmi"]) if all(same) else 100.0
        height = float(row["height"].removesuffix("ft")) * FOOT
        for seen in (visibility, (visibility + upto) / 2, upto * (1 - 1e-6)):
            found = sweep_width.lookup(row["object"], row["unit"], height, seen * NMI)
            assert found / NMI == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize(
    ("name", "kind", "feet", "visibility", "expected"),
    [
        ("Raft 4 person", "Aircraft", 500, 10, 1.8),  # a row
        ("Raft 4 person", "Aircraft", 500, 14.9, 1.8),
        ("Raft 4 person", "Aircraft", 500, 25, 2.2),
        ("Raft 4 person", "Boat", 8, 5, 2.2),
        ("Raft 4 person", "Boat", 11, 5, 2.6),  # half way between 2.2 at 8 ft and 3.0 at 14 ft
        ("Raft 4 person", "Aircraft", 2250, 5, 1.3),
        ("Raft 4 person", "Helicopter", 625, 5, 1.65),
        ("Raft 4 person", "Aircraft", 200, 5, 1.3),  # below the lowest: as at 300 ft
        ("Raft 4 person", "Boat", 40, 5, 3.0),  # above the highest eye: as at 14 ft
        ("Person in Water", "Helicopter", 1500, 9.9, 0.0),  # not seen at all
        ("Person in Water", "Helicopter", 1500, 10, 0.1),
    ],
)
def test_heights_are_straight_in_between(
    name: str, kind: str, feet: float, visibility: float, expected: float
) -> None:
    found = sweep_width.lookup(name, kind, feet * FOOT, visibility * NMI) / NMI
    assert found == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize(
    ("name", "kind", "knots", "factor"),
    [
        ("Person in Water", "Aircraft", 150, 1.2),
        ("Person in Water", "Aircraft", 165, 1.1),
        ("Person in Water", "Helicopter", 75, 1.25),
        ("Person in Water", "Helicopter", 40, 1.5),  # slower than the slowest: as there
        ("Person in Water", "Helicopter", 160, 0.7),
        ("Power Boat 78ft", "Helicopter", 120, 1.0),  # left out: as at 90 kn
        ("Power Boat 78ft", "Helicopter", 130, 0.95),
        ("Ship 225ft", "Aircraft", 210, 1.0),
        ("Sail Boat 15ft", "Helicopter", 140, 0.9),
        ("Person in Water", "Boat", 5, 1.0),
    ],
)
def test_speeds(name: str, kind: str, knots: float, factor: float) -> None:
    assert sweep_width.speed_factor(name, kind, knots * KNOT) == pytest.approx(factor)


def test_every_printed_factor() -> None:
    for row in rows("sweep_width_corrections.csv"):
        found = sweep_width.speed_factor(row["object"], row["unit"], float(row["speed_kn"]) * KNOT)
        assert found == pytest.approx(float(row["factor"]))


@pytest.mark.parametrize(
    ("wind", "seas", "small", "large"),
    [
        (None, None, 1.0, 1.0),
        (14.9, 1.9, 1.0, 1.0),
        (15, None, 0.5, 0.9),
        (25, 1, 0.5, 0.9),
        (25.1, 1, 0.25, 0.9),
        (5, 2, 0.5, 0.9),
        (20, 4.1, 0.25, 0.9),
    ],
)
def test_weather(wind: float | None, seas: float | None, small: float, large: float) -> None:
    told = (None if wind is None else wind * KNOT, None if seas is None else seas * FOOT)
    assert sweep_width.weather_factor("Raft 4 person", *told) == small
    assert sweep_width.weather_factor("Ship 120ft", *told) == large


def test_corrections_multiply() -> None:
    """1.8 nmi at 500 ft and 10 nmi; 165 kn lies between 1.1 and 1.0; 20 kn of wind halves it;
    fatigue takes a tenth.
    """
    seen = Conditions(10 * NMI, 500 * FOOT, 165 * KNOT, wind=20 * KNOT, seas=1 * FOOT, fatigue=True)
    assert sweep_width.width("Raft 4 person", "Aircraft", seen) / NMI == pytest.approx(
        1.8 * 1.05 * 0.5 * 0.9
    )


def test_names_as_people_write_them() -> None:
    assert len(sweep_width.objects()) == 25
    for written in ("raft 4 person", "Raft 4 Persons", "RAFT-4-PERSON"):
        assert sweep_width.find(written) == "Raft 4 person"
    assert sweep_width.find("power boat <= 15 ft") == "Power Boat ≤ 15ft"
    for name in sweep_width.objects():
        assert sweep_width.find(name) == name
    assert [sweep_width.find_kind(kind.upper()) for kind in KINDS] == list(KINDS)


@pytest.mark.parametrize(
    ("name", "advice"),
    [
        ("Power Boat 6ft", 'nearest is "Power Boat ≤ 15ft"'),
        ("Power Boat 40ft", 'nearest by size are "Power Boat 33ft" or "Power Boat 53ft"'),
        ("40 ft motor boat", 'nearest by size are "Power Boat 33ft" or "Power Boat 53ft"'),
        ("Power Boat 90ft", 'nearest is "Power Boat 78ft"'),
        ("Yacht 12 m", 'nearest by size are "Sail Boat 30ft" or "Sail Boat 40ft"'),  # 39.4 ft
        ("Ship 400ft", 'nearest is "Ship ≥ 300ft"'),
        ("Life raft 5", 'nearest by size are "Raft 4 person" or "Raft 6 person"'),
        ("Life raft", 'give its size: "Raft 1 person", "Raft 4 person",'),
        ("Person in Watr", 'nearest is "Person in Water"'),
        (
            "dinghy",
            'for "dinghy" choose "Power Boat ≤ 15ft", "Power Boat 20ft" or "Sail Boat 15ft"; see: drift objects',
        ),
        ("kayak", 'none of them fits "kayak": give sweep_width itself'),
    ],
)
def test_what_is_advised_goes_by_size(name: str, advice: str) -> None:
    with pytest.raises(UserError, match=re.escape(advice)):
        sweep_width.find(name)
    for quoted in re.findall('"([^"]+)"', advice):
        if quoted not in ("dinghy", "kayak"):
            assert sweep_width.find(quoted) == quoted  # the remedy works


@pytest.mark.parametrize(
    ("name", "kind", "feet", "visibility", "words"),
    [
        ("Raft 4 persn", "Aircraft", 500, 5, ("Raft 4 persn", 'nearest is "Raft 4 person"')),
        ("duck", "Aircraft", 500, 5, ("duck", "Person in Water", "Sail Boat")),
        ("Raft 4 person", "Balloon", 500, 5, ("Balloon", "Aircraft, Helicopter, Boat")),
        ("Raft 4 person", "Aircraft", 500, 0.5, ("0.5 nmi", "begin at 1 nmi")),
        ("Raft 4 person", "Aircraft", 5000, 5, ("altitude 5000 ft", "300 to 3000 ft")),
        ("Raft 4 person", "Boat", 4, 5, ("height of eye 4 ft", "8 to 14 ft")),
    ],
)
def test_what_the_tables_do_not_say(
    name: str, kind: str, feet: float, visibility: float, words: tuple[str, ...]
) -> None:
    with pytest.raises(UserError) as caught:
        sweep_width.lookup(name, kind, feet * FOOT, visibility * NMI)
    assert "\n" not in str(caught.value)
    for word in words:
        assert word in str(caught.value)


def test_an_aircraft_without_a_speed() -> None:
    with pytest.raises(UserError, match="need its speed"):
        sweep_width.width("Raft 4 person", "Aircraft", Conditions(10 * NMI, 500 * FOOT))
