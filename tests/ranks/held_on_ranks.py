"""Run by `mpiexec -n N python -m mpi4py held_on_ranks.py OUT.json`: messages about supports and locations, on ranks and on one
machine.

For each body, its supports and its division: the message on one machine, and that of each rank; empty if there is no error.
"""

import json
import sys
import warnings
from functools import partial
from pathlib import Path

import numpy as np
import skfem
from fields_on_ranks import RNG
from mpi4py import MPI
from system.test_mechanisms import BODIES, CHAIN, ONE_EDGE, ONE_NODE, TRIANGLES, WALL, at, crumbs, cube, fan, put_together, ring

import skfem_stvk as S
from skfem_stvk.ranks import distribute
from skfem_stvk.system.rigid import parts_of_body

warnings.simplefilter("ignore")
COMM = MPI.COMM_WORLD


def divisions(mesh):
    """Return the rank of each element by name of the division."""
    along = np.argsort(np.argsort(mesh.p[0, mesh.t].mean(axis=0), kind="stable"), kind="stable")
    n = COMM.size
    found = {"at the joint": along * n // mesh.nt, "random": RNG(3).permutation(np.arange(mesh.nt) % n)}
    return found | {"METIS": None} if mesh.nt > 50 else found


def block(d, n=4, element=None):
    """Return a block of cells."""
    mesh = {2: skfem.MeshTri, 3: skfem.MeshTet}[d].init_tensor(*[np.linspace(0, 1, n)] * d)
    return S.ElementMesh.of(mesh if element is None else element.init_tensor(*[np.linspace(0, 1, n)] * d))


def loose_part():
    """Return a cube, and another one that is not connected with it."""
    return put_together(cube(0, 0, 0), cube(5, 0, 0))


def with_cable(mesh, *ends):
    """Return the mesh with a named segment between the nodes at two points."""
    ids = [int(np.flatnonzero(at(*point)(mesh.p))[0]) for point in ends]
    return S.ElementMesh(mesh.p, mesh.t, lines={"cable": np.array(ids)[:, None]})


def cases():
    """Yield names, meshes, and functions of a mesh that return a system."""

    def body(m, fixed, *terms, law=None):
        return S.System(m, [law or S.StVK(young=2.0, poisson=0.3), *terms], fixed=fixed)

    for name, (mesh, _, _) in BODIES.items():
        yield f"{name}, held at one end", mesh, partial(body, fixed=WALL)
        yield f"{name}, not held", mesh, partial(body, fixed=None)
        yield f"{name}, almost all held", mesh, partial(body, fixed={lambda x: x[0] < 1.5: "xyz", lambda x: x[0] > 1.2: "xy"})
        yield f"{name}, held in z", mesh, partial(body, fixed={lambda x: x[2] == 0: "z", lambda x: x[0] == 0: "x"})
    both_ends = {**WALL, lambda x: x[0] > 1.9: "xyz"}
    yield "a chain, held at both ends", CHAIN, partial(body, fixed={**WALL, lambda x: x[0] == 3: "xyz"})
    yield "an edge, held at both ends", ONE_EDGE, partial(body, fixed=both_ends)
    outer = lambda x: x[0] == 2  # noqa: E731
    for axis in range(3):
        foundation = S.ElasticFoundation(outer, tuple(np.eye(3)[axis]))
        yield f"an edge on a foundation along {axis}", ONE_EDGE, lambda m, f=foundation: body(m, WALL, f)
        yield f"a node on a foundation along {axis}", ONE_NODE, lambda m, f=foundation: body(m, None, f)
    cable = S.StVK(young=1.0, area=0.1, simplices="cable")
    tied = with_cable(ONE_EDGE, (0, 0, 0), (2, 2, 0))
    yield "an edge with a cable", tied, lambda m: body(m, WALL, cable)
    yield "an edge with a cable within a piece", with_cable(ONE_EDGE, (0, 0, 0), (1, 1, 0)), lambda m: body(m, WALL, cable)
    yield "parts with a cable", with_cable(loose_part(), (1, 1, 1), (5, 1, 1)), lambda m: body(m, WALL, cable)
    yield "a loose part", loose_part(), partial(body, fixed=WALL)
    yield "a loose part at one node", loose_part(), partial(body, fixed={**WALL, at(5, 0, 0): "xyz"})
    yield "triangles", TRIANGLES, partial(body, fixed={lambda x: x[0] == 0: "xy"})
    for n in (3, 5, 12):
        yield f"a ring of {n}", ring(n), partial(body, fixed=None)
    yield "a fan", fan(40), partial(body, fixed={at(*fan(40).p[:, 0]): "xyz"})
    beam = S.ElementMesh.of(skfem.MeshTet.init_tensor(np.linspace(0, 4, 9), np.linspace(0, 1, 3), np.linspace(0, 1, 3)))
    ends = {
        "wall": {lambda x: x[0] == 0: "xyz"},
        "one node": {at(4, 1, 1): "xyz"},
        "two nodes": {lambda x: np.abs(x[1:]).max(0) == 0: "xyz"},
    }
    for name, fixed in ends.items():
        yield f"a beam at {name}", beam, partial(body, fixed=fixed)
        yield f"a quadratic beam at {name}", beam.with_degree(2), partial(body, fixed=fixed)
    region = S.StVK(young=1.0, poisson=0.3, region="ends")
    middle = np.abs(beam.p[0, beam.t].mean(axis=0) - 2) < 0.5
    named = S.ElementMesh(beam.p, beam.t, subdomains={"ends": np.flatnonzero(~middle)})
    yield "a beam without its middle", named, partial(body, fixed=WALL, law=region)
    for element in (skfem.MeshHex, skfem.MeshQuad):
        mesh = block(3 if element is skfem.MeshHex else 2, element=element)
        few = S.ElementMesh(mesh.p, mesh.t[:, RNG(2).random(mesh.nt) < 0.5], element=mesh.element)
        used, t = np.unique(few.t, return_inverse=True)
        few = S.ElementMesh(few.p[:, used], t.reshape(few.t.shape), element=mesh.element)
        yield f"some {mesh.element.name}", few, lambda m: body(m, {lambda x: x[0] == 0: "xyz"[: m.d]})
    for seed in range(8):
        for d in (2, 3):
            mesh, rng = crumbs(d, seed, 0.2 + 0.07 * seed, seed % 2 == 0)
            nodes = np.flatnonzero(rng.random(mesh.nv) < 0.03 * seed)
            fixed = {tuple(nodes.tolist()): "xyz"[:d]} if len(nodes) else None
            yield f"crumbs {seed} in {d}D", mesh, partial(body, fixed=fixed)


def message(work):
    """Return the message of the error that `work` raises, or an empty text."""
    try:
        work()
        return ""
    except S.StvkError as error:
        return f"{type(error).__name__}: {error}"


def main(out):
    found = {}
    for name, mesh, build in cases():
        whole = build(mesh)
        for how, part_of in divisions(mesh).items():
            if mesh.nt < COMM.size:
                continue
            one = build(distribute(mesh, part_of=part_of))
            on_rank = message(one.check_held)
            same = np.array_equal(parts_of_body(one), parts_of_body(whole)[one.mesh.node_numbers])
            found[f"{name}, {how}"] = [message(whole.check_held), *COMM.allgather(on_rank if same else "other parts")]
    if COMM.rank == 0:
        Path(out).write_text(json.dumps(found, indent=1))


if __name__ == "__main__":
    main(sys.argv[1])
