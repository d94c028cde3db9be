"""Boxes of longitudes and latitudes, which may cross the antimeridian."""

from dataclasses import dataclass

from geo import sphere


@dataclass(frozen=True)
class Box:
    """Edges [deg]: west in [-180, 180), east in (west, west + 360].

    Box(170, -10, 195, 5) crosses the antimeridian.
    """

    west: float
    south: float
    east: float
    north: float

    def grown(self, degrees_lon: float, degrees_lat: float) -> "Box":
        """Return the box widened on every side [deg], at most to the whole Earth."""
        south, north = max(self.south - degrees_lat, -90.0), min(self.north + degrees_lat, 90.0)
        if self.east - self.west + 2 * degrees_lon >= 360:
            return Box(-180.0, south, 180.0, north)
        west = sphere.wrap_degrees(self.west - degrees_lon)
        return Box(west, south, west + self.east - self.west + 2 * degrees_lon, north)


def box_between(west: float, south: float, east: float, north: float) -> Box:
    """Return the box from a western edge eastward to an eastern one.

    Equal longitudes, or longitudes a turn apart, give the whole globe.

    Args:
        west: western edge [deg]; any multiple of 360 may be added.
        south: southern edge [deg].
        east: eastern edge [deg]; it may exceed 180.
        north: northern edge [deg].

    Raises:
        ValueError: east is less than west, and the box would be wider than half the Earth: most
            likely the two are swapped, or a sign is missing.
    """
    width = 360.0 if east - west >= 360 else (east - west) % 360 or 360.0
    start, left = float(sphere.wrap_degrees(west)), float(sphere.wrap_degrees(east))
    if east < west and 180 < width < 360:
        raise ValueError(
            f"west {west:g} to east {east:g} goes {width:g} degrees round the Earth, the long way; write west {left:g} and "
            f"east {left + 360 - width:g} for the {360 - width:g} degrees between them, or west {start:g} and east "
            f"{start + width:g} if you mean the long way"
        )
    return Box(start, south, start + width, north)
