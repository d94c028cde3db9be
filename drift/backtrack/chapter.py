"""What a backward run of a spill hands out: where and when it may have been released."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from drift.backtrack import backward
from drift.backtrack.backward import Origin
from drift.maps.imprint import Setting
from drift.maps.marks import Mark
from drift.output import formats
from drift.output.chapter import Chapter, Contents, Stamped, bound
from drift.spill.records import Find
from geo import notation


@dataclass(frozen=True)
class Matter:
    """What the files and pictures are made from."""

    found: Origin
    finds: Sequence[Find]
    setting: Setting


def _table(one: Matter, stamped: Stamped) -> str:
    facts = backward.summary(one.found)
    return formats.csv_text([*facts, "run_id"], [[*facts.values(), stamped["run_id"]]])


def _picture(one: Matter, path: Path) -> None:
    from drift.backtrack import map as origin_map  # here: Matplotlib takes a second to import

    marks = [
        Mark(find.lon, find.lat, f"{k} {find.name}, {notation.group(find.time)[:6]}Z")
        for k, find in enumerate(one.finds, 1)
        if find.lat == find.lat  # a stretch by name has no place of its own
    ]
    origin_map.draw(one.found, path, one.setting.imprint, polygons=one.setting.polygons, marks=marks)


FILES: dict[str, Callable[[Matter, Stamped], Contents]] = {
    "origin.nc": lambda one, stamped: backward.dataset(one.found),
    "origin.csv": _table,
}
PICTURES: dict[str, Callable[[Matter, Path], None]] = {
    "origin.png": _picture,
}


def chapter(one: Matter) -> Chapter:
    """Return the chapter of a backward run."""
    warnings = backward.warnings(one.found)
    numbers = {"origin": backward.summary(one.found), "warnings": warnings}
    return Chapter(numbers, bound(FILES, one), bound(PICTURES, one), warnings=tuple(warnings))
