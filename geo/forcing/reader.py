"""Open the files of a source and read slices of it on a regular grid, for `sources.open_source`."""

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from geo import notation, sphere
from geo.array import Array
from geo.box import Box
from geo.errors import UserError
from geo.files import dataset
from geo.forcing import derived, ensemble, harmonise, members, quantities, survey, validity
from geo.forcing.quantity import QUANTITIES
from geo.forcing.reading import blank, component, memory, nest, slices, tile
from geo.forcing.reading.component import Component
from geo.forcing.reading.kept import Kept
from geo.forcing.times import averages, clock, versions
from geo.grids import fill, layout, naming
from geo.grids.grid import Grid
from geo.grids.layout import Layout

Values = NDArray[np.float32]

ZERO = "(zero)"  # name of the second component of a scalar


@dataclass(frozen=True)
class Reading:
    """How to read one quantity from files; `sources.Source` has the same fields."""

    grid: Grid
    times: clock.Times
    read: Callable[[int], Values]
    missing: float
    notes: tuple[str, ...]
    fingerprint: str
    domain: NDArray[np.bool_] | None
    # of an ensemble: label and read function of every member but the first
    others: tuple[tuple[str, Callable[[int], Values]], ...] = ()
    label: str = ""  # of the first member
    edges: bool = False  # the first and the last time are edges of means, which hold there
    # returns which of some slices have no value in at least one member
    blank: Callable[[Sequence[int]], list[int]] | None = None


@dataclass(frozen=True)
class Request:
    """How the user wants files read; the arguments of `sources.open_source`."""

    quantity: str
    name: str
    variables: Mapping[str, Any]
    units: str | None
    times: Any
    steady: bool
    box: Box | None
    depth: float | None
    # a single slice is accepted: it is enough to describe a file, but not for a run
    lenient: bool
    plausible: bool  # the user vouches for the values: none is rejected as an impossible speed
    timeout: float  # [s] of requests to an address
    # True: the files are members of an ensemble; str: the dimension along which members lie
    members: bool | str = False
    # the files of each member, if no dimension holds members
    entries: tuple[tuple[str, ...], ...] = ()


@dataclass(frozen=True)
class Opened:
    """An opened source before a box is cut out of it: everything that no case's area affects."""

    request: Request
    paths: dataset.Paths | memory.NamedDataset
    files: list[tuple[str, xr.Dataset]]
    pair: quantities.Pair
    components: tuple[Component, Component]
    times: clock.Times
    count: int  # number of slices
    whole: survey.Survey
    notes: tuple[str, ...]
    label: str = ""  # as a member of an ensemble
    # the other members of the ensemble, if this is the first
    others: tuple["Opened", ...] = ()
    edges: bool = False  # the first and the last time are edges of means, which hold there


def open_reader(request: Request, paths: dataset.Paths | memory.NamedDataset) -> Reading:
    """Open files or a dataset in memory, and return how to read the quantity over the box."""
    opened = open_all(request, paths)
    reading = cut_source(opened, request.box)
    q, pair = request.quantity, opened.pair
    options = f"{request.variables} {request.units} {request.times} {request.steady} {request.depth} {request.box}"
    options += f" members {request.members}" if request.members else ""
    time = opened.components[0].segments[0][2]
    digest = _fingerprint(
        request, paths, opened.files, pair, time, f"{q} {pair.east} {pair.north} {options}"
    )
    return replace(reading, fingerprint=digest)


def open_all(request: Request, paths: dataset.Paths | memory.NamedDataset) -> Opened:
    """Open files or a dataset in memory, find the quantity, and survey its values.

    Args:
        request: what to read and how; its box is not used.
        paths: of the files, or a dataset in memory.

    Returns:
        The source; for an ensemble the first member with all others in `others`.
    """
    files = _open_files(request, paths)
    if not request.members:
        return _open_single(request, paths, files)
    dim = request.members if isinstance(request.members, str) else None
    if dim is not None and not any(dim in data.dims for _, data in files):
        raise UserError(_no_members_message(request, files))
    if dim is not None or any(members.lie_in(data) for _, data in files):
        return _members_along_dim(_open_single(request, paths, files))
    return _members_by_entry(request, paths, files)


def _open_files(
    request: Request, paths: dataset.Paths | memory.NamedDataset
) -> list[tuple[str, xr.Dataset]]:
    if isinstance(paths, memory.NamedDataset):
        return [(paths.title, memory.as_stored(paths))]
    q = request.quantity
    return [(path, dataset.open_one(path, q, request.timeout)) for path in dataset.expand(paths, q)]


def _members_along_dim(opened: Opened) -> Opened:
    """Return a source as an ensemble whose members lie along a dimension of its variables."""
    request, pair = opened.request, opened.components
    ensemble.check_sizes(request.name, request.quantity, pair)
    dim = pair[0].member
    if dim is None:
        raise UserError(_no_members_message(request, opened.files))
    labels = members.labels(pair[0].segments[0][0], dim)
    pairs = [
        (
            replace(pair[0], fixed={**pair[0].fixed, dim: k}),
            replace(pair[1], fixed={**pair[1].fixed, dim: k}),
        )
        for k in range(len(labels))
    ]
    for number, own in enumerate(pairs):
        with _naming_member(number, labels, f"{dim} = ", request.name):
            for component_ in own:
                ensemble.check_held(component_)
    others = tuple(
        replace(opened, components=own, label=label)
        for own, label in zip(pairs[1:], labels[1:], strict=True)
    )
    note = f"{len(labels)} members of an ensemble along {dim}: {members.some(labels)}"
    return replace(opened, label=labels[0], others=others, notes=(*opened.notes, note))


def _members_by_entry(
    request: Request,
    paths: dataset.Paths | memory.NamedDataset,
    files: list[tuple[str, xr.Dataset]],
) -> Opened:
    """Return an ensemble of which each entry of `request.entries` is a member."""
    if len(request.entries) < 2:
        raise UserError(_no_members_message(request, files))
    labels = _member_labels(request.entries)
    all_opened: list[Opened] = []
    datasets = dict(files)
    for number, entry in enumerate(request.entries):
        with _naming_member(number, labels), dataset.reporting_damage(entry, request.quantity):
            own = [
                (
                    path,
                    datasets[path]
                    if path in datasets
                    else dataset.open_one(path, request.quantity, request.timeout),
                )
                for path in dataset.expand(entry, request.quantity)
            ]
            opened = _open_single(
                replace(request, name=dataset.title(entry), members=False), entry, own
            )
            for component_ in opened.components:
                ensemble.check_held(component_)
            if all_opened:
                ensemble.check_grid(opened.components, all_opened[0].components, request.quantity)
        all_opened.append(opened)
    times, chosen = ensemble.common(
        [opened.times for opened in all_opened], request.name, request.quantity
    )
    all_opened = [
        _select_times(opened, times, own, label)
        for opened, own, label in zip(all_opened, chosen, labels, strict=True)
    ]
    first, notes = all_opened[0], list(all_opened[0].notes)
    if first.count < max(own.max() + 1 for own in chosen):
        notes.append(f"{first.count} times that all members have")
    notes.append(f"{len(labels)} members of an ensemble, by file: {members.some(labels)}")
    return replace(
        first,
        request=request,
        paths=paths,
        files=files,
        others=tuple(all_opened[1:]),
        notes=tuple(notes),
    )


@contextmanager
def _naming_member(
    number: int, labels: Sequence[str], by: str = "", name: str = ""
) -> Iterator[None]:
    """Add the ensemble member's name to an error message."""
    try:
        yield
    except UserError as error:
        place = f"member {number + 1} of {len(labels)} ({by}{labels[number]})"
        raise UserError(f"{name}: {place} {error}" if name else f"{place}: {error}") from error


def _select_times(opened: Opened, times: clock.Times, chosen: Array, label: str) -> Opened:
    """Return a member reduced to some of its times; chosen: the indices of their slices."""
    first, second = (
        replace(c, segments=tuple(c.segments[k] for k in chosen)) for c in opened.components
    )
    place = {int(old): new for new, old in enumerate(chosen)}
    surveyed = replace(
        opened.whole,
        looked_at=tuple(place[k] for k in opened.whole.looked_at if k in place) or (0,),
    )
    return replace(
        opened,
        components=(first, second),
        times=times,
        count=len(chosen),
        whole=surveyed,
        label=label,
    )


def _member_labels(entries: tuple[tuple[str, ...], ...]) -> list[str]:
    """Return labels for members given by files: file names, else folder names, else numbers."""
    firsts = [entry[0].rstrip("/") for entry in entries]
    names = [os.path.splitext(os.path.basename(path))[0] for path in firsts]
    folders = [os.path.basename(os.path.dirname(path)) for path in firsts]
    for labels in (names, folders):
        if len(set(labels)) == len(entries):
            return labels
    return [str(number) for number in range(1, len(entries) + 1)]


def _no_members_message(request: Request, files: list[tuple[str, xr.Dataset]]) -> str:
    dims = sorted({f"{dim} = {size}" for _, data in files for dim, size in data.sizes.items()})
    wanted = (
        f'"{request.members}"'
        if isinstance(request.members, str)
        else f"one of the names {members.NAMES}"
    )
    return (
        f"{request.name}: [[{request.quantity}]] members = {str(request.members).lower()}, but there are no members: no "
        f"dimension of both components has {wanted} (it has {', '.join(dims)[:300]}), nor are there several files; name a "
        'file for each member, or the dimension: members = "..."'
    )


def _open_single(
    request: Request,
    paths: dataset.Paths | memory.NamedDataset,
    files: list[tuple[str, xr.Dataset]],
) -> Opened:
    q = request.quantity
    notes: list[str] = []
    files = harmonise.rename_components(q, files, request.variables, notes)
    attributes: dict[str, Mapping[str, Any]] = {}
    for _, data in files:
        for key, variable in data.variables.items():
            if variable.ndim >= 1:
                attributes.setdefault(str(key), variable.attrs)
    fields = {k: a for k, a in attributes.items() if _is_field(k, files)}
    _check_chosen(request, files)
    pair = quantities.find(q, fields, request.variables, request.name)
    names = pair.east if QUANTITIES[q].scalar else f"{pair.east}, {pair.north}"
    notes.append(f"{QUANTITIES[q].spoken} from {names} (found by {pair.how})")
    _check_sizes(request, pair, files)
    if QUANTITIES[q].scalar:
        files = [(path, _with_zero_component(data, pair.east)) for path, data in files]
        pair = replace(pair, north=ZERO)
    first, second = _gather_components(request, pair, files, notes)
    if request.lenient and not request.members and first.member is not None:
        labels = members.labels(first.segments[0][0], first.member)
        notes.append(
            f"{len(labels)} members of an ensemble along {first.member}: {members.some(labels)}; members = true to drift in all of "
            "them; shown is the first"
        )
    first, second, times = _join_times(request, first, second, notes)
    first, second, times, edges = _add_edge_times(first, second, times)
    notes += first.notes + tuple(n for n in second.notes if n not in first.notes)
    count = 1 if request.steady else len(first.segments)
    surveyed = survey.survey_slices((first, second), count, request.plausible, request.name)
    first, second = (
        replace(c, fills=fills, vouched=request.plausible)
        for c, fills in zip((first, second), surveyed.fills, strict=True)
    )
    return Opened(
        request,
        paths,
        files,
        pair,
        (first, second),
        times,
        count,
        surveyed,
        tuple(notes),
        edges=edges,
    )


def cut_source(opened: Opened, box: Box | None) -> Reading:
    """Return how to read the part of a source that a case needs; its fingerprint is empty.

    Args:
        opened: the source.
        box: area of the case; None for the whole source.

    Raises:
        UserError: the source does not overlap the box, or has no value there.
    """
    request, (first, second), surveyed = (
        replace(opened.request, box=box),
        opened.components,
        opened.whole,
    )
    wanted = _needed_box(box)
    if nest.moves((first, second)):
        return _cut_nest(opened, request, wanted)
    crops = [layout.crop(c.layout, wanted) for c in (first, second)]
    if crops[0] is None or crops[1] is None:
        raise UserError(_no_overlap_message(request, first.layout))
    regridded = tile.build_tile((first, second), (crops[0], crops[1]), opened.pair.axes, wanted)
    seen = tile.examine(regridded, opened.count, surveyed)
    if seen.missing == 1.0 and seen.empty:
        inside = " in the case's area" if box is not None else ""
        odd = (
            f" ({seen.strange} are no possible speed: are the units right?)" if seen.strange else ""
        )
        raise UserError(
            f"{request.name}: every value is missing{inside}{odd}; set [[{request.quantity}]] files"
        )
    regridded = seen.tile
    return Reading(
        regridded.grid,
        opened.times,
        lambda i: tile.read_tile(regridded, i),
        seen.missing,
        opened.notes + surveyed.notes + regridded.notes + seen.notes,
        "",
        tile.domain(regridded),
        tuple(
            (other.label, partial(_read_slice, replace(regridded, components=other.components)))
            for other in opened.others
        ),
        opened.label,
        opened.edges,
        _blank_finder(
            [
                regridded,
                *(replace(regridded, components=other.components) for other in opened.others),
            ]
        ),
    )


def _blank_finder(tiles: Sequence[tile.Tile]) -> Callable[[Sequence[int]], list[int]]:
    """Return a test for slices that are blank in any of some tiles; it reads each slice once."""
    known: dict[int, bool] = {}

    def find(indices: Sequence[int]) -> list[int]:
        unknown = [i for i in indices if i not in known]
        found = {
            i for regridded in tiles for i in blank.find_blank_slices(regridded, unknown, indices)
        }
        known.update((i, i in found) for i in unknown)
        return [i for i in indices if known[i]]

    return find


def _cut_nest(opened: Opened, request: Request, wanted: Box | None) -> Reading:
    """Do what `cut_source` does for a grid that moves."""
    pair, surveyed = opened.components, opened.whole
    moving_nest = nest.make(pair, opened.count, opened.pair.axes, wanted, surveyed.dry)
    if moving_nest is None:
        raise UserError(_no_overlap_message(request, pair[0].layout))
    missing, empty = nest.missing(moving_nest)
    if empty:
        raise UserError(f"{request.name}: every value is missing; set [[{request.quantity}]] files")
    return Reading(
        moving_nest.grid,
        opened.times,
        partial(nest.read_nested_slice, moving_nest),
        missing,
        opened.notes + surveyed.notes + moving_nest.notes,
        "",
        moving_nest.domain,
        tuple(
            (
                o.label,
                partial(nest.read_nested_slice, replace(moving_nest, components=o.components)),
            )
            for o in opened.others
        ),
        opened.label,
        opened.edges,
    )


def _read_slice(regridded: tile.Tile, i: int) -> Values:
    return tile.read_tile(regridded, i)


def keep(opened: Opened, box: Box) -> Opened:
    """Return a source that keeps slices in memory over a box once they are read.

    `cut_source` takes parts inside the box from memory. For an ensemble, only the first member's
    slices are kept.
    """
    kept = []
    if nest.moves(opened.components):
        return opened
    for component_ in opened.components:
        crop = layout.crop(component_.layout, _needed_box(box))
        kept.append(
            component_ if crop is None else replace(component_, kept=Kept(slices.window(crop)))
        )
    return replace(opened, components=(kept[0], kept[1]))


def _fingerprint(
    request: Request,
    paths: dataset.Paths | memory.NamedDataset,
    files: list[tuple[str, xr.Dataset]],
    pair: quantities.Pair,
    time: str | None,
    extra: str,
) -> str:
    """Return a short hash of the files' bytes, or of the values of a dataset in memory."""
    if not isinstance(paths, memory.NamedDataset):
        return dataset.fingerprint([p for p, _ in files], [d for _, d in files], extra)
    used = {pair.east, pair.north, *map(str, request.variables.values())}
    for name in (pair.east, pair.north):
        used.update(str(files[0][1][name].attrs.get("ancillary_variables", "")).split())
    return memory.fingerprint(files[0][1], used, time, extra)


def _needed_box(box: Box | None) -> Box | None:
    """Return a box with all nodes from which a node inside `box` may be filled.

    With it, a cropped source is filled exactly as the whole one would be.
    """
    if box is None:
        return None
    margin = float(np.degrees(fill.REACH / sphere.RADIUS))
    cosine = np.cos(np.radians(min(89.0, max(abs(box.south), abs(box.north)) + margin)))
    return box.grown(float(margin / cosine), margin)


def _check_chosen(request: Request, files: list[tuple[str, xr.Dataset]]) -> None:
    """Raise UserError for a variable named in the case that no file holds."""
    variables = {str(n): v for _, d in files for n, v in d.variables.items()}
    for key in ("lon", "lat", "time", "angle", "mask", "x", "y"):
        name = request.variables.get(key)
        if name is None or (key == "mask" and name in ("none", False)):
            continue
        if name not in variables:
            raise UserError(
                f'{request.name}: no variable "{name}"; set [[{request.quantity}]] variables.{key}'
            )
        if key in ("lon", "lat", "x", "y") and not np.issubdtype(variables[name].dtype, np.number):
            raise UserError(
                f'{request.name}: "{name}" holds no numbers; set [[{request.quantity}]] variables.{key}'
            )


def _check_sizes(
    request: Request, pair: quantities.Pair, files: list[tuple[str, xr.Dataset]]
) -> None:
    """Raise UserError for components without values, or one variable named as both."""
    for path, data in files:
        for name in (pair.east, pair.north):
            empty = (
                [str(d) for d in data[name].dims if data.sizes[d] == 0]
                if name in data.variables
                else []
            )
            if empty:
                raise UserError(
                    f"{path}: {component.describe_dims(data, name)} holds no value along {empty[0]}; "
                    f"set [[{request.quantity}]] files"
                )
        shared = (
            not QUANTITIES[request.quantity].scalar
            and pair.east == pair.north
            and pair.east in data.variables
        )
        if shared and not any(str(d).lower() in component.HORIZONTAL for d in data[pair.east].dims):
            raise UserError(
                f"{path}: {pair.east} is named as both components; set [[{request.quantity}]] variables.north"
            )


def _with_zero_component(data: xr.Dataset, name: str) -> xr.Dataset:
    """Return a dataset in which a scalar has a second component, zero where the scalar has a
    value.
    """
    if name not in data.variables:
        return data
    variable = data[name].variable

    def read(part: derived.Part) -> Array:
        return derived.values_of(variable, part) * 0.0

    zero = xr.DataArray(derived.derive(variable, read), data[name].coords)
    return data.assign({ZERO: zero})


def _is_field(name: str, files: list[tuple[str, xr.Dataset]]) -> bool:
    """Return True if a variable can be a component: numeric, and no coordinate of its own axis."""
    data = next(d for _, d in files if name in d.variables)
    return np.issubdtype(data[name].dtype, np.number) and data[name].dims != (name,)


def _gather_components(
    request: Request, pair: quantities.Pair, files: list[tuple[str, xr.Dataset]], notes: list[str]
) -> tuple[Component, Component]:
    holding = [(p, d) for p, d in files if pair.east in d.variables or pair.north in d.variables]
    others = [
        (p, d) for p, d in files if pair.east not in d.variables and pair.north not in d.variables
    ]
    lent: dict[str, xr.Variable] = {}
    for path, data in others:
        own = {
            str(n): v
            for n, v in data.variables.items()
            if naming.of_grid(str(n), v.attrs) and "time" not in v.dims
        }
        if not any(
            naming.LON.match(n) or str(v.attrs.get("standard_name", "")) == "longitude"
            for n, v in own.items()
        ):
            raise UserError(
                f"{path} holds neither {pair.east} nor {pair.north}; remove it from [[{request.quantity}]] files"
            )
        lent |= own
        notes.append(f"grid from {os.path.basename(path)}")
    if lent:
        holding = [(p, _with_grid_variables(d, lent)) for p, d in holding]
    holding = [(path, _apply_validity(request, pair, data, notes)) for path, data in holding]
    holding = harmonise.align_grids(holding, (pair.east, pair.north), request.units, notes)
    stated = request.steady or clock.states_times(request.times)
    result = []
    for side, name in enumerate((pair.east, pair.north)):
        having = [(path, data) for path, data in holding if name in data.variables]
        wanted = component.Wanted(
            name,
            side,
            request.quantity,
            request.variables,
            request.units,
            request.depth,
            needs_times=not stated,
            members=request.members or request.lenient,
            times=request.times,
            steady=request.steady,
        )
        try:
            result.append(component.gather(wanted, having))
        except (IndexError, ValueError) as error:
            if not {"lon", "lat"} & set(request.variables):
                raise
            raise UserError(
                f"{request.name}: the longitude and latitude that [[{request.quantity}]] variables name do not fit "
                f"{component.describe_dims(having[0][1], name)}; set variables.lon and variables.lat"
            ) from error
    return result[0], result[1]


def _apply_validity(
    request: Request, pair: quantities.Pair, data: xr.Dataset, notes: list[str]
) -> xr.Dataset:
    """Return a dataset with invalid values of its components set to NaN and versions merged."""
    for name in dict.fromkeys((pair.east, pair.north)):
        if name not in data.variables:
            continue
        own: list[str] = []
        if not request.plausible:
            data = data.assign({name: validity.apply(data, name, own)})
        if versions.NAME not in request.variables:
            data = data.assign({name: versions.merge_versions(data, name, own)})
        notes += [note for note in own if note not in notes]
    return data


def _with_grid_variables(data: xr.Dataset, lent: Mapping[str, xr.Variable]) -> xr.Dataset:
    """Return a dataset with the grid variables that it lacks, where their dimensions agree."""
    fitting = {
        n: v
        for n, v in lent.items()
        if n not in data.variables
        and all(data.sizes.get(d, v.sizes[d]) == v.sizes[d] for d in v.dims)
    }
    return data.assign(fitting)


def _join_times(
    request: Request, first: Component, second: Component, notes: list[str]
) -> tuple[Component, Component, clock.Times]:
    """Reduce both components to their common slices; return them and their times.

    The times are empty for a steady field.
    """
    q, none = request.quantity, np.empty(0, "datetime64[s]")
    if request.steady:
        if len(first.segments) > 1:
            notes.append(f"steady: the first of {len(first.segments)} slices stands for all times")
        return first, second, none
    if clock.states_times(request.times):
        if len(first.segments) != len(second.segments):
            raise UserError(
                f"{request.name}: {first.name} and {second.name} have different numbers of slices, "
                f"{len(first.segments)} and {len(second.segments)}; name files of as many in [[{q}]] files"
            )
        times = clock.stated(request.times, len(first.segments), q)
        if len(times) == 1:
            raise UserError(
                f"{request.name}: one slice cannot be interpolated in time; set [[{q}]] steady = true"
            )
        notes.append("times as the case states them")
        return _apply_stated_times(request, first, second, times, notes)
    assert first.times is not None
    assert second.times is not None
    times, in_first, in_second = np.intersect1d(first.times, second.times, return_indices=True)
    if len(times) == 0:
        raise UserError(
            f"{request.name}: {first.name} ({_format_span(first.times)}) and {second.name} ({_format_span(second.times)}) have no "
            f"time in common; name files of the same times in [[{q}]] files"
        )
    if len(times) < max(len(first.times), len(second.times)):
        notes.append(
            f"{len(times)} times common to {first.name} ({len(first.times)}) and {second.name} ({len(second.times)})"
        )
        first, second = _select_slices(first, in_first), _select_slices(second, in_second)
    if len(times) == 1:
        if not request.lenient:
            raise UserError(
                f"{request.name}: one time only, {notation.format_dtg(times[0])}, which cannot be interpolated in time; "
                f"set [[{q}]] steady = true to hold it constant, or name files of other times in [[{q}]] files"
            )
        notes.append("one time only: a run needs steady = true, or files of other times")
    elif np.median(np.diff(times)) > np.timedelta64(25, "h"):
        notes.append(
            f"slices are {np.median(np.diff(times)).astype('m8[h]').astype(int)} h apart: tides and gusts are not resolved"
        )
    return first, second, times


def _format_span(times: clock.Times) -> str:
    return f"{notation.format_dtg(times[0])} to {notation.format_dtg(times[-1])}"


def _apply_stated_times(
    request: Request, first: Component, second: Component, times: clock.Times, notes: list[str]
) -> tuple[Component, Component, clock.Times]:
    """Return components with the times that a case states.

    If the case states a stamp, the slices are means, placed at the middle of their intervals.
    """
    stamp = clock.stamp(request.times)
    if not stamp:
        return first, second, times
    none = averages.join_intervals([None], [len(times)])
    moved, cells, remarks = averages.slice_times(
        times, none, averages.Method("", "", ""), stamp, ""
    )
    notes += remarks
    return replace(first, cells=cells), replace(second, cells=cells), moved


def _select_slices(component_: Component, index: Array) -> Component:
    """Return a component with some of its slices."""
    cells = component_.cells if component_.cells is None else component_.cells[index]
    return replace(component_, segments=tuple(component_.segments[k] for k in index), cells=cells)


def _add_edge_times(
    first: Component, second: Component, times: clock.Times
) -> tuple[Component, Component, clock.Times, bool]:
    """Return components of means with two more times: the outer edges of their intervals.

    The outermost means hold up to these edges. The last value returned is True if they were added.
    """
    if first.cells is None or second.cells is None or len(times) < 2:
        return first, second, times, False
    times, index = averages.add_interval_edges(times, first.cells)
    return _select_slices(first, index), _select_slices(second, index), times, True


def _no_overlap_message(request: Request, item: Layout) -> str:
    lon, lat = layout.points(item)
    box = request.box
    assert box is not None
    x, y = (box.west + box.east) / 2, (box.south + box.north) / 2
    placed = np.isfinite(lon) & np.isfinite(lat)
    near = np.argmin(
        np.where(
            placed,
            sphere.distance(np.radians(x), np.radians(y), np.radians(lon), np.radians(lat)),
            np.inf,
        )
    )
    where = notation.distance_and_direction(x, y, float(lon.flat[near]), float(lat.flat[near]))
    return (
        f"{request.name} covers {_format_extent(lon, lat)} and the case needs {box.west:.2f} to {box.east:.2f} E, "
        f"{box.south:.2f} to {box.north:.2f} N: no overlap; from the middle of that it is {where} to the nearest "
        f"value; set [[{request.quantity}]] files, or move the case"
    )


def _format_extent(lon: Array, lat: Array) -> str:
    turned = lon if np.ptp(lon[np.isfinite(lon)]) < 350 else sphere.wrap_degrees(lon)
    return f"{np.nanmin(turned):.2f} to {np.nanmax(turned):.2f} E, {np.nanmin(lat):.2f} to {np.nanmax(lat):.2f} N"
