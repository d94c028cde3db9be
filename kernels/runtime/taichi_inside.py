"""Taichi 1.7.4 through its internals: functions that are missing or slow in its public interface.

This module contains everything that uses Taichi's internals. kernels.runtime.taichi_public has the
same functions without them, for any other release; kernels.runtime.taichi_way chooses. Launches
rely on kernel_impl.Kernel.launch_kernel, views of columns on Program.get_ndarray_data_ptr_as_int.
"""

import ctypes
import functools
import os
import sys
import textwrap
import weakref
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import taichi as ti
from taichi._lib import core
from taichi.lang import impl, kernel_impl
from taichi.lang.argpack import ArgPack, ArgPackType
from taichi.lang.ast import ast_transformer_utils
from taichi.lang.enums import Layout
from taichi.lang.matrix import MatrixType
from taichi.lang.struct import StructType
from taichi.lang.util import cook_dtype
from taichi.types import ndarray_type, primitive_types
from taichi.types.annotations import template
from taichi.types.utils import is_signed

from kernels.runtime.dtypes import KINDS, NUMPY

Launch = Callable[..., None]

_backend = "none"  # the backend that has been started
# By kernel and compile-time arguments: the compiled kernel and its machine code.
_known: dict[tuple, tuple[Any, Any]] = {}


def cache() -> Path:
    """Return Taichi's default folder of compiled kernels."""
    return Path(impl.default_cfg().offline_cache_file_path)


def begin(backend: str) -> None:
    """Prepare the backend that has just been started.

    Only the thread of ti.init may lay out the (empty) tree of fields, which otherwise happens at
    the first launch, in whatever thread; afterwards any thread may compile and launch kernels.
    """
    global _backend
    _backend = backend
    impl.get_runtime().materialize()
    _quicken()


def close() -> bool:
    """Write compiled kernels to the cache; return whether Taichi needs no further shutdown."""
    program = impl.get_runtime().prog
    if program is not None:
        program.finalize()
    return True


def _place(self: Any, node: Any) -> str:
    """Return the source location of a node of a function's syntax tree, for error messages."""
    line = self.src[node.lineno - 1].strip()
    return f'File "{self.file}", line {node.lineno + self.lineno_offset}, in {self.func.func.__name__}:\n{line}\n'


def _quicken() -> None:
    """Make Taichi read each source once, and give only the line of an error: saves 40 % of reading.

    Taichi formats the source of every single expression in lines of 80 characters in case it
    contains an error, and looks up, reads and formats the source of a function wherever it is
    called. The compiled code does not change.
    """
    ast_transformer_utils.ASTTransformerContext.get_pos_info = _place
    once = functools.lru_cache(None)
    kernel_impl.getsourcefile, kernel_impl.getsourcelines = (
        once(kernel_impl.getsourcefile),
        once(kernel_impl.getsourcelines),
    )
    kernel_impl.textwrap = SimpleNamespace(fill=once(textwrap.fill), dedent=once(textwrap.dedent))
    kernel_impl.Kernel.launch_kernel = _launch


_launch_by_taichi = kernel_impl.Kernel.launch_kernel


def _launch(kernel: Any, compiled: Any, *args: Any) -> Any:
    """Launch a kernel with plain arguments at half of Taichi's cost; leave all others to Taichi.

    Taichi's own launch makes functions that refer to themselves and to the arrays of packs: these
    would lie in memory until Python looks for cycles.
    """
    context = compiled.make_launch_context()
    place, packed = 0, list[Any]()
    plain = kernel.return_type is None and not kernel.has_print
    for argument, value in zip(kernel.arguments, args, strict=True):
        kind = argument.annotation
        if isinstance(kind, template):
            continue
        if isinstance(kind, ndarray_type.NdarrayType):
            plain = plain and _set_array(context, place, kind, value)
        elif isinstance(kind, ArgPackType):
            context.set_arg_argpack((place,), value._ArgPack__argpack)
            packed += _arrays_of_pack(kind, value)
        elif isinstance(value, _accepted(kind)):
            _set(context, place, kind, value)
        else:
            plain = False
        if not plain:
            return _launch_by_taichi(kernel, compiled, *args)
        place += 1
    # Taichi puts the arrays of packs after all other arguments.
    for number, array in enumerate(packed, place):
        context.set_arg_ndarray((number,), array)
    program = impl.get_runtime().prog
    code = program.compile_kernel(program.config(), program.get_device_caps(), compiled)
    program.launch_kernel(code, context)
    return None


def _set_array(context: Any, place: int, kind: Any, value: Any) -> bool:
    """Set an array of a launch, if it is one on the device or a plain one of NumPy's."""
    if isinstance(value, ti.Ndarray):
        context.set_arg_ndarray((place,), value.arr)
        return value.grad is None
    if id(kind.dtype) not in primitive_types.type_ids or not isinstance(value, np.ndarray):
        return False
    address = value.__array_interface__["data"][0]
    context.set_arg_external_array_with_shape((place,), address, value.nbytes, value.shape, 0)
    return value.flags.c_contiguous


def _arrays_of_pack(kind: ArgPackType, value: Any) -> list[Any]:
    """Return the device arrays of a pack."""
    members = zip(kind.members.values(), value._members, strict=True)
    return [own.arr for one, own in members if isinstance(one, ndarray_type.NdarrayType)]


def _accepted(kind: Any) -> tuple[type, ...]:
    """Return the types of numbers that Taichi takes for an argument that is one."""
    if id(kind) in primitive_types.real_type_ids:
        return float, int, np.floating, np.integer
    return (int, np.integer) if id(kind) in primitive_types.integer_type_ids else ()


class Column(ti.ScalarNdarray):
    """A device array of scalars, which on a CPU is read and written in place.

    Taichi would launch a kernel for each copy.

    It is created without the caller's stack trace, which Taichi's own array keeps for messages, and
    which takes most of the time of creating one.
    """

    def __init__(self, dtype, n: int, zeroed: bool = True) -> None:
        ti.Ndarray.__init__(self)
        self.dtype = self.element_type = dtype
        program = impl.get_runtime().prog
        self.arr = program.create_ndarray(
            dtype, (n,), layout=Layout.NULL, zero_fill=zeroed, dbg_info=core.DebugInfo("")
        )
        self.shape = (n,)
        self._host: np.ndarray | None = None

    def to_numpy(self) -> np.ndarray:
        """Return a copy on the host."""
        if _backend == "cpu":
            return self._memory().copy()
        if _backend == "cuda":
            values = np.empty(self.shape, NUMPY[self.dtype])
            _copied("DtoH", values.ctypes.data, _address(self.arr), values.nbytes)
            return values
        return super().to_numpy()

    def from_numpy(self, arr: np.ndarray) -> None:
        """Write the values of a host array of the same shape and type."""
        fits = arr.dtype == NUMPY[self.dtype] and arr.shape == self.shape
        if _backend == "cpu" and fits:
            self._memory()[:] = arr
        elif _backend == "cuda" and fits:
            values = np.ascontiguousarray(arr)
            _copied("HtoD", _address(self.arr), values.ctypes.data, values.nbytes)
        else:
            super().from_numpy(arr)  # it also reports what is wrong with the array

    def _memory(self) -> np.ndarray:
        if self._host is None:
            self._host = _memory(self.arr, self.shape[0], KINDS[self.dtype])
        return self._host


def _memory(array, n: int, kind: type) -> np.ndarray:
    """Return a view of n numbers of a device array in the memory of a CPU.

    The view does not keep the array alive, and must not be used after it.
    """
    return np.frombuffer((kind * n).from_address(_address(array)), kind)


def _address(array: Any) -> int:
    """Return the address of a device array, on the CPU or on an NVIDIA card."""
    return impl.get_runtime().prog.get_ndarray_data_ptr_as_int(array)


def _copied(way: str, to: int, of: int, size: int) -> None:
    """Copy bytes with CUDA's driver after all launches have finished; way: HtoD, DtoH or DtoD.

    Taichi's own copies launch a kernel with a NumPy array, which is copied both ways.
    """
    driver, context = _driver()
    failed = driver.cuCtxSetCurrent(context)
    failed = failed or getattr(driver, f"cuMemcpy{way}_v2")(*map(ctypes.c_uint64, (to, of, size)))
    if failed:
        raise RuntimeError(f"CUDA: a copy of {size} bytes ({way}) failed with error {failed}")


@functools.cache
def _driver() -> tuple[Any, Any]:
    """Return CUDA's driver and the context of Taichi's arrays: the first card's primary context."""
    driver = ctypes.CDLL("nvcuda.dll" if sys.platform == "win32" else "libcuda.so")
    device, context = ctypes.c_int(), ctypes.c_void_p()
    driver.cuDeviceGet(ctypes.byref(device), 0)
    driver.cuDevicePrimaryCtxRetain(ctypes.byref(context), device)
    return driver, context


def column(dtype: Any, n: int, zeroed: bool = True) -> Column:
    """Return a device array of n scalars."""
    return Column(dtype, n, zeroed)


def copy_into(values: Column, fresh: Column) -> None:
    """Copy a column into another one of its size and type."""
    if _backend == "cpu":
        fresh._memory()[:] = values._memory()
    elif _backend == "cuda":
        size = values.shape[0] * ctypes.sizeof(KINDS[values.dtype])
        _copied("DtoD", _address(fresh.arr), _address(values.arr), size)
    else:
        fresh.copy_from(values)


def lying(held: Column) -> np.ndarray | None:
    """Return a view of a column in a CPU's memory; None on a graphics card.

    It must not be used after the column is gone.
    """
    return held._memory() if _backend == "cpu" else None


def nodes(n: int) -> ti.Ndarray:
    """Return a zeroed device array of n vectors of four float32.

    Taichi 1.7.4 frees scalar ndarrays but forgets vector ones (ScalarNdarray has __del__,
    VectorNdarray has none).
    """
    made = ti.Vector.ndarray(4, ti.f32, shape=(n,))
    weakref.finalize(made, _free, impl.get_runtime().prog, made.arr, os.getpid()).atexit = False
    return made


def _free(program: Any, array: Any, owner: int) -> None:
    """Free an array in the process that created it: a card's driver serves no forked processes."""
    if os.getpid() == owner:
        program.delete_ndarray(array)


def pairs(held: ti.Ndarray) -> np.ndarray | None:
    """Return a view of an array of `nodes`, each as two 64-bit pairs of float32, (n, 2).

    None on a graphics card.
    """
    n = held.shape[0]
    return _memory(held.arr, 2 * n, ctypes.c_int64).reshape(n, 2) if _backend == "cpu" else None


class Pack(ArgPack):
    """A pack of a kernel's arguments, created in a fraction of the time that Taichi's own takes.

    Taichi creates a new class for each.
    """

    def __init__(self, kind: ArgPackType, members: dict[str, Any]) -> None:
        """Write all members but arrays to the device; arrays are passed at the launch."""
        self._ArgPack__entries = members
        self._ArgPack__annotations = kind.members
        self._ArgPack__dtype = kind.dtype
        self._ArgPack__argpack = impl.get_runtime().prog.create_argpack(kind.dtype)
        numbers = [
            name
            for name, member in kind.members.items()
            if not isinstance(member, ndarray_type.NdarrayType)
        ]
        for place, name in enumerate(numbers):
            self._write_to_device(kind.members[name], type(members[name]), members[name], place)


pack = Pack


def bind(kernel: Any, args: tuple, changing: tuple[str, ...]) -> Launch:
    """Return a function that launches a kernel with these arguments.

    The function takes the whole numbers named in `changing`; all other arguments are fixed. Arrays
    are `ti.Ndarray`s and stay alive as long as the function does, alone or in a `pack`; a structure
    is given as a dict.
    """
    primal = kernel._primal
    program = impl.get_runtime().prog
    each = zip(primal.arguments, args, strict=True)
    key = (
        primal,
        *(value for argument, value in each if isinstance(argument.annotation, template)),
    )
    if key not in _known:
        compiled = primal.compiled_kernels[primal.ensure_compiled(*_structured(primal, args))]
        _known[key] = (
            compiled,
            program.compile_kernel(program.config(), program.get_device_caps(), compiled),
        )
    compiled, code = _known[key]
    real = [
        (a, v)
        for a, v in zip(primal.arguments, args, strict=True)
        if not isinstance(a.annotation, template)
    ]
    arrays, packed = [], []
    for place, (argument, value) in enumerate(real):
        if isinstance(argument.annotation, ndarray_type.NdarrayType):
            arrays.append(((place,), value.arr))
        elif isinstance(argument.annotation, ArgPackType):
            packed += _arrays_of_pack(argument.annotation, value)
    # Taichi puts the arrays of packs after all other arguments.
    arrays += [((len(real) + k,), array) for k, array in enumerate(packed)]
    slots = [(next(k for k, (a, _) in enumerate(real) if a.name == name),) for name in changing]

    def fresh() -> Any:
        context = compiled.make_launch_context()
        for place, (argument, value) in enumerate(real):
            if isinstance(argument.annotation, ArgPackType):
                context.set_arg_argpack((place,), value._ArgPack__argpack)
            elif not isinstance(argument.annotation, ndarray_type.NdarrayType):
                _set(context, place, argument.annotation, value)
        return context

    # A launch on CUDA frees a buffer of the context but leaves its address there: such a context
    # can be used only once.
    lasting = None if _backend == "cuda" else fresh()

    def launch_bound(*values: int, kept: tuple = args) -> None:
        context = lasting or fresh()
        for slot, array in arrays:  # set again each time, as a launch turns arrays into addresses
            context.set_arg_ndarray(slot, array)
        for slot, value in zip(slots, values, strict=True):
            context.set_arg_int(slot, value)
        program.launch_kernel(code, context)

    return launch_bound


def _structured(primal: Any, args: tuple) -> list:
    """Return the arguments with structures as Taichi takes them; these are slow to create."""
    each = zip(primal.arguments, args, strict=True)
    return [
        a.annotation(**_typed(a.annotation, v)) if isinstance(a.annotation, StructType) else v
        for a, v in each
    ]


def _typed(kind: StructType, numbers: dict[str, float]) -> dict[str, float]:
    """Return numbers as floats if the structure's member is one: Taichi accepts nothing else."""
    real = primitive_types.real_types
    return {
        name: float(numbers[name]) if dtype in real else numbers[name]
        for name, dtype in kind.members.items()
    }


def _set(context: Any, place: int, kind: Any, value: Any) -> None:
    """Set one argument of a launch that is not an array."""
    if isinstance(kind, MatrixType):
        kind.set_kernel_struct_args(kind(*(value[k] for k in range(kind.n))), context, (place,))
    elif isinstance(kind, StructType):
        kind.set_kernel_struct_args(_typed(kind, value), context, (place,))
    elif id(kind) in primitive_types.real_type_ids:
        context.set_arg_float((place,), float(value))
    elif is_signed(cook_dtype(kind)):
        context.set_arg_int((place,), int(value))
    else:
        context.set_arg_uint((place,), int(value))
