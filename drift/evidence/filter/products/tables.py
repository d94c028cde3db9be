"""Effects of each sortie, contact and sensor as a table, as GeoJSON and as a summary."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from drift.evidence.filter import crossings
from drift.evidence.filter import shapes as search_shapes
from drift.evidence.filter.records import (
    NO_SENSORS,
    Barrier,
    Contact,
    Line,
    Look,
    Presence,
    Sensors,
    Sortie,
)
from drift.evidence.filter.updates import Update, Updates, merge_unlikely_scenarios
from drift.products.files import formats, geojson
from geo import notation
from geo.array import Array
from geo.notation import NMI

ALL = "all"


COLUMNS = (  # of sorties.csv
    *("update", "name", "kind", "status", "time", "date_time_group", "scenario", "pod", "poc"),
    *("pos", "pos_ashore", "pos_alive", "pos_cumulative", "log_evidence", "bayes_factor", "prior"),
    *("posterior", "ess_before", "ess_after", "resampled", "ess_resampled", "filled", "distinct"),
)


def csv(updates: Updates, run: str) -> str:
    """Return the CSV of updates: a row per update and scenario, and one for all together.

    `status` of a sortie is "flown" or "planned". `prior` and `posterior` are a scenario's
    probability before and after the update, `bayes_factor` its odds after over its odds before. A
    contact or a sensor has no POD, POC and POS. An empty value does not apply or is unknown.

    Args:
        updates: of the run.
        run: the run_id for the last column.
    """
    rows, status = [], _statuses(updates)
    for number, (update, before) in enumerate(steps(updates), 1):
        figures = {
            "pod": update.pod,
            "poc": update.poc,
            "pos": update.pos,
            "pos_ashore": update.ashore,
            "pos_alive": update.alive,
            "pos_cumulative": update.cumulative,
            "log_evidence": update.log_evidence,
        }
        factors = bayes_factors(update, before)
        for j, scenario in enumerate([*updates.scenarios, ALL]):
            single = j < len(updates.scenarios)
            rows.append(
                {
                    "update": number,
                    "name": update.name,
                    "kind": update.kind,
                    "status": status.get(update.name, "") if update.kind == "sortie" else "",
                    "time": update.time,
                    "date_time_group": notation.format_dtg(update.time),
                    "scenario": scenario,
                    **{key: None if v is None else v[j] for key, v in figures.items()},
                    "bayes_factor": factors[j] if single else None,
                    "prior": before[j] if single else 1.0,
                    "posterior": update.posterior[j] if single else 1.0,
                    "ess_before": update.ess_before,
                    "ess_after": update.ess_after,
                    "resampled": update.resampled,
                    "ess_resampled": update.ess_resampled,
                    "filled": update.filled,
                    "distinct": update.distinct,
                }
            )
    if not rows:  # sensor lines alone, which change no weight
        return formats.csv_text(COLUMNS, [], run=run)
    return formats.csv_rows(rows, run=run, digits=".8g")


def _statuses(updates: Updates) -> dict[str, str]:
    """Return "flown" or "planned" by the name of each sortie."""
    return {sortie.name: sortie.status for sortie in updates.sorties}


def steps(updates: Updates) -> list[tuple[Update, Array]]:
    """Return each update with the probability of each scenario before it."""
    before = [
        np.asarray(updates.prior, float),
        *(np.asarray(update.posterior, float) for update in updates.all),
    ]
    return list(zip(updates.all, before, strict=False))


def bayes_factors(update: Update, before: Array) -> Array:
    """Return the factors by which an update multiplied each scenario's odds, (scenarios,).

    The odds are those against all other scenarios together. The factor is P(evidence | scenario) /
    P(evidence | others), the others in proportion to `before`; NaN if there are no others.
    """
    log = np.asarray(update.log_evidence[:-1], float)
    top = log[before > 0].max(initial=-math.inf)
    like = (
        np.exp(np.where(before > 0, log - top, -math.inf))
        if math.isfinite(top)
        else np.zeros_like(before)
    )
    factors = np.full(len(before), np.nan)
    for j in range(len(before)):
        others = np.arange(len(before)) != j
        if not (before[j] > 0 and before[others].sum() > 0):
            continue
        rest = float(like[others] @ before[others] / before[others].sum())
        factors[j] = like[j] / rest if rest > 0 else (math.inf if like[j] > 0 else np.nan)
    return factors


def summary_of_search(updates: Updates) -> dict[str, Any]:
    """Return the search for the summary: all updates, and the status after them.

    With many scenarios, the figures of each update are those of the likeliest, and of all others
    together; the table of updates (`csv`) has all.
    """
    names, shown = updates.scenarios, merge_unlikely_scenarios(updates)
    done = [update for update in shown.all if update.cumulative is not None]
    last = updates.all[-1].posterior if updates.all else updates.prior
    return {
        "updates": [_update(shown, update, before) for update, before in steps(shown)],
        "sorties": sum(update.kind == "sortie" for update in updates.all),
        "contacts": sum(update.kind == "contact" for update in updates.all),
        "sensors": sum(update.kind not in ("sortie", "contact") for update in updates.all),
        "cumulative_pos": _by_scenario(shown.scenarios, done[-1].cumulative if done else None),
        "scenarios": {
            name: {"prior": float(updates.prior[j]), "posterior": float(last[j])}
            for j, name in enumerate(names)
        },
        "log_evidence": updates.log_evidence,
        "distinct": updates.all[-1].distinct if updates.all else 1.0,
        **(
            {"lines": crossings.summary_of_crossings(updates.crossings)}
            if updates.crossings
            else {}
        ),
    }


def _update(updates: Updates, update: Update, before: Array) -> dict[str, Any]:
    names = updates.scenarios
    row: dict[str, Any] = {
        "name": update.name,
        "kind": update.kind,
        "time": update.time,
        "date_time_group": notation.format_dtg(update.time),
        "log_evidence": _by_scenario(names, update.log_evidence),
        "bayes_factor": dict(zip(names, bayes_factors(update, before).tolist(), strict=True)),
        "posterior": dict(zip(names, np.asarray(update.posterior, float).tolist(), strict=True)),
        "ess_before": update.ess_before,
        "ess_after": update.ess_after,
        "resampled": update.resampled,
        "ess_resampled": update.ess_resampled,
        "filled": update.filled,
        "distinct": update.distinct,
    }
    if update.kind == "sortie":
        row |= {
            "status": _statuses(updates).get(update.name),
            "pod": _by_scenario(names, update.pod),
            "poc": _by_scenario(names, update.poc),
            "pos": _by_scenario(names, update.pos),
            "pos_ashore": _by_scenario(names, update.ashore),
            "pos_alive": _by_scenario(names, update.alive),
            "cumulative_pos": _by_scenario(names, update.cumulative),
        }
    return row


def _by_scenario(names: Sequence[str], values: Array | None) -> dict[str, Any] | None:
    """Return figures under "all" and, by name, under "scenarios".

    Two levels are needed because a scenario may be called "all".
    """
    if values is None:
        return None
    figures = [float(v) for v in values]
    return {ALL: figures[-1], "scenarios": dict(zip(names, figures[:-1], strict=True))}


def shapes(
    sorties: Sequence[Sortie],
    contacts: Sequence[Contact],
    updates: Updates,
    attributes: Mapping[str, Any],
    sensors: Sensors = NO_SENSORS,
) -> dict[str, Any]:
    """Return areas, legs, contacts, fields and lines as a GeoJSON FeatureCollection (RFC 7946).

    Shapes are cut at the antimeridian. With many scenarios, only the likeliest are named. The
    `shape` of a feature is: for a sortie "area" (at its start), "legs", "transit", "zones" (at its
    end) or "point" (of a fixed sensor); for a contact "point", "region" or "line"; for a look or
    presence "field"; for a barrier or line "line". Shapes that drift with a marker are over the
    ground if the marker's track is known.
    """
    updates, of_case = merge_unlikely_scenarios(updates), updates
    taken = {(update.kind, update.name): update for update in updates.all}
    features = []
    for sortie in sorties:
        widths = {
            n: w
            for n, w in zip(of_case.scenarios, sortie.sweep_width, strict=True)
            if n in updates.scenarios
        }
        properties = _sortie(sortie, taken.get(("sortie", sortie.name)), updates.scenarios, widths)
        if (ring := search_shapes.searched(sortie)) is not None:
            features.append(_feature(search_shapes.polygon([ring]), "area", properties))
        parts = search_shapes.flown(sortie)
        for shape, wanted in (("legs", True), ("transit", False)):
            some = [points for searching, points in parts if searching == wanted]
            if some and (geometry := search_shapes.lines(some))["coordinates"]:
                features.append(_feature(geometry, shape, properties))
            elif some:  # legs without length: a buoy
                features.append(_feature(search_shapes.point(*some[0][0]), "point", properties))
        if rings := search_shapes.zones(sortie, sortie.end):
            features.append(_feature(search_shapes.lines(rings), "zones", properties))
    for contact in contacts:
        update = taken.get(("contact", contact.name))
        properties = {
            "name": contact.name,
            "kind": "contact",
            "time": notation.iso(contact.time),
            "of": contact.kind,
            "belief": contact.belief,
            "log_evidence": _finite(update.log_evidence[-1]) if update else None,
        }
        for shape, points in search_shapes.contact(contact):
            if shape == "region":
                geometry = search_shapes.polygon([points])
            elif shape == "line":
                geometry = search_shapes.lines([points])
            else:
                geometry = geojson.point(*points[0])
            features.append(_feature(geometry, shape, properties))
    for what in (*sensors.telling, *sensors.lines):
        features.append(_sensor(what, updates))
    return geojson.collection(features, attributes)


def _sensor(what: Look | Presence | Barrier | Line, updates: Updates) -> dict[str, Any]:
    """Return the feature of a look, a presence, a barrier or a line."""
    kind = type(what).__name__.lower()
    properties: dict[str, Any] = {"name": what.name, "kind": kind}
    if isinstance(what, Look):
        properties |= {
            "time": notation.iso(what.time),
            "sees": "something" if what.positive else "nothing",
        }
    elif not isinstance(what, Line):
        properties |= {"start": notation.iso(what.start), "end": notation.iso(what.end)}
    if isinstance(what, Presence):
        properties["present"] = what.present
    if isinstance(what, Barrier):
        properties["reported"] = None if what.reported is None else notation.iso(what.reported)
    if isinstance(what, Line):
        crossed = updates.crossings.all if updates.crossings else ()
        properties["probability"] = next(
            (float(c.probability[-1]) for c in crossed if c.line == what), None
        )
    else:
        update = next((u for u in updates.all if (u.kind, u.name) == (kind, what.name)), None)
        properties["log_evidence"] = _finite(update.log_evidence[-1]) if update else None
    points = search_shapes.sensor(what)
    if isinstance(what, Look | Presence):
        return _feature(search_shapes.polygon([points]), "field", properties)
    return _feature(search_shapes.lines([points]), "line", properties)


def _feature(geometry: dict[str, Any], shape: str, properties: Mapping[str, Any]) -> dict[str, Any]:
    return geojson.feature(geometry, {"shape": shape, **properties})


def _sortie(
    sortie: Sortie, update: Update | None, scenarios: Sequence[str], widths: Mapping[str, float]
) -> dict[str, Any]:
    properties = {
        "name": sortie.name,
        "kind": "sortie",
        "status": sortie.status,
        "unit": sortie.kind,
        "start": notation.iso(sortie.start),
        "end": notation.iso(sortie.end),
        "law": sortie.law.kind,
        "frame": sortie.frame,
        "over_ground": sortie.frame == "ground" or sortie.marker is not None,
        "completed": sortie.completed,
        "sweep_width_nmi": {name: width / NMI for name, width in widths.items()},
    }
    for name, values in (
        () if update is None else (("pod", update.pod), ("poc", update.poc), ("pos", update.pos))
    ):
        properties[name] = None if values is None else _finite(values[-1])
        properties[f"{name}_by_scenario"] = (
            None if values is None else dict(zip(scenarios, map(_finite, values[:-1]), strict=True))
        )
    return properties


def _finite(value: Any) -> float | None:
    return float(value) if np.isfinite(value) else None
