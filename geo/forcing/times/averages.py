"""Times of slices that are means over an interval.

A mean is the best estimate for the middle of its interval, but files stamp it at the start, the
middle or the end. Time bounds give the interval. Without bounds its length is the spacing of the
slices, and its position follows from the product, if that is known, or from the case. Linear
interpolation of means placed this way is of second order: with x = pi T / P, means over consecutive
intervals T keep (sin(x) / x)^3 of the amplitude of a sinusoid of period P, instants (sin(x) / x)^2.
"""

import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from geo import notation
from geo.errors import UserError
from geo.forcing.times import clock, epoch
from geo.forcing.times.clock import Times

STAMPS = ("start", "middle", "end", "instant")
CELLS = "datetime64[s]"
# in units of the usual interval: a longer one means that a slice is absent
APART = 1.5
MONTH = (28 * 86400, 31 * 86400)  # [s]
SLACK = 0.02  # tolerance for stamps outside their bounds, as a share of the interval

# Names of Copernicus Marine Service data sets end with the type of their slices: mean (m) or
# instant (i).
COPERNICUS = re.compile(r"cmems_(?:mod|obs)[\w.\-]*_PT?\d+[HDMYS]-(m|i)(?![A-Za-z])")
# cell methods whose value is a good estimate for the middle of the interval
MEANS = ("mean", "average", "avg", "median", "mid_range")
# methods of CF, GRIB and XIOS that give no velocity; other words are ignored
OTHERS = (
    "sum",
    "maximum",
    "minimum",
    "maximum_absolute_value",
    "minimum_absolute_value",
    "mean_absolute_value",
    "mean_of_upper_decile",
    "mode",
    "range",
    "root_mean_square",
    "standard_deviation",
    "sum_of_squares",
    "variance",
    "max",
    "min",
    "accum",
    "accumulate",
    "diff",
    "rms",
    "sd",
    "cov",
    "ratio",
)
POINTS = ("point", "instant", "instantaneous", "once", "inst")
_METHODS = re.compile(r"((?:[\w.]+\s*:\s*)+)([A-Za-z_]+)((?:\s+(?:within|over|where)\s+[\w.]+)*)")
_WORDS = re.compile(
    r"\b(time[- ]?(?:averaged?|mean)|(?:hour|dai|week|month)ly[- ](?:averaged?|means?))\b",
    re.IGNORECASE,
)


@dataclass(frozen=True)
class Method:
    """Cell method of a variable over time: "mean", "point", another CF method, or "" if unknown.

    stamp: where in its interval a mean is stamped, "" if unknown; why: the evidence, for messages.
    """

    kind: str
    stamp: str
    why: str


def method_of(data: xr.Dataset, name: str, time_name: str | None, path: str) -> Method:
    """Return the cell method over time, from the attributes and the name of the product."""
    attributes = data[name].attrs
    axis = {
        "time",
        "t",
        *clock.NAMES,
        *([time_name, *map(str, data[time_name].dims)] if time_name else []),
    }
    product = _product_method(data, path)
    text = str(attributes.get("cell_methods", ""))
    for names, kind, rest in _METHODS.findall(re.sub(r"\([^)]*\)", " ", text)):
        if axis & {one.strip() for one in names.split(":")}:
            if re.search(r"\b(within|over)\b", rest):
                return Method("climatology", "", f'cell_methods "{text}"')
            return Method(
                _method_kind(kind),
                product.stamp if _method_kind(kind) == "mean" else "",
                f'cell_methods "{text}"',
            )
    for key in ("GRIB_stepType", "online_operation"):
        kind = _method_kind(str(attributes.get(key, "")).strip())
        if kind:  # GRIB stamps an average at its end
            return Method(
                kind,
                "end" if kind == "mean" and key == "GRIB_stepType" else "",
                f"{key} {attributes[key]}",
            )
    if product.kind:
        return product
    words = _WORDS.search(str(attributes.get("long_name", "")))
    return (
        Method("mean", "", f'long name "{attributes["long_name"]}"')
        if words
        else Method("", "", "")
    )


def _method_kind(method: str) -> str:
    low = method.lower()
    return "mean" if low in MEANS else "point" if low in POINTS else low if low in OTHERS else ""


def _product_method(data: xr.Dataset, path: str) -> Method:
    """Return the method that a Copernicus product name states, in the path or in attributes."""
    for text in (path, *(str(value) for value in data.attrs.values())):
        match = COPERNICUS.search(text)
        if match:
            kind = "mean" if match[1] == "m" else "point"
            return Method(
                kind, "start" if kind == "mean" else "", f"Copernicus data set {match[0]}"
            )
    return Method("", "", "")


def bounds_of(
    data: xr.Dataset, time_name: str, times: Times, zone: int | None
) -> tuple[Times | None, list[str]]:
    """Return the interval of each time of a file, and notes.

    Args:
        data: the file's dataset.
        time_name: the time variable.
        times: decoded, UTC, shape (n,).
        zone: [s] ahead of UTC that the case states; None for none.

    Returns:
        Intervals [UTC], shape (n, 2), or None without bounds; and notes.

    Raises:
        UserError: bounds contradict their times.
    """
    variable = data[time_name]
    name = str(variable.attrs.get("bounds", ""))
    if not name:
        return None, []
    if name not in data.variables:
        return None, [f'"{time_name}" names bounds "{name}" that the file lacks']
    bounds = data[name]
    values = np.asarray(bounds.values)
    if values.ndim == 1 and variable.ndim == 0:
        values = values[None, :]
    elif (
        variable.ndim == 1
        and bounds.ndim == 2
        and bounds.dims[1] == variable.dims[0]
        and bounds.dims[0] != bounds.dims[1]
    ):
        values = values.T
    if values.shape[-1:] != (2,) or values.ndim != 2 or len(values) < len(times):
        return None, [f'"{name}" is no interval for each time: not used']
    values = values[: len(times)]
    numbers = np.where(np.isin(values, clock.FILLS), np.nan, values.astype(np.float64))
    if not np.isfinite(numbers).all() or (numbers[:, 0] == numbers[:, 1]).all():
        return None, [] if np.isfinite(numbers).all() else [
            f'"{name}" has missing values: not used'
        ]
    units, calendar = (str(variable.attrs.get(key, "")) for key in ("units", "calendar"))
    own = str(bounds.attrs.get("units", ""))
    if own and own.strip() != units.strip() and epoch.is_shifted(own):
        units = own
    calendar = str(bounds.attrs.get("calendar", calendar)) or "standard"
    cells = np.sort(clock.dates(numbers, units, calendar.lower(), name, zone), axis=1)
    _check_bounds(cells, times, name)
    return cells, []


def _check_bounds(cells: Times, times: Times, name: str) -> None:
    """Raise UserError for bounds that do not contain their times, or that are out of order."""
    slack = (cells[:, 1] - cells[:, 0]) * SLACK + np.timedelta64(1, "s")
    outside = np.flatnonzero((times < cells[:, 0] - slack) | (times > cells[:, 1] + slack))
    if outside.size:
        k = int(outside[0])
        raise UserError(
            f'"{name}" says that the slice of {notation.format_dtg(times[k])} is of {notation.format_dtg(cells[k, 0])} to '
            f"{notation.format_dtg(cells[k, 1])}, which does not hold that time"
        )
    middles = _middles(cells)
    if (
        len(times) > 1
        and (np.sign(np.diff(middles.astype(int))) != np.sign(np.diff(times.astype(int)))).any()
    ):
        raise UserError(f'"{name}" gives intervals that are not in the order of their times')


def slice_times(
    times: Times, cells: Times, method: Method, stated: str, key: str
) -> tuple[Times, Times | None, list[str]]:
    """Return the times of slices, their intervals (n, 2) or None for instants, and notes.

    Args:
        times: as in the files, increasing, shape (n,).
        cells: intervals by bounds, NaT for none, shape (n, 2).
        method: cell method over time.
        stated: where the case says that times lie in their intervals, "" if it does not.
        key: of the case that states it, for messages.

    Raises:
        UserError: only some of the slices have bounds.
    """
    if stated == "instant":
        return times, None, ["times are taken as instants, as the case states"]
    if stated:
        return _place_by_spacing(times, stated, "as the case says")
    known = ~np.isnat(cells[:, 0])
    if known.all() and method.kind != "point":
        moved = _middles(cells)
        return moved, cells, [_describe_means(cells, times, moved, "by their time bounds")]
    if known.any() and method.kind != "point":
        raise UserError(
            f'some files have time bounds and some have none; state {key} = "start", "middle" or "end"'
        )
    if (
        not method.kind
        and len(times) > 1
        and _monthly_spacing(int(np.median(np.diff(times)).astype(int)))
    ):
        method = Method("mean", "", "slices a month apart")
    if method.kind != "mean" or len(times) < 2:
        return times, None, []
    if _are_midpoints(times):
        return _place_by_spacing(times, "middle", f"{method.why}, and stamps at half their spacing")
    if method.stamp:
        return _place_by_spacing(times, method.stamp, method.why)
    usual = np.median(np.diff(times))
    return (
        times,
        None,
        [
            f"WARNING: means over {_format_hours(usual)} ({method.why}), and nothing says whether they are stamped at the start, the "
            f'middle or the end: taken for the middle, which may be {_format_hours(usual / 2)} off; state {key} = "start", '
            '"middle" or "end"'
        ],
    )


def add_interval_edges(times: Times, cells: Times) -> tuple[Times, NDArray[np.int64]]:
    """Return times with the outer edges of the first and the last interval added.

    The outermost means hold up to these edges. The second value is the index of the slice for each
    time.
    """
    every = np.arange(len(times))
    index = np.concatenate(([0], every, [len(times) - 1]))
    return np.concatenate((cells[:1, 0], times, cells[-1:, 1])), index


def _place_by_spacing(times: Times, stamp: str, why: str) -> tuple[Times, Times | None, list[str]]:
    """Place means by their stamps alone: an interval lasts until the next stamp.

    At a gap it has the usual length.
    """
    if len(times) < 2:
        return times, None, []
    steps, usual = np.diff(times), np.median(np.diff(times)).astype("timedelta64[s]")
    steps = np.where(steps > APART * usual, usual, steps)
    if stamp == "start":
        last = _add_months(times[-1:], 1) - times[-1:] if _are_month_starts(times) else steps[-1:]
        begin, end = times, times + np.concatenate((steps, last))
    elif stamp == "end":
        first = times[:1] - _add_months(times[:1], -1) if _are_month_starts(times) else steps[:1]
        begin, end = times - np.concatenate((first, steps)), times
    else:
        begin = times - np.concatenate((steps[:1], steps)) // 2
        end = times + np.concatenate((steps, steps[-1:])) // 2
    cells = np.stack((begin, end), axis=1)
    moved = times if stamp == "middle" else _middles(cells)
    where = {"start": "stamped at their start", "end": "stamped at their end"}.get(
        stamp, "stamped at their middle"
    )
    return moved, cells, [_describe_means(cells, times, moved, f"{where}: {why}")]


def _describe_means(cells: Times, times: Times, moved: Times, why: str) -> str:
    lengths = np.unique(cells[:, 1] - cells[:, 0])
    over = (
        _format_hours(lengths[0])
        if len(lengths) == 1
        else f"{_format_hours(lengths[0])} to {_format_hours(lengths[-1])}"
    )
    shift = (
        ""
        if (moved == times).all()
        else f"; the slice stamped {notation.format_dtg(times[0])} is given {notation.format_dtg(moved[0])}"
    )
    return f"means over {over}, each placed at the middle of its interval ({why}){shift}; the first and last are held to the ends of their intervals"


def _middles(cells: Times) -> Times:
    return np.asarray(cells[:, 0] + (cells[:, 1] - cells[:, 0]) // 2)


def _are_midpoints(times: Times) -> bool:
    """Return True if all stamps lie half their spacing after its multiples.

    Examples are 12:00 for daily means and 00:30 for hourly ones; for monthly means, the middle of
    the month.
    """
    usual = int(np.median(np.diff(times)).astype(int))
    if _monthly_spacing(usual):
        days = times.astype("datetime64[D]") - times.astype("datetime64[M]").astype("datetime64[D]")
        return bool(((days >= np.timedelta64(13, "D")) & (days <= np.timedelta64(16, "D"))).all())
    if not 0 < usual <= 86400 or 86400 % usual:
        return False
    return bool((times.astype(np.int64) % usual * 2 == usual).all())


def _monthly_spacing(usual: int) -> bool:
    return MONTH[0] <= usual <= MONTH[1]


def _are_month_starts(times: Times) -> bool:
    """Return True if all stamps are the first moment of a month, with monthly spacing."""
    firsts = times == times.astype("datetime64[M]").astype(CELLS)
    return bool(firsts.all()) and _monthly_spacing(int(np.median(np.diff(times)).astype(int)))


def _add_months(times: Times, by: int) -> Times:
    return np.asarray((times.astype("datetime64[M]") + np.timedelta64(by, "M")).astype(CELLS))


def _format_hours(span: Any) -> str:
    hours = float(span / np.timedelta64(3600, "s"))
    return f"{hours:g} h" if hours >= 1 else f"{hours * 60:g} min"


def join_intervals(cells: Iterable[Times | None], counts: Iterable[int]) -> Times:
    """Return the intervals of the slices of several files, NaT for files without bounds."""
    none = np.datetime64("NaT", "s")
    parts = [
        np.full((n, 2), none) if own is None else own for own, n in zip(cells, counts, strict=True)
    ]
    return np.concatenate(parts) if parts else np.empty((0, 2), CELLS)
