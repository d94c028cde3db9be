"""The command line `drift`: run or check a case, list cases and objects, say how a forcing file was understood.

Exit status: 0, 2 for the user's error (one line), 1 for ours, 130 when interrupted, 143 when asked to end. Nothing heavy is imported before
the command that needs it, so that help and lists come at once.
"""

import argparse
import contextlib
import io
import os
import signal
import sys
import tempfile
import threading
import traceback
import warnings
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from geo.errors import UserError

BACKENDS = ("cpu", "cuda", "vulkan", "metal")
INTERRUPTED = "drift: interrupted; no half file is left"
TERMINATED = "drift: asked to end; no half file is left"
EXAMPLES = """examples:
  drift run overdue_boat
  drift run my_case.toml --out results --set clock.step='10 min' --set scenario.0.weight=0.3
  drift objects raft deep ballast
  drift info currents/*.nc --plot currents.png"""


class Terminated(BaseException):
    """A request to end (SIGTERM): unwinds as Ctrl-C does, so that nothing half-written stays."""


class Parser(argparse.ArgumentParser):
    """An argument parser whose complaints are one line, like every other."""

    def error(self, message: str) -> Any:
        """Refuse the command line."""
        raise UserError(f"{message}. See: {self.prog} --help")


def parser() -> Parser:
    """Return the command line's grammar."""
    whole = Parser(
        prog="drift",
        description="Forecast where an object adrift at sea may be.",
        epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    whole.add_argument("--version", action="store_true", help="print the version")
    commands = whole.add_subparsers(dest="command", metavar="COMMAND", parser_class=Parser)

    run = commands.add_parser("run", help="forecast a case and write maps and tables")
    _add_case(run)
    run.add_argument("--out", type=Path, metavar="DIR", help="folder for the results (default: NAME-forecast)")
    run.add_argument("--threads", type=int, metavar="N", help="CPU threads (default: all); the result doesn't change")
    run.add_argument("--backend", choices=BACKENDS, default="cpu", help="where the particles move (default: cpu)")
    run.add_argument("--overwrite", action="store_true", help="replace results that the folder holds")

    check = commands.add_parser("check", help="validate a case and its forcing without running")
    _add_case(check)

    commands.add_parser("cases", help="list the cases that ship with drift")

    objects = commands.add_parser("objects", help="list leeway classes, or search them")
    objects.add_argument("words", nargs="*", metavar="WORDS", help="only classes that hold every word")

    info = commands.add_parser("info", help="say how a forcing file was understood")
    info.add_argument(
        "files", nargs="+", metavar="FILE", help="files of one source: joined in time, u and v may be apart"
    )
    info.add_argument("--plot", type=Path, metavar="PNG", help="draw a map of the first time")
    return whole


def _add_case(command: argparse.ArgumentParser) -> None:
    command.add_argument("case", metavar="CASE", help="a case file, or the name of a shipped case")
    command.add_argument(
        "--set",
        action="append",
        default=[],
        dest="changes",
        metavar="KEY=VALUE",
        help="change one place of the case, like clock.step='10 min'; lists count from 0; may be repeated",
    )
    command.add_argument("--seed", type=int, metavar="N", help="another seed than the case's")


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line and return the exit status."""
    _open_streams()
    warnings.filterwarnings("ignore", message="Glyph .* missing from font")  # the map then shows a box
    if os.name == "posix" and not os.environ.get("HOME"):  # Taichi aborts at import without one
        home = os.path.expanduser("~")
        os.environ["HOME"] = home if os.path.isdir(home) else tempfile.gettempdir()
    try:
        with _ending_cleanly():
            return _dispatch(argv)
    except UserError as error:
        print(f"drift: {_line(error)}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print(INTERRUPTED, file=sys.stderr)
        return 130
    except Terminated:
        print(TERMINATED, file=sys.stderr)
        return 143
    except BrokenPipeError:  # the reader left, as in `drift objects | head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except SystemExit as leaving:  # argparse's --help
        return int(leaving.code or 0)
    except Exception as error:
        traceback.print_exc()
        print(f"drift: an error of drift itself: {type(error).__name__}: {error}", file=sys.stderr)
        return 1


def _line(error: Exception) -> str:
    """Return a refusal as one line that a terminal can show, whatever the user had written."""
    line = "".join(letter if letter.isprintable() else " " for letter in " ".join(str(error).split()))
    return line if len(line) <= 1200 else f"{line[:600]} ... {line[-500:]}"


def _dispatch(argv: Sequence[str] | None) -> int:
    whole = parser()
    given = whole.parse_args(argv)
    if given.version:
        from importlib.metadata import version

        _say(f"drift {version('casp-drift')}")
        return 0
    if given.command is None:
        whole.print_help()
        return 0
    {"run": _run, "check": _check, "cases": _cases, "objects": _objects, "info": _info}[given.command](given)
    return 0


def _open_streams() -> None:
    """Give closed streams (`>&-`) a place to go, and letters that a stream cannot show a substitute."""
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:
            nowhere = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115
            setattr(sys, name, nowhere)
            setattr(sys, f"__{name}__", nowhere)  # Taichi takes a stream that was exchanged for a notebook's
        elif isinstance(stream, io.TextIOWrapper) and stream.errors in {"strict", "surrogateescape"}:
            stream.reconfigure(errors="replace")


def _say(text: str) -> None:
    """Print on standard output, at once: a failure can still be told."""
    try:
        print(text, flush=True)
    except BrokenPipeError:
        raise
    except OSError as error:
        with contextlib.suppress(OSError):  # what is left in the buffer would fail once more at the end
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        raise UserError(
            f"cannot write to standard output: {error.strerror}; results that were asked for stand"
        ) from None


_asked: list[int] = []  # signals to end that have come: the exception is lost where a destructor is running


@contextlib.contextmanager
def _ending_cleanly() -> Iterator[None]:
    """Turn Ctrl-C and a request to end into exceptions that unwind the run."""
    _asked.clear()

    def end(number: int, frame: object) -> None:
        _asked.append(number)
        _heed()

    def unraisable(lost: Any) -> None:
        if not isinstance(lost.exc_value, KeyboardInterrupt | Terminated):
            before(lost)

    before, sys.unraisablehook = sys.unraisablehook, unraisable
    try:
        with _on(signal.SIGTERM, end), _on(signal.SIGINT, end):
            yield
    finally:
        sys.unraisablehook = before


def _heed() -> None:
    """Leave if that was asked for."""
    if _asked:
        raise Terminated if _asked[0] == signal.SIGTERM else KeyboardInterrupt


@contextlib.contextmanager
def _on(number: signal.Signals, handler: Callable[[int, Any], None]) -> Iterator[None]:
    """Handle a signal for a while; only a process's main thread can."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(number, handler)
    try:
        yield
    finally:
        signal.signal(number, before if before is not None else signal.SIG_DFL)


def _load(given: argparse.Namespace) -> Any:
    from drift import case

    overrides = {}
    for change in given.changes:
        key, equals, value = change.partition("=")
        if not key.strip() or not equals:
            raise UserError(f'--set "{change}" must be KEY=VALUE, like clock.step=600')
        overrides[key.strip()] = value
    if given.seed is not None:
        overrides["seed"] = str(given.seed)
    return case.load(given.case, overrides)


def _run(given: argparse.Namespace) -> None:
    with _leaving_at_once():
        case = _load(given)
        out = given.out or Path(f"{case.path.stem}-forecast")
        if given.threads is not None and given.threads < 1:
            raise UserError(f"--threads {given.threads} must be at least 1")
        from drift import flow, outcome, progress, tables

    with progress.shown(case) as show:

        def report(phase: str, share: float) -> None:
            _heed()
            show(phase, share)

        result = flow.run(
            case, out, threads=given.threads, backend=given.backend, overwrite=given.overwrite, report=report
        )
    facts = result.summary["run"]
    last = {**tables.numbers(result.forecast), **result.summary}
    _print_facts(case.title, outcome.spill(last) if case.spill else outcome.forecast(last))
    basis = f"{facts['particles']:,} particles, {facts['scheme']}, step {facts['step_s']} s, seed {facts['seed']}"
    _say(f"{basis}\nResults in {out}")


@contextlib.contextmanager
def _leaving_at_once() -> Iterator[None]:
    """Leave at the first Ctrl-C: libraries swallow KeyboardInterrupt while they are imported. Nothing is open yet."""

    def leave(number: int, frame: object) -> None:
        asked = number == signal.SIGTERM
        os.write(2, f"{TERMINATED if asked else INTERRUPTED}\n".encode())
        os._exit(128 + number)

    with _on(signal.SIGINT, leave), _on(signal.SIGTERM, leave):
        yield


def _check(given: argparse.Namespace) -> None:
    case = _load(given)
    from drift import flow

    _print_facts(f"{case.title}: ready to run", flow.check(case))


def _cases(given: argparse.Namespace) -> None:
    from drift import case

    table = _table("Name", "Title")
    for name, title in case.shipped():
        table.add_row(name, title)
    _show(table)


def _objects(given: argparse.Namespace) -> None:
    from drift import leeway

    words = " ".join(given.words)
    found = leeway.search(words)
    if not found:
        raise UserError(f'no leeway class holds "{words}"; see them all: drift objects')
    table = _table("Class", "Description")
    for side in ("Downwind", "Right", "Left"):
        table.add_column(f"{side}\n% + cm/s ± cm/s", justify="right", no_wrap=True)
    for drifter in found:
        lines = (
            f"{100 * line.slope:.2f} {100 * line.offset:+6.2f} {100 * line.std:5.2f}"
            for line in (drifter.down, drifter.right, drifter.left)
        )
        table.add_row(drifter.name, "  " * drifter.level + drifter.description, *lines)
    _show(table)
    if not words:
        _say('Besides: "water" for a pure water drifter, { windage = "3 %" } or lines of your own in the case file.')


def _info(given: argparse.Namespace) -> None:
    from geo import describe

    understood = describe.understand(given.files)
    for source in understood:
        _say("\n".join([*describe.describe(source), *describe.sketch(source)]))
    for source in understood if given.plot else ():
        plot = given.plot
        if len(understood) > 1:
            plot = plot.with_name(f"{plot.stem}-{source.quantity}{plot.suffix}")
        _draw(source, plot)
        _say(f"Map in {plot}")


def _draw(source: Any, path: Path) -> None:
    from drift import maps
    from geo import shore

    if path.suffix.lower() != ".png" or not path.absolute().parent.is_dir():
        raise UserError(f"--plot {path}: must be a .png file in a folder that exists")
    values, grid = source.read(0), source.grid
    when = f", {source.times[0]}Z" if source.times.size else ""
    title = f"{source.quantity} {source.name}{when}"
    land = shore.land("gshhg", grid.box).polygons
    maps.draw_field(path, grid.lon, grid.lat, values[..., 0], values[..., 1], title=title, polygons=land)


def _print_facts(title: str, facts: dict[str, str]) -> None:
    table = _table("", "")
    table.show_header = False
    _say(title)
    for name, fact in facts.items():
        table.add_row(name, fact)
    _show(table)


def _show(table: Any) -> None:
    from rich.console import Console

    if sys.stdout.isatty():
        Console(highlight=False, markup=False).print(table)
        return
    # A pipe has no width of its own: lines stay whole there, and end where their text does.
    page = io.StringIO()
    Console(file=page, highlight=False, markup=False, width=10_000, color_system=None).print(table)
    _say("\n".join(line.rstrip() for line in page.getvalue().splitlines()).strip("\n"))


def _table(*headings: str) -> Any:
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for heading in headings:
        table.add_column(heading)
    return table


if __name__ == "__main__":
    sys.exit(main())
