"""Geohashes against published ones (Wikipedia, geohash.org), and there and back."""

import pytest

from geo import geohash


@pytest.mark.parametrize(
    ("lon", "lat", "text"),
    [(10.40744, 57.64911, "u4pruydqqvj"), (-5.603, 42.605, "ezs42"), (-0.0001, -0.0001, "7zzzzz")],
)
def test_published_geohashes(lon, lat, text):
    assert geohash.encode(lon, lat, len(text)) == text
    back = geohash.decode(text)
    assert geohash.encode(*back, len(text)) == text


def test_what_is_no_geohash():
    with pytest.raises(ValueError, match="substring"):
        geohash.decode("stretch a")
