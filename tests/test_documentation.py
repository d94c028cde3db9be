"""The documentation names every file that a run writes and every key of searches, and no other; its
examples are TOML.
"""

import re
import tomllib
from pathlib import Path
from typing import Any

import pytest
import searches
from generate import figures
from places import ROOT
from pydantic import BaseModel

from drift.apps.fetch import fetching
from drift.apps.sensor import chapter as reach_chapter
from drift.apps.track import chapter as regain_chapter
from drift.assess.budget import chapter as budget_chapter
from drift.assess.compare import chapter as contrast_chapter
from drift.assess.experiment import chapter as experiments_chapter
from drift.assess.score import chapter as score_chapter
from drift.assess.verify import chapter as drifters_chapter
from drift.case.scenario import scenario
from drift.case.search.barrier import BarrierTable, LineTable
from drift.case.search.contact import BearingTable, ContactTable, PlaceTable, RangeTable
from drift.case.search.drifter import DrifterTable
from drift.case.search.look import LookTable
from drift.case.search.pattern import NEEDS, PatternTable, RegionTable
from drift.case.search.plan import PlanTable, ResamplingTable, UnitTable
from drift.case.search.presence import PresenceTable
from drift.case.search.report import ReportTable
from drift.case.search.sensor import ConditionsTable, SensorTable
from drift.case.search.sortie import MarkerTable, SortieTable, WatchTable
from drift.case.sonar.processing import ProcessingTable
from drift.case.sonar.tow import TowTable
from drift.evidence.filter.products import chapter as search_chapter
from drift.evidence.posterior import chapter as posterior_chapter
from drift.evidence.posterior.quantities import QUANTITIES
from drift.evidence.suspend import chapter as suspend_chapter
from drift.forecast import by_member
from drift.forecast.products import chapter as forecast_chapter
from drift.pipeline import flow
from drift.planning.arrays import chapter as arrays_chapter
from drift.planning.arrays import processing_chapter
from drift.planning.patrols import chapter as patrols_chapter
from drift.planning.search.products import chapter as planner_chapter
from drift.planning.search.products import unit_sheet
from drift.products.files import manifest, writer
from drift.spills.backtrack import chapter as backtrack_chapter
from drift.spills.worlds.products import chapter as spill_chapter

DOCS = ROOT / "docs"
PAGES = ("searches.md", "search_keys.md")
# sections of search_keys.md, "chapter / section", and what they describe
HEADINGS: dict[str, type[BaseModel]] = {
    "[[sortie]]": SortieTable,
    "[[sortie]] / area": RegionTable,
    "[[sortie]] / pattern": PatternTable,
    "[[sortie]] / watch": WatchTable,
    "[[sortie]] / marker": MarkerTable,
    "How it sees": SensorTable,
    "How it sees / sweep_width": ConditionsTable,
    "[[contact]]": ContactTable,
    "[[contact]] / position": PlaceTable,
    "[[contact]] / bearing": BearingTable,
    "[[contact]] / range": RangeTable,
    "[[drifter]]": DrifterTable,
    "[[report]]": ReportTable,
    "[[look]]": LookTable,
    "[[presence]]": PresenceTable,
    "[[barrier]]": BarrierTable,
    "[[line]]": LineTable,
    "[[unit]]": UnitTable,
    "[[tow]]": TowTable,
    "[plan]": PlanTable,
    "[plan] / [plan.processing]": ProcessingTable,
    "[resampling]": ResamplingTable,
}
CHECKED: dict[str, type[BaseModel]] = {
    "sortie": SortieTable, "contact": ContactTable, "look": LookTable, "presence": PresenceTable,
    "barrier": BarrierTable, "line": LineTable, "unit": UnitTable, "plan": PlanTable, "resampling": ResamplingTable,
}  # fmt: skip

EVERY = {writer.SUMMARY, manifest.NAME, flow.REPORT}  # what every run writes
# by page: the files and pictures of the chapters that it describes
WRITTEN: dict[str, set[str]] = {
    "docs/files.md": {
        *EVERY, *forecast_chapter.FILES, *forecast_chapter.PICTURES, *forecast_chapter.SCENARIO_PICTURES, *suspend_chapter.FILES, *suspend_chapter.PICTURES,
        *search_chapter.FILES, *search_chapter.PICTURES, *search_chapter.MAPS,
        *search_chapter.LINE_FILES, *search_chapter.LINE_PICTURES,
        *posterior_chapter.FILES, *posterior_chapter.PICTURES, *posterior_chapter.RANKED, *posterior_chapter.MANY, *by_member.FILES,
    },
    "docs/searches.md": {*planner_chapter.FILES, *planner_chapter.PICTURES, *arrays_chapter.FILES, *arrays_chapter.PICTURES, *processing_chapter.FILES, *processing_chapter.PICTURES},
    "docs/spill.md": {
        *spill_chapter.FILES, *spill_chapter.FIND_FILES, *spill_chapter.PICTURES,
        *patrols_chapter.FILES, *patrols_chapter.LEFT_OUT_FILES, *patrols_chapter.PICTURES,
        *backtrack_chapter.FILES, *backtrack_chapter.PICTURES,
    },
    "docs/compare.md": {*contrast_chapter.FILES, *contrast_chapter.PICTURES},
    "docs/score.md": {*score_chapter.FILES, *score_chapter.PICTURES},
    "docs/budget.md": {*budget_chapter.NAMES},
    "docs/targets.md": {*reach_chapter.FILES, *reach_chapter.PICTURES},
    "docs/tracking.md": {
        *experiments_chapter.FILES, *experiments_chapter.TRACKING, *experiments_chapter.PICTURES, *regain_chapter.FILES,
        *regain_chapter.PATHS, *regain_chapter.PICTURES,
    },
    "docs/fetch.md": {fetching.TABLES, "manifest.json"},
    "docs/verify.md": {*drifters_chapter.FILES, *drifters_chapter.PICTURES},
    "docs/formats.md": {"forecast.kml", "forecast.gpx", "stretches.gpx", "patrols.gpx", "areas.geojson", "positions.geojson"}
    | {"origin.kml", "origin.gpx", "sitrep.txt", "navtex.txt"},  # of exports
}  # fmt: skip


def sections() -> dict[str, str]:
    """Return the text of search_keys.md by "chapter / section"."""
    found, chapter = {}, ""
    for part in re.split(
        r"^(?=##)", (DOCS / "search_keys.md").read_text(encoding="utf-8"), flags=re.MULTILINE
    )[1:]:
        heading, _, text = part.partition("\n")
        title = heading.lstrip("# ").replace("`", "")
        chapter = title if heading.startswith("## ") else chapter
        found[title if title == chapter else f"{chapter} / {title}"] = text
    return found


def rows(text: str, head: str) -> dict[str, list[str]]:
    """Return the rows of the table under a first heading by each name that stands in backticks in
    their first cell.
    """
    table = re.search(rf"^\| {head} \|.*\n\|[-|]+\n((?:\|.*\n)*)", text, flags=re.MULTILINE)
    assert table, f"no table headed {head}"
    cells = [
        [cell.strip() for cell in line.strip("|").split(" | ")] for line in table[1].splitlines()
    ]
    return {name: row for row in cells for name in re.findall(r"`([^`]+)`", row[0])}


def keys(table: type[BaseModel]) -> set[str]:
    """Return the keys of a table as a case file writes them."""
    return {field.alias or name for name, field in table.model_fields.items()}


def blocks(page: str) -> list[str]:
    """Return the TOML blocks of a page."""
    return re.findall(
        r"^```toml\n(.*?)^```",
        (DOCS / page).read_text(encoding="utf-8"),
        flags=re.MULTILINE | re.DOTALL,
    )


def named(page: str) -> set[str]:
    """Return the names of files without a folder that stand in backticks on a page, but for its
    blocks of code.
    """
    text = re.sub(
        r"^```.*?^```",
        "",
        (ROOT / page).read_text(encoding="utf-8"),
        flags=re.MULTILINE | re.DOTALL,
    )
    return set(re.findall(r"`([^`\s/]*\.(?:png|csv|nc|txt|geojson|gpx|kml|json|toml|html))`", text))


def test_the_table_of_files_is_what_a_run_with_sorties_writes() -> None:
    """A row for each file of a forecast, of a search and of a decision to suspend, and none for a
    file that is not written.
    """
    page = "docs/files.md"
    assert set(rows((ROOT / page).read_text(encoding="utf-8"), "file")) == WRITTEN[page]


@pytest.mark.parametrize("page", WRITTEN)
def test_every_file_is_described(page: str) -> None:
    """Where its chapter's topic is."""
    assert named(page) >= WRITTEN[page]


@pytest.mark.parametrize(
    "page", ["README.md", *(f"docs/{path.name}" for path in sorted(DOCS.glob("*.md")))]
)
def test_no_file_is_described_that_is_not_written(page: str) -> None:
    """A plan's sheets are called after its units."""
    sheets = {name for name, _, _ in unit_sheet.pages(searches.plan())}
    assert named(page) <= sheets.union(*WRITTEN.values())


@pytest.mark.parametrize("heading", HEADINGS)
def test_every_key_is_described(heading: str) -> None:
    """A row for each key of a table, and none for a key that it does not have."""
    expected = keys(HEADINGS[heading])
    # keys that they share stand in a chapter of their own
    if heading in ("[[sortie]]", "[[unit]]"):
        expected -= keys(SensorTable)
    assert set(rows(sections()[heading], "key")) == expected


def test_keys_of_a_scenario() -> None:
    """Its chapter names the keys that searches add to it, and those of survival."""
    described = rows(sections()["[[scenario]]"], "key")
    searched = {"search_object", "survival", "hazard"}
    assert set(described) == searched <= keys(scenario.ScenarioTable)
    assert keys(scenario.SurvivalTable) <= set(re.findall(r"\w+", " ".join(described["survival"])))


def test_quantities_of_posteriors() -> None:
    """The table names each quantity, and no other."""
    page = (DOCS / "targets.md").read_text(encoding="utf-8")
    assert set(rows(page, "quantity")) == {quantity.name for quantity in QUANTITIES}


def test_kinds_of_pattern() -> None:
    """The table of kinds says what each needs and may have."""
    described = rows(sections()["[[sortie]] / pattern"], "`kind`")
    found = {
        kind.strip('"'): tuple(tuple(re.findall(r"`([^`]+)`", cell)) for cell in row[1:])
        for kind, row in described.items()
    }
    assert found == NEEDS


@pytest.mark.parametrize("page", PAGES)
def test_examples_are_understood(page: str) -> None:
    """Every block is TOML, and its tables are accepted."""
    found = blocks(page)
    assert len(found) >= 3
    for block in found:
        parsed: dict[str, Any] = tomllib.loads(block)
        for name, table in CHECKED.items():
            given = parsed.get(name, [])
            for one in given if isinstance(given, list) else [given]:
                table.model_validate(one)


def test_the_table_of_benchmarks_names_each() -> None:
    """Files that are a part of others are no benchmarks."""
    own = [
        path
        for path in (ROOT / "benchmarks").glob("*.py")
        if "__main__" in path.read_text(encoding="utf-8")
    ]
    listed = rows(
        (DOCS / "performance.md").read_text(encoding="utf-8").partition("## Benchmarks")[2],
        "command",
    )
    assert {name.split()[1] for name in listed if "benchmarks/" in name} == {
        f"benchmarks/{path.name}" for path in own
    }


@pytest.mark.parametrize("page", ["performance.md", "validation.md"])
def test_every_figure_names_a_command(page: str) -> None:
    """Each row of a table that ends in commands has one, and the tests that it names are there."""
    found = [
        line
        for line in (DOCS / page).read_text(encoding="utf-8").splitlines()
        if line.startswith("| ")
    ]
    headed = False
    for line in found:
        last = line.strip("|").split(" | ")[-1].strip()
        headed = last == "command" or (headed and not re.match(r"\| (part|what|command) \|", line))
        if headed and last != "command":
            assert re.search(r"`(pytest|python|drift) ", last), line
    named = re.findall(r"tests/[\w/.]+", "\n".join(found))
    assert {name for name in named if not (ROOT / name).exists()} == set()


def test_the_speeds_are_those_that_the_benchmarks_wrote() -> None:
    """To mend it: python docs/generate/figures.py."""
    assert figures.page() == figures.PAGE.read_text(encoding="utf-8")
    assert figures.history() == figures.HISTORY.read_text(encoding="utf-8")
    held = {path.stem for path in (ROOT / "benchmarks" / "figures").iterdir()}
    assert held == set(figures.ROWS)


def test_a_worse_run_is_marked(monkeypatch: pytest.MonkeyPatch) -> None:
    """A figure a fifth worse than in the run before: more seconds, or fewer forecasts a second."""
    earlier = figures.runs("many")[-1]
    kinds = earlier["forecasts"].items()
    slower = {
        name: {**kind, "a_second": kind["a_second"] / 1.2, "processor_ms": kind["processor_ms"]}
        for name, kind in kinds
    }
    monkeypatch.setattr(figures, "runs", lambda name: [earlier, {**earlier, "forecasts": slower}])
    monkeypatch.setattr(figures, "ROWS", {"many": figures.ROWS["many"]})
    first, second = figures.history().splitlines()[-2:]
    assert first.count("**") == 0
    assert [cell.count("**") for cell in second.split("|")[4:-1]] == [2, 2, 2, 0, 0, 0]


def test_figures_beside_peers_stand_at_their_own_names(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each program's figure, told apart by its value, in the table and in the history."""
    names = ("drift, rafts", "OpenDrift, rafts", *(f"{one}, passive" for one in figures.ALL))
    told = {
        name: {"full_caches_s": 10 + k, "empty_caches_s": 20 + k, "us_a_particle_day": 30 + k}
        for k, name in enumerate(names)
    }
    size = {"particles": 4000, "hours": 36}
    about = {"day": "2026-01-01", "commit": "c", "machine": "m", "cores": 2}
    run = {**about, **size, "programs": told}
    monkeypatch.setattr(figures, "runs", lambda name: [run])
    monkeypatch.setattr(figures, "ROWS", {"peers": figures.ROWS["peers"]})
    cells = [line.split(" | ")[1] for line in figures.table().splitlines()[4:]]
    assert cells == [
        "drift 10.0 s, OpenDrift's Leeway 11.0 s",
        "drift 20.0 s, OpenDrift's Leeway 21.0 s",
        "drift 12.0 s, OpenDrift 13.0 s, Parcels 14.0 s, OceanTracker 15.0 s",
        "drift 22.0 s, OpenDrift 23.0 s, Parcels 24.0 s, OceanTracker 25.0 s",
        "drift 30 us, OpenDrift's Leeway 31 us",
        "drift 32 us, OpenDrift 33 us, Parcels 34 us, OceanTracker 35 us",
    ]
    assert figures.table().count(" of 4,000 ") == figures.table().count(" over 36 h ") == 2
    assert figures.history().splitlines()[-1].count(" | ") == 2 + 18


def test_the_readme_is_short() -> None:
    """At most 7 KB: what is longer has a page of its own."""
    assert len((ROOT / "README.md").read_bytes()) <= 7 * 1024


@pytest.mark.parametrize("page", ["README.md", "docs/index.md", "docs/explanation.md"])
def test_the_glossary_is_linked(page: str) -> None:
    assert "glossary.md)" in (ROOT / page).read_text(encoding="utf-8")


@pytest.mark.parametrize(
    "page",
    [
        "CONTRIBUTING.md",
        "README.md",
        *(f"docs/{path.relative_to(DOCS)}" for path in sorted(DOCS.rglob("*.md"))),
    ],
)
def test_benchmarks_that_are_named_are_there(page: str) -> None:
    """A page that cites a benchmark cites one that can be run."""
    named = set(re.findall(r"benchmarks/(\w+\.\w+)", (ROOT / page).read_text(encoding="utf-8")))
    assert {name for name in named if not (ROOT / "benchmarks" / name).exists()} == set()


def _anchors(page: Path) -> set[str]:
    """The names under which the site has the headings of a page."""
    text = re.sub(r"(?ms)^```.*?^```", "", page.read_text(encoding="utf-8"))
    headings = (
        re.sub(r"\[(.*?)\]\(.*?\)", r"\1", line) for line in re.findall(r"(?m)^#+ (.*)$", text)
    )
    return {re.sub(r"[^\w\- ]", "", line.lower()).replace(" ", "-") for line in headings}


def test_links_lead_to_headings() -> None:
    """A heading that is renamed takes the links to it along."""
    written = (path for path in DOCS.rglob("*.md") if DOCS / "generated" not in path.parents)
    pages = {path.resolve() for path in [ROOT / "README.md", *written]}
    links = [
        (page, (page.parent / target).resolve() if target else page, heading)
        for page in pages
        for target, heading in re.findall(
            r"\]\(([^)#\s:]*)#([^)\s]+)\)", page.read_text(encoding="utf-8")
        )
    ]
    lost = [link for link in links if link[1] in pages and link[2] not in _anchors(link[1])]
    assert len(links) > 100
    assert lost == []


def test_faults_of_the_mutants_stand_where_they_say() -> None:
    """Each once in its file, and its tests are there: a move of code once left a benchmark that
    could not start.
    """
    faults = tomllib.loads((ROOT / "benchmarks" / "mutants.toml").read_text(encoding="utf-8"))[
        "mutant"
    ]
    for fault in faults:
        own = ROOT / fault["file"]
        assert own.exists(), fault
        assert own.read_text(encoding="utf-8").count(fault["find"]) == 1, fault
        assert all((ROOT / "tests" / name).exists() for name in fault["tests"]), fault
