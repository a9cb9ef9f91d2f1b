"""Errors of a scene, each with its key, its line and a message that does not presuppose the schema."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from difflib import get_close_matches
from typing import Any, NamedTuple, get_args, get_origin

from pydantic import BaseModel, ValidationError

from ..arguments import shown
from ..errors import SceneError, StvkError, nearest
from .schema.quantities import bare, is_union, literals, members
from .source import SceneSource, refuse_all
from .syntax import Loc, path_of, value_text

#: Expected values in words of TOML, by pydantic's type of error; others are in pydantic's words.
EXPECTED = {
    "float_type": "a number",
    "int_type": "a whole number",
    "string_type": "text in quotation marks",
    "bool_type": "true or false",
    "list_type": "a list in [brackets]",
    **dict.fromkeys(("dict_type", "model_type", "model_attributes_type"), "a table"),
}
#: Values in tables of places that are often written as lists of places; None for the place itself.
OF_PLACES = {"fixed": "xyz", "prescribed": {"x": 0.01}, "probes": None, "reactions": None}
#: Expected texts by their pattern.
PATTERNS = {
    "^[xyz]+$": 'letters of components, such as "xyz" or "y"',
    r"\.(pvd|vtu)$": "a name that ends in .pvd (series of states) or .vtu (last state)",
    r"\.(gif|mp4)$": "a name that ends in .gif or .mp4",
}
#: Pydantic's words for an expected value, a comparison, or a number of entries.
SHOULD = re.compile(r"\w+ should (?:be|have) (.*?)(?: after validation.*)?")


class SchemaLocation(NamedTuple):
    """Location of an error in the data, with the model of the table there and the type of the key."""

    loc: Loc
    model: type[BaseModel] | None
    annotation: Any


class Complaints:
    """Errors of a scene, collected so that one message lists them all.

    >>> complaints = Complaints(SceneSource.parse("[analysis]\\ndt = -1"))
    >>> complaints.add(("analysis", "dt"), "-1 is not above 0")
    >>> complaints.refuse()
    Traceback (most recent call last):
    skfem_stvk.errors.SceneError: scene.toml: analysis.dt, line 2: -1 is not above 0
    """

    def __init__(self, source: SceneSource) -> None:
        self._source = source
        self._found: dict[tuple[Loc, str], None] = {}

    def add(self, loc: Sequence[str | int], message: str) -> None:
        """Complain about a key, in words of a scene (`IN_TOML`); a repeated complaint is added once."""
        for advice, in_toml in IN_TOML.items():
            message = message.replace(advice, in_toml)
        self._found[tuple(loc), message] = None

    @contextmanager
    def at(self, *loc: str | int) -> Iterator[None]:
        """Turn any error of the package or the system that is raised within into a complaint about a key, and continue."""
        try:
            yield
        except SceneError as error:
            for path, _, message in error.complaints:
                self.add(loc, f"{path}: {message}" if path else message)
        except (StvkError, OSError) as error:
            self.add(loc, str(error))

    def of_pydantic(self, error: ValidationError, schema: type[BaseModel]) -> None:
        """Complain about all that pydantic found in data of this schema."""
        messages_at: dict[Loc, list[str]] = {}
        for one in error.errors(include_url=False):
            loc, message = _location_and_message(one, schema)
            messages_at.setdefault(loc, [])
            if message not in messages_at[loc]:
                messages_at[loc].append(message)
        for loc, messages in messages_at.items():
            self.add(loc, "; or ".join(messages))

    def refuse(self) -> None:
        """Raise SceneError with all complaints, in the order of the lines, if there are any."""
        rows = [(path_of(loc), self._source.line(loc), self._source.setting(loc), message) for loc, message in self._found]
        rows.sort(key=lambda row: (row[1] is None, row[1] or 0))
        texts = []
        for path, line, setting, message in rows:
            where = f", line {line}" if line is not None else f", from --set {setting}" if setting else ""
            texts.append(f"{path}{where}: {message}" if path else message)
        refuse_all(texts, self._source.name, [(path, line, message) for path, line, _, message in rows])


def _location_and_message(error: Any, schema: type[BaseModel]) -> tuple[Loc, str]:
    """Return the location of a pydantic error in the data, and its message."""
    location, kind, given = _locate(schema, error["loc"]), error["type"], error.get("input")
    if kind in ("union_tag_invalid", "union_tag_not_found"):
        return _kind_is_wrong(location, error)
    if kind == "missing":
        return location.loc, f"is missing{_description(location)}"
    if kind == "extra_forbidden":
        keys = sorted(location.model.model_fields) if location.model is not None else []
        return location.loc, _unknown("unknown key", str(location.loc[-1]), keys, "Known here")
    if kind == "literal_error":
        known = error["ctx"].get("names", literals(location.annotation))
        return location.loc, _unknown_value(given, list(map(str, known)))
    return location.loc, f"got {shown(given)}; expected {_expected(error, given, location.loc)}"


def _expected(error: Any, given: Any, loc: Loc) -> str:
    """Return the value that was expected, in words."""
    if error["type"] == "dict_type" and loc[-1] in OF_PLACES and isinstance(given, list) and given:
        table = {str(place): OF_PLACES[str(loc[-1])] or str(place) for place in given[:3]}
        return f"a table, such as {loc[-1]} = {value_text(table)}"
    if error["type"].startswith("model") and loc[0] == "expect" and isinstance(given, int | float):
        return f"a table, such as {loc[-1]} = {value_text({'value': given, 'rtol': 0.001})}"
    if error["type"] in EXPECTED:
        number = isinstance(given, str) and EXPECTED[error["type"]].endswith("number")
        return EXPECTED[error["type"]] + (" without quotation marks" if number else "")
    if error["type"] == "string_pattern_mismatch":
        return PATTERNS.get(error["ctx"]["pattern"], "a name without blanks at its ends")
    match = SHOULD.fullmatch(error["msg"])
    words = match[1] if match else str(error["msg"])
    return f"a value {words}" if words.startswith(("greater", "less")) else words


def _kind_is_wrong(location: SchemaLocation, error: Any) -> tuple[Loc, str]:
    """Return the message that lists the kinds of a table, which its key `type` or `model` selects."""
    context, given = error.get("ctx", {}), error.get("input")
    name = str(context.get("discriminator", "'type'")).strip("'")
    name = name if name.isidentifier() else "type"
    known = [tag for tag in _kinds(location) if tag != "file"]
    listed = ", ".join(known)
    of_file = ", or file = the path of a mesh file" if "file" in _kinds(location) else ""  # which has no type
    if not isinstance(given, Mapping):
        return location.loc, f"got {shown(given)}; expected a table with {name} = one of {listed}"
    if name not in given:
        near = get_close_matches(name, map(str, given), n=1)
        if near:
            return (*location.loc, near[0]), f"unknown key; did you mean {name!r}? It selects the kind: one of {listed}"
        return location.loc, f"the key {name!r} is missing, which selects the kind: one of {listed}{of_file}"
    return (*location.loc, name), _unknown_value(given[name], known)


def _unknown(what: str, name: str, known: Sequence[str], known_words: str = "Known") -> str:
    """Return the message on an unknown name, with the nearest one and all that are known."""
    near = nearest(name, known)
    return f"{what}{f'; did you mean {near!r}?' if near else '.'} {known_words}: {', '.join(known)}."


def _unknown_value(given: Any, known: Sequence[str]) -> str:
    return _unknown(f"{shown(given)} is not known here", str(given).replace("_", "-"), known)


#: Advice of messages to programs, and the same advice to scenes.
IN_TOML = {
    "Fix more components (fixed={place: 'xyz'}), prescribe them, or add an ElasticFoundation.": (
        'Fix more components ([fixed] place = "xyz"), prescribe them ([prescribed] place = { x = 0.0 }), or add a term of type = '
        '"elastic-foundation".'
    ),
    "or take the vertices out with a predicate.": ('or name other nodes: [places] some = { type = "nodes", ids = [...] }.'),
    "Prescribe a function of t that starts at u0, or start from an equilibrium: u0=solve_static(...).u.": (
        'Give them a time, such as time = { type = "ramp", until = 0.1 }, or start from an equilibrium: [initial] file = '
        '"static.vtu".'
    ),
    "Add Gravity(...), or give u0 or v0.": 'Add a term such as type = "gravity", or [initial] velocity = [...] or file = "...".',
    "Take fewer unknowns, or allow more: most_memory=.": "Take fewer unknowns.",
}


def _description(location: SchemaLocation) -> str:
    """Return the sentence of a key."""
    found = location.model.model_fields.get(str(location.loc[-1])) if location.model is not None and location.loc else None
    return f": {found.description.rstrip('.')}" if found is not None and found.description else ""


# conversion from the location of an error to the data: pydantic includes the members of unions in it


def _locate(schema: type[BaseModel], loc: Sequence[str | int]) -> SchemaLocation:
    """Return the location of an error in the data and the model of its table, by following the types of the schema."""
    annotation: Any = schema
    model: type[BaseModel] | None = None
    data: list[str | int] = []
    rest = [one for one in loc if one != "[key]"]
    while rest:
        annotation, _ = bare(annotation)
        if is_union(annotation):
            member = _member(annotation, rest[0])
            if member is None:
                break
            annotation, consumed = member
            rest = rest[consumed:]
        elif isinstance(annotation, type) and issubclass(annotation, BaseModel):
            model, name = annotation, rest.pop(0)
            data.append(name)
            found = annotation.model_fields.get(str(name))
            annotation = None if found is None else found.annotation
        elif get_origin(annotation) in (dict, list):
            data.append(rest.pop(0))
            annotation, model = get_args(annotation)[-1], None
        else:
            break
    return SchemaLocation(tuple(data), model, annotation)


def _member(annotation: Any, label: str | int) -> tuple[Any, int] | None:
    """Return the union member for a label of pydantic, and how many parts of the location it takes; None if none matches."""
    found = list(members(annotation))
    for tags, one in found:
        if str(label) in tags:
            return one, 1
    if len(found) == 1:
        return found[0][1], 0
    for _, one in found:  # pydantic labels plain members by their type
        inner, _ = bare(one)
        name = inner.__name__ if isinstance(inner, type) and get_origin(inner) is None else str(inner)
        if isinstance(label, str) and (label == name or (get_origin(inner) is list and label.startswith("list["))):
            return one, 1
    return None


def _kinds(location: SchemaLocation) -> list[str]:
    """Return the kinds of a table that are allowed at a location."""
    annotation = location.annotation
    return [tag for tags, _ in members(annotation) for tag in tags] if annotation is not None else []
