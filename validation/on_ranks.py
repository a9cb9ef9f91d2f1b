"""Program of the study `distributed` on each rank: `mpiexec -n N python -m mpi4py -m validation.on_ranks WHAT TETRAHEDRA`."""

from __future__ import annotations

import json
import sys
import time
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import skfem
from mpi4py import MPI

from skfem_stvk import ElementMesh, Gravity, LinearBackwardEuler, StVK, System, Traction, VelocityVerlet, simulate, solve_static
from skfem_stvk.arguments import Array
from skfem_stvk.edges import ALL
from skfem_stvk.errors import StvkWarning
from skfem_stvk.linear import BlockJacobiCg, Kind, Outcome, Unknowns, choose
from skfem_stvk.ranks import MeshPart, distribute
from skfem_stvk.system.free_tangent import FreeTangent
from skfem_stvk.system.operator import FreeOperator

CG = "block-jacobi-cg"


def beam(tetrahedra: int) -> ElementMesh:
    """Return a beam 4 x 1 x 1 with inner vertices moved at random, of about this number of tetrahedra."""
    n = max(2, round((tetrahedra / 24) ** (1 / 3)))
    mesh = skfem.MeshTet.init_tensor(np.linspace(0, 4, 4 * n + 1), np.linspace(0, 1, n + 1), np.linspace(0, 1, n + 1))
    p = mesh.p.copy()
    inner = ((p > 1e-9) & (p < np.array([[4], [1], [1]]) - 1e-9)).all(axis=0)
    p[:, inner] += 0.15 / n * np.random.default_rng(0).uniform(-1, 1, (3, inner.sum()))
    return ElementMesh(p, mesh.t)


def body(mesh: ElementMesh) -> System:
    """Return a beam that is held at one end and loaded at the other."""
    loads = [Traction(lambda x: x[0] > 4 - 1e-9, (0, 0, -4e3)), Gravity(g=(0, 0, -1.0))]
    return System(mesh, [StVK(young=1e6, poisson=0.3, density=1000.0), *loads], fixed={lambda x: x[0] < 1e-9: "xyz"})


def displacements(mesh: ElementMesh) -> Array:
    """Return a smooth state, which is not small."""
    x, y, z = mesh.p
    return 0.05 * np.stack([np.sin(x + y), np.cos(x * z), x**2 / 4]).T.ravel()


def equal(part: MeshPart, tetrahedra: int) -> dict[str, float]:
    """Return the largest differences from one machine, relative to the largest entry."""
    space, one, whole = part.space, body(part), body(beam(tetrahedra))
    at, u = space.numbers, displacements(whole.mesh)
    v = np.cos(0.7 * np.arange(len(u)))

    def difference(own: Array, reference: Array) -> float:
        return space.comm.most(float(abs(own - reference[at]).max())) / float(abs(reference).max())

    def static(system: System) -> Array:
        return solve_static(system, steps=1, solver=CG, rtol=1e-12, quiet=True).u

    def motion(system: System, integrator: Any) -> Array:
        return simulate(system, integrator, until=100 * integrator.dt, quiet=True).u

    dt = 0.02 / round((tetrahedra / 24) ** (1 / 3)) / 40
    implicit = LinearBackwardEuler(20 * dt, rtol=1e-12, solver=CG)
    return {
        "W": abs(one.energy(u[at]) / whole.energy(u) - 1),
        "F": difference(one.internal_force(u[at]), whole.internal_force(u)),
        "K v": difference(one.product(u[at], v[at]), whole.product(u, v)),
        "static u": difference(static(one), static(whole)),
        "Verlet u": difference(motion(one, VelocityVerlet(dt)), motion(whole, VelocityVerlet(dt))),
        "equation 9 u": difference(motion(one, implicit), motion(whole, implicit)),
    }


def calls(system: System) -> dict[str, Callable[[], Any]]:
    """Return what is timed and counted, by name; a solve returns its number of iterations."""
    space, u = system.space, displacements(system.mesh)
    x, K = space.random(1), system.linear_operator(0 * u)
    free = system.free_dofs(system.supports.held)
    matrix = FreeOperator(K, free)
    factors = BlockJacobiCg().analyse(Unknowns(*np.divmod(free.free, 3))).factorise(matrix, Kind.POSITIVE_DEFINITE)
    b, nodes = space.on(free.free).random(2), np.zeros((system.mesh.nv, 3))
    return {
        "F": lambda: system.energy_and_force(u),
        "K v": lambda: K.matvec(x),
        "sum at shared nodes": lambda: space.share(nodes),
        "x . y": lambda: space.dot(x, x),
        "CG": lambda: factors.solve(b, 1e-2).iterations,
    }


def costs(part: MeshPart, seconds: float = 2.0) -> dict[str, Any]:
    """Return times [ms] of calls on this part, the least of many and the largest of all ranks, and their traffic."""
    space, system = part.space, body(part)
    found: dict[str, Any] = {
        "ranks": space.comm.size,
        "tetrahedra": part.element_count,
        "shared nodes": space.comm.most(len(space.shared)),
        "surface": space.comm.most(len(space.shared) / part.nv),
    }
    for name, call in calls(system).items():
        call()
        space.comm.traffic.reset()
        result = call()
        times = result if name == "CG" else 1
        traffic = {kind: count / times for kind, count in vars(space.comm.traffic).items()}
        found[name] = {"ms": 1e3 * space.comm.most(least(call, space.comm.mpi, seconds)) / times, **traffic}
    return found


def solved(part: MeshPart, solver: str) -> dict[str, int]:
    """Return the numbers of unknowns and of iterations of a solve to 1e-8, with K at rest and a random force."""
    system = body(part)
    tangent = FreeTangent(system, choose(solver, system.ndofs, Kind.SYMMETRIC, divided=part.space.comm.divided), Kind.SYMMETRIC)
    K = tangent.at(np.zeros(system.ndofs), 1.0, ALL, False)
    solution = tangent.factorise(K).solve(tangent.space.random(2), 1e-8)
    if solution.outcome is not Outcome.SOLVED:
        raise SystemExit(f"{solver}: {solution.outcome.value}")
    return {"tetrahedra": part.element_count, "unknowns": tangent.space.count, "iterations": solution.iterations}


def least(call: Callable[[], Any], comm: MPI.Comm, seconds: float) -> float:
    """Return the least time of a call [s], in calls that all ranks begin together."""
    best, end, going = np.inf, time.perf_counter() + seconds, True
    while going:
        comm.Barrier()
        begin = time.perf_counter()
        call()
        best = min(best, time.perf_counter() - begin)
        going = comm.bcast(time.perf_counter() < end)
    return best


def against_serial(part: MeshPart) -> dict[str, list[float]]:
    """Return times [ms] on one rank that sums and reduces as several do, and of the same body without ranks, in turns."""
    type(part.space).divided = property(lambda space: True)
    one, other = calls(body(part)), calls(body(ElementMesh(part.p, part.t)))
    found = {}
    for name in ("F", "K v", "CG"):
        best = [np.inf, np.inf]
        for _ in range(10 if name == "CG" else 100):
            for i, call in enumerate((one[name], other[name])):
                begin = time.perf_counter()
                result = call()
                times = result if name == "CG" else 1
                best[i] = min(best[i], (time.perf_counter() - begin) / times)
        found[name] = [1e3 * value for value in best]
    return found


def main(what: str, tetrahedra: int) -> None:
    """Print a result as JSON on rank 0."""
    warnings.simplefilter("ignore", StvkWarning)
    comm = MPI.COMM_WORLD
    begin = time.perf_counter()
    part = distribute(beam(tetrahedra) if comm.rank == 0 else None)
    found: dict[str, Any] = {"distribute": time.perf_counter() - begin}
    if what == "equal":
        found |= equal(part, tetrahedra)
    elif what == "costs":
        found |= costs(part)
    elif what == "against-serial":
        found |= against_serial(part)
    else:
        found |= solved(part, what)
    if comm.rank == 0:
        print(json.dumps(found))


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]))
