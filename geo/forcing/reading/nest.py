"""Moving grids, whose coordinates change with time, like WRF's moving nests.

Each slice is interpolated from its current grid position to one regular grid that covers all
positions. Outside the current position a slice has no value.
"""

import threading
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from geo.box import Box
from geo.forcing.reading import tile
from geo.forcing.reading.component import Component
from geo.forcing.reading.tile import Tile, Values
from geo.grids import layout, target
from geo.grids.grid import Grid
from geo.grids.layout import Layout

TILES = 4  # number of grid positions whose interpolation weights are kept


@dataclass(frozen=True)
class Nest:
    """Two components on a moving grid, and the regular grid to which they are interpolated.

    numbers: index of the position at each slice. met: positions that overlap the needed box. dry:
    exact zeros are land. domain: (nlat, nlon), True for nodes inside the grid at every position in
    `met`.
    """

    grid: Grid
    components: tuple[Component, Component]
    numbers: tuple[tuple[int, int], ...]
    met: frozenset[tuple[int, int]]
    axes: str
    box: Box | None
    dry: bool
    domain: NDArray[np.bool_] | None
    notes: tuple[str, ...]
    # tiles of the positions used last
    tiles: dict[tuple[int, int], Tile] = field(default_factory=dict, repr=False)
    guard: threading.Lock = field(default_factory=threading.Lock, repr=False)


def moves(components: Sequence[Component]) -> bool:
    """Return True if the grid of a component moves."""
    return any(component.places is not None for component in components)


def make(
    components: tuple[Component, Component], count: int, axes: str, box: Box | None, dry: bool
) -> Nest | None:
    """Return a moving grid over the needed part; None if no slice overlaps it.

    Args:
        components: on the moving grid.
        count: number of slices.
        axes: as in `tile.make`.
        box: needed area; None for all.
        dry: exact zeros are land.
    """
    numbers = tuple(
        (_position_number(components[0], i), _position_number(components[1], i))
        for i in range(count)
    )
    met: list[tuple[int, int]] = []
    extent = target.Extent()
    for number in dict.fromkeys(numbers):
        crops = _crop_at(components, number, box)
        if crops is not None:
            met.append(number)
            extent.add(crops[0])
    if not met:
        return None
    grid, coarser = target.over(extent, box)
    nest = Nest(grid, components, numbers, frozenset(met), axes, box, dry, None, ())
    notes = _tile_at(nest, met[0]).notes
    if coarser:
        notes += (f"coarser than wanted to stay under {target.MOST_NODES:,} nodes",)
    return replace(nest, domain=_always_inside(nest, met), notes=notes)


def _position_number(component: Component, i: int) -> int:
    data, _, _, k = component.segments[i]
    return 0 if component.places is None else component.places.number[id(data), k]


def _layout_at(component: Component, place: int) -> Layout:
    return component.layout if component.places is None else component.places.layout(place)


def _crop_at(
    components: tuple[Component, Component], number: tuple[int, int], box: Box | None
) -> tuple[Layout, Layout] | None:
    """Return both layouts at a position, cropped to a box; None if one does not overlap it."""
    first = layout.crop(_layout_at(components[0], number[0]), box)
    second = layout.crop(_layout_at(components[1], number[1]), box)
    return None if first is None or second is None else (first, second)


def _tile_at(nest: Nest, number: tuple[int, int]) -> Tile:
    """Return the tile of a position, from those used last or made now."""
    with nest.guard:
        found = nest.tiles.pop(number, None)
        if found is None:
            crops = _crop_at(nest.components, number, nest.box)
            assert crops is not None
            found = tile.build_tile(nest.components, crops, nest.axes, nest.box, nest.grid)
        nest.tiles[number] = found
        while len(nest.tiles) > TILES:
            del nest.tiles[next(iter(nest.tiles))]
    return replace(found, components=nest.components)


def _always_inside(nest: Nest, met: Sequence[tuple[int, int]]) -> NDArray[np.bool_] | None:
    """Return the nodes inside the grid at every position, where a missing value may mean land.

    Of many positions only TILES are used.
    """
    chosen = np.unique(np.linspace(0, len(met) - 1, TILES).astype(int))
    inside = [tile.domain(_tile_at(nest, met[k])) for k in chosen]
    masks = [mask for mask in inside if mask is not None]
    if not masks:
        return None
    always = np.logical_and.reduce(masks)
    return always if always.any() else masks[0]


def read_nested_slice(nest: Nest, i: int) -> Values:
    """Return slice i like `tile.read_tile`; NaN outside the grid's position at that time."""
    if nest.numbers[i] not in nest.met:
        return np.full((nest.grid.nlat, nest.grid.nlon, 2), np.nan, np.float32)
    current = _tile_at(nest, nest.numbers[i])
    if nest.dry:
        current = replace(current, dry=tile.still(current, i))
    return tile.read_tile(current, i)


def missing(nest: Nest) -> tuple[float, bool]:
    """Return the share of nodes missing in the first overlapping slice, and whether all are blank.

    The latter is judged from three slices.
    """
    overlapping = [i for i, number in enumerate(nest.numbers) if number in nest.met]
    looked_at = {overlapping[0], overlapping[len(overlapping) // 2], overlapping[-1]}
    first = float(np.isnan(read_nested_slice(nest, overlapping[0])[..., 0]).mean())
    return first, not any(np.isfinite(read_nested_slice(nest, i)).any() for i in looked_at)
