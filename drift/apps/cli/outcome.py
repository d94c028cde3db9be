"""What a run came to, in a few lines for a terminal: facts by name, in the order in which they are
read.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from drift.forecast import likeliest
from drift.forecast.effective import Count
from drift.planning.search.products import subareas
from drift.planning.search.products import text as plan_text
from drift.planning.search.records import Plan, Tasking
from drift.products.maps import gazetteer
from drift.products.maps.gazetteer import Near
from drift.spills.backtrack import text as origin_text
from drift.spills.worlds import verdict
from drift.spills.worlds.products import tables as washup_tables
from geo import notation
from geo.notation import NMI, group, position

WORTH_A_WARNING = 0.01  # share of the probability lost from which a line says so
ASHORE = 0.01  # share of a POS that is of what lies ashore from which it is told apart
WORST = 5  # stretches of coast that are listed
LIKELIEST = 3  # values on an axis of families that are told
DENSEST = 3  # of those with most objects per km


ALIKE = {"prior": 0.0}  # of what stands for many scenarios together

Facts = dict[str, str]


def forecast(numbers: dict[str, Any]) -> Facts:
    """Return where, how sure and what ended how, at the end of the run; numbers: those of the
    summary.
    """
    end = numbers["outputs"][-1]
    # before the areas that they doubt
    facts = {"time": end["date_time_group"]} | _warnings(numbers["warnings"])
    moving = [name for name in ("adrift", "under_way") if end["probability"].get(name, 0.0) > 0]
    afloat = " or ".join(name.replace("_", " ") for name in moving) or "adrift"
    for name, key in (("mean position", "mean"), (f"datum (mean of those {afloat})", "datum")):
        if end[key]:
            facts[name] = end[key]["text"]
    facts |= {f"{share} area": told for share, told in _areas(end).items()} | _opening(numbers)
    for status, share in numbers["account"].items():
        if share > 0:
            facts[status.replace("_", " ")] = notation.percent(share)
    facts |= {"errors": told} if (told := numbers["uncertainty"]["told"]) else {}
    facts |= _search(numbers) | _guided(numbers)
    facts |= _lost(numbers)
    facts |= _coast(numbers)
    facts |= {"members": _members(numbers["members"])} if "members" in numbers else {}
    facts |= _stories(numbers["scenario_weights"])
    return facts | _by_axis(numbers["stories"]) if "stories" in numbers else facts


def _guided(numbers: dict[str, Any]) -> Facts:
    """Return the finds toward which particles were guided, if any."""
    if "guide" not in numbers:
        return {}
    finds = ", ".join(f'"{name}"' for name in numbers["guide"]["finds"])
    share = 1 - numbers["guide"]["prior_share"]
    return {
        "guided": f"{notation.percent(share, 0)} of the particles, toward contact {finds}; weights account for it"
    }


def _areas(output: dict[str, Any]) -> Facts:
    """Return the areas of an output in words, by the shares that they hold."""
    return {
        share: f"{area:,.0f} nmi2" if area == area else "none"
        for share, area in output["area_nmi2"].items()
    }


def _opened(numbers: dict[str, Any]) -> dict[str, Any]:
    """Return the output that the map and the report show first."""
    return next(output for output in numbers["outputs"] if output["time"] == numbers["opens"])


def _opening(numbers: dict[str, Any]) -> Facts:
    """Return at which time the map and the report open, and the areas then, where that is not the
    end.
    """
    at = _opened(numbers)
    if at is numbers["outputs"][-1]:
        return {}
    areas = ", ".join(f"{share} {told}" for share, told in _areas(at).items())
    return {"map.png, report.html": f"open at {at['date_time_group']}, areas then: {areas}"}


def summary_of_outcome(last: dict[str, Any]) -> dict[str, Any]:
    """Return the same for programs, at the end of the run: positions in degrees, the rest in SI.

    last: the numbers of the summary. What there are more of stands in summary.json.
    """
    end, opened, run = last["outputs"][-1], _opened(last), last["run"]
    told = {
        "time": end["time"],
        **{
            name: end[name] and {"lon_deg": end[name]["lon"], "lat_deg": end[name]["lat"]}
            for name in ("mean", "datum")
        },
        "area_m2": _square_metres(end),
        # map.png and report.html
        "opens": {"time": opened["time"], "area_m2": _square_metres(opened)},
        "status": last["account"],
        "scenarios": {
            name: {key: story[key] for key in ("prior", "posterior")}
            for name, story in last["scenario_weights"].items()
        },
        "effective_particles": end["effective_particles"],
        "particles": run["particles"],
        "seed": run["seed"],
        "step_s": run["step_s"],
        "warnings": list(last["warnings"]),
    }
    if "members" in last:
        told["members"] = last["members"]
    if "search" in last:
        told["sorties"] = [
            {
                "name": update["name"],
                "pos": update["pos"]["all"],
                "cumulative_pos": update["cumulative_pos"]["all"],
            }
            for update in last["search"]["updates"]
            if update["kind"] == "sortie"
        ]
    if "spill" in last:
        told |= {
            key: last["spill"][key]
            for key in ("totals", "worst_stretches", "effective_worlds", "finds", "silence")
        }
    return told


def _square_metres(output: dict[str, Any]) -> dict[str, float]:
    """Return the areas of an output [m2] by the shares that they hold."""
    return {share: 1e6 * area for share, area in output["area_km2"].items()}


def _members(told: dict[str, Any]) -> str:
    """Return how many members of the winds and currents there are, and for which the evidence
    speaks.
    """
    weights = {name: weight["posterior"] for name, weight in told["weights"].items()}
    if told["effective"] > 0.999 * told["number"]:
        return f"{told['number']}, all as likely"
    first = sorted(weights, key=lambda name: -weights[name])[:3]
    likeliest = ", ".join(f"{name} {notation.percent(weights[name])}" for name in first)
    return f"{told['number']}, of which {told['effective']:.1f} are effective after all observations; likeliest {likeliest}"


def _stories(stories: dict[str, Any]) -> Facts:
    """Return how likely each scenario is; of many the likeliest, and the others together."""
    facts: Facts = {}
    table = np.array(
        [[story[key] for story in stories.values()] for key in ("prior", "posterior")], float
    )
    shown = likeliest.likeliest_scenarios(table)
    names = list(stories)
    for name, story in ((names[k], stories[names[k]]) for k in shown.alone):
        remarks = (
            [f"{notation.percent(story['posterior'])} (before: {notation.percent(story['prior'])})"]
            if len(stories) > 1
            else []
        )
        if story["prior_on_land"] > 0:
            remarks.append(
                f"{notation.percent(story['prior_on_land'])} of its starting positions were on land and ignored"
            )
        if remarks:
            facts[f'scenario "{name}"'] = "; ".join(remarks)
    if shown.rest:
        prior, posterior = shown.sums(table)[:, -1]
        facts[shown.names(names)[-1]] = (
            f"{notation.percent(posterior)} (before: {notation.percent(prior)}); see summary.json"
        )
    return facts


def _by_axis(told: dict[str, Any]) -> Facts:
    """Return of families how likely the likeliest values on each axis are, and how many scenarios
    count; nothing without families.
    """
    facts: Facts = {}
    for axis, values in told["axes"].items():
        first = sorted(values, key=lambda label: -values[label]["posterior"])[:LIKELIEST]
        parts = [
            f"{label} {notation.percent(values[label]['posterior'])} (before: {notation.percent(values[label]['prior'])})"
            for label in first
        ]
        facts[f"scenarios by {axis}"] = ", ".join(parts)
    if facts:
        before, now = (told["effective"][key] for key in ("prior", "posterior"))
        facts["effective scenarios"] = f"{now:.3g} of {told['number']:,} (before: {before:.3g})"
    return facts


def plan(planned: Plan) -> Facts:
    """Return what a plan is worth, and what each unit is to do."""
    facts = {"plan": plan_text.worth(planned)}
    facts |= {"ashore": words} if (words := plan_text.stranded(planned)) else {}
    for name, tasking in zip(subareas.names(planned), planned.taskings, strict=True):
        facts[f"{name} {tasking.unit.name}"] = (
            f"{tasking.length / NMI:.1f} x {tasking.width / NMI:.1f} nmi at {position(*tasking.centre)}, "
            f"{tasking.legs} leg{'s' * (tasking.legs != 1)} {tasking.spacing / NMI:.2f} nmi apart, on scene {group(tasking.on_scene)[:6]}Z to "
            f"{group(tasking.off_scene)[:6]}Z, POS {notation.percent(tasking.pos)}{_at_sea(tasking)}"
        )
    if planned.idle:
        facts["not sent"] = ", ".join(planned.idle)
    facts |= {f"boats {k}": words for k, words in enumerate(planned.said, 1)}
    facts |= {
        f"warning {k}": words
        for k, words in enumerate(plan_text.warnings(planned, synthetic=False), 1)
    }
    if len(planned.scenarios) > 1:
        facts |= {
            f'POS if "{scenario}"': notation.percent(pos)
            for scenario, pos in subareas.scenario_pos(planned)
        }
    return facts


def plan_numbers(planned: Plan) -> dict[str, Any]:
    """Return the same for programs: positions and directions in degrees, the rest in SI."""
    return {
        "objective": planned.spec.objective,
        "value": planned.value,
        "pos": planned.pos,
        "pos_ashore": planned.pos_ashore,
        "ashore": planned.ashore,
        "pos_by_scenario": dict(subareas.scenario_pos(planned)),
        "bound": planned.bound,
        "idle": planned.idle,
        "taskings": [
            {
                "area": name,
                "unit": tasking.unit.name,
                "round": tasking.round,
                "takeoff": tasking.takeoff,
                "on_scene": tasking.on_scene,
                "off_scene": tasking.off_scene,
                "home": tasking.home,
                "centre": {"lon_deg": tasking.centre[0], "lat_deg": tasking.centre[1]},
                "length_m": tasking.length,
                "width_m": tasking.width,
                "orientation_deg": np.degrees(tasking.orientation) % 360,
                "pattern": tasking.manner.pattern,
                "drift_m_s": subareas.drift(tasking),
                "drift_toward_deg": np.degrees(subareas.toward(tasking)) % 360,
                "creep_deg": np.degrees(tasking.creep) % 360,
                "spacing_m": tasking.spacing,
                "legs": tasking.legs,
                "pos": tasking.pos,
                "pos_ashore": tasking.pos_ashore,
            }
            for name, tasking in zip(subareas.names(planned), planned.taskings, strict=True)
        ],
    }


def _at_sea(tasking: Tasking) -> str:
    """Return of a boat how far it goes by sea, and which of its legs are cut."""
    remarks = [
        f"{name.lower()} {way / NMI:.1f} nmi by sea, {straight / NMI:.1f} straight"
        for name, way, straight in subareas.by_sea(tasking)
    ]
    remarks += [f"legs {plan_text.listed(tasking.cut)} cut at the coast"] * bool(tasking.cut)
    return "".join(f", {words}" for words in remarks)


def _warnings(warnings: Sequence[str]) -> Facts:
    """Return warnings by number, where there are several."""
    return {
        f"warning {k}" if len(warnings) > 1 else "warning": text
        for k, text in enumerate(warnings, 1)
    }


def _search(numbers: dict[str, Any]) -> Facts:
    """Return what sorties and contacts came to."""
    facts: Facts = {}
    dead: set[str] = set()
    for update in numbers.get("search", {}).get("updates", ()):
        for name, share in update["posterior"].items():
            if (
                share == 0
                and name not in dead
                and numbers["scenario_weights"].get(name, ALIKE)["prior"] > 0
            ):
                dead.add(name)
                facts[f'note on "{name}"'] = (
                    f'{update["kind"]} "{update["name"]}" contradicts this scenario: nothing of it is left'
                )
        if update["kind"] == "sortie":
            facts[f'sortie "{update["name"]}"'] = (
                f"POS {notation.percent(update['pos']['all'])}{_ashore(update)}, so far {notation.percent(update['cumulative_pos']['all'])}"
            )
        else:
            facts[f'{update["kind"]} "{update["name"]}"'] = (
                f"{Count(update['ess_after']).words} after it, {update['ess_before']:,.0f} before{_filled(update)}"
            )
    for line in numbers.get("search", {}).get("lines", ()):
        facts[f'line "{line["name"]}"'] = (
            f"crossed with {notation.percent(line['probability']['all'])}"
        )
    return facts


def _filled(update: Mapping[str, Any]) -> str:
    """Return what became of the particles after a contact or silence, where they are placed again
    at contacts.
    """
    if update["filled"] == "contact":
        return f"; repopulated, {update['ess_resampled']:,.0f} of them effective"
    return "; the track is lost" if update["filled"] == "lost" else ""


def _ashore(update: dict[str, Any]) -> str:
    """Return which part of a POS is of what lies ashore, where it is worth telling."""
    part = update["pos_ashore"]["all"]
    return (
        f" ({notation.percent(part)} of it ashore)"
        if part >= ASHORE * update["pos"]["all"] and part >= 0.0005
        else ""
    )


def spill(numbers: dict[str, Any]) -> Facts:
    """Return how many objects ended how, which stretches get most and when, and what the finds say."""
    end, washup = numbers["outputs"][-1], numbers["spill"]
    facts = {"time": end["date_time_group"]}
    for fate, figure in washup["totals"].items():
        if figure["expected"] >= 0.05:
            facts[fate] = _number(figure)
    for place in washup["worst_stretches"][:WORST]:
        name = washup_tables.called(place["segment"], place["name"], place["position"])
        facts[f"{place['rank']} {name}"] = (
            f"{place['number_10']:.0f} to {place['number_90']:.0f} ashore (10 to 90 %), {place['expected']:.1f} on average, "
            f"at least one {notation.percent(place['probability'])}, the first about {_group(place['first_50'])}"
            f"{_near(place)}"
        )
    if dense := washup["densest_stretches"][:DENSEST]:
        facts["most per km"] = "; ".join(
            f"{washup_tables.called(place['segment'], place['name'], place['position'])} ({place['expected_per_km']:.2g} a km)"
            for place in dense
        )
    for find in washup["finds"]:
        unlikely = "unlikely: check it, or set false = 0.1" if find["odd"] else "not unusual"
        facts[f'find {find["number"]} "{find["name"]}"'] = (
            f"{find['stretch']}: chance of a find here was {notation.percent(find['probability_beforehand'])}, "
            f"{unlikely} ({notation.percent(find['tail'])} at places at most as likely); {verdict.ours(find)}"
        )
    if washup["silence"]:
        facts["assumed"] = washup["silence"]
    for patrol in washup["patrols"]:
        facts[f'patrol "{patrol["name"]}"'] = (
            f"{len(patrol['stretches'])} stretches, {patrol['length_km']:.0f} km of shoreline, finds "
            f"{notation.percent(patrol['detection'], 0)}"
        )
    counted = f"{washup['effective_worlds']:,.0f} of {washup['worlds']:,} are effective"
    rounds = len(washup["effective_worlds_by_round"])
    facts["worlds"] = counted + (
        f", resampled {rounds - 1} times around the finds" if rounds > 1 else ""
    )
    facts["errors"] = numbers["uncertainty"]["told"]
    facts |= _coast(numbers)
    facts |= _warnings(numbers["warnings"])
    for number, note in enumerate(washup["notes"], 1):
        facts[f"note {number}"] = note
    return facts | _lost(numbers)


def _near(place: dict[str, Any]) -> str:
    """Return the nearest town of a stretch that has no name of its own."""
    near = Near(place["near"], 1000 * place["near_km"], place["near_across_water"] == "yes")
    town = gazetteer.place_in_words(near) if place["position"] in place["name"] else ""
    return town and f", {town}"


def _number(figure: dict[str, float]) -> str:
    """Return a number of objects in words: the range over simulated spills first, then the mean and
    its own error.
    """
    low, high, mean = (figure[name] for name in ("number_10", "number_90", "expected"))
    span = (
        f"{low:.0f} to {high:.0f} objects" if high > low else f"{low:.0f} object{'s' * (low != 1)}"
    )
    if low == high and abs(mean - low) < 1e-9:
        return span
    return f"{span} (10 to 90 %), mean {mean:.1f} +- {figure['standard_error']:.2g} (sampling)"


def origin(release: dict[str, Any], warnings: Sequence[str] = ()) -> Facts:
    """Return where and when a spill may have been released, by a backward run."""
    facts = origin_text.origin_facts(release) | _warnings(warnings)
    facts["note"] = (
        "backward: proposes where to look; objects not found are left out. The answer is a forward run (drift run) "
        "with this release as its prior, weighted by all finds"
    )
    return facts


def _group(iso: str) -> str:
    """Return a time as files hold it, 2026-11-21T18:30:00Z, as a date-time group; "never" for NaT."""
    time = np.datetime64(iso.removesuffix("Z"))
    return "never" if np.isnat(time) else group(time)


def _coast(numbers: dict[str, Any]) -> Facts:
    """Return what the coast does, and what was done to the shoreline."""
    return {
        "coast": numbers["run"]["coast_behaviour"],
        **{f"coast, note {k}": note for k, note in enumerate(numbers["coast"]["notes"], 1)},
    }


def _lost(numbers: dict[str, Any]) -> Facts:
    lost = sum(numbers["account"][status] for status in ("outside", "left"))
    if lost <= WORTH_A_WARNING:
        return {}
    return {
        "lost": f"{notation.percent(lost)} of the probability ran out of forcing or left the domain; "
        "areas are shares of the rest"
    }
