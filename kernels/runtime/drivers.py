"""Devices listed by graphics drivers, through ctypes: CUDA and NVML, the Vulkan loader, macOS.

Nothing has to be installed, no card is started, and a missing library becomes a message. Offsets
and numbers of structures are those of cuda.h, nvml.h and vulkan_core.h.
"""

import ctypes
import os
import platform
import re
import struct
import sys
from ctypes import byref
from typing import Any

from kernels.runtime import devices
from kernels.runtime.devices import Device, Listed

SOFTWARE = re.compile("llvmpipe|lavapipe|softpipe|swiftshader", re.IGNORECASE)
HIDING = "CUDA_VISIBLE_DEVICES"  # environment variable of CUDA
FEATURES = {"float64": 39, "int64": 40}  # by their index in VkPhysicalDeviceFeatures


def ask(backend: str) -> Listed:
    """Return the devices that the driver of a backend lists: cuda, vulkan or metal."""
    try:
        return {"cuda": _cuda, "vulkan": _vulkan, "metal": _metal}[backend]()
    except AttributeError as error:  # a function is missing
        return Listed(
            backend, (), f"the driver's library is too old ({error})", "update the driver"
        )


def _cuda() -> Listed:
    """Return NVIDIA's cards in the order of CUDA, of which Taichi takes the first."""
    driver = _library("libcuda.so", "nvcuda.dll")
    if driver is None and _library("libcuda.so.1") is not None:
        link = "make a link of that name to it in a folder, and name the folder in LD_LIBRARY_PATH"
        return Listed("cuda", (), "Taichi loads libcuda.so, and only libcuda.so.1 is there", link)
    if driver is None:
        install = "install NVIDIA's driver (a container: start it with --gpus all)"
        return Listed("cuda", (), "no NVIDIA driver is found", install)
    count, version = ctypes.c_int(), ctypes.c_int()
    if failed := driver.cuInit(0) or driver.cuDeviceGetCount(byref(count)):
        words = ctypes.c_char_p()
        driver.cuGetErrorString(failed, byref(words))
        why = f"the NVIDIA driver does not start: {(words.value or b'no reason given').decode(errors='replace')}"
        return Listed(
            "cuda", (), why, f"look at nvidia-smi, restart after an update of the driver{_hidden()}"
        )
    if count.value == 0:
        return Listed(
            "cuda", (), "the NVIDIA driver lists no card", f"look at nvidia-smi{_hidden()}"
        )
    driver.cuDriverGetVersion(byref(version))
    return Listed(
        "cuda", tuple(_cuda_device(driver, number, version.value) for number in range(count.value))
    )


def _hidden() -> str:
    """Return a hint that an environment variable hides cards, if it is set."""
    return f", unset {HIDING}, which is {os.environ[HIDING]!r}" if HIDING in os.environ else ""


def _cuda_device(driver: Any, number: int, version: int) -> Device:
    device, name, bus = (
        ctypes.c_int(),
        ctypes.create_string_buffer(256),
        ctypes.create_string_buffer(64),
    )
    total, major, minor = ctypes.c_size_t(), ctypes.c_int(), ctypes.c_int()
    driver.cuDeviceGet(byref(device), number)
    driver.cuDeviceGetName(name, len(name), device)
    driver.cuDeviceTotalMem_v2(byref(total), device)
    driver.cuDeviceGetPCIBusId(bus, len(bus), device)
    # CU_DEVICE_ATTRIBUTE_COMPUTE_CAPABILITY_MAJOR, _MINOR
    driver.cuDeviceGetAttribute(byref(major), 75, device)
    driver.cuDeviceGetAttribute(byref(minor), 76, device)
    knows = f"CUDA {version // 1000}.{version % 1000 // 10}"
    own, free = _nvml(bus.value)
    # a part of a card (MIG) is smaller than the card
    free = None if free is None else min(free, total.value)
    unfit, remedy = devices.cuda_unfit((major.value, minor.value), version, free)
    driver_told = f"driver {own}, {knows}" if own else knows
    return Device(
        "cuda", number, _text(name.raw), "discrete", driver_told, total.value, free, unfit, remedy
    )


def _nvml(bus: bytes) -> tuple[str, int | None]:
    """Return the version of NVIDIA's driver and the card's free memory [bytes].

    bus: of the card. "" and None: unknown.
    """
    nvml = _library("libnvidia-ml.so.1", "nvml.dll")
    if nvml is None or nvml.nvmlInit_v2():
        return "", None
    version, handle, memory = (
        ctypes.create_string_buffer(96),
        ctypes.c_void_p(),
        (ctypes.c_ulonglong * 3)(),
    )
    nvml.nvmlSystemGetDriverVersion(version, len(version))
    nvml.nvmlDeviceGetHandleByPciBusId_v2(bus, byref(handle))
    known = handle.value and not nvml.nvmlDeviceGetMemoryInfo(handle, memory)  # total, free, used
    nvml.nvmlShutdown()
    return _text(version.raw), memory[1] if known else None


def _metal() -> Listed:
    """Return the graphics unit of an Apple processor."""
    if sys.platform != "darwin" or platform.machine() != "arm64":
        return Listed("metal", (), "it is for macOS on Apple's own processors")
    driver = f"macOS {platform.mac_ver()[0]}"
    return Listed("metal", (Device("metal", 0, "Apple GPU", "integrated", driver),))


def _vulkan() -> Listed:
    """Return the devices of all Vulkan drivers, in the loader's order."""
    loader = _library("libvulkan.so.1", "vulkan-1.dll", "libvulkan.1.dylib")
    install = "install the card's driver (Debian: libvulkan1 and mesa-vulkan-drivers, or NVIDIA's)"
    if loader is None:
        return Listed("vulkan", (), "no Vulkan loader is found", install)
    application = ctypes.create_string_buffer(
        struct.pack("@IPPIPII", 0, 0, 0, 0, 0, 0, 1 << 22 | 1 << 12)
    )
    wanted = ctypes.create_string_buffer(
        struct.pack("@IPIPIPIP", 1, 0, 0, ctypes.addressof(application), 0, 0, 0, 0)
    )
    instance, count = ctypes.c_void_p(), ctypes.c_uint32()
    failed = loader.vkCreateInstance(wanted, None, byref(instance))
    if failed == 0:
        loader.vkEnumeratePhysicalDevices(instance, byref(count), None)
        handles = (ctypes.c_void_p * count.value)()
        loader.vkEnumeratePhysicalDevices(instance, byref(count), handles)
        devices = tuple(
            _vulkan_device(loader, number, handle) for number, handle in enumerate(handles)
        )
        loader.vkDestroyInstance(instance, None)
    if failed or not devices:
        return Listed("vulkan", (), "no driver of Vulkan lists a device", install)
    return Listed("vulkan", devices)


def _vulkan_device(loader: Any, number: int, handle: int) -> Device:
    about, driver = _filled(
        loader.vkGetPhysicalDeviceProperties2, handle, (1000059001, 824), (1000196000, 520)
    )
    features, bits8, numbers8 = _filled(
        loader.vkGetPhysicalDeviceFeatures2,
        handle,
        (1000059000, 220),
        (1000177000, 12),
        (1000082000, 8),
    )
    memory, budget = _filled(
        loader.vkGetPhysicalDeviceMemoryProperties2, handle, (1000059006, 520), (1000237000, 256)
    )
    version, _, _, _, kind_number = struct.unpack_from("5I", about)
    name, told = _text(about[20:276]), f"{_text(driver[4:260])} {_text(driver[260:516])}".strip()
    software = kind_number == devices.KINDS.index("software") or SOFTWARE.search(f"{name} {told}")
    kind = (
        "software"
        if software
        else devices.KINDS[kind_number]
        if kind_number < len(devices.KINDS)
        else "other"
    )
    has = {
        wanted: struct.unpack_from("I", features, 4 * place)[0]
        for wanted, place in FEATURES.items()
    }
    has |= {
        "8 bits in buffers": struct.unpack_from("I", bits8)[0],
        "int8": struct.unpack_from("I", numbers8, 4)[0],
    }
    heaps = [
        struct.unpack_from("QI", memory, 264 + 16 * k)
        for k in range(struct.unpack_from("I", memory, 260)[0])
    ]
    own = [k for k, (_, flags) in enumerate(heaps) if flags & 1]  # VK_MEMORY_HEAP_DEVICE_LOCAL_BIT
    # VK_EXT_memory_budget
    limits, used = struct.unpack_from("16Q", budget), struct.unpack_from("16Q", budget, 128)
    total = sum(heaps[k][0] for k in own)
    free = sum(limits[k] - min(used[k], limits[k]) for k in own) if any(limits) and own else None
    lacks = tuple(wanted for wanted, there in has.items() if not there)
    unfit, remedy = devices.vulkan_unfit(
        (version >> 22 & 0x7F, version >> 12 & 0x3FF),
        lacks,
        struct.unpack_from("I", about, 372)[0],
        kind,
        told,
    )
    if not unfit and kind not in devices.SHARING:
        unfit, remedy = devices.fullness(free)
    return Device(
        "vulkan", number, name, kind, told or "driver unknown", total, free, unfit, remedy
    )


def _filled(ask_of: Any, handle: int, *kinds: tuple[int, int]) -> list[bytes]:
    """Return the contents of chained structures that a device fills in.

    kinds: (VkStructureType, bytes after the head) of each; zeros: the device does not know it.
    """
    parts = [ctypes.create_string_buffer(16 + size) for _, size in kinds]
    for (kind, _), part, after in zip(kinds, parts, [*parts[1:], None], strict=True):
        struct.pack_into("@IP", part, 0, kind, 0 if after is None else ctypes.addressof(after))
    ask_of(ctypes.c_void_p(handle), parts[0])
    return [part.raw[16:] for part in parts]


def _text(raw: bytes) -> str:
    return raw.split(b"\0")[0].decode(errors="replace")


def _library(linux: str, windows: str = "", mac: str = "") -> Any:
    """Return a system library, or None if it is missing."""
    name = {"win32": windows, "darwin": mac}.get(sys.platform, linux)
    try:
        return ctypes.CDLL(name) if name else None
    except OSError:
        return None
