"""What a hundred servers that answer wrongly do to us: a line, a traceback, a crash or a hang.

Each answer is a good one, damaged in one of many ways (`tests/hostile.py`), the same for the same seed. All slices are
read, as `drift info` does. A crash or a hang of the process that reads is seen from outside it; with --direct the
netCDF library works in that process, as it would without `geo.address`. The last three rows must be 0.

python benchmarks/fuzz_server.py [--answers 100] [--seed 0] [--direct]
"""

import argparse
import collections
import queue
import subprocess
import sys
import threading
import time
import traceback
from pathlib import Path

TIMEOUT = 2.0  # [s] of a source
LIMIT = 120.0  # [s] without a word from the process that reads, after which it hangs
ROWS = ("read as if nothing were wrong", "one line", "traceback", "crash", "hang")


def read_all(first: int, last: int, direct: bool) -> None:
    """Read answers of hostile servers and print what came of each."""
    sys.path[:0] = [str(Path(__file__).parents[1] / "tests"), str(Path(__file__).parents[1])]
    import hostile

    from geo import address, forcing
    from geo.errors import UserError

    if direct:
        import xarray as xr

        plain = {"decode_times": False, "decode_coords": False, "cache": False}
        address.open_dataset = lambda url, timeout: xr.open_dataset(url, decode_timedelta=False, **plain)
    sea = hostile.sea()
    for seed in range(first, last):
        name, answer = hostile.mutated(sea, seed)
        print(f"{seed}\t{name}", flush=True)
        with hostile.serving(answer) as url:
            begin = time.perf_counter()
            try:
                source = forcing.open_source("current", url, timeout=TIMEOUT)
                for i in range(len(source.times)):
                    source.read(i)
                told = ROWS[0]
            except UserError as error:
                told = f"{ROWS[1]}: {error}" if "\n" not in str(error) else f"traceback: {error}"
            except Exception:
                told = f"traceback: {traceback.format_exc()}"
        print(f"{seed}\t{time.perf_counter() - begin:.1f}\t{' '.join(told.split())}", flush=True)


def watched(first: int, last: int, direct: bool) -> dict[int, tuple[str, str]]:
    """Return name and outcome of each answer, starting the process that reads anew where it crashes or hangs."""
    outcomes: dict[int, tuple[str, str]] = {}
    while first < last:
        command = [sys.executable, __file__, "--from", str(first), "--to", str(last), *(["--direct"] if direct else [])]
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
        lines: queue.SimpleQueue[str | None] = queue.SimpleQueue()
        threading.Thread(target=lambda p=process, q=lines: [q.put(line) for line in p.stdout] + [q.put(None)]).start()
        name = "before the first"
        while True:
            try:
                line = lines.get(timeout=LIMIT)
            except queue.Empty:
                process.kill()
                outcomes[first] = name, "hang"
                break
            if line is None:
                if process.wait() != 0:
                    outcomes[first] = name, f"crash: status {process.returncode}"
                break
            seed, *words = line.rstrip("\n").split("\t")
            first = int(seed)
            if len(words) == 1:
                name = words[0]
            else:
                outcomes[first] = name, words[1]
                print(f"{first:4} {words[0]:>5} s  {name:24} {words[1][:180]}", flush=True)
        if first in outcomes and outcomes[first][1].startswith(("hang", "crash")):
            print(f"{first:4}          {name:24} {outcomes[first][1]}", flush=True)
        first += 1
    return outcomes


def main() -> None:
    """Run and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--answers", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0, help="of the first answer")
    parser.add_argument("--direct", action="store_true", help="let the library work in the process that reads")
    parser.add_argument("--from", dest="first", type=int, help=argparse.SUPPRESS)
    parser.add_argument("--to", dest="last", type=int, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.first is not None:
        read_all(given.first, given.last, given.direct)
        return
    outcomes = watched(given.seed, given.seed + given.answers, given.direct)
    kinds = collections.Counter(told.split(":")[0] for _, told in outcomes.values())
    print(f"\n{'outcome':32} of {len(outcomes)}")
    for row in ROWS:
        print(f"{row:32} {kinds[row]:5}")


if __name__ == "__main__":
    main()
