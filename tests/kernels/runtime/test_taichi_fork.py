"""A fork of Taichi in place of it, in processes of its own: what moves, is searched for, steers and
follows agrees.

Skipped where the fork is not installed: `pip install quadrants`.
"""

import importlib.util
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from places import ROOT

FORK = "quadrants"
RUN = """
import sys
import numpy as np
import drift
from kernels.runtime import runtime, taichi_way
runtime.start(threads=2)
print(taichi_way.fork)
found = {}
for name, particles in (("overdue_boat", 600), ("smuggler_bridge", 300)):
    tracks = drift.run(drift.vary(drift.load(name), {"particles": particles})).particles
    found |= {f"{name} {column}": tracks[column].values for column in ("lon", "lat", "status", "weight")}
np.savez(sys.argv[1], **found)
"""
GROUPS = """
import kernels
import numpy as np
import taichi as ti
from kernels.runtime import launch, runtime
runtime.start(threads=2)
Reals = ti.types.ndarray(dtype=ti.f32, ndim=1)
Two = ti.types.argpack(one=Reals, two=Reals, sizes=ti.types.vector(3, ti.i64))

@ti.func
def scaled(pair: ti.template(), i: ti.i32) -> ti.f32:
    one = ti.static(pair.one)
    sizes = pair.sizes
    return one[i] * ti.cast(sizes[1], ti.f32) + pair.two[i]

@ti.kernel
def added(pair: Two, shift: ti.i32):
    for i in range(pair.one.shape[0]):
        pair.two[i] = scaled(pair, i) + shift

def column(value):
    return runtime.upload(np.full(3, value, np.float32))

for scale in (2, 5):
    one, two, both = column(1.0), column(10.0), column(3.0)
    added(launch.pack(Two, one, two, (9, scale, 9)), np.int64(100 * scale))
    added(launch.pack(Two, both, both, (9, scale, 9)), 0)
    print(two.to_numpy().tolist(), both.to_numpy().tolist())
"""
pytestmark = pytest.mark.skipif(
    importlib.util.find_spec(FORK) is None, reason=f"{FORK} is not installed"
)


def printed(code: str, folder: Path, *arguments: str, fork: str = FORK) -> list[str]:
    """Return what a process prints that uses a fork, or Taichi where that is ""."""
    file = folder / "program.py"  # a kernel's source is read from its file
    file.write_text(code, encoding="utf-8")
    own = os.environ | {"PYTHONPATH": str(ROOT), "DRIFT_TAICHI": fork}
    done = subprocess.run(
        [sys.executable, str(file), *arguments],
        env=own,
        capture_output=True,
        text=True,
        timeout=280,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


def test_groups_are_told_apart_from_launch_to_launch(tmp_path: Path) -> None:
    """Other arrays and numbers, without compiling again; and one array that stands twice in its
    group.
    """
    assert printed(GROUPS, tmp_path) == [
        "[212.0, 212.0, 212.0] [9.0, 9.0, 9.0]",
        "[515.0, 515.0, 515.0] [18.0, 18.0, 18.0]",
    ]


def test_a_fork_moves_and_weighs_as_taichi_does(tmp_path: Path) -> None:
    """Another release of LLVM rounds sums of products elsewhere: a few last bits of float32, 6e-8
    each.
    """
    assert printed(RUN, tmp_path, str(tmp_path / "fork.npz")) == ["True"]
    assert printed(RUN, tmp_path, str(tmp_path / "taichi.npz"), fork="") == ["False"]
    fork, taichi = np.load(tmp_path / "fork.npz"), np.load(tmp_path / "taichi.npz")
    for name in ("overdue_boat", "smuggler_bridge"):
        for column in ("lon", "lat"):
            # [deg], a metre
            assert np.abs(fork[f"{name} {column}"] - taichi[f"{name} {column}"]).max() < 1e-5
        assert (fork[f"{name} status"] == taichi[f"{name} status"]).all()
        assert np.allclose(fork[f"{name} weight"], taichi[f"{name} weight"], rtol=1e-5, atol=1e-9)
