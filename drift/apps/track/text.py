"""A contact that was lost, in words and tables."""

from collections.abc import Mapping, Sequence

import numpy as np

from drift.apps.track.record import Chased, Failed, Regained
from drift.tracking.tracker import doubts, holding, path
from drift.tracking.tracker.density import Region
from drift.tracking.tracker.detections import Detections
from drift.tracking.tracker.holding import Loss, Shown
from geo import notation
from geo.notation import KNOT, NMI

# spread of courses from which on none is told: if all are alike it is 104 degrees
VAGUE = np.radians(90)
WILD = 2.0  # times the least area that the largest of other clouds is, from which on results warn
ASTRAY = 0.1  # how much less of other clouds an area holds than it says, from which on results warn


def moment(found: Regained, seconds: float) -> np.datetime64:
    """Return a time [s after the start] as a date and time, to the second."""
    return np.datetime64(notation.epoch(found.held.study.start) + round(seconds), "s")


def track_facts(found: Regained) -> dict[str, str]:
    """Return a line for the last detection, each time shown, and for what must be doubted."""
    held = found.held
    seen = held.study.target
    assert isinstance(seen, Detections)
    who = held.study.sensors[int(seen.sensor[-1])].name
    told = {
        "last detection": f"{notation.group(moment(found, seen.time[-1]))} by {who}; {len(seen.time)} in all"
    }
    for one in held.shown:
        when = moment(found, one.time)
        minute = notation.group(when)
        told[notation.iso(when) if minute in told else minute] = _state(found, one)
    if found.chased is not None:
        told["path"] = "none" if isinstance(found.chased, Failed) else _path(found, found.chased)
    if silenced := [loss for loss in held.lost if loss.sensors]:
        told["lost"] = _lost(found, silenced)
    if held.anew.any():
        told["repopulated"] = _anew(found)
    warnings = _warnings(found)
    return {**told, "warning": "; ".join(warnings)} if warnings else told


def _lost(found: Regained, losses: Sequence[Loss]) -> str:
    """Return whose silence lost the track, when, and what may be done about it."""
    bulk = found.held.study.methods[0].filling.bulk
    left = (
        f"fewer than {notation.hundredths(bulk)} % of the particles were"
        if bulk > 0
        else "no particle was"
    )
    each: dict[str, list[str]] = {}
    for loss in losses:
        who = " and ".join(
            f"{sensor.name} (within {notation.number(sensor.reach / NMI)} nmi, grace {notation.lasting(sensor.grace)})"
            for sensor in loss.sensors
        )
        each.setdefault(who, []).append(notation.group(moment(found, loss.time)))
    silent = "; ".join(f"{', '.join(times)} by {who}" for who, times in each.items())
    since = (
        "found again since, but what was known of course and speed is gone: "
        if found.held.shown[-1].cloud is not None
        else ""
    )
    return (
        f"{since}{left} left by what found nothing at {silent}. If not every plot is in the log, give that sensor a longer grace, or on = false; "
        "else check positions, reaches and when it is on, or take a higher fastest speed, or more particles"
    )


def _anew(found: Regained) -> str:
    """Return which plots had most of the cloud drawn again, and what that means."""
    held = found.held
    filling = held.study.methods[0].filling
    each = ", ".join(
        f"{notation.group(moment(found, float(time)))} ({notation.short_percent(left)})"
        for time, left in zip(held.time[held.anew], held.left[held.anew], strict=True)
    )
    return (
        f"at {each}, because fewer than bulk, {notation.hundredths(filling.bulk)} % of the particles, matched the detection: {'all' if filling.method == 'position' else 'half'} "
        "of the new particles take any course; a lower bulk and more particles keep those that matched"
    )


def _warnings(found: Regained) -> list[str]:
    """Return what must be doubted: plots that no target made, areas by chance, ways of following
    that are left out, no path.
    """
    held, study = found.held, found.held.study
    told = doubts.doubts_about(study)
    if rough := [words for one in held.shown for words in _rough(found, one)]:
        told.append(
            f"areas go by chance: {', '.join(rough)}: take more particles, or take them as rough"
        )
    for one in held.shown:
        astray = one.holding if one.cloud is None else holding.OTHERS - one.holding
        if astray:
            told.append(
                f"at {notation.group(moment(found, one.time))} {astray} of {holding.OTHERS} clouds of other random numbers hold "
                f"{'a' if one.cloud is None else 'no'} track: it hangs by chance, take more particles"
            )
    if len(study.methods) > 1:
        told.append(
            f'followed by "{study.methods[0].name}" alone, the first of {len(study.methods)} ways'
        )
    # in the second of a detection, perhaps
    silenced = [loss.time for loss in held.lost if loss.sensors]
    nothing = held.time[held.detected & np.isnan(held.place[:, 0]) & ~np.isin(held.time, silenced)]
    if nothing.size:
        times = ", ".join(
            dict.fromkeys(notation.group(moment(found, float(time))) for time in nothing)
        )
        told.append(
            f"no track is held from {times} on, as no water is in the box of what was detected: check position, bearing and range"
        )
    if held.shown[-1].cloud is None:
        told.append("no track is held at the end")
    if isinstance(found.chased, Failed):
        told.append(f"no path: {found.chased.why}")
    known = min(float(study.tracker.time[-1]), study.end)
    if study.pursuit is not None and study.logged and known > study.pursuit.begin + 1:
        told.append(
            f"the path is planned on what was known at its begin, {notation.group(moment(found, study.pursuit.begin))}, and the tracker's log "
            f"goes on until {notation.group(moment(found, known))}: what was not seen since counts in the track alone; leave begin out"
        )
    return told


def _rough(found: Regained, one: Shown) -> list[str]:
    """Return which areas at a time are another by other random numbers."""
    when, told = notation.group(moment(found, one.time)), []
    for share, (low, high) in one.sizes.items():
        which = f"that of {notation.hundredths(share)} % at {when}"
        if one.within.get(share, share) < share - ASTRAY:
            told.append(
                f"{which} holds {notation.short_percent(one.within[share])} of {one.holding} other clouds"
            )
        elif high > WILD * low:
            told.append(
                f"{which} is {_rounded(low / NMI**2)} to {_rounded(high / NMI**2)} nmi2 by {one.holding + 1} clouds"
            )
    return told


def _state(found: Regained, one: Shown) -> str:
    held = found.held
    if one.cloud is None:
        return "no track is held"
    k = held.row(one.time)
    lon, lat = path.degrees(held.place[k])
    place = notation.position(float(lon), float(lat))
    if np.isnan(held.within[k]):
        place = f"no one place (the mean, {place}, lies outside the areas)"
    elif held.within[k] > min(held.areas[k]):
        place = f"{place} (a mean, outside the area of {notation.hundredths(min(held.areas[k]))} %)"
    course = round(float(np.degrees(held.course[k]))) % 360
    told = (
        f"course {course:03d} +- {np.degrees(held.off[k]):.0f}"
        if held.off[k] < VAGUE
        else "any course"
    )
    return f"{place}, {told}, {held.speed[k] / KNOT:.0f} +- {held.slower[k] / KNOT:.0f} kn; {sizes(held.areas[k], one.sizes)}"


def _path(found: Regained, chased: Chased) -> str:
    """Return what a path comes to."""
    chase = found.held.study.pursuit
    assert chase is not None
    until = notation.group(moment(found, chased.found.path.time[-1]))
    own, other = chased.found.met[-1], chased.judged[-1]
    near = f"within {notation.number(chase.reach / NMI)} nmi"
    if chase.to is None:
        words = f"by {until} {notation.short_percent(own)} of the particles {near} (at most {notation.short_percent(chased.found.near)} are reachable)"
    else:
        words = f"at {notation.position(*np.degrees(chase.to))} at {until}, {notation.short_percent(own)} of the particles {near} on the way"
    words += (
        ", another cloud has lost the track"
        if np.isnan(other)
        else f"; {notation.short_percent(other)} on a check cloud"
    )
    anew = [notation.group(moment(found, chase.times[step])) for step in chased.found.plans[1:]]
    return words + (f"; planned again at {', '.join(anew)}" if anew else "")


def sizes(
    regions: Mapping[float, Region], spread: Mapping[float, tuple[float, float]] | None = None
) -> str:
    """Return how large the areas are; spread: the least and the largest by clouds alike [m2]."""
    each = []
    for share, region in regions.items():
        among = (
            ""
            if spread is None
            else " ({} to {})".format(*(_rounded(size / NMI**2) for size in spread[share]))
        )
        each.append(f"{notation.hundredths(share)} % {_rounded(region.area / NMI**2)}{among} nmi2")
    return ", ".join(each)


def _rounded(value: float) -> str:
    """Return an area to two digits: more than that a cloud does not know."""
    return f"{float(f'{value:.2g}'):,.10g}"
