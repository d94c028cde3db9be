"""Numbered trials in a process of their own, seen from outside: one that crashes or hangs is an
outcome, not the end.

A benchmark calls `run`; its own file, started again with `--trials` and their numbers, calls
`trial` for each of them.
"""

import collections
import queue
import subprocess
import sys
import threading
import time
import traceback
import warnings
from collections.abc import Callable, Sequence

from geo.errors import UserError

LIMIT = 180.0  # [s] without a word, after which the process hangs
NEVER = ("more than its lines", "warning", "traceback", "crash", "hang")  # rows that must be 0

Outcomes = dict[int, tuple[str, str]]  # by number: what was tried, and what came of it


def trial(number: int, name: str, make: Callable[[], str]) -> None:
    """Make one trial and print what came of it: what `make` returns, a refusal, a warning or a
    traceback.
    """
    print(f"{number}\t{name}", flush=True)
    begin = time.perf_counter()
    with warnings.catch_warnings(record=True) as seen:
        warnings.simplefilter("always")
        warnings.simplefilter("ignore", DeprecationWarning)
        warnings.simplefilter("ignore", PendingDeprecationWarning)
        try:
            told = make()
        except UserError as error:
            lines = getattr(error, "lines", (str(error),))
            told = (
                f"refused: {error}"
                if not any("\n" in line for line in lines)
                else f"more than its lines: {error!r}"
            )
        except Exception:
            told = f"traceback: {traceback.format_exc()}"
    if seen and not told.startswith("traceback"):
        told = f"warning: {seen[0].category.__name__} {seen[0].message} {seen[0].filename}:{seen[0].lineno}"
    print(f"{number}\t{time.perf_counter() - begin:.1f}\t{' '.join(told.split())}", flush=True)


def run(
    file: str, numbers: Sequence[int], more: Sequence[str] = (), *, told: bool = False
) -> Outcomes:
    """Return what came of numbered trials of a benchmark's file, which is started again where it
    crashes or hangs.

    more: words of its command line besides --trials; told: print every trial, not only what must
    not be.
    """
    outcomes: Outcomes = {}
    left = list(numbers)
    while left:
        command = [sys.executable, file, "--trials", ",".join(map(str, left)), *more]
        process = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
        )
        lines: queue.SimpleQueue[str | None] = queue.SimpleQueue()
        threading.Thread(
            target=lambda p=process, q=lines: [q.put(line) for line in p.stdout] + [q.put(None)],
            daemon=True,
        ).start()
        number, name = left[0], "before it began"
        while True:
            try:
                line = lines.get(timeout=LIMIT)
            except queue.Empty:
                process.kill()
                outcomes[number] = name, "hang"
                break
            if line is None:
                if process.wait() != 0 and number not in outcomes:
                    outcomes[number] = name, f"crash: status {process.returncode}"
                break
            first, *words = line.rstrip("\n").split("\t")
            if not first.isdigit():
                continue  # something else that was printed
            number = int(first)
            if len(words) == 1:
                name = words[0]
            else:
                outcomes[number] = name, words[1]
        if not outcomes.keys() & set(left):
            outcomes[left[0]] = "before it began", f"crash: status {process.returncode}"
        left = [number for number in left if number not in outcomes]
    for number, (name, outcome) in sorted(outcomes.items()):
        if told or outcome.partition(":")[0] in NEVER:
            print(f"{number:5}  {name:28} {outcome[-700:]}", flush=True)
    return outcomes


def table(outcomes: Outcomes) -> bool:
    """Print how often each outcome came, those that must not be at the end; return whether one of
    these came.
    """
    kinds = collections.Counter(told.partition(":")[0] for _, told in outcomes.values())
    print(f"\n{'outcome':36} of {len(outcomes)}")
    for kind in (*sorted(set(kinds) - set(NEVER)), *NEVER):
        print(f"{kind:36} {kinds[kind]:6}{'   (must be 0)' if kind in NEVER else ''}")
    return any(kinds[kind] for kind in NEVER)
