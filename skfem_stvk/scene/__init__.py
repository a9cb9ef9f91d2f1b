"""Scenes: a whole job, from the mesh to what is written and expected, in one TOML file."""
