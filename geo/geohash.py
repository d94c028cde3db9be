"""Geohashes (Niemeyer 2008): positions as letters and digits; more of them mean a smaller cell."""

ALPHABET = "0123456789bcdefghjkmnpqrstuvwxyz"


def encode(lon: float, lat: float, length: int) -> str:
    """Return the geohash of a position [deg], lon in [-180, 180], with `length` letters."""
    bounds, values = [[-180.0, 180.0], [-90.0, 90.0]], (lon, lat)
    letters, number = "", 0
    for bit in range(5 * length):
        low, high = bounds[bit % 2]  # longitude first
        middle = (low + high) / 2
        upper = values[bit % 2] >= middle
        bounds[bit % 2] = [middle, high] if upper else [low, middle]
        number = 2 * number + upper
        if bit % 5 == 4:
            letters, number = letters + ALPHABET[number], 0
    return letters


def decode(text: str) -> tuple[float, float]:
    """Return the centre (lon, lat) [deg] of a geohash's cell; raise ValueError for other text."""
    bounds, bit = [[-180.0, 180.0], [-90.0, 90.0]], 0
    for letter in text:
        number = ALPHABET.index(letter)
        for shift in range(4, -1, -1):
            low, high = bounds[bit % 2]
            middle = (low + high) / 2
            bounds[bit % 2] = [middle, high] if number >> shift & 1 else [low, middle]
            bit += 1
    return sum(bounds[0]) / 2, sum(bounds[1]) / 2
