"""Maps by story: each is that of its own particles, its areas hold what they say, and of many the
others stand together.
"""

from dataclasses import replace

import clouds
import numpy as np
import pytest
from PIL import Image
from pyproj import Geod

from drift.engine.particles.status import Status
from drift.forecast import build as forecast_build
from drift.forecast import by_scenario, effective
from drift.forecast.products import chapter, scenario_maps
from drift.products.maps.imprint import Imprint, Setting
from drift.products.maps.marks import Line, Mark
from geo import sphere

N = 6000


def made(weights, east=20_000.0, lon=-60.0, learnt=True):
    """Return a forecast of scenarios that lie side by side, of which a fifth has stranded and a
    tenth of the first has sunk.

    learnt: the weights are those after the first output, which has equal ones.
    """
    rng = np.random.default_rng(3)
    many = len(weights)
    scenario = np.arange(N) % many
    weight = np.asarray(weights, float)[scenario]
    weight = weight * rng.gamma(2.0, size=N)
    status = np.where(np.arange(N) % 5 == 0, Status.ASHORE, Status.ADRIFT)
    status = np.where((scenario == 0) & (np.arange(N) % 10 == many), Status.SUNK, status).astype(
        np.int32
    )
    snapshots = []
    for i, spread in enumerate((2000.0, 4000.0)):
        x, y = sphere.destination(
            np.radians(lon),
            np.radians(12.0),
            rng.normal(0, spread, N) + east * scenario,
            rng.normal(0, 2 * spread, N),
        )
        time = np.datetime64("2026-11-21T18:30:00") + np.timedelta64(6 * i, "h")
        place = sphere.to_binary(np.degrees(x)), sphere.to_binary(np.degrees(y))
        share = np.full(N, 1 / N) if learnt and not i else weight / weight.sum()
        snapshots.append(
            clouds.at(
                time,
                *place,
                share,
                status if i else np.zeros(N, np.int32),
                scenario.astype(np.int32),
            )
        )
    return forecast_build.build_forecast(
        snapshots, scenarios=[f"story {k}" for k in range(many)]
    ), snapshots


def test_each_story_has_the_map_of_its_own_particles():
    forecast, (_, last) = made([1.0, 3.0, 0.0])
    found = by_scenario.forecasts_by_scenario(forecast, -1)
    assert [story.name for story in found] == ["story 1", "story 0", "story 2"]
    everywhere = sum(story.now * story.forecast.data["probability"].values[0] for story in found)
    np.testing.assert_allclose(
        everywhere, forecast.data["probability"].values[-1], rtol=1e-5, atol=1e-12
    )
    for story in found:
        own = last.scenario == int(story.name[-1])
        assert story.now == pytest.approx(last.probability[own].sum(), abs=1e-9)
        assert story.before == pytest.approx(1 / 3, abs=1e-9)
        if story.now == 0:
            assert not story.forecast.contours
            assert not story.forecast.data["probability"].values.any()
            continue
        lost = (
            last.probability[own & (last.status == Status.SUNK)].sum() / last.probability[own].sum()
        )
        # float32 of maps
        assert float(story.forecast.data["probability"].sum()) == pytest.approx(1 - lost, abs=1e-4)
        assert float(story.forecast.data["effective_particles"][0]) == pytest.approx(
            effective.number(last.probability[own & (last.status != Status.SUNK)])
        )


def test_what_is_ashore_of_a_scenario_is_a_share_of_its_own_map():
    """Far apart, each cell is of one scenario: what is ashore adds up to its share of stranded."""
    forecast, (_, last) = made([1.0, 3.0], east=200_000.0)
    for scenario in by_scenario.forecasts_by_scenario(forecast, -1):
        own = last.scenario == int(scenario.name[-1])
        stranded = last.probability[own & (last.status == Status.ASHORE)].sum()
        ashore = scenario.forecast.data["probability_ashore"].values[0]
        expected = stranded / last.probability[own].sum()
        assert np.nansum(ashore) == pytest.approx(expected, abs=1e-4)  # float32 of maps


def test_areas_of_a_story_hold_their_shares_of_its_map_and_are_as_large_as_their_outlines():
    """The smallest set of cells that holds a share holds less than the share by at most one cell;
    outlines keep sizes to 0.5 %.
    """
    forecast, _ = made([1.0, 3.0], lon=179.9)
    earth = Geod(a=sphere.RADIUS, b=sphere.RADIUS)
    for story in by_scenario.forecasts_by_scenario(forecast, -1):
        data = story.forecast.data.isel(time=0)
        mass = data["probability"].values / data["probability"].values.sum()
        for contour in story.forecast.contours:
            inside = mass[data["containment"].values <= contour.share].sum()
            assert contour.share - mass.max() <= inside <= contour.share + 1e-9
            outline = sum(
                abs(earth.geometry_area_perimeter(part)[0]) for part in contour.polygon.geoms
            )
            # edges between corners are not great circles
            assert outline == pytest.approx(contour.area, rel=0.006)


def test_of_many_stories_the_others_stand_together_and_count_as_their_particles_do():
    weights = np.arange(1.0, 15.0)
    forecast, (_, last) = made(weights, east=3000.0, learnt=False)
    found = by_scenario.forecasts_by_scenario(forecast, -1)
    assert [story.name for story in found[:-1]] == [f"story {k}" for k in range(13, 3, -1)]
    assert found[-1].name == "4 others"
    rest = (last.scenario < 4) & (last.status != Status.SUNK)
    # Weights of a scenario on the map and off it are not told apart by how many count: a tenth of
    # the first has sunk.
    assert float(found[-1].forecast.data["effective_particles"][0]) == pytest.approx(
        effective.number(last.probability[rest]), rel=0.02
    )
    assert found[-1].now == pytest.approx(last.probability[last.scenario < 4].sum(), abs=1e-9)


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("weights", "east", "lon"),
    [([1.0, 3.0, 0.0], 20_000.0, -60.0), (np.arange(1.0, 15.0), 3000.0, 179.9)],
)
def test_the_picture_is_drawn(tmp_path, weights, east, lon):
    forecast, _ = made(weights, east, lon)
    marks = [Mark(lon, 12.0, "LKP, story 0"), Mark(lon + 0.2, 12.0, "LKP, story 1")]
    lines = [Line([lon, lon + 0.1], [11.9, 12.1], "story 2")]
    on = Setting(Imprint("Stories", caution="SYNTHETIC"), marks=marks, lines=lines, particles=N)
    scenario_maps.plot_scenarios(forecast, tmp_path / "stories.png", on)
    with Image.open(tmp_path / "stories.png") as picture:
        assert picture.info["Title"] == "Stories"
        assert picture.width == pytest.approx(
            130 * (min(len(weights) + 1, 4) * 3.14 - 0.14 + 1.45), abs=2
        )


def test_stories_of_one_are_not_drawn_apart():
    forecast, _ = made([1.0])
    matter = chapter.ForecastOutputs(forecast, None, Setting(Imprint("one")))
    assert set(chapter.forecast_bundle(matter).pictures) == {*chapter.PICTURES}
    assert {*chapter.forecast_bundle(replace(matter, forecast=made([1.0, 1.0])[0])).pictures} == {
        *chapter.PICTURES,
        *chapter.SCENARIO_PICTURES,
    }
