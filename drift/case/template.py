"""Commented cases to begin with, one a kind of incident: what `drift new` writes."""

from importlib import resources
from pathlib import Path

from geo.errors import UserError

TEMPLATES = {
    "position": "adrift from a reported position",
    "passage": "overdue on passage: under way, then adrift, or late",
    "spill": "many objects released by one event, and where they come ashore",
    "search": "sorties that found nothing, and units for the next search",
}
# of drift track
TRACKED = {"contact": "a contact that was lost: its track by the detections there are"}


def template_text(name: str) -> str:
    """Return the text of a template; raise UserError for a name that is none of theirs."""
    if name not in TEMPLATES | TRACKED:
        listed = ", ".join(f"{own} ({words})" for own, words in (TEMPLATES | TRACKED).items())
        raise UserError(f'no template "{name}"; there are: {listed}')
    return (
        resources.files("cases").joinpath("templates", f"{name}.toml").read_text(encoding="utf-8")
    )


def write(name: str, path: Path) -> None:
    """Write a template to a new file; raise UserError where that cannot be, or is there already."""
    words = template_text(name)
    if path.suffix != ".toml":
        raise UserError(f"{str(path)[:300]!a}: a case file ends in .toml")
    try:
        with open(path, "x", encoding="utf-8", newline="\n") as file:
            file.write(words)
    except FileExistsError:
        raise UserError(
            f"{path}: is there already, and is not replaced; name another file"
        ) from None
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise UserError(
            f"{str(path)[:300]!a}: cannot be written ({reason}); name another file"
        ) from None
