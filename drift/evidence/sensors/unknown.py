"""The unknown error that all looks and watches of a group share, as quadrature nodes."""

import numpy as np

from drift.evidence.sensors.records import Sensor, Sonar
from geo.array import Array

# (largest unknown as a share of the fluctuation, number of nodes)
NODES = ((0.6, 8), (1.0, 12), (1.5, 16))
MOST = NODES[-1][0]  # beyond it, products of misses err by more than 0.001 with 16 nodes


def offsets(unknown: float, fluctuation: float) -> tuple[Array, Array]:
    """Return nodes [dB] and probabilities of a normal unknown; one node if it is 0.

    Gauss-Hermite quadrature, by NumPy.

    Args:
        unknown: standard deviation [dB].
        fluctuation: of the signal excess [dB]; it smooths the integrand.
    """
    if unknown == 0:
        return np.zeros(1), np.ones(1)
    share = unknown / fluctuation
    many = next(count for most, count in NODES if share <= most * (1 + 1e-9))
    nodes, weights = np.polynomial.hermite_e.hermegauss(many)
    return nodes * unknown, weights / weights.sum()


def values(sensor: Sensor) -> tuple[Array, Array]:
    """Return nodes [dB] and probabilities of a sensor's unknown, the same for its whole group."""
    sonar = sensor.sees
    if not isinstance(sonar, Sonar):
        return np.zeros(1), np.ones(1)
    return offsets(sonar.unknown, min(sonar.fluctuation, sensor.steadiest))


def key(sensor: Sensor) -> tuple[str, float]:
    """Return the key that looks and watches with the same unknown share.

    It differs from all keys of sorties.
    """
    return f"sensors {sensor.group}", sensor.sees.unknown if isinstance(
        sensor.sees, Sonar
    ) else np.inf
