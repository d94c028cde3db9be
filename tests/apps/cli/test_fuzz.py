"""A slice of what the fuzzers of benchmarks/ do at length: nothing but lines, whatever is damaged."""

import random
from pathlib import Path

import fuzz_cases
import fuzz_commands
import fuzz_files
import numpy as np
import pytest

from geo.errors import UserError


@pytest.mark.thorough
@pytest.mark.parametrize("first", [pytest.param(20_000, marks=pytest.mark.thorough), 20_040])
def test_mutated_cases_are_refused_in_lines_or_understood(first: int, tmp_path: Path) -> None:
    """Warnings are errors here: none of NumPy's reaches a user either."""
    told: dict[int, tuple[str, ...]] = {}
    for number in range(first, first + 25):
        try:
            fuzz_cases.tried(fuzz_cases.mutated(number)[1], tmp_path, run=False)
        except UserError as error:
            told[number] = error.lines
    assert 0 < len(told) < 25
    assert not [
        n for n, lines in told.items() if any("\n" in line or not line.strip() for line in lines)
    ]


@pytest.mark.thorough
@pytest.mark.parametrize("made", ["packed", "roms", "fvcom", "classic", "checksums"])
def test_damaged_files_are_refused_in_a_line_or_read(made: str, tmp_path: Path) -> None:
    whole = fuzz_files.NETCDF[made](tmp_path / "whole.nc")
    values = fuzz_files.truth(whole)
    told: list[str] = []
    for number in range(8):
        kind, content = fuzz_files.damaged(
            whole.read_bytes(), random.Random(1_000 * len(made) + number)
        )
        path = tmp_path / f"{number}.nc"
        path.write_bytes(content)
        try:
            seen = fuzz_files.truth(path)
        except UserError as error:
            told.append(str(error))
            continue
        same = len(seen) == len(values) and all(
            np.array_equal(a, b, equal_nan=True) for a, b in zip(seen, values, strict=True)
        )
        assert same or made != "checksums", (number, kind)
    assert not [line for line in told if "\n" in line]


@pytest.mark.thorough
def test_odd_options_and_tables_are_refused_in_lines_or_understood(tmp_path: Path) -> None:
    """Two trials of each command; results that stood before an error stand after it."""
    told = []
    for number in range(2 * len(fuzz_commands.COMMANDS)):
        _, given = fuzz_commands.words(number, tmp_path)
        told.append(fuzz_commands.tried(given, tmp_path).partition(":")[0])
    assert {*told} == {"done", "refused"}
