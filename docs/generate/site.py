"""Have Sphinx make pages before it reads them: references from what the program itself has, a
gallery of runs.
"""

import shutil
from pathlib import Path
from typing import Any

from sphinx.util import logging

from generate import commands, files, gallery, keys, objects, runs

MADE = "generated"  # below docs/, not kept in the repository
KEPT = ("runs", "tutorials")  # there too: results, kept between builds


def setup(app: Any) -> dict[str, bool]:
    """Have the pages made before Sphinx looks for its sources."""
    app.connect("builder-inited", lambda app: write(Path(app.srcdir)))
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _changes() -> str:
    """Return the changelog, with its links as a page below docs/ has them."""
    return (runs.ROOT / "CHANGELOG.md").read_text(encoding="utf-8").replace("](docs/", "](../")


def write(docs: Path) -> None:
    """Write all generated pages below docs/generated/."""
    made = docs / MADE
    for path in made.glob("*"):
        if path.name not in KEPT:
            shutil.rmtree(path) if path.is_dir() else path.unlink()
    results = runs.make(docs, made / "runs")
    for name, text in (
        ("changes", _changes()),
        ("keys", keys.page(docs)),
        ("commands", commands.page()),
        ("python", objects.page()),
        ("files", files.page(results)),
    ):
        (made / f"{name}.md").write_text(text, encoding="utf-8")
    run = gallery.write(made / "gallery", made / "extra", results)
    written, variables = files.count(results)
    logging.getLogger(__name__).info(
        f"made: {keys.count()} keys, {len(commands.subcommands(commands.grammar.parser()))} commands, {objects.count()} Python names, "
        f"{written} files with {variables} variables and columns, {run} cases run"
    )
