"""Who is in port would be known: closed forms of arrivals off a port, and draws in float64 of a
voyage beside its way.
"""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trial_case

import drift

N = 40_000
FAR = """
[[sortie]]
name = "elsewhere"
start = "+18 h"
end = "+19 h"
area = { centre = [170, 0], length = "10 nmi", width = "10 nmi" }
pod = 0.5
"""


def case_of(
    folder: Path,
    *more: str,
    n: int = N,
    current: int = 0,
    currents: str = "compensated",
    off: int = 0,
    **yacht: Any,
) -> drift.Case:
    """Return a voyage of 60 nmi home, in a current [kn] abeam; off: [nmi] its way; yacht: keys."""
    voyage = {
        "waypoints": [[179.9, -0.5], [179.9, 0.5]],
        "speed": ["4 kn", "6 kn"],
        "cross_track": f"{off} nmi",
    }
    return trial_case.load(
        folder,
        *more,
        start="2026-03-05T00:00Z",
        duration="24 h",
        particles=n,
        uncertainty="none",
        clock={"step": 3600},
        current={"constant": {"speed": f"{current} kn", "toward": 90}},
        scenario={
            "object": None,
            "position": None,
            "vessel": {"land": "ignore", "currents": currents},
            "phase": [{"voyage": voyage}],
            **yacht,
        },
    )


def ran(folder: Path, *more: str, **given: Any) -> drift.Result:
    return drift.run(case_of(folder, *more, **given))


def close(found: float, share: float) -> None:
    """Hold a log evidence against the log of a share of N particles, within three standard errors."""
    assert found == pytest.approx(math.log(share), abs=3 * math.sqrt((1 - share) / share / N))


def test_whom_the_current_has_set_off_is_not_in_port(tmp_path: Path) -> None:
    """By its dead reckoning it is there after 60 nmi, and the current has set it 60 / v nmi off:
    within 12 nmi if it made 5 knots.

    At 11 h those of 60 / 11 knots and more are known to be in port, at the sortie those of 5 knots
    too, and nobody else ever.
    """
    result = ran(
        tmp_path,
        FAR,
        current=1,
        currents="felt",
        overdue="+11 h",
        arrival_radius="12 nmi",
    )
    first, later, sortie, *rest = result.updates.all
    assert (first.kind, later.kind, sortie.kind) == ("overdue", "overdue", "sortie")
    length = math.radians(1) * 6_371_008.8 / 1852  # [nmi] of the voyage, on the sphere
    fast, near = (6 - length / 11) / 2, (6 - length / 12) / 2
    close(first.log_evidence[-1], 1 - fast)
    assert math.exp(first.log_evidence[-1] + later.log_evidence[-1]) == pytest.approx(
        1 - near, abs=3 * math.sqrt(0.25 / N)
    )
    assert not rest
    # The others go on as what they are: arrived by their dead reckoning, on the map, and with all
    # of the weight.
    assert result.summary["account"]["arrived"] == pytest.approx(1, abs=1e-6)
    snapshot = result.forecast.data.isel(time=-1)
    # those of 4 to 5 knots lie 60 / v off: on average 60 ln(5 / 4)
    lon = float(snapshot["mean_lon"]) % 360
    assert (lon - 179.9) * 60 == pytest.approx(length * math.log(5 / 4), abs=0.05)


@pytest.mark.parametrize(("radius", "nmi"), [({}, 10.0), ({"arrival_radius": "4 nmi"}, 4.0)])
def test_what_kept_off_its_way_is_in_port_within_the_radius(
    tmp_path: Path, radius: dict[str, str], nmi: float
) -> None:
    """Speed and side drawn in NumPy: in port is who has arrived, and is off the last way point by
    no more than the radius.
    """
    result = ran(tmp_path, overdue="+12 h", off=6, **radius)
    (only,) = result.updates.all
    rng = np.random.default_rng(5)
    speed, off = rng.uniform(4, 6, 1_000_000), rng.normal(0, 6, 1_000_000)
    length = math.radians(1) * 6_371_008.8 / 1852
    missing = float(((length / speed > 12) | (np.abs(off) > nmi)).mean())
    close(only.log_evidence[-1], missing)


def test_the_plan_does_not_look_for_what_is_in_port(tmp_path: Path) -> None:
    from drift.pipeline import run_setup
    from drift.planning.search import follow
    from kernels.runtime import runtime

    unit = """
[plan]
begin = "+11 h"
particles = 2000
[[unit]]
name = "helicopter"
kind = "Helicopter"
base = [179.0, 0.0]
search_speed = "90 kn"
endurance = "2 h"
daylight = false
sweep_width = "1 nmi"
"""
    case = case_of(tmp_path, unit, n=2000, overdue="+11 h")
    runtime.start()
    tracks = follow.follow(case, run_setup.open_for(case))
    length = math.radians(1) * 6_371_008.8 / 1852
    # share that can be seen at each edge: those who have not come in
    still = tracks.weight @ tracks.adrift.T
    hours = (tracks.time - tracks.time[0]) / 3600 + 11
    slowest = np.maximum(length / hours, 4)
    expected = (slowest - 4) / (length / 11 - 4)
    # about half of the particles have weight
    assert still == pytest.approx(expected, abs=3 * math.sqrt(0.25 / 1000))


def test_a_radius_without_overdue_is_refused(tmp_path: Path) -> None:
    from geo.errors import UserError

    with pytest.raises(UserError, match="arrival_radius belongs to overdue"):
        case_of(tmp_path, arrival_radius="5 nmi")
