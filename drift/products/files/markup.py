"""XML for other programs: elements with safe text, positions as attributes, documents as text."""

import xml.etree.ElementTree as ET

from geo import sphere

DIGITS = 7  # decimals of a degree: 1 cm


def leaf(parent: ET.Element, tag: str, text: str) -> None:
    """Append an element that contains a text."""
    ET.SubElement(parent, tag).text = plain(text)


def plain(text: str) -> str:
    """Return a text without line breaks and without characters that XML 1.0 forbids."""
    return "".join(c for c in text if c >= " " and c not in "\ufffe\uffff")


def position(lon: float, lat: float) -> dict[str, str]:
    """Return a position [deg] as attributes; 180 becomes -180, as GPX and RTZ end below 180."""
    return {
        "lat": f"{lat:.{DIGITS}f}",
        "lon": f"{sphere.wrap_degrees(round(lon, DIGITS)):.{DIGITS}f}",
    }


def document_text(root: ET.Element) -> str:
    """Return an XML document as the text of its file."""
    ET.indent(root)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{ET.tostring(root, encoding="unicode")}\n'
