"""Drift models of a user's own: the iceberg of docs/howto/model.md against its balance of forces,
leeway written again, and refusals.
"""

import re
from pathlib import Path

import numpy as np
import pytest
from scipy import integrate, optimize

import drift
from drift.case import case_digest
from drift.engine.motion.models import by_name as models
from drift.engine.motion.models import own_motion
from drift.engine.motion.scenario import PositionPrior
from geo.errors import UserError
from geo.files import fence

PAGE = Path(__file__).parents[4] / "docs" / "howto" / "model.md"
HOURS = 24
RADIUS = 6_371_008.8  # [m]
CASE = """
title = "berg"
start = 2026-04-14T06:00:00Z
end = "+24 h"
seed = 11
particles = {particles}
[clock]
step = "30 min"
[coast]
source = "none"
[[current]]
constant = {{ speed = "0.4 kn", toward = 170 }}
[[wind]]
constant = {{ speed = "22 kn", from = 320 }}
{more}
"""
BERG = """
[[scenario]]
name = "berg"
motion = "own.py"
parameters = {{ length = 1800, width = 900 }}
position = {{ at = "{at}", error = "0.0001 nmi" }}
"""
CURRENT = 0.4 * 1852 / 3600 * np.array([np.sin(np.radians(170)), np.cos(np.radians(170))])
WIND = -22 * 1852 / 3600 * np.array([np.sin(np.radians(320)), np.cos(np.radians(320))])


def iceberg() -> str:
    """Return the file of the page."""
    found = re.search(
        r"<!-- file: iceberg.py -->\s*```python\n(.*?)\n *```",
        PAGE.read_text(encoding="utf-8"),
        re.S,
    )
    assert found is not None
    return re.sub(r"^   ", "", found[1], flags=re.M)


def loaded(
    folder: Path, own: str, scenarios: str, more: str = "", particles: int = 200
) -> drift.Case:
    """Return a case in a folder, with a drift model of its own."""
    (folder / "own.py").write_text(own, encoding="utf-8")
    path = folder / "case.toml"
    path.write_text(CASE.format(particles=particles, more=more) + scenarios, encoding="utf-8")
    return drift.load(path)


def balanced(latitude: float, length: float, width: float) -> np.ndarray:
    """Return the velocity [m/s] over ground at which drag of air and water and the Coriolis force
    on an iceberg balance.

    Its height falls out: mass, and both of its sides, are in proportion to it. Sides are seen from
    all directions alike, 2 / pi of length and width together; the wind is much faster than the ice.
    """
    air, water, ice, in_air, in_water = 1.2, 1027.0, 850.0, 1.3, 0.9
    mass, wet = ice * length * width, 2 / np.pi * (length + width) * ice / water
    dry = 2 / np.pi * (length + width) * (1 - ice / water)
    f = 2 * 7.2921e-5 * np.sin(latitude)

    def force(v: np.ndarray) -> np.ndarray:
        coriolis = mass * f * np.array([v[1], -v[0]])
        wind = 0.5 * air * in_air * dry * np.hypot(*WIND) * WIND
        return (coriolis + wind - 0.5 * water * in_water * wet * np.hypot(*v) * v) / mass * 1e5

    found = optimize.root(force, 0.01 * WIND, tol=1e-12)
    assert found.success
    return CURRENT + found.x


@pytest.mark.parametrize("at", ["46-45N 047-30W", "63-10S 052-20W"])
def test_an_iceberg_goes_where_its_forces_balance(tmp_path: Path, at: str) -> None:
    case = loaded(tmp_path, iceberg(), BERG.format(at=at))
    last = drift.run(case).particles.isel(time=-1)
    prior = case.scenarios[0].prior
    assert isinstance(prior, PositionPrior)

    def rates(time: float, place: np.ndarray) -> np.ndarray:
        east, north = balanced(place[1], 1800, 900)
        return np.array([east / np.cos(place[1]), north]) / RADIUS

    end = integrate.solve_ivp(
        rates, (0, HOURS * 3600), [prior.lon, prior.lat], rtol=1e-10, atol=1e-13
    ).y[:, -1]
    east = (np.radians(last["lon"].values) - end[0]) * np.cos(end[1]) * RADIUS
    north = (np.radians(last["lat"].values) - end[1]) * RADIUS
    # of 30 km; they begin within 1 m, and numbers are float32
    # They begin within six standard deviations (0.16 m); roundings of the way are centimetres.
    assert np.hypot(east, north).max() < 1.0
    assert max(abs(east.mean()), abs(north.mean())) < 0.07  # four of its standard errors, and those


def test_a_file_of_the_package_is_a_model_by_its_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It moves particles as the same file of a user's does, to the bit, and takes no object."""
    berg = BERG.format(at="46-45N 047-30W")
    own = drift.run(loaded(tmp_path, iceberg(), berg, particles=20))
    shipped = {"berg": tmp_path / "own.py"}
    monkeypatch.setattr(own_motion, "shipped", lambda: shipped)
    named = berg.replace('"own.py"', '"berg"')
    with monkeypatch.context() as fenced:  # as `drift serve` reads a case
        fenced.setenv(fence.NAME, fence.fence_text(fence.Fence((tmp_path,))))
        case = loaded(tmp_path, iceberg(), named, particles=20)
    np.testing.assert_array_equal(drift.run(case).trajectories.lon, own.trajectories.lon)
    with pytest.raises(UserError, match='motion = "berg" determines its drift'):
        loaded(tmp_path, iceberg(), named + 'object = "PIW-1"')
    with pytest.raises(UserError, match='allowed are "drift", "berg", or a Python file'):
        loaded(tmp_path, iceberg(), named.replace('"berg"\nparameters', '"bergs"\nparameters'))


def test_parameters_are_drawn_for_each_particle(tmp_path: Path) -> None:
    own = """
PARAMETERS = ("a", "b", "c", "d")

def velocity(current, wind, waves, parameters):
    return [parameters[0] + 2 * parameters[1], parameters[2] - 3 * parameters[3]] + 0.0 * current
"""
    laws = {"a": (0.31, 0.021), "b": (-0.12, 0.014), "c": (0.27, 0.033), "d": (0.05, 0.008)}
    given = ", ".join(
        f"{name} = {{ mean = {mean}, std = {std} }}" for name, (mean, std) in laws.items()
    )
    scenario = BERG.format(at="0-00N 020-10W").replace("length = 1800, width = 900", given)
    more = f"[output]\ntrajectories = {(n := 4000)}\n"
    last = drift.run(loaded(tmp_path, own, scenario, more, n)).particles.isel(time=-1)
    far = (
        np.radians([last["lon"].values + 20 + 10 / 60, last["lat"].values])
        * RADIUS
        / (HOURS * 3600)
    )
    (a, b, c, d), (sa, sb, sc, sd) = zip(*laws.values(), strict=True)
    stds = np.hypot([sa, sc], [2 * sb, 3 * sd])
    error = 4 * stds / np.sqrt(n)  # four standard errors
    assert np.all(np.abs(far.mean(axis=1) - [a + 2 * b, c - 3 * d]) < error)
    assert np.all(np.abs(far.std(axis=1) - stds) < error / np.sqrt(2))
    assert abs(np.corrcoef(far)[0, 1]) < 4 / np.sqrt(n)


WAVES = """
[[stokes]]
constant = { speed = "0.2 kn", toward = 205 }
[uncertainty]
current = { std = "0.11 m/s", time = "7 h", bias = "0.04 m/s" }
wind = { std = "1.7 m/s", time = "5 h" }
diffusivity = "3 m2/s"
"""
RAFT = """
[[scenario]]
name = "raft"
object = "LIFE-RAFT-NB-1"
position = { at = "59-20N 001-10E", error = "3 nmi" }
"""
GIVEN = "def velocity(current, wind, waves, parameters):\n"
PLAIN = "def velocity(current, wind, waves, parameters):\n    return wind\n"
DOWNWIND = "def velocity(current, wind, waves, parameters):\n    return current + waves + parameters[0] * wind\n"


@pytest.mark.thorough
def test_windage_written_as_a_function_drifts_as_windage_does(tmp_path: Path) -> None:
    """With errors of the forcing and a random walk, and beside a raft, which drifts as it does
    anyway.
    """
    own = 'PARAMETERS = ("share",)\n\n\n' + DOWNWIND
    place = 'position = { at = "59-40N 001-40E", error = "2 nmi" }\n'
    mine = (
        f'[[scenario]]\nname = "box"\nmotion = "own.py"\nparameters = {{ share = 0.023 }}\n{place}'
    )
    plain = f'[[scenario]]\nname = "box"\nobject = {{ windage = "2.3 %" }}\n{place}'
    one, other = (
        drift.run(loaded(tmp_path, own, RAFT + box, WAVES)).particles.isel(time=-1)
        for box in (mine, plain)
    )
    assert set(one["scenario"].values) == {0, 1}
    for name in ("lon", "lat"):  # the same sums, in the same order
        np.testing.assert_array_equal(one[name].values, other[name].values)


def test_the_fastest_of_its_parameters_and_winds_draws_the_domain(tmp_path: Path) -> None:
    own = 'PARAMETERS = ("share", "wave")\n\n\n' + GIVEN
    own += "    return current + parameters[0] * wind + parameters[1] * waves\n"
    scenario = BERG.format(at="59-40N 001-40E").replace(
        "length = 1800, width = 900", "share = { mean = 0.021, std = 0.003 }, wave = -0.5"
    )
    (berg,) = loaded(tmp_path, own, scenario, WAVES).scenarios
    model = models.model_of(berg)
    assert model.usual(berg, 20.0) == pytest.approx(20 * 0.021, rel=1e-6)  # float32
    assert model.fastest(berg, 20.0, 4.0) == pytest.approx(20 * (0.021 + 4 * 0.003), rel=1e-6)


def test_scenarios_that_name_one_file_move_in_one_launch_each_by_its_parameters(
    tmp_path: Path,
) -> None:
    own = 'PARAMETERS = ("east", "north")\n\n\n' + GIVEN
    own += "    return [parameters[0], parameters[1]] + 0.0 * wind\n"
    speeds = [(0.21, -0.13), (-0.34, 0.07), (0.05, 0.29)]
    scenarios = "".join(
        BERG.format(at="0-00N 020-10W")
        .replace("length = 1800, width = 900", f"east = {east}, north = {north}")
        .replace('"berg"', f'"{k}"')
        for k, (east, north) in enumerate(speeds)
    )
    case = loaded(tmp_path, own, scenarios)
    assert len({id(models.model_of(scenario)) for scenario in case.scenarios}) == 1
    last = drift.run(case).particles.isel(time=-1)
    far = np.radians([last["lon"].values + 20 + 10 / 60, last["lat"].values]) * RADIUS
    for k, speed in enumerate(speeds):
        members = last["scenario"].values == k
        assert members.sum() > 20
        expected = np.array(speed)[:, None] * HOURS * 3600
        assert np.abs(far[:, members] - expected).max() < 1.0  # [m]; they begin within 1 m


@pytest.mark.thorough
def test_shards_give_the_same_bits(tmp_path: Path) -> None:
    case = loaded(tmp_path, iceberg(), RAFT + BERG.format(at="59-40N 001-40E"), WAVES)
    assert drift.run(case).particles.identical(drift.run(case, shards=2).particles)


def test_a_file_is_run_by_a_run_and_not_by_reading(tmp_path: Path) -> None:
    case = loaded(
        tmp_path,
        iceberg() + '\nraise OSError("no such device")\n',
        BERG.format(at="46-45N 047-30W"),
    )
    with pytest.raises(UserError, match=r"^own\.py: running it failed: OSError: no such device$"):
        drift.run(case)


def test_plain_helpers_are_compiled_too_and_names_may_be_given_anew(tmp_path: Path) -> None:
    """What is called waves is no wave once the function has given it a value of its own."""
    own = """
def share(wind):
    if wind.norm() > 5.0:
        wind *= 0.5
    return wind

def velocity(current, wind, waves, parameters):
    waves = 0.04 * share(wind)
    return current + waves
"""
    scenario = BERG.format(at="59-40N 001-40E").replace(
        "parameters = { length = 1800, width = 900 }\n", ""
    )
    one = drift.run(loaded(tmp_path, own, scenario)).particles.isel(time=-1)
    plain = scenario.replace('motion = "own.py"', 'object = { windage = "2 %" }')
    other = drift.run(loaded(tmp_path, own, plain)).particles.isel(time=-1)
    for name in ("lon", "lat"):  # 0.04 of a half is 0.02, in float32 too
        np.testing.assert_array_equal(one[name].values, other[name].values)


def test_a_file_that_has_changed_meanwhile_is_refused(tmp_path: Path) -> None:
    case = loaded(tmp_path, iceberg(), BERG.format(at="46-45N 047-30W"))
    (tmp_path / "own.py").write_text(iceberg() + "\n", encoding="utf-8")
    with pytest.raises(
        UserError, match=r"^own\.py has changed since the case was read; read the case again$"
    ):
        drift.run(case)
    (tmp_path / "own.py").unlink()
    with pytest.raises(
        UserError,
        match=r"own\.py: No such file or directory; the case names it as its drift model$",
    ):
        drift.run(case)


def test_another_file_makes_another_case(tmp_path: Path) -> None:
    scenario = BERG.format(at="46-45N 047-30W")
    digests = {
        case_digest.digest(loaded(tmp_path, iceberg() + more, scenario)) for more in ("", "", "\n")
    }
    assert len(digests) == 2
    assert loaded(tmp_path, iceberg(), scenario).inputs == (str(tmp_path / "own.py"),)


NONE = "def velocity(current, wind, waves, parameters):\n    x = wind\n"
REFUSED = {
    "no file": (None, "", 'motion: no file "own.py"; looked for '),
    "no Python": ("def velocity(:\n", "", "own.py is not valid Python in line 1: "),
    "no function": ("speed = 3\n", "", "own.py has no function velocity(current, wind, waves, parameters)"),
    "in a branch": (f"if True:\n    {GIVEN}        return wind\n", "", "outside classes, branches and other functions"),
    "async": (f"async {GIVEN}    return wind\n", "", "own.py has no function velocity("),
    "twice": (f"{DOWNWIND}{DOWNWIND}", "", "own.py: velocity is defined in lines 1, 3; keep one"),
    "bound anew": (f"{DOWNWIND}velocity = 3\n", "", "own.py: velocity is defined in lines 1, 3; keep one"),
    "other arguments": (
        "def velocity(wind, current, waves, parameters):\n    return wind\n", "",
        "own.py: velocity(wind, current, waves, parameters) must take (current, wind, waves, parameters)",
    ),
    "more arguments": (
        "def velocity(current, wind, waves, parameters, *, k=1):\n    return wind\n", "",
        "own.py: velocity(current, wind, waves, parameters, *, k=1) must take (current,",
    ),
    "no return": (NONE, "", "own.py: velocity must return its velocity in its last line, and nowhere else; assign"),
    "nothing returned": (f"{NONE}    return\n", "", "must return its velocity in its last line, and nowhere else; assign"),
    "two returns": (
        f"{GIVEN}    if wind[0] > 0:\n        return wind\n    return current\n", "",
        "must return its velocity in its last line, and nowhere else, not in line 3; assign it to a variable in branches",
    ),
    "a parameter too many": (
        f"PARAMETERS = ('a',)\n{GIVEN}    return wind * parameters[1]\n", "parameters = { a = 1 }",
        "own.py: line 3 reads parameters[1], and PARAMETERS names 1: a",
    ),
    "a parameter of none": (f"{GIVEN}    return wind * parameters[-1]\n", "", "line 2 reads parameters[-1], and PARAMETERS names none"),
    "chance": (f"{GIVEN}    return wind * ti.random()\n", "", "line 2 draws with ti.random; state uncertainty in [uncertainty]"),
    "a start": (f"import taichi as ti\nti.init()\n{DOWNWIND}", "", "line 2 calls ti.init, which drift does itself; leave it out"),
    "names that are none": (f"PARAMETERS = (1, 2)\n{DOWNWIND}", "", "own.py: PARAMETERS must be a tuple of names"),
    "made names": (f"PARAMETERS = tuple('abcde')\n{DOWNWIND}", "", "own.py: PARAMETERS must be a tuple of names"),
    "five": (f"PARAMETERS = ('a', 'b', 'c', 'd', 'e')\n{DOWNWIND}", "", "PARAMETERS has a, b, c, d, e; at most 4 are"),
    "missing": (f"PARAMETERS: tuple = ('a', 'b')\n{PLAIN}", "parameters = { a = 1 }", 'parameters: "b" is missing; own.py takes a, b'),
    "unknown": (PLAIN, "parameters = { a = 1 }", 'parameters: "a" is unknown; own.py takes none'),
    "negative": (PLAIN, "parameters = { a = { mean = 1, std = -1 } }", "parameters.a.std"),
    "a unit": (PLAIN, 'parameters = { a = "80 m" }', "parameters.a: '80 m' must be a number without a unit, as the Python file expects it"),
    "no waves": (PLAIN.replace("return wind", "return wind + waves"), "", "own.py uses waves, and the case has none: add [[stokes]], their Stokes drift"),
    "no waves in a branch": (
        f"{GIVEN}    if wind[0] > 0:\n        waves = wind * 0.01\n    return current + waves\n", "",
        "own.py uses waves, and the case has none",
    ),
    "an object too": (PLAIN, 'object = "PIW-1"', 'motion = "own.py" determines its drift; leave object out'),
    "jibing": (PLAIN, "jibe = 0.1", 'jibe belongs to leeway, and motion = "own.py" has none; leave jibe out'),
    "another word": (None, 'motion = "sail"', "no model of motion 'sail'; allowed are \"drift\", "),
    "of leeway": (None, 'motion = "drift"\nobject = "PIW-1"\nparameters = { a = 1 }', 'add motion = "FILE.py", or leave'),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_wrong_is_said_in_a_line(tmp_path: Path, name: str) -> None:
    own, keys, told = REFUSED[name]
    if own is not None:
        (tmp_path / "own.py").write_text(own, encoding="utf-8")
    motion = "" if "motion" in keys else 'motion = "own.py"\n'
    scenario = f'[[scenario]]\nname = "berg"\n{motion}{keys}\nposition = {{ at = "46-45N 047-30W", error = "1 nmi" }}\n'
    path = tmp_path / "case.toml"
    path.write_text(CASE.format(particles=200, more="") + scenario, encoding="utf-8")
    with pytest.raises(UserError) as refused:
        drift.load(path)
    assert told in str(refused.value)


@pytest.mark.parametrize(
    ("body", "told"),
    [
        (
            "return wind / (wind[0] - wind[0])",
            "own.py: velocity is not a finite number in a current of 0 m/s and a wind of ",
        ),
        (
            "return wind * ti.sqrt(ti.abs(wind.norm() - 11.5) - 1.5)",
            "own.py: velocity is not a finite number in a current of 0 m/s and",
        ),
        ("return sorted(wind)", "own.py: velocity can't be compiled ("),
        ("return 0.1", "own.py: velocity can't be compiled ("),
        ("return [wind[0], wind[1], 0.0]", "own.py: velocity can't be compiled ("),
    ],
)
def test_a_function_that_fails_is_refused_before_the_run(
    tmp_path: Path, body: str, told: str
) -> None:
    own = f"import taichi as ti\n\n\ndef velocity(current, wind, waves, parameters):\n    {body}\n"
    scenario = BERG.format(at="46-45N 047-30W").replace(
        "parameters = { length = 1800, width = 900 }\n", ""
    )
    with pytest.raises(UserError) as refused:
        drift.run(loaded(tmp_path, own, scenario))
    assert str(refused.value).startswith(told)
    assert "\n" not in str(refused.value)


def test_no_program_of_a_case_is_run_behind_a_fence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(fence.NAME, fence.fence_text(fence.Fence((tmp_path,))))
    with pytest.raises(
        UserError,
        match=r'"own\.py" is a program, and programs in a case are not run here; run the case with drift run$',
    ):
        loaded(tmp_path, iceberg(), BERG.format(at="46-45N 047-30W"))
