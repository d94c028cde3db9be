"""Forecasts along drifters know nothing of the evidence of their case."""

import numpy as np
import pytest
from verified_drifters import case, simulated

import drift

EVIDENCE = {
    "drifter": [{"track": "buoy.csv"}],
    "report": [
        {
            "name": "ADCP",
            "current": {"speed": "2 kn", "toward": 350},
            "at": [1.0, 45.0],
            "time": "+3 h",
            "error": "0.1 kn",
        }
    ],
    "sortie": [
        {
            "start": "+2 h",
            "end": "+4 h",
            "law": "random",
            "pod": 0.7,
            "area": {"centre": [1.0, 45.0], "length": "6 nmi", "width": "4 nmi", "orientation": 20},
        }
    ],
}


@pytest.fixture(scope="module")
def places(tmp_path_factory):
    """Return where forecasts of a case without evidence have their means, and the folder."""
    folder = tmp_path_factory.mktemp("plain")
    return apart(case(folder)), folder


def apart(given):
    """Return the separations [m] of forecasts of two drifters."""
    return drift.verify(given, simulated(2, 8), hours=6, every=86_400.0, particles=500).apart


@pytest.mark.parametrize("kind", sorted(EVIDENCE))
def test_evidence_changes_no_bit(places, kind):
    plain, folder = places
    rows = ["time,lon,lat"] + [f"2021-03-01T0{hour}:00Z,{1 - 0.02 * hour},45" for hour in range(7)]
    (folder / "buoy.csv").write_text("\n".join(rows))
    with_it = drift.vary(case(folder), {kind: EVIDENCE[kind]})
    assert np.array_equal(apart(with_it), plain)
