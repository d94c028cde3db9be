"""Entry point for a command that ends together with the process that started it.

That process (`drift.apps.serve.jobs`) holds the command's standard input open; its end is the
signal.
"""

import contextlib
import importlib.util
import os
import signal
import sys
import threading
import time
from pathlib import Path

from drift.apps.cli import commands
from geo.files import child, fence, landlock

PACKAGES = ("drift", "geo", "kernels", "cases")
# files of graphics cards and their drivers, below the root: read-only ("r") and writable ("w")
CARDS = {
    "r": (
        "proc/driver/nvidia",
        "proc/devices",
        "proc/modules",
        "sys/bus/pci",
        "sys/class/drm",
        "etc/vulkan",
        "etc/glvnd",
    ),
    "w": ("dev/nvidia*", "dev/dri"),
}
GRACE = 10.0  # [s] for the command to clean up before it is ended


def main(memory: int | None = None) -> None:
    """Run the command line, and end the process when its standard input closes.

    memory: limit of the process [bytes].
    """
    if memory is not None:
        child.limit(RLIMIT_DATA=memory)  # writable address space, some of it never used
    enclose(cards="--backend" in sys.argv)
    threading.Thread(target=_end_with_input, daemon=True).start()
    commands.leave()


def answer(memory: int | None = None) -> None:
    """Answer requests of the desk on standard input until it closes (see `serve.answers.process`).

    memory: limit of the process [bytes].
    """
    if memory is not None:
        child.limit(RLIMIT_DATA=memory)
    enclose()
    from drift.apps.serve.answers import process

    process.answer_requests()


def enclose(cards: bool = False) -> None:
    """Have the kernel enforce the file fence too, if it can.

    It allows the fence's folders, the working directory and the program's own files.

    cards: whether the command may use graphics cards, which are files.
    """
    if (raised := fence.current_fence()) is not None:
        specs = filter(None, map(importlib.util.find_spec, PACKAGES))
        program = [
            Path(location) for spec in specs for location in spec.submodule_search_locations or ()
        ]
        # In an editable install the metadata with the version is beside the packages.
        metadata = [
            path for location in program for path in location.parent.glob("casp_drift*-info")
        ]
        here = Path.cwd()
        read, written = (
            [location for pattern in CARDS[access] for location in Path("/").glob(pattern)]
            if cards
            else []
            for access in "rw"
        )
        landlock.enclose(
            [*raised.folders, here],
            [*program, *metadata, *read],
            [*raised.writable, here, *written],
        )


def _end_with_input() -> None:
    with contextlib.suppress(OSError):
        while os.read(0, 4096):
            pass
    os.kill(os.getpid(), signal.SIGTERM)
    time.sleep(GRACE)
    os._exit(128 + signal.SIGTERM)
