"""The [spill] table and its finds and patrols: many objects of some classes, released by one event.

The tables build records in SI units and UTC. The parameters that all objects of a spill share
(release, biases of windage and current, share destroyed, sinking rate, reporting rate) are drawn
once for each *world*; the objects are drawn within a world. For the probability model see
drift.spills.worlds.worlds and drift.spills.worlds.finds.
"""

import math
import os
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np
from pydantic import (
    BeforeValidator,
    Field,
    ValidatorFunctionWrapHandler,
    WrapValidator,
    model_validator,
)

from drift.case.scenario.objects import ObjectTable
from drift.case.scenario.scenario import TracklineTable
from drift.case.tracking import ship
from drift.case.values import fields, units
from drift.case.values.mistakes import Mistakes
from drift.case.values.places import AreaTable, PositionTable
from drift.engine.motion.scenario import JIBE_RATE, Loss, ReleasePrior, TrackPrior
from drift.spills.worlds.records import (
    DAY,
    FEWEST_PARTICLES,
    Find,
    Kind,
    Patrol,
    Reporting,
    Sinking,
    Spill,
    Team,
)
from geo import notation, sphere

MOST_CLASSES = 4
ROUNDED = 0.01 + 1e-9  # tolerance of the sum of classes' shares, which are rounded to two digits
MOST_DAYS = 60  # most patrols of a patrol_unit
MOST_REACH = 1_000_000.0  # [m] largest reach of a patrol_unit over land
FEWEST_WORLDS = 50
FASTEST = 50.0  # [m/s] greatest speed of a ship on its track
LONGEST = 366 * DAY  # [s] longest duration of the release


class SinkingTable(fields.Table):
    """Sinking of objects: at a constant rate (half-life), or lognormal with a median time.

    Times are one value or [low, high].
    """

    half_life: fields.DurationRange | None = None
    """Half-life of objects that sink at a constant rate; one value, or [lowest, highest]."""
    waterlogged: fields.DurationRange | None = None
    """Median time until an object is waterlogged and sinks; one value, or [lowest, highest]."""
    spread: Annotated[float, Field(ge=1, le=20)] = 1.5
    """Factor of one standard deviation of `waterlogged`."""

    @model_validator(mode="after")
    def one_law(self) -> "SinkingTable":
        """Reject no distribution, or two."""
        law = fields.one_of(self, ("half_life", "waterlogged"))
        if law == "half_life" and "spread" in self.model_fields_set:
            raise ValueError("spread belongs to waterlogged; a half_life has no spread")
        return self

    def sinking(self) -> Sinking:
        """Return the record of the sinking law."""
        if self.half_life is not None:
            return Sinking(self.half_life)
        assert self.waterlogged is not None
        return Sinking(self.waterlogged, max(math.log(self.spread), 1e-6))


class KindTable(fields.Table):
    """A [[spill.class]] table as written."""

    name: fields.Label
    """Name of the class in tables."""
    share: fields.Weight | None = None
    """Share of the objects; shares add up to 1. Classes without it divide the remainder equally."""
    object: Annotated[
        ObjectTable,
        BeforeValidator(lambda value: {"name": value} if isinstance(value, str) else value),
    ]
    """The drifting object, as in a scenario."""
    jibe: fields.Rate | None = None
    """Jibing rate, as in a scenario."""
    sinking: SinkingTable | None = None
    """Sinking of objects; by default objects do not sink."""

    def kind(self, share: float) -> Kind:
        """Return the record of the class, with its share of all objects."""
        drifter = self.object.drifter()
        jibe = self.jibe if self.jibe is not None else (JIBE_RATE if drifter.jibes else 0.0)
        return Kind(
            self.name, share, drifter, jibe, self.sinking.sinking() if self.sinking else None
        )


def _rates(value: Any) -> dict[str, float]:
    if not isinstance(value, dict):
        raise ValueError(
            'must be a table of rates by kind of shore, like { town = "1 /day", wild = "0.02 /day" }'
        )
    return {str(kind): fields.rate(rate) for kind, rate in value.items()}


class ReportingTable(fields.Table):
    """The [spill.reporting] table as written; rates are per stranded object."""

    rate: Annotated[dict[str, float], BeforeValidator(_rates)] = Field(
        default_factory=lambda: {"town": 1 / DAY, "road": 0.2 / DAY, "wild": 0.02 / DAY}
    )
    """Rate at which a stranded object is reported, by kind of shore."""
    removal: Annotated[float, BeforeValidator(fields.rate)] = 0.0
    """Rate at which stranded objects are buried or removed without a report."""
    bias: Annotated[float, Field(ge=0, le=3)] = 0.0
    """Uncertainty of all rates: standard deviation of the logarithm of a common factor."""
    coast: str = "wild"
    """Kind of shore of stretches without `access` in a file."""
    until: fields.Time | None = None
    """Time up to which all reports are known; by default the last find or patrol."""

    @model_validator(mode="after")
    def whole(self) -> "ReportingTable":
        """Reject a kind of shore without a rate."""
        if self.coast not in self.rate:
            raise ValueError(
                f'coast = "{self.coast}" has no rate; kinds with one: {", ".join(self.rate) or "none"}'
            )
        return self


class StretchTable(fields.Table):
    """The [spill.stretches] table as written."""

    length: Annotated[fields.Length, Field(ge=100, le=1_000_000)] = 10_000.0
    """Length of stretches, if no file defines them."""
    file: str | None = None
    """GeoJSON of lines or polygons with `name`, and `access`, the kind of shore."""


def _number(value: object) -> tuple[int, int]:
    low, high = fields.pair_of(lambda x: float(fields.count(x)))(value)
    if not 1 <= low <= high <= 1_000_000:
        raise ValueError(
            f"{value!r} must be a number of objects, 1 to 1,000,000, or [lowest, highest]"
        )
    return int(low), int(high)


def _release_duration(value: object) -> float:
    seconds = units.quantity(value, "s", "duration", "2 h")
    if not 0 <= seconds <= LONGEST:
        raise ValueError(f"{value!r} must be 0 to {LONGEST / DAY:g} d")
    return seconds


class TrackPointTable(fields.Table):
    """A point of the ship's track."""

    at: fields.Position
    """Position of the ship."""
    time: fields.Time
    """Time at which it was there."""


def _file_or_points(value: object, handler: ValidatorFunctionWrapHandler) -> Any:
    if isinstance(value, str) and value:
        return value
    if not isinstance(value, list):
        raise ValueError(
            f'{value!r} must be a file such as "ship.gpx", or points like '
            '{ at = "53 25N 004 15E", time = "011700ZJAN2019" }'
        )
    return handler(value)


def _begin(value: object) -> tuple[units.Instant, units.Instant]:
    early, late = value if isinstance(value, list) and len(value) == 2 else (value, value)
    return units.time(early), units.time(late)


class LossTable(fields.Table):
    """A [[spill.loss]] table: an interval in which objects went overboard along the track."""

    begin: Annotated[tuple[units.Instant, units.Instant], BeforeValidator(_begin)]
    """Time at which it began; one, or [earliest, latest]."""
    length: fields.DurationRange
    """How long it lasted; one value, or [shortest, longest]."""
    share: Annotated[fields.Weight, Field(gt=0)] | None = None
    """Share of the objects; by default each loss has the same."""

    def record(self, start: np.datetime64, share: float) -> Loss:
        """Return the record of the loss; share: if the table has none."""
        early, late = (units.resolve(time, start) for time in self.begin)
        if late < early:
            raise ValueError(
                f"[spill] loss: begin must go from the earlier to the later time, not from "
                f"{notation.format_dtg(early)} to {notation.format_dtg(late)}"
            )
        return Loss((early, late), self.length, self.share or share)


class SpillTable(fields.Table):
    """The [spill] table as written."""

    old_keys: ClassVar = {
        "scatter": "release_std",
        "lasting": "release_duration",
        "renewals": "redraws",
    }

    objects: Annotated[tuple[int, int], BeforeValidator(_number)]
    """Number of objects lost, or [fewest, most]."""
    kinds: Annotated[list[KindTable], Field(min_length=1, max_length=MOST_CLASSES, alias="class")]
    """Classes of objects, one to four."""
    position: PositionTable | None = None
    """Position of the release, as in a scenario."""
    area: AreaTable | None = None
    """In place of `position`: anywhere in an area."""
    trackline: TracklineTable | None = None
    """In place of `position`: somewhere on a voyage."""
    track: Annotated[
        Annotated[list[TrackPointTable], Field(min_length=2)] | None, WrapValidator(_file_or_points)
    ] = None
    """In place of `position`: the ship's track, points or a file (GPX with times, CSV, netCDF);
    objects go overboard along it, in each `loss`."""
    ship: fields.Label | None = None
    """Which ship of the file in `track`; by default its only one."""
    loss: list[LossTable] = Field(default_factory=list)
    """Intervals in which objects went overboard, with `track`."""
    clock_error: Annotated[float, BeforeValidator(_release_duration)] = 0.0
    """Largest error of the ship's clock that the times of `track` are by; either way, equally
    likely."""
    release_std: fields.Length = 0.0
    """Standard deviation of an object's release position about that of its world, east and
    north."""
    release_duration: Annotated[float, BeforeValidator(_release_duration)] = 0.0
    """Duration of the release, over which the objects of a world go adrift."""
    worlds: fields.Count = 2000
    """Number of simulated spills, each with its own parameters."""
    per_world: fields.Count | None = None
    """Particles per world; by default the number of objects, at least 500, at most 2,000."""
    destroyed: fields.ShareRange = (0.0, 0.0)
    """Share of objects destroyed at once, or a range."""
    windage_bias: Annotated[fields.Share, Field(le=1)] = 0.2
    """Standard deviation of the logarithm of a world's factor on all leeway."""
    current_bias: fields.CurrentError | None = None  # in place of uncertainty.current.bias
    """In place of `uncertainty.current.bias`: standard deviation of a world's bias, per
    component."""
    redraws: Annotated[fields.Count, Field(ge=0, le=20)] = 3
    """Largest number of times that worlds are resampled, if finds leave too few effective
    worlds."""
    stretches: StretchTable = StretchTable()
    """Stretches into which the coast is divided."""
    reporting: ReportingTable = ReportingTable()
    """The reporting rate of stranded objects."""
    bridges: list[Annotated[list[fields.Position], Field(min_length=2, max_length=2)]] = Field(
        default_factory=list
    )
    """Bridges, dams and fords that connect land masses for patrols and names: pairs of positions,
    one on either side.
    """

    @model_validator(mode="after")
    def whole(self) -> "SpillTable":
        """Reject no position or two, wrong shares of classes, and too few or too many worlds."""
        place = fields.one_of(self, ("position", "area", "trackline", "track"))
        self._check_loss(place == "track")
        if self.ship is not None and self.track_file is None:
            raise ValueError('ship is one of the ships in a file; give track = "FILE" too')
        self.shares()
        names = [kind.name for kind in self.kinds]
        for name in names:
            if names.count(name) > 1:
                raise ValueError(f'class "{name}": two classes have this name; give each its own')
            # headings of washup.csv
            if name == "se" or name.removesuffix("_se") in set(names) - {name}:
                raise ValueError(
                    f'class "{name}": this name is that of a standard error in tables; give another'
                )
        if self.worlds < FEWEST_WORLDS:
            raise ValueError(
                f"worlds {self.worlds}: must be at least {FEWEST_WORLDS}; 2000 is usual"
            )
        if self.per_world is not None and self.per_world < FEWEST_PARTICLES * len(self.kinds):
            raise ValueError(
                f"per_world {self.per_world}: must be at least {FEWEST_PARTICLES} for each class"
            )
        particles = self.worlds * self.particles()
        if hasattr(os, "sysconf"):
            most = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") // 400
            if particles > min(most, 2**31 - 1):
                raise ValueError(
                    f"worlds x per_world = {particles:,} particles; this machine's memory holds {most:,}"
                )
        return self

    def _check_loss(self, track: bool) -> None:
        if not track:
            for name in ("loss", "clock_error"):
                if name in self.model_fields_set:
                    raise ValueError(f"{name} belongs to track, the ship's track; give track too")
            return
        if not self.loss:
            raise ValueError("track needs a [[spill.loss]]: when objects went overboard")
        if "release_duration" in self.model_fields_set:
            raise ValueError("release_duration: with track give the length of each [[spill.loss]]")
        given = [loss.share for loss in self.loss if loss.share is not None]
        if given and (len(given) < len(self.loss) or abs(math.fsum(given) - 1) > ROUNDED):
            raise ValueError(
                f"shares of the losses, {', '.join(f'{share:g}' for share in given)}: give each "
                "loss one, so that they add up to 1, or none"
            )

    def shares(self) -> list[float]:
        """Return the classes' shares of the objects; raise ValueError if they do not add up to
        1."""
        total = math.fsum(kind.share or 0.0 for kind in self.kinds)
        missing = sum(kind.share is None for kind in self.kinds)
        if missing and total < 1:
            return [
                (1 - total) / missing if kind.share is None else kind.share for kind in self.kinds
            ]
        if missing or abs(total - 1) > ROUNDED:
            each = ", ".join(
                f"{kind.name} {'not given' if kind.share is None else f'{kind.share:g}'}"
                for kind in self.kinds
            )
            rest = ", and leave a remainder for classes without a share" if missing else ""
            raise ValueError(
                f"shares of the classes add up to {total:g} ({each}); they must add up to 1{rest}"
            )
        return [(kind.share or 0.0) / total for kind in self.kinds]

    def particles(self) -> int:
        """Return the number of particles per world."""
        return (
            self.per_world if self.per_world is not None else min(max(self.objects[1], 500), 2000)
        )

    @property
    def track_file(self) -> str | None:
        """The file of the ship's track; None: there is none, or its points are in the case."""
        given: Any = self.track
        return given if isinstance(given, str) else None

    def prior(self, start: np.datetime64, folder: Path) -> ReleasePrior:
        """Return the prior of a world's release: position and time.

        Args:
            start: start of the case.
            folder: folder from which relative paths start.

        Raises:
            UserError: the file of the ship's track cannot be read.
            ValueError: the position or the track is not possible.
        """
        if self.track:
            return self._track_prior(self.track, start, folder)
        table = self.position or self.area or self.trackline
        assert table is not None  # whole
        return table.prior(start)

    def _track_prior(
        self, track: list[TrackPointTable], start: np.datetime64, folder: Path
    ) -> TrackPrior:
        file = self.track_file
        fixes = _points(track, start) if file is None else ship.read_ship(file, self.ship, folder)
        losses = tuple(loss.record(start, 1 / len(self.loss)) for loss in self.loss)
        first = min(loss.begin[0] for loss in losses)
        last = max(loss.end for loss in losses)
        margin = np.timedelta64(math.ceil(self.clock_error), "s")
        begin, end = (float(notation.epoch(time)) for time in (first - margin, last + margin))
        if begin < fixes.time[0] or end > fixes.time[-1]:
            known = [np.datetime64(round(float(time)), "s") for time in fixes.time[[0, -1]]]
            raise ValueError(
                f"[spill] loss: objects may go overboard from {notation.format_dtg(first)} to "
                f"{notation.format_dtg(last)}, and with clock_error the ship's track must cover "
                f"{notation.format_dtg(first - margin)} to {notation.format_dtg(last + margin)}; it "
                f"covers {notation.format_dtg(known[0])} to {notation.format_dtg(known[1])}"
            )
        if file is not None:
            fixes = ship.during(fixes, begin, end)
        lon, lat = np.radians(fixes.lon), np.radians(fixes.lat)
        speed = sphere.distance(lon[:-1], lat[:-1], lon[1:], lat[1:]) / np.diff(fixes.time)
        if speed.max() > FASTEST:
            k = int(np.argmax(speed))
            when = notation.format_dtg(np.datetime64(round(float(fixes.time[k])), "s"))
            raise ValueError(
                f"[spill] track: the ship makes {speed.max():.0f} m/s between two points, from "
                f"{when}; at most {FASTEST:g} m/s; check positions and times"
            )
        return TrackPrior(
            tuple(lon.tolist()),
            tuple(lat.tolist()),
            tuple(fixes.time.tolist()),
            losses,
            self.clock_error,
            first,
            last,
        )

    def began(self) -> str:
        """Return the key that sets the begin of the spill."""
        return (
            "loss.begin"
            if self.track
            else "trackline.departure"
            if self.trackline
            else "position.time"
            if self.position
            else "area.time"
        )


def _points(track: list[TrackPointTable], start: np.datetime64) -> ship.Fixes:
    """Return the points of a track in the case; reject times that do not ascend."""
    times = [units.resolve(point.time, start) for point in track]
    for before, after in pairwise(times):
        if after <= before:
            raise ValueError(
                f"[spill] track: {notation.format_dtg(after)} follows "
                f"{notation.format_dtg(before)}; times must ascend"
            )
    lon, lat = np.array([point.at for point in track]).T
    return ship.Fixes(np.array([float(notation.epoch(time)) for time in times]), lon, lat)


class FindTable(fields.Table):
    """A [[find]] table as written."""

    name: fields.Label | None = None
    """Name of the find in tables."""
    at: fields.Position | None = None
    """Position of the find; give this or `stretch`."""
    stretch: str | None = None
    """Name of the stretch on which it was found."""
    time: fields.Time | None = None
    """Time of the find."""
    by_time: fields.Time | None = None
    """Latest possible time of the find, if its time is unknown."""
    at_sea: bool = False
    """`true`: it was found afloat."""
    radius: Annotated[fields.Length, Field(gt=0)] = 5000.0
    """For a find at sea: particles within this distance match the find."""
    kind: str | None = Field(default=None, alias="class")
    """Class of the object, if known."""
    by: str | None = None
    """Name of the patrol that found it; by default the public."""
    false: fields.Share = 0.0
    """Probability that the find is not from this spill."""

    @model_validator(mode="after")
    def placed(self) -> "FindTable":
        """Reject a find without exactly one position and one time."""
        fields.one_of(self, ("at", "stretch"))
        if self.by is None or self.time is not None or self.by_time is not None:
            fields.one_of(self, ("time", "by_time"))
        if self.at_sea and (self.at is None or self.by is not None or self.by_time is not None):
            raise ValueError("at_sea needs at = a position and a time, and no patrol")
        if self.by is not None and self.by_time is not None:
            raise ValueError(
                "by a patrol, at the patrol's time: give time, or leave it to the patrol"
            )
        if "radius" in self.model_fields_set and not self.at_sea:
            raise ValueError(
                "radius belongs to a find with at_sea = true; one ashore lies on its stretch"
            )
        if self.false >= 1:
            raise ValueError(
                "false = 1: the find is certainly not from this spill and has no effect; leave it out"
            )
        return self


class PatrolTable(fields.Table):
    """A [[patrol]] table as written."""

    name: fields.Label
    """Name of the patrol, to which finds refer."""
    stretches: list[str] = Field(default_factory=list)
    """Names of the patrolled stretches; give these or `between`."""
    between: Annotated[list[fields.Position], Field(min_length=2, max_length=2)] | None = None
    """Two positions on the shore; the patrol covered the shore between them."""
    time: fields.Time
    """Time of the patrol."""
    detection: Annotated[
        float, BeforeValidator(lambda value: units.quantity(value, "", "probability", "0.8"))
    ]
    """Probability to find an object lying there."""

    @model_validator(mode="after")
    def proper(self) -> "PatrolTable":
        """Reject a detection that is not a probability, and a patrol without stretches."""
        if not 0 <= self.detection <= 1:
            raise ValueError(f"detection {self.detection:g} must be a probability, 0 to 1")
        if bool(self.stretches) == (self.between is not None):
            raise ValueError("give either stretches = [names] or between = [position, position]")
        return self


class PatrolUnitTable(fields.Table):
    """A [[patrol_unit]] table as written."""

    name: fields.Label
    """Name of the unit in the plan."""
    length: Annotated[fields.Length, Field(gt=0)]
    """Length of shore that it patrols in a day."""
    detection: Annotated[
        float, BeforeValidator(lambda value: units.quantity(value, "", "probability", "0.8"))
    ]
    """Probability to find an object lying there."""
    first: fields.Time
    """Time of its first patrol; then every 24 h."""
    days: Annotated[fields.Count, Field(ge=1, le=MOST_DAYS)] = 1
    """Number of patrols."""
    stretches: list[str] = Field(default_factory=list)
    """Names of the stretches that it can reach; give these or `base`."""
    base: fields.Position | None = None
    """Base of the unit; needs `reach`. With neither `stretches` nor `base` it can go anywhere."""
    reach: Annotated[fields.Length, Field(gt=0)] | None = None
    """Largest distance over land from `base` to the middle of a stretch; with `crosses_water` along
    a straight line.
    """
    crosses_water: bool = False
    """`true`: it also reaches other land masses, by boat; otherwise only that of its `base`."""

    @model_validator(mode="after")
    def proper(self) -> "PatrolUnitTable":
        """Reject a detection that is not a probability, and a reach without a base."""
        if not 0 < self.detection <= 1:
            raise ValueError(
                f"detection {self.detection:g} must be a probability above 0, at most 1"
            )
        if self.stretches and self.base is not None:
            raise ValueError(
                "give either stretches = [names], or base with reach, or none of them if the team can go anywhere"
            )
        if (self.base is None) != (self.reach is None):
            raise ValueError(
                'base and reach belong together, like base = "29 10N 090 50W", reach = "40 km"'
            )
        if self.reach is not None and self.reach > MOST_REACH and not self.crosses_water:
            raise ValueError(
                f"reach {self.reach / 1000:g} km: at most {MOST_REACH / 1000:g} km over land; give less, or leave out base "
                "and reach: it can go anywhere"
            )
        return self

    def team(self, start: np.datetime64) -> Team:
        """Return the record of the team."""
        first = units.resolve(self.first, start)
        times = tuple(first + np.timedelta64(24 * day, "h") for day in range(self.days))
        base, reach = self.base, math.inf if self.reach is None else self.reach
        named = tuple(self.stretches)
        return Team(
            self.name, self.length, self.detection, times, named, base, reach, self.crosses_water
        )


def build_spill(
    table: SpillTable,
    find_tables: list[FindTable],
    patrol_tables: list[PatrolTable],
    team_tables: list[PatrolUnitTable],
    start: np.datetime64,
    file: str | None,
    folder: Path,
) -> Spill:
    """Build the record of a spill.

    Args:
        table: the [spill] table.
        find_tables: its finds.
        patrol_tables: its patrols.
        team_tables: its patrol units.
        start: start of the case.
        file: file of named stretches; None: there is none.
        folder: folder from which relative paths start.

    Raises:
        UserError: finds or patrols do not fit the spill, one line for each mistake.
    """
    prior = table.prior(start, folder)
    wrong = Mistakes()
    patrols = tuple(_patrol(patrol, start) for patrol in patrol_tables)
    wrong.lines += _duplicate_names([patrol.name for patrol in patrols], "patrol")
    finds = []
    for number, find in enumerate(find_tables, 1):
        with wrong.gathered():
            finds.append(_find(find, number, patrols, start))
    wrong.lines += _duplicate_names([find.name for find in finds], "find")
    wrong.lines += _duplicate_names([team.name for team in team_tables], "patrol_unit")
    wrong.refuse()
    spill = Spill(
        objects=table.objects,
        kinds=tuple(
            kind.kind(share)
            for kind, share in zip(table.kinds, table.shares(), strict=True)
            if share > 0
        ),
        prior=prior,
        release_std=table.release_std,
        release_duration=table.release_duration,
        worlds=table.worlds,
        per_world=table.particles(),
        destroyed=table.destroyed,
        windage_bias=table.windage_bias,
        # build_case replaces it: drift.case.forcing.uncertainty
        current_bias=table.current_bias or 0.0,
        reporting_bias=table.reporting.bias,
        redraws=table.redraws,
        stretch=table.stretches.length,
        stretches=file,
        reporting=Reporting(
            table.reporting.rate,
            table.reporting.removal,
            table.reporting.coast,
            None if table.reporting.until is None else units.resolve(table.reporting.until, start),
        ),
        finds=tuple(finds),
        patrols=patrols,
        teams=tuple(team.team(start) for team in team_tables),
        bridges=tuple((ends[0], ends[1]) for ends in table.bridges),
    )
    _check(spill, table.began())
    return spill


def _duplicate_names(names: list[str], what: str) -> list[str]:
    """Return messages about duplicate names."""
    again = [name for name in dict.fromkeys(names) if names.count(name) > 1]
    return [f'{what} "{name}": two {what}s have this name; give each its own' for name in again]


def _patrol(table: PatrolTable, start: np.datetime64) -> Patrol:
    ends = (table.between[0], table.between[1]) if table.between else None
    return Patrol(
        table.name, tuple(table.stretches), ends, units.resolve(table.time, start), table.detection
    )


def _find(table: FindTable, number: int, patrols: tuple[Patrol, ...], start: np.datetime64) -> Find:
    name = table.name or f"find {number}"
    when = table.time if table.time is not None else table.by_time
    time = units.resolve(when, start) if when is not None else None
    if table.by is not None:
        patrol = next((p for p in patrols if p.name == table.by), None)
        if patrol is None:
            allowed = ", ".join(f'"{p.name}"' for p in patrols) or "none is given"
            raise ValueError(
                f'{name}: by "{table.by}" is not a patrol; patrols: {allowed}; for the public leave it out'
            )
        if time is not None and time != patrol.time:
            raise ValueError(
                f'{name}: found at {notation.format_dtg(time)}, but patrol "{table.by}" was there at '
                f"{notation.format_dtg(patrol.time)}"
            )
        if patrol.detection == 0:
            raise ValueError(
                f'{name}: found by patrol "{table.by}", whose detection is 0; raise it'
            )
        time = patrol.time
    assert time is not None  # placed
    lon, lat = table.at if table.at is not None else (math.nan, math.nan)
    return Find(
        name,
        time,
        table.by_time is not None,
        table.stretch,
        lon,
        lat,
        table.radius,
        table.at_sea,
        table.kind,
        table.by,
        table.false,
    )


def _check(spill: Spill, when: str) -> None:
    """Reject impossible finds and patrols; `when` is the key that sets the begin of the spill."""
    wrong = Mistakes()
    kinds, most = [kind.name for kind in spill.kinds], spill.objects[1]
    for find in spill.finds:
        if find.kind is not None and find.kind not in kinds:
            wrong.lines.append(
                f'{find.name}: class "{find.kind}" is not a class of the spill with a share: {", ".join(kinds)}'
            )
    sure = [find for find in spill.finds if find.false == 0]
    cure = "raise it, or give finds a probability of being false"
    if len(sure) > most:
        wrong.lines.append(
            f"{len(sure)} finds, but only {most} objects were spilled ([spill] objects); {cure}"
        )
    for kind in spill.kinds:
        number = sum(find.kind == kind.name for find in sure)
        there = math.ceil(kind.share * most - 1e-9)
        if number > there:
            wrong.lines.append(
                f'{number} finds of class "{kind.name}", but at most {there} of the {most} objects ([spill] objects) '
                f"are of it; {cure}"
            )
    if sure and spill.destroyed[0] == 1:
        wrong.lines.append(
            f"{sure[0].name}: [spill] destroyed = 1 leaves nothing to be found; lower it"
        )
    began = spill.prior.release_start
    events: list[Find | Patrol] = [*spill.finds, *spill.patrols]
    for event in events:
        if event.time <= began:
            word = "found" if isinstance(event, Find) else "a patrol"
            wrong.lines.append(
                f"{event.name}: {word} at {notation.format_dtg(event.time)}, not after the spill, which began at "
                f"{notation.format_dtg(began)} at the earliest; check its time, or [spill] {when}"
            )
    until, last = spill.reporting.until, max((event.time for event in events), default=began)
    if until is not None and until < last:
        what = "the last find or patrol" if events else "the spill"
        wrong.lines.append(
            f"spill.reporting.until {notation.format_dtg(until)} is before {what}, {notation.format_dtg(last)}"
        )
    wrong.refuse()
