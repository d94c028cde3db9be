"""Runs of several threads of one program, one after another: Taichi compiles and launches for one thread at a time."""

import functools
from collections.abc import Callable
from typing import ParamSpec, TypeVar

from kernels import runtime

P = ParamSpec("P")
R = TypeVar("R")


def in_turn(function: Callable[P, R]) -> Callable[P, R]:
    """Return a function that waits until no other thread of the program runs a case, then does what `function` does.

    The wait heeds signals. A call from within a run, by its `report` say, does not wait.
    """

    @functools.wraps(function)
    def waiting(*args: P.args, **kwargs: P.kwargs) -> R:
        with runtime.alone():
            return function(*args, **kwargs)

    return waiting
