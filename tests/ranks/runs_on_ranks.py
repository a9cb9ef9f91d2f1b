"""Run by `mpiexec -n N python -m mpi4py runs_on_ranks.py OUT.json`: static solves and motions on ranks and on one machine.

Differences of displacements are relative to the largest displacement, those of ledger columns to the largest of their kind. All
ranks must have the same bits at shared nodes, and the same steps.
"""

import json
import sys
import warnings
from pathlib import Path

import numpy as np
from bodies import EVERY_MESH, distorted, turned_round
from fields_on_ranks import RNG, difference, divisions, equal_bits
from mpi4py import MPI

import skfem_stvk as S
from skfem_stvk.ranks import distribute

warnings.simplefilter("ignore")
CG = "block-jacobi-cg"


def beam():
    """Return a beam of 480 tetrahedra of both orientations, with two regions."""
    import skfem

    mesh = skfem.MeshTet.init_tensor(np.linspace(0, 3, 11), np.linspace(0, 1, 3), np.linspace(0, 1, 5))
    p = distorted(mesh.p, RNG(1), 0.1)
    left = p[0, mesh.t].mean(axis=0) < 1.2
    return S.ElementMesh(p, turned_round(mesh.t, RNG(2)), {"left": np.flatnonzero(left), "right": np.flatnonzero(~left)})


BEAM = beam()
BODIES = {name: EVERY_MESH[name] for name in ("triangles", "quadratic tetrahedra", "quadratic triangles", "hexahedra")} | {
    "beam": BEAM
}


def start(x):
    return x[0] < 0.2


def materials(m):
    """Return a stiffness that differs from element to element."""
    return RNG(4).uniform(1, 5, m.element_count)[m.element_numbers]


def system(m, laws, loads=(), **supports):
    return S.System(m, [*laws, *loads], **({"fixed": {start: "xyz"[: m.d]}} | supports))


def by_node(reaction):
    """Return the nodes and the forces of a reaction, as columns."""
    return {"vertices": reaction.vertices.tolist(), "reaction": reaction.by_node.ravel().tolist()}


def statics():
    """Return functions of a mesh that solve, and the divisions that each is tried with."""

    def solve(m, laws, *loads, steps=2, **supports):
        result = S.solve_static(system(m, laws, loads, **supports), steps=steps, solver=CG, rtol=1e-12, quiet=True)
        columns = {"t": [s.t for s in result.history], "iterations": [len(s.iterations) for s in result.history]}
        return result.u, columns | by_node(result.reaction())

    def stvk(m):
        return S.StVK(young=materials(m), poisson=0.3)

    def down(m, size):
        return S.Traction(lambda x: x[0] > 0.8, -size * np.eye(m.d)[-1])

    every = ("METIS", "strips", "random", "pieces")
    runs = {
        f"static, {name}": (name, lambda m: solve(m, [stvk(m)], down(m, 0.05)), ("METIS", "random"))
        for name in BODIES
        if name != "beam"
    }
    runs["static, beam"] = "beam", lambda m: solve(m, [stvk(m)], down(m, 0.01)), every
    runs["static, moved end"] = (
        "beam",
        lambda m: solve(m, [stvk(m)], prescribed={lambda x: x[0] > 2.8: {"x": 0.2, "z": 0.3}}),
        every,
    )
    runs["static, foundation and weight"] = (
        "beam",
        lambda m: solve(m, [stvk(m), S.ElasticFoundation(lambda x: x[2] < 0.1, 0.2)], S.BodyForce([0, 0, -0.05])),
        ("METIS", "pieces"),
    )
    laws = {
        "NeoHookean": lambda m: [S.NeoHookean(young=materials(m), poisson=0.3)],
        "Corotated": lambda m: [S.Corotated(young=materials(m), poisson=0.3)],
        "InvertibleStVK": lambda m: [S.InvertibleStVK(young=materials(m), poisson=0.3)],
        "LinearElastic": lambda m: [S.LinearElastic(young=materials(m), poisson=0.3)],
        "VolumePenalty": lambda m: [stvk(m), S.VolumePenalty(0.5)],
        "two regions": lambda m: [
            S.StVK(young=3.0, poisson=0.2, region="left"),
            S.NeoHookean(young=1.0, poisson=0.4, region="right"),
        ],
    }
    for name, make in laws.items():
        runs[f"static, {name}"] = "beam", lambda m, make=make: solve(m, make(m), down(m, 0.01)), ("METIS", "random")
    return runs


def motions():
    """Return functions of a mesh that simulate, as in `statics`."""
    cg = {"rtol": 1e-12, "solver": CG}
    integrators = {
        "Verlet": S.VelocityVerlet(dt=0.01),
        "equation 9": S.LinearBackwardEuler(dt=0.05, **cg),
        "energy and momentum": S.EnergyMomentum(dt=0.05, solver=CG),
        "Newmark": S.Newmark(dt=0.05, **cg),
    }

    def move(m, integrator, *loads, steps=100, damping=(), **supports):
        body = system(m, [S.StVK(young=materials(m), poisson=0.3, density=1.0)], loads, **supports)
        v0 = 0.1 * np.sin(3 * m.p).T.ravel()
        v0.reshape(-1, m.d)[start(m.p)] = 0
        run = S.simulate(body, integrator, until=steps * (integrator.dt or 0.01), v0=v0, damping=damping, quiet=True)
        return run.u, {name: run.ledger[name].tolist() for name in run.ledger.names} | by_node(run.reaction())

    runs = {}
    for name, integrator in integrators.items():
        steps = 100 if name in ("Verlet", "equation 9") else 20

        def run(m, integrator=integrator, steps=steps):
            return move(m, integrator, S.Gravity(g=[0, 0, -0.05]), steps=steps)

        runs[f"motion, {name}"] = "beam", run, ("METIS", "pieces")
    runs["motion, Verlet with steps that are found"] = "beam", lambda m: move(m, S.VelocityVerlet()), ("METIS", "random")
    runs["motion, pressure"] = (
        "beam",
        lambda m: move(m, S.VelocityVerlet(dt=0.01), S.Pressure(lambda x: x[2] > 0.8, lambda t: 0.2 * np.sin(5 * t))),
        ("METIS", "random"),
    )
    runs["motion, moved end"] = (
        "beam",
        lambda m: move(
            m,
            S.VelocityVerlet(dt=0.01),
            damping=[S.Rayleigh(0.1, 0.002)],
            prescribed={lambda x: x[0] > 2.8: {"x": lambda t: t**2 / 9}},
        ),
        ("METIS", "random"),
    )
    return runs


def kind_of(name):
    kinds = {"closure_error": "energy", "work": "energy"} | {
        kind: kind for kind in ("energy", "linear_momentum", "angular_momentum")
    }
    return next((kind for part, kind in kinds.items() if part in name), name)


def compare(name, run, how, whole):
    mesh = BODIES[name]
    part = distribute(mesh, part_of=divisions(mesh, MPI.COMM_WORLD.size)[how])
    space = part.space
    own, columns = run(part)
    u, reference = whole
    found = {"u": difference(space, own, u, space.numbers), "bits": 0.0 if equal_bits(space, own) else float("inf")}
    largest = {}
    for name, column in reference.items():
        largest[kind_of(name)] = max(largest.get(kind_of(name), 1e-300), np.abs(column).max(initial=0))
    ranks = space.comm.mpi.allgather(columns)
    found["columns of ranks"] = 0.0 if all(one == ranks[0] for one in ranks) else float("inf")
    for name, column in reference.items():
        if len(columns[name]) != len(column):
            found[name] = float("inf")
        elif name not in ("inverted_elements", "wall_time"):
            found[name] = float(np.abs(np.subtract(columns[name], column)).max(initial=0) / largest[kind_of(name)])
    return found


def main(out, *names):
    found = {}
    for name, (body, run, hows) in (statics() | motions()).items():
        if names and not any(one in name for one in names):
            continue
        whole = run(BODIES[body])
        for how in hows:
            found[f"{name}, {how}"] = compare(body, run, how, whole)
    if MPI.COMM_WORLD.rank == 0:
        Path(out).write_text(json.dumps(found))


if __name__ == "__main__":
    main(*sys.argv[1:])
