"""Have Sphinx make pages before it reads them: references from what the program itself has, a
gallery of runs.
"""

import shutil
from pathlib import Path
from typing import Any

from sphinx.errors import ConfigError
from sphinx.util import logging

from generate import commands, faults, files, gallery, keys, objects, runs

MADE = "generated"  # below docs/, not kept in the repository
LOG = logging.getLogger(__name__)
KEPT = ("runs", "tutorials")  # there too: results, kept between builds


# what one page alone does not have: its neighbours, and pictures of runs
NOT_ALONE = ["myst.xref_missing", "toc.not_readable", "image.not_readable", "ref", "download"]


def setup(app: Any) -> dict[str, bool]:
    """Have the pages made before Sphinx looks for its sources.

    `sphinx-build -D only=howto/model docs build/page` builds docs/howto/model.md alone, and runs
    nothing.
    """
    app.add_config_value("only", "", "env", str)
    app.connect("config-inited", _only)
    app.connect("builder-inited", _make)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _only(app: Any, config: Any) -> None:
    if not config.only:
        return
    if not (Path(app.srcdir) / f"{config.only}.md").is_file():
        raise ConfigError(
            f'only: there is no page docs/{config.only}.md; write for example "howto/model"'
        )
    config.root_doc = config.only
    config.include_patterns = [f"{config.only}.md"]
    config.suppress_warnings = [*config.suppress_warnings, *NOT_ALONE]


def _make(app: Any) -> None:
    if not app.config.only:
        write(Path(app.srcdir))


def _changes() -> str:
    """Return the changelog, with its links as a page below docs/ has them."""
    return (runs.ROOT / "CHANGELOG.md").read_text(encoding="utf-8").replace("](docs/", "](../")


def _run(docs: Path, folder: Path) -> None:
    """Run the cases that the pages show, and say so: it takes minutes."""
    for last, left in runs.make(docs, folder):
        if last:
            LOG.info(f"ran {last}; {left} left")
        elif left:
            LOG.info(
                f"running {left} cases and tutorials whose results the pages show: some minutes on two "
                "cores, once; what is run is kept until the program or a case changes. "
                "One page without runs: sphinx-build -D only=howto/model docs build/page"
            )


def write(docs: Path) -> None:
    """Write all generated pages below docs/generated/."""
    made = docs / MADE
    for path in made.glob("*"):
        if path.name not in KEPT:
            shutil.rmtree(path) if path.is_dir() else path.unlink()
    _run(docs, made / "runs")
    results = runs.results(made / "runs")
    for name, text in (
        ("changes", _changes()),
        ("keys", keys.page(docs)),
        ("commands", commands.page()),
        ("python", objects.page()),
        ("faults", faults.page()),
        ("files", files.page(results)),
    ):
        (made / f"{name}.md").write_text(text, encoding="utf-8")
    run = gallery.write(made / "gallery", made / "extra", results)
    written, variables = files.count(results)
    LOG.info(
        f"made: {keys.count()} keys, {len(commands.subcommands(commands.grammar.parser()))} commands, {objects.count()} Python names, "
        f"{written} files with {variables} variables and columns, {run} cases run"
    )
