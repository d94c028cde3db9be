"""Leaves: what a topic shows in report.html, as plain records that the page's script draws.

Shapes and tables are read from the GeoJSON and CSV files of the run, which the page carries, so
that it cannot tell anything else than they do. Each function returns a leaf; `look` names how its
shapes are drawn (LOOKS in assets/looks.js).
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
]  # name in the file, header, and how values are written (FORMS in assets/tables.js)

ALWAYS, AT, SINCE, DURING = "always", "at", "since", "during"  # when a shape is there, by its times


def maps(
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
) -> Leaf:
    """Return maps of probability over time, of which one scenario is shown at a time.

    time: datetime64 (t,). lon, lat: cells' middles [deg], evenly spaced. stories: probability by
    cell, (t, nlat, nlon) each, by name; the first is of all. area: of cells [m2], (nlat, nlon).
    tops: density that ends the colours of each time [1/m2]. containment: smallest share whose area
    holds a cell, (t, nlat, nlon); shown: that up to which cells are shaded.
    """
    fold = packed.fold(len(time) * (len(stories) + (containment is not None)), len(lat), len(lon))
    cells = packed.summed(area, fold)
    return {
        "leaf": "maps",
        "title": title,
        "time": notation.epochs(time).tolist(),
        "lon": packed.axis(lon, fold),
        "lat": packed.axis(lat, fold),
        "stories": list(stories),
        "top": [float(top) for top in tops],
        "density": [
            packed.logarithms(packed.summed(values, fold), cells) for values in stories.values()
        ],
        "containment": None
        if containment is None
        else packed.shares(packed.least(containment, fold)),
        "shown": shown,
    }


def shapes(
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

    where: values that properties of its features have, a list of them for any of these. when: AT
    (`time` is that of the map), SINCE (its begin has come), DURING (bold between begin and end, not
    there before), else ALWAYS; span: the properties of begin and end, `time` where there are none.
    label: the property that is written beside a shape; told: properties that the pointer tells.
    graded: file, key and column of a CSV file with a column `time`, of which the value at the map's
    time gives a shape with the same key its colour and width; without a row it is not there. frame:
    whether the page begins with all of it in view.
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


def features(title: str, drawn: Sequence[Mapping[str, Any]], look: str, **options: Any) -> Leaf:
    """Return GeoJSON features that stand in no file as a layer; options: as of `shapes`."""
    return {**shapes(title, "", look, **options), "features": list(drawn)}


def marked(
    title: str, marks: Sequence[Mark], lines: Sequence[Line], look: str, **options: Any
) -> Leaf:
    """Return the marks and lines of a chart, with their names, as a layer; options: as of `shapes`."""
    drawn = [
        geojson.feature(geojson.point(mark.lon, mark.lat), {"name": mark.label}) for mark in marks
    ]
    for line in lines:
        points = np.column_stack([line.lon, line.lat])
        ring = np.vstack([points, points[:1]]) if line.closed else points
        drawn.append(
            geojson.feature(geojson.lines([shapely.LineString(ring)]), {"name": line.label})
        )
    return features(title, drawn, look, label="name", **options)


def points(
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

    since: the column of the time from which each is there; weight: that by which the area of its
    dot grows.
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


def track(title: str, file: str, lon: str, lat: str, look: str, *, shown: bool = True) -> Leaf:
    """Return a track by time from two columns of a CSV file, and its point at the time of the map."""
    return {
        "leaf": "track",
        "title": title,
        "file": file,
        "lon": lon,
        "lat": lat,
        "look": look,
        "shown": shown,
    }


def sample(
    title: str,
    time: Array,
    lon: Array,
    lat: Array,
    status: Array,
    names: Sequence[str],
    story: Array,
) -> Leaf:
    """Return the tracks of some particles.

    lon, lat: [deg] (m, t); status: (m, t), a number among `names`; story: (m,), a number among
    those of the maps.
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


def arrows(
    title: str, time: Array, lon: Array, lat: Array, velocity: Array, look: str, *, shown: bool
) -> Leaf:
    """Return arrows of a flow: velocity [m/s] east and north (t, m, 2) at places [deg] (m,), NaN
    where there is none.
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


def headline_leaf(words: str) -> Leaf:
    """Return sentences that stand on top of the page."""
    return {"leaf": "headline", "words": words}


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
    """Return a table of a CSV file, or of rows in the order of the columns.

    where: values that columns of the file have, a list of them for any of these. by_time: the
    column with the time of a row, of which those of the map's time are marked. unfolded: whether it
    is seen at once.
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
    """Return a text, of a file of the run or as it is; unfolded: whether it is seen at once."""
    return {"leaf": "text", "title": title, "file": file, "words": words, "unfolded": unfolded}
