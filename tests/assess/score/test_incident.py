"""Scores of one find against closed forms: a normal cloud that moves and grows in a steady current."""

import math
from pathlib import Path

import numpy as np
import pytest
import trial_case
from scipy import stats

import drift
from drift.assess.score import calibration, incident
from drift.assess.score.incident import Find
from geo import sphere

pytestmark = pytest.mark.usefixtures("coarse_maps")
STD, DIFFUSIVITY, EAST, NORTH = 2600.0, 160.0, 0.61, -0.34
LON, LAT = -52.3, 44.15
CASE = {
    "duration": "6 h",
    "particles": 20_000,
    "current": {"constant": {"east": EAST, "north": NORTH}},
    "uncertainty": {"diffusivity": f"{DIFFUSIVITY} m2/s"},
    "clock": {"step": "15 min"},
    "scenario": {"position": {"at": [LON, LAT], "std": f"{STD} m"}},
}
SORTIE = {
    "name": "first",
    "start": "+1 h",
    "end": "+2 h",
    "speed": "90 kn",
    "sweep_width": "0.4 nmi",
    "area": {"centre": [LON, LAT], "length": "9 nmi", "width": "7 nmi", "orientation": 20},
}


def std_at(hours: float) -> float:
    return math.sqrt(STD**2 + 2 * DIFFUSIVITY * 3600 * hours)


def find_at(hours: float, east: float, north: float) -> Find:
    """Return a find at a displacement [m] from the middle of the cloud after some hours."""
    middle = np.radians([LON, LAT])
    moved = sphere.destination(*middle, EAST * 3600 * hours, NORTH * 3600 * hours)
    lon, lat = sphere.destination(*moved, east, north)
    time = np.datetime64("2026-11-21T00:00", "s") + np.timedelta64(round(3600 * hours), "s")
    return Find(time, float(np.degrees(lon)), float(np.degrees(lat)))


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> incident.Run:
    folder = tmp_path_factory.mktemp("run")
    drift.run(trial_case.load(folder, output={"every": "2 h"}, **CASE), folder / "raft")
    return incident.open_run(folder / "raft")


@pytest.mark.parametrize("hours", [2.0, 3.1, 4.0, 5.75])
@pytest.mark.parametrize(("east", "north"), [(700.0, -900.0), (-3300.0, 1200.0), (2000.0, 5100.0)])
def test_containment_and_separation(
    run: incident.Run, hours: float, east: float, north: float
) -> None:
    """1 - exp(-r^2 / 2 s^2). Kernels of about 50 of 20,000 particles widen it by a hundredth, and
    the calibration, by particles held out, errs by up to three hundredths.
    """
    found = incident.score_run(run, find_at(hours, east, north), within=600.0)
    away = math.hypot(east, north)
    expected = 1 - math.exp(-(away**2) / (2 * std_at(hours) ** 2))
    assert found.containment == pytest.approx(expected, abs=0.04)
    # the mean of 20,000 particles errs by std / sqrt(20,000), 0.03 km a component
    assert found.from_mean == pytest.approx(away, abs=4 * std_at(6) / math.sqrt(20_000))
    # the mode of a smoothed cloud is within a third of a standard deviation of the middle
    assert abs(found.separation - away) < std_at(hours) / 3
    assert (found.sorties, found.pos) == (0, 0.0)
    assert found.hours == pytest.approx(hours, abs=1e-3)


@pytest.mark.thorough
def test_simulated_truths_are_uniform(run: incident.Run) -> None:
    """300 objects drawn like the particles, at times of their own: Kolmogorov and Smirnov."""
    rng = np.random.default_rng(5)
    shares = []
    for hours in rng.uniform(0.5, 6, 300).round(3):
        east, north = rng.normal(0, std_at(hours), 2)
        shares.append(incident.score_run(run, find_at(hours, east, north), 600.0).containment)
    assert stats.kstest(shares, "uniform").pvalue > 0.01
    # and objects that spread by half as much again are noticed
    far = [1 - (1 - share) ** 2.25 for share in shares]
    assert calibration.kolmogorov(np.array(far))[1] < 1e-6


def test_a_find_outside_the_outputs(run: incident.Run) -> None:
    late = incident.score_run(run, find_at(6.5, 900.0, 0.0), within=2000.0)
    assert late.nearest == np.datetime64("2026-11-21T06:00")
    with pytest.raises(drift.UserError, match="no output is within 20 min of the find at 210630Z"):
        incident.score_run(run, find_at(6.5, 900.0, 0.0), within=1200.0)
    far = incident.score_run(run, find_at(4.0, 300_000.0, 0.0), within=0.0)
    assert far.containment == 1.0


@pytest.mark.thorough
def test_what_a_run_learnt_of_its_find_is_not_used(tmp_path: Path) -> None:
    """The case reports the find as a contact, which pulls the cloud onto it: the map before it is
    scored, as the run without the contact is.
    """
    found = find_at(4.0, 4200.0, -1500.0)
    contact = {
        "name": "Found",
        "time": "+4 h",
        "position": {"at": [found.lon, found.lat], "error": "100 m"},
    }
    folders = []
    for name, more in (("plain", {}), ("told", {"contact": [contact]})):
        case = trial_case.load(
            tmp_path, output={"every": "30 min"}, sortie=[SORTIE], **CASE, **more
        )
        drift.run(case, tmp_path / name)
        folders.append(tmp_path / name)
    plain, told = (incident.open_run(folder) for folder in folders)
    assert plain.find is None
    assert told.find is not None
    assert told.find.lon == pytest.approx(found.lon, abs=1e-5)
    honest = incident.score_run(plain, found, 3600.0)
    careful = incident.score_run(told, told.find, 3600.0)
    # the map half an hour before, moved on, is narrower by 2 D times half an hour
    assert careful.nearest == np.datetime64("2026-11-21T03:30")
    assert careful.containment == pytest.approx(honest.containment, abs=0.04)
    after = told.data["time"].values == np.datetime64("2026-11-21T04:00", "ns")
    assert after.any()
    with pytest.raises(drift.UserError, match="used the find of 210400ZNOV26 as a contact"):
        incident.score_run(told, told.find, 600.0)
    # named otherwise, it is known by its place and time
    assert incident.score_run(told, found, 3600.0).nearest == careful.nearest
    assert (honest.sorties, careful.sorties) == (1, 1)
    assert honest.pos == careful.pos > 0.05
    assert incident.score_run(plain, find_at(1.5, 100.0, 0.0), 3600.0).sorties == 0
