"""SAR messages: the sections of a situation report in their order, in ASCII lines."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import xarray as xr

from drift.apps.export import messages
from geo.errors import UserError

TIMES = np.array(["2026-03-05T12:00", "2026-03-05T18:00", "2026-03-05T21:00"], "datetime64[ns]")
BOX = [[[[-29.5, 39.9], [-29.6, 40.0], [-29.8, 39.9], [-29.7, 39.8], [-29.5, 39.9]]]]
SEARCH = [
    {"kind": "contact", "name": "flare", "time": "2026-03-05T09:30:00Z", "shape": "point"},
    {"kind": "sortie", "name": "b", "start": "2026-03-05T10:00:00Z", "end": "2026-03-05T11:00:00Z", "pos": 0.25, "shape": "area"},
    {"kind": "sortie", "name": "b", "start": "2026-03-05T10:00:00Z", "end": "2026-03-05T11:00:00Z", "pos": 0.25, "shape": "legs"},
    {"kind": "sortie", "name": "a", "start": "2026-03-05T08:00:00Z", "end": "2026-03-05T09:00:00Z", "pos": None, "shape": "area"},
]  # fmt: skip
PLAN = [
    {"shape": "area", "area": "A-1", "unit": "helo", "pos": 0.36, "takeoff": "2026-03-05T18:00:00Z",
     "on_scene": "2026-03-05T18:26:00Z", "off_scene": "2026-03-05T19:54:00Z"},
]  # fmt: skip


def cells() -> xr.Dataset:
    """Two cells, one afloat and one on the coast 70 km east of it, the same at all times."""
    afloat, ashore = np.array([[0.93, 0.0]]), np.array([[0.0, 0.07]])
    at = {
        "probability": (("time", "lat", "lon"), np.stack([afloat + ashore] * len(TIMES))),
        "probability_ashore": (("time", "lat", "lon"), np.stack([ashore] * len(TIMES))),
        "cell_area": (("lat", "lon"), np.ones((1, 2))),
    }
    return xr.Dataset(at, {"time": TIMES, "lat": [39.9], "lon": [-29.6, -28.8]})


def finished(plan: Any = (), means: int = 3) -> Any:
    """Return a result as exports read it."""
    geometry = {"type": "MultiPolygon", "coordinates": BOX}
    return SimpleNamespace(
        title="Yacht Šárka überfällig",
        words="run 1-s1",
        folder=Path("out"),
        forecast=xr.Dataset(coords={"time": TIMES, "scenario": ["raft", "yacht"]}),
        cells_with_ashore=cells,
        features=lambda name: [{"properties": own, "geometry": geometry} for own in plan],
        search=lambda: [{"properties": own} for own in SEARCH],
        positions=lambda name: [(t, -29.65 + 0.1 * k, 39.95) for k, t in enumerate(TIMES[:means])],
        areas=lambda: [
            (t, share, geometry, {"area_nmi2": 1234.5 * share}) for t in TIMES for share in (0.5, 0.95)
        ],
    )  # fmt: skip


def lines(run: Any, name: str) -> list[str]:
    text = messages.files(run)[name].decode("ascii")
    assert text.upper() == text
    assert all(len(line) <= 69 for line in text.split("\r\n"))
    return text.replace("\r\n   ", " ").split("\r\n")


def test_a_report_has_the_sections_of_the_standard_format() -> None:
    told = lines(finished(), "sitrep.txt")
    assert told[0] == "DATE AND TIME 052100ZMAR26"
    letters = [line[0] for line in told[5:-1]]
    assert "".join(letters) == "ABCDEFGHJKLMN"
    by_letter = {line[0]: line for line in told[5:-1]}
    assert (
        by_letter["A"]
        == "A. IDENTITY OF CASUALTY: YACHT ??RKA ?BERF?LLIG. NAME, CALL SIGN, FLAG ____"
    )
    assert by_letter["B"] == (
        "B. POSITION: MEAN OF THE FORECAST AT 052100ZMAR26 39-57.0N 029-27.0W. "
        "MOST LIKELY AFLOAT 39-54.0N 029-36.0W, 93 % IS AFLOAT. "
        "MOST LIKELY COAST 39-54.0N 028-48.0W, 7.0 % WITHIN 2.5 NMI. 50 % WITHIN 617 NMI2. 95 % WITHIN 1.17E+03 NMI2"
    )
    assert by_letter["G"].startswith("G. DESCRIPTION OF CASUALTY: POSSIBLE: RAFT. POSSIBLE: YACHT.")
    assert by_letter["J"] == (
        "J. INITIAL ACTIONS TAKEN: FLARE 050930ZMAR26, REPORTED. A 050800ZMAR26 TO 050900ZMAR26, NOTHING FOUND. "
        "B 051000ZMAR26 TO 051100ZMAR26, NOTHING FOUND, POS 0.25"
    )
    assert by_letter["K"].startswith("K. SEARCH AREA: NONE PLANNED. 50 % AREA WITHIN ")
    assert by_letter["M"] == "M. FUTURE PLANS: ____"


def test_a_plan_is_reported_at_the_time_before_it() -> None:
    told = lines(finished(PLAN), "sitrep.txt")
    assert told[0] == "DATE AND TIME 051800ZMAR26"
    by_letter = {line[0]: line for line in told[5:-1]}
    assert by_letter["K"] == (
        "K. SEARCH AREA: AREA A-1 39-54.0N 029-30.0W, 40-00.0N 029-36.0W, 39-54.0N 029-48.0W, 39-48.0N 029-42.0W, FOR HELO"
    )
    assert (
        by_letter["M"]
        == "M. FUTURE PLANS: HELO SEARCHES A-1 051826ZMAR26 TO 051954ZMAR26, POS 0.36"
    )


def test_a_warning_for_navtex() -> None:
    told = lines(finished(), "navtex.txt")
    assert told[0] == "ZCZC ____D____"
    assert told[-2:] == ["NNNN", ""]
    assert "ADRIFT NEAR 39-57.0N 029-27.0W AT 052100ZMAR26. 50 % AREA WITHIN" in " ".join(told)


def test_without_a_position_there_is_no_message() -> None:
    with pytest.raises(
        UserError,
        match="nothing is adrift or ashore at 052100ZMAR26; choose an earlier output with ",
    ):
        messages.files(finished(means=2))
