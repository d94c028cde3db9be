"""Units, plans and survival as a case gives them: the records made of them, and one line for each
error.
"""

from pathlib import Path

import numpy as np
import pytest
from search_tables import (
    BOX,
    CONTACT,
    FAST,
    HEAD,
    KNOT,
    NMI,
    SCENARIOS,
    SEEN,
    SORTIE,
    UNIT,
    WHEN,
    WIDTH,
    hour,
    load,
    refusal,
    unit,
)

FULL = WHEN + WIDTH + BOX + FAST  # a sortie in order


def test_a_unit_and_its_defaults(tmp_path: Path) -> None:
    found = unit(tmp_path, WIDTH, 'kind = "helicopter"\n')
    assert (found.name, found.kind, found.group) == ("H60", "Helicopter", "Helicopter visual")
    assert (found.base, found.return_to) == ((-88.0, 28.5), (-88.0, 28.5))
    assert (found.search_speed, found.transit_speed) == pytest.approx((90 * KNOT, 90 * KNOT))
    assert (found.endurance, found.turnaround, found.ready, found.daylight) == (
        10_800,
        7200,
        hour(0),
        True,
    )
    more = 'sensor = "sonar"\ntransit_speed = "140 kn"\nready = "+3 h"\nturnaround = 0\nlaw = "random"\n'
    found = unit(tmp_path, WIDTH, more)
    assert (found.group, found.daylight, found.ready, found.turnaround) == (
        "sonar",
        False,
        hour(3),
        0,
    )
    assert found.transit_speed == pytest.approx(140 * KNOT)


def test_a_plan_begins_after_what_is_known(tmp_path: Path) -> None:
    loaded = load(tmp_path, SORTIE, FULL, CONTACT, SEEN, UNIT, WIDTH)
    assert (loaded.plan.begin, loaded.plan.until) == (hour(9), hour(24))
    assert loaded.units[0].ready == hour(9)
    given = '[plan]\nbegin = "+10 h"\nuntil = "+20 h"\nseparation = "2 nmi"\nrounds = 2\nparticles = 20_000\n'
    loaded = load(tmp_path, SORTIE, FULL, UNIT, WIDTH, given)
    assert (loaded.plan.begin, loaded.plan.until, loaded.plan.rounds) == (hour(10), hour(20), 2)
    assert loaded.plan.separation == pytest.approx(2 * NMI)


def test_survival_and_resampling(tmp_path: Path) -> None:
    """Half are alive at the median, and one standard deviation of a normal later 15.9 % of them."""
    told = SCENARIOS.replace(
        'search_object = "raft', 'survival = { median = "18 h", spread = 2 }\nsearch_object = "raft'
    )
    more = '[plan]\nobjective = "alive"\n[resampling]\nmethod = "kahn"\nbelow = "10 %"\n'
    loaded = load(tmp_path, more, scenarios=told)
    alive = loaded.scenarios[0].survival
    assert alive is not None
    assert alive.alive(np.array([0.0, 18.0, 36.0]) * 3600) == pytest.approx(
        [1, 0.5, 0.158655], abs=1e-6
    )
    assert loaded.scenarios[1].survival is None
    assert [scenario.search_object for scenario in loaded.scenarios] == [
        "Raft 4 person",
        "Person in Water",
    ]
    assert (loaded.resampling.method, loaded.resampling.below) == ("kahn", 0.1)


UNITS = {
    "negative endurance": (
        UNIT.replace('"3 h"', '"-3 h"') + WIDTH,
        "endurance '-3 h' must be above 0",
    ),
    "no endurance": (UNIT.replace('endurance = "3 h"\n', "") + WIDTH, "endurance: is missing"),
    "standing still": (UNIT.replace('"90 kn"', "0") + WIDTH, "must be above 0"),
    "no sweep width": (UNIT, "sweep_width is missing"),
    "no base": (UNIT.replace('base = "28 30N 088 00W"\n', "") + WIDTH, "base: is missing"),
    "ready too late": (
        UNIT + WIDTH + 'ready = "+24 h"\n',
        "not before the plan's end, 220000ZNOV26",
    ),
    "unknown kind": (UNIT + WIDTH + 'kind = "Helo"\n', 'no kind of unit "Helo"'),
    "unknown law": (UNIT + WIDTH + 'law = "cube"\n', "no detection function"),
    "no turnaround": (UNIT + WIDTH + 'turnaround = "-1 h"\n', "0 to 30 days"),
    "a plan that ends first": (
        UNIT + WIDTH + '[plan]\nbegin = "+5 h"\nuntil = "+4 h"\n',
        "not before its end, 210400ZNOV26",
    ),
    "a plan outside the run": (
        UNIT + WIDTH + '[plan]\nuntil = "+40 h"\n',
        "plan.until: 221600ZNOV26 is outside the run",
    ),
    "nobody to find alive": (
        UNIT + WIDTH + '[plan]\nobjective = "alive"\n',
        '"alive" needs survival',
    ),
    "another objective": (UNIT + WIDTH + '[plan]\nobjective = "cost"\n', "'cost' is not allowed"),
    "no rounds": (UNIT + WIDTH + "[plan]\nrounds = 0\n", "plan.rounds"),
    "few particles": (UNIT + WIDTH + "[plan]\nparticles = 10\n", "1,000 to 1,000,000"),
    "always resampling": ("[resampling]\nbelow = 1\n", "must be below 1"),
    "slots that float and change hands": (
        '[resampling]\nmethod = "kahn"\nbelow = 0.5\nacross_scenarios = true\n',
        'across_scenarios = true needs method = "systematic"',
    ),
    "copies that would change hands": (
        '[resampling]\nmethod = "duplicates"\nbelow = 0.5\nacross_scenarios = true\n',
        "the survivors of a scenario keep their slots",
    ),
    "what is placed anew at no speed": (
        '[resampling]\nmethod = "combined"\nbelow = 0.5\n',
        "needs fastest",
    ),
    "what is placed anew and never duplicated": (
        '[resampling]\nmethod = "position"\nfastest = "9 kn"\n',
        "needs 0 < bulk <= below, and bulk is 0.1, below 0",
    ),
    "a bulk of duplicates": (
        '[resampling]\nmethod = "duplicates"\nbulk = 0.1\n',
        "bulk: only for method",
    ),
    "slots that never change hands": (
        "[resampling]\nacross_scenarios = true\n",
        "needs below, such as 0.5",
    ),
    "another resampling": ('[resampling]\nmethod = "residual"\n', "'residual' is not allowed"),
}


@pytest.mark.parametrize("kind", UNITS)
def test_what_is_wrong_with_units_and_plans(kind: str, tmp_path: Path) -> None:
    given, word = UNITS[kind]
    assert word in refusal(tmp_path, given)


@pytest.mark.parametrize(
    "value", ["{ median = 0 }", '{ median = "18 h", spread = 1 }', '{ median = "18 h", spred = 2 }']
)
def test_what_is_wrong_with_survival(value: str, tmp_path: Path) -> None:
    line = refusal(
        tmp_path,
        scenarios=SCENARIOS.replace("search_object", f"survival = {value}\nsearch_object", 1),
    )
    assert 'scenario "raft".survival' in line


@pytest.mark.parametrize(
    ("more", "hours"),
    [
        ((), None),
        ((SORTIE, WHEN, WIDTH, BOX, FAST), 8),
        ((SORTIE, WHEN, WIDTH, BOX, FAST, UNIT, WIDTH), 8),
        ((SORTIE, WHEN, WIDTH, BOX, FAST, UNIT, WIDTH, '[plan]\nbegin = "+11 h"\n'), 11),
        ((UNIT, WIDTH), None),  # it plans from the start on, where nothing is known yet
        ((SORTIE, WHEN, WIDTH, BOX, FAST, UNIT, WIDTH, '[output]\ndatum = "+7 h"\n'), 7),
    ],
)
def test_maps_open_at_the_time_that_matters(
    tmp_path: Path, more: tuple[str, ...], hours: int | None
) -> None:
    """The datum asked for, the begin of the plan, the end of the last sortie, the end: and it is an
    output.
    """
    case = load(tmp_path, *more, head=HEAD.replace('output.every = "12 h"\n', ""))
    assert case.opens == (None if hours is None else hour(hours))
    assert case.opens is None or case.opens in case.outputs


def test_a_datum_outside_the_run_is_refused(tmp_path: Path) -> None:
    head = HEAD.replace('output.every = "12 h"', 'output.datum = "+25 h"')
    assert "output.datum: 220100ZNOV26 is outside the run" in refusal(tmp_path, head=head)
