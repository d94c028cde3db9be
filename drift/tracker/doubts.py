"""What must be doubted in a tracking case before anything is followed: plots and logs that no vessel made."""

from collections import Counter

import numpy as np

from drift.tracker import detections
from drift.tracker.detections import Detections
from drift.tracker.study import Study
from geo import notation, sphere
from geo.notation import KNOT


def of(study: Study) -> list[str]:
    """Return what must be doubted in the detections and the tracker's log of a case, each in words."""
    told = _strayed(study)
    return [*_plots(study, study.target), *told] if isinstance(study.target, Detections) else told


def _moment(study: Study, seconds: float) -> np.datetime64:
    return np.datetime64(notation.epoch(study.start) + round(seconds), "s")


def _plots(study: Study, seen: Detections) -> list[str]:
    """Return which plots are too far from the one before, stand twice, or were made by what was off."""
    fastest, told = study.methods[0].behaviour.fastest, []
    rows = Counter(
        zip(
            seen.time, seen.sensor, *(np.nan_to_num(part, nan=-1.0) for part in (seen.bearing, seen.range)), strict=True
        )
    )
    for (time, number, *_), times in rows.items():
        if times > 1:
            when = notation.group(_moment(study, float(time)))
            told.append(
                f"the plot of {when} by {study.sensors[number].name} stands {times} times: check for one that is missing"
            )
    for time, speed in zip(*detections.needed(study.sensors, seen, study.tracker), strict=True):
        if speed > fastest * 1.001:
            told.append(
                f"the plot of {notation.group(_moment(study, time))} needs {speed / KNOT:,.0f} kn from the one before, "
                f"fastest is {fastest / KNOT:.3g} kn: check its bearing and range"
            )
    for number, time in zip(seen.sensor, seen.time, strict=True):
        sensor = study.sensors[number]
        # One that is never on is one whose silence is not to count.
        if not sensor.hears and np.isfinite(sensor.on.begin) and not sensor.on.includes(float(time)):
            when = notation.group(_moment(study, float(time)))
            told.append(f"{sensor.name} was off when it detected something at {when}: check when it is on")
    return told


def _strayed(study: Study) -> list[str]:
    """Return between which times the tracker's log has it go far faster than it mostly does."""
    way = study.tracker
    speed = way.rate * sphere.RADIUS / KNOT
    usual = float(np.median(speed[speed > 1.0])) if (speed > 1.0).sum() > 2 else np.inf
    times = [notation.iso(_moment(study, time)) for time in way.time]
    return [
        f"the tracker would make {speed[k]:,.0f} kn from {times[k]} to {times[k + 1]}, mostly it makes {usual:,.0f} kn: "
        "check its latitudes and longitudes there"
        for k in np.flatnonzero((speed > 2.5 * usual) & (speed > 20.0))
    ]
