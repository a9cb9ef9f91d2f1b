"""A public function, how it is called well, and what of the hostile values is legal."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

#: A function, and good values for its arguments by name.
Made = tuple[Callable[..., Any], dict[str, Any]]


@dataclass(frozen=True)
class Call:
    """A function to call.

    Attributes
    ----------
    name : of the function.
    make : gives it, with good values for its arguments: new ones, where the function changes them.
    legal : names of hostile values that an argument takes, by argument.
    called : expressions for what messages call an argument where that is not its name.
    costly : whether a call that succeeds takes more than some milliseconds.
    """

    name: str
    make: Callable[[], Made]
    legal: Mapping[str, frozenset[str]] = field(default_factory=dict)
    called: Mapping[str, str] = field(default_factory=dict)
    costly: bool = False
