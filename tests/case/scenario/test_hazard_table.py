"""The `hazard` of a scenario as written: what is rejected, in one line each, and what is read back."""

import re
from pathlib import Path

import hazards
import numpy as np
import pytest
import trial_case

import drift
from drift.case.scenario.hazard import HazardTable
from drift.pipeline import run_setup
from geo.errors import UserError
from kernels.runtime import runtime

LON, LAT = np.linspace(-89.13, -86.07, 13), np.linspace(26.31, 28.47, 9)
VOYAGE = {
    "waypoints": [[-88.31, 27.13], [-87.42, 27.83]],
    "speed": "9 kn",
    "cross_track": "2 nmi",
}
PAGE = (Path(__file__).parents[3] / "docs" / "targets.md").read_text(encoding="utf-8")


def case_of(folder: Path, hazard: dict, **more) -> drift.Case:
    own = {"position": None, "trackline": VOYAGE, "hazard": hazard, **more.pop("own", {})}
    return trial_case.load(folder, scenario=own, duration="12 h", **more)


def field(value: float | None = None, at: tuple[int, int] = (3, 5)) -> np.ndarray:
    values = np.full((LAT.size, LON.size), 1.7)
    if value is not None:
        values[at] = value
    return values


@pytest.mark.parametrize(
    ("hazard", "words"),
    [
        ({}, "exactly one of wind, file must be given; found none"),
        ({"wind": "9 m/s", "file": "risk.nc"}, "exactly one of wind, file .* found wind and file"),
        ({"wind": "9 m/s", "outside": 1}, "outside belongs to file"),
        ({"file": "risk.nc", "width": "2 m/s"}, "width belongs to wind"),
        ({"file": "risk.nc", "deeper": 0.2}, "deeper belongs to depth"),
        ({"wind": "9 deg"}, "hazard.wind.*9 deg"),
        ({"wind": "9 m/s", "width": "0 m/s"}, "hazard.width.*above 0|hazard.width.*greater than 0"),
        ({"file": "risk.nc", "outside": -0.2}, "hazard.outside.*0"),
        ({"wind": "9 m/s"}, r"hazard is by the wind and there is none: add \[\[wind\]\]"),
        ({"file": "gone.nc"}, "hazard.file.*gone.nc"),
        (
            {"file": "risk.nc", "variable": "hazrd"},
            'no variable "hazrd" .the nearest name is "hazard"',
        ),
        ({"file": "risk.nc", "depth": "10 m", "variable": "hazard"}, 'is in "1"; depths are in m'),
    ],
)
def test_refused(tmp_path: Path, hazard: dict, words: str) -> None:
    hazards.write(tmp_path / "risk.nc", field(), LON, LAT)
    with pytest.raises(UserError, match=words) as caught:
        case_of(tmp_path, hazard)
    assert len(str(caught.value).splitlines()) == 1


def test_it_belongs_to_a_trackline(tmp_path: Path) -> None:
    own = {"trackline": None, "position": trial_case.RAFT["position"]}
    with pytest.raises(UserError, match="hazard belongs to a trackline"):
        case_of(tmp_path, {"wind": "9 m/s"}, own=own)


def test_the_time_of_distress_is_written_in_the_trackline(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="write it within the trackline"):
        case_of(tmp_path, {"wind": "9 m/s"}, own={"distress": {"part": [0, 1]}})


def test_a_target_under_way_has_none(tmp_path: Path) -> None:
    voyage = {"waypoints": ["59N 4E", "59N 5E"], "speed": "6 kn"}
    own = {"trackline": None, "distress": {"part": [0, 1]}, "phase": [{"voyage": voyage}]}
    with pytest.raises(UserError, match="targets under way have none yet"):
        case_of(tmp_path, {"wind": "9 m/s"}, own=own)


@pytest.mark.parametrize(
    ("values", "more", "words"),
    [
        (field(-0.4), {}, r"1 of 117 values of \"hazard\" are no hazard, first -0.4 at latitude 27.12, longitude -87.855"),
        (field(np.nan), {}, "1 of 117 values are missing, first at latitude 27.12, .*set outside"),
        (field(), {"units": "dB"}, 'is in "dB"; give it as a number or a rate'),
    ],
)  # fmt: skip
def test_a_field_is_refused(tmp_path: Path, values: np.ndarray, more: dict, words: str) -> None:
    """With the value, and where it stands."""
    hazards.write(tmp_path / "risk.nc", values, LON, LAT, **more)
    with pytest.raises(UserError, match=words):
        case_of(tmp_path, {"file": "risk.nc"})


def test_depths_say_what_is_up(tmp_path: Path) -> None:
    hazards.write(tmp_path / "bed.nc", field(), LON, LAT, "bed", units="m")
    with pytest.raises(UserError, match="does not say whether it is positive up"):
        case_of(tmp_path, {"file": "bed.nc", "variable": "bed", "depth": "10 m"})


@pytest.mark.parametrize(
    ("values", "lon", "words"),
    [
        (field() * 0, LON, "it is 0 all along the trackline"),
        (field(), LON + 0.9, "risk.nc has no value at 27-13.*, on the trackline; .*hazard.outside"),
    ],
)
def test_a_voyage_is_refused(
    tmp_path: Path, values: np.ndarray, lon: np.ndarray, words: str
) -> None:
    """Where the hazard is 0 along it, and where it leaves the field."""
    runtime.start()
    hazards.write(tmp_path / "risk.nc", values, lon, LAT)
    case = case_of(tmp_path, {"file": "risk.nc"})
    with pytest.raises(UserError, match=f'scenario "raft".hazard: {words}'):
        run_setup.spec_of(case, run_setup.open_for(case))


def test_a_wind_with_members_is_refused(tmp_path: Path) -> None:
    runtime.start()
    winds = [{"constant": {"speed": f"{w} m/s", "from": 213}} for w in (7, 11)]
    case = case_of(tmp_path, {"wind": "9 m/s"}, wind={"members": winds})
    with pytest.raises(UserError, match="the wind has 2 members"):
        run_setup.spec_of(case, run_setup.open_for(case))


@pytest.mark.parametrize(
    ("hazard", "words"),
    [
        ({"wind": "9 m/s"}, "in the wind, half of the greatest hazard at 9 m/s, within about 2.5 m/s"),
        ({"file": "risk.nc", "outside": 0.25}, "in proportion to risk.nc, 0.25 outside of it"),
        ({"file": "bed.nc", "depth": "12 m", "deeper": 0.2}, "in less than 12 m of water by bed.nc .elsewhere 0.2 of that."),
    ],
)  # fmt: skip
def test_check_reads_it_back(tmp_path: Path, hazard: dict, words: str) -> None:
    hazards.write(tmp_path / "risk.nc", field(), LON, LAT)
    hazards.write(tmp_path / "bed.nc", field(), LON, LAT, "depth", units="m")
    wind = {"constant": {"speed": "8 m/s", "from": 213}}
    lines = str(drift.check(case_of(tmp_path, hazard, wind=wind)))
    assert re.search(f"distress likelier {words}", lines)


def test_the_page_names_every_key() -> None:
    (section,) = re.findall(r"^### `hazard`\n(.*?)(?=^##)", PAGE, re.M | re.S)
    named = re.findall(r"^\| `(\w+)` \|", section, re.MULTILINE)
    assert named == [*HazardTable.model_fields]
