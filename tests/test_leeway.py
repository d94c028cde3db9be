"""The leeway table against the published figures and OpenDrift's transcription, where that is at hand."""

import os
from pathlib import Path

import numpy as np
import pytest

from drift import leeway
from geo.errors import UserError

DATA = Path(os.environ.get("DRIFT_DATA", Path(__file__).parents[2] / "shared" / "data"))


def figures(drifter: leeway.Drifter) -> list[float]:
    lines = (drifter.down, drifter.right, drifter.left)
    return [100 * value for line in lines for value in (line.slope, line.offset, line.std)]  # %, cm/s, cm/s


def test_published_figures() -> None:
    # Allen and Plourde 1999, table 8-1, and Breivik and Allen 2008, table 1 for the person in the water.
    assert figures(leeway.find("PIW-1")) == pytest.approx([0.96, 0, 12, 0.54, 0, 9.4, -0.54, 0, 9.4])
    raft = leeway.find("LIFE-RAFT-DB-10")
    assert figures(raft) == pytest.approx([3.52, -2.5, 6.1, 0.62, -3.0, 3.5, -0.45, -0.2, 3.6])
    assert raft.jibes
    assert raft.uses_wind


def test_every_figure_as_transcribed() -> None:
    source = DATA / "leeway" / "OBJECTPROP.DAT"
    if not source.is_file():
        pytest.skip(f"no {source}; set DRIFT_DATA")
    lines = source.read_text().splitlines()
    rows = [(lines[k].split()[0], lines[k + 1], lines[k + 2]) for k in range(0, 255, 3)]
    assert [name for name, _, _ in rows] == list(leeway.classes())
    for name, description, numbers in rows:
        drifter = leeway.find(name)
        assert figures(drifter) == pytest.approx([float(text) for text in numbers.split()], abs=1e-12)
        assert drifter.level == description.strip().count(">")


def test_table_is_whole() -> None:
    assert len(leeway.classes()) == 85
    assert (
        sum(d.left.slope != -d.right.slope or d.left.offset != -d.right.offset for d in leeway.classes().values()) > 15
    )
    assert all(drifter.description for drifter in leeway.classes().values())
    assert not leeway.find("SLDMB").uses_wind  # the datum marker buoy is built to follow the water


def test_error_at_10_metres_per_second_is_the_regressions() -> None:
    line = leeway.find("PIW-3").right
    wind = np.array([0.0, 10.0, 20.0])
    np.testing.assert_allclose(line.slope_std * wind + line.offset_std, line.std * np.array([0.5, 1.0, 1.5]))


def test_find_in_any_case_and_water() -> None:
    assert leeway.find("sailboat-6B").name == "SAILBOAT-6b"
    assert leeway.find("Water") == leeway.WATER
    assert not leeway.WATER.uses_wind


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("LIFERAFT-DB-10", 'nearest is "LIFE-RAFT-DB-10"'),
        ("LIFE-RAFT-DB-99", "nearest is"),
        ("kayak", 'such as "PERSON-POWERED-VESSEL-1"'),
        ("zzzz", "See: drift objects"),
    ],
)
def test_unknown_class_is_refused_with_the_nearest(name: str, words: str) -> None:
    with pytest.raises(UserError, match=words):
        leeway.find(name)


def test_search_takes_every_word_and_looks_at_main_classes() -> None:
    assert [drifter.name for drifter in leeway.search("life raft 15-50 LIGHT")] == ["LIFE-RAFT-DB-19"]
    assert len(leeway.search("")) == 85
    assert leeway.search("raft spaceship") == []
