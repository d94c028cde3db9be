"""Taichi through its public interface only, for releases other than the known 1.7.4.

It has the functions of kernels.runtime.taichi_inside, with the same bits and more time: a launch
inspects all arguments again, columns are copied by kernels, and arrays of nodes are freed as that
release does it (1.7.4 never does).
"""

import inspect
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import taichi as ti

Launch = Callable[..., None]
_Structure = type(ti.types.struct(one=ti.f32))


def cache() -> Path:
    """Return the default folder of compiled kernels."""
    return Path.home() / ".cache" / ti.__name__ / "ticache"


def begin(backend: str) -> None:
    """Prepare the backend: only the thread of ti.init may lay out the (empty) tree of fields."""
    ti.sync()


def close() -> bool:
    """Return False: only the shutdown of the interpreter writes compiled kernels to the cache."""
    return False


def column(dtype: Any, n: int, zeroed: bool = True) -> ti.Ndarray:
    """Return a zeroed device array of n scalars."""
    return ti.ndarray(dtype, shape=(n,))


def copy_into(values: ti.Ndarray, fresh: ti.Ndarray) -> None:
    """Copy a column into another one of its size and type."""
    fresh.copy_from(values)


def lying(held: ti.Ndarray) -> np.ndarray | None:
    """Return None: the address of an array is not public."""
    return None


def nodes(n: int) -> ti.Ndarray:
    """Return a zeroed device array of n vectors of four float32."""
    return ti.Vector.ndarray(4, ti.f32, shape=(n,))


def pairs(held: ti.Ndarray) -> np.ndarray | None:
    """Return None: the address of an array is not public."""
    return None


def pack(kind: Any, members: dict[str, Any]) -> Any:
    """Return a pack of arguments (`ti.types.argpack`)."""
    return kind(**members)


def bind(kernel: Any, args: tuple, changing: tuple[str, ...]) -> Launch:
    """Return a function that launches a kernel with these arguments.

    See kernels.runtime.taichi_inside.bind.
    """
    parameters = list(inspect.signature(kernel).parameters.values())
    places = [next(k for k, one in enumerate(parameters) if one.name == name) for name in changing]
    own = [_structured(one.annotation, value) for one, value in zip(parameters, args, strict=True)]

    def launch(*values: int) -> None:
        for place, value in zip(places, values, strict=True):
            own[place] = value
        kernel(*own)

    return launch


def _structured(kind: Any, value: Any) -> Any:
    """Return an argument as Taichi takes it: float members of a structure get floats.

    Taichi accepts nothing else for these.
    """
    if not isinstance(kind, _Structure):
        return value
    real = (ti.f32, ti.f64)
    return kind(
        **{
            name: float(value[name]) if dtype in real else value[name]
            for name, dtype in kind.members.items()
        }
    )
