"""On a card of NVIDIA's a column is copied once, by the driver: held against a stub of it that
keeps what it is given.
"""

import subprocess
import sys
from collections import Counter
from pathlib import Path

import cuda_stub
import pytest

pytestmark = pytest.mark.skipif(
    bool(cuda_stub.why_not()), reason=cuda_stub.why_not() or "the stub can be made"
)

ROUND_TRIP = """
import sys, numpy as np, taichi as ti
from pathlib import Path
from kernels.runtime import runtime
runtime.start("cuda")
log = Path(sys.argv[1]) / "calls.txt"
begun = len(log.read_text().splitlines())
for kind in (np.float32, np.int32, np.int64, np.float64, np.uint8):
    values = (np.arange(1001) * 37 % 251).astype(kind)
    column = runtime.upload(values)
    copied = runtime.copy(column)
    column.from_numpy(values[::-1])
    assert np.array_equal(column.to_numpy(), values[::-1])
    assert np.array_equal(copied.to_numpy(), values)
print(*log.read_text().splitlines()[begun:], sep="\\n")
"""
BYTES = [1001 * size for size in (4, 4, 8, 8, 1)]
WAYS = {"up": 2, "down": 2, "within": 1}  # how often each column goes


def test_columns_come_back_as_they_went_and_are_copied_once(tmp_path: Path) -> None:
    environment = cuda_stub.environment(cuda_stub.compiled(tmp_path), tmp_path)
    command = [sys.executable, "-c", ROUND_TRIP, str(tmp_path)]
    done = subprocess.run(command, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-2000:]
    calls = [line.split() for line in done.stdout.splitlines()]
    copies = Counter(
        (what, int(size)) for what, size in (call for call in calls if call[0] in WAYS)
    )
    assert copies == {
        (way, size): BYTES.count(size) * times for way, times in WAYS.items() for size in BYTES
    }
    assert not [call for call in calls if call[0] == "launch"]
