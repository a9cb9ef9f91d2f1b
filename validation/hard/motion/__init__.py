"""Hard cases in motion: dropped, crushed, released, swinging, stiff and soft, thrown, inverted; and runs of very many steps."""

from __future__ import annotations

from collections.abc import Callable

from .impacts import impacts
from .inverted import inverted
from .released import released
from .scene import Scene
from .stiff import stiff

#: Functions that return the scenes, in the order of the table.
SCENES: tuple[Callable[[], list[Scene]], ...] = (impacts, released, stiff, inverted)

__all__ = ["SCENES", "Scene"]
