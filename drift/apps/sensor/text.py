"""A sensor's reach as text and numbers: for the terminal, for programs, and for the map."""

import math
from typing import Any

import numpy as np

from drift.apps.sensor import reach as reaching
from drift.apps.sensor.records import Question, Reach
from geo import notation
from geo.array import Array
from geo.notation import NMI


def reach_facts(found: Reach) -> dict[str, str]:
    """Return the reach as facts by name."""
    question, pod = found.question, f"{notation.hundredths(reaching.HALF)} %"
    facts = {"sensor": f"{question.sensor.name}, {described(question)}"}
    if found.farthest.max() <= 0:
        facts[f"{pod} out to"] = (
            f"nowhere: the probability is {100 * found.around.pod.max():.2g} % at most"
        )
    else:
        facts[f"{pod} out to"] = _spread(found.farthest)
        if np.any(found.unbroken < found.farthest - 1.0):
            facts[f"{pod} without a gap to"] = _spread(found.unbroken)
        order = reaching.bearings_by_range(found)
        first, last = int(order[0]), int(order[-1])
        if _is_omnidirectional(found):
            facts["bearings"] = "all equal"
        else:
            facts["best bearing"] = f"{first:03d}, to {_miles(found.farthest[first])}"
            facts["worst bearing"] = f"{last:03d}, to {_miles(found.farthest[last])}"
        middle = _median(found)
        facts["zones" if _is_omnidirectional(found) else f"zones on {middle:03d}"] = ", ".join(
            f"{a / NMI:.1f} to {b / NMI:.1f} nmi" for a, b in zones(found, middle)
        )
    return facts | {f"assumed, {name}": words for name, words in question.assumed}


def described(question: Question) -> str:
    """Describe the position, time, heading and beams of a look."""
    words = [f"at {notation.stated_position(*question.place)}", notation.format_dtg(question.time)]
    if question.has_array:
        words.append(f"array on {round(math.degrees(question.heading)) % 360:03d}")
    return ", ".join([*words, *([_listened(question)] if _listened(question) else [])])


def _listened(question: Question) -> str:
    """Describe the processed beams; "" if there is only one."""
    sonar = question.sonar
    if sonar is None or len(sonar.gain.beams) == 1:
        return ""
    many = len(sonar.gain.beams)
    if not question.beams:
        return f"all {many} beams"
    return f"beam{'s' * (len(question.beams) > 1)} {', '.join(str(beam + 1) for beam in question.beams)} of {many}"


def _is_omnidirectional(found: Reach) -> bool:
    """Return True if the detection is the same on all bearings."""
    return bool(np.ptp(found.around.pod, axis=0).max() < 1e-4)


def _median(found: Reach) -> int:
    """Return the bearing [deg] with the median range; the first of several."""
    return int(np.argsort(np.round(found.farthest), kind="stable")[reaching.BEARINGS // 2])


def zones(found: Reach, bearing: int) -> list[tuple[float, float]]:
    """Return the zones [m] of 50 % detection on a bearing [deg]."""
    return reaching.zones(found.range, found.around.pod[bearing])


def _miles(metres: float) -> str:
    """Return a range [m] as text in nautical miles."""
    return f"{metres / NMI:.1f} nmi" if metres > 0 else "nowhere"


def _spread(ranges: Array) -> str:
    """Return the minimum, median and maximum over bearings of ranges [m] as text."""
    least, middle, most = np.quantile(ranges, [0.0, 0.5, 1.0], method="higher") / NMI
    if most - least < 0.05:
        return f"{most:.1f} nmi on all bearings"
    return f"{least:.1f} nmi at least, {middle:.1f} median, {most:.1f} at most, by bearing"


def summary_of_reach(found: Reach) -> dict[str, Any]:
    """Return the reach for programs; names end in the unit."""
    question, order, middle = found.question, reaching.bearings_by_range(found), _median(found)
    sonar = question.sonar
    return {
        "name": question.sensor.name,
        "kind": "sonar" if sonar is not None else "pod",
        "time": question.time,
        "lon_deg": question.place[0],
        "lat_deg": question.place[1],
        "heading_deg": math.degrees(question.heading) if question.has_array else None,
        "beams": [beam + 1 for beam in question.beams] or None,
        "source_level_db": question.level,
        "extent_nmi": found.extent / NMI,
        "range_50_nmi": _range_quantiles(found.farthest),
        "range_50_unbroken_nmi": _range_quantiles(found.unbroken),
        "best_bearing_deg": int(order[0]),
        "worst_bearing_deg": int(order[-1]),
        "median_bearing_deg": middle,
        "zones_nmi": [[a / NMI, b / NMI] for a, b in zones(found, middle)],
        "assumed": dict(question.assumed),
    }


def _range_quantiles(ranges: Array) -> dict[str, float]:
    names = ("min", "median", "max")
    return dict(
        zip(
            names,
            (np.quantile(ranges, [0.0, 0.5, 1.0], method="higher") / NMI).tolist(),
            strict=True,
        )
    )
