"""What only a checkout of the project holds: the C element loop and the meshes by Gmsh, under `validation/`."""

from __future__ import annotations

import sys
from importlib import import_module
from pathlib import Path
from types import ModuleType

from ..errors import StvkError


def checkout() -> Path | None:
    """The folder of the project: the one that this package lies in, or the current one; nobody else's `validation` is run."""
    for folder in (Path(__file__).resolve().parents[2], Path.cwd()):
        project = folder / "pyproject.toml"
        if (folder / "validation").is_dir() and project.is_file() and 'name = "skfem-stvk"' in project.read_text(encoding="utf-8"):
            return folder
    return None


def from_checkout(name: str) -> ModuleType:
    """The module `validation.NAME` of the checkout.

    Raises
    ------
    StvkError
        if there is none.
    """
    folder = checkout()
    if folder is None:
        raise StvkError("only in a checkout: clone the repository and run this command there")
    sys.path.insert(0, str(folder))
    try:
        return import_module(f"validation.{name}")
    finally:
        sys.path.remove(str(folder))
