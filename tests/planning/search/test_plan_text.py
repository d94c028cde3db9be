"""The search action plan: that what crews read leads to the rectangle and the times of the plan, by
pyproj's geodesics.
"""

import math
import re
from dataclasses import replace

import numpy as np
import pyproj
import pytest
import searches

from drift.planning.search.products import subareas
from drift.planning.search.products import text as plan_text
from geo import notation, sphere

GEOD = pyproj.Geod(a=sphere.RADIUS, b=sphere.RADIUS)
NMI = 1852.0
POSITION = re.compile(r"(\d\d)-(\d\d\.\d)([NS]) (\d{3})-(\d\d\.\d)([EW])")
READ = 0.05 * math.sqrt(2) + 0.01  # [nmi] by which a position to a tenth of a minute may be off


def places(text):
    """Return positions (lon, lat) as a crew would read them."""
    return [
        (
            (int(e) + float(f) / 60) * (1 if g == "E" else -1),
            (int(a) + float(b) / 60) * (1 if c == "N" else -1),
        )
        for a, b, c, e, f, g in POSITION.findall(text)
    ]


def block(text, name):
    return text.split("3  TASKING")[1].split(f"\n   {name}  ")[1].split("\n\n")[0]


def line(text, label):
    return next(row for row in text.splitlines() if row.strip().startswith(label))


@pytest.mark.parametrize(("lon", "lat"), [(-88.2, 27.8), (179.9, -61.0)])
def test_a_crew_can_fly_it(lon, lat):
    plan = searches.plan(lon, lat)
    text = plan_text.plan_text(plan, "Overdue boat", "run-s1")
    for name, one in zip(("A-1", "A-2", "A-3"), plan.taskings, strict=True):
        told = block(text, name)
        corners = places(told)[:4]
        sides = [
            GEOD.inv(*a, *b)[2] / NMI
            for a, b in zip(corners, corners[1:] + corners[:1], strict=True)
        ]
        for k, side in enumerate(sides):
            nearest = (
                min((one.length, one.width), key=lambda size: abs(size / NMI - sides[k])) / NMI
            )
            assert side == pytest.approx(nearest, abs=2 * READ + 0.01 * nearest)
        csp = places(line(told, "CSP"))[0]
        # half a spacing inside in both directions of the corner that is named first
        assert GEOD.inv(*corners[0], *csp)[2] == pytest.approx(
            one.spacing / math.sqrt(2), abs=2 * READ * NMI
        )
        assert GEOD.inv(*csp, one.sortie.legs.lon[0], one.sortie.legs.lat[0])[2] < READ * NMI
        course = GEOD.inv(
            *(v for k in (0, 1) for v in (one.sortie.legs.lon[k], one.sortie.legs.lat[k]))
        )[0]
        assert int(re.search(r"(\d{3})T", line(told, "First leg"))[1]) == pytest.approx(
            course % 360, abs=1
        )
        legs = [int(v) for v in re.findall(r"(\d+) legs?", line(told, "First leg"))]
        assert legs == [one.legs]
        assert float(line(told, "Track spacing").split()[2]) == pytest.approx(
            one.spacing / NMI, abs=0.005
        )
        fourth = one.sortie.legs.lon[3], one.sortie.legs.lat[3]
        # from the first leg to the second
        creep = GEOD.inv(one.sortie.legs.lon[0], one.sortie.legs.lat[0], *fourth)[0]
        assert int(re.search(r"(\d{3})T", line(told, "Creep"))[1]) == pytest.approx(
            creep % 360, abs=1
        )


def test_the_worth_and_the_bound_stand_at_the_head():
    plan = searches.plan()
    text = plan_text.plan_text(
        plan, "Overdue boat", "run-s1", ["a note"], datum=(-88.25, 27.5, searches.hours(17))
    )
    assert "POS 0.46; estimated bound 0.53" in text
    told = " ".join(text.split())
    assert (
        "no plan of these units, detection functions and times is expected to find more than 0.528 of the planning particles"
        in told
    )
    assert "This one finds 0.471 of them: 89 %" in told
    assert "two standard errors of sampling are 0.008" in told
    assert "27-30.0N 088-15.0W at 222330ZNOV26" in text
    assert "0.52  position report" in text
    assert re.search(r"better\s+by 0.121 \+- 0.003", text)
    assert "- a note" in text
    assert "WARNING" not in text
    alive = plan_text.plan_text(searches.plan(objective="alive"), "Overdue boat", "run-s1")
    assert "0.31 to detect alive (POS 0.46); estimated bound 0.37" in alive


def test_warnings_come_first():
    plan = replace(searches.plan(), seen=0.52)
    text = plan_text.plan_text(plan, "Overdue boat", "run-s1", synthetic=True)
    head = text.split("1  WORTH")[0]
    assert "SYNTHETIC" in head
    assert "0.520" in head


def test_it_goes_through_any_line():
    """Mail and telex take ASCII of 80 columns; the names are the coordinator's own."""
    text = plan_text.plan_text(
        searches.plan(rounds=2), "A title " * 30, "run-s1", ["a note " * 40], synthetic=True
    )
    assert text.isascii()
    assert max(map(len, text.splitlines())) <= 78
    assert "\t" not in text
    assert text.endswith("\n")
    assert "Round 2" in text
    assert "B-1  CG 1503" in text


def test_pod_is_the_textbooks():
    """Inverse cube erf(sqrt(pi)/2 C); M-beta with a gamma factor against 400,000 draws."""
    plan = searches.plan()
    c = np.array([0.8, 0.8, 1.3]) / 3.0
    np.testing.assert_allclose(
        subareas.pods(plan.taskings[0]), [math.erf(math.sqrt(math.pi) / 2 * v) for v in c]
    )
    factor = np.random.default_rng(3).gamma(11.0, 1 / 11.0, 400_000)
    looks = np.multiply.outer(np.array([0.8, 0.8, 1.3]) / 1.5 / 0.8, factor)
    whole = np.floor(looks)
    expected = (1 - 0.2**whole * (1 - 0.8 * (looks - whole))).mean(axis=1)
    # 16 nodes for a kinked law
    np.testing.assert_allclose(subareas.pods(plan.taskings[1]), expected, atol=5e-3)


def test_directions_are_said_as_crews_say_them():
    assert [subareas.degrees(math.radians(v)) for v in (0, 0.4, 359.7, -90, 725, 359.4)] == [
        360,
        360,
        360,
        270,
        5,
        359,
    ]


def test_a_plan_of_nothing_is_said():
    text = plan_text.plan_text(
        replace(searches.plan(), taskings=(), alternatives=()), "Overdue boat", "run-s1"
    )
    assert "no unit can search" in text
    assert "ALTERNATIVES" not in text
    assert re.findall(r"^(\d)  [A-Z]", text, re.MULTILINE) == ["1", "2", "3", "4", "5"]


def test_one_unit_may_have_one_alternative_only():
    plan = searches.plan()
    one = replace(plan, taskings=plan.taskings[:1], alternatives=plan.alternatives[:1])
    text = plan_text.plan_text(one, "Overdue boat", "run-s1")
    assert re.findall(r"^(\d)  [A-Z]", text, re.MULTILINE) == ["1", "2", "3", "4", "5", "6"]
    assert "4  ALTERNATIVES" in text


def test_what_else_could_be_done_stands_beside_the_plan_on_the_same_particles():
    """The plan's figure was of other particles than those of the alternatives; one that is better
    is warned of.
    """
    plan = searches.plan()
    text = plan_text.plan_text(plan, "Overdue boat", "run-s1")
    told = text.split("4  ALTERNATIVES")[1].split("\n5  ")[0]
    assert told.splitlines()[0].endswith("all on the planning particles")
    assert told.splitlines()[1] == "   0.471  this plan"
    values = [float(row.split()[0]) for row in told.splitlines() if re.match(r" +0\.\d{3}  ", row)]
    gaps = [float(gap) for gap in re.findall(r"better\s+by (\S+)", told)]
    assert [values[0] - value for value in values[1:]] == pytest.approx(gaps)
    spec = replace(plan.spec, separation=2 * NMI)
    near = replace(
        plan.alternatives[1], difference=-0.03, value=0.501, standard_error=0.01, apart=False
    )
    better = replace(plan, spec=spec, alternatives=(plan.alternatives[0], near))
    head, tail = plan_text.plan_text(better, "Overdue boat", "run-s1").split("1  WORTH")
    assert "finds 0.030 +- 0.010 more than this plan" in " ".join(head.split())
    assert "nearer than 2 nmi to each other" in " ".join(head.split())
    assert "the plan is WORSE by 0.030 +- 0.010" in " ".join(tail.split())
    level = replace(better, alternatives=(replace(near, difference=-0.0004, standard_error=0.001),))
    told = " ".join(plan_text.plan_text(level, "Overdue boat", "run-s1").split())
    assert "the plan is as good within the error of sampling (by 0.000 +- 0.001)" in told
    chance = replace(better, alternatives=(replace(near, standard_error=0.02),))
    assert plan_text.warnings(chance, synthetic=False) == []


def test_one_reason_of_a_wait_is_told():
    plan = searches.plan()
    first = plan.taskings[0]
    ready = first.takeoff - np.timedelta64(3, "h")
    plan = replace(plan, spec=replace(plan.spec, begin=ready))
    late = replace(first, unit=replace(first.unit, ready=ready), waits="for daylight")
    told = block(
        plan_text.plan_text(replace(plan, taskings=(late,)), "Overdue boat", "run-s1"), "A-1"
    )
    assert (
        line(told, "Departs").split("Departs")[1].strip() == "3.0 h after it is ready: for daylight"
    )
    soon = replace(late, unit=replace(first.unit, ready=first.takeoff))
    assert "Departs" not in plan_text.plan_text(
        replace(plan, taskings=(soon,)), "Overdue boat", "run-s1"
    )


def test_pod_is_a_table_with_whole_names():
    plan = replace(
        searches.plan(), scenarios=("swamped while fishing", "a", "adrift with engine failure")
    )
    told = (
        block(plan_text.plan_text(plan, "Overdue boat", "run-s1"), "A-1")
        .split("Expected POD")[1]
        .splitlines()
    )
    assert told[0].split() == ["POD", "W", "[nmi]", "Coverage"]
    pods = subareas.pods(plan.taskings[0])
    for row, name, pod, width in zip(told[1:], plan.scenarios, pods, (0.8, 0.8, 1.3), strict=True):
        assert row.split(name)[1].split() == [f"{pod:.2f}", f"{width:.2f}", f"{width / 3:.2f}"]
    assert len({len(row) for row in told[1:]}) == 1


def test_both_states_of_what_steers_are_told():
    """A row for each where they differ; one line each where all scenarios are alike; none of it
    where nothing steers.
    """
    plan = searches.plan()
    first = plan.taskings[0]
    width = tuple(v * NMI for v in (0.8, 2.4, 1.3))
    steered = replace(first, sortie=replace(first.sortie, width_under_way=width))
    told = block(
        plan_text.plan_text(
            replace(plan, taskings=(steered, *plan.taskings[1:])), "Yacht", "run-s1"
        ),
        "A-1",
    )
    rows = [row.split() for row in told.split("Expected POD")[1].splitlines()[1:]]
    names = [name for name in plan.scenarios for _ in range(1 + (name == plan.scenarios[1]))]
    assert [" ".join(row[:-3]).split(",")[0] for row in rows] == names
    assert rows[1][-4:] == [
        "adrift",
        f"{math.erf(math.sqrt(math.pi) / 2 * 0.8 / 3):.2f}",
        "0.80",
        "0.27",
    ]
    assert rows[2][-5:] == [
        "under",
        "way",
        f"{math.erf(math.sqrt(math.pi) / 2 * 0.8):.2f}",
        "2.40",
        "0.80",
    ]
    numbers = subareas.summary_of_plan(replace(plan, taskings=(steered,)))["taskings"][0]
    assert numbers["sweep_width_under_way_nmi"] == pytest.approx(
        dict(zip(plan.scenarios, (0.8, 2.4, 1.3), strict=True))
    )
    assert numbers["pod_under_way"][plan.scenarios[1]] == pytest.approx(
        math.erf(math.sqrt(math.pi) / 2 * 0.8)
    )
    same = replace(first.sortie, sweep_width=(0.9 * NMI,) * 3, width_under_way=(1.8 * NMI,) * 3)
    lines = " ".join(
        plan_text.plan_text(
            replace(plan, taskings=(replace(first, sortie=same),)), "Yacht", "run-s1"
        ).split()
    )
    assert "at W 0.9 nmi, coverage 0.30, adrift" in lines
    assert "at W 1.8 nmi, coverage 0.60, under way" in lines
    assert "under way" not in plan_text.plan_text(plan, "Overdue boat", "run-s1")


def test_a_third_digit_tells_a_plan_from_its_bound():
    plan = replace(searches.plan(), value=0.4551, bound=0.4572)
    # bounds are rounded up
    assert plan_text.worth(plan) == "POS 0.455; estimated bound 0.458 (+-0.008)"


def test_where_there_is_no_bound_no_figure_stands_for_it():
    plan = replace(
        searches.plan(),
        bound=None,
        unbounded="only 312 effective particles, too few to judge this plan",
    )
    text = " ".join(plan_text.plan_text(plan, "Overdue boat", "run-s1").split())
    assert "POS 0.46; no bound: only 312 effective particles, too few to judge this plan" in text
    assert "estimated" not in text
    assert "Bound" not in text


def test_the_bound_of_rounds_is_said_to_be_loose():
    text = plan_text.plan_text(searches.plan(rounds=2), "Overdue boat", "run-s1")
    assert "2 times its endurance without turnaround: it is loose" in " ".join(text.split())
    assert "turnaround" not in plan_text.plan_text(searches.plan(), "Overdue boat", "run-s1")


def test_what_is_not_certain_is_not_written_as_one() -> None:
    """0.995 was "1.00" on the plan, its picture and its sheets."""
    assert [notation.probability(p) for p in (0.0, 0.454, 0.9949, 0.9951, 0.99999, 1.0)] == [
        "0.00",
        "0.45",
        "0.99",
        ">0.99",
        ">0.99",
        "1.00",
    ]
    assert notation.probability(0.9996, 3) == ">0.999"
