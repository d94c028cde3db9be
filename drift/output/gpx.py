"""GPX 1.1 (topografix.com/GPX/1/1): a document and its points, in the order of elements of its schema."""

import xml.etree.ElementTree as ET
from typing import Any

from drift.output import markup
from geo import notation

SPACE = "http://www.topografix.com/GPX/1/1"


def document(title: str, words: str) -> ET.Element:
    """Return an empty document; waypoints come first, then routes, then tracks."""
    root = ET.Element("gpx", {"xmlns": SPACE, "version": "1.1", "creator": "casp-drift"})
    about = ET.SubElement(root, "metadata")
    markup.leaf(about, "name", title)
    if words:
        markup.leaf(about, "desc", words)
    return root


def point(
    parent: ET.Element, tag: str, lon: float, lat: float, *, time: Any = None, name: str = "", words: str = "",
    kind: str = "",
) -> None:  # fmt: skip
    """Append a point [deg]: wpt, rtept or trkpt; time: np.datetime64, UTC."""
    element = ET.SubElement(parent, tag, markup.position(lon, lat))
    told = {"time": "" if time is None else notation.iso(time), "name": name, "desc": words, "type": kind}
    for key, value in told.items():
        if value:
            markup.leaf(element, key, value)
