"""What all looks and watches of a group have in common and nobody knows: values that stand for it."""

import numpy as np

from drift.evidence.sensors.records import Sensor, Sonar
from geo.array import Array

# values that stand for it, up to such a share of the fluctuation
NODES = ((0.6, 8), (1.0, 12), (1.5, 16))
MOST = NODES[-1][0]  # beyond it 16 values do not hold products of misses to 0.001


def offsets(unknown: float, fluctuation: float) -> tuple[Array, Array]:
    """Return values [dB] of a normal number of standard deviation `unknown`, and their
    probabilities; one where it is 0.

    fluctuation [dB]: of the signal excess, which smooths what the values are asked for.
    Gauss-Hermite quadrature, for which NumPy is enough.
    """
    if unknown == 0:
        return np.zeros(1), np.ones(1)
    share = unknown / fluctuation
    many = next(count for most, count in NODES if share <= most * (1 + 1e-9))
    nodes, weights = np.polynomial.hermite_e.hermegauss(many)
    return nodes * unknown, weights / weights.sum()


def values(sensor: Sensor) -> tuple[Array, Array]:
    """Return the values [dB] that stand for a sensor's unknown, and their probabilities: all of its
    group have the same.
    """
    sonar = sensor.sees
    if not isinstance(sonar, Sonar):
        return np.zeros(1), np.ones(1)
    return offsets(sonar.unknown, min(sonar.fluctuation, sensor.steadiest))


def key(sensor: Sensor) -> tuple[str, float]:
    """Return what looks and watches have in common that share an unknown; sorties have keys of
    other names.
    """
    return f"sensors {sensor.group}", sensor.sees.unknown if isinstance(
        sensor.sees, Sonar
    ) else np.inf
