"""Waters that many cases share: sources opened once, slices kept in memory, one coast for all.

Each case still sees the box, the crop and the grid that it would have alone: what is shared is what
does not depend on them. Cases near each other have the same crop (environment.part): its slices are
turned, regridded and filled once for all. A coast is exact wherever its grid begins, as long as its
cells are of the finest size; a case whose prior reaches beyond the coast that it would have alone,
or whose waters are too wide for the finest cells, gets its own.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from drift.case.record import Case
from drift.engine.environment import coastline, domain
from drift.engine.environment.environment import Environment
from drift.engine.environment.environment_spec import EnvironmentSpec
from drift.engine.environment.forcing_spec import ForcingSpec
from drift.engine.environment.forcing_spec import options as source_options
from drift.engine.motion.ensemble_spec import EnsembleSpec
from drift.pipeline import run_setup
from geo import sphere
from geo.box import Box
from geo.coast import edges as shoreline
from geo.coast import shore
from geo.coast.shore import Shore
from geo.errors import UserError
from geo.forcing import reader, sources
from geo.forcing.reading import memory
from geo.forcing.reading.kept import Finished
from geo.forcing.sources import Source
from kernels.step import coast as device_coast

WIDEST = 400.0  # [deg2] of a box of waters, whose coast still fits the finest cells
CUTS = 64  # parts of sources that are kept, because cases from one place share theirs


class Files:
    """Sources of files and datasets, each opened when it is first asked for.

    What cannot be opened is refused every time.
    """

    def __init__(self, held: Mapping[str, memory.Held]) -> None:
        self._held = held
        self._opened: dict[str, reader.Opened | UserError] = {}

    def open(self, spec: ForcingSpec) -> reader.Opened:
        """Return a source, whatever it is called in a case."""
        key = repr(replace(spec, name="", fill=0, add=False))
        if key not in self._opened:
            try:
                files = list(spec.files) if spec.dataset is None else self._held[spec.dataset]
                self._opened[key] = sources.open_shared(
                    spec.quantity, files, **source_options(spec)
                )
            except UserError as error:
                self._opened[key] = error
        opened = self._opened[key]
        if isinstance(opened, UserError):
            raise UserError(*opened.lines)
        return opened


class Waters:
    """A stretch of water with all that its cases have in common."""

    def __init__(self, box: Box, files: Files) -> None:
        self.box = box
        self._files = files
        self._kept: dict[int, reader.Opened] = {}
        self._cuts: dict[tuple[int, Box], Source] = {}
        self._finished = Finished()
        self._lands: dict[tuple[str, Any], tuple[Shore, shoreline.Coast | None]] = {}
        self._shores: dict[int, tuple[shoreline.Coast, device_coast.DeviceCoast]] = {}

    def open_for(self, case: Case, datasets: Mapping[str, Any]) -> Environment:
        """Return the environment that a case would have alone."""
        return run_setup.open_for(case, datasets, common=self)

    def source(self, spec: ForcingSpec, box: Box) -> Source:
        """Return a source's part for a box."""
        opened = self._files.open(spec)
        if id(opened) not in self._kept:
            self._kept[id(opened)] = sources.keep(opened, self.box)
        key = id(opened), box
        part = self._cuts.pop(key, None) or sources.part_of_source(self._kept[id(opened)], box)
        self._cuts[key] = part
        if len(self._cuts) > CUTS:
            del self._cuts[next(iter(self._cuts))]
        return replace(part, name=spec.name).shelved(key, self._finished)

    def coast(
        self, spec: EnsembleSpec, asked: EnvironmentSpec, box: Box
    ) -> tuple[Shore, shoreline.Coast | None] | None:
        """Return the land and coast of these waters, where a case would have the same in its box;
        else None.
        """
        if not _within(domain.around(spec, 0.0, domain.FARTHEST), box) or not _within(
            box, self._coastal
        ):
            return None
        key = asked.coast.source, asked.coast.lakes
        if key not in self._lands:
            land = shore.land(asked.coast.source, self._coastal, asked.coast.lakes)
            self._lands[key] = (
                land,
                shoreline.build_coast(land, self._coastal) if land.polygons.size else None,
            )
        land, coast = self._lands[key]
        return None if coast is not None and coast.shift != shoreline.FINEST else (land, coast)

    def shore(self, coast: shoreline.Coast | None) -> device_coast.DeviceCoast | None:
        """Return a coast on the device, where it is these waters' own; None for another."""
        if coast is None or all(coast is not own for _, own in self._lands.values()):
            return None
        if id(coast) not in self._shores:
            self._shores[id(coast)] = coast, device_coast.upload(coast)
        return self._shores[id(coast)][1]

    @property
    def _coastal(self) -> Box:
        """The box of the coast: all that any of its cases asks for."""
        margin = coastline.MARGIN
        highest = min(max(abs(self.box.south), abs(self.box.north)), 80)
        return self.box.grown(float(margin / np.cos(np.radians(highest))), margin)


def divide(cases: Sequence[Case], datasets: Mapping[str, Any]) -> list[Waters]:
    """Return the waters of each case: near ones share theirs, as long as these do not become too
    wide.
    """
    files = Files(memory.hold(datasets))
    boxes: list[Box] = []
    number = []
    for case in cases:
        own = domain.bounds(run_setup.ensemble_spec(case), run_setup.environment_spec(case))
        for k, box in enumerate(boxes):
            joined = _joined(box, own)
            if (joined.east - joined.west) * (joined.north - joined.south) <= WIDEST:
                boxes[k] = joined
                break
        else:
            k = len(boxes)
            boxes.append(own)
        number.append(k)
    shared = [Waters(box, files) for box in boxes]
    return [shared[k] for k in number]


def _joined(box: Box, other: Box) -> Box:
    """Return the smallest box that holds two."""
    turn = 360 * round((box.west + box.east - other.west - other.east) / 720)
    west, east = min(box.west, other.west + turn), max(box.east, other.east + turn)
    run_setup = sphere.wrap_degrees(west)
    return Box(
        run_setup, min(box.south, other.south), run_setup + east - west, max(box.north, other.north)
    )


def _within(box: Box, other: Box) -> bool:
    """Whether a box lies in another."""
    offset = (box.west - other.west) % 360
    return (
        offset + box.east - box.west <= other.east - other.west
        and other.south <= box.south
        and box.north <= other.north
    )
