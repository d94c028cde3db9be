"""Imprints of the pictures of a search."""

from dataclasses import replace

import numpy as np
import searches

from drift.evidence.filter.products import evidence_map
from drift.evidence.filter.updates import Update
from drift.products.maps.imprint import Imprint, Setting

# or whatever else a picture must not be believed of
WRONG = "NO ERROR of current and wind in this forecast"
IMPRINT = Imprint("A search", footer="casp-drift", attributes={"case": "x"})
COMMON = {"imprint": IMPRINT}
SETTING = Setting(IMPRINT)
CAUTIONED = replace(IMPRINT, caution=WRONG)


def one(log_evidence, before):
    update = Update(
        "u", "sortie", searches.BEGIN, np.array([*log_evidence, 0.0]), np.zeros(2), 1.0, 1.0
    )
    return evidence_map.evidence_in_words(update, np.array(before), ("a", "b"))
