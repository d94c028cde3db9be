"""How much the drifting buoys of a case changed its forecast: residuals, and areas without them.

The areas are those of small forecasts before any search, on common random numbers: with all buoys,
with none, and without each.
"""

from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from drift.case.record import Case
from drift.engine.environment.environment import Environment
from drift.engine.motion import scene, simulate
from drift.engine.motion.buoys import Buoys, BuoyTrack
from drift.engine.motion.spool import SnapshotStore
from drift.evidence.filter.records import Sensors
from drift.forecast import build
from drift.pipeline import run_setup
from drift.products.files.chapter import OutputBundle
from drift.products.maps.marks import Line, Mark
from drift.products.report import leaves
from geo import notation
from geo.array import Array
from geo.notation import KNOT, NMI

PARTICLES = 20_000  # of each small forecast
MOST_LEFT_OUT = 4  # buoys up to which there is a forecast without each


def summary_of_buoys(case: Case, where: Environment, buoys: Buoys) -> dict[str, Any]:
    """Return what each buoy showed, and the containment areas [nmi2] with and without them.

    Args:
        case: of the run.
        where: its environment.
        buoys: its conditioned errors.

    Returns:
        For summary.json: `buoys`, a table for each; `particles` of the small forecasts; and
        `area_nmi2` by share at the end, `with` and `without` all buoys. A spill has no areas.
    """
    shown = [_seen_by(case, buoys, number) for number in range(len(buoys.names))]
    found: dict[str, Any] = {"buoys": shown, "notes": [*_notes(case)]}
    if case.spill:
        return found
    small = min(case.particles, PARTICLES)
    found["particles"] = small
    found["area_nmi2"] = {
        "with": _areas(case, where, case.drifters, small),
        "without": _areas(case, where, (), small),
    }
    if 1 < len(shown) <= MOST_LEFT_OUT:
        for number, own in enumerate(shown):
            rest = case.drifters[:number] + case.drifters[number + 1 :]
            own["area_nmi2_without_it"] = _areas(case, where, rest, small)
    return found


def buoys_bundle(found: Mapping[str, Any], buoys: Sequence[BuoyTrack]) -> OutputBundle:
    """Return the report's layer and table of drifting buoys; found: of `summary_of_buoys`."""
    return OutputBundle(leaves=(partial(_leaves, found, buoys),))


def _leaves(found: Mapping[str, Any], buoys: Sequence[BuoyTrack]) -> list[Any]:
    """Return a layer of the buoys' tracks, and a table of what each showed."""
    tracks = [Line(own.lon.tolist(), own.lat.tolist(), "") for own in buoys]
    last = [Mark(float(own.lon[-1]), float(own.lat[-1]), own.name) for own in buoys]
    areas = found.get("area_nmi2", {})
    rows = [
        [
            own["name"],
            own["displacements"],
            notation.format_dtg(own["last_fix"]),
            f"{own['excess_m_s'] / KNOT:.2f} kn toward {notation.bearing(own['excess_toward_deg'])}",
            _listed(own.get("area_nmi2_without_it", areas.get("without", {}))),
        ]
        for own in found["buoys"]
    ]
    columns = [
        ("name", "Buoy", "words"),
        ("displacements", "Displacements", "count"),
        ("last_fix", "Until", "words"),
        ("excess", "Current beyond the forcing", "words"),
        ("without", "Areas without it [nmi2]", "words"),
    ]
    note = " ".join(
        [
            *(
                [f"Areas with all buoys, before any search: {_listed(areas['with'])} nmi2."]
                if areas
                else []
            ),
            *found["notes"],
        ]
    )
    return [
        leaves.marks_leaf("Drifting buoys", last, tracks, "buoy"),
        leaves.table_leaf("Drifting buoys", columns, rows=rows, note=note, unfolded=True),
    ]


def _listed(areas: Mapping[str, float]) -> str:
    """Return areas by share in one line."""
    return ", ".join(f"{share} {area:,.0f}" for share, area in areas.items())


def _seen_by(case: Case, buoys: Buoys, number: int) -> dict[str, Any]:
    """Return the mean error that one buoy shows, and when it was seen."""
    own = case.drifters[number]
    excess = _mean_excess(case, buoys, number)
    return {
        "name": own.name,
        "fixes": int(own.time.size),
        "displacements": int((~own.fresh).sum()),
        "first_fix": str(np.datetime64(int(own.time[0]), "s")),
        "last_fix": str(np.datetime64(int(own.time[-1]), "s")),
        "excess_m_s": float(np.hypot(*excess)),
        "excess_toward_deg": float(np.degrees(np.arctan2(*excess)) % 360),
    }


def _mean_excess(case: Case, buoys: Buoys, number: int) -> Array:
    """Return the mean velocity (east, north) [m/s] at a buoy beyond the likeliest forcing, while it
    was seen.
    """
    own, law = case.drifters[number], buoys.law
    m = len(buoys.names)
    likeliest = int(np.argmax(buoys.given.log_likelihood))
    states = buoys.given.means[:-1, likeliest]  # (steps, states, 2)
    begins = notation.epoch(case.start) + buoys.edges[:-1]
    seen = np.flatnonzero((begins >= own.time[0]) & (begins <= own.time[-1]))
    if not seen.size:
        seen = np.argmin(np.abs(begins - own.time[0]), keepdims=True)
    total = law.current_std * states[seen, number]
    if law.biased:
        total = total + law.bias_std * states[seen, m * (1 + int(buoys.windy)) + number]
    return np.asarray(total.mean(axis=0))


def _areas(case: Case, where: Environment, drifters: Any, particles: int) -> dict[str, float]:
    """Return the containment areas [nmi2] at the end of a small forecast, by share."""
    small = replace(
        case,
        drifters=tuple(drifters),
        particles=particles,
        counts=None,
        sorties=(),
        contacts=(),
        sensors=Sensors(),
        units=(),
        outputs=case.outputs[-1:],
    )
    begin = run_setup.prepare(small, where)
    outputs = small.period.seconds(small.outputs)
    with closing(begin.scene.forcing):
        moments = simulate.run(begin.ensemble, begin.scene, begin.clock, outputs)
        snapshots = SnapshotStore.of_run(small.period, begin.ensemble, moments, len(outputs))
    with snapshots:
        forecast = build.build_forecast(
            snapshots.outputs,
            scenarios=[scenario.name for scenario in small.scenarios],
            is_land=scene.land_of(begin.scene),
            shares=small.areas,
            grid=None,
        )
    areas = forecast.data["containment_area"].values[-1] / NMI**2
    return {
        f"{notation.hundredths(share)}%": float(area)
        for share, area in zip(small.areas, areas, strict=True)
    }


def _notes(case: Case) -> list[str]:
    """Return what was left out of the tracks."""
    return [f'drifter "{own.name}": {note}' for own in case.drifters for note in own.notes]
