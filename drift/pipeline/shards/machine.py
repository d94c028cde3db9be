"""Fingerprint of the processor's arithmetic, on which the last bits of results depend."""

import hashlib
import platform

import numpy as np

from kernels.step import probe

FUNCTIONS = (
    np.exp,
    np.log,
    np.sin,
    np.cos,
    np.tan,
    np.sqrt,
    np.cbrt,
    np.expm1,
    np.log1p,
    np.arctan,
)


def arithmetic() -> str:
    """Return a digest of function values, whose last bits differ between kinds of machines."""
    x = np.linspace(0.001, 50.0, 4001)
    values = [function(x) for function in FUNCTIONS]
    values += [
        np.arctan2(np.sin(x), np.cos(x)),
        np.hypot(x, 1 / x),
        x**0.37,
        probe.values(x.astype(np.float32)),
    ]
    total = hashlib.sha256(b"".join(np.ascontiguousarray(value).tobytes() for value in values))
    return f"{platform.machine()} {total.hexdigest()[:16]}"
