"""Expected detections of moving particles in rectangles searched by parallel sweeps.

Single legs are not resolved. Sweep detection functions: the legs are spread out into a front that
creeps across the rectangle. A particle is covered when the front passes it, with W / S times the
creep's speed over the front's speed relative to the particle: a particle that drifts along with the
creep is covered more. Random search: the share of the search time that the particle spends inside.
Tracks are straight within a bin, in a plane. A particle counts as under way before its own time
`turn`, as adrift after it.

Kernels take LANES neighbouring particles at a time, without branches between them: compilers make
vector instructions of that. A particle gets the same bits as by itself.
"""

from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any

import numpy as np
import taichi as ti

from kernels.planning.allocate import HostInts, HostReals, look
from kernels.runtime import runtime

BLOCK = 256
LANES = 8  # particles in a vector; divides BLOCK
# Numbers of a rectangle: x, y, sine and cosine of the orientation, length, width, start, duration,
# side of the creep.
PARAMETERS = 9
FULL = 8.0  # upper bound of coverage
ROUNDING = 10.0  # [m] larger than the rounding of positions in the plane


@ti.func
def lanes(column: ti.template(), at: ti.i32):
    """Return LANES neighbouring numbers of an array."""
    return ti.Vector([column[at + j] for j in range(LANES)])


@ti.func
def _cover(
    random: ti.template(),
    i: ti.i32,
    c: ti.i32,
    edges: ti.i32,
    padded: ti.i32,
    time: ti.template(),
    x: ti.template(),
    y: ti.template(),
    value: ti.template(),
    box: ti.template(),
    turn: ti.template(),
    rectangle: ti.template(),
):
    """Return (coverage adrift, coverage under way, mean value of finding) of particles.

    They are LANES particles from i on, of `padded`. Coverage is in units of the pattern's own.
    turn: when each goes adrift [s].
    """
    p = c * PARAMETERS
    cx, cy, sin, cos = rectangle[p], rectangle[p + 1], rectangle[p + 2], rectangle[p + 3]
    half, wide, side = rectangle[p + 4] * 0.5, rectangle[p + 5] * 0.5, rectangle[p + 8]
    start, duration = rectangle[p + 6], rectangle[p + 7]
    total, under_way = ti.Vector([0.0] * LANES), ti.Vector([0.0] * LANES)
    worth, weight = ti.Vector([0.0] * LANES), ti.Vector([0.0] * LANES)
    # A particle whose box does not meet the rectangle never enters it, and is not covered.
    east, north = lanes(box, i) - cx, lanes(box, padded + i) - cy
    reach = (lanes(box, 2 * padded + i) + ROUNDING) * (ti.abs(sin) + ti.abs(cos))
    meets = (ti.abs(east * sin + north * cos) < half + reach) & (
        ti.abs(east * cos - north * sin) < wide + reach
    )
    if meets.any():
        end = start + duration
        creep = 2.0 * wide / duration
        adrift = lanes(turn, i)
        t = 0
        while t < edges - 2 and time[t + 1] <= start:
            t += 1
        while t < edges - 1 and time[t] < end:
            k = t * padded + i
            here, there = lanes(value, k), lanes(value, k + padded)
            present = meets & (here >= 0.0) & (there >= 0.0)
            first, last = ti.max(time[t], start), ti.min(time[t + 1], end)
            long = time[t + 1] - time[t]
            s0, s1 = (first - time[t]) / long, (last - time[t]) / long
            dx, dy = lanes(x, k + padded) - lanes(x, k), lanes(y, k + padded) - lanes(y, k)
            px, py = lanes(x, k) - cx, lanes(y, k) - cy
            ax, ay, bx, by = px + s0 * dx, py + s0 * dy, px + s1 * dx, py + s1 * dy
            a0, a1 = ax * sin + ay * cos, bx * sin + by * cos
            q0, q1 = side * (ax * cos - ay * sin), side * (bx * cos - by * sin)
            if ti.static(random):
                # The part of the path inside the rectangle is the intersection with both of its
                # slabs.
                low, high = ti.Vector([0.0] * LANES), ti.Vector([1.0] * LANES)
                for d in ti.static(range(2)):
                    u, v, h = a0, a1, half
                    if ti.static(d == 1):
                        u, v, h = q0, q1, wide
                    moves = ti.abs(v - u) > 1e-3
                    e, f = (-h - u) / (v - u), (h - u) / (v - u)
                    low = ti.select(moves, ti.max(low, ti.min(e, f)), low)
                    stays = ti.select(ti.abs(u) > h, -1.0, high)
                    high = ti.select(moves, ti.min(high, ti.max(e, f)), stays)
                inside = present & (high > low)
                share = (high - low) * (last - first) / duration
                steered = ti.min((adrift - first - low * (last - first)) / duration, share)
                under_way += ti.select(inside & (steered > 0.0), steered, 0.0)
                total += ti.select(inside, ti.select(steered > 0.0, share - steered, share), 0.0)
                at = s0 + 0.5 * (low + high) * (s1 - s0)
                worth += ti.select(inside, share * (here + at * (there - here)), 0.0)
                weight += ti.select(inside, share, 0.0)
            else:
                q0 += wide - creep * (first - start)
                q1 += wide - creep * (last - start)
                f = q0 / (q0 - q1)
                inside = ti.abs(a0 + f * (a1 - a0)) <= half
                passed = present & ((q0 > 0.0) != (q1 > 0.0)) & inside
                more = ti.min(creep * (last - first) / ti.abs(q1 - q0), FULL)
                steers = first + f * (last - first) < adrift
                under_way += ti.select(passed & steers, more, 0.0)
                total += ti.select(passed & (steers == 0), more, 0.0)
                at = s0 + f * (s1 - s0)
                worth += ti.select(passed, more * (here + at * (there - here)), 0.0)
                weight += ti.select(passed, more, 0.0)
            t += 1
        worth = ti.select(weight > 0.0, worth / weight, worth)
    return total, under_way, worth


@ti.kernel
def _gains(
    random: ti.template(),
    edges: ti.i32,
    padded: ti.i32,
    time: HostReals,
    x: HostReals,
    y: HostReals,
    value: HostReals,
    box: HostReals,
    scenario: HostInts,
    turn: HostReals,
    rectangle: HostReals,
    coverage: HostReals,
    scenarios: ti.i32,
    factor: HostReals,
    steps: ti.f32,
    curve: HostReals,
    before: HostReals,
    later: HostReals,
    sums: HostReals,
):
    m, nodes = scenario.shape[0], factor.shape[0]
    blocks = (m + BLOCK - 1) // BLOCK
    for cb in range(rectangle.shape[0] // PARAMETERS * blocks):
        c, block = cb // blocks, cb % blocks
        total = 0.0
        for group in range(BLOCK // LANES):
            first = block * BLOCK + group * LANES
            if first < m:
                shares, steering, worths = _cover(
                    random, first, c, edges, padded, time, x, y, value, box, turn, rectangle
                )
                for j in ti.static(range(LANES)):
                    if shares[j] + steering[j] > 0.0:
                        i = first + j
                        own = 2 * c * scenarios + scenario[i]
                        full = shares[j] * coverage[own] + steering[j] * coverage[own + scenarios]
                        for k in range(nodes):
                            chance = look(curve, full * factor[k] * steps)
                            total += (
                                before[i * nodes + k] * (worths[j] - later[i * nodes + k]) * chance
                            )
        sums[cb] = total


@ti.kernel
def _found(
    random: ti.template(),
    edges: ti.i32,
    padded: ti.i32,
    time: HostReals,
    x: HostReals,
    y: HostReals,
    value: HostReals,
    box: HostReals,
    scenario: HostInts,
    turn: HostReals,
    rectangle: HostReals,
    coverage: HostReals,
    factor: HostReals,
    steps: ti.f32,
    curve: HostReals,
    found: HostReals,
    when: HostReals,
):
    nodes, scenarios = factor.shape[0], coverage.shape[0] // 2
    for group in range(padded >> 3):
        first = group * LANES
        shares, steering, worths = _cover(
            random, first, 0, edges, padded, time, x, y, value, box, turn, rectangle
        )
        for j in ti.static(range(LANES)):
            i = first + j
            own = scenario[ti.min(i, scenario.shape[0] - 1)]
            full = shares[j] * coverage[own] + steering[j] * coverage[scenarios + own]
            when[i] = worths[j]
            for k in range(nodes):
                found[i * nodes + k] = look(curve, full * factor[k] * steps)


@dataclass(frozen=True, eq=False)
class Swarm:
    """Tracks on a plane, as kernels take them; on the host, float32 unless stated otherwise.

    All columns but `scenario` are padded to whole vectors of LANES particles, with particles that
    cannot be found: n particles instead of m. Times follow each other, as do the numbers of a box.
    """

    time: np.ndarray  # [s] (edges,)
    x: np.ndarray  # [m] (edges * n,)
    y: np.ndarray
    value: np.ndarray  # value of finding it there; negative: it cannot be found
    box: np.ndarray  # (3 n,): centre of its box and half of the longer side [m]
    scenario: np.ndarray  # int32 (m,)
    # [s] when a particle that was under way goes adrift (n,); NEVER: it drifts from the begin
    turn: np.ndarray
    # Mean velocity [m/s] from each edge on, (edges * n,): of a bridge's leg, without its noise;
    # (0,): that of the track.
    flow_x: np.ndarray
    flow_y: np.ndarray
    # spread rate of that bridge [m/sqrt(s)] (edges * n,), 0 where a track is straight; (0,): all
    # are straight
    k: np.ndarray

    def at_edges(self, column: np.ndarray) -> np.ndarray:
        """Return a column of all particles at all edges, such as x, shape (edges, m)."""
        return column.reshape(len(self.time), -1)[:, : len(self.scenario)]

    @cached_property
    def drifting(self) -> bool:
        """Whether all particles drift from the begin."""
        return len(self.flow_x) == 0 and bool((self.turn == np.float32(NEVER)).all())

    @cached_property
    def resident(self) -> tuple[Any, ...]:
        """All columns as kernels take them repeatedly: copied to a graphics card once."""
        return tuple(runtime.resident(getattr(self, each.name)) for each in fields(self))


NEVER = -1e30  # [s] before all times


def swarm(
    time: np.ndarray,
    x: np.ndarray,
    y: np.ndarray,
    value: np.ndarray,
    scenario: np.ndarray,
    turn: np.ndarray | None = None,
    flow: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None,
) -> Swarm:
    """Return tracks as kernels take them.

    Args:
        time: of the edges [s], (edges,).
        x: [m] at the edges, (edges, m).
        y: [m] at the edges, (edges, m).
        value: of finding a particle there, (edges, m); negative: it cannot be found.
        scenario: of each particle, (m,).
        turn: when each particle goes adrift [s], (m,); by default before all times.
        flow: mean velocities east and north [m/s] and spread rates of bridges [m/sqrt(s)], (edges,
            m) each.
    """
    extent = np.maximum(np.ptp(x, axis=0), np.ptp(y, axis=0)) / 2
    box = np.stack([(x.max(0) + x.min(0)) / 2, (y.max(0) + y.min(0)) / 2, extent])
    none = np.zeros(0, np.float32)
    flows = (none, none, none) if flow is None else map(_padded, flow)
    turns = np.full(x.shape[1], NEVER) if turn is None else turn
    return Swarm(
        np.asarray(time, np.float32),
        _padded(x),
        _padded(y),
        _padded(value, -1.0),
        _padded(box),
        scenario.astype(np.int32),
        _padded(turns[None], NEVER),
        *flows,
    )


def _padded(values: np.ndarray, fill: float = 0.0) -> np.ndarray:
    """Return rows of values, (k, m), padded to whole vectors, float32 (k * n,)."""
    more = -values.shape[1] % LANES
    rows = np.pad(values.astype(np.float32), ((0, 0), (0, more)), constant_values=fill)
    return rows.reshape(-1)


def by_state(values: np.ndarray, leading: int = 0) -> np.ndarray:
    """Return numbers by state (adrift, under way) and scenario: (..., 2, scenarios).

    values: (..., scenarios), the same in both states, or (..., 2, scenarios); leading: number of
    leading dimensions.
    """
    values = np.asarray(values)
    return values if values.ndim == leading + 2 else np.repeat(values[..., None, :], 2, axis=-2)


def gains(
    particles: Swarm,
    random: bool,
    rectangle: np.ndarray,
    coverage: np.ndarray,
    factor: np.ndarray,
    step: float,
    curve: np.ndarray,
    before: np.ndarray,
    later: np.ndarray,
) -> np.ndarray:
    """Return the gain of each rectangle, float64 (c,).

    It is the sum of before * (worth - later) * b over particles and nodes, b the probability of
    detection and worth the value of finding the particle then.

    Args:
        particles: the tracks.
        random: whether the rectangle is searched at random, not by sweeps.
        rectangle: (c, PARAMETERS), SI.
        coverage: of its pattern, (c, scenarios), or by state (c, 2, scenarios).
        factor: of the sweep width at each node.
        step: of coverage, between values of the curve.
        curve: b at multiples of the step.
        before: remaining weight, (m, nodes).
        later: value that the remaining weight will still bring, (m, nodes).
    """
    m, coverage = particles.scenario.shape[0], by_state(coverage, 1)
    sums = np.zeros(len(rectangle) * -(-m // BLOCK), np.float32)
    read = [
        np.ascontiguousarray(v, np.float32).reshape(-1)
        for v in (rectangle, coverage, factor, curve, before, later)
    ]
    place, covered, factors, *last = runtime.residents(*read)
    edges, padded = particles.time.shape[0], particles.turn.shape[0]
    moving, scenarios = particles.resident[:-3], coverage.shape[-1]
    _gains(
        random, edges, padded, *moving, place, covered, scenarios, factors, 1 / step, *last, sums
    )
    return sums.astype(np.float64).reshape(len(rectangle), -1).sum(axis=1)


def found(
    particles: Swarm,
    random: bool,
    rectangle: np.ndarray,
    coverage: np.ndarray,
    factor: np.ndarray,
    step: float,
    curve: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the detections of one rectangle by particle.

    They are b for each particle and node, float32 (m, nodes), and the value of finding the particle
    then, (m,). coverage: (scenarios,), or by state (2, scenarios); other arguments as in `gains`.
    """
    m, padded = particles.scenario.shape[0], particles.turn.shape[0]
    distinct, which = np.unique(factor, return_inverse=True)
    b, worth = np.zeros(padded * len(distinct), np.float32), np.zeros(padded, np.float32)
    read = [
        np.ascontiguousarray(v, np.float32).reshape(-1)
        for v in (rectangle, by_state(coverage), distinct, curve)
    ]
    *arrays, table = runtime.residents(*read)
    edges = particles.time.shape[0]
    _found(random, edges, padded, *particles.resident[:-3], *arrays, 1 / step, table, b, worth)
    return np.take(b.reshape(padded, -1)[:m], which, axis=1), worth[:m]
