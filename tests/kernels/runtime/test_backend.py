"""Which backend runs: what auto takes and says, what is refused, and a card that is full on the
way.
"""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from places import ROOT

from geo.errors import UserError
from kernels.runtime import devices, drivers, runtime
from kernels.runtime.devices import Device, Listed

CARD = Device("cuda", 0, "Card", "discrete", "CUDA 12.4", 8 * 2**30, 6 * 2**30)
OOM = "[cuda_driver.h:operator()@92] CUDA Error CUDA_ERROR_OUT_OF_MEMORY: out of memory while calling malloc_async_impl (cuMemAllocAsync)"
DOUBLED = """
import numpy as np
import taichi as ti
from kernels.runtime import devices, drivers, runtime

@ti.kernel
def double(values: ti.types.ndarray()):
    for i in values:
        values[i] *= 2

def doubled():
    held = runtime.upload(np.full(3, 1.5, np.float32))
    double(held)
    return held.to_numpy().tolist()

real = drivers.ask
def listing(*found):
    "Have drivers list these devices alone."
    drivers.ask = lambda backend: devices.Listed(backend, tuple(d for d in found if d.backend == backend), f"no {backend}")
"""


def program(folder: Path, code: str, **environment: str) -> subprocess.CompletedProcess[str]:
    """Return what a process of its own does: Taichi starts once in each."""
    (folder / "program.py").write_text(DOUBLED + code, encoding="utf-8")
    return subprocess.run(
        [sys.executable, "program.py"],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": str(ROOT)} | environment,
        capture_output=True,
        text=True,
        timeout=120,
    )


def lavapipe() -> Device:
    device = drivers.ask("vulkan").taken
    if device is None or device.unfit:
        pytest.skip("no usable driver of Vulkan is installed")
    return device


def test_auto_without_a_card_runs_on_the_processor_and_says_why(tmp_path: Path) -> None:
    code = "listing(); runtime.start('auto'); print(doubled(), runtime.about(), runtime.told(), sep='\\n')"
    done = program(tmp_path, code)
    told = "--backend auto takes cpu: cuda: no cuda; vulkan: no vulkan; metal: no metal"
    assert done.stdout.splitlines() == ["[3.0, 3.0, 3.0]", "{'backend': 'cpu'}", told]
    assert done.stderr == ""


def test_auto_takes_what_is_listed_as_a_card_and_keeps_it(tmp_path: Path) -> None:
    """The software device of Vulkan stands in for one."""
    name = lavapipe().name
    code = """
from dataclasses import replace
listing(replace(real("vulkan").taken, kind="discrete"))
runtime.start("auto", lanes=10**6)
print(doubled(), runtime.backend(), runtime.about()["device"].split(",")[0], runtime.room() > 0, runtime.told(), sep="\\n")
runtime.start("auto")
try:
    runtime.start("cpu")
except Exception as error:
    print(error)
"""
    done = program(tmp_path, code)
    values, backend, device, room, told, refused = done.stdout.splitlines()
    assert (values, backend, room) == ("[3.0, 3.0, 3.0]", "vulkan", "True")
    assert name.startswith(device)
    assert told.startswith(f"--backend auto takes vulkan: {name}, ")
    assert "this process already runs vulkan" in refused
    assert done.stderr == ""


@pytest.mark.parametrize("full", [False, True])
def test_auto_falls_back_to_the_processor_in_one_line(tmp_path: Path, full: bool) -> None:
    """From a card that its driver lists and Taichi cannot start, and from one that is full: here
    there is none.
    """
    why = (
        ", '', 'discrete', 'CUDA 12.4', 2**33, 2**20, *devices.fullness(2**20)"
        if full
        else ", 'Card', 'discrete', 'CUDA 12.4'"
    )
    done = program(
        tmp_path,
        f"listing(devices.Device('cuda', 0{why})); runtime.start('auto'); print(doubled(), repr(runtime.told()))",
    )
    if not done.stdout.strip().startswith("["):
        pytest.skip("there is a card here")
    assert done.stdout.split("\n")[-2] == "[3.0, 3.0, 3.0] ''"
    assert done.stderr.count("\n") == 1
    assert done.stderr.startswith('drift: backend = "auto" takes cpu: ')
    wanted = (
        "1.0 MiB of its memory are free, and a run needs 1.0 GiB"
        if full
        else "Card, CUDA 12.4 does not start ("
    )
    assert wanted in done.stderr


def test_a_software_device_is_taken_where_it_is_asked_for_and_said_to_be_for_tests(
    tmp_path: Path,
) -> None:
    if lavapipe().kind != "software":
        pytest.skip("the driver of Vulkan is a card's")
    done = program(tmp_path, "runtime.start('vulkan'); print(doubled())")
    assert done.stdout == "[3.0, 3.0, 3.0]\n"
    assert (
        done.stderr
        == f'drift: backend = "vulkan": {lavapipe().name} is a software device: for tests\n'
    )


@pytest.mark.thorough
def test_a_software_device_that_may_compute_wrongly_is_refused_and_the_remedies_work(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where Mesa is as old as is said; with one that is new enough it starts (above), and so does
    the processor.
    """
    if lavapipe().kind != "software":
        pytest.skip("the driver of Vulkan is a card's")
    done = program(tmp_path, "devices.MESA = 1000\nruntime.start('vulkan')")
    last = done.stderr.splitlines()[-1]
    assert (
        "which may compute wrongly and say nothing; install Mesa 1000 or later (Debian 12: " in last
    )
    assert last.endswith('or use backend = "cpu"')
    assert (
        program(tmp_path, "devices.MESA = 1000\nruntime.start('cpu'); print(doubled())").stdout
        == "[3.0, 3.0, 3.0]\n"
    )


def test_a_card_that_fills_up_on_the_way_is_a_line(monkeypatch: pytest.MonkeyPatch) -> None:
    """In the words of Taichi 1.7.4 on a CUDA driver that grants 2 GiB; other errors stay what they
    are.
    """
    monkeypatch.setattr(
        runtime, "_started", {"backend": "cuda", "threads": 2, "thread": -1, "device": CARD}
    )
    with (
        pytest.raises(
            UserError,
            match=r'^backend = "cuda": Card is full; end other .* more shards, or use backend = "cpu"$',
        ),
        runtime.telling_full(),
    ):
        raise RuntimeError(OOM)
    with pytest.raises(RuntimeError, match="an illegal memory access"), runtime.telling_full():
        raise RuntimeError("CUDA_ERROR_ILLEGAL_ADDRESS: an illegal memory access was encountered")
    monkeypatch.setattr(runtime, "_started", {"backend": "cpu", "threads": 2, "device": None})
    with pytest.raises(RuntimeError, match="OUT_OF_MEMORY"), runtime.telling_full():
        raise RuntimeError(OOM)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="copies of a process draw where there is fork")
@pytest.mark.parametrize(("backend", "frees"), [("vulkan", False), ("cpu", True)])
def test_a_copy_of_the_process_frees_no_array_of_a_card(
    tmp_path: Path, backend: str, frees: bool
) -> None:
    """As copies that draw pictures are: they end well, and the original still has its arrays, and
    frees them itself.
    """
    lavapipe()
    code = f"""
import os
runtime.start("{backend}")
held, nodes, whose = runtime.upload(np.full(3, 1.5, np.float32)), runtime.empty_nodes(3), ti.ScalarNdarray.__del__
child = os.fork()
if child == 0:
    nodes = None
    print(ti.ScalarNdarray.__del__ is whose, flush=True)
    os._exit(0)
assert os.waitpid(child, 0)[1] == 0
double(held)
print(held.to_numpy().tolist(), ti.ScalarNdarray.__del__ is whose)
"""
    assert program(tmp_path, code).stdout == f"{frees}\n[3.0, 3.0, 3.0] True\n"


def test_the_page_of_backends_has_the_messages() -> None:
    """Each, but for its numbers and names."""
    page = (ROOT / "docs" / "backends.md").read_text(encoding="utf-8")
    cards = (
        devices.cuda_unfit((5, 2), 12040, None),
        devices.cuda_unfit((9, 0), 9020, None),
        devices.fullness(0),
    )
    modern = {
        "version": (1, 3),
        "lacks": (),
        "buffers": 100,
        "kind": "discrete",
        "driver": "llvmpipe Mesa 22.3.6",
    }
    told = [why.removeprefix("0.0 MiB ") for why, _ in cards]
    for differs in ({"version": (1, 0)}, {"kind": "software"}):
        told.append(devices.vulkan_unfit(**(modern | differs))[0])
    told.append("it hands N buffers to a kernel")
    told.append(devices.automatic(5, drivers.ask).why.replace("5", "N"))
    for line in told:
        assert line in page, line


def test_the_room_of_a_card_is_asked_for_each_time(monkeypatch: pytest.MonkeyPatch) -> None:
    now = Device("cuda", 0, "Card", "discrete", "CUDA 12.4", 8 * 2**30, 2 * 2**30)
    monkeypatch.setattr(drivers, "ask", lambda backend: Listed(backend, (now,)))
    monkeypatch.setattr(
        runtime, "_started", {"backend": "cuda", "threads": 2, "thread": -1, "device": CARD}
    )
    assert runtime.room() == 2 * 2**30
    assert runtime.about() == {"backend": "cuda", "device": "Card, CUDA 12.4"}
    monkeypatch.setattr(drivers, "ask", lambda backend: Listed(backend, (), "gone"))
    assert runtime.room() == 6 * 2**30
    monkeypatch.setattr(runtime, "_started", {"backend": "cpu", "threads": 2, "device": None})
    assert runtime.room() is None
    assert runtime.about() == {"backend": "cpu"}


def test_the_threshold_of_auto_is_that_of_the_docs() -> None:
    """And its arithmetic: a step's host time over a particle's on a processor of 16 cores, rounded
    up.
    """
    page = (ROOT / "docs" / "backends.md").read_text(encoding="utf-8")
    assert f"fewer than {devices.WORTH:,} particles" in page
    assert 1e-3 / 12e-9 <= devices.WORTH < 2 * 1e-3 / 12e-9
