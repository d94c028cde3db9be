"""Searches and shores inside steps do not depend on the length of the step."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

import drift
from drift.engine.motion import step_size
from drift.engine.particles.status import Status
from geo import sphere


def test_the_error_of_a_step_counts_what_goes_wrong_inside_it() -> None:
    """A step of an hour whose ends agree with those of half an hour, and which half-way is 33 m
    off.
    """
    lon, lat = np.arange(200), np.arange(200) * 1000
    end = lon, lat, np.full(200, Status.ADRIFT)
    agreeing = step_size._Window({3600: end, 1800: end}, np.ones(200), {3600: 33.0}, {3600: 0.0})
    assert agreeing.error(3600) == 33.0
    # 100,000 units of 9.3 mm northward within half a day
    apart = lon, lat + 100_000, end[2]
    strayed = step_size._Window(
        {3600: end, 1800: apart}, np.full(200, 0.5), {3600: 33.0}, {3600: 0.0}
    )
    assert strayed.error(3600) == pytest.approx(2 * 100_000 * sphere.UNIT * sphere.RADIUS, rel=1e-6)


TIDAL = """
start = "2026-06-10T00:00Z"
duration = "7 h"
particles = 4000
seed = 4
uncertainty = "none"
[output]
every = "7 h"
[coast]
source = {coast}
{behaviour}
[clock]
step = "{step}"
[[current]]
table = [
 {{ time = "2026-06-10T00:00Z", speed = "0.1 m/s", toward = 30 }},
 {{ time = "2026-06-10T01:00Z", speed = "1.2 m/s", toward = 75 }},
 {{ time = "2026-06-10T02:00Z", speed = "2.1 m/s", toward = 130 }},
 {{ time = "2026-06-10T03:00Z", speed = "2.4 m/s", toward = 190 }},
 {{ time = "2026-06-10T04:00Z", speed = "2.1 m/s", toward = 250 }},
 {{ time = "2026-06-10T05:00Z", speed = "1.2 m/s", toward = 300 }},
 {{ time = "2026-06-10T07:00Z", speed = "0.1 m/s", toward = 330 }},
]
[[scenario]]
name = "x"
object = "water"
position = {{ at = "40 00N 040 00W", error = "600 m" }}
"""
LEGS = [
    [-39.88, 39.975],
    [-39.905, 39.955],
    [-39.88, 39.94],
    [-39.905, 39.925],
    [-39.89, 39.905],
    [-39.92, 39.9],
    [-39.91, 39.885],
]
SORTIES = f"""
[[sortie]]
name = "legs"
start = "2026-06-10T02:20Z"
sweep_width = "400 m"
law = "inverse_cube"
speed = "9 kn"
waypoints = {LEGS}
[[sortie]]
name = "legs of another law"
start = "2026-06-10T02:21Z"
sweep_width = "400 m"
law = "definite_range"
speed = "9 kn"
waypoints = {LEGS}
[[sortie]]
name = "stays"
start = "2026-06-10T03:10Z"
end = "2026-06-10T03:50Z"
law = "random"
pod = 0.8
area = {{ polygon = [[-39.93, 39.887], [-39.903, 39.887], [-39.903, 39.9], [-39.93, 39.9]] }}
[[look]]
name = "look"
time = "2026-06-10T03:30Z"
at = [-39.9078, 39.8979]
radius = "300 m"
sees = "nothing"
[[presence]]
name = "field"
at = [-39.9078, 39.8979]
radius = "500 m"
start = "2026-06-10T03:05Z"
end = "2026-06-10T03:52Z"
present = "never"
detection = 0.8
[[barrier]]
name = "line"
points = [[-39.93, 39.894], [-39.885, 39.894]]
start = "2026-06-10T02:40Z"
end = "2026-06-10T04:20Z"
detection = 0.7
"""
SQUARE = """
[[sortie]]
name = "square"
start = "2026-06-10T00:00Z"
sweep_width = "400 m"
law = "inverse_cube"
frame = "datum"
pattern = { kind = "square", datum = "40 00N 040 00W", spacing = "400 m", orientation = 40, legs = 9 }
speed = "2 kn"
"""


def written(folder: Path, **how: str) -> Path:
    path = folder / "case.toml"
    path.write_text(TIDAL.format(**how))
    return path


@pytest.mark.thorough
def test_what_searches_inside_steps_find_does_not_depend_on_the_step(tmp_path: Path) -> None:
    """A tide that turns through 270 degrees in five hours: POS at an hour's steps against steps of
    three minutes.

    Where the drift bends southward between 03:00 and 04:00 lie an area, a look, a field and a line
    across it.
    """
    pos = {}
    for step in ("1 h", "3 min"):
        path = written(tmp_path, step=step, coast='"none"', behaviour="")
        path.write_text(path.read_text().replace("7 h", "5 h") + SORTIES)
        updates = drift.run(drift.load(path)).summary["search"]["updates"]
        pos[step] = {update["name"]: -np.expm1(update["log_evidence"]["all"]) for update in updates}
    for name, value in pos["3 min"].items():
        assert 0.05 < value < 0.95
        # Chords of up to 5 m and sweep widths of 400 m; a boundary's particles are 4000^-1/2 of
        # them.
        assert pos["1 h"][name] == pytest.approx(value, abs=0.006)


@pytest.mark.thorough
@pytest.mark.parametrize(
    "step",
    [
        "10 min",
        "1 h",
    ],
)
def test_a_pattern_that_drifts_with_its_datum_finds_what_it_finds_on_still_water(
    tmp_path: Path, step: str
) -> None:
    """A square about the middle of what drifts in a tide that turns: both go the same way."""
    pos = []
    for tidal in (True, False):
        path = written(tmp_path, step=step, coast='"none"', behaviour="")
        text = path.read_text()
        if not tidal:
            text = re.sub(r'speed = "[0-9.]+ m/s"', 'speed = "0 m/s"', text)
        path.write_text(text + SQUARE)
        (update,) = drift.run(drift.load(path)).summary["search"]["updates"]
        pos.append(-np.expm1(update["log_evidence"]["all"]))
    # Chords of up to 5 m and a sweep width of 400 m; a boundary's particles are 4000^-1/2 of them.
    assert pos[0] == pytest.approx(pos[1], abs=0.006)


@pytest.mark.parametrize("behaviour", ["strand", "slide", "refloat"])
@pytest.mark.thorough
def test_what_a_bent_way_meets_of_the_shore_does_not_depend_on_the_step(
    tmp_path: Path, behaviour: str
) -> None:
    """A spit that only the bend of the way reaches: shares ashore, and where the rest is, at the
    longest step and at three minutes.
    """
    # An island south-east of where the way turns between 03:00 and 04:00, a kilometre off the chord
    # of that hour.
    ring = [
        [-39.912, 39.891],
        [-39.898, 39.889],
        [-39.897, 39.8985],
        [-39.904, 39.9],
        [-39.912, 39.891],
    ]
    (tmp_path / "land.geojson").write_text(json.dumps({"type": "Polygon", "coordinates": [ring]}))
    key = f'behaviour = "{behaviour}"' + ('\nhalf_life = "3 h"' if behaviour == "refloat" else "")
    found = {}
    for step in ("10 min" if behaviour == "slide" else "1 h", "3 min"):
        result = drift.run(
            drift.load(written(tmp_path, step=step, coast='"land.geojson"', behaviour=key))
        )
        last = result.forecast.data.isel(time=-1)
        found[step] = (
            result.summary["account"]["ashore"],
            float(last["mean_lon"]),
            float(last["mean_lat"]),
        )
    (ashore, lon, lat), (fine_ashore, fine_lon, fine_lat) = found.values()
    if behaviour == "strand":
        assert 0.1 < fine_ashore < 0.9
    assert ashore == pytest.approx(fine_ashore, abs=0.01)
    # A hundredth of the particles, which what a chord of 5 m leaves out may be, are 5 km from where
    # they would be.
    assert lon == pytest.approx(fine_lon, abs=6e-4)
    assert lat == pytest.approx(fine_lat, abs=6e-4)


SPIT = [
    [-39.912, 39.891],
    [-39.898, 39.889],
    [-39.897, 39.8985],
    [-39.904, 39.9],
    [-39.912, 39.891],
]


def slid(folder: Path, step: str, *changes: tuple[str, str]) -> tuple[np.ndarray, np.ndarray]:
    """Return (lon, lat) [rad] (times, n) of particles that slide along SPIT."""
    (folder / "land.geojson").write_text(json.dumps({"type": "Polygon", "coordinates": [SPIT]}))
    path = written(folder, step=step, coast='"land.geojson"', behaviour='behaviour = "slide"')
    for old, new in changes:
        path.write_text(path.read_text().replace(old, new))
    (ran,) = drift.run_many([drift.load(path)])
    if ran.error:
        raise ran.error
    return np.radians(ran.lon), np.radians(ran.lat)


def test_the_step_is_chosen_for_what_slides_too(tmp_path: Path) -> None:
    """Corners passed by particles that slide, at steps of three minutes, the chosen one and the
    longest; a longer one is refused.
    """
    often = ('every = "7 h"', 'every = "15 min"')
    with pytest.raises(
        drift.UserError,
        match=r"3600 s is longer than the limit for sliding .*, 600 s: .*give at most that",
    ):
        slid(tmp_path, "1 h", often)
    fine = slid(tmp_path, "3 min", often)
    off = {
        step: sphere.distance(*fine, *slid(tmp_path, step, often)) for step in ("auto", "10 min")
    }
    # The error of a step, which is of first order where corners are passed, is twice what halving
    # it tells: 20 m a day.
    assert np.percentile(off["auto"], 95, axis=1).max() < 40
    # At ends of ten minutes: their 1.4 km are slid in pieces of 50 m, and each corner leads at most
    # one of them astray.
    assert np.percentile(off["10 min"][::2], 95, axis=1).max() < 50


@pytest.mark.thorough
def test_what_slides_and_walks_is_where_it_is_at_any_step(tmp_path: Path) -> None:
    """With a random walk: the mean place after each hour at steps of three minutes and of ten,
    other noise in each.
    """
    walk = 'uncertainty = { current = "none", wind = "none", diffusivity = "0.5 m2/s" }'
    changes = ('uncertainty = "none"', walk), ('every = "7 h"', 'every = "1 h"'), ("4000", "20_000")
    middle = np.radians([-39.9, 39.9])
    places = [
        np.stack(sphere.offset(*middle, *slid(tmp_path, step, *changes)))
        for step in ("3 min", "10 min")
    ]
    apart = np.diff([place.mean(axis=-1) for place in places], axis=0)
    error = np.sqrt(sum(place.var(axis=-1) for place in places) / 20_000)
    assert np.abs(apart / error).max() < 3.5  # of 16 means
