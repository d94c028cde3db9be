"""All Taichi kernels: particle steps, evidence from sensors, planning, tracking.

| folder | contents |
|---|---|
| `runtime` | start of a backend; arrays on host and device; launches, batches, cards |
| `maths` | counter-based random numbers, trigonometry on every backend, the exponential map |
| `step` | start positions; forcing at a point; velocity, errors, integration, shore, states; sums |
| `drift_models` | drift models of the package, in the form of a user's own |
| `steering` | steering targets: itineraries, legs, set by the current, pieces of their paths |
| `evidence` | sorties, sonars, tables of POD, lines and areas: their effect on particles' weights |
| `planning` | expected results of effort, rectangles, legs, stations and beams |
| `tracking` | clouds of particles for rarely detected targets |

Kernels take arrays and numbers and write arrays. Modules with kernels must not use `from __future__
import annotations`, which breaks Taichi.
"""

import inspect
import os

# When imported, Taichi prints a banner and asks a server for its newest version; a rescue tool does
# neither.
os.environ.setdefault("ENABLE_TAICHI_HEADER_PRINT", "False")
os.environ.setdefault("TI_SKIP_VERSION_CHECK", "ON")
# Without a terminal, as in a notebook, Taichi prints a note and captures the output of kernels,
# which print nothing.
os.environ.setdefault("TI_ENABLE_PYBUF", "0")
# Each decorator of Taichi looks up the source line that imports the module, from a frame of
# Python's importer, which has no source. The search through all modules fails after half a second
# in total, unless that frame has a module.
inspect.modulesbyfile.setdefault("<frozen importlib._bootstrap>", "importlib._bootstrap")

if os.environ.get("DRIFT_TAICHI"):
    from kernels.runtime import taichi_fork

    taichi_fork.register(os.environ["DRIFT_TAICHI"])
