"""The version of the installed distribution, and those of what its results follow from."""

import functools
import os
import platform
from importlib import metadata

__version__ = metadata.version("casp-drift")
MAKERS = (  # of results: who reads files, moves, sums and outlines
    "casp-drift",
    os.environ.get("DRIFT_TAICHI") or "taichi",
    "numpy",
    "scipy",
    "shapely",
    "contourpy",
    "pyproj",
    "pyogrio",
    "xarray",
    "netCDF4",
    "cftime",
    "zarr",
    "eccodes",
    "roaring-landmask",
)


@functools.cache
def versions() -> dict[str, str]:
    """Return the versions of Python and of the packages that make results."""
    return {
        "Python": platform.python_version(),
        **{name: metadata.version(name) for name in MAKERS},
    }


def told() -> str:
    """Return the same in a line."""
    return ", ".join(f"{name} {version}" for name, version in versions().items())
