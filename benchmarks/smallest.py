"""The smallest mode of each benchmark: the same work on small numbers, to see in seconds whether it
still runs.

A benchmark gives `parse` the numbers of that mode. What it needs and this machine lacks ends it
with one line: see `lack`. tests/benchmarks/test_smallest.py runs all of them so.
"""

import argparse
import os
import sys
from importlib import util
from pathlib import Path
from typing import NoReturn

WORD = "--smallest"
# a case for it, which needs no data
CASE = Path(__file__).parents[1] / "docs" / "generate" / "small.toml"
ASKED = WORD in sys.argv[1:]


def parse(parser: argparse.ArgumentParser, **numbers: object) -> argparse.Namespace:
    """Return what the command line asks for; numbers: what is taken in the smallest mode where it
    does not say.
    """
    parser.add_argument(
        WORD, action="store_true", help="small numbers, and seconds: does it still run?"
    )
    if ASKED:
        parser.set_defaults(**numbers)
    return parser.parse_args()


def lack(what: str) -> NoReturn:
    """End with one line that says what is missing: in the smallest mode, which asks for what this
    machine can, well.
    """
    print(f"left out: {what}")
    sys.exit(not ASKED)


def need(*modules: str) -> None:
    """End with one line where one of these modules is not installed."""
    for name in modules:
        if util.find_spec(name) is None:
            lack(f"{name} is not installed")


def data() -> Path:
    """Return the folder of real forcing; end with one line where there is none."""
    folder = Path(os.environ.get("DRIFT_DATA", ""))
    if not (os.environ.get("DRIFT_DATA") and folder.is_dir()):
        lack("no real forcing: set DRIFT_DATA")
    return folder
