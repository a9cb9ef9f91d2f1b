"""Scenes: a whole job, from the mesh to what is written and expected, in one TOML file."""

from .outcome import SceneOutcome
from .scene import Scene
from .sweep import SweepRow, sweep

__all__ = ["Scene", "SceneOutcome", "SweepRow", "sweep"]
