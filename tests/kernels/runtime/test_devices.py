"""What is judged of graphics cards: which one auto takes, and why one cannot be used.

Records are made by hand.
"""

from collections.abc import Callable

import pytest

from geo.errors import UserError
from kernels.runtime import devices
from kernels.runtime.devices import Device, Listed

GIB = 2**30
CARD = Device("cuda", 0, "Card", "discrete", "driver 550.54, CUDA 12.4", 8 * GIB, 6 * GIB)
NONE = {name: Listed(name, (), f"no {name}", f"install {name}") for name in devices.CARDS}


def asking(*listed: Listed) -> Callable[[str], Listed]:
    """Return what lists these devices, and none of other backends."""
    return (NONE | {one.backend: one for one in listed}).__getitem__


def vulkan(*kinds: str, unfit: str = "") -> Listed:
    made = [
        Device("vulkan", k, f"{kind} {k}", kind, "Mesa 25", unfit=unfit)
        for k, kind in enumerate(kinds)
    ]
    return Listed("vulkan", tuple(made))


def test_auto_takes_a_card_and_says_which() -> None:
    choice = devices.automatic(10**6, asking(Listed("cuda", (CARD,)), vulkan("discrete")))
    assert choice.device is CARD
    assert choice.why == "Card, driver 550.54, CUDA 12.4; 6.0 GiB of 8.0 GiB free"
    assert not choice.missed


def test_a_run_below_the_threshold_stays_on_the_processor_and_no_driver_is_asked() -> None:
    def never(backend: str) -> Listed:
        raise AssertionError(backend)

    choice = devices.automatic(devices.WORTH - 1, never)
    assert choice.device is None
    assert (
        choice.why == "a card is worth it from 100,000 particles or clouds on, and this has 99,999"
    )
    assert devices.automatic(devices.WORTH, asking(Listed("cuda", (CARD,)))).device is CARD


@pytest.mark.parametrize("kind", ["integrated", "software", "virtual", "other"])
def test_auto_takes_no_device_that_is_no_card_of_its_own(kind: str) -> None:
    choice = devices.automatic(None, asking(vulkan(kind)))
    assert choice.device is None
    assert f"vulkan: {kind} 0 is a{'n' * (kind[0] in 'io')} {kind} device" in choice.why
    assert "cuda: no cuda;" in choice.why
    assert not choice.missed


def test_a_card_that_cannot_be_used_is_missed_with_what_to_do_and_the_next_backend_is_asked() -> (
    None
):
    old = Device(
        "cuda", 0, "Old card", "discrete", "CUDA 9.1", unfit="too old", remedy="take another"
    )
    choice = devices.automatic(None, asking(Listed("cuda", (old,))))
    assert choice.missed
    assert "cuda: Old card: too old (take another)" in choice.why
    other = devices.automatic(
        None, asking(Listed("cuda", (old,)), vulkan("integrated", "discrete"))
    )
    assert other.device is not None
    assert (other.device.backend, other.device.number) == ("vulkan", 1)


@pytest.mark.parametrize(
    ("kinds", "named", "number"),
    [
        (("software", "integrated", "discrete"), "", 2),
        (("software", "integrated", "discrete"), "1", 1),
        # Taichi says that there is no such device, and ranks them itself
        (("software", "virtual"), "7", 1),
        (("discrete", "discrete"), "", 0),
    ],
)
def test_vulkan_takes_the_best_or_the_one_that_is_named(
    kinds: tuple[str, ...], named: str, number: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TI_VISIBLE_DEVICE", named)
    taken = vulkan(*kinds).taken
    assert taken is not None
    assert taken.number == number


def test_cuda_takes_its_first_card_whatever_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TI_VISIBLE_DEVICE", "1")
    other = Device("cuda", 1, "Other", "discrete", "CUDA 12.4")
    assert Listed("cuda", (CARD, other)).taken is CARD


@pytest.mark.parametrize(
    ("capability", "version", "free", "why"),
    [
        ((5, 2), 12040, None, "its compute capability is 5.2, and kernels need 6.0"),
        ((6, 0), 9020, None, "its driver knows CUDA 9.2, and Taichi needs CUDA 10.0"),
        (
            (6, 0),
            10000,
            GIB - 1,
            "1024.0 MiB of its memory are free, and a run needs 1.0 GiB beside its particles",
        ),
        ((6, 0), 10000, GIB, ""),
        ((9, 0), 12040, None, ""),
    ],
)
def test_why_a_card_of_cuda_cannot_be_used(
    capability: tuple, version: int, free: int | None, why: str
) -> None:
    found, remedy = devices.cuda_unfit(capability, version, free)
    assert found == why
    assert bool(remedy) == bool(why)


MODERN = {
    "version": (1, 3),
    "lacks": (),
    "buffers": 1024,
    "kind": "discrete",
    "driver": "radv Mesa 22.3.6",
}


@pytest.mark.parametrize(
    ("differs", "why"),
    [
        ({}, ""),
        ({"version": (1, 0)}, "it knows Vulkan 1.0, and kernels need 1.1"),
        ({"lacks": ("float64", "int8")}, "it lacks float64, int8, which kernels need"),
        ({"buffers": 30}, "it hands 30 buffers to a kernel, and kernels take up to 31"),
        (
            {"kind": "software"},
            "software of radv Mesa 22.3.6, which may compute wrongly and say nothing",
        ),
        ({"kind": "software", "driver": "llvmpipe Mesa 25.0.7-2~bpo12+1 (LLVM 15.0.6)"}, ""),
        ({"kind": "software", "driver": "llvmpipe Mesa 100.1"}, ""),
        (
            {"kind": "software", "driver": "SwiftShader driver 5"},
            "software of SwiftShader driver 5, which may",
        ),
    ],
)
def test_why_a_device_of_vulkan_cannot_be_used(differs: dict, why: str) -> None:
    found, remedy = devices.vulkan_unfit(**(MODERN | differs))
    assert found.startswith(why)
    assert bool(found) == bool(why) == bool(remedy)


def test_a_backend_that_is_asked_for_and_cannot_be_used_is_refused_with_what_to_do() -> None:
    assert devices.usable(Listed("cuda", (CARD,))) is CARD
    with pytest.raises(
        UserError, match=r'^backend = "cuda": no cuda; install cuda, or use backend = "cpu"$'
    ):
        devices.usable(NONE["cuda"])
    with pytest.raises(
        UserError, match=r"""^backend = "metal": it is macOS's; use backend = "cpu"$"""
    ):
        devices.usable(Listed("metal", (), "it is macOS's"))
    full = Device("cuda", 0, "Card", "discrete", "CUDA 12.4", 8 * GIB, 0, *devices.fullness(0))
    with pytest.raises(
        UserError,
        match=r"Card: 0\.0 MiB of its memory are free, .*; end other programs on the card",
    ):
        devices.usable(Listed("cuda", (full,)))


def test_only_a_card_has_memory_of_its_own() -> None:
    assert CARD.room == 6 * GIB
    # nobody says what is free
    assert Device("cuda", 0, "", "discrete", "", 8 * GIB).room == 8 * GIB
    assert Device("vulkan", 0, "", "software", "", 8 * GIB, 6 * GIB).room is None
    assert (
        Device("vulkan", 0, "", "integrated", "", 8 * GIB, 6 * GIB).memory
        == "the processor's memory"
    )
