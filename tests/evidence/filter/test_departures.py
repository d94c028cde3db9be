"""A target that departs, or leaves the domain, while an area is watched was not there throughout."""

from pathlib import Path

import numpy as np
import pytest

from drift.case import file as case_file
from drift.engine.motion import simulate
from drift.pipeline import run_setup
from kernels.runtime import runtime

FALSE_ALARMS = 0.01
CASE = """
title = "A yacht past a watched area"
start = "2026-03-05T00:00Z"
end = "+8 h"
particles = 3000
coast = {{ source = "none" }}
clock = {{ step = "{step}" }}
{domain}
[[scenario]]
name = "yacht"
vessel = {{ land = "ignore" }}
[[scenario.phase]]
voyage = {{ waypoints = [[-40.0, 30.0], [-39.0, 30.1]], speed = "3 kn", departure = {departure} }}
[[presence]]
name = "radar"
at = [-40.0, 30.0]
radius = "100 nmi"
start = "+2 h"
end = "{end}"
present = "throughout"
detection = 1.0
false_alarms = {false_alarms}
"""


def likelihood(tmp_path: Path, **texts: str) -> float:
    """Return how likely the report of a presence is."""
    path = tmp_path / "case.toml"
    path.write_text(CASE.format(**{"domain": "", "false_alarms": FALSE_ALARMS, **texts}))
    case = case_file.load(path)
    runtime.start()
    begin = run_setup.prepare(case, run_setup.open_for(case))
    search = run_setup.build_search_filter(case, begin)
    list(simulate.run(begin.ensemble, begin.scene, begin.clock, np.empty(0), search=search))
    begin.scene.forcing.close()
    (update,) = search.updates.all
    return float(np.exp(update.log_evidence[-1]))


@pytest.mark.parametrize("step", ["15 min", "1 h", "3 h"])
@pytest.mark.parametrize(
    ("departure", "end", "there"),
    [
        ("+1 h", "+5 h", 1.0),
        ("+2 h", "+5 h", 1.0),  # as the watch begins
        ("+3 h", "+5 h", 0.0),  # as a step begins
        ("+3.2 h", "+5 h", 0.0),
        ("+2.95 h", "+2.9 h", 0.0),  # in a step in which the watch ended before
        ("+7 h", "+5 h", 0.0),
    ],
)
def test_who_departs_during_the_watch_was_not_there_throughout(
    tmp_path: Path, step: str, departure: str, end: str, there: float
) -> None:
    found = likelihood(tmp_path, step=step, departure=f'"{departure}"', end=end)
    assert found == pytest.approx(FALSE_ALARMS + (1 - FALSE_ALARMS) * there, rel=1e-5)


def test_departures_at_random(tmp_path: Path) -> None:
    found = likelihood(tmp_path, step="1 h", departure='["+1 h", "+4 h"]', end="+5 h")
    share = 1 / 3  # of the departures lies before the watch
    error = np.sqrt(share * (1 - share) / 3000)
    assert found == pytest.approx(FALSE_ALARMS + (1 - FALSE_ALARMS) * share, abs=3 * error)


def test_a_target_outside_of_the_domain_is_not_there(tmp_path: Path) -> None:
    """It leaves 30 minutes before the watch begins, within the radius."""
    domain = "domain = { west = -40.5, south = 29.5, east = -39.9135, north = 30.5 }"
    found = likelihood(tmp_path, step="30 min", departure='"+0 h"', end="+5 h", domain=domain)
    assert found == pytest.approx(FALSE_ALARMS, rel=1e-5)
