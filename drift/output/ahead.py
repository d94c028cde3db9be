"""What takes long to import and is wanted at the end only is imported while particles move.

Kernels leave the interpreter alone meanwhile. Copies of the process that draw (drift.output.drawing) have it with them.
"""

import ast
import functools
import importlib
import threading
from collections.abc import Callable
from typing import Any

_under_way: list[threading.Thread] = []
_parse: Callable[..., Any] = ast.parse
_parsing = threading.RLock()


@functools.wraps(_parse)
def _one_by_one(*args: Any, **kwargs: Any) -> Any:
    """Parse as `ast.parse` does, never in two threads at once.

    CPython 3.11 and 3.12 count how deep all threads together are: SystemError, "AST constructor recursion depth mismatch".
    Taichi parses its kernels, and Matplotlib and dask parse while they are imported.
    """
    with _parsing:
        return _parse(*args, **kwargs)


def begin(*modules: str) -> None:
    """Have another thread import some modules, one after another; what cannot be is left to whoever wants it."""
    if not _under_way:
        thread = threading.Thread(target=_imported, args=modules, name="imports", daemon=True)
        _under_way.append(thread)
        ast.parse = _one_by_one
        thread.start()


def _imported(*modules: str) -> None:
    for module in modules:
        try:
            importlib.import_module(module)
        except Exception:  # who needs it tells of it
            return


def done() -> None:
    """Wait until that is done: a process is not to be copied in the middle of it."""
    while _under_way:
        _under_way.pop().join()
    ast.parse = _parse
