"""Scenes: a whole job in one TOML file, from the mesh to output files and expected results."""

from .scene import Scene
from .scene_outcome import SceneOutcome
from .sweep import SweepRow, sweep

__all__ = ["Scene", "SceneOutcome", "SweepRow", "sweep"]
