"""Start Taichi once, on the backend asked for; move arrays between host and device.

`ti.init` wipes every array of the process, so a process keeps the backend that it started with.
"""

import contextlib
import io
import weakref

import numpy as np
import taichi as ti
from taichi.lang import impl

from geo.errors import UserError

BACKENDS = {"cpu": ti.cpu, "cuda": ti.cuda, "vulkan": ti.vulkan, "metal": ti.metal}

_started: dict[str, object] = {}


def start(backend: str = "cpu", threads: int | None = None) -> None:
    """Start Taichi on a backend with a number of CPU threads (default: all); once started, keep it.

    Raises UserError when the backend is unknown or this machine lacks it, or when another one runs already.
    """
    if backend not in BACKENDS:
        raise UserError(f"--backend: unknown backend {backend!r}; allowed: {', '.join(BACKENDS)}")
    if _started:
        if backend != _started["backend"] or threads not in (None, _started["threads"]):
            raise UserError(
                f"--backend/--threads: this process already runs {_started['backend']} with "
                f"{_started['threads'] or 'all'} threads; start a new process for {backend} with {threads or 'all'}"
            )
        return
    options = {"cpu_max_num_threads": threads} if threads else {}
    try:
        with contextlib.redirect_stdout(io.StringIO()):
            # fast_math reorders sums, so that results would hang on the compiler; it saves 3 to 10 %.
            ti.init(
                arch=BACKENDS[backend],
                enable_fallback=False,
                default_fp=ti.f32,
                default_ip=ti.i32,
                fast_math=False,
                log_level=ti.ERROR,
                offline_cache=True,
                **options,
            )
    except Exception as error:
        raise UserError(
            f"--backend: {backend!r} is not available on this machine ({str(error).splitlines()[0]}); use --backend cpu"
        ) from error
    _started.update(backend=backend, threads=threads)


def backend() -> str:
    """Return the name of the running backend, or "none"."""
    return str(_started.get("backend", "none"))


def empty(n: int, dtype=ti.f32) -> ti.Ndarray:
    """Return a zeroed device array of n scalars."""
    return ti.ndarray(dtype, shape=(max(n, 1),))


def empty_nodes(n: int) -> ti.Ndarray:
    """Return a zeroed device array of n vectors of four float32: one aligned fetch a node is worth 10 % of a step.

    Taichi 1.7.4 frees scalar ndarrays but forgets vector ones (ScalarNdarray has __del__, VectorNdarray has none).
    """
    nodes = ti.Vector.ndarray(4, ti.f32, shape=(max(n, 1),))
    weakref.finalize(nodes, impl.get_runtime().prog.delete_ndarray, nodes.arr).atexit = False
    return nodes


_DTYPES = {
    np.dtype(np.float32): ti.f32,
    np.dtype(np.int32): ti.i32,
    np.dtype(np.uint8): ti.u8,
    np.dtype(np.int64): ti.i64,
    np.dtype(np.float64): ti.f64,
}


def upload(values: np.ndarray) -> ti.Ndarray:
    """Return a device copy of a host array, flattened."""
    flat = np.ascontiguousarray(values).reshape(-1)
    device = empty(flat.size, _DTYPES[flat.dtype])
    if flat.size:
        device.from_numpy(flat)
    return device


def copy(values: ti.Ndarray) -> ti.Ndarray:
    """Return a copy of a device array of scalars."""
    fresh = empty(values.shape[0], values.dtype)
    fresh.copy_from(values)
    return fresh


def wait() -> None:
    """Wait until the device has done all that was launched: for timing."""
    ti.sync()
