"""One lattice step of all particles: drift in current, wind and waves, errors, diffusion, coast.

A step from position (lon, lat) integrates dlon/dt = u / (R cos lat), dlat/dt = v / R by an explicit Runge-Kutta scheme;
adds a random walk; and ends at its first crossing of the shore, or goes on along it. Positions are integers; within the
step everything is float32 on differences from the position at its begin. Writing of the increment is one rounding of at
most 5 mm.

One launch does it all, so that the columns are read once. The parts are point functions, which another model of motion
shares: kernels.life says when in the step a particle moves and writes how the step ends for it, errors what chance does
to it, integrate leads it along any field of velocity, shore says what the coast does to it; velocity.drift is this
model's own.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import taichi as ti

from kernels import batch, errors, integrate, launch, life, noise, shore, sphere
from kernels.batch import Batch
from kernels.coast import Coast, DeviceCoast, Ints, Reals, open_sea
from kernels.features import (
    BIAS,
    COAST,
    DEBRIS,
    DIFFUSION,
    DIVERGENCE,
    ERRORS,
    FORCING,
    JIBE,
    MEMBERS,
    REFLOAT,
    RK4,
    SINK,
    SLIDE,
    WIND,
)  # fmt: skip
from kernels.life import ASHORE, SUNK
from kernels.noise import Purpose
from kernels.sample import Ranges, Sea, Tiles, members_of
from kernels.velocity import Drifter, drift

# Longest step accepted [binary angle units], 42 degrees; a longer one, next to a pole, counts as invalid.
FARTHEST = 5.0e8

f32x2 = ti.types.vector(2, ti.f32)
f32x4 = ti.types.vector(4, ti.f32)

# The columns of an ensemble, of shape (n,) each: those that every model of motion has, and those of this one.
CORE = {
    **dict.fromkeys(("lon", "lat", "status", "release", "status_since", "edge", "sink_time", "moving_since"), Ints),
    "scenario": Ints,
    "log_weight": Reals,
}
OWN = {
    "side": Ints,
    **dict.fromkeys(
        (
            *("down_slope", "down_offset", "right_slope", "right_offset", "left_slope", "left_offset"),
            *("current_error_east", "current_error_north", "wind_error_east", "wind_error_north"),
            *("current_bias_east", "current_bias_north"),
        ),
        Reals,
    ),
}


class Physics(NamedTuple):
    """How the objects of one scenario move, besides the forcing; each term is off at zero."""

    current_std: float = 0.0  # [m/s] of the current's error, a component
    current_time: float = 1.0  # [s] its decorrelation time
    wind_std: float = 0.0
    wind_time: float = 1.0
    diffusivity: float = 0.0  # [m2/s]
    jibe_rate: float = 0.0  # [1/s]


# The arguments of the kernel in groups: arrays in packs, numbers in structures.
CoreColumns = ti.types.argpack(**CORE)
OwnColumns = ti.types.argpack(**OWN, member_of=Ints)
PhysicsTerms = ti.types.struct(**dict.fromkeys(Physics._fields, ti.f32))
Terms = ti.types.struct(
    direction=ti.f32,  # +1 forward in time, -1 backward
    seed0=ti.u32,
    seed1=ti.u32,
    coast0=ti.u32,  # of what happens at the coast: debris has a key of its own there
    coast1=ti.u32,
    stay=ti.f32,  # see Beach
    offing=ti.f32,
    debris=ti.i32,  # see Surroundings
    west=ti.i32,  # see Domain
    south=ti.i32,
    width=ti.u32,
    height=ti.u32,
)


@ti.func
def _line(features: ti.template(), own: ti.template(), i: ti.i32) -> f32x4:
    """Return the leeway line of particle i on the side to which it drifts, see kernels.velocity."""
    line = f32x4(0.0)
    if ti.static(features & WIND):
        line = f32x4(own.down_slope[i], own.down_offset[i], own.right_slope[i], own.right_offset[i])
        if own.side[i] < 0:
            line[2], line[3] = own.left_slope[i], own.left_offset[i]
    return line


@ti.func
def _physics(table: ti.template(), s: ti.i32) -> PhysicsTerms:
    """Return the physics of scenario s."""
    at = s * ti.static(len(Physics._fields))
    return PhysicsTerms(
        current_std=table[at],
        current_time=table[at + 1],
        wind_std=table[at + 2],
        wind_time=table[at + 3],
        diffusivity=table[at + 4],
        jibe_rate=table[at + 5],
    )


@ti.kernel
def _advance(
    features: ti.template(),
    velocity: ti.template(),
    listed: ti.template(),
    first: ti.i32,
    last: ti.i32,
    slots: Ints,
    shift: Ints,
    table: Reals,
    core: CoreColumns,
    own: OwnColumns,
    sea: Sea,
    coast: Coast,
    terms: Terms,
    elapsed: ti.i32,
    duration: ti.i32,
    step: ti.i32,
):
    for k in range(first, last):
        i = batch.slot(listed, slots, k)
        story = core.scenario[i]
        slot = i + shift[story]  # its number in the whole run, which is the key of its noise
        physics = _physics(table, story)
        state, due, sinking = core.status[i], life.NEVER, life.NEVER
        if ti.static(features & REFLOAT):
            if state == ASHORE:
                w = noise.words(terms.coast0, terms.coast1, noise.STREAM_REFLOAT, slot, core.status_since[i])
                due = life.refloats(core.status_since[i], noise.uniform(w[0]), terms.stay)
        if ti.static(features & SINK):
            sinking = core.sink_time[i]
        moves, left, finish = life.ahead(state, core.release[i], due, sinking, elapsed, duration)
        if ti.static(features & SINK):
            if moves and finish == left:
                core.status[i], core.status_since[i], moves = SUNK, finish, False
        if moves:
            dt = ti.cast(finish - left, ti.f32)
            begin, share = ti.cast(left - elapsed, ti.f32) / duration, dt / duration
            error, walk = errors.draw(features, own, physics, terms, i, slot, step, dt)
            among = 0  # which member of an ensemble of forcings it drifts in
            if ti.static(features & MEMBERS):
                among = own.member_of[i]
            drifter = Drifter(line=_line(features, own, i), error=error, member=among)
            x, y = core.lon[i], core.lat[i]
            c0, s0 = sphere.cos_lat(y), sphere.sin_lat(y)
            off = f32x2(0.0)
            if ti.static(features & REFLOAT):
                if state == ASHORE:
                    x, y, east, north = shore.leave(x, y, c0, terms.offing, core.edge[i], coast)
                    off = terms.direction * f32x2(east, north)
            r = integrate.integrate(
                velocity, ti.static(integrate.CLASSICAL if features & RK4 else integrate.MIDPOINT),
                ti.static(bool(features & REFLOAT)), features, sea, drifter, x, y, c0, s0, terms.direction * dt,
                begin, share, off,
            )  # fmt: skip
            if r[3] > 0.5:  # where the drift leads onto the beach, the particle waits for one that leads off it
                dlon, dlat = r[0], r[1]
                if ti.static(features & REFLOAT):
                    core.moving_since[i] = left
                if ti.static(features & DIVERGENCE):
                    x_half, y_half = x + ti.cast(0.5 * dlon, ti.i32), y + ti.cast(0.5 * dlat, ti.i32)
                    middle = begin + 0.5 * share
                    core.log_weight[i] -= dt * integrate.divergence(
                        velocity, features, sea, drifter, x_half, y_half, middle
                    )
                if ti.static(features & DIFFUSION):
                    way = errors.walked(walk, c0, s0)
                    dlon, dlat = dlon + way[0], dlat + way[1]
                move_lon, move_lat, known = 0, 0, False
                if ti.max(ti.abs(dlon), ti.abs(dlat)) < FARTHEST:
                    move_lon, move_lat = ti.cast(ti.round(dlon), ti.i32), ti.cast(ti.round(dlat), ti.i32)
                    known = r[2] > 0.5
                x_end, y_end = x + move_lon, y + move_lat
                met, number, part = 0, -1, ti.cast(1.0, ti.f32)
                if ti.static(features & COAST):
                    # The shore is asked first: a stage may lie inland, behind it, and find no forcing only for that.
                    met, x_end, y_end, part, number = shore.meet(
                        ti.static(bool(features & DIFFUSION)), ti.static(bool(features & SLIDE)),
                        x, y, move_lon, move_lat, c0,
                        2.0 * physics.diffusivity * dt, terms.coast0, terms.coast1, slot, step, coast,
                    )  # fmt: skip
                    if ti.static(features & SLIDE):
                        if x_end != x + move_lon or y_end != y + move_lat:
                            known = True  # it slid along the shore: a stage that found no forcing lay inland
                life.ending(core, terms, i, met, number, part, known, x_end, y_end, left, finish, elapsed + duration)


class Beach(NamedTuple):
    """What happens to a particle that reaches the coast: it stays for good, for a while, or slides along."""

    stay: float = 0.0  # [s] mean wait before it is afloat again; 0: it stays for good
    offing: float = 0.0  # [m] distance off the beach at which it is afloat again
    slides: bool = False


class Step(NamedTuple):
    """One step of the lattice clock."""

    number: int  # number of the lattice step: the key of its noise
    elapsed: int  # [s] from the run's start to the begin of the step
    duration: int  # [s] > 0
    direction: int  # +1 forward in time, -1 backward


Move = Callable[[Step], None]


class Domain(NamedTuple):
    """The box outside which a particle has left the case [binary angle]."""

    west: int
    south: int
    width: int
    height: int


class Surroundings(NamedTuple):
    """What is the same for all scenarios of a run: the domain, the coast, what a step computes."""

    domain: Domain
    coast: DeviceCoast | None = None
    beach: Beach = Beach()
    bias: bool = False  # whether particles have an error of the current that lasts
    sinks: bool = False
    divergence: bool = False  # log weights lose the divergence along the track: a backward run's likelihood
    # Number of a class of debris, 0: none. It shares the errors of the forcing with the object, slot by slot, but has a
    # random walk and jibes of its own.
    debris: int = 0
    scheme: str = "rk4"


def features(ranges: Ranges, physics: Sequence[Physics], place: Surroundings) -> int:
    """Return the compile-time features that some scenarios need together.

    A scenario that has no use of one moves by the same bits with it: each term is off at zero.
    """
    forcing = sum(FORCING[quantity] for quantity, (first, last) in ranges.items() if last > first)
    wind = bool(forcing & WIND)
    coastal = place.coast is not None
    return (
        forcing
        | ERRORS * any(own.current_std > 0 or (wind and own.wind_std > 0) for own in physics)
        | DIFFUSION * any(own.diffusivity > 0 for own in physics)
        | JIBE * (wind and any(own.jibe_rate > 0 for own in physics))
        | COAST * coastal
        | RK4 * (place.scheme == "rk4")
        | BIAS * place.bias
        | SINK * place.sinks
        | REFLOAT * (coastal and place.beach.stay > 0)
        | SLIDE * (coastal and place.beach.slides)
        | DIVERGENCE * place.divergence
        | DEBRIS * (place.debris > 0)
    )


def advance(
    ensemble: Any,
    slots: tuple[int, int, int],
    tiles: Tiles,
    ranges: Ranges,
    physics: Physics,
    step: Step,
    place: Surroundings,
    velocity: Any = drift,
) -> None:
    """Move slots of an ensemble of one scenario over one lattice step, in place: see `mover`.

    slots: the first, the one after the last, and the number of the first in the whole run, which is the key of its
    noise.
    """
    first, last, number = slots
    own = batch.of((first, last), (number,), (0,))
    mover(ensemble, own, tiles, ranges, (physics,), place, step.direction, velocity)(step)


def mover(
    ensemble: Any,
    own: Batch,
    tiles: Tiles,
    ranges: Ranges,
    physics: Sequence[Physics],
    place: Surroundings,
    direction: int,
    velocity: Any = drift,
) -> Move:
    """Return a function that moves slots of an ensemble over one lattice step, in place, by one launch.

    ensemble: a drift.particles.ensemble.Ensemble. own: its slots that are moved; the number of each in the whole run is
    the key of its noise. ranges: first and last tile by quantity. physics: of each scenario of the batch. direction: of
    all its steps. velocity: a function as kernels.integrate takes it, so that the order of the scheme can be measured
    on an analytic flow. A particle moves only while adrift, from its release on; it ends ashore, sunk, outside the
    forcing or the domain.
    """
    seed0, seed1 = noise.key(ensemble.seed)
    coastal = Purpose.DEBRIS_COAST if place.debris else Purpose.RUN
    coast0, coast1 = noise.key(ensemble.seed, coastal, place.debris)
    args = (
        features(ranges, physics, place) | MEMBERS * (tiles.members > 1),
        velocity,
        own.listed,
        own.first,
        own.last,
        own.slots,
        own.shift,
        own.table(physics),
        launch.pack(CoreColumns, *(getattr(ensemble, name) for name in CORE)),
        launch.pack(OwnColumns, *(ensemble.own[name] for name in OWN), members_of(ensemble.own, tiles)),
        tiles.sea(ranges),
        (place.coast or open_sea()).pack,
        {
            "direction": direction,
            "seed0": seed0,
            "seed1": seed1,
            "coast0": coast0,
            "coast1": coast1,
            "stay": place.beach.stay,
            "offing": place.beach.offing,
            "debris": place.debris,
            **place.domain._asdict(),
        },
        *(0, 1, 0),
    )
    move = launch.bind(_advance, args, ("elapsed", "duration", "step"))
    return lambda step: move(step.elapsed, step.duration, step.number)
