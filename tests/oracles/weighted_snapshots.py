"""Snapshots of weighted particles."""

import clouds
import numpy as np

from drift.engine.particles.status import Status
from geo import sphere

BEGIN = np.datetime64("2026-11-21T18:30:00")


def snapshot(lon, lat, weight, hours, status=Status.ADRIFT, scenario=0, **more):
    n = len(lon)
    place = sphere.to_binary(np.asarray(lon)), sphere.to_binary(np.asarray(lat))
    time = BEGIN + np.timedelta64(hours, "h")
    codes = (np.broadcast_to(np.asarray(code, np.int32), n) for code in (status, scenario))
    return clouds.at(time, *place, weight / weight.sum(), *codes, **more)
