"""The picture of the rooms in docs/architecture.md against the imports, and against what
import-linter is told.
"""

import ast
import re
from pathlib import Path

import pytest
from places import ROOT

FLOORS = ("drift", "kernels", "geo")
TOP = "the package itself"  # drift/__init__.py, __main__.py


def floors() -> dict[str, list[list[str]]]:
    """Return the picture: rooms of each floor, a list a line, the highest first."""
    text = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    found: dict[str, list[list[str]]] = {}
    for line in text.split("```")[1].strip().splitlines():
        floor, rooms = re.fullmatch(r"(\w*)\s+(\w+(?: · \w+)*)  .*", line).groups()
        found.setdefault(floor or list(found)[-1], []).append(rooms.split(" · "))
    return found


def room(module: str, floor: str) -> str:
    """Return the room in which a module stands."""
    parts = module.split(".")
    if floor == "kernels":
        return "kernels"
    if floor == "geo":
        return parts[1] if len(parts) > 1 and (ROOT / "geo" / parts[1]).is_dir() else "earth"
    return parts[1] if len(parts) > 1 else TOP


def imported(path: Path) -> list[str]:
    """Return the modules of ours that a file imports, at its top or inside functions."""
    names = []
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module and node.module.split(".")[0] in FLOORS:
            for alias in node.names:
                whole = f"{node.module}.{alias.name}"
                is_module = (ROOT / f"{whole.replace('.', '/')}.py").exists() or (
                    ROOT / whole.replace(".", "/")
                ).is_dir()
                names.append(whole if is_module else node.module)
        elif isinstance(node, ast.Import):
            names += [alias.name for alias in node.names if alias.name.split(".")[0] in FLOORS]
    return names


@pytest.mark.parametrize("floor", FLOORS)
def test_every_room_is_in_the_picture_and_every_room_of_the_picture_is_there(floor: str) -> None:
    folder = ROOT / floor
    there = {
        room(f"{floor}.{path.stem if path.is_file() else path.name}", floor)
        for path in folder.iterdir()
        if _ours(path)
    }
    assert {name for line in floors()[floor] for name in line} == there - {TOP, "data"}


def _ours(path: Path) -> bool:
    return (path.suffix == ".py" and not path.stem.startswith("__")) or (
        path / "__init__.py"
    ).exists()


@pytest.mark.thorough
def test_imports_go_down_the_picture() -> None:
    picture = [line for floor in floors().values() for line in floor]
    height = {name: -k for k, line in enumerate(picture) for name in line}
    wrong, seen = [], set()
    for floor in FLOORS:
        for path in (ROOT / floor).glob("**/*.py"):
            here = room(
                ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"),
                floor,
            )
            if here in (TOP, "__main__"):
                continue
            for module in imported(path):
                there = room(module, module.split(".")[0])
                seen.add((here, there))
                if there not in (here, TOP, "data") and height[there] >= height[here]:
                    wrong.append(f"{path.relative_to(ROOT)} imports {module}")
    assert not wrong
    assert len(seen) > 50  # it did look


@pytest.mark.parametrize("page", ["CONTRIBUTING.md", "docs/architecture.md"])
def test_what_to_change_is_there(page: str) -> None:
    """Each file that the tables name exists, and holds each name that stands before it."""
    rows = [line for line in (ROOT / page).read_text(encoding="utf-8").splitlines() if "| " in line]
    names, wrong = 0, []
    for line in rows:
        for before, path in re.findall(
            r"((?:(?:`\w+`|and|,) )*(?:of|in) )?`([\w/]+/[\w.]*)`", line
        ):
            found = [own for own in (ROOT / path, ROOT / "drift" / path) if own.exists()]
            if not found:
                wrong.append(f"{path} is not there")
            for name in re.findall(r"`(\w+)`", before) if found and found[0].is_file() else ():
                names += 1
                if not re.search(rf"\b{name}\b", found[0].read_text(encoding="utf-8")):
                    wrong.append(f"{path} has no {name}")
    assert not wrong
    assert names > 10 or page != "CONTRIBUTING.md"
