"""Commented template cases, one per kind of incident, which `drift new` writes."""

from importlib import resources
from pathlib import Path

from geo.errors import UserError

TEMPLATES = {
    "position": "adrift from a reported position",
    "passage": "overdue on passage: under way, then adrift, or late",
    "spill": "many objects released by one event, and where they come ashore",
    "search": "sorties that found nothing, and units for the next search",
}
# templates of drift track
TRACKED = {"contact": "a lost contact: its track, estimated from its detections"}


def template_text(name: str) -> str:
    """Return the text of a template; raise UserError for an unknown name."""
    if name not in TEMPLATES | TRACKED:
        listed = ", ".join(f"{own} ({words})" for own, words in (TEMPLATES | TRACKED).items())
        raise UserError(f'no template "{name}"; there are: {listed}')
    return (
        resources.files("cases").joinpath("templates", f"{name}.toml").read_text(encoding="utf-8")
    )


def write(name: str, path: Path) -> None:
    """Write a template to a new file.

    Args:
        name: name of the template.
        path: the new file, ending in .toml.

    Raises:
        UserError: there is no such template, or the file exists or cannot be written.
    """
    words = template_text(name)
    if path.suffix != ".toml":
        raise UserError(f"{str(path)[:300]!a}: a case file ends in .toml")
    try:
        with open(path, "x", encoding="utf-8", newline="\n") as file:
            file.write(words)
    except FileExistsError:
        raise UserError(f"{path}: exists already and is not replaced; name another file") from None
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise UserError(
            f"{str(path)[:300]!a}: cannot be written ({reason}); name another file"
        ) from None
