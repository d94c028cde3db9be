"""What takes long to import and is wanted at the end only is imported while particles move.

Kernels leave the interpreter alone meanwhile. Copies of the process that draw (drift.output.drawing) have it with them.
"""

import importlib
import threading

_under_way: list[threading.Thread] = []


def begin(*modules: str) -> None:
    """Have another thread import some modules, one after another; what cannot be is left to whoever wants it."""
    if not _under_way:
        thread = threading.Thread(target=_imported, args=modules, name="imports", daemon=True)
        _under_way.append(thread)
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
