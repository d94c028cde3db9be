"""The track of a ship that lost objects, from a file: against great circles in NumPy float64."""

import csv
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import drift
from drift.spills.worlds import release, worlds
from geo import sphere
from geo.box import Box
from geo.coast import edges as shoreline
from geo.coast.shore import Shore
from geo.errors import UserError
from geo.files import fence
from kernels.step import coast as device_coast

CASE = """
start = "{start}Z"
duration = "2 d"
[[current]]
constant = {{ speed = "0.3 m/s", toward = 70 }}
[[wind]]
constant = {{ speed = "9 m/s", from = 200 }}
[spill]
objects = 40
worlds = 60
per_world = 30
{spill}
[[spill.loss]]
begin = ["+2 h", "+5 h"]
length = ["20 min", "3 h"]
[[spill.class]]
name = "raft"
object = "LIFE-RAFT-DB-10"
"""
START = np.datetime64("2026-11-21T06:00:00")
# hours after the start, lon, lat: across 180 degrees, a turn, and two fixes half a second apart
SHIP = [
    (-7.0, 177.9, 55.9),
    (1.25, 179.1, 57.3),
    (3.0, -179.6, 57.9),
    (3.0 + 0.5 / 3600, -179.599_95, 57.900_03),
    (4.4, -179.9, 58.4),
    (8.5, -177.2, 58.1),
    (60.0, -160.0, 50.0),
]
Rows = Sequence[tuple[float, float, float]]


def stamp(hours: float) -> str:
    return f"{START + np.timedelta64(round(3.6e6 * hours), 'ms')}Z"


def table(rows: Rows, head: str = "time,lon,lat") -> str:
    return "\n".join([head, *(f"{stamp(hours)},{lon},{lat}" for hours, lon, lat in rows)]) + "\n"


def gpx(**ships: Rows) -> str:
    tracks = ""
    for name, rows in ships.items():
        points = "".join(
            f'<trkpt lat="{lat}" lon="{lon}"><time>{stamp(hours)}</time></trkpt>'
            for hours, lon, lat in rows
        )
        tracks += f"<trk><name>{name}</name><trkseg>{points}</trkseg></trk>"
    return f'<gpx xmlns="http://www.topografix.com/GPX/1/1">{tracks}</gpx>'


def load(folder: Path, spill: str, start: Any = START) -> drift.Case:
    (folder / "case.toml").write_text(CASE.format(start=start, spill=spill))
    return drift.load(folder / "case.toml")


def unit(lon: Any, lat: Any) -> Any:
    lon, lat = np.radians(lon), np.radians(lat)
    return np.stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)], -1)


def slerp(rows: Rows, hours: Any) -> Any:
    """Return unit vectors of the ship's places: great circles, by the share of the time."""
    times, lon, lat = np.array(rows, float).T
    corner = unit(lon, lat)
    leg = np.clip(np.searchsorted(times, hours, side="right") - 1, 0, times.size - 2)
    share = ((hours - times[leg]) / (times[leg + 1] - times[leg]))[:, None]
    chord = np.linalg.norm(corner[leg + 1] - corner[leg], axis=-1)[:, None]
    angle = np.maximum(2 * np.arcsin(chord / 2), 1e-300)  # 0: it lies still
    a, b = np.sin((1 - share) * angle), np.sin(share * angle)
    return (a * corner[leg] + b * corner[leg + 1]) / np.sin(angle)


def lost(case: drift.Case, box: Box) -> tuple[Any, Any]:
    """Return when objects went overboard [h after the start, by the ship's clock], and where."""
    assert case.spill is not None
    drawn = worlds.draw_worlds(case.spill, 7, lambda lon, lat: np.zeros(np.shape(lon), bool))
    coast = device_coast.upload(shoreline.build_coast(Shore(np.array([], object), "none"), box))
    ensemble = release.draw_release(case.spill, drawn, case.period, case.errors, coast, 3)
    assert drawn.clock is not None
    hours = (ensemble.release.to_numpy() + drawn.clock[ensemble.world.to_numpy()]) / 3600
    return hours, unit(*(sphere.to_degrees(x.to_numpy()) for x in (ensemble.lon, ensemble.lat)))


SEA = Box(176, 54, 186, 60)


@pytest.mark.parametrize("form", ["csv", "gpx"])
def test_objects_go_overboard_where_the_ship_was(form: str, tmp_path: Path) -> None:
    text = table(SHIP) if form == "csv" else gpx(MERIDIAN=SHIP)
    (tmp_path / f"ship.{form}").write_text(text)
    case = load(tmp_path, f'track = "ship.{form}"\nclock_error = "9 min"')
    hours, places = lost(case, SEA)
    # vectors of up to 20 km in float32 (2 mm), clocks of up to 540 s to 6e-5 s at 15 m/s (1 mm), and
    # binary angles of 1 cm, at both ends
    assert (np.linalg.norm(places - slerp(SHIP, hours), axis=1) * sphere.RADIUS).max() < 0.05
    assert str(tmp_path / f"ship.{form}") in case.inputs


def test_a_file_has_the_bits_of_points_in_the_case(tmp_path: Path) -> None:
    """Fixes beyond the losses do not count: neither for the draws nor for the domain."""
    rows = [(hours, lon, lat) for hours, lon, lat in SHIP if hours != 3.0 + 0.5 / 3600]
    (tmp_path / "ship.csv").write_text(table(rows))
    from_file = load(tmp_path, 'track = "ship.csv"')
    points = ",".join(
        f'{{ at = [{lon}, {lat}], time = "{stamp(hours)[:19]}Z" }}'
        for hours, lon, lat in rows[1:-1]
    )
    in_case = load(tmp_path, f"track = [{points}]")
    assert from_file.spill is not None
    assert in_case.spill is not None
    assert from_file.spill.prior == in_case.spill.prior


def test_a_ship_of_several_and_fixes_that_come_twice(tmp_path: Path) -> None:
    """Rows of ships mixed, as AIS comes; a repeated row, and one of the same minute."""
    rows = [f"{name},{stamp(h)},{lon + off},{lat}"
            for h, lon, lat in SHIP for name, off in (("A", 0.0), ("B", 0.8))]  # fmt: skip
    rows.insert(5, rows[3])  # B at 1.25 h again
    rows.insert(5, f"B,{stamp(1.25)},{179.91},57.301")  # 600 m off
    (tmp_path / "ais.csv").write_text("\n".join(["mmsi,time,lon,lat", *rows]))
    prior = load(tmp_path, 'track = "ais.csv"\nship = "B"').spill.prior  # type: ignore[union-attr]
    np.testing.assert_allclose(np.degrees(prior.lon), [179.9, -178.8, -178.79995, -179.1, -176.4])
    (tmp_path / "ais.gpx").write_text(gpx(A=SHIP[:3], B=SHIP))
    prior = load(tmp_path, 'track = "ais.gpx"\nship = "B"').spill.prior  # type: ignore[union-attr]
    assert len(prior.lon) == 5
    for name in ("ais.csv", "ais.gpx"):
        for ship, message in (
            ("", f'"{name}" holds 2 ships ("A", "B"); give ship = "NAME", the one that lost'),
            ('ship = "C"', f'[spill] ship: "C" is not in "{name}"; it holds "A", "B"'),
        ):
            with pytest.raises(UserError) as refused:
                load(tmp_path, f'track = "{name}"\n{ship}')
            assert message in str(refused.value)


def test_a_real_ship(data: Path, tmp_path: Path) -> None:
    """128 of the Suez Canal, off Port Said: fixes to the minute, and two places at one time."""
    file = data / "ships" / "suez_ships.csv"
    start = np.datetime64("2021-03-21T00:30:00")
    with file.open() as opened:
        rows = [
            ((np.datetime64(row["time"][:-1], "s") - start) / np.timedelta64(1, "h"),
             float(row["lon"]), float(row["lat"]))
            for row in csv.DictReader(opened) if row["ship"] == "128"
        ]  # fmt: skip
    kept = [row for k, row in enumerate(rows) if k == 0 or row[0] > rows[k - 1][0]]
    assert len(rows) - len(kept) == 8
    case = load(tmp_path, f'track = "{file}"\nship = "128"\nclock_error = "2 min"', start)
    hours, places = lost(case, Box(31, 30, 34, 33))
    assert (np.linalg.norm(places - slerp(kept, hours), axis=1) * sphere.RADIUS).max() < 0.05


LINES = table(SHIP).splitlines(keepends=True)
BAD = {
    "no time": ("ship.gpx", gpx(A=SHIP).replace("time>", "name>"), "", '"ship.gpx" has no times'),
    "metres": (
        "ship.csv", table([(h, 1e5 * lon, lat) for h, lon, lat in SHIP]), "",
        "fix 1 has lon 1.779e+07, lat 55.9, which is not on Earth in degrees; mend or remove the 7 of",
    ),
    "text": (
        "ship.csv", table(SHIP).replace("57.9\n", "?\n"), "",
        "fix 3 has no proper time, lon or lat; mend or remove the 1 of its 7 fixes",
    ),
    "order": (
        "ship.csv", "".join([*LINES[:3], LINES[5], LINES[3], *LINES[6:]]), "",
        "goes back in time: fix 4 at 210900ZNOV26 follows 211024ZNOV26; put its fixes in the order",
    ),
    "two places": (
        "ship.csv", table([*SHIP[:2], (1.25, 178.1, 57.3), *SHIP[2:]]), "",
        "has two places at 210715ZNOV26, 32.4 nmi apart: 57-18.0N 179-06.0E and 57-18.0N 178-06.0E",
    ),
    "one time": (
        "ship.csv", table([(1.0, 179.0, 57.3), (1.0, 179.0, 57.3)]), "", "fixes at one time only",
    ),
    "gap": (
        "ship.csv", table([*SHIP[:2], (8.5, -177.2, 58.1)]), "",
        "no fix from 210715ZNOV26 to 211430ZNOV26, while objects may go overboard; at most 6 h",
    ),
    "late": (
        "ship.csv", table(SHIP[:5]), "",
        "must cover 210800ZNOV26 to 211400ZNOV26; it covers 202300ZNOV26 to 211024ZNOV26",
    ),
    "fast": (
        "ship.csv", table([*SHIP[:4], (4.4, -172.2, 58.4), *SHIP[5:]]), "",
        "the ship makes 87 m/s between two points, from 210900ZNOV26; at most 50 m/s",
    ),
    "absent": ("ship.csv", table(SHIP), 'track = "other.csv"', '[spill] track: no file "other.csv"'),
    "not a file": ("ship.csv", "", "track = 5", 'must be a file such as "ship.gpx", or points like'),
    "a ship without a file": (
        "ship.csv", "",
        'ship = "A"\ntrack = [{ at = [179, 57], time = "+1 h" }, { at = [179, 58], time = "+9 h" }]',
        "ship is one of the ships in a file",
    ),
}  # fmt: skip


@pytest.mark.parametrize("kind", BAD)
def test_bad_files(kind: str, tmp_path: Path) -> None:
    name, text, spill, message = BAD[kind]
    (tmp_path / name).write_text(text)
    with pytest.raises(UserError) as refused:
        load(tmp_path, spill or f'track = "{name}"')
    assert message in str(refused.value)
    assert len([line for line in refused.value.lines if "track" in line or "ship" in line]) == 1


def test_drift_serve_reads_no_file_outside(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for folder in ("served", "elsewhere"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "ship.csv").write_text(table(SHIP))
    held = fence.Fence((tmp_path / "served",))
    monkeypatch.setenv(fence.NAME, fence.fence_text(held))
    load(tmp_path / "served", 'track = "ship.csv"')
    with pytest.raises(UserError, match="is outside the folders that may be read here"):
        load(tmp_path / "served", 'track = "../elsewhere/ship.csv"')
