"""Run by `mpiexec -n N python -m mpi4py petsc_on_ranks.py OUT.json`: solves by PETSc on ranks against SuperLU on one machine.

For each run, the largest difference of displacements, relative to the largest displacement; infinity if ranks that share a node
have other bits there.
"""

import json
import sys
from pathlib import Path

import numpy as np
import runs_on_ranks as runs
from buckled import compressed, strut
from fields_on_ranks import difference, divisions
from mpi4py import MPI

import skfem_stvk as S
from skfem_stvk.linear import Kind, Outcome, Petsc, SuperLU
from skfem_stvk.ranks import distribute
from skfem_stvk.system.free_tangent import FreeTangent

MUMPS = Petsc("-ksp_type preonly -pc_type cholesky -pc_factor_mat_solver_type mumps")
DIVISIONS = "METIS", "random", "pieces"


def solved(mesh, solver, loads, **supports):
    result = S.solve_static(
        runs.system(mesh, [S.StVK(young=runs.materials(mesh), poisson=0.3)], loads, **supports),
        steps=2,
        solver=solver,
        rtol=1e-12,
        quiet=True,
    )
    return result.u


def down(mesh, size=0.01):
    return S.Traction(lambda x: x[0] > 0.8, -size * np.eye(mesh.d)[-1])


def moved(mesh, solver, mass):
    body = runs.system(mesh, [S.StVK(young=runs.materials(mesh), poisson=0.3, density=1.0)], [S.Gravity(g=[0, 0, -0.05])])
    step = S.BackwardEuler(dt=0.1, solver=solver, rtol=1e-12)
    return S.simulate(body, step, until=0.5, mass=mass, quiet=True).u


def cases():
    """Return the body, and a function of a mesh and a solver, by name."""
    found = {name: (name, lambda m, s: solved(m, s, [down(m, 0.05)])) for name in runs.BODIES}
    found["beam"] = "beam", lambda m, s: solved(m, s, [down(m)])
    found["sliding"] = "beam", lambda m, s: solved(m, s, [down(m)], fixed={runs.start: "xyz", (lambda x: x[1] < 0.1): "y"})
    found["plane strain"] = "beam", lambda m, s: solved(m, s, [down(m)], fixed={runs.start: "xyz", (lambda x: x[1] > -9): "y"})
    found["small free end"] = "beam", lambda m, s: solved(m, s, [down(m)], fixed={(lambda x: x[0] < 2.5): "xyz"})
    found["moved end"] = "beam", lambda m, s: solved(m, s, [], prescribed={lambda x: x[0] > 2.8: {"x": 0.2, "z": 0.3}})
    found["follower pressure"] = "beam", lambda m, s: solved(m, s, [S.Pressure(lambda x: x[2] > 0.95, 0.005)])
    for mass in ("lumped", "consistent"):
        found[f"motion, {mass} mass"] = "beam", lambda m, s, mass=mass: moved(m, s, mass)
    found["MUMPS"] = "beam", lambda m, s: solved(m, MUMPS if s == "petsc" else s, [down(m)])
    return found


def indefinite(part):
    """Return the outcomes of solves with a K that is positive definite, and beyond the critical load of a compressed beam."""
    system = runs.system(part, [S.StVK(young=1.0, poisson=0.3)])
    tangent = FreeTangent(system, Petsc(), Kind.SYMMETRIC)
    found = []
    for strain in (0.0, 0.3):
        u = np.zeros((part.nv, 3))
        u[:, 0] = -strain * (part.p[0] - part.bounds[0, 0])
        factors = tangent.factorise(tangent.free_matrix(u.ravel(), 1.0))
        found.append(factors.solve(tangent.space.random(), 1e-8).outcome is Outcome.SOLVED)
    return found


def force_of(mesh):
    """Return the force on free degrees of freedom due to a motion of the others, with zeros elsewhere."""
    end = {lambda x: x[0] > 2.8: {"x": 0.2, "z": 0.3}}
    system = runs.system(mesh, [S.StVK(young=runs.materials(mesh), poisson=0.3)], prescribed=end)
    tangent = FreeTangent(system, Petsc() if system.space.comm.divided else SuperLU(), Kind.SYMMETRIC)
    tangent.free_matrix(np.zeros(system.ndofs), 1.0)
    return tangent.space.expand(
        tangent.force_of(np.sin(system.mesh.p.T.ravel()) * tangent.constrained.expand(np.ones(tangent.constrained.n)))
    )


def main(out):
    comm, found = MPI.COMM_WORLD, {}
    for case, (name, run) in cases().items():
        mesh = runs.BODIES[name]
        whole = run(mesh, "superlu")
        for how in DIVISIONS:
            part = distribute(mesh, part_of=divisions(mesh, comm.size)[how])
            found[f"{case}, {how}"] = difference(part.space, run(part, "petsc"), whole, part.space.numbers)
    beam = distribute(runs.BEAM, part_of=divisions(runs.BEAM, comm.size)["random"])
    found["force of a motion"] = difference(beam.space, force_of(beam), force_of(runs.BEAM), beam.space.numbers)
    buckled = S.solve_static(compressed(distribute(strut())), 1, solver=MUMPS, raise_on_failure=False, quiet=True)
    found["counted"] = buckled.message
    found["indefinite"] = indefinite(beam)
    if comm.rank == 0:
        Path(out).write_text(json.dumps(found))


if __name__ == "__main__":
    main(sys.argv[1])
