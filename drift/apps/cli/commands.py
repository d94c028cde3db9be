"""The command line `drift`: which command is done, and how the process ends.

Exit status: 0, 1 where a forecast misses what its case expects ([expect]), 2 for the user's errors
(a line each), 1 for ours, 130 when interrupted, 143 when asked to end, 129 when its terminal went.
Nothing heavy is imported before the command that needs it, so that help and lists come at once.
"""

import argparse
import logging
import os
import sys
import tempfile
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
    "export": export.run,
    "fetch": fetch.run,
    "verify": jobs.verify,
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
)  # what libraries say, in errors of all kinds

# what the loader says of one; a bare image lacks Taichi's libX11
NO_LIBRARY = ": cannot open shared object file"


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line and return the exit status."""
    with errors.of_a_command():
        return _run(argv)


def _run(argv: Sequence[str] | None) -> int:
    terminal.open_streams()
    # NumPy's, which a user cannot mend; tests take them as errors.
    warnings.filterwarnings("ignore", category=RuntimeWarning)
    # the map shows a box in its place
    warnings.filterwarnings("ignore", message="Glyph .* missing from font")
    # of a home that cannot be written it warns at length
    logging.getLogger("matplotlib").setLevel(logging.ERROR)
    if os.name == "posix" and not os.environ.get("HOME"):  # Taichi aborts at import without one
        home = os.path.expanduser("~")
        os.environ["HOME"] = home if os.path.isdir(home) else tempfile.gettempdir()
    try:
        with interrupt.ending_cleanly():
            return _dispatch(argv)
    except UserError as error:
        lines = terminal.lines(error)
        for line in lines:
            print(f"drift: {line}", file=sys.stderr)
        return _failed(argv, 2, lines)
    except KeyboardInterrupt:
        print(interrupt.INTERRUPTED, file=sys.stderr)
        return _failed(argv, 130, [interrupt.INTERRUPTED])
    except interrupt.Terminated as asked:
        with suppress(OSError):  # the terminal may have gone
            print(interrupt.TERMINATED, file=sys.stderr, flush=True)
        return _failed(argv, 128 + asked.number, [interrupt.TERMINATED])
    except BrokenPipeError:  # the reader left, as in `drift objects | head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except SystemExit as leaving:  # argparse's --help
        return int(leaving.code or 0)
    except Exception as error:
        if isinstance(error, MemoryError) or any(words in str(error) for words in NO_MEMORY):
            # If a library cannot be loaded, fewer particles do not help.
            fewer = "" if isinstance(error, ImportError | OSError) else "take fewer particles, or "
            why = str(error) or "no more could be allocated"
            words = (
                f"not enough memory ({why}); {fewer}raise the limit (ulimit -v), if there is one"
            )
            print(f"drift: {words}", file=sys.stderr)
            return _failed(argv, 2, [words])
        if isinstance(error, ImportError) and NO_LIBRARY in str(error):
            words = f"a library of the system is missing ({error}); install it, on Debian and Ubuntu libX11 by: apt-get install libx11-6"
            print(f"drift: {words}", file=sys.stderr)
            return _failed(argv, 2, [words])
        traceback.print_exc()
        words = f"an error of drift itself: {type(error).__name__}: {error}"
        print(f"drift: {words}", file=sys.stderr)
        return _failed(argv, 1, [words])


def _failed(argv: Sequence[str] | None, status: int, lines: list[str]) -> int:
    """Return the exit status of a failure, and tell of it as JSON where that was asked for.

    The arguments themselves are looked at, for they may be what is wrong.
    """
    if "--json" in (sys.argv[1:] if argv is None else argv):
        with suppress(UserError, BrokenPipeError):  # of a standard output that takes nothing
            answer.refuse([line.removeprefix("drift: ") for line in lines])
    return status


def _dispatch(argv: Sequence[str] | None) -> int:
    whole = grammar.parser()
    given = whole.parse_args(argv)
    if given.version:
        from importlib.metadata import version

        terminal.say(f"drift {version('casp-drift')}")
        return 0
    if given.print_completion is not None:
        from drift.apps.cli import completion

        terminal.say(completion.script(whole, given.print_completion))
        return 0
    if given.command is None:
        whole.print_help()
        return 0
    told = COMMANDS[given.command](given)
    answer.tell(told, given.command, as_json=given.json, quiet=given.quiet)
    return told.status


def leave() -> None:
    """Run the command line and end the process.

    An interrupted run ends at once, as taking Taichi down takes a second.
    """
    status = main()
    if status in (129, 130, 143):  # all is unwound, nothing is left to write
        for stream in (sys.stdout, sys.stderr):
            with suppress(OSError, ValueError):
                stream.flush()
        os._exit(status)
    sys.exit(status)


if __name__ == "__main__":
    leave()
