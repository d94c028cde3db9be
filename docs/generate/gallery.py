"""The gallery: what each shipped case looks like when it is run, its text, the command, and its
report.
"""

import re
import shutil
from collections.abc import Mapping
from pathlib import Path

from drift.case import file as case_file
from generate import runs

PICTURES = (
    "map.png",
    "washup.png",
    "search.png",
    "evidence.png",
    "posteriors.png",
    "suspend.png",
    "snapshots.png",
)
CAPTIONS = {
    "map.png": "Where it may be, when it matters",
    "washup.png": "What comes ashore where",
    "search.png": "The sorties, one by one",
    "evidence.png": "What each sortie showed",
    "posteriors.png": "Posteriors besides position",
    "suspend.png": "Suspend?",
    "snapshots.png": "The same at each output",
    "plan.png": "The next search",
    "plan-A-1.png": "The sheet of a unit",
}


def about() -> dict[str, str]:
    """Return the description of each shipped case, from its page."""
    text = (runs.ROOT / "docs" / "cases.md").read_text(encoding="utf-8")
    table = re.search(r"^\| case \| what \|\n\|[-|]+\n((?:\|.*\n)*)", text, flags=re.MULTILINE)
    assert table, "docs/cases.md has no table of shipped cases"
    found = {}
    for line in table[1].splitlines():
        names, what = (cell.strip() for cell in line.strip("|").split(" | "))
        found |= dict.fromkeys(re.findall(r"`([^`]+)`", names), what)
    return found


def write(folder: Path, extra: Path, results: Mapping[str, Path]) -> int:
    """Write the pages of the gallery, and the reports beside the site; return the number of cases
    that were run.
    """
    folder.mkdir(parents=True)
    (extra / "reports").mkdir(parents=True)
    titles, said = dict(case_file.shipped()), about()
    cards = []
    for case, title in sorted(
        titles.items(), key=lambda one: (one[0] not in results, one[0] != "overdue_boat")
    ):
        shown = case in results
        (folder / f"{case}.md").write_text(
            _page(case, title, said[case], folder, extra, results), encoding="utf-8"
        )
        picture = "washup.png" if shown and (results[case] / "washup.png").exists() else "map.png"
        image = f"[![{title}]({case}-{picture})]({case}.md)\n\n" if shown else ""
        cards.append(f"## {title}\n\n{image}[`{case}`]({case}.md): {said[case]}.\n")
    note = (
        f"The shipped cases, run when these pages were built, with {runs.PARTICLES:,} particles each (spills: 1,000 worlds of 60) so that a build takes minutes: areas are "
        "rougher than those of the full cases. Winds and currents are synthetic where the title says so. `drift cases` lists them; `drift run NAME` runs one."
    )
    (folder / "index.md").write_text(
        "# Gallery\n\n"
        + note
        + "\n\n```{toctree}\n:hidden:\n\n"
        + "\n".join(titles)
        + "\n```\n\n"
        + "\n".join(cards),
        encoding="utf-8",
    )
    return sum(case in results for case in titles)


def _page(
    case: str, title: str, said: str, folder: Path, extra: Path, results: Mapping[str, Path]
) -> str:
    text = (runs.ROOT / "cases" / f"{case}.toml").read_text(encoding="utf-8")
    parts = [f"# {title}", f"`{case}`: {said}."]
    if case not in results:
        parts.append(
            "Its winds and currents are real ones, from files that do not come along: it is run where `DRIFT_DATA` names their folder."
        )
    own = [one for one in runs.every() if one.name == case or one.name.startswith(f"{case}-")]
    for one in sorted(own, key=lambda one: one.name):  # the forecast before the plan
        parts += _shown(one, folder, extra, results[one.name])
    parts += ["## The case", f"```toml\n{text.strip()}\n```"]
    return "\n\n".join(parts) + "\n"


def _shown(one: runs.Run, folder: Path, extra: Path, result: Path) -> list[str]:
    printed = (result.parent / f"{result.name}.txt").read_text(encoding="utf-8").strip()
    printed = re.sub(r"\n[^\n]* in results/.*", "", printed)
    parts = [f"## `drift {one.words[0]}`", f"```console\n$ {one.command}\n{printed}\n```"]
    if (result / "report.html").exists():
        shutil.copyfile(result / "report.html", extra / "reports" / f"{one.name}.html")
        parts.append(
            f'<p><a href="../../reports/{one.name}.html">Open its report</a>: the map that moves through time, the layers and the tables, in one file.</p>'
        )
    own = ("plan.png", "plan-A-1.png") if one.words[0] == "plan" else PICTURES
    for picture in own:
        if (result / picture).exists():
            shutil.copyfile(result / picture, folder / f"{one.name}-{picture}")
            parts.append(f"![{CAPTIONS[picture]}]({one.name}-{picture})\n\n*{CAPTIONS[picture]}*")
    return parts
