"""The command line `drift`: dispatch of a command, and the exit status of the process.

Exit status: 0 for success; 1 if a forecast misses its case's [expect], or for an internal error; 2
for a user error (one line each); 130 if interrupted, 143 if terminated, 129 if the terminal closed.
Slow imports wait for the command that needs them, so that help and lists are printed at once.
"""

import argparse
import atexit
import logging
import os
import sys
import tempfile
import threading
import traceback
import warnings
from collections.abc import Callable, Sequence
from contextlib import suppress

from drift.apps.cli import (
    answer,
    bridges,
    experiments,
    export,
    fetch,
    grammar,
    jobs,
    lists,
    reach,
    serve,
    terminal,
)
from drift.apps.cli.answer import Answer
from drift.products.files import interrupt
from geo import errors
from geo.errors import UserError

COMMANDS: dict[str, Callable[[argparse.Namespace], Answer]] = {
    "run": jobs.run,
    "plan": jobs.plan,
    "origin": jobs.origin,
    "compare": jobs.compare,
    "budget": jobs.budget,
    "export": export.run,
    "fetch": fetch.run,
    "verify": jobs.verify,
    "score": jobs.score,
    "fit-errors": jobs.fit_errors,
    "bridge": bridges.bridge,
    "fit-bridge": bridges.fit_bridge,
    "sensor": reach.sensor,
    "experiment": experiments.experiment,
    "track": experiments.track,
    "check": jobs.check,
    "cases": lists.cases,
    "new": lists.new,
    "objects": lists.objects,
    "info": lists.info,
    "serve": serve.run,
}

NO_MEMORY = (
    "emory allocation",
    "failed to map segment",
    "annot allocate memory",
)  # parts of the messages of libraries, which raise errors of several types

# message of the dynamic loader; a minimal container image lacks Taichi's libX11
NO_LIBRARY = ": cannot open shared object file"


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line and return the exit status."""
    with errors.naming_options():
        return _run(argv)


def _run(argv: Sequence[str] | None) -> int:
    terminal.open_streams()
    # NumPy's RuntimeWarnings are of no use to a user; the tests turn them into errors.
    warnings.filterwarnings("ignore", category=RuntimeWarning)
    # the map shows a box in place of a missing glyph
    warnings.filterwarnings("ignore", message="Glyph .* missing from font")
    # Matplotlib warns at length about a home folder that is not writable
    logging.getLogger("matplotlib").setLevel(logging.ERROR)
    if os.name == "posix" and not os.environ.get("HOME"):  # Taichi aborts at import without one
        home = os.path.expanduser("~")
        os.environ["HOME"] = home if os.path.isdir(home) else tempfile.gettempdir()
    try:
        with interrupt.ending_cleanly():
            return _dispatch(argv)
    except UserError as error:
        lines = terminal.printable_error_lines(error)
        for line in lines:
            print(f"drift: {line}", file=sys.stderr)
        return _failed(argv, 2, lines)
    except KeyboardInterrupt as request:
        return _interrupted(argv, 130, interrupt.INTERRUPTED, request)
    except interrupt.Terminated as request:
        return _interrupted(argv, 128 + request.number, interrupt.TERMINATED, request)
    except BrokenPipeError:  # the reader closed the pipe, as in `drift objects | head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except SystemExit as exit_request:  # argparse's --help
        return int(exit_request.code or 0)
    except Exception as error:
        if isinstance(error, MemoryError) or any(message in str(error) for message in NO_MEMORY):
            # Fewer particles do not help if a library cannot be loaded.
            fewer = "" if isinstance(error, ImportError | OSError) else "take fewer particles, or "
            why = str(error) or "no more could be allocated"
            message = (
                f"not enough memory ({why}); {fewer}raise the limit (ulimit -v), if there is one"
            )
            print(f"drift: {message}", file=sys.stderr)
            return _failed(argv, 2, [message])
        if isinstance(error, ImportError) and NO_LIBRARY in str(error):
            message = (
                f"a library of the system is missing ({error}); install it, on Debian and "
                "Ubuntu libX11 by: apt-get install libx11-6"
            )
            print(f"drift: {message}", file=sys.stderr)
            return _failed(argv, 2, [message])
        traceback.print_exc()
        message = f"internal error in drift: {type(error).__name__}: {error}"
        print(f"drift: {message}", file=sys.stderr)
        return _failed(argv, 1, [message])


def _interrupted(
    argv: Sequence[str] | None, status: int, message: str, request: BaseException
) -> int:
    """Return the exit status of an interrupt; say so, with what the run has kept."""
    line = "; ".join([message, *getattr(request, "__notes__", ())])
    with suppress(OSError):  # the terminal may be closed
        print(line, file=sys.stderr, flush=True)
    return _failed(argv, status, [line])


def _failed(argv: Sequence[str] | None, status: int, lines: list[str]) -> int:
    """Return the exit status of a failure; with --json also print the error as JSON.

    `--json` is looked for in the raw arguments, as parsing them may be what failed.
    """
    if "--json" in (sys.argv[1:] if argv is None else argv):
        with suppress(UserError, BrokenPipeError):  # standard output may be closed
            answer.print_json_errors([line.removeprefix("drift: ") for line in lines])
    return status


def _dispatch(argv: Sequence[str] | None) -> int:
    root = grammar.parser()
    args = root.parse_args(argv)
    if args.version:
        from importlib.metadata import version

        terminal.print_line(f"drift {version('casp-drift')}")
        return 0
    if args.print_completion is not None:
        from drift.apps.cli import completion

        terminal.print_line(completion.script(root, args.print_completion))
        return 0
    if args.command is None:
        root.print_help()
        return 0
    result = COMMANDS[args.command](args)
    answer.print_answer(result, args.command, as_json=args.json, quiet=args.quiet)
    return result.status


def leave() -> None:
    """Run the command line and end the process.

    A run skips the interpreter's shutdown, which frees its objects one by one and takes a second.
    """
    status = main()
    if status in (129, 130, 143):  # everything is cleaned up, nothing is left to write
        for stream in (sys.stdout, sys.stderr):
            with suppress(OSError, ValueError):
                stream.flush()
        os._exit(status)
    if _closed():
        os._exit(status)
    sys.exit(status)


def _closed() -> bool:
    """Do what a shutdown would do for files; return whether the process may end without one."""
    used = sys.modules.get("kernels.runtime.runtime")
    others = (one for one in threading.enumerate() if one is not threading.main_thread())
    if used is None or not all(one.daemon for one in others):
        return False
    atexit._run_exitfuncs()
    try:
        sys.stdout.flush()
        sys.stderr.flush()
    except (OSError, ValueError):  # the interpreter reports it
        return False
    return bool(used.close())


if __name__ == "__main__":
    leave()
