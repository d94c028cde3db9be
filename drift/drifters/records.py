"""Tracks of real drifters, and which of their fixes are believed.

A track is what one drifter reported: times, positions, and whatever else stood beside them. Fixes that cannot be true are
left out, and it is told how many and why; where a drifter was silent for too long its track is cut into stretches.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from geo import sphere

Array = npt.NDArray[Any]

FASTEST = 3.0  # [m/s] beyond which nothing drifts for long
JUMP = 500.0  # [m] that two fixes may be apart besides: positions have errors too
GAP = 3 * 3600.0  # [s] of silence over which a drifter's way is not known well enough
AGROUND, STILL = 12 * 3600.0, 200.0  # [s] and [m]: what does not leave a circle of that radius for so long is aground


@dataclass(frozen=True)
class Track:
    """Fixes of one drifter in order of time: UTC [s since 1970], lon and lat [deg], and other columns, each shape (n,)."""

    name: str
    time: Array
    lon: Array
    lat: Array
    columns: Mapping[str, Array] = field(default_factory=dict)

    def at(self, time: npt.ArrayLike) -> tuple[Array, Array]:
        """Return (lon, lat) [deg] at times between fixes, along the straight way from one to the next."""
        time = np.asarray(time, np.float64)
        before = np.clip(np.searchsorted(self.time, time, "right") - 1, 0, max(self.time.size - 2, 0))
        after = np.minimum(before + 1, self.time.size - 1)
        span = np.maximum(self.time[after] - self.time[before], 1e-9)
        share = (time - self.time[before]) / span
        lon, lat = np.radians(self.lon), np.radians(self.lat)
        east, north = sphere.offset(lon[before], lat[before], lon[after], lat[after])
        x, y = sphere.destination(lon[before], lat[before], east * share, north * share)
        return np.degrees(x), np.degrees(y)

    def silent(self, begin: float, end: float) -> float:
        """Return the longest time [s] without a fix that touches [begin, end] [s since 1970]; inf where the track is not."""
        if begin < self.time[0] or end > self.time[-1]:
            return np.inf
        first = int(np.searchsorted(self.time, begin, "right")) - 1
        last = int(np.searchsorted(self.time, end, "left"))
        return float(np.diff(self.time[first : last + 1]).max(initial=0.0))


@dataclass(frozen=True)
class Believed:
    """Tracks of which only believable fixes are left, and in words what was left out."""

    tracks: tuple[Track, ...]
    notes: tuple[str, ...]


def taken(track: Track, keep: Array) -> Track:
    """Return a track with some of its fixes (indices, or a mask)."""
    columns = {name: values[keep] for name, values in track.columns.items()}
    return replace(track, time=track.time[keep], lon=track.lon[keep], lat=track.lat[keep], columns=columns)


def believed(tracks: Sequence[Track], fastest: float = FASTEST) -> Believed:
    """Return tracks in order of time without fixes that cannot be true, and without spells aground."""
    counts = dict.fromkeys(("impossible", "repeated", "other", "fast", "aground"), 0)
    left, grounded, short = [], [], []
    for track in tracks:
        sound = np.isfinite(track.time) & (np.abs(track.lat) <= 90) & (track.lon >= -180) & (track.lon <= 360)
        counts["impossible"] += int((~sound).sum())
        order = np.flatnonzero(sound)
        order = order[np.argsort(track.time[order], kind="stable")]
        found = taken(track, order)
        found = replace(found, lon=sphere.wrap_degrees(found.lon))
        again = np.diff(found.time, prepend=-np.inf) <= 0
        alike = again & (np.diff(found.lon, prepend=np.nan) == 0) & (np.diff(found.lat, prepend=np.nan) == 0)
        counts["repeated"] += int(alike.sum())
        counts["other"] += int((again & ~alike).sum())
        found = taken(found, ~again)
        slow = _slow(found, fastest)
        counts["fast"] += int((~slow).sum())
        found = taken(found, slow)
        aground = _aground(found)
        if aground.any():
            counts["aground"] += int(aground.sum())
            since = np.datetime64(int(found.time[np.flatnonzero(aground)[0]]), "s")
            grounded.append(f"{track.name} from {since}Z")
            found = taken(found, ~aground)
        if found.time.size > 1:
            left.append(found)
        else:
            short.append(track.name)
    words = {
        "impossible": "without a time or with an impossible position",
        "repeated": "that repeat the one before",
        "other": "at another place at the time of the one before",
        "fast": f"that need more than {fastest:g} m/s to be reached and left",
        "aground": f"aground, of spells of {AGROUND / 3600:g} h or more within {STILL:g} m: {_listed(grounded)}",
    }
    notes = [f"{count:,} fixes left out {words[kind]}" for kind, count in counts.items() if count]
    if short:
        many = f"{len(short)} drifters" if len(short) > 1 else "1 drifter"
        notes.append(f"{many} left out with fewer than two fixes: {_listed(short)}")
    return Believed(tuple(left), tuple(notes))


def _listed(names: Sequence[str]) -> str:
    more = f" and {len(names) - 4} more" if len(names) > 4 else ""
    return ", ".join(names[:4]) + more


def _slow(track: Track, fastest: float) -> Array:
    """Return which fixes can be reached and left at a believable speed; of a leap alone neither end is at fault."""
    keep = np.arange(track.time.size)
    while keep.size > 2:
        excess = _excess(track, keep[:-1], keep[1:], fastest)
        both = np.minimum(excess[:-1], excess[1:])  # a wrong fix is left as fast as it was reached
        around = _excess(track, keep[:-2], keep[2:], fastest)
        worst = np.where((both > 0) & (around <= 0), both, 0.0)
        if worst.max() <= 0:
            break
        # of neighbours only the worst goes at a time
        peak = worst >= np.maximum(np.concatenate([[0.0], worst[:-1]]), np.concatenate([worst[1:], [0.0]]))
        keep = np.delete(keep, 1 + np.flatnonzero(peak & (worst > 0)))
    if keep.size > 2:  # a wrong first or last fix has one neighbour only
        excess = _excess(track, keep[:-1], keep[1:], fastest)
        first, last = excess[0] > 0 >= excess[1], excess[-1] > 0 >= excess[-2]
        keep = keep[int(first) : keep.size - int(last)]
    mask = np.zeros(track.time.size, bool)
    mask[keep] = True
    return mask


def _excess(track: Track, before: Array, after: Array, fastest: float) -> Array:
    """Return by how much [m] the way between fixes is longer than could be drifted."""
    lon, lat = np.radians(track.lon), np.radians(track.lat)
    way = sphere.distance(lon[before], lat[before], lon[after], lat[after])
    return np.asarray(way - fastest * (track.time[after] - track.time[before]) - JUMP)


def _aground(track: Track) -> Array:
    """Return which fixes belong to a spell of AGROUND or longer on one spot, shape (n,)."""
    lon, lat = np.radians(track.lon), np.radians(track.lat)
    later = np.searchsorted(track.time, track.time + AGROUND)
    whole = np.flatnonzero(later < track.time.size)
    near = sphere.distance(lon[whole], lat[whole], lon[later[whole]], lat[later[whole]]) <= 2 * STILL
    found = np.zeros(track.time.size, bool)
    for first in whole[near]:
        spell = slice(first, later[first] + 1)
        x, y = np.median(lon[spell]), np.median(lat[spell])
        if sphere.distance(x, y, lon[spell], lat[spell]).max() <= STILL:
            found[spell] = True
    return found


def breaks(track: Track, longest: float = GAP, fastest: float = FASTEST) -> Array:
    """Return which fixes begin a stretch: the first, those after a long silence, and those a leap away, shape (n,)."""
    index = np.arange(track.time.size)
    leap = _excess(track, index[:-1], index[1:], fastest) > 0
    return np.concatenate([[True], (np.diff(track.time) > longest) | leap])
