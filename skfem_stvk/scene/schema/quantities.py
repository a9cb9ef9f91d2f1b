"""Kinds of values in a scene: each key has a type, limits, a dimension that says its unit, and one sentence."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field


class Part(BaseModel):
    """A table of a scene: exactly these keys, of these types, with finite numbers; it does not change."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)


def key(sentence: str, dimension: str | None = None, **limits: Any) -> Any:
    """A key's sentence, the dimension of its value (see `scene.units`), and its limits as pydantic's `Field` takes them."""
    return Field(description=sentence, json_schema_extra={"dimension": dimension}, **limits)


#: One to three components.
Components = Annotated[list[float], Field(min_length=1, max_length=3)]
#: A name that outputs are told apart by.
Name = Annotated[str, Field(min_length=1, max_length=100, pattern=r"^\S(.*\S)?$")]
