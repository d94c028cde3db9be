"""Subsets by the Copernicus Marine toolbox, a program of its own (`pip install -e '.[fetch]' where
drift lies`).

It alone knows the user's name and password (`copernicusmarine login`): they never pass through this
process.
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
from geo.files.web import Passing

PROGRAM = "copernicusmarine"
ADVICE = "pip install -e '.[fetch]' where drift lies"
DAY = np.timedelta64(86_400, "s")
SECOND = np.timedelta64(1, "s")
# before and after the span: the longest step of its products
AROUND = np.timedelta64(3 * 3600, "s")
LONGEST = 1800.0  # [s] that the toolbox may work on one part
MEGA = 1e6
CELL = 0.25  # [deg] around the box: its products have 0.083 to 0.2 deg


def ship(order: Order) -> Shipment:
    """Return what an order comes to, a part a day; asks the toolbox for its size.

    Raises UserError or Passing.
    """
    begin, end = order.begin - AROUND, order.end + AROUND
    spans = [(start, min(start + DAY, end) - SECOND) for start in np.arange(begin, end, DAY)]
    said = _told([*_question(order, begin, end - SECOND), "--dry-run"], 20 * order.timeout)
    size = _size(said)
    parts = []
    for start, stop in spans:
        question = _question(order, start, stop)
        key = hashlib.sha256(json.dumps(question).encode()).hexdigest()
        share = size * float((stop - start) / (end - begin))
        parts.append(Part(key, partial(_make, question), None, share))
    notes = () if size else ("the toolbox did not say how large this is",)
    return Shipment(order, tuple(parts), notes)


def _question(order: Order, start: np.datetime64, stop: np.datetime64) -> list[str]:
    provider, box = order.provider, order.box.grown(CELL, CELL)
    words = ["subset", "--dataset-id", provider.dataset]
    for name in provider.variables:
        words += ["--variable", name]
    words += ["--minimum-longitude", f"{box.west:.4f}", "--maximum-longitude", f"{box.east:.4f}"]
    words += ["--minimum-latitude", f"{box.south:.4f}", "--maximum-latitude", f"{box.north:.4f}"]
    words += ["--start-datetime", str(start), "--end-datetime", str(stop)]
    if provider.level is not None:
        # the first layer alone
        words += ["--minimum-depth", "0", "--maximum-depth", f"{2 * provider.level:g}"]
    return [*words, "--coordinates-selection-method", "inside"]


def _make(question: list[str], path: Path) -> None:
    where = [
        "--output-directory",
        str(path.parent),
        "--output-filename",
        path.name,
        "--file-format",
        "netcdf",
    ]
    _told([*question, *where, "--overwrite"], LONGEST)
    if not path.is_file():
        raise Passing(f"{PROGRAM} ended well and wrote nothing")


def _size(said: str) -> float:
    """Return the size that the toolbox tells [bytes], 0 where it tells none."""
    try:
        told = json.loads(said[said.index("{") :])
        number, unit = str(told["file_size"]).split()
        return float(number) * MEGA if unit == "MB" else 0.0
    except (ValueError, KeyError, TypeError):
        return 0.0


def _told(words: list[str], longest: float) -> str:
    """Return what the toolbox prints; bounded in time, and ended with this process's wait."""
    program = shutil.which(PROGRAM) or shutil.which(PROGRAM, path=os.path.dirname(sys.executable))
    if program is None:
        raise UserError(f"this provider needs the program {PROGRAM}, which is not there: {ADVICE}")
    command = [program, *words, "--disable-progress-bar", "--log-level", "ERROR"]
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
                out, trouble = child.communicate(timeout=waiting.POLL)
                break
            except subprocess.TimeoutExpired:
                waiting.heed()
                if time.monotonic() > until:
                    raise Passing(f"{PROGRAM} did not come to an end in {longest:g} s") from None
    finally:
        if child.poll() is None:
            if os.name == "posix":
                os.killpg(child.pid, signal.SIGKILL)
            else:
                child.kill()
            child.communicate()
    if child.returncode == 0:
        return out
    last = " ".join((trouble.strip() or out.strip() or "it said nothing").splitlines()[-1].split())[
        -200:
    ]
    low = f"{trouble} {out}".lower()
    if any(
        word in low for word in ("credential", "password", "username", "log in", "login", "aborted")
    ):
        raise UserError(f"{PROGRAM} asks for credentials: run {PROGRAM} login once")
    if any(
        word in low
        for word in ("exceed", "out of bounds", "outofbounds", "not found", "does not exist")
    ):
        raise UserError(f"{PROGRAM}: {last}")
    raise Passing(f"{PROGRAM} failed ({last})")
