"""Summaries of `drift track` as text: the estimate at the times shown, the path, and warnings."""

from collections.abc import Mapping, Sequence

import numpy as np

from drift.apps.track.record import Chased, Failed, Regained
from drift.tracking.tracker import doubts, holding, path
from drift.tracking.tracker.density import Region
from drift.tracking.tracker.detections import Detections
from drift.tracking.tracker.holding import Held, Loss, Shown
from geo import notation
from geo.notation import KNOT, NMI

# spread of courses from which on the course is reported as "any"; uniform courses have 104 degrees
VAGUE = np.radians(90)
WILD = 2.0  # ratio of the largest to the smallest area of check clouds above which results warn
ASTRAY = 0.1  # shortfall of an area's share of check clouds above which results warn


def moment(found: Regained, seconds: float) -> np.datetime64:
    """Return a time [s after the start] as a date and time, to the second."""
    return np.datetime64(notation.epoch(found.held.study.start) + round(seconds), "s")


def track_facts(found: Regained) -> dict[str, str]:
    """Return facts on the last detection, the estimates shown, the path, and warnings."""
    held = found.held
    detections = held.study.target
    assert isinstance(detections, Detections)
    sensor = held.study.sensors[int(detections.sensor[-1])].name
    facts = {
        "last detection": f"{notation.format_dtg(moment(found, detections.time[-1]))} by {sensor}; {len(detections.time)} in all"
    }
    for one in held.shown:
        when = moment(found, one.time)
        minute = notation.format_dtg(when)
        facts[notation.iso(when) if minute in facts else minute] = _state(found, one)
    if found.chased is not None:
        facts["path"] = "none" if isinstance(found.chased, Failed) else _path(found, found.chased)
    if silenced := [loss for loss in held.lost if loss.sensors]:
        facts["lost"] = _lost(found, silenced)
    if held.anew.any():
        facts["repopulated"] = _repopulated(found)
    warnings = _warnings(found)
    return {**facts, "warning": "; ".join(warnings)} if warnings else facts


def _lost(found: Regained, losses: Sequence[Loss]) -> str:
    """Return which sensors' silence lost the track, when, and what may help."""
    bulk = found.held.study.methods[0].filling.bulk
    left = (
        f"fewer than {notation.hundredths(bulk)} % of the particles were"
        if bulk > 0
        else "no particle was"
    )
    each: dict[str, list[str]] = {}
    for loss in losses:
        who = " and ".join(
            f"{sensor.name} (within {notation.number(sensor.reach / NMI)} nmi, grace {notation.format_duration(sensor.grace)})"
            for sensor in loss.sensors
        )
        each.setdefault(who, []).append(notation.format_dtg(moment(found, loss.time)))
    silent = "; ".join(f"{', '.join(times)} by {who}" for who, times in each.items())
    since = (
        "found again since, but without the earlier information on course and speed: "
        if found.held.shown[-1].cloud is not None
        else ""
    )
    return (
        f"{since}{left} left by sensors that detected nothing at {silent}. If the log does not "
        "contain every plot, give that sensor a longer grace, or on = false; "
        "otherwise check positions, reaches and when it is on, or use a higher fastest speed, or "
        "more particles"
    )


def _repopulated(found: Regained) -> str:
    """Return which detections caused the cloud to be repopulated, and the consequence."""
    held = found.held
    filling = held.study.methods[0].filling
    each = ", ".join(
        f"{notation.format_dtg(moment(found, float(time)))} ({notation.short_percent(left)})"
        for time, left in zip(held.time[held.anew], held.left[held.anew], strict=True)
    )
    return (
        f"at {each}, because fewer than bulk, {notation.hundredths(filling.bulk)} % of the particles, matched the detection: {'all' if filling.method == 'position' else 'half'} "
        "of the new particles take any course; a lower bulk and more particles keep those that matched"
    )


def _warnings(found: Regained) -> list[str]:
    """Return warnings: doubtful detections, areas that depend on chance, no path, and so on."""
    held, study = found.held, found.held.study
    warnings = doubts.doubts_about(study)
    if rough := [words for one in held.shown for words in _rough(found, one)]:
        warnings.append(
            f"areas depend on chance: {', '.join(rough)}: use more particles, or treat them as "
            "rough"
        )
    for one in held.shown:
        astray = one.holding if one.cloud is None else holding.OTHERS - one.holding
        if astray:
            warnings.append(
                f"at {notation.format_dtg(moment(found, one.time))} {astray} of {holding.OTHERS} "
                "clouds with other random numbers hold "
                f"{'a' if one.cloud is None else 'no'} track: the result depends on chance, use "
                "more particles"
            )
    if len(study.methods) > 1:
        warnings.append(
            f'followed by "{study.methods[0].name}" only, the first of {len(study.methods)} methods'
        )
    # perhaps in the same second as a detection
    loss_times = [loss.time for loss in held.lost if loss.sensors]
    without_water = held.time[
        held.detected & np.isnan(held.place[:, 0]) & ~np.isin(held.time, loss_times)
    ]
    if without_water.size:
        times = ", ".join(
            dict.fromkeys(notation.format_dtg(moment(found, float(time))) for time in without_water)
        )
        warnings.append(
            f"no track is held from {times} on, as there is no water in the box of the "
            "detection: check position, bearing and range"
        )
    if held.shown[-1].cloud is None:
        warnings.append("no track is held at the end")
    if isinstance(found.chased, Failed):
        warnings.append(f"no path: {found.chased.why}")
    known = min(float(study.tracker.time[-1]), study.end)
    if study.pursuit is not None and study.logged and known > study.pursuit.begin + 1:
        warnings.append(
            "the path uses only detections up to its start, "
            f"{notation.format_dtg(moment(found, study.pursuit.begin))}, but the tracker's log "
            f"continues until {notation.format_dtg(moment(found, known))}: looks since then only "
            "affect the track; remove begin"
        )
    return warnings


def _rough(found: Regained, one: Shown) -> list[str]:
    """Return which areas at a time differ between clouds with other random numbers."""
    when, doubts_found = notation.format_dtg(moment(found, one.time)), []
    for share, (low, high) in one.sizes.items():
        which = f"that of {notation.hundredths(share)} % at {when}"
        if one.within.get(share, share) < share - ASTRAY:
            doubts_found.append(
                f"{which} contains {notation.short_percent(one.within[share])} of {one.holding} "
                "other clouds"
            )
        elif high > WILD * low:
            doubts_found.append(
                f"{which} is {_rounded(low / NMI**2)} to {_rounded(high / NMI**2)} nmi2 by {one.holding + 1} clouds"
            )
    return doubts_found


def _state(found: Regained, one: Shown) -> str:
    held = found.held
    k = held.row(one.time)
    if one.cloud is None:
        return f"no track is held{_carried(held, k)}"
    lon, lat = path.degrees(held.place[k])
    place = notation.position(float(lon), float(lat))
    if np.isnan(held.within[k]):
        place = f"no single position (the mean, {place}, is outside the areas)"
    elif held.within[k] > min(held.areas[k]):
        place = f"{place} (a mean, outside the area of {notation.hundredths(min(held.areas[k]))} %)"
    course = round(float(np.degrees(held.course[k]))) % 360
    course_text = (
        f"course {course:03d} +- {np.degrees(held.off[k]):.0f}"
        if held.off[k] < VAGUE
        else "any course"
    )
    return f"{place}, {course_text}, {held.speed[k] / KNOT:.0f} +- {held.slower[k] / KNOT:.0f} kn; {sizes(held.areas[k], one.sizes)}{_carried(held, k)}"


def _carried(held: Held, row: int) -> str:
    """Return where the last detection is if it went on; "" at a detection and before the first."""
    if held.detected[row] or np.isnan(held.carried[row, 0]):
        return ""
    lon, lat = path.degrees(held.carried[row])
    return f"; last detection carried forward: {notation.position(float(lon), float(lat))}"


def _path(found: Regained, chased: Chased) -> str:
    """Return what share of the cloud a path meets, as text."""
    chase = found.held.study.pursuit
    assert chase is not None
    until = notation.format_dtg(moment(found, chased.found.path.time[-1]))
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
    replanned = [
        notation.format_dtg(moment(found, chase.times[step])) for step in chased.found.plans[1:]
    ]
    return words + (f"; replanned at {', '.join(replanned)}" if replanned else "")


def sizes(
    regions: Mapping[float, Region], spread: Mapping[float, tuple[float, float]] | None = None
) -> str:
    """Return the sizes of areas as text; spread: smallest and largest of check clouds [m2]."""
    each = []
    for share, region in regions.items():
        range_text = (
            ""
            if spread is None
            else " ({} to {})".format(*(_rounded(size / NMI**2) for size in spread[share]))
        )
        each.append(
            f"{notation.hundredths(share)} % {_rounded(region.area / NMI**2)}{range_text} nmi2"
        )
    return ", ".join(each)


def _rounded(value: float) -> str:
    """Return an area rounded to two digits, the precision that a cloud supports."""
    return f"{float(f'{value:.2g}'):,.10g}"
