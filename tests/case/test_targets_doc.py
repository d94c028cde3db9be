"""docs/targets.md names every key of itineraries and no other, and its examples are TOML that
loads.
"""

import re
import tomllib
from pathlib import Path

import pytest
from places import ROOT
from pydantic import BaseModel

from drift.case import file as case_file
from drift.case.scenario import family, itinerary, waypoints
from drift.case.tracking import tracker

TEXT = (ROOT / "docs" / "targets.md").read_text(encoding="utf-8")
HEADINGS: dict[str, type[BaseModel]] = {
    "course": itinerary.CourseTable,
    "behaviour": itinerary.ActsTable,
    "[tracker.NAME]": tracker.TrackerTable,
    "track": waypoints.TrackTable,
    "voyage": waypoints.VoyageTable,
    "lanes": waypoints.LanesTable,
    "loiter": itinerary.LoiterTable,
    "bridge": waypoints.BridgeTable,
    "Way points": waypoints.PointTable,
    "Distress": itinerary.DistressTable,
    "vessel": itinerary.VesselTable,
    "[[family]]": family.FamilyTable,
    "[family.axis.NAME]": family.AxisTable,
}


def test_every_kind_of_phase_has_its_section() -> None:
    assert set(itinerary.LAWS) < set(HEADINGS)


@pytest.mark.parametrize("heading", HEADINGS)
def test_sections_name_every_key(heading: str) -> None:
    (section,) = re.findall(
        rf"^##+ `?{re.escape(heading)}`?\n(.*?)(?=^##|\Z)", TEXT, re.MULTILINE | re.DOTALL
    )
    named = re.findall(r"^\| `(\w+)` \|", section, re.MULTILINE)
    assert sorted(named) == sorted(
        field.alias or name for name, field in HEADINGS[heading].model_fields.items()
    )


def test_the_example_of_a_scenario_loads(tmp_path: Path) -> None:
    first = re.findall(r"```toml\n(.*?)```", TEXT, re.DOTALL)[0]
    assert "scenario" in tomllib.loads(first)
    path = tmp_path / "trial.toml"
    flows = '[[current]]\nanalytic = "gulf"\n[[wind]]\nanalytic = "breeze"\n'
    path.write_text(f'title = "trial"\nstart = "141800ZOCT26"\nduration = "84 h"\n{flows}{first}')
    itinerary_of = case_file.load(path).scenarios[0].itinerary
    assert itinerary_of is not None
    assert itinerary_of.distress is not None


def test_the_example_of_a_family_loads(tmp_path: Path) -> None:
    (example,) = [
        text for text in re.findall(r"```toml\n(.*?)```", TEXT, re.DOTALL) if "[[family]]" in text
    ]
    path = tmp_path / "trial.toml"
    head = 'title = "trial"\nstart = "141800ZOCT26"\nduration = "84 h"\ncoast.source = "none"\n'
    path.write_text(head + example)
    case = case_file.load(path)
    assert len(case.scenarios) == 200
    assert case.scenarios[1].name == "transit, north, 6-7 kn, +3 h"
    assert sum(scenario.weight for scenario in case.scenarios[:100]) == pytest.approx(0.75)
