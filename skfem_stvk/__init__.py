"""St. Venant-Kirchhoff elasticity on simplices from edges, and a referee for other implementations: a plugin for scikit-fem."""

from importlib import import_module
from importlib.util import find_spec
from typing import Any

# A line `from .MODULE import NAME as NAME` for each public name. Names that a program does not use are not imported.
with open(f"{__path__[0]}/__init__.pyi", encoding="utf-8") as _stub:
    _MODULES = {words[-1]: words[1] for words in map(str.split, _stub) if words[:1] == ["from"]}
__all__ = sorted(_MODULES)


def __getattr__(name: str) -> Any:
    """Return a public name, or a submodule, which is imported on first access; and the version of the installed package."""
    if name == "__version__":
        return import_module("importlib.metadata").version("skfem-stvk")
    if name in _MODULES:
        globals()[name] = getattr(import_module(_MODULES[name], __name__), name)
        return globals()[name]
    if not name.startswith("_") and find_spec(f"{__name__}.{name}"):
        return import_module(f".{name}", __name__)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
