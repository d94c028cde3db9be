"""Start Taichi once, let one thread at a time use it, and move arrays between host and device.

`ti.init` wipes every array of the process, so a process keeps the backend that it started with.
"""

import contextlib
import io
import logging
import math
import os
import tempfile
import threading
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

# warnings come to standard error unless a program sends them elsewhere
LOG = logging.getLogger("drift")
LEAST_SPACE = "2 to 3 GiB"  # that a small run maps, of which it uses a tenth
# environment variable that tells Taichi where compiled kernels are kept
NAMED = "TI_OFFLINE_CACHE_FILE_PATH"
BACKENDS = {"cpu": ti.cpu, "cuda": ti.cuda, "vulkan": ti.vulkan, "metal": ti.metal}
# in place of a backend: a card where there is one and it is worth it, else the processor
AUTO = "auto"
# in what backends say of that
FULL = ("out of memory", "out_of_memory", "OUT_OF_DEVICE_MEMORY", "OUT_OF_HOST_MEMORY")

_started: dict[str, object] = {}
_use = threading.RLock()  # held by the thread that uses Taichi


@contextlib.contextmanager
def alone() -> Iterator[None]:
    """Wait until no other thread uses Taichi, and keep it for this one meanwhile; may be nested.

    Taichi's compiler keeps what it compiles at the moment in variables of the process: a second
    thread that launches meanwhile gets errors from the middle of the compiler, or ends the process.
    """
    with waiting.hold_lock(_use):
        yield


def cores() -> int:
    """Return the number of cores that this process may use.

    That is the least of the machine's, its affinity's and its container's quota.
    """
    try:
        count = len(os.sched_getaffinity(0))
    except (AttributeError, OSError):  # macOS and Windows know no affinity
        count = os.cpu_count() or 1
    quota = _quota()
    return count if quota is None else max(1, min(count, math.ceil(quota)))


def _quota() -> float | None:
    """Return the cores' worth of time that the container grants, None without a limit.

    Reads Linux control groups, version 2 or 1.
    """
    for names in (("cpu.max",), ("cpu/cpu.cfs_quota_us", "cpu/cpu.cfs_period_us")):
        try:
            granted, period = " ".join((CGROUPS / name).read_text() for name in names).split()
            if int(granted) > 0 and int(period) > 0:
                return int(granted) / int(period)
        except (OSError, ValueError):  # there is none, or it says "max"
            continue
    return None


def start(backend: str = "cpu", threads: int | None = None, lanes: int | None = None) -> None:
    """Start Taichi on a backend with a number of CPU threads; once started, keep it.

    backend: one of BACKENDS, or AUTO, which keeps what runs already; threads: `cores()` by default
    and at most; lanes: how many particles, or clouds of a tracking case, are to be moved side by
    side, for AUTO.

    Raises UserError when the backend is unknown or this machine lacks it, when another one runs
    already, or on a graphics card from another thread than the one that started it.
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
    """Start what AUTO takes, and return it; where a card does not start that should, start the
    processor.
    """
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
    """Start Taichi; raise UserError where it does not start."""
    if backend == "vulkan" and device is not None:
        # Taichi ranks devices in another way, and ends at "abc"
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
                # The machine's compiler finds again whatever this pass finds in a kernel, and the
                # pass takes time in proportion to the square of the kernel's length.
                cfg_optimization=False,
                advanced_optimization=backend != "cpu",  # likewise: half of the time of compiling
                # A card's errors are raised, and would be printed too: a run prints one line of its
                # own.
                log_level=ti.ERROR if backend == "cpu" else ti.CRITICAL,
                **_caching(),
                cpu_max_num_threads=threads,
            )
            way.begin(backend)
        if backend != "cpu" and hasattr(os, "register_at_fork"):
            os.register_at_fork(after_in_child=_forsake)
    except Exception as error:
        raise _not_started(backend, error) from error


def _forsake() -> None:
    """Have a copy of this process, such as one that draws, free no arrays of the card: its driver
    serves no copies.
    """
    ti.ScalarNdarray.__del__ = lambda self: None


def _caching() -> dict[str, object]:
    """Return Taichi's options for keeping compiled kernels from run to run, where its folder can be
    written.

    Where it cannot, as in a read-only home, Taichi would end the process by a segmentation fault,
    last of all, when it makes the folder. So kernels are not kept, and it is given a folder that is
    there: its own.
    """
    cache = Path(os.environ.get(NAMED) or way.cache())
    try:
        cache.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=cache):
            pass
        for file in cache.glob("*.tcb"):  # it may be another user's
            file.open("ab").close()
    except OSError as error:
        LOG.warning(
            "drift: the cache %s cannot be written (%s), so every run compiles its kernels again; name another folder "
            "in the environment variable %s",
            cache,
            error.strerror,
            NAMED,
        )
        os.environ.pop(NAMED, None)  # Taichi would warn that it does not count
        return {"offline_cache": False, "offline_cache_file_path": str(Path(ti.__file__).parent)}
    # Taichi takes this folder by itself; a fork knows neither the folder nor the variable.
    known = not taichi_way.fork and (taichi_way.inside or os.environ.get(NAMED))
    return {"offline_cache": True} | ({} if known else {"offline_cache_file_path": str(cache)})


def _not_started(backend: str, error: Exception) -> UserError:
    """Return why a backend does not start; another one is suggested only for a graphics card's."""
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
    """Refuse another backend or number of threads than those that run, and a graphics card from
    another thread.
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
    """Return how many threads Taichi runs on, or would run on if it was started now."""
    return int(str(_started.get("threads", cores())))


def backend() -> str:
    """Return the name of the running backend, or "none"."""
    return str(_started.get("backend", "none"))


def about() -> dict[str, str]:
    """Return what files say of the running backend: its name, and its device where that is a
    graphics card.

    The driver is part of the device: it compiles what runs.
    """
    device = _started.get("device")
    return {"backend": backend()} | (
        {"device": device.identity} if isinstance(device, Device) else {}
    )


def told() -> str:
    """Return what AUTO took and why, in a line; "" where it was not asked, or a warning has said
    it.
    """
    return str(_started.get("told", ""))


def room() -> int | None:
    """Return how much of the running device's own memory is free [bytes];

    None where it uses the processor's, or where it is unknown.
    """
    device = _started.get("device")
    if not isinstance(device, Device):
        return None
    listed = drivers.ask(device.backend).devices
    return next((one.room for one in listed if one.number == device.number), device.room)


@contextlib.contextmanager
def telling_full() -> Iterator[None]:
    """Turn what a backend raises when its card is full into a line that says what to do
    (UserError).
    """
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

    One aligned fetch a node saves 10 % of the time of a step.
    """
    return way.nodes(max(n, 1))


def pairs(nodes: ti.Ndarray) -> np.ndarray | None:
    """Return an array of `empty_nodes` where it lies, each node as two pairs of float32 in 64 bits
    (n, 2).

    Return None where that is not to be had, as on any backend but the CPU.
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
    """Return a host array as kernels take it that read it again and again: a card holds a copy of
    it.
    """
    return values if _started.get("backend") == "cpu" else upload(values)


def residents(*values: np.ndarray) -> list[np.ndarray | ti.Ndarray]:
    """Return host arrays as a kernel takes them that only reads them.

    CUDA would copy NumPy arrays back, too, and have the host wait for it. On Vulkan a copy of one's
    own is a launch with a NumPy array, which gains nothing.
    """
    return [upload(each) for each in values] if _started.get("backend") == "cuda" else list(values)


def copy(values: ti.Ndarray, into: ti.Ndarray | None = None) -> ti.Ndarray:
    """Return a copy of a device array of scalars; into: an earlier one, in whose place it is made
    where that is as large.

    New memory costs more than what is copied into it.
    """
    fits = into is not None and into.shape == values.shape and into.dtype == values.dtype
    fresh = into if fits else way.column(values.dtype, values.shape[0], zeroed=False)
    way.copy_into(values, fresh)
    return fresh


def wait() -> None:
    """Wait until the device has done all that was launched; used for timing."""
    ti.sync()
