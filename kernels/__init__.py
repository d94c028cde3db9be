"""Every Taichi kernel: a step of the particles, detection, planning, tracking.

| folder | what its kernels do |
|---|---|
| `runtime` | start a backend; arrays on the host and on the device; launches, batches, graphics cards |
| `maths` | random numbers by counter, sine and arc tangent on every backend, the exponential map |
| `step` | start positions; forcing at a point; velocity, errors, integration, shore, life; sums of outputs |
| `steering` | targets that steer: itineraries, legs, the current they feel, pieces of their paths |
| `evidence` | sorties, sonar, tables of POD, lines and fields: what each does to the weights of particles |
| `planning` | what effort, rectangles, legs, stations and beams would find |
| `tracking` | clouds of particles that follow targets which are rarely detected |

Kernels take arrays and numbers and write arrays. Modules here do without
`from __future__ import annotations`, which breaks Taichi.
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
