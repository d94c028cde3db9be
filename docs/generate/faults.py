"""The page about faults put into the code: which the tests notice, from benchmarks/mutants.json."""

import json
import tomllib
from collections import Counter
from typing import Any

from generate import runs

INTRODUCTION = """# Do the tests notice faults?

`benchmarks/mutants.toml` lists {listed:,} small faults: a line of the program, what stands there instead, and the tests that should notice.
`python benchmarks/mutants.py` puts each into a copy of the program and runs those tests: first those of the default suite, then those of the thorough stage.
A fault is killed if a test fails, and survives if all pass. The newest results are of {tried:,} of them.

| stage | kills | share of those tried |
|---|---|---|
| default suite | {default:,} | {default_share:.1%} |
| default and thorough | {killed:,} | {killed_share:.1%} |

Faults of one kind stand together in the list, so neighbours are not independent. Some were found by outsiders who had not read the tests.
"""


def page() -> str:
    """Return the page in Markdown."""
    benchmarks = runs.ROOT / "benchmarks"
    listed = tomllib.loads((benchmarks / "mutants.toml").read_text(encoding="utf-8"))["mutant"]
    held = json.loads((benchmarks / "mutants.json").read_text(encoding="utf-8"))
    rows: list[dict[str, Any]] = list(held.values())
    stages = Counter(row["stage"] for row in rows if row["verdict"] == "killed")
    killed, tried = sum(stages.values()), max(len(rows), 1)
    parts = [
        INTRODUCTION.format(
            listed=len(listed),
            tried=len(rows),
            default=stages["default"],
            default_share=stages["default"] / tried,
            killed=killed,
            killed_share=killed / tried,
        )
    ]
    parts.append("## By package\n\n| package | tried | killed |\n|---|---|---|")
    packages = Counter(_package(row["file"]) for row in rows)
    deaths = Counter(_package(row["file"]) for row in rows if row["verdict"] == "killed")
    parts[-1] += "".join(
        f"\n| `{name}` | {count} | {deaths[name]} |" for name, count in sorted(packages.items())
    )
    survivors = [row for row in rows if row["verdict"] != "killed"]
    parts.append(f"## Survivors\n\n{len(survivors)} faults that no listed test notices:")
    reasons = {(fault["file"], fault["what"]): fault.get("why", "") for fault in listed}
    parts.append("\n".join(_line(row, reasons) for row in survivors) or "None.")
    return "\n\n".join(parts) + "\n"


def _line(row: dict[str, Any], reasons: dict[tuple[str, str], str]) -> str:
    """Return a survivor, and why it may survive where the list says so."""
    why = reasons.get((row["file"], row["what"]), "")
    return f"- `{row['file']}`: {row['what']}{f' ({why})' if why else ''}"


def _package(file: str) -> str:
    return "/".join(file.split("/")[: 2 if file.startswith("drift/") else 1])
