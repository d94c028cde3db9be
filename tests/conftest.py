"""What all tests share: Taichi on two threads, and where real data may lie."""

from pathlib import Path

import pytest
from places import DATA

from kernels import runtime


def pytest_configure() -> None:
    runtime.start("cpu", threads=2)


@pytest.fixture(scope="session")
def data() -> Path:
    """The folder of real forcing files: DRIFT_DATA, or shared/data beside the checkout; skipped where absent."""
    if not DATA.is_dir():
        pytest.skip(f"no real data: {DATA} is not there; set DRIFT_DATA")
    return DATA.resolve()
