"""What a source holds as a whole: its speeds, undeclared fill values, and whether its land is zero.

Judged once a source, from fixed slices and evenly strided points of all that the files hold, never
from the part that a case needs: so no answer depends on the case's domain. At most READ bytes of
values are read.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from geo import notation
from geo.array import Array
from geo.errors import UserError
from geo.files.dataset import remote
from geo.forcing import quantities
from geo.forcing.quantity import QUANTITIES
from geo.forcing.reading import slices
from geo.forcing.reading.component import Component

READ = 64 * 2**20  # [bytes] of values at most, both components and all slices together
READ_REMOTE = 4 * 2**20  # [bytes] of values at most from an address
LOOKED_AT = 8  # slices at most: the first, the last and some between
DRY = 0.005  # share of exact zeros from which they are land
RECURS = 3  # times that an extreme value must occur at least to be a fill value
VARIED = 10  # different values that the rest must hold before one can stand apart from it
# share of the range of all other values by which a number of nines stands apart from them
GAP = 0.25
SLOW_WIND = 2.0  # [m/s]


# percentile of a current's speeds that must stay under the fastest: points of a race may exceed it
PERCENTILE = 99.9


@dataclass(frozen=True)
class Survey:
    """What some slices of a source say of all of it."""

    looked_at: tuple[int, ...]  # indices of the slices
    # of each component, in the file's units: numbers for "missing"
    fills: tuple[tuple[float, ...], tuple[float, ...]]
    dry: bool  # whether points that are exactly zero in all those slices are land
    notes: tuple[str, ...]  # all that in words


def survey_slices(
    components: tuple[Component, Component], count: int, plausible: bool, name: str
) -> Survey:
    """Survey the first `count` slices of a source.

    plausible: the user vouches for its values, so that nothing is refused.
    Raises UserError, with the figures, where the speeds can't be those of the quantity.
    """
    looked_at = tuple(
        int(k) for k in np.unique(np.linspace(0, count - 1, min(count, LOOKED_AT)).round())
    )
    samples = [_sample(component, looked_at) for component in components]
    notes: list[str] = []
    fills: list[tuple[float, ...]] = []
    for component, values in zip(components, samples, strict=True):
        stray = (
            ()
            if plausible
            else undeclared(values, component.factor, component.quantity, _packed(component))
        )
        fills.append(stray)
        for fill in stray:
            share = float(np.mean(values == fill))
            values[values == fill] = np.nan
            notes.append(
                f'"{component.name}" holds {fill:g} at {notation.percent(share)} of its points, apart from all other values: taken '
                "as a fill value that the file does not declare (plausible = true to take it as a value)"
            )
        with np.errstate(invalid="ignore", over="ignore"):
            values[
                np.abs(values) * component.factor > QUANTITIES[component.quantity].impossible
            ] = np.nan
    slow = () if plausible else _shared(samples)
    for fill in slow:
        share = float(np.mean(samples[0] == fill))
        samples = [np.where(values == fill, np.nan, values) for values in samples]
        notes.append(
            f"both components hold {fill:g} at {notation.percent(share)} of their points, apart from all other values: taken as a "
            "fill value that the file does not declare (plausible = true to take it as a value)"
        )
    shares = _still(components, samples, looked_at)
    dry = min(shares) > DRY and max(shares) < 1 and _may_be_dry(components, samples)
    if dry:
        notes.append(
            f"{notation.percent(max(shares))} of the values are exactly zero at all {len(looked_at)} times looked at: taken as land "
            '(variables.mask = "none" to take them as still water)'
        )
    notes += _judged(components, samples, looked_at, plausible, name)
    return Survey(looked_at, (fills[0] + slow, fills[1] + slow), dry, tuple(notes))


def _sample(component: Component, looked_at: tuple[int, ...]) -> Array:
    """Return strided values in the file's own units, shape (slices, ...).

    Missing, infinite or masked values are NaN.
    """
    data, path, _, _ = component.segments[0]
    sizes = [int(data.sizes[dim]) for dim in component.dims]
    itemsize = np.dtype(
        data[component.name].encoding.get("dtype") or data[component.name].dtype
    ).itemsize
    most = (READ_REMOTE if remote(path) else READ) / (2 * len(looked_at) * itemsize)
    stride = max(1, int(np.ceil((np.prod(sizes) / most) ** (1 / len(sizes)))))
    every = (slice(None, None, stride),) * len(sizes)
    values = np.stack([slices.block(component, k, every) for k in looked_at])
    if component.mask is not None:
        values[:, ~component.mask[every]] = np.nan
    values[np.isinf(values)] = np.nan
    return values


def _packed(component: Component) -> tuple[float, ...]:
    """Return what a packed variable decodes the numbers to that libraries fill with where nothing
    is declared.
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
    """Return the values that must be fill values: extreme, recurring, and apart from all others by
    a gap.

    values: in the file's own units, NaN missing; factor: to m/s. A recurring extreme alone proves
    nothing: packed fields saturate. One apart by a gap must also be faster than anything real, or
    what a packed number is by default.
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


def _shared(samples: list[Array]) -> tuple[float, ...]:
    """Return a number of nines that both components hold at the same points, apart from all else.

    That is a slow fill value. 99 cm/s is a speed like others; that both components have exactly it,
    in many places, and nothing near it, is not.
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


def _still(
    components: tuple[Component, Component], samples: list[Array], looked_at: tuple[int, ...]
) -> tuple[float, float]:
    """Return the shares of the present points of each component that are exactly zero in all
    slices.
    """
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
    """Whether zeros can be land: not in a wind, nor where a mask or the case says which water is
    still.

    Stokes drift really is zero in the lee, once packed: there only a file that has no missing value
    can mean land.
    """
    first = components[0]
    if (
        QUANTITIES[first.quantity].in_air
        or first.unmasked
        or any(c.mask is not None for c in components)
    ):
        return False
    return QUANTITIES[first.quantity].zeros_are_land or not any(
        np.isnan(values).any() for values in samples
    )


def _judged(
    components: tuple[Component, Component],
    samples: list[Array],
    looked_at: tuple[int, ...],
    plausible: bool,
    name: str,
) -> list[str]:
    """Refuse speeds that can't be the quantity's; return a warning of a wind that hardly blows."""
    quantity = components[0].quantity
    speed = _speeds(components, samples)
    if not speed.size:
        return []
    mean, high, largest = (
        float(speed.mean()),
        float(np.percentile(speed, PERCENTILE)),
        float(speed.max()),
    )
    figures = f"mean {mean:.2g}, {PERCENTILE:g}th percentile {high:.3g}, largest {largest:.3g} m/s"
    spoken, fastest = QUANTITIES[quantity].spoken, QUANTITIES[quantity].fastest
    strong = QUANTITIES[quantity].strong_mean
    if math.isfinite(strong):
        good = mean <= strong and high <= fastest
        allowed = f"a {spoken}'s mean is at most {strong:g}, its {PERCENTILE:g}th percentile at most {fastest:g} m/s"
    else:
        good, allowed = largest <= fastest, f"a {spoken} is at most {fastest:g} m/s"
    if not good and plausible:
        return [f"speeds that no {spoken} has ({figures}), as the case vouches"]
    if not good:
        raise UserError(
            f"{name}: {components[0].name}, {components[1].name} can't be a {spoken}: {figures}; {allowed}. "
            f"Is it another quantity, or in other units? Mend [[{quantity}]] files, variables or units, or set "
            "plausible = true"
        )
    if QUANTITIES[quantity].in_air and largest <= SLOW_WIND:
        return [
            f"WARNING: this wind is nowhere over {largest:.2g} m/s at the {len(looked_at)} times looked at: is it a "
            "current?"
        ]
    return []


def _speeds(components: tuple[Component, Component], samples: list[Array]) -> NDArray[Any]:
    """Return the speeds [m/s] where both components are, raveled; of staggered ones those of one
    index.
    """
    shape = tuple(min(a, b) for a, b in zip(samples[0].shape, samples[1].shape, strict=True))
    part = tuple(slice(0, n) for n in shape)
    # damaged files hold signalling NaNs and numbers of any size
    with np.errstate(invalid="ignore", over="ignore"):
        x, y = (
            values[part] * component.factor
            for values, component in zip(samples, components, strict=True)
        )
        speed = np.hypot(x, y)
    kept: NDArray[Any] = speed[np.isfinite(speed) & (speed > 0)]
    return kept if kept.size else speed[np.isfinite(speed)]
