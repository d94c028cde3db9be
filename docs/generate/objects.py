"""The reference of Python: every public object, its signature as it is written, its docstring, and
what it returns.
"""

import ast
import dataclasses
import inspect
import re
import textwrap
import tokenize
from collections.abc import Iterable, Iterator
from io import StringIO
from typing import Any, get_args

import drift

INTRODUCTION = """# Python

Every public name, `import drift` has them all. They are imported at their first use, and typed. Arrays are NumPy's, maps and tables
xarray's and pandas'. SI units and radians inside, degrees at the door; times are `datetime64`, UTC. `UserError` is what all of them raise for what can be mended.

```python
import drift

case = drift.load("overdue_boat")
result = drift.run(case)
```

What many of them take:

- `out`: a folder, which is written completely or not at all; without it nothing is written. `overwrite`: whether results that it holds are replaced.
- `datasets`: the xarray.Datasets that the case's sources name, by their names there.
- `threads`: of the processor, all by default; `backend`: `"cpu"`, `"cuda"`, `"vulkan"`, `"metal"` or `"auto"`.
- `report`: a function that is told what is being done and how much of it is done, as a share.

Guides: [for scientists](../tutorials/scientist.md), [read results in Python](../howto/results.md), [many forecasts](../howto/many.md)."""


def _tree(thing: Any) -> Any:
    return ast.parse(textwrap.dedent(inspect.getsource(thing))).body[0]


def _defaults(arguments: ast.arguments) -> Iterator[tuple[str, tuple[list[Any], int]]]:
    """Give each argument that has a default by name, with the list and the place where that stands."""
    plain = [*arguments.posonlyargs, *arguments.args]
    for k, argument in enumerate(plain[len(plain) - len(arguments.defaults) :]):
        yield argument.arg, (arguments.defaults, k)
    for k, argument in enumerate(arguments.kwonlyargs):
        if arguments.kw_defaults[k] is not None:
            yield argument.arg, (arguments.kw_defaults, k)


def signature(function: Any) -> str:
    """Return arguments and result as the source has them."""
    node = _tree(function)
    for argument, kept in _defaults(node.args):
        value = inspect.signature(function).parameters[argument].default
        if isinstance(value, int | float):  # a constant of its module says less than its value
            kept[0][kept[1]] = ast.Constant(value)
    arguments = ast.unparse(node.args)
    if arguments.split(",")[0] == "self":
        arguments = arguments.partition("self")[2].lstrip(", ")
    result = f" -> {ast.unparse(node.returns)}" if node.returns is not None else ""
    return f"({arguments}){result}"


SECTION = re.compile(r"^(Args|Returns|Raises):\n((?: {4}.*\n?|\n(?= {4}))+)", re.MULTILINE)
HEADINGS = {"Args": "Arguments", "Returns": "Returns", "Raises": "Raises"}


def _section(match: re.Match[str]) -> str:
    """Return a section of a docstring as Markdown: items of arguments and errors, a paragraph of
    what is returned.
    """
    lines = textwrap.dedent(match[2])
    if match[1] != "Returns":
        items = re.split(r"\n(?! )", lines.strip())
        lines = "\n".join(
            re.sub(r"^([\w, ]+):", r"- `\1`:", " ".join(item.split())) for item in items
        )
        lines = re.sub(r"`(\w+), (\w+)`", r"`\1`, `\2`", lines)
    return f"**{HEADINGS[match[1]]}**\n\n{lines.strip()}\n\n"


def _docstring(thing: Any, names: Iterable[str] = ()) -> str:
    """Return a docstring as Markdown, with an item for each "name: meaning" of a parameter or
    field.
    """
    if SECTION.search(inspect.getdoc(thing) or ""):
        return SECTION.sub(_section, (inspect.getdoc(thing) or "") + "\n")
    text = re.sub(r"(?<![`\w])\*(?![\s*])", r"\*", inspect.getdoc(thing) or "").replace(
        "[[", "\\[["
    )
    listed = "|".join(map(re.escape, names))
    if listed:
        found = re.compile(rf"(?:^|(?<=[.;]\s))((?:{listed})(?:,\s(?:{listed}))*):\s", re.MULTILINE)
        text = found.sub(
            lambda match: (
                "\n- " + ", ".join(f"`{name}`" for name in re.split(r",\s", match[1])) + ": "
            ),
            text,
        )
        head, *items = re.split(r"\n+(?=- `)", text)
        items = [
            re.sub(r"\s*\n(?!\n)", " ", item) if "\n\n" not in item else item for item in items
        ]
        text = "\n".join([head, "", *items]) if items else head
    return re.sub(r"(?<=[.;]) (?=Raises )", "\n\n", text)


def _comments(cls: type) -> dict[str, str]:
    """Return what stands behind the fields of a record, or below them as a string."""
    source = textwrap.dedent(inspect.getsource(cls))
    body = _tree(cls).body
    said = {
        token.start[0]: token.string.lstrip("# ")
        for token in tokenize.generate_tokens(StringIO(source).readline)
        if token.type == tokenize.COMMENT
    }
    found = {}
    for node, after in zip(body, [*body[1:], None], strict=True):
        if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
            below = (
                isinstance(after, ast.Expr)
                and isinstance(after.value, ast.Constant)
                and isinstance(after.value.value, str)
            )
            words = after.value.value if below else said.get(node.end_lineno or node.lineno, "")  # type: ignore[union-attr]
            found[node.target.id] = (ast.unparse(node.annotation), words)
    return found  # type: ignore[return-value]


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("\n", " ").replace("[[", "\\[[")


def function(name: str, thing: Any, of: str = "py:function") -> str:
    """Return the entry of a function or method."""
    said = _docstring(thing, inspect.signature(thing).parameters)
    return f"::::{{{of}}} {name}{signature(thing)}\n{said}\n::::"


def record(name: str, cls: type) -> str:
    """Return the entry of a class: its fields, its properties and methods."""
    fields = (
        [field.name for field in dataclasses.fields(cls)] if dataclasses.is_dataclass(cls) else []
    )
    parts = [f":::::{{py:class}} {name}", _docstring(cls, fields)]
    if dataclasses.is_dataclass(cls):
        rows = [
            f"| `{field}` | `{_cell(kind)}` | {_cell(words)} |"
            for field, (kind, words) in _comments(cls).items()
        ]
        parts.append("\n".join(["| field | type | what |", "|---|---|---|", *rows]))
    for member, value in vars(cls).items():
        if member.startswith("_"):
            continue
        if isinstance(value, property):
            parts.append(
                f"::::{{py:property}} {member}\n:type: {ast.unparse(_tree(value.fget).returns)}\n\n{_docstring(value)}\n::::"
            )
        elif inspect.isfunction(value):
            parts.append(function(member, value, "py:method"))
    return "\n\n".join([*parts, ":::::"])


def _returned(thing: Any) -> list[type]:
    kind = inspect.signature(thing).return_annotation
    kinds = [kind, *get_args(kind)]
    return [one for one in kinds if inspect.isclass(one) and one.__module__.startswith("drift.")]


def page() -> str:
    """Return the page of all public objects."""
    parts = [INTRODUCTION, "## Functions"]
    public = {
        name: getattr(drift, name) for name in sorted(drift.__all__) if not name.startswith("__")
    }
    functions = {name: thing for name, thing in public.items() if inspect.isfunction(thing)}
    classes = {name: thing for name, thing in public.items() if inspect.isclass(thing)}
    parts += [function(f"drift.{name}", thing) for name, thing in functions.items()]
    parts += ["## Records", *(record(f"drift.{name}", thing) for name, thing in classes.items())]
    known = set(classes.values())
    others = dict.fromkeys(
        kind for thing in functions.values() for kind in _returned(thing) if kind not in known
    )
    parts += [
        "## What functions return besides",
        *(record(f"{kind.__module__}.{kind.__qualname__}", kind) for kind in others),
    ]
    return "\n\n".join(parts) + "\n"


def count() -> int:
    """Return the number of public names."""
    return len(drift.__all__)
