"""Pieces of particles' paths in a step, the input of all evidence kernels: `Paths`.

A drifting particle moves straight in a step, or in each of a few parts of it; `Straights` holds the
ends of that one piece in columns. It is stationary before it moves and after it strands, which
makes one more piece at either end.

A steering target has a list of pieces, which kernels.steering.steer writes once for all sensors.
The first piece is stored at the target's own slot, all others behind the slots, wherever there is
room; each holds the index of the next one. A target that has arrived or run aground has one more,
stationary piece. A piece may be a Brownian bridge. Where its shape matters it is halved at Levy's
midpoints (`Part`), which are the same for all sensors (kernels.maths.noise).
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import taichi as ti

from kernels.maths import noise, sphere
from kernels.runtime import launch, runtime
from kernels.runtime.batch import Batch
from kernels.steering import ways
from kernels.steering.itinerary import Target
from kernels.step import life
from kernels.step.coast import Ints, Reals

NONE = -1  # there is no further piece
# pieces of a drifting particle: before it moves, while it moves, stranded
WAITS, MOVES, LIES = range(3)
DEPTH = 14  # most halvings of a piece: an hour to 0.2 s

Ends = ti.types.vector(DEPTH + 2, ti.i32)

Pieces = ti.types.argpack(
    piece_lon=Ints,  # [binary angle] where it begins
    piece_lat=Ints,
    piece_to_lon=Ints,
    piece_to_lat=Ints,
    piece_begin=Ints,  # [s]
    piece_end=Ints,
    piece_count=Ints,  # its number in the step, a key of its noise; NONE: the target has no piece
    piece_next=Ints,  # index of the next piece, or NONE
    piece_k=Reals,  # K of the bridge [m/sqrt(s)]; 0: it goes straight
    # (east, north) [m/s]: mean velocity of a bridge's leg. A single array, as `_steer` of
    # kernels.steering.steer has no buffer left on Metal.
    piece_velocity=Reals,
    piece_used=Ints,  # (1,) number of pieces, all slots included
)

Straights = ti.types.argpack(
    straight_lon=Ints,  # [binary angle] position at the begin of the part of the step
    straight_lat=Ints,
    straight_to_lon=Ints,  # and at its end
    straight_to_lat=Ints,
    release=Ints,  # [s]
    moving_since=Ints,
)

Piece = ti.types.struct(
    lon=ti.i32,  # [binary angle] where it begins, and where it ends
    lat=ti.i32,
    to_lon=ti.i32,
    to_lat=ti.i32,
    begin=ti.f32,  # [s after the step's begin]
    end=ti.f32,
    k=ti.f32,  # K of the bridge [m/sqrt(s)]; 0: it goes straight
)

Part = ti.types.struct(
    lon=ti.i32,  # [binary angle] where it begins, and where it ends
    lat=ti.i32,
    to_lon=ti.i32,
    to_lat=ti.i32,
    begin=ti.f32,  # [s after the step's begin]
    end=ti.f32,
    at=ti.i32,  # its begin in units of 2^-DEPTH of the piece
    depth=ti.i32,  # number of halvings; below 0: there is no further part
)

Later = ti.types.struct(
    # parts that come later: their ends and depths, the nearest one last
    many=ti.i32,
    lons=Ends,
    lats=Ends,
    depths=Ends,
)


@ti.func
def first_piece(
    steers: ti.template(),
    paths: ti.template(),
    i: ti.i32,
    status: ti.i32,
    elapsed: ti.i32,
    shore: ti.i32,
) -> ti.i32:
    """Return the index of a particle's first piece, or NONE.

    A steering target's piece is at its slot; a drifting particle's is WAITS or MOVES. shore: 1 if
    stranded particles are visible.
    """
    here = NONE
    if ti.static(steers):
        if paths.piece_count[i] != NONE:
            here = i
    else:
        if status < life.PENDING:
            here = MOVES
            if shore == 1 and paths.moving_since[i] > ti.max(elapsed, paths.release[i]):
                here = WAITS
    return here


@ti.func
def next_piece(
    steers: ti.template(), paths: ti.template(), here: ti.i32, status: ti.i32, shore: ti.i32
) -> ti.i32:
    """Return the index of the next piece, or NONE."""
    then = NONE
    if ti.static(steers):
        then = paths.piece_next[here]
    else:
        if shore == 1 and here != LIES and (here == WAITS or status == life.ASHORE):
            then = here + 1
    return then


@ti.func
def load_piece(
    steers: ti.template(),
    paths: ti.template(),
    i: ti.i32,
    here: ti.i32,
    status: ti.i32,
    status_since: ti.i32,
    elapsed: ti.i32,
    duration: ti.i32,
    shore: ti.i32,
) -> Piece:
    """Return a piece of particle i, empty if the particle is aground and invisible there.

    elapsed, duration: of the part of the step that the paths cover [s].
    """
    piece = Piece(k=0.0)
    if ti.static(steers):
        piece.lon, piece.lat = paths.piece_lon[here], paths.piece_lat[here]
        piece.to_lon, piece.to_lat = paths.piece_to_lon[here], paths.piece_to_lat[here]
        piece.begin = ti.cast(paths.piece_begin[here] - elapsed, ti.f32)
        piece.end = ti.cast(paths.piece_end[here] - elapsed, ti.f32)
        piece.k = paths.piece_k[here]
        if shore == 0 and status == life.AGROUND and paths.piece_begin[here] >= status_since:
            piece.end = piece.begin
    else:
        times = life.behind(
            status, paths.release[i], status_since, paths.moving_since[i], elapsed, duration
        )
        seen, left, finish, gone = times[0], times[1], times[2], times[3]
        piece.lon, piece.lat = paths.straight_lon[i], paths.straight_lat[i]
        piece.to_lon, piece.to_lat = paths.straight_to_lon[i], paths.straight_to_lat[i]
        begin, end = left, finish
        if here != MOVES:
            if here == WAITS:
                begin, end = seen, left
                piece.to_lon, piece.to_lat = piece.lon, piece.lat
            else:
                begin, end = ti.max(left, finish), gone
                piece.lon, piece.lat = piece.to_lon, piece.to_lat
        piece.begin, piece.end = ti.cast(begin - elapsed, ti.f32), ti.cast(end - elapsed, ti.f32)
    return piece


@ti.func
def leg_velocity(paths: ti.template(), here: ti.i32) -> ti.types.vector(2, ti.f32):
    """Return (east, north) [m/s]: the mean velocity of a bridge's leg."""
    return ti.Vector([paths.piece_velocity[2 * here], paths.piece_velocity[2 * here + 1]])


@ti.func
def whole_piece(piece: Piece) -> Part:
    """Return a piece as a single part."""
    return Part(
        lon=piece.lon,
        lat=piece.lat,
        to_lon=piece.to_lon,
        to_lat=piece.to_lat,
        begin=piece.begin,
        end=piece.end,
        at=0,
        depth=0,
    )


@ti.func
def no_later() -> Later:
    """Return an empty stack of later parts."""
    return Later(many=0, lons=Ends(0), lats=Ends(0), depths=Ends(0))


@ti.func
def halve_part(
    part: ti.template(),
    later: ti.template(),
    piece: Piece,
    seed0: ti.u32,
    seed1: ti.u32,
    slot: ti.i32,
    step: ti.i32,
    count: ti.i32,
):
    """Replace a part of a bridge by its first half, which ends at Levy's midpoint.

    The second half goes to `later`. slot, step, count: number of the target in the whole run, of
    the step, and of the piece in the step, which are the key of the noise.
    """
    n = later.many
    later.lons[n], later.lats[n], later.depths[n], later.many = (
        part.to_lon,
        part.to_lat,
        part.depth + 1,
        n + 1,
    )
    middle = part.at + (1 << (DEPTH - part.depth - 1))
    w = noise.further(seed0, seed1, noise.STREAM_LEVY, slot, step, (count << (DEPTH + 1)) + middle)
    normal, half = noise.normals(w[0], w[1]), 0.5 * (part.end - part.begin)
    x, y = ways.toward(part.lon, part.lat, part.to_lon, part.to_lat, half, half, piece.k, normal)
    part.to_lon, part.to_lat, part.depth = x, y, part.depth + 1
    _time_part(part, piece)


@ti.func
def next_part(part: ti.template(), later: ti.template(), piece: Piece):
    """Replace a part by the next part of its piece."""
    part.at += 1 << (DEPTH - part.depth)
    part.lon, part.lat, part.depth = part.to_lon, part.to_lat, -1
    if later.many > 0:
        n = later.many - 1
        part.to_lon, part.to_lat, part.depth, later.many = (
            later.lons[n],
            later.lats[n],
            later.depths[n],
            n,
        )
        _time_part(part, piece)


@ti.func
def _time_part(part: ti.template(), piece: Piece):
    """Write the begin and end times of a part of a piece."""
    whole = piece.end - piece.begin
    part.begin = piece.begin + whole * ti.cast(part.at, ti.f32) * (1.0 / (1 << DEPTH))
    part.end = part.begin + whole * ti.cast(1 << (DEPTH - part.depth), ti.f32) * (
        1.0 / (1 << DEPTH)
    )


@ti.func
def note(
    pieces: ti.template(),
    slot: ti.i32,
    last: ti.i32,
    target: Target,
    x: ti.i32,
    y: ti.i32,
    end: ti.i32,
    k: ti.f32,
    count: ti.i32,
):
    """Write a piece of the target in a slot, from its position to (x, y); return its index.

    end: [s] when the piece ends; last: index of the piece before, or NONE. Without room a piece is
    only counted.
    """
    here, room = slot, pieces.piece_lon.shape[0]
    if last != NONE:
        here = ti.atomic_add(pieces.piece_used[0], 1)
        if here < room:
            pieces.piece_next[last] = here
    if here < room:
        pieces.piece_lon[here], pieces.piece_lat[here] = target.lon, target.lat
        pieces.piece_to_lon[here], pieces.piece_to_lat[here] = x, y
        pieces.piece_begin[here], pieces.piece_end[here] = target.time, end
        pieces.piece_count[here], pieces.piece_next[here], pieces.piece_k[here] = count, NONE, k
        if k > 0.0:
            far = sphere.offset(target.lon, target.lat, target.to_lon, target.to_lat)
            pace = 1.0 / ti.max(ti.cast(target.to_time - target.time, ti.f32), 1.0)
            pieces.piece_velocity[2 * here], pieces.piece_velocity[2 * here + 1] = (
                far[0] * pace,
                far[1] * pace,
            )
    return here if here < room else last


class Paths(NamedTuple):
    """Paths of some particles over the last step, or of drifting ones over a straight part."""

    own: Batch  # the particles
    steers: bool
    pack: Any  # Pieces (steering) or Straights (drifting)
    elapsed: int  # [s] from the run's start to the begin of the step or part
    duration: int  # [s]
    step: int  # number of the step, the key of its noise
    polar: bool = False  # whether the domain holds a pole

    def cut(self, first: float, last: float) -> tuple[float, float]:
        """Return the part of [first, last] that the paths cover [s after the run's start]."""
        return max(first, self.elapsed), min(last, self.elapsed + self.duration)


def straight(
    ensemble: Any,
    own: Batch,
    before: tuple[Any, Any],
    after: tuple[Any, Any],
    elapsed: int,
    duration: int,
    step: int = 0,
    polar: bool = False,
) -> Paths:
    """Return the paths of drifting particles over a part of a step in which they move straight.

    Args:
        ensemble: a drift.engine.particles.ensemble.Ensemble, after the step.
        own: the particles.
        before: lon, lat [binary angle] at the begin of the part, int32 on the device, (n,) each.
        after: lon, lat [binary angle] at its end.
        elapsed: begin of the part [s after the run's start].
        duration: of the part [s].
        step: number of the step.
        polar: whether the domain holds a pole.
    """
    pack = launch.pack(Straights, *before, *after, ensemble.release, ensemble.moving_since)
    return Paths(own, False, pack, elapsed, duration, step, polar)


def steered(own: Batch, pack: Any, step: Any) -> Paths:
    """Return the paths of targets in a step.

    pack: their pieces, see kernels.steering.steer.write_pieces; step: a kernels.step.advance.Step.
    """
    return Paths(own, True, pack, step.elapsed, step.duration, step.number)


class Room:
    """The pieces of one step on the device.

    Their columns are reused from step to step, and grow if necessary.
    """

    def __init__(self, slots: int) -> None:
        self._slots, self._used = slots, runtime.empty(1, ti.i32)
        self._of(slots)

    def _of(self, size: int) -> None:
        # free the old columns before new ones are allocated
        self.size, self.pack, self.columns = size, None, {}
        sizes = dict.fromkeys(Pieces.members, size) | {"piece_velocity": 2 * size}
        self.columns = {
            name: runtime.empty(sizes[name], member.dtype)
            for name, member in Pieces.members.items()
        }
        self.columns["piece_used"] = self._used
        self.pack = launch.pack(Pieces, *self.columns.values())

    def fill(self, write: Callable[[Any], None]) -> None:
        """Call `write` with the pack, again with more room until all pieces fit."""
        while not self.enough(write):
            pass

    def enough(self, write: Callable[[Any], None]) -> bool:
        """Call `write` with the pack; return whether all pieces fitted, else enlarge it."""
        self._used.from_numpy(np.array([self._slots], np.int32))
        write(self.pack)
        used = int(self._used.to_numpy()[0])
        if used > self.size:
            self._of(used + used // 8)
            return False
        return True
