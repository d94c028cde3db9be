"""Routes of the API with what they take and answer, and their description for other programs.

A route and its description are one object, so the description cannot lag behind. It is OpenAPI 3.1,
whose schemas are JSON Schema 2020-12.
"""

import inspect
import re
from collections.abc import Callable, Iterable
from typing import Any

from starlette.convertors import IntegerConvertor
from starlette.routing import BaseRoute, Route

from drift.apps.serve import names
from drift.version import __version__

Schema = dict[str, Any]

ANYTHING: Schema = {}
TEXT: Schema = {"type": "string"}
NUMBER: Schema = {"type": "number"}
COUNT: Schema = {"type": "integer", "minimum": 0}
FLAG: Schema = {"type": "boolean"}
CASE: Schema = {"type": "string", "pattern": r"\.toml$", "maxLength": names.LONGEST}
DIGEST: Schema = {"type": "string", "pattern": "^[0-9a-f]{64}$"}
NOTHING: Schema = {"type": "object", "additionalProperties": False}
OBJECT: Schema = {"type": "object"}


def record(optional: Iterable[str] = (), **members: Schema) -> Schema:
    """Return the schema of an object with these members and no others."""
    return {
        "type": "object",
        "properties": members,
        "required": [name for name in members if name not in set(optional)],
        "additionalProperties": False,
    }


def many(member: Schema) -> Schema:
    """Return the schema of a list."""
    return {"type": "array", "items": member}


def or_null(schema: Schema) -> Schema:
    """Return the schema of a value that may be missing."""
    return {"anyOf": [schema, {"type": "null"}]}


ERROR = record(error=TEXT)
MISTAKES = record(mistakes=many(TEXT))


class Operation(Route):
    """A route with what it takes and answers.

    takes: the body of a POST request. answers: of the status 200; None for a file. reads: it changes
    nothing, so guests may use it. mistakes: it may answer with mistakes of a case instead.
    """

    def __init__(
        self,
        method: str,
        path: str,
        handler: Callable[..., Any],
        answers: Schema | None,
        *,
        takes: Schema | None = None,
        reads: bool = False,
        mistakes: bool = False,
    ) -> None:
        super().__init__(path, handler, methods=[method])
        self.takes, self.answers, self.mistakes = takes, answers, mistakes
        self.reads = reads or method == "GET"


def open_to_guests(routes: Iterable[BaseRoute]) -> frozenset[str]:
    """Return the paths of POST requests that change nothing."""
    return frozenset(
        route.path
        for route in routes
        if isinstance(route, Operation) and route.reads and "POST" in (route.methods or ())
    )


def document(routes: Iterable[BaseRoute]) -> dict[str, Any]:
    """Return the description of all routes besides those of the page itself."""
    paths: dict[str, dict[str, Any]] = {}
    for route in routes:
        if isinstance(route, Route) and route.path.startswith(("/api/", "/runs/")):
            path = re.sub(r":\w+}", "}", route.path)
            for method in sorted((route.methods or set()) - {"HEAD"}):
                paths.setdefault(path, {})[method.lower()] = _described(route, method)
    return {
        "openapi": "3.1.0",
        "info": {
            "title": "drift serve",
            "version": __version__,
            "description": "Cases, jobs and results of the served folder.",
        },
        "paths": paths,
        "security": [{"token": []}],
        "components": {
            "securitySchemes": {"token": {"type": "http", "scheme": "bearer"}},
            "schemas": {"Error": ERROR, "Mistakes": MISTAKES},
        },
    }


def _described(route: Route, method: str) -> dict[str, Any]:
    """Return the description of a route; one without schemas takes and answers anything."""
    own = route if isinstance(route, Operation) else None
    takes, answers = (own.takes, own.answers) if own else (OBJECT, ANYTHING)
    doc = inspect.getdoc(route.endpoint) or ""
    told: dict[str, Any] = {
        "summary": doc.partition("\n")[0],
        "parameters": [
            {"name": name, "in": "path", "required": True, "schema": _parameter(convertor)}
            for name, convertor in route.param_convertors.items()
        ],
        "responses": {
            "200": _answer(answers, own is not None and own.mistakes),
            "default": {
                "description": "an error, in a line",
                "content": _json({"$ref": "#/components/schemas/Error"}),
            },
        },
        "x-guests": own is not None and own.reads,
    }
    if method == "POST":
        body = OBJECT if takes is None else takes
        told["requestBody"] = {"required": True, "content": _json(body)}
    return told


def _parameter(convertor: object) -> Schema:
    return COUNT if isinstance(convertor, IntegerConvertor) else TEXT


def _answer(schema: Schema | None, mistakes: bool) -> dict[str, Any]:
    if schema is None:
        told = _json({"$ref": "#/components/schemas/Mistakes"}) if mistakes else {}
        return {"description": "the file", "content": {"*/*": {"schema": {}}, **told}}
    if mistakes:
        schema = {"anyOf": [schema, {"$ref": "#/components/schemas/Mistakes"}]}
    return {"description": "done", "content": _json(schema)}


def _json(schema: Schema) -> dict[str, Any]:
    return {"application/json": {"schema": schema}}
