"""Scenes: a whole job in one TOML file, from the mesh to output files and expected results."""
