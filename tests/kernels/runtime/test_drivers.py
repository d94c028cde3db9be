"""What drivers list: by libraries made of stub_drivers.c, whose structures the C compiler lays out,
and by a real one.
"""

import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path

import pytest
from places import ROOT

from geo.errors import UserError
from kernels.runtime import devices, drivers, runtime
from kernels.tracking import clouds

LIST = "import json, sys; from dataclasses import asdict; from kernels.runtime import drivers; "
LIST += "print(json.dumps(asdict(drivers.ask(sys.argv[1]))))"
Ask = Callable[..., dict]


@pytest.fixture(scope="module")
def stub(tmp_path_factory: pytest.TempPathFactory) -> Path:
    compiler = next(filter(None, map(shutil.which, ("cc", "gcc", "clang"))), None)
    if compiler is None or sys.platform != "linux":
        pytest.skip("stubs of drivers need a C compiler, on Linux")
    made = tmp_path_factory.mktemp("drivers") / "stub.so"
    source = Path(__file__).with_name("stub_drivers.c")
    subprocess.run([compiler, "-shared", "-fPIC", "-o", str(made), str(source)], check=True)
    return made


@pytest.fixture
def ask(stub: Path, tmp_path: Path) -> Ask:
    """Return what lists the devices of a backend where libraries of these names are the stub."""

    def asked(backend: str, *names: str, **says: object) -> dict:
        for name in names:
            shutil.copy(stub, tmp_path / name)
        own = {
            key: value
            for key, value in os.environ.items()
            if key not in ("CUDA_VISIBLE_DEVICES", "TI_VISIBLE_DEVICE")
        }
        own |= {"PYTHONPATH": str(ROOT), "LD_LIBRARY_PATH": str(tmp_path)} | {
            key: str(says[key]) for key in says
        }
        done = subprocess.run(
            [sys.executable, "-c", LIST, backend],
            env=own,
            capture_output=True,
            text=True,
            check=True,
        )
        return json.loads(done.stdout)

    return asked


def test_cards_of_cuda_with_their_memory(ask: Ask) -> None:
    """The bus tells cards apart for NVML: the second has one byte more in all and one more free."""
    listed = ask("cuda", "libcuda.so", "libnvidia-ml.so.1", STUB_COUNT=2, STUB_CC=86)
    first, second = listed["devices"]
    assert first == {
        "backend": "cuda", "number": 0, "name": "Stub card 0", "kind": "discrete",
        "driver": "driver 550.54.15, CUDA 12.4", "total": 8 * 2**30, "free": 6 * 2**30, "unfit": "", "remedy": "",
    }  # fmt: skip
    assert (second["number"], second["name"]) == (1, "Stub card 1")
    assert (second["total"], second["free"]) == (8 * 2**30 + 1, 6 * 2**30 + 1)


def test_cuda_without_nvml_and_a_part_of_a_card(ask: Ask) -> None:
    (device,) = ask("cuda", "libcuda.so")["devices"]
    assert (device["free"], device["driver"]) == (None, "CUDA 12.4")
    (device,) = ask("cuda", "libnvidia-ml.so.1", STUB_TOTAL=5 * 2**30)["devices"]
    assert device["free"] == 5 * 2**30  # NVML tells of the whole card


@pytest.mark.parametrize(
    ("says", "why"),
    [
        ({"STUB_CC": 52}, "its compute capability is 5.2, and kernels need 6.0"),
        ({"STUB_VERSION": 9020}, "its driver knows CUDA 9.2, and Taichi needs CUDA 10.0"),
        ({"STUB_FREE": 2**29}, "512.0 MiB of its memory are free"),
    ],
)
def test_a_card_of_cuda_that_cannot_be_used(ask: Ask, says: dict, why: str) -> None:
    (device,) = ask("cuda", "libcuda.so", "libnvidia-ml.so.1", **says)["devices"]
    assert device["unfit"].startswith(why)
    assert device["remedy"]


@pytest.mark.thorough
def test_no_card_of_cuda(ask: Ask) -> None:
    """What the driver says is told, and a variable that hides cards is named: without it they are
    there.
    """
    if ask("cuda")["devices"]:
        pytest.skip("there is a card here")
    assert ask("cuda")["why"] == "no NVIDIA driver is found"
    linked = ask("cuda", "libcuda.so.1")
    assert linked["why"] == "Taichi loads libcuda.so, and only libcuda.so.1 is there"
    none = ask("cuda", "libcuda.so", CUDA_VISIBLE_DEVICES="")
    assert none["why"] == "the NVIDIA driver does not start: no CUDA-capable device is detected"
    assert none["remedy"].endswith("unset CUDA_VISIBLE_DEVICES, which is ''")
    assert ask("cuda")["why"] == ""
    assert ask("cuda", STUB_COUNT=0)["why"] == "the NVIDIA driver lists no card"


def test_the_link_that_is_advised_is_found(ask: Ask, tmp_path: Path) -> None:
    """The remedy of a libcuda.so.1 alone: a link to it in a folder of LD_LIBRARY_PATH."""
    if not ask("cuda", "libcuda.so.1")["why"]:
        pytest.skip("there is a libcuda.so here")
    (tmp_path / "libcuda.so").symlink_to("libcuda.so.1")
    assert ask("cuda")["devices"][0]["name"] == "Stub card 0"


def test_devices_of_vulkan_with_their_memory(ask: Ask) -> None:
    """Heaps of a card: its own, and the window to it, all of which this process has used."""
    listed = ask("vulkan", "libvulkan.so.1", STUB_TYPES="241", STUB_INFO="Mesa 25.1.0")
    card, software, unit = listed["devices"]
    assert card == {
        "backend": "vulkan", "number": 0, "name": "Stub card 0", "kind": "discrete", "driver": "stubv Mesa 25.1.0",
        "total": 8 * 2**30 + 2**28, "free": 6 * 2**30, "unfit": "", "remedy": "",
    }  # fmt: skip
    assert (software["kind"], software["unfit"], unit["kind"]) == ("software", "", "integrated")
    assert ask("vulkan", STUB_BUDGET=0)["devices"][0]["free"] is None


@pytest.mark.parametrize(
    ("says", "why"),
    [
        ({"STUB_MINOR": 0}, "it knows Vulkan 1.0"),
        ({"STUB_FLOAT64": 0}, "it lacks float64, which"),
        ({"STUB_INT64": 0}, "it lacks int64, which"),
        ({"STUB_STORAGE8": 0}, "it lacks 8 bits in buffers, which"),
        ({"STUB_INT8": 0, "STUB_INT64": 0}, "it lacks int64, int8, which"),
        ({"STUB_BUFFERS": 30}, "it hands 30 buffers to a kernel, and kernels take up to 31"),
        ({"STUB_FREE": 2**20}, "1.0 MiB of its memory are free"),
        (
            {"STUB_TYPES": 4, "STUB_INFO": "Mesa 22.3.6 (LLVM 15.0.6)"},
            "software of stubv Mesa 22.3.6 (LLVM 15.0.6)",
        ),
        ({"STUB_NAME": "SwiftShader Device"}, "software of stubv Mesa 24.1.2"),
    ],
)
@pytest.mark.thorough
def test_a_device_of_vulkan_that_cannot_be_used(ask: Ask, says: dict, why: str) -> None:
    (device,) = ask("vulkan", "libvulkan.so.1", **says)["devices"]
    assert device["unfit"].startswith(why)
    assert device["remedy"]
    assert ask("vulkan", STUB_BUFFERS=31)["devices"][0]["unfit"] == ""


def test_no_device_of_vulkan(ask: Ask) -> None:
    failed = ask("vulkan", "libvulkan.so.1", STUB_INSTANCE=-9)  # VK_ERROR_INCOMPATIBLE_DRIVER
    assert (failed["devices"], failed["why"]) == ([], "no driver of Vulkan lists a device")
    assert ask("vulkan", STUB_TYPES="")["why"] == "no driver of Vulkan lists a device"


def test_a_library_without_what_is_asked_is_too_old(ask: Ask, tmp_path: Path) -> None:
    shutil.copy(next(Path("/lib").glob("*/libm.so.6")), tmp_path / "libcuda.so")
    assert ask("cuda")["why"].startswith("the driver's library is too old (")


def test_metal_is_for_apple(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "platform", "linux")
    assert drivers.ask("metal").why == "it is for macOS on Apple's own processors"
    monkeypatch.setattr(sys, "platform", "darwin")
    monkeypatch.setattr("platform.machine", lambda: "arm64")
    monkeypatch.setattr("platform.mac_ver", lambda: ("14.5", ("", "", ""), "arm64"))
    (device,) = drivers.ask("metal").devices
    assert (device.kind, device.driver, device.room) == ("integrated", "macOS 14.5", None)
    assert device.unfit == ""


def test_tracks_are_refused_on_metal_which_has_no_float64(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(runtime, "backend", lambda: "metal")
    with pytest.raises(
        UserError,
        match=r'^backend = "metal": tracks are followed in float64, .*; use backend = "cpu"$',
    ):
        clouds.follow(False, 1, 1, {}, {}, {}, {}, {}, None)


@pytest.mark.skipif(
    shutil.which("vulkaninfo") is None, reason="needs vulkaninfo (Debian: vulkan-tools)"
)
def test_a_real_driver_of_vulkan_says_what_vulkaninfo_prints() -> None:
    """Name, kind, driver, heaps and limits of the first device, from another program (Khronos)."""
    told = subprocess.run(["vulkaninfo"], capture_output=True, text=True, timeout=60).stdout
    listed = drivers.ask("vulkan").devices
    if not listed:
        pytest.skip("no driver of Vulkan is installed")
    device = listed[0]

    def first(pattern: str) -> str:
        return re.search(pattern, told, re.MULTILINE)[1]

    assert device.name == first(r"^\s*deviceName\s*=\s*(.*)$")
    assert device.driver == f"{first(r'driverName +=? *(.*)$')} {first(r'driverInfo +=? *(.*)$')}"
    kind = first(r"deviceType\s*=\s*PHYSICAL_DEVICE_TYPE_(\w+)")
    kinds = {
        "CPU": "software",
        "INTEGRATED_GPU": "integrated",
        "DISCRETE_GPU": "discrete",
        "VIRTUAL_GPU": "virtual",
    }
    assert device.kind == kinds[kind]
    if told.count("memoryHeaps[") == 1:
        assert device.total == int(first(r"memoryHeaps\[0\]:\s*\n\s*size\s*=\s*(\d+)"))
    if device.kind == "software" and int(first(r"Mesa (\d+)")) >= devices.MESA:
        assert device.unfit == ""
    assert asdict(device)["free"] is None or 0 < device.free <= device.total
