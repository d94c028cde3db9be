"""Is a folder of results ever a mixture of two runs? Runs with --overwrite are killed (SIGKILL) at
random moments.

Most are a stand-in that publishes files of the size of a real run's; most of its kills fall into
the publication. A few are the real command. After each kill the folder is read as a reader does,
and what is in it is held against what the old run left and what the new one would have written,
without our code. Then a run that is left alone must leave no hidden folder.

    python benchmarks/kill_overwrite.py [--kills 50] [--real 6] [--seed 1]

Exits 1 if a folder was a mixture, or lost.
"""

import argparse
import hashlib
import random
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

import smallest

# [bytes]
SIZES = {
    "forecast.nc": 6_000_000,
    "particles.nc": 900_000,
    "map.png": 700_000,
    "snapshots.png": 1_500_000,
    "contours.geojson": 400_000,
    "track.csv": 4_000,
    "ashore.csv": 60_000,
    "summary.json": 30_000,
}
OUTCOMES = ("old whole", "new whole", "mixture", "lost")
# When it is killed: the file whose appearance counts, the longest time after it [s], how often
MOMENTS = (
    ("", 1.0, 1),
    ("new/summary.json", 0.3, 2),
    ("journal.json", 0.01, 4),
    ("old/manifest.json", 0.003, 4),
)
REAL = 5.0 if smallest.ASKED else 30.0  # [s] of a real run
RUN_ID = re.compile(rb"[0-9a-f]{10}-s\d+")


def files(seed: int) -> dict[str, bytes]:
    """Return what the stand-in writes: every file is full of its run's name."""
    run = f"{hashlib.sha256(b'%d' % seed).hexdigest()[:10]}-s{seed} ".encode()
    sizes = {**SIZES, f"only_{seed}.csv": 50_000}
    return {
        name: (f"{name} ".encode() + run * (size // len(run) + 1))[:size]
        for name, size in sizes.items()
    }


def stand_in(folder: Path, seed: int) -> None:
    """Publish files of a real run's size."""
    from drift.products.files import manifest, publication

    made = files(seed)
    publication.check(folder, True, [*made, manifest.NAME])
    with publication.staged(folder) as stage:
        for name, data in made.items():
            (stage.new / name).write_bytes(data)
        publication.publish(stage, RUN_ID.search(made["track.csv"])[0].decode(), overwrite=True)


def command(folder: Path, seed: int, real: bool) -> list[str]:
    """Return the words that start a run."""
    if real:
        name = str(smallest.CASE) if smallest.ASKED else "overdue_boat"
        case = [
            "-m",
            "drift",
            "run",
            name,
            "--set",
            "particles=2000",
            "--set",
            "output.every='12 h'",
        ]
        return [sys.executable, *case, "--overwrite", "--seed", str(seed), "--out", str(folder)]
    return [sys.executable, __file__, "--publish", str(folder), "--seed", str(seed)]


def kill(words: list[str], folder: Path, mark: str, delay: float) -> None:
    """Start a run and kill it a time [s] after a file that its hidden folder holds has appeared; at
    once after no mark.
    """
    with subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as running:
        while mark and running.poll() is None and not list(folder.glob(f".drift-partial-*/{mark}")):
            time.sleep(2e-4)  # [s] else it takes a core from the run
        time.sleep(delay)
        running.send_signal(signal.SIGKILL)


def contents(folder: Path) -> dict[str, bytes]:
    """Return the files of runs in a folder, but for manifests."""
    names = {"notes.txt", "link.csv", "manifest.json"}
    return {
        path.name: path.read_bytes()
        for path in folder.iterdir()
        if path.is_file() and path.name not in names
    }


def judged(folder: Path, old: dict[str, bytes], seed: int, real: bool) -> str:
    """Return the outcome of a kill, after what a reader does."""
    import drift

    try:
        told = {path.name for path in drift.results(folder)} - {"manifest.json"}
    except drift.UserError as error:
        print(f"    {error}")
        return "mixture" if contents(folder) else "lost"
    found = contents(folder)
    if told != set(found):
        return "mixture"
    if found == old:
        return "old whole"
    if not real:
        return "new whole" if found == files(seed) else "mixture"
    # A table without a row names no run; in a picture a number may follow that begins with a digit.
    runs = [run for data in found.values() for run in RUN_ID.findall(data)]
    ours = re.compile(rb"[0-9a-f]{10}-s%d" % seed)
    return (
        "new whole" if set(found) == set(old) and runs and all(map(ours.match, runs)) else "mixture"
    )


def trial(folder: Path, kills: int, real: bool, dice: random.Random) -> Counter[str]:
    """Return how often which outcome followed, of kills of runs on one folder."""
    folder.mkdir(exist_ok=True)
    (folder / "notes.txt").write_text("mine")
    (folder / "map.png.d").mkdir(exist_ok=True)
    (folder / "link.csv").symlink_to("notes.txt")
    found: Counter[str] = Counter()
    subprocess.run(command(folder, 1, real), stdout=subprocess.DEVNULL, check=True)
    for number in range(kills):
        old, seed = contents(folder), number + 2
        mark, longest, _ = dice.choices(MOMENTS, [often for *_, often in MOMENTS])[0]
        kill(
            command(folder, seed, real),
            folder,
            mark,
            dice.uniform(0, longest if mark or not real else REAL),
        )
        during = len(list(folder.glob(".drift-partial-*/journal.json")))
        outcome = judged(folder, old, seed, real)
        mine = (folder / "notes.txt").read_text() == "mine" and (folder / "link.csv").is_symlink()
        found[outcome] += 1
        found["in the middle of the renames"] += during
        found["the user's things changed"] += not (mine and (folder / "map.png.d").is_dir())
    subprocess.run(command(folder, kills + 2, real), stdout=subprocess.DEVNULL, check=True)
    found["hidden folders after the next run"] += len(
        [*folder.glob(".drift-*"), *folder.parent.glob(".drift-*")]
    )
    return found


def main() -> None:
    """Print a table of outcomes."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--kills", type=int, default=50)
    parser.add_argument("--real", type=int, default=6, help="of them with the real command")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--publish", type=Path, help=argparse.SUPPRESS)
    given = smallest.parse(parser, kills=2, real=1)
    if given.publish:
        stand_in(given.publish, given.seed)
        return
    dice = random.Random(given.seed)
    rows = {}
    with tempfile.TemporaryDirectory() as ground:
        for name, kills, real in (
            ("stand-in", given.kills - given.real, False),
            ("drift run", given.real, True),
        ):
            if kills > 0:
                rows[name] = trial(Path(ground) / name.replace(" ", "-"), kills, real, dice)
    others = (
        "in the middle of the renames",
        "the user's things changed",
        "hidden folders after the next run",
    )
    print(f"{'':36}" + "".join(f"{name:>12}" for name in rows))
    for row in (*OUTCOMES, *others):
        print(f"{row:36}" + "".join(f"{found[row]:12}" for found in rows.values()))
    sys.exit(any(found["mixture"] or found["lost"] for found in rows.values()))


if __name__ == "__main__":
    main()
