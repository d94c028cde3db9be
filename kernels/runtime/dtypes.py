"""Scalar types and their names in NumPy, Taichi and ctypes."""

import numpy as np
import taichi as ti

DTYPES = {
    np.dtype(np.float32): ti.f32,
    np.dtype(np.int32): ti.i32,
    np.dtype(np.uint8): ti.u8,
    np.dtype(np.int64): ti.i64,
    np.dtype(np.float64): ti.f64,
}
NUMPY = {kind: dtype for dtype, kind in DTYPES.items()}
KINDS = {kind: np.ctypeslib.as_ctypes_type(dtype) for kind, dtype in NUMPY.items()}
