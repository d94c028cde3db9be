"""Contacts as a case gives them: the records made of them, and one line for each error."""

import math
from pathlib import Path

import pytest
from search_tables import BOX, CONTACT, NMI, SEEN, contact, hour, refusal

from drift.evidence.filter import patterns


def test_a_position_with_its_error(tmp_path: Path) -> None:
    """Half of a circular normal lies within sqrt(2 ln 2) standard deviations."""
    seen = contact(tmp_path, SEEN, 'belief = "70 %"\n')
    assert (seen.name, seen.kind, seen.time, seen.belief) == (
        "flare",
        "position",
        hour(9),
        pytest.approx(0.7),
    )
    assert (seen.major, seen.minor) == pytest.approx([NMI / math.sqrt(2 * math.log(2))] * 2)
    assert [(fix.lon, fix.lat, fix.share) for fix in seen.fixes] == [(-88.0, 27.5, 1.0)]
    assert seen.drifter is None


def test_rival_fixes_and_debris(tmp_path: Path) -> None:
    given = 'position = { fixes = [["27 30N 088 00W", 0.7], [[-88.5, 27.2], "30 %"]], std = ["1 nmi", "3 nmi"], orientation = 20 }\n'
    seen = contact(tmp_path, given, 'of = "PIW-2"\nfalse_density = "0.001 /nmi2"\n')
    assert [fix.share for fix in seen.fixes] == pytest.approx([0.7, 0.3])
    assert (seen.major, seen.minor) == pytest.approx((3 * NMI, NMI))
    assert math.degrees(seen.orientation) == pytest.approx(110)
    assert seen.false_density == pytest.approx(0.001 / NMI**2)
    assert seen.belief == 1
    assert seen.drifter is not None
    assert seen.drifter.name == "PIW-2"


def test_bearings_ranges_and_areas(tmp_path: Path) -> None:
    at = 'from = "27 30N 088 00W"'
    seen = contact(
        tmp_path,
        f'bearing = {{ {at}, bearing = 230, std = "5 deg", far = "12 nmi", zones = [[0, "3 nmi", 0.5]] }}\n',
        'false_density = "0.01 /deg"\n',
    )
    assert (seen.kind, seen.sensor, seen.near, seen.far) == (
        "bearing",
        (-88.0, 27.5),
        0,
        pytest.approx(12 * NMI),
    )
    assert (seen.bearing, seen.bearing_std) == pytest.approx((math.radians(230), math.radians(5)))
    assert seen.false_density == pytest.approx(0.01 * 180 / math.pi)
    assert seen.zones is not None
    seen = contact(
        tmp_path,
        f'range = {{ {at}, range = "12 nmi", std = "0.5 nmi" }}\nfalse_density = "0.02 /nmi"\n',
    )
    assert (seen.kind, seen.range, seen.range_std) == (
        "range",
        pytest.approx(12 * NMI),
        pytest.approx(0.5 * NMI),
    )
    assert seen.false_density == pytest.approx(0.02 / NMI)
    seen = contact(tmp_path, BOX)
    assert seen.area == patterns.rectangle((-88.0, 27.5), 20 * NMI, 10 * NMI, math.radians(30))


FROM = '{ from = "27 30N 088 00W", '
CONTACTS = {
    "nothing seen": ("", "exactly one of position, bearing, range, area"),
    "two things seen": (SEEN + BOX, "found position and area"),
    "belief above 1": (SEEN + "belief = 70\n", "belief 70 must be a probability, 0 to 1"),
    "negative belief": (SEEN + "belief = -0.1\n", "must be a probability"),
    "no belief": (SEEN + "belief = 0\n", "has no effect; remove it"),
    "belief and density": (
        SEEN + 'belief = 0.5\nfalse_density = "0.01 /nmi2"\n',
        "give belief or false_density",
    ),
    "density without a unit": (
        SEEN + "false_density = 0.01\n",
        'needs a unit here, like "0.001 /nmi2"',
    ),
    "density in another unit": (SEEN + 'false_density = "0.01 /nmi"\n', "0.01 /nmi"),
    "negative density": (SEEN + 'false_density = "-0.01 /nmi2"\n', "at least 0"),
    "no error": (SEEN.replace(', error = "1 nmi"', ""), "exactly one of std, ellipse, error"),
    "an error of 0": (SEEN.replace('"1 nmi"', "0"), "an error above 0"),
    "no place": ('position = { error = "1 nmi" }\n', "exactly one of at, fixes"),
    "shares of less": (
        'position = { error = "1 nmi", fixes = [[[0, 0], 0.5], [[0, 1], 0.3]] }\n',
        "add up to 0.8; they must add up to 1",
    ),
    "a fix without a share": (
        'position = { error = "1 nmi", fixes = [[0, 0]] }\n',
        "0 is not a position",
    ),
    "a bearing without error": (f"bearing = {FROM}bearing = 230, std = 0 }}\n", "must be above 0"),
    "a bearing of 400": (f'bearing = {FROM}bearing = 400, std = "5 deg" }}\n', "0 to 360 degrees"),
    "a bearing back": (
        f'bearing = {FROM}bearing = 20, std = "5 deg", near = "5 nmi", far = "2 nmi" }}\n',
        "far must be farther than near",
    ),
    "a range of nothing": (f'range = {FROM}range = 0, std = "1 nmi" }}\n', "greater than 0"),
    "a range without error": (f'range = {FROM}range = "5 nmi", std = 0 }}\n', "greater than 0"),
    "of nothing known": (SEEN + 'of = "WINDSRUFER"\n', "no leeway class"),
    "two corners": ("area = { polygon = [[-88, 27], [-87, 27]] }\n", "has 2 corners"),
}


@pytest.mark.parametrize("kind", CONTACTS)
def test_what_is_wrong_with_a_contact(kind: str, tmp_path: Path) -> None:
    given, word = CONTACTS[kind]
    line = refusal(tmp_path, CONTACT, given)
    assert 'contact "flare"' in line
    assert word in line


def test_a_contact_outside_the_run(tmp_path: Path) -> None:
    line = refusal(tmp_path, CONTACT.replace("+9 h", "+30 h"), SEEN)
    assert 'contact "flare": 220600ZNOV26 is outside the run, 210000ZNOV26 to 220000ZNOV26' in line
