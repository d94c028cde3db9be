"""The output files of a backward run: where and when a spill may have been released."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from drift.products.files.chapter import Contents, OutputBundle, Stamped, bind_outputs
from drift.products.maps.imprint import Setting
from drift.products.maps.marks import Mark
from drift.spills.backtrack import backward, outlines, report, text
from drift.spills.backtrack.backward import Origin
from drift.spills.worlds.records import Find
from geo import notation


@dataclass(frozen=True)
class OriginOutputs:
    """The inputs of the origin's files and picture."""

    origin: Origin
    finds: Sequence[Find]
    setting: Setting


def _table(outputs: OriginOutputs, stamped: Stamped) -> str:
    return text.origin_csv(backward.summary_of_origin(outputs.origin), stamped["run_id"])


def _plot(outputs: OriginOutputs, path: Path) -> None:
    # imported here because Matplotlib takes a second
    from drift.spills.backtrack import map as origin_map

    origin_map.plot_origin(outputs.origin, path, replace(outputs.setting, marks=_marks(outputs)))


def _marks(outputs: OriginOutputs) -> list[Mark]:
    return [
        Mark(find.lon, find.lat, f"{k} {find.name}, {notation.format_dtg(find.time)[:6]}Z")
        for k, find in enumerate(outputs.finds, 1)
        if not math.isnan(find.lat)  # a find on a named stretch has no position
    ]


FILES: dict[str, Callable[[OriginOutputs, Stamped], Contents]] = {
    "origin.nc": lambda outputs, stamped: backward.origin_dataset(outputs.origin),
    "origin.csv": _table,
    "origin.geojson": lambda outputs, stamped: outlines.origin_geojson(
        outputs.origin, _marks(outputs), stamped
    ),
}
PICTURES: dict[str, Callable[[OriginOutputs, Path], None]] = {
    "origin.png": _plot,
}


def origin_bundle(outputs: OriginOutputs) -> OutputBundle:
    """Return the output bundle of a backward run."""
    warnings = backward.origin_warnings(outputs.origin)
    numbers = {"origin": backward.summary_of_origin(outputs.origin), "warnings": warnings}
    leaves = (partial(report.origin_leaves, outputs.origin, _marks(outputs)),)
    return OutputBundle(
        numbers,
        bind_outputs(FILES, outputs),
        bind_outputs(PICTURES, outputs),
        leaves=leaves,
        warnings=tuple(warnings),
    )
