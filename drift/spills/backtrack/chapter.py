"""What a backward run of a spill hands out: where and when it may have been released."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from drift.products.files.chapter import Chapter, Contents, Stamped, bound
from drift.products.maps.imprint import Setting
from drift.products.maps.marks import Mark
from drift.spills.backtrack import backward, outlines, report, text
from drift.spills.backtrack.backward import Origin
from drift.spills.worlds.records import Find
from geo import notation


@dataclass(frozen=True)
class OriginOutputs:
    """What the files and pictures are made from."""

    origin: Origin
    finds: Sequence[Find]
    setting: Setting


def _table(matter: OriginOutputs, stamped: Stamped) -> str:
    return text.csv(backward.summary(matter.origin), stamped["run_id"])


def _picture(matter: OriginOutputs, path: Path) -> None:
    # here: Matplotlib takes a second to import
    from drift.spills.backtrack import map as origin_map

    origin_map.plot_origin(matter.origin, path, replace(matter.setting, marks=_marks(matter)))


def _marks(matter: OriginOutputs) -> list[Mark]:
    return [
        Mark(find.lon, find.lat, f"{k} {find.name}, {notation.group(find.time)[:6]}Z")
        for k, find in enumerate(matter.finds, 1)
        if not math.isnan(find.lat)  # a find on a named stretch has no place of its own
    ]


FILES: dict[str, Callable[[OriginOutputs, Stamped], Contents]] = {
    "origin.nc": lambda matter, stamped: backward.dataset(matter.origin),
    "origin.csv": _table,
    "origin.geojson": lambda matter, stamped: outlines.collection(
        matter.origin, _marks(matter), stamped
    ),
}
PICTURES: dict[str, Callable[[OriginOutputs, Path], None]] = {
    "origin.png": _picture,
}


def chapter(matter: OriginOutputs) -> Chapter:
    """Return the chapter of a backward run."""
    warnings = backward.warnings(matter.origin)
    numbers = {"origin": backward.summary(matter.origin), "warnings": warnings}
    leaves = (partial(report.origin_leaves, matter.origin, _marks(matter)),)
    return Chapter(
        numbers,
        bound(FILES, matter),
        bound(PICTURES, matter),
        leaves=leaves,
        warnings=tuple(warnings),
    )
