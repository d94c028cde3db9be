"""Assign the finds and patrols of a case to stretches of coast, for the likelihood."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt
import shapely

from drift.engine.motion.period import Period
from drift.spills.worlds import exposure, finds
from drift.spills.worlds.records import Find, Patrol, Reporting, Spill
from drift.spills.worlds.worlds import Worlds
from geo import notation, sphere
from geo.coast import edges as shoreline
from geo.coast import land_masses
from geo.coast import segments as stretches
from geo.coast.edges import Coast
from geo.coast.segments import Segments
from geo.errors import UserError

NUMBERS = 25  # most grid values of an uncertain number of objects
FARTHEST = 3000.0  # [m] largest distance of a find ashore from the shoreline
SHARES = 41  # grid values of the share destroyed
# [m] largest distance of a patrolled stretch's middle from the line between the patrol's ends
ABREAST = 3000.0


def cut_stretches(spill: Spill, coast: Coast) -> Segments:
    """Return the stretches of coast for a spill's figures: the user's, or equal ones.

    Each has its land mass.

    Raises:
        UserError: the file of stretches cannot be used, or a bridge ends far from land.
    """
    land = land_masses.build_land_masses(coast.polygons, spill.bridges, coast.cut)
    if spill.stretches is not None:
        segments = stretches.read_named_segments(coast, spill.stretches, spill.stretch)
    else:
        segments = stretches.cut_coast(coast, spill.stretch)
    access = tuple(kind or spill.reporting.coast for kind in segments.access)
    mass_of_stretch = land_masses.mass_of_stretches(
        land, coast, segments.of_edge, len(segments.name)
    )
    return replace(segments, access=access, land=land, mass=mass_of_stretch)


def build_evidence(
    period: Period, spill: Spill, segments: Segments, coast: Coast, worlds: Worlds
) -> finds.SpillEvidence:
    """Return the finds and patrols of a spill, on stretches and in seconds after the start.

    Args:
        period: period of the run.
        spill: the spill.
        segments: stretches of coast.
        coast: the coast.
        worlds: the worlds, with their factors on reporting rates.

    Returns:
        The evidence for drift.spills.worlds.finds.

    Raises:
        UserError: a find or a patrol has an impossible place.
    """
    walks, places = _place_evidence(spill, segments, coast)
    patrols = tuple(
        exposure.Walk(walk, period.elapsed(patrol.time), patrol.detection)
        for walk, patrol in zip(walks, spill.patrols, strict=True)
    )
    kinds, names = [kind.name for kind in spill.kinds], [patrol.name for patrol in spill.patrols]
    detections = [
        finds.Detection(
            find.name,
            kinds.index(find.kind) if find.kind is not None else None,
            finds.AtSea(find.lon, find.lat, find.radius, 1.0) if stretch < 0 else stretch,
            period.elapsed(find.time),
            find.latest,
            names.index(find.by) if find.by is not None else None,
            find.false,
        )
        for find, stretch in zip(spill.finds, places, strict=True)
    ]
    last = max([find.time for find in detections] + [patrol.time for patrol in patrols], default=0)
    until = spill.reporting.until
    return finds.SpillEvidence(
        _number_priors(spill),
        tuple(detections),
        patrols,
        exposure.Reporting(
            reporting_rates(spill.reporting, segments), spill.reporting.removal, worlds.reporting
        ),
        segments.length,
        float(last if until is None else period.elapsed(until)),
    )


def _place_evidence(
    spill: Spill, segments: Segments, coast: Coast
) -> tuple[list[tuple[int, ...]], list[int]]:
    """Return the stretches that each patrol walked, and the stretch of each find (-1: at sea)."""
    walks = [tuple(stretches_of_patrol(patrol, segments)) for patrol in spill.patrols]
    names = [patrol.name for patrol in spill.patrols]
    places = [stretch_of_find(find, segments, coast) for find in spill.finds]
    for find, stretch in zip(spill.finds, places, strict=True):
        if find.by is not None and stretch not in walks[names.index(find.by)]:
            raise UserError(
                f'{find.name}: found by patrol "{find.by}" on stretch "{segments.name[stretch]}", '
                "where that patrol did not go"
            )
    return walks, places


def _number_priors(spill: Spill) -> finds.Numbers:
    """Return uniform priors, on grids, of the number of objects and of the share destroyed."""
    low, high = spill.objects
    objects = np.unique(
        np.rint(np.linspace(low, high, min(high - low + 1, NUMBERS))).astype(np.int64)
    )
    least, most = spill.destroyed
    share = (
        (np.arange(SHARES) + 0.5) / SHARES * (most - least) + least
        if most > least
        else np.array([least])
    )
    return finds.Numbers(
        objects,
        np.full(objects.size, 1 / objects.size),
        np.array([kind.share for kind in spill.kinds]),
        share,
        np.full(share.size, 1 / share.size),
    )


def reporting_rates(reporting: Reporting, segments: Segments) -> npt.NDArray[np.float64]:
    """Return the reporting rate of an object on each stretch [1/s], (S,), by kind of shore.

    Raises:
        UserError: a kind of shore has no rate.
    """
    kinds = [kind or reporting.coast for kind in segments.access]
    for kind, name in zip(kinds, segments.name, strict=True):
        if kind not in reporting.rate:
            rated = ", ".join(reporting.rate)
            raise UserError(
                f'stretch "{name}": its kind of shore "{kind}" has no reporting rate; '
                f"[spill.reporting] rate has {rated}"
            )
    return np.array([reporting.rate[kind] for kind in kinds])


def stretch_of_find(find: Find, segments: Segments, coast: Coast) -> int:
    """Return the stretch on which a find lies; -1 at sea.

    Raises:
        UserError: the find is not on the coast; the message has the nearest coast and its distance.
    """
    if find.stretch is not None:
        return stretch_by_name(find.stretch, find.name, segments)
    check_place_of_find(find, coast)
    if find.at_sea:
        return -1
    return stretches.nearest_segment(segments, coast, find.lon, find.lat)[0]


def check_place_of_find(find: Find, coast: Coast) -> float:
    """Return the distance of a find ashore from the shoreline [m]; 0 at sea.

    Raises:
        UserError: as `stretch_of_find`; the find has a position.
    """
    binary = sphere.to_binary([find.lon]), sphere.to_binary([find.lat])
    land = bool(shoreline.is_land(coast, *binary)[0])
    if find.at_sea:
        if land:
            raise UserError(
                f"{find.name}: {notation.stated_position(find.lon, find.lat)} is not at sea but "
                "on land; leave out at_sea, or move it"
            )
        return 0.0
    near = shoreline.nearest_coast(coast, find.lon, find.lat)
    if near is None:
        raise UserError(
            f"{find.name}: {notation.stated_position(find.lon, find.lat)} lies far from any coast "
            "of the domain; move it, or widen [domain]"
        )
    if near[2] > FARTHEST:
        where = "inland" if land else "off the coast"
        cure = "move it" if land else "move it, or say at_sea = true"
        raise UserError(
            f"{find.name}: {notation.stated_position(find.lon, find.lat)} lies "
            f"{near[2] / 1000:.1f} km {where}; the nearest coast is at "
            f"{notation.position(near[0], near[1])}, and a find ashore must lie within "
            f"{FARTHEST / 1000:.0f} km of it; {cure}"
        )
    return near[2]


def stretch_by_name(name: str, place: str, segments: Segments) -> int:
    """Return the number of a stretch by its name, its id or its number.

    Args:
        name: name, id or number of the stretch.
        place: what refers to the stretch, for the message.
        segments: stretches of coast.

    Returns:
        The number of the stretch.

    Raises:
        UserError: there is no such stretch.
    """
    import difflib

    if name in segments.name:
        return segments.name.index(name)
    if (found := stretches.segment_of_id(segments, name)) is not None:
        return found
    number = name.removeprefix("stretch ")
    if number.isdecimal() and int(number) < len(segments.name):
        return int(number)  # as numbered in the picture and in the tables
    near = difflib.get_close_matches(name, segments.name, n=1, cutoff=0.5)
    hint = f'; nearest is "{near[0]}"' if near else ""
    raise UserError(
        f'{place}: no stretch "{name}"{hint}; a run without it lists those touched in washup.csv'
    )


def stretches_of_patrol(patrol: Patrol, segments: Segments) -> Sequence[int]:
    """Return the stretches that a patrol searched.

    They are those named, or those beside the straight line between the patrol's ends.

    Raises:
        UserError: there are none, or a name is unknown.
    """
    if patrol.ends is None:
        return [
            stretch_by_name(name, f'patrol "{patrol.name}"', segments) for name in patrol.stretches
        ]
    (lon, lat), end = patrol.ends
    start = math.radians(lon), math.radians(lat)
    x, y = sphere.offset(*start, np.radians(segments.lon), np.radians(segments.lat))
    end_radians = math.radians(end[0]), math.radians(end[1])
    line = shapely.LineString([(0, 0), sphere.offset(*start, *end_radians)])
    chosen = np.flatnonzero(shapely.distance(line, shapely.points(x, y)) < ABREAST)
    if not chosen.size:
        raise UserError(
            f'patrol "{patrol.name}": no stretch has its middle within {ABREAST / 1000:.0f} km of '
            f"the line between its ends at {notation.format_dtg(patrol.time)}; name stretches, or make "
            "them shorter ([spill.stretches] length)"
        )
    return [int(k) for k in chosen]
