"""What drift check says of an itinerary, phase by phase."""

from pathlib import Path

import pytest
import trial_case

from drift.apps.check import voyage

TOLD = {
    'position = { at = [-30.2, 45.1], std = "3 nmi" }\ndistress = { rate = "0.02/h" }\n[[scenario.phase]]\n'
    'course = { course = { low = 340, best = 5, high = 20, ratio = 4 }, speed = ["3 kn", "9 kn"], change = "7 h", for = "20 h" }\n'
    '[[scenario.phase]]\nloiter = { polygon = [[-30, 45], [-29, 45], [-29, 46]], speed = "4 kn", leg = "9 nmi", until = "+50 h" }': (
        "course 340 to 020 (best 005) at 3 to 9 kn, changed every 7 h on average, for 20 h; then to and fro in a polygon at 4 kn, "
        "legs of 9 nmi, until 070200ZMAR26; in distress at a rate of 0.02 / h, and then adrift as X"
    ),
    'overdue = "+30 h"\ndistress = { part = { low = 0.2, best = 0.5, high = 0.9, ratio = 3 } }\n[[scenario.phase]]\n'
    'voyage = { waypoints = ["45N 030W", "46N 030W"], departure = ["+1 h", "+3 h"], speed = "5 kn" }': (
        "voyage of 60 nmi by 2 way points, from 050100ZMAR26 to 050300ZMAR26, at 5 kn; in distress after 20 to 90 (best 50) % of its "
        "way, and then adrift as X; from 060600ZMAR26 on, targets that have arrived within 10 nmi of their last way point are in port and no longer searched for"
    ),
    'distress = { between = "+7 h" }\n[[scenario.phase]]\n[scenario.phase.bridge]\nk = "9 nmi/sqrt(h)"\nk_spread = 1.5\n'
    'points = [{ at = [-30, 45], time = "+1 h" }, { at = [-31, 47], time = { at = "+40 h", std = "2 h" } }]': (
        "bridge, K = 9 nmi/sqrt(h), known to a factor of 1.5, from 050100ZMAR26, there 061600ZMAR26 +- 2 h; in distress "
        "050700ZMAR26, and then adrift as X"
    ),
    'vessel = { currents = "felt" }\ndistress = { between = "+7 h" }\n[[scenario.phase]]\n'
    'track = { points = [{ at = [-30, 45], after = "0 h" }, { at = [-31, 47], after = ["20 h", "25 h"] }] }': (
        "track of 2 way points, from 050000ZMAR26, the last after 20 to 25 h; by dead reckoning, set off its way by the current; in distress "
        "050700ZMAR26, and then adrift as X"
    ),
}  # fmt: skip


@pytest.mark.parametrize("written", TOLD)
def test_words_of_an_itinerary(written: str, tmp_path: Path) -> None:
    case = trial_case.load(
        tmp_path,
        written,
        start="2026-03-05T00:00Z",
        duration="60 h",
        scenario={"position": None},
    )
    itinerary = case.scenarios[0].itinerary
    assert itinerary is not None
    assert voyage.itinerary_in_words(itinerary, "X") == TOLD[written]
