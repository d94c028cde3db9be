"""Properties of steering targets that are fixed at birth and stored in no column.

They are functions of the birth slot, which copies made by resampling inherit, so that they can be
computed at any time.
"""

import taichi as ti

from kernels.maths import noise
from kernels.runtime import batch, launch, rows
from kernels.runtime.batch import Batch
from kernels.steering import itinerary, steer
from kernels.steering.itinerary import PHASE, POINT_LAW, Chance, Plan
from kernels.steering.steer import Own
from kernels.step.coast import Ints, Reals

SPEED, FIRST_COURSE, DESTINATION, SPREAD_RATE, ARRIVAL = range(5)  # numbers in a row of `wanted`
WANTED = 5
# columns of `Settled`, in the order of these numbers
FIELDS = ("speed", "course", "destination", "k", "arrival")

Settled = ti.types.argpack(
    speed=Reals,  # [m/s]
    course=Reals,  # [rad] clockwise from north; may be beyond a turn
    destination=Ints,  # number among the phase's destinations
    k=Reals,  # [m/sqrt(s)]
    # [s] end of its itinerary, unless its distress comes first; NEVER: unknown
    arrival=Ints,
)


@ti.func
def _own_arrival(plan: ti.template(), key: Chance, phase: ti.i32, departure: ti.i32) -> ti.i32:
    """Return when [s] a target reaches the last way point of a phase without way point times."""
    speed, time = itinerary.own_speed(plan, key, phase), departure
    row = phase * PHASE
    for k in range(1, plan.numbers[row + 2]):
        length = plan.laws[plan.point_laws_at + (plan.numbers[row + 1] + k) * POINT_LAW + 3]
        time += ti.max(ti.cast(ti.round(length / speed), ti.i32), 1)
    return time


@ti.kernel
def _settle(
    listed: ti.template(),
    first: ti.i32,
    last: ti.i32,
    slots: Ints,
    scenario: Ints,
    steer_whole: Ints,
    wanted: Ints,
    plan: Plan,
    out: Settled,
    seed0: ti.u32,
    seed1: ti.u32,
):
    for j in range(first, last):
        i = batch.slot(listed, slots, j)
        n = scenario.shape[0]  # a row's length
        birth = steer_whole[Own.BIRTH * n + i]
        key = Chance(seed0, seed1, birth, birth, 0, 0)
        row = scenario[i] * WANTED
        phase = wanted[row + SPEED]
        if phase >= 0:
            out.speed[i] = itinerary.own_speed(plan, key, phase)
            if itinerary.on_course(plan, phase):
                _course, fast, _word = itinerary.course_of(plan, itinerary.first(key, phase), phase)
                out.speed[i] = fast
        phase = wanted[row + FIRST_COURSE]
        if phase >= 0:
            toward, _fast, _word = itinerary.course_of(plan, itinerary.first(key, phase), phase)
            out.course[i] = toward
        phase = wanted[row + DESTINATION]
        if phase >= 0:
            out.destination[i] = itinerary.own_destination(plan, key, phase)
        phase = wanted[row + SPREAD_RATE]
        if phase >= 0:
            out.k[i] = itinerary.own_k(plan, key, phase)
        phase = wanted[row + ARRIVAL]
        if phase >= 0:
            out.arrival[i] = _own_arrival(plan, key, phase, steer_whole[Own.DEPARTURE * n + i])


def settle(columns, own: Batch, plan, seed: int, wanted, out) -> None:
    """Write the properties of steering targets that are fixed at birth.

    Args:
        columns: by name, `scenario` and those of kernels.steering.steer.WHOLE, int32 (n,).
        own: the slots of steering targets.
        plan: the itineraries.
        seed: of the run.
        wanted: int32 (scenarios * WANTED,), the phase of each property, a number in the `Plan`; -1:
            not written. The phase of an arrival is the only one of its itinerary, and its way
            points have no times.
        out: by name, the columns (n,) of `Settled`; written.
    """
    _settle(
        own.listed,
        own.first,
        own.last,
        own.slots,
        columns["scenario"],
        rows.whole(columns, steer.WHOLE),
        wanted,
        plan,
        launch.pack(Settled, *(out[name] for name in FIELDS)),
        *noise.key(seed),
    )
