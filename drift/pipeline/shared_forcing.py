"""Forcing and coast shared by many cases: sources opened once, slices cached, one coast per region.

Every case keeps the box, crop and grid that it would have alone, so its results do not change.
Cases near each other have the same crop (environment.part); its slices are rotated, regridded and
filled once. A coast does not depend on the origin of its grid as long as its cells have the finest
size. A case gets its own coast if its prior reaches beyond the coast that it would have alone, or
if the shared region is too wide for the finest cells. The last such coast is kept, for a case with
the same box.
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
from geo.forcing.reading.kept import SliceCache
from geo.forcing.sources import Source
from kernels.step import coast as device_coast

WIDEST = 400.0  # [deg2] largest region whose coast still fits the finest cells
CUTS = 64  # cached crops of sources: cases in one place share a crop


class Files:
    """Forcing sources from files and datasets, each opened at its first use.

    A source that cannot be opened raises the same UserError every time.
    """

    def __init__(self, held: Mapping[str, memory.NamedDataset]) -> None:
        self._held = held
        self._opened: dict[str, reader.Opened | UserError] = {}

    def open(self, spec: ForcingSpec) -> reader.Opened:
        """Return an opened source; equal sources with different names are opened once."""
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


class SharedRegion:
    """A region with the sources, slices, land and coast that its cases share."""

    def __init__(self, box: Box, files: Files) -> None:
        self.box = box
        self._files = files
        self._kept: dict[int, reader.Opened] = {}
        self._cuts: dict[tuple[int, Box], Source] = {}
        self._finished = SliceCache()
        self._lands: dict[tuple[str, Any], tuple[Shore, shoreline.Coast | None]] = {}
        self._own: dict[Any, tuple[Shore, shoreline.Coast | None]] = {}  # at most one
        self._shores: dict[int, tuple[shoreline.Coast, device_coast.DeviceCoast]] = {}

    def open_for(self, case: Case, datasets: Mapping[str, Any]) -> Environment:
        """Return the environment of a case, equal to the one that it would have alone."""
        return run_setup.open_for(case, datasets, common=self)

    def source(self, spec: ForcingSpec, box: Box) -> Source:
        """Return a source cropped to a box."""
        opened = self._files.open(spec)
        if id(opened) not in self._kept:
            self._kept[id(opened)] = sources.keep(opened, self.box)
        key = id(opened), box
        part = self._cuts.pop(key, None) or sources.part_of_source(self._kept[id(opened)], box)
        self._cuts[key] = part
        if len(self._cuts) > CUTS:
            del self._cuts[next(iter(self._cuts))]
        return replace(part, name=spec.name).with_cache(key, self._finished)

    def coast(
        self, spec: EnsembleSpec, asked: EnvironmentSpec, box: Box
    ) -> tuple[Shore, shoreline.Coast | None]:
        """Return the land and coast of a case in its box: those of the region, if they are equal.

        The land of a wide region is not read: its coast may have coarser cells than the case's.
        """
        if (
            is_wide(self.box)
            or not lies_inside(domain.around(spec, 0.0, domain.FARTHEST), box)
            or not lies_inside(box, self._coastal)
        ):
            return self._own_coast(asked, box)
        key = asked.coast.source, asked.coast.lakes
        if key not in self._lands:
            land = shore.read_land(asked.coast.source, self._coastal, asked.coast.lakes)
            self._lands[key] = (
                land,
                shoreline.build_coast(land, self._coastal) if land.polygons.size else None,
            )
        land, coast = self._lands[key]
        if coast is not None and coast.shift != shoreline.FINEST:
            return self._own_coast(asked, box)
        return land, coast

    def _own_coast(self, asked: EnvironmentSpec, box: Box) -> tuple[Shore, shoreline.Coast | None]:
        """Return the land and coast that a case has alone in its box."""
        key = asked.coast.source, asked.coast.lakes, box
        if key not in self._own:
            land = shore.read_land(asked.coast.source, box, asked.coast.lakes)
            coast = shoreline.build_coast(land, box) if land.polygons.size else None
            self._own = {key: (land, coast)}
        return self._own[key]

    def shore(self, coast: shoreline.Coast | None) -> device_coast.DeviceCoast | None:
        """Return a shared coast uploaded to the device; None for a coast of another region."""
        if coast is None or all(coast is not own for _, own in self._lands.values()):
            return None
        if id(coast) not in self._shores:
            self._shores[id(coast)] = coast, device_coast.upload(coast)
        return self._shores[id(coast)][1]

    @property
    def _coastal(self) -> Box:
        """The box of the shared coast: the region plus the largest margin of its cases."""
        margin = coastline.MARGIN
        highest = min(max(abs(self.box.south), abs(self.box.north)), 80)
        return self.box.grown(float(margin / np.cos(np.radians(highest))), margin)


def share_regions(cases: Sequence[Case], datasets: Mapping[str, Any]) -> list[SharedRegion]:
    """Return the region of each case: neighbouring cases share one that is at most WIDEST."""
    files = Files(memory.wrap_datasets(datasets))
    boxes: list[Box] = []
    number = []
    for case in cases:
        own = domain.bounds(run_setup.ensemble_spec(case), run_setup.environment_spec(case))
        for k, box in enumerate(boxes):
            joined = _smallest_common_box(box, own)
            if not is_wide(joined):
                boxes[k] = joined
                break
        else:
            k = len(boxes)
            boxes.append(own)
        number.append(k)
    shared = [SharedRegion(box, files) for box in boxes]
    return [shared[k] for k in number]


def is_wide(box: Box) -> bool:
    """Return whether a box is so large that its coast may not have the finest cells."""
    return (box.east - box.west) * (box.north - box.south) > WIDEST


def _smallest_common_box(box: Box, other: Box) -> Box:
    """Return the smallest box that contains both boxes."""
    turn = 360 * round((box.west + box.east - other.west - other.east) / 720)
    west, east = min(box.west, other.west + turn), max(box.east, other.east + turn)
    wrapped = sphere.wrap_degrees(west)
    return Box(
        wrapped, min(box.south, other.south), wrapped + east - west, max(box.north, other.north)
    )


def lies_inside(box: Box, other: Box) -> bool:
    """Return whether a box lies inside another."""
    offset = (box.west - other.west) % 360
    return (
        offset + box.east - box.west <= other.east - other.west
        and other.south <= box.south
        and box.north <= other.north
    )
