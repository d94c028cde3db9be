"""What is told of a spill's finds: each that is odd, and the silence besides them, wherever results
are read.
"""

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from spills import case_of

import drift
from drift.apps.cli import outcome
from drift.spills.worlds import renewal, verdict

PAINTS = False
FINDS = """
[spill.reporting]
rate = { wild = "0.5 /day" }
[[find]]
name = "one"
at = [0.0, 0.05]
time = "+40 h"
[[find]]
name = "stray"
at = [0.0, -1.0]
time = "+44 h"
false = 0.1
[[find]]
name = "far"
at = [0.0, -0.9]
time = "+46 h"
"""


@pytest.fixture(scope="module")
def told(tmp_path_factory: pytest.TempPathFactory) -> tuple[drift.Result, Path]:
    folder = tmp_path_factory.mktemp("verdict")
    case = case_of(folder, FINDS, worlds=100, per_world=60)
    text = case.path.read_text().replace("[spill]", "[spill]\nredraws = 0", 1)
    case.path.write_text(text)
    return drift.run(drift.load(case.path), folder / "out"), folder / "out"


def summary(folder: Path) -> Any:
    return json.loads((folder / "summary.json").read_text())


@pytest.mark.thorough
def test_every_odd_find_is_a_warning_wherever_warnings_stand(told, tmp_path: Path) -> None:
    result, folder = told
    warnings = result.summary["warnings"]
    for name, place, verdict_on_it in (
        ("stray", "01-00.0S 000-00.0E", "not from this spill: "), ("far", "00-54.0S 000-00.0E", "counted as from this spill"),
    ):  # fmt: skip
        (words,) = (line for line in warnings if f'"{name}"' in line)
        assert place in words
        assert verdict_on_it in words
        assert "is unlikely" in words
        assert (
            "chance of a find there was 0 %, there or at less likely places 0 %" in words
        )  # it is exactly 0
        assert any(
            line == words for line in outcome.summary_of_outcome(summary(folder))["warnings"]
        )
        assert words in summary(folder)["spill"]["warning"]
        assert words in drift.export(folder, "kml", tmp_path / f"kml-{name}")[0].read_text()
        assert json.dumps(words)[1:-1] in (folder / "report.html").read_text()
    assert not any('"one"' in line for line in warnings)


@pytest.mark.thorough
def test_finds_stand_in_a_table_of_their_own(told) -> None:
    _, folder = told
    with open(folder / "finds.csv", newline="", encoding="utf-8") as file:
        rows = {row["name"]: row for row in csv.DictReader(file)}
    assert list(rows) == ["one", "stray", "far"]
    assert [row["odd"] for row in rows.values()] == ["no", "yes", "yes"]
    assert float(rows["stray"]["none_of_ours"]) > 0.9 > 0 == float(rows["far"]["none_of_ours"])
    assert rows["stray"]["time"] == "2026-11-22T20:00:00Z"
    facts = outcome.spill(summary(folder))
    assert "not from this spill: " in facts['find 2 "stray"']
    assert "counted as from this spill" in facts['find 3 "far"']
    assert [find["name"] for find in outcome.summary_of_outcome(summary(folder))["finds"]] == list(
        rows
    )


@pytest.mark.thorough
def test_that_silence_is_evidence_is_told_where_the_figures_stand(
    told, monkeypatch, tmp_path: Path
) -> None:
    from matplotlib.figure import Figure

    from drift.spills.worlds.products import chapter

    result, folder = told
    words = renewal.silence_of_spill(result.aftermath)
    assert words is not None
    assert "no other reports until 222200ZNOV26 (the last find or patrol)" in words
    assert outcome.spill(summary(folder))["assumed"] == words
    assert words in (folder / "report.html").read_text()
    written: list[str] = []
    draw = Figure.text
    monkeypatch.setattr(
        Figure,
        "text",
        lambda self, x, y, s, *a, **k: written.append(s) or draw(self, x, y, s, *a, **k),
    )
    chapter.PICTURES["washup.png"](
        chapter.SpillOutputs(result.aftermath, result.setting), tmp_path / "washup.png"
    )
    assert any(words in line for line in written)
    assert all(f'"{name}"' in " ".join(written) for name in ("stray", "far"))


def test_without_finds_and_patrols_silence_says_nothing(told) -> None:
    after = told[0].aftermath
    spill = after.spill.__class__(**{**vars(after.spill), "finds": ()})
    assert verdict.silence_in_words(after.period, spill, 0.0) is None


def test_a_range_is_told_before_the_mean_and_its_own_error(told) -> None:
    result, folder = told
    facts = outcome.spill(summary(folder))
    data = result.washup.isel(time=-1).sel(fate="ashore")
    low, _, high = data["total_number"].values
    mean, error = float(data["total"]), float(data["total_se"])
    assert facts["ashore"] == (
        f"{low:.0f} to {high:.0f} objects (10 to 90 %), mean {mean:.1f} +- {error:.2g} (sampling)"
    )
    assert np.isclose(result.summary["spill"]["totals"]["ashore"]["number_90"], high)


def test_stretches_are_named_by_towns_and_ranked_by_the_kilometre(told) -> None:
    """The nearest is the list's nearest by the great circle, and far away at 0 N, 0 E."""
    from drift.products.maps import gazetteer
    from drift.products.maps.gazetteer import Near
    from geo import sphere

    _, folder = told
    with open(folder / "washup.csv", newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    for row in rows:
        dense = float(row["expected"]) / float(row["length_km"])
        assert float(row["expected_per_km"]) == pytest.approx(dense, rel=2e-5, abs=1e-9)
        assert float(row["near_km"]) > 400
        assert row["near"]
    ranks = [
        int(row["rank_per_km"])
        for row in sorted(rows, key=lambda row: -float(row["expected_per_km"]))
    ]
    assert ranks == list(range(1, len(rows) + 1))
    names, lons, lats, _, _ = gazetteer._all()
    rng = np.random.default_rng(4)
    lon, lat = rng.uniform(-10, 6, 40), rng.uniform(36, 60, 40)
    for x, y, near in zip(lon, lat, gazetteer.nearest_towns(lon, lat), strict=True):
        a, b, east = np.radians(y), np.radians(lats), np.radians(lons - x)
        cos = np.sin(a) * np.sin(b) + np.cos(a) * np.cos(b) * np.cos(east)
        distance = sphere.RADIUS * np.arccos(np.clip(cos, -1, 1))
        k = int(np.argmin(distance))
        assert near.away == pytest.approx(distance[k], abs=1.0)
        assert near.name == names[k]
    assert gazetteer.place_in_words(Near("Viana", 9_400)) == "near Viana"
    assert gazetteer.place_in_words(Near("Viana", 34_400)) == "34 km from Viana"
    assert gazetteer.place_in_words(Near("Utrik", 2_068_000)) == ""


def test_finds_and_washup_go_along_to_other_programs(told, tmp_path: Path) -> None:
    _, folder = told
    (kml,) = (
        path for path in drift.export(folder, "kml", tmp_path / "kml") if path.suffix == ".kml"
    )
    text = kml.read_text()
    assert "<name>find 2 stray (odd)</name>" in text
    assert "<name>find 1 one</name>" in text
    assert "<name>Coast</name>" in text
    pytest.importorskip("rasterio")
    names = {
        path.name for path in drift.export(folder, "geotiff", tmp_path / "tif", times=["+72 h"])
    }
    assert "washup.geojson" in names
    assert (tmp_path / "tif" / "washup.geojson").read_bytes() == (
        folder / "washup.geojson"
    ).read_bytes()
