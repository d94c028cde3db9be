"""Every netCDF file against CF-1.11 and ACDD-1.3 by IOOS' compliance checker: pip install -e
'.[conformance]'.
"""

from pathlib import Path

import pytest

checker = pytest.importorskip("compliance_checker.suite", reason="pip install -e '.[conformance]'")
pytestmark = [
    pytest.mark.conformance,
    pytest.mark.filterwarnings("ignore"),  # the checker's own
]

FILES = ("forecast.nc", "particles.nc", "washup.nc", "origin.nc", "verify.nc")
# What CF recommends and we do otherwise, by the words of the complaint:
KNOWN = (
    # time first: a file is written, read and cut by time
    "not in the recommended order T, Z, Y, X",
    # Tracks that share their times have one time axis, as those of OpenDrift and TrajAn; CF's
    # appendix H.4 repeats it.
    "weight is not a trajectory, it is detected as a mapped-grid",
    # The checker's rule and not CF's (5.6, appendix F): mean positions in a file on a grid are
    # longitudes and latitudes too.
    "grid mapping latitude_longitude requires exactly one variable with standard_name",
)
# ACDD's attributes that only who hands a file on can fill, and those of heights, of which we have
# none
PERSONAL = {
    *(
        "acknowledgment/acknowledgement",
        "comment",
        "institution",
        "license",
        "naming_authority",
        "project",
    ),
    *(f"{who}_{what}" for who in ("creator", "publisher") for what in ("name", "url", "email")),
    *("processing_level", "geospatial_bounds_vertical_crs"),
    *(f"geospatial_vertical_{what}" for what in ("min", "max", "positive")),
}
# the weight of what is recommended; 3: required or highly recommended, 1: suggested
RECOMMENDED = 2
# the checker takes times for a line: here they go by forecast and hour
CRASHES = {"verify.nc": {"check_time_extents"}}


@pytest.fixture(scope="module")
def files(written: Path) -> dict[str, Path]:
    """One file of every kind, by name; those of forecasts are of the plan's."""
    return {
        path.name: path
        for path in sorted(written.glob("*/*.nc"), key=lambda path: path.parent.name == "plan")
    }


def complaints(path: Path, checked: str) -> list[str]:
    """Return what a check says of a file."""
    checker.CheckSuite.load_all_available_checkers()
    suite = checker.CheckSuite()
    found = suite.run_all(suite.load_dataset(str(path)), [checked])
    groups, errors = found[checked] if isinstance(found, dict) else found[0][checked]
    assert not errors.keys() - CRASHES.get(path.name, set()), errors
    failed = [group for group in groups if group.weight >= RECOMMENDED and not full(group.value)]
    return [f"{group.name}: {word}" for group in failed for word in group.msgs or ["failed"]]


def full(value: object) -> bool:
    """Return whether a check gave all its points."""
    return value[0] == value[1] if isinstance(value, tuple) else bool(value)


def test_every_kind_of_file_is_looked_at(files: dict[str, Path]) -> None:
    assert sorted(files) == sorted(FILES)


@pytest.mark.parametrize("name", FILES)
def test_cf(files: dict[str, Path], name: str) -> None:
    told = complaints(files[name], "cf:1.11")
    assert [line for line in told if not any(known in line for known in KNOWN)] == []


@pytest.mark.parametrize("name", FILES)
def test_acdd(files: dict[str, Path], name: str) -> None:
    """All is there but what is a person's to say, and standard names, of which CF has few for
    probabilities.
    """
    for line in complaints(files[name], "acdd:1.3"):
        missing = line.rpartition(": ")[2].removesuffix(" not present").strip()
        uneven = missing == "time_coverage_resolution"  # stated only where times are evenly apart
        assert missing in PERSONAL or missing.endswith("standard_name") or uneven, line
