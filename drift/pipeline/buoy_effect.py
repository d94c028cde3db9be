"""How much buoys and reports on scene changed a forecast: residuals, and areas without them.

The areas are those of small forecasts before any search, on common random numbers: with all buoys
and reports, without any buoy or any report, and without each.
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
from drift.engine.motion.errors.buoys import Buoys, BuoyTrack
from drift.engine.motion.spool import SnapshotStore
from drift.evidence.filter.records import Sensors
from drift.forecast import build
from drift.pipeline import run_setup
from drift.products.files.chapter import OutputBundle
from drift.products.maps.marks import Line, Mark
from drift.products.report import leaves
from geo import notation, sphere
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
        For summary.json: `buoys`, a table for each, and `areas_without`.
    """
    shown = [_seen_by(case, buoys, number) for number in range(len(buoys.names))]
    found: dict[str, Any] = {"buoys": shown, "notes": [*_notes(case)]}
    return found | areas_without(case, where, "drifters", shown)


def areas_without(
    case: Case, where: Environment, key: str, shown: Sequence[dict[str, Any]]
) -> dict[str, Any]:
    """Return areas with and without buoys or reports, and how far these moved the mean position.

    Those without each are added to its table.

    Args:
        case: of the run.
        where: its environment.
        key: "drifters" or "reports".
        shown: the table of each.

    Returns:
        `particles` of the small forecasts, `area_nmi2` by share at the end, `with` and `without`
        all of them, and the shift of the mean by all. A spill has none of it.
    """
    if case.spill:
        return {}

    def forecast_with(left: tuple[Any, ...]) -> tuple[dict[str, float], Array]:
        changed: dict[str, Any] = {key: left}
        return _forecast_end(replace(case, **changed), where)

    every = getattr(case, key)
    (areas, mean), (areas_of_none, mean_of_none) = forecast_with(every), forecast_with(())
    found: dict[str, Any] = {"particles": min(case.particles, PARTICLES)}
    found["area_nmi2"] = {"with": areas, "without": areas_of_none}
    found |= _shift(mean_of_none, mean)
    if 1 < len(shown) <= MOST_LEFT_OUT:
        for number, own in enumerate(shown):
            own["area_nmi2_without_it"], mean_of_rest = forecast_with(
                every[:number] + every[number + 1 :]
            )
            own |= _shift(mean_of_rest, mean)
    return found


def _shift(before: Array, after: Array) -> dict[str, float]:
    """Return how far, and in which direction, the mean position (lon, lat) [rad] was moved."""
    if not np.isfinite([before, after]).all():
        return {}
    east, north = sphere.offset(*before, *after)
    toward = float(np.degrees(np.arctan2(east, north)) % 360)
    return {"shift_nmi": float(np.hypot(east, north) / NMI), "shift_toward_deg": toward}


def shift_in_words(own: Mapping[str, Any]) -> str:
    """Return the shift of the mean position by buoys or reports; own: the table that holds it."""
    if "shift_nmi" not in own:
        return ""
    toward = notation.bearing(round(own["shift_toward_deg"]))
    return f"{own['shift_nmi']:.1f} nmi toward {toward}"


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
            f"{own['excess_m_s'] / KNOT:.2f} kn toward {notation.bearing(round(own['excess_toward_deg']))}",
            listed_areas(own.get("area_nmi2_without_it", areas.get("without", {}))),
        ]
        for own in found["buoys"]
    ]
    columns = [
        ("name", "Buoy", "words"),
        ("displacements", "Displacements", "count"),
        ("last_fix", "Until", "words"),
        ("excess", "Its current less that of the case", "words"),
        ("without", "Areas without it [nmi2]", "words"),
    ]
    note = " ".join(
        [
            *(
                [f"Areas with all buoys, before any search: {listed_areas(areas['with'])} nmi2."]
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


def listed_areas(areas: Mapping[str, float]) -> str:
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
    own = case.drifters[number]
    likeliest = int(np.argmax(buoys.given.log_likelihood))
    begins = notation.epoch(case.start) + buoys.edges[:-1]
    seen = np.flatnonzero((begins >= own.time[0]) & (begins <= own.time[-1]))
    if not seen.size:
        seen = np.argmin(np.abs(begins - own.time[0]), keepdims=True)
    states = buoys.given.means[seen, likeliest]  # (steps, states, 2)
    return np.asarray(buoys.parts(number, of_wind=False) @ states.mean(axis=0))


def _forecast_end(case: Case, where: Environment) -> tuple[dict[str, float], Array]:
    """Return the containment areas [nmi2] at the end of a small forecast, by share, and the mean
    position (lon, lat) [rad] there.
    """
    small = replace(
        case,
        particles=min(case.particles, PARTICLES),
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
    mean = np.radians([forecast.data[f"mean_{axis}"].values[-1] for axis in ("lon", "lat")])
    by_share = {
        f"{notation.hundredths(share)}%": float(area)
        for share, area in zip(small.areas, areas, strict=True)
    }
    return by_share, mean


def _notes(case: Case) -> list[str]:
    """Return what was left out of the tracks."""
    return [f'drifter "{own.name}": {note}' for own in case.drifters for note in own.notes]
