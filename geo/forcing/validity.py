"""Valid values of a variable, by its valid range and its quality flags.

For a packed variable, the range (`valid_range`, `valid_min`, `valid_max`) is in packed numbers,
unless it is of a floating type and the packed numbers are not (NetCDF Users' Guide, appendix A).
Flags follow section 3.5 of the CF conventions: flag variables are listed in `ancillary_variables`,
or their standard names mark them as flags of the variable. The words of their meanings say which
values are bad.
"""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from geo.array import Array
from geo.forcing.derived import Part, derive, values_of

LIMITS = ("valid_range", "valid_min", "valid_max")
BAD = re.compile(
    r"bad|fail|invalid|erroneous|error|missing|reject|unreliable|corrupt|spike|not_valid|do_not_use|out_of_range"
    r"|unusable|poor|no_data|land|ice(?![a-z])|wrong|impossible|below_detection|above_detection",
    re.IGNORECASE,
)
GOOD = re.compile(
    r"^(no|not|without|free_of|probably_good|good|passe?d?|ok|valid)(_|$)|not_(bad|missing|failed)|no_(bad|error)",
    re.IGNORECASE,
)
FLAGS = ("quality_flag", "status_flag", "aggregate_quality_flag")


@dataclass(frozen=True)
class Flags:
    """A flag variable, with a test for bad flags and the meanings of bad and of accepted flags."""

    name: str
    variable: xr.Variable
    is_bad: Callable[[Array], NDArray[np.bool_]]
    bad: tuple[str, ...]
    kept: tuple[str, ...]


def apply(data: xr.Dataset, name: str, notes: list[str]) -> xr.Variable:
    """Return a variable with invalid values set to NaN; a note on each rule goes to `notes`."""
    variable = data.variables[name]
    limits = _valid_limits(variable.attrs, variable.encoding)
    flags = _find_flags(data, name)
    if limits is None and not flags:
        return variable
    if limits is not None:
        ends = (("below", limits[0]), ("above", limits[1]))
        bounds = " or ".join(f"{side} {end:.6g}" for side, end in ends if np.isfinite(end))
        stated = ", ".join(key for key in LIMITS if key in variable.attrs)
        units = str(variable.attrs.get("units", "")).strip()
        notes.append(
            f'"{name}": values {bounds} {units}, outside its {stated}, are missing (plausible = true to take them)'
        )
    for flag in flags:
        kept = f"; kept: {', '.join(flag.kept)}" if flag.kept else ""
        notes.append(
            f'"{name}": values that "{flag.name}" calls {", ".join(flag.bad)} are missing{kept} (plausible = true to '
            "take them all)"
        )

    low, high = limits or (-np.inf, np.inf)
    grain = 0.0 if limits is None else _rounding_tolerance(limits, variable.encoding)

    def read(part: Part) -> Array:
        values = values_of(variable, part)
        with np.errstate(invalid="ignore"):
            wrong = (values < low - grain) | (values > high + grain)
        for flag in flags:
            wrong |= flag.is_bad(_broadcast_flags(flag.variable, variable, part))
        values[wrong] = np.nan
        return values

    return derive(variable, read)


def _valid_limits(
    attributes: Mapping[str, Any], packing: Mapping[str, Any]
) -> tuple[float, float] | None:
    """Return the (least, greatest) valid value of a variable in unpacked units.

    None if its attributes state no limit.
    """
    low, high = -np.inf, np.inf
    valid_range, ends = _unpack_numbers(attributes.get("valid_range"), packing), []
    if valid_range is not None and valid_range.size == 2:
        low, high = float(valid_range.min()), float(valid_range.max())
    for key in ("valid_min", "valid_max"):
        end = _unpack_numbers(attributes.get(key), packing)
        ends.append(
            float(end[0]) if end is not None and end.size == 1 and np.isfinite(end[0]) else None
        )
    packed_upside_down = float(packing.get("scale_factor", 1.0)) < 0 and None not in ends
    if packed_upside_down:
        ends = ends[::-1]
    low, high = (low if ends[0] is None else ends[0]), (high if ends[1] is None else ends[1])
    return (low, high) if low < high and (np.isfinite(low) or np.isfinite(high)) else None


def _rounding_tolerance(limits: tuple[float, float], packing: Mapping[str, Any]) -> float:
    """Return the tolerance by which rounding may move a valid value beyond a limit."""
    kind = np.dtype(packing.get("dtype") or np.float32)
    if kind.kind in "iu" and _is_packed(packing):
        return abs(float(packing.get("scale_factor", 1.0))) / 2
    ends = [
        abs(end) for end in (*limits, float(packing.get("add_offset", 0.0))) if np.isfinite(end)
    ]
    return 4 * float(np.finfo(np.float32).eps) * max(ends)


def unpacked(attributes: Mapping[Any, Any], packing: Mapping[str, Any]) -> dict[Any, Any]:
    """Return attributes with limits in unpacked units, for a variable that is already unpacked."""
    if not _is_packed(packing) or not any(key in attributes for key in LIMITS):
        return dict(attributes)
    limits = _valid_limits(attributes, packing)
    rest = {key: value for key, value in attributes.items() if key not in LIMITS}
    return rest if limits is None else rest | {"valid_range": np.array(limits)}


def _is_packed(packing: Mapping[str, Any]) -> bool:
    return "scale_factor" in packing or "add_offset" in packing


def _unpack_numbers(stated: Any, packing: Mapping[str, Any]) -> Array | None:
    """Return the numbers of an attribute in unpacked units; None if it holds no numbers."""
    if isinstance(stated, str):
        try:
            stated = [float(text) for text in stated.replace(",", " ").split()]
        except ValueError:
            return None
    if stated is None:
        return None
    numbers = np.ravel(np.asarray(stated))
    if not np.issubdtype(numbers.dtype, np.number):
        return None
    kind = np.dtype(packing.get("dtype") or np.float64)
    unsigned = kind.kind == "u" or (
        kind.kind == "i" and str(packing.get("_Unsigned", "")).lower() == "true"
    )
    if unsigned and numbers.dtype.kind == "i":
        numbers = numbers.astype(np.int64) % (1 << (8 * kind.itemsize))
    unpacked = numbers.dtype.kind == "f" and kind.kind in "iu"
    if _is_packed(packing) and not unpacked:
        scale, offset = (
            float(packing.get("scale_factor", 1.0)),
            float(packing.get("add_offset", 0.0)),
        )
        return numbers.astype(np.float64) * scale + offset
    return numbers.astype(np.float64)


def _find_flags(data: xr.Dataset, name: str) -> list[Flags]:
    """Return the flag variables of a variable that mark some flags as bad."""
    variable = data.variables[name]
    listed = str(variable.attrs.get("ancillary_variables", "")).replace(",", " ").split()
    others = {
        n
        for v in data.variables.values()
        for n in str(v.attrs.get("ancillary_variables", "")).split()
    }
    standard = str(variable.attrs.get("standard_name", "")).strip()
    own = {f"{standard} {flag}" for flag in FLAGS} if standard else set()
    found = []
    for other in map(str, data.variables):
        candidate = data.variables[other]
        flag_name = re.sub(r"\s+", " ", str(candidate.attrs.get("standard_name", "")).strip())
        of_all = flag_name in FLAGS and other not in others
        if other == name or not (other in listed or flag_name in own or of_all):
            continue
        if "flag_meanings" in candidate.attrs and set(candidate.dims) <= set(variable.dims):
            flags = _read_flags(other, candidate)
            found += [flags] if flags is not None and flags.bad else []
    return found


def _read_flags(name: str, variable: xr.Variable) -> Flags | None:
    """Return the flags of a flag variable; None if its attributes contradict each other."""
    meanings = str(variable.attrs["flag_meanings"]).replace(",", " ").split()
    values, masks = (_read_integers(variable, key) for key in ("flag_values", "flag_masks"))
    if values is None and masks is None:
        return None
    count = len(meanings)
    if any(numbers is not None and numbers.size != count for numbers in (values, masks)):
        return None
    wrong = [bool(BAD.search(word)) and not GOOD.search(word) for word in meanings]
    bad = tuple(word for word, is_bad in zip(meanings, wrong, strict=True) if is_bad)
    kept = tuple(word for word, is_bad in zip(meanings, wrong, strict=True) if not is_bad)
    bits = _all_bits(variable)

    def is_bad(numbers: Array) -> NDArray[np.bool_]:
        finite = np.isfinite(numbers)
        flag_bits = np.where(finite, numbers, 0).astype(np.int64) & bits
        result = np.zeros(numbers.shape, bool)
        for k in np.flatnonzero(wrong):
            mask = bits if masks is None else int(masks[k])
            hit = (
                (flag_bits & mask) != 0 if values is None else (flag_bits & mask) == int(values[k])
            )
            result |= hit
        return result & finite

    return Flags(name, variable, is_bad, bad, kept)


def _all_bits(variable: xr.Variable) -> int:
    """Return an integer with all bits set that the stored type of a flag variable has."""
    kind = np.dtype(variable.encoding.get("dtype") or variable.dtype)
    return (1 << min(8 * kind.itemsize, 62)) - 1 if kind.kind in "iu" else (1 << 62) - 1


def _read_integers(variable: xr.Variable, key: str) -> NDArray[np.int64] | None:
    stated = variable.attrs.get(key)
    if isinstance(stated, str):
        stated = [float(number) for number in re.findall(r"-?\d+", stated)]
    if stated is None:
        return None
    numbers = np.ravel(np.asarray(stated))
    if (
        not numbers.size
        or not np.issubdtype(numbers.dtype, np.number)
        or not np.isfinite(numbers).all()
    ):
        return None
    return numbers.astype(np.int64) & _all_bits(variable)


def _broadcast_flags(flag: xr.Variable, variable: xr.Variable, part: Part) -> Array:
    """Return part of a flag variable, shaped to broadcast with the flagged variable's part."""
    dims = [dim for dim in variable.dims if not isinstance(part.get(str(dim)), int | np.integer)]
    own = [dim for dim in flag.dims if dim in dims]
    values = values_of(flag, part)
    values = values.transpose([own.index(dim) for dim in dims if dim in own])
    return values.reshape(
        [values.shape[[d for d in dims if d in own].index(d)] if d in own else 1 for d in dims]
    )
