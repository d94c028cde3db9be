"""Pictures of a plan, and labels and numbers that must not touch."""

import itertools
from dataclasses import replace

import numpy as np
import searches
import shapely
from matplotlib.text import Text
from search_imprints import CAUTIONED, SETTING

from drift.evidence.filter.products import evidence_map
from drift.evidence.filter.products import map as search_map
from drift.evidence.filter.updates import Updates
from drift.planning.search.products import map as plan_map
from drift.planning.search.products import subareas
from drift.products.maps.imprint import Setting


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


def test_labels_of_a_plan_keep_apart(tmp_path, search, figures):
    plan = searches.plan()
    far = [(-89.2, 31.5), (-89.1, 31.4), (-88.8, 31.6)]  # all beyond the upper edge, close together
    taskings = [
        replace(one, unit=replace(one.unit, base=base, return_to=base))
        for one, base in zip(plan.taskings, far, strict=True)
    ]
    title = f"A title that goes on {'and on ' * 15}until it meets a warning"
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
