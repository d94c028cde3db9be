"""Everyday words find classes that exist; search objects are those of the sweep width tables."""

import pytest

from drift.apps.cli import commands
from drift.engine.motion.objects import everyday, leeway
from drift.evidence.filter.detection import sweep_width

NAMES = tuple(leeway.classes())


def found(words: str) -> set[str]:
    return {drifter.name for drifter in leeway.search_classes(words)}


@pytest.mark.parametrize("words", everyday.everyday_words())
def test_every_word_finds_the_classes_that_it_stands_for(words: str) -> None:
    meaning = everyday.classes_of_word(words, NAMES)
    assert meaning is not None
    assert meaning.classes
    assert meaning.classes <= found(words)
    assert everyday.split_words(words) == [words]  # a phrase is one


def test_every_pattern_of_classes_fits_some() -> None:
    for table in ("everyday_words.csv", "search_objects.csv"):
        for row in everyday._rows(table):
            for pattern in row["classes"].split():
                assert everyday._matching(pattern, NAMES), (table, pattern)


def test_no_word_stands_in_two_rows() -> None:
    every = [
        word for row in everyday._rows("everyday_words.csv") for word in row["words"].split("|")
    ]
    assert len(every) == len(set(every))


@pytest.mark.parametrize(
    ("words", "name", "searched"),
    [
        ("kayak", "PERSON-POWERED-VESSEL-1", None),
        ("paddle", "PERSON-POWERED-VESSEL-1", None),
        ("SUP", "PERSON-POWERED-VESSEL-2", None),
        ("surfboard", "PERSON-POWERED-VESSEL-2", None),
        ("canoe", "PERSON-POWERED-VESSEL-1", None),
        ("dinghy", "SAILBOAT-8", "Sail Boat 15ft"),
        ("rubber boat", "LIFE-RAFT-NB-1", "Raft 4 person to Raft 15 person, by capacity"),
        ("RIB", "SKIFF-1", "Power Boat ≤ 15ft to Power Boat 20ft, by length"),
        ("jet-ski", "PWC", "Power Boat ≤ 15ft"),
        ("jet boat", "SKIFF-1", "Power Boat ≤ 15ft to Power Boat 20ft, by length"),
        ("panga", "PANGA-FULL", "Power Boat 20ft"),
        ("migrant boat", "RUBBER-BOAT", None),
        ("pedalo", "SKIFF-2", "Power Boat ≤ 15ft to Power Boat 20ft, by length"),
        ("life jackets", "PIW-2", "Person in Water"),
    ],
)
def test_what_people_lose_has_a_class_and_its_search_object_or_none(
    words: str, name: str, searched: str | None, capsys: pytest.CaptureFixture[str]
) -> None:
    assert name in found(words)
    goes_with = everyday.search_objects(name)
    assert (goes_with and goes_with.words) == searched
    assert commands.main(["objects", *words.split()]) == 0
    printed = " ".join(capsys.readouterr().out.split())
    assert (searched or "no sweep width table fits; give sweep_width instead") in printed


def test_what_no_class_fits_is_described_in_the_case(capsys: pytest.CaptureFixture[str]) -> None:
    assert commands.main(["objects", "drone"]) == 2
    assert 'object = { windage = "3 %" }' in capsys.readouterr().err


def test_words_are_combined_with_those_of_descriptions() -> None:
    assert found("yacht") == {f"SAILBOAT-{k}" for k in (1, 2, 3, 4, 5, 6, "6b", 7)}
    assert found("YACHTS dismasted") == {"SAILBOAT-2", "SAILBOAT-3", "SAILBOAT-4"}
    assert found("man overboard deceased") == {"PIW-6"}
    assert (
        found("raft")
        > found("raft deep ballast")
        == {name for name in NAMES if name.startswith("LIFE-RAFT-DB")}
    )
    assert found("spaceship") == set()


def test_what_was_found_before_is_found_still() -> None:
    """An everyday word adds classes: none is lost whose name or description holds it."""
    for word in everyday.everyday_words():
        held = {
            name
            for name, drifter in leeway.classes().items()
            if word in f"{name} {drifter.description}".lower()
        }
        assert held <= found(word)


def test_search_objects_are_those_of_the_tables() -> None:
    tables = set(sweep_width.objects())
    every = [everyday.search_objects(name) for name in NAMES]
    assert all(set(one.names) <= tables for one in every if one)
    assert set().union(*(one.names for one in every if one)) == tables  # all of them have a class
    assert everyday.search_objects("PIW-3").words == "Person in Water"
    assert everyday.search_objects("LIFE-RAFT-DB-19").names[-1] == "Raft 25 person"
    # the first row that fits counts
    assert everyday.search_objects("SAILBOAT-8").names == ("Sail Boat 15ft",)
    assert everyday.search_objects("MED-WASTE-1") is None
