"""Do the tests notice? Small faults are put into the code, one at a time, and the tests that
concern them are run.

    python benchmarks/mutants.py [--only TEXT] [--workers 1] [--done FILE] [--again] [--trust]

The faults are those of mutants.toml: a file, what stands there, what stands there instead, and the
tests that should notice. Each is put into a copy of the checkout. It is killed when a test fails or
does not end in time: first those of the default suite are run, then, where all of them pass, those
of the thorough stage. It survives when all pass. Text that does not stand exactly once in its file
is stale: mend mutants.toml. First all tests must pass without a fault (--trust: they are taken to).

Results are kept in mutants.json beside this file (--done: elsewhere), so that a run can go on
later; a fault that has changed there, or whose tests are others now, is tried again.
"""

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
import tomllib
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from queue import Queue
from typing import Any

import smallest

HERE = Path(__file__).resolve().parent
LIMIT = 900  # [s] for the tests of one fault
# pytest's markers of the stages, in the order in which they are tried
STAGES = {"default": "", "thorough": "thorough"}
PASSED, FAILED, NONE_CHOSEN = 0, 1, 5  # pytest's exit statuses
SETTLED = ("killed", "survived")


def known() -> list[dict[str, Any]]:
    """Return the faults; stop at one whose text is stale."""
    mutants: list[dict[str, Any]] = tomllib.loads(
        (HERE / "mutants.toml").read_text(encoding="utf-8")
    )["mutant"]
    stale = [
        m
        for m in mutants
        if (HERE.parent / m["file"]).read_text(encoding="utf-8").count(m["find"]) != 1
    ]
    if stale:
        sys.exit(
            "\n".join(
                f"stale: {m['file']}: {m['what']}: its text does not stand there exactly once"
                for m in stale
            )
        )
    return mutants


def quick(mutant: dict[str, Any]) -> int:
    """Return how many bytes of tests should notice a fault."""
    return sum((HERE.parent / "tests" / name).stat().st_size for name in mutant["tests"])


def keep(results: dict[str, Any], path: Path) -> None:
    """Write the results, in the order of file and words."""
    ordered = dict(sorted(results.items(), key=lambda item: (item[1]["file"], item[1]["what"])))
    whole = path.with_suffix(".part")
    whole.write_text(json.dumps(ordered, indent=1) + "\n", encoding="utf-8")
    whole.replace(path)


def key(mutant: dict[str, Any]) -> str:
    """Return what names a fault among the results: it is another where its text or its tests are."""
    return json.dumps([mutant[name] for name in ("file", "find", "replace", "tests")])


def passes(tests: list[str], marker: str, copy: Path, data: str) -> tuple[int, str]:
    """Return pytest's exit status for tests on a copy of the checkout, and the first test that
    failed.

    marker: of tests that the default suite leaves out; "" for the default suite.
    """
    command = [
        sys.executable,
        "-m",
        "pytest",
        "-x",
        "-q",
        "--no-header",
        "--tb=no",
        "-p",
        "no:cacheprovider",
    ]
    chosen = ["-m", marker] if marker else []
    done = subprocess.run(
        [*command, *chosen, *(f"tests/{name}" for name in tests)],
        cwd=copy,
        env={
            **os.environ,
            "PYTHONPATH": str(copy),
            "DRIFT_DATA": data,
            "PYTHONDONTWRITEBYTECODE": "1",
        },
        capture_output=True,
        text=True,
        timeout=LIMIT,
    )
    lines = done.stdout.splitlines()
    return done.returncode, next((x for x in lines if x.startswith(("FAILED", "ERROR"))), "")


def tried(mutant: dict[str, Any], copy: Path, data: str) -> dict[str, Any]:
    """Return what became of a fault in a copy of the checkout: a row of the results."""
    file = copy / mutant["file"]
    whole = file.read_text(encoding="utf-8")
    file.write_text(whole.replace(mutant["find"], mutant["replace"]), encoding="utf-8")
    row = {
        "file": mutant["file"],
        "what": mutant["what"],
        "verdict": "survived",
        "stage": "",
        "noticed": "",
    }
    stages = {mutant["marker"]: mutant["marker"]} if "marker" in mutant else STAGES
    begin = time.perf_counter()
    try:
        for stage, marker in stages.items():
            code, noticed = passes(mutant["tests"], marker, copy, data)
            if code not in (PASSED, NONE_CHOSEN):
                row.update(
                    verdict="killed" if code == FAILED else "broken", stage=stage, noticed=noticed
                )
                break
    except subprocess.TimeoutExpired:
        row.update(verdict="killed", stage=stage, noticed="did not end")
    finally:
        file.write_text(whole, encoding="utf-8")
    return {**row, "seconds": round(time.perf_counter() - begin)}


def main() -> None:
    """Try all faults and print what became of each, and the share that was killed."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--only", default="", help="of those whose file or words hold this text")
    options.add_argument("--workers", type=int, default=1)
    options.add_argument(
        "--done", type=Path, default=HERE / "mutants.json", help="results: read first, and added to"
    )
    options.add_argument("--again", action="store_true", help="try those again that survived")
    options.add_argument(
        "--trust",
        action="store_true",
        help="do not see first whether all tests pass without a fault",
    )
    given = smallest.parse(options, only="geo/")
    results: dict[str, Any] = {}
    if given.done.exists():
        results = json.loads(given.done.read_text(encoding="utf-8"))
    everything = known()
    results = {name: row for name, row in results.items() if name in map(key, everything)}
    mutants = [m for m in everything if given.only in f"{m['file']} {m['what']}"]
    if not mutants:
        sys.exit(f"--only {given.only!r}: no fault's file or words hold this text")
    mutants = sorted(mutants, key=quick)[:1] if smallest.ASKED else mutants
    settled = ("killed",) if given.again else SETTLED
    waiting = [m for m in mutants if results.get(key(m), {}).get("verdict") not in settled]
    data = os.environ.get("DRIFT_DATA", str(HERE.parent.parent / "shared" / "data"))
    listed = subprocess.run(
        ["git", "ls-files"], cwd=HERE.parent, capture_output=True, text=True, check=True
    )
    tracked = [name for name in listed.stdout.splitlines() if (HERE.parent / name).is_file()]
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(given.workers) as pool:
        copies: Queue[Path] = Queue()
        for n in range(given.workers):
            copy = Path(folder) / str(n) / "tree"
            for name in tracked:
                (copy / name).parent.mkdir(parents=True, exist_ok=True)
                shutil.copy(HERE.parent / name, copy / name)
            copies.put(copy)

        def one(mutant: dict[str, Any]) -> None:
            copy = copies.get()
            try:
                row = tried(mutant, copy, data)
            finally:
                copies.put(copy)
            results[key(mutant)] = row
            print(
                f"{row['verdict']:8} {row['stage']:8} {row['seconds']:5.0f} s"
                f"  {row['file']}: {row['what']}  {row['noticed'][:90]}",
                flush=True,
            )
            if not smallest.ASKED:
                keep(results, given.done)

        if not given.trust:
            copy = copies.get()
            for name, marker in sorted(
                {(name, m.get("marker", "")) for m in waiting for name in m["tests"]}
            ):
                code, noticed = passes([name], marker, copy, data)
                if code not in (PASSED, NONE_CHOSEN):
                    sys.exit(f"tests/{name} fails without any fault: {noticed}")
            copies.put(copy)
        list(pool.map(one, waiting))
    rows = [(results[key(m)], m.get("why")) for m in mutants]
    for row, why in rows:
        if row["verdict"] != "killed":
            print(f"{row['verdict']}: {row['file']}: {row['what']}" + (f" ({why})" if why else ""))
    stages = Counter(row["stage"] for row, _ in rows if row["verdict"] == "killed")
    killed = ", ".join(f"{stage} {count / len(rows):.1%}" for stage, count in stages.items())
    print(
        f"{len(rows)} faults: {stages.total()} killed, {stages.total() / len(rows):.1%} (by stage: {killed})"
    )


if __name__ == "__main__":
    main()
