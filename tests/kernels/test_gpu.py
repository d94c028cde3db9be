"""A GPU's forecast against the CPU's: the integer noise is the same, positions differ by the last bits of libm."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import taichi as ti
import xarray as xr

from geo import sphere

NO_SEARCH = ("--set", "sortie=[]", "--set", "unit=[]", "--set", "plan={}")


@pytest.mark.gpu
@pytest.mark.skipif(not ti._lib.core.with_cuda(), reason="no CUDA device on this machine")
def test_cuda_agrees_with_the_cpu(tmp_path: Path) -> None:
    """Same seed, same case: tracks within 50 m after 18 h of drift, for all but the few that strand elsewhere."""
    for backend in ("cpu", "cuda"):
        command = [sys.executable, "-m", "drift", "run", "overdue_boat", "--backend", backend]
        command += [
            "--set",
            "particles=8_000",
            "--set",
            "duration='18 h'",
            *NO_SEARCH,
            "--out",
            str(tmp_path / backend),
        ]
        subprocess.run(command, check=True, capture_output=True)
    with xr.open_dataset(tmp_path / "cpu/particles.nc") as cpu, xr.open_dataset(tmp_path / "cuda/particles.nc") as cuda:
        places = [np.radians(one[name].values) for one in (cpu, cuda) for name in ("lon", "lat")]
    apart = sphere.distance(*places)
    assert np.quantile(apart[np.isfinite(apart)], 0.99) < 50
