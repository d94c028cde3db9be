"""What is asked of a sensor, from a case and what a user says beside it; all that does not fit is
refused here.
"""

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
from drift.evidence.sensors import grid_pod, hearing
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
    """Return what is asked; raise UserError for what does not fit the case or the sensor."""
    sensor = _sensor(case, name)
    said: Assumed = []
    carrying = _carrying(case, sensor) if sensor.place is None and at is None else None
    when = _time(case, time, carrying, said)
    place, toward = _place(sensor, at, heading, carrying, when, said)
    try:
        listened = sonar.beams(beams, sensor)
    except ValueError as error:
        raise UserError(f"--beams: {error}") from None
    level = _level(case, sensor, scenario, speed, said)
    if isinstance(sensor.sees, Sonar):
        said.append(("noise", _noise(sensor.sees.noise, when)))
    elif sensor.sees.times.size:
        said.append(("POD", _held(sensor.sees.times, when)))
    said.append(("land", "sound and sight pass it, as in a run"))
    return Question(
        sensor, place, toward, when, listened, level, tuple((a, b) for a, b in said if b)
    )


def _sensor(case: Case, name: str) -> Sensor:
    there = case.named_sensors
    if name in there:
        return there[name]
    near = difflib.get_close_matches(name, list(there), n=1, cutoff=0.5)
    hint = f'did you mean "{near[0]}"? ' if near else ""
    names = ", ".join(there) or "none; write it as [[sensor]]"
    raise UserError(f'no sensor "{name}" in {case.path.name}; {hint}there are: {names}')


def _carrying(case: Case, sensor: Sensor) -> Sortie | None:
    """Return the sortie that carries a sensor, None where none does; several are refused."""
    every = [s for s in case.sorties if s.sensor is not None and s.sensor.name == sensor.name]
    every = [s for s in every if s.legs is not None and s.frame == "ground"]
    if len(every) > 1:
        names = ", ".join(f'"{sortie.name}"' for sortie in every)
        raise UserError(
            f'where is sensor "{sensor.name}"? Sorties {names} carry it: give --at, and --heading of an array'
        )
    return every[0] if every else None


def _time(case: Case, time: object, carrying: Sortie | None, said: Assumed) -> np.datetime64:
    if time is None:
        if carrying is not None and not carrying.start <= case.start <= carrying.end:
            said.append(
                ("time", f'{notation.group(carrying.start)}, the start of sortie "{carrying.name}"')
            )
            return carrying.start
        said.append(("time", f"{notation.group(case.start)}, the start of the case"))
        return case.start
    try:
        return units.resolve(units.time(time), case.start)
    except ValueError as error:
        raise UserError(f"--time: {error}") from None


def _place(
    sensor: Sensor,
    at: object,
    heading: object,
    carrying: Sortie | None,
    when: np.datetime64,
    said: Assumed,
) -> tuple[tuple[float, float], float]:
    """Return where a sensor is [deg], and the heading [rad] of its array."""
    if sensor.place is not None:
        if at is not None or heading is not None:
            raise UserError(
                f'sensor "{sensor.name}" stands where its table says (at); leave --at and --heading out, or change the table '
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
    if carrying is not None:
        assert carrying.legs is not None
        if not carrying.start <= when <= carrying.end:
            raise UserError(
                f'sensor "{sensor.name}": sortie "{carrying.name}" carries it from {notation.group(carrying.start)} to '
                f"{notation.group(carrying.end)}, not at {notation.group(when)}; give --time within, or --at"
            )
        place, course = _under_way(carrying.legs, float(notation.epoch(when)))
        said.append(("place", f'that of sortie "{carrying.name}" then'))
        return place, course if toward is None else toward
    grid = sensor.sees
    if isinstance(grid, PodGrid) and grid.lon is not None and grid.lat is not None:
        said.append(
            (
                "place",
                "the middle of what its table sees, from which ranges are measured: it has no place of its own",
            )
        )
        return _middle(grid, when), toward or 0.0
    raise UserError(
        f'where is sensor "{sensor.name}"? Neither its table (at) nor one sortie says; give --at'
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


def _under_way(legs: Legs, time: float) -> tuple[tuple[float, float], float]:
    """Return where something on legs is at a time [s since 1970], (lon, lat) [deg], and its course
    [rad].
    """
    k = min(max(int(np.searchsorted(legs.time, time, side="right")) - 1, 0), len(legs.time) - 2)
    share = min(max((time - legs.time[k]) / (legs.time[k + 1] - legs.time[k]), 0.0), 1.0)
    ends = np.radians([[legs.lon[k], legs.lat[k]], [legs.lon[k + 1], legs.lat[k + 1]]])
    east, north = sphere.offset(*ends[0], *ends[1])
    lon, lat = sphere.destination(ends[0, 0], ends[0, 1], east * share, north * share)
    # The great circle goes on beyond its end as it came there.
    before, after = (
        sphere.destination(ends[0, 0], ends[0, 1], east * s, north * s)
        for s in (share - 1e-3, share + 1e-3)
    )
    way = sphere.offset(*before, *after)
    place = float(sphere.wrap_degrees(math.degrees(float(lon)))), math.degrees(float(lat))
    return place, float(np.arctan2(*way)) % hearing.TURN


def _middle(grid: PodGrid, when: np.datetime64) -> tuple[float, float]:
    """Return the middle (lon, lat) [deg] of what a table by place sees."""
    assert grid.lon is not None
    assert grid.lat is not None
    seen = grid_pod.pod_at(grid, when) > 0
    seen = seen if seen.any() else ~seen
    lon, lat = grid.lon[seen.any(axis=0)], grid.lat[seen.any(axis=1)]
    middle = math.degrees((lon[0] + lon[-1]) / 2), math.degrees((lat[0] + lat[-1]) / 2)
    return float(sphere.wrap_degrees(middle[0])), middle[1]


def _level(case: Case, sensor: Sensor, scenario: str | None, speed: object, said: Assumed) -> float:
    """Return the source level [dB] of the target; NaN where the sensor is no sonar."""
    if not isinstance(sensor.sees, Sonar):
        given = [
            option
            for option, value in (("--scenario", scenario), ("--speed", speed))
            if value is not None
        ]
        if given:
            raise UserError(
                f'{given[0]}: sensor "{sensor.name}" is a table of POD, the same for all targets; leave it out'
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
    fast = _speed(speed, levels, k)
    level = float(hearing.level(sensor.sees, np.array([k]), np.array([fast]))[0])
    alone = len(names) == 1
    why = (
        ""
        if scenario is not None or alone
        else f", the likeliest beforehand ({notation.percent(weights[k] / sum(weights))})"
    )
    words = f'{notation.number(level)} dB, of scenario "{names[k]}"{why}'
    if np.ptp(levels.level[k]) > 0:
        words += f", at {notation.number(fast / KNOT)} kn{', the slowest that is given' if speed is None else ''}"
    said.append(("source level", words))
    return level


def _speed(speed: object, levels: Levels, scenario: int) -> float:
    """Return the speed [m/s] that is asked for, or the slowest of a scenario's own table."""
    if speed is None:
        own = levels.level[scenario]  # other scenarios may be given at slower speeds
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
    held = _held(noise.times, when)
    return f"{span}, {held}" if held else span


def _held(times: NDArray[np.datetime64], when: np.datetime64) -> str:
    """Return what is said of a time outside of those that are known."""
    if not times.size or times[0] <= when <= times[-1]:
        return ""
    edge, which = (times[0], "first") if when < times[0] else (times[-1], "last")
    return f"as at {notation.group(edge)}, its {which} time"
