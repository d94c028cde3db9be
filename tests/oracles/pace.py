"""How slow the machine is at the moment: what has to be done within seconds may take longer where
others use the processor.
"""

import time


def slowness() -> float:
    """Return how many times its processor time a spell of work takes: 1 on a machine that is quiet."""
    begin, worked = time.monotonic(), time.process_time()
    while time.process_time() - worked < 0.1:
        pass
    return max(1.0, (time.monotonic() - begin) / 0.1)


class Watch:
    """A clock that begins now and goes as slowly as the machine."""

    def __init__(self) -> None:
        self._slow = slowness()
        self._begin = time.monotonic()

    def seconds(self) -> float:
        """Return how long it would have taken on a quiet machine [s]."""
        gone = time.monotonic() - self._begin
        return gone / max(self._slow, slowness())
