"""Elements, bytes and packages of each part of a scene."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from rich.table import Table

from ..terminal import grid, printable
from ..terms import HasMemory, is_load
from .build import Built
from .schema.analyses import DynamicAnalysis, ModesAnalysis

#: Packages that a linear solver imports in addition to scipy.
OF_SOLVERS = {"pardiso": ("pypardiso",), "amg-cg": ("pyamg",)}
#: Packages that the folder of results imports, for the picture of the body and for the page.
OF_RESULTS = ("matplotlib", "jinja2")


class PartCost(NamedTuple):
    """Cost of a part of a scene.

    Attributes
    ----------
    name
        Name of the part, such as "terms[0] stvk".
    nbytes
        Bytes of its arrays after the analysis has computed F, and K and the mass matrix if it needs them.
    elements
        Number of elements on which it acts; None if it has no region.
    packages
        Names of the packages that are imported for it alone.
    """

    name: str
    nbytes: int = 0
    elements: int | None = None
    packages: tuple[str, ...] = ()


def footprint(built: Built) -> list[PartCost]:
    """Return elements, bytes and packages of the mesh, every term, the matrices of the analysis, and the results.

    Explicit analyses make no K and no pattern; motion and modes make a mass matrix.

    >>> from skfem_stvk.scene import Scene
    >>> scene = Scene.of_data({
    ...     "mesh": {"type": "box", "size": [4.0, 1.0, 1.0], "cells": [4, 1, 1]},
    ...     "materials": {"steel": {"model": "isotropic", "young": 2e11, "poisson": 0.3, "density": 7850.0}},
    ...     "terms": [{"type": "stvk", "material": "steel"}, {"type": "gravity", "g": [0.0, 0.0, -9.81]}],
    ...     "fixed": {"left": "xyz"},
    ...     "analysis": {"type": "static"},
    ... })
    >>> [row.name for row in footprint(scene.built)]
    ['mesh', 'terms[0] stvk', 'terms[1] gravity', 'pattern of K', 'rows of K', 'analysis static', 'results']
    """
    sections, analysis, system = built.sections, built.sections.analysis, built.system
    u = np.zeros(system.ndofs) if built.u0 is None else built.u0
    system.residual(u)
    if not (isinstance(analysis, DynamicAnalysis) and analysis.explicit):
        system.jacobian(u)
    if isinstance(analysis, DynamicAnalysis | ModesAnalysis):
        system.mass(analysis.mass)
    arrays = system.memory()
    rows = [PartCost("mesh", arrays["mesh"], packages=("meshio",) if hasattr(sections.mesh, "file") else ())]
    elastic, loads = iter(system.bound_terms), iter(system.bound_loads)
    for number, (section, term) in enumerate(zip(sections.terms, system.terms, strict=True)):
        bound = next(loads if is_load(term) else elastic)
        nbytes = sum(bound.memory().values()) if isinstance(bound, HasMemory) else 0
        mesh = next((body.mesh for body in system.body.beside if any(term is one for one in body.terms)), system.mesh)
        elements = len(mesh.elements(term.region)) if hasattr(term, "region") else None
        rows.append(PartCost(f"terms[{number}] {section.type}", nbytes, elements))
    made = ("blocks of pairs", "pattern of K", "rows of K", "mass")
    rows += [PartCost(part, arrays[part]) for part in made if arrays.get(part)]
    rows.append(PartCost(f"analysis {analysis.type}", packages=OF_SOLVERS.get(built.solver, ())))
    return [*rows, PartCost("results", packages=OF_RESULTS)]


def table(rows: list[PartCost]) -> Table:
    """Return the costs in a table."""
    found = grid("footprint", "part", "elements", "kB", "imports", right=("elements", "kB"))
    for row in rows:
        elements = "" if row.elements is None else str(row.elements)
        found.add_row(printable(row.name), elements, f"{row.nbytes / 1e3:.1f}" if row.nbytes else "", ", ".join(row.packages))
    return found
