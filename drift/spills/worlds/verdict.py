"""The finds of a spill one by one: as rows of numbers, as a table and in words."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from drift.engine.motion.period import Period
from drift.products.files import formats
from drift.spills.worlds import finds
from drift.spills.worlds.finds import Detection, Posterior, Surprise
from drift.spills.worlds.products import tables as washup_tables
from drift.spills.worlds.records import Spill
from geo import notation, sphere
from geo.coast.segments import Segments

ODD = 0.02  # tail probability below which a find is called odd

Row = dict[str, Any]


def find_rows(
    spill: Spill, segments: Segments, posterior: Posterior, surprises: Sequence[Surprise]
) -> list[Row]:
    """Return a row of figures for each find, in order of time; numbers are as in the case."""
    known = posterior.known.finds
    return [
        _row(number, spill, segments, surprise, float(posterior.unrelated[number]))
        for surprise in surprises
        for number in [known.index(surprise.find)]
    ]


def _row(
    number: int, spill: Spill, segments: Segments, surprise: Surprise, unrelated: float
) -> Row:
    find, given = surprise.find, spill.finds[number]
    segment = None if isinstance(find.place, finds.AtSea) else find.place
    lon, lat = find_position(spill, segments, number, find)
    return {
        "number": number + 1,
        "name": find.name,
        "time": given.time,
        "not_later_than": find.latest,
        "lon_deg": float(sphere.wrap_degrees(lon)),
        "lat_deg": lat,
        "position": notation.position(lon, lat)
        if spill.finds[number].stretch
        else notation.stated_position(lon, lat),
        "stretch": "at sea"
        if segment is None
        else washup_tables.stretch_with_town(segments, segment),
        "segment": segment,
        "class": given.kind,
        "by": given.by or "public",
        "false": given.false,
        "probability_beforehand": surprise.probability,
        "tail": surprise.tail,
        "odd": surprise.tail < ODD,
        "none_of_ours": unrelated,
    }


def find_position(
    spill: Spill, segments: Segments, number: int, find: Detection
) -> tuple[float, float]:
    """Return where a find lies (lon, lat) [deg]: as given, or the middle of its stretch.

    Args:
        spill: the spill.
        segments: stretches of coast.
        number: number of the find in the case, from 0.
        find: the same find, on its stretch.

    Returns:
        Longitude and latitude [deg].
    """
    if isinstance(find.place, finds.AtSea):
        return find.place.lon, find.place.lat
    given = spill.finds[number]
    if given.stretch is None:
        return given.lon, given.lat
    return float(segments.lon[find.place]), float(segments.lat[find.place])


def finds_csv(told: Sequence[Row], worlds: float, run: str) -> str:
    """Return the finds as CSV, a row each, in order of time.

    Args:
        told: rows of the finds, from `rows`.
        worlds: effective worlds after the finds.
        run: the run_id, for the last column.

    Returns:
        The text of finds.csv.
    """
    lines = [{**row, "effective_worlds": worlds} for row in told]
    return formats.csv_rows(lines, run=run, digits=".6g")


def false_find_in_words(row: Row) -> str:
    """Return the probability that a find is not from this spill in words."""
    if row["false"] == 0:
        return "counted as from this spill (set false if unsure)"
    return f"not from this spill: {notation.percent(row['none_of_ours'])}"


def odd_find_warnings(told: Sequence[Row]) -> list[str]:
    """Return a warning for each find whose place was improbable given the evidence before it."""
    return [
        f'find {row["number"]} "{row["name"]}" ({notation.format_dtg(row["time"])}, {row["position"]}, '
        f"{row['stretch']}) is unlikely: "
        f"the chance of a find there was {notation.percent(row['probability_beforehand'])}, "
        f"there or at less likely places {notation.percent(row['tail'])}; {false_find_in_words(row)}; check it, or set false = 0.1"
        for row in told
        if row["odd"]
    ]


def silence_in_words(period: Period, spill: Spill, until: float) -> str | None:
    """Return up to when the absence of reports is evidence, as text; None without evidence.

    until: time up to which all finds are known [s after start].
    """
    if not spill.finds and not spill.patrols:
        return None
    time = period.start + np.timedelta64(round(until), "s")
    which = (
        "spill.reporting.until" if spill.reporting.until is not None else "the last find or patrol"
    )
    what = "no other reports" if spill.finds else "no finds or reports"
    return f"{what} until {notation.format_dtg(time)} ({which}); that silence is evidence too"
