"""An allocation as a table: what is told there is what brute arithmetic on the chances gives."""

import csv
import io

import numpy as np
import pytest

from drift.planning.arrays import processing, processing_text, records
from drift.planning.arrays.records import Allocation, Hearing, Names
from drift.products.files import formats, text_sheet

# Two arrays of two beams; a target on the left is heard by the first beam of each, one on the right
# by the second.
CHANCE = np.array([[[0.5, 0, 0.4, 0], [0, 0.3, 0, 0.2]], [[0.25, 0, 0.1, 0], [0, 0.6, 0, 0.1]]])
WEIGHT = np.array([3.0, 1.0])


def made(**more: object) -> tuple[Hearing, Allocation, Names]:
    hearing = records.hearing(CHANCE, WEIGHT, [0, 0, 1, 1], 1, **more)
    names = Names(
        ("SOSUS west", "=cmd()"),
        ("north", "south", "095°", "275°"),
        ("P1",),
        np.array(["2026-06-01T00:00", "2026-06-01T06:00", "2026-06-01T12:00"], "datetime64[s]"),
    )
    return hearing, processing.allocate(hearing), names


def test_the_table_says_what_is_processed_and_what_it_is_worth() -> None:
    hearing, found, names = made()
    text = processing_text.processing_as_text(found, hearing, names, "Four beams", "abc-s1")
    # First slot: left beam, 3 * 0.5 of 4. Second: left would add 3 * 0.5 * 0.25 = 0.375, right 0.6:
    # right.
    assert found.chosen == ((0,), (1,))
    assert "Heard at least once: 0.525; no choice of beams is worth more" in text
    assert "010000ZJUN26  heard by its end: 0.375" in text
    assert "P1: SOSUS west north, gain 0.3750" in text
    assert "010600ZJUN26  heard by its end: 0.525" in text
    assert "P1: SOSUS west south, gain 0.1500  NEW" in text
    # 3 * (1 - 0.5 * 0.75) = 1.875 of 4
    assert "the same beams all the time: 0.469, 0.056 less" in text
    assert "SOSUS west north at 010600ZJUN26 (0.0938)" in " ".join(text.split())  # 0.375 / 4
    assert max(map(len, text.splitlines())) <= text_sheet.WIDE


def test_rows_are_for_programs_and_no_spreadsheet_runs_them() -> None:
    hearing, found, names = made()
    rows = list(csv.DictReader(io.StringIO(processing_text.csv(found, hearing, names, "abc-s1"))))
    assert [
        (row["time"], row["array"], row["beam"], row["gain"], row["heard"]) for row in rows
    ] == [
        ("2026-06-01T00:00:00Z", "SOSUS west", "north", "0.375", "0.375"),
        ("2026-06-01T06:00:00Z", "SOSUS west", "south", "0.15", "0.525"),
    ]
    assert {row["end"] for row in rows} == {"2026-06-01T06:00:00Z", "2026-06-01T12:00:00Z"}
    hearing = records.hearing(CHANCE[:1, :, [2, 0]], WEIGHT, [1, 1], 1)
    found = processing.allocate(hearing)
    assert ",'=cmd()," in processing_text.csv(found, hearing, names, "abc-s1")


def test_what_a_processor_does_that_works_on_nothing() -> None:
    hearing, found, names = made(manned=np.array([[True], [False]]), cost=np.full((2, 4), 2.0))
    text = processing_text.processing_as_text(found, hearing, names, "Four beams", "abc-s1")
    assert "P1: idle: no beam adds anything" in text
    assert "P1: off" in text
    assert "Choices that would add most: no beam." in text
    assert processing_text.csv(found, hearing, names, "x").count("\n") == 1
    hearing, found, names = made(cost=np.full((2, 4), 0.3))
    assert processing_text.worth(found).startswith(
        "Heard at least once: 0.525, 0.375 minus the cost of the beams"
    )


def test_numbers_are_shares_that_json_holds() -> None:
    hearing, found, names = made()
    told = formats.plain(processing_text.summary_of_processing(found, hearing, names))
    assert told["heard"] == pytest.approx(0.525)
    assert told["slots"][1]["beams"] == {"P1": "SOSUS west south"}
    assert told["slots"][1]["time"] == "2026-06-01T06:00:00Z"
    assert told["heard"] <= told["bound"] <= 1


def test_names_by_number() -> None:
    hearing, _, _ = made()
    names = records.names(hearing, np.datetime64("2026-06-01T00:00"), 5400.0)
    assert names.beams == ("beam 1", "beam 2", "beam 1", "beam 2")
    assert processing_text.called(2, hearing, names) == "array 2 beam 1"
    assert names.begins(1) == "010130ZJUN26"
