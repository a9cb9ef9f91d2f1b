"""The command `skfem-stvk warm-up`: compile kernels ahead, on all cores."""

from __future__ import annotations

import argparse
import os
from collections import deque
from collections.abc import Callable
from itertools import product
from time import perf_counter
from typing import Any

import numpy as np

from ...errors import MaterialError, StvkError
from ...kernels.compiled import NOT_STORED, first_use
from ...mesh import ElementMesh
from ...mesh.element import ELEMENTS
from ...solvers.dynamics import EnergyMomentum, LinearBackwardEuler, VelocityVerlet, simulate
from ...solvers.newton.processes import Crashed, in_processes
from ...solvers.statics import solve_static
from ...system import System
from ...terminal import CountedProgress, duration
from ...terms import TERMS, Gravity
from ...terms.laws.elastic_law import ElasticLaw

#: The laws of elasticity by their `type` in scenes.
LAWS: dict[str, Any] = {kind: law for kind, law in TERMS.items() if isinstance(law, type) and issubclass(law, ElasticLaw)}


def _solve(body: System) -> None:
    for solver in ("superlu", "block-jacobi-cg", "ssor-cg", "amg-cg"):
        solve_static(body, solver=solver, quiet=True)


def _move(body: System) -> None:
    for integrator in (VelocityVerlet(), LinearBackwardEuler(dt=1e-3), EnergyMomentum(dt=1e-3)):
        simulate(body, integrator, until=1e-3, quiet=True)


#: Work on a body that compiles kernels, each in a separate process; kernels of an earlier row are on disk for the next one.
ROWS: tuple[dict[str, Callable[[System], object]], ...] = (
    {"bodies": lambda body: None},
    {
        "forces": lambda body: body.internal_force(np.zeros(body.ndofs)),
        "tangents": lambda body: body.tangent(np.zeros(body.ndofs)),
        "products": lambda body: body.product(np.zeros(body.ndofs), np.ones(body.ndofs)),
    },
    {"statics": _solve, "motions": _move},
)
WORK = {name: work for row in ROWS for name, work in row.items()}


def body_of(element: str, law: str) -> System:
    """Return a small body of elements of this kind, fixed at x = 0."""
    kind = ELEMENTS[element]
    one = np.arange(kind.n, dtype=np.int32)[:, None]
    mesh: Any = ElementMesh(kind.nodes.T, one, element=kind) if kind.mesh is None else kind.mesh().refined(2)  # two levels of AMG
    d = len(mesh.p)
    terms = [LAWS[law](young=1.0, poisson=0.3, density=1.0), Gravity(-np.eye(d)[0] / 100)]
    return System(mesh, terms, fixed={lambda x: np.isclose(x[0], 0.0): "xyz"[:d]})


def compile_kernels(task: tuple[str, str, str]) -> int | str:
    """Compile the kernels of a task (element, law, work); return the number of kernels not yet on disk, or why the body is
    impossible.
    """
    element, law, work = task
    first_use.quiet, before = True, first_use.count
    try:
        body = body_of(element, law)
    except MaterialError as error:
        return str(error)
    WORK[work](body)
    return first_use.count - before


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `skfem-stvk warm-up`."""
    for name, known, default in (("elements", ELEMENTS, "tetrahedra"), ("laws", LAWS, "stvk")):
        parser.add_argument(
            f"--{name}",
            nargs="+",
            default=[default],
            metavar="NAME",
            help=f"{', '.join(repr(one) if ' ' in one else one for one in known)}, or all; by default {default}",
        )
    parser.add_argument("--quiet", action="store_true", help="print nothing but errors")


def warm_up(options: argparse.Namespace) -> int:
    """Compile the kernels of elements and laws on all cores.

    Then W, F, K, `K v`, statics and motions of a first run need no compilation. Machine code is stored on disk, in the folder
    that `skfem-stvk info` names.
    """
    elements, laws = _chosen("elements", options.elements, ELEMENTS), _chosen("laws", options.laws, LAWS)
    if not first_use.on_disk:
        raise StvkError(f"Kernels cannot be compiled ahead: {NOT_STORED}.")
    pairs = list(product(elements, laws))
    began, counts, jobs = perf_counter(), [], os.cpu_count() or 1
    with CountedProgress("warm-up", len(pairs) * len(WORK), options.quiet) as progress:
        for row in ROWS:
            waiting, left_out = deque((*pair, work) for work in row for pair in pairs), []
            for (element, law, work), found in in_processes(compile_kernels, waiting, min(len(waiting), jobs), 1):
                progress.step(f"{element}, {law}: {work}")
                if isinstance(found, Crashed):
                    raise StvkError(f"The process that compiled {work} of {element}, {law}, ended at once. The memory may be full.")
                if isinstance(found, str):
                    left_out.append((element, law))
                    progress.print(f"{element}, {law}: {found}")
                else:
                    counts.append(found)
            pairs = [pair for pair in pairs if pair not in left_out]
        progress.print(f"{sum(counts)} kernels compiled in {duration(perf_counter() - began)}")
    return 0


def _chosen(option: str, names: list[str], known: dict[str, Any]) -> list[str]:
    """Return the user-supplied names, or all."""
    if names == ["all"]:
        return list(known)
    if unknown := [name for name in names if name not in known]:
        raise StvkError(f"--{option} {unknown[0]!r}; expected names of {', '.join(known)}, or all.")
    return names
