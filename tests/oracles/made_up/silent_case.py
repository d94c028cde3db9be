"""A case of a raft that states no errors."""

from pathlib import Path

import drift

HEAD = """
start = "2024-03-05T00:00Z"
duration = "3 h"
"""
RAFT = """
[[scenario]]
name = "raft"
object = { windage = "3 %" }
position = { at = "59 00N 004 00E", std = "1 nmi" }
"""


def load(folder: Path, text: str, **changes: str) -> drift.Case:
    (folder / "trial.toml").write_text(text)
    return drift.load(
        folder / "trial.toml", {key.replace("__", "."): value for key, value in changes.items()}
    )
