"""Does a run that is killed again and again end with the files of one that was left in peace?

    python benchmarks/kill_resume.py [CASE] [--set KEY=VALUE ..] [--shards 8] [--kills 10] [--seed
    1]

The case is run once in one piece. Then the same in shards is killed (SIGKILL) at random moments,
each time after up to as long as the run in one piece took, and begun again, over its results where
these stand; the last time it is let end. Prints what each left behind, and what differs in the
files.
"""

import argparse
import random
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import same_files
import smallest


def main() -> None:
    """Run, kill, compare."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("case", nargs="?", default="overdue_boat")
    options.add_argument("--set", action="append", default=[])
    options.add_argument("--shards", type=int, default=8)
    options.add_argument("--kills", type=int, default=10)
    options.add_argument("--seed", type=int, default=1)
    given = smallest.parse(
        options, case=str(smallest.CASE), set=["particles=9000"], shards=3, kills=1
    )
    draw = random.Random(given.seed)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        changes = [part for change in given.set for part in ("--set", change)]

        def command(out: str, *more: str) -> list[str]:
            return [
                sys.executable,
                "-m",
                "drift",
                "run",
                given.case,
                *changes,
                "--out",
                str(folder / out),
                "--quiet",
                *more,
            ]

        begin = time.monotonic()
        subprocess.run(command("whole"), check=True)
        whole = time.monotonic() - begin
        print(f"in one piece: {whole:.1f} s")
        for kill in range(given.kills):
            process = subprocess.Popen(
                command("killed", "--shards", str(given.shards), "--overwrite"),
                stderr=subprocess.DEVNULL,
            )
            wait = draw.uniform(0, whole)
            try:
                process.wait(wait)
                print(f"{kill + 1}: ended by itself with {process.returncode}")
                continue
            except subprocess.TimeoutExpired:
                process.send_signal(signal.SIGKILL)
                process.wait()
            left = folder / ".killed.unfinished"
            kept = len(list(left.glob("shard-*.json")))
            print(
                f"{kill + 1}: killed after {wait:.1f} s; {kept} shards kept, results {'stand' if (folder / 'killed').exists() else 'not there'}"
            )
        subprocess.run(command("killed", "--shards", str(given.shards), "--overwrite"), check=True)
        found = same_files.differences(folder / "whole", folder / "killed")
        print("\n".join(found) or "the same files")
        print(
            f"left behind: {sorted(path.name for path in folder.iterdir() if path.name not in ('whole', 'killed')) or 'nothing'}"
        )
        sys.exit(bool(found))


if __name__ == "__main__":
    main()
