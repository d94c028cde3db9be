"""Report of `drift info FILE`: how a file was interpreted, what is missing, and a text map."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from geo import notation, sphere
from geo.box import Box
from geo.errors import UserError
from geo.files import address, dataset
from geo.forcing import quantities, sources
from geo.forcing.quantity import QUANTITIES, list_quantities
from geo.forcing.sources import Source

ARROWS = "→↗↑↖←↙↓↘"  # from east, counterclockwise, 45 degrees each
LOOKED_AT = 1000  # sources with more slices than this are not searched for blank slices
LAND, CALM = "·", "○"


def open_quantities(paths: dataset.Paths, only: str | None = None, **options: Any) -> list[Source]:
    """Return one source for every quantity that the files hold.

    Args:
        paths: the files or addresses.
        only: read the files as this quantity; by default every quantity is searched for.
        options: as in `sources.open_source`.

    Raises:
        UserError: no quantity was found, or none of those found can be read (no units, say).
    """
    understood: list[Source] = []
    errors: dict[str, UserError] = {}
    patience = options.get("timeout", address.TIMEOUT)
    listed = dataset.expand(paths, only or "current")
    # The process that reads an address ends with the last of its datasets. Keeping these references
    # lets one process serve all reads below.
    _open_addresses = [
        dataset.open_one(p, "current", patience) for p in listed if dataset.is_remote(p)
    ]
    with dataset.reporting_damage(listed, "current"):
        files_of = (
            {only: listed}
            if only
            else _files_by_quantity(listed, options.get("variables") or {}, patience)
        )
    own = [str((options.get("variables") or {}).get(key, "")) for key in ("east", "north")]
    if not files_of and any(own):
        raise UserError(
            f"{dataset.title(listed)}: nothing says whether {' and '.join(filter(None, own))} are "
            f"{list_quantities('a ')}; say which: --as"
        )
    for quantity in QUANTITIES:
        if files_of and quantity not in files_of:
            continue
        try:
            found = sources.open_source(
                quantity, files_of.get(quantity, listed), lenient=True, **options
            )
            if found.times.size <= LOOKED_AT and not any(
                dataset.is_remote(path) for path in listed
            ):
                found = (
                    found.without_blank_slices(found.times[0], found.times[-1])
                    if found.times.size
                    else found
                )
            understood.append(found)
        except UserError as error:
            errors[quantity] = error
    if not files_of:
        halves = [e for e in errors.values() if "one component" in str(e)]
        why = (halves or [errors["current"]])[0]
        raise UserError(f"no {list_quantities()} found: {why}") from why
    if not understood:
        raise next(iter(errors.values()))
    return understood


def _files_by_quantity(
    listed: list[str], chosen: Mapping[str, Any], patience: float
) -> dict[str, list[str]]:
    """Return for each quantity the files that hold it and those that hold no quantity (grids)."""
    variables: dict[str, dict[str, Any]] = {}
    for path in listed:
        data = dataset.open_one(path, "current", patience)
        variables[path] = {str(n): v.attrs for n, v in data.variables.items() if v.ndim >= 1}
    everything = {
        name: attributes for held in variables.values() for name, attributes in held.items()
    }
    names: dict[str, set[str]] = {}
    for quantity in QUANTITIES:
        for fields in (everything, *variables.values()):  # files may have other names for the same
            try:
                pair = quantities.search(quantity, fields)
            except UserError:
                # several pairs fit: let `open_source` raise the error that lists them
                names[quantity] = set(everything)
                break
            if pair is not None:
                names.setdefault(quantity, set()).update((pair.east, pair.north))
    own = {str(chosen[key]) for key in ("east", "north") if key in chosen}
    names = {quantity: own or wanted for quantity, wanted in names.items()}
    idle = [
        path
        for path, held in variables.items()
        if not any(wanted & held.keys() for wanted in names.values())
    ]
    return {
        quantity: [path for path in listed if path in idle or wanted & variables[path].keys()]
        for quantity, wanted in names.items()
    }


def describe(source: Source) -> list[str]:
    """Return the lines of the report on a source: area, times, missing share, speeds and notes."""
    grid, box = source.grid, source.grid.box
    lines = [f"{QUANTITIES[source.quantity].spoken}: {source.name}"]
    around = " round the Earth" if grid.seamless else ""
    lines.append(
        f"  where    {_format_box(box)}{around}; {grid.nlon} x {grid.nlat} nodes of {grid.dlon:.4g} x {grid.dlat:.4g} "
        "degrees"
    )
    lines.append(f"  when     {_describe_times(source)}")
    values = source.read(0)
    speed = np.hypot(values[..., 0], values[..., 1])
    missing = f"  missing  {notation.percent(source.missing)} of the nodes of the first slice"
    lines.append(missing)
    if np.isfinite(speed).any():
        unit = QUANTITIES[source.quantity].unit_text
        figures = (
            f"mean {np.nanmean(speed, dtype=float):.2f}{unit}, largest {np.nanmax(speed):.2f}{unit}"
        )
        middle = np.nanmean(values.reshape(-1, 2), axis=0, dtype=float)
        lines.append(
            f"  value    {figures}"
            if QUANTITIES[source.quantity].scalar
            else f"  speed    {figures}; mean vector {middle[0]:+.2f} east, {middle[1]:+.2f} north"
        )
    lines += [f"  note     {note}" for note in source.notes]
    lines.append(f"  hash     {source.fingerprint}")
    return lines


def sketch(source: Source, width: int = 60, height: int = 22) -> list[str]:
    """Return a text map of the first slice, north up, one string per row.

    An arrow points where the flow goes; "·" means missing, "○" nearly calm.
    """
    grid, values = source.grid, source.read(0)
    middle = np.cos(np.radians(grid.lat0 + grid.dlat * (grid.nlat - 1) / 2))
    ratio = (grid.nlon - 1) * grid.dlon * max(middle, 0.1) / ((grid.nlat - 1) * grid.dlat)
    # a character is twice as high as wide
    columns = int(min(width, grid.nlon, max(2, round(2 * height * ratio))))
    rows = int(min(height, grid.nlat, max(2, round(columns / ratio / 2))))
    j = np.linspace(grid.nlat - 1, 0, rows).round().astype(int)
    i = np.linspace(0, grid.nlon - 1, columns).round().astype(int)
    picked = values[np.ix_(j, i)].astype(float)
    speed = np.hypot(picked[..., 0], picked[..., 1])
    typical = float(np.sqrt(np.nanmean(speed**2))) if np.isfinite(speed).any() else 0.0
    lines = []
    for row, fast in zip(picked, speed, strict=True):
        text = ""
        for (east, north), s in zip(row, fast, strict=True):
            if not np.isfinite(s):
                text += LAND
            elif s <= 0.1 * typical:
                text += CALM
            else:
                text += ARROWS[int(np.round(np.degrees(np.arctan2(north, east)) / 45.0)) % 8]
        lines.append("  " + text)
    return lines


def _describe_times(source: Source) -> str:
    times = source.times[1:-1] if source.edges else source.times
    if len(times) == 0:
        return "steady: at all times"
    if len(times) == 1:
        return f"{notation.format_dtg(times[0])} only"
    steps = np.unique(np.diff(times).astype("m8[m]").astype(int))
    spacing = (
        f"every {_format_interval(steps[0])}"
        if len(steps) == 1
        else f"{_format_interval(steps[0])} to {_format_interval(steps[-1])} apart"
    )
    hold_text = (
        f", held from {notation.format_dtg(source.times[0])} to {notation.format_dtg(source.times[-1])}"
        if source.edges
        else ""
    )
    return f"{notation.format_dtg(times[0])} to {notation.format_dtg(times[-1])}, {len(times)} slices {spacing}{hold_text}"


def _format_interval(minutes: int) -> str:
    return f"{minutes / 60:g} h" if minutes >= 60 else f"{minutes} min"


def _format_box(box: Box) -> str:
    west, east = (f"{abs(v):.2f} {'EW'[v < 0]}" for v in (box.west, sphere.wrap_degrees(box.east)))
    south, north = (f"{abs(v):.2f} {'NS'[v < 0]}" for v in (box.south, box.north))
    return f"{west} to {east}, {south} to {north}"
