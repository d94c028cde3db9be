"""Midpoints of pieces of a bridge: the same whenever a piece is halved, others for each piece."""

import numpy as np
import taichi as ti
from scipy import stats

from geo import sphere
from kernels.steering import pieces

LON, LAT = 179.99, -38.4  # pieces cross the antimeridian
K, SECONDS, WIDE = 20.0, 3600.0, 30_000  # [m/sqrt(s)], [s], east-west length [m]

Out = ti.types.ndarray(dtype=ti.i32, ndim=3)


@ti.kernel
def _midpoints(
    lon: ti.i32, lat: ti.i32, to_lon: ti.i32, to_lat: ti.i32, seconds: ti.f32, k: ti.f32, out: Out
):
    for slot, count in ti.ndrange(out.shape[0], out.shape[1]):
        piece = pieces.Piece(lon, lat, to_lon, to_lat, 0.0, seconds, k)
        part, later = pieces.whole_piece(piece), pieces.no_later()
        pieces.halve_part(part, later, piece, ti.u32(3), ti.u32(7), slot, 5, count)
        out[slot, count, 0], out[slot, count, 1] = part.to_lon, part.to_lat


def test_each_piece_has_a_midpoint_of_its_own_from_levys_distribution() -> None:
    lon, lat = (sphere.to_binary(degrees) for degrees in (LON, LAT))
    x, y = sphere.destination(*np.radians((LON, LAT)), WIDE, 0.0)
    far = (sphere.to_binary(np.degrees(x)), sphere.to_binary(np.degrees(y)))
    slots, counts = 2000, 3
    out = np.zeros((slots, counts, 2), np.int32)
    _midpoints(*(int(np.int32(place)) for place in (lon, lat, *far)), SECONDS, K, out)
    degrees = sphere.to_degrees(out)
    middle = sphere.destination(*np.radians((LON, LAT)), WIDE / 2, 0.0)
    off = np.stack(sphere.offset(*middle, *np.radians(np.moveaxis(degrees, -1, 0))), axis=-1)
    normal = off / (K * np.sqrt(SECONDS) / 2)  # Levy: K sqrt(dt) / 2
    for count in range(counts):
        for axis in range(2):
            assert stats.kstest(normal[:, count, axis], "norm").pvalue > 1e-3
    pairs = np.corrcoef(normal.transpose(1, 2, 0).reshape(counts * 2, slots))
    assert np.abs(pairs - np.eye(counts * 2)).max() < 4 / np.sqrt(slots)
