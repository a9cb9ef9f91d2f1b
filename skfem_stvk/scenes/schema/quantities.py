"""Kinds of values in a scene: each key has a type, limits, a dimension that says its unit, and one sentence."""

from __future__ import annotations

import types
import typing
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Annotated, Any, Literal, get_args, get_origin

from pydantic import BaseModel, ConfigDict, Field, GetCoreSchemaHandler, GetJsonSchemaHandler, Tag
from pydantic.fields import FieldInfo
from pydantic_core import CoreSchema, PydanticCustomError
from pydantic_core.core_schema import no_info_after_validator_function


class Part(BaseModel):
    """A table of a scene: exactly these keys, of these types, with finite numbers; it does not change."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)


def key(sentence: str, dimension: str | None = None, **limits: Any) -> Any:
    """Declare a key: its sentence, the dimension of its value (see `skfem_stvk.units`), and its limits as in pydantic's `Field`."""
    return Field(description=sentence, json_schema_extra={"dimension": dimension}, **limits)


def dimension_of(found: FieldInfo) -> str | None:
    """Return the dimension that a key of a scene declares; None for pure numbers and other values."""
    extra = found.json_schema_extra
    dimension = extra.get("dimension") if isinstance(extra, dict) else None
    return dimension if isinstance(dimension, str) else None


@dataclass(frozen=True)
class OneOf:
    """Metadata of a text: it must be one of the names that a table, such as that of integrators, has when a scene is checked."""

    names: Callable[[], Iterable[str]]

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return no_info_after_validator_function(self._checked, handler(source))

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        return handler(schema) | {"enum": list(self.names())}

    def _checked(self, given: str) -> str:
        if given not in self.names():
            raise PydanticCustomError("literal_error", "one of the names in a table", {"names": list(self.names())})
        return given


class Read:
    """Metadata of a text: it is the path of a file that the scene reads."""


#: Path of a file that the scene reads, relative to the scene file. `input_files` finds all keys of this type.
InputFile = Annotated[str, Field(min_length=1), Read()]
#: One to three components.
Components = Annotated[list[float], Field(min_length=1, max_length=3)]
#: Name that distinguishes outputs.
Name = Annotated[str, Field(min_length=1, max_length=100, pattern=r"^\S(.*\S)?$")]


# components of the types of keys, for messages and pages


def bare(annotation: Any) -> tuple[Any, tuple[Any, ...]]:
    """Return a type without its annotations, and these annotations."""
    metadata: tuple[Any, ...] = ()
    while get_origin(annotation) is Annotated:
        annotation, *more = get_args(annotation)
        metadata = (*metadata, *more)
    return annotation, metadata


def is_union(annotation: Any) -> bool:
    """Return whether a type is one of several."""
    return get_origin(annotation) in (typing.Union, types.UnionType)


def members(annotation: Any) -> Iterator[tuple[tuple[str, ...], Any]]:
    """Yield the members of a union, also those of unions within it, with the tags that select them."""
    annotation, _ = bare(annotation)
    for one in get_args(annotation) if is_union(annotation) else (annotation,):
        inner, metadata = bare(one)
        tags = tuple(tag.tag for tag in metadata if isinstance(tag, Tag))
        if is_union(inner) and not tags:
            yield from members(inner)
        elif inner is not type(None):
            if not tags and isinstance(inner, type) and issubclass(inner, BaseModel):
                kinds = (inner.model_fields[name] for name in ("type", "model") if name in inner.model_fields)
                tags = tuple(str(value) for kind in kinds for value in literals(kind.annotation))
            yield tags, one


def literals(annotation: Any, metadata: Iterable[Any] = ()) -> list[Any]:
    """Return the values that a key may have, if they are listed in its type or in its metadata."""
    annotation, more = bare(annotation)
    for one in (*metadata, *more):
        if isinstance(one, OneOf):
            return list(one.names())
    if is_union(annotation):
        return [value for one in get_args(annotation) for value in literals(one)]
    return list(get_args(annotation)) if get_origin(annotation) is Literal else []


# files of a scene


def input_files(table: Any, loc: tuple[str | int, ...] = ()) -> Iterator[tuple[tuple[str | int, ...], str]]:
    """Yield key path and value of each file that a table reads, and the tables in it. The scene checks, hashes and writes these.

    Parameters
    ----------
    table
        A table, or lists and dictionaries of tables.
    loc
        Key path of the table.
    """
    if isinstance(table, list | dict | Part):
        keys = type(table).model_fields if isinstance(table, Part) else {}
        for name, value in enumerate(table) if isinstance(table, list) else dict(table).items():
            if isinstance(value, str) and name in keys and is_input_file(keys[str(name)]):
                yield (*loc, name), value
            else:
                yield from input_files(value, (*loc, name))


def is_input_file(key: FieldInfo) -> bool:
    """Return whether the value of a key is the path of a file that the scene reads."""
    metadata = [*key.metadata, *(one for _, kind in members(key.annotation) for one in bare(kind)[1])]
    return any(isinstance(one, Read) for one in metadata)
