"""Shares of the containment areas of a forecast: `output.areas` of a case, in percent."""

SHARES = (0.5, 0.75, 0.95)  # used where a case names none
MOST = 6  # most lines that can be distinguished on a map
LEAST, LARGEST = 1.0, 99.9  # [%], of areas that particles can resolve


def percents(value: object) -> tuple[float, ...]:
    """Return percentages, ascending; raise ValueError if the value is not a list of allowed
    percentages.
    """
    if not isinstance(value, list | tuple) or not all(
        isinstance(v, int | float) and v is not True for v in value
    ):
        raise ValueError(f"{value!r} must be a list of percentages, like [50, 90, 95]")
    shares = tuple(sorted({float(share) for share in value}))
    if not 1 <= len(value) <= MOST or len(shares) < len(value):
        raise ValueError(f"{value!r} holds {len(value)} areas; must be 1 to {MOST} different ones")
    for share in shares:
        if not LEAST <= share <= LARGEST:
            raise ValueError(
                f"{share:g} % is not an area that particles can estimate; must be {LEAST:g} to {LARGEST:g} %"
            )
    return shares
