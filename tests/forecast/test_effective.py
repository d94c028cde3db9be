"""Results that rest on few particles or worlds say so: against sums of our own."""

import csv
import io
import json
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import searches
import xarray as xr
from weighted_snapshots import snapshot

import drift
from drift.engine.particles.status import Status
from drift.evidence.filter.products import evidence_map, particles_left
from drift.forecast import build as forecast_build
from drift.forecast import effective
from drift.forecast.effective import Count
from drift.forecast.products import map as forecast_map
from drift.forecast.products import tables
from drift.planning.search.products import files as plan_files
from drift.planning.search.products import map as plan_map
from drift.planning.search.products import text as plan_text
from drift.products.maps import page
from drift.products.maps.imprint import Imprint, Setting
from geo import sphere

# or whatever else a picture must not be believed of
WRONG = "NO ERROR of current and wind in this forecast"
N = 100_000
BANNER = "ONLY 4 OF 100,000 PARTICLES ARE EFFECTIVE"


def cloud(lon=179.7, lat=-38.2, n=N):
    rng = np.random.default_rng(8)
    x, y = sphere.destination(
        *np.radians([lon, lat]), rng.normal(0, 9000, n), rng.normal(0, 14_000, n)
    )
    return np.degrees(x), np.degrees(y)


@pytest.fixture(scope="module")
def forecast():
    """At the first output all count alike, at the second four of them do, a quarter each."""
    lon, lat = cloud()
    four = np.full(N, 1e-12)
    four[[11, 30_011, 60_011, 90_011]] = 0.25
    return forecast_build.build_forecast(
        [snapshot(lon, lat, w, h) for h, w in ((0, np.ones(N)), (6, four))], scenarios=["only"]
    )


def own(weight):
    share = weight / weight.sum()
    return 1 / np.sum(share**2)


def test_numbers_are_kongs_and_families_count_once():
    rng = np.random.default_rng(3)
    weight, family, code = (
        rng.exponential(size=400),
        rng.integers(0, 7, 400),
        rng.integers(0, 3, 400),
    )
    assert effective.number(7.5 * weight) == pytest.approx(own(weight), rel=1e-12)
    whole = np.array([weight[family == k].sum() for k in range(7)])
    assert effective.number(weight, family) == pytest.approx(own(whole), rel=1e-12)
    # its squares underflow
    assert effective.number(weight * 1e-200) == pytest.approx(own(weight), rel=1e-12)
    np.testing.assert_allclose(
        effective.effective_by_code(code, 4, weight),
        [own(weight[code == k]) for k in range(3)] + [0],
    )
    each = [
        own(np.array([weight[(family == f) & (code == k)].sum() for f in range(7)]))
        for k in range(3)
    ]
    np.testing.assert_allclose(effective.effective_by_code(code, 4, weight, family), [*each, 0])
    assert effective.number(np.zeros(0)) == effective.number(np.zeros(3)) == 0


@pytest.mark.parametrize(
    ("count", "few", "text"),
    [
        (Count(199.99, 1000), True, "199 of 1,000 particles are effective"),
        (Count(200.0, 1000), False, "200 of 1,000 particles are effective"),
        (Count(1.0, 1000), True, "1 of 1,000 particles is effective"),
        (Count(1.4), True, "1 particle is effective"),
        # nothing is on the map: it has no areas to doubt
        (Count(0.0, 5), False, "1 of 5 particles is effective"),
        (Count(50 - 1e-9, 50, "worlds"), False, "50 of 50 worlds are effective"),
        (Count(12.7, 2000, "worlds"), True, "13 of 2,000 worlds are effective"),
    ],
)
def test_one_threshold_for_particles_and_one_for_worlds(count, few, text):
    assert count.few == few
    assert count.words == text


@pytest.mark.thorough
def test_pictures_say_that_few_count_and_when(tmp_path, forecast, words):
    setting = Setting(Imprint("Few"), particles=N)
    cautioned = Setting(Imprint("Few", caution=WRONG), particles=N)
    forecast_map.draw_map(forecast, tmp_path / "map.png", cautioned)
    assert f"{BANNER}: the areas are rough" in words
    assert WRONG in words
    assert any(text.startswith("50 % area: rough, ") for text in words)
    words.clear()
    forecast_map.draw_map(forecast, tmp_path / "sure.png", setting, time=0)
    assert not any("ONLY" in text or "rough" in text.lower() for text in words)
    words.clear()
    forecast_map.draw_snapshots(forecast, tmp_path / "snapshots.png", setting)
    assert f"{BANNER} at 220030ZNOV26: areas are rough" in words
    assert (
        sum("only 4 of 100,000 particles are effective" in text for text in words) == 1
    )  # on the panel of that time alone


def test_banners_keep_clear_of_all_other_words(tmp_path, forecast, monkeypatch):
    seen = []
    monkeypatch.setattr(page, "save", lambda canvas, *args, **kwargs: seen.append(canvas.figure))
    long, short = "A long title of a case, as they are given, " * 2, "Short"
    forecast_map.draw_map(
        forecast, tmp_path / "map.png", Setting(Imprint(long, caution=WRONG), particles=N)
    )
    forecast_map.draw_snapshots(
        forecast, tmp_path / "snapshots.png", Setting(Imprint(short, caution=WRONG), particles=N)
    )
    for figure in seen:
        draw = figure.canvas.get_renderer()
        banner = next(text for text in figure.texts if BANNER in text.get_text())
        box = banner.get_bbox_patch().get_window_extent(draw)
        others = [text for text in figure.texts if text is not banner]
        assert not any(box.overlaps(text.get_window_extent(draw)) for text in others)
        assert all(box.y0 >= ax.bbox.y1 - 1 for ax in figure.axes if ax.bbox.x0 < box.x1)
        chart = figure.axes[0]
        np.testing.assert_allclose(
            chart.get_position().bounds, chart.get_position(original=True).bounds, atol=1e-3
        )


def test_files_carry_the_number_and_few_are_warned_of(forecast):
    data = forecast.data
    weight = np.full(N, 1e-12)
    weight[:4] = 0.25
    wanted = [float(N), own(weight)]
    np.testing.assert_allclose(data["effective_particles"], wanted, rtol=1e-6)
    np.testing.assert_allclose(data["scenario_effective"][:, 0], wanted, rtol=1e-6)
    np.testing.assert_allclose(data["status_effective"].sel(status="adrift"), wanted, rtol=1e-6)
    rows = list(csv.DictReader(io.StringIO(tables.track(forecast, "run"))))
    np.testing.assert_allclose(
        [float(row["effective_particles"]) for row in rows], wanted, rtol=1e-5
    )
    features = tables.contours(forecast, {"warning": "w"})
    assert features["warning"] == "w"
    assert {round(f["properties"]["effective_particles"]) for f in features["features"]} == {N, 4}
    assert tables.summary_of_forecast(forecast)["outputs"][1][
        "effective_particles"
    ] == pytest.approx(4, rel=1e-6)
    told = effective.effective_warnings(data, N)
    assert told == [
        "only 4 of 100,000 particles are effective at 220030ZNOV26: areas and shares are rough"
    ]
    assert effective.effective_warnings(data.isel(time=[0]), N) == []


def test_what_is_drawn_anew_counts_as_what_it_descends_from():
    lon, lat = cloud(n=6)
    one = snapshot(lon, lat, np.ones(6), 0, family=np.array([2, 2, 5, 5, 5, 0]))
    made = forecast_build.build_forecast([one], scenarios=["only"])
    assert made.data["effective_particles"].item() == pytest.approx(own(np.array([2.0, 3.0, 1.0])))


def test_a_spill_stands_on_its_worlds(tmp_path, words):
    """60,000 particles of 100 worlds, of which three hold all but nothing of the probability."""
    n, worlds = 60_000, 100
    lon, lat = cloud(n=n)
    world = np.arange(n) % worlds
    share = np.full(worlds, 1e-6)
    share[[3, 50, 77]] = 0.5, 0.3, 0.2
    one = snapshot(lon, lat, share[world], 0, world=world.astype(np.int32))
    made = forecast_build.build_forecast([one], scenarios=["box", "drum"])
    assert made.data["effective_worlds"].item() == pytest.approx(own(share), rel=1e-9)
    assert made.data["effective_particles"].item() > 200
    assert tables.summary_of_forecast(made)["outputs"][0]["effective_worlds"] == pytest.approx(
        own(share), rel=1e-9
    )
    assert effective.effective_warnings(made.data, n)[0].startswith(
        "only 3 of 100 worlds are effective at 211830ZNOV26: "
    )
    forecast_map.draw_map(made, tmp_path / "map.png", Setting(Imprint("t"), particles=n))
    assert "ONLY 3 OF 100 WORLDS ARE EFFECTIVE: the areas are rough" in words


def test_a_part_that_stands_on_few_is_told():
    """A tenth of the probability, ashore, on 20 particles; a scenario of a fifth on 50; all the
    rest on many.
    """
    n = 50_000
    lon, lat = cloud(n=n)
    weight, status, scenario = np.full(n, 1.0), np.zeros(n, np.int32), np.zeros(n, np.int32)
    status[:20], scenario[20:70] = Status.ASHORE, 1
    weight[:20], weight[20:70] = 0.1 / 20, 0.2 / 50
    weight[70:] = 0.7 / (n - 70)
    made = forecast_build.build_forecast(
        [snapshot(lon, lat, weight, 0, status, scenario)], scenarios=["first", "second"]
    )
    assert made.data["effective_particles"].item() == pytest.approx(own(weight), rel=1e-9)
    assert own(weight) > 200
    told = effective.effective_warnings(made.data, n)
    assert told == [
        "only 20 particles are effective of those ashore: figures of this part are rough (10 % of the probability)",
        'only 50 particles are effective of scenario "second": figures of this part are rough (20 % of the probability)',
    ]
    row = next(csv.DictReader(io.StringIO(tables.ashore(made, "run"))))
    assert float(row["effective_particles"]) == pytest.approx(20)


def test_stories_that_stand_on_few_are_one_line():
    """Fifths of the probability on 60, 50 and 80 particles of three scenarios, the rest on many of
    a fourth.
    """
    n = 50_000
    lon, lat = cloud(n=n)
    scenario = np.full(n, 3, np.int32)
    weight = np.full(n, 0.4 / (n - 190))
    for story, (begin, many) in enumerate([(0, 60), (60, 50), (110, 80)]):
        scenario[begin : begin + many], weight[begin : begin + many] = story, 0.2 / many
    one = snapshot(lon, lat, weight, 0, np.zeros(n, np.int32), scenario)
    made = forecast_build.build_forecast([one], scenarios=["a", "b", "c", "d"])
    assert effective.effective_warnings(made.data, n) == [
        'only 50 particles are effective of scenario "b", and few of 2 others: figures of this part are rough (60 % of the '
        "probability)"
    ]


@pytest.mark.thorough
def test_a_plan_made_or_scored_on_few_says_so_everywhere(tmp_path, words):
    forecast = searches.search()[0]
    plan = replace(searches.plan(), made_on=Count(2500.0, 20_000), scored_on=Count(6.25, 100_000))
    told = "only 6 of 100,000 particles are effective in scoring: its POS is rough"
    assert plan_text.rough(plan) == [told]
    assert f"WARNING: {told}" in " ".join(plan_text.plan_text(plan, "T", "run").split())
    made = plan_files.plan_as_json(plan)
    assert made["warnings"] == [told]
    assert made["effective_particles"] == {"made_on": 2500.0, "scored_on": 6.25}
    for text in (plan_files.gpx(plan, "T", "r"), plan_files.kml(plan, "T", "r")):
        assert any(
            f"run r. WARNING: {told}" == (element.text or "")
            for element in ET.fromstring(text).iter()
        )
    assert f"# WARNING: {told}" in plan_files.toml(plan)
    assert all(
        f["properties"]["effective_particles_scored_on"] == 6.25
        for f in plan_files.geojson(plan, {})["features"]
    )
    plan_map.plot_plan(forecast, plan, tmp_path / "plan.png", Setting(Imprint("t")))
    assert "ONLY 6 OF 100,000 PARTICLES ARE EFFECTIVE: areas and POS are rough" in words
    words.clear()
    sure = replace(plan, scored_on=Count(60_000.0, 100_000))
    assert plan_text.rough(sure) == plan_files.plan_as_json(sure)["warnings"] == []
    assert "WARNING" not in plan_files.gpx(sure) + plan_files.kml(sure) + plan_files.toml(sure)
    plan_map.plot_plan(forecast, sure, tmp_path / "sure.png", Setting(Imprint("t")))
    assert not any("ONLY" in text for text in words)


@pytest.mark.thorough
def test_the_evidence_says_after_what_few_are_left(tmp_path, words):
    updates, setting = searches.search()[3], Setting(Imprint("t"), particles=12_000)
    evidence_map.plot_evidence(updates, tmp_path / "sure.png", setting)
    assert not any("ONLY" in text for text in words)
    low = [replace(u, ess_after=7.9) if k == 2 else u for k, u in enumerate(updates.all)]
    evidence_map.plot_evidence(replace(updates, all=tuple(low)), tmp_path / "few.png", setting)
    assert "ONLY 8 OF 12,000 PARTICLES ARE EFFECTIVE: shares, evidence and POS are rough" in words
    assert sum(text.endswith(", 8 particles are effective") for text in words) == 1
    told = particles_left.few_particles_warnings(
        searches.search()[0].data, 12_000, replace(updates, all=tuple(low))
    )
    named = f'{low[2].kind} "{low[2].name}"'
    before = f"{low[2].ess_before:,.0f}"
    # 200 that count, of 7.9 in 12,000: 303,797
    assert told[0].startswith(
        f"only 8 of 12,000 particles are effective after {named} ({before} before it): areas and shares after it are rough. Check it; otherwise "
        "use 310,000 particles or more"
    )


CASE = """
title = "few"
start = "211830ZNOV26"
duration = "3 h"
particles = 3000
coast.source = "none"
output.every = "1 h"
current = [{ constant = { speed = "0.5 kn", toward = 80 } }]
wind = [{ constant = { speed = "8 kn", from = 200 } }]
resampling.below = 0.9
uncertainty.diffusivity = "5 m2/s"
[[scenario]]
name = "raft"
object = { windage = "3 %" }
position = { at = "27 30N 088 00W", std = "4 nmi" }
[[contact]]
name = "radar"
time = "211930ZNOV26"
position = { at = "27 31N 087 58W", std = "0.15 nmi" }
"""


@pytest.mark.thorough
def test_copies_do_not_make_a_run_look_sure(tmp_path):
    """A contact of 0.15 nmi in a prior of 4 nmi leaves one in 350 of 3,000; drawn again, these are
    3,000 again, and no more.
    """
    (tmp_path / "few.toml").write_text(CASE)
    result = drift.run(drift.load(tmp_path / "few.toml"), tmp_path / "out")
    update = result.updates.all[0]
    assert update.resampled
    assert update.ess_after < 60
    with xr.open_dataset(tmp_path / "out" / "forecast.nc") as data:
        counted = data["effective_particles"].values
        assert counted[0] == pytest.approx(3000)
        # as many families as have descendants, at most
        assert (counted[-2:] <= 3000 * update.distinct + 1e-6).all()
        assert counted[-1] == pytest.approx(update.ess_after, rel=0.5)
        warning = data.attrs["warning"]
    many = round(update.ess_after)
    told = f'only {many} of 3,000 particles are effective after contact "radar" (3,000 before it): areas and shares after it are rough'
    assert warning.startswith(told)
    summary = json.loads(Path(tmp_path / "out" / "summary.json").read_text())
    assert summary["warnings"][0].startswith(told)
    for name in ("contours.geojson", "sorties.geojson"):
        assert json.loads((tmp_path / "out" / name).read_text())["warning"] == warning
    with xr.open_dataset(tmp_path / "out" / "particles.nc", decode_times=False) as tracks:
        assert tracks.attrs["warning"] == warning
