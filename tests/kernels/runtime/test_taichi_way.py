"""Taichi by its insides, in one file, and by its public interface alone: the same bits."""

import ast
import hashlib
import os
import runpy
import subprocess
import sys
from pathlib import Path

import pytest
import taichi
from places import ROOT

import drift
from kernels.runtime import taichi_inside, taichi_public, taichi_way

KERNELS = ROOT / "kernels" / "runtime"
CASES = {
    "overdue_boat": {"particles": 600, "resampling": {"below": 0.5}},
    "overdue_yacht": {"particles": 300},
    "smuggler_bridge": {"particles": 300},
}
RUN = f"""
import hashlib
import drift
from kernels.runtime import runtime, taichi_way
runtime.start(threads=2)
print("inside" if taichi_way.inside else "public")
for made in drift.run_many([drift.vary(drift.load(name), changes) for name, changes in {CASES}.items()]):
    print(hashlib.sha256(b"".join(x.tobytes() for x in (made.lon, made.lat, made.status, made.probability))).hexdigest())
"""


def done(code: str, **environment: str) -> list[str]:
    """Return what a process of its own prints."""
    own = {
        name: value
        for name, value in os.environ.items()
        if name not in ("DRIFT_PLAIN_TAICHI", "XDG_CACHE_HOME")
    }
    one = subprocess.run(
        [sys.executable, "-c", code],
        env=own | {"PYTHONPATH": str(ROOT)} | environment,
        capture_output=True,
        text=True,
        timeout=280,
        check=True,
    )
    return one.stdout.splitlines()


@pytest.mark.thorough
def test_both_ways_give_the_same_bits() -> None:
    """Drift, coast, sorties, resampling; targets that steer, looks and bridges: columns, groups,
    nodes and launches.
    """
    public = done(RUN, DRIFT_PLAIN_TAICHI="1")
    assert (taichi_way.inside, public[0]) == (True, "public")
    inside = []
    for made in drift.run_many(
        [drift.vary(drift.load(name), changes) for name, changes in CASES.items()]
    ):
        assert made.error is None
        parts = [x.tobytes() for x in (made.lon, made.lat, made.status, made.probability)]
        inside.append(hashlib.sha256(b"".join(parts)).hexdigest())
    assert inside == public[1:]


@pytest.mark.parametrize(
    ("version", "environment", "way"),
    [
        ("(1, 7, 4)", {}, "True kernels.runtime.taichi_inside"),
        ("(1, 7, 4)", {"DRIFT_PLAIN_TAICHI": "0"}, "True kernels.runtime.taichi_inside"),
        ("(1, 7, 4)", {"DRIFT_PLAIN_TAICHI": "1"}, "False kernels.runtime.taichi_public"),
        ("(1, 8, 0)", {}, "False kernels.runtime.taichi_public"),
        ("(1, 7, 3)", {}, "False kernels.runtime.taichi_public"),
    ],
)
def test_insides_are_used_of_the_release_that_is_known_alone(
    version: str, environment: dict[str, str], way: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What chooses is run again, here, beside the one that has chosen."""
    monkeypatch.delenv("DRIFT_PLAIN_TAICHI", raising=False)
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr(taichi, "__version__", ast.literal_eval(version))
    chosen = runpy.run_path(str(KERNELS / "taichi_way.py"))
    assert f"{chosen['inside']} {chosen['way'].__name__}" == way


def test_no_other_file_reaches_into_taichi() -> None:
    """By imports from below the package's top; what compiles kernels is reached through
    `taichi_way.way`.
    """
    reaching = set()
    for path in [
        *(ROOT / "kernels").rglob("*.py"),
        *(ROOT / "drift").rglob("*.py"),
        *(ROOT / "geo").rglob("*.py"),
    ]:
        text = path.read_text(encoding="utf-8")
        if not any(word in text for word in ("taichi", "_primal", "lang", "_lib")):
            continue
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.ImportFrom | ast.Import):
                first = getattr(node, "module", None) or ""
                names = [first, *(f"{first}.{alias.name}".strip(".") for alias in node.names)]
                if any(
                    name.startswith(("taichi._", "taichi.lang", "taichi.types")) for name in names
                ):
                    reaching.add(path.name)
            if isinstance(node, ast.Attribute) and node.attr in ("_primal", "lang", "_lib"):
                reaching.add(path.name)
    assert reaching == {"taichi_inside.py"}


def test_the_public_way_is_public() -> None:
    tree = ast.parse((KERNELS / "taichi_public.py").read_text(encoding="utf-8"))
    attributes = {node.attr for node in ast.walk(tree) if isinstance(node, ast.Attribute)}
    assert not {name for name in attributes if name.startswith("_")} - {"__name__"}


def test_both_ways_have_the_same_functions() -> None:
    expected = {"begin", "bind", "cache", "close", "column", "copy_into", "nodes", "pack", "pairs"}
    for name in expected:
        assert callable(getattr(taichi_inside, name))
        assert callable(getattr(taichi_public, name))
    used = {
        node.attr
        for name in ("runtime.py", "launch.py")
        for node in ast.walk(ast.parse((KERNELS / name).read_text(encoding="utf-8")))
        if isinstance(node, ast.Attribute)
        and isinstance(node.value, ast.Name)
        and node.value.id == "way"
    }
    assert used == expected


def test_the_folder_of_compiled_kernels_is_the_same_in_both_ways(tmp_path: Path) -> None:
    """In a home of its own, which Taichi reads from the environment."""
    code = "from pathlib import Path; from kernels.runtime import taichi_inside, taichi_public as public; "
    code += "print(Path(taichi_inside.cache()) == public.cache())"
    if sys.platform == "linux":
        assert done(code, HOME=str(tmp_path)) == ["True"]
