"""Searches within 60 nmi of a pole: against the same search at the equator and geometry in three
dimensions.
"""

import math
from pathlib import Path

import numpy as np
import pytest
import trial_case
from matplotlib.figure import Figure

import drift
from drift.products.maps import chart
from geo import sphere


def searched(
    folder: Path,
    sorties: str,
    *,
    at: str,
    error: float,
    hours: float,
    n: int,
    step: str,
    speed: float,
) -> list[dict]:
    """Return what the sorties of a case told, whose target drifts at a speed [kn]."""
    case = trial_case.load(
        folder,
        sorties,
        start="2026-03-03T18:00Z",
        duration=f"{hours} h",
        particles=n,
        seed=5,
        uncertainty="none",
        output={"every": f"{hours} h"},
        clock={"step": step},
        current={"constant": {"speed": f"{speed} kn", "toward": 70}},
        scenario={"position": {"at": f"{at} 000 00E", "error": f"{error} nmi"}},
    )
    return list(drift.run(case).summary["search"]["updates"])


@pytest.mark.thorough
@pytest.mark.usefixtures("coarse_maps")
def test_a_search_over_the_pole_finds_what_the_same_search_at_the_equator_finds(
    tmp_path: Path,
) -> None:
    """The globe turned so that its pole lies on the equator: places, legs, and a current in the
    tangent plane.
    """
    # Offsets (east, north) [nmi] from the middle, as at the meridian of 0.
    flown = [(-6.0, -5.0), (7.0, -3.0), (7.5, 0.5), (-5.0, 2.0), (-4.0, 6.0), (8.0, 5.0)]
    ring = [(2.0, 1.0), (6.0, 2.0), (5.0, 5.0), (1.5, 4.0)]

    def written(latitude: float, offsets: list[tuple[float, float]]) -> str:
        each = []
        for east, north in offsets:
            lon, lat = sphere.destination(
                0.0, math.radians(latitude), east * 1852.0, north * 1852.0
            )
            each.append(f"[{math.degrees(lon):.9f}, {math.degrees(lat):.9f}]")
        return ", ".join(each)

    pos = []
    for at, latitude in (("00 00N", 0.0), ("90 00N", 90.0)):
        sorties = f"""
[[sortie]]
name = "legs"
start = "+70 min"
sweep_width = "1.5 nmi"
law = "inverse_cube"
waypoints = [{written(latitude, flown)}]
speed = "90 kn"
[[sortie]]
name = "legs of another law"
start = "+71 min"
sweep_width = "1.5 nmi"
law = "definite_range"
waypoints = [{written(latitude, flown)}]
speed = "90 kn"
[[sortie]]
name = "area"
area = {{ polygon = [{written(latitude, ring)}] }}
start = "+2 h"
end = "+210 min"
law = "random"
pod = 0.6
"""
        how = {"hours": 4, "n": 40_000, "step": "1 h", "speed": 1, "at": at, "error": 3}
        pos.append([update["pos"]["all"] for update in searched(tmp_path, sorties, **how)])
    # The same particles by seed and slot, but for the tangent plane's third order, 5 mm: one at an
    # edge may differ.
    assert pos[1] == pytest.approx(pos[0], abs=1 / 40_000)


@pytest.mark.usefixtures("coarse_maps")
@pytest.mark.parametrize("step", [pytest.param("5 min", marks=pytest.mark.thorough), "1 h"])
def test_a_pattern_drifts_with_its_datum_past_a_pole_as_past_any_point(
    tmp_path: Path, step: str
) -> None:
    """An expanding square in the frame of a datum that drifts past the pole, a mile and a half from
    it, on both sides.
    """
    pos = {}
    for pole in (0, 1, -1):
        lon, lat = np.degrees(sphere.destination(0.0, pole * math.pi / 2, 1.3 * 1852, -0.8 * 1852))
        # The first leg leads 30 degrees east of what is north at the meridian of 0.
        sortie = f"""
[[sortie]]
name = "square"
start = "+10 min"
sweep_width = "1 nmi"
law = "inverse_cube"
frame = "datum"
speed = "12 kn"
[sortie.pattern]
kind = "square"
datum = [{lon:.9f}, {lat:.9f}]
spacing = "1 nmi"
legs = 9
orientation = {(30 + pole * lon) % 360:.6f}
"""
        at = ("00 00N", "90 00N", "90 00S")[pole]
        how = {"hours": 4, "n": 10_000, "step": step, "speed": 1.5, "at": at, "error": 3}
        (update,) = searched(tmp_path, sortie, **how)
        pos[pole] = update["pos"]["all"]
    # In a minute a marker goes 46 m, 2.8 km from the pole: its chord in lon and lat bulges by 0.1
    # m, 5e-5 of a sweep width.
    for pole in (1, -1):
        assert pos[pole] == pytest.approx(pos[0], rel=5e-5)


@pytest.mark.thorough
@pytest.mark.usefixtures("coarse_maps")
@pytest.mark.parametrize("pole", [-1])
def test_the_area_of_a_pattern_round_a_pole_is_the_circle_about_it(
    tmp_path: Path, pole: int
) -> None:
    """A sector search through the pole of 320 nmi:

    POC is that of a circular normal whose 50 % circle has 250 nmi.
    """
    n, at = 4000, f"90 00{'N' if pole > 0 else 'S'}"
    sortie = f"""
[[sortie]]
name = "sectors"
start = "+70 min"
sweep_width = "20 nmi"
law = "inverse_cube"
frame = "ground"
pattern = {{ kind = "sector", datum = "{at} 000 00E", radius = "320 nmi", orientation = 20 }}
speed = "280 kn"
"""
    how = {"hours": 16, "n": n, "step": "1 h", "speed": 0, "at": at, "error": 250}
    (update,) = searched(tmp_path, sortie, **how)
    expected = 1 - 2 ** -((320 / 250) ** 2)
    # A circle is 36 corners, which leave out 0.2 %: a quarter of a standard error.
    assert update["poc"]["all"] == pytest.approx(
        expected, abs=4 * math.sqrt(expected * (1 - expected) / n)
    )


@pytest.mark.usefixtures("coarse_maps")
@pytest.mark.parametrize("pole", [1, -1])
@pytest.mark.parametrize("ends", [((-8, 2), (8, 2)), ((8, 0.5), (0.01, 0.6)), ((-8, 0.5), (0, 0))])
@pytest.mark.thorough
def test_a_leg_beside_the_pole_passes_what_is_abeam(tmp_path: Path, pole: int, ends: tuple) -> None:
    """M-beta counts a pass abeam by the leg's own course: in the plane of the pole, east and west
    of the meridian of 0.
    """

    def at(x: float, y: float) -> list[float]:
        lat = pole * (90 - math.degrees(math.hypot(x, y) * 1852 / sphere.RADIUS))
        return [round(math.degrees(math.atan2(x, y)), 9), round(lat, 9)]

    sortie = {
        "name": "s",
        "start": "+15 min",
        "speed": "20 kn",
        "law": {"m_beta": 0.8},
        "sweep_width": "1 nmi",
        "waypoints": [at(*end) for end in ends],
    }
    case = trial_case.load(
        tmp_path,
        duration="2 h",
        particles=4000,
        uncertainty="none",
        clock={"step": "1 h"},
        current={"constant": {"east": 0, "north": 0}},
        scenario={"position": {"at": at(0, -2), "error": "6 nmi"}},
        sortie=[sortie],
    )
    result = drift.run(case)
    tracks = next(iter(drift.run_many([case])))
    far = np.radians(90 - np.abs(tracks.lat[0])) * sphere.RADIUS / 1852
    x, y = far * np.sin(np.radians(tracks.lon[0])), far * np.cos(np.radians(tracks.lon[0]))
    (ax, ay), (bx, by) = ends
    long = math.hypot(bx - ax, by - ay)
    along = ((x - ax) * (bx - ax) + (y - ay) * (by - ay)) / long
    across = np.abs((x - ax) * (by - ay) - (y - ay) * (bx - ax)) / long
    passed = (along > 0) & (along < long) & (across < 0.5 / 0.8)
    # Of 4000 particles two lie within the third order of the plane at an edge.
    assert result.updates.all[0].pos[-1] == pytest.approx(0.8 * passed.mean(), abs=5e-4)


@pytest.mark.parametrize(("latitude", "arrow"), [(89.9, False), (-88.5, False), (87.0, True)])
def test_no_north_arrow_where_north_is_no_direction_of_the_paper(
    latitude: float, arrow: bool
) -> None:
    frame = chart.frame(np.array([20.0, 30.0]), np.array([latitude - 0.05, latitude + 0.05]), 1.3)
    axes = Figure().add_subplot()
    chart.prepare(axes, frame)
    chart.scale_bar(axes, frame, (0.015, 0.015))
    assert ("N" in [text.get_text() for text in axes.texts]) == arrow


@pytest.mark.parametrize("pole", [1, -1])
def test_a_chart_holds_cells_that_reach_over_the_pole(pole: int) -> None:
    lon, lat = np.linspace(-180, 180, 50), pole * np.linspace(89.8, 90.0007, 50)
    frame = chart.frame(lon, lat, 1.3)
    assert np.isfinite([*frame.x, *frame.y]).all()
    assert frame.holds(*frame.project(lon, lat)).all()
