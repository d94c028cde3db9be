"""Currents, winds and Stokes drift as the engine reads them.

A `Source` is a regular longitude-latitude grid, times, and slices that are read on demand. Whatever
the files hold (projected, curvilinear, staggered or triangular grids, packed numbers, other units
and calendars), slices are true east and north components in m/s, with NaN for missing.
"""

import hashlib
import os
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from geo import notation, sphere
from geo.box import Box
from geo.errors import UserError
from geo.files import address, dataset
from geo.forcing import analytic as flows
from geo.forcing import members as called
from geo.forcing import reader
from geo.forcing.quantity import QUANTITIES
from geo.forcing.reading import memory
from geo.forcing.reading.kept import Shelf, SliceCache
from geo.grids.grid import Grid

# grid with the globe in one cell, for fields that are uniform
EVERYWHERE = Grid(-180.0, -90.0, 360.0, 180.0, 2, 2)
# with meridians 0.5 degrees apart, interpolated directions err by (0.5 degrees)^2 / 8 = 1e-5
ABOUT_POLE = Grid(-180.0, -90.0, 0.5, 180.0, 721, 2)
WARNING_PREFIX = "WARNING: "  # start of a note that the user must see
MOST_NODES = 1_000_000  # largest number of grid nodes for a built-in flow


@dataclass(frozen=True)
class Source:
    """One source of one quantity.

    quantity: one of QUANTITIES. name: for messages. grid: of the nodes. times: datetime64[s] UTC,
    strictly increasing, shape (nt,), empty for a steady field. read: slice index (0 when steady) ->
    float32 C-contiguous (nlat, nlon, 2), true east and north [m/s], NaN for missing. missing: share
    of nodes missing in the first slice. notes: how the files were interpreted. fingerprint: a hash
    of the content, independent of where files are stored. domain: (nlat, nlon), True for nodes
    inside the source's own grid, None if all are; outside it a missing value does not mean land.
    shelf: cache of slices that are ready to be sampled, shared by forecasts; None for no cache.
    label: of a member of an ensemble. others: the other members, if this is the first one, on the
    same grid and with the same times. edges: the first and the last time are edges of means, which
    hold there. blank: returns which of some slices have no value, None if there is no such test.
    gapless: the source is interpolated in time over any gap, like a table of a person's reports;
    False: a gap of more than stream.LONGEST_GAP times the usual interval is a hole in the data.
    """

    quantity: str
    name: str
    grid: Grid
    times: NDArray[np.datetime64]
    read: Callable[[int], NDArray[np.float32]]
    missing: float
    notes: tuple[str, ...]
    fingerprint: str
    domain: NDArray[np.bool_] | None = None
    shelf: Shelf | None = None
    label: str = ""
    others: tuple["Source", ...] = ()
    edges: bool = False
    blank: Callable[[Sequence[int]], list[int]] | None = None
    gapless: bool = False

    @property
    def members(self) -> tuple["Source", ...]:
        """All members of the ensemble, this one first; only this one if it is no ensemble."""
        return (self, *self.others)

    def with_cache(self, part: Hashable, finished: SliceCache) -> "Source":
        """Return the source with a cache for its slices and for those of each other member."""
        others = tuple(
            replace(other, shelf=Shelf((part, number), finished))
            for number, other in enumerate(self.others, 1)
        )
        return replace(self, shelf=Shelf(part, finished), others=others)

    def without_blank_slices(self, first: np.datetime64, last: np.datetime64) -> "Source":
        """Return the source without blank slices, so that time interpolation skips them.

        A note lists them. If all slices between the two times are blank, the source is returned
        unchanged.
        """
        if self.blank is None or self.times.size < 3:
            return self
        low, high = (int(k) for k in np.searchsorted(self.times, (first, last)))
        examined, size = range(max(low - 1, 0), min(high + 1, self.times.size)), self.times.size
        empty = self.blank(examined)
        # widen the range until the slices on both sides of the removed ones have values
        while empty and len(empty) < len(examined):
            wider = range(
                max(examined[0] - (examined[0] in empty), 0),
                min(examined[-1] + 1 + (examined[-1] in empty), size),
            )
            if wider == examined:
                break
            examined, empty = wider, self.blank(wider)
        kept = np.delete(np.arange(self.times.size), empty)
        if not empty or len(empty) == len(examined) or kept.size < 2:
            return self
        when = [notation.format_dtg(self.times[i]) for i in empty]
        times_text = f"{', '.join(when[:4])}{f' and {len(when) - 4} more' if len(when) > 4 else ''}"
        note = f"{WARNING_PREFIX}{'slices' if len(when) > 1 else 'the slice'} of {times_text} hold{'s' * (len(when) == 1)} no value here"
        return replace(
            self._select_slices(kept, empty),
            notes=(*self.notes, f"{note}: left out and interpolated over"),
            others=tuple(other._select_slices(kept, empty) for other in self.others),
        )

    def _select_slices(self, kept: NDArray[np.int64], empty: Sequence[int]) -> "Source":
        """Return the source with some of its slices; empty: indices of the others."""
        read = self.read
        shelf = self.shelf and Shelf(
            (self.shelf.part, "without", tuple(empty)), self.shelf.finished
        )
        return replace(
            self,
            times=self.times[kept],
            read=lambda i: read(int(kept[i])),
            shelf=shelf,
            edges=self.edges and kept[0] == 0 and kept[-1] == self.times.size - 1,
            blank=None,
        )


def combine_members(members: Sequence[Source]) -> Source:
    """Return sources of one quantity, each with a label, combined into an ensemble.

    Raises UserError if their grids or times differ.
    """
    first = members[0]
    for number, other in enumerate(members[1:], 2):
        if other.grid != first.grid or not np.array_equal(other.times, first.times):
            what = "another grid" if other.grid != first.grid else "other times"
            raise UserError(
                f"member {number} ({other.label}) has {what} than member 1 ({first.label}): all members of an ensemble "
                f"must have the same; leave it out of [[{first.quantity}]]"
            )
    digest = hashlib.sha256(
        " ".join(member.fingerprint for member in members).encode()
    ).hexdigest()[:16]
    note = f"{len(members)} members of an ensemble: {called.some([member.label for member in members])}"
    return replace(first, fingerprint=digest, notes=(*first.notes, note), others=tuple(members[1:]))


def open_source(
    quantity: str,
    paths: dataset.Paths | memory.NamedDataset,
    *,
    variables: Mapping[str, Any] | None = None,
    units: str | None = None,
    times: Any = None,
    steady: bool = False,
    box: Box | None = None,
    depth: float | None = None,
    name: str | None = None,
    lenient: bool = False,
    plausible: bool = False,
    timeout: float = address.TIMEOUT,
    members: bool | str = False,
    entries: Sequence[Sequence[str]] = (),
) -> Source:
    """Open files, or a dataset in memory, as one source.

    Args:
        quantity: one of QUANTITIES.
        paths: a path, a glob, a list of them, a Zarr store, an OPeNDAP address, or a dataset in
            memory.
        variables: the case's choice, which overrides what is found: {"east", "north", "lon",
            "lat", "time", "angle", "mask": name}, {"axes": "true" | "grid"}, {"crs": anything that
            pyproj knows}, {name of a dimension: index}.
        units: of the values, if the file has none or wrong ones.
        times: {"start": ..., "interval": ...} or one time per slice, to replace the file's times;
            {"zone": "-06:00"}, hours by which the file's times are ahead of UTC; {"stamp": "start"
            | "middle" | "end" | "instant"}, where in its interval the time of a mean lies.
        steady: use the first slice at all times.
        box: area needed; two more nodes are read on each side. None for the whole source.
        depth: wanted level [m].
        name: for messages, instead of the files' names.
        lenient: accept a single slice, which is enough to describe a file.
        plausible: the user vouches for the values: no speed is rejected, and no value is taken as
            an undeclared fill value.
        timeout: longest wait for an answer of an address' server [s].
        members: True for an ensemble, or the name of the dimension along which members lie.
        entries: the files of each member, if no dimension holds members.

    Raises:
        UserError: the files cannot be read or interpreted.
    """
    request, listed = _build_request(
        quantity,
        paths,
        variables,
        units,
        times,
        steady,
        box,
        depth,
        lenient,
        plausible,
        timeout,
        members,
        tuple(map(tuple, entries)),
    )
    with dataset.reporting_damage(_paths_or_title(listed), quantity):
        reading = reader.open_reader(request, listed)
    return _build_source(request, name, reading)


def open_shared(
    quantity: str,
    paths: dataset.Paths | memory.NamedDataset,
    *,
    variables: Mapping[str, Any] | None = None,
    units: str | None = None,
    times: Any = None,
    steady: bool = False,
    depth: float | None = None,
    plausible: bool = False,
    timeout: float = address.TIMEOUT,
    members: bool | str = False,
    entries: Sequence[Sequence[str]] = (),
) -> reader.Opened:
    """Open files for several cases; `keep` and `part_of_source` give each case its part.

    The arguments are those of `open_source`.
    """
    request, listed = _build_request(
        quantity,
        paths,
        variables,
        units,
        times,
        steady,
        None,
        depth,
        False,
        plausible,
        timeout,
        members,
        tuple(map(tuple, entries)),
    )
    with dataset.reporting_damage(_paths_or_title(listed), quantity):
        return reader.open_all(request, listed)


def keep(opened: reader.Opened, box: Box) -> reader.Opened:
    """Return an opened source that keeps slices in memory over a box, once they are read."""
    return reader.keep(opened, box)


def part_of_source(opened: reader.Opened, box: Box, name: str | None = None) -> Source:
    """Return the part of an opened source over a box, as `open_source` would return it.

    Only its fingerprint is missing.
    """
    with dataset.reporting_damage(_paths_or_title(opened.paths), opened.request.quantity):
        return _build_source(opened.request, name, reader.cut_source(opened, box))


def _build_request(
    quantity: str,
    paths: dataset.Paths | memory.NamedDataset,
    variables: Mapping[str, Any] | None,
    *how: Any,
) -> tuple[reader.Request, Any]:
    """Return the reader's request, and the paths as a list or the dataset in memory."""
    if quantity not in QUANTITIES:
        raise UserError(f'quantity "{quantity}": allowed are {", ".join(QUANTITIES)}')
    if isinstance(paths, memory.NamedDataset):
        return reader.Request(quantity, paths.name, variables or {}, *how), paths
    listed = [paths] if isinstance(paths, str | os.PathLike) else list(paths)
    return reader.Request(quantity, dataset.title(listed), variables or {}, *how), listed


def _paths_or_title(paths: Any) -> Any:
    """Return the paths, or the title of the dataset in memory, for messages."""
    return [paths.title] if isinstance(paths, memory.NamedDataset) else paths


def _build_source(request: reader.Request, name: str | None, reading: reader.Reading) -> Source:
    first = Source(
        request.quantity,
        name or request.name,
        reading.grid,
        reading.times,
        reading.read,
        reading.missing,
        reading.notes,
        reading.fingerprint,
        reading.domain,
        label=reading.label,
        edges=reading.edges,
        blank=reading.blank,
    )
    return replace(
        first,
        others=tuple(replace(first, read=read, label=label) for label, read in reading.others),
    )


def constant_field(
    quantity: str,
    east: float,
    north: float,
    name: str = "as reported",
    about: tuple[float, float] | None = None,
) -> Source:
    """Return a steady, uniform field [m/s] over the globe; about: see `uniform_field`."""
    return _build_uniform(
        quantity, np.empty(0, "datetime64[s]"), np.array([east]), np.array([north]), name, about
    )


def uniform_field(
    quantity: str,
    times: ArrayLike,
    east: ArrayLike,
    north: ArrayLike,
    name: str = "as reported",
    about: tuple[float, float] | None = None,
) -> Source:
    """Return a uniform field over the globe that changes in time.

    Args:
        quantity: one of QUANTITIES.
        times: UTC, ascending, shape (nt,).
        east: component [m/s], shape (nt,).
        north: component [m/s], shape (nt,).
        name: of the source, for messages.
        about: the position (lon, lat) [deg] for which the field is stated, if the domain contains
            a pole. The field then has one direction in the polar plane. A constant direction
            relative to true north would turn from meridian to meridian there.

    Raises:
        UserError: there are fewer than two rows, or the times do not increase.
    """
    when = np.asarray(times).astype("datetime64[s]").reshape(-1)
    u, v = np.asarray(east, float).reshape(-1), np.asarray(north, float).reshape(-1)
    if not len(when) == len(u) == len(v) or len(when) < 2:
        raise UserError(
            f"[[{quantity}]] table: {len(when)} times for {len(u)} values; give at least two rows"
        )
    if (np.diff(when) <= np.timedelta64(0, "s")).any():
        raise UserError(f"[[{quantity}]] table: times must increase")
    return _build_uniform(quantity, when, u, v, name, about)


def _build_uniform(
    quantity: str,
    times: NDArray[np.datetime64],
    east: NDArray[Any],
    north: NDArray[Any],
    name: str,
    about: tuple[float, float] | None,
) -> Source:
    if not (np.isfinite(east).all() and np.isfinite(north).all()):
        raise UserError(f"[[{quantity}]] {name}: a speed is not a finite number")
    values = np.stack((east, north), axis=-1).astype(np.float32)
    digest = hashlib.sha256(
        quantity.encode() + times.astype(np.int64).tobytes() + values.tobytes()
    ).hexdigest()[:16]

    def read(i: int) -> NDArray[np.float32]:
        return np.ascontiguousarray(np.broadcast_to(values[i], (2, 2, 2)))

    def read_about(i: int) -> NDArray[np.float32]:
        assert about is not None
        common = sphere.to_pole(np.radians(about[0]), about[1], *values[i].astype(float))
        row = np.stack(sphere.from_pole(np.radians(ABOUT_POLE.lon), about[1], *common), axis=-1)
        return np.ascontiguousarray(np.broadcast_to(row.astype(np.float32), (2, *row.shape)))

    description = " then ".join(
        format_vector(quantity, *vector)
        for vector in zip(east[:3].tolist(), north[:3].tolist(), strict=True)
    )
    rest = f" and {len(values) - 3} more" if len(values) > 3 else ""
    note = f"the same everywhere: {description}{rest}"
    if about is None or QUANTITIES[quantity].scalar:
        return Source(quantity, name, EVERYWHERE, times, read, 0.0, (note,), digest)
    note += f"; near the pole one direction, stated for {notation.position(*about)}"
    return Source(quantity, name, ABOUT_POLE, times, read_about, 0.0, (note,), digest)


def format_vector(quantity: str, east: float, north: float) -> str:
    """Return a vector as mariners write it: in knots, winds from and currents toward a bearing.

    Of a scalar return the value with its unit.
    """
    if QUANTITIES[quantity].scalar:
        return f"{east:.6g}{QUANTITIES[quantity].unit_text}"
    speed = float(np.hypot(east, north))
    if speed == 0:
        return "0 kn"
    toward = np.degrees(np.arctan2(east, north))
    from_ = QUANTITIES[quantity].in_air
    angle = float(toward + 180 if from_ else toward)
    return f"{notation.number(speed / notation.KNOT)} kn {'from' if from_ else 'toward'} {notation.bearing(angle)}"


def analytic(
    quantity: str,
    kind: str,
    box: Box,
    start: np.datetime64,
    end: np.datetime64,
    **parameters: float,
) -> Source:
    """Return a built-in synthetic flow over a box, with hourly slices.

    Args:
        quantity: one of QUANTITIES.
        kind: of the flow, a key of `geo.forcing.analytic.KINDS`.
        box: area of the case.
        start: first or last time of the case; the slices cover both.
        end: the other one.
        parameters: of the flow in `geo.forcing.analytic`, and `spacing` [deg], which overrides the
            flow's grid spacing.
    """
    spacing = parameters.pop("spacing", None)
    flow, usual = flows.build_flow(quantity, kind, box, **parameters)
    step = float(spacing or usual)
    width, height = box.east - box.west, box.north - box.south
    step = max(step, float(np.sqrt(width * height / MOST_NODES)))
    if box.east - box.west >= 360.0:
        step = 360.0 / np.ceil(360.0 / step)
    # Nodes lie at multiples of the step, so that their positions do not depend on the box.
    west = np.floor(box.west / step)
    east = min(np.ceil(box.east / step), west + np.ceil(360.0 / step))
    south, north = (
        np.floor(max(box.south / step, -90 / step + 1)),
        np.ceil(min(box.north / step, 90 / step - 1)),
    )
    grid = Grid(
        west * step,
        south * step,
        step,
        step,
        int(max(east - west, 1)) + 1,
        int(max(north - south, 1)) + 1,
    )
    hour = np.timedelta64(3600, "s")
    first, last = sorted((_to_seconds(start), _to_seconds(end)))
    first = first.astype("datetime64[h]").astype("datetime64[s]")
    times = first + hour * np.arange(int(np.ceil((last - first) / hour)) + 1)
    if len(times) < 2:
        times = first + hour * np.arange(2)
    velocity = flow(grid.lon[None, :], grid.lat[:, None])

    def read(i: int) -> NDArray[np.float32]:
        result = np.empty((grid.nlat, grid.nlon, 2), np.float32)
        result[..., 0], result[..., 1] = velocity(
            float((times[i] - flows.EPOCH) / np.timedelta64(1, "s"))
        )
        result[np.abs(grid.lat) > 89.0] = np.nan
        return result

    settings = ", ".join(f"{k} = {v:g}" for k, v in sorted(parameters.items()))
    digest = hashlib.sha256(f"{kind} {settings} {grid} {first} {last}".encode()).hexdigest()[:16]
    notes = (
        f'SYNTHETIC: built-in flow "{kind}"{" with " + settings if settings else ""}, no observation or model',
    )
    missing = float((np.abs(grid.lat) > 89.0).mean())
    return Source(quantity, f"synthetic {kind}", grid, times, read, missing, notes, digest)


def _to_seconds(time: Any) -> np.datetime64:
    return np.datetime64(time, "s")
