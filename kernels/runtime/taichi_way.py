"""Choice of the interface to Taichi: internals of the known release, or public functions."""

import os

import taichi as ti

KNOWN = (1, 7, 4)  # release whose internals kernels.runtime.taichi_inside uses
# environment variable: 1 selects the public interface for any release, for tests
PLAIN = "DRIFT_PLAIN_TAICHI"

fork = ti.__name__ != "taichi"  # see kernels.runtime.taichi_fork
inside = not fork and ti.__version__ == KNOWN and os.environ.get(PLAIN) != "1"
if inside:
    from kernels.runtime import taichi_inside as way
else:
    from kernels.runtime import taichi_public as way

__all__ = ["fork", "inside", "way"]
