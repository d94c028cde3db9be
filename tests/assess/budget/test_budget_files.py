"""The files and texts of a budget, and where members of an ensemble agree."""

import csv
import json
import math
from pathlib import Path

import numpy as np
import pytest
import trial_case
import xarray as xr

import drift
from drift.apps.cli import commands as cli

PAINTS = False
pytestmark = pytest.mark.usefixtures("coarse_maps")
STD, HOURS = 3000.0, 6.0
# east of the first, [m] after six hours: the second overlaps it, the third is far away
APART = (0.0, 5200.0, 40_000.0)
MEMBERS = [{"constant": {"east": 0.31 + far / (HOURS * 3600), "north": 0.17}} for far in APART]


@pytest.fixture(scope="module")
def ensemble(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The results of a budget whose case has three members and a contact."""
    folder = tmp_path_factory.mktemp("ensemble")
    path = trial_case.write(
        folder,
        current={"members": MEMBERS},
        output={"areas": [50, 95]},
        scenario={"position": {"at": "27 30N 088 00W", "std": f"{STD} m"}},
        contact=[{"name": "flare", "time": "+2 h", "position": {"at": "27 30N 087 58W", "error": "9 nmi"}}],
    )  # fmt: skip
    argv = ["budget", str(path), "--out", str(folder / "out"), "--particles", "9000", "--json"]
    assert cli.main(argv) == 0
    return folder / "out"


def lens(radius: float, apart: float) -> float:
    """Return the area that two circles share."""
    half = apart / 2
    return 2 * radius**2 * math.acos(half / radius) - half * math.sqrt(4 * radius**2 - apart**2)


def test_members_agree_where_their_circles_overlap(ensemble: Path) -> None:
    """By circles that hold 50 and 95 % of each member; areas from few particles are up to 5 %
    too large, which is 2.5 % of a radius.
    """
    with (ensemble / "consensus.csv").open() as file:
        rows = {(row["area_percent"], row["models"]): row for row in csv.DictReader(file)}
    assert len(rows) == 6
    for share in (0.5, 0.95):
        for least in (1, 2, 3):
            got = float(rows[f"{100 * share:g}", str(least)]["area_nmi2"]) * 1852**2
            sizes = []
            for scale in (0.975, 1.03):
                radius = scale * STD * math.sqrt(-2 * math.log1p(-share))
                both = lens(radius, APART[1])
                sizes.append({1: 3 * math.pi * radius**2 - both, 2: both, 3: 0.0}[least])
            # a cell at the edge is in or out: an eighth of a cell's width around the circle
            assert 0.93 * sizes[0] <= got <= 1.07 * sizes[1], (share, least)


def test_files_hold_the_figures(ensemble: Path) -> None:
    names = {path.name for path in ensemble.iterdir()}
    assert {"budget.csv", "budget.png", "consensus.csv", "consensus.nc", "consensus.png"} <= names
    found = json.loads((ensemble / "summary.json").read_text())["budget"]
    with (ensemble / "budget.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["source"] for row in rows] == ["members", "start"] * 2
    for row, area in zip(rows[::2], found["areas"], strict=True):
        own = area["sources"]["members"]
        assert float(row["share"]) == pytest.approx(own["share"], rel=1e-5)
        assert float(row["alone_nmi2"]) == pytest.approx(own["alone_m2"] / 1852**2, rel=1e-5)
        parts = area["sources"].values()
        assert sum(part["share"] for part in parts) + area["rest"] == pytest.approx(1, abs=1e-9)
    assert found["not_used"] == ["1 contact"]
    assert found["consensus"]["of"] == "members"
    with xr.open_dataset(ensemble / "consensus.nc") as data:
        count = data["models"].values
        assert count.max() == 2
        inside = (data["cell_area"].values * (count[-1, 1] >= 2)).sum()
        stored = found["consensus"]["areas"][1]["m2_by_models"][1]
        assert inside == pytest.approx(stored, rel=1e-6)


@pytest.mark.thorough
def test_the_text_names_the_greatest_and_what_to_do(tmp_path: Path) -> None:
    errors = {"current": {"std": 0.3, "time": "4 h"}}
    case = trial_case.load(tmp_path, uncertainty=errors)
    text = repr(drift.budget(case, particles=4000))
    assert "greatest: current error: drop a buoy on scene" in text
    assert "without it" in text
    assert "smaller; alone" in text
    assert np.char.count(text, "consensus") == 0
