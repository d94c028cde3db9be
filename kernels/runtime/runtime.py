"""Start Taichi once, serialise its use by threads, and move arrays between host and device.

`ti.init` wipes every array of the process, so a process keeps the backend that it started with.
"""

import contextlib
import io
import logging
import math
import os
import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import taichi as ti

from geo import errors, waiting
from geo.errors import UserError
from kernels.runtime import devices, drivers, taichi_way
from kernels.runtime.devices import Choice, Device
from kernels.runtime.dtypes import DTYPES
from kernels.runtime.memory import CGROUPS
from kernels.runtime.taichi_way import way

# warnings go to standard error unless a program redirects them
LOG = logging.getLogger("drift")
LEAST_SPACE = "2 to 3 GiB"  # address space that a small run maps; it uses a tenth of it
# environment variable of Taichi: folder of compiled kernels
NAMED = "TI_OFFLINE_CACHE_FILE_PATH"
STALE = 300.0  # [s] age of a lock of the cache after which its process must have died
BACKENDS = {"cpu": ti.cpu, "cuda": ti.cuda, "vulkan": ti.vulkan, "metal": ti.metal}
# instead of a backend: a graphics card if there is one and it pays off, else the processor
AUTO = "auto"
# parts of backends' messages when memory is full
FULL = ("out of memory", "out_of_memory", "OUT_OF_DEVICE_MEMORY", "OUT_OF_HOST_MEMORY")

_started: dict[str, object] = {}
_use = threading.RLock()  # locked by the thread that uses Taichi


@contextlib.contextmanager
def alone() -> Iterator[None]:
    """Wait until no other thread uses Taichi, then reserve it for this thread; may be nested.

    Taichi's compiler keeps its current state in variables of the process: a second thread that
    launches at the same time gets errors from the middle of the compiler, or crashes the process.
    """
    with waiting.hold_lock(_use):
        yield


def cores() -> int:
    """Return the number of cores that this process may use.

    It is the smallest of the machine's, its affinity's and its container's quota.
    """
    try:
        count = len(os.sched_getaffinity(0))
    except (AttributeError, OSError):  # macOS and Windows know no affinity
        count = os.cpu_count() or 1
    quota = _quota()
    return count if quota is None else max(1, min(count, math.ceil(quota)))


def _quota() -> float | None:
    """Return the container's CPU quota in cores; None without a limit.

    It reads Linux control groups, version 2 or 1.
    """
    for names in (("cpu.max",), ("cpu/cpu.cfs_quota_us", "cpu/cpu.cfs_period_us")):
        try:
            granted, period = " ".join((CGROUPS / name).read_text() for name in names).split()
            if int(granted) > 0 and int(period) > 0:
                return int(granted) / int(period)
        except (OSError, ValueError):  # no such file, or it contains "max"
            continue
    return None


def start(backend: str = "cpu", threads: int | None = None, lanes: int | None = None) -> None:
    """Start Taichi on a backend with a number of CPU threads; once started, keep it.

    Args:
        backend: one of BACKENDS, or AUTO, which keeps a backend that is already running.
        threads: `cores()` by default and at most.
        lanes: for AUTO: how many particles, or clouds of a tracking case, are to be moved side by
            side.

    Raises:
        UserError: the backend is unknown, missing on this machine, or another one is running; or a
            graphics card is used from another thread than the one that started it.
    """
    if backend not in (*BACKENDS, AUTO):
        raise UserError(
            f"--backend: unknown backend {backend!r}; allowed: {', '.join((*BACKENDS, AUTO))}"
        )
    if threads is not None and threads < 1:
        raise UserError(f"--threads {threads} must be at least 1")
    with alone():
        count = min(threads or cores(), cores())
        if _started:
            taken = str(_started["backend"]) if backend == AUTO else backend
            _check_same(taken, None if threads is None else count)
            return
        if backend == AUTO:
            choice = _automatic(lanes, count)
        else:
            choice = Choice(None if backend == "cpu" else devices.usable(drivers.ask(backend)), "")
            if choice.device is not None and choice.device.kind == "software":
                words = f"--backend {backend}: {choice.device.name} is a software device: for tests"
                LOG.warning("drift: %s", errors.name_arguments(words))
            _init(backend, count, choice.device)
        taken = choice.device.backend if choice.device else "cpu"
        told = f"--backend {AUTO} takes {taken}: {choice.why}" if backend == AUTO else ""
        if told:
            LOG.log(
                logging.WARNING if choice.missed else logging.INFO,
                "drift: %s",
                errors.name_arguments(told),
            )
        _started.update(
            backend=taken, threads=count, thread=threading.get_ident(), device=choice.device
        )
        _started["told"] = "" if choice.missed else told


def _automatic(lanes: int | None, threads: int) -> Choice:
    """Start the choice of AUTO and return it; if its card fails to start, start the processor."""
    choice = devices.automatic(lanes, drivers.ask)
    if choice.device is not None:
        try:
            _init(choice.device.backend, threads, choice.device)
            return choice
        except UserError as error:
            why = _first_line(error.__cause__ or error)
            choice = Choice(None, f"{choice.device.identity} does not start ({why})", missed=True)
    _init("cpu", threads, None)
    return choice


def _init(backend: str, threads: int, device: Device | None) -> None:
    """Start Taichi; raise UserError if it fails to start."""
    if backend == "vulkan" and device is not None:
        # Taichi ranks devices differently, and crashes on "abc"
        os.environ[devices.PICKING] = str(device.number)
    try:
        with contextlib.redirect_stdout(io.StringIO()):
            # fast_math reorders sums, so that results would depend on the compiler; it would save 3
            # to 10 %.
            ti.init(
                arch=BACKENDS[backend],
                enable_fallback=False,
                default_fp=ti.f32,
                default_ip=ti.i32,
                fast_math=False,
                # The machine's compiler repeats whatever this pass optimises, and the pass takes
                # time in proportion to the square of the kernel's length.
                cfg_optimization=False,
                # for the same reason: it takes half of the time of compiling
                advanced_optimization=backend != "cpu",
                # A card's errors are raised, and would be printed as well: a run prints its own
                # line.
                log_level=ti.ERROR if backend == "cpu" else ti.CRITICAL,
                **_caching(),
                cpu_max_num_threads=threads,
            )
            way.begin(backend)
        if backend != "cpu" and hasattr(os, "register_at_fork"):
            os.register_at_fork(after_in_child=_forsake)
    except Exception as error:
        raise _not_started(backend, error) from error


def close() -> bool:
    """Write compiled kernels to the cache as the process ends.

    Returns:
        Whether the process may then end without a shutdown; a graphics card needs one.
    """
    return _started.get("backend") in (None, "cpu") and way.close()


def _forsake() -> None:
    """Stop a forked copy of this process from freeing arrays of the card.

    The card's driver serves no forked processes, such as one that plots.
    """
    ti.ScalarNdarray.__del__ = lambda self: None


def _caching() -> dict[str, object]:
    """Return Taichi's options for caching compiled kernels between runs.

    If the folder cannot be written, as in a read-only home, Taichi would crash with a segmentation
    fault at the end of the process, when it creates the folder. Kernels are then not cached, and
    Taichi gets a folder that exists: its own.
    """
    cache = Path(os.environ.get(NAMED) or way.cache())
    try:
        cache.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=cache):
            pass
        for file in cache.glob("*.tcb"):  # raises OSError if the file is another user's
            file.open("ab").close()
        _remove_stale_locks(cache)
    except OSError as error:
        LOG.warning(
            "drift: the cache %s cannot be written (%s), so every run compiles its kernels again; name another folder "
            "in the environment variable %s",
            cache,
            error.strerror,
            NAMED,
        )
        os.environ.pop(NAMED, None)  # Taichi would warn that it ignores the variable
        return {"offline_cache": False, "offline_cache_file_path": str(Path(ti.__file__).parent)}
    # Taichi uses this folder by default; a fork knows neither the folder nor the variable.
    known = not taichi_way.fork and (taichi_way.inside or os.environ.get(NAMED))
    return {"offline_cache": True} | ({} if known else {"offline_cache_file_path": str(cache)})


def _remove_stale_locks(cache: Path) -> None:
    """Remove locks of the cache that a killed process has left.

    Taichi locks the cache for moments, by a file that it removes. If that file stays, Taichi
    neither reads nor writes the cache any more, without a word.
    """
    for lock in cache.glob("*.lock"):
        with contextlib.suppress(FileNotFoundError):  # another process was quicker
            if time.time() - lock.stat().st_mtime > STALE:
                lock.unlink()


def _not_started(backend: str, error: Exception) -> UserError:
    """Return the error of a backend that fails to start.

    It suggests another backend only for a graphics card.
    """
    why = _first_line(error)
    if backend != "cpu" and any(words in why for words in FULL):
        return UserError(
            f"--backend {backend}: its card is full ({why}); end other programs on the card, or use --backend cpu"
        )
    if "emory" in why:
        return UserError(
            f"not enough memory to start the backend {backend!r} ({why}); it needs {LEAST_SPACE} of address space: "
            "raise the limit (ulimit -v), or give the process more memory"
        )
    remedy = (
        "reinstall taichi (pip install --force-reinstall taichi)"
        if backend == "cpu"
        else "use --backend cpu"
    )
    return UserError(f"--backend: {backend!r} is not available on this machine ({why}); {remedy}")


def _first_line(error: BaseException) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0]


def _check_same(backend: str, threads: int | None) -> None:
    """Reject a backend, number of threads or thread that does not fit the running backend.

    A graphics card serves only the thread that started it.
    """
    if backend != _started["backend"] or threads not in (None, _started["threads"]):
        raise UserError(
            f"--backend and --threads: this process already runs {_started['backend']} with {_started['threads']} threads; "
            f"start a new process for {backend} with {threads or 'all'}"
        )
    if backend != "cpu" and threading.get_ident() != _started["thread"]:
        raise UserError(
            f"--backend {backend}: a graphics card serves the thread that started it, and this is another one of the "
            "same program; run all cases from one thread, or with --backend cpu"
        )


def threads() -> int:
    """Return how many threads Taichi uses, or would use if it was started now."""
    return int(str(_started.get("threads", cores())))


def backend() -> str:
    """Return the name of the running backend, or "none"."""
    return str(_started.get("backend", "none"))


def about() -> dict[str, str]:
    """Return the running backend's name, and its device if that is a graphics card, for outputs.

    The driver is part of the device: it compiles the kernels.
    """
    device = _started.get("device")
    return {"backend": backend()} | (
        {"device": device.identity} if isinstance(device, Device) else {}
    )


def told() -> str:
    """Return a line on the choice of AUTO and its reason.

    It is "" if AUTO was not requested, or if a warning has reported the choice.
    """
    return str(_started.get("told", ""))


def room() -> int | None:
    """Return the free memory of the running device's own [bytes].

    None if it uses the processor's memory, or if it is unknown.
    """
    device = _started.get("device")
    if not isinstance(device, Device):
        return None
    listed = drivers.ask(device.backend).devices
    return next((one.room for one in listed if one.number == device.number), device.room)


@contextlib.contextmanager
def telling_full() -> Iterator[None]:
    """Turn a backend's error on a full card into a UserError that says what to do."""
    try:
        yield
    except RuntimeError as error:
        device, why = _started.get("device"), str(error)
        if not isinstance(device, Device) or not any(words in why for words in FULL):
            raise
        raise UserError(
            f"--backend {device.backend}: {device.name} is full; end other programs on it and give the same command again (a "
            "run in shards goes on from those that are finished), cut it into more --shards, or use --backend cpu"
        ) from error


def empty(n: int, dtype=ti.f32) -> ti.Ndarray:
    """Return a zeroed device array of n scalars."""
    return way.column(dtype, max(n, 1))


def empty_nodes(n: int) -> ti.Ndarray:
    """Return a zeroed device array of n vectors of four float32.

    One aligned fetch per node saves 10 % of the time of a step.
    """
    return way.nodes(max(n, 1))


def pairs(nodes: ti.Ndarray) -> np.ndarray | None:
    """Return a view of an array of `empty_nodes`, each node as two 64-bit pairs of float32, (n, 2).

    None if there is no view, as on any backend but the CPU.
    """
    return way.pairs(nodes)


def upload(values: np.ndarray) -> ti.Ndarray:
    """Return a device copy of a host array, flattened."""
    flat = np.ascontiguousarray(values).reshape(-1)
    device = empty(flat.size, DTYPES[flat.dtype])
    if flat.size:
        device.from_numpy(flat)
    return device


def resident(values: np.ndarray) -> np.ndarray | ti.Ndarray:
    """Return a host array as kernels take it repeatedly: a graphics card gets a copy."""
    return values if _started.get("backend") == "cpu" else upload(values)


def residents(*values: np.ndarray) -> list[np.ndarray | ti.Ndarray]:
    """Return host arrays as a kernel takes them that only reads them.

    CUDA would also copy NumPy arrays back, and the host would wait for that. On Vulkan, an explicit
    copy is itself a launch with a NumPy array, so it gains nothing.
    """
    return [upload(each) for each in values] if _started.get("backend") == "cuda" else list(values)


def copy(values: ti.Ndarray, into: ti.Ndarray | None = None) -> ti.Ndarray:
    """Return a copy of a device array of scalars.

    into: an array to overwrite, if its size and type fit. New memory costs more than the copy
    itself.
    """
    fits = into is not None and into.shape == values.shape and into.dtype == values.dtype
    fresh = into if fits else way.column(values.dtype, values.shape[0], zeroed=False)
    way.copy_into(values, fresh)
    return fresh


def wait() -> None:
    """Wait until the device has finished all launches; used for timing."""
    ti.sync()
