"""The fields of the step "Search": rows such as sorties and finds of a case, its plan and its spill.

Each is a key of a table, such as "sortie.0.pattern.spacing"; "sortie.2" is a whole table, which is
added after the last one or removed. As with all fields of a form (`drift.apps.serve.fields.form`), the
text stays the truth, and what no field shows is left to it.
"""

import re
from collections.abc import Mapping, Sequence
from datetime import date, datetime
from typing import Any

from drift.apps.serve.fields import nodes, spill_fields
from drift.case.values import units
from geo import notation
from geo.errors import UserError

MOST = 50  # rows of a table that a form shows
LONGEST = 1000  # characters of a value
MOST_POSITIONS = 1000
TABLES: dict[str, tuple[str, ...]] = {
    "sortie": (
        "name",
        "unit",
        "start",
        "end",
        "speed",
        "sweep_width",
        "sweep_width.visibility",
        "sweep_width.wind",
        "sweep_width.seas",
        "altitude",
        "completed",
        "ashore",
        "pod",
        "track",
        "waypoints",
        *(
            f"pattern.{key}"
            for key in (
                "kind",
                "centre",
                "datum",
                "length",
                "width",
                "orientation",
                "spacing",
                "corner",
                "legs",
                "radius",
                "sectors",
                "waypoints",
                "offset",
                "return",
            )
        ),
        *(f"area.{key}" for key in ("centre", "length", "width", "orientation", "polygon")),
    ),
    "contact": (
        "name",
        "time",
        "belief",
        "of",
        "position.at",
        "position.error",
        "bearing.from",
        "bearing.bearing",
        "bearing.std",
        "bearing.far",
        "range.from",
        "range.range",
        "range.std",
    ),
    "unit": (
        "name",
        "kind",
        "base",
        "ready",
        "search_speed",
        "transit_speed",
        "endurance",
        "sensor",
        "sweep_width",
        "sweep_width.visibility",
        "sweep_width.wind",
        "sweep_width.seas",
        "altitude",
        "sweep_width_uncertainty",
        "daylight",
    ),
    **spill_fields.TABLES,
}
OF_SPILL = tuple(spill_fields.TABLES)
SINGLE = {  # tables that a case has once
    "plan": ("begin", "until", "separation", "rounds", "ashore"),
    "spill": spill_fields.KEYS,
}
SINGLE_FIELDS = tuple(f"{table}.{key}" for table, keys in SINGLE.items() for key in keys)
ROW = re.compile(rf"({'|'.join(map(re.escape, TABLES))})\.(\d{{1,2}})(?:\.(.+))?")
NUMBER = re.compile(r"\.\d+")
POSITIONS = ("waypoints", "polygon", "between")  # lists of positions
LISTS = (*POSITIONS, "stretches")  # lists of words
PLACES = ("at", "base", "centre", "datum", "from")  # one position

# keys of a spill that other fields show
ELSEWHERE = (
    "spill.class",
    "spill.loss",
    *(f"spill.{start}" for start in ("position", "trackline", "area")),
)

Place = tuple[str | int, ...]


def names_of(data: Mapping[str, Any]) -> list[str]:
    """Return the names of all fields of the tables of a case."""
    own = [
        f"{table}.{k}.{key}"
        for table, keys in TABLES.items()
        for k in range(_count(data, table))
        for key in keys
    ]
    return [*own, *SINGLE_FIELDS]


def rows_of(data: Any, table: str) -> Any:
    """Return the list of a table, such as "spill.class"; None if the case has none."""
    for key in table.split("."):
        data = data.get(key) if isinstance(data, dict) else None
    return data


def _count(data: Mapping[str, Any], table: str) -> int:
    rows = rows_of(data, table)
    return min(len(rows), MOST) if isinstance(rows, list) else 0


def is_field(name: str) -> bool:
    """Return whether a name is one of a field or of a whole table."""
    if name in SINGLE_FIELDS:
        return True
    row = ROW.fullmatch(name)
    return row is not None and int(row[2]) < MOST and (row[3] is None or row[3] in TABLES[row[1]])


def read_rows(data: Mapping[str, Any]) -> dict[str, Any]:
    """Return what the form shows of the tables of a case.

    Returns:
        `rows`: of each table a list; each row has the values of its fields, and `in_text`, the keys
        that only the text shows. `plan`, `spill`: the same of these.
    """
    rows = {
        table: [
            _row(rows_of(data, table)[k], f"{table}.", keys) for k in range(_count(data, table))
        ]
        for table, keys in TABLES.items()
    }
    numbers = spill_fields.numbers_of_classes(data.get("spill"))
    for row, number in zip(rows["spill.class"], numbers, strict=False):
        if number is not None:
            row["values"]["number"] = number
            row["in_text"] = [key for key in row["in_text"] if key != "share"]
    return {"rows": rows} | {
        table: _row(data[table] if isinstance(data.get(table), dict) else {}, f"{table}.", keys)
        for table, keys in SINGLE.items()
    }


def _row(row: Any, prefix: str, keys: Sequence[str]) -> dict[str, Any]:
    """Return the values of a table's fields, and the keys that only the text shows."""
    if not isinstance(row, dict):
        return {"values": {}, "in_text": [str(row)[:100]]}
    values, hidden = {}, list[str]()
    for name, value in _leaves(row, keys):
        if f"{prefix}{name}" in ELSEWHERE:
            continue
        shown = _shown(f"{prefix}{name}", value) if name in keys else None
        if shown is None:
            hidden.append(name)
        else:
            values[name] = shown
    return {"values": values, "in_text": hidden}


def _leaves(row: Mapping[str, Any], keys: Sequence[str]) -> list[tuple[str, Any]]:
    """Return the names and values of a table; keys of an inner table that has fields have dots."""
    found = []
    for key, value in row.items():
        if isinstance(value, dict) and any(name.startswith(f"{key}.") for name in keys):
            found += [(f"{key}.{inner}", one) for inner, one in value.items()]
        else:
            found.append((key, value))
    return found


def _shown(name: str, value: Any) -> Any:
    """Return a value as a form shows it; None: it cannot."""
    last = name.rpartition(".")[2]
    if name == "spill.track":
        return spill_fields.shown_track(value)
    if isinstance(value, list) and len(value) == 2 and name in spill_fields.RANGES:
        pair = [_shown("", one) for one in value]
        return None if None in pair else pair
    try:
        if last == "stretches" and isinstance(value, list):
            return value if all(isinstance(one, str) for one in value) else None
        if last in POSITIONS:
            return [_spelled(one) for one in value] if isinstance(value, list) else None
        if last in PLACES:
            return _spelled(value)
    except (ValueError, TypeError, KeyError, AttributeError, OverflowError):
        return None
    if isinstance(value, datetime | date):
        return value.isoformat()
    return value if nodes.plain(value) else None


def _spelled(value: Any) -> str:
    """Return a position as text, as it is written if it is text; waypoints with times have none."""
    if isinstance(value, str):
        return value
    lon, lat = units.position(value)
    return str(notation.position(lon, lat))


def hidden_keys(data: Mapping[str, Any]) -> list[str]:
    """Return the keys of these tables that only the text shows."""
    read = read_rows(data)
    found = [f"{table}.{key}" for table in SINGLE for key in read[table]["in_text"]]
    for table, rows in read["rows"].items():
        if not isinstance(rows_of(data, table), list | None):
            found.append(table)
        found += [f"{table}.{k}.{key}" for k, row in enumerate(rows) for key in row["in_text"]]
    return found


def check_value(field: str, value: Any) -> None:
    """Reject a value that a field cannot hold; whether it makes sense, the check says."""
    row = ROW.fullmatch(field)
    if value is None:
        return
    if row is None or row[3] is not None:
        _check_one(field, value)
        return
    if not isinstance(value, dict) or not value:
        raise UserError(f"{field}: give the keys of a new table, or nothing to remove it")
    for key, one in value.items():
        inner = one.items() if isinstance(one, dict) else [("", one)]
        for name, leaf in inner:
            whole = f"{key}.{name}" if name else str(key)
            if whole not in TABLES[row[1]]:
                raise UserError(f"{field}: there is no field {whole[:100]!r}")
            _check_one(f"{field}.{whole}", leaf)


def _check_one(field: str, value: Any) -> None:
    last, plain = field.rpartition(".")[2], NUMBER.sub("", field)
    if last in LISTS or (plain == "spill.track" and not isinstance(value, str)):
        if not isinstance(value, list) or not 1 <= len(value) <= MOST_POSITIONS:
            raise UserError(
                f"{field}: give a list of {'names' if last == 'stretches' else 'positions'}"
            )
        for one in value:
            check_words(field, one)
    elif isinstance(value, list) and len(value) == 2 and plain in spill_fields.RANGES:
        for one in value:
            _check_one(field, one)
    elif isinstance(value, bool):
        return
    elif isinstance(value, int | float):
        if not abs(value) < 1e15:  # neither is NaN
            raise UserError(f"{field}: {value} is too large a number")
    else:
        check_words(field, value)


def check_words(field: str, value: Any) -> None:
    """Reject a value that is not one line of text."""
    if not isinstance(value, str) or len(value) > LONGEST or not value.isprintable():
        raise UserError(f"{field}: give one line of at most {LONGEST} characters")


def place_of(field: str) -> Place:
    """Return the keys and list indices of a field in the tables of a case."""
    return tuple(int(part) if part.isdecimal() else part for part in field.split("."))


def check_place(data: Mapping[str, Any], field: str) -> None:
    """Reject a field whose table does not exist, or whose value only the text can change."""
    row = ROW.fullmatch(field)
    table = row[1] if row else field.partition(".")[0]
    rows = rows_of(data, table)
    if rows is None:
        rows = [] if row else {}
    if not isinstance(rows, list if row else dict):
        raise UserError(f"{table} is set in the text; change it there")
    if row is None:
        one, key = rows, field.partition(".")[2]
    else:
        if int(row[2]) > len(rows) or (int(row[2]) == len(rows) and row[3] is not None):
            raise UserError(f"{field}: there is no such {table}")
        if row[3] is None:
            return
        one, key = rows[int(row[2])], row[3]
    hidden = _row(one, f"{table}.", TABLES[table] if row else SINGLE[table])["in_text"]
    if any(name == key or name.startswith(f"{key}.") for name in hidden):
        raise UserError(f"{field} is set in the text; change it there")


def set_key(node: Any, field: str, value: Any) -> None:
    """Set or remove a key or a whole table, in a document of tomlkit or in plain tables."""
    row = ROW.fullmatch(field)
    if row is None:
        table, _, key = field.partition(".")
        if table not in node:
            if value is None:
                return
            node[table] = nodes.table_beside(node, {}, inline=False)
        if field == "spill.track":
            value = spill_fields.written_track(node, value)
            if value is not None:
                spill_fields.clear_other_starts(node[table], "track")
        _set_inside(node[table], key.split("."), value)
    elif row[3] is None:
        _set_row(node, row[1], int(row[2]), value)
    elif row[1] == "spill.class" and row[3] == "number":
        spill_fields.set_number(node, int(row[2]), value)
    else:
        _set_inside(rows_of(node, row[1])[int(row[2])], row[3].split("."), value)


def _set_row(node: Any, table: str, number: int, value: Any) -> None:
    """Add a table after the last, or remove or replace one."""
    many = rows_of(node, table)
    many = [] if many is None else many
    if value is None:
        if number < len(many):
            if table == "spill.class":
                spill_fields.remove_class(node, number)
            else:
                del many[number]
        *above, last = table.split(".")
        holder = rows_of(node, ".".join(above)) if above else node
        if holder is not None and last in holder and not len(many):
            del holder[last]
        return
    if number < len(many):
        raise UserError(f"{table}.{number} exists already")
    add_row(node, table, value)


def add_row(node: Any, table: str, row: Mapping[str, Any]) -> None:
    """Add a table after the last of its kind."""
    *above, last = table.split(".")
    holder = rows_of(node, ".".join(above)) if above else node
    if last not in holder:
        holder[last] = nodes.list_of_tables(node)
    made = nodes.table_beside(node, {}, inline=False)
    nodes.begin_after_blank_line(made)
    for key, one in row.items():
        made[key] = nodes.table_beside(node, one) if isinstance(one, dict) else one
    if table == "spill.class":
        spill_fields.add_class(node, made)
    else:
        holder[last].append(made)


def _set_inside(row: Any, keys: list[str], value: Any) -> None:
    """Set or remove a key of a table, or of a table in it, which takes the place of a plain value."""
    *above, last = keys
    if not above:
        nodes.put(row, last, value)
        return
    (inner,) = above
    if not isinstance(row.get(inner), dict):
        if value is None:
            return
        row[inner] = nodes.table_beside(row, {})
    nodes.put(row[inner], last, value)
    if not row[inner]:
        del row[inner]
