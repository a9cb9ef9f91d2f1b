"""Hard cases in motion: dropped, crushed, let go, swung, stiff and soft, thrown, tangled; and runs of very many steps."""

from __future__ import annotations

from collections.abc import Callable

from .impacts import impacts
from .released import released
from .scene import Scene
from .stiff import stiff
from .tangled import tangled

#: Makers of the scenes, in the order of the table.
SCENES: tuple[Callable[[], list[Scene]], ...] = (impacts, released, stiff, tangled)

__all__ = ["SCENES", "Scene"]
