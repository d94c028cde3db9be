"""docs/tracking.md names every key of a tracking case and no other, with the defaults that hold."""

import re

import pytest
from places import ROOT
from pydantic import BaseModel

from drift.case.tracking import detections, tracker, tracking

(TEXT,) = re.findall(
    r"^## Every key\n(.*?)(?=^## )",
    (ROOT / "docs" / "tracking.md").read_text(encoding="utf-8"),
    re.MULTILINE | re.DOTALL,
)
HEADINGS: dict[str, type[BaseModel]] = {
    "A tracking case": tracking.TrackingTable,
    "`[target]`": tracking.TargetTable,
    "`[[detection]]`": detections.DetectionTable,
    "`[tracker]`": tracker.TrackerTable,
    "`[[sensor]]`": tracking.SensorTable,
    "`[[method]]`": tracking.MethodTable,
    "`[pursuit]`": tracking.PursuitTable,
    "`[experiment]`": tracking.ExperimentTable,
}


def rows(heading: str) -> dict[str, str]:
    """Return the defaults written, by key."""
    (section,) = re.findall(
        rf"^### {re.escape(heading)}\n(.*?)(?=^###|\Z)", TEXT, re.MULTILINE | re.DOTALL
    )
    return dict(re.findall(r"^\| `(\w+)` \| [^|]+ \| ([^|]*) ?\| ", section, re.MULTILINE))


@pytest.mark.parametrize("heading", HEADINGS)
def test_sections_name_every_key(heading: str) -> None:
    assert sorted(rows(heading)) == sorted(HEADINGS[heading].model_fields)
    assert set(re.findall(r"^### (.*)$", TEXT, re.MULTILINE)) == set(HEADINGS)


SECONDS = {"s": 1, "min": 60, "h": 3600}


@pytest.mark.parametrize("heading", HEADINGS)
def test_defaults_are_those_that_hold(heading: str) -> None:
    """Numbers and words; of what must be given nothing stands there."""
    for key, written in rows(heading).items():
        field = HEADINGS[heading].model_fields[key]
        said = written.strip().strip("`")
        if field.is_required():
            assert said == "", key
        elif isinstance(field.default, bool):
            assert said == str(field.default).lower(), key
        elif isinstance(field.default, int | float):
            value, _, unit = said.partition(" ")
            assert float(value) * SECONDS.get(unit, 1) == field.default, key
        elif isinstance(field.default, str) and field.default:
            assert said == f'"{field.default}"', key
