"""Chapters: what several topics hand out, joined; against what each hands out by itself."""

import json
from pathlib import Path

import pytest

from drift.pipeline import flow
from drift.products.files import chapter, writer
from drift.products.files.chapter import OutputBundle
from drift.products.maps.imprint import Imprint, Setting

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


def test_what_is_done_meanwhile_finds_the_files_but_need_not_wait_for_pictures(
    tmp_path: Path,
) -> None:
    """With one process, pictures are drawn last: none is there yet, and every file is."""
    held: list[bool] = []

    def draw(path: Path) -> None:
        held.append((path.parent / "a.txt").exists())
        path.write_bytes(b"ink")

    topic = OutputBundle({}, chapter.bind_outputs(TABLE, "salt"), {"c.png": draw})
    writer.write(tmp_path / "out", [topic, OutputBundle(facts={"seed": "7"})],
                 meanwhile=lambda: held.append(False))  # fmt: skip
    assert held == [False, True]


@pytest.mark.parametrize("fails", [False, True])
def test_the_items_of_a_report_are_made_once_and_cost_no_other_file(
    tmp_path: Path, fails: bool
) -> None:
    """Items that fail, before the page is written and while it is, give one warning."""
    asked: list[str] = []

    def leaves() -> list[object]:
        asked.append("items")
        if fails:
            raise ValueError("no such cell")
        return []

    topic = OutputBundle({"versions": {}}, chapter.bind_outputs(TABLE, "salt"), leaves=(leaves,))
    run = OutputBundle(facts={"seed": "7"})

    def publish() -> set[str]:
        setting = Setting(Imprint("t"))
        flow.publish_outputs(
            tmp_path / "out", [run, topic], setting, overwrite=False, tell=lambda share: None
        )
        return {path.name for path in (tmp_path / "out").iterdir()}

    if fails:
        with pytest.warns(UserWarning, match=r"report\.html could not be drawn \(no such cell\)"):
            names = publish()
        assert "report.html" not in names
    else:
        names = publish()
        assert "report.html" in names
        assert asked == ["items"]
    assert {"a.txt", "b.txt", "summary.json"} <= names
