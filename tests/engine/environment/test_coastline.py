"""The land of charts: that of the run's coast, and where a chart reaches beyond it, the land there
too.
"""

import json

import shapely

from drift.engine.environment import coastline
from drift.engine.environment.environment_spec import Coast
from geo.box import Box
from geo.coast import edges as shoreline
from geo.coast import shore


def test_a_chart_beyond_the_domain_has_the_land_there(tmp_path) -> None:
    """Two islands on both sides of 180 degrees; the domain holds one of them."""
    islands = [shapely.box(179.0, -17.2, 179.4, -16.9), shapely.box(-176.2, -18.1, -175.9, -17.6)]
    path = tmp_path / "islands.geojson"
    features = [
        {"type": "Feature", "properties": {}, "geometry": json.loads(shapely.to_geojson(island))}
        for island in islands
    ]
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    asked, domain = Coast(str(path), "strand"), Box(178.6, -17.9, 180.3, -16.4)
    coast = shoreline.build_coast(shore.read_land(path, domain), domain)
    land = coastline.land_reader(coast, asked)
    assert land(Box(178.9, -17.3, 179.9, -16.8)) is coast.polygons
    wide = land(Box(178.9, -18.4, 184.6, -16.8))
    assert sorted(shapely.bounds(wide)[:, 0].round(6)) == [179.0, 183.8]  # unwrapped
    assert land(Box(178.7, -18.5, 184.7, -16.7)) is wide  # read once
    assert coastline.land_reader(None, Coast("none", "strand"))(domain).size == 0
