"""Text sheets for people: numbered sections of at most 78 columns, plain ASCII except for names.

They go by mail, telex or radio. All texts of plans and of the decision to suspend are made here.
"""

import textwrap
from collections.abc import Iterable, Sequence

WIDE = 78
SYNTHETIC = "SYNTHETIC wind or current. NOT FOR OPERATIONS."


def text_sheet(
    title: str,
    case_title: str,
    run: str,
    sections: Iterable[tuple[str, Sequence[str]]],
    *,
    warnings: Iterable[str] = (),
    intro: Sequence[str] = (),
    conventions: str = "Times are UTC",
) -> str:
    """Return a text sheet.

    Args:
        title: of the sheet.
        case_title: title of the case.
        run: id of the run.
        sections: heading and lines of each.
        warnings: that stand before the sections.
        intro: lines before the warnings.
        conventions: of times and directions.
    """
    blocks = [[title, *paragraph(case_title), f"Run {run}. {conventions}."]]
    blocks += [list(intro)] if intro else []
    blocks += [paragraph(f"WARNING: {warning}") for warning in warnings]
    blocks += [[f"{number}  {head}", *body] for number, (head, body) in enumerate(sections, 1)]
    return "\n\n".join("\n".join(block) for block in blocks) + "\n"


def paragraph(words: str, indent: int = 0, hang: int | None = None) -> list[str]:
    """Return a paragraph wrapped to the page width.

    Args:
        words: of the paragraph.
        indent: blanks before its first line.
        hang: blanks before the others; None: as many.
    """
    first, rest = " " * indent, " " * (indent if hang is None else hang)
    return textwrap.wrap(
        words, WIDE, initial_indent=first, subsequent_indent=rest, break_long_words=False
    )
