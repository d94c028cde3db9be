"""Every kernel, in each of its variants, compiles for graphics cards: to PTX and to SPIR-V.

Nothing is run. PTX is what Taichi makes for CUDA; here it starts on a stub of CUDA's driver, so
that no card is needed. SPIR-V is what it makes for Vulkan, and it needs a Vulkan driver: Mesa's in
software will do (`mesa-vulkan-drivers`; 25 or later where results count, not only compiling).
"""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import cuda_stub
import pytest
import variants
from places import HELPERS, ROOT

COMMAND = [sys.executable, str(ROOT / "tests" / "oracles" / "variants.py")]
HERE = os.pathsep.join(map(str, [ROOT, *HELPERS]))
PARTS = 2  # they may run side by side


def rows(done: subprocess.CompletedProcess[str]) -> list[dict[str, Any]]:
    """Return what a run of variants.py printed, a row for each variant."""
    assert done.returncode == 0, f"the compiler ended: {done.stderr[-2000:]}"
    return [json.loads(line) for line in done.stdout.splitlines() if line.startswith("{")]


@pytest.mark.gpu
@pytest.mark.timeout(1200)  # minutes where other programs use the machine
@pytest.mark.skipif(bool(cuda_stub.why_not()), reason=cuda_stub.why_not() or "the stub can be made")
@pytest.mark.parametrize("part", range(PARTS))
def test_every_kernel_compiles_to_ptx(part: int, tmp_path: Path) -> None:
    environment = cuda_stub.environment(cuda_stub.compiled(tmp_path), tmp_path)
    command = [*COMMAND, "cuda", "--ptx", str(tmp_path), "--part", str(part), str(PARTS)]
    found = rows(subprocess.run(command, env=environment, capture_output=True, text=True))
    assert {row["kernel"] for row in found} == variants.kernels(part, PARTS).keys()
    assert not [row for row in found if row["error"]]
    for row in found:
        function = variants.kernels()[row["kernel"]].__name__
        texts = [path.read_text() for path in tmp_path.glob(f"{row['kernel']}.*.ptx")]
        assert texts, f"no PTX of {row['kernel']}"
        assert all(f".entry {function}_" in text for text in texts)
    calls = [line.split() for line in (tmp_path / "calls.txt").read_text().splitlines()]
    assert len([call for call in calls if call[0] == "launch"]) >= len(found)


@pytest.mark.gpu
@pytest.mark.timeout(1200)  # minutes where other programs use the machine
@pytest.mark.parametrize("part", range(PARTS))
def test_every_kernel_compiles_to_spirv(part: int) -> None:
    environment = os.environ | {"PYTHONPATH": HERE}
    command = [*COMMAND, "vulkan", "--part", str(part), str(PARTS)]
    done = subprocess.run(command, env=environment, capture_output=True, text=True)
    if "not available on this machine" in done.stderr:
        pytest.skip("no Vulkan on this machine: install mesa-vulkan-drivers")
    found = rows(done)
    assert {row["kernel"] for row in found} == variants.kernels(part, PARTS).keys()
    assert not {row["kernel"]: row["error"] for row in found if row["error"]}


def test_parts_hold_every_kernel_and_each_argument_has_values() -> None:
    every = variants.kernels()
    parts = [variants.kernels(part, PARTS) for part in range(PARTS)]
    assert sum(map(len, parts)) == len(every)
    assert {name for part in parts for name in part} == every.keys()
    assert all(variants.variants(name, kernel) for name, kernel in every.items())


def test_an_argument_without_values_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(variants.VALUES, "polar")
    with pytest.raises(LookupError, match=r"bridge\._between: give the values of 'polar'"):
        variants.variants("bridge._between", variants.kernels()["bridge._between"])
