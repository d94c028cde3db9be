"""KML 2.2 (OGC 07-147r2): styles, folders, and places with times.

Geometries come as GeoJSON, split at 180 degrees.
"""

import html
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from typing import Any

from drift.products.files import markup

SPACE = "http://www.opengis.net/kml/2.2"


def document(title: str, words: str) -> tuple[ET.Element, ET.Element]:
    """Return the root and its empty Document; append styles first, then folders."""
    root = ET.Element("kml", {"xmlns": SPACE})
    inside = ET.SubElement(root, "Document")
    markup.leaf(inside, "name", title)
    markup.leaf(inside, "description", html.escape(words, quote=False))  # shown as HTML
    return root, inside


def style(
    document: ET.Element, name: str, ink: str, width: str, fill: str = "", icon: str = ""
) -> None:
    """Append a style; ink, fill: colours as aabbggrr; icon: address of a symbol."""
    element = ET.SubElement(document, "Style", {"id": name})
    if icon:
        symbol = ET.SubElement(element, "IconStyle")
        markup.leaf(symbol, "color", ink)
        markup.leaf(ET.SubElement(symbol, "Icon"), "href", icon)
    line = ET.SubElement(element, "LineStyle")
    markup.leaf(line, "color", ink)
    markup.leaf(line, "width", width)
    if fill:
        markup.leaf(ET.SubElement(element, "PolyStyle"), "color", fill)


def folder(parent: ET.Element, name: str) -> ET.Element:
    """Append a folder to an element, and return it."""
    element = ET.SubElement(parent, "Folder")
    markup.leaf(element, "name", name)
    return element


def append_place(
    parent: ET.Element,
    name: str,
    words: str,
    span: tuple[str, str],
    look: str,
    geometry: Mapping[str, Any],
) -> None:
    """Append a place to a folder.

    Args:
        parent: the folder.
        name: name of the place.
        words: its description, plain text.
        span: first and last time at which it is shown, ISO 8601.
        look: name of its style; "" for none.
        geometry: its GeoJSON geometry.
    """
    element = ET.SubElement(parent, "Placemark")
    markup.leaf(element, "name", name)
    markup.leaf(element, "description", html.escape(words, quote=False))
    when = ET.SubElement(element, "TimeSpan")
    markup.leaf(when, "begin", span[0])
    markup.leaf(when, "end", span[1])
    if look:
        markup.leaf(element, "styleUrl", f"#{look}")
    _geometry(element, geometry)


def _geometry(parent: ET.Element, geometry: Mapping[str, Any]) -> None:
    """Append a GeoJSON geometry as KML."""
    kind, coordinates = geometry["type"], geometry["coordinates"]
    if kind == "Point":
        markup.leaf(ET.SubElement(parent, "Point"), "coordinates", _coordinates([coordinates]))
        return
    many = ET.SubElement(parent, "MultiGeometry")
    for part in coordinates:
        if kind == "MultiLineString":
            line = ET.SubElement(many, "LineString")
            markup.leaf(line, "tessellate", "1")
            markup.leaf(line, "coordinates", _coordinates(part))
            continue
        polygon = ET.SubElement(many, "Polygon")
        markup.leaf(polygon, "tessellate", "1")
        for edge, ring in zip(
            ["outerBoundaryIs", *["innerBoundaryIs"] * (len(part) - 1)], part, strict=True
        ):
            markup.leaf(
                ET.SubElement(ET.SubElement(polygon, edge), "LinearRing"),
                "coordinates",
                _coordinates(ring),
            )


def _coordinates(points: Sequence[Sequence[float]]) -> str:
    return " ".join(f"{lon:.7f},{lat:.7f}" for lon, lat in points)
