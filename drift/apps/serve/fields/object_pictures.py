"""Pictures of what can be adrift, each of a group of leeway classes (assets/objects.svg)."""

from fnmatch import fnmatchcase
from functools import lru_cache
from types import MappingProxyType

# by symbol: words, and patterns of leeway classes; the first that fits counts
PICTURES = MappingProxyType(
    {
        "person": ("Person in water", ("PIW-*",)),
        "raft": ("Life raft", ("LIFE-RAFT-*", "USCG-RESCUE", "AVIATION-1")),
        "capsule": ("Hard-shell raft", ("LIFE-CAPSULE", "OVATEK-CRAFT-*")),
        "slide": ("Escape slide", ("AVIATION-*",)),
        "kayak": ("Kayak, canoe", ("PERSON-POWERED-VESSEL-1", "OUTRIGGER-CANOE")),
        "board": ("Surf board", ("PERSON-POWERED-VESSEL-*",)),
        "jetski": ("Jet ski", ("PWC",)),
        "skiff": ("Skiff, open boat", ("SKIFF-*", "PANGA*", "WOODEN-BOAT")),
        "dinghy": ("Migrants' raft", ("RUBBER-BOAT", "REFUGEE-RAFT-*")),
        "motorboat": ("Motor boat", ("SPORT-*",)),
        "sailboat": ("Sailing boat", ("SAILBOAT-*",)),
        "fishing": ("Fishing vessel", ("FISHING-VESSEL-*",)),
        "freighter": ("Freighter", ("COASTAL-FREIGHTER",)),
        "container": ("Container", ("CONTAINER-*",)),
        "drum": ("Drum", ("OIL-DRUM",)),
        "box": ("Fish box", ("BAIT-BOX-*",)),
        "debris": ("Debris, waste", ("FV-DEBRIS", "SEWAGE", "MED-WASTE-*")),
        "buoy": ("Buoy", ("SLDMB", "SEPIRB")),
        "mine": ("Mine", ("MINE",)),
        "water": ("Water itself", ("water",)),
    }
)
OTHER = "debris"  # of classes without a picture of their own


@lru_cache
def picture_of_class(name: str) -> str:
    """Return the symbol that shows a leeway class."""
    fitting = (
        symbol
        for symbol, (_, patterns) in PICTURES.items()
        if any(fnmatchcase(name, pattern) for pattern in patterns)
    )
    return next(fitting, OTHER)
