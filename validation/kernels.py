"""Candidates for the kernels of W and F, and of K, in one run on one thread."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any
from unittest.mock import patch

import numba
import numpy as np
from rich.console import Console
from rich.table import Table

from skfem_stvk import ElementMesh, StVK, System
from skfem_stvk.edges.stiffness import GeneralStiffness
from skfem_stvk.edges.topology import KernelOrder

from .bench.control import Control, compiler
from .bench.costs import best_and_median
from .bench.meshes import bracket
from .edge_gather import EdgeGather
from .operations import edges, total_lagrangian
from .operations.algorithms import Algorithm, state
from .operations.body import Body
from .operations.meshes import box
from .operations.timing import call
from .solver_calls import costs, costs_of_laws

LAM, MU = 1.5, 1.0
LIMIT = 1e-11
TERM = StVK(young=2.6, poisson=0.3)
Calls = dict[tuple[str, str], Callable[[], Any]]

LISTS = (
    ("F", "TSEP list", Algorithm("", "F", edges.prepare, edges.force_displacement, True)),
    ("F", "TSEP list without zeros", Algorithm("", "F", partial(edges.prepare, prune=True), edges.force_displacement, True)),
    ("F", "one tetrahedron at a time", Algorithm("", "F", total_lagrangian.prepare, total_lagrangian.force)),
    ("K", "TSEP list", Algorithm("", "K", edges.prepare, edges.tangent_displacement, True)),
    ("K", "TSEP list without zeros", Algorithm("", "K", partial(edges.prepare, prune=True), edges.tangent_displacement, True)),
    ("K", "one tetrahedron at a time", Algorithm("", "K", total_lagrangian.prepare, total_lagrangian.tangent)),
)


def main(quick: bool = False) -> int:
    """Compare candidates for the kernels in ns per tetrahedron and in CSR products, on boxes and on a Gmsh mesh."""
    numba.set_num_threads(1)
    meshes = {"box": box(5)} if quick else {"box": box(19), "bracket": bracket(2.2e-3), "large box": box(35)}
    table = Table(box=None, header_style="bold")
    for heading in ("of", "candidate", *(f"{name}, {mesh.nt} tets" for name, mesh in meshes.items())):
        table.add_column(heading, justify="left" if heading in ("of", "candidate") else "right")
    seconds = 0.01 if quick else 0.3
    columns = [measured(mesh, seconds) for mesh in meshes.values()]
    for of, name in columns[0]:
        table.add_row(of, name, *(f"{column[of, name][0]:.0f} ns {column[of, name][1]:5.2f} x" for column in columns))
    console = Console(highlight=False, width=132)
    console.print(table)
    console.print(
        "x: time of one CSR product with K. Candidates for K give blocks, the package a CSR matrix. F of all but the C loop agrees "
        "to 1e-11."
    )
    console.print(costs(meshes, TERM, seconds))
    console.print(costs_of_laws(meshes, seconds))
    return 0


def measured(mesh: ElementMesh, seconds: float) -> dict[tuple[str, str], tuple[float, float]]:
    """Return ns per tetrahedron and CSR products of each candidate."""
    body = Body(mesh, LAM, MU)
    u = state(body)
    calls = dict(candidates(mesh, body, u))
    expected = System(mesh, TERM).internal_force(u.ravel())
    for (of, name), once in calls.items():
        result = once()
        if of == "F" and name != "C loop":
            force = np.asarray(result[-1] if isinstance(result, tuple) else result).ravel()
            assert np.abs(force - expected).max() <= LIMIT * np.abs(expected).max(), name
    best = {key: taken.best for key, taken in best_and_median(calls, seconds).items()}
    product = best.pop(("", "CSR product"))
    return {key: (1e9 * value / mesh.nt, value / product) for key, value in best.items()}


def candidates(mesh: ElementMesh, body: Body, u: Any) -> Iterator[tuple[tuple[str, str], Callable[[], Any]]]:
    """Yield the calls by quantity and name. `measured` checks F of all but the C loop."""
    x = u.ravel()
    ours = System(mesh, TERM)
    K = ours.tangent(x)
    yield ("", "CSR product"), lambda: K @ x
    with patch("skfem_stvk.edges.assembly.kernel_order", order_of_the_mesh):
        unsorted = System(mesh, TERM)
    coefficients = partial(TERM.stiffness(mesh).coefficients, mesh.p, mesh.t)
    with patch.object(StVK, "stiffness", lambda *_: GeneralStiffness(coefficients)):
        general = System(mesh, TERM)
    lists = {(of, name): call(candidate, body, u) for of, name, candidate in LISTS}
    gather = EdgeGather(mesh.p, mesh.t, LAM, MU)
    control = Control(mesh.p, mesh.t, LAM, MU) if compiler() else None
    for of in "FK":
        yield from ((key, value) for key, value in lists.items() if key[0] == of)
        if of == "K":
            yield ("K", "edge by edge, from its tetrahedra"), lambda: gather.tangent(u)
        if control is not None:
            yield (of, "C loop"), partial(control.internal_force if of == "F" else control.tangent, x)
        for name, system in {
            "lanes, in the mesh's order": unsorted,
            "lanes, 27 numbers a tetrahedron": general,
            "lanes: the package": ours,
        }.items():
            yield (of, name), partial(system.energy_and_force, x) if of == "F" else partial(system.tangent, x, system.tangent(x))


def order_of_the_mesh(t: Any, edges: Any, ascending: bool) -> KernelOrder:
    """Return the mesh's own order: only the vertices of each simplex are sorted."""
    local = np.argsort(t, axis=0)
    vertices = np.arange(t.max() + 1, dtype=np.int32)
    return KernelOrder(vertices, np.arange(t.shape[1], dtype=np.int32), np.take_along_axis(t, local, axis=0), local)
