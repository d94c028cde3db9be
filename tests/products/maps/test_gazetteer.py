"""The gazetteer against positions of harbours from the World Port Index (NGA Pub 150), to a few
miles.
"""

import numpy as np
import pytest
from pyproj import Geod

from drift.products.maps import gazetteer
from geo.box import Box

HARBOURS = {  # lon, lat [deg]
    "Bergen": (5.32, 60.40), "Suva": (178.43, -18.13), "Honolulu": (-157.87, 21.31), "Punta Arenas": (-70.90, -53.17), "Mobile": (-88.04, 30.69),
}  # fmt: skip


@pytest.mark.parametrize("name", HARBOURS)
def test_harbours_are_where_they_are(name):
    """Within 8 nmi: a town's middle is not its quay."""
    lon, lat = HARBOURS[name]
    found = {
        place.name: place
        for place in gazetteer.places_in_box(Box(lon - 0.6, lat - 0.4, lon + 0.6, lat + 0.4))
    }
    assert found[name].harbour
    _, _, metres = Geod(ellps="WGS84").inv(lon, lat, found[name].lon, found[name].lat)
    assert metres < 8 * 1852


def test_a_box_across_180_names_both_sides_without_a_jump():
    places = gazetteer.places_in_box(Box(177.0, -19.0, 182.0, -15.0), 30)
    assert all(177 <= place.lon <= 182 for place in places)
    assert {place.lon > 180 for place in places} == {True, False}


def test_few_are_named_and_well_apart():
    box = Box(-10.0, 35.0, 30.0, 60.0)
    places = gazetteer.places_in_box(box, 15)
    assert len(places) == 15
    at = np.array([[place.lon * np.cos(np.radians(47.5)), place.lat] for place in places])
    apart = np.hypot(*(at[:, None] - at[None]).transpose(2, 0, 1))[np.triu_indices(15, 1)]
    assert apart.min() >= gazetteer.APART * (30 + 10) * np.cos(np.radians(47.5))
    assert gazetteer.places_in_box(Box(-40.0, -50.0, -35.0, -47.0)) == []  # nobody lives there
