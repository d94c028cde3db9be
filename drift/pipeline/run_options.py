"""A job: a case plus the opened forcing, output folder and run options.

`open_job` checks the options first, then starts Taichi and opens the environment. Jobs of several
threads of one program run one after another, because Taichi serves one thread at a time.
"""

import contextlib
import difflib
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
from drift.engine.environment.environment import Common, Environment
from drift.forecast.products import chapter as forecast_chapter
from drift.pipeline import run_setup
from drift.products.files import writer
from geo.errors import UserError
from geo.files import digest
from kernels.runtime import runtime

P = ParamSpec("P")
R = TypeVar("R")
ProgressCallback = Callable[
    [str, float], None
]  # called with the phase of the run and its share done, 0 to 1


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
    """Options of every function that reads forcing and moves particles.

    Attributes:
        datasets: xarray.Datasets by name, for sources of the case with `dataset = "name"`; drift
            reads them and keeps no reference.
        threads: CPU threads; None, or more than there are: all. The results are the same to the bit
            for any number.
        backend: device that moves particles: "cpu", "cuda", "vulkan", "metal", or "auto": a
            graphics card if the run is large enough. A process keeps the backend and the threads of
            its first run.
        overwrite: whether existing results in `out` are replaced, once the new ones are complete.
        report: called with the phase ("read", "drift", "map", "write" ..) and its share done, 0 to
            1; `drift.progress` makes one. An exception that it raises ends the run.
    """

    datasets: Mapping[str, Any] | None
    threads: int | None
    backend: str
    overwrite: bool
    report: ProgressCallback | None


class RunOptions(JobOptions, total=False):
    """Options of `drift.run`, `plan`, `patrol`, `place` and `allocate`, besides JobOptions.

    Attributes:
        memory: memory limit of the run [GiB]; None: half of the free memory. A run that needs more
            is moved in shards.
        shards: number of parts of the particles, moved one after another; None: as many as the
            memory limit requires. The results are the same to the bit for any number.
        client: a dask.distributed.Client whose workers move the shards; `out` must be a folder that
            all of them see.
    """

    memory: float | None
    shards: int | None
    client: Any


@dataclass(frozen=True)
class Options:
    """Options of a job: an output folder, and RunOptions with their defaults."""

    out: str | os.PathLike[str] | None = None  # None: results are returned, and not written
    datasets: Mapping[str, Any] | None = None
    threads: int | None = None
    backend: str = "cpu"
    overwrite: bool = False
    report: ProgressCallback | None = None
    memory: float | None = None
    shards: int | None = None
    client: Any = None


@dataclass(frozen=True)
class Job:
    """A case, its opened environment, a stopwatch, a progress callback and an output folder."""

    case: Case  # the one asked for, or one derived from it: a plan's, say, whose sorties are flown
    opened: Case  # the one asked for, whose environment is open
    where: Environment
    clock: Stopwatch
    tell: ProgressCallback
    out: Path | None  # None: results are returned, and not written
    overwrite: bool
    memory: float | None = None  # see Options
    shards: int | None = None
    client: Any = None


def open_job(case: Case, options: Options = Options(), common: Common | None = None) -> Job:
    """Return the job of a case: check the output folder, start Taichi and open the environment.

    Args:
        case: the case.
        options: its output folder and run options.
        common: sources and coast shared with other cases; None: nothing is shared.

    Raises:
        UserError: options exclude each other, the output folder cannot be written or holds
            something, the backend is not available, or the forcing cannot be read.
    """
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
        where = run_setup.open_for(case, options.datasets, common=common)
    return Job(
        case,
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
    """Ignore the progress of a run."""


def serialized(function: Callable[P, R]) -> Callable[P, R]:
    """Return the function with serialized calls: a call waits until no other thread runs a case.

    Signals interrupt the wait. A nested call from inside a run, for instance by its `report`, does
    not wait. If a graphics card runs out of memory, the call raises UserError. The new function's
    signature and docstring list each of the `**options`; an unknown option raises TypeError.
    """

    @functools.wraps(function)
    def serialized_call(*args: P.args, **kwargs: P.kwargs) -> R:
        _reject_unknown_options(serialized_call, kwargs)
        with runtime.alone(), runtime.telling_full():
            return function(*args, **kwargs)

    _spell_out_options(function, serialized_call)
    return serialized_call


def _reject_unknown_options(function: Callable[..., Any], given: Mapping[str, Any]) -> None:
    """Raise TypeError for a keyword that a public function does not take."""
    allowed = list(inspect.signature(function).parameters)
    unknown = [name for name in given if name not in allowed]
    if not unknown:
        return
    near = difflib.get_close_matches(unknown[0], allowed, 1)
    hint = f" did you mean {near[0]!r}?" if near else ""
    raise TypeError(
        f"drift.{function.__name__}: no option {unknown[0]!r};{hint} allowed: {', '.join(allowed)}. "
        "Keys of the case, such as seed, are changed by drift.vary"
    )


def _spell_out_options(function: Callable[..., Any], wrapper: Any) -> None:
    """Write a function's `**options` into the signature and docstring of its wrapper."""
    parameters = dict(inspect.signature(function).parameters)
    last = parameters.pop("options", None)
    if last is None:
        return
    (options_class,) = get_args(last.annotation)  # of Unpack
    defaults = Options()
    for name, kind in get_type_hints(options_class).items():
        parameters[name] = last.replace(
            name=name,
            kind=inspect.Parameter.KEYWORD_ONLY,
            default=getattr(defaults, name),
            annotation=kind,
        )
    wrapper.__signature__ = inspect.signature(function).replace(
        parameters=list(parameters.values())
    )
    descriptions = "".join(
        _describe_options(one)
        for one in ((JobOptions,) if options_class is JobOptions else (JobOptions, RunOptions))
    )
    wrapper.__doc__ = re.sub(
        r"^ +\*\*options: .*\n",
        lambda _: descriptions,
        inspect.getdoc(function) or "",
        flags=re.MULTILINE,
    )


def _describe_options(options: type) -> str:
    """Return the Attributes section of the docstring of an options class."""
    return (inspect.getdoc(options) or "").partition("Attributes:\n")[2].rstrip() + "\n"
