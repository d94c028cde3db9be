"""What is installed, and the files that describe it to pip, conda, Docker, pre-commit and those who
cite it, agree.

They are built and installed by .ci/package.
"""

import re
import tomllib
from typing import Any

import pytest
import yaml
from places import ROOT

from drift.apps.cli import commands

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
CHANGES = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
# names that differ there
CONDA = {"eccodes": "python-eccodes", "matplotlib": "matplotlib-base"}


def read(name: str) -> Any:
    return yaml.safe_load((ROOT / name).read_text(encoding="utf-8"))


def packages() -> list[str]:
    found: list[str] = PROJECT["tool"]["hatch"]["build"]["targets"]["wheel"]["packages"]
    return found


def bounds(requirement: str) -> tuple[str, str]:
    """Return a package's name and its bounds, as conda writes them."""
    match = re.match(r"([A-Za-z0-9-]+) *(.*)", requirement)
    assert match
    return match[1].lower(), match[2]


def test_every_package_is_in_the_wheel_and_in_the_sdist() -> None:
    top = {path.parent.name for path in ROOT.glob("*/__init__.py")} - {
        "tests",
        "docs",
        "benchmarks",
    }
    assert set(packages()) == top
    assert set(packages()) < set(
        PROJECT["tool"]["hatch"]["build"]["targets"]["sdist"]["only-include"]
    )


def test_versions_agree() -> None:
    version = PROJECT["project"]["version"]
    assert read("CITATION.cff")["version"] == version
    assert read("recipe/recipe.yaml")["context"]["version"] == version
    newest = re.search(r"^## \[(\d\S*)\] - (\S+)$", CHANGES, flags=re.MULTILINE)
    assert newest
    assert newest[1] == version
    assert newest[2] == str(read("CITATION.cff")["date-released"])


def test_the_conda_recipe_asks_for_the_same_packages() -> None:
    """Taichi, which conda-forge lacks, comes as its wheel, with what that needs."""
    recipe = read("recipe/recipe.yaml")
    asked = dict(bounds(one) for one in recipe["requirements"]["run"] if isinstance(one, str))
    assert asked.pop("python") == PROJECT["project"]["requires-python"]
    needed = dict(map(bounds, PROJECT["project"]["dependencies"]))
    assert needed.pop("taichi") == f"=={recipe['context']['taichi']}"
    assert {name: asked[name] for name in asked if name not in ("colorama", "dill")} == {
        CONDA.get(name, name): least for name, least in needed.items()
    }


def test_the_image_is_made_of_what_the_wheel_is_made_of() -> None:
    """And nothing else is sent to where it is built."""
    needed = {"pyproject.toml", "README.md", "LICENSE", *packages()}
    copied = re.findall(
        r"^COPY (?!--from)(.*) \S+$",
        (ROOT / "Dockerfile").read_text(encoding="utf-8"),
        re.MULTILINE,
    )
    assert {name for line in copied for name in line.split()} == needed
    ignored = (ROOT / ".dockerignore").read_text(encoding="utf-8").splitlines()
    assert {line[1:] for line in ignored if line.startswith("!")} == needed
    assert "*" in ignored


def test_the_image_runs_as_a_user_of_no_privilege() -> None:
    last = (ROOT / "Dockerfile").read_text(encoding="utf-8").rpartition("\nFROM ")[2]
    assert re.findall(r"^USER (\S+)$", last, re.MULTILINE) == ["drift"]


def test_hooks_are_what_ci_runs() -> None:
    """Each is local, so that a commit needs no network."""
    commands = [
        line.removesuffix(" .")
        for line in (ROOT / ".ci" / "run").read_text(encoding="utf-8").splitlines()
    ]
    (local,) = read(".pre-commit-config.yaml")["repos"]
    assert local["repo"] == "local"
    assert {hook["entry"] for hook in local["hooks"]} <= set(commands)
    assert {hook["language"] for hook in local["hooks"]} == {"system"}
    assert {"ruff check", "ruff format --check", "mypy", "lint-imports"} <= {
        hook["entry"] for hook in local["hooks"]
    }


def test_the_changelog_is_of_what_users_notice() -> None:
    """At most 8 KB a version; the sections are those of Keep a Changelog, and its links lead to
    pages.
    """
    parts = re.split(r"^## \[", CHANGES, flags=re.MULTILINE)[1:]
    assert parts[0].startswith("Unreleased]")
    for part in parts:
        assert len(part.encode()) <= 8 * 1024
        sections = re.findall(r"^### (.*)$", part, flags=re.MULTILINE)
        kinds = ["Added", "Changed", "Deprecated", "Removed", "Fixed", "Security"]
        assert sections == [kind for kind in kinds if kind in sections]
    linked = re.findall(r"\]\((docs/[^)#]+)(?:#([^)]+))?\)", CHANGES)
    assert linked
    for page, anchor in linked:
        text = (ROOT / page).read_text(encoding="utf-8")
        headings = [
            re.sub(r"[^\w -]", "", line).strip().lower()
            for line in re.findall(r"^#+ (.*)$", text, re.MULTILINE)
        ]
        assert not anchor or anchor in {heading.replace(" ", "-") for heading in headings}, (
            page,
            anchor,
        )


@pytest.mark.parametrize("package", packages())
def test_packages_but_the_kernels_and_the_data_are_typed(package: str) -> None:
    assert (ROOT / package / "py.typed").exists() == (package in ("drift", "geo"))


def test_a_library_that_a_bare_system_lacks_is_named_with_its_remedy(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def missing(given: Any) -> Any:
        raise ImportError("libX11.so.6: cannot open shared object file: No such file or directory")

    monkeypatch.setitem(commands.COMMANDS, "cases", missing)
    assert commands.main(["cases"]) == 2
    told = capsys.readouterr().err
    assert told.startswith("drift: a library of the system is missing (libX11.so.6: ")
    assert told.endswith("apt-get install libx11-6\n")
    assert told.count("\n") == 1


def test_the_workflow_of_the_documentation_is_one() -> None:
    """It runs the files that its page has, with the library that a bare system lacks."""
    page = (ROOT / "docs" / "howto" / "ci.md").read_text(encoding="utf-8")
    found = dict(re.findall(r"<!-- file: (\S+) -->\n```\w+\n(.*?)```", page, flags=re.DOTALL))
    (job,) = yaml.safe_load(found["drift.yml"])["jobs"].values()
    steps = [step["run"] for step in job["steps"] if "run" in step]
    assert any("libx11-6" in step for step in steps)
    assert {name for step in steps for name in re.findall(r"\w+\.(?:py|toml)", step)} == {
        "raft.toml",
        "test_raft.py",
    }
    assert {"raft.toml", "test_raft.py"} < found.keys()
