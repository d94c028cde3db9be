"""Use a fork of Taichi in its place, and add the packs of arguments (`ti.types.argpack`) it lacks.

A fork's kernel takes an object that holds arrays as a template, and compiles again for each object.
Every launch of a kernel therefore passes its packs in the same objects, which take over the arrays
of the packs until the next launch. Numbers of a template are compiled in, so the numbers of a pack
are passed as an array.
"""

import functools
import importlib
import inspect
import os
import sys
from collections.abc import Callable
from types import ModuleType
from typing import Any

import numpy as np


class Kind:
    """A type of pack: its members' annotations by name."""

    def __init__(self, **members: Any) -> None:
        self.members = members
        self.vectors = [name for name, kind in members.items() if hasattr(kind, "n")]

    def __call__(self, **values: Any) -> "Group":
        """Return a pack with these values."""
        return Group(
            self,
            values | {name: _numbers(self.members[name], values[name]) for name in self.vectors},
        )


class Group:
    """A pack of arguments: its arrays by name."""

    def __init__(self, kind: Kind, arrays: dict[str, Any]) -> None:
        self.kind, self.arrays = kind, arrays


def register(name: str) -> None:
    """Make `import taichi` return the fork of this name, without its banner."""
    if "taichi" in sys.modules:
        raise ImportError(
            "DRIFT_TAICHI: this program has imported taichi already; import drift first"
        )
    os.environ.setdefault(f"ENABLE_{name.upper()}_HEADER_PRINT", "False")
    os.environ.setdefault("QD_ENABLE_PYBUF", "0")
    fork = importlib.import_module(name)
    types, taichi = ModuleType("taichi.types"), ModuleType("taichi")
    vars(types).update(vars(fork.types), argpack=Kind)
    vars(taichi).update(
        vars(fork), types=types, ArgPack=Group, kernel=functools.partial(_kernel, fork)
    )
    sys.modules |= {"taichi": taichi, "taichi.types": types}


def _numbers(kind: Any, values: Any) -> Any:
    """Return a vector's numbers as a device array."""
    import taichi as ti

    from kernels.runtime.dtypes import NUMPY

    made = ti.ndarray(kind.dtype, shape=(kind.n,))
    made.from_numpy(np.array([values[k] for k in range(kind.n)], NUMPY[kind.dtype]))
    return made


@functools.cache
def _shell(fork: ModuleType) -> type:
    """Return the type of the objects that pass packs to kernels."""

    @fork.func
    def number(vector: fork.template(), k: fork.template()):
        return vector.numbers[k]

    @fork.data_oriented
    class Vector:
        """The numbers of a vector. A kernel may assign it to a variable, unlike an array."""

        def __getitem__(self, k: Any) -> Any:
            return number(self, k)

    @fork.data_oriented
    class Shell:
        def take(self, group: Group) -> None:
            for name, array in group.arrays.items():
                if name in group.kind.vectors:
                    vars(self).setdefault(name, Vector()).numbers = array
                else:
                    setattr(self, name, array)

    return Shell


def _kernel(fork: ModuleType, function: Callable[..., None]) -> Callable[..., None]:
    """Return a function as the fork's kernel that accepts packs and NumPy scalars."""
    signature = inspect.signature(function)
    notes = {name: one.annotation for name, one in signature.parameters.items()}
    places = [place for place, kind in enumerate(notes.values()) if isinstance(kind, Kind)]
    function.__annotations__ |= {
        name: fork.template() for name, kind in notes.items() if isinstance(kind, Kind)
    }
    compiled = fork.kernel(function)
    shells: dict[tuple[int, ...], list[Any]] = {}

    def launch(*args: Any) -> None:
        own = [value.item() if isinstance(value, np.generic) else value for value in args]
        ids = [id(array) for place in places for array in args[place].arrays.values()]
        # A compiled kernel takes an array once, even if it occurs several times.
        same = tuple(map(ids.index, ids)) if len(set(ids)) < len(ids) else ()
        if same not in shells:
            shells[same] = [_shell(fork)() for _ in places]
        for place, shell in zip(places, shells[same], strict=True):
            shell.take(args[place])
            own[place] = shell
        compiled(*own)

    launch.__signature__ = signature  # type: ignore[attr-defined]
    return functools.update_wrapper(launch, function)
