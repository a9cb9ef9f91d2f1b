"""What each part of a scene costs: bytes, kernels that run, times of W, F and K, and the packages that it imports."""

from __future__ import annotations

import statistics
import sys
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from types import FrameType
from typing import Any, NamedTuple

import numpy as np
from rich.table import Table

from ..arguments import Array
from ..edges.elements import nbytes
from ..edges.pairs import Coupled
from ..errors import StvkWarning
from ..mesh import ElementMesh
from ..referee.terminal import grid, printable
from ..system import System
from ..system.pattern import Pattern
from ..terms import HasMemory, is_load
from ..terms.load import Moment
from .build import Built
from .schema.analyses import DynamicAnalysis, ModesAnalysis

#: Calls of which a time is the median, unless they take longer than `PATIENCE` [s] together.
CALLS, PATIENCE = 7, 0.5
#: Packages that a linear solver takes beside scipy.
OF_SOLVERS = {"pardiso": ("pypardiso",), "amg-cg": ("pyamg",)}
#: Packages that the folder of results takes: the picture of the body, and the page.
OF_RESULTS = ("matplotlib", "jinja2")


class PartCost(NamedTuple):
    """What a part of a scene costs.

    Attributes
    ----------
    name : as it stands in the scene.
    nbytes : of the arrays that it holds once W, F and K have been asked for.
    elements : on which it acts; None of what has no region.
    energy, force, stiffness : [s] of W, F and K; None where there is none, or where the analysis asks for none.
    kernels : that run for them, by name.
    packages : that it imports, beside those of the package itself.
    """

    name: str
    nbytes: int = 0
    elements: int | None = None
    energy: float | None = None
    force: float | None = None
    stiffness: float | None = None
    kernels: tuple[str, ...] = ()
    packages: tuple[str, ...] = ()


def footprint(built: Built) -> list[PartCost]:
    """What each part of a scene costs: the mesh, every term alone, all terms together, what is made for the analysis, the results.

    The times are measured, on a body of its own. K is not asked for where the analysis is explicit, and no pattern is made then;
    there is a mass in motion and for modes.

    >>> from skfem_stvk.scene import Scene
    >>> scene = Scene.of_data({
    ...     "mesh": {"type": "box", "size": [4.0, 1.0, 1.0], "cells": [4, 1, 1]},
    ...     "materials": {"steel": {"model": "isotropic", "young": 2e11, "poisson": 0.3, "density": 7850.0}},
    ...     "terms": [{"type": "stvk", "material": "steel"}, {"type": "gravity", "g": [0.0, 0.0, -9.81]}],
    ...     "fixed": {"left": "xyz"},
    ...     "analysis": {"type": "static"},
    ... })
    >>> [row.name for row in footprint(scene.built)]
    ['mesh', 'terms[0] stvk', 'terms[1] gravity', 'all terms', 'pattern of K', 'rows of K', 'analysis static', 'results']
    >>> footprint(scene.built)[1].kernels
    ('add_scattered', 'energy_and_force', 'fold', 'gather', 'linearize')
    """
    sections, analysis = built.sections, built.sections.analysis
    implicit = not (isinstance(analysis, DynamicAnalysis) and analysis.explicit)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", StvkWarning)  # what there is to say was said when it was built
        system = built.system.anew()
    u = np.zeros(system.ndofs) if built.u0 is None else built.u0
    rows = [PartCost("mesh", nbytes=system.memory()["mesh"], packages=("meshio",) if hasattr(sections.mesh, "file") else ())]
    elastic, loads = zip(system.bound_terms, system.pair_terms, strict=True), iter(system.bound_loads)
    for number, (section, term) in enumerate(zip(sections.terms, system.terms, strict=True)):
        x = u.reshape(-1, system.mesh.d)
        cost = _of_load(next(loads), system.mesh, x, implicit) if is_load(term) else _of_term(*next(elastic), system, x, implicit)
        on = next((body.mesh for body in system.body.beside if any(term is one for one in body.terms)), system.mesh)
        found = len(on.elements(term.region)) if hasattr(term, "region") else None
        rows.append(cost._replace(name=f"terms[{number}] {section.type}", elements=found))
    rows.append(_of_all(system, u, implicit))
    if isinstance(analysis, DynamicAnalysis | ModesAnalysis):
        system.mass(analysis.mass)
    held = system.memory()
    rows += [PartCost(part, held[part]) for part in ("pattern of K", "rows of K", "mass") if held[part]]
    rows.append(PartCost(f"analysis {analysis.type}", packages=OF_SOLVERS.get(built.solver, ())))
    return [*rows, PartCost("results", packages=OF_RESULTS)]


def _of_term(bound: Any, pairs: Any, system: System, x: Array, implicit: bool) -> PartCost:
    """Costs of an elastic term alone, with a pattern of its own."""
    force, fill = np.zeros(x.shape, dtype=system.dtype), None
    if implicit:
        pattern = Pattern(system.mesh.nv, system.mesh.d, [bound.nodes_paired])
        fill = partial(pairs.fill, x, pairs.rows(pattern), np.empty(pattern.nnz, dtype=system.dtype), False)
    energy = partial(bound.energy_and_force, x) if bound.has_energy else None
    cost = _measured(energy, partial(bound.energy_and_force, x, force), fill)
    return cost._replace(nbytes=_bytes(bound) + (pairs.own_memory() if isinstance(pairs, Coupled) else 0))


def _of_load(bound: Any, mesh: ElementMesh, x: Array, implicit: bool) -> PartCost:
    """Costs of a load alone: W is its potential, F what acts, K its stiffness."""
    moment, force, size, add = Moment.checked(1.0), np.zeros(x.shape), 0, None
    if implicit and not bound.dead:
        of, pattern = Coupled(bound, mesh.nv, mesh.d, np.float64), Pattern(mesh.nv, mesh.d, [bound.nodes_paired])
        add = partial(of.add_stiffness, x, moment, of.pairs.rows(pattern), np.zeros(pattern.nnz))
        size = of.own_memory()
    energy = partial(bound.potential, x, moment) if bound.has_potential else None
    return _measured(energy, partial(bound.add_force, x, moment, force), add)._replace(nbytes=_bytes(bound) + size)


def _of_all(system: System, u: Array, implicit: bool) -> PartCost:
    """Costs of all elastic terms together, as an analysis asks for them."""
    tangent = partial(system.tangent, u, system.tangent(u)) if implicit else None
    energy = None if system.without_energy else partial(system.energy, u)
    cost = _measured(energy, partial(system.internal_force, u), tangent)
    size = sum(map(_bytes, (*system.bound_terms, *system.bound_loads)))
    return cost._replace(name="all terms", nbytes=size, elements=system.mesh.nt)


def _measured(*calls: Callable[[], Any] | None) -> PartCost:
    """Times of W, F and K, and the kernels that run for them once all is made that is kept."""
    energy, force, stiffness = [None if call is None else _seconds(call) for call in calls]
    with _kernels_run() as kernels:
        for call in calls:
            if call is not None:
                call()
    return PartCost("", 0, None, energy, force, stiffness, tuple(sorted(kernels)))


def _bytes(bound: Any) -> int:
    """Bytes of the arrays of a term on a body."""
    if isinstance(bound, HasMemory):
        return sum(bound.memory().values())
    return sum(nbytes(value) for value in vars(bound).values() if isinstance(value, np.ndarray))


def _seconds(call: Callable[[], Any]) -> float:
    """The median time of some calls, behind a first one, which may compile."""
    times: list[float] = []
    call()
    while len(times) < CALLS and sum(times) < PATIENCE:
        begin = time.perf_counter()
        call()
        times.append(time.perf_counter() - begin)
    return statistics.median(times)


@contextmanager
def _kernels_run() -> Iterator[set[str]]:
    """Names of the kernels that Python calls meanwhile in this thread, which are told to Python's profilers."""
    known, seen, before = _kernels(), set[str](), sys.getprofile()

    def note(frame: FrameType, event: str, argument: Any) -> None:
        code = frame.f_code
        if event == "call" and (code.co_filename, code.co_name) in known:
            seen.add(code.co_name.lstrip("_"))

    sys.setprofile(note)
    try:
        yield seen
    finally:
        sys.setprofile(before)


def _kernels() -> set[tuple[str, str]]:
    """Files and names of all kernels."""
    package = f"{__package__.rpartition('.')[0]}.kernels."
    modules = [module for name, module in list(sys.modules.items()) if name.startswith(package)]
    codes = [value.py_func.__code__ for module in modules for value in vars(module).values() if hasattr(value, "py_func")]
    return {(code.co_filename, code.co_name) for code in codes}


def table(rows: list[PartCost]) -> Table:
    """The costs in a table; times in microseconds."""
    found = grid(
        "footprint", "part", "elements", "kB", "W", "F", "K", "kernels", "imports", right=("elements", "kB", "W", "F", "K")
    )
    found.caption = "W, F, K: measured, in microseconds; of a load its potential, its force and its stiffness"
    for row in rows:
        times = ["" if seconds is None else f"{1e6 * seconds:.0f}" for seconds in (row.energy, row.force, row.stiffness)]
        elements = "" if row.elements is None else str(row.elements)
        size = f"{row.nbytes / 1e3:.1f}" if row.nbytes else ""
        found.add_row(printable(row.name), elements, size, *times, ", ".join(row.kernels), ", ".join(row.packages))
    return found
