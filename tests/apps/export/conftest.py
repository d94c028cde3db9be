"""What the tests of exports share: a finished run with a plan across the antimeridian."""

from pathlib import Path

import finished
import plans
import pytest
import xarray as xr


@pytest.fixture(scope="session")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the run, which no test changes."""
    with plans.after_few_trials():
        return finished.plan(tmp_path_factory.mktemp("run"))


@pytest.fixture(scope="module")
def forecast(run: Path) -> xr.Dataset:
    return xr.load_dataset(run / "forecast.nc")
