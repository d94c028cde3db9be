"""Contacts by sensors of the case as it gives them: the records made of them, their shapes, and a
line for what is wrong.
"""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trial_case
import xarray as xr

from drift.apps.check import check
from drift.case import file as case_file
from drift.evidence.filter import shapes
from drift.evidence.filter.records import Contact, Heard, Tone
from geo.errors import UserError

SONAR = """
[sensor.sonar]
source_level = "140 dB"
noise = "70 dB"
loss = { to = "80 nmi" }
gain = { table = [[0, "4 dB"], [60, "9 dB"], [120, "9 dB"], [180, "5 dB"]], symmetric = true, mirrored = MIRRORED }
"""
ARRAY = '[[sensor]]\nname = "array"\nat = "27 20N 088 00W"\nheading = 30\n' + SONAR.replace(
    "MIRRORED", "true"
)
TOWED = '[[sensor]]\nname = "towed"\n' + SONAR.replace("MIRRORED", "false")
RADAR = '[[sensor]]\nname = "radar"\nat = "27 20N 088 00W"\npod = { file = "pod.nc" }\n'
CONTACT = '[[contact]]\nname = "seen"\ntime = "+9 h"\n'
BEARING = 'bearing = { sensor = "array", bearing = 280, std = "3 deg" }\n'
BY_TOW = 'bearing = { sensor = "towed", from = "27 20N 088 00W", heading = 200, bearing = 280, std = "3 deg" }\n'
FREQUENCY = 'frequency = { value = "50.1 Hz", std = "0.02 Hz", source = "50 Hz" }\n'
LEVEL = 'received_level = { value = "92 dB", std = "2 dB" }\n'


def load(tmp_path: Path, *more: str) -> tuple[Contact, ...]:
    table = xr.DataArray(
        np.full(3, 0.5),
        {"range": ("range", [1e3, 2e4, 4e4], {"units": "m"})},
        ("range",),
        attrs={"units": "1"},
    )
    table.to_dataset(name="pod").to_netcdf(tmp_path / "pod.nc")
    return trial_case.load(tmp_path, ARRAY, TOWED, RADAR, *more, duration="24 h").contacts


def heard(contact: Contact) -> Heard:
    assert contact.heard is not None
    return contact.heard


def test_records(tmp_path: Path) -> None:
    first, second, third = load(
        tmp_path,
        CONTACT + BEARING + LEVEL + FREQUENCY,
        CONTACT.replace("seen", "second").replace("9 h", "10 h")
        + BY_TOW.replace('std = "3 deg"', 'std = [[0, "12 deg"], [90, "2 deg"]]')
        + FREQUENCY.replace(' }', ', source_std = "0.05 Hz", source_group = "shaft", sound_speed = "1480 m/s", speed = "6 kn" }'),
        CONTACT.replace("seen", "third").replace("9 h", "11 h")
        + 'bearing = { sensor = "radar", bearing = 10, wedge = "8 deg", far = "30 nmi" }\n',
    )  # fmt: skip
    assert first.sensor == pytest.approx((-88.0, 27 + 1 / 3))
    assert first.far == pytest.approx(80 * 1852)
    assert (heard(first).mirrored, heard(first).heading, heard(first).level) == (
        True,
        math.radians(30),
        (92.0, 2.0),
    )
    assert heard(first).tone == Tone(50.1, 0.02, 50.0)
    assert heard(first).velocity == (0.0, 0.0)
    assert heard(second).tone == Tone(50.1, 0.02, 50.0, 0.05, 1480.0, "shaft")
    assert not heard(second).mirrored
    knots = 6 * 1852 / 3600
    assert heard(second).velocity == pytest.approx(
        (knots * math.sin(math.radians(200)), knots * math.cos(math.radians(200)))
    )
    np.testing.assert_allclose(np.degrees(second.bearing_stds), [[0, 12], [90, 2], [180, 12]])
    assert (third.wedge, third.bearing_std, third.far) == (math.radians(8), 0.0, 4e4)


@pytest.mark.parametrize(("side", "mirrored"), [("", True), (', side = "port"', False)])
def test_the_image_is_drawn_where_the_bearing_may_be_that(
    tmp_path: Path, side: str, mirrored: bool
) -> None:
    (contact,) = load(tmp_path, CONTACT + BEARING.replace(" }", f"{side} }}"))
    assert heard(contact).mirrored == mirrored
    found = shapes.contact(contact)
    assert [shape for shape, _ in found] == ["point", *("region", "line") * (1 + mirrored)]
    ends = [points[-1] - points[0] for shape, points in found if shape == "line"]
    towards = [np.degrees(np.arctan2(x * np.cos(np.radians(27.6)), y)) % 360 for x, y in ends]
    assert towards == pytest.approx([280.0, 140.0][: 1 + mirrored], abs=1.0)
    case = case_file.load(tmp_path / "case.toml")
    assert ("bearing 280 or 140" in check.check(case)['contact "seen"']) == mirrored


WRONG = {
    "no sensor": (BEARING.replace("array", "aray"), 'no sensor "aray"; did you mean "array"?'),
    "zones": (BEARING.replace(" }", ', zones = [["0 nmi", "9 nmi", 0.9]] }'), "zones and sensor"),
    "from of what stands": (BEARING.replace(" }", ', from = "27 20N 088 00W" }'), "has a fixed position"),
    "heading of what stands": (BEARING.replace(" }", ", heading = 20 }"), "has a fixed position (`at` in its table)"),
    "no place": (BY_TOW.replace('from = "27 20N 088 00W", ', ""), 'where was sensor "towed"?'),
    "no heading": (BY_TOW.replace("heading = 200, ", ""), "give its heading at the time"),
    "no place at all": ('bearing = { bearing = 280, std = "3 deg" }\n', "from is missing"),
    "heading alone": ('bearing = { from = "27 20N 088 00W", heading = 3, bearing = 280, std = "3 deg" }\n', "heading belongs to a sensor"),
    "side alone": ('bearing = { from = "27 20N 088 00W", side = "port", bearing = 280, std = "3 deg" }\n', "side belongs to an array"),
    "std by bearing alone": ('bearing = { from = "27 20N 088 00W", bearing = 280, std = [[0, "3 deg"], [90, "1 deg"]] }\n', "std by relative bearing belongs to an array"),
    "side that it is not on": (BEARING.replace(" }", ', side = "starboard" }'), "its image to starboard is 140.0"),
    "side of what can tell": (BY_TOW.replace(" }", ', side = "port" }'), "distinguishes port from starboard"),
    "no error": (BEARING.replace(', std = "3 deg"', ""), "give std"),
    "two errors": (BEARING.replace(" }", ', wedge = "8 deg" }'), "give std"),
    "an error of 100 degrees": (BEARING.replace("3 deg", "100 deg"), "above 0 and at most 90 deg"),
    "no wedge": (BEARING.replace('std = "3 deg"', 'wedge = "0 deg"'), "wedge 0 deg must be above 0"),
    "errors that end early": (BEARING.replace('"3 deg"', '[[0, "9 deg"], [80, "2 deg"]]'), "0 to 180 deg, or to 90"),
    "errors out of order": (BEARING.replace('"3 deg"', '[[0, "9 deg"], [50, "3 deg"], [40, "2 deg"], [90, "2 deg"]]'), "does not come after"),
    "beyond its reach": (BEARING.replace(" }", ', near = "90 nmi" }'), "beyond its reach of 80.0 nmi"),
    "a beam that is not there": (BEARING.replace(" }", ", beams = [2] }"), "must be numbers from 1 to 1"),
    "level without sensor": ('position = { at = "27 30N 088 00W", std = "5 nmi" }\n' + LEVEL, "a bearing or range needs the sensor"),
    "level of a radar": (BEARING.replace("array", "radar") + LEVEL, "belong to a sonar"),
    "level and false density": (BEARING + LEVEL + 'false_density = "0.01 /deg"\n', "with received_level give belief"),
    "frequency and false density": (BEARING + FREQUENCY + 'false_density = "0.01 /deg"\n', "with frequency give belief"),
    "level in volts": (BEARING + LEVEL.replace("92 dB", "92 V"), "is not a number of decibels"),
    "level of 900": (BEARING + LEVEL.replace("92 dB", "900 dB"), "must be -50 to 250 dB"),
    "level without error": (BEARING + LEVEL.replace("2 dB\" }", "0 dB\" }"), "must be above 0"),
    "frequency far off": (BEARING + FREQUENCY.replace("50.1", "501"), "no target is fast enough"),
    "frequency of zero": (BEARING + FREQUENCY.replace('"50 Hz"', '"0 Hz"'), "must be above 0 Hz"),
    "source all unknown": (BEARING + FREQUENCY.replace(" }", ', source_std = "40 Hz" }'), "source_std 40 Hz"),
    "group of what is known": (BEARING + FREQUENCY.replace(" }", ', source_group = "a" }'), "the source frequency is known"),
    "doubt in a group": (BEARING + "belief = 0.5\n" + FREQUENCY.replace(" }", ', source_std = "0.1 Hz", source_group = "a" }'), "belief and source_group"),
    "speed of what stands": (BEARING + FREQUENCY.replace(" }", ', speed = "3 kn" }'), "leave speed and course out"),
    "sound in air": (BEARING + FREQUENCY.replace(" }", ', sound_speed = "340 m/s" }'), "must be 1000 to 2000 m/s"),
    "at the start": (BEARING.replace('+9 h', '+0 h') + FREQUENCY, "need a velocity, which is unknown at the start of"),
    "of debris": (BEARING + 'of = "PIW-4"\n', "of and sensor"),
}  # fmt: skip


@pytest.mark.parametrize(("lines", "said"), WRONG.values(), ids=WRONG)
def test_what_is_refused(tmp_path: Path, lines: str, said: str) -> None:
    contact = CONTACT.replace("9 h", "0 h") if "at the start" in said else CONTACT
    with pytest.raises(UserError) as caught:
        load(tmp_path, contact + lines)
    assert len(caught.value.lines) == 1, caught.value.lines
    assert said in caught.value.lines[0], caught.value.lines[0]


def test_one_source_is_told_of_once(tmp_path: Path) -> None:
    tone = FREQUENCY.replace(" }", ', source_std = "0.1 Hz", source_group = "a" }')
    with pytest.raises(UserError, match="another source or source_std"):
        load(
            tmp_path,
            CONTACT + BEARING + tone,
            CONTACT.replace("seen", "next") + BEARING + tone.replace("0.1", "0.2"),
        )


SERIES = """
[[contact]]
name = "west"
bearings = { file = "bearings.csv", sensor = "array", std = "3 deg" }
received_level = { std = "2 dB" }
frequency = { std = "0.02 Hz", source = "50 Hz", source_std = "0.1 Hz", source_group = "shaft" }
"""


def test_a_series_is_as_its_contacts(tmp_path: Path) -> None:
    (tmp_path / "bearings.csv").write_text(
        "time, bearing, std, received_level, frequency\n+9 h, 280, , 92 dB, 50.1\n2026-11-21T10:00Z, 281, 4 deg, 91, 50.12 Hz\n"
    )
    written = ""
    for name, time, bearing, std, level, value in (
        ("west 1", "+9 h", 280, 3, 92, 50.1), ("west 2", "+10 h", 281, 4, 91, 50.12),
    ):  # fmt: skip
        written += f"""
[[contact]]
name = "{name}"
time = "{time}"
bearing = {{ sensor = "array", bearing = {bearing}, std = "{std} deg" }}
received_level = {{ value = "{level} dB", std = "2 dB" }}
frequency = {{ value = "{value} Hz", std = "0.02 Hz", source = "50 Hz", source_std = "0.1 Hz", source_group = "shaft" }}
"""
    read, told = load(tmp_path, SERIES), load(tmp_path, written)
    plain = [
        [replace(one, heard=replace(heard(one), sensor=heard(read[0]).sensor)) for one in both]
        for both in (read, told)
    ]
    assert plain[0] == plain[1]


@pytest.mark.parametrize(
    ("lines", "said"),
    [
        ("time, azimuth\n+9 h, 3\n", "no column bearing; allowed are time, bearing, std"),
        ("time, bearing, weather\n+9 h, 3, fair\n", "unknown column weather"),
        ("time, bearing\n", "has 0 bearings"),
        ("time, bearing\n+9 h, 3\n+10 h\n", "line 3: as many values as names"),
        (
            "time, bearing\n+9 h, 3\n+10 h, 400\n",
            'contact "west", line 3 of bearings.csv: bearing.bearing',
        ),
        ("time, bearing\n+9 h, 3\nsoon, 40\n", 'contact "west", line 3 of bearings.csv: time'),
        ("time, bearing\n+9 h, 3\n+99 h, 40\n", "is outside the run"),
        ("time, bearing, frequency\n+9 h, 3, 50\n", "received_level: value is missing"),
    ],
)
def test_a_series_that_is_wrong(tmp_path: Path, lines: str, said: str) -> None:
    (tmp_path / "bearings.csv").write_text(lines)
    with pytest.raises(UserError) as caught:
        load(tmp_path, SERIES)
    assert any(said in line for line in caught.value.lines), caught.value.lines
