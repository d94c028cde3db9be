"""What GDAL reads of an export, and the areas of the run."""

import json
import math
from pathlib import Path

import numpy as np
import pyogrio
import shapely

HALF = 0.5e-7 + 1e-12  # [deg] half of the last digit that is written
METRES = math.radians(6_371_008.8)  # in a degree of the sphere


def contours(run: Path) -> dict[tuple[str, float], shapely.Geometry]:
    features = json.loads((run / "contours.geojson").read_text())["features"]
    return {
        (f["properties"]["time"], f["properties"]["level"]): shapely.from_geojson(
            json.dumps(f["geometry"])
        )
        for f in features
    }


def layer(path: Path, name: str) -> tuple[dict[str, list], np.ndarray]:
    meta, _, geometry, columns = pyogrio.raw.read(path, layer=name)
    return dict(zip(meta["fields"], map(list, columns), strict=True)), shapely.from_wkb(geometry)
