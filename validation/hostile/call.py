"""Public functions with good arguments and the hostile values that are legal."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

#: A function, and good values of its arguments by name.
Made = tuple[Callable[..., Any], dict[str, Any]]


@dataclass(frozen=True)
class Call:
    """Function to call.

    Attributes
    ----------
    name
        Name of the function.
    make
        Returns the function and good values of its arguments. The values are new objects if the function changes them.
    legal
        For each argument, the names of hostile values that are legal.
    called
        For each argument, an expression for the words by which messages name it, if they do not use its name.
    costly
        Whether a successful call takes more than some milliseconds.
    """

    name: str
    make: Callable[[], Made]
    legal: Mapping[str, frozenset[str]] = field(default_factory=dict)
    called: Mapping[str, str] = field(default_factory=dict)
    costly: bool = False
