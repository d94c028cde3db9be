"""How the documentation is built: sphinx-build -W docs build/site."""

import sys
from importlib.metadata import version as of
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

made = Path(__file__).parent / "generated" / "extra"  # reports of the gallery, beside the pages
made.mkdir(parents=True, exist_ok=True)

project = "casp-drift"
copyright = "the casp-drift contributors"
version = release = of("casp-drift")

extensions = ["myst_parser", "generate.site"]
exclude_patterns = ["generate", "generated/runs", "generated/tutorials", "generated/extra"]
nitpicky = True
# types of other projects, and of our own that are not public
nitpick_ignore_regex = [("py:class", ".*")]
myst_heading_anchors = 4
myst_enable_extensions = ["attrs_inline", "colon_fence", "deflist"]
highlight_language = "text"
smartquotes = False  # what is quoted is typed

html_theme = "furo"
html_title = "casp-drift"
html_extra_path = ["generated/extra"]
html_copy_source = False
