"""Files of `drift sensor`: a netCDF grid and a CSV table."""

import math

import numpy as np
import xarray as xr

from drift.apps.sensor.records import Reach
from drift.products.files import formats
from drift.products.files.chapter import Stamped
from geo.notation import NMI

EVERY = 10  # [deg] between bearings of the table
ROWS = 100  # most ranges per bearing in the table
STEPS = tuple(m * 10.0**e for e in range(-2, 4) for m in (1, 2, 5))  # [nmi] allowed range steps


def grid(found: Reach, stamped: Stamped) -> xr.Dataset:
    """Return signal excess and probability of detection by longitude and latitude."""
    question = found.question
    data: dict[str, object] = {
        "pod": (
            ("lat", "lon"),
            found.cells.pod.astype(np.float32),
            {
                "long_name": "probability that a look of the sensor detects a target",
                "units": "1",
                "valid_range": np.array([0, 1], np.float32),
                "comment": "land is ignored; for a sonar Phi(signal excess / fluctuation), averaged over its unknown",
            },
        )
    }
    if found.cells.excess is not None:
        data["signal_excess"] = (
            ("lat", "lon"),
            found.cells.excess.astype(np.float32),
            {
                "long_name": "signal excess",
                "units": "dB",
                "comment": "source level - loss - (noise - gain) - threshold; missing beyond the range of the loss table",
            },
        )
    coords: dict[str, object] = {
        "lat": (
            "lat",
            found.lat,
            {"standard_name": "latitude", "units": "degrees_north", "axis": "Y"},
        ),
        "lon": (
            "lon",
            found.lon,
            {"standard_name": "longitude", "units": "degrees_east", "axis": "X"},
        ),
        "time": (
            (),
            question.time.astype("datetime64[ns]"),
            {"standard_name": "time", "long_name": "time of the look", "axis": "T"},
        ),
    }
    attributes: dict[str, object] = {
        "summary": f'Where the sensor "{question.sensor.name}" would detect a target by one look.',
        "sensor": question.sensor.name,
        "sensor_lon": question.place[0],
        "sensor_lat": question.place[1],
        "assumed": "; ".join(f"{name}: {words}" for name, words in question.assumed),
    }
    if question.sonar is not None:
        attributes |= {
            "source_level_db": question.level,
            "fluctuation_db": question.sonar.fluctuation,
        }
        attributes |= {"heading_deg": math.degrees(question.heading)} if question.has_array else {}
        attributes |= {"beams": ", ".join(str(beam + 1) for beam in question.beams) or "all"}
    return xr.Dataset(data, coords, attributes)


def reach_csv(found: Reach, stamped: Stamped) -> str:
    """Return signal excess and probability of detection by bearing and range, as CSV."""
    step = next((step for step in STEPS if found.extent / NMI / step <= ROWS), STEPS[-1])
    ranges = np.arange(1, math.floor(found.extent / NMI / step + 1e-9) + 1) * step
    rows = []
    for bearing in range(0, len(found.bearing), EVERY):
        pod = np.interp(ranges * NMI, found.range, found.around.pod[bearing])
        excess = None if found.around.excess is None else found.around.excess[bearing]
        signal_excess = (
            np.full(ranges.shape, np.nan)
            if excess is None
            else np.interp(ranges * NMI, found.range, excess)
        )
        for metres, db, chance in zip(ranges, signal_excess, pod, strict=True):
            rows.append(
                [
                    bearing,
                    f"{metres:.10g}",
                    f"{db:.2f}" if math.isfinite(db) else "",
                    f"{chance:.4f}",
                ]
            )
    head = ["bearing_deg", "range_nmi", "signal_excess_db", "pod", "sensor", "time"]
    constants = [found.question.sensor.name, found.question.time]
    every = [[*row, *constants] for row in rows]
    return formats.csv_text(head, every, run=stamped["run_id"])
