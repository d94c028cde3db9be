"""What the tests of exports share: a finished run with a plan across the antimeridian."""

from pathlib import Path

import finished
import pytest
import xarray as xr
from plans import few_trials  # noqa: F401 (a fixture)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory, few_trials: None) -> Path:  # noqa: F811
    return finished.plan(tmp_path_factory.mktemp("run"))


@pytest.fixture(scope="module")
def forecast(run: Path) -> xr.Dataset:
    return xr.load_dataset(run / "forecast.nc")
