"""Tables of a scene that are derived from the library: a key for each parameter that declares a `Quantity`."""

from __future__ import annotations

import functools
import operator
from collections.abc import Iterable, Iterator, Mapping
from inspect import Parameter, getdoc, signature
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, get_args, get_origin, get_type_hints

from pydantic import Field, Tag, create_model

from ...arguments import Quantity
from ...terms.loads.contact import Friction
from ...terms.loads.rigid_mesh import RigidMesh
from ...terms.loads.rigid_shapes import SHAPES
from .places import PlaceOrName, Region, Simplices, place_or
from .quantities import Components, InputFile, Name, Part, bare, input_files, is_union, key

#: Names of keys, by the names of their parameters that differ.
KEYS = {"where": "on"}
#: Keys of terms that hold a place, or the name of a region, which means its part of the surface.
SURFACES = "first", "second"
#: Types of keys whose parameters have a wider type, by the name of the parameter.
TYPES: dict[str, Any] = {
    "where": PlaceOrName,
    "first": PlaceOrName,
    "file": InputFile,
    "region": Region,
    "simplices": Simplices,
    "material": Name,
    "frame": Annotated[list[Annotated[list[float], Field(min_length=2, max_length=3)]], Field(min_length=2, max_length=3)],
    "voigt": Annotated[list[Annotated[list[float], Field(min_length=2, max_length=6)]], Field(min_length=6, max_length=6)],
}
#: Parameters with a shorthand in the library that scenes do not have.
REQUIRED = ("material",)


class Derived(Part):
    """A table that stands for an object of the library."""

    library: ClassVar[Any]

    def made(self, folder: Path = Path()) -> Any:
        """Return the object of the library with the values of the keys. Files are in the `folder`."""
        values = dict(self) | self._paths(folder)
        return self.library(**{name: value for name, value in values.items() if name not in ("type", "model")})

    def _paths(self, folder: Path) -> dict[str, Path]:
        """Return the paths of the files in this table by their keys; those of tables in it are not included."""
        return {str(loc[0]): folder / value for loc, value in input_files(self) if len(loc) == 1}


def derived(
    tag: str, kind: str, library: Any, base: type[Derived] = Derived, keys: Mapping[str, tuple[Any, Any]] | None = None
) -> Any:
    """Return the table of a class of the library, or of a function that makes an object of one.

    Parameters
    ----------
    tag, kind
        The key that distinguishes this table from others, and its value: "type", "gravity". A table that stands alone has none: "".
    base
        Class with the methods of the table.
    keys
        Types and defaults of its keys, by default those of the declared parameters.
    """
    name = "".join(word.capitalize() for word in kind.split("-")) + base.__name__.removeprefix("Any")
    keys = keys_of(library) if keys is None else keys
    model: Any = create_model(  # type: ignore[call-overload]
        name, __base__=base, __module__=__name__, **({tag: (Literal[kind], ...)} if tag else {}), **keys
    )
    model.__doc__, model.library = " ".join((getdoc(library) or "").split("\n\n")[0].split()), library
    return model


def one_of(tables: Iterable[Any], tag: str) -> Any:
    """Return the union of these tables, which the key `tag` distinguishes."""
    return Annotated[functools.reduce(operator.or_, tables), Field(discriminator=tag)]


def declared(library: Any) -> Iterator[tuple[Parameter, Any, Quantity]]:
    """Yield the parameters of a class or function that declare a `Quantity`, each with its type and declaration."""
    hints = get_type_hints(library, include_extras=True)
    for name, parameter in signature(library).parameters.items():
        annotation, metadata = bare(hints.get(name))
        yield from ((parameter, annotation, one) for one in metadata if isinstance(one, Quantity))


def keys_of(library: Any) -> dict[str, tuple[Any, Any]]:
    """Return types and defaults of the keys for the declared parameters of a class or function."""
    keys = {}
    for parameter, annotation, quantity in declared(library):
        name, default = parameter.name, parameter.default
        if default is parameter.empty:
            default = None if is_union(annotation) and type(None) in get_args(annotation) else ...
        default = ... if name in REQUIRED else quantity.otherwise if default is None else default
        kind, limits = type_of(name, annotation, quantity)
        kind = kind | None if default is None else kind
        keys[KEYS.get(name, name)] = Annotated[kind, key(quantity.sentence, quantity.dimension, **limits)], default
    return keys


def type_of(name: str, annotation: Any, quantity: Quantity) -> tuple[Any, Mapping[str, Any]]:
    """Return the type of a key without its default, and its limits; those of the entries of a list are in its type."""
    limits = {limit: value for limit in ("gt", "ge", "lt", "le") if (value := getattr(quantity, limit)) is not None}
    kinds = [one for one in get_args(annotation) if one is not type(None)] if is_union(annotation) else [annotation]
    annotation = kinds[0] if len(kinds) == 1 else float  # values for each element or node are only for programs
    if name in TYPES:
        return TYPES[name], limits
    if quantity.values:
        return Literal[quantity.values], {}
    if quantity.components:
        return float | Components if annotation is float else Components, limits
    if annotation in (bool, int, str):
        return annotation, limits
    if get_origin(annotation) is not tuple:
        return float, limits
    entry = Annotated[float, Field(**limits)] if limits else float
    entries = get_args(annotation)
    if entries[-1] is ...:
        return list[entry], {"min_length": 1}  # type: ignore[valid-type]
    return Annotated[list[entry], Field(min_length=len(entries), max_length=len(entries))], {}  # type: ignore[valid-type]


class AnyShape(Derived):
    """A rigid shape, whose parameters are the keys."""


RIGID_MESH = derived("type", "rigid-mesh", RigidMesh)
#: Tables within those of terms, by the name of their key.
PARTS: dict[str, list[Any]] = {
    "shape": [derived("type", kind, shape, AnyShape) for kind, shape in SHAPES.items()],
    "friction": [derived("", "friction", Friction)],
    "second": [RIGID_MESH],
}
TYPES |= {
    "shape": one_of(PARTS["shape"], "type"),
    "friction": PARTS["friction"][0],
    "second": place_or(Annotated[RIGID_MESH, Tag("rigid-mesh")], "rigid-mesh"),
}
