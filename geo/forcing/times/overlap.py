"""Times that several files of a source share: at file boundaries and in overlapping forecasts.

If the values are equal, one of them is used. If they differ, the file of the later run is used from
its first time to its last, so that slices of two runs never alternate. Final values of ERA5 are
preferred to preliminary ones.
"""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from geo import notation
from geo.array import Array
from geo.errors import UserError
from geo.files import dataset
from geo.forcing.times import clock, versions

COMPARED = 64  # number of pairs of files whose values are compared; others are assumed to differ
COMPARED_REMOTE = 4  # number of pairs of addresses
LOOKED_AT = 2**16  # largest number of values compared per slice
ROUNDING = 4.0 * float(np.finfo(np.float32).eps)

Slice = tuple[xr.Dataset, str, str | None, int]


@dataclass(frozen=True)
class _Run:
    """The slices of one file: indices among all slices, times [s], and start of its run [s]."""

    path: str
    index: NDArray[np.int64]
    times: NDArray[np.int64]
    began: int
    version: NDArray[np.int64]  # ERA5's `expver`, 0 without


def resolve_overlaps(
    times: NDArray[np.datetime64],
    slices: Sequence[Slice],
    name: str,
    fixed: Mapping[str, int],
    notes: list[str],
) -> NDArray[np.int64]:
    """Return the indices of the slices to use, in order of time, each time once.

    Args:
        times: of all slices.
        slices: of all files.
        name: of the variable.
        fixed: its indices along all dimensions except time and the horizontal ones.
        notes: list to which notes are appended.
    """
    seconds = times.astype("datetime64[s]").astype(np.int64)
    kept = np.ones(len(seconds), bool)
    if len(np.unique(seconds)) < len(seconds):
        runs = _list_runs(seconds, slices)
        same, later, unseen = list[str](), list[str](), list[str]()
        for k, earlier in enumerate(runs):
            for run in runs[k + 1 :]:
                shared = np.intersect1d(earlier.times, run.times)
                if shared.size:
                    most = COMPARED_REMOTE if dataset.is_remote(run.path) else COMPARED
                    seen = len(same) + len(later) < most
                    equal = seen and _equal_values(earlier, run, shared, slices, name, fixed)
                    (same if equal else later if seen else unseen).append(
                        _drop_overlap(earlier, run, shared, equal, kept)
                    )
        notes += _overlap_notes(same, later, unseen)
    chosen = np.flatnonzero(kept)
    return np.asarray(chosen[np.argsort(seconds[chosen], kind="stable")], np.int64)


def _list_runs(seconds: NDArray[np.int64], slices: Sequence[Slice]) -> list[_Run]:
    """Return the runs in order of their start; of equal starts the last named is later."""
    files: dict[int, list[int]] = {}
    for k, (data, *_) in enumerate(slices):
        files.setdefault(id(data), []).append(k)
    runs = []
    for own in files.values():
        data, path, along, _ = slices[own[0]]
        index = np.array(own)
        began = _run_start(data)
        own_versions = versions.along(data, along)
        version = (
            np.zeros(len(own), np.int64)
            if own_versions is None
            else own_versions[[slices[k][3] for k in own]]
        )
        first = int(seconds[index].min())
        runs.append(_Run(path, index, seconds[index], first if began is None else began, version))
    return sorted(runs, key=lambda run: (run.began, int(run.times.min())))


def _run_start(data: xr.Dataset) -> int | None:
    """Return the start of a file's run [s since 1970]; None if the file does not state it."""
    for name, variable in data.variables.items():
        if (
            str(variable.attrs.get("standard_name", "")) == "forecast_reference_time"
            and variable.size == 1
        ):
            try:
                return int(
                    clock.decode(data, str(name))[0]
                    .ravel()[0]
                    .astype("datetime64[s]")
                    .astype(np.int64)
                )
            except UserError:
                return None
    return None


def _drop_overlap(
    earlier: _Run, later: _Run, shared: NDArray[np.int64], equal: bool, kept: NDArray[np.bool_]
) -> str:
    """Clear `kept` for slices of two runs that are not used; return a text for a note."""
    a, b = (run.version[np.isin(run.times, shared)] for run in (earlier, later))
    if not np.array_equal(np.sort(a), np.sort(b)):  # ERA5: final values before preliminary ones
        for run, other in ((earlier, later), (later, earlier)):
            best = dict(zip(other.times.tolist(), other.version.tolist(), strict=True))
            worse = [
                best.get(t, v) < v
                for t, v in zip(run.times.tolist(), run.version.tolist(), strict=True)
            ]
            kept[run.index[np.array(worse, bool)]] = False
        shared = np.array(
            [t for t in shared if _version_at(earlier, t) == _version_at(later, t)], np.int64
        )
        kept[earlier.index[np.isin(earlier.times, shared)]] = False
        return f"{os.path.basename(earlier.path)} and {os.path.basename(later.path)}, final values before preliminary ones"
    first, last = int(later.times.min()), int(later.times.max())
    gone = (
        np.isin(earlier.times, shared)
        if equal
        else (earlier.times >= first) & (earlier.times <= last)
    )
    kept[earlier.index[gone]] = False
    if equal:
        return f"{os.path.basename(earlier.path)} and {os.path.basename(later.path)}"
    begin, end = (
        notation.format_dtg(np.datetime64(t, "s"))
        for t in (first, min(last, int(earlier.times.max())))
    )
    return f"{os.path.basename(later.path)} instead of {os.path.basename(earlier.path)} from {begin} to {end}"


def _version_at(run: _Run, time: int) -> int:
    return int(run.version[np.flatnonzero(run.times == time)[0]])


def _equal_values(
    earlier: _Run,
    later: _Run,
    shared: NDArray[np.int64],
    slices: Sequence[Slice],
    name: str,
    fixed: Mapping[str, int],
) -> bool:
    """Return True if two runs have equal values at the first, middle and last time they share."""
    far = dataset.is_remote(later.path)
    for time in (
        {int(shared[0])}
        if far
        else {int(shared[0]), int(shared[len(shared) // 2]), int(shared[-1])}
    ):
        pair = []
        for run in (earlier, later):
            k = int(run.index[np.flatnonzero(run.times == time)[0]])
            pair.append(_sample_slice(slices[k], name, fixed))
        (a, near), (b, other) = pair
        if a.shape != b.shape or (np.isnan(a) != np.isnan(b)).any():
            return False
        with np.errstate(invalid="ignore"):
            slack = near + other + ROUNDING * np.maximum(np.abs(a), np.abs(b))
            if (np.abs(a - b) > slack).any():
                return False
    return True


def _sample_slice(one: Slice, name: str, fixed: Mapping[str, int]) -> tuple[Array, float]:
    """Return thinned values of a slice and the rounding error of their packing."""
    data, _, along, k = one
    variable = data[name]
    index: dict[str, Any] = {dim: n for dim, n in fixed.items() if dim in variable.dims}
    if along is not None:
        index[along] = k
    variable = variable.isel(index)
    every = max(1, int(np.ceil((variable.size / LOOKED_AT) ** (1 / max(variable.ndim, 1)))))
    thinned = variable.isel({dim: slice(None, None, every) for dim in variable.dims})
    packing = data[name].encoding
    packed = np.dtype(packing.get("dtype") or np.float64).kind in "iu"
    step = abs(float(packing.get("scale_factor", 1.0))) if packed else 0.0
    return np.asarray(thinned.values, np.float64), 0.501 * step


def _overlap_notes(same: list[str], later: list[str], unseen: list[str]) -> list[str]:
    """Return notes on pairs of files with equal values, with other values, or not compared."""
    remarks = []
    if same:
        remarks.append(
            f"times that files share, with equal values, are used once: {_list_some(same)}"
        )
    if later:
        remarks.append(
            f"times that files share, with different values: used is {_list_some(later)}"
        )
    if unseen:
        remarks.append(
            f"times that many files share, whose values were not compared: used is {_list_some(unseen)}"
        )
    return remarks


def _list_some(listed: list[str]) -> str:
    return "; ".join(listed[:3]) + (f"; and {len(listed) - 3} more" if len(listed) > 3 else "")
