"""What a forecast hands out: its maps over time, tracks of a subsample, tables and shapes for a GIS, and two pictures."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from drift.forecast import tables
from drift.forecast import tracks as forecast_tracks
from drift.forecast.build import Forecast
from drift.forecast.tracks import Trajectories
from drift.maps.imprint import Setting
from drift.output.chapter import Chapter, Contents, Stamped, bound


@dataclass(frozen=True)
class Matter:
    """What the files and pictures are made from."""

    forecast: Forecast
    tracks: Trajectories
    setting: Setting
    overlays: Sequence[Callable[[Any], Any]] = ()  # what other topics draw on the map: drift.maps.overlay.AtTime


def _map(one: Matter, path: Path) -> None:
    from drift.forecast import map as forecast_map  # here: Matplotlib takes a second to import

    on = one.setting
    forecast_map.draw_map(
        one.forecast, path, on.imprint, polygons=on.polygons, marks=on.marks, lines=on.lines, known_as=on.known_as,
        particles=on.particles, overlays=one.overlays,
    )  # fmt: skip


def _snapshots(one: Matter, path: Path) -> None:
    from drift.forecast import map as forecast_map

    on = one.setting
    forecast_map.draw_snapshots(
        one.forecast, path, on.imprint, polygons=on.polygons, marks=on.marks, particles=on.particles
    )


FILES: dict[str, Callable[[Matter, Stamped], Contents]] = {
    "forecast.nc": lambda one, stamped: one.forecast.data,
    "particles.nc": lambda one, stamped: forecast_tracks.dataset(one.tracks, one.forecast),
    "contours.geojson": lambda one, stamped: tables.geojson(one.forecast, stamped),
    "track.csv": lambda one, stamped: tables.track(one.forecast, stamped["run_id"]),
    "ashore.csv": lambda one, stamped: tables.ashore(one.forecast, stamped["run_id"]),
}
PICTURES: dict[str, Callable[[Matter, Path], None]] = {
    "map.png": _map,
    "snapshots.png": _snapshots,
}


def chapter(one: Matter) -> Chapter:
    """Return the chapter of a forecast."""
    return Chapter(tables.numbers(one.forecast), bound(FILES, one), bound(PICTURES, one))
