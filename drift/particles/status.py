"""What can become of a particle."""

from enum import IntEnum


class Status(IntEnum):
    """Codes in the ensemble's status column; kernels test ADRIFT == 0."""

    ADRIFT = 0
    ASHORE = 1
    OUTSIDE = 2  # no forcing here or now
    LEFT = 3  # left the case's domain
    SUNK = 4
    PENDING = 5  # not yet released, or not yet departed
    UNDER_WAY = 6  # steers
    ARRIVED = 7  # steered to the end of its itinerary
    AGROUND = 8  # stopped by the shore while under way
