"""The decision to suspend: survival and searches against Bayes by hand, and the days ahead."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.container import ErrorbarContainer
from scipy import integrate, stats

import drift
from drift.apps.check import check
from drift.case.scenario import survival
from drift.evidence.suspend import decision, further
from drift.evidence.suspend import map as suspend_map
from drift.evidence.suspend import text as suspend_text
from drift.pipeline import flow
from drift.products.files import text_sheet
from drift.products.maps import page
from drift.products.maps.imprint import Imprint
from geo import notation
from geo.errors import UserError

PAINTS = False  # but for one test
CASE = """
title = "Two stories"
start = "2026-06-01T06:00Z"
duration = "30 h"
particles = {particles}
[output]
every = "6 h"
[clock]
step = "1 h"
[coast]
source = "none"
[[current]]
constant = {{ speed = "0 kn", toward = 70 }}
[uncertainty]
diffusivity = 0
[[scenario]]
name = "swimmer"
weight = 0.6
object = "water"
area = {{ polygon = [[-20.0, 45.0], [-19.0, 45.0], [-19.0, 45.4], [-20.0, 45.4]], until = "+4 h" }}
survival = {{ water = "11 degC", clothing = "light", spread = 3 }}
[[scenario]]
name = "raft"
weight = 0.4
object = "water"
area = {{ polygon = [[-20.0, 45.0], [-19.0, 45.0], [-19.0, 45.4], [-20.0, 45.4]], until = "+2 h" }}
survival = {{ median = "20 h", spread = 1.7 }}
[[sortie]]
name = "western third"
start = "+6 h"
end = "+7 h"
area = {{ polygon = [[-20.0, 44.9], [-19.6667, 44.9], [-19.6667, 45.5], [-20.0, 45.5]] }}
pod = {{ swimmer = 0.5, raft = 0.8 }}
law = "definite_range"
{more}
"""


def run(folder: Path, particles: int = 20_000, more: str = "", out: bool = False) -> drift.Result:
    path = folder / "case.toml"
    path.write_text(CASE.format(particles=particles, more=more))
    return drift.run(drift.load(path), out=folder / "out" if out else None)


@pytest.mark.parametrize(
    ("water", "minutes"), [(5.0, 132.0732), (10.0, 176.7978), (15.0, 276.8182), (18.0, 431.1850)]
)
def test_the_regression_is_as_published(water: float, minutes: float) -> None:
    """15 + 7.2 / (0.0785 - 0.0034 T) by hand; at 10 degC its authors' leaflet has 2 1/2 to 3 hours
    (Hayward et al. 1976).
    """
    assert survival.immersed(water) / 60 == pytest.approx(minutes, abs=5e-5)
    if water == 10:
        assert 2.5 < minutes / 60 < 3


@pytest.mark.parametrize("text", ["11 degC", "51.8 degF", "284.15 K", "11 °C"])
def test_temperatures_in_any_unit(text: str) -> None:
    assert survival.celsius(text) == pytest.approx(11.0, abs=1e-9)


WRONG = {
    "too warm": ('{ water = "22 degC", clothing = "light" }', "4.6 to 18.2 degC"),
    "too cold": ('{ water = "1 degC", clothing = "light" }', "is 1.0 degC"),
    "no unit": ('{ water = 12, clothing = "light" }', "its unit"),
    "not a temperature": ('{ water = "12 m", clothing = "light" }', "is not a temperature"),
    "no clothing": ('{ water = "12 degC" }', "clothing is missing"),
    "another clothing": (
        '{ water = "12 degC", clothing = "dry suit" }',
        "give median and spread instead",
    ),
    "two ways": (
        '{ water = "12 degC", clothing = "light", median = "3 h" }',
        "exactly one of median, water",
    ),
    "neither": ("{ spread = 2 }", "exactly one of median, water"),
    "clothing of a median": ('{ median = "3 h", clothing = "light" }', "clothing belongs to water"),
}


@pytest.mark.parametrize("kind", WRONG)
def test_what_is_wrong_is_said_in_one_line(kind: str, tmp_path: Path) -> None:
    given, word = WRONG[kind]
    path = tmp_path / "case.toml"
    whole = CASE.format(particles=100, more="")
    path.write_text(whole.replace('{ median = "20 h", spread = 1.7 }', given))
    with pytest.raises(UserError) as refused:
        drift.load(path)
    lines = refused.value.lines
    assert len(lines) == 1
    assert 'scenario "raft".survival' in lines[0]
    assert word in lines[0]


def test_check_says_what_survival_was_understood(tmp_path: Path) -> None:
    path = tmp_path / "case.toml"
    path.write_text(CASE.format(particles=100, more=""))
    understood = check.check(drift.load(path))
    assert (
        "alive: median 3.17 h, 68 % between 1/3 and 3 times that (Hayward"
        in understood['scenario "swimmer"']
    )
    assert "alive: median 20 h, 68 % between 1/1.7" in understood['scenario "raft"']


def chance_alive(median: float, spread: float, window: float, time: float) -> float:
    """Return the chance of being alive at a time of who went adrift uniformly within a window [h],
    by quadrature.
    """
    log = np.log
    value = integrate.quad(
        lambda r: stats.norm.sf(log((time - r) / median) / log(spread)),
        0,
        window,
        epsabs=1e-12,
        limit=200,
    )[0]
    return value / window


SOUTH = """
[[sortie]]
name = "south"
start = "+8 h"
end = "+9 h"
area = { polygon = [[-20.1, 44.9], [-18.9, 44.9], [-18.9, 45.15], [-20.1, 45.15]] }
pod = { swimmer = 0.7, raft = 0.4 }
law = "definite_range"
"""


@pytest.mark.thorough
@pytest.mark.parametrize("more", ["", "[resampling]\nbelow = 0.999\n"])
def test_alive_and_never_searched_are_those_of_bayes_by_hand(tmp_path: Path, more: str) -> None:
    """A uniform prior at rest, its west searched, then its south: posterior and alive in closed
    form, by scenario and of all.
    """
    result = run(tmp_path, more=SOUTH + more)
    suspension = flow.suspension_basis(result)
    assert suspension is not None
    share, pod, west = np.array([0.6, 0.4]), np.array([[0.5, 0.8], [0.7, 0.4]]), 0.33330
    low, middle, high = np.sin(np.radians([45.0, 45.15, 45.4]))
    # great circles for its edges bulge by under 0.3 % of its height
    south = (middle - low) / (high - low)
    missed = (1 - west * pod[0]) * (1 - south * pod[1])
    posterior = share * missed / (share @ missed)
    never = (1 - west) * (1 - south) / missed
    # Three standard deviations of a share, of which each is at most 1/2.
    error = 3 / np.sqrt(suspension.effective * np.array([*(0.8 * posterior), 1.0]))
    assert np.abs(suspension.share - posterior).max() < error[-1] / 2
    assert (np.abs(suspension.never - [*never, posterior @ never]) < error / 2).all()
    assert (np.abs(suspension.cumulative - [*(1 - missed), 1 - share @ missed]) < error / 2).all()
    assert suspension.now == np.datetime64("2026-06-01T15:00")
    median = [(15 + 7.2 / (0.0785 - 0.0034 * 11)) / 60, 20.0]
    for time, alive, alive_error in suspension.ahead:
        age = float((time - np.datetime64("2026-06-01T06:00")) / np.timedelta64(1, "h"))
        each = np.array(
            [
                chance_alive(m, s, w, age)
                for m, s, w in zip(median, (3, 1.7), (4.0, 2.0), strict=True)
            ]
        )
        # of bins of 36 s: see standing.WITHIN
        assert (np.abs(alive[:-1] - each) <= 3 * alive_error[:-1] + 1e-5).all()
        assert abs(alive[-1] - posterior @ each) <= 3 * alive_error[-1] + 1e-5
    later = [alive[-1] for _, alive, _ in suspension.ahead]
    assert (np.diff(later) < 0).all()
    assert later[-1] >= further.GONE


@pytest.mark.thorough
@pytest.mark.parametrize("distress", ["", 'distress = { rate = "0.02/h" }'])
def test_who_never_goes_adrift_does_not_blur_when_others_did(tmp_path: Path, distress: str) -> None:
    """A yacht that is under way throughout, or goes adrift weeks after the run: the others' chances
    are what they were.
    """
    late = f"""
[[scenario]]
name = "late"
weight = 0.5
{distress and 'object = "water"'}
{distress and 'survival = { median = "20 h", spread = 1.7 }'}
{distress}
[[scenario.phase]]
[scenario.phase.voyage]
waypoints = [[-17.0, 45.5], [-10.0, 46.5]]
departure = "+0 h"
speed = "5 kn"
"""
    path = tmp_path / "case.toml"
    path.write_text(
        CASE.format(particles=20_000, more=late).replace("raft = 0.8 }", "raft = 0.8, late = 0 }")
    )
    suspension = flow.suspension_basis(drift.run(drift.load(path)))
    assert suspension is not None
    median = [(15 + 7.2 / (0.0785 - 0.0034 * 11)) / 60, 20.0]
    binned = (
        1e-5 * (30 / 4 if distress else 1) ** 2
    )  # an error of second order in the bins' width: 36 s in a window of 4 h
    for time, alive, error in suspension.ahead:
        age = float((time - np.datetime64("2026-06-01T06:00")) / np.timedelta64(1, "h"))
        each = np.array(
            [
                chance_alive(m, s, w, age)
                for m, s, w in zip(median, (3, 1.7), (4.0, 2.0), strict=True)
            ]
        )
        assert (np.abs(alive[:2] - each) <= 3 * error[:2] + binned).all()
        if not distress:
            assert alive[2] == 1.0
        elif age <= 35:
            # until the yacht is there: distress at a constant rate, then a lognormal time
            t = np.linspace(0, age, 20_001)[:-1] + age / 40_000
            lost = (
                (
                    0.02
                    * np.exp(-0.02 * t)
                    * stats.norm.cdf(np.log((age - t) / 20.0) / np.log(1.7))
                ).sum()
                * age
                / 20_000
            )
            assert abs(alive[2] - (1 - lost)) <= 3 * error[2] + binned


@pytest.fixture(scope="module")
def small(
    tmp_path_factory: pytest.TempPathFactory,
) -> tuple[drift.Result, decision.Suspension, Path]:
    """A run of few particles, the decision by it, and the folder of its files."""
    folder = tmp_path_factory.mktemp("small")
    result = run(folder, particles=1000, out=True)
    told = flow.suspension_basis(result)
    assert told is not None
    return result, told, folder / "out"


@pytest.mark.thorough
def test_a_day_like_the_last_one(small: tuple[drift.Result, decision.Suspension, Path]) -> None:
    """What is swept is W v t; a uniform area holds what random search of it finds, the searched
    third less.
    """
    result, suspension, out = small
    sorties = result.updates.sorties
    assert further.area(sorties[0]) / 1852**2 == pytest.approx(
        20 * np.cos(np.radians(45.2)) * 36, rel=2e-3
    )
    swept = further.effort(sorties[0])
    # definite range: C = POD
    np.testing.assert_allclose(swept / further.area(sorties[0]), [0.5, 0.8], rtol=1e-6)
    one = suspension.further[0]
    whole = 60 * np.cos(np.radians(45.2)) * 24 * 1852**2
    # No more is found than if each scenario had all effort where it is likeliest, and no less than
    # by even effort
    low = float(suspension.share @ -np.expm1(-swept / whole))
    assert (
        low - 3 * one.pos_error
        < one.pos
        < float(suspension.share @ (swept / whole * 1.5 / (1 - 0.8 / 3)))
    )
    assert one.alive < one.pos
    text = (out / "suspend.txt").read_text()
    assert max(map(len, text.splitlines())) <= text_sheet.WIDE
    assert text.isascii()
    for word in (
        "western third",
        "Hayward, Eckerson and Collis 1975",
        "neither a plan nor a bound",
    ):
        assert word in " ".join(text.split())
    assert (out / "suspend.png").exists()


@pytest.mark.thorough
@pytest.mark.usefixtures("painted")
def test_the_picture_is_painted(
    small: tuple[drift.Result, decision.Suspension, Path], tmp_path: Path
) -> None:
    suspend_map.plot_suspension(small[1], tmp_path / "suspend.png", imprint=Imprint("Title"))
    assert (tmp_path / "suspend.png").stat().st_size > 10_000


@pytest.mark.parametrize("mortal", [True, False])
def test_days_on_a_held_map_bear_no_error_and_no_panel_is_empty(
    small: tuple[drift.Result, decision.Suspension, Path],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    mortal: bool,
) -> None:
    """What holding the map does to later days is not in the particles: +- would promise it.

    A plan's sorties meet particles that drift on.
    """
    drawn: list[Any] = []
    monkeypatch.setattr(page, "save", lambda canvas, *args, **more: drawn.append(canvas.figure))
    _, told, _ = small
    assert len(told.further) > 1
    suspension = told if mortal else replace(told, bases=(None, None))
    for planned in (False, True):
        some = replace(suspension, planned=planned)
        *_, words = suspend_text.suspension_text(some, "Title", "run").split("4  SEARCHING ON")
        assert ("+-" in words) == planned
        assert ("no errors are given" in " ".join(words.split())) == (not planned)
        suspend_map.plot_suspension(some, tmp_path / "suspend.png", imprint=Imprint("Title"))
        axes = drawn[-1].axes
        assert [ax.get_title(loc="left") for ax in axes] == [
            *(["Probability of being alive"] if mortal else []), "Searched so far", "Further search from now"
        ]  # fmt: skip
        assert any(isinstance(one, ErrorbarContainer) for one in axes[-1].containers) == planned
        notes = " ".join(text.get_text() for text in drawn[-1].texts)
        assert ("no scenario has survival times" in notes) == (not mortal)
        assert ("drift is ignored" in notes) == (not planned)


def test_bars_and_words_of_what_was_searched_are_shares_of_all(
    small: tuple[drift.Result, decision.Suspension, Path],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Bars add up to all; right after a sortie 1/3 was searched, of which it left 1/2 or 1/5."""
    drawn: list[Any] = []
    monkeypatch.setattr(page, "save", lambda canvas, *args, **more: drawn.append(canvas.figure))
    _, told, out = small
    suspend_map.plot_suspension(told, tmp_path / "suspend.png", imprint=Imprint("Title"))
    panel = next(ax for ax in drawn[-1].axes if ax.get_title(loc="left") == "Searched so far")
    wide = np.array([[bar.get_width() for bar in bars] for bars in panel.containers])
    np.testing.assert_allclose(wide.sum(axis=0), 1.0, atol=1e-12)
    for update, _ in told.sorties:
        assert update.poc is not None
        assert update.pos is not None
        poc, pos = float(update.poc[-1]), float(update.pos[-1])
        left = notation.percent((poc - pos) / (1 - pos))
        assert left != notation.percent(poc - pos)
        assert f"{left}  {update.name}" in (out / "suspend.txt").read_text()


def test_survival_times_alone_are_told_from_the_start(tmp_path: Path) -> None:
    path = tmp_path / "case.toml"
    whole = CASE.format(particles=500, more="")
    path.write_text(whole[: whole.index("[[sortie]]")])
    suspension = flow.suspension_basis(drift.run(drift.load(path)))
    assert suspension is not None
    assert suspension.now == np.datetime64("2026-06-01T06:00")
    assert suspension.sorties == suspension.further == ()
    assert "No sortie has been flown" in suspend_text.suspension_text(suspension, "Title", "run")
