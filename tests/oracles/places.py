"""Where things lie that tests read: this checkout, and the folder of real forcing files, which may
not be there.
"""

import os
from pathlib import Path

ROOT = Path(__file__).parents[2]
# the folders of what tests share, for the path of another process
HELPERS = [Path(__file__).parent, *sorted(Path(__file__).parent.glob("[a-z]*/"))]
DATA = Path(os.environ.get("DRIFT_DATA") or ROOT.parent / "shared" / "data")
