"""Shells complete commands, options, shipped cases and files: bash does so here, for the others the
script is made.
"""

import builtins
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

from drift.apps.cli import commands as cli
from drift.apps.cli import grammar

pytest.importorskip("shtab")


@pytest.fixture(scope="module")
def script(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("completion") / "drift.bash"
    from drift.apps.cli import completion

    path.write_text(completion.script(grammar.parser(), "bash"))
    return path


@pytest.mark.skipif(shutil.which("bash") is None, reason="no bash")
@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["ru"], {"run"}),
        (["c"], {"check", "cases", "compare"}),
        (["run", "overdue"], {"overdue_boat", "overdue_yacht"}),
        (["run", "my"], {"my_case.toml"}),
        (["compare", "overdue_boat", "gulf_c"], {"gulf_containers"}),
        (["run", "--ov"], {"--overwrite"}),
        (["run", "--backend", "c"], {"cpu", "cuda"}),
        (["new", "pas"], {"passage"}),
        (["info", "wind"], {"wind.nc"}),
    ],
)
def test_a_real_bash_completes(
    script: Path, tmp_path: Path, words: list[str], expected: set[str]
) -> None:
    for name in ("my_case.toml", "my_notes.txt", "wind.nc"):
        (tmp_path / name).touch()
    listed = " ".join(f"'{word}'" for word in ["drift", *words])
    # As bash does on Tab: the words, the number of the one under the cursor, and the function that
    # is told of them.
    asked = f"""
source '{script}'
COMP_WORDS=({listed}); COMP_CWORD={len(words)}; COMP_LINE="{" ".join(["drift", *words])}"; COMP_POINT=${{#COMP_LINE}}
function=$(complete -p drift | sed 's/.*-F \\([^ ]*\\) .*/\\1/')
$function drift '{words[-1]}' '{(["drift", *words])[-2]}'
printf '%s\\n' "${{COMPREPLY[@]}}"
"""
    done = subprocess.run(
        ["bash", "--norc", "-c", asked], capture_output=True, text=True, check=True, cwd=tmp_path
    )
    assert set(done.stdout.split()) == expected


@pytest.mark.parametrize("shell", grammar.SHELLS)
def test_scripts_of_all_shells_name_commands_and_cases(
    shell: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["--print-completion", shell]) == 0
    made = capsys.readouterr().out
    assert "fit-errors" in made
    assert ("overdue_boat" in made) == (shell != "tcsh")  # which completes files alone


def test_without_shtab_a_line_says_what_to_install(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    whole = builtins.__import__

    def without(name: str, *rest: Any) -> Any:
        if name == "shtab":
            raise ImportError(name)
        return whole(name, *rest)

    monkeypatch.setattr(builtins, "__import__", without)
    assert cli.main(["--print-completion", "bash"]) == 2
    assert capsys.readouterr().err == (
        'drift: --print-completion needs shtab: pip install -e ".[completion]" in the folder of drift\'s source\n'
    )
