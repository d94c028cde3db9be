"""The track of one buoy or ship from a file that a case names: GPX with times, CSV or netCDF."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from drift.case.tracking import reading
from drift.case.values import gpx
from drift.tracking.tracks.records import Track


def read_one_track(
    file: str, chosen: str | None, key: str, chooser: str, several: str, advice: str
) -> Track:
    """Return the fixes of one track of a file, as they stand there.

    Args:
        file: path of the file.
        chosen: name of the track; None: the file's only one.
        key: key of the case that names the file, for messages.
        chooser: key of the case that names the track.
        several: what the file holds, in the plural: "buoys".
        advice: what to do with a file that holds several.

    Raises:
        UserError: the file holds no track.
        ValueError: the track has no times, or it is not clear which one is meant.
    """
    name = Path(file).name

    def check_choice(names: Sequence[str]) -> None:
        listed = ", ".join(f'"{name}"' for name in names[:6])
        listed += f" and {len(names) - 6} more" if len(names) > 6 else ""
        if chosen is None and len(names) > 1:
            raise ValueError(f'{key}: "{name}" holds {len(names)} {several} ({listed}); {advice}')
        if chosen is not None and chosen not in names:
            raise ValueError(
                f'{chooser}: "{chosen}" is not in "{name}"; it holds {listed or "no named track"}'
            )

    if Path(file).suffix.lower() == ".gpx":
        check_choice(gpx.track_names(file))
        points = gpx.read_gpx(file, chosen)
        if not points.time:
            raise ValueError(f'{key}: "{name}" has no times')
        time, lon, lat = (np.array(values) for values in (points.time, points.lon, points.lat))
        return Track(Path(file).stem, time, lon, lat)
    tracks = reading.read_drifters(file, given_as=key)
    check_choice([track.name for track in tracks])
    return next(track for track in tracks if chosen in (None, track.name))
