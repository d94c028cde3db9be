"""Records of a fetch: an order to a provider, and the shipment of parts, each one file by time."""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from drift.apps.fetch.catalogue import Provider
from geo.box import Box


@dataclass(frozen=True)
class Order:
    """A quantity of a provider in a box and a span.

    The times go from the last one at or before `begin` to the first one at or after `end`.
    timeout: longest wait for a server's answer [s]. asked: when it was ordered, which determines
    the times that a forecast's provider has.
    """

    provider: Provider
    box: Box
    begin: np.datetime64  # [s] UTC
    end: np.datetime64
    timeout: float
    asked: np.datetime64  # [s] UTC


@dataclass(frozen=True)
class Part:
    """A part of a shipment: some of its times, in one file.

    key: identifies the content, so that a part that was fetched before is recognised. make: writes
    it as a netCDF file. times: [s] UTC that it must contain, shape (n,); None if only the provider
    knows them. size: estimate [bytes].
    """

    key: str
    make: Callable[[Path], None]
    times: NDArray[np.datetime64] | None
    size: float


@dataclass(frozen=True)
class Shipment:
    """All parts of an order; notes: remarks for the user."""

    order: Order
    parts: tuple[Part, ...]
    notes: tuple[str, ...] = field(default=())

    @property
    def size(self) -> float:
        """The estimated size of the download [bytes]."""
        return sum(part.size for part in self.parts)
