"""Notebooks, in a real kernel: that of the documentation with what its cells show, progress, and
many runs in one kernel.
"""

import re
from io import StringIO
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pandas
import pytest
from places import ROOT

nbclient = pytest.importorskip("nbclient", reason="needs the extra `notebook`")
nbformat = pytest.importorskip("nbformat", reason="needs the extra `notebook`")
pytestmark = [pytest.mark.documentation, pytest.mark.timeout(1800)]

SMALL = """
title = "small"
start = "160600ZNOV15"
duration = "6 h"
particles = 2000
[[current]]
constant = { speed = "0.8 kn", toward = 75 }
[[wind]]
constant = { speed = "12 kn", from = 250 }
[uncertainty]
current = { std = "0.2 m/s", time = "5 h" }
wind = { std = "1.5 m/s", time = "6 h" }
[[scenario]]
name = "raft"
object = "LIFE-RAFT-DB-11"
position = { at = [10.0, 40.0], error = "3 nmi" }
"""
SIZES = (5_000, 200_000, 20_000, 100_000, 50_000)  # particles of the runs, in turn
A_PARTICLE = 96  # [bytes] of its columns (docs/performance.md)


class Told(nbclient.NotebookClient):  # type: ignore[misc, name-defined] - nbclient's own way to see messages
    """A client that keeps every HTML that a cell shows or replaces."""

    def process_message(self, msg: Any, cell: Any, cell_index: int) -> Any:
        """Keep what is shown, then do as ever."""
        if "data" in msg["content"]:
            self.told = [*getattr(self, "told", []), msg["content"]["data"].get("text/html", "")]
        return super().process_message(msg, cell, cell_index)


def executed(notebook: Any, folder: Any) -> Told:
    client = Told(
        notebook, timeout=600, kernel_name="python3", resources={"metadata": {"path": str(folder)}}
    )
    client.execute()
    return client


def shown(cell: Any, kind: str) -> str:
    """Return what a cell shows of a kind, all of its outputs together; fail if it warned."""
    assert not [output for output in cell.outputs if output.get("name") == "stderr"], cell.outputs
    return "".join(output.data.get(kind, "") for output in cell.outputs if "data" in output)


def framed(cell: Any) -> pandas.DataFrame:
    """Return the table that a cell shows, its numbers as numbers."""
    page = shown(cell, "text/html")
    table = ElementTree.fromstring(page[page.index("<table") : page.index("</table>") + 8])
    head, *rows = ([found.text or "" for found in row] for row in table.iter("tr"))
    return pandas.read_csv(StringIO(pandas.DataFrame(rows, columns=head).to_csv(index=False)))


def test_the_notebook_of_the_documentation(tmp_path: Any) -> None:
    notebook = nbformat.read(ROOT / "docs" / "notebooks" / "search.ipynb", 4)
    nbformat.validate(notebook)
    assert not any(cell.get("outputs") for cell in notebook.cells), (
        "outputs are not kept in the repository"
    )
    client = executed(notebook, tmp_path)
    check, result, track, sorties, areas, plot, total, several = (
        c for c in notebook.cells if c.cell_type == "code"
    )
    assert "leeway" in shown(check, "text/plain") or "scenario" in shown(check, "text/plain")
    page = shown(result, "text/html")
    assert "<h4>Overdue boat" in page
    assert "SYNTHETIC" in page
    assert "data:image/png;base64," in page
    assert "<progress" not in page  # nothing of it stays
    phases = {found[1] for text in client.told if (found := re.search(r"</progress> (\w+)", text))}
    assert {"read", "drift", "map"} <= phases
    shares = [
        float(found[1])
        for text in client.told
        if (found := re.search(r"value='([\d.]+)'></progress> drift", text))
    ]
    assert shares == sorted(shares)
    table = framed(track)
    assert len(table) == 3
    assert (table["area_95_nmi2"] > table["area_50_nmi2"]).all()
    table = framed(sorties)
    assert table["name"].iloc[0] == "MH-60 along the track"
    assert len(table) == 6
    # six digits as shown
    np.testing.assert_allclose(table["poc"] * table["pod"], table["pos"], rtol=0.01)
    table = framed(areas)
    assert list(table["share"]) == [0.5, 0.75, 0.95]
    assert table["geometry"].str.startswith("MULTIPOLYGON").all()
    assert shown(plot, "image/png")
    assert 0.9 < float(shown(total, "text/plain")) <= 1 + 1e-6
    table = framed(several)
    assert table["50 % area, nmi²"].is_monotonic_increasing  # larger errors, larger areas


def test_twenty_runs_in_one_kernel_keep_no_memory(tmp_path: Any) -> None:
    """Ten runs after the first ten take no more memory than the particles of one: a run that kept
    its own would keep ten.
    """
    (tmp_path / "case.toml").write_text(SMALL, encoding="utf-8")
    cell = nbformat.v4.new_code_cell(f"""
import drift, gc, psutil
case, used = drift.load("case.toml"), []
for k in range(20):
    result = drift.run(drift.vary(case, {{"particles": {SIZES}[k % {len(SIZES)}], "seed": k}}))
    result._repr_html_()
    gc.collect()  # pictures of Matplotlib hold themselves in circles
    used.append(psutil.Process().memory_info().rss)
used""")
    notebook = nbformat.v4.new_notebook(cells=[cell])
    executed(notebook, tmp_path)
    used = np.array(re.findall(r"\d+", shown(cell, "text/plain")), float)
    assert used.size == 20
    assert used[10:].max() - used[:10].max() < A_PARTICLE * max(SIZES)


def test_progress_of_a_run_that_fails_goes_too(tmp_path: Any) -> None:
    cell = nbformat.v4.new_code_cell("""
import drift
try:
    with drift.progress() as report:
        report("<b>drift</b>", 0.25)
        1 / 0
except ZeroDivisionError:
    print("over")""")
    notebook = nbformat.v4.new_notebook(cells=[cell])
    client = executed(notebook, tmp_path)
    assert "<progress value='0.250'></progress> &lt;b&gt;drift&lt;/b&gt;" in client.told
    assert shown(cell, "text/html") == ""
