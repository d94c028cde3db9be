"""Where and when a world's release is, for each kind of prior.

It is a function of latents, which are independent standard normals.

A new kind of prior has its law here. Works on NumPy float64.
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

from drift.engine.motion.scenario import AreaPrior, PositionPrior, ReleasePrior, TracklinePrior
from geo import notation, sphere
from geo.array import Real

PIECE = 20_000.0  # [m] of a great-circle leg with one course

Latents = Callable[[str], Real]  # latents of all worlds by name, (w,); 0 where there are none
# lon, lat [rad] and whether that is possible, (w,) each
Places = tuple[Real, Real, npt.NDArray[np.bool_]]


@dataclass(frozen=True)
class Law:
    """How latents become releases; only what is uncertain has a latent. time: [s since 1970], (w,)
    int64.
    """

    names: tuple[str, ...]  # names of the latents
    place: Callable[[Latents], Places]
    time: Callable[[Latents], npt.NDArray[np.int64]]


def law(prior: ReleasePrior) -> Law:
    """Return the law of the releases of worlds."""
    of_kind: Callable[[Any], Law] = LAWS[type(prior)]
    return of_kind(prior)


def _position(prior: PositionPrior) -> Law:
    names: tuple[str, ...] = ("release_x", "release_y") if prior.major > 0 else ()
    if prior.displacement:
        names += ("displacement", "displacement_direction")
    return Law(
        (*names, *_unsure_time(prior)), partial(_about, prior), partial(_within_window, prior)
    )


def _area(prior: AreaPrior) -> Law:
    names = ("release_x", "release_y", *_unsure_time(prior))
    return Law(names, partial(_inside, prior), partial(_within_window, prior))


def _trackline(prior: TracklinePrior) -> Law:
    return Law(("voyage", "cross_track"), partial(_on_track, prior), partial(_on_voyage, prior))


LAWS: dict[type, Callable[[Any], Law]] = {
    PositionPrior: _position,
    AreaPrior: _area,
    TracklinePrior: _trackline,
}


def _about(prior: PositionPrior, of: Latents) -> Places:
    along, across = prior.major * of("release_x"), prior.minor * of("release_y")
    s, c = math.sin(prior.orientation), math.cos(prior.orientation)
    lon, lat = sphere.destination(
        prior.lon, prior.lat, along * s + across * c, along * c - across * s
    )
    if prior.displacement:
        (near, far), (begin, end) = prior.displacement.distance, prior.displacement.direction
        length = near + (far - near) * special.ndtr(of("displacement"))
        bearing = begin + (end - begin) * special.ndtr(of("displacement_direction"))
        lon, lat = sphere.destination(lon, lat, length * np.sin(bearing), length * np.cos(bearing))
    return lon, lat, np.ones(len(lon), bool)


def _inside(prior: AreaPrior, of: Latents) -> Places:
    shape = shapely.Polygon(np.column_stack([prior.lon, prior.lat]))
    west, south, east, north = shape.bounds
    lon = west + (east - west) * special.ndtr(of("release_x"))
    # Uniform in true area.
    lat = np.arcsin(np.sin(south) + (np.sin(north) - np.sin(south)) * special.ndtr(of("release_y")))
    return lon, lat, shapely.contains_xy(shape, lon, lat)


def _on_track(prior: TracklinePrior, of: Latents) -> Places:
    x, y = sphere.track(prior.lon, prior.lat, PIECE)
    east, north = sphere.offset(x[:-1], y[:-1], x[1:], y[1:])
    length = np.hypot(east, north)
    done = np.concatenate([[0.0], np.cumsum(length)])
    way = _share(prior, of) * done[-1]
    piece = np.clip(np.searchsorted(done, way, side="right") - 1, 0, length.size - 1)
    e, n = east[piece] / length[piece], north[piece] / length[piece]
    along, off = way - done[piece], prior.cross_track * of("cross_track")
    lon, lat = sphere.destination(x[piece], y[piece], along * e + off * n, along * n - off * e)
    return lon, lat, np.ones(len(lon), bool)


def _share(prior: TracklinePrior, of: Latents) -> Real:
    """Return the share of the voyage done."""
    u, low, high = special.ndtr(of("voyage")), prior.low, prior.high
    if prior.mode is None:
        return np.asarray(low + (high - low) * u)
    peak = (prior.mode - low) / (high - low)
    rising, falling = np.sqrt(u * peak), 1 - np.sqrt((1 - u) * (1 - peak))
    return np.asarray(low + (high - low) * np.where(u < peak, rising, falling))


def _unsure_time(prior: PositionPrior | AreaPrior) -> tuple[str, ...]:
    return ("release_time",) if prior.release_end > prior.release_start else ()


def _within_window(prior: PositionPrior | AreaPrior, of: Latents) -> npt.NDArray[np.int64]:
    return _between(prior.release_start, prior.release_end, special.ndtr(of("release_time")))


def _on_voyage(prior: TracklinePrior, of: Latents) -> npt.NDArray[np.int64]:
    return _between(prior.departure, prior.arrival, _share(prior, of))


def _between(begin: np.datetime64, end: np.datetime64, share: Real) -> npt.NDArray[np.int64]:
    """Return times [s since 1970] by the share of a span of time that is over."""
    return notation.epoch(begin) + np.rint(
        share * float((end - begin) / np.timedelta64(1, "s"))
    ).astype(np.int64)
