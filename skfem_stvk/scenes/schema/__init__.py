"""The schema of scenes: every key with its type, default, dimension and one sentence. Docs and templates are printed from it."""

from .sections import SceneTables, scene_tables

__all__ = ["SceneTables", "scene_tables"]
