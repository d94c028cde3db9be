"""Where a sensor hears, in words and numbers: for the terminal, for programs, and under the title
of the picture.
"""

import math
from typing import Any

import numpy as np

from drift.apps.sensor import reach as reaching
from drift.apps.sensor.records import Question, Reach
from geo import notation
from geo.array import Array
from geo.notation import NMI


def reach_facts(found: Reach) -> dict[str, str]:
    """Return what was found, by name."""
    asked, pod = found.question, f"{notation.hundredths(reaching.HALF)} %"
    told = {"sensor": f"{asked.sensor.name}, {described(asked)}"}
    if found.farthest.max() <= 0:
        told[f"{pod} out to"] = (
            f"nowhere: the chance is {100 * found.around.pod.max():.2g} % at most"
        )
    else:
        told[f"{pod} out to"] = spread(found.farthest)
        if np.any(found.unbroken < found.farthest - 1.0):
            told[f"{pod} without a gap to"] = spread(found.unbroken)
        order = reaching.order(found)
        first, last = int(order[0]), int(order[-1])
        if alike(found):
            told["bearings"] = "all equal"
        else:
            told["best bearing"] = f"{first:03d}, to {miles(found.farthest[first])}"
            told["worst bearing"] = f"{last:03d}, to {miles(found.farthest[last])}"
        middle = median(found)
        told["zones" if alike(found) else f"zones on {middle:03d}"] = ", ".join(
            f"{a / NMI:.1f} to {b / NMI:.1f} nmi" for a, b in zones(found, middle)
        )
    return told | {f"assumed, {name}": words for name, words in asked.assumed}


def described(asked: Question) -> str:
    """Return where a sensor is, when, and how it is turned."""
    words = [f"at {notation.stated_position(*asked.place)}", notation.group(asked.time)]
    if asked.has_array:
        words.append(f"array on {round(math.degrees(asked.heading)) % 360:03d}")
    return ", ".join([*words, *([listened(asked)] if listened(asked) else [])])


def listened(asked: Question) -> str:
    """Return which beams are listened to; nothing where there is one."""
    sonar = asked.sonar
    if sonar is None or len(sonar.gain.beams) == 1:
        return ""
    many = len(sonar.gain.beams)
    if not asked.beams:
        return f"all {many} beams"
    return f"beam{'s' * (len(asked.beams) > 1)} {', '.join(str(beam + 1) for beam in asked.beams)} of {many}"


def alike(found: Reach) -> bool:
    """Whether all bearings are heard alike."""
    return bool(np.ptp(found.around.pod, axis=0).max() < 1e-4)


def median(found: Reach) -> int:
    """Return the bearing [deg] on which it hears to the median of all ranges; of several the first."""
    return int(np.argsort(np.round(found.farthest), kind="stable")[reaching.BEARINGS // 2])


def zones(found: Reach, bearing: int) -> list[tuple[float, float]]:
    """Return the zones [m] of a bearing [deg]."""
    return reaching.zones(found.range, found.around.pod[bearing])


def miles(metres: float) -> str:
    """Return a range in words."""
    return f"{metres / NMI:.1f} nmi" if metres > 0 else "nowhere"


def spread(ranges: Array) -> str:
    """Return the least, the median and the most of ranges [m] by bearing."""
    least, middle, most = np.quantile(ranges, [0.0, 0.5, 1.0], method="higher") / NMI
    if most - least < 0.05:
        return f"{most:.1f} nmi on all bearings"
    return f"{least:.1f} nmi at least, {middle:.1f} median, {most:.1f} at most, by bearing"


def summary_of_reach(found: Reach) -> dict[str, Any]:
    """Return the same for programs."""
    asked, order, middle = found.question, reaching.order(found), median(found)
    sonar = asked.sonar
    return {
        "name": asked.sensor.name,
        "kind": "sonar" if sonar is not None else "pod",
        "time": asked.time,
        "lon_deg": asked.place[0],
        "lat_deg": asked.place[1],
        "heading_deg": math.degrees(asked.heading) if asked.has_array else None,
        "beams": [beam + 1 for beam in asked.beams] or None,
        "source_level_db": asked.level,
        "extent_nmi": found.extent / NMI,
        "range_50_nmi": _spread(found.farthest),
        "range_50_unbroken_nmi": _spread(found.unbroken),
        "best_bearing_deg": int(order[0]),
        "worst_bearing_deg": int(order[-1]),
        "median_bearing_deg": middle,
        "zones_nmi": [[a / NMI, b / NMI] for a, b in zones(found, middle)],
        "assumed": dict(asked.assumed),
    }


def _spread(ranges: Array) -> dict[str, float]:
    names = ("min", "median", "max")
    return dict(
        zip(
            names,
            (np.quantile(ranges, [0.0, 0.5, 1.0], method="higher") / NMI).tolist(),
            strict=True,
        )
    )
