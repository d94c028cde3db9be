"""What the tests of drift serve share: a server with a folder of harmless and hostile files."""

import os
import shutil
from collections.abc import Iterator

import pytest
import small_case
from desks import NASTY, Server, finished


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    outer = tmp_path_factory.mktemp("outer")
    folder = outer / "folder"
    folder.mkdir()
    (outer / "secret.toml").write_text('title = "secret"', encoding="utf-8")
    (folder / "case.toml").write_text(small_case.STEADY, encoding="utf-8")
    (folder / "nasty.toml").write_text(f'title = "{NASTY}"', encoding="utf-8")
    (folder / ".hidden.toml").write_text("title = 1", encoding="utf-8")
    (folder / "link.toml").symlink_to(outer / "secret.toml")
    os.mkfifo(folder / "pipe.toml")  # who opens it waits for one who writes
    (folder / "folder.toml").mkdir()
    finished(folder / "done", NASTY, a_txt="words", b_html="<script>alert(1)</script>", c_nc="x")
    (folder / "done" / "extra.txt").write_text("no manifest names it", encoding="utf-8")
    finished(folder / "half")
    (folder / "half" / "report.html").unlink()
    finished(outer / "elsewhere")
    (folder / "linked").symlink_to(outer / "elsewhere")
    with Server(folder.resolve()) as one:
        yield one


@pytest.fixture
def served(running: Server) -> Iterator[Server]:
    """The server; what a test leaves in its folder is removed."""
    before = set(running.folder.iterdir())
    yield running
    for path in set(running.folder.iterdir()) - before:
        shutil.rmtree(path) if path.is_dir() and not path.is_symlink() else path.unlink()
