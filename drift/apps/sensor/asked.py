"""Build the question to a sensor from a case and a user's options; invalid options are rejected."""

import difflib
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from drift.apps.sensor.records import Question
from drift.case.record import Case
from drift.case.sonar import sonar
from drift.case.values import fields, units
from drift.evidence.filter.records import Sortie
from drift.evidence.sensors import hearing, pod_table
from drift.evidence.sensors.records import Levels, Noise, PodGrid, Sensor, Sonar
from geo import notation, sphere
from geo.errors import UserError
from geo.notation import KNOT
from geo.polyline import Legs

Assumed = list[tuple[str, str]]


def question(
    case: Case,
    name: str,
    *,
    time: object = None,
    at: object = None,
    heading: object = None,
    beams: Sequence[int] | None = None,
    scenario: str | None = None,
    speed: object = None,
) -> Question:
    """Return the question for a sensor of a case.

    Args:
        case: the case.
        name: name of the sensor.
        time: time of the look, as a case writes times; None: a default, see `drift sensor --help`.
        at: position of the sensor, as a case writes positions; None: that of its table or sortie.
        heading: heading of its array [degrees from north].
        beams: numbers of beams, from 1; None: all.
        scenario: scenario that gives the source level; None: the likeliest.
        speed: speed of the target, for a source level that depends on speed; None: the lowest.

    Returns:
        The question, with the assumptions that were made.

    Raises:
        UserError: an option does not fit the case or the sensor.
    """
    sensor = _sensor(case, name)
    assumed: Assumed = []
    sortie = _carrying_sortie(case, sensor) if sensor.place is None and at is None else None
    when = _time(case, time, sortie, assumed)
    place, toward = _place(sensor, at, heading, sortie, when, assumed)
    try:
        beam_numbers = sonar.beam_indices(beams, sensor)
    except ValueError as error:
        raise UserError(f"--beams: {error}") from None
    level = _level(case, sensor, scenario, speed, assumed)
    if isinstance(sensor.sees, Sonar):
        assumed.append(("noise", _noise(sensor.sees.noise, when)))
    elif sensor.sees.times.size:
        assumed.append(("POD", _nearest_time_remark(sensor.sees.times, when)))
    assumed.append(("land", "does not block sound or sight, as in a run"))
    return Question(
        sensor, place, toward, when, beam_numbers, level, tuple((a, b) for a, b in assumed if b)
    )


def _sensor(case: Case, name: str) -> Sensor:
    there = case.named_sensors
    if name in there:
        return there[name]
    near = difflib.get_close_matches(name, list(there), n=1, cutoff=0.5)
    hint = f'did you mean "{near[0]}"? ' if near else ""
    names = ", ".join(there) or "none; write it as [[sensor]]"
    raise UserError(f'no sensor "{name}" in {case.path.name}; {hint}there are: {names}')


def _carrying_sortie(case: Case, sensor: Sensor) -> Sortie | None:
    """Return the sortie that carries a sensor, None without one; raise UserError for several."""
    every = [s for s in case.sorties if s.sensor is not None and s.sensor.name == sensor.name]
    every = [s for s in every if s.legs is not None and s.frame == "ground"]
    if len(every) > 1:
        names = ", ".join(f'"{sortie.name}"' for sortie in every)
        raise UserError(
            f'where is sensor "{sensor.name}"? Sorties {names} carry it: give --at, and '
            "--heading if it is an array"
        )
    return every[0] if every else None


def _time(case: Case, time: object, sortie: Sortie | None, assumed: Assumed) -> np.datetime64:
    if time is None:
        if sortie is not None and not sortie.start <= case.start <= sortie.end:
            assumed.append(
                (
                    "time",
                    f'{notation.format_dtg(sortie.start)}, the start of sortie "{sortie.name}"',
                )
            )
            return sortie.start
        assumed.append(("time", f"{notation.format_dtg(case.start)}, the start of the case"))
        return case.start
    try:
        return units.resolve(units.time(time), case.start)
    except ValueError as error:
        raise UserError(f"--time: {error}") from None


def _place(
    sensor: Sensor,
    at: object,
    heading: object,
    sortie: Sortie | None,
    when: np.datetime64,
    assumed: Assumed,
) -> tuple[tuple[float, float], float]:
    """Return the position of a sensor (lon, lat) [deg] and the heading of its array [rad]."""
    if sensor.place is not None:
        if at is not None or heading is not None:
            raise UserError(
                f'sensor "{sensor.name}" has the position of its table (at); remove --at and '
                "--heading, or change the table "
                "by --set"
            )
        return sensor.place, sensor.heading
    toward = _heading(heading)
    if at is not None:
        try:
            place = units.position(at)
        except ValueError as error:
            raise UserError(f"--at: {error}") from None
        array = isinstance(sensor.sees, Sonar) and len(sensor.sees.gain.bearing) > 1
        if array and toward is None:
            raise UserError(f'sensor "{sensor.name}" has an array: give its --heading, like 045')
        return place, toward or 0.0
    if sortie is not None:
        assert sortie.legs is not None
        if not sortie.start <= when <= sortie.end:
            raise UserError(
                f'sensor "{sensor.name}": sortie "{sortie.name}" carries it from '
                f"{notation.format_dtg(sortie.start)} to "
                f"{notation.format_dtg(sortie.end)}, not at {notation.format_dtg(when)}; give --time "
                "within, or --at"
            )
        place, course = _position_on_legs(sortie.legs, float(notation.epoch(when)))
        assumed.append(("place", f'that of sortie "{sortie.name}" then'))
        return place, course if toward is None else toward
    grid = sensor.sees
    if isinstance(grid, PodGrid) and grid.lon is not None and grid.lat is not None:
        assumed.append(
            (
                "place",
                "the centre of its table's coverage, from which ranges are measured: the table "
                "gives no position",
            )
        )
        return _coverage_centre(grid, when), toward or 0.0
    raise UserError(
        f'where is sensor "{sensor.name}"? Neither its table (at) nor a sortie gives a position; '
        "give --at"
    )


def _heading(heading: object) -> float | None:
    if heading is None:
        return None
    try:
        bare = float(heading) if isinstance(heading, str) else heading
    except ValueError:
        bare = heading
    try:
        return math.radians(fields.direction(bare))
    except ValueError as error:
        raise UserError(f"--heading: {error}") from None


def _position_on_legs(legs: Legs, time: float) -> tuple[tuple[float, float], float]:
    """Return position (lon, lat) [deg] and course [rad] on legs at a time [s since 1970]."""
    k = min(max(int(np.searchsorted(legs.time, time, side="right")) - 1, 0), len(legs.time) - 2)
    share = min(max((time - legs.time[k]) / (legs.time[k + 1] - legs.time[k]), 0.0), 1.0)
    ends = np.radians([[legs.lon[k], legs.lat[k]], [legs.lon[k + 1], legs.lat[k + 1]]])
    east, north = sphere.offset(*ends[0], *ends[1])
    lon, lat = sphere.destination(ends[0, 0], ends[0, 1], east * share, north * share)
    # The course is the direction of the great circle at this point, also at the end of a leg.
    before, after = (
        sphere.destination(ends[0, 0], ends[0, 1], east * s, north * s)
        for s in (share - 1e-3, share + 1e-3)
    )
    way = sphere.offset(*before, *after)
    place = float(sphere.wrap_degrees(math.degrees(float(lon)))), math.degrees(float(lat))
    return place, float(np.arctan2(*way)) % hearing.TURN


def _coverage_centre(grid: PodGrid, when: np.datetime64) -> tuple[float, float]:
    """Return the centre (lon, lat) [deg] of the coverage of a POD table by position."""
    assert grid.lon is not None
    assert grid.lat is not None
    seen = pod_table.pod_at(grid, when) > 0
    seen = seen if seen.any() else ~seen
    lon, lat = grid.lon[seen.any(axis=0)], grid.lat[seen.any(axis=1)]
    centre = math.degrees((lon[0] + lon[-1]) / 2), math.degrees((lat[0] + lat[-1]) / 2)
    return float(sphere.wrap_degrees(centre[0])), centre[1]


def _level(
    case: Case, sensor: Sensor, scenario: str | None, speed: object, assumed: Assumed
) -> float:
    """Return the source level of the target [dB]; NaN if the sensor is not a sonar."""
    if not isinstance(sensor.sees, Sonar):
        options = [
            option
            for option, value in (("--scenario", scenario), ("--speed", speed))
            if value is not None
        ]
        if options:
            raise UserError(
                f'{options[0]}: sensor "{sensor.name}" is a POD table, the same for all targets; '
                "remove the option"
            )
        return math.nan
    names = [one.name for one in case.scenarios]
    if scenario is not None and scenario not in names:
        near = difflib.get_close_matches(scenario, names, n=1, cutoff=0.5)
        hint = f'did you mean "{near[0]}"? ' if near else ""
        raise UserError(
            f'--scenario: no scenario "{scenario}"; {hint}there are: {", ".join(names[:20])}'
        )
    weights = [one.weight for one in case.scenarios]
    k = int(np.argmax(weights)) if scenario is None else names.index(scenario)
    levels = sensor.sees.levels
    target_speed = _speed(speed, levels, k)
    level = float(hearing.level(sensor.sees, np.array([k]), np.array([target_speed]))[0])
    only_one = len(names) == 1
    why = (
        ""
        if scenario is not None or only_one
        else f", the likeliest beforehand ({notation.percent(weights[k] / sum(weights))})"
    )
    words = f'{notation.number(level)} dB, of scenario "{names[k]}"{why}'
    if np.ptp(levels.level[k]) > 0:
        words += f", at {notation.number(target_speed / KNOT)} kn{', the slowest that is given' if speed is None else ''}"
    assumed.append(("source level", words))
    return level


def _speed(speed: object, levels: Levels, scenario: int) -> float:
    """Return the given speed [m/s], or the lowest one of a scenario's own table."""
    if speed is None:
        own = levels.level[scenario]  # other scenarios may start at lower speeds
        changes = np.flatnonzero(own != own[0])
        return float(levels.speed[changes[0] - 1 if changes.size else 0])
    try:
        number = units.quantity(speed, "m/s", "speed", "8 kn")
    except ValueError as error:
        raise UserError(f"--speed: {error}") from None
    if number < 0:
        raise UserError(f'--speed "{speed}" must be at least 0')
    return number


def _noise(noise: Noise, when: np.datetime64) -> str:
    least, most = float(noise.level.min()), float(noise.level.max())
    span = f"{least:.4g} dB" if most - least < 0.05 else f"{least:.4g} to {most:.4g} dB"
    remark = _nearest_time_remark(noise.times, when)
    return f"{span}, {remark}" if remark else span


def _nearest_time_remark(times: NDArray[np.datetime64], when: np.datetime64) -> str:
    """Return a remark if a time is outside the known times, whose nearest one is used; else ""."""
    if not times.size or times[0] <= when <= times[-1]:
        return ""
    edge, which = (times[0], "first") if when < times[0] else (times[-1], "last")
    return f"the values are those of its {which} time, {notation.format_dtg(edge)}"
