"""What charts show of itineraries: what scenarios share once, all that is on it in its places,
lanes of several routes in one network.
"""

import itertools
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from pyproj import Geod

from drift.case import file as case_file
from drift.engine.environment import layers
from drift.engine.motion.steering import lanes
from drift.engine.motion.steering.itinerary import Ways
from drift.products.maps import chart


def test_a_way_that_scenarios_share_is_drawn_once() -> None:
    overlay = layers.itineraries(case_file.load("overdue_yacht").scenarios)
    assert [text for _, text in overlay.key] == ["Way: dismasted, in the raft, slow, and under way"]
    (line,) = overlay.places["the track of dismasted, in the raft, slow, and under way"]
    np.testing.assert_allclose(
        line[[0, -1]], [[-87 - 16 / 60, 30 + 4 / 60], [-83.05, 27.6]], atol=1e-9
    )


def test_many_ways_are_one_row_of_the_legend_and_one_line() -> None:
    """Of forty voyages nobody tells colours apart; five have one each."""
    (first, *_) = case_file.load("overdue_yacht").scenarios
    assert first.itinerary is not None
    (voyage,) = first.itinerary.phases
    assert isinstance(voyage, Ways)
    some = []
    for k in range(40):
        moved = tuple(
            replace(p, place=replace(p.place, lat=p.place.lat - 1e-4 * k)) for p in voyage.points
        )  # type: ignore[call-arg, union-attr]
        itinerary = replace(first.itinerary, phases=(replace(voyage, points=moved),))
        some.append(replace(first, name=f"story {k}", itinerary=itinerary))
    frame = chart.frame(np.array([-89.0, -82.0]), np.array([27.0, 31.0]), 1.2)
    for count, lines in ((5, 5), (40, 1)):
        overlay = layers.itineraries(some[:count])
        ax = Figure().add_axes((0, 0, 1, 1))
        chart.prepare(ax, frame)
        before = len(ax.lines)
        overlay.draw(ax, frame)
        assert len(ax.lines) - before == len(overlay.key) == len(overlay.places) == lines
    assert [text for _, text in overlay.key] == ["Tracks of 40 scenarios"]
    (drawn,) = ax.lines[before:]
    assert np.isnan(drawn.get_xdata()).sum() == 40  # type: ignore[arg-type]


def test_way_points_patrols_and_odds_are_drawn() -> None:
    submarine, smuggler = (
        case_file.load(name).scenarios for name in ("cast_submarine", "smuggler_bridge")
    )
    overlay = layers.itineraries(submarine)
    assert next(text for _, text in overlay.key) == "Way: track to patrol"
    assert [text for _, text in overlay.key][-1] == "Area of patrol"
    _, *outlines = overlay.places["the track of track to patrol"]
    assert len(outlines) == 3
    # The second way point's ellipse holds half with semi-axes of 25 and 10 nmi.
    lon, lat = outlines[1].T
    _, _, far = Geod(a=6_371_008.8, b=6_371_008.8).inv(
        np.full(lon.size, -28 - 10 / 60), np.full(lat.size, 44 + 40 / 60), lon, lat
    )
    assert far.max() == pytest.approx(25 * 1852, rel=1e-3)
    assert far.min() == pytest.approx(10 * 1852, rel=1e-2)  # its outline has 72 points
    overlay = layers.itineraries(smuggler)
    frame = chart.frame(np.array([-105.0, -92.0]), np.array([0.0, 16.0]), 1.2)
    ax = Figure().add_axes((0, 0, 1, 1))
    chart.prepare(ax, frame)
    overlay.draw(ax, frame)
    assert sorted(text.get_text() for text in ax.texts) == [
        "prior 20 %",
        "prior 30 %",
        "prior 50 %",
    ]


def test_lanes_of_several_routes_are_one_network_with_each_lane_once() -> None:
    scenarios = case_file.load("medsearch_transit").scenarios
    own = [s.itinerary.phases[0].lanes for s in scenarios if s.itinerary]  # type: ignore[union-attr]
    pairs = {
        tuple(sorted(pair)) for one in own for pair in itertools.pairwise(one.route.node)
    }  # one is followed both ways
    whole = lanes.join_networks([one.network for one in own])
    names = np.array(whole.name)
    found = list(zip(names[whole.start], names[whole.end], strict=True))
    assert len(found) == len(set(found)) == len(pairs)
    assert {tuple(sorted(pair)) for pair in found} == pairs
    for one in own:
        assert lanes.route(whole, one.route.node).along[-1] == pytest.approx(one.route.along[-1])


def test_a_tracker_that_scenarios_share_is_drawn_once(tmp_path: Path) -> None:
    """Its rhumb line across 180 degrees, with no jump: 40 minutes at 30 knots, by pyproj."""
    story = 'name = "{}"\nposition = {{ at = [-179.8, 12.3], std = "1 nmi" }}\n[[scenario.phase]]\nbehaviour = {{ fastest = "32 kn", acts = ["3 min", "15 min"], {} = 0.2, tracker = "patrol" }}\n'
    path = tmp_path / "chase.toml"
    path.write_text(
        'title = "t"\nstart = "2026-03-05T00:00Z"\nduration = "40 min"\ncoast.source = "none"\n'
        '[tracker.patrol]\nat = [179.9, 12.0]\nlegs = [{ course = 75, speed = "30 kn" }]\n'
        + "".join(
            f"[[scenario]]\n{story.format(name, kind)}"
            for name, kind in (("seeks", "seek"), ("flees", "hide"))
        )
    )
    overlay = layers.itineraries(case_file.load(path).scenarios)
    assert [text for _, text in overlay.key] == ["Tracker that targets seek or flee from"]
    (line,) = overlay.places["the tracker"]
    assert np.abs(np.diff(line[:, 0])).max() < 0.1
    _, _, far = Geod(a=6_371_008.8, b=6_371_008.8).inv(*line[0], *line[-1])
    assert far == pytest.approx(20 * 1852, rel=1e-5)
    ax = Figure().add_axes((0, 0, 1, 1))
    frame = chart.frame(np.array([179.5, 180.5]), np.array([11.5, 12.5]), 1.2)
    chart.prepare(ax, frame)
    before = len(ax.lines)
    overlay.draw(ax, frame)
    assert len(ax.lines) - before == 1
