"""Run by `mpiexec -n N python -m mpi4py places_on_ranks.py OUT.json`: locations that only some ranks have, or none.

For each location: the degrees of freedom or the message of the error, on one machine and on ranks.
"""

import json
import sys
import warnings
from pathlib import Path

import numpy as np
import skfem
from held_on_ranks import message
from mpi4py import MPI

import skfem_stvk as S
from skfem_stvk.ranks import distribute

COMM = MPI.COMM_WORLD
MATERIAL = S.StVK(young=2.0, poisson=0.3)


def body(degree):
    """Return a beam along x with names of which a strip has all or none."""
    mesh = S.ElementMesh.of(skfem.MeshTet.init_tensor(np.linspace(0, 3, 10), np.linspace(0, 1, 3), np.linspace(0, 1, 3)))
    end = mesh.surface[:, (mesh.p[0, mesh.surface] == 3).all(axis=0)]
    corner = np.flatnonzero((mesh.p[0] == 3) & (mesh.p[1] == 0))
    names = {"boundaries": {"end": end, "twofold": end}, "node_sets": {"corner": corner, "twofold": corner}}
    regions = {"first": np.flatnonzero(mesh.p[0, mesh.t].mean(axis=0) < 0.4)}
    return S.ElementMesh(mesh.p, mesh.t, regions, **names).with_degree(degree)


LOCATIONS = {
    "a plane": S.Plane((3, 0, 0), (1, 0, 0)),
    "no plane": S.Plane((3.1, 0, 0), (1, 0, 0)),
    "a plane within a distance": S.Plane((3.1, 0, 0), (1, 0, 0), within=0.2),
    "a box": S.Box((2.9, 0, 0), (3, 1, 1)),
    "no box": S.Box((3.9, 0, 0), (4, 1, 1)),
    "a plane in the plane": S.Plane((3, 0), (1, 0)),
    "the nearest node": S.NearestNode((3.2, 0.1, 0.1)),
    "one of two nearest nodes": S.NearestNode((1.5, 0.25, 0.5)),
    "no near node": S.NearestNode((0, 900, 0)),
    "a predicate": lambda x: x[0] > 2.9,
    "no predicate": lambda x: x[0] > 3.9,
    "ids": [0, 89, 3],
    "one id": [89],
    "ids outside": [3, 4711],
    "an id twice": [3, 4, 3],
    "a mask": lambda m: np.arange(m.space.count // m.d) > 85,
    "a boundary": "end",
    "a node set": "corner",
    "two names": "twofold",
    "no name": "and",
}


def cases():
    """Yield names, and functions of a mesh that return numbers of the whole body, such as degrees of freedom, and a system."""
    for name, where in LOCATIONS.items():

        def at(m, where=where, name=name):
            return where(m) if name == "a mask" else where

        def fixed(m, at=at):
            system = S.System(m, MATERIAL, fixed=[(at(m), "xz")])
            return m.space.numbers[system.supports.fixed]

        def traction(m, at=at):
            force = S.System(m, [MATERIAL, S.Traction(at(m), (0, 0, 1.0))]).external_force(np.zeros(m.p.size))
            return m.space.numbers[np.abs(force) > 1e-12]

        yield f"fixed at {name}", fixed
        yield f"traction on {name}", traction

    def system(m, *terms, **options):
        return S.System(m, [MATERIAL, *terms], **options)

    end, wall, low = lambda x: x[0] > 2.9, lambda x: x[0] == 0, lambda x: x[2] == 0
    yield "traction on an edge", lambda m: system(m, S.Traction(lambda x: (x[0] > 2.9) & (x[1] == 0), (0, 0, 1.0)))
    yield "fixed and prescribed", lambda m: system(m, fixed={end: "x"}, prescribed={low: {"x": 0.1, "y": 0.2}})
    yield "prescribed twice", lambda m: system(m, prescribed=[(end, {"x": 0.1}), (low, {"x": 0.2})])
    yield "prescribed twice alike", lambda m: system(m, prescribed=[(end, {"x": 0.1}), (low, {"x": 0.1})])
    yield "everything fixed", lambda m: system(m, fixed={lambda x: x[0] >= 0: "xyz"})
    yield "nothing acts", lambda m: S.solve_static(system(m, fixed={wall: "xyz"}), quiet=True)
    yield (
        "one end moves",
        lambda m: S.solve_static(
            system(m, fixed={wall: "xyz"}, prescribed={end: {"x": 0.1}}), solver="block-jacobi-cg", quiet=True
        ),
    )
    yield "a region by box", lambda m: m.element_numbers[m.elements(S.Box((2.7, 0, 0), (3, 1, 1)))]
    yield "no region by box", lambda m: m.elements(S.Box((3.7, 0, 0), (4, 1, 1)))
    yield "a region by name", lambda m: m.element_numbers[m.elements("first")]
    yield "no region by name", lambda m: m.elements("second")
    yield "a region by ids", lambda m: m.element_numbers[m.elements(np.array([3, 215]))]
    yield "nodes in no term", lambda m: S.System(m, S.StVK(young=1.0, poisson=0.3, region="first"))
    yield "no density", lambda m: S.System(m, S.StVK(young=1.0, poisson=0.3), fixed={wall: "xyz"}).mass()
    yield (
        "density of one end",
        lambda m: (
            S.System(m, [MATERIAL, S.StVK(young=1.0, poisson=0.3, region="first", density=1.0)], fixed={end: "xyz"})
            .mass()
            .solve(np.zeros(m.p.size))
        ),
    )


def result(mesh, work):
    """Return the numbers that `work` returns, the message of its error, and its warnings, which rank 0 alone gives."""
    numbers = []

    def run():
        found = work(mesh)
        numbers.extend(found.tolist() if isinstance(found, np.ndarray) and found.dtype.kind == "i" else [])

    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always")
        error = message(run)
    texts = [str(one.message) for one in warned if issubclass(one.category, S.StvkWarning)]
    return sorted(set(numbers)), [error, *texts]


def main(out):
    found = {}
    for degree in (1, 2):
        mesh = body(degree)
        part_of = np.argsort(np.argsort(mesh.p[0, mesh.t[:4]].mean(axis=0), kind="stable")) * COMM.size // mesh.nt
        part = distribute(mesh, part_of=part_of)
        for name, work in cases():
            numbers, texts = result(mesh, work)
            of_ranks = COMM.allgather(result(part, work))
            found[f"{name}, degree {degree}"] = [
                [numbers, *texts],
                *[[sorted({n for of, _ in of_ranks for n in of}), error, *of_ranks[0][1][1:]] for _, (error, *_) in of_ranks],
            ]
    if COMM.rank == 0:
        Path(out).write_text(json.dumps(found, indent=1))


if __name__ == "__main__":
    main(sys.argv[1])
