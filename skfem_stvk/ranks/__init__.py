"""Bodies on several machines, by MPI."""

from importlib import import_module
from typing import Any

#: Module of each public name; a program imports MPI with the names that use it, and partition files need none.
_MODULES = {
    "DividedSpace": ".divided_space",
    "MeshPart": ".divided_mesh",
    "PartSizes": ".partition_files",
    "Ranks": ".divided_space",
    "distribute": ".divided_mesh",
    "gathered": ".divided_mesh",
    "verify_on_ranks": ".distributed_verification",
    "write_partition": ".partition_files",
}
__all__ = sorted(_MODULES)


def __getattr__(name: str) -> Any:
    """Return a public name, which is imported on first access."""
    if name in _MODULES:
        return getattr(import_module(_MODULES[name], __name__), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
