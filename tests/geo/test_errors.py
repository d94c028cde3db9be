"""Errors name arguments of Python, and options where a command runs."""

import inspect

import pytest

import drift
from drift.apps.cli import commands, grammar
from drift.case.file import load
from geo import errors
from geo.errors import UserError

SAID = {  # as a command has it: as Python has it
    "--threads 0 must be at least 1": "threads = 0 must be at least 1",
    "--backend cuda: its card is full; use --backend cpu": 'backend = "cuda": its card is full; use backend = "cpu"',
    "--backend: unknown backend 'gpu'": "backend: unknown backend 'gpu'",
    "name another with --out, or add --overwrite": "name another with out, or add overwrite = True",
    "--memory 1.5 (GiB): a run takes 2 GiB at least": "memory = 1.5 (GiB): a run takes 2 GiB at least",
    "--max-gap 0 s must be above 0 s": "gap = 0 s must be above 0 s",
    "--error -1e+03 m must be above 0 m": "error = -1e+03 m must be above 0 m",
    "--hold-out: one track; leave it out": "held_out: one track; leave it out",
    "without --shards or --workers or --cluster": "without shards or client",
    "pip install --force-reinstall taichi": "pip install --force-reinstall taichi",
    "leave one out (--set current.0='{ constant = { .. } }')": "leave one out (--set current.0='{ constant = { .. } }')",
}


@pytest.mark.parametrize("text", SAID)
def test_one_text_is_said_in_two_ways(text: str) -> None:
    error = UserError(text, "--seed 3: another mistake")
    assert str(error) == f"{SAID[text]}\n--seed 3: another mistake"
    assert error.lines == (SAID[text], "--seed 3: another mistake")
    with errors.naming_options():
        assert str(error) == f"{text}\n--seed 3: another mistake"
        with errors.naming_options():  # by a program that runs commands
            pass
        assert error.lines[0] == text
    assert error.lines[0] == SAID[text]


def test_an_argument_in_an_error_is_one_of_a_function() -> None:
    functions = [
        getattr(drift, name) for name in drift.__all__ if inspect.isfunction(getattr(drift, name))
    ]
    known = {name for function in functions for name in inspect.signature(function).parameters}
    assert set(errors.ARGUMENTS.values()) <= known


def test_an_option_in_an_error_is_one_of_a_command() -> None:
    known = {
        option
        for command in _parsers()
        for action in command._actions
        for option in action.option_strings
    }
    assert {f"--{name}" for name in errors.ARGUMENTS if " " not in name} <= known


def _parsers() -> list:  # type: ignore[type-arg]
    whole = grammar.parser()
    return [
        parser
        for action in whole._actions
        if isinstance(action.choices, dict)
        for parser in action.choices.values()
    ]


def test_python_and_the_command_name_what_each_has(capsys: pytest.CaptureFixture[str]) -> None:
    case = load("overdue_boat")
    with pytest.raises(UserError, match=r"^threads = 0 must be at least 1$"):
        drift.run(case, threads=0)
    with pytest.raises(UserError, match=r"^backend: unknown backend 'gpu'; allowed: cpu, "):
        drift.run(case, backend="gpu")
    assert commands.main(["run", "overdue_boat", "--threads", "0"]) == 2
    assert capsys.readouterr().err == "drift: --threads 0 must be at least 1\n"
