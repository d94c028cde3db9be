"""Reference systems of grid mappings, as CF's attributes describe them."""

from collections.abc import Mapping
from typing import Any

import pyproj

# an Earth has one of them; without, or with both, pyproj takes WGS 84
EARTH = {"earth_radius", "semi_major_axis"}
GREENWICH = {"longitude_of_prime_meridian": 0.0, "prime_meridian_name": "Greenwich"}


def parse_reference_system(attributes: Mapping[str, Any]) -> pyproj.CRS:
    """Return the reference system of a grid mapping's attributes; raises what `pyproj.CRS.from_cf`
    does.

    Where none says a prime meridian pyproj looks up Greenwich by its name, in half a second: it is
    told, and makes the same system.
    """
    lacking = len(attributes.keys() & EARTH) == 1 and not attributes.keys() & GREENWICH.keys()
    return pyproj.CRS.from_cf({**attributes, **GREENWICH} if lacking else dict(attributes))
