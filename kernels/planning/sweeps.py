"""Expected detections of moving particles by the legs of a path, for recorded tracks.

This is the exact detection probability on which a plan is refined.

The mathematics is that of the search itself (kernels.evidence.sweep), in a plane instead of on the
sphere: two straight motions at a time, of a leg and of a particle within a time bin. A particle
counts as under way before its own time `turn`, as adrift after it. As in kernels.evidence.sweep, a
Brownian bridge is passed at the mean velocity of its leg, not along its noise, and at most once
abeam of a leg. Near a sensor it is followed within a bin, at Levy's midpoints: if its whole hazard
in a bin were computed at one place, fewer particles would get more of it, and fewer would be
detected.
"""

import numpy as np
import taichi as ti

from kernels.evidence import sweep
from kernels.maths import noise
from kernels.planning.allocate import HostInts, HostReals
from kernels.planning.rectangles import LANES, Swarm, by_state, lanes
from kernels.runtime import runtime

BLOCK = 128
# distance from all legs, in sweep widths, beyond which comparisons leave a particle out: one leg
# detects 0.3 % there
FAR = 5.0
DEPTH = 5  # halvings of a bridge in a bin: five minutes to 9 s
# distance from a sensor, in spreads of a bridge in a bin, within which the bridge is followed, as
# in kernels.evidence.sweep
NEAR = 4.0
SEED = 20260601  # of the midpoints: the same for all legs that are compared
# 1 / (4 pi): the hazard's coefficient is W^2 / (4 pi) (Koopman 1980, inverse cube)
AREA = 0.07957747154594767
# [1/m2] largest integral of a leg in a bin: finite in float32 times any square of a sweep width.
# Right over a particle it would be infinite, and the particle's mean value undefined.
MOST = 1e20

f32x2 = sweep.f32x2


@ti.func
def _bend(i: ti.i32, t: ti.i32, share: ti.f32, stray: ti.f32) -> f32x2:
    """Return a bridge's deviation from its chord at a share of bin t.

    It consists of midpoints of midpoints, linear in between. stray: K sqrt(length of the bin) [m];
    a midpoint's standard deviation is half of that of its part.
    """
    off = f32x2(0.0, 0.0)
    for level in range(DEPTH):
        cells = 1 << level
        at = share * cells
        cell = ti.min(ti.cast(at, ti.i32), cells - 1)
        w = noise.further(ti.u32(SEED), ti.u32(0), noise.STREAM_LEVY, i, t, cells + cell)
        hat = 1.0 - ti.abs(2.0 * (at - cell) - 1.0)
        off += hat * 0.5 * stray / ti.sqrt(ti.f32(cells)) * noise.normals(w[0], w[1])
    return off


@ti.func
def _exposure(
    cube: ti.template(),
    bridged: ti.template(),
    i: ti.i32,
    first: ti.i32,
    last: ti.i32,
    edges: ti.i32,
    padded: ti.i32,
    time: ti.template(),
    x: ti.template(),
    y: ti.template(),
    value: ti.template(),
    turn: ti.f32,
    flow_x: ti.template(),
    flow_y: ti.template(),
    spread: ti.template(),
    node: ti.template(),
    table: ti.template(),
    scale: ti.f32,
    scale_under_way: ti.f32,
):
    """Return (-log(miss) adrift, -log(miss) under way, mean value of finding the particle).

    It covers nodes [first, last). node: (time, x, y, seeks). scale: one over the sweep width [1/m],
    0 if the particle is invisible. cube: return the integrals of ds / (2 r^3) instead of
    -log(miss), without scale.
    """
    total, under_way, worth = 0.0, 0.0, 0.0
    t = 0
    while t < edges - 2 and time[t + 1] <= node[4 * first]:
        t += 1
    for k in range(first, last - 1):
        begin, end = node[4 * k], node[4 * k + 4]
        sx, sy = node[4 * k + 1], node[4 * k + 2]
        vx, vy = (node[4 * k + 5] - sx) / (end - begin), (node[4 * k + 6] - sy) / (end - begin)
        pace = ti.max(ti.sqrt(vx * vx + vy * vy), sweep.TINY)
        now = begin
        passed = 0
        while now < end:
            till = ti.min(end, time[t + 1])
            if t == edges - 2:
                till = end
            steers = now < turn
            if steers and turn < till:
                till = turn
            own = scale
            if steers:
                own = scale_under_way
            here, there = value[t * padded + i], value[(t + 1) * padded + i]
            if here >= 0.0 and there >= 0.0 and node[4 * k + 3] > 0.0 and own > 0.0:
                long = time[t + 1] - time[t]
                px, py = x[t * padded + i], y[t * padded + i]
                dx, dy = (
                    (x[(t + 1) * padded + i] - px) / long,
                    (y[(t + 1) * padded + i] - py) / long,
                )
                a = f32x2(
                    px + dx * (now - time[t]) - sx - vx * (now - begin),
                    py + dy * (now - time[t]) - sy - vy * (now - begin),
                )
                b = a + f32x2(dx - vx, dy - vy) * (till - now)
                if ti.static(bridged):
                    stray = spread[t * padded + i] * ti.sqrt(long)
                    d = b - a
                    nearest = ti.min(ti.max(-a.dot(d) / ti.max(d.dot(d), 1e-6), 0.0), 1.0)
                    if stray > 0.0 and (a + nearest * d).norm() < NEAR * stray:
                        next_part = ti.floor((now - time[t]) / long * (1 << DEPTH) + 1e-2) + 1.0
                        part_ends = time[t] + next_part / (1 << DEPTH) * long
                        if next_part < (1 << DEPTH) and part_ends > now:
                            till = ti.min(till, part_ends)
                        a += _bend(i, t, (now - time[t]) / long, stray)
                        b = f32x2(
                            px + dx * (till - time[t]) - sx - vx * (till - begin),
                            py + dy * (till - time[t]) - sy - vy * (till - begin),
                        ) + _bend(i, t, (till - time[t]) / long, stray)
                more = 0.0
                if ti.static(cube):
                    if ti.static(bridged):
                        middle = 0.5 * (a + b)
                        half = (
                            0.5
                            * f32x2(flow_x[t * padded + i] - vx, flow_y[t * padded + i] - vy)
                            * (till - now)
                        )
                        a, b = middle - half, middle + half
                    far_a, far_b = (
                        ti.sqrt(a[0] * a[0] + a[1] * a[1]),
                        ti.sqrt(b[0] * b[0] + b[1] * b[1]),
                    )
                    more = ti.min(sweep.hazard(a, b, far_a, far_b), MOST)
                else:
                    ahead_a, ahead_b = (
                        -(a[0] * vx + a[1] * vy) / pace,
                        -(b[0] * vx + b[1] * vy) / pace,
                    )
                    lateral = sweep.lateral(a, b, ahead_a, ahead_b)
                    if lateral >= 0.0 and passed == 0:
                        more = -ti.log(ti.max(1.0 - sweep.chance(table, lateral * own), 1e-30))
                        if ti.static(bridged):
                            passed = 1
                if steers:
                    under_way += more
                else:
                    total += more
                share = (0.5 * (now + till) - time[t]) / long
                worth += more * (here + share * (there - here))
            if till == time[t + 1] and t < edges - 2:
                t += 1
            now = till
    if total + under_way > 0.0:
        worth /= total + under_way
    return total, under_way, worth


@ti.func
def _drifting(
    i: ti.i32,
    first: ti.i32,
    last: ti.i32,
    edges: ti.i32,
    padded: ti.i32,
    time: ti.template(),
    x: ti.template(),
    y: ti.template(),
    value: ti.template(),
    node: ti.template(),
):
    """Return (integral of ds / (2 r^3), mean value of finding) of LANES drifting particles.

    They are those from i on. It is `_exposure` of inverse cube legs without branches between
    particles, for compilers to make vector instructions: the same bits in a fraction of the time.
    """
    total, worth = ti.Vector([0.0] * LANES), ti.Vector([0.0] * LANES)
    t = 0
    while t < edges - 2 and time[t + 1] <= node[4 * first]:
        t += 1
    for k in range(first, last - 1):
        begin, end = node[4 * k], node[4 * k + 4]
        sx, sy = node[4 * k + 1], node[4 * k + 2]
        vx, vy = (node[4 * k + 5] - sx) / (end - begin), (node[4 * k + 6] - sy) / (end - begin)
        now = begin
        while now < end:
            till = ti.min(end, time[t + 1])
            if t == edges - 2:
                till = end
            if node[4 * k + 3] > 0.0:
                p = t * padded + i
                here, there = lanes(value, p), lanes(value, p + padded)
                long = time[t + 1] - time[t]
                px, py = lanes(x, p), lanes(y, p)
                dx, dy = (lanes(x, p + padded) - px) / long, (lanes(y, p + padded) - py) / long
                ax = px + dx * (now - time[t]) - sx - vx * (now - begin)
                ay = py + dy * (now - time[t]) - sy - vy * (now - begin)
                bx, by = ax + (dx - vx) * (till - now), ay + (dy - vy) * (till - now)
                # as kernels.evidence.sweep.hazard
                ex, ey = bx - ax, by - ay
                far_a, far_b = ti.sqrt(ax * ax + ay * ay), ti.sqrt(bx * bx + by * by)
                product, dot = far_a * far_b, ax * bx + ay * by
                cross = ax * by - ay * bx
                angle = ti.select(dot < 0.0, cross * cross / (product - dot), product + dot)
                length = ti.sqrt(ex * ex + ey * ey)
                more = 0.5 * length * (far_a + far_b) / ti.max(product * angle, sweep.TINY)
                more = ti.min(more, MOST)
                more = ti.select((here >= 0.0) & (there >= 0.0), more, 0.0)
                total += more
                share = (0.5 * (now + till) - time[t]) / long
                worth += more * (here + share * (there - here))
            if till == time[t + 1] and t < edges - 2:
                t += 1
            now = till
    return total, ti.select(total > 0.0, worth / total, worth)


@ti.func
def _near(
    i: ti.i32,
    c: ti.i32,
    widest: ti.f32,
    padded: ti.i32,
    box: ti.template(),
    extent: ti.template(),
):
    """Return whether a particle comes near enough to path c to be compared."""
    far = FAR * widest + box[2 * padded + i]
    return (
        widest > 0.0
        and ti.abs(box[i] - extent[4 * c]) < far + extent[4 * c + 2]
        and ti.abs(box[padded + i] - extent[4 * c + 1]) < far + extent[4 * c + 3]
    )


@ti.func
def _hazard(
    cube: ti.template(),
    total: ti.f32,
    under_way: ti.f32,
    w: ti.f32,
    w_under_way: ti.f32,
    factor: ti.f32,
) -> ti.f32:
    """Return -log(miss) from the results of `_exposure`, for sweep widths [m] times a factor."""
    exponent = total + under_way
    if ti.static(cube):
        exponent = total * ti.f32(AREA) * w * w * factor * factor
        exponent += under_way * ti.f32(AREA) * w_under_way * w_under_way * factor * factor
    return exponent


@ti.func
def _scale(w: ti.f32, factor: ti.f32) -> ti.f32:
    """Return one over a sweep width [1/m], 0 if the particle is invisible."""
    scale = 0.0
    if w > 0.0:
        scale = 1.0 / (w * factor)
    return scale


@ti.kernel
def _gains(
    cube: ti.template(),
    bridged: ti.template(),
    edges: ti.i32,
    padded: ti.i32,
    time: HostReals,
    x: HostReals,
    y: HostReals,
    value: HostReals,
    box: HostReals,
    scenario: HostInts,
    turn: HostReals,
    flow_x: HostReals,
    flow_y: HostReals,
    spread: HostReals,
    start: HostInts,
    extent: HostReals,
    node: HostReals,
    table: HostReals,
    width: HostReals,
    factor: HostReals,
    before: HostReals,
    later: HostReals,
    sums: HostReals,
):
    m, nodes, scenarios = scenario.shape[0], factor.shape[0], width.shape[0] // 2
    blocks = (m + BLOCK - 1) // BLOCK
    for cb in range(sums.shape[0]):
        c, block = cb // blocks, cb % blocks
        total = 0.0
        for i in range(block * BLOCK, ti.min(block * BLOCK + BLOCK, m)):
            w, w_under_way = width[scenario[i]], width[scenarios + scenario[i]]
            widest = ti.max(w, w_under_way)
            if _near(i, c, widest, padded, box, extent):
                h, steered, worth = 0.0, 0.0, 0.0
                for k in range(nodes):
                    if ti.static(not cube) or k == 0:
                        h, steered, worth = _exposure(
                            cube,
                            bridged,
                            i,
                            start[c],
                            start[c + 1],
                            edges,
                            padded,
                            time,
                            x,
                            y,
                            value,
                            turn[i],
                            flow_x,
                            flow_y,
                            spread,
                            node,
                            table,
                            _scale(w, factor[k]),
                            _scale(w_under_way, factor[k]),
                        )
                    exponent = _hazard(cube, h, steered, w, w_under_way, factor[k])
                    total += (
                        before[i * nodes + k]
                        * (worth - later[i * nodes + k])
                        * (1.0 - ti.exp(-exponent))
                    )
        sums[cb] = total


@ti.kernel
def _found(
    cube: ti.template(),
    bridged: ti.template(),
    edges: ti.i32,
    padded: ti.i32,
    time: HostReals,
    x: HostReals,
    y: HostReals,
    value: HostReals,
    box: HostReals,
    scenario: HostInts,
    turn: HostReals,
    flow_x: HostReals,
    flow_y: HostReals,
    spread: HostReals,
    node: HostReals,
    table: HostReals,
    width: HostReals,
    factor: HostReals,
    found: HostReals,
    when: HostReals,
):
    nodes, scenarios = factor.shape[0], width.shape[0] // 2
    for i in range(scenario.shape[0]):
        # written for every element: a graphics card copies the whole array back, but not to the
        # card
        when[i] = 0.0
        w, w_under_way = width[scenario[i]], width[scenarios + scenario[i]]
        h, steered, worth = 0.0, 0.0, 0.0
        for k in range(nodes):
            found[i * nodes + k] = 0.0
            if ti.max(w, w_under_way) > 0.0:
                if ti.static(not cube) or k == 0:
                    h, steered, worth = _exposure(
                        cube,
                        bridged,
                        i,
                        0,
                        node.shape[0] // 4,
                        edges,
                        padded,
                        time,
                        x,
                        y,
                        value,
                        turn[i],
                        flow_x,
                        flow_y,
                        spread,
                        node,
                        table,
                        _scale(w, factor[k]),
                        _scale(w_under_way, factor[k]),
                    )
                    when[i] = ti.max(when[i], worth)
                exponent = _hazard(cube, h, steered, w, w_under_way, factor[k])
                found[i * nodes + k] = 1.0 - ti.exp(-exponent)


@ti.kernel
def _gains_drifting(
    edges: ti.i32,
    padded: ti.i32,
    time: HostReals,
    x: HostReals,
    y: HostReals,
    value: HostReals,
    box: HostReals,
    scenario: HostInts,
    start: HostInts,
    extent: HostReals,
    node: HostReals,
    width: HostReals,
    factor: HostReals,
    before: HostReals,
    later: HostReals,
    sums: HostReals,
):
    m, nodes = scenario.shape[0], factor.shape[0]
    blocks = (m + BLOCK - 1) // BLOCK
    for cb in range(sums.shape[0]):
        c, block = cb // blocks, cb % blocks
        total = 0.0
        for group in range(BLOCK // LANES):
            i = block * BLOCK + group * LANES
            near = ti.Vector([0] * LANES)
            for j in ti.static(range(LANES)):
                if i + j < m:
                    near[j] = _near(i + j, c, width[scenario[i + j]], padded, box, extent)
            if near.any():
                h, worth = _drifting(
                    i, start[c], start[c + 1], edges, padded, time, x, y, value, node
                )
                for j in ti.static(range(LANES)):
                    if near[j]:
                        w = width[scenario[i + j]]
                        for k in range(nodes):
                            chance = 1.0 - ti.exp(-_hazard(True, h[j], 0.0, w, w, factor[k]))
                            at = (i + j) * nodes + k
                            total += before[at] * (worth[j] - later[at]) * chance
        sums[cb] = total


@ti.kernel
def _found_drifting(
    edges: ti.i32,
    padded: ti.i32,
    time: HostReals,
    x: HostReals,
    y: HostReals,
    value: HostReals,
    scenario: HostInts,
    node: HostReals,
    width: HostReals,
    factor: HostReals,
    found: HostReals,
    when: HostReals,
):
    nodes = factor.shape[0]
    for group in range(padded >> 3):
        i = group * LANES
        h, worth = _drifting(i, 0, node.shape[0] // 4, edges, padded, time, x, y, value, node)
        for j in ti.static(range(LANES)):
            w = width[scenario[ti.min(i + j, scenario.shape[0] - 1)]]
            when[i + j] = ti.select(w > 0.0, worth[j], 0.0)
            for k in range(nodes):
                exponent = _hazard(True, h[j], 0.0, w, w, factor[k])
                found[(i + j) * nodes + k] = 1.0 - ti.exp(-exponent)


def _nodes(path: np.ndarray) -> np.ndarray:
    """Return a path unchanged; raise ValueError unless it has four numbers per node.

    The kernels step through four numbers per node, and would misread any others.
    """
    if path.ndim != 2 or path.shape[1] != 4:
        raise ValueError(
            f"a path has nodes (time, x, y, seeks), shape (k, 4); this one has shape {path.shape}"
        )
    return path


def _extent(points: np.ndarray) -> np.ndarray:
    """Return the centre and half the sides of the box of points (k, 2)."""
    low, high = points.min(axis=0), points.max(axis=0)
    return np.concatenate([(low + high) / 2, (high - low) / 2])


def gains(
    particles: Swarm,
    table: np.ndarray | None,
    paths: list[np.ndarray],
    width: np.ndarray,
    factor: np.ndarray,
    before: np.ndarray,
    later: np.ndarray,
) -> np.ndarray:
    """Return the gain of each path, float64.

    It is the sum of before * (worth - later) * (1 - miss) over particles and nodes, worth the value
    of finding the particle then. Particles far from all of a path (FAR) are left out.

    Args:
        particles: the tracks.
        table: a lateral range curve (range / W, probability, ...); None: inverse cube.
        paths: nodes (time [s], x, y [m], whether the leg to the next node searches), straight in
            between.
        width: sweep width [m] by scenario, (scenarios,), or by state (2, scenarios).
        factor: of the sweep width at each node.
        before: remaining weight, (m, nodes).
        later: value that the remaining weight will still bring, (m, nodes).
    """
    start = np.concatenate([[0], np.cumsum([len(p) for p in paths])]).astype(np.int32)
    extent = np.concatenate([_extent(p[:, 1:3]) for p in paths]).astype(np.float32)
    m = particles.scenario.shape[0]
    sums = np.zeros(len(paths) * -(-m // BLOCK), np.float32)
    node, widths, factors, weight, rest = (
        np.ascontiguousarray(v, np.float32).reshape(-1)
        for v in (_nodes(np.concatenate(paths)), by_state(width), factor, before, later)
    )
    size = particles.time.shape[0], particles.turn.shape[0]
    if table is None and particles.drifting:
        read = runtime.residents(start, extent, node, widths, factors, weight, rest)
        _gains_drifting(*size, *particles.resident[:6], *read, sums)
        return sums.astype(np.float64).reshape(len(paths), -1).sum(axis=1)
    curve = np.zeros(4, np.float32) if table is None else np.asarray(table, np.float32).reshape(-1)
    _gains(
        table is None,
        len(particles.flow_x) > 0,
        *size,
        *particles.resident,
        *runtime.residents(start, extent, node, curve, widths, factors, weight, rest),
        sums,
    )
    return sums.astype(np.float64).reshape(len(paths), -1).sum(axis=1)


def found(
    particles: Swarm,
    table: np.ndarray | None,
    path: np.ndarray,
    width: np.ndarray,
    factor: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the detections of one path by particle.

    They are 1 - miss for each particle and node, float32 (m, nodes), and the value of finding the
    particle then, (m,). Arguments as in `gains`.
    """
    m, size = particles.scenario.shape[0], (particles.time.shape[0], particles.turn.shape[0])
    distinct, which = np.unique(factor, return_inverse=True)
    b, worth = np.zeros(size[1] * len(distinct), np.float32), np.zeros(size[1], np.float32)
    node, widths, factors = (
        np.ascontiguousarray(v, np.float32).reshape(-1)
        for v in (_nodes(path), by_state(width), distinct)
    )
    if table is None and particles.drifting:
        time, x, y, value, _, scenario, *_ = particles.resident
        read = runtime.residents(node, widths, factors)
        _found_drifting(*size, time, x, y, value, scenario, *read, b, worth)
        return np.take(b.reshape(size[1], -1)[:m], which, axis=1), worth[:m]
    curve = np.zeros(4, np.float32) if table is None else np.asarray(table, np.float32).reshape(-1)
    read = runtime.residents(node, curve, widths, factors)
    bridged = len(particles.flow_x) > 0
    _found(table is None, bridged, *size, *particles.resident, *read, b, worth)
    return np.take(b.reshape(size[1], -1)[:m], which, axis=1), worth[:m]
