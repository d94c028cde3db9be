"""Names that some system takes for one: of cases and of users."""

from pathlib import Path

import pytest

from drift.apps.serve import names, shelf, users
from geo.errors import UserError

EQUAL = {
    "case": ("Boat.toml", "boat.toml"),
    "normal form": ("caf\u00e9.toml", "cafe\u0301.toml"),
    "full width": ("boat.toml", "\uff42\uff4f\uff41\uff54.toml"),
    "a ligature": ("off.toml", "o\ufb00.toml"),
    "sharp s": ("gross.toml", "gro\u00df.toml"),
    "Kelvin": ("k.toml", "\u212a.toml"),
}


@pytest.mark.parametrize("kind", EQUAL)
def test_a_new_case_has_a_name_that_no_system_mixes_up(tmp_path: Path, kind: str) -> None:
    first, second = EQUAL[kind]
    assert names.folded(first) == names.folded(second)
    shelf.save(tmp_path, first, "title = 1", None)
    with pytest.raises(shelf.Conflict):
        shelf.save(tmp_path, second, "title = 2", None)
    assert [one.name for one in tmp_path.iterdir()] == [first]
    if not names.plain(second):  # no name of a case at all
        return
    # one that was there before can still be changed
    (tmp_path / second).write_text("title = 3", encoding="utf-8")
    shelf.save(tmp_path, second, "title = 4", shelf.digest(b"title = 3"))
    assert (tmp_path / second).read_text(encoding="utf-8") == "title = 4"


@pytest.mark.parametrize("given", [("Anna", "ANNA"), ("k", "\u212a")])
def test_users_with_equal_names(given: tuple[str, str]) -> None:
    with pytest.raises(UserError, match="is given twice"):
        users.users_of(given[:1], given[1:])
