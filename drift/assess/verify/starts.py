"""Starts of the forecasts of each drifter, and how long its position is known after each.

A drifter that runs aground is scored where it lies, like particles that come ashore: leaving it out
would leave a sample of drifters that stay afloat. If it stops transmitting there, or is carried
away, it still counts as aground. Other starts are left out only for reasons unrelated to the drift,
or are counted with a reason that says otherwise.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from drift.assess.verify import grounding
from drift.engine.environment.environment_spec import Coast
from drift.tracking.tracks import records
from drift.tracking.tracks.records import Believed, Track
from geo.array import Array
from geo.errors import UserError


@dataclass(frozen=True)
class Start:
    """The start of one forecast.

    track: number of the drifter's track; time: [s since 1970]; until: when the drifter was last
    seen aground [s since 1970], inf where it was seen to the end of the forecast.
    """

    track: int
    time: int
    until: float = np.inf


@dataclass(frozen=True)
class Stranded:
    """Tracks of drifters, with fixes aground on the case's shore and fixes stopped elsewhere."""

    tracks: tuple[Track, ...]
    ashore: tuple[Array, ...]  # of each track, (n,)
    stopped: tuple[Array, ...]

    def position(self, start: Start, time: Array) -> tuple[Array, Array, Array]:
        """Return a drifter's (lon [deg], lat [deg], aground) at times [s since 1970], each (m,)."""
        track = self.tracks[start.track]
        known_time = np.minimum(time, start.until)
        lon, lat = track.at(known_time)
        before = np.searchsorted(track.time, known_time, "right") - 1
        return lon, lat, self.ashore[start.track][before]


@dataclass
class LeftOut:
    """How many starts were left out, by reason."""

    gap: int = 0  # silent for too long, or leaps
    ended: int = 0  # the track ends before the forecast
    ended_near: int = 0  # of these, tracks that end near the shore
    aground: int = 0  # aground at the start
    stopped: int = 0  # stopped away from the shore

    def counts(self) -> dict[str, int]:
        """Return how many starts were left out, by reason in words; only reasons that occurred."""
        every = {
            "aground at the start": self.aground,
            "track ends too early": self.ended,
            "silent, or leaps": self.gap,
            "stopped off any shore": self.stopped,
        }
        return {reason: count for reason, count in every.items() if count}

    def notes(self, gap: float) -> list[str]:
        """Return a note for each reason; gap: longest time between fixes [s]."""
        words = (
            (
                self.gap,
                f"the drifter is silent for more than {gap / 3600:.3g} h, or leaps, before the end",
            ),
            (self.ended, "the drifter's track ends before the forecast does" + self._near_words()),
            (self.aground, "the drifter is aground at the start"),
            (
                self.stopped,
                "the drifter stops before the end where the case has no shore within "
                f"{grounding.NEAR / 1000:g} km: moored, caught or aboard, or [coast] lacks its "
                "shore",
            ),
        )
        return [f"{count} starts left out: {reason}" for count, reason in words if count]

    def _near_words(self) -> str:
        if not self.ended_near:
            return ""
        return (
            f", {self.ended_near} of them within {grounding.NEAR / 1000:g} km of the shore: if "
            "those drifters ran aground there, the stated shares are biased without them; "
            "--ends-aground scores them there"
        )


def mark_stranded(believed: Believed, coast: Coast, ends_aground: bool = False) -> Stranded:
    """Return the tracks with the fixes aground on the case's shore, and those stopped elsewhere.

    Args:
        believed: tracks and their fixes that do not move.
        coast: the case's coast.
        ends_aground: whether a track that ends near the shore ended aground.

    Returns:
        Tracks with masks of the fixes that are aground, and of those that have stopped off any
        shore.

    Raises:
        UserError: the case's shoreline cannot be read.
    """
    pairs = zip(believed.tracks, believed.aground, strict=True)
    spells = [
        (k, spell) for k, (track, mask) in enumerate(pairs) for spell in records.spells(track, mask)
    ]
    places = np.array([_middle(believed.tracks[k], spell) for k, spell in spells]).reshape(-1, 2)
    near = grounding.near_shore(coast, places[:, 0], places[:, 1])
    ashore = _briefly_ashore(believed.tracks, coast)
    for (k, spell), is_near in zip(spells, near, strict=True):
        ashore[k][spell] |= is_near
    stopped = tuple(mask & ~own for mask, own in zip(believed.aground, ashore, strict=True))
    if ends_aground:
        for own, elsewhere, near_end in zip(
            ashore, stopped, _end_near_shore(believed.tracks, coast), strict=True
        ):
            own[-1] |= near_end and not elsewhere[-1]
    return Stranded(believed.tracks, ashore, stopped)


def _briefly_ashore(tracks: Sequence[Track], coast: Coast) -> tuple[Array, ...]:
    """Return the fixes in spells of some hours beside the case's shore, bool (n,) by track."""
    if not tracks:
        return ()
    still = [records.aground(track, records.BRIEF) for track in tracks]
    lon, lat = (
        np.concatenate(
            [np.empty(0), *(values[mask] for values, mask in zip(columns, still, strict=True))]
        )
        for columns in ([track.lon for track in tracks], [track.lat for track in tracks])
    )
    beside = grounding.distance_from_shore(coast, lon, lat, grounding.BESIDE) <= grounding.BESIDE
    parts = np.split(beside, np.cumsum([int(mask.sum()) for mask in still])[:-1])
    for mask, part in zip(still, parts, strict=True):
        mask[mask] = part
    return tuple(still)


def _middle(track: Track, spell: slice) -> tuple[float, float]:
    """Return the position [deg] of the fix in the middle of a spell."""
    middle = (spell.start + spell.stop) // 2
    return float(track.lon[middle]), float(track.lat[middle])


def _end_near_shore(tracks: Sequence[Track], coast: Coast) -> Array:
    """Return which tracks end near a case's shore."""
    return grounding.near_shore(
        coast, [track.lon[-1] for track in tracks], [track.lat[-1] for track in tracks]
    )


def find_starts(
    stranded: Stranded, every: float, length: float, gap: float, fastest: float
) -> tuple[list[Start], LeftOut, list[int]]:
    """Return the starts of all forecasts, the starts left out, and tracks that end too early.

    Args:
        stranded: tracks with their fixes aground and stopped.
        every: time between starts [s].
        length: length of a forecast [s].
        gap: longest time between fixes [s] that a forecast may span.
        fastest: speed [m/s] beyond which two fixes are a leap.

    Returns:
        Starts; counts of starts left out, by reason; and the number of a track once for each start
        after which it ends too early.
    """
    found, left, ended_early = [], LeftOut(), []
    for number, track in enumerate(stranded.tracks):
        fresh = records.breaks(track, gap, fastest)
        ashore, stopped = stranded.ashore[number], stranded.stopped[number]
        for time in np.arange(np.ceil(track.time[0]), track.time[-1], every):
            first = int(np.searchsorted(track.time, time, "right")) - 1
            # the fix at the end, or after it
            last = int(np.searchsorted(track.time, time + length, "left"))
            breaking = first + 1 + np.flatnonzero(fresh[first + 1 : last + 1])
            # one past the last known fix
            end_known = int(breaking[0]) if breaking.size else min(last + 1, track.time.size)
            known = slice(first, end_known)
            start = Start(number, int(time))
            if ashore[first]:
                left.aground += 1
            elif stopped[known].any():
                left.stopped += 1
            elif end_known > last:
                found.append(start)
            elif ashore[end_known - 1]:
                found.append(replace(start, until=float(track.time[end_known - 1])))
            elif breaking.size:
                left.gap += 1
            else:
                left.ended += 1
                ended_early.append(number)
    return found, left, ended_early


def known_starts(
    stranded: Stranded,
    coast: Coast,
    every: float,
    length: float,
    gap: float,
    fastest: float,
    notes: list[str],
) -> tuple[list[Start], dict[str, int]]:
    """Return the starts of all forecasts, and the counts of starts left out, by reason.

    Arguments are as for `starts`; coast: the case's; notes: receives notes on the starts left out.

    Raises:
        UserError: no start is left.
    """
    found, left, ended_early = find_starts(stranded, every, length, gap, fastest)
    if ended_early:
        numbers, counts = np.unique(ended_early, return_counts=True)
        near = _end_near_shore([stranded.tracks[k] for k in numbers], coast)
        left.ended_near = int(counts[near].sum())
    notes += left.notes(gap)
    if not found:
        raise UserError(
            f"--drifters: no drifter can be followed for {length / 3600:g} h without a gap of "
            f"more than {gap / 3600:.3g} h ({'; '.join(notes) or 'their tracks are shorter'}); "
            "give fewer --hours, or a longer --max-gap"
        )
    return found, left.counts()
