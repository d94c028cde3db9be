"""Current, wind and Stokes drift at a point, bilinear in space and linear in time.

The forcing of a run consists of tiles, all in one flat array. A node holds four numbers side by
side: (east, north) at the earlier and at the later of two times, so that one look-up fetches both.
A missing value is NaN. The tiles of a quantity form groups. Within a group, the first tile with a
value at the point counts; the values of all groups are added. If a group has no value, the sum is
invalid, never zero.

The tile of an ensemble source holds the nodes of one member after another. A particle reads the
nodes of its own member; a tile without members serves all particles.

Per tile, `where` (int32) holds WHERE numbers: its first node, lon0, lat0 [binary angle], nlon, the
tile after the last one of its group, and the number of nodes of a member (0: no members). `scale`
(float32) holds SCALE numbers per tile, for each of the next steps in turn: nodes per unit east and
north, the last node's coordinates (nlon - 1, nlat - 1; negative: no data in this step), and the
weight of the later slice at the begin of the step and its change over the step.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import taichi as ti

from geo import sphere
from geo.errors import UserError
from geo.forcing.quantity import QUANTITIES
from geo.grids.grid import Grid
from kernels.runtime import launch, runtime

WHERE, SCALE = 6, 6
MOST = 32  # most steps whose weights are on the device at once

f32x3 = ti.types.vector(3, ti.f32)
f32x4 = ti.types.vector(4, ti.f32)
# First and last tile of each quantity in `Sea.ranges`, in the order of QUANTITIES; see `ordered`.
ORDER = tuple(QUANTITIES)
# first and last tile by quantity; a quantity may be left out
Ranges = Mapping[str, tuple[int, int]]
i32xN = ti.types.vector(2 * len(ORDER), ti.i32)
Nodes = ti.types.ndarray(dtype=f32x4, ndim=1)
Sea = ti.types.argpack(
    nodes=Nodes,
    where=ti.types.ndarray(dtype=ti.i32, ndim=1),
    scale=ti.types.ndarray(dtype=ti.f32, ndim=1),
    ranges=i32xN,
)


def position(quantity: str) -> int:
    """Return the index in `Sea.ranges` of a quantity's first tile; its last one follows."""
    return 2 * ORDER.index(quantity)


def ordered(ranges: Ranges) -> tuple[int, ...]:
    """Return first and last tile of each quantity as in `Sea.ranges`; (0, 0): no tiles."""
    return tuple(number for quantity in ORDER for number in ranges.get(quantity, (0, 0)))


@ti.func
def of_tile(
    members: ti.template(),
    sea: ti.template(),
    row: ti.i32,
    tile: ti.i32,
    lon: ti.i32,
    lat: ti.i32,
    fraction: ti.f32,
    member: ti.i32,
) -> f32x3:
    """Return (east, north, valid) of one tile; zeros where it has no value.

    row: where `scale` begins for the step; fraction: of the step. members: whether any tile has
    members, a compile-time constant; member: the point's own.

    It always reads four nodes, so that it needs no branch: see kernels.runtime.bundle.
    """
    nodes, where, scale = ti.static(sea.nodes, sea.where, sea.scale)
    w, s = tile * WHERE, row + tile * SCALE
    # Differences wrap modulo a turn: a tile may cross the antimeridian, and points west or south of
    # it come out far east or north.
    x = ti.cast(ti.cast(lon - where[w + 1], ti.u32), ti.f32) * scale[s]
    y = ti.cast(ti.cast(lat - where[w + 2], ti.u32), ti.f32) * scale[s + 1]
    # the last node belongs to the cell before it
    ix = ti.max(ti.cast(ti.min(x, scale[s + 2] - 0.5), ti.i32), 0)
    iy = ti.max(ti.cast(ti.min(y, scale[s + 3] - 0.5), ti.i32), 0)
    fx, fy = x - ix, y - iy
    a = where[w] + iy * where[w + 3] + ix
    if ti.static(members):
        a += member * where[w + 5]
    b = a + where[w + 3]
    lower = nodes[a] + fx * (nodes[a + 1] - nodes[a])
    upper = nodes[b] + fx * (nodes[b + 1] - nodes[b])
    both = lower + fy * (upper - lower)  # (east, north) at the earlier and at the later time
    alpha = scale[s + 4] + scale[s + 5] * fraction
    u = both[0] + alpha * (both[2] - both[0])
    v = both[1] + alpha * (both[3] - both[1])
    known = (x <= scale[s + 2]) & (y <= scale[s + 3]) & (u + v == u + v)  # the last term: not NaN
    return f32x3(ti.select(known, u, 0.0), ti.select(known, v, 0.0), ti.select(known, 1.0, 0.0))


@ti.func
def sample(
    members: ti.template(),
    sea: ti.template(),
    row: ti.i32,
    first: ti.i32,
    last: ti.i32,
    lon: ti.i32,
    lat: ti.i32,
    fraction: ti.f32,
    member: ti.i32,
) -> f32x3:
    """Return (east, north, valid), summed over the groups of tiles in [first, last).

    Within a group, the first tile with a value at the point counts. sea: a `Sea`; row: where its
    `scale` begins for the step; fraction: of the step. first must begin a group, last end one.
    members: whether any tile has members, a compile-time constant; member: the point's own.
    """
    where = ti.static(sea.where)
    east, north, valid = 0.0, 0.0, 0.0
    tile = first
    while tile < last:
        w = tile * WHERE
        r = of_tile(members, sea, row, tile, lon, lat, fraction, member)
        east, north, valid = east + r[0], north + r[1], r[2]
        if valid > 0.5:
            tile = where[w + 4]  # the next group
        else:
            tile += 1
            if tile == where[w + 4]:
                tile = last  # the group has no value here, so the sum has none
    return f32x3(east, north, valid)


@ti.func
def numbers_of(sea: ti.template()) -> ti.i32:
    """Return how many numbers `scale` has per step."""
    return sea.where.shape[0] // WHERE * SCALE


def members_of(columns: Mapping[str, Any], tiles: "Tiles") -> Any:
    """Return the column of ensemble members, int32 (n,); a placeholder (1,) without members."""
    return columns["member"] if tiles.members > 1 else runtime.empty(1, ti.i32)


@ti.kernel
def _place(
    nodes: Nodes,
    values: ti.types.ndarray(dtype=ti.f32, ndim=1),
    first: ti.i32,
    later: ti.i32,
    shift: ti.i32,
):
    for i in range(values.shape[0] >> 1):  # `//` in the bound of a loop does not compile for Vulkan
        node = nodes[first + i]
        if shift == 1:
            node[0], node[1] = node[2], node[3]
        if later == 1:
            node[2], node[3] = values[2 * i], values[2 * i + 1]
        else:
            node[0], node[1] = values[2 * i], values[2 * i + 1]
        nodes[first + i] = node


@ti.kernel
def _sample_all(
    members: ti.template(),
    sea: Sea,
    first: ti.i32,
    last: ti.i32,
    fraction: ti.f32,
    lon: ti.types.ndarray(dtype=ti.i32, ndim=1),
    lat: ti.types.ndarray(dtype=ti.i32, ndim=1),
    member: ti.types.ndarray(dtype=ti.i32, ndim=1),
    out: ti.types.ndarray(dtype=ti.f32, ndim=1),
):
    for i in range(lon.shape[0]):
        r = sample(members, sea, 0, first, last, lon[i], lat[i], fraction, member[i])
        for k in ti.static(range(3)):
            out[3 * i + k] = r[k]


class Tiles:
    """The forcing tiles of a run on the device.

    `place` writes a time slice, `blend` sets the times of the next steps. ends: for each tile the
    one after the last of its group; by default all form one group. members: number of each tile's,
    by default one.
    """

    def __init__(
        self, grids: list[Grid], ends: list[int] | None = None, members: list[int] | None = None
    ) -> None:
        many = members or [1] * len(grids)
        self._own = [g.nlon * g.nlat for g in grids]  # nodes of one member
        sizes = [nodes * number for nodes, number in zip(self._own, many, strict=True)]
        if 4 * sum(sizes) >= 2**31:
            each = " of all members" if max(many) > 1 else ""
            raise UserError(
                f"forcing: {sum(sizes)} grid nodes{each} in the domain; at most 2**29 fit: make [domain] smaller"
            )
        self.grids = grids
        self.members = max(many, default=1)
        self.offsets = [int(x) for x in np.cumsum([0, *sizes])[:-1]]
        self.nodes = runtime.empty_nodes(sum(sizes))
        self._where = np.zeros((max(len(grids), 1), WHERE), np.int32)
        self._scale = np.zeros((max(len(grids), 1), SCALE), np.float32)
        ends = [len(grids)] * len(grids) if ends is None else ends
        for row, (grid, begin, end) in enumerate(zip(grids, self.offsets, ends, strict=True)):
            stride = self._own[row] if many[row] > 1 else 0
            self._where[row] = (
                begin,
                sphere.to_binary(grid.lon0),
                sphere.to_binary(grid.lat0),
                grid.nlon,
                end,
                stride,
            )
            self._scale[row] = (
                360 / sphere.TURN / grid.dlon,
                360 / sphere.TURN / grid.dlat,
                -1,
                -1,
                0,
                0,
            )
        self.where = runtime.upload(self._where)
        self.scale = runtime.upload(np.tile(self._scale, (MOST, 1)))
        self._seas: dict[tuple[int, ...], ti.ArgPack] = {}

    def place(
        self, tile: int, values: np.ndarray, *, later: bool, shift: bool = False, member: int = 0
    ) -> None:
        """Write a member's slice (nlat, nlon, 2) [m/s] as the later or the earlier one.

        shift: copy the later slice to the earlier one first.
        """
        first = self.offsets[tile] + member * self._own[tile]
        flat = np.ascontiguousarray(values, np.float32).reshape(-1)
        own = runtime.pairs(self.nodes)
        if own is None:
            _place(self.nodes, runtime.resident(flat), first, int(later), int(shift))
            return
        own = own[first : first + flat.size // 2]
        if shift:
            own[:, 0] = own[:, 1]
        own[:, int(later)] = flat.view(np.int64)

    def blend(self, *steps: Sequence[tuple[float, float] | None]) -> None:
        """Set the time weights of the next steps, at most MOST.

        Args:
            steps: for each step, per tile, the later slice's weight at its begin and end; None: no
                data in this step.
        """
        scale = np.tile(self._scale, (MOST, 1, 1))
        for own, weights in zip(scale, steps, strict=False):
            for row, (grid, weight) in enumerate(zip(self.grids, weights, strict=True)):
                own[row, 2:4] = (grid.nlon - 1, grid.nlat - 1) if weight else (-1, -1)
                begin, end = weight or (0.0, 0.0)
                own[row, 4:] = begin, end - begin
        self.scale.from_numpy(scale.reshape(-1))

    def at(
        self,
        first: int,
        last: int,
        lon: np.ndarray,
        lat: np.ndarray,
        fraction: float,
        member: np.ndarray | None = None,
    ) -> np.ndarray:
        """Return (east, north, valid) [m/s, m/s, 0 or 1], shape (n, 3), for tests and checks.

        lon, lat: binary angles (n,). member: int32 (n,), by default the first.
        """
        out = np.zeros(3 * lon.size, np.float32)
        own = np.zeros(lon.size, np.int32) if member is None else member
        _sample_all(self.members > 1, self.sea({}), first, last, fraction, lon, lat, own, out)
        return out.reshape(-1, 3)

    def sea(self, ranges: Ranges) -> ti.ArgPack:
        """Return the tiles as a `Sea` for kernels."""
        numbers = ordered(ranges)
        if numbers not in self._seas:
            self._seas[numbers] = launch.pack(Sea, self.nodes, self.where, self.scale, numbers)
        return self._seas[numbers]
