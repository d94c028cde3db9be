"""Files of the kinds that outside trials found to go wrong: their right ends, or an error whose
remedy gives them.

Ends are from a float64 integration of the analytic fields in the files (their README and our own,
which agree to 0.1 m).
"""

import shutil
from pathlib import Path

import numpy as np
import pytest

import drift
from geo import sphere
from geo.errors import UserError

NEAR = 5.0  # [m] the mean of 200 particles that start within a metre, and places to six decimals
RIGHT = {
    "g_nestwind": (-29.962820, 39.993391),
    "vr_range": (-29.040431, 39.979680),
    "j_shared": (-29.504371, 40.036986),
    "j_360": (-29.504371, 40.036986),
    # 0.6 of the current's speeds: the wind is 20 times as fast, windage 3 %
    "e_expver": (-29.704720, 40.023776),
}
# what is rejected, in which words, and the line that the error asks for
REMEDIES: dict[str, tuple[str, str, tuple[float, float]]] = {
    "h_n_u850": (r"u850 is given at 850 hPa.*variables\.level", "variables = { level = 0 }", (-29.584846, 40.031959)),
    "f_ugutm0": (
        r'lengths in a plane.*crs = .*axes = "true"', 'variables = { crs = "EPSG:32625", axes = "true" }',
        (-29.504371, 40.036986),
    ),
}  # fmt: skip


@pytest.fixture
def faults(data: Path, tmp_path: Path) -> Path:
    """A copy of the folder of faulty inputs; skipped where it is absent."""
    if not (data / "faults").is_dir():
        pytest.skip("no folder of faulty inputs")
    for name in ("j1", "j14"):
        shutil.copytree(data / "faults" / name, tmp_path / name, copy_function=shutil.copyfile)
    for path in (data / "faults").glob("*.*"):
        if path.stem in RIGHT | REMEDIES:
            shutil.copyfile(path, tmp_path / path.name)  # which may be written, as path may not
    return tmp_path


def apart(case: Path, right: tuple[float, float]) -> float:
    """Run a case and return how far the mean of its particles ends from the right place [m]."""
    end = drift.run(drift.load(case)).particles.isel(time=-1)
    return float(
        sphere.distance(*np.radians((float(end.lon.mean()), float(end.lat.mean()), *right)))
    )


@pytest.mark.parametrize("name", RIGHT)
def test_ends_are_right(name: str, faults: Path) -> None:
    assert apart(faults / f"{name}.toml", RIGHT[name]) < NEAR


@pytest.mark.parametrize("name", REMEDIES)
def test_refusals_name_a_remedy_that_works(name: str, faults: Path) -> None:
    words, line, right = REMEDIES[name]
    case = faults / f"{name}.toml"
    with pytest.raises(UserError, match=words):
        drift.run(drift.load(case))
    case.write_text(case.read_text().replace("files = ", f"{line}\nfiles = "))
    assert apart(case, right) < NEAR
