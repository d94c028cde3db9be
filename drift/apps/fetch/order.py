"""What is ordered of a provider, and what it ships: parts by time, each one file."""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from drift.apps.fetch.catalogue import Provider
from geo.box import Box


@dataclass(frozen=True)
class Order:
    """A quantity of a provider in a box, at all its times from one that is not after `begin` to one
    not before `end`.

    timeout: how long a server may leave a question unanswered [s]; asked: when it was ordered,
    which says what a forecast's provider has.
    """

    provider: Provider
    box: Box
    begin: np.datetime64  # [s] UTC
    end: np.datetime64
    timeout: float
    asked: np.datetime64  # [s] UTC


@dataclass(frozen=True)
class Part:
    """A piece of a shipment by time.

    key: what it holds, so that an equal part that was fetched before is known; make: writes it as a
    netCDF file; times [s] UTC that must be in it, shape (n,); none where the provider alone knows
    them; size [bytes], about.
    """

    key: str
    make: Callable[[Path], None]
    times: NDArray[np.datetime64] | None
    size: float


@dataclass(frozen=True)
class Shipment:
    """All parts of an order; notes: what the user should know of it."""

    order: Order
    parts: tuple[Part, ...]
    notes: tuple[str, ...] = field(default=())

    @property
    def size(self) -> float:
        """How much will be fetched [bytes], about."""
        return sum(part.size for part in self.parts)
