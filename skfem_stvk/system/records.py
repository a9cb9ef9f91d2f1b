"""What stands in the headers of files, as pydantic checks it."""

from __future__ import annotations

from typing import Annotated, Literal, TypeAlias

from pydantic import BaseModel, ConfigDict, Field, JsonValue, ValidationError

Kind: TypeAlias = Literal["path of equilibria", "motion"]


class Record(BaseModel):
    """What stands in a file: exactly these names, of these types, with finite numbers."""

    model_config = ConfigDict(strict=True, extra="forbid", frozen=True, allow_inf_nan=False)


class Signature(Record):
    """The signature of a problem, as it stands in each file of a run.

    The `method` has all options on which the states depend, `numbers` are of the system and of where it starts, by name, with loads
    and prescribed displacements looked at in `moments`: load factors or times [s].
    """

    kind: Kind
    method: dict[str, JsonValue]
    moments: Annotated[list[float], Field(max_length=9)]
    numbers: dict[str, Annotated[list[float], Field(max_length=9)]]


def in_words(error: ValidationError, most: int = 3) -> str:
    """What is wrong with a record: the first few, and how many more."""
    found = [
        f"{'.'.join(map(str, one['loc'])) or 'it'}: {one['msg']}" for one in error.errors(include_input=False, include_url=False)
    ]
    return "; ".join(found[:most]) + (f"; and {len(found) - most} more" if len(found) > most else "")
