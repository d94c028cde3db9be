"""Every Taichi kernel: a step of the particles (drift, errors, shore, life), detection, planning,
deposits.

In the order in which data passes them:

dtypes   types of scalars runtime  start a backend; host arrays <-> device arrays devices, drivers
graphics cards: which one is taken, and what their drivers list taichi_way  Taichi by its insides
(taichi_inside), or by its public interface alone (taichi_public) taichi_fork  a fork of Taichi in
its place, where DRIFT_TAICHI names one rows     columns in the rows of one array: a card binds few
arrays to a kernel tables   tables of two dimensions: the numbers of one thing side by side launch
arguments in groups; a kernel with its arguments set once batch    the slots that one launch works
on bundle   particles that a kernel moves side by side noise    counter-based random numbers:
f(seed, stream, slot, step) angles, doubles  sine, arc tangent and the like in float32 and float64,
the same on every backend sphere   the exponential map on binary angles prior    draw initial
positions in water sample   current, wind and Stokes drift at a point, from regular tiles coast
is it wet; where does a step first meet the shore features what a step may hold, as bits life
during which part of a step a particle moves guide    noise that leads particles toward what was
found errors   Ornstein-Uhlenbeck errors, random walk, jibes velocity current, Stokes drift and
leeway of a drifting object integrate  Runge-Kutta along a velocity, and its divergence shore
what the shore does to a step: landing, sliding, refloating advance  one step of all particles,
composed of these bridge   where particles are inside a step itinerary, ways, steer  targets that
steer: their way points, the ways between these, one step of all of them felt     how fast the
current sets targets off that do not make it good pieces   the pieces of particles' paths in a step,
of what drifts and of what steers, for every sensor that asks settled  what is settled at the birth
of a target that steers, and stands in no column sweep    what a sensor's track does to each
particle: exposure, and the weights that it leaves listen, glimpse  what a passive sonar hears, and
a table of POD sees, on a straight stretch watch    what such a sensor makes of each particle's path
touch    whether a Brownian bridge touches a line, stays in a box or a disc observe  what a line or
a field tells of a piece of way, straight or a bridge probe    values by which one processor's
arithmetic is told from another's allocate what effort that is spread over cells finds rectangles
what rectangles searched by parallel sweeps find sweeps   what legs that are flown find clouds
clouds of particles that follow targets which are rarely seen: they act, are cut by sweeps and
filled again beams    what each beam of a sonar would hear of particles whose tracks are kept

Arrays and numbers in, arrays out. Modules here do without `from __future__ import annotations`: it
breaks Taichi.
"""

import inspect
import os

# Taichi prints a banner and asks a server for its newest version when imported; a rescue tool does
# neither.
os.environ.setdefault("ENABLE_TAICHI_HEADER_PRINT", "False")
os.environ.setdefault("TI_SKIP_VERSION_CHECK", "ON")
# Where standard output is not a terminal's own, as in a notebook, it says so and takes in what
# kernels print: none does.
os.environ.setdefault("TI_ENABLE_PYBUF", "0")
# Taichi asks at each of its decorators which source line imports the module, of a frame of Python's
# importer, which has no source: all modules are looked through in vain, half a second in all,
# unless it is known where that frame belongs.
inspect.modulesbyfile.setdefault("<frozen importlib._bootstrap>", "importlib._bootstrap")

if os.environ.get("DRIFT_TAICHI"):
    from kernels.runtime import taichi_fork

    taichi_fork.register(os.environ["DRIFT_TAICHI"])
