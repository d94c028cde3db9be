"""A command that ends with the process that started it, which holds its standard input open (`drift.desk.jobs`)."""

import contextlib
import os
import signal
import threading
import time

from drift.cli import commands

GRACE = 10.0  # [s] to leave nothing half written


def main() -> None:
    """Run the command line, and end the process once its input does."""
    threading.Thread(target=_watch, daemon=True).start()
    commands.leave()


def _watch() -> None:
    with contextlib.suppress(OSError):
        while os.read(0, 4096):
            pass
    os.kill(os.getpid(), signal.SIGTERM)
    time.sleep(GRACE)
    os._exit(128 + signal.SIGTERM)
