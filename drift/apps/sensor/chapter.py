"""What is handed out of where a sensor hears: a grid, a table, a picture."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from drift.apps.sensor import files, text
from drift.apps.sensor.records import Reach
from drift.products.files.chapter import Chapter, Contents, Stamped, bound
from drift.products.maps.imprint import Imprint


@dataclass(frozen=True)
class SensorOutputs:
    """What the files and the picture are made from."""

    found: Reach
    imprint: Imprint
    land: Callable[[Any], Any]  # returns the polygons of land in a box [deg]


def _map(matter: SensorOutputs, path: Path) -> None:
    from drift.apps.sensor import map as reach_map  # here: Matplotlib takes a second to import

    reach_map.plot_reach(matter.found, path, matter.imprint, matter.land)


FILES: dict[str, Callable[[SensorOutputs, Stamped], Contents]] = {
    "sensor.nc": lambda matter, stamped: files.grid(matter.found, stamped),
    "sensor.csv": lambda matter, stamped: files.reach_csv(matter.found, stamped),
}
PICTURES: dict[str, Callable[[SensorOutputs, Path], None]] = {"sensor.png": _map}


def chapter(matter: SensorOutputs, attributes: dict[str, str]) -> Chapter:
    """Return the chapter of a sensor."""
    numbers = {"sensor": text.summary_of_reach(matter.found)}
    return Chapter(numbers, bound(FILES, matter), bound(PICTURES, matter), facts=attributes)
