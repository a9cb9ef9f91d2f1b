"""Output from the schema of scenes: commented examples, the page of all keys, and JSON Schema for editors."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from textwrap import fill
from typing import Any, NamedTuple, get_args, get_origin

from pydantic import BaseModel
from pydantic_core import PydanticUndefined

from ..arguments import choice
from ..terms.loads.rigid_shapes import SHAPES
from ..units import UNITS, UnitSystem
from .schema import scene_tables
from .schema.quantities import bare, dimension_of, is_union, literals, members
from .syntax import Loc, lines_of, parsed, value_text

#: Column of the sentences after the values of examples.
COLUMN = 40
#: Characters in a line of the page of keys, outside its tables.
WIDEST = 128
#: Words for types of values.
WORDS = {float: "number", int: "whole number", bool: "true or false", str: "text", list: "list", dict: "table"}
BOUNDS = {"gt": ">", "ge": ">=", "lt": "<", "le": "<="}

_BEAM = """
[mesh]
type = "box"
size = [0.4, 0.05, 0.05]
cells = [16, 2, 2]
element = "hexahedra"

[materials.steel]
model = "isotropic"
young = 210e9
poisson = 0.3
density = 7850

[[terms]]
type = "stvk"
material = "steel"
"""
_WEIGHT = """
[[terms]]
type = "gravity"
g = [0, 0, -9.81]
"""
_FIXED = """
[fixed]
left = "xyz"
"""
#: A scene of each kind that solves as it stands.
EXAMPLES = {
    "static": f"""title = "A beam that is held at one end and loaded at the other"
units = "SI"
{_BEAM}{_WEIGHT}
[[terms]]
type = "traction"
on = "right"
traction = [0, 0, -2e6]
{_FIXED}
[analysis]
type = "static"
steps = 10

[output]
file = "beam.pvd"
probes = {{ tip = [0.4, 0.025, 0.025] }}
reactions = {{ wall = "left" }}
plots = ["tip", "path"]

[expect]
wall.z = {{ value = 5077, rtol = 1e-3 }}
""",
    "arc-length": """title = "A column that buckles, pushed a little to the side"
units = "SI"

[mesh]
type = "box"
size = [1.0, 0.05]
cells = [20, 2]
degree = 2

[materials.rubber]
model = "isotropic"
young = 1e6
poisson = 0.45

[[terms]]
type = "stvk"
material = "rubber"

[[terms]]
type = "traction"
on = "right"
traction = [-4e3, 10]

[fixed]
left = "xy"

[analysis]
type = "arc-length"
steps = 20

[analysis.stop]
displacement = { at = "right", component = "y", value = 0.3 }

[output]
file = "column.pvd"
probes = { tip = "right" }
plots = ["tip", "path"]

[expect]
tip.y = { value = 0.3, atol = 1e-9 }
""",
    "dynamic": f"""title = "A beam that is held at one end, and let go under its weight with a kick"
units = "SI"
{_BEAM}{_WEIGHT}{_FIXED}
[initial]
velocity = [0, 0, -2.0]

[analysis]
type = "dynamic"
integrator = "energy-momentum"
dt = 2e-4
until = 0.01

[output]
file = "beam.pvd"
every = 10
probes = {{ tip = [0.4, 0.025, 0.025] }}
plots = ["ledger", "tip"]

[expect]
energy.closure = {{ value = 0, atol = 1e-6 }}
""",
    "modes": f"""title = "Natural modes of a beam that is held at one end"
units = "SI"
{_BEAM}{_FIXED}
[analysis]
type = "modes"
n = 6

[output]
file = "modes.pvd"

[expect]
modes.rigid = {{ value = 0, atol = 0 }}
""",
}


class KeyRow(NamedTuple):
    """A key of a table: its name, type, default, dimension and sentence."""

    name: str
    type: str
    default: Any  # PydanticUndefined if it is required
    dimension: str | None
    sentence: str


def example(kind: str) -> str:
    """Return a commented scene of this kind that solves without changes; omitted keys are comments in it.

    Raises StvkError for an unknown kind.

    >>> print("\\n".join(example("modes").splitlines()[4:7]))
    [mesh]
    type = "box"                             # A box along the axes, in one, two or three dimensions; ...
    size = [0.4, 0.05, 0.05]                 # Length along each axis [m]
    """
    text = EXAMPLES[choice("init: type", kind, EXAMPLES)]
    data, lines, rows = parsed(text, kind), lines_of(text), text.splitlines()
    units = UNITS[data["units"]]
    added: dict[int, list[str]] = {}
    for loc, model, table in _tables_in(data, scene_tables(), ()):
        keys = {row.name: row for row in rows_of(model)}
        own = {name: line for name in table if name in keys and (line := lines.get((*loc, name)))}
        written = {name: line for name, line in own.items() if rows[line - 1].startswith(name)}
        for name, line in written.items():
            if name != "title":
                rows[line - 1] = _commented(rows[line - 1], keys[name], units)
        if not loc or not rows[lines[loc] - 1].startswith("["):
            continue  # the optional keys of a whole scene are too many; tables in braces end on their line
        for name in sorted(keys.keys() - table.keys()):
            default = keys[name].default
            if default is not PydanticUndefined and not isinstance(default, BaseModel | dict | list):
                given = "..." if default is None else value_text(default)
                line = max(written.values(), default=lines[loc])
                added.setdefault(line, []).append(_commented(f"# {name} = {given}", keys[name], units))
    out = ["# A scene: `skfem-stvk solve FILE` solves it, `skfem-stvk init --keys` prints all keys."]
    for number, row in enumerate(rows, 1):
        out += [row, *added.get(number, [])]
    return "\n".join(out) + "\n"


def _commented(line: str, row: KeyRow, units: UnitSystem) -> str:
    unit = "" if row.dimension is None else f" [{units.symbol(row.dimension)}]"
    return f"{line:{COLUMN}} # {row.sentence.rstrip('.')}{unit}"


def _tables_in(data: Any, annotation: Any, loc: Loc) -> Iterator[tuple[Loc, type[BaseModel], Mapping[str, Any]]]:
    """Yield the tables within data of this type, with their models."""
    annotation, _ = bare(annotation)
    if isinstance(data, dict):
        for tags, one in members(annotation):
            inner, _ = bare(one)
            if isinstance(inner, type) and issubclass(inner, BaseModel):
                kind = data.get("type", data.get("model"))
                if (kind in tags or not tags) if kind is not None else data.keys() <= inner.model_fields.keys():
                    yield loc, inner, data
                    for name, value in data.items():
                        yield from _tables_in(value, inner.model_fields[name].annotation, (*loc, name))
                    return
            elif get_origin(inner) is dict:
                for name, value in data.items():
                    yield from _tables_in(value, get_args(inner)[1], (*loc, name))
                return
    elif isinstance(data, list):
        for _, one in members(annotation):
            inner, _ = bare(one)
            if get_origin(inner) is list:
                for number, value in enumerate(data):
                    yield from _tables_in(value, get_args(inner)[0], (*loc, number))
                return


def rows_of(model: type[BaseModel]) -> list[KeyRow]:
    """Return the keys of a table, its kind first."""
    rows = []
    for name, found in model.model_fields.items():
        kind = _type_in_words(found.annotation, (*found.metadata, found))
        sentence = found.description or " ".join((model.__doc__ or "").split())
        rows.append(KeyRow(name, kind, found.default, dimension_of(found), sentence))
    return sorted(rows, key=lambda row: row.name not in ("type", "model"))


def _type_in_words(annotation: Any, metadata: tuple[Any, ...] = ()) -> str:
    annotation, more = bare(annotation)
    metadata = (*metadata, *more)
    if values := literals(annotation, metadata):
        return " or ".join(json.dumps(value) for value in values)
    if is_union(annotation):
        words = [_type_in_words(one, metadata) for _, one in members(annotation)]
        return " or ".join(dict.fromkeys(words))
    limits = [f"{BOUNDS[name]} {getattr(one, name):g}" for one in metadata for name in BOUNDS if hasattr(one, name)]
    bounds = f" {', '.join(dict.fromkeys(limits))}" if limits else ""
    if get_origin(annotation) is list:
        return f"list of {_plural(_type_in_words(get_args(annotation)[0]))}"
    if get_origin(annotation) is dict:
        return f"by name: {_type_in_words(get_args(annotation)[1])}"
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return f"[{title_of(annotation)}](#{title_of(annotation).replace(' ', '-').lower()})"
    return WORDS.get(annotation, str(annotation)) + bounds


def _plural(word: str) -> str:
    first, space, rest = word.partition(" ")
    return f"{first}s{space}{rest}" if first in ("number", "list") else f"whole numbers{rest[6:]}" if first == "whole" else word


def title_of(model: type[BaseModel]) -> str:
    """Return the name of a table on the page: its kind, or its own name."""
    for name in ("type", "model"):
        if name in model.model_fields and model.__name__ not in TITLES:
            (kind,) = literals(model.model_fields[name].annotation)
            return str(kind)
    return TITLES.get(model.__name__, model.__name__)


#: Names of tables that differ from their kind, or from their class.
TITLES = {
    "SceneTables": "Scene",
    "MeshFile": "Mesh file",
    "BoxPlace": "Box of nodes",
    "Initial": "Initial state",
    "StopRule": "Stop",
    "DisplacementLevel": "Level",
    "ReducedBasis": "Reduced basis",
    "Prescribed": "Displacements",
    "FrictionDerived": "Friction",
    **{f"{kind.capitalize()}Shape": f"Rigid {kind}" for kind in SHAPES},
}


def tables() -> list[type[BaseModel]]:
    """Return all tables of a scene, in the order in which the schema names them."""
    found: dict[type[BaseModel], None] = {}

    def visit(annotation: Any) -> None:
        annotation, _ = bare(annotation)
        if isinstance(annotation, type) and issubclass(annotation, BaseModel):
            if annotation not in found:
                found[annotation] = None
                for one in annotation.model_fields.values():
                    visit(one.annotation)
        elif is_union(annotation) or get_origin(annotation) in (list, dict):
            for one in get_args(annotation):
                visit(one)

    visit(scene_tables())
    return list(found)


def page() -> str:
    """Return the docs' page of all keys, printed by `skfem-stvk init --keys`."""
    parts = [
        "# All keys of a scene\n",
        "Printed by `skfem-stvk init --keys` from the schema that checks scenes; `skfem-stvk init --schema` prints JSON\n"
        'Schema for editors. Units are those of `units = "SI"`. [Scenes](../how-to/scenes.md) says how they go together.\n',
    ]
    for model in tables():
        parts.append(f"## {title_of(model)}\n\n{fill(model.__doc__ or '', WIDEST, break_on_hyphens=False)}\n")
        parts.append("| key | type | default | unit | |\n|---|---|---|---|---|")
        for row in rows_of(model):
            unit = "" if row.dimension is None else UNITS["SI"].symbol(row.dimension)
            sentence = row.sentence.replace("|", r"\|")
            parts.append(f"| `{row.name}` | {row.type} | {_default(row.default)} | {unit} | {sentence} |")
        parts.append("")
    return "\n".join(parts).rstrip() + "\n"


def _default(value: Any) -> str:
    if value is PydanticUndefined:
        return "required"
    if isinstance(value, BaseModel):
        value = value.model_dump(exclude_none=True, exclude_defaults=True)
    return "" if value is None or value == {} or value == [] else f"`{json.dumps(value)}`"


def json_schema() -> str:
    """Return JSON Schema of scenes, by which editors complete and check them."""
    return json.dumps(scene_tables().model_json_schema(), indent=1) + "\n"
