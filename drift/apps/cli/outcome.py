"""Terminal summaries of runs and plans: short facts by name, in reading order."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from drift.forecast import likeliest
from drift.forecast.effective import Count
from drift.products.maps import gazetteer
from drift.products.maps.gazetteer import Near
from drift.spills.backtrack import text as origin_text
from drift.spills.worlds import verdict
from drift.spills.worlds.products import tables as washup_tables
from geo import notation
from geo.notation import KNOT, format_dtg

WORTH_A_WARNING = 0.01  # share of lost probability above which a line reports it
ASHORE = 0.01  # share of a POS due to stranded particles above which it is reported separately
WORST = 5  # stretches of coast that are listed
LIKELIEST = 3  # values listed for each axis of a scenario family
DENSEST = 3  # stretches listed by objects per km


NO_PRIOR = {"prior": 0.0}  # for a name that stands for many scenarios together

Facts = dict[str, str]


def forecast(numbers: dict[str, Any]) -> Facts:
    """Return the state at the end of the run as facts: positions, areas, statuses, evidence.

    numbers: the content of summary.json.
    """
    end = numbers["outputs"][-1]
    # warnings come before the areas that they qualify
    facts = {"time": end["date_time_group"]} | _warnings(numbers["warnings"])
    moving = [name for name in ("adrift", "under_way") if end["probability"].get(name, 0.0) > 0]
    afloat = " or ".join(name.replace("_", " ") for name in moving) or "adrift"
    for name, key in (("mean position", "mean"), (f"datum (mean of those {afloat})", "datum")):
        if end[key]:
            facts[name] = end[key]["text"]
    facts |= {f"{share} area": size for share, size in _areas(end).items()} | _opening(numbers)
    for status, share in numbers["account"].items():
        if share > 0:
            facts[status.replace("_", " ")] = notation.percent(share)
    facts |= _states(numbers)
    facts |= {"errors": errors} if (errors := numbers["uncertainty"]["told"]) else {}
    facts |= _search(numbers) | _guided(numbers) | _drifters(numbers) | _reports(numbers)
    facts |= _lost(numbers)
    facts |= _coast(numbers)
    facts |= {"members": _members(numbers["members"])} if "members" in numbers else {}
    facts |= _scenarios(numbers["scenario_weights"])
    return facts | _by_axis(numbers["stories"]) if "stories" in numbers else facts


def _states(numbers: dict[str, Any]) -> Facts:
    """Return what has become of the objects, by scenario; nothing if none changes."""
    return {
        f'states of "{name}"': ", ".join(
            f"{state} {notation.percent(share)}" for state, share in own.items()
        )
        for name, own in numbers.get("states", {}).items()
    }


def _guided(numbers: dict[str, Any]) -> Facts:
    """Return the contacts toward which the particles were guided; nothing without guidance."""
    if "guide" not in numbers:
        return {}
    finds = ", ".join(f'"{name}"' for name in numbers["guide"]["finds"])
    share = 1 - numbers["guide"]["prior_share"]
    return {
        "guided": f"{notation.percent(share, 0)} of the particles, toward contact {finds}; weights account for it"
    }


def _drifters(numbers: dict[str, Any]) -> Facts:
    """Return what each drifting buoy showed, and the areas without; nothing without buoys."""
    if "drifters" not in numbers:
        return {}
    found, facts = numbers["drifters"], {}
    for number, own in enumerate(found["buoys"], 1):
        text = (
            f'"{own["name"]}": {own["displacements"]} displacements, until {notation.format_dtg(own["last_fix"])}; the current there differed from that of the case by '
            f"{own['excess_m_s'] / KNOT:.2f} kn toward {notation.bearing(round(own['excess_toward_deg']))}"
        )
        if without := own.get("area_nmi2_without_it"):
            text += f"; areas without it: {_listed_areas(without)}"
        facts[f"drifter {number}"] = text
    if "area_nmi2" in found:
        both = found["area_nmi2"]
        facts["areas by drifters"] = (
            f"before any search, with them {_listed_areas(both['with'])}; without {_listed_areas(both['without'])}"
        )
    return facts | {f"drifters, note {k}": note for k, note in enumerate(found["notes"], 1)}


def _reports(numbers: dict[str, Any]) -> Facts:
    """Return what each report on scene showed and changed, and the areas without; nothing without
    reports.
    """
    if "reports" not in numbers:
        return {}
    found, facts = numbers["reports"], {}
    for number, own in enumerate(found["reports"], 1):
        text = f'"{own["name"]}": {own["text"]}'
        if without := own.get("area_nmi2_without_it"):
            text += f"; areas without it: {_listed_areas(without)}{_shifted(own)}"
        facts[f"report {number}"] = text
    if "area_nmi2" in found:
        both = found["area_nmi2"]
        facts["areas by reports"] = (
            f"before any search, with them {_listed_areas(both['with'])}; without {_listed_areas(both['without'])}{_shifted(found)}"
        )
    return facts


def _shifted(own: dict[str, Any]) -> str:
    """Return how far reports moved the mean position."""
    if "shift_nmi" not in own:
        return ""
    toward = notation.bearing(round(own["shift_toward_deg"]))
    return f"; the mean position moved by {own['shift_nmi']:.1f} nmi toward {toward}"


def _listed_areas(areas: dict[str, float]) -> str:
    """Return areas by share in one line."""
    return ", ".join(f"{share} {area:,.0f}" for share, area in areas.items()) + " nmi2"


def _areas(output: dict[str, Any]) -> Facts:
    """Return the containment areas of an output as text, by their shares."""
    return {
        share: f"{_rounded(area)} nmi2" if area == area else "none"
        for share, area in output["area_nmi2"].items()
    }


def _opened(numbers: dict[str, Any]) -> dict[str, Any]:
    """Return the output that the map and the report show when they are opened."""
    return next(output for output in numbers["outputs"] if output["time"] == numbers["opens"])


def _rounded(area: float) -> str:
    """Return an area in whole units, or to three digits below ten: a stretch of coast is small."""
    return f"{area:,.0f}" if area >= 10 else f"{area:.3g}"


def _opening(numbers: dict[str, Any]) -> Facts:
    """Return the time that the map and the report show first, with its areas; {} for the end."""
    opened = _opened(numbers)
    if opened is numbers["outputs"][-1]:
        return {}
    areas = ", ".join(f"{share} {area}" for share, area in _areas(opened).items())
    return {"map.png, report.html": f"open at {opened['date_time_group']}, areas then: {areas}"}


def summary_of_outcome(last: dict[str, Any]) -> dict[str, Any]:
    """Return the same facts for programs: positions in degrees, everything else in SI units.

    last: the content of summary.json, which has more.
    """
    end, opened, run = last["outputs"][-1], _opened(last), last["run"]
    summary = {
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
        summary["members"] = last["members"]
    if "search" in last:
        summary["sorties"] = [
            {
                "name": update["name"],
                "pos": update["pos"]["all"],
                "cumulative_pos": update["cumulative_pos"]["all"],
            }
            for update in last["search"]["updates"]
            if update["kind"] == "sortie"
        ]
    if "spill" in last:
        summary |= {
            key: last["spill"][key]
            for key in ("totals", "worst_stretches", "effective_worlds", "finds", "silence")
        }
    return summary


def _square_metres(output: dict[str, Any]) -> dict[str, float]:
    """Return the containment areas of an output [m2] by their shares."""
    return {share: 1e6 * area for share, area in output["area_km2"].items()}


def _members(members: dict[str, Any]) -> str:
    """Return the number of ensemble members of the forcing, and which the evidence favours."""
    weights = {name: weight["posterior"] for name, weight in members["weights"].items()}
    if members["effective"] > 0.999 * members["number"]:
        return f"{members['number']}, all equally likely"
    first = sorted(weights, key=lambda name: -weights[name])[:3]
    likeliest = ", ".join(f"{name} {notation.percent(weights[name])}" for name in first)
    return f"{members['number']}, of which {members['effective']:.1f} are effective after all observations; likeliest {likeliest}"


def _scenarios(scenarios: dict[str, Any]) -> Facts:
    """Return the probability of each scenario; of many, the likeliest and the sum of the rest."""
    facts: Facts = {}
    table = np.array(
        [[scenario[key] for scenario in scenarios.values()] for key in ("prior", "posterior")],
        float,
    )
    shown = likeliest.likeliest_scenarios(table)
    names = list(scenarios)
    for name, scenario in ((names[k], scenarios[names[k]]) for k in shown.alone):
        remarks = (
            [
                f"{notation.percent(scenario['posterior'])} (before: "
                f"{notation.percent(scenario['prior'])})"
            ]
            if len(scenarios) > 1
            else []
        )
        if scenario["prior_on_land"] > 0:
            remarks.append(
                f"{notation.percent(scenario['prior_on_land'])} of its starting positions were "
                "on land and ignored"
            )
        if remarks:
            facts[f'scenario "{name}"'] = "; ".join(remarks)
    if shown.rest:
        prior, posterior = shown.sums(table)[:, -1]
        facts[shown.names(names)[-1]] = (
            f"{notation.percent(posterior)} (before: {notation.percent(prior)}); see summary.json"
        )
    return facts


def _by_axis(families: dict[str, Any]) -> Facts:
    """Return the likeliest values on each axis of scenario families, and effective scenarios.

    The result is empty without families.
    """
    facts: Facts = {}
    for axis, values in families["axes"].items():
        first = sorted(values, key=lambda label: -values[label]["posterior"])[:LIKELIEST]
        parts = [
            f"{label} {notation.percent(values[label]['posterior'])} (before: {notation.percent(values[label]['prior'])})"
            for label in first
        ]
        facts[f"scenarios by {axis}"] = ", ".join(parts)
    if facts:
        before, now = (families["effective"][key] for key in ("prior", "posterior"))
        facts["effective scenarios"] = f"{now:.3g} of {families['number']:,} (before: {before:.3g})"
    return facts


def _warnings(warnings: Sequence[str]) -> Facts:
    """Return warnings as facts, numbered if there are several."""
    return {
        f"warning {k}" if len(warnings) > 1 else "warning": text
        for k, text in enumerate(warnings, 1)
    }


def _search(numbers: dict[str, Any]) -> Facts:
    """Return the POS of each sortie, the effect of each contact, and line crossings."""
    facts: Facts = {}
    contradicted: set[str] = set()
    for update in numbers.get("search", {}).get("updates", ()):
        for name, share in update["posterior"].items():
            if (
                share == 0
                and name not in contradicted
                and numbers["scenario_weights"].get(name, NO_PRIOR)["prior"] > 0
            ):
                contradicted.add(name)
                facts[f'note on "{name}"'] = (
                    f'{update["kind"]} "{update["name"]}" contradicts this scenario: its '
                    "posterior probability is 0"
                )
        if update["kind"] == "sortie":
            facts[f'sortie "{update["name"]}"'] = (
                f"POS {notation.percent(update['pos']['all'])}{_ashore(update)}, so far {notation.percent(update['cumulative_pos']['all'])}"
            )
        else:
            facts[f'{update["kind"]} "{update["name"]}"'] = (
                f"{Count(update['ess_after']).words} after it, {update['ess_before']:,.0f} "
                f"before{_repopulation(update)}"
            )
    for line in numbers.get("search", {}).get("lines", ()):
        facts[f'line "{line["name"]}"'] = (
            f"crossed with {notation.percent(line['probability']['all'])}"
        )
    return facts


def _repopulation(update: Mapping[str, Any]) -> str:
    """Return whether particles were repopulated or the track was lost after an update."""
    if update["filled"] == "contact":
        return f"; repopulated, {update['ess_resampled']:,.0f} of them effective"
    return "; the track is lost" if update["filled"] == "lost" else ""


def _ashore(update: dict[str, Any]) -> str:
    """Return the share of a POS that is due to stranded particles, if it is large enough."""
    part = update["pos_ashore"]["all"]
    return (
        f" ({notation.percent(part)} of it ashore)"
        if part >= ASHORE * update["pos"]["all"] and part >= 0.0005
        else ""
    )


def spill(numbers: dict[str, Any]) -> Facts:
    """Return a spill's objects by fate, its worst stretches and when, and the evidence of finds."""
    end, washup = numbers["outputs"][-1], numbers["spill"]
    facts = {"time": end["date_time_group"]}
    for fate, figure in washup["totals"].items():
        if figure["expected"] >= 0.05:
            facts[fate] = _number(figure)
    for place in washup["worst_stretches"][:WORST]:
        name = washup_tables.stretch_name(place["segment"], place["name"], place["position"])
        facts[f"{place['rank']} {name}"] = (
            f"{place['number_10']:.0f} to {place['number_90']:.0f} ashore (10 to 90 %), {place['expected']:.1f} on average, "
            f"at least one {notation.percent(place['probability'])}, the first about {_group(place['first_50'])}"
            f"{_near(place)}"
        )
    if dense := washup["densest_stretches"][:DENSEST]:
        facts["most per km"] = "; ".join(
            f"{washup_tables.stretch_name(place['segment'], place['name'], place['position'])} ({place['expected_per_km']:.2g} a km)"
            for place in dense
        )
    for find in washup["finds"]:
        unlikely = "unlikely: check it, or set false = 0.1" if find["odd"] else "not unusual"
        facts[f'find {find["number"]} "{find["name"]}"'] = (
            f"{find['stretch']}: chance of a find here was {notation.percent(find['probability_beforehand'])}, "
            f"{unlikely} ({notation.percent(find['tail'])} here or at less likely places); {verdict.false_find_in_words(find)}"
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
        f", resampled {'once' if rounds == 2 else f'{rounds - 1} times'} around the finds"
        if rounds > 1
        else ""
    )
    facts["errors"] = numbers["uncertainty"]["told"]
    facts |= _coast(numbers)
    facts |= _warnings(numbers["warnings"])
    for number, note in enumerate(washup["notes"], 1):
        facts[f"note {number}"] = note
    return facts | _lost(numbers)


def _near(place: dict[str, Any]) -> str:
    """Return the nearest town to a stretch that has no name of its own; "" otherwise."""
    near = Near(place["near"], 1000 * place["near_km"], place["near_across_water"] == "yes")
    town = gazetteer.place_in_words(near) if place["position"] in place["name"] else ""
    return town and f", {town}"


def _number(figure: dict[str, float]) -> str:
    """Return a number of objects as text: 10 to 90 % range over spills, mean, sampling error."""
    low, high, mean = (figure[name] for name in ("number_10", "number_90", "expected"))
    span = (
        f"{low:.0f} to {high:.0f} objects" if high > low else f"{low:.0f} object{'s' * (low != 1)}"
    )
    if low == high and abs(mean - low) < 1e-9:
        return span
    return f"{span} (10 to 90 %), mean {mean:.1f} +- {figure['standard_error']:.2g} (sampling)"


def origin(release: dict[str, Any], warnings: Sequence[str] = ()) -> Facts:
    """Return where and when a spill may have been released, from a backward run."""
    facts = origin_text.origin_facts(release) | _warnings(warnings)
    facts["note"] = (
        "backtrack: proposes places to look at; it does not use objects that were not found. Confirm it with a "
        "forward run (drift run) "
        "with this release as its prior, weighted by all finds"
    )
    return facts


def _group(iso: str) -> str:
    """Return an ISO time of a results file as a date-time group; "never" for NaT."""
    time = np.datetime64(iso.removesuffix("Z"))
    return "never" if np.isnat(time) else format_dtg(time)


def _coast(numbers: dict[str, Any]) -> Facts:
    """Return the behaviour at the coast, and notes on the shoreline."""
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
