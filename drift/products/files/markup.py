"""XML that other programs read: what its texts may hold, and positions as they write them."""

import xml.etree.ElementTree as ET

from geo import sphere

DIGITS = 7  # decimals of a degree: 1 cm


def leaf(parent: ET.Element, tag: str, text: str) -> None:
    """Append an element with a text."""
    ET.SubElement(parent, tag).text = plain(text)


def plain(text: str) -> str:
    """Return a text without what XML 1.0 cannot hold, and without line breaks."""
    return "".join(c for c in text if c >= " " and c not in "\ufffe\uffff")


def position(lon: float, lat: float) -> dict[str, str]:
    """Return a position [deg] as attributes; 180 is west, for the schemas of GPX and RTZ end below
    it.
    """
    return {
        "lat": f"{lat:.{DIGITS}f}",
        "lon": f"{sphere.wrap_degrees(round(lon, DIGITS)):.{DIGITS}f}",
    }


def document_text(root: ET.Element) -> str:
    """Return a document as it is written to its file."""
    ET.indent(root)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{ET.tostring(root, encoding="unicode")}\n'
