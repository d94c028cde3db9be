"""Condition a run's errors of current and wind on its drifting buoys and its reports on scene.

A report is compared with the forcing at its place and time. For buoys the forcing is sampled where each buoy was, for each scenario and member of an ensemble, and its
displacements between fixes are compared with those by the forcing (drift.engine.motion.errors.buoy_errors).
Before its first fix a buoy's place is that of the water that carried it there, by the likeliest
forcing and the error that its own track shows.
"""

from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import replace

import numpy as np

from drift.case.record import Case
from drift.engine.environment import along_track, domain
from drift.engine.environment.environment import Environment
from drift.engine.motion.clock import Clock
from drift.engine.motion.errors import buoy_errors
from drift.engine.motion.errors import buoys as on_scene
from drift.engine.motion.errors.buoy_errors import Fixes, Law
from drift.engine.motion.errors.buoys import Buoys, BuoyTrack
from drift.engine.motion.forcing import Forcing
from drift.engine.motion.scene import Scene
from drift.pipeline import reports as reported
from drift.tracking.tracks.records import Track
from geo import sphere
from geo.array import Array
from geo.errors import UserError
from geo.forcing.quantity import QUANTITIES


def _law_of(case: Case) -> Law:
    """Return the prior of the errors that the buoys and reports of a case show."""
    current, wind = case.current_error, case.wind_error
    windy = any(buoy.windage > 0 for buoy in case.drifters)
    windy = windy or any(report.quantity == "wind" for report in case.reports)
    return Law(
        current.std,
        current.time,
        current.length,
        current.bias,
        wind.std if windy else 0.0,
        wind.time,
        wind.length,
        case.diffusivity,
    )


def places_of(case: Case) -> int:
    """Return the number of places at which the errors of a case are known: buoys, and reports."""
    return len(case.drifters) + len(reported.places_of_reports(case.reports))


def states_of(case: Case) -> int:
    """Return the number of states of the errors at the buoys and reports of a case."""
    law = _law_of(case)
    return on_scene.states(places_of(case), len(case.drifters), law.wind_std > 0, law.biased)


def condition_on_buoys(case: Case, where: Environment, clock: Clock) -> Buoys | None:
    """Return the errors at the buoys and reports of a case given these; None without any.

    Args:
        case: of the run.
        where: its environment.
        clock: its steps.

    Raises:
        UserError: a report, or all displacements of a buoy, lie where there is no forcing.
    """
    if not places_of(case):
        return None
    if domain.is_polar(where.box):
        what = "drifter" if case.drifters else "report"
        raise UserError(
            f"{case.path.name}: [[{what}]]: the domain reaches a pole, where east at a {'buoy' if case.drifters else 'report'} is not east at the "
            f"object; give a [domain] that ends before it, or leave the {what}s out"
        )
    members, law = max(len(where.members), 1), _law_of(case)
    edges, numbers = on_scene.step_edges(clock)
    hypotheses = [(s, member) for s in range(len(where.water)) for member in range(members)]
    with closing(Forcing(list(where.water), case.direction)) as forcing:
        fixes, tracked = _track_buoys(case, forcing, law, clock.start + edges, hypotheses)
        sights = reported.sights_of(case, where, forcing, hypotheses, clock.start)
    fixed = np.array(reported.places_of_reports(case.reports)).reshape(1, -1, 2)
    places = np.concatenate([tracked, np.repeat(fixed, edges.size, axis=0)], axis=1)
    windy = law.wind_std > 0
    middles = _middles(places)
    current = _factors(middles, law.current_length)
    wind = _factors(middles, law.wind_length)
    given = buoy_errors.condition(law, edges, (current, wind if windy else None), fixes, sights)
    return Buoys(
        tuple(buoy.name for buoy in case.drifters),
        tuple(sights),
        law,
        given,
        places[:-1],
        np.stack([current, wind], axis=1),
        numbers,
        edges,
        windy,
        members,
        case.spill is not None,
    )


def _track_buoys(
    case: Case, forcing: Forcing, law: Law, times: Array, hypotheses: Sequence[tuple[int, int]]
) -> tuple[list[Fixes], Array]:
    """Return the fixes of the buoys, at times after the run's start, and their lon, lat [deg] at
    times [s since 1970], (times, buoys, 2).
    """
    if not case.drifters:
        return [], np.empty((times.size, 0, 2))
    tracks = [_track(buoy) for buoy in case.drifters]
    points = [along_track.quadrature_points(track.time) for track in tracks]
    velocities = _model_velocities(case, forcing, hypotheses, tracks, points)
    fixes = [
        _fixes(case, buoy, point, velocity)
        for buoy, point, velocity in zip(case.drifters, points, velocities, strict=True)
    ]
    likeliest = int(np.argmin(_mismatch(fixes)))
    shown = hypotheses[likeliest]
    places = []
    for buoy, own, track in zip(case.drifters, fixes, tracks, strict=True):
        error = _error_shown(own, law, times, likeliest)
        places.append(_places(case, forcing, shown, buoy, error, track, times))
    return [replace(own, time=own.time - times[0]) for own in fixes], np.stack(places, axis=1)


def share_with_buoys(scene: Scene, buoys: Buoys | None) -> Scene:
    """Return a scene whose particles share the errors at buoys and reports."""
    if buoys is None:
        return scene
    return replace(scene, buoys=buoys, place=scene.place._replace(shares=True))


def _track(buoy: BuoyTrack) -> Track:
    return Track(buoy.name, buoy.time, buoy.lon, buoy.lat)


def _model_velocities(
    case: Case,
    forcing: Forcing,
    hypotheses: Sequence[tuple[int, int]],
    tracks: Sequence[Track],
    points: Sequence[tuple[Array, Array, Array]],
) -> list[Array]:
    """Return the velocity of each buoy by the forcing at its points, (hypotheses, points, 2)."""
    counts = [point[0].size for point in points]
    time = np.concatenate([point[0] for point in points])
    at = [track.at(point[0]) for track, point in zip(tracks, points, strict=True)]
    lon, lat = (sphere.to_binary(np.concatenate([place[k] for place in at])) for k in (0, 1))
    windage = np.repeat([buoy.windage for buoy in case.drifters], counts)
    found = np.stack([_velocity(case, forcing, one, time, lon, lat, windage) for one in hypotheses])
    return np.split(found, np.cumsum(counts)[:-1], axis=1)


def _velocity(
    case: Case,
    forcing: Forcing,
    hypothesis: tuple[int, int],
    time: Array,
    lon: Array,
    lat: Array,
    windage: Array,
) -> Array:
    """Return velocities (points, 2) [m/s] of buoys by the forcing; NaN where it has no value."""
    scenario, member = hypothesis
    asked = [
        name
        for name, quantity in QUANTITIES.items()
        if case.forcing.get(name) and not quantity.scalar
    ]
    sampled = along_track.sample_forcing(forcing, scenario, asked, time, lon, lat, member)
    total = np.zeros((time.size, 2))
    for quantity, values in sampled.items():
        known = values if QUANTITIES[quantity].needed else np.nan_to_num(values)
        if QUANTITIES[quantity].in_air:
            # a wind that does not move a buoy may be missing
            total += np.where(windage[:, None] > 0, windage[:, None] * known, 0.0)
        else:
            total += known
    return total


def _fixes(
    case: Case, buoy: BuoyTrack, point: tuple[Array, Array, Array], velocity: Array
) -> Fixes:
    """Return a buoy's fixes beside the displacements by the forcing, at times since 1970."""
    _, weight, owner = point
    n = buoy.time.size
    model = np.stack(
        [
            np.stack([np.bincount(owner, weight * v[:, side], n) for side in (0, 1)], axis=1)
            for v in velocity
        ]
    )
    lon, lat = np.radians(buoy.lon), np.radians(buoy.lat)
    east, north = sphere.offset(lon[:-1], lat[:-1], lon[1:], lat[1:])
    own = np.concatenate([np.zeros((1, 2)), np.stack([east, north], axis=1)])
    missing = np.asarray(~np.isfinite(model).all(axis=(0, 2)))
    fresh = np.logical_or(buoy.fresh, missing)
    if fresh.all():
        raise UserError(
            f'{case.path.name}: drifter "{buoy.name}": no two of its fixes at most 6 h apart lie where the forcing has values; '
            "check its positions, widen [domain], or leave it out"
        )
    each = np.where(fresh[None, :, None], 0.0, own - np.where(missing[None, :, None], 0.0, model))
    total = np.cumsum(each, axis=1)
    begin = np.maximum.accumulate(np.where(fresh, np.arange(n), 0))
    return Fixes(buoy.time, fresh, total - total[:, begin], buoy.error, buoy.windage)


def _mismatch(fixes: Sequence[Fixes]) -> Array:
    """Return the mean square speed beyond the forcing under each hypothesis, (hypotheses,)."""
    total = np.zeros(len(fixes[0].excess))
    for own in fixes:
        step, moved = np.diff(own.time), np.diff(own.excess, axis=1)
        known = ~own.fresh[1:]
        total += ((moved[:, known] / step[known, None]) ** 2).sum(axis=(1, 2))
    return total


def _error_shown(own: Fixes, law: Law, times: Array, hypothesis: int) -> Array:
    """Return the mean error of the current at a buoy's first fix by its own track, [m/s]: the
    changing part and the constant one, (2, 2).
    """
    one = np.ones((times.size - 1, 1, 1))
    alone = replace(own, excess=own.excess[[hypothesis]])
    given = buoy_errors.condition(law, times, (one, one if law.wind_std > 0 else None), [alone])
    first = int(np.clip(np.searchsorted(times, own.time[0]), 0, times.size - 1))
    state = given.means[first, 0]
    bias = law.bias_std * state[-2] if law.biased else np.zeros(2)
    return np.stack([law.current_std * state[0], bias])


def _places(
    case: Case,
    forcing: Forcing,
    hypothesis: tuple[int, int],
    buoy: BuoyTrack,
    error: Array,
    track: Track,
    times: Array,
) -> Array:
    """Return lon, lat [deg] of a buoy at times [s since 1970], (times, 2)."""
    place = np.stack(track.at(np.clip(times, buoy.time[0], buoy.time[-1])), axis=-1)
    # Back from the first fix its error goes with the water. After the last one nothing is known of
    # its innovations, so that its place has no effect.
    before = np.flatnonzero(times < buoy.time[0])[::-1]
    for k, there in zip(
        before, _traced_back(case, forcing, hypothesis, buoy, times[before], error), strict=True
    ):
        place[k] = there
    return place


def _traced_back(
    case: Case,
    forcing: Forcing,
    hypothesis: tuple[int, int],
    buoy: BuoyTrack,
    times: Array,
    error: Array,
) -> Iterator[tuple[float, float]]:
    """Yield lon, lat [deg] at descending times [s since 1970] of what drifted to a first fix.

    error: its changing part at the fix, which fades with its decorrelation time, and its bias,
    (2, 2) [m/s]. Without forcing it moved by them alone.
    """
    lon, lat = np.radians(buoy.lon[0]), np.radians(buoy.lat[0])
    windage, memory = np.array([buoy.windage]), case.current_error.time
    first = later = buoy.time[0]
    for time in times:
        middle = np.array([np.rint((later + time) / 2)])
        x, y = (sphere.to_binary(np.degrees([angle])) for angle in (lon, lat))
        velocity = np.nan_to_num(_velocity(case, forcing, hypothesis, middle, x, y, windage)[0])
        faded = memory * (np.exp((later - first) / memory) - np.exp((time - first) / memory))
        way = (velocity + error[1]) * (later - time) + error[0] * faded
        lon, lat = sphere.destination(lon, lat, *-way)
        later = time
        yield float(np.degrees(lon)), float(np.degrees(lat))


def _middles(places: Array) -> Array:
    """Return the middles between places at the edges of steps (steps + 1, m, 2) [deg]."""
    lon, lat = np.radians(places[..., 0]), np.radians(places[..., 1])
    east, north = sphere.offset(lon[:-1], lat[:-1], lon[1:], lat[1:])
    x, y = sphere.destination(lon[:-1], lat[:-1], east / 2, north / 2)
    return np.asarray(np.degrees(np.stack([x, y], axis=-1)))


def _factors(places: Array, length: float) -> Array:
    """Return Cholesky factors of the correlations between places (steps, m, 2) [deg],
    (steps, m, m).
    """
    lon, lat = np.radians(places[..., 0]), np.radians(places[..., 1])
    apart = sphere.distance(lon[:, :, None], lat[:, :, None], lon[:, None], lat[:, None])
    matrix = buoy_errors.correlation(apart, length)
    # two buoys at one place have the same error: a millionth keeps the factor regular
    m = places.shape[1]
    return np.linalg.cholesky(matrix * (1 - 1e-6) + 1e-6 * np.eye(m))
