"""Output files of `drift sensor`: a grid, a table and a map."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from drift.apps.sensor import files, text
from drift.apps.sensor.records import Reach
from drift.products.files.chapter import Contents, OutputBundle, Stamped, bind_outputs
from drift.products.maps.imprint import Imprint


@dataclass(frozen=True)
class SensorOutputs:
    """The data that the files and the map are made from."""

    found: Reach
    imprint: Imprint
    land: Callable[[Any], Any]  # returns the polygons of land in a box [deg]


def _map(outputs: SensorOutputs, path: Path) -> None:
    from drift.apps.sensor import map as reach_map  # imported here: Matplotlib takes a second

    reach_map.plot_reach(outputs.found, path, outputs.imprint, outputs.land)


FILES: dict[str, Callable[[SensorOutputs, Stamped], Contents]] = {
    "sensor.nc": lambda outputs, stamped: files.grid(outputs.found, stamped),
    "sensor.csv": lambda outputs, stamped: files.reach_csv(outputs.found, stamped),
}
PICTURES: dict[str, Callable[[SensorOutputs, Path], None]] = {"sensor.png": _map}


def chapter(outputs: SensorOutputs, attributes: dict[str, str]) -> OutputBundle:
    """Return the outputs of `drift sensor`."""
    numbers = {"sensor": text.summary_of_reach(outputs.found)}
    return OutputBundle(
        numbers, bind_outputs(FILES, outputs), bind_outputs(PICTURES, outputs), facts=attributes
    )
