"""A box of longitudes and latitudes that may lie across the antimeridian."""

from dataclasses import dataclass

from geo import sphere


@dataclass(frozen=True)
class Box:
    """Edges [deg]: west in [-180, 180), east in (west, west + 360], so Box(170, -10, 195, 5) crosses 180."""

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
