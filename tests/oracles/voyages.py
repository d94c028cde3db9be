"""Yachts, bridges and boats that drift, as cases of which the tests ask what is believed."""

from pathlib import Path

import numpy as np

from drift.case import file as case_file
from drift.case.record import Case
from drift.engine.motion import simulate
from drift.evidence.posterior import marginal
from drift.evidence.posterior.records import Posteriors
from drift.pipeline import run_setup
from geo.array import Array
from kernels.runtime import runtime

CALM = """
start = "2026-03-05T00:00Z"
duration = "30 h"
particles = {n}
[clock]
step = "1 h"
[coast]
source = "none"
[uncertainty]
diffusivity = 0
[[current]]
constant = {{ speed = "0.9 kn", toward = 141 }}
"""
YACHT = """
[[scenario]]
name = "yacht"
weight = {weight}
[[scenario.phase]]
[scenario.phase.voyage]
waypoints = [[178.3, 43.1], [-176.9, 44.2]]
departure = ["+1 h", "+9 h"]
speed = {{ low = "5 kn", best = "7 kn", high = "11 kn", ratio = 4 }}
"""
AT_RISK = f"""
{YACHT.replace("[[scenario.phase]]", 'object = "water"' + chr(10) + "[[scenario.phase]]")}
[scenario.distress]
between = ["+4 h", "+41 h"]
"""
TENDER = """
[[scenario]]
name = "tender"
weight = {weight}
object = "water"
position = {{ at = [178.3, 43.1], std = "3 nmi", time = "+2 h", until = "+6 h" }}
"""
COURSE = """
[[scenario]]
name = "course"
weight = {weight}
[scenario.position]
at = [178.3, 43.1]
std = "3 nmi"
[[scenario.phase]]
[scenario.phase.course]
course = {{ low = 330, best = 350, high = 65, ratio = 3 }}
speed = ["4 kn", "9 kn"]
"""
BRIDGE = """
[[scenario]]
name = "bridge"
weight = {weight}
[[scenario.phase]]
[scenario.phase.bridge]
k = "3 nmi/sqrt(h)"
k_spread = 1.6
[[scenario.phase.bridge.points]]
at = [178.3, 43.1]
std = "2 nmi"
time = ["+1 h", "+3 h"]
[[scenario.phase.bridge.destinations]]
at = [-179.2, 44.9]
std = "3 nmi"
time = ["+20 h", "+26 h"]
probability = 0.63
[[scenario.phase.bridge.destinations]]
at = [-178.8, 41.7]
std = "3 nmi"
time = ["+22 h", "+27 h"]
probability = 0.37
"""
CONTACT = """
[[contact]]
name = "{name}"
time = "+{hours} h"
position = {{ at = [{lon}, {lat}], error = "{error} nmi" }}
"""


def load(
    folder: Path,
    *parts: str,
    n: int = 4000,
    weights: tuple[float, ...] = (),
    extra: str = "",
    **more: object,
) -> Case:
    """Return a case of parts, each scenario with its weight."""
    given = weights or (1.0,) * len(parts)
    text = "".join(part.format(weight=weight) for part, weight in zip(parts, given, strict=True))
    (folder / "case.toml").write_text(CALM.format(n=n) + extra + text + "".join(more.values()))  # type: ignore[arg-type]
    return case_file.load(folder / "case.toml")


def believed(case: Case) -> tuple[Posteriors, run_setup.Start]:
    """Run a case without its products; return its posteriors, and its ensemble as it is at the end."""
    runtime.start()
    begin = run_setup.prepare(case, run_setup.open_for(case))
    held = run_setup.beliefs(case, begin)
    assert held is not None
    search = run_setup.build_search_filter(case, begin, held)
    list(simulate.run(begin.ensemble, begin.scene, begin.clock, np.array([]), search=search))
    begin.scene.forcing.close()
    assert held.posteriors is not None
    return held.posteriors, begin


def of(posteriors: Posteriors, stage: int, name: str) -> marginal.Marginal:
    """Return the distribution of a quantity after an update."""
    number = [told.quantity.name for told in posteriors.told].index(name)
    return posteriors.stages[stage].marginals[number]


def moments(values: Array, weight: Array) -> tuple[float, float, float]:
    """Return mean, standard deviation and effective number."""
    mean = np.average(values, weights=weight)
    return (
        mean,
        np.sqrt(np.average((values - mean) ** 2, weights=weight)),
        weight.sum() ** 2 / (weight**2).sum(),
    )
