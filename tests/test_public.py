"""The public face: its names, their types, and that nothing of the house stands in their way."""

import ast
import importlib
import inspect
import pkgutil
import pydoc
import re
import subprocess
import sys

import pytest
from places import ROOT

import drift

NAMES = {
    "Brief", "Case", "Result", "UserError", "__version__", "allocate", "budget", "check", "compare", "experiment", "export", "fetch", "fit_errors", "load", "origin", "patrol", "place", "plan", "progress",
    "results", "run", "run_many", "score", "sensor_reach", "serve", "trace", "track", "vary", "verify",
}  # fmt: skip


def test_the_names_are_those_of_the_stub_and_all_can_be_had() -> None:
    stub = ast.parse((ROOT / "drift" / "__init__.pyi").read_text(encoding="utf-8"))
    homes = {
        a.asname: (node.module, a.name)
        for node in stub.body
        if isinstance(node, ast.ImportFrom)
        for a in node.names
    }
    assert set(drift.__all__) == set(dir(drift)) == set(homes) == NAMES
    for name, (module, there) in homes.items():
        assert getattr(drift, name) is getattr(importlib.import_module(module), there)
    assert drift.trace is drift.origin


def test_no_room_has_a_public_name() -> None:
    """A module of that name would stand in the function's place once it is imported."""
    assert not {module.name for module in pkgutil.iter_modules(drift.__path__)} & NAMES


def test_help_shows_each_name_with_its_documentation_and_no_private_one() -> None:
    shown = pydoc.render_doc(drift, renderer=pydoc.plaintext)
    for name in NAMES - {"__version__"}:
        assert name in shown
        assert getattr(drift, name).__doc__
    assert "_HOMES" not in shown
    assert "_lazy" not in shown


def test_a_name_that_is_not_there_is_said_so() -> None:
    with pytest.raises(AttributeError, match="forecast_it"):
        drift.forecast_it  # noqa: B018


def test_importing_it_does_nothing_heavy() -> None:
    told = "import sys, drift; print(sorted({'numpy', 'taichi', 'xarray', 'pydantic'} & set(sys.modules)))"
    done = subprocess.run(
        [sys.executable, "-c", told], capture_output=True, text=True, check=True, cwd=ROOT
    )
    assert done.stdout == "[]\n"


def functions() -> list[str]:
    return sorted(name for name in NAMES if inspect.isfunction(getattr(drift, name)))


@pytest.mark.parametrize("name", functions())
def test_help_explains_each_argument_result_and_error(name: str) -> None:
    """In the order of the signature, and no argument that is not there; units are in brackets."""
    function = getattr(drift, name)
    parts = re.split(
        r"^(Args|Returns|Raises):$", inspect.getdoc(function) or "", flags=re.MULTILINE
    )
    found = dict(zip(parts[1::2], parts[2::2], strict=True))
    listed = re.findall(r"^    (\w+(?:, \w+)*): ", found["Args"], flags=re.MULTILINE)
    assert [one for words in listed for one in words.split(", ")] == list(
        inspect.signature(function).parameters
    )
    assert name == "serve" or found["Returns"].strip()
    assert name == "progress" or "UserError: " in found["Raises"]


@pytest.mark.parametrize(
    "name", ["run", "plan", "patrol", "place", "allocate", "origin", "compare"]
)
def test_a_case_alone_is_enough_and_options_have_their_defaults(name: str) -> None:
    signature = inspect.signature(getattr(drift, name))
    cases = ["a case"] * (2 if name == "compare" else 1)
    given = signature.bind(*cases)
    given.apply_defaults()
    shared = ("datasets", "threads", "backend", "overwrite", "report")
    assert [given.arguments[key] for key in shared] == [None, None, "cpu", False, None]
    with pytest.raises(TypeError, match="thread"):
        signature.bind(*cases, thread=2)


@pytest.mark.parametrize(
    ("name", "option", "hint"),
    [("run", "dataset", "did you mean 'datasets'?"), ("plan", "seed", "drift.vary")],
)
def test_an_unknown_option_names_the_function_and_the_options(
    name: str, option: str, hint: str
) -> None:
    function = getattr(drift, name)
    with pytest.raises(TypeError, match=rf"^drift.{name}: no option '{option}'") as raised:
        function(drift.load("overdue_boat"), **{option: 1})
    assert hint in str(raised.value)
    assert ", ".join(inspect.signature(function).parameters) in str(raised.value)


def test_help_of_a_run_says_units_and_shapes() -> None:
    shown = pydoc.render_doc(drift.run, renderer=pydoc.plaintext)
    for words in (
        "memory limit of the run [GiB]",
        "(time, lat, lon)",
        "CPU threads",
        "sources of the case with",
    ):
        assert words in shown
    assert "(outputs, particles)" in (inspect.getdoc(drift.run_many) or "")
