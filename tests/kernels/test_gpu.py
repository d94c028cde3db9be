"""Other backends against the CPU: a search, what steers, sensors, an ensemble, a spill, a track and
a plan.

Random numbers are integers and the same everywhere. Sums of float32 are rounded elsewhere, so
positions part by the last bits, and a particle that a last bit strands elsewhere counts for itself
alone.
"""

import json
import os
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
from places import ROOT
from portable import RUNS

from geo import sphere

pytestmark = [pytest.mark.gpu, pytest.mark.timeout(900)]
DIFFERENT = ("search", "steered", "heard", "members", "spill")  # those not run twice
# Positions are in units of 9 mm; a step rounds to one of them, and a hundred steps add up to some
# decimetres.
MEDIAN, MOST = 0.1, 1.0  # [m] of half the particles, and of 99 of a hundred
START = "from kernels.runtime import runtime; runtime.start({!r})"
Results = Mapping[str, np.ndarray]


def results(backend: str, folder: Path) -> Results:
    """Return what comes of the runs of `portable` on a backend."""
    file = folder / f"{backend}.npz"
    script = ROOT / "tests" / "oracles" / "portable.py"
    subprocess.run([sys.executable, str(script), backend, str(file)], check=True)
    return np.load(file)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("backends")


@pytest.fixture(scope="module")
def cpu(folder: Path) -> Results:
    return results("cpu", folder)


@pytest.fixture(scope="module", params=["cuda", "vulkan", "metal"])
def other(request: pytest.FixtureRequest, folder: Path) -> Results:
    """Results of another backend; skipped where this machine has none, unless DRIFT_BACKENDS names
    it.
    """
    started = subprocess.run(
        [sys.executable, "-c", START.format(request.param)], capture_output=True, text=True
    )
    if (
        started.returncode != 0
        and request.param not in os.environ.get("DRIFT_BACKENDS", "").split()
    ):
        pytest.skip(
            f"no {request.param} on this machine: {started.stderr.strip().splitlines()[-1]}"
        )
    return results(request.param, folder)


def apart(one: Results, two: Results, name: str) -> np.ndarray:
    """Return how far [m] the particles of two results are apart that are in the same state and
    place.
    """
    places = [
        np.radians(each[f"{name}/{column}"]) for each in (one, two) for column in ("lon", "lat")
    ]
    found = sphere.distance(*places)
    return found[np.isfinite(found)]


@pytest.mark.parametrize("name", DIFFERENT)
def test_particles_are_where_the_cpu_has_them(cpu: Results, other: Results, name: str) -> None:
    found = apart(cpu, other, name)
    assert found.size > 500
    assert np.median(found) <= MEDIAN
    assert np.quantile(found, 0.99) <= MOST


@pytest.mark.parametrize("name", DIFFERENT)
def test_all_but_one_in_a_thousand_end_in_the_same_state(
    cpu: Results, other: Results, name: str
) -> None:
    one, two = cpu[f"{name}/status"], other[f"{name}/status"]
    assert np.mean(one != two) < 0.001


@pytest.mark.parametrize("name", DIFFERENT)
def test_evidence_and_weights_agree(cpu: Results, other: Results, name: str) -> None:
    """A decimetre in a swath of a kilometre is 1e-4 of a POD, of either sign: over a thousand
    particles some 3e-6.
    """
    one, two = (json.loads(str(each[f"{name}/figures"])) for each in (cpu, other))
    assert one.keys() == two.keys()
    assert "account.adrift" in one
    states = np.mean(cpu[f"{name}/status"] != other[f"{name}/status"])
    for key, value in one.items():
        assert two[key] == pytest.approx(value, rel=2e-5, abs=2e-5 + states, nan_ok=True), key


@pytest.mark.parametrize("name", DIFFERENT)
def test_areas_agree(cpu: Results, other: Results, name: str) -> None:
    """Where a metre takes a particle into the next cell, an area changes by a cell or two."""
    one, two = cpu[f"{name}/areas"], other[f"{name}/areas"]
    assert one.size > 0
    assert np.allclose(one, two, rtol=0.01, equal_nan=True)


@pytest.mark.parametrize("name", ["search again", "search in shards"])
def test_the_same_bits_twice_and_from_shards(other: Results, name: str) -> None:
    for column in ("lon", "lat", "status"):
        assert np.array_equal(
            other[f"search/{column}"], other[f"{name}/{column}"], equal_nan=column != "status"
        )
    assert json.loads(str(other[f"{name}/figures"])) == json.loads(str(other["search/figures"]))


def test_a_track_is_followed_alike(cpu: Results, other: Results) -> None:
    """Clouds move in float64."""
    assert np.nanmax(np.abs(cpu["track/place"] - other["track/place"])) < 1e-9


def test_a_plan_is_as_good(cpu: Results, other: Results) -> None:
    """The optimiser may take another of two that differ in the last digits; what it finds is worth
    the same.
    """
    assert other["plan/pos"][2] == cpu["plan/pos"][2]
    assert other["plan/pos"][:2] == pytest.approx(cpu["plan/pos"][:2], abs=0.01)


def test_all_runs_are_compared() -> None:
    assert set(RUNS) == {*DIFFERENT, "search again", "search in shards"}
