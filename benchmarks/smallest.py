"""The smallest mode of each benchmark: the same work on small numbers, to see in seconds whether it
still runs.

A benchmark gives `parse` the numbers of that mode. What it needs and this machine lacks ends it
with one line: see `lack`. tests/benchmarks/test_smallest.py runs all of them so.
"""

import argparse
import datetime
import json
import os
import platform
import subprocess
import sys
from importlib import util
from pathlib import Path
from typing import Any, NoReturn

WORD = "--smallest"
# a case for it, which needs no data
CASE = Path(__file__).parents[1] / "docs" / "generate" / "small.toml"
ASKED = WORD in sys.argv[1:]


def parse(
    parser: argparse.ArgumentParser, saves: bool = False, **numbers: object
) -> argparse.Namespace:
    """Return what the command line asks for.

    Args:
        parser: of the benchmark's own options.
        saves: whether it takes --json FILE, for `save`.
        numbers: what is taken in the smallest mode where the command line does not say.
    """
    if saves:
        parser.add_argument("--json", type=Path, help="file that receives the figures")
    parser.add_argument(
        WORD, action="store_true", help="small numbers, and seconds: does it still run?"
    )
    if ASKED:
        parser.set_defaults(**numbers)
    return parser.parse_args()


def save(given: argparse.Namespace, measured: dict[str, Any]) -> None:
    """Add figures to the runs in the file of --json, with the day, the commit and the machine."""
    if not given.json:
        return
    earlier = json.loads(given.json.read_text(encoding="utf-8")) if given.json.is_file() else []
    about = {
        "day": datetime.datetime.now(datetime.UTC).date().isoformat(),
        "commit": _commit(),
        "machine": _processor(),
        "cores": os.cpu_count(),
    }
    text = json.dumps([*earlier, {**about, **measured}], indent=1)
    given.json.write_text(text + "\n", encoding="utf-8")


def _commit() -> str:
    """Return the commit that is measured, with a + where files differ from it."""
    words = ["git", "describe", "--always", "--dirty=+", "--exclude=*"]
    told = subprocess.run(words, cwd=CASE.parent, capture_output=True, text=True, check=False)
    return told.stdout.strip() or "no checkout"


def _processor() -> str:
    """Return the name of the processor."""
    listed = Path("/proc/cpuinfo")
    lines = listed.read_text(encoding="utf-8").splitlines() if listed.is_file() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor()


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
