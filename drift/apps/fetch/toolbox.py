"""Subsets by the Copernicus Marine toolbox, a separate program (`pip install -e '.[fetch]'`).

Only the toolbox handles the user's name and password (`copernicusmarine login`): they never pass
through this process.
"""

import hashlib
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import numpy as np

from drift.apps.fetch.order import Order, Part, Shipment
from geo import waiting
from geo.errors import UserError
from geo.files.web import TemporaryError

PROGRAM = "copernicusmarine"
ADVICE = "pip install -e '.[fetch]' in the folder of drift's source"
DAY = np.timedelta64(86_400, "s")
SECOND = np.timedelta64(1, "s")
# before and after the span: the longest time step of its products
AROUND = np.timedelta64(3 * 3600, "s")
LONGEST = 1800.0  # [s] that the toolbox may need for one part
MEGA = 1e6
CELL = 0.25  # [deg] around the box: its products have 0.083 to 0.2 deg


def ship(order: Order) -> Shipment:
    """Return the shipment of an order, a part per day; ask the toolbox for its size.

    Raises UserError or Passing.
    """
    begin, end = order.begin - AROUND, order.end + AROUND
    spans = [(start, min(start + DAY, end) - SECOND) for start in np.arange(begin, end, DAY)]
    printed = _run_toolbox(
        [*_arguments(order, begin, end - SECOND), "--dry-run"], 20 * order.timeout
    )
    size = _size(printed)
    parts = []
    for start, stop in spans:
        arguments = _arguments(order, start, stop)
        key = hashlib.sha256(json.dumps(arguments).encode()).hexdigest()
        share = size * float((stop - start) / (end - begin))
        parts.append(Part(key, partial(_make, arguments), None, share))
    notes = () if size else ("the toolbox did not report the size",)
    return Shipment(order, tuple(parts), notes)


def _arguments(order: Order, start: np.datetime64, stop: np.datetime64) -> list[str]:
    provider, box = order.provider, order.box.grown(CELL, CELL)
    words = ["subset", "--dataset-id", provider.dataset]
    for name in provider.variables:
        words += ["--variable", name]
    words += ["--minimum-longitude", f"{box.west:.4f}", "--maximum-longitude", f"{box.east:.4f}"]
    words += ["--minimum-latitude", f"{box.south:.4f}", "--maximum-latitude", f"{box.north:.4f}"]
    words += ["--start-datetime", str(start), "--end-datetime", str(stop)]
    if provider.level is not None:
        # only the first layer
        words += ["--minimum-depth", "0", "--maximum-depth", f"{2 * provider.level:g}"]
    return [*words, "--coordinates-selection-method", "inside"]


def _make(arguments: list[str], path: Path) -> None:
    target = [
        "--output-directory",
        str(path.parent),
        "--output-filename",
        path.name,
        "--file-format",
        "netcdf",
    ]
    _run_toolbox([*arguments, *target, "--overwrite"], LONGEST)
    if not path.is_file():
        raise TemporaryError(f"{PROGRAM} succeeded but wrote nothing")


def _size(printed: str) -> float:
    """Return the size that the toolbox reports [bytes]; 0 if it reports none."""
    try:
        report = json.loads(printed[printed.index("{") :])
        number, unit = str(report["file_size"]).split()
        return float(number) * MEGA if unit == "MB" else 0.0
    except (ValueError, KeyError, TypeError):
        return 0.0


def _run_toolbox(arguments: list[str], longest: float) -> str:
    """Run the toolbox and return what it prints; it is ended after a time limit or an interrupt."""
    program = shutil.which(PROGRAM) or shutil.which(PROGRAM, path=os.path.dirname(sys.executable))
    if program is None:
        raise UserError(
            f"this provider needs the program {PROGRAM}, which is not installed: {ADVICE}"
        )
    command = [program, *arguments, "--disable-progress-bar", "--log-level", "ERROR"]
    child = subprocess.Popen(
        command,
        stdin=subprocess.DEVNULL,  # it must not ask for a password here
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        errors="replace",
        start_new_session=True,
    )
    until = time.monotonic() + longest
    try:
        while True:
            try:
                out, errors = child.communicate(timeout=waiting.POLL)
                break
            except subprocess.TimeoutExpired:
                waiting.check_wait()
                if time.monotonic() > until:
                    raise TemporaryError(f"{PROGRAM} did not finish within {longest:g} s") from None
    finally:
        if child.poll() is None:
            if os.name == "posix":
                os.killpg(child.pid, signal.SIGKILL)
            else:
                child.kill()
            child.communicate()
    if child.returncode == 0:
        return out
    last = " ".join((errors.strip() or out.strip() or "it said nothing").splitlines()[-1].split())[
        -200:
    ]
    lower_case = f"{errors} {out}".lower()
    if any(
        word in lower_case
        for word in ("credential", "password", "username", "log in", "login", "aborted")
    ):
        raise UserError(f"{PROGRAM} asks for credentials: run {PROGRAM} login once")
    if any(
        word in lower_case
        for word in ("exceed", "out of bounds", "outofbounds", "not found", "does not exist")
    ):
        raise UserError(f"{PROGRAM}: {last}")
    raise TemporaryError(f"{PROGRAM} failed ({last})")
