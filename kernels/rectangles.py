"""What rectangles that are searched by parallel sweeps find of moving particles, without their single legs.

Swept laws: the legs are smeared out into a front that creeps across the rectangle. A particle is covered where the
front passes it, with W / S times the creep's speed over the front's speed past the particle: what drifts along with the
creep is covered more. Random search: the share of the search time that the particle spends inside. Tracks are straight
within a bin, in a plane.
"""

from typing import NamedTuple

import numpy as np
import taichi as ti

from kernels.allocate import HostInts, HostReals, look

BLOCK = 256
# Numbers of a rectangle: x, y, sine and cosine of the orientation, length, width, start, duration, side of the creep.
PARAMETERS = 9
FULL = 8.0  # coverage beyond which more is not counted


@ti.func
def _cover(
    random: ti.template(), i: ti.i32, c: ti.i32, edges: ti.i32, time: ti.template(), x: ti.template(), y: ti.template(),
    value: ti.template(), box: ti.template(), rectangle: ti.template(),
):  # fmt: skip
    """Return the coverage of particle i, in units of the pattern's own, and what finding it then is worth."""
    p = c * PARAMETERS
    cx, cy, sin, cos = rectangle[p], rectangle[p + 1], rectangle[p + 2], rectangle[p + 3]
    half, wide, side = rectangle[p + 4] * 0.5, rectangle[p + 5] * 0.5, rectangle[p + 8]
    start, duration = rectangle[p + 6], rectangle[p + 7]
    total, worth, weight = 0.0, 0.0, 0.0
    reach = half + wide + box[3 * i + 2]
    if ti.abs(box[3 * i] - cx) < reach and ti.abs(box[3 * i + 1] - cy) < reach:
        end = start + duration
        creep = 2.0 * wide / duration
        t = 0
        while t < edges - 2 and time[t + 1] <= start:
            t += 1
        while t < edges - 1 and time[t] < end:
            here, there = value[i * edges + t], value[i * edges + t + 1]
            if here >= 0.0 and there >= 0.0:
                first, last = ti.max(time[t], start), ti.min(time[t + 1], end)
                long = time[t + 1] - time[t]
                s0, s1 = (first - time[t]) / long, (last - time[t]) / long
                dx, dy = x[i * edges + t + 1] - x[i * edges + t], y[i * edges + t + 1] - y[i * edges + t]
                px, py = x[i * edges + t] - cx, y[i * edges + t] - cy
                ax, ay, bx, by = px + s0 * dx, py + s0 * dy, px + s1 * dx, py + s1 * dy
                a0, a1 = ax * sin + ay * cos, bx * sin + by * cos
                q0, q1 = side * (ax * cos - ay * sin), side * (bx * cos - by * sin)
                if ti.static(random):
                    # The part of the way inside the rectangle lies in both of its slabs.
                    low, high = 0.0, 1.0
                    for d in ti.static(range(2)):
                        u, v, h = a0, a1, half
                        if ti.static(d == 1):
                            u, v, h = q0, q1, wide
                        if ti.abs(v - u) > 1e-3:
                            e, f = (-h - u) / (v - u), (h - u) / (v - u)
                            low, high = ti.max(low, ti.min(e, f)), ti.min(high, ti.max(e, f))
                        elif ti.abs(u) > h:
                            high = -1.0
                    if high > low:
                        share = (high - low) * (last - first) / duration
                        total += share
                        at = s0 + 0.5 * (low + high) * (s1 - s0)
                        worth += share * (here + at * (there - here))
                        weight += share
                else:
                    q0 += wide - creep * (first - start)
                    q1 += wide - creep * (last - start)
                    if (q0 > 0.0) != (q1 > 0.0):
                        f = q0 / (q0 - q1)
                        if ti.abs(a0 + f * (a1 - a0)) <= half:
                            more = ti.min(creep * (last - first) / ti.abs(q1 - q0), FULL)
                            total += more
                            at = s0 + f * (s1 - s0)
                            worth += more * (here + at * (there - here))
                            weight += more
            t += 1
    if weight > 0.0:
        worth /= weight
    return total, worth


@ti.kernel
def _gains(
    random: ti.template(), edges: ti.i32, time: HostReals, x: HostReals, y: HostReals, value: HostReals, box: HostReals,
    scenario: HostInts, rectangle: HostReals, coverage: HostReals, scenarios: ti.i32, factor: HostReals, steps: ti.f32,
    curve: HostReals, before: HostReals, later: HostReals, sums: HostReals,
):  # fmt: skip
    m, nodes = scenario.shape[0], factor.shape[0]
    blocks = (m + BLOCK - 1) // BLOCK
    for cb in range(rectangle.shape[0] // PARAMETERS * blocks):
        c, block = cb // blocks, cb % blocks
        total = 0.0
        for i in range(block * BLOCK, ti.min(block * BLOCK + BLOCK, m)):
            share, worth = _cover(random, i, c, edges, time, x, y, value, box, rectangle)
            if share > 0.0:
                full = share * coverage[c * scenarios + scenario[i]]
                for k in range(nodes):
                    total += (
                        before[i * nodes + k] * (worth - later[i * nodes + k]) * look(curve, full * factor[k] * steps)
                    )
        sums[cb] = total


@ti.kernel
def _found(
    random: ti.template(), edges: ti.i32, time: HostReals, x: HostReals, y: HostReals, value: HostReals, box: HostReals,
    scenario: HostInts, rectangle: HostReals, coverage: HostReals, factor: HostReals, steps: ti.f32,
    curve: HostReals, found: HostReals, when: HostReals,
):  # fmt: skip
    nodes = factor.shape[0]
    for i in range(scenario.shape[0]):
        share, worth = _cover(random, i, 0, edges, time, x, y, value, box, rectangle)
        when[i] = worth
        for k in range(nodes):
            found[i * nodes + k] = look(curve, share * coverage[scenario[i]] * factor[k] * steps)


class Swarm(NamedTuple):
    """Tracks on a plane, as the kernels take them; on the host, float32 unless it says otherwise."""

    time: np.ndarray  # [s] (edges,)
    x: np.ndarray  # [m] (m * edges,), a particle's together
    y: np.ndarray
    value: np.ndarray  # what finding it is worth there; negative: it cannot be found
    box: np.ndarray  # (3 m,): middle of its box and the larger half of its sides [m]
    scenario: np.ndarray  # int32 (m,)


def swarm(time: np.ndarray, x: np.ndarray, y: np.ndarray, value: np.ndarray, scenario: np.ndarray) -> Swarm:
    """Return tracks at edges, x, y [m] and value (edges, m), for the kernels."""
    box = np.stack(
        [
            (x.max(0) + x.min(0)) / 2,
            (y.max(0) + y.min(0)) / 2,
            np.maximum(np.ptp(x, axis=0), np.ptp(y, axis=0)) / 2,
        ],
        axis=1,
    )
    flat = [np.ascontiguousarray(v.T, np.float32).reshape(-1) for v in (x, y, value)]
    return Swarm(np.asarray(time, np.float32), *flat, box.astype(np.float32).reshape(-1), scenario.astype(np.int32))


def gains(
    particles: Swarm, random: bool, rectangle: np.ndarray, coverage: np.ndarray, factor: np.ndarray, step: float,
    curve: np.ndarray, before: np.ndarray, later: np.ndarray,
) -> np.ndarray:  # fmt: skip
    """Return what each rectangle finds, float64 (c,).

    This is the sum of before * (worth - later) * b over particles and nodes.

    rectangle: (c, PARAMETERS), SI; coverage: (c, scenarios) of its pattern; factor: of the sweep width at each node;
    curve: b at multiples of a step of coverage; before, later: (m, nodes), the weight that is left, and what it will
    still bring.
    """
    m = particles.scenario.shape[0]
    sums = np.zeros(len(rectangle) * -(-m // BLOCK), np.float32)
    arrays = [np.ascontiguousarray(v, np.float32).reshape(-1) for v in (rectangle, coverage)]
    last = [np.ascontiguousarray(v, np.float32).reshape(-1) for v in (curve, before, later)]
    edges = particles.time.shape[0]
    _gains(random, edges, *particles, *arrays, coverage.shape[1], np.asarray(factor, np.float32), 1 / step, *last, sums)
    return sums.astype(np.float64).reshape(len(rectangle), -1).sum(axis=1)


def found(
    particles: Swarm, random: bool, rectangle: np.ndarray, coverage: np.ndarray, factor: np.ndarray, step: float,
    curve: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Return what one rectangle finds of each particle.

    The results are b for each particle and node, float32 (m, nodes), and what finding the particle then is worth, (m,).
    """
    m = particles.scenario.shape[0]
    b, worth = np.zeros(m * len(factor), np.float32), np.zeros(m, np.float32)
    arrays = [np.ascontiguousarray(v, np.float32).reshape(-1) for v in (rectangle, coverage, factor)]
    edges = particles.time.shape[0]
    _found(random, edges, *particles, *arrays, 1 / step, np.asarray(curve, np.float32), b, worth)
    return b.reshape(m, -1), worth
