"""What all tests share: Taichi on two threads, the order of tests, where real data may lie, and a
browser.
"""

import gc
import os
import shutil
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Any

import hypothesis
import numpy as np
import pytest
from hypothesis.internal.conjecture import providers
from one_thread import Process
from PIL import Image
from PIL.PngImagePlugin import PngInfo
from places import DATA

TESTS = Path(__file__).parent
SMALL_MAPS = (
    "apps/cli",
    "assess/experiment",
    "engine/environment",
    "engine/motion",
    "evidence/filter",
    "evidence/posterior",
    "evidence/suspend",
    "pipeline/shards",
    "planning/patrols",
    "planning/search",
    "spills/backtrack",
    "spills/worlds",
)


LAID_OUT = {
    "apps/check",
    "apps/export",
    "apps/sensor",
    "assess/budget",
    "assess/compare",
    "assess/score",
    "assess/verify",
    "case",
    "geo/files",
    *SMALL_MAPS,
} - {"assess/experiment"}


# Folders whose tests compile many kernels, those that compile the same ones side by side. They come
# first, so that one worker runs most of them: two would compile each kernel twice.
MANY_KERNELS = (
    "engine/motion/steering",
    "kernels/steering",
    "evidence/filter",
    "engine",
    "pipeline",
    "kernels/step",
    "kernels/evidence",
    "evidence/posterior",
    "evidence/suspend",
    "assess",
    "apps/export",
    "apps/track",
    "tracking",
    "apps/check",
    "spills",
)
LONG = ("test_cases.py", "test_flow.py", "test_many.py", "test_result.py", "test_steering_cases.py")


def pytest_configure(config: pytest.Config) -> None:
    """Start Taichi, and set Hypothesis; a process that only hands tests to workers needs neither.

    No test reads the clock, what one finds it finds each time, and nothing is left in the folder.
    Hypothesis would also look for constants in all modules that are imported, which takes seconds,
    and draw some of these: its examples would depend on what else runs.
    """
    worker = getattr(config, "workerinput", None)
    if worker is None and getattr(config.option, "numprocesses", None):
        return
    from kernels.runtime import runtime

    runtime.start("cpu", threads=2)
    hypothesis.settings.register_profile("suite", deadline=None, derandomize=True, database=None)
    hypothesis.settings.load_profile("suite")
    providers._get_local_constants = lambda: providers._local_constants
    if worker is not None and int(worker["workerid"].removeprefix("gw")) % 2:
        config.args = [each for arg in config.args for each in _from_the_end(arg)]


def _from_the_end(arg: str) -> list[str]:
    """Return what a folder of tests holds, the last first, for every second worker to read.

    Where nothing has been compiled to bytecode, workers that begin at the same file compile all
    files side by side; from two ends, each compiles half of them for the other.
    """
    if not Path(arg).is_dir():
        return [arg]
    inside = sorted(Path(arg).iterdir(), reverse=True)
    return [str(each) for each in inside if each.is_dir() or each.match("test_*.py")]


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Give the tests one order, by files, in whichever order they were read."""
    items.sort(key=lambda item: _place(item.path))


def _place(path: Path) -> tuple[int, str]:
    """Return what a file of tests is sorted by: the rank of its folder, and its path."""
    name = path.relative_to(TESTS).as_posix()
    ranked = (k for k, folder in enumerate(MANY_KERNELS) if name.startswith(f"{folder}/"))
    return (-1 if name in LONG else next(ranked, len(MANY_KERNELS))), name


def pytest_collection_finish() -> None:
    """Leave what is imported and collected out of the collector's sight: to look through it takes
    0.2 s each time.
    """
    gc.collect()
    gc.freeze()


@pytest.hookimpl(trylast=True)
def pytest_unconfigure() -> None:
    """Have Taichi keep what it has compiled: a worker of pytest-xdist ends without the exit at
    which it would.
    """
    if "taichi" in sys.modules:  # after kernels, which keeps it quiet
        sys.modules["taichi"].reset()


@pytest.fixture(scope="session")
def data() -> Path:
    """The folder of real forcing files:

    DRIFT_DATA, or shared/data beside the checkout; skipped where absent.
    """
    if not DATA.is_dir():
        pytest.skip(f"no real data: {DATA} is not there; set DRIFT_DATA")
    return DATA.resolve()


@pytest.fixture(scope="session")
def one_thread() -> Iterator[Process]:
    """A process of one thread, for what has to have the same bits as with the two of the tests."""
    process = Process()
    yield process
    process.end()


@pytest.fixture(scope="module")
def states_of_generators(request: pytest.FixtureRequest) -> list[tuple[np.random.Generator, Any]]:
    """The random generators of a test module, each with its state before the first test."""
    held = vars(request.module).values()
    generators = [value for value in held if isinstance(value, np.random.Generator)]
    return [(generator, generator.bit_generator.state) for generator in generators]


@pytest.fixture(autouse=True)
def same_numbers_in_any_order(
    states_of_generators: list[tuple[np.random.Generator, Any]],
) -> None:
    """Give each test the first numbers of its module's generators, whatever ran before it."""
    for generator, state in states_of_generators:
        generator.bit_generator.state = state


@contextmanager
def _coarse() -> Iterator[None]:
    from drift.forecast import build  # not before a test asks for it

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(build, "ACROSS", 120)
        patch.setattr(build, "ACROSS_ONE", 240)
        yield


@pytest.fixture(scope="module")
def coarse_maps() -> Iterator[None]:
    """Make maps of a tenth of the cells, in the same way: for tests that read no number off a map.

    Maps are most of the time of a small run.
    """
    with _coarse():
        yield


@pytest.fixture(scope="module", autouse=True)
def small_maps(request: pytest.FixtureRequest) -> None:
    """Make small maps in the folders whose tests read no number off one; a module that does has a
    fixture of this name, which does nothing.
    """
    folder = request.path.parent.relative_to(TESTS)
    if any(folder.is_relative_to(one) for one in SMALL_MAPS):
        request.getfixturevalue("coarse_maps")


def _lay_out(
    canvas: Any, path: Path, title: str, attributes: Mapping[str, str] | None, dpi: int
) -> None:
    """Write one white point with the texts of a picture, as `page.save` would write the picture."""
    texts = PngInfo()
    for name, text in {"Title": title, "Software": "casp-drift", **(attributes or {})}.items():
        texts.add_text(name, text)
    Image.new("L", (1, 1), 255).save(path, "png", pnginfo=texts)


@contextmanager
def _laid_out() -> Iterator[Callable[..., None]]:
    # not for tests that draw nothing: Matplotlib takes long to import
    from drift.products.maps import page

    with pytest.MonkeyPatch.context() as patch:
        paint = page.save
        patch.setattr(page, "save", _lay_out)
        yield paint


@pytest.fixture(scope="session")
def small() -> Callable[[], AbstractContextManager[None]]:
    """What a run of a whole session, which begins before the fixtures of its module, is made in:
    small maps, and pictures that are laid out.
    """

    @contextmanager
    def both() -> Iterator[None]:
        with _coarse(), _laid_out():
            yield

    return both


@pytest.fixture(scope="module", autouse=True)
def pictures_laid_out(request: pytest.FixtureRequest) -> Iterator[Callable[..., None] | None]:
    """Lay out the pictures of runs, and paint none, in modules of LAID_OUT that look at none.

    All of our code runs. To paint, which Matplotlib does, is half of the time of a small run that
    writes files. A module looks at pictures where it names some, or compares all files of runs. One
    that only names them, or lies in another folder and looks at none, says PAINTS = False; a test
    of it that looks at some asks for `painted`.
    """
    folder = request.path.parent.relative_to(TESTS)
    source = request.path.read_text(encoding="utf-8")
    looks = ".png" in source or "same_files" in source
    elsewhere = not any(folder.is_relative_to(one) for one in LAID_OUT)
    if getattr(request.module, "PAINTS", looks or elsewhere):
        yield None
        return
    with _laid_out() as paint:
        yield paint


@pytest.fixture
def painted(pictures_laid_out: Callable[..., None] | None, monkeypatch: pytest.MonkeyPatch) -> None:
    """Paint the pictures of one test."""
    from drift.products.maps import page

    if pictures_laid_out is not None:
        monkeypatch.setattr(page, "save", pictures_laid_out)


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """Chromium without a window, by Playwright; where it is absent CI fails and others skip."""
    chromium = next(
        filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None
    )
    if chromium is None and not os.environ.get("CI"):
        pytest.skip("no Chromium is installed")
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        started = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        yield started
        started.close()
