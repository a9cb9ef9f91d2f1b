"""Rows of the package's tables that extensions add; a test removes them again."""

import sys
from importlib import import_module
from pathlib import Path
from typing import Annotated

from extensions import element, integrator, law, load, solver

import skfem_stvk
from skfem_stvk.linear import SOLVERS
from skfem_stvk.scenes.schema.quantities import key

ROOT = Path(skfem_stvk.__file__).parent.parent


class Package:
    """The package with the rows of extensions; `edited` are the files that contain those rows."""

    def __init__(self, monkeypatch):
        self._monkeypatch, self.edited = monkeypatch, {}

    def add(self, module, table, name, value):
        """Add an entry to a table of a module."""
        self._monkeypatch.setitem(getattr(self._module(module), table), name, value)

    def replace(self, module, name, value):
        """Replace a value of a module, or add a value."""
        self._monkeypatch.setattr(self._module(module), name, value, raising=False)

    def _module(self, name):
        import_module(name)
        module = sys.modules[name]  # a function may have the name of its module
        file = Path(module.__file__)
        stub = file.with_suffix(".pyi")  # the stub lists the public names
        self.edited[(stub if stub.exists() else file).relative_to(ROOT).as_posix()] = None
        return module


def with_law(package):
    package.add("skfem_stvk.terms", "TERMS", "damaged", law.Damaged)
    package.replace("skfem_stvk", "Damaged", law.Damaged)


def with_load(package):
    package.add("skfem_stvk.terms", "TERMS", "shared-force", load.SharedForce)
    package.replace("skfem_stvk", "SharedForce", load.SharedForce)


def with_element(package):
    for one in (element.QUAD9, element.HEX27):
        package.add("skfem_stvk.mesh.element", "ELEMENTS", one.name, one)
    package.add("skfem_stvk.referee.reference.kinds", "KINDS", element.HEX27.name, element.KIND)


def with_integrator(package):
    package.add("skfem_stvk.solvers.dynamics.integrators", "INTEGRATORS", "DriftKick", integrator.DriftKick)


def with_solver(package):
    package.replace("skfem_stvk.linear.choose", "SOLVERS", (*SOLVERS, solver.Dense()))


def with_key(package):
    sections = import_module("skfem_stvk.scenes.schema.sections")

    class SceneTables(sections.SceneTables):
        """Scene with one more key."""

        author: Annotated[str, key("Who wrote it.")] = ""

    package.replace("skfem_stvk.scenes.schema.sections", "SceneTables", SceneTables)


#: Functions that add a toy, by kind of extension.
EXTENSIONS = {
    "law": with_law,
    "element": with_element,
    "load": with_load,
    "integrator": with_integrator,
    "linear solver": with_solver,
    "key of scenes": with_key,
}
