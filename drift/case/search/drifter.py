"""The [[drifter]] table: a drifting buoy on scene, whose track corrects the current near it."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from drift.case.context import Run, unique_names
from drift.case.forcing import sources
from drift.case.tracking import reading
from drift.case.values import fields, gpx, units
from drift.case.values.mistakes import Mistakes
from drift.engine.motion.errors.buoys import BuoyTrack
from drift.engine.motion.scenario import Scenario
from drift.tracking.tracks import records
from drift.tracking.tracks.records import Track
from geo import notation, sphere
from geo.array import Array
from geo.errors import UserError

# Windage of buoys: share of the wind at 10 m that moves them through the water at their depth. CODE
# drifters, of which self-locating datum marker buoys are a kind, show no downwind slip (Poulain,
# Ursella and Brunetti 2002, LAPCOD meeting, Key Largo); SVP drifters that lost their drogue 1 %
# (Poulain et al. 2009, doi:10.1175/2008JTECHO618.1).
WINDAGE = {"sldmb": 0.0, "code": 0.0, "svp": 0.0, "undrogued svp": 0.01}
MOST = 12  # buoys of a case: the errors at them are states of every particle
LONGEST_GAP = 6 * 3600.0  # [s] between fixes; over a longer one the way between them is unknown
FARTHEST = 20  # correlation lengths from a buoy to the search object; more is a mistake


class DrifterTable(fields.Table):
    """A [[drifter]] table as written."""

    name: fields.Label | None = None
    """Name in messages and results; by default that of the track in the file, or the file's."""
    track: Annotated[str, Field(min_length=1)]
    """The buoy's fixes: CSV with time, lon and lat (and id, if it holds several buoys), GPX with
    times, or netCDF with CF trajectories."""
    id: fields.Label | None = None
    """Which buoy of the file; by default its only one."""
    kind: Literal["sldmb", "code", "svp", "undrogued svp"] = "sldmb"
    """Kind of buoy, which gives its windage: none for a self-locating datum marker buoy, another
    buoy of the CODE kind, or an SVP drifter (drogued at 15 m); 1 % for one without its drogue."""
    windage: fields.Windage | None = None
    """Share of the wind that moves the buoy; by default that of its kind."""
    error: fields.Length = 20.0
    """Standard deviation of each component of a fix."""
    until: fields.Time | None = None
    """When the buoy was picked up or ran aground; later fixes are not used."""

    @model_validator(mode="after")
    def exact_fixes_are_none(self) -> "DrifterTable":
        """Reject fixes without error."""
        if self.error < 1:
            raise ValueError(f"error is {self.error:g} m; at least 1 m")
        return self

    def buoy(self, name: str, run: Run) -> BuoyTrack:
        """Return the fixes within the run.

        Raises:
            UserError: the file holds no track, or another one.
            ValueError: fewer than two fixes lie in the run.
        """
        track = self._track(run.folder)
        found = records.believed([track])
        if not found.tracks:
            raise ValueError(
                f'"{self.track}": fewer than two fixes are believable '
                f"({'; '.join(found.notes)}); check its times and positions"
            )
        track, notes = found.tracks[0], list(found.notes)
        keep = ~found.aground[0]
        if keep.sum() < 2:
            raise ValueError(
                f'"{self.track}": {(~keep).sum():,} of its {keep.size:,} fixes lie aground, for {records.AGROUND / 3600:g} h or more within '
                f"{records.STILL:g} m; leave the drifter out"
            )
        if not keep.all():
            notes.append(f"{(~keep).sum():,} fixes left out at which it lay aground")
        end = run.end if self.until is None else units.resolve(self.until, run.start)
        inside = (track.time >= notation.epoch(run.start)) & (
            track.time <= min(notation.epoch(end), notation.epoch(run.end))
        )
        if (keep & inside).sum() < 2:
            first, last = (np.datetime64(int(t), "s") for t in (track.time[0], track.time[-1]))
            raise ValueError(
                f'"{self.track}": fewer than two fixes afloat from {notation.format_dtg(run.start)} to '
                f"{notation.format_dtg(end)}; they are from {notation.format_dtg(first)} to "
                f"{notation.format_dtg(last)}; change the case's times or until, or check the zone of the file's times"
            )
        if not inside.all():
            until = "the end" if self.until is None else "until"
            notes.append(f"{(~inside).sum():,} fixes left out before the start or after {until}")
        # a fix after one that is left out begins a stretch
        fresh = records.breaks(track, LONGEST_GAP) | np.append(False, ~keep[:-1])
        chosen = records.selected(track, keep & inside)
        fresh = fresh[keep & inside]
        fresh[0] = True
        if fresh.all():
            raise ValueError(
                f'"{self.track}": no two of its {fresh.size} fixes are at most {LONGEST_GAP / 3600:g} h apart and need at most '
                f"{records.FASTEST:g} m/s; give more fixes, or leave the drifter out"
            )
        if gaps := int(fresh[1:].sum()):
            notes.append(
                f"{gaps:,} gaps of more than {LONGEST_GAP / 3600:g} h, or leaps, between fixes"
            )
        windage = WINDAGE[self.kind] if self.windage is None else self.windage
        return BuoyTrack(
            name,
            np.rint(chosen.time),
            chosen.lon,
            chosen.lat,
            fresh,
            self.error,
            windage,
            tuple(notes),
        )

    def _track(self, folder: Path) -> Track:
        """Return the track of the file that is meant."""
        file = sources.one_file(self.track, folder, "track")
        if Path(file).suffix.lower() == ".gpx":
            names = gpx.track_names(file)
            self._check_id(file, names)
            points = gpx.read_gpx(file, self.id)
            if not points.time:
                raise ValueError(f'track: "{Path(file).name}" has no times')
            time, lon, lat = (np.array(values) for values in (points.time, points.lon, points.lat))
            return Track(Path(file).stem, time, lon, lat)
        tracks = reading.read_drifters(file, given_as="track")
        self._check_id(file, [track.name for track in tracks])
        return next(track for track in tracks if self.id in (None, track.name))

    def _check_id(self, file: str, names: Sequence[str]) -> None:
        """Reject a file of several buoys without `id`, and an `id` that is not in the file."""
        listed = ", ".join(f'"{name}"' for name in names[:6])
        listed += f" and {len(names) - 6} more" if len(names) > 6 else ""
        if self.id is None and len(names) > 1:
            raise ValueError(
                f'track: "{Path(file).name}" holds {len(names)} buoys ({listed}); give id, and a [[drifter]] for each'
            )
        if self.id is not None and self.id not in names:
            raise ValueError(
                f'id: "{self.id}" is not in "{Path(file).name}"; it holds {listed or "no named track"}'
            )


def build_drifters(tables: Sequence[DrifterTable], run: Run) -> tuple[BuoyTrack, ...]:
    """Return the buoys of a case; raise UserError with all their mistakes."""
    if not tables:
        return ()
    wrong, found = Mistakes(), []
    names = [table.name or table.id or Path(table.track).stem for table in tables]
    with wrong.gathered():
        unique_names(names, "drifter")
    if len(tables) > MOST:
        wrong.lines.append(f"[[drifter]]: {len(tables)} buoys; at most {MOST}")
    for table, name in zip(tables, names, strict=True):
        try:
            found.append(table.buoy(name, run))
        except UserError as error:
            wrong.lines += [f'drifter "{name}": {line}' for line in error.lines]
        except ValueError as error:
            wrong.lines.append(f'drifter "{name}": {error}')
    wrong.refuse()
    return tuple(found)


def check_near(buoys: Sequence[BuoyTrack], scenarios: Sequence[Scenario], length: float) -> None:
    """Reject a buoy too far from every scenario to be of use.

    Args:
        buoys: of the case.
        scenarios: of the case.
        length: correlation length of the current's errors [m].

    Raises:
        UserError: one line for each such buoy.
    """
    places = [extent for scenario in scenarios for extent in scenario.extents(3.0)]
    wrong = []
    for buoy in buoys:
        nearest = min(_nearest(buoy, x, y) - reach for x, y, reach in places)
        if nearest > FARTHEST * length:
            wrong.append(
                f'drifter "{buoy.name}": is {nearest / 1000:,.0f} km from the nearest reported position at least; the errors of the '
                f"current are correlated over {length / 1000:.3g} km, so at most {FARTHEST * length / 1000:.3g} km are of use; check its "
                "positions (east is positive), leave it out, or give uncertainty.current.length"
            )
    if wrong:
        raise UserError(*wrong)


def check_wind(buoys: Sequence[BuoyTrack], scenarios: Sequence[Scenario]) -> None:
    """Reject a buoy with windage where a scenario's object feels no wind, which is then not read.

    Raises:
        UserError: one line for each such buoy.
    """
    still = [
        scenario.name
        for scenario in scenarios
        if not (scenario.uses_wind and scenario.sources.get("wind"))
    ]
    blown = [buoy for buoy in buoys if buoy.windage > 0]
    if still and blown:
        raise UserError(
            *(
                f'drifter "{buoy.name}": windage is {notation.percent(buoy.windage)}, but scenario "{still[0]}" has no wind that its '
                "object feels; add one, or give windage = 0"
                for buoy in blown
            )
        )


def _nearest(buoy: BuoyTrack, lon: Array, lat: Array) -> float:
    """Return the least distance [m] of a buoy's fixes from places [rad]."""
    x, y = np.radians(buoy.lon), np.radians(buoy.lat)
    return float(
        sphere.distance(x[:, None], y[:, None], lon.reshape(1, -1), lat.reshape(1, -1)).min()
    )
