"""Particles at one time, as tests make them up."""

from typing import Any

import numpy as np

from drift.engine.particles.snapshot import Snapshot


def at(
    time: np.datetime64,
    lon: Any,
    lat: Any,
    probability: Any,
    status: Any,
    scenario: Any,
    **more: Any,
) -> Snapshot:
    """Return a snapshot of particles in any order: those of one scenario are laid side by side, as
    in a run.

    Args:
        time: when it is, UTC.
        lon: longitude [binary angle], int32 (n,).
        lat: latitude, likewise.
        probability: of each particle, sum 1 (n,).
        status: code of drift.engine.particles.status (n,).
        scenario: number of each one's scenario (n,).
        more: further columns (n,).
    """
    order = np.argsort(scenario, kind="stable")
    whole = (np.asarray(values)[order].astype(np.int32) for values in (lon, lat, status, scenario))
    x, y, codes, numbers = whole
    own = {name: np.asarray(values)[order] for name, values in more.items()}
    return Snapshot(time, x, y, np.asarray(probability)[order], codes, numbers, **own)
