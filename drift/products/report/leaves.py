"""Leaves: the items of report.html, as plain records that the page's script draws.

Shapes and tables are read from the run's GeoJSON and CSV files, which the page contains, so that it
cannot differ from them. Each function returns a leaf; `look` names the style of its shapes (LOOKS
in assets/looks.js).
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import shapely

from drift.products.files import geojson
from drift.products.maps.marks import Line, Mark
from drift.products.report import packed
from geo import notation
from geo.array import Array

Leaf = dict[str, Any]
Columns = Sequence[
    tuple[str, str, str]
]  # name in the file, header, and number format (FORMS in assets/tables.js)

ALWAYS, AT, SINCE, DURING = "always", "at", "since", "during"  # when a shape is shown


def maps_leaf(
    title: str,
    time: Array,
    lon: Array,
    lat: Array,
    stories: Mapping[str, Array],
    area: Array,
    tops: Sequence[float],
    *,
    containment: Array | None = None,
    shown: float = 1.0,
    pale: Sequence[bool] | None = None,
) -> Leaf:
    """Return probability maps over time; the page shows one scenario at a time.

    Args:
        title: title of the layer.
        time: times, datetime64 (t,).
        lon: centres of cells [deg], evenly spaced, (nlon,).
        lat: centres of cells [deg], evenly spaced, (nlat,).
        stories: probability by cell and scenario, (t, nlat, nlon) each; the first is the total.
        area: areas of cells [m2], (nlat, nlon).
        tops: density at the end of the colour scale of each time [1/m2].
        containment: smallest share whose area contains a cell, (t, nlat, nlon).
        shown: containment up to which cells are shaded.
        pale: at which times the shading is pale, so that the coast stands out; None: never.

    Returns:
        The leaf.
    """
    fold = packed.merge_factor(
        len(time) * (len(stories) + (containment is not None)), len(lat), len(lon)
    )
    cells = packed.merge_by_sum(area, fold)
    return {
        "leaf": "maps",
        "title": title,
        "time": notation.epochs(time).tolist(),
        "lon": packed.axis(lon, fold),
        "lat": packed.axis(lat, fold),
        "stories": list(stories),
        "top": [float(top) for top in tops],
        "density": [
            packed.logarithms(packed.merge_by_sum(values, fold), cells)
            for values in stories.values()
        ],
        "containment": None
        if containment is None
        else packed.shares(packed.merge_by_minimum(containment, fold)),
        "shown": shown,
        "pale": [False] * len(time) if pale is None else list(pale),
    }


def shapes_leaf(
    title: str,
    file: str,
    look: str,
    *,
    where: Mapping[str, Any] | None = None,
    when: str = ALWAYS,
    span: tuple[str, str] = ("start", "end"),
    label: str = "",
    told: Columns = (),
    graded: tuple[str, str, str] | None = None,
    shown: bool = True,
    frame: bool = False,
) -> Leaf:
    """Return the shapes of a GeoJSON file of the run as a layer.

    Args:
        title: title of the layer.
        file: name of the file.
        look: style of the shapes.
        where: required values of properties; a list allows any of its values.
        when: AT (at the time `time`), SINCE (from its start on), DURING (from its start on, bold
            until its end) or ALWAYS.
        span: properties with start and end; `time` stands in for missing ones.
        label: property that is written at a shape.
        told: properties that the pointer shows.
        graded: file, key and column of a CSV file with a column `time`; its value at the map's time
            sets the colour and width of the shape with that key. A shape without a row is hidden.
        shown: whether the layer is visible at first.
        frame: whether the page opens with all of the layer in view.

    Returns:
        The leaf.
    """
    return {
        "leaf": "shapes",
        "title": title,
        "file": file,
        "look": look,
        "where": dict(where or {}),
        "when": when,
        "span": list(span),
        "label": label,
        "told": [list(column) for column in told],
        "shown": shown,
        "frame": frame,
        "graded": None
        if graded is None
        else dict(zip(("file", "key", "column"), graded, strict=True)),
    }


def features_leaf(
    title: str, drawn: Sequence[Mapping[str, Any]], look: str, **options: Any
) -> Leaf:
    """Return GeoJSON features that are in no file as a layer; options: as for `shapes`."""
    return {**shapes_leaf(title, "", look, **options), "features": list(drawn)}


def marks_leaf(
    title: str, marks: Sequence[Mark], lines: Sequence[Line], look: str, **options: Any
) -> Leaf:
    """Return the named marks and lines of a chart as a layer; options: as for `shapes`."""
    drawn = [
        geojson.feature(geojson.point(mark.lon, mark.lat), {"name": mark.label}) for mark in marks
    ]
    for line in lines:
        points = np.column_stack([line.lon, line.lat])
        ring = np.vstack([points, points[:1]]) if line.closed else points
        drawn.append(
            geojson.feature(geojson.lines([shapely.LineString(ring)]), {"name": line.label})
        )
    return features_leaf(title, drawn, look, label="name", **options)


def points_leaf(
    title: str,
    file: str,
    look: str,
    *,
    since: str = "",
    weight: str = "",
    told: Columns = (),
    shown: bool = True,
) -> Leaf:
    """Return the rows of a CSV file with columns lon and lat as points.

    Args:
        title: title of the layer.
        file: name of the file.
        look: style of the points.
        since: column with the time from which a point is shown; "": always.
        weight: column that sets the area of the dots; "": equal.
        told: columns that the pointer shows.
        shown: whether the layer is visible at first.

    Returns:
        The leaf.
    """
    return {
        "leaf": "points",
        "title": title,
        "file": file,
        "look": look,
        "since": since,
        "weight": weight,
        "told": [list(column) for column in told],
        "shown": shown,
    }


def track_leaf(title: str, file: str, lon: str, lat: str, look: str, *, shown: bool = True) -> Leaf:
    """Return a track from two columns of a CSV file, with its point at the time of the map."""
    return {
        "leaf": "track",
        "title": title,
        "file": file,
        "lon": lon,
        "lat": lat,
        "look": look,
        "shown": shown,
    }


def sample_leaf(
    title: str,
    time: Array,
    lon: Array,
    lat: Array,
    status: Array,
    names: Sequence[str],
    story: Array,
) -> Leaf:
    """Return the tracks of a sample of particles.

    Args:
        title: title of the layer.
        time: times, datetime64 (t,).
        lon, lat: positions [deg], (m, t).
        status: indices into `names`, (m, t).
        names: names of the statuses.
        story: indices of scenarios among those of the maps, (m,).

    Returns:
        The leaf.
    """
    return {
        "leaf": "sample",
        "title": title,
        "time": notation.epochs(time).tolist(),
        "shown": False,
        "number": len(lon),
        "lon": packed.packed_numbers(lon, np.float32),
        "lat": packed.packed_numbers(lat, np.float32),
        "status": packed.packed_numbers(status, np.uint8),
        "names": list(names),
        "story": np.asarray(story).tolist(),
    }


def arrows_leaf(
    title: str, time: Array, lon: Array, lat: Array, velocity: Array, look: str, *, shown: bool
) -> Leaf:
    """Return arrows of a flow over time.

    Args:
        title: title of the layer.
        time: times, datetime64 (t,).
        lon, lat: positions [deg], (m,).
        velocity: east and north components [m/s], (t, m, 2); NaN without data.
        look: style of the arrows.
        shown: whether the layer is visible at first.

    Returns:
        The leaf.
    """
    return {
        "leaf": "arrows",
        "title": title,
        "time": notation.epochs(time).tolist(),
        "look": look,
        "shown": shown,
        "lon": np.round(lon, 5).tolist(),
        "lat": np.round(lat, 5).tolist(),
        "velocity": packed.packed_numbers(velocity, np.float32),
    }


def headline_leaf(words: str, *, first: bool = False) -> Leaf:
    """Return sentences for the top of the page; first: whether they come before all others."""
    return {"leaf": "headline", "words": words, "first": first}


def table_leaf(
    title: str,
    columns: Columns,
    *,
    file: str = "",
    rows: Sequence[Sequence[Any]] = (),
    where: Mapping[str, str | list[str]] | None = None,
    by_time: str = "",
    note: str = "",
    unfolded: bool = False,
) -> Leaf:
    """Return a table from a CSV file, or from rows.

    Args:
        title: title of the table.
        columns: name in the file, header and number format of each column.
        file: name of the file; "": use `rows`.
        rows: rows with values in the order of the columns.
        where: required values of columns; a list allows any of its values.
        by_time: column with the time of a row; rows at the map's time are highlighted.
        note: caption of the table.
        unfolded: whether the table is open at first.

    Returns:
        The leaf.
    """
    return {
        "leaf": "table",
        "title": title,
        "columns": [list(column) for column in columns],
        "file": file,
        "rows": [list(row) for row in rows],
        "where": dict(where or {}),
        "by_time": by_time,
        "note": note,
        "unfolded": unfolded,
    }


def text_leaf(title: str, *, file: str = "", words: str = "", unfolded: bool = False) -> Leaf:
    """Return a text, from a file of the run or as given; unfolded: whether it is open at first."""
    return {"leaf": "text", "title": title, "file": file, "words": words, "unfolded": unfolded}
