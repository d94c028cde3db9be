"""Runs in shards that are stopped or killed, and what they leave."""

from collections.abc import Callable
from pathlib import Path

from drift.products.files import hidden


def unfinished(out: Path) -> Path:
    return out.parent / f".{out.name}{hidden.UNFINISHED}"


def shards_of(out: Path) -> list[str]:
    return sorted(path.name for path in unfinished(out).glob("shard-*"))


class Stopped(Exception):
    pass


KILLED = """
import os, signal, sys
import drift
from drift.engine.motion import spool
from drift.pipeline.shards import work
case, out, where = sys.argv[1:]
def die():
    os.kill(os.getpid(), signal.SIGKILL)
keep, replace = spool.ShardFile._keep, work.replace
def kept(self, name, values):
    at = keep(self, name, values)
    if where == "data" and "00002" in str(self.file.name) and len(self.taken) == 1:
        self.file.flush()
        die()
    return at
def replaced(path, text):
    if "00002" in path.name:
        path.with_suffix(".new").write_text(text[: len(text) // 2])
        die()
    replace(path, text)
spool.ShardFile._keep, work.replace = kept, replaced
drift.run(drift.load(case), out, shards=4)
"""


def stopping(at: float) -> Callable[[str, float], None]:
    """Return what stops a run once so much of its drift is done."""

    def report(phase: str, share: float) -> None:
        if phase == "drift" and share >= at:
            raise Stopped

    return report
