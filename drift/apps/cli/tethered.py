"""A command that ends with the process that started it, which holds its standard input open
(`drift.apps.serve.jobs`).
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
# files of graphics cards and of their drivers, below the root: those that are read, and written too
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
GRACE = 10.0  # [s] to leave nothing half written


def main(memory: int | None = None) -> None:
    """Run the command line, and end the process once its input does; memory: the most that it may
    take [bytes].
    """
    if memory is not None:
        child.limit(RLIMIT_DATA=memory)  # what it may write to, of which some it never does
    enclose(cards="--backend" in sys.argv)
    threading.Thread(target=_watch, daemon=True).start()
    commands.leave()


def enclose(cards: bool = False) -> None:
    """Have the kernel hold the fence too, where it can: the fence's folders, the working directory
    and the program.

    cards: whether the command may use graphics cards, which are files.
    """
    if (raised := fence.raised()) is not None:
        specs = filter(None, map(importlib.util.find_spec, PACKAGES))
        program = [Path(place) for spec in specs for place in spec.submodule_search_locations or ()]
        # Where it is installed as it stands, what says its version lies beside the packages.
        about = [path for place in program for path in place.parent.glob("casp_drift*-info")]
        here = Path.cwd()
        read, written = (
            [place for one in CARDS[way] for place in Path("/").glob(one)] if cards else []
            for way in "rw"
        )
        landlock.enclose(
            [*raised.folders, here], [*program, *about, *read], [*raised.writable, here, *written]
        )


def _watch() -> None:
    with contextlib.suppress(OSError):
        while os.read(0, 4096):
            pass
    os.kill(os.getpid(), signal.SIGTERM)
    time.sleep(GRACE)
    os._exit(128 + signal.SIGTERM)
