"""The pictures of a run: what is drawn on them comes from the case, its environment and its forecast."""

import warnings
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from drift import summary
from drift.backtrack.backward import Origin
from drift.case.record import Case
from drift.forecast.build import Forecast
from drift.motion import forcing_error
from drift.motion.environment import Environment
from drift.motion.scenario import AreaPrior, PositionPrior
from drift.output import formats
from drift.patrols import planner as patrol_planner
from drift.patrols.planner import PatrolPlan
from drift.planner import fleet
from drift.planner.records import Plan
from drift.search.updates import Updates
from drift.spill import renewal
from drift.spill.renewal import Aftermath
from drift.suspend.decision import Suspension
from geo import notation

Figure = Callable[[Path], None]


def figures(
    case: Case,
    where: Environment,
    forecast: Forecast,
    footer: str,
    after: Aftermath | None = None,
    updates: Updates | None = None,
    plan: Plan | None = None,
    told: Suspension | None = None,
    planned: PatrolPlan | None = None,
) -> dict[str, Figure]:
    """Return, by file name, what draws each picture to a path."""
    from drift.forecast import layers
    from drift.forecast import map as forecast_map
    from drift.planner import map as plan_map
    from drift.planner import unit_sheet
    from drift.search import evidence_map
    from drift.search import map as search_map
    from drift.spill import map as washup_map
    from drift.suspend import map as suspend_map

    attributes = summary.attributes(case, where)
    known_as, short = ("Position at start", "start") if case.direction < 0 else ("Last known position", "LKP")
    marks, lines = [], []
    stories = case.scenarios
    if case.spill:  # its classes of objects were released together
        known_as, short, stories = "Release", "release", (replace(case.scenarios[0], name="release"),)
    for scenario in stories:
        prior = scenario.prior
        alone = len(stories) == 1
        if isinstance(prior, PositionPrior):
            label = known_as if alone else f"{short}, {scenario.name}"
            marks.append(forecast_map.Mark(float(np.degrees(prior.lon)), float(np.degrees(prior.lat)), label))
        else:
            lon = np.degrees(np.unwrap(prior.lon)).tolist()
            closed = isinstance(prior, AreaPrior)
            lines.append(forecast_map.Line(lon, np.degrees(prior.lat).tolist(), scenario.name, closed=closed))
    coast = where.coast.polygons if where.coast is not None else None
    common: dict[str, Any] = {
        "title": case.title if plan is None else f"If this plan finds nothing: {case.title}",
        "polygons": () if coast is None else coast,
        "marks": marks,
        "particles": case.particles,
        "footer": footer,
        "attributes": {**attributes, "run_id": formats.run_id(attributes)},
        "caution": caution(case),
    }
    drawn = {
        "map.png": _kept(
            partial(
                forecast_map.draw_map,
                forecast,
                lines=lines,
                known_as=known_as,
                searched=updates.sorties if updates else (),
                contacts=case.contacts,
                **common,
            )
        ),
        "snapshots.png": _kept(partial(forecast_map.draw_snapshots, forecast, **common)),
    }
    if after is not None:
        rest = {name: value for name, value in common.items() if name != "particles"}
        numbered = enumerate(after.posterior.known.finds, 1)
        found = [layers.Mark(*renewal.position(after, find), f"{k}") for k, find in numbered]
        walked = [
            washup_map.Patrolled(told["name"], told["time"], told["detection"], told["segments"])
            for told in renewal.patrols(after.spill, after.segments)
        ]
        rest |= {"finds": found, "patrols": walked, "warning": renewal.warning(after)}
        drawn["washup.png"] = _kept(partial(washup_map.draw, after.washup, after.segments, **rest))
        if planned is not None:
            rest["patrols"] = [
                washup_map.Patrolled(
                    slot.team.name, slot.when, slot.team.detection, [visit.segment for visit in visits]
                )
                for slot, visits in patrol_planner.by_patrol(planned)
            ]
            rest |= {"title": f"Planned patrols: {case.title}", "patrolled": "planned patrol", "near": True}
            drawn["patrols.png"] = _kept(partial(washup_map.draw, after.washup, after.segments, **rest))
    if updates is not None:
        bare = {name: common[name] for name in ("title", "particles", "footer", "attributes", "caution")}
        drawn["evidence.png"] = _kept(partial(evidence_map.draw, updates, **bare))
        # A plan's forecast has no outputs at the times of its sorties: plan.png shows them.
        for page in range(1, 1 + (search_map.pages(updates.sorties) if plan is None else 0)):
            name = "search.png" if page == 1 else f"search-{page}.png"
            drawing = partial(search_map.draw, forecast, updates.sorties, case.contacts, updates, page=page, **common)
            drawn[name] = _kept(drawing)
    if plan is not None:
        drawn["plan.png"] = _kept(partial(plan_map.draw, forecast, plan, **{**common, "title": case.title}))
        land = fleet.shown(case, where, unit_sheet.box(plan)) if coast is not None and plan.taskings else ()
        shown = {name: common[name] for name in ("footer", "attributes", "caution")}
        for name, which, number in unit_sheet.pages(plan):
            sheet = partial(unit_sheet.draw, plan, which, number=number, title=case.title, polygons=land, **shown)
            drawn[name] = _kept(sheet)
    if told is not None:
        bare = {name: common[name] for name in ("footer", "attributes", "caution")}
        drawn["suspend.png"] = _kept(partial(suspend_map.draw, told, title=case.title, **bare))
    return drawn


def synthetic(case: Case) -> bool:
    """Whether winds or currents are made up."""
    return any(spec.analytic is not None for spec in (*case.currents, *case.winds, *case.stokes))


def caution(case: Case) -> str:
    """Return what stands on a banner of every picture: made up winds or currents, else errors that were switched off."""
    if synthetic(case):
        return "SYNTHETIC wind or current: not for operations"
    felt = any(scenario.object.uses_wind for scenario in case.scenarios)
    return forcing_error.switched_off(case.current_error, case.wind_error if felt else None)


def origin(case: Case, where: Environment, found: Origin, footer: str) -> dict[str, Figure]:
    """Return, by file name, what draws where a spill may have come from."""
    from drift.backtrack import map as origin_map
    from drift.forecast import layers

    assert case.spill is not None
    attributes = summary.attributes(case, where)
    marks = [
        layers.Mark(find.lon, find.lat, f"{k} {find.name}, {notation.group(find.time)[:6]}Z")
        for k, find in enumerate(case.spill.finds, 1)
        if find.lat == find.lat  # a stretch by name has no place of its own
    ]
    draw = partial(
        origin_map.draw,
        found,
        title=case.title,
        polygons=where.coast.polygons if where.coast is not None else (),
        marks=marks,
        footer=footer,
        attributes={**attributes, "run_id": formats.run_id(attributes)},
        caution=caution(case),
    )
    return {"origin.png": _kept(draw)}


def _kept(draw: Figure) -> Figure:
    """Return a drawing that, where it fails, costs its own picture only: hours of forecast hang on the other files."""

    def attempt(path: Path) -> None:
        import matplotlib

        try:
            with matplotlib.rc_context({"text.parse_math": False}):  # a "$" in a name is no formula
                draw(path)
        except (ArithmeticError, LookupError, StopIteration, TypeError, ValueError) as error:
            path.unlink(missing_ok=True)
            warnings.warn(f"{path.name} could not be drawn ({error}); all other files are complete", stacklevel=2)

    return attempt
