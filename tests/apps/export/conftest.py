"""What the tests of exports share: a finished run with a plan across the antimeridian."""

from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path

import finished
import plans
import pytest
import xarray as xr


@pytest.fixture(scope="session")
def run(
    tmp_path_factory: pytest.TempPathFactory, small: Callable[[], AbstractContextManager[None]]
) -> Path:
    """The folder of the run, which no test changes; none looks at a picture of it."""
    with plans.after_few_trials(), small():
        return finished.plan(tmp_path_factory.mktemp("run"))


@pytest.fixture(scope="module")
def forecast(run: Path) -> xr.Dataset:
    return xr.load_dataset(run / "forecast.nc")
