"""Pictures of a search and of a plan: that they are drawn anywhere, say what they must, and are the
same each time.
"""

import itertools
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
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.text import Text
from PIL import Image
from places import ROOT

from drift.evidence.filter.products import evidence_map
from drift.evidence.filter.products import layers as search_layers
from drift.evidence.filter.products import map as search_map
from drift.evidence.filter.updates import Update, Updates
from drift.forecast.products import map as forecast_map
from drift.planning.search.products import map as plan_map
from drift.planning.search.products import subareas
from drift.products.maps.imprint import Imprint, Setting
from drift.products.maps.marks import Mark
from drift.products.maps.overlay import Overlay

# or whatever else a picture must not be believed of
WRONG = "NO ERROR of current and wind in this forecast"


@pytest.fixture(scope="module")
def search():
    return searches.search()


@pytest.fixture
def words(monkeypatch):
    """Collect every text that is on a figure when it would be saved; it is laid out, and no pixel
    is drawn.
    """
    found = []

    def listen(self, *args, **kwargs):
        found.extend(text.get_text() for text in self.findobj(Text) if text.get_text())
        self.draw_without_rendering()

    monkeypatch.setattr(Figure, "savefig", listen)
    return found


IMPRINT = Imprint("A search", footer="casp-drift", attributes={"case": "x"})
COMMON = {"imprint": IMPRINT}
SETTING = Setting(IMPRINT)
CAUTIONED = replace(IMPRINT, caution=WRONG)


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
    assert "Page 2 of 2   ·   5 sorties that found nothing, in order of start" in words
    assert "before 221230Z (+180 min)" in words  # no output is nearer to its start at 0930Z


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


def one(log_evidence, before):
    update = Update(
        "u", "sortie", searches.BEGIN, np.array([*log_evidence, 0.0]), np.zeros(2), 1.0, 1.0
    )
    return evidence_map.evidence_in_words(update, np.array(before), ("a", "b"))


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


def test_a_plan_shows_its_figures(tmp_path, search, words):
    plan = searches.plan()
    plan_map.plot_plan(search[0], plan, tmp_path / "a.png", SETTING)
    assert "Plan: POS 0.46; estimated bound 0.53 (+-0.01)" in words
    assert "A-1 CG 1503\n222330Z" in words
    assert "5 legs, spacing 3.00 nmi, creep 228T" in words
    near = search[0].data["time"].values[plan_map.nearest(search[0], plan)]
    assert abs(near - searches.hours(18.75)) <= np.timedelta64(
        105, "m"
    )  # on scene 2330Z to 0300Z; outputs at 2330Z, 0630Z
    unit = replace(plan.taskings[0].unit, base=(-95.0, 30.0))
    far = replace(plan, taskings=(replace(plan.taskings[0], unit=unit), *plan.taskings[1:]))
    plan_map.plot_plan(search[0], far, tmp_path / "b.png", SETTING)
    assert any(text.startswith("CG 1503\nbase 3") for text in words)
    plan_map.plot_plan(search[0], replace(plan, taskings=()), tmp_path / "c.png", SETTING)
    assert "No unit can search in this period." in words


def test_a_plan_shows_the_land_of_all_that_it_shows(tmp_path, search, words):
    """The coast of a run ends with its domain: a map that reaches farther showed sea where land is."""
    asked = []

    def land(box):
        asked.append(box)
        return [shapely.box(-88.5, 27.9, -88.4, 28.0)]

    plan = searches.plan()
    plan_map.plot_plan(search[0], plan, tmp_path / "a.png", replace(SETTING, polygons=land))
    assert "Land" in words
    (box,) = asked
    for tasking in plan.taskings:
        for lon, lat in subareas.corners(tasking):
            assert box.west < lon < box.east
            assert box.south < lat < box.north


def boxes(figure, some):
    renderer = figure.canvas.get_renderer()
    return {
        text.get_text(): text.get_window_extent(renderer)
        for text in figure.findobj(Text)
        if some(text.get_text())
    }


def overlapping(found):
    return [(a, b) for a, b in itertools.combinations(found, 2) if found[a].overlaps(found[b])]


@pytest.fixture
def figures(monkeypatch):
    """Collect figures as they are saved."""
    found = []
    save = Figure.savefig
    monkeypatch.setattr(
        Figure,
        "savefig",
        lambda self, *args, **kwargs: (found.append(self), save(self, *args, **kwargs))[1],
    )
    return found


def test_labels_of_a_plan_keep_apart(tmp_path, search, figures):
    plan = searches.plan()
    far = [(-89.2, 31.5), (-89.1, 31.4), (-88.8, 31.6)]  # all beyond the upper edge, close together
    taskings = [
        replace(one, unit=replace(one.unit, base=base, return_to=base))
        for one, base in zip(plan.taskings, far, strict=True)
    ]
    title = "A title that goes on and on until it meets a warning, Gulf of Mexico and beyond"
    plan = replace(plan, taskings=tuple(taskings))
    plan_map.plot_plan(
        search[0], plan, tmp_path / "a.png", Setting(replace(CAUTIONED, title=title))
    )
    found = boxes(
        figures[0],
        lambda text: "\nbase " in text or "\n2" in text or text.startswith(("A title", "SYNTH")),
    )
    assert sum("\n2" in text for text in found) == 3
    assert sum("\nbase " in text for text in found) >= 1
    assert any(text.startswith("A title") and text.endswith(" …") for text in found)
    assert overlapping(found) == []


def test_what_else_could_be_done_is_told_in_full(tmp_path, search, words):
    plan = searches.plan()
    name = "each unit where it alone finds most, ignoring what all of the others find"
    plan = replace(plan, alternatives=(replace(plan.alternatives[0], name=name),))
    plan_map.plot_plan(search[0], plan, tmp_path / "a.png", SETTING)
    k = next(k for k, text in enumerate(words) if text.startswith("0.35  "))
    assert " ".join(words[k : k + 2]) == f"0.35  {name}"
    # of the same particles as the plan, and which
    assert words[k - 2 : k] == ["Compared, on the planning particles", "0.47  this plan"]


def test_numbers_of_updates_close_in_time_do_not_touch(tmp_path, search, figures):
    updates = search[3]
    sortie = updates.all[0]
    times = (0, 1, 40, 40.1, 40.3, 52, 70)
    many = tuple(
        replace(sortie, name=f"{k}", time=searches.hours(hour)) for k, hour in enumerate(times)
    )
    evidence_map.plot_evidence(
        Updates(searches.NAMES, searches.PRIOR, many), tmp_path / "a.png", SETTING
    )
    axes = figures[0].axes[1]
    renderer = figures[0].canvas.get_renderer()
    found = {
        t.get_text(): t.get_window_extent(renderer)
        for t in axes.texts
        if set(t.get_text()) <= set("1234567-, ")
    }
    assert list(found) == ["1-2", "3-5", "6", "7"]
    assert overlapping(found) == []


def test_sorties_have_the_numbers_of_their_updates(tmp_path, search, words):
    """The helicopter's area, begun before but taken into account after the second C-130's, has the
    higher number.
    """
    forecast, sorties, contacts, updates = search
    ordered = [u.name for u in updates.all]
    swapped = [ordered.index(name) for name in ("Helicopter, fishing ground", "C-130 second")]
    found = list(updates.all)
    found[swapped[0]], found[swapped[1]] = found[swapped[1]], found[swapped[0]]
    other = replace(updates, all=tuple(found))
    search_map.plot_searches(
        forecast, sorties[1:3], contacts, other, tmp_path / "a.png", SETTING, page=1
    )
    for sortie in sorties[1:3]:
        number = 1 + next(k for k, u in enumerate(found) if u.name == sortie.name)
        assert f"{number} {sortie.name}" in words


def test_contacts_are_drawn_with_the_sorties_that_they_concern(
    tmp_path, search, words, monkeypatch
):
    """The fix of 12 h and the flare of 13 h, in the panels of the cutter at 14.5 h to 17 h; not in
    those before.
    """
    forecast, sorties, contacts, updates = search
    drawn = []
    monkeypatch.setattr(
        search_map.search_layers, "contact", lambda ax, here, one, scale: drawn.append(one.name)
    )
    search_map.plot_searches(
        forecast, sorties[2:], contacts, updates, tmp_path / "a.png", SETTING, page=1
    )
    assert sorted(drawn) == ["Beacon A/B"] * 3 + ["Red flare"] * 3
    drawn.clear()
    late = replace(sorties[3], start=searches.hours(20), end=searches.hours(22))
    search_map.plot_searches(
        forecast, [late], contacts, updates, tmp_path / "a.png", SETTING, page=1
    )
    assert drawn == []


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
