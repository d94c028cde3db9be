"""Detection by a passive sonar or by a table of POD along the paths of particles.

See kernels.evidence.listen and kernels.evidence.glimpse for the sensors, kernels.steering.pieces
for the paths. A Brownian bridge that may be detected is halved until its spread is at most the
spacing of the sonar's table of losses, or half a cell of POD. The source level of a bridge uses the
speed of its leg.
"""

from typing import Any

import numpy as np
import taichi as ti

from kernels.evidence import glimpse, jumps, listen
from kernels.evidence.glimpse import HEARD, Pods
from kernels.evidence.listen import Ear, HostReals, Laid, Stretch, f32x2
from kernels.maths import noise, sphere
from kernels.runtime import batch, bundle, runtime
from kernels.steering import pieces
from kernels.steering.pieces import DEPTH, NONE, Paths, Pieces, Straights
from kernels.step import life
from kernels.step.coast import Ints, Reals

NOTHING = np.zeros(1, np.float32)  # placeholder for tables that the kernel does not read


def _watching(Ways: Any, steers: bool) -> Any:
    """Return the kernel for one kind of path: `Straights` (drifting) or `Pieces` (steering)."""

    @ti.kernel
    def _watch(
        kind: ti.template(),
        listed: ti.template(),
        first: ti.i32,
        last: ti.i32,
        slots: Ints,
        shift: Ints,
        scenario: Ints,
        status: Ints,
        status_since: Ints,
        paths: Ways,
        elapsed: ti.i32,
        duration: ti.i32,
        step: ti.i32,
        seed0: ti.u32,
        seed1: ti.u32,
        ear: Ear,
        losses: HostReals,
        around: HostReals,
        levels: HostReals,
        paces: HostReals,
        offsets: HostReals,
        limits: HostReals,
        log_missed: Reals,
        edges: Reals,
        held: Reals,
        shore: ti.i32,
    ):
        many = offsets.shape[0]
        size = log_missed.shape[0] // many
        if ti.static(bundle.threads(384) and kind == HEARD):
            ti.loop_config(block_dim=384)
        for nth in range(first * many, last * many):
            i, f = batch.slot(listed, slots, nth), 0
            if ti.static(kind == HEARD):
                i, f = batch.slot(listed, slots, nth // many), nth % many
            which, state = scenario[i], status[i]
            here = pieces.first_piece(steers, paths, i, state, elapsed, shore)
            watched, now = here != NONE, ear.begin
            if ti.static(kind == HEARD and not steers):
                watched = state <= life.PENDING
                if state < life.PENDING:  # before its release it was under way, not adrift
                    now = ti.min(ti.max(now, ti.cast(paths.release[i] - elapsed, ti.f32)), ear.end)
            if watched:
                silence, total, quiet = jumps.at_first(), 0.0, 0.0
                if ti.static(kind == HEARD):
                    silence = listen.taken(f * size + i, size * many, edges, held)
                while here != NONE:
                    way = pieces.load_piece(
                        steers, paths, i, here, state, status_since[i], elapsed, duration, shore
                    )
                    part, later, source = pieces.whole_piece(way), pieces.no_later(), 0.0
                    if way.begin >= ear.end or way.end <= ear.begin:
                        part.depth = -1
                    if ti.static(kind == HEARD):
                        stray = glimpse.FAR * way.k * ti.sqrt(ti.max(way.end - way.begin, 0.0))
                        if (
                            listen.out_of_reach(
                                ear, way.lon, way.lat, way.to_lon, way.to_lat, stray
                            )
                            == 1
                        ):
                            part.depth = -1
                        source = offsets[f] + listen.level(
                            levels, paces, which, _speed(steers, paths, here, way, paces)
                        )
                    while part.depth >= 0:
                        low, high, halve = (
                            ti.max(ear.begin, part.begin),
                            ti.min(ear.end, part.end),
                            0,
                        )
                        if low < high:
                            dx, dy = (
                                ti.cast(part.to_lon - part.lon, ti.f32),
                                ti.cast(part.to_lat - part.lat, ti.f32),
                            )
                            pace = 1.0 / ti.max(part.end - part.begin, 1e-6)
                            a, b = f32x2(0.0), f32x2(0.0)
                            for side in range(2):
                                when = low if side == 0 else high
                                share = ti.min((when - part.begin) * pace, 1.0)
                                x = part.lon + ti.cast(ti.round(share * dx), ti.i32)
                                y = part.lat + ti.cast(ti.round(share * dy), ti.i32)
                                found = glimpse.where(kind, ear, when, x, y)
                                if side == 0:
                                    a = found
                                else:
                                    b = found
                            b = glimpse.onward(kind, ear, a, b)
                            if ti.static(steers):
                                stray = way.k * ti.sqrt(part.end - part.begin)
                                halve = _halves(kind, ear, limits, a, b, stray, part.depth, source)
                            if halve == 1:
                                pass
                            elif ti.static(kind == HEARD):
                                quiet += low - now
                                listen.hear(
                                    silence,
                                    quiet,
                                    ear,
                                    losses,
                                    around,
                                    limits,
                                    a,
                                    b,
                                    high - low,
                                    source,
                                )
                                now = high
                            else:
                                total += glimpse.hazard(kind, ear, losses, a, b, high - low)
                        if ti.static(steers):
                            if halve == 1:
                                count = paths.piece_count[here]
                                pieces.halve_part(
                                    part, later, way, seed0, seed1, i + shift[which], step, count
                                )
                            else:
                                pieces.next_part(part, later, way)
                        else:
                            part.depth = -1
                    here = pieces.next_piece(steers, paths, here, state, shore)
                if ti.static(kind == HEARD):
                    if (
                        ti.static(not steers) or state >= life.PENDING
                    ):  # otherwise it went adrift; the drifting kernel continues from there
                        quiet += ear.end - now
                    jumps.settle(silence, ear.rate, quiet)
                    listen.put(silence, f * size + i, size * many, log_missed, edges, held)
                else:
                    log_missed[i] -= total

    return _watch


@ti.func
def _speed(
    steers: ti.template(),
    paths: ti.template(),
    here: ti.i32,
    way: pieces.Piece,
    paces: ti.template(),
) -> ti.f32:
    """Return the speed [m/s] on a piece, on a bridge that of its leg; 0 if no level needs it."""
    speed = 0.0
    if paces.shape[0] > 1:
        if way.k <= 0.0:
            far = sphere.offset_near(way.lon, way.lat, way.to_lon, way.to_lat)
            speed = far.norm() / ti.max(way.end - way.begin, 1.0)
        if ti.static(steers):
            if way.k > 0.0:
                speed = pieces.leg_velocity(paths, here).norm()
    return speed


@ti.func
def _halves(
    kind: ti.template(),
    ear: Ear,
    limits: ti.template(),
    a: f32x2,
    b: f32x2,
    stray: ti.f32,
    depth: ti.i32,
    source: ti.f32,
) -> ti.i32:
    """Return 1 if a part of a bridge from a to b with this spread [m] must be halved."""
    halve = 0
    fine = 0.5 * ear.between
    if ti.static(kind == HEARD):
        fine = ti.max(ear.between, listen.FINE)
    if depth < DEPTH and stray > fine:
        halve = glimpse.near(kind, ear, a, b, stray)
        if ti.static(kind == HEARD):
            if halve == 1:
                d = b - a
                share = ti.min(ti.max(-a.dot(d) / ti.max(d.dot(d), 1e-12), 0.0), 1.0)
                far = ti.max((a + share * d).norm() - glimpse.FAR * stray, 0.0)
                halve = listen.audible(ear, limits, far, source)
    return halve


_drifting, _steering = _watching(Straights, False), _watching(Pieces, True)


def _launch(ensemble: Any, paths: Paths, kind: int, *sensor: Any) -> None:
    e, kernel = ensemble, _steering if paths.steers else _drifting
    kernel(
        kind,
        *paths.own.launched,
        e.scenario,
        e.status,
        e.status_since,
        paths.pack,
        paths.elapsed,
        paths.duration,
        paths.step,
        *noise.key(e.seed),
        *sensor,
    )


def listen_along(ensemble: Any, paths: Paths, sonar: Laid, kept: tuple[Any, Any, Any]) -> None:
    """Update the miss probability of particles for one sonar, along their paths in the last step.

    Args:
        ensemble: a drift.engine.particles.ensemble.Ensemble, after the step.
        paths: paths of some of its particles. Stranded and grounded ones are inaudible.
        sonar: on a stretch of its track; its times count from the begin of the paths.
        kept: its columns on the device, see kernels.evidence.listen.columns; updated.
    """
    _launch(ensemble, paths, HEARD, sonar.ear, *runtime.residents(*sonar.tables), *kept, 0)


def look_along(
    ensemble: Any, paths: Paths, stretch: Stretch, pods: Pods, shore: bool, log_missed: Any
) -> None:
    """Add the log miss probability of a sensor with a table of POD, along paths in the last step.

    Args:
        ensemble: a drift.engine.particles.ensemble.Ensemble, after the step.
        paths: paths of some of its particles.
        stretch: of the sensor's track; its times count from the begin of the paths.
        pods: its table.
        shore: whether stranded and grounded particles are visible.
        log_missed: on the device, float32 (n,); updated.
    """
    table = np.ascontiguousarray(pods.table, np.float32).reshape(-1)
    columns = (log_missed,) * 3  # the kernel writes only the first one
    table, nothing = runtime.residents(table, NOTHING)
    _launch(
        ensemble,
        paths,
        pods.kind,
        glimpse.ear(stretch, pods),
        table,
        *(nothing,) * 5,
        *columns,
        int(shore),
    )
