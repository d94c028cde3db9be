"""Tracks of real drifters and ships, and the selection of believable fixes.

A track holds the times, positions and other columns that one drifter or ship reported. Impossible
fixes are removed, and notes give their number and the reasons. Long gaps divide a track into
stretches.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from geo import sphere
from geo.array import Array

FASTEST = 3.0  # [m/s] highest believable drift speed
# [m] allowance for errors of position in that test
JUMP = 500.0
GAP = 3 * 3600.0  # [s] longest gap across which a drifter's displacement is known well enough
# [s], [m]: a drifter that stays this long in a circle of this radius is aground
AGROUND, STILL = 12 * 3600.0, 200.0
BRIEF = 3 * 3600.0  # [s] the same beside a shore; in open water that could be slack water
FEWEST = 3  # fewest fixes of a spell


@dataclass(frozen=True)
class Track:
    """Fixes of one drifter in order of time.

    UTC [s since 1970], lon, lat [deg] and other columns, each (n,).
    """

    name: str
    time: Array
    lon: Array
    lat: Array
    columns: Mapping[str, Array] = field(default_factory=dict)

    def at(self, time: npt.ArrayLike) -> tuple[Array, Array]:
        """Return (lon, lat) [deg] at times [s since 1970], on great circles between fixes."""
        time = np.asarray(time, np.float64)
        before = np.clip(
            np.searchsorted(self.time, time, "right") - 1, 0, max(self.time.size - 2, 0)
        )
        after = np.minimum(before + 1, self.time.size - 1)
        span = np.maximum(self.time[after] - self.time[before], 1e-9)
        share = (time - self.time[before]) / span
        lon, lat = np.radians(self.lon), np.radians(self.lat)
        east, north = sphere.offset(lon[before], lat[before], lon[after], lat[after])
        x, y = sphere.destination(lon[before], lat[before], east * share, north * share)
        return np.degrees(x), np.degrees(y)

    def silent(self, begin: float, end: float) -> float:
        """Return the longest gap [s] between fixes that overlaps begin to end [s since 1970].

        It is inf beyond the track.
        """
        if begin < self.time[0] or end > self.time[-1]:
            return np.inf
        first = int(np.searchsorted(self.time, begin, "right")) - 1
        last = int(np.searchsorted(self.time, end, "left"))
        return float(np.diff(self.time[first : last + 1]).max(initial=0.0))


@dataclass(frozen=True)
class Believed:
    """Tracks with only believable fixes, and notes on what was left out.

    aground: of each track, which of its fixes belong to a spell aground, (n,).
    """

    tracks: tuple[Track, ...]
    notes: tuple[str, ...]
    aground: tuple[Array, ...]


def selected(track: Track, keep: Array) -> Track:
    """Return a track with some of its fixes (indices, or a mask)."""
    columns = {name: values[keep] for name, values in track.columns.items()}
    return replace(
        track, time=track.time[keep], lon=track.lon[keep], lat=track.lat[keep], columns=columns
    )


def aground(track: Track, least: float = AGROUND) -> Array:
    """Return which fixes belong to a spell aground, shape (n,).

    Args:
        track: with its fixes.
        least: shortest time of a spell [s]; it also needs FEWEST fixes.
    """
    lon, lat = np.radians(track.lon), np.radians(track.lat)
    later = np.searchsorted(track.time, track.time + least)
    later = np.maximum(later, np.arange(track.time.size) + FEWEST - 1)
    complete = np.flatnonzero(later < track.time.size)
    near = (
        sphere.distance(lon[complete], lat[complete], lon[later[complete]], lat[later[complete]])
        <= 2 * STILL
    )
    inside = np.zeros(track.time.size, bool)
    for first in complete[near]:
        spell = slice(first, later[first] + 1)
        x, y = np.median(lon[spell]), np.median(lat[spell])
        if sphere.distance(x, y, lon[spell], lat[spell]).max() <= STILL:
            inside[spell] = True
    return inside


def nowhere(track: Track) -> Array:
    """Return that no fix is aground, (n,); for ships, which anchor, and animals, which rest."""
    return np.zeros(track.time.size, bool)


def believed(
    tracks: Sequence[Track],
    fastest: float = FASTEST,
    spells_aground: Callable[[Track], Array] = aground,
) -> Believed:
    """Return tracks in order of time without impossible fixes.

    Args:
        tracks: as they were read.
        fastest: highest believable speed [m/s].
        spells_aground: returns which fixes of a track are aground, shape (n,).
    """
    counts = dict.fromkeys(("impossible", "repeated", "other", "fast"), 0)
    sound_tracks, too_short = [], []
    for track in tracks:
        possible = (
            np.isfinite(track.time)
            & (np.abs(track.lat) <= 90)
            & (track.lon >= -180)
            & (track.lon <= 360)
        )
        counts["impossible"] += int((~possible).sum())
        order = np.flatnonzero(possible)
        order = order[np.argsort(track.time[order], kind="stable")]
        kept = selected(track, order)
        kept = replace(kept, lon=sphere.wrap_degrees(kept.lon))
        repeated = np.diff(kept.time, prepend=-np.inf) <= 0
        identical = (
            repeated
            & (np.diff(kept.lon, prepend=np.nan) == 0)
            & (np.diff(kept.lat, prepend=np.nan) == 0)
        )
        counts["repeated"] += int(identical.sum())
        counts["other"] += int((repeated & ~identical).sum())
        kept = selected(kept, ~repeated)
        reachable = _reachable(kept, fastest)
        counts["fast"] += int((~reachable).sum())
        kept = selected(kept, reachable)
        if kept.time.size > 1:
            sound_tracks.append(kept)
        else:
            too_short.append(track.name)
    reasons = {
        "impossible": "without a time or with an impossible position",
        "repeated": "that repeat the one before",
        "other": "at another place at the time of the one before",
        "fast": f"that need more than {fastest:g} m/s to be reached and left",
    }
    notes = [f"{count:,} fixes left out {reasons[kind]}" for kind, count in counts.items() if count]
    notes += _note_on_short(too_short)
    return Believed(
        tuple(sound_tracks), tuple(notes), tuple(spells_aground(track) for track in sound_tracks)
    )


def _note_on_short(names: Sequence[str]) -> list[str]:
    """Return a note on the tracks with too few fixes; [] if there are none."""
    if not names:
        return []
    many = f"{len(names)} tracks" if len(names) > 1 else "1 track"
    return [f"{many} left out with fewer than two fixes: {_listed(names)}"]


def spells(track: Track, aground: Array) -> list[slice]:
    """Return the spells aground of a track, as slices of its fixes.

    A fix farther from the one before than the width of a spell begins another spell.

    Args:
        track: with its fixes.
        aground: which of its fixes are aground, shape (n,).
    """
    lon, lat = np.radians(track.lon), np.radians(track.lat)
    moved = sphere.distance(lon[:-1], lat[:-1], lon[1:], lat[1:]) > 2 * STILL
    joined = aground[:-1] & aground[1:] & ~moved
    begins = aground & ~np.append(False, joined)
    ends = aground & ~np.append(joined, False)
    pairs = zip(np.flatnonzero(begins).tolist(), np.flatnonzero(ends).tolist(), strict=True)
    return [slice(begin, end + 1) for begin, end in pairs]


def words_for_spells(tracks: Sequence[Track], aground: Sequence[Array]) -> str:
    """Return the rule for a spell aground, and when the first drifters ran aground.

    It is "" if none did.
    """
    pairs = zip(tracks, aground, strict=True)
    firsts = [(track, int(np.argmax(mask))) for track, mask in pairs if mask.any()]
    if not firsts:
        return ""
    names = [
        f"{track.name} from {np.datetime64(int(track.time[first]), 's')}Z"
        for track, first in firsts
    ]
    return f"{AGROUND / 3600:g} h or more within {STILL:g} m, {BRIEF / 3600:g} h near a shore: {_listed(names)}"


def _listed(names: Sequence[str]) -> str:
    """Return the first four of many names, and the number of others."""
    more = f" and {len(names) - 4} more" if len(names) > 4 else ""
    return ", ".join(names[:4]) + more


def _reachable(track: Track, fastest: float) -> Array:
    """Return which fixes can be reached and left at a believable speed.

    Both ends of a single leap count as reachable.
    """
    keep = np.arange(track.time.size)
    while keep.size > 2:
        excess = _excess(track, keep[:-1], keep[1:], fastest)
        # a wrong fix is both reached and left too fast
        lone_excess = np.minimum(excess[:-1], excess[1:])
        around = _excess(track, keep[:-2], keep[2:], fastest)
        worst = np.where((lone_excess > 0) & (around <= 0), lone_excess, 0.0)
        if worst.max() <= 0:
            break
        # Remove only the worst of neighbouring fixes at a time.
        peak = worst >= np.maximum(
            np.concatenate([[0.0], worst[:-1]]), np.concatenate([worst[1:], [0.0]])
        )
        keep = np.delete(keep, 1 + np.flatnonzero(peak & (worst > 0)))
    if keep.size > 2:  # the first and the last fix have one neighbour only
        excess = _excess(track, keep[:-1], keep[1:], fastest)
        first, last = excess[0] > 0 >= excess[1], excess[-1] > 0 >= excess[-2]
        keep = keep[int(first) : keep.size - int(last)]
    mask = np.zeros(track.time.size, bool)
    mask[keep] = True
    return mask


def _excess(track: Track, before: Array, after: Array, fastest: float) -> Array:
    """Return the excess [m] of the distance between fixes over the largest possible drift."""
    lon, lat = np.radians(track.lon), np.radians(track.lat)
    way = sphere.distance(lon[before], lat[before], lon[after], lat[after])
    return np.asarray(way - fastest * (track.time[after] - track.time[before]) - JUMP)


def breaks(track: Track, longest: float = GAP, fastest: float = FASTEST) -> Array:
    """Return which fixes begin a stretch, shape (n,): the first, and those after a gap or leap.

    Args:
        track: with its fixes.
        longest: gap that does not divide a track [s].
        fastest: highest believable speed [m/s].
    """
    index = np.arange(track.time.size)
    leap = _excess(track, index[:-1], index[1:], fastest) > 0
    return np.concatenate([[True], (np.diff(track.time) > longest) | leap])
