"""The outputs of a forecast: maps by time, tracks of a subsample, tables, GIS shapes and
pictures.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from drift.forecast import mapped
from drift.forecast import tracks as forecast_tracks
from drift.forecast.build import Forecast
from drift.forecast.products import tables
from drift.forecast.tracks import Trajectories
from drift.products.files.chapter import Contents, OutputBundle, Stamped, bind_outputs
from drift.products.maps.imprint import Setting


@dataclass(frozen=True)
class ForecastOutputs:
    """The inputs of the forecast's files and pictures."""

    forecast: Forecast
    tracks: Trajectories
    setting: Setting
    overlays: Sequence[
        Callable[[Any], Any]
    ] = ()  # layers of other topics for the map: drift.products.maps.overlay.AtTime
    small: Sequence[Callable[[Any], Any]] = ()  # the same on the maps of all outputs
    # the time that the report shows first; of a plan's failure map.png shows a later one
    report_opens: np.datetime64 | None = None


def _map(matter: ForecastOutputs, path: Path) -> None:
    # imported here because Matplotlib takes a second
    from drift.forecast.products import map as forecast_map

    time = mapped.opening_output(matter.forecast.data, matter.setting.opens)
    forecast_map.draw_map(
        matter.forecast, path, matter.setting, time=time, overlays=matter.overlays
    )


def _snapshots(matter: ForecastOutputs, path: Path) -> None:
    from drift.forecast.products import map as forecast_map

    forecast_map.draw_snapshots(matter.forecast, path, matter.setting, overlays=matter.small)


def _scenario_maps(matter: ForecastOutputs, path: Path) -> None:
    from drift.forecast.products import scenario_maps

    scenario_maps.plot_scenarios(matter.forecast, path, matter.setting, overlays=matter.small)


def _leaves(matter: ForecastOutputs) -> list[Any]:
    from drift.forecast.products import report

    return report.forecast_leaves(matter.forecast, matter.tracks, matter.report_opens)


FILES: dict[str, Callable[[ForecastOutputs, Stamped], Contents]] = {
    "forecast.nc": lambda matter, stamped: matter.forecast.data,
    "particles.nc": lambda matter, stamped: forecast_tracks.dataset(matter.tracks, matter.forecast),
    "contours.geojson": lambda matter, stamped: tables.contours(matter.forecast, stamped),
    "track.csv": lambda matter, stamped: tables.track(matter.forecast, stamped["run_id"]),
    "ashore.csv": lambda matter, stamped: tables.ashore(matter.forecast, stamped["run_id"]),
}
PICTURES: dict[str, Callable[[ForecastOutputs, Path], None]] = {
    "map.png": _map,
    "snapshots.png": _snapshots,
}
SCENARIO_PICTURES: dict[str, Callable[[ForecastOutputs, Path], None]] = {  # of several scenarios
    "stories.png": _scenario_maps,
}


def forecast_bundle(matter: ForecastOutputs) -> OutputBundle:
    """Return the output bundle of a forecast."""
    several = matter.forecast.data.sizes["scenario"] > 1
    return OutputBundle(
        tables.summary_of_forecast(matter.forecast, matter.setting.opens),
        bind_outputs(FILES, matter),
        bind_outputs(PICTURES | SCENARIO_PICTURES if several else PICTURES, matter),
        leaves=(partial(_leaves, matter),),
    )
