"""Missing values next to the coast, filled from their wet neighbours for sampling only."""

import numpy as np
from numpy.typing import NDArray


def fill(values: NDArray[np.float32], cells: int, seamless: bool = False) -> NDArray[np.float32]:
    """Return values (nlat, nlon, k) with missing nodes up to `cells` deep filled, ring by ring.

    A ring's node is the mean of those of its eight neighbours that are valid or were filled before; what was
    valid keeps every bit. seamless: the last column is the first one, so that rings go on across the seam.
    """
    result = np.array(values, np.float32, order="C")
    body = result[:, :-1] if seamless else result
    ny, nx = body.shape[:2]
    for _ in range(cells):
        wet = np.asarray(np.isfinite(body).all(axis=2))
        if wet.all() or not wet.any():
            break
        # one frame of land round everything, or the far side of the seam
        padded = np.zeros((ny + 2, nx + 2, body.shape[2]), np.float32)
        count = np.zeros((ny + 2, nx + 2), np.float32)
        padded[1:-1, 1:-1], count[1:-1, 1:-1] = np.where(wet[..., None], body, 0), wet
        if seamless:
            for frame in (padded, count):
                frame[:, 0], frame[:, -1] = frame[:, -2], frame[:, 1]
        total, neighbours = np.zeros_like(body), np.zeros((ny, nx), np.float32)
        for j in range(3):
            for i in range(3):
                total += padded[j : j + ny, i : i + nx]
                neighbours += count[j : j + ny, i : i + nx]
        ring = ~wet & (neighbours > 0)
        body[ring] = total[ring] / neighbours[ring][:, None]
    if seamless:
        result[:, -1] = result[:, 0]
    return result
