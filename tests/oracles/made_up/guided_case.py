"""A raft and its debris in a current of unknown bias, for tests of guided particles."""

import contextlib
from pathlib import Path

import numpy as np

import drift
from drift.engine.motion import simulate
from drift.pipeline import run_setup
from geo import sphere
from kernels.runtime import runtime

HOURS = 12
HEAD = """
start = "2026-11-21T00:00Z"
duration = "12 h"
particles = {particles}
seed = 5
output.every = "12 h"
clock.step = "15 min"
[coast]
source = "none"
"""
STILL = """
[[current]]
constant = {{ speed = "0 kn", toward = 0 }}
[[wind]]
constant = {{ speed = "8 m/s", from = 270 }}
[uncertainty]
diffusivity = "10 m2/s"
current = {{ std = "{current} m/s", time = "6 h", bias = "{bias} m/s" }}
wind = {{ std = "{wind} m/s", time = "9 h" }}
"""
PLACES = ((-0.03, 0.02), (0.05, -0.04))  # [deg] of the two scenarios
WEIGHTS = (0.7, 0.3)
SLOPES = (0.03, 0.04)  # of the object, and of its debris
D, ERROR = 10.0, 200.0


def text_of(particles, current, bias, wind, release):
    """Return a case of two scenarios that differ in their place; release [m]."""
    text = HEAD.format(particles=particles) + STILL.format(current=current, bias=bias, wind=wind)
    for name, place, weight in zip("ab", PLACES, WEIGHTS, strict=True):
        text += f'[[scenario]]\nname = "{name}"\nweight = {weight}\nobject = {{ windage = "{100 * SLOPES[0]:g} %" }}\n'
        text += f'position = {{ at = {list(place)}, std = ["{release} m", "{0.4 * release} m"], orientation = 30 }}\n'
    return text


def find_text(name, east, north, hours=HOURS, more=""):
    """Return a find of debris, so many metres from 0 N 0 E."""
    lon, lat = (float(np.degrees(x)) for x in sphere.destination(0.0, 0.0, east, north))
    text = f'[[contact]]\nname = "{name}"\ntime = "+{hours} h"\nof = {{ windage = "{100 * SLOPES[1]:g} %" }}\n'
    return text + f'position = {{ at = [{lon}, {lat}], std = "{ERROR} m" }}\n{more}'


def loaded(tmp_path: Path, text: str) -> drift.Case:
    (tmp_path / "case.toml").write_text(text)
    return drift.load(tmp_path / "case.toml")


def begun(tmp_path, text):
    """Return a case and the start of its run, with its forcing."""
    case = loaded(tmp_path, text)
    runtime.start()
    return case, run_setup.prepare(case, run_setup.open_for(case))


def run_of(tmp_path, text):
    """Return where particles are at the end [m] (2, n), their weights, what each find did, and the
    guide.
    """
    case, begin = begun(tmp_path, text)
    search = run_setup.build_search_filter(case, begin)
    with contextlib.closing(begin.scene.forcing):
        list(simulate.run(begin.ensemble, begin.scene, begin.clock, np.array([0]), search=search))
    lon, lat = (begin.ensemble.columns[name].to_numpy() * sphere.UNIT for name in ("lon", "lat"))
    weight = np.exp(begin.ensemble.log_weight.to_numpy().astype(float))
    return (
        np.stack(sphere.offset(0.0, 0.0, lon, lat)),
        weight / weight.sum(),
        search.updates,
        begin.guide,
    )
