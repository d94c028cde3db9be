"""The [[sortie]] table and the records that it builds for the search filter.

A sortie searches an area, or along legs (a pattern, waypoints, a track), or it is a watch with
range zones or a sensor. The search that was done counts, not the plan: `completed` shortens the
legs, `actual` replaces the legs.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, Field, model_validator

from drift.case.context import Run, build_each
from drift.case.search import pattern as pattern_table
from drift.case.search import track as track_table
from drift.case.search.pattern import PatternTable, RegionTable, Spacing, Waypoints
from drift.case.search.sensor import Kind, Pod, SensorTable, Zones, values_by_scenario
from drift.case.sonar import sonar as sonar_table
from drift.case.values import fields, units
from drift.case.values.mistakes import Mistakes
from drift.engine.motion.scenario import Scenario
from drift.evidence.filter import patterns
from drift.evidence.filter.detection import laws
from drift.evidence.filter.records import Sortie
from drift.evidence.sensors.records import Sensor, Sonar
from geo import notation, polyline
from geo.notation import KNOT, NMI
from geo.polyline import Area, Legs

MODES = ("area", "pattern", "waypoints", "track", "watch")


class WatchTable(fields.Table):
    """A watch: a sensor of the case or range zones, at a position or along the sortie's legs."""

    at: fields.Position | None = None
    zones: Zones | None = None
    sensor: fields.Label | None = None
    beams: list[fields.Count] | None = None

    @model_validator(mode="after")
    def one_kind(self) -> "WatchTable":
        """Reject zones together with a sensor, neither of the two, and beams without a sensor."""
        if (self.zones is None) == (self.sensor is None):
            found = "neither" if self.zones is None else "both"
            raise ValueError(f"give exactly one of zones and sensor; {found} is given")
        if self.beams is not None and self.sensor is None:
            raise ValueError("beams belong to a sensor's array; give sensor, or leave beams out")
        return self


class MarkerTable(fields.Table):
    """The track of a datum marker in a drifting search: a GPX track, or positions with times."""

    track: str | None = None
    positions: Waypoints | None = None

    @model_validator(mode="after")
    def one_way(self) -> "MarkerTable":
        """Reject no track or two, and positions without times."""
        fields.one_of(self, ("track", "positions"))
        if self.positions is not None and self.positions[0][0] is None:
            raise ValueError(
                'positions of a marker need their times: ["211800ZNOV26", "27 30N 088 15W"]'
            )
        return self


def _actual(value: object) -> Any:
    if isinstance(value, str):
        return value
    rows: Any = pattern_table.waypoints(value)
    if rows[0][0] is None:
        raise ValueError(
            'actual is a GPX file, or positions with their times: ["211800ZNOV26", "27 30N 088 15W"]'
        )
    return rows


def _completed(value: object) -> float:
    share: float = units.quantity(value, "", "share", "60 %")
    if not 0 < share <= 1:
        raise ValueError(
            f'{value!r} must be a share above 0 and at most 1, like 0.6 or "60 %"; leave out a sortie that was not flown'
        )
    return share


class SortieTable(SensorTable):
    """A [[sortie]] table as written."""

    name: fields.Label | None = None
    unit: Kind = ""
    start: fields.Time | None = None
    end: fields.Time | None = None
    speed: fields.ShipSpeed | None = None
    completed: Annotated[float, BeforeValidator(_completed)] = 1.0
    ashore: bool = True
    actual: Annotated[Any, BeforeValidator(_actual)] = None
    frame: Literal["ground", "datum"] | None = None
    marker: MarkerTable | None = None
    area: RegionTable | None = None
    pod: Pod = None
    spacing: Spacing | None = None
    pattern: PatternTable | None = None
    waypoints: Waypoints | None = None
    transit_legs: list[fields.Count] | None = None
    track: Annotated[str, Field(min_length=1)] | None = None
    watch: WatchTable | None = None
    sweep_width_after: dict[str, fields.Length] | None = None

    @model_validator(mode="after")
    def one_search(self) -> "SortieTable":
        """Reject no kind of search or two, and keys that belong to another kind."""
        if self.watch is not None:
            self._check_watch()
        else:
            fields.one_of(self, MODES)
        if self.area is None:
            for key in ("pod", "spacing"):
                if getattr(self, key) is not None:
                    where = (
                        "inside pattern"
                        if self.pattern is not None and key == "spacing"
                        else "with area"
                    )
                    raise ValueError(f"{key} belongs {where}; legs give their own coverage")
        if self._anywhere() and self.area is None and self.watch is None:
            raise ValueError(
                f'law = "{self.law.kind}" applies to an area without legs; give another law, or an area'
            )
        if self.actual is not None:
            self._check_actual()
        if self.area is not None and self.actual is None:
            self._check_effort()
        if self.pattern is not None and self.speed is None and self.actual is None:
            raise ValueError('speed is missing: a pattern needs one, like speed = "90 kn"')
        if self.frame == "datum" and (self.track is not None or self.watch is not None):
            raise ValueError(
                'frame = "datum" applies to a planned search; a track made good and a watch are relative to the ground'
            )
        if self.transit_legs is not None and (self.waypoints is None or self.actual is not None):
            raise ValueError(
                "transit_legs are numbers of legs between waypoints that do not search; give them with waypoints"
            )
        if self.marker is not None and self.frame_() == "ground":
            raise ValueError('marker belongs to frame = "datum", a search that drifts with it')
        return self

    def _check_watch(self) -> None:
        assert self.watch is not None
        for key in ("area", "pattern"):
            if getattr(self, key) is not None:
                raise ValueError(f"watch and {key}: a watch has a place (at), waypoints or a track")
        places = [self.watch.at is not None, self.waypoints is not None, self.track is not None]
        if sum(places) > 1 or (sum(places) < 1 and self.watch.sensor is None):
            raise ValueError(
                "watch needs exactly one place: watch.at, or waypoints or a track along which it moves"
            )
        for key in ("law", "sweep_width", "sweep_width_uncertainty", "completed", "actual"):
            if key in self.model_fields_set:
                raise ValueError(
                    f"{key} does not belong to a watch, whose POD its zones or sensor define; leave it out"
                )

    def _check_actual(self) -> None:
        for key in ("completed", "track", "marker"):
            if key in self.model_fields_set:
                raise ValueError(f"give actual, the track made good, or {key}, not both")
        if self.frame == "datum":
            raise ValueError('actual is a track relative to the ground; leave out frame = "datum"')
        if self._anywhere():
            raise ValueError(
                f'law = "{self.law.kind}" applies to an area without legs, actual is a track; give another law, or leave actual out'
            )

    def _anywhere(self) -> bool:
        """Return whether its detection function applies to an area without legs."""
        return laws.formulas_of(self.law).detects == "anywhere"

    def _check_effort(self) -> None:
        given = [key for key in ("pod", "spacing") if getattr(self, key) is not None]
        if len(given) == 2:
            raise ValueError(
                "give pod or spacing, not both: either determines the coverage of the area"
            )
        if not given and self.speed is None:
            raise ValueError(
                "how well was the area searched? Give one of pod, spacing, or speed (then effort is speed x time)"
            )

    def frame_(self) -> Literal["ground", "datum"]:
        """Return the frame: by default, expanding squares and sectors drift with their datum."""
        if self.actual is not None:
            return "ground"
        drifting = self.pattern is not None and self.pattern.kind in {"square", "sector"}
        return self.frame or ("datum" if drifting else "ground")

    def sortie(self, name: str, run: Run) -> Sortie:
        """Return the record of the sortie.

        Args:
            name: its name.
            run: the run, its scenarios and sensors.

        Raises:
            ValueError: it is inconsistent, or does not fit the run.
            UserError: the same, with one line for each mistake.
        """
        start = None if self.start is None else units.resolve(self.start, run.start)
        end = None if self.end is None else units.resolve(self.end, run.start)
        if start is not None and end is not None and end <= start:
            raise ValueError(
                f"end {notation.format_dtg(end)} is not after start {notation.format_dtg(start)}"
            )
        sensor = (
            sonar_table.sensor_named(self.watch.sensor, run)
            if self.watch and self.watch.sensor
            else None
        )
        area, legs = self._place(start, end, run, self._stands(sensor))
        begin, finish = self._times(start, end, legs)
        wrong = Mistakes()
        speed = math.nan
        widths: tuple[float, ...] = ()
        with wrong.gathered():
            run.check(begin, finish)
        with wrong.gathered():
            speed = self._speed(legs)
            widths = self._widths(speed, run.scenarios)
        wrong.refuse()
        # Zones of a watch, or a POD in place of a width, apply adrift and under way.
        one_pod = math.isnan(widths[0]) and self.sweep_width_under_way is None
        under_way = (
            () if self.watch or one_pod else self.widths_under_way(self.unit, speed, run.scenarios)
        )
        if self.actual is not None or self.track is not None:
            assert legs is not None
            legs = polyline.thin_legs(legs, _fineness(widths))
        widest = max((*widths, *under_way))
        if area is None and legs is not None and self.watch is None and widest > 0:
            area = polyline.search_strip(legs, widest)
        sortie = Sortie(
            name,
            self.unit,
            begin,
            finish,
            self.law,
            widths,
            width_under_way=under_way,
            shape=self.shape(),
            group=sensor.group if sensor else "" if self.watch else self.group(self.unit),
            area=area,
            coverage=self._coverage(widths, area, begin, finish, run.scenarios)
            if legs is None
            else (),
            coverage_under_way=(
                self._coverage(under_way, area, begin, finish, run.scenarios)
                if legs is None and under_way
                else ()
            ),
            legs=legs,
            watch=self.watch.zones if self.watch else None,
            sensor=sensor,
            beams=sonar_table.beam_indices(self.watch.beams, sensor)
            if self.watch and sensor
            else (),
            completed=self.completed,
            ashore=self.ashore,
            speed=speed,
            altitude=self.height(),
            spacing=self._given_spacing(),
            crossed=self.actual is None
            and self.pattern is not None
            and self.pattern.kind in {"parallel", "creeping"},
        )
        changed = self._changed_widths(speed, widths, run.scenarios)
        if changed and not math.isnan(widths[0]):
            coverages = [
                self._coverage(own, area, begin, finish, run.scenarios) if legs is None else ()
                for own in changed
            ]
            sortie = replace(sortie, changed=tuple(zip(changed, coverages, strict=True)))
        return self._drifting(sortie, run)

    def _changed_widths(
        self, speed: float, widths: tuple[float, ...], scenarios: Sequence[Scenario]
    ) -> list[tuple[float, ...]]:
        """Return the sweep widths [m] after change 1, 2, ... of each scenario; []: as before.

        By name of the state, else by its search object with the tables, else that of the scenario.
        """
        given = self.sweep_width_after or {}
        states = {one.name for scenario in scenarios for one in scenario.changes}
        for name in given:
            if name not in states:
                there = ", ".join(f'"{state}"' for state in sorted(states)) or "none"
                raise ValueError(
                    f'sweep_width_after: no change leads to "{name}"; there are: {there}'
                )
        if given and math.isnan(widths[0]):
            raise ValueError(
                "sweep_width_after belongs to sweep_width; give that, or leave sweep_width_after out"
            )
        changed = []
        for number in range(max((len(scenario.changes) for scenario in scenarios), default=0)):
            row = list(widths)
            for k, scenario in enumerate(scenarios):
                one = scenario.changes[number] if number < len(scenario.changes) else None
                if one is not None and one.name in given:
                    row[k] = given[one.name]
                elif one is not None and one.search_object and self._by_tables:
                    then = replace(scenario, search_object=one.search_object)
                    row[k] = self.widths(self.unit, speed, [then])[0]
            changed.append(tuple(row))
        return changed if any(row != widths for row in changed) else []

    def _stands(self, sensor: Sensor | None) -> tuple[float, float] | None:
        """Return the fixed position of a watch (lon, lat) [deg]; None if it moves or is no
        watch."""
        if self.watch is None:
            return None
        moves = self.waypoints is not None or self.track is not None
        if sensor is None:
            return self.watch.at
        if sensor.place is not None and (moves or self.watch.at is not None):
            raise ValueError(
                f'sensor "{sensor.name}" has a fixed position (at in its table); leave at, waypoints and track out here'
            )
        if sensor.place is None and not moves and self.watch.at is None:
            raise ValueError(
                f'where is sensor "{sensor.name}"? Give waypoints or a track along which it moves, or watch.at, or at in its '
                "[[sensor]] table"
            )
        if (
            self.watch.at is not None
            and isinstance(sensor.sees, Sonar)
            and len(sensor.sees.gain.bearing) > 1
        ):
            raise ValueError(
                f'sensor "{sensor.name}" has an array, which has a heading: give waypoints or a track along which it moves, or '
                "at and heading in its [[sensor]] table"
            )
        return sensor.place or self.watch.at

    def _place(
        self,
        start: np.datetime64 | None,
        end: np.datetime64 | None,
        run: Run,
        stands: tuple[float, float] | None,
    ) -> tuple[Area | None, Legs | None]:
        """Return the searched area and the legs made good, None where there is none."""
        since = None if start is None else float(notation.epoch(start))
        until = None if end is None else float(notation.epoch(end))
        if self.actual is not None:
            legs = track_table.read_track(self.actual, "actual", self.speed, since, until, run)
            if self.pattern is None:
                return self.area.area() if self.area else None, legs
            return self._planned(
                since or legs.time[0], until or legs.time[-1], self._speed(legs)
            ).area, legs
        if self.area is not None:
            return self.area.area(), None
        if self.track is not None:
            return None, track_table.completed_share(
                track_table.read_track(self.track, "track", self.speed, since, until, run),
                self.completed,
                until,
            )
        if self.waypoints is not None and self.waypoints[0][0] is not None:
            legs = self._transit(pattern_table.timed_legs(self.waypoints, run.start))
            track_table.check_speed(legs, self.speed, 0.0, "waypoints")
            return None, track_table.completed_share(legs, self.completed, until)
        if since is None:
            raise ValueError("start is missing and has no default")
        if stands is not None:
            if until is None:
                raise ValueError("end is missing and has no default: it is the end of the watch")
            lon, lat = stands
            return None, Legs((since, until), (lon, lon), (lat, lat), (True,))
        if self.pattern is not None:
            assert self.speed is not None  # one_search
            pattern = self._planned(since, until, self.speed)
            return pattern.area, track_table.completed_share(pattern.legs, self.completed, until)
        assert self.waypoints is not None
        if self.speed is None:
            raise ValueError(
                'speed is missing: waypoints without times need one, like speed = "90 kn"'
            )
        lon_deg, lat_deg = np.array([place for _, place in self.waypoints]).T
        try:
            return None, track_table.completed_share(
                self._transit(polyline.legs_at_speed(lon_deg, lat_deg, since, self.speed)),
                self.completed,
                until,
            )
        except ValueError as error:
            raise ValueError(f"waypoints: {error}") from None

    def _transit(self, legs: Legs) -> Legs:
        """Return the legs with `transit_legs` marked as not searching."""
        if self.transit_legs is None:
            return legs
        many, named = len(legs.searching), self.transit_legs
        if not named or min(named) < 1 or max(named) > many or len(set(named)) == many:
            raise ValueError(
                f"transit_legs {named} must list some of its {many} legs by number, from 1, and not all of them"
            )
        return replace(legs, searching=tuple(k + 1 not in named for k in range(many)))

    def _planned(self, since: float, until: float | None, speed: float) -> patterns.Pattern:
        assert self.pattern is not None
        try:
            return self.pattern.pattern(since, speed, until)
        except ValueError as error:
            raise ValueError(f"pattern: {error}") from None

    def _times(
        self, start: np.datetime64 | None, end: np.datetime64 | None, legs: Legs | None
    ) -> tuple[np.datetime64, np.datetime64]:
        """Return the begin and end of the sortie: those given, else those of its legs."""
        if legs is None:
            for key, time in (("start", start), ("end", end)):
                if time is None:
                    raise ValueError(f"{key} is missing and has no default")
            assert start is not None
            assert end is not None
            return start, end
        first, last = (
            pattern_table.moment(math.floor(legs.time[0] + 1e-6)),
            pattern_table.moment(legs.time[-1], up=True),
        )
        for stated, flown, late in ((start, first, False), (end, last, True)):
            if stated is not None and (flown > stated if late else flown < stated):
                raise ValueError(
                    f"its legs {'end' if late else 'begin'} at {notation.format_dtg(flown)}, "
                    f"{'after its end' if late else 'before its start'}, {notation.format_dtg(stated)}"
                )
        return first if start is None else start, last if end is None else end

    def _speed(self, legs: Legs | None) -> float:
        """Return the speed [m/s]: the one given, else that of the legs, else NaN."""
        if self.speed is not None:
            return self.speed
        if legs is None or (
            self.watch is not None and len({*zip(legs.lon, legs.lat, strict=True)}) == 1
        ):
            return math.nan
        return float(polyline.lengths(legs).sum()) / (legs.time[-1] - legs.time[0])

    def _widths(self, speed: float, scenarios: Sequence[Scenario]) -> tuple[float, ...]:
        """Return the sweep widths [m]; NaN for a watch, and for a POD in place of a width."""
        if self.watch is not None:
            return (math.nan,) * len(scenarios)
        if (
            self.area is not None
            and self.actual is None
            and self.pod is not None
            and self.sweep_width is None
        ):
            return (math.nan,) * len(scenarios)
        return self.widths(self.unit, speed, scenarios)

    def _coverage(
        self,
        widths: tuple[float, ...],
        area: Area | None,
        start: np.datetime64,
        end: np.datetime64,
        scenarios: Sequence[Scenario],
    ) -> tuple[float, ...]:
        """Return the coverage of an area for each scenario."""
        assert area is not None
        if self.pod is not None:
            pods = (
                values_by_scenario(self.pod, scenarios, "pod")
                if isinstance(self.pod, dict)
                else (self.pod,) * len(scenarios)
            )
            try:
                return tuple(laws.coverage_of(self.law, pod) for pod in pods)
            except ValueError as error:
                raise ValueError(f"pod: {error}") from None
        size, duration = patterns.square_metres(area), float((end - start) / np.timedelta64(1, "s"))
        if self.spacing is None:
            assert self.speed is not None  # _check_effort
            return tuple(width * self.speed * duration / size for width in widths)
        takes = size / self.spacing / self.speed if self.speed else 0.0
        if takes > track_table.TOO_FAST * duration and self.completed == 1:
            assert self.speed is not None
            raise ValueError(
                f"{size / NMI**2:.3g} nmi2 at a spacing of {self.spacing / NMI:.3g} nmi take "
                f"{track_table.hours(takes)} at {self.speed / KNOT:.3g} kn, but start to end is "
                f"{track_table.hours(duration)}; change one of these, or give completed"
            )
        return tuple(width / self.spacing for width in widths)

    def _given_spacing(self) -> float:
        spacing = self.pattern.spacing if self.pattern is not None else self.spacing
        return math.nan if spacing is None else spacing

    def _drifting(self, sortie: Sortie, run: Run) -> Sortie:
        """Return the sortie with its datum and marker if it drifts, else unchanged."""
        if self.frame_() == "ground":
            return sortie
        if self.pattern is not None and self.pattern.datum is not None:
            datum = self.pattern.datum
        elif self.pattern is not None and self.pattern.centre is not None:
            datum = self.pattern.centre
        elif self.area is not None:
            datum = self.area.middle()
        else:
            assert sortie.legs is not None
            datum = (sortie.legs.lon[0], sortie.legs.lat[0])
        marker = None
        if self.marker is not None:
            given = (self.marker.track, self.marker.positions)
            marker = track_table.read_marker(*given, sortie.start, sortie.end, run)
        return replace(sortie, frame="datum", datum=datum, marker=marker)


def build_sorties(tables: Sequence[SortieTable], run: Run) -> tuple[Sortie, ...]:
    """Return the sorties, ordered by start; raise UserError with all their mistakes."""
    sorties = build_each(
        [table.sortie for table in tables], [table.name for table in tables], "sortie", run
    )
    return tuple(sorted(sorties, key=lambda sortie: (sortie.start, sortie.end)))


def _fineness(widths: tuple[float, ...]) -> float:
    seen = [width for width in widths if width > 0]
    return min([track_table.FINEST, *(width / 20 for width in seen)])
