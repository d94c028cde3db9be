"""What all tests share: Taichi on two threads, and where real data may lie."""

import os
from pathlib import Path

import pytest

from kernels import runtime


def pytest_configure() -> None:
    runtime.start("cpu", threads=2)


@pytest.fixture(scope="session")
def data() -> Path:
    """The folder of real forcing files: DRIFT_DATA, or shared/data beside the checkout; skipped where absent."""
    folder = Path(os.environ.get("DRIFT_DATA", Path(__file__).parents[2] / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip(f"no real data: {folder} is not there; set DRIFT_DATA")
    return folder.resolve()
