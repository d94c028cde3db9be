"""Itineraries that cross land are rejected when a case is opened; those that may are not."""

import json
from pathlib import Path

import pytest
from itinerary_tables import AT, HEAD, OPEN, PHASE, STORY, VOYAGE, bridge, course, lanes, loiter

from drift.case import file as case_file
from drift.case.file import UserError
from drift.engine.motion.steering.itinerary import Ways
from drift.pipeline import run_setup

ISLAND = [[-30.9, 45.5], [-30.6, 45.5], [-30.6, 45.8], [-30.9, 45.8], [-30.9, 45.5]]


def on_an_island(tmp_path: Path, body: str) -> tuple[str, ...]:
    """Return the lines by which a case is refused when it is opened in a sea with one island; none:
    it is not.
    """
    land = {
        "type": "Feature",
        "properties": {},
        "geometry": {"type": "Polygon", "coordinates": [ISLAND]},
    }
    (tmp_path / "island.geojson").write_text(
        json.dumps({"type": "FeatureCollection", "features": [land]})
    )
    (tmp_path / "lanes.toml").write_text(
        "".join(
            f'[[node]]\nname = "{name}"\nat = {at}\n'
            for name, at in {
                "South": [-30.2, 45.1],
                "North": [-31.4, 46.3],
                "East": [-30.1, 46.2],
            }.items()
        )
        + '[[lane]]\nthrough = ["South", "East", "North"]\nwidth = "6 nmi"\n'
        + '[[lane]]\nfrom = "South"\nto = "North"\nwidth = "6 nmi"\n'
    )
    path = tmp_path / "trial.toml"
    path.write_text(HEAD + '[coast]\nsource = "island.geojson"\n' + body)
    case = case_file.load(path)
    try:
        run_setup.open_for(case)
    except UserError as told:
        return told.lines
    return ()


STRAIGHT, ROUND = '["South", "North"]', '["South", "East", "North"]'
OVER = "[[-30.8, 45.2], [-29.3, 45.3], [-29.2, 45.9], [-30.8, 45.9]]"


def test_ways_over_land_are_refused_when_a_case_is_opened(tmp_path: Path) -> None:
    (line,) = on_an_island(tmp_path, STORY + lanes(STRAIGHT, "lanes.toml"))
    assert line.startswith('lane "South - North": its corridor, 6 nmi wide')
    assert "touches land near" in line
    assert on_an_island(tmp_path, STORY + lanes(ROUND, "lanes.toml")) == ()
    lines = on_an_island(tmp_path, STORY + VOYAGE.format('cross_track = "0.5 nmi"') + loiter(OVER))
    assert [line.split(":")[0] for line in lines] == [
        'scenario "one".phase 1.voyage',
        'scenario "one".phase 2.loiter.polygon',
    ]
    assert (
        "leg 1, 4 nmi wide with 4 standard deviations of cross_track to each side, touches land near"
        in lines[0]
    )


def test_the_way_from_one_voyage_to_the_next_is_held_against_land(tmp_path: Path) -> None:
    """Two voyages round an island, the second of which begins beyond it; not so where it begins
    where the first ends.
    """
    first, second = (
        PHASE + f'voyage = {{ waypoints = {points}, speed = "5 kn", cross_track = "0.3 nmi" }}\n'
        for points in ("[[-30.2, 45.1], [-30.3, 45.4]]", "[[-31.3, 46.1], [-31.4, 46.3]]")
    )
    (line,) = on_an_island(tmp_path, STORY + first + second)
    assert line.startswith(
        'scenario "one".phase 1: the track from its end to the start of phase 2, 2.4 nmi wide, touches land'
    )
    assert (
        on_an_island(
            tmp_path,
            STORY + first + second.replace("[-31.3, 46.1]", "[-30.3, 45.4], [-30.2, 46.3]"),
        )
        == ()
    )
    assert on_an_island(tmp_path, STORY + 'vessel = { land = "stop" }\n' + first + second) == ()


def test_a_turn_too_sharp_for_the_error_is_told_by_its_place(tmp_path: Path) -> None:
    sharp = VOYAGE.format('cross_track = "9 nmi"').replace(
        "[-31.4, 46.3]]", "[-30.2, 45.3], [-29.2, 45.3]]"
    )
    (line,) = on_an_island(tmp_path, STORY + sharp)
    assert line.startswith(
        'scenario "one".phase 1.voyage: with 4 standard deviations of cross_track to each side: lane "1 - 2": 12 nmi long'
    )


@pytest.mark.parametrize("land", ["stop", "ignore"])
def test_what_may_meet_land_is_not_refused(land: str, tmp_path: Path) -> None:
    vessel = f'vessel = {{ land = "{land}" }}\n'
    assert (
        on_an_island(tmp_path, STORY + vessel + VOYAGE.format('departure = "+1 h"') + loiter(OVER))
        == ()
    )


def test_bridges_and_courses_are_not_refused(tmp_path: Path) -> None:
    assert on_an_island(tmp_path, STORY + bridge('time = "+2 h"', 'time = "+50 h"')) == ()
    assert on_an_island(tmp_path, STORY + AT + course("320")) == ()


def test_ways_are_held_against_land_beyond_the_domain(tmp_path: Path) -> None:
    # The island lies outside the domain of the case, in which there is no coast.
    small = '[domain]\nwest = "30 30W"\neast = "29W"\nsouth = "44N"\nnorth = "45 25N"\n'
    (line,) = on_an_island(tmp_path, small + STORY + VOYAGE.format('cross_track = "0.5 nmi"'))
    assert "touches land" in line


def test_lanes_bring_their_network_along(tmp_path: Path) -> None:
    path = tmp_path / "trial.toml"
    path.write_text(HEAD + OPEN + STORY + lanes('{ from = "Cape Spartel", to = "Oran" }'))
    (phase,) = case_file.load(path).scenarios[0].itinerary.phases  # type: ignore[union-attr]
    assert isinstance(phase, Ways)
    assert phase.lanes is not None
    assert phase.lanes.network.start.size == len(phase.lanes.route.node) - 1
