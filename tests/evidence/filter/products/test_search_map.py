"""Pictures of a search: that they are drawn anywhere, say what they must, and are the same each
time.
"""

import math
import re
import subprocess
import sys
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
import searches
import shapely
from matplotlib.lines import Line2D
from PIL import Image
from places import ROOT
from search_imprints import CAUTIONED, COMMON, SETTING, WRONG, one

from drift.evidence.filter.products import evidence_map
from drift.evidence.filter.products import layers as search_layers
from drift.evidence.filter.products import map as search_map
from drift.evidence.filter.updates import Updates
from drift.forecast.products import map as forecast_map
from drift.planning.search.products import map as plan_map
from drift.products.maps.imprint import Imprint, Setting
from drift.products.maps.marks import Mark
from drift.products.maps.overlay import Overlay


@pytest.mark.thorough
def test_each_sortie_before_amid_and_after(tmp_path, search, words):
    """Each with the ways that are on every map, and the plan and the forecast with them too."""
    forecast, sorties, contacts, updates = search
    drawn = []
    way = Overlay(
        lambda ax, frame: drawn.append(frame), {}, [(Line2D([], []), "Way: by the usual one")]
    )
    setting = Setting(CAUTIONED, overlays=[lambda now: way])
    search_map.plot_searches(
        forecast, sorties, contacts, updates, tmp_path / "search.png", setting, page=1
    )
    assert len(drawn) == 12  # four sorties, before, amid and after
    assert words.count("Way: by the usual one") == 1
    for stage in ("before", "mid-search", "after"):
        assert sum(text.startswith(stage) for text in words) == 4
    assert "before 221230Z" in words
    assert "after 221333Z" in words
    first = next(u for u in updates.all if u.name == "C-130 first light")
    figures = [f"{100 * v[-1]:.0f} %" for v in (first.poc, first.pod, first.pos)]
    assert any(text.endswith("POC {} × POD {} = POS {}".format(*figures)) for text in words)
    assert f"POS {figures[2]}, cumulative {figures[2]}" in words
    assert WRONG in words
    plan_map.plot_plan(forecast, searches.plan(), tmp_path / "plan.png", setting)
    forecast_map.draw_map(forecast, tmp_path / "map.png", setting)
    assert len(drawn) == 14
    assert words.count("Way: by the usual one") == 3


def test_pages_hold_four_sorties_and_off_times_are_told(tmp_path, search, words):
    forecast, sorties, _, updates = search
    many = [replace(sorties[0], name=f"number {k}") for k in range(4)] + [
        searches.watch(-88.2, 27.8)
    ]
    assert search_map.pages(many) == 2
    assert search_map.pages(many[:4]) == 1
    assert search_map.pages([]) == 0
    search_map.plot_searches(
        forecast, many, (), updates, tmp_path / "search-2.png", SETTING, page=2
    )
    assert "Towed array" in words  # it has no update, and so no number
    assert "Page 2 of 2   ·   5 sorties that found nothing, in order of end" in words
    assert "before 221230Z (+180 min)" in words  # no output is nearer to its start at 0930Z


def test_sorties_stand_in_the_order_of_their_numbers(tmp_path, search, words):
    """One that starts first and ends last comes last, as in the evidence."""
    forecast, sorties, _, updates = search
    flown = sorted(sorties, key=lambda sortie: sortie.end)
    long = replace(flown[-1], start=flown[0].start - np.timedelta64(1, "h"))
    search_map.plot_searches(
        forecast, [long, *flown[:-1]], (), updates, tmp_path / "a.png", SETTING, page=1
    )
    names = "|".join(re.escape(sortie.name) for sortie in sorties)
    numbers = [int(text.split()[0]) for text in words if re.fullmatch(rf"\d+ +({names})", text)]
    assert len(numbers) == len(sorties)
    assert numbers == sorted(numbers)


@pytest.mark.thorough
def test_pictures_anywhere(tmp_path):
    """Far north, and across the antimeridian."""
    lon, lat = 179.9, 82.0
    forecast, sorties, _, updates = searches.search(lon, lat)
    common = {
        **COMMON,
        "polygons": lambda box: [shapely.box(lon + 0.4, lat, lon + 2, lat + 1)],
        "marks": [Mark(lon, lat)],
    }
    everything = [sorties[3], searches.watch(lon, lat)]
    setting = Setting(**common)
    search_map.plot_searches(
        forecast,
        everything,
        searches.contacts(lon, lat),
        updates,
        tmp_path / "search.png",
        setting,
        page=1,
    )
    reminder = partial(search_layers.reminder, everything, ())
    forecast_map.draw_map(forecast, tmp_path / "map.png", setting, overlays=[reminder])
    counted = replace(setting, particles=1000)
    plan_map.plot_plan(forecast, searches.plan(lon, lat, rounds=2), tmp_path / "plan.png", counted)
    for name in ("search", "map", "plan"):
        with Image.open(tmp_path / f"{name}.png") as image:
            assert min(image.size) > 700


def test_only_sorties_begun_are_on_the_map(tmp_path, search, words):
    forecast, sorties, _, _ = search
    searched = [partial(search_layers.reminder, sorties, ())]
    forecast_map.draw_map(
        forecast, tmp_path / "a.png", Setting(Imprint("t")), time=0, overlays=searched
    )
    assert "Searched area" not in words
    forecast_map.draw_map(forecast, tmp_path / "b.png", Setting(Imprint("t")), overlays=searched)
    assert "Searched area" in words
    assert "Legs as flown" in words
    ahead = [partial(search_layers.reminder, [sorties[0], *planned_too(sorties[1:])], ())]
    forecast_map.draw_map(forecast, tmp_path / "c.png", Setting(Imprint("t")), overlays=ahead)
    assert "Legs as flown or planned" in words


def planned_too(sorties):
    return [replace(sortie, planned=True) for sortie in sorties]


def test_no_searches_change_no_pixel(tmp_path, search):
    for name, more in (
        ("a.png", {}),
        ("b.png", {"overlays": [partial(search_layers.reminder, (), ())]}),
    ):
        forecast_map.draw_map(search[0], tmp_path / name, Setting(Imprint("t")), **more)
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()


def test_the_evidence_says_what_moved_which_story(tmp_path, search, words):
    updates = search[3]
    evidence_map.plot_evidence(updates, tmp_path / "evidence.png", Setting(CAUTIONED))
    assert "before the first update" in words
    assert any(text.startswith("4 sorties that found nothing") for text in words)
    assert 'speaks for "swamped while fishing"' in words
    assert "Bayes factor 1.44: weak evidence" in words  # as the table has it
    last = [u for u in updates.all if u.cumulative is not None][-1]
    assert f"{100 * last.cumulative[-1]:.0f}  all together" in words
    for name, share in zip(searches.NAMES, last.cumulative, strict=False):
        assert f"{100 * share:.0f}  {name}" in words


@pytest.mark.parametrize(
    ("odds", "text", "strength"),
    [
        (1.1, "hardly distinguishes", "beyond 1.10"),
        (2.0, 'for "a"', "2: weak"),
        (10.0, 'for "a"', "10: positive"),
        (1 / 10, 'against "a"', "1/10: positive"),
        (100.0, 'for "a"', "100: strong"),
        (1000.0, 'for "a"', "1,000: very strong"),
        (1e30, 'for "a"', "over 1,000,000: very strong"),
        (math.inf, 'rules out "b"', ""),
    ],
)
def test_strength_of_evidence_in_words(odds, text, strength):
    """The words for Bayes factors of 3, 20 and 150 are those of Kass and Raftery (1995)."""
    log = [0.0, -math.log(odds) if odds < math.inf else -math.inf]
    told = one(log, [0.3, 0.7])
    assert text in told[0]
    assert strength in told[1]


def test_evidence_of_one_story_of_many_updates_and_of_none(tmp_path, search, words):
    updates = search[3]

    def alone(values):
        return None if values is None else values[[-1, -1]]

    single = [
        replace(u, log_evidence=alone(u.log_evidence), posterior=np.ones(1), poc=alone(u.poc), pos=alone(u.pos),
                cumulative=alone(u.cumulative))
        for u in updates.all
    ]  # fmt: skip
    evidence_map.plot_evidence(
        Updates(("only",), np.ones(1), tuple(single)), tmp_path / "one.png", SETTING
    )
    assert "POC (light), POS (dark) [%]" in words
    many = tuple(replace(updates.all[k % 6], name=f"update {k}") for k in range(30))
    evidence_map.plot_evidence(
        Updates(searches.NAMES, searches.PRIOR, many), tmp_path / "many.png", SETTING
    )
    assert "after update 8" in words
    assert any("the first 8 updates are in sorties.csv" in text for text in words)
    evidence_map.plot_evidence(
        Updates(searches.NAMES, searches.PRIOR, ()), tmp_path / "none.png", SETTING
    )
    assert "0 sorties that found nothing" in words
    words.clear()
    seen = [replace(u, kind="look", poc=None, pos=None, cumulative=None) for u in single]
    evidence_map.plot_evidence(
        Updates(("only",), np.ones(1), tuple(seen)), tmp_path / "seen.png", SETTING
    )
    assert "Probability of the report beforehand [%]" in words
    assert "Cumulative POS [%]" not in words
    assert "6 reports of sensors" in words


@pytest.mark.thorough
def test_the_same_search_gives_the_same_bytes(tmp_path, search):
    forecast, sorties, contacts, updates = search
    for name in ("a", "b"):
        search_map.plot_searches(
            forecast, sorties[:1], contacts, updates, tmp_path / f"{name}.png", SETTING, page=1
        )
        evidence_map.plot_evidence(updates, tmp_path / f"e{name}.png", SETTING)
    for prefix in ("", "e"):
        assert (tmp_path / f"{prefix}a.png").read_bytes() == (
            tmp_path / f"{prefix}b.png"
        ).read_bytes()
    with Image.open(tmp_path / "a.png") as image:
        assert image.text["case"] == "x"


def test_no_file_imports_pyplot():
    files = [
        *(ROOT / "drift").rglob("*.py"),
        *(ROOT / "geo").rglob("*.py"),
        *(ROOT / "kernels").rglob("*.py"),
    ]
    assert len(files) > 100
    assert not [
        f
        for f in files
        if re.search(r"import .*pyplot|matplotlib\.pyplot", f.read_text(encoding="utf-8"))
    ]


@pytest.mark.thorough
def test_pyplot_stays_out():
    program = "import sys, drift.forecast.products.map, drift.evidence.filter.products.map, drift.evidence.filter.products.evidence_map, drift.planning.search.products.map; sys.exit('matplotlib.pyplot' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", program], check=False).returncode == 0
