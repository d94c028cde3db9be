"""What stands on every picture of a run: whose it is, where it comes from, and what it must not be believed of."""

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Imprint:
    """Words that all pictures of a run share."""

    title: str
    footer: str = ""  # a line of where it comes from: case, seed, version
    attributes: Mapping[str, str] = field(default_factory=dict)  # the same in full, into the file
    caution: str = ""  # on a banner
