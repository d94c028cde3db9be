"""Parts of tracks that can be compared with a model without bias from drifters that run aground.

The last displacement of a drifter that runs aground is not known: the shore cut it short. So
displacements towards the shore are missing, and the others lean offshore. Therefore, if any drifter
of a set runs aground, each track ends at the first fix from which its drifter might have run
aground before the next. Where a track ends depends on what came before, not on the displacements
left out; data missing in this way do not bias a likelihood (Rubin 1976,
doi:10.1093/biomet/63.3.581).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from drift.assess.verify import grounding
from drift.assess.verify.starts import Stranded
from drift.engine.environment.environment_spec import Coast
from drift.tracking.tracks import records
from drift.tracking.tracks.records import Track
from geo import sphere
from geo.array import Array

FAST = 0.99  # quantile of the speeds between fixes that defines the reach of a drifter


@dataclass(frozen=True)
class Exposed:
    """Parts of tracks to compare with a model, and notes on what was left out."""

    tracks: tuple[Track, ...]
    notes: tuple[str, ...]


def exposed_tracks(stranded: Stranded, coast: Coast, gap: float) -> Exposed:
    """Return the parts of tracks that are compared with a model.

    Fixes of drifters that have stopped are left out.

    Args:
        stranded: tracks with their fixes aground and stopped.
        coast: the case's coast.
        gap: longest time between two fixes [s].

    Returns:
        Parts of tracks, with notes.

    Raises:
        UserError: the case's shoreline cannot be read.
    """
    notes = []
    masks = [own | other for own, other in zip(stranded.ashore, stranded.stopped, strict=True)]
    if still := sum(int(mask.sum()) for mask in masks):
        words = records.words_for_spells(stranded.tracks, masks)
        notes.append(f"{still:,} fixes left out because the drifter was aground: {words}")
    afloat = [np.flatnonzero(~mask) for mask in masks]
    if any(mask.any() for mask in stranded.ashore):
        afloat = _before_the_shore(stranded, coast, gap, afloat, notes)
    pairs = zip(stranded.tracks, afloat, strict=True)
    tracks = tuple(records.selected(track, keep) for track, keep in pairs if keep.size > 1)
    return Exposed(tracks, tuple(notes))


def _before_the_shore(
    stranded: Stranded, coast: Coast, gap: float, afloat: Sequence[Array], notes: list[str]
) -> list[Array]:
    """Return the fixes (indices) before the shore is in reach, and the first fix in reach of it.

    afloat: indices of the fixes of each track to consider; notes: receives a note.
    """
    tracks = stranded.tracks
    first = [int(np.argmax(mask)) if mask.any() else mask.size for mask in stranded.ashore]
    before = [keep[keep < end] for keep, end in zip(afloat, first, strict=True)]
    speeds = np.concatenate(
        [_speeds(track, gap)[keep] for track, keep in zip(tracks, before, strict=True)]
    )
    fast = (
        float(np.quantile(speeds[np.isfinite(speeds)], FAST)) if np.isfinite(speeds).any() else 0.0
    )
    steps = [
        np.diff(track.time, append=np.inf)[keep] for track, keep in zip(tracks, before, strict=True)
    ]
    reach = fast * np.minimum(np.concatenate(steps), gap)
    lon, lat = (
        np.concatenate([values[keep] for values, keep in zip(columns, before, strict=True)])
        for columns in ([track.lon for track in tracks], [track.lat for track in tracks])
    )
    within = grounding.distance_from_shore(coast, lon, lat, float(reach.max(initial=0.0))) <= reach
    ends = np.cumsum([keep.size for keep in before])[:-1]
    kept = [
        keep[: int(np.argmax(near)) + 1] if near.any() else keep
        for keep, near in zip(before, np.split(within, ends), strict=True)
    ]
    if left := sum(keep.size - own.size for keep, own in zip(afloat, kept, strict=True)):
        notes.append(
            f"{left:,} fixes left out: their drifter had come within "
            f"{float(np.median(reach)) / 1000:.2g} km of the shore, near enough to run aground "
            "before the next fix. Using them would bias the errors offshore, because tracks that "
            'lead ashore end early (coast.source = "none" keeps these fixes)'
        )
    return kept


def _speeds(track: Track, gap: float) -> Array:
    """Return the speed from each fix to the next [m/s], (n,).

    It is NaN for the last fix, and if the next is more than `gap` [s] later.
    """
    lon, lat = np.radians(track.lon), np.radians(track.lat)
    step = np.diff(track.time)
    speed = sphere.distance(lon[:-1], lat[:-1], lon[1:], lat[1:]) / step
    return np.append(np.where(step <= gap, speed, np.nan), np.nan)
