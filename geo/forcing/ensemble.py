"""Checks that the members of an ensemble fit together.

Each member must have both components, values, the same grid, and times that all members share.
"""

from collections.abc import Sequence

import numpy as np

from geo.array import Array
from geo.errors import UserError
from geo.forcing.reading import slices
from geo.forcing.reading.component import Component
from geo.forcing.times import clock
from geo.grids import layout
from geo.grids.layout import Layout

LOOKED_AT = 2**16  # largest number of values per slice that is read to find a present one


def check_sizes(name: str, quantity: str, pair: tuple[Component, Component]) -> None:
    """Raise UserError if the two components do not have the same number of members."""
    counts = [
        f"{c.name} has {_member_count(c)} along {c.member}" if c.member else f"{c.name} has none"
        for c in pair
    ]
    if pair[0].member != pair[1].member or _member_count(pair[0]) != _member_count(pair[1]):
        raise UserError(
            f"{name}: number of ensemble members: {' and '.join(counts)}; both components must have the same; set "
            f"[[{quantity}]] files"
        )


def _member_count(component: Component) -> int:
    return int(component.segments[0][0].sizes[component.member]) if component.member else 1


def check_held(component: Component) -> None:
    """Raise UserError if a member has no value in its first and its last slice."""
    sizes = [int(component.segments[0][0].sizes[dim]) for dim in component.dims]
    stride = max(1, int(np.ceil((np.prod(sizes) / LOOKED_AT) ** (1 / len(sizes)))))
    every = (slice(None, None, stride),) * len(sizes)
    for i in dict.fromkeys((0, len(component.segments) - 1)):
        if np.isfinite(slices.block(component, i, every)).any():
            return
    mend = f"remove it from [[{component.quantity}]] files"
    if component.member:
        mend += f", or set variables.{component.member} to the index of one that has values"
    raise UserError(
        f'holds no value of "{component.name}": each member must have both components; {mend}'
    )


def check_grid(
    pair: tuple[Component, Component], first: tuple[Component, Component], quantity: str
) -> None:
    """Raise UserError if a member's grid points differ from those of the first member."""
    for own, other in zip(pair, first, strict=True):
        if not _same_points(own.layout, other.layout):
            raise UserError(
                f'the points of "{own.name}" are not those of the first member: all members of an ensemble must have one '
                f"grid; remove it from [[{quantity}]] files"
            )


def _same_points(own: Layout, other: Layout) -> bool:
    if type(own) is not type(other):
        return False
    pairs = zip(layout.points(own), layout.points(other), strict=True)
    return all(
        a.shape == b.shape and np.allclose(a, b, rtol=1e-6, atol=1e-5, equal_nan=True)
        for a, b in pairs
    )


def common(
    times: Sequence[clock.Times], name: str, quantity: str
) -> tuple[clock.Times, list[Array]]:
    """Return the times that all members share, and for each member the indices of these slices.

    Steady fields have no times; each index is then 0.

    Args:
        times: of each member.
        name: of the source, for messages.
        quantity: of the source, for messages.

    Raises:
        UserError: the members share fewer than two times.
    """
    if not times[0].size:
        return times[0], [np.zeros(1, int)] * len(times)
    shared = times[0]
    for own in times[1:]:
        shared = np.intersect1d(shared, own)
    if shared.size < 2:
        raise UserError(
            f"{name}: the members of the ensemble have {shared.size} time{'s' * (shared.size != 1)} in common; must have "
            f"two at least: name files of the same hours in [[{quantity}]] files"
        )
    return shared, [np.searchsorted(own, shared) for own in times]
