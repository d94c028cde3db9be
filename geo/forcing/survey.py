"""Survey of a source's values: its speeds, undeclared fill values, and whether zeros mean land.

The survey is made once per source, from fixed slices and evenly strided points of everything that
the files hold, never from the part that a case needs. So its results do not depend on the case's
area. It reads at most READ bytes of values.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from geo import notation
from geo.array import Array
from geo.errors import UserError
from geo.files.dataset import is_remote
from geo.forcing import quantities
from geo.forcing.quantity import QUANTITIES
from geo.forcing.reading import slices
from geo.forcing.reading.component import Component

READ = 64 * 2**20  # [bytes] largest amount read, both components and all slices together
READ_REMOTE = 4 * 2**20  # [bytes] largest amount read from an address
LOOKED_AT = 8  # largest number of slices: the first, the last and some in between
DRY = 0.005  # share of exact zeros above which they mean land
RECURS = 3  # a fill value occurs at least so often
VARIED = 10  # least number of different other values for the gap to a fill value to be judged
# gap between a number of nines and all other values, as a share of the others' range
GAP = 0.25
SLOW_WIND = 2.0  # [m/s]


# percentile of a current's speeds that must be below `fastest`: a few points may exceed it
PERCENTILE = 99.9


@dataclass(frozen=True)
class Survey:
    """What a sample of slices shows about the whole source."""

    looked_at: tuple[int, ...]  # indices of the slices
    # for each component, in the file's units: values that mean missing
    fills: tuple[tuple[float, ...], tuple[float, ...]]
    dry: bool  # points that are exactly zero in all these slices are land
    notes: tuple[str, ...]  # the findings in words


def survey_slices(
    components: tuple[Component, Component], count: int, plausible: bool, name: str
) -> Survey:
    """Survey the first `count` slices of a source.

    Args:
        components: of the source.
        count: number of slices.
        plausible: the user vouches for the values, so nothing is rejected or taken as fill value.
        name: of the source, for messages.

    Raises:
        UserError: the speeds cannot be those of the quantity; the message gives the figures.
    """
    looked_at = tuple(
        int(k) for k in np.unique(np.linspace(0, count - 1, min(count, LOOKED_AT)).round())
    )
    samples = [_sample_values(component, looked_at) for component in components]
    notes: list[str] = []
    fills: list[tuple[float, ...]] = []
    for component, values in zip(components, samples, strict=True):
        stray = (
            ()
            if plausible
            else undeclared(
                values, component.factor, component.quantity, _packed_fill_values(component)
            )
        )
        fills.append(stray)
        for fill in stray:
            share = float(np.mean(values == fill))
            values[values == fill] = np.nan
            notes.append(
                f'"{component.name}" holds {fill:g} at {notation.percent(share)} of its points, apart from all other values: taken '
                "as a fill value that the file does not declare (plausible = true to use it as a value)"
            )
        with np.errstate(invalid="ignore", over="ignore"):
            values[
                np.abs(values) * component.factor > QUANTITIES[component.quantity].impossible
            ] = np.nan
    slow = () if plausible else _shared_nines(samples)
    for fill in slow:
        share = float(np.mean(samples[0] == fill))
        samples = [np.where(values == fill, np.nan, values) for values in samples]
        notes.append(
            f"both components hold {fill:g} at {notation.percent(share)} of their points, apart from all other values: taken as a "
            "fill value that the file does not declare (plausible = true to use it as a value)"
        )
    shares = _zero_shares(components, samples, looked_at)
    dry = min(shares) > DRY and max(shares) < 1 and _may_be_dry(components, samples)
    if dry:
        notes.append(
            f"{notation.percent(max(shares))} of the values are exactly zero at all {len(looked_at)} times looked at: taken as land "
            '(variables.mask = "none" to take them as still water)'
        )
    notes += _check_speeds(components, samples, looked_at, plausible, name)
    return Survey(looked_at, (fills[0] + slow, fills[1] + slow), dry, tuple(notes))


def _sample_values(component: Component, looked_at: tuple[int, ...]) -> Array:
    """Return strided values in the file's own units, shape (slices, ...).

    Missing, infinite or masked values are NaN.
    """
    data, path, _, _ = component.segments[0]
    sizes = [int(data.sizes[dim]) for dim in component.dims]
    itemsize = np.dtype(
        data[component.name].encoding.get("dtype") or data[component.name].dtype
    ).itemsize
    most = (READ_REMOTE if is_remote(path) else READ) / (2 * len(looked_at) * itemsize)
    stride = max(1, int(np.ceil((np.prod(sizes) / most) ** (1 / len(sizes)))))
    strides = (slice(None, None, stride),) * len(sizes)
    values = np.stack([slices.block(component, k, strides) for k in looked_at])
    if component.mask is not None:
        values[:, ~component.mask[strides]] = np.nan
    values[np.isinf(values)] = np.nan
    return values


def _packed_fill_values(component: Component) -> tuple[float, ...]:
    """Return the values to which the usual fill values of packed integers decode.

    Libraries write these if no fill value is declared.
    """
    packing = component.segments[0][0][component.name].encoding
    kind = np.dtype(packing.get("dtype") or np.float64)
    if kind.kind != "i":
        return ()
    limits = np.iinfo(kind)
    scale, offset = (
        float(packing.get(key, usual))
        for key, usual in (("scale_factor", 1.0), ("add_offset", 0.0))
    )
    return tuple(number * scale + offset for number in (limits.min, limits.min + 1, limits.max))


def undeclared(
    values: Array, factor: float, quantity: str, packed: tuple[float, ...] = ()
) -> tuple[float, ...]:
    """Return values that must be undeclared fill values.

    Such a value is an extreme, occurs repeatedly, and a gap separates it from all others. It must
    also be faster than any real speed, or be a usual fill value of packed integers. A repeated
    extreme alone proves nothing, because packed fields saturate.

    Args:
        values: in the file's own units, NaN for missing.
        factor: from these units to m/s.
        quantity: one of QUANTITIES.
        packed: usual fill values of packed integers, decoded.
    """
    finite = values[np.isfinite(values)]
    fastest = QUANTITIES[quantity].fastest
    fills: list[float] = []
    for _ in range(4):  # a file may hold two fill values, each with both signs
        for largest in (True, False):
            if not finite.size:
                return tuple(fills)
            extreme = float(finite.max() if largest else finite.min())
            at = finite == extreme
            rest = finite[~at]
            if (
                int(at.sum()) < RECURS
                or rest.size < VARIED
                or len(np.unique(rest[:: max(1, rest.size // 10_000)])) < VARIED
            ):
                continue
            low, high = float(rest.min()), float(rest.max())
            gap = extreme - high if largest else low - extreme
            fast = abs(extreme) * factor > fastest
            usual = bool(np.isclose(abs(extreme), quantities.NINES, rtol=1e-6).any()) and fast
            usual |= any(np.isclose(extreme, value, rtol=1e-5) for value in packed)
            if gap > (GAP if usual else 1.0) * (high - low) and (usual or fast):
                fills.append(extreme)
                finite = rest
    return tuple(fills)


def _shared_nines(samples: list[Array]) -> tuple[float, ...]:
    """Return numbers of nines that both components hold at the same points, apart from all others.

    They are fill values of plausible size. 99 cm/s is a speed like others, but not if both
    components have exactly this value at many points, and nothing near it elsewhere.
    """
    if samples[0].shape != samples[1].shape:
        return ()
    fills, largest = [], float(np.fmax.reduce(np.abs(samples[0]), axis=None, initial=0.0))
    for size in quantities.NINES:
        for fill in (size, -size) if size <= 1.01 * largest else ():
            at = np.isclose(samples[0], fill, rtol=1e-6) & np.isclose(samples[1], fill, rtol=1e-6)
            if at.mean() <= DRY:
                continue
            rest = np.concatenate([values[~at & np.isfinite(values)] for values in samples])
            if (
                rest.size
                and len(np.unique(rest[:10_000])) >= VARIED
                and np.abs(rest - fill).min() > GAP * np.ptp(rest)
            ):
                fills.append(float(samples[0][at][0]))
    return tuple(fills)


def _zero_shares(
    components: tuple[Component, Component], samples: list[Array], looked_at: tuple[int, ...]
) -> tuple[float, float]:
    """Return for each component the share of its present points that are zero in all slices."""
    zero = []
    for component, values in zip(components, samples, strict=True):
        still = np.stack(
            [slices.still(slab, component, i) for slab, i in zip(values, looked_at, strict=True)]
        )
        zero.append(np.all(still | np.isnan(values), axis=0) & np.any(still, axis=0))
    if samples[0].shape == samples[1].shape:
        # both must be zero, because a packed component is often zero by itself
        zero = [zero[0] & zero[1]] * 2
    present = [np.any(np.isfinite(values), axis=0) for values in samples]
    first, second = (float(z.sum() / max(p.sum(), 1)) for z, p in zip(zero, present, strict=True))
    return first, second


def _may_be_dry(components: tuple[Component, Component], samples: list[Array]) -> bool:
    """Return True if zeros may mean land.

    They cannot in a wind or a scalar, nor if a mask or the case says which water is still. Stokes drift is
    often zero in a lee, once packed; its zeros may mean land only in a file without missing values.
    """
    first = components[0]
    if (
        QUANTITIES[first.quantity].in_air
        or QUANTITIES[first.quantity].scalar
        or first.unmasked
        or any(c.mask is not None for c in components)
    ):
        return False
    return QUANTITIES[first.quantity].zeros_are_land or not any(
        np.isnan(values).any() for values in samples
    )


def _check_speeds(
    components: tuple[Component, Component],
    samples: list[Array],
    looked_at: tuple[int, ...],
    plausible: bool,
    name: str,
) -> list[str]:
    """Reject speeds that the quantity cannot have; return a warning for a very weak wind."""
    quantity = components[0].quantity
    speed = _speeds(components, samples)
    if not speed.size:
        return []
    mean, high, largest = (
        float(speed.mean()),
        float(np.percentile(speed, PERCENTILE)),
        float(speed.max()),
    )
    unit = QUANTITIES[quantity].unit_text
    figures = (
        f"mean {mean:.2g}, {PERCENTILE:g}th percentile {high:.3g}, largest {largest:.3g}{unit}"
    )
    quantity_name, fastest = QUANTITIES[quantity].spoken, QUANTITIES[quantity].fastest
    strong = QUANTITIES[quantity].strong_mean
    if math.isfinite(strong):
        good = mean <= strong and high <= fastest
        allowed = f"a {quantity_name}'s mean is at most {strong:g}, its {PERCENTILE:g}th percentile at most {fastest:g}{unit}"
    else:
        good, allowed = largest <= fastest, f"a {quantity_name} is at most {fastest:g}{unit}"
    if not good and plausible:
        return [
            f"speeds that no {quantity_name} has ({figures}), accepted because plausible = true"
        ]
    if not good:
        given = components[:1] if QUANTITIES[quantity].scalar else components
        names = ", ".join(component.name for component in given)
        raise UserError(
            f"{name}: {names} can't be a {quantity_name}: {figures}; {allowed}. "
            f"Is it another quantity, or in other units? Correct [[{quantity}]] files, variables or units, or set "
            "plausible = true"
        )
    if QUANTITIES[quantity].in_air and largest <= SLOW_WIND:
        return [
            f"WARNING: this wind never exceeds {largest:.2g} m/s at the {len(looked_at)} times examined: is it a "
            "current?"
        ]
    return []


def _speeds(components: tuple[Component, Component], samples: list[Array]) -> NDArray[Any]:
    """Return the speeds [m/s] where both components have values, as a flat array.

    Components of a staggered grid are combined index by index.
    """
    shape = tuple(min(a, b) for a, b in zip(samples[0].shape, samples[1].shape, strict=True))
    part = tuple(slice(0, n) for n in shape)
    # damaged files hold signalling NaNs and arbitrarily large numbers
    with np.errstate(invalid="ignore", over="ignore"):
        x, y = (
            values[part] * component.factor
            for values, component in zip(samples, components, strict=True)
        )
        speed = np.hypot(x, y)
    kept: NDArray[Any] = speed[np.isfinite(speed) & (speed > 0)]
    return kept if kept.size else speed[np.isfinite(speed)]
