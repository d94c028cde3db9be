"""Missing values next to the coast, filled from their wet neighbours for sampling only."""

import numpy as np
from numpy.typing import NDArray


def fill(values: NDArray[np.float32], cells: int, seamless: bool = False) -> NDArray[np.float32]:
    """Return values (nlat, nlon, k) with missing nodes up to `cells` deep filled, ring by ring.

    A ring's node is the mean of those of its eight neighbours that are valid or were filled before; what was
    valid keeps every bit. seamless: the last column is the first one, so that rings go on across the seam.
    """
    result = np.array(values, np.float32, order="C")
    for _ in range(cells):
        body = result[:, :-1] if seamless else result
        wet = np.isfinite(body).all(axis=2)
        if wet.all() or not wet.any():
            break
        pad = np.pad(np.where(wet[..., None], body, 0), ((1, 1), (0, 0), (0, 0)))
        count = np.pad(wet.astype(np.float32), ((1, 1), (0, 0)))
        mode = "wrap" if seamless else "constant"
        pad, count = np.pad(pad, ((0, 0), (1, 1), (0, 0)), mode=mode), np.pad(count, ((0, 0), (1, 1)), mode=mode)
        ny, nx = wet.shape
        total, neighbours = np.zeros_like(body), np.zeros((ny, nx), np.float32)
        for j in range(3):
            for i in range(3):
                total += pad[j : j + ny, i : i + nx]
                neighbours += count[j : j + ny, i : i + nx]
        ring = ~wet & (neighbours > 0)
        body[ring] = total[ring] / neighbours[ring][:, None]
        if seamless:
            result[:, -1] = result[:, 0]
    return result
