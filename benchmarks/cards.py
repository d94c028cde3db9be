"""Graphics cards by name: bandwidth of memory and rate of issue, as their makers state them."""

from typing import NamedTuple

THREADS = 32  # in a warp


class Card(NamedTuple):
    """What bounds a step on a card."""

    name: str  # all of its words stand in what the driver calls it
    bandwidth: float  # [byte/s] of its own memory
    processors: int  # multiprocessors, of four schedulers each
    clock: float  # [Hz], boost

    @property
    def issued(self) -> float:
        """Instructions a second that all its threads issue together, at most."""
        return self.processors * 4 * THREADS * self.clock


# NVIDIA's data sheets. The first that fits counts.
CARDS = (
    Card("H100 PCIe", 2.0e12, 114, 1.755e9),
    Card("H100", 3.35e12, 132, 1.755e9),
    Card("H200", 4.8e12, 132, 1.755e9),
    Card("A100 80GB", 2.0e12, 108, 1.41e9),
    Card("A100", 1.555e12, 108, 1.41e9),
    Card("L40S", 0.864e12, 142, 2.52e9),
    Card("RTX 4090", 1.008e12, 128, 2.52e9),
)


def known(name: str) -> Card | None:
    """Return the card of a name, as a driver writes it or as CARDS does; None: nothing is known."""
    return next((card for card in CARDS if all(word in name for word in card.name.split())), None)
