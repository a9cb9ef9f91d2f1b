"""What only a checkout of the project holds: the C element loop and the meshes by Gmsh, under `validation/`."""

from __future__ import annotations

from importlib import import_module
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType

from ..errors import StvkError


def from_checkout(name: str) -> ModuleType:
    """The module `validation.NAME`, importable or in the current folder.

    Raises
    ------
    StvkError
        if it is neither.
    """
    try:
        return import_module(f"validation.{name}")
    except ModuleNotFoundError:
        file = Path("validation") / f"{name}.py"
    spec = spec_from_file_location(f"validation_{name}", file) if file.is_file() else None
    if spec is None or spec.loader is None:
        raise StvkError("only in a checkout: clone the repository and run this command there")
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
