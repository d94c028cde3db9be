"""A job: a case plus the opened forcing, output folder and run options.

Every job begins in the same way: what can be refused at once is refused, then Taichi is started and
the environment opened. Jobs of several threads of one program are done one after another, for
Taichi compiles and launches for one thread at a time.
"""

import contextlib
import functools
import inspect
import os
import re
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ParamSpec, TypedDict, TypeVar, get_args, get_type_hints

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


class JobOptions(TypedDict, total=False):
    """Options of whatever reads forcing and moves particles.

    Attributes:
        datasets: the xarray.Datasets that sources of the case with `dataset = "name"` name, by that
            name; they are only read, and not kept.
        threads: threads of the CPU; None, or more than there are: all. No number of them changes a
            bit of the results.
        backend: where particles move: "cpu", "cuda", "vulkan", "metal", or "auto" for a graphics
            card where one is worth it. A process keeps the backend and the threads that it began
            with.
        overwrite: whether results that `out` holds are replaced, once the new ones are complete.
        report: is called with what is being done ("read", "drift", "map", "write" ..) and the share
            of it that is done, 0 to 1; `drift.progress` makes one. An exception that it raises ends
            the run.
    """

    datasets: Mapping[str, Any] | None
    threads: int | None
    backend: str
    overwrite: bool
    report: Report | None


class RunOptions(JobOptions, total=False):
    """Options of `drift.run`, `plan`, `patrol`, `place` and `allocate`: those of JobOptions, and
    these.

    Attributes:
        memory: memory that the run may take [GiB]; None: half of what is free. A run that needs
            more is moved in shards.
        shards: into how many parts the particles are cut, moved one after another; None: as the
            memory asks. No number of them changes a bit of the results.
        client: a dask.distributed.Client whose workers move the shards; `out` is to lie where all
            of them see it.
    """

    memory: float | None
    shards: int | None
    client: Any


@dataclass(frozen=True)
class Options:
    """How a job is to be done, whatever its case is: a folder for the results, and RunOptions with
    their defaults.
    """

    out: str | os.PathLike[str] | None = None  # None: results are returned, and not written
    datasets: Mapping[str, Any] | None = None
    threads: int | None = None
    backend: str = "cpu"
    overwrite: bool = False
    report: Report | None = None
    memory: float | None = None
    shards: int | None = None
    client: Any = None


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
        raise UserError(
            "datasets: workers read files; write these to files and name them in the case"
        )
    if options.client is not None and options.backend not in ("cpu", runtime.AUTO):
        raise UserError(
            f"--backend {options.backend}: workers move particles on processors; leave it out"
        )
    tell, clock = options.report or _silent, Stopwatch()
    folder = None if options.out is None else Path(options.out)
    if folder is not None:
        writer.check_folder(
            folder, options.overwrite, (*forecast_chapter.FILES, *forecast_chapter.PICTURES)
        )
    digest.start(case.inputs)
    with clock.phase("taichi"):
        backend = options.backend if options.client is None else "cpu"
        runtime.start(backend, options.threads, case.particles)
    tell("read", 0.0)
    with clock.phase("read"):
        where = run_setup.open_for(case, options.datasets)
    return Job(
        case,
        where,
        clock,
        tell,
        folder,
        options.overwrite,
        options.memory,
        options.shards,
        options.client,
    )


def _silent(phase: str, share: float) -> None:
    """Tell nobody."""


def in_turn(function: Callable[P, R]) -> Callable[P, R]:
    """Return a function that waits until no other thread of the program runs a case, then does its
    work.

    A graphics card that is full on the way becomes a UserError. The wait heeds signals. A call from
    within a run, by its `report` say, does not wait. `**options` of the function are spelled out in
    the signature and the docstring of the new one.
    """

    @functools.wraps(function)
    def waiting(*args: P.args, **kwargs: P.kwargs) -> R:
        with runtime.alone(), runtime.telling_full():
            return function(*args, **kwargs)

    _spell_out_options(function, waiting)
    return waiting


def _spell_out_options(function: Callable[..., Any], shown: Any) -> None:
    """Have a function's `**options` stand in the signature and the docstring of the one that is
    shown for it.
    """
    parameters = dict(inspect.signature(function).parameters)
    last = parameters.pop("options", None)
    if last is None:
        return
    (given,) = get_args(last.annotation)  # of Unpack
    defaults = Options()
    for name, kind in get_type_hints(given).items():
        parameters[name] = last.replace(
            name=name,
            kind=inspect.Parameter.KEYWORD_ONLY,
            default=getattr(defaults, name),
            annotation=kind,
        )
    shown.__signature__ = inspect.signature(function).replace(parameters=list(parameters.values()))
    told = "".join(
        _told(one) for one in ((JobOptions,) if given is JobOptions else (JobOptions, RunOptions))
    )
    shown.__doc__ = re.sub(
        r"^ +\*\*options: .*\n", lambda _: told, inspect.getdoc(function) or "", flags=re.MULTILINE
    )


def _told(options: type) -> str:
    """Return what the docstring of a class of options says of each."""
    return (inspect.getdoc(options) or "").partition("Attributes:\n")[2].rstrip() + "\n"
