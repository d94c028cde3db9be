"""The [[drifter]] table: tracks that are read, cut and rejected."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import drift
from geo.errors import UserError

CASE = """
start = "2026-03-05T00:00Z"
duration = "24 h"
coast = { source = "none" }
[[current]]
constant = { speed = "0.4 kn", toward = 61 }
[uncertainty]
current = { std = "0.25 m/s", time = "11 h" }
[[scenario]]
name = "raft"
object = "water"
position = { at = [179.95, 40.0], std = "1 km" }
"""
HOUR = np.timedelta64(1, "h")
BEGIN = np.datetime64("2026-03-05T00:00:00")


def write(folder: Path, rows: list[tuple[Any, float, float]], name: str = "b.csv") -> None:
    lines = [f"{time}Z,{lon},{lat}" for time, lon, lat in rows]
    (folder / name).write_text("\n".join(["time,lon,lat", *lines]) + "\n")


def steady(hours: list[float]) -> list[tuple[Any, float, float]]:
    """Return fixes of a steady drift across the antimeridian."""
    return [
        (BEGIN + np.timedelta64(round(3600 * h), "s"), (0.01 * h + 359.98) % 360 - 180, 40.01 - 0.003 * h)
        for h in hours
    ]  # fmt: skip


def load(folder: Path, more: str, text: str = CASE) -> drift.Case:
    path = folder / "case.toml"
    path.write_text(text + more)
    return drift.load(path)


def rejected(folder: Path, more: str, text: str = CASE) -> str:
    with pytest.raises(UserError) as error:
        load(folder, more, text)
    return "\n".join(error.value.lines)


def test_a_track_is_read_and_cut_to_the_run(tmp_path: Path) -> None:
    """Before the start, after `until` and around a gap of more than 6 hours."""
    write(tmp_path, steady([-2, -1, 0.5, 1, 2, 9, 10, 11, 12]))
    (buoy,) = load(tmp_path, '[[drifter]]\ntrack = "b.csv"\nuntil = "+11 h"\n').drifters
    assert buoy.name == "b"
    assert ((buoy.time - buoy.time[0]) / 3600).tolist() == [0, 0.5, 1.5, 8.5, 9.5, 10.5]
    assert buoy.fresh.tolist() == [True, False, False, True, False, False]
    assert buoy.notes == (
        "3 fixes left out before the start or after until",
        "1 gaps of more than 6 h, or leaps, between fixes",
    )
    assert (buoy.error, buoy.windage) == (20.0, 0.0)


def gpx(tracks: dict[str, list[float]]) -> str:
    """Return a GPX file of tracks by name, with fixes at hours."""
    written = ""
    for name, hours in tracks.items():
        points = "".join(
            f'<trkpt lat="{lat}" lon="{lon}"><time>{time}Z</time></trkpt>'
            for time, lon, lat in steady(hours)
        )
        written += f"<trk><name>{name}</name><trkseg>{points}</trkseg></trk>"
    return (
        f'<gpx xmlns="http://www.topografix.com/GPX/1/1" version="1.1" creator="t">{written}</gpx>'
    )


def test_gpx_and_a_file_of_several(tmp_path: Path) -> None:
    (tmp_path / "b.gpx").write_text(gpx({"B 1": [0, 1, 2]}))
    rows = [f"{name},{time}Z,{lon},{lat}" for name in "AB" for time, lon, lat in steady([0, 3])]
    (tmp_path / "two.csv").write_text("\n".join(["id,time,lon,lat", *rows]))
    case = load(
        tmp_path, '[[drifter]]\ntrack = "b.gpx"\n[[drifter]]\ntrack = "two.csv"\nid = "B"\n'
    )
    assert [(own.name, own.time.size) for own in case.drifters] == [("b", 3), ("B", 2)]
    message = rejected(tmp_path, '[[drifter]]\ntrack = "two.csv"\n')
    assert 'holds 2 buoys ("A", "B"); give id, and a [[drifter]] for each' in message
    message = rejected(tmp_path, '[[drifter]]\ntrack = "two.csv"\nid = "C"\n')
    assert '"C" is not in "two.csv"; it holds "A", "B"' in message


def test_one_track_of_a_gpx_file_is_chosen_by_its_name(tmp_path: Path) -> None:
    (tmp_path / "two.gpx").write_text(gpx({"A": [0, 1, 2], "B": [1, 2, 3, 4]}))
    (buoy,) = load(tmp_path, '[[drifter]]\ntrack = "two.gpx"\nid = "B"\n').drifters
    assert (buoy.name, buoy.time.size) == ("B", 4)
    assert 'holds 2 buoys ("A", "B"); give id' in rejected(
        tmp_path, '[[drifter]]\ntrack = "two.gpx"\n'
    )
    assert '"C" is not in "two.gpx"; it holds "A", "B"' in rejected(
        tmp_path, '[[drifter]]\ntrack = "two.gpx"\nid = "C"\n'
    )


def test_a_buoy_without_its_drogue_has_windage(tmp_path: Path) -> None:
    write(tmp_path, steady([0, 1, 2]))
    windy = (
        CASE.replace('object = "water"', 'object = "PIW-1"')
        .replace(
            "[uncertainty]", '[[wind]]\nconstant = { speed = "10 kn", from = 200 }\n[uncertainty]'
        )
        .replace('time = "11 h" }', 'time = "11 h" }\nwind = { std = "2 m/s" }')
    )
    case = load(tmp_path, '[[drifter]]\ntrack = "b.csv"\nkind = "undrogued svp"\n', windy)
    assert case.drifters[0].windage == 0.01


def test_check_and_a_run_of_many_steps(tmp_path: Path) -> None:
    """Check follows particles with steps of its own, for which nothing is known of the buoys."""
    write(tmp_path, steady([0, 1, 2]))
    case = load(tmp_path, '[[drifter]]\ntrack = "b.csv"\n', "clock.step = 600\n" + CASE)
    assert "3 fixes" in str(drift.check(case)['drifter "b"'])


def test_a_domain_with_a_pole_is_rejected(tmp_path: Path) -> None:
    rows = [(BEGIN + k * HOUR, 20.0 + k, 89.9) for k in range(3)]
    write(tmp_path, rows)
    polar = CASE.replace("at = [179.95, 40.0]", "at = [10.0, 89.9]")
    case = load(tmp_path, '[[drifter]]\ntrack = "b.csv"\n', "particles = 500\n" + polar)
    with pytest.raises(
        UserError, match=r"the domain reaches a pole, where east at a buoy is not east"
    ):
        drift.run(case)


@pytest.mark.parametrize(
    ("rows", "more", "message"),
    [
        ([(BEGIN + 3 * HOUR, -60.0, 40.0), (BEGIN + 4 * HOUR, -60.01, 40.0)], "",
         r'drifter "b": is 9,.* km from the nearest reported position.*at most 250 km'),
        ([(BEGIN + 30 * HOUR, 179.9, 40.0), (BEGIN + 31 * HOUR, 179.9, 40.01)], "",
         r"fewer than two fixes afloat .*they are from 060600ZMAR26 to 060700ZMAR26; change the case's times or until, or check the zone"),
        ([(BEGIN + k * HOUR, 179.9, 40.0) for k in range(20)], "",
         r"20 of its 20 fixes lie aground, for 12 h or more within 200 m; leave the drifter out"),
        (steady([0, 7, 14]), "", r"no two of its 3 fixes are at most 6 h apart"),
        (steady([0, 1, 2]), 'windage = "2 %"\n',
         r'windage is 2.0 %, but scenario "raft" has no wind that its object feels; add one, or give windage = 0'),
        (steady([0, 1, 2]), 'windage = "2 %"\n[[wind]]\nconstant = { speed = "9 kn", from = 200 }\n',
         r'windage is 2.0 %, but scenario "raft" has no wind that its object feels; add one, or give windage = 0'),
        ([(BEGIN, 0.0, 0.0), (BEGIN + HOUR, 0.0, 0.0)], "", r"from the nearest reported position"),
        ([(BEGIN, 179.9, 40.0)], "", r"fewer than two fixes are believable"),
        (steady([0, 1, 2]), "error = 0.5\n", r"error is 0.5 m; at least 1 m"),
        (steady([0, 1, 2]), "windage = 0.6\n", r"windage"),
        (steady([0, 1, 2]), '[[drifter]]\nname = "b"\ntrack = "b.csv"\n',
         r'drifter "b": two drifters have this name'),
        (steady([0, 1, 2]), 'kind = "argos"\n', r"kind"),
    ],
)  # fmt: skip
def test_what_cannot_be_used_is_rejected(
    tmp_path: Path, rows: Any, more: str, message: str
) -> None:
    """In another ocean, with the wrong clock, aground, at (0, 0), alone; without error; twice."""
    import re

    write(tmp_path, rows)
    found = rejected(tmp_path, f'[[drifter]]\ntrack = "b.csv"\n{more}')
    assert re.search(message, found), found


def test_an_empty_file_says_so(tmp_path: Path) -> None:
    (tmp_path / "b.csv").write_text("time,lon,lat\n")
    assert "holds no table" in rejected(tmp_path, '[[drifter]]\ntrack = "b.csv"\n')


def test_no_error_to_correct_and_no_way_back(tmp_path: Path) -> None:
    write(tmp_path, steady([0, 1, 2]))
    none = CASE.replace('current = { std = "0.25 m/s", time = "11 h" }', 'current = "none"')
    assert "give uncertainty.current.std, or leave the drifters out" in rejected(
        tmp_path, '[[drifter]]\ntrack = "b.csv"\n', none
    )
    back = 'direction = "backward"\n' + CASE
    assert "no effect in a backward run" in rejected(
        tmp_path, '[[drifter]]\ntrack = "b.csv"\n', back
    )


def test_a_length_of_its_own_is_the_remedy(tmp_path: Path) -> None:
    """A buoy 320 km off is accepted with a length of 50 km."""
    write(tmp_path, [(BEGIN, 176.2, 40.0), (BEGIN + HOUR, 176.21, 40.0)])
    more = '[[drifter]]\ntrack = "b.csv"\n'
    assert "give uncertainty.current.length" in rejected(tmp_path, more)
    long = CASE.replace('time = "11 h" }', 'time = "11 h", length = "50 km" }')
    case = load(tmp_path, more, long)
    assert case.current_error.length == 50_000
