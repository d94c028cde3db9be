"""Coordinate reference systems of CF grid mappings."""

from collections.abc import Mapping
from typing import Any

import pyproj

# attributes of the Earth's shape: without them, or with both, pyproj assumes WGS 84
EARTH = {"earth_radius", "semi_major_axis"}
GREENWICH = {"longitude_of_prime_meridian": 0.0, "prime_meridian_name": "Greenwich"}


def parse_reference_system(attributes: Mapping[str, Any]) -> pyproj.CRS:
    """Return the reference system of a grid mapping's attributes.

    It raises the errors of `pyproj.CRS.from_cf`. If the attributes have no prime meridian, pyproj
    looks up Greenwich by name, which takes half a second; passing Greenwich gives the same system.
    """
    lacking = len(attributes.keys() & EARTH) == 1 and not attributes.keys() & GREENWICH.keys()
    return pyproj.CRS.from_cf({**attributes, **GREENWICH} if lacking else dict(attributes))
