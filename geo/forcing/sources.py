"""Currents, winds and Stokes drift as the engine sees them.

Each is a regular grid, times, and slices read on demand.

Whatever the files hold (projected, curved, staggered or triangular grids, packed numbers, other
units and calendars), a `Source` gives true east and north in m/s on a regular longitude-latitude
grid, NaN where missing.
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
from geo.forcing.reading.kept import Finished, Shelf
from geo.grids.grid import Grid

# the globe in one cell, for fields that are the same everywhere
EVERYWHERE = Grid(-180.0, -90.0, 360.0, 180.0, 2, 2)
# between meridians a direction errs by (0.5 degrees)^2 / 8: 1e-5
ABOUT_POLE = Grid(-180.0, -90.0, 0.5, 180.0, 721, 2)
DOUBT = "WARNING: "  # with which a note begins that a user must heed
MOST_NODES = 1_000_000  # most nodes of a built-in flow's tile


@dataclass(frozen=True)
class Source:
    """One source of one quantity.

    quantity: one of QUANTITIES; name: for messages; grid: its nodes; times: datetime64[s] UTC,
    strictly increasing, shape (nt,), empty for a steady field; read: slice index (0 when steady) ->
    float32 C-contiguous (nlat, nlon, 2), true east and north [m/s], NaN missing; missing: share of
    nodes missing in the first slice; notes: how it was understood, in plain words; fingerprint: a
    hash of what is read, independent of where it lies; domain: (nlat, nlon) nodes inside the
    source's own grid, None where all are: beyond it no value is missing for land; shelf: where
    slices that are ready to be sampled stay for other forecasts, None: nowhere. edges: whether the
    first and the last time are the edges of means, which hold there. blank: returns which of some
    slices hold nothing, None where none can be asked. label: what it is called as a member of an
    ensemble; others: the other members of an ensemble of which this is the first, on the same grid,
    with the same times. gapless: interpolated however far apart its times are, as rows that a
    person reported are; False: a gap of more than stream.LONGEST_GAP times the usual interval is a
    hole in the data.
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
        """All members of the ensemble, this one first; this one alone where it is no ensemble."""
        return (self, *self.others)

    def shelved(self, part: Hashable, finished: Finished) -> "Source":
        """Return it with a shelf for its slices, and one for those of each other member."""
        others = tuple(
            replace(other, shelf=Shelf((part, number), finished))
            for number, other in enumerate(self.others, 1)
        )
        return replace(self, shelf=Shelf(part, finished), others=others)

    def without_blank(self, first: np.datetime64, last: np.datetime64) -> "Source":
        """Return the source without the empty slices between two times, as if they were absent.

        It says which they are. Where all of them hold nothing it is returned as it is.
        """
        if self.blank is None or self.times.size < 3:
            return self
        low, high = (int(k) for k in np.searchsorted(self.times, (first, last)))
        asked, size = range(max(low - 1, 0), min(high + 1, self.times.size)), self.times.size
        empty = self.blank(asked)
        # what is interpolated over them must hold something
        while empty and len(empty) < len(asked):
            wider = range(
                max(asked[0] - (asked[0] in empty), 0),
                min(asked[-1] + 1 + (asked[-1] in empty), size),
            )
            if wider == asked:
                break
            asked, empty = wider, self.blank(wider)
        kept = np.delete(np.arange(self.times.size), empty)
        if not empty or len(empty) == len(asked) or kept.size < 2:
            return self
        when = [notation.group(self.times[i]) for i in empty]
        told = f"{', '.join(when[:4])}{f' and {len(when) - 4} more' if len(when) > 4 else ''}"
        note = f"{DOUBT}{'slices' if len(when) > 1 else 'the slice'} of {told} hold{'s' * (len(when) == 1)} no value here"
        return replace(
            self._only(kept, empty),
            notes=(*self.notes, f"{note}: left out, and interpolated over as if absent"),
            others=tuple(other._only(kept, empty) for other in self.others),
        )

    def _only(self, kept: NDArray[np.int64], empty: Sequence[int]) -> "Source":
        """Return it with some of its slices; empty: the others."""
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


def ensemble(members: Sequence[Source]) -> Source:
    """Return sources of one quantity, which have a label each, as the members of an ensemble.

    Raises UserError where they do not have the same grid and the same times.
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
    told = f"{len(members)} members of an ensemble: {called.some([member.label for member in members])}"
    return replace(first, fingerprint=digest, notes=(*first.notes, told), others=tuple(members[1:]))


def open_source(
    quantity: str,
    paths: dataset.Paths | memory.Held,
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

    paths: a path, a glob, a list of them, a Zarr store, an OPeNDAP address, or the dataset.
    variables: the case's own {"east", "north", "lon", "lat", "time", "angle", "mask": name},
    {"axes": "true" | "grid"}, {"crs": any that pyproj knows}, {a dimension's name: index}; it
    overrides what is found. units: of the values where the file is silent or wrong. times:
    {"start": ..., "interval": ...} or one time a slice, where the file's are meaningless; {"zone":
    "-06:00"}, hours that the file's are ahead of UTC; {"stamp": "start"
    | "middle" | "end" | "instant"}, where in the interval of a mean its time stands. steady: the first slice holds at all times. box: what is needed; two
    nodes more are read. depth: wanted level [m]. lenient: accept a lone slice, to describe it.
    plausible: the user vouches for its values: no speed is refused, no value taken as an undeclared
    fill value for standing apart. timeout: how long the server of an address may leave a question
    unanswered [s]. members: whether what is opened is an ensemble, or the dimension along which its
    members lie; entries: the files of each, where no dimension holds them.
    """
    asked, listed = _request(
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
    with dataset.readable(_titles(listed), quantity):
        reading = reader.open_reader(asked, listed)
    return _source(asked, name, reading)


def open_shared(
    quantity: str,
    paths: dataset.Paths | memory.Held,
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
    """Open files as `open_source` does, for several cases: `keep` and `cut` give each its part."""
    asked, listed = _request(
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
    with dataset.readable(_titles(listed), quantity):
        return reader.open_all(asked, listed)


def keep(opened: reader.Opened, box: Box) -> reader.Opened:
    """Return an opened source whose slices stay in memory over a box, once they are read."""
    return reader.keep(opened, box)


def part_of_source(opened: reader.Opened, box: Box, name: str | None = None) -> Source:
    """Return the part of an opened source that `open_source` would give for a box; without a
    fingerprint.
    """
    with dataset.readable(_titles(opened.paths), opened.request.quantity):
        return _source(opened.request, name, reader.cut_source(opened, box))


def _request(
    quantity: str,
    paths: dataset.Paths | memory.Held,
    variables: Mapping[str, Any] | None,
    *how: Any,
) -> tuple[reader.Request, Any]:
    """Return a request, and what it is made of."""
    if quantity not in QUANTITIES:
        raise UserError(f'quantity "{quantity}": allowed are {", ".join(QUANTITIES)}')
    if isinstance(paths, memory.Held):
        return reader.Request(quantity, paths.name, variables or {}, *how), paths
    listed = [paths] if isinstance(paths, str | os.PathLike) else list(paths)
    return reader.Request(quantity, dataset.title(listed), variables or {}, *how), listed


def _titles(paths: Any) -> Any:
    """Return what messages call the files, or the dataset in memory."""
    return [paths.title] if isinstance(paths, memory.Held) else paths


def _source(asked: reader.Request, name: str | None, reading: reader.Reading) -> Source:
    first = Source(
        asked.quantity,
        name or asked.name,
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


def constant(
    quantity: str,
    east: float,
    north: float,
    name: str = "as reported",
    about: tuple[float, float] | None = None,
) -> Source:
    """Return a steady, uniform field [m/s] over the globe; about: see `table`."""
    return _uniform(
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
        quantity: of the forcing.
        times: UTC, ascending, shape (nt,).
        east: component [m/s], shape (nt,).
        north: component [m/s], shape (nt,).
        name: of the source.
        about: the place (lon, lat) [deg] for which the field is stated, where the domain holds a
            pole: then the field has one direction in the plane of the pole, and not one to true
            north, which there turns from place to place.

    Raises:
        UserError: the table is too short, or its times do not increase.
    """
    when = np.asarray(times).astype("datetime64[s]").reshape(-1)
    u, v = np.asarray(east, float).reshape(-1), np.asarray(north, float).reshape(-1)
    if not len(when) == len(u) == len(v) or len(when) < 2:
        raise UserError(
            f"[[{quantity}]] table: {len(when)} times for {len(u)} values; give at least two rows"
        )
    if (np.diff(when) <= np.timedelta64(0, "s")).any():
        raise UserError(f"[[{quantity}]] table: times must increase")
    return _uniform(quantity, when, u, v, name, about)


def _uniform(
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

    spoken = " then ".join(
        as_said(quantity, *vector)
        for vector in zip(east[:3].tolist(), north[:3].tolist(), strict=True)
    )
    rest = f" and {len(values) - 3} more" if len(values) > 3 else ""
    note = f"the same everywhere: {spoken}{rest}"
    if about is None:
        return Source(quantity, name, EVERYWHERE, times, read, 0.0, (note,), digest)
    note += f"; near the pole one direction, stated for {notation.position(*about)}"
    return Source(quantity, name, ABOUT_POLE, times, read_about, 0.0, (note,), digest)


def as_said(quantity: str, east: float, north: float) -> str:
    """Return a vector as mariners say it: winds from, currents toward, knots."""
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
    """Return a built-in synthetic flow over a box, hourly from before start to after end (either
    order).

    parameters: those of the flow in `geo.forcing.analytic`; spacing [deg] overrides that of its
    tile.
    """
    spacing = parameters.pop("spacing", None)
    flow, usual = flows.build_flow(quantity, kind, box, **parameters)
    step = float(spacing or usual)
    width, height = box.east - box.west, box.north - box.south
    step = max(step, float(np.sqrt(width * height / MOST_NODES)))
    if box.east - box.west >= 360.0:
        step = 360.0 / np.ceil(360.0 / step)
    # Nodes stand at multiples of the step, so that their places do not depend on the box.
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
    first, last = sorted((_second(start), _second(end)))
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

    given = ", ".join(f"{k} = {v:g}" for k, v in sorted(parameters.items()))
    digest = hashlib.sha256(f"{kind} {given} {grid} {first} {last}".encode()).hexdigest()[:16]
    notes = (
        f'SYNTHETIC: built-in flow "{kind}"{" with " + given if given else ""}, no observation or model',
    )
    missing = float((np.abs(grid.lat) > 89.0).mean())
    return Source(quantity, f"synthetic {kind}", grid, times, read, missing, notes, digest)


def _second(time: Any) -> np.datetime64:
    return np.datetime64(time, "s")
