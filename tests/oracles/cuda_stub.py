"""A stub of CUDA's driver, made from tests/backends/cuda_stub.c, and the environment to use it."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

from places import HELPERS, ROOT

SOURCE = ROOT / "tests" / "backends" / "cuda_stub.c"


def why_not() -> str:
    """Return why the stub cannot be compiled here, or nothing."""
    if sys.platform != "linux":
        return "the stub of CUDA's driver is for Linux: Taichi loads libcuda.so there"
    return "" if _compiler() else "no C compiler (cc or gcc) to make the stub of CUDA's driver"


def compiled(folder: Path) -> Path:
    """Compile the stub in a folder, and return the folder, as LD_LIBRARY_PATH needs it."""
    command = [_compiler(), "-shared", "-fPIC", "-O1", "-Wall", "-Werror"]
    subprocess.run([*command, "-o", folder / "libcuda.so", SOURCE], check=True)
    return folder


def environment(driver: Path, out: Path, capability: int = 90) -> dict[str, str]:
    """Return the environment of a program that runs on the stub, and whose results go to `out`."""
    return os.environ | {
        "LD_LIBRARY_PATH": str(driver),
        "CUDA_STUB_OUT": str(out),
        "CUDA_STUB_CC": str(capability),
        "PYTHONPATH": os.pathsep.join(map(str, [ROOT, *HELPERS])),
    }


def _compiler() -> str | None:
    return shutil.which("cc") or shutil.which("gcc")
