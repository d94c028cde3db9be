"""Chapters: what several topics hand out, joined; against what each hands out by itself."""

import json
from pathlib import Path

from drift.products.files import chapter, writer
from drift.products.files.chapter import OutputBundle

TABLE = {
    "a.txt": lambda one, stamped: f"{one} of {stamped['seed']}",
    "b.txt": lambda one, stamped: one.upper(),
}


def test_a_table_is_bound_to_what_its_topic_has_found() -> None:
    """Each row makes what its function makes of it; two topics of one table do not disturb each
    other.
    """
    first, second = chapter.bind_outputs(TABLE, "salt"), chapter.bind_outputs(TABLE, "ice")
    assert list(first) == list(TABLE)
    assert [make({"seed": "7"}) for make in (*first.values(), *second.values())] == [
        "salt of 7", "SALT", "ice of 7", "ICE"
    ]  # fmt: skip


def test_chapters_become_one_result(tmp_path: Path) -> None:
    """Numbers in the order of the chapters, the last of one name; every file and picture; warnings
    of all in every file.
    """
    drawn: list[str] = []
    run = OutputBundle({"one": 1, "two": 2}, facts={"title": "t", "seed": "7"}, warnings=("first",))
    topic = OutputBundle(
        {"two": 20, "three": 3},
        chapter.bind_outputs(TABLE, "salt"),
        {"c.png": lambda path: drawn.append(path.name)},
    )
    other = OutputBundle(warnings=("second", "third"))
    topic.pictures["c.png"](tmp_path / "by itself.png")

    def draw(path: Path) -> None:
        path.write_bytes(b"ink")

    paths = writer.write(
        tmp_path / "out", [run, topic, other, OutputBundle(pictures={"c.png": draw})]
    )
    assert {path.name for path in paths} == {
        "a.txt",
        "b.txt",
        "c.png",
        "summary.json",
        "manifest.json",
    }
    assert drawn == ["by itself.png"]
    assert (tmp_path / "out" / "a.txt").read_text() == "salt of 7"
    told = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert told["warning"] == "first; second; third"
    assert [(name, told[name]) for name in told if name in ("one", "two", "three")] == [
        ("one", 1),
        ("two", 20),
        ("three", 3),
    ]
    assert (told["title"], told["run_id"][-3:]) == ("t", "-s7")
    paths = writer.write(tmp_path / "calm", [OutputBundle(facts={"seed": "7"})])
    assert "warning" not in json.loads((tmp_path / "calm" / "summary.json").read_text())
