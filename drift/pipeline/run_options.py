"""A job: a case plus the opened forcing, output folder and run options.

Every job begins in the same way: what can be refused at once is refused, then Taichi is started and the environment
opened. Jobs of several threads of one program are done one after another, for Taichi compiles and launches for one
thread at a time.
"""

import contextlib
import functools
import os
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

from drift.case.record import Case
from drift.engine.environment.environment import Environment
from drift.forecast.products import chapter as forecast_chapter
from drift.pipeline import run_setup
from drift.products.files import writer
from geo.errors import UserError
from geo.files import digest
from kernels.runtime import runtime

P = ParamSpec("P")
R = TypeVar("R")
Report = Callable[[str, float], None]  # takes what is being done, and what share of it is done


@dataclass
class Stopwatch:
    """Wall time by phase [s]."""

    seconds: dict[str, float] = field(default_factory=dict)

    @contextlib.contextmanager
    def phase(self, name: str) -> Iterator[None]:
        """Add the time spent inside to a phase."""
        begin = time.perf_counter()
        yield
        self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - begin


@dataclass(frozen=True)
class Options:
    """How a job is to be done, whatever its case is.

    These are the options of `drift.run`, `plan`, `patrol` and `origin`, in their order.
    """

    out: str | os.PathLike[str] | None = None  # folder for results; None: they are returned, and not written
    datasets: Mapping[str, Any] | None = None
    threads: int | None = None
    backend: str = "cpu"
    overwrite: bool = False
    report: Report | None = None
    memory: float | None = None  # [GiB] that a run may take; None: half of what is free
    shards: int | None = None  # into which its particles are cut; None: as many as the memory asks for
    client: Any = None  # dask.distributed.Client whose workers move the shards; None: this process does


@dataclass(frozen=True)
class Job:
    """A case, the environment that was opened for it, the time that passes, and where results go."""

    case: Case
    where: Environment
    clock: Stopwatch
    tell: Report
    out: Path | None  # None: results are returned, and not written
    overwrite: bool
    memory: float | None = None  # see Options
    shards: int | None = None
    client: Any = None


def open_job(case: Case, options: Options = Options()) -> Job:
    """Return the job of a case, once it is sure that results can be written and Taichi runs."""
    if options.client is not None and options.datasets:
        raise UserError("datasets: workers read files; write these to files and name them in the case")
    if options.client is not None and options.backend not in ("cpu", runtime.AUTO):
        raise UserError(f"--backend {options.backend}: workers move particles on processors; leave it out")
    tell, clock = options.report or _silent, Stopwatch()
    folder = None if options.out is None else Path(options.out)
    if folder is not None:
        writer.check_folder(folder, options.overwrite, (*forecast_chapter.FILES, *forecast_chapter.PICTURES))
    digest.start(case.inputs)
    with clock.phase("taichi"):
        backend = options.backend if options.client is None else "cpu"
        runtime.start(backend, options.threads, case.particles)
    tell("read", 0.0)
    with clock.phase("read"):
        where = run_setup.open_for(case, options.datasets)
    return Job(case, where, clock, tell, folder, options.overwrite, options.memory, options.shards, options.client)


def _silent(phase: str, share: float) -> None:
    """Tell nobody."""


def in_turn(function: Callable[P, R]) -> Callable[P, R]:
    """Return a function that waits until no other thread of the program runs a case, then does its work.

    A graphics card that is full on the way becomes a UserError. The wait heeds signals. A call from within a run, by its `report` say, does not wait.
    """

    @functools.wraps(function)
    def waiting(*args: P.args, **kwargs: P.kwargs) -> R:
        with runtime.alone(), runtime.telling_full():
            return function(*args, **kwargs)

    return waiting
