"""Search plan as text: the search action plan for crews and coordinators (IAMSAR Manual, Vol. II).

Positions are degrees and decimal minutes, directions true, times date-time groups.
"""

import math
import textwrap
from collections.abc import Sequence

import numpy as np

from drift.forecast import effective
from drift.planning.search.products import subareas
from drift.planning.search.records import Plan, Tasking
from drift.products.files.text_sheet import (
    SYNTHETIC,
    WIDE,
    paragraph,
    text_sheet,
)
from geo import notation, sphere
from geo.notation import KNOT, NMI

FOOT = 0.3048  # [m]
LABEL = 18
LONG_WAIT = 0.5  # [h] wait from which its reason is given
SHOWN_ASHORE = 0.005  # probability from which stranding is mentioned
OPTIMISTIC = 0.02  # largest optimism without a warning
OBJECTIVES = {"pos": "detect the object", "alive": "detect the object while alive"}
EXPECTED = "Expected POD"
SPACING = {"sector": "Radius"}  # label of a pattern's spacing, if not "Track spacing"
STATES = ("adrift", "under way")


def plan_text(
    plan: Plan,
    case_title: str,
    run: str,
    notes: Sequence[str] = (),
    *,
    datum: tuple[float, float, np.datetime64] | None = None,
    synthetic: bool = False,
) -> str:
    """Return the search action plan.

    Args:
        plan: to be written.
        case_title: title of the case.
        run: id of the run.
        notes: further notes for the coordinator.
        datum: (lon, lat) [deg] and its time.
        synthetic: whether winds or currents are synthetic.
    """
    names = subareas.names(plan)
    tasks: list[str] = []
    number = 0
    for name, tasking in zip(names, plan.taskings, strict=True):
        if tasking.round != number and plan.spec.rounds > 1:
            number = tasking.round
            later = ", planned as if all earlier rounds fail: plan again after they are flown"
            tasks += ["", *paragraph(f"Round {number}{later if number > 1 else ''}", 3)]
        tasks += ["", *task(plan, name, tasking)]
    others = [("ALTERNATIVES, all on the planning particles", _alternatives(plan))]
    remarks = (*notes, *_standard_notes(plan))
    sections = [
        ("WORTH", _worth(plan, datum)),
        ("SEARCH AREAS", _table(plan, names)),
        ("TASKING", tasks or ["   none: no unit can search in this period"]),
        *others * bool(plan.alternatives),
        (
            "COORDINATION, COMMUNICATIONS, REPORTS",
            ["   to be filled in by the search mission coordinator"],
        ),
        ("NOTES", [line for note in remarks for line in paragraph(f"- {note}", 3, 5)]),
    ]
    return text_sheet(
        "SEARCH ACTION PLAN",
        case_title,
        run,
        sections,
        warnings=warnings(plan, synthetic),
        conventions="Times are UTC, directions true",
    )


def warnings(plan: Plan, synthetic: bool) -> list[str]:
    """Return the warnings at the head of a plan: limits of its use and reliability."""
    lines = []
    if synthetic:
        lines.append(SYNTHETIC)
    if plan.seen - plan.value > OPTIMISTIC:
        lines.append(
            f"overfitted: the plan scored {plan.seen:.3f} on the planning particles, {plan.value:.3f} on others. "
            "Plan with more particles."
        )
    lines += [
        f"{other.name}: finds {-other.difference:.3f} +- {other.standard_error:.3f} more than this plan on the "
        f"planning particles, but its areas come nearer than {plan.spec.separation / NMI:.3g} nmi to each other."
        for other in plan.alternatives
        if -other.difference > 2 * other.standard_error and not other.apart
    ]
    return lines + rough(plan)


def rough(plan: Plan) -> list[str]:
    """Return a warning for each figure of a plan that rests on few particles."""
    lines = []
    if plan.made_on is not None and plan.made_on.few:
        lines.append(
            effective.sentence(
                plan.made_on,
                "in planning",
                "its areas and its bound are rough",
            )
        )
    if plan.scored_on is not None and plan.scored_on.few:
        lines.append(effective.sentence(plan.scored_on, "in scoring", "its POS is rough"))
    return lines


def worth(plan: Plan) -> str:
    """Return one line with a plan's value and the estimated bound of all plans.

    Without a bound it gives the reason. The bound is rounded up, to three digits if two show no
    difference from the value.
    """
    digits = (
        3 if plan.bound is not None and f"{plan.value:.2f}" == f"{_up(plan.bound, 2):.2f}" else 2
    )
    value = f"POS {notation.probability(plan.value, digits)}"
    if plan.spec.objective == "alive":
        value = f"{notation.probability(plan.value, digits)} to detect alive (POS {notation.probability(plan.pos, digits)})"
    if plan.bound is None:
        return f"{value}; no bound: {plan.unbounded}" if plan.unbounded else value
    error = f" (+-{_up(2 * plan.bound_error, digits):.{digits}f})" if plan.bound_error > 0 else ""
    return f"{value}; estimated bound {_up(plan.bound, digits):.{digits}f}{error}"


def plan_facts(plan: Plan) -> dict[str, str]:
    """Return the value of a search plan and the task of each unit, for a terminal."""
    facts = {"plan": worth(plan)}
    facts |= {"ashore": words} if (words := stranded(plan)) else {}
    for name, tasking in zip(subareas.names(plan), plan.taskings, strict=True):
        facts[f"{name} {tasking.unit.name}"] = (
            f"{tasking.length / NMI:.1f} x {tasking.width / NMI:.1f} nmi at {notation.position(*tasking.centre)}, "
            f"{tasking.legs} leg{'s' * (tasking.legs != 1)} {tasking.spacing / NMI:.2f} nmi apart, on scene {notation.format_dtg(tasking.on_scene)[:6]}Z to "
            f"{notation.format_dtg(tasking.off_scene)[:6]}Z, POS {notation.percent(tasking.pos)}{_at_sea(tasking)}"
        )
    if plan.idle:
        facts["not sent"] = ", ".join(plan.idle)
    facts |= {f"boats {k}": words for k, words in enumerate(plan.said, 1)}
    facts |= {f"warning {k}": words for k, words in enumerate(warnings(plan, synthetic=False), 1)}
    if len(plan.scenarios) > 1:
        facts |= {
            f'POS if "{scenario}"': notation.percent(pos)
            for scenario, pos in subareas.scenario_pos(plan)
        }
    return facts


def _at_sea(tasking: Tasking) -> str:
    """Return the sea distances of a boat, and which of its legs are cut at the coast."""
    remarks = [
        f"{name.lower()} {way / NMI:.1f} nmi by sea, {straight / NMI:.1f} straight"
        for name, way, straight in subareas.by_sea(tasking)
    ]
    remarks += [f"legs {_listed(tasking.cut)} cut at the coast"] * bool(tasking.cut)
    return "".join(f", {words}" for words in remarks)


def stranded(plan: Plan) -> str:
    """Return the probability that the object is ashore, and whether the plan covers it.

    Returns "" if that probability is negligible.
    """
    if max(plan.ashore, plan.pos_ashore) < SHOWN_ASHORE:
        return ""
    lies = f"{notation.percent(plan.ashore)} probability that it is stranded when the plan begins"
    if plan.spec.ashore:
        return f"{lies}; {notation.probability(plan.pos_ashore)} of the POS is for stranded objects that a unit passes"
    return f"{lies}; this plan covers only objects afloat: send a shore party, or set ashore = true in [plan]"


def _share(value: float) -> str:
    """Return a share in whole percent, or "all"."""
    return "all" if value == 1 else notation.percent(value, 0)


def _up(value: float, digits: int) -> float:
    """Return a bound rounded up to a number of digits."""
    return float(math.ceil(round(value * 10.0**digits, 6)) / 10.0**digits)


def _worth(plan: Plan, datum: tuple[float, float, np.datetime64] | None) -> list[str]:
    """Return the section on the plan's value."""
    rows = [
        (
            "Period",
            f"{notation.format_dtg(plan.spec.begin)} to {notation.format_dtg(plan.spec.until)}",
        )
    ]
    if datum is not None and (where := notation.position(*datum[:2])) is not None:
        rows.append(("Datum", f"{where} at {notation.format_dtg(datum[2])}"))
    rows += [("Objective", OBJECTIVES[plan.spec.objective]), ("Worth", worth(plan))]
    if words := stranded(plan):
        rows.append(("Ashore", words))
    if plan.bound:
        bound = (
            "An estimate: no plan of these units, detection functions and times is expected to find more than "
            f"{_up(plan.bound, 3):.3f} of the planning particles. This one finds {plan.seen:.3f} of them: "
            f"{100 * plan.seen / plan.bound:.0f} %. Its POS is estimated on other particles: two standard "
            f"errors of sampling are {_up(2 * plan.bound_error, 3):.3f}"
        )
        rows.append(("Bound", bound))
    if plan.spec.rounds > 1 and plan.bound is not None:
        loose = f"The bound lets each unit search {plan.spec.rounds} times its endurance without turnaround: it is loose"
        rows.append(("", loose))
    rows.append(("Optimism", f"{plan.seen - plan.value:+.3f} on the planning particles"))
    for k, (name, pos) in enumerate(subareas.scenario_pos(plan)):
        rows.append(("POS by scenario" if k == 0 else "", f"{notation.probability(pos):5} {name}"))
    return [line for row in rows for line in _row(*row)]


def _table(plan: Plan, names: Sequence[str]) -> list[str]:
    """Return the table of search areas."""
    lines = [f"   {'Area':6}{'Unit':24}{'Takeoff':9}{'On scene':10}{'Off':9}{'Home':9}{'POS':>5}"]
    for name, tasking in zip(names, plan.taskings, strict=True):
        times = [
            _short(time)
            for time in (tasking.takeoff, tasking.on_scene, tasking.off_scene, tasking.home)
        ]
        unit = tasking.unit.name if len(tasking.unit.name) <= 23 else f"{tasking.unit.name[:20]}..."
        lines.append(
            f"   {name:6}{unit:24}{times[0]:9}{times[1]:10}{times[2]:9}{times[3]:9}{notation.probability(tasking.pos):>5}"
        )
    return [
        *lines,
        *paragraph(
            "POS: of each unit, conditional on the failure of those before it in this list", 3
        ),
    ]


def task(plan: Plan, name: str, tasking: Tasking) -> list[str]:
    """Return a unit's task as lines of text."""
    unit, sortie = tasking.unit, tasking.sortie
    title = f"{name}  {unit.name}" + (
        f" ({unit.kind})" if unit.kind and unit.kind != unit.name else ""
    )
    corners = [notation.position(*corner) or "" for corner in subareas.corners(tasking)]
    size = f"{tasking.length / NMI:.1f} x {tasking.width / NMI:.1f}"
    rows: list[tuple[str, str]] = [
        ("Corners", f"{corners[0]}   {corners[1]}"),
        ("", f"{corners[2]}   {corners[3]}"),
        ("Centre", notation.position(*tasking.centre) or ""),
        ("Size", f"{size} nmi, length along {_both(tasking.orientation)}"),
    ]
    if sortie.legs is not None:
        lengths = (
            "in pieces of up to" if tasking.cut else "of" if tasking.manner.plain else "of up to"
        )
        many = f"{tasking.legs} leg{'s' * (tasking.legs != 1)} {lengths}"
        parallel = tasking.manner.pattern == "parallel"
        rows += [
            ("Pattern", subareas.pattern(tasking)),
            ("CSP", f"{notation.position(*subareas.begin(tasking))}   (commence search point)"),
            (
                "First leg",
                f"{_first_course(tasking):03d}T, {many} {subareas.leg_length(tasking) / NMI:.1f} nmi",
            ),
            *[("Creep", f"{subareas.degrees(tasking.creep):03d}T")] * parallel,
            (
                SPACING.get(tasking.manner.pattern, "Track spacing"),
                f"{tasking.spacing / NMI:.2f} nmi",
            ),
        ]
    else:
        rows.append(
            (
                "Pattern",
                f"search of the whole area, {subareas.track_length(tasking) / NMI:.0f} nmi of track",
            )
        )
    if tasking.cut:
        ways = f"{subareas.round_length(tasking) / NMI:.1f} nmi of ways round land without search"
        swept = f"{subareas.track_length(tasking) / NMI:.1f} nmi search {_share(tasking.swept)} of the sea in the area"
        rows.append(("Cut legs", f"{_listed(tasking.cut)}: cut at the coast; {swept}; {ways}"))
    rows.append(
        (
            "Speed",
            f"{notation.number(unit.search_speed / KNOT)} kn search, {notation.number(unit.transit_speed / KNOT)} kn transit",
        )
    )
    if math.isfinite(unit.altitude):
        what = "Height of eye" if unit.kind == "Boat" else "Altitude"
        rows.append((what, f"{notation.number(unit.altitude / FOOT)} ft"))
    waits = float((tasking.takeoff - max(unit.ready, plan.spec.begin)) / np.timedelta64(1, "h"))
    if waits >= LONG_WAIT:
        why = f": {tasking.waits}" if tasking.waits else ""
        rows.append(("Departs", f"{waits:.1f} h after it is ready{why}"))
    rows += [
        (
            "Takeoff",
            f"{notation.format_dtg(tasking.takeoff)}   from {notation.stated_position(*unit.base)}",
        ),
        (
            "On scene",
            notation.format_dtg(tasking.on_scene) + ("   at the CSP" if sortie.legs else ""),
        ),
        (
            "Off scene",
            f"{notation.format_dtg(tasking.off_scene)}   at {notation.position(*subareas.end(tasking))}",
        ),
        (
            "Home",
            f"{notation.format_dtg(tasking.home)}   at {notation.stated_position(*unit.return_to)}",
        ),
        *(
            (which, f"{way / NMI:.1f} nmi by sea, {straight / NMI:.1f} nmi straight")
            for which, way, straight in subareas.by_sea(tasking)
        ),
        ("POS", notation.probability(tasking.pos)),
    ]
    if unit.afloat:
        keeps = [f"{notation.number(unit.clear_of_land / NMI)} nmi off land"] * (
            unit.clear_of_land > 0
        )
        keeps += [f"in water deeper than {notation.number(unit.draught)} m"] * (unit.draught > 0)
        rows += [("Keeps", ", ".join(keeps))] * bool(keeps)
    return [
        f"   {title}",
        *(line for row in rows for line in _row(*row, indent=6)),
        *_expected(plan, tasking),
    ]


def _listed(numbers: Sequence[int]) -> str:
    """Return ascending numbers with runs as ranges: 6 to 8, 12."""
    runs: list[list[int]] = []
    for number in numbers:
        if runs and number == runs[-1][-1] + 1:
            runs[-1].append(number)
        else:
            runs.append([number])
    return ", ".join(
        str(run[0]) if len(run) == 1 else f"{run[0]}{' to ' if len(run) > 2 else ', '}{run[-1]}"
        for run in runs
    )


def _expected(plan: Plan, tasking: Tasking) -> list[str]:
    """Return the POD of a tasking: a line if all scenarios have the same, otherwise a table.

    If sweep widths differ under way, there is a line or row for each state.
    """
    by_state = [
        (
            subareas.pods(tasking, state),
            subareas.widths(tasking, state) / NMI,
            subareas.coverages(tasking, state),
        )
        for state in ((False, True) if tasking.sortie.width_under_way else (False,))
    ]
    if all(np.ptp(width) < 1e-9 and np.ptp(coverage) < 1e-9 for _, width, coverage in by_state):
        lines = [
            f"{notation.probability(pod[0])} at W {notation.number(w[0], 3)} nmi, coverage {c[0]:.2f}"
            for pod, w, c in by_state
        ]
        if len(set(lines)) > 1:
            lines = [f"{line}, {state}" for line, state in zip(lines, STATES, strict=True)]
        return [
            part
            for k, line in enumerate(dict.fromkeys(lines))
            for part in _row("" if k else EXPECTED, line, indent=6)
        ]
    rows: list[tuple[str, list[float]]] = []
    shown_by_state = [subareas.told(plan, *figures) for figures in by_state]
    for k, name in enumerate(shown_by_state[0][0]):
        own = [[column[k] for column in columns] for _, columns in shown_by_state]
        if own[0] == own[-1]:
            rows.append((name, own[0]))
        else:
            rows += [
                (f"{name}, {state}", figures) for state, figures in zip(STATES, own, strict=True)
            ]
    wide = max(len(name) for name, _ in rows)
    lines = [f"{'':{wide}}   POD  W [nmi]  Coverage"]
    for name, figures in rows:
        lines.append(
            f"{name:{wide}} {notation.probability(figures[0]):>5}  {figures[1]:7.2f}  {figures[2]:8.2f}"
        )
    return [f"      {'' if k else EXPECTED:{LABEL}}{line}" for k, line in enumerate(lines)]


def _alternatives(plan: Plan) -> list[str]:
    """Return the section on alternatives."""
    lines = [f"   {plan.seen:.3f}  this plan"]
    for other in plan.alternatives:
        by = f"by {abs(other.difference):.3f} +- {other.standard_error:.3f}"
        if abs(other.difference) < 2 * other.standard_error:
            gap = f"as good within the error of sampling ({by})"
        else:
            gap = f"{'better' if other.difference > 0 else 'WORSE'} {by}"
        near = (
            ""
            if other.apart
            else f" (nearer to each other than {plan.spec.separation / NMI:.3g} nmi)"
        )
        beside = "this is the plan" if other.same else f"the plan is {gap}"
        lines += paragraph(f"{other.value:.3f}  {other.name}{near}; {beside}", 3, 10)
    return lines


def _standard_notes(plan: Plan) -> tuple[str, ...]:
    """Return the notes that stand in every plan."""
    boats = (
        "Boats follow the coast of this case, whose error may exceed the distance that they keep from it. Rocks "
        "awash and tides are not known, nor are depths without a depth grid: check each way on a chart.",
    )
    return (
        *boats * any(tasking.unit.afloat for tasking in plan.taskings),
        "Altitudes and times are for planning: crews and controllers settle separation, weather and daylight.",
        "POD is for an object that stays in the area; POS counts those that drift in and out of it.",
        *(
            "A drifting area moves as a whole during its search: its corners enclose all of its legs, and its POD is "
            "for an object that drifts with it. Fly the turning points at their times.",
        )
        * any(tasking.manner.moves for tasking in plan.taskings),
        "After the search append plan.toml to the case, with what was flown: completed or actual.",
    )


def _row(label: str, value: str, indent: int = 3) -> list[str]:
    """Return a labelled row, wrapped to the page width."""
    start = " " * indent + f"{label:{LABEL}}"
    return textwrap.wrap(
        value,
        WIDE,
        initial_indent=start,
        subsequent_indent=" " * len(start),
        drop_whitespace=True,
        break_long_words=False,
        fix_sentence_endings=False,
    ) or [start.rstrip()]


def _both(angle: float) -> str:
    """Return the two directions of an axis: 030/210T."""
    first = subareas.degrees(angle)
    low, high = sorted((first, (first + 179) % 360 + 1))
    return f"{low:03d}/{high:03d}T"


def _first_course(tasking: Tasking) -> int:
    """Return the course [deg] of the first leg; on parallel legs, one way of the axis."""
    legs = tasking.sortie.legs
    assert legs is not None
    east, north = sphere.offset(*np.radians([legs.lon[0], legs.lat[0], legs.lon[1], legs.lat[1]]))
    if not tasking.manner.plain:
        return subareas.degrees(math.atan2(east, north))
    ahead = (
        math.sin(tasking.orientation) * float(east) + math.cos(tasking.orientation) * float(north)
        >= 0
    )
    return subareas.degrees(tasking.orientation + (0 if ahead else math.pi))


def _short(time: np.datetime64) -> str:
    """Return a time without its month: 161350Z."""
    return f"{notation.format_dtg(time)[:6]}Z"
