"""Do the tests notice? Small faults are put into the code one at a time, and the tests of their room are run; prints one table.

    python benchmarks/mutants.py [--only TEXT] [--workers 1] [--done FILE] [--trust]

The faults are those of mutants.toml: a file, what stands there, what stands there instead, and the tests that should notice. Each runs on
a copy of the checkout. A fault is killed when a test fails (or does not end in time), and survives when all pass. Text that
does not stand exactly once in its file is stale: mend mutants.toml. First all tests must pass without a fault (--trust: they are taken
to). --done keeps results, so that a run can go on later.
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
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from queue import Queue
from typing import Any

import smallest

HERE = Path(__file__).resolve().parent
PARTS = (
    "drift",
    "geo",
    "kernels",
    "cases",
    "tests",
    "benchmarks",
    "docs",
    "pyproject.toml",
    "README.md",
    "CHANGELOG.md",
)
LIMIT = 900  # [s] for the tests of one fault


def known() -> list[dict[str, Any]]:
    """Return the faults; stop at one whose text is stale."""
    mutants: list[dict[str, Any]] = tomllib.loads((HERE / "mutants.toml").read_text(encoding="utf-8"))["mutant"]
    stale = [m for m in mutants if (HERE.parent / m["file"]).read_text(encoding="utf-8").count(m["find"]) != 1]
    if stale:
        sys.exit(
            "\n".join(f"stale: {m['file']}: {m['what']}: its text does not stand there exactly once" for m in stale)
        )
    return mutants


def quick(mutant: dict[str, Any]) -> int:
    """Return how many bytes of tests should notice a fault."""
    return sum((HERE.parent / "tests" / name).stat().st_size for name in mutant["tests"])


def passes(tests: list[str], marker: str, copy: Path, data: str) -> tuple[int, str]:
    """Return the exit code of tests on a copy of the checkout, up to the first that fails, and which that is.

    marker: of tests that the suite leaves out; none by default.
    """
    chosen = ["-m", marker] if marker else []
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-x", "-q", "--no-header", "--tb=no", "-p", "no:cacheprovider", *chosen, *(f"tests/{name}" for name in tests)],
        cwd=copy, env={**os.environ, "PYTHONPATH": str(copy), "DRIFT_DATA": data, "PYTHONDONTWRITEBYTECODE": "1"},
        capture_output=True, text=True, timeout=LIMIT,
    )  # fmt: skip
    return done.returncode, next((x for x in done.stdout.splitlines() if x.startswith(("FAILED", "ERROR"))), "")


def tried(mutant: dict[str, Any], copy: Path, data: str) -> tuple[str, float, str]:
    """Return what became of a fault in a copy of the checkout, how long that took [s], and which test noticed it."""
    file = copy / mutant["file"]
    whole = file.read_text(encoding="utf-8")
    file.write_text(whole.replace(mutant["find"], mutant["replace"]), encoding="utf-8")
    begin = time.perf_counter()
    try:
        code, noticed = passes(mutant["tests"], mutant.get("marker", ""), copy, data)
        verdict = {0: "survived", 1: "killed"}.get(code, "broken")
    except subprocess.TimeoutExpired:
        verdict, noticed = "killed", "did not end"
    finally:
        file.write_text(whole, encoding="utf-8")
    return verdict, time.perf_counter() - begin, noticed


def main() -> None:
    """Try all faults and print what became of each, and the share that was killed."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--only", default="", help="of those whose file or words hold this text")
    options.add_argument("--workers", type=int, default=1)
    options.add_argument("--done", type=Path, help="JSON file of results: read first, and added to")
    options.add_argument("--again", action="store_true", help="try those again that survived")
    options.add_argument("--trust", action="store_true", help="do not see first whether all tests pass without a fault")
    given = smallest.parse(options, only="geo/")
    results: dict[str, Any] = {}
    if given.done and given.done.exists():
        results = json.loads(given.done.read_text())
    mutants = [m for m in known() if given.only in f"{m['file']} {m['what']}"]
    mutants = sorted(mutants, key=quick)[:1] if smallest.ASKED else mutants
    keys = [json.dumps([m["file"], m["find"], m["replace"]]) for m in mutants]
    settled = {"killed"} if given.again else {"killed", "survived", "broken"}
    waiting = [(k, m) for k, m in zip(keys, mutants, strict=True) if results.get(k, [""])[0] not in settled]
    data = os.environ.get("DRIFT_DATA", str(HERE.parent.parent / "shared" / "data"))
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(given.workers) as pool:
        copies: Queue[Path] = Queue()
        for n in range(given.workers):
            copy = Path(folder) / str(n) / "tree"
            copy.mkdir(parents=True)
            for part in PARTS:
                source = HERE.parent / part
                if source.is_dir():
                    shutil.copytree(source, copy / part, ignore=shutil.ignore_patterns("__pycache__"))
                elif source.exists():
                    shutil.copy(source, copy / part)
            copies.put(copy)

        def one(item: tuple[str, dict[str, Any]]) -> None:
            key, mutant = item
            copy = copies.get()
            try:
                verdict, seconds, noticed = tried(mutant, copy, data)
            finally:
                copies.put(copy)
            results[key] = [verdict, noticed]
            print(f"{verdict:8} {seconds:5.0f} s  {mutant['file']}: {mutant['what']}  {noticed[:90]}", flush=True)
            if given.done:
                given.done.write_text(json.dumps(results, indent=1))

        if not given.trust:
            copy = copies.get()
            for name, marker in sorted({(name, m.get("marker", "")) for _, m in waiting for name in m["tests"]}):
                code, noticed = passes([name], marker, copy, data)
                if code != 0:
                    sys.exit(f"tests/{name} fails without any fault: {noticed}")
            copies.put(copy)
        list(pool.map(one, waiting))
    verdicts = [results[key][0] for key in keys]
    for key, mutant in zip(keys, mutants, strict=True):
        if results[key][0] != "killed":
            print(
                f"{results[key][0]}: {mutant['file']}: {mutant['what']}"
                + (f" ({mutant['why']})" if "why" in mutant else "")
            )
    print(f"{len(mutants)} faults: {verdicts.count('killed')} killed, {verdicts.count('survived')} survived, "
          f"{verdicts.count('broken')} broken: {verdicts.count('killed') / max(len(mutants), 1):.0%} killed")  # fmt: skip


if __name__ == "__main__":
    main()
