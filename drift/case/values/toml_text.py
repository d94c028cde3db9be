"""Parse the TOML of a case, and reject what no case needs and what takes minutes to parse."""

import re
import tomllib
from typing import Any

MOST_PARTS = 50  # of a dotted key: the library's work grows with their square
# so many parts of a key before its last; \w in place of letters keeps the search simple
PART = r"""(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')[ \t]*+\.[ \t]*+"""
DOTTED = re.compile(rf"(?<![\w.-])(?:{PART}){{{MOST_PARTS}}}")


def parse_toml(text: str) -> dict[str, Any]:
    """Return the tables of a text.

    Args:
        text: TOML.

    Raises:
        ValueError: the text is not TOML, or a key has more than MOST_PARTS parts.
        RecursionError: values are nested too deeply.
    """
    if found := DOTTED.search(text):
        line = text.count("\n", 0, found.start()) + 1
        raise ValueError(
            f"a key that begins with {found[0][:20]!r} has more than {MOST_PARTS} parts between "
            f"dots (at line {line}, column 1)"
        )
    return tomllib.loads(text)
