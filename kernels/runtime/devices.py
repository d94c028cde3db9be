"""Graphics cards: their properties, whether kernels can run on them, and the choice of `auto`.

kernels.runtime.drivers queries the drivers; this module queries and starts nothing.
"""

import os
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from geo import notation
from geo.errors import UserError

# particles from which a card pays off, an estimate: a step costs the host 0.5 ms, like 40,000
# particles on 16 cores (docs/backends.md)
WORTH = 100_000
LEAST = (
    2**30
)  # [bytes] of a card for its context, kernels, forcing and coast; Taichi 1.7.4 takes as many of old drivers
# compute capability: the first with atomic float64 addition (CUDA C++ Programming Guide, "Atomic
# Functions")
CAPABILITY = (6, 0)
DRIVER = 10_000  # CUDA 10.0: Taichi 1.7.4 starts on no older driver ("requires at least CUDA 10.0")
VULKAN = (1, 1)  # subgroups, and 8 bits in storage buffers
# buffers of the largest kernel, steer._steer: its arrays, and those that Taichi adds
# (tests/test_kernel_constructs.py)
BUFFERS = 31
# software devices of older Mesa compute wrong results silently; 22.3 was tried (docs/backends.md)
MESA = 25
KINDS = ("other", "integrated", "discrete", "virtual", "software")  # by VkPhysicalDeviceType
SHARING = ("integrated", "software")  # kinds that use the processor's memory
BEST_FIRST = ("discrete", "integrated", "virtual", "other", "software")
PICKING = "TI_VISIBLE_DEVICE"  # environment variable of Taichi that picks a Vulkan device
CARDS = ("cuda", "vulkan", "metal")  # backends in the order in which auto looks for cards


@dataclass(frozen=True)
class Device:
    """A graphics card, or software that emulates one, as one backend sees it."""

    backend: str
    number: int  # in the order of its driver
    name: str
    kind: str  # of KINDS
    driver: str  # with its version
    total: int | None = None  # [bytes] memory; None: unknown
    free: int | None = None  # [bytes] free memory
    unfit: str = ""  # why kernels cannot run on it; "" if they can
    remedy: str = ""  # what to do about that

    @property
    def identity(self) -> str:
        """Return name and driver, which identify a device in results."""
        return f"{self.name}, {self.driver}"

    @property
    def room(self) -> int | None:
        """Return the free memory of a card's own [bytes].

        None if it uses the processor's memory, or if it is unknown.
        """
        return None if self.kind in SHARING else self.total if self.free is None else self.free

    @property
    def memory(self) -> str:
        """Return a description of its free memory."""
        if self.kind in SHARING or self.total is None:
            return "the processor's memory" if self.kind in SHARING else "memory unknown"
        free = "unknown" if self.free is None else notation.format_bytes(self.free)
        return f"{free} of {notation.format_bytes(self.total)} free"


@dataclass(frozen=True)
class Listed:
    """Devices that the driver of a backend lists."""

    backend: str
    devices: tuple[Device, ...] = ()
    why: str = ""  # why it lists none
    remedy: str = ""

    @property
    def taken(self) -> Device | None:
        """Return the device that the backend uses, or None.

        CUDA uses the first one, Vulkan the one named in the environment or the best.
        """
        named = os.environ.get(PICKING, "") if self.backend == "vulkan" else "0"
        if named.isdecimal() and int(named) < len(self.devices):
            return self.devices[int(named)]
        order = lambda one: (bool(one.unfit), BEST_FIRST.index(one.kind), one.number)  # noqa: E731
        return min(self.devices, key=order, default=None)

    @property
    def unfit(self) -> tuple[str, str]:
        """Return why kernels cannot run on this backend, and the remedy; empty if they can."""
        device = self.taken
        if device is None:
            return self.why, self.remedy
        return (f"{device.name}: {device.unfit}", device.remedy) if device.unfit else ("", "")


@dataclass(frozen=True)
class Choice:
    """The device that `--backend auto` uses, or None for the processor; and the reason."""

    device: Device | None
    why: str
    missed: bool = False  # there is a card, but it cannot be used


def automatic(lanes: int | None, ask: Callable[[str], Listed]) -> Choice:
    """Return the choice of `--backend auto`: the first discrete card that is usable and pays off.

    A graphics unit inside a processor shares the memory whose speed limits a step, and a software
    device is the processor itself: auto uses neither.

    Args:
        lanes: particles, or clouds of a tracking case, that kernels can move side by side; None:
            unknown.
        ask: lists the devices of a backend (kernels.runtime.drivers.ask).
    """
    if lanes is not None and lanes < WORTH:
        return Choice(
            None,
            f"a card is worth it from {WORTH:,} particles or clouds on, and this has {lanes:,}",
        )
    whys, missed = [], False
    for backend in CARDS:
        listed = ask(backend)
        device, (unfit, remedy) = listed.taken, listed.unfit
        if device is not None and not unfit and device.kind == "discrete":
            return Choice(device, f"{device.identity}; {device.memory}")
        there = device is not None and device.kind == "discrete"
        missed |= there
        alone = (
            ""
            if device is None
            else f"{device.name} is {'an' if device.kind[0] in 'io' else 'a'} {device.kind} device"
        )
        whys.append(f"{backend}: {unfit or alone}{f' ({remedy})' if there else ''}")
    return Choice(None, "; ".join(whys), missed)


def usable(listed: Listed) -> Device:
    """Return the device that a backend uses.

    Raises:
        UserError: kernels cannot run on it; the message says what to do.
    """
    device, (unfit, remedy) = listed.taken, listed.unfit
    if device is None or unfit:
        ways = f"{remedy}, or use --backend cpu" if remedy else "use --backend cpu"
        raise UserError(f"--backend {listed.backend}: {unfit}; {ways}")
    return device


def fullness(free: int | None) -> tuple[str, str]:
    """Return that a card is full, and the remedy; empty if it is not, or if that is unknown."""
    if free is None or free >= LEAST:
        return "", ""
    why = f"{notation.format_bytes(free)} of its memory are free, and a run needs {notation.format_bytes(LEAST)} beside its particles"
    return why, "end other programs on the card (nvidia-smi lists them on NVIDIA's)"


def cuda_unfit(capability: tuple[int, int], version: int, free: int | None) -> tuple[str, str]:
    """Return why kernels cannot run on a CUDA card, and the remedy; empty if they can.

    version: CUDA version that its driver supports, 1000 * major + 10 * minor; free: memory [bytes].
    """
    if capability < CAPABILITY:
        why = f"its compute capability is {capability[0]}.{capability[1]}, and kernels need 6.0"
        return why, "take a card of 2016 or later (Pascal)"
    if version < DRIVER:
        return (
            f"its driver knows CUDA {version // 1000}.{version % 1000 // 10}, and Taichi needs CUDA 10.0",
            "update NVIDIA's driver",
        )
    return fullness(free)


def vulkan_unfit(
    version: tuple[int, int], lacks: Sequence[str], buffers: int, kind: str, driver: str
) -> tuple[str, str]:
    """Return why kernels cannot run on a Vulkan device, and the remedy; empty if they can."""
    if version < VULKAN:
        return (
            f"it knows Vulkan {version[0]}.{version[1]}, and kernels need 1.1",
            "update its driver",
        )
    mesa = re.search(r"Mesa (\d+)", driver)
    if kind == "software" and (mesa is None or int(mesa[1]) < MESA):
        remedy = (
            f"install Mesa {MESA} or later (Debian 12: mesa-vulkan-drivers of bookworm-backports)"
        )
        return (
            f"software of {driver or 'an unknown driver'}, which may compute wrongly and say nothing",
            remedy,
        )
    if lacks:
        return f"it lacks {', '.join(lacks)}, which kernels need", "take another card"
    if buffers < BUFFERS:
        return (
            f"it hands {buffers} buffers to a kernel, and kernels take up to {BUFFERS}",
            "update its driver",
        )
    return "", ""
