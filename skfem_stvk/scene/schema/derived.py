"""Tables of a scene that are derived from the library: a key for each parameter that declares a `Quantity`."""

from __future__ import annotations

import functools
import operator
from collections.abc import Iterable, Mapping
from inspect import signature
from typing import Annotated, Any, ClassVar, Literal, get_args, get_origin, get_type_hints

from pydantic import Field, create_model

from ...arguments import Quantity
from .places import PlaceOrName, Region
from .quantities import Components, Part, bare, is_union, key

#: Names of keys, by the names of their parameters that differ.
KEYS = {"where": "on"}
#: Types of keys whose parameters have a wider type, by the name of the parameter.
TYPES: dict[str, Any] = {
    "where": PlaceOrName,
    "region": Region,
    **dict.fromkeys(("g", "force", "traction"), Components),
    "frame": Annotated[list[Annotated[list[float], Field(min_length=2, max_length=3)]], Field(min_length=2, max_length=3)],
    "voigt": Annotated[list[Annotated[list[float], Field(min_length=2, max_length=6)]], Field(min_length=6, max_length=6)],
}


class Derived(Part):
    """A table that stands for an object of the library."""

    library: ClassVar[Any]


def derived(name: str, base: Any, library: Any, sentence: str, kind: tuple[str, str] | None = None, **more: tuple[Any, Any]) -> Any:
    """Return the table `name` for a class of the library, or for a function that makes an object of one.

    Parameters
    ----------
    base : table whose keys it has as well.
    sentence : about the table.
    kind : the key that tells this table from others, and the value of this key: ("type", "gravity").
    more : types and defaults of keys in addition to those of the class, or in place of them.
    """
    own = {one: key for one, key in keys_of(library).items() if one not in base.model_fields}
    told = {} if kind is None else {kind[0]: (Literal[kind[1]], ...)}
    model: Any = create_model(name, __base__=base, __module__=__name__, **told, **(own | more))  # type: ignore[call-overload]
    model.__doc__, model.library = sentence, library
    return model


def one_of(tables: Iterable[Any], kind: str) -> Any:
    """Return the union of these tables, which the key `kind` tells apart."""
    return Annotated[functools.reduce(operator.or_, tables), Field(discriminator=kind)]


def keys_of(library: Any) -> dict[str, tuple[Any, Any]]:
    """Return types and defaults of the keys for the parameters of a class or function that declare a `Quantity`."""
    hints, keys = get_type_hints(library, include_extras=True), {}
    for name, parameter in signature(library).parameters.items():
        annotation, metadata = bare(hints.get(name))
        for quantity in (one for one in metadata if isinstance(one, Quantity)):
            default = ... if parameter.default is parameter.empty else parameter.default
            kind, limits = _type_of(name, annotation, quantity)
            kind = kind | None if default is None else kind
            keys[KEYS.get(name, name)] = Annotated[kind, key(quantity.sentence, quantity.dimension, **limits)], default
    return keys


def _type_of(name: str, annotation: Any, quantity: Quantity) -> tuple[Any, Mapping[str, Any]]:
    """Return the type of a key without its default, and its limits; those of the entries of a list are in its type."""
    limits = {limit: value for limit in ("gt", "ge", "lt", "le") if (value := getattr(quantity, limit)) is not None}
    kinds = [one for one in get_args(annotation) if one is not type(None)] if is_union(annotation) else [annotation]
    annotation = kinds[0] if len(kinds) == 1 else float  # values for each element or node are for programs alone
    if name in TYPES:
        return TYPES[name], limits
    if quantity.values:
        return Literal[quantity.values], {}
    if annotation in (bool, int, str):
        return annotation, limits
    if get_origin(annotation) is not tuple:
        return float, limits
    entry = Annotated[float, Field(**limits)] if limits else float
    entries = get_args(annotation)
    if entries[-1] is ...:
        return list[entry], {"min_length": 1}  # type: ignore[valid-type]
    return Annotated[list[entry], Field(min_length=len(entries), max_length=len(entries))], {}  # type: ignore[valid-type]
