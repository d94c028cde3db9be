"""Place and time of a world's release as a function of latents, for each kind of prior.

Latents are independent standard normals. A new kind of prior needs its law here. Works on NumPy
float64.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt
import shapely
from scipy import special

from drift.engine.motion.scenario import (
    AreaPrior,
    PositionPrior,
    ReleasePrior,
    TracklinePrior,
    TrackPrior,
)
from geo import notation, sphere
from geo.array import Real

PIECE = 20_000.0  # [m] piece of a great-circle leg that counts as straight

Latents = Callable[[str], Real]  # latents of all worlds by name, (w,); 0 for unknown names
# lon, lat [rad] and whether they are possible, (w,) each
Places = tuple[Real, Real, npt.NDArray[np.bool_]]


@dataclass(frozen=True)
class ReleaseLaw:
    """Mapping from latents to releases; only uncertain quantities have a latent.

    time: [s since 1970], (w,) int64.
    """

    names: tuple[str, ...]  # names of the latents
    place: Callable[[Latents], Places]
    time: Callable[[Latents], npt.NDArray[np.int64]]


def release_law(prior: ReleasePrior) -> ReleaseLaw:
    """Return the law of the worlds' releases for a prior."""
    of_kind: Callable[[Any], ReleaseLaw] = LAWS[type(prior)]
    return of_kind(prior)


def _position(prior: PositionPrior) -> ReleaseLaw:
    names: tuple[str, ...] = ("release_x", "release_y") if prior.major > 0 else ()
    if prior.displacement:
        names += ("displacement", "displacement_direction")
    return ReleaseLaw(
        (*names, *_unsure_time(prior)), partial(_about, prior), partial(_within_window, prior)
    )


def _area(prior: AreaPrior) -> ReleaseLaw:
    names = ("release_x", "release_y", *_unsure_time(prior))
    return ReleaseLaw(names, partial(_inside, prior), partial(_within_window, prior))


def _trackline(prior: TracklinePrior) -> ReleaseLaw:
    return ReleaseLaw(
        ("voyage", "cross_track"), partial(_on_track, prior), partial(_on_voyage, prior)
    )


def _track(prior: TrackPrior) -> ReleaseLaw:
    names: list[str] = []
    for number, loss in enumerate(prior.losses, 1):
        names += [f"begin {number}"] if loss.begin[1] > loss.begin[0] else []
        names += [f"length {number}"] if loss.length[1] > loss.length[0] else []
    names += ["clock"] if prior.clock_error > 0 else []
    return ReleaseLaw(tuple(names), partial(_first_lost, prior), partial(_first_time, prior))


LAWS: dict[type, Callable[[Any], ReleaseLaw]] = {
    PositionPrior: _position,
    AreaPrior: _area,
    TracklinePrior: _trackline,
    TrackPrior: _track,
}


@dataclass(frozen=True)
class Losses:
    """When the objects of each world went overboard, and how wrong the ship's clock was."""

    begin: npt.NDArray[np.int64]  # [s since 1970], (w, losses)
    length: Real  # [s], (w, losses)
    clock: Real  # [s] fast, (w,)


def losses(prior: TrackPrior, latent: Latents) -> Losses:
    """Return the losses of worlds along a ship's track."""
    begin, length = [], []
    for number, loss in enumerate(prior.losses, 1):
        begin.append(_between(*loss.begin, special.ndtr(latent(f"begin {number}"))))
        low, high = loss.length
        length.append(low + (high - low) * special.ndtr(latent(f"length {number}")))
    clock = prior.clock_error * (2 * special.ndtr(latent("clock")) - 1)
    return Losses(np.stack(begin, axis=1), np.stack(length, axis=1), np.asarray(clock))


def track_pieces(prior: TrackPrior) -> tuple[Real, Real, Real, Real, Real]:
    """Return the great-circle pieces of a ship's track.

    Returns:
        Longitudes and latitudes [rad] of their starts, (p,); vectors east and north [m] to their
        ends, (p,); and times [s since 1970] by the ship's clock of all starts and the last end,
        (p + 1,).
    """
    lon, lat, time = [], [], [np.array(prior.time[:1], float)]
    for k in range(len(prior.time) - 1):
        x, y = sphere.track(prior.lon[k : k + 2], prior.lat[k : k + 2], PIECE)
        lon.append(x)
        lat.append(y)
        time.append(np.linspace(prior.time[k], prior.time[k + 1], x.size)[1:])
    steps = [sphere.offset(x[:-1], y[:-1], x[1:], y[1:]) for x, y in zip(lon, lat, strict=True)]
    east, north = (np.concatenate([step[c] for step in steps]) for c in (0, 1))
    x, y = (np.concatenate([each[:-1] for each in part]) for part in (lon, lat))
    return x, y, east, north, np.concatenate(time)


def _about(prior: PositionPrior, latent: Latents) -> Places:
    along, across = prior.major * latent("release_x"), prior.minor * latent("release_y")
    s, c = math.sin(prior.orientation), math.cos(prior.orientation)
    lon, lat = sphere.destination(
        prior.lon, prior.lat, along * s + across * c, along * c - across * s
    )
    if prior.displacement:
        (near, far), (begin, end) = prior.displacement.distance, prior.displacement.direction
        length = near + (far - near) * special.ndtr(latent("displacement"))
        bearing = begin + (end - begin) * special.ndtr(latent("displacement_direction"))
        lon, lat = sphere.destination(lon, lat, length * np.sin(bearing), length * np.cos(bearing))
    return lon, lat, np.ones(len(lon), bool)


def _inside(prior: AreaPrior, latent: Latents) -> Places:
    shape = shapely.Polygon(np.column_stack([prior.lon, prior.lat]))
    west, south, east, north = shape.bounds
    lon = west + (east - west) * special.ndtr(latent("release_x"))
    # Uniform by area on the sphere.
    lat = np.arcsin(
        np.sin(south) + (np.sin(north) - np.sin(south)) * special.ndtr(latent("release_y"))
    )
    return lon, lat, shapely.contains_xy(shape, lon, lat)


def _on_track(prior: TracklinePrior, latent: Latents) -> Places:
    x, y = sphere.track(prior.lon, prior.lat, PIECE)
    east, north = sphere.offset(x[:-1], y[:-1], x[1:], y[1:])
    length = np.hypot(east, north)
    cumulative = np.concatenate([[0.0], np.cumsum(length)])
    distance_made = _share(prior, latent) * cumulative[-1]
    piece = np.clip(
        np.searchsorted(cumulative, distance_made, side="right") - 1, 0, length.size - 1
    )
    e, n = east[piece] / length[piece], north[piece] / length[piece]
    along, off = distance_made - cumulative[piece], prior.cross_track * latent("cross_track")
    lon, lat = sphere.destination(x[piece], y[piece], along * e + off * n, along * n - off * e)
    return lon, lat, np.ones(len(lon), bool)


def _first_lost(prior: TrackPrior, latent: Latents) -> Places:
    x, y, east, north, time = track_pieces(prior)
    lost = losses(prior, latent)
    shown = lost.begin.min(axis=1) + lost.clock
    piece = np.clip(np.searchsorted(time, shown, side="right") - 1, 0, x.size - 1)
    share = np.clip((shown - time[piece]) / (time[piece + 1] - time[piece]), 0, 1)
    lon, lat = sphere.destination(x[piece], y[piece], share * east[piece], share * north[piece])
    return lon, lat, np.ones(len(lon), bool)


def _first_time(prior: TrackPrior, latent: Latents) -> npt.NDArray[np.int64]:
    return np.asarray(losses(prior, latent).begin.min(axis=1))


def _share(prior: TracklinePrior, latent: Latents) -> Real:
    """Return the share of the voyage that is completed at the release, (w,)."""
    u, low, high = special.ndtr(latent("voyage")), prior.low, prior.high
    if prior.mode is None:
        return np.asarray(low + (high - low) * u)
    peak = (prior.mode - low) / (high - low)
    rising, falling = np.sqrt(u * peak), 1 - np.sqrt((1 - u) * (1 - peak))
    return np.asarray(low + (high - low) * np.where(u < peak, rising, falling))


def _unsure_time(prior: PositionPrior | AreaPrior) -> tuple[str, ...]:
    return ("release_time",) if prior.release_end > prior.release_start else ()


def _within_window(prior: PositionPrior | AreaPrior, latent: Latents) -> npt.NDArray[np.int64]:
    return _between(prior.release_start, prior.release_end, special.ndtr(latent("release_time")))


def _on_voyage(prior: TracklinePrior, latent: Latents) -> npt.NDArray[np.int64]:
    return _between(prior.departure, prior.arrival, _share(prior, latent))


def _between(begin: np.datetime64, end: np.datetime64, share: Real) -> npt.NDArray[np.int64]:
    """Return times [s since 1970] by the elapsed share of a time span, (w,)."""
    return notation.epoch(begin) + np.rint(
        share * float((end - begin) / np.timedelta64(1, "s"))
    ).astype(np.int64)
