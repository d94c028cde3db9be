"""GeoTIFF export of probability and containment by cell: WGS 84, north up.

There is one file for each output and each side of 180 degrees.
"""

import warnings
from typing import Any

import numpy as np

from drift.apps.export.finished import Finished
from geo import notation
from geo.errors import UserError

BANDS = {
    "probability": "probability that the object is in the cell, adrift or ashore",
    "containment": "smallest share of the probability whose area holds the cell",
}

WASHUP = frozenset({"washup.geojson"})


def files(run: Finished) -> dict[str, bytes]:
    """Return a GeoTIFF for each output, like probability-20261122T1800Z.tif.

    Band 1 is the probability by cell, band 2 the containment. NaN marks missing data: containment
    at times without a map. A grid across the antimeridian becomes two files, -E and -W, each within
    [-180, 180] to half a cell. Results of a spill add washup.geojson, the stretches of coast.
    """
    try:
        import rasterio  # noqa: F401 (an extra)
    except ImportError:
        raise UserError(
            "geotiff needs rasterio: pip install -e '.[geotiff]' in the folder of drift's source"
        ) from None
    contents, forecast = {}, run.cells()
    lon, sides = forecast["lon"].values, {}
    turns = np.floor((lon + 180) / 360).astype(int)
    for turn in np.unique(turns):
        suffix = "" if np.ptp(turns) == 0 else ("-E" if turn == turns[0] else "-W")
        sides[suffix] = (np.flatnonzero(turns == turn), 360.0 * turn)
    for k, time in enumerate(forecast["time"].values):
        stamp = notation.iso(time).replace("-", "").replace(":", "")
        for suffix, (columns, shift) in sides.items():
            part = forecast.isel(time=k, lon=columns)
            name = f"probability-{stamp[:13]}{'' if stamp[13:15] == '00' else stamp[13:15]}Z{suffix}.tif"
            contents[name] = _file(run, part, shift)
    for name in WASHUP & run.names:  # stretches of coast are lines, which a raster cannot hold
        run.features(name)  # raises UserError if the file is damaged
        contents[name] = (run.folder / name).read_bytes()
    return contents


def _file(run: Finished, output: Any, shift: float) -> bytes:
    """Return the file of one output; shift: whole turns [deg] to subtract from its longitudes."""
    import rasterio
    from rasterio.io import MemoryFile
    from rasterio.transform import from_bounds

    nlat, nlon = output["probability"].shape
    west, east = output["lon_bnds"].values[0, 0] - shift, output["lon_bnds"].values[-1, 1] - shift
    south, north = output["lat_bnds"].values[0, 0], output["lat_bnds"].values[-1, 1]
    profile = {
        "driver": "GTiff",
        "dtype": "float32",
        "count": len(BANDS),
        "width": nlon,
        "height": nlat,
        "crs": rasterio.crs.CRS.from_epsg(4326),
        "transform": from_bounds(west, south, east, north, nlon, nlat),
        "nodata": np.nan,
        "compress": "deflate",
    }
    time = notation.iso(output["time"].values)
    with MemoryFile() as memory:
        with warnings.catch_warnings(), memory.open(**profile) as file:
            for band, (name, words) in enumerate(BANDS.items(), 1):
                file.write(output[name].values[::-1].astype(np.float32), band)
                file.set_band_description(band, name)
                file.update_tags(band, long_name=words, time=time)
            stamp = time.replace("-", ":").replace("T", " ").rstrip("Z")
            file.update_tags(
                title=run.title,
                run_id=run.run,
                time=time,
                comment=run.words,
                TIFFTAG_DATETIME=stamp,
            )
        return bytes(memory.read())
