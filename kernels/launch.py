"""Arguments of kernels in groups, and a kernel with its arguments set once, to be launched again and again.

Taichi looks at all arguments anew at every launch, which takes longer than a step of some thousand particles.

This module relies on how Taichi 1.7.4 works inside (kernel_impl.Kernel.launch_kernel).
"""

from collections.abc import Callable
from typing import Any

from taichi.lang import impl
from taichi.lang.argpack import ArgPack, ArgPackType
from taichi.lang.matrix import MatrixType
from taichi.lang.struct import StructType
from taichi.lang.util import cook_dtype
from taichi.types import ndarray_type, primitive_types
from taichi.types.annotations import template
from taichi.types.utils import is_signed

from kernels import runtime

Launch = Callable[..., None]

# By kernel and compile-time arguments: what was compiled, and its machine code.
_known: dict[tuple, tuple[Any, Any]] = {}


class Pack(ArgPack):
    """A group of a kernel's arguments, made in a fraction of the time that Taichi's own takes.

    Taichi makes a new class for each.
    """

    def __init__(self, kind: ArgPackType, members: dict[str, Any]) -> None:
        """Write what is no array to the device; arrays are handed over at the launch."""
        self._ArgPack__entries = members
        self._ArgPack__annotations = kind.members
        self._ArgPack__dtype = kind.dtype
        self._ArgPack__argpack = impl.get_runtime().prog.create_argpack(kind.dtype)
        numbers = [name for name, member in kind.members.items() if not isinstance(member, ndarray_type.NdarrayType)]
        for place, name in enumerate(numbers):
            self._write_to_device(kind.members[name], type(members[name]), members[name], place)


def pack(kind: ArgPackType, *values: Any) -> Pack:
    """Return a group of arguments of a kind (`ti.types.argpack`), in the order of its members.

    It keeps its arrays alive.

    Numbers in it cost 12 us and some 30 bytes that Taichi never gives back: what is packed for each ensemble holds
    none. Taichi 1.7.4 knows the members by their names alone: two groups of one kernel must not share one, nor may the
    kernel give one to a variable of its own.
    """
    return Pack(kind, dict(zip(kind.members, values, strict=True)))


def bind(kernel: Any, args: tuple, changing: tuple[str, ...]) -> Launch:
    """Return a function that launches a kernel with these arguments.

    The function takes the whole numbers named in `changing`; all other arguments stay as they are. Arrays are
    `ti.Ndarray`s, and stay alive as long as the function does, alone or in a `pack`; a structure comes as a dict.
    """
    primal = kernel._primal
    program = impl.get_runtime().prog
    each = zip(primal.arguments, args, strict=True)
    key = (primal, *(value for argument, value in each if isinstance(argument.annotation, template)))
    if key not in _known:
        compiled = primal.compiled_kernels[primal.ensure_compiled(*_structured(primal, args))]
        _known[key] = compiled, program.compile_kernel(program.config(), program.get_device_caps(), compiled)
    compiled, code = _known[key]
    real = [(a, v) for a, v in zip(primal.arguments, args, strict=True) if not isinstance(a.annotation, template)]
    arrays, packed = [], []
    for place, (argument, value) in enumerate(real):
        if isinstance(argument.annotation, ndarray_type.NdarrayType):
            arrays.append(((place,), value.arr))
        elif isinstance(argument.annotation, ArgPackType):
            members = zip(argument.annotation.members.values(), value._members, strict=True)
            packed += [own.arr for kind, own in members if isinstance(kind, ndarray_type.NdarrayType)]
    # Taichi puts the arrays of groups after all else.
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

    # A launch on CUDA frees a buffer of the context, and leaves its address there: such a context serves once.
    lasting = None if runtime.backend() == "cuda" else fresh()

    def launch_bound(*values: int, kept: tuple = args) -> None:
        context = lasting or fresh()
        for slot, array in arrays:  # set anew each time: a launch turns arrays into addresses
            context.set_arg_ndarray(slot, array)
        for slot, value in zip(slots, values, strict=True):
            context.set_arg_int(slot, value)
        program.launch_kernel(code, context)

    return launch_bound


def _structured(primal: Any, args: tuple) -> list:
    """Return the arguments with structures as Taichi takes them, which are slow to make."""
    each = zip(primal.arguments, args, strict=True)
    return [a.annotation(**_typed(a.annotation, v)) if isinstance(a.annotation, StructType) else v for a, v in each]


def _typed(kind: StructType, numbers: dict[str, float]) -> dict[str, float]:
    """Return numbers as floats where a structure holds floats: it takes no others."""
    real = primitive_types.real_types
    return {name: float(numbers[name]) if dtype in real else numbers[name] for name, dtype in kind.members.items()}


def _set(context: Any, place: int, kind: Any, value: Any) -> None:
    """Set one argument of a launch that is no array."""
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
