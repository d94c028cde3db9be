"""Description of a tracking case as the program understood it."""

import math

import numpy as np

from drift.tracking.tracker import doubts, path
from drift.tracking.tracker.detections import Detections
from drift.tracking.tracker.pursuit import Pursuit
from drift.tracking.tracker.records import Behaviour, Plan, Sensor, Tracker
from drift.tracking.tracker.study import Scene, Study, figures
from geo import notation, sphere
from geo.array import Array
from geo.notation import KNOT, NMI


def tracking_facts(study: Study) -> dict[str, str]:
    """Return a labelled line for each part of a tracking case."""
    facts = {
        "time": f"{_moment(study, 0.0)} to {_moment(study, study.end)}, figures every {notation.format_duration(study.every)}"
    }
    facts["cloud"] = f"{study.size:,} particles, seed {study.seed}"
    if isinstance(study.target, Scene):
        facts["target"] = _target(study.target)
        low, high = study.window
        over = (
            ""
            if low <= 0 and high >= study.end
            else f", over {notation.format_duration(low)} to {notation.format_duration(min(high, study.end))}"
        )
        facts["runs"] = (
            f"{study.runs:,}: {', '.join(figures(study.areas, study.criteria is not None))}{over}"
        )
    else:
        facts["detections"] = _detections(study, study.target)
    facts["land"] = (
        "particles turn at the shore (GSHHG)" if study.minds_land else "particles pass over it"
    )
    facts["tracker"] = _way(study.tracker.place, study.tracker.rate)
    written = isinstance(study.target, Detections)
    facts |= {f'sensor "{sensor.name}"': _sensor(sensor, written) for sensor in study.sensors}
    facts |= {f'way of following "{method.name}"': _method(method) for method in study.methods}
    if (chase := study.pursuit) is not None:
        facts["pursuit"] = (
            f"to {chase.aim} it, from {notation.stated_position(*np.degrees(chase.start))} at {_moment(study, chase.begin)}{_goal(chase)}, "
            f"{chase.steps} looks every {notation.format_duration(chase.interval)}, {notation.number(chase.speed / KNOT)} kn, within {notation.number(chase.reach / NMI)} nmi"
        )
    doubted = doubts.doubts_about(study)
    return {**facts, "warning": "; ".join(doubted)} if doubted else facts


def _goal(chase: Pursuit) -> str:
    """Return the destination as text."""
    return "" if chase.to is None else f" to {notation.stated_position(*np.degrees(chase.to))}"


def _moment(study: Study, seconds: float) -> str:
    """Return the date-time group of seconds after the start."""
    return notation.format_dtg(np.datetime64(notation.epoch(study.start) + round(seconds), "s"))


def _way(place: Array, rate: Array) -> str:
    """Return the start and speed of a path as text."""
    lon, lat = path.degrees(place[0])
    speed = rate * sphere.RADIUS / KNOT
    if not len(speed) or speed.max() < 0.005:
        return f"stays at {notation.stated_position(float(lon), float(lat))}"
    low, high = notation.number(float(speed.min()), 3), notation.number(float(speed.max()), 3)
    return f"from {notation.stated_position(float(lon), float(lat))}, {low if low == high else f'{low} to {high}'} kn"


def _target(scene: Scene) -> str:
    """Return an experiment's target as text."""
    words = _way(scene.way.place, scene.way.rate)
    if scene.radiates is not None:
        words += f"; its radar {_on(scene.radiates)}"
    return words + (f"; then it {_behaviour(scene.acts)}" if scene.acts is not None else "")


def _detections(study: Study, found: Detections) -> str:
    """Return the recorded detections as text."""
    counts = [int((found.sensor == k).sum()) for k in range(len(study.sensors))]
    each = ", ".join(
        f"{n} by {sensor.name}" for n, sensor in zip(counts, study.sensors, strict=True)
    )
    return f"{len(found.time)}, {_moment(study, found.time[0])} to {_moment(study, found.time[-1])}: {each}"


def _sensor(sensor: Sensor, written: bool) -> str:
    """Return a sensor as text; written: whether its detections were recorded."""
    bearing = (
        "any bearing"
        if sensor.bearing_error >= math.pi
        else f"bearing +- {notation.number(math.degrees(sensor.bearing_error))} deg"
    )
    words = f"to {notation.number(sensor.reach / NMI)} nmi, range +- {notation.hundredths(sensor.range_share)} %, {bearing}"
    if sensor.hears:
        return f"{words}; hears a radiating target, its silence is no evidence"
    words = f"{words}; sweeps every {notation.number(sensor.interval)} s, {_on(sensor.on)}"
    silent = written and sensor.on.begin < math.inf
    return words + (
        f"; its silence is evidence only {notation.format_duration(sensor.grace)} or more from a plot within its reach"
        if silent
        else ""
    )


def _on(plan: Plan) -> str:
    """Return a schedule as text."""
    if plan.begin == math.inf or plan.lasting == 0:
        return "off"
    if plan.lasting == math.inf:
        return "on" if plan.begin == 0 else f"on from +{notation.format_duration(plan.begin)}"
    again = f" every {notation.format_duration(plan.every)}" if plan.every < math.inf else ""
    return f"on for {notation.format_duration(plan.lasting)}{again} from +{notation.format_duration(plan.begin)}"


def _method(method: Tracker) -> str:
    """Return a way of following as text."""
    filling = method.filling
    return (
        f"{_behaviour(method.behaviour)}; below {notation.hundredths(filling.partial)} % duplicated, below {notation.hundredths(filling.bulk)} % repopulated by "
        f"{filling.method} or lost"
    )


def _behaviour(law: Behaviour) -> str:
    """Return a behaviour as text."""
    most = f"up to {notation.number(law.fastest / KNOT)} kn"
    if law.acts is None:
        return f"keeps course and speed, {most}"
    chances = (("changes", law.change), ("seeks", law.seek), ("hides", law.hide))
    each = ", ".join(
        f"{what} with {notation.hundredths(chance)} %" for what, chance in chances if chance > 0
    )
    soonest, latest = law.acts
    return f"{each or 'keeps course and speed'} every {notation.format_duration(soonest)} to {notation.format_duration(latest)}, {most}"
