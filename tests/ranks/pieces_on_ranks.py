"""Run by `mpiexec -n N python -m mpi4py pieces_on_ranks.py FOLDER`: files and fields of states on ranks, and those of one machine.

For each body, FOLDER gets NAME.pvtu with its pieces, and NAME.vtu. `out.json` has the largest differences of fields, relative to
their size, and the elements of each rank.
"""

import json
import sys
import warnings
from pathlib import Path

import numpy as np
from bodies import EVERY_MESH, state
from mpi4py import MPI

from skfem_stvk import ElementMesh, MeshError, StVK, StvkError, System, read_state
from skfem_stvk.ranks import distribute
from skfem_stvk.results import Fields, Series, compare_networks, names, plot, write_mesh, write_vtu
from skfem_stvk.results.monitors import point_of
from skfem_stvk.system.signature import Fingerprint

warnings.simplefilter("ignore")
COMM = MPI.COMM_WORLD


def bodies():
    """Return meshes, and functions that return the systems on them. The second region of a mesh has no term."""
    for name, bare in EVERY_MESH.items():
        low, skin = np.flatnonzero(bare.p[0, bare.t].mean(axis=0) < 0.6), bare.surface
        mesh = ElementMesh(
            bare.p, bare.t, boundaries={"skin": skin}, subdomains={"low": low, "some": low[::2]}, element=bare.element
        )
        yield name, mesh, lambda m: System(m, StVK(young=2.0, poisson=0.3))
        if mesh.k == mesh.d == 3 and mesh.element.degree == 1:
            yield f"part of {name}", mesh, lambda m: System(m, StVK(young=2.0, poisson=0.3, region="low"))
        if name == "tetrahedra":
            bag = StVK(young=7.0, poisson=0.2, simplices="skin", thickness=0.1)
            yield "covered", mesh, lambda m, bag=bag: System(m, [StVK(young=2.0, poisson=0.3, region="low"), bag])
            order = np.argsort(mesh.p[0])
            lines = {"near": np.stack([order[:3], order[1:4]]), "far": np.stack([order[-4:-1], order[-3:]])}
            tied, pairs = (
                ElementMesh(mesh.p, mesh.t, {"low": low, "some": low[::2]}, lines=lines),
                np.unique(np.sort(mesh.t[:2, ::9], axis=0), axis=1),
            )
            cables = [StVK(young=7.0, area=0.1 * i, simplices=where) for i, where in enumerate(("near", "far", pairs), start=1)]
            yield "tied", tied, lambda m, cables=cables: System(m, [StVK(young=2.0, poisson=0.3), *cables])


def division(name, mesh):
    """Return the rank of each element: strips of which the first has terms everywhere, random ranks, or None for METIS."""
    if name in ("covered", "tied") or name.startswith("part of"):
        return np.argsort(np.argsort(mesh.p[0, mesh.t].mean(axis=0))) * COMM.size // mesh.nt
    return np.random.default_rng(2).permutation(np.arange(mesh.nt) % COMM.size) if "quad" in name else None


def difference(space, own, whole, numbers):
    """Return the largest difference, relative to the largest value; infinite if other values are missing."""
    whole = np.ma.masked_array(whole)
    a, b = np.ma.filled(own, 0.0), whole.filled(0.0)
    same = np.array_equal(np.ma.getmaskarray(own), np.ma.getmaskarray(whole)[numbers])
    return space.comm.most(float(np.abs(a - b[numbers]).max(initial=0.0)) if same else np.inf) / (np.abs(b).max() or 1.0)


def relative(own, whole):
    """Return the largest relative difference of numbers."""
    return float(np.max(np.abs(np.divide(own, whole) - 1)))


def same_bits(space, x):
    """Return whether all ranks have the same bits at nodes that they share."""
    rows = np.ascontiguousarray(np.ma.filled(x, 0.0).reshape(len(x), -1).T)
    return not space.comm.any(sum(not np.array_equal(space.share(space.counted(row)), row) for row in rows) > 0)


def refused(call):
    """Return the message of an error."""
    try:
        call()
    except (StvkError, MeshError) as error:
        return str(error)
    return ""


def main(folder):
    out = {}
    for name, mesh, build in bodies():
        part = distribute(mesh, part_of=division(name, mesh))
        space, u = part.space, 0.1 * state(mesh).ravel()
        v = np.cos(np.arange(u.size))
        one, whole = Fields.of(build(part)).at(u[space.numbers], v[space.numbers]), Fields.of(build(mesh)).at(u, v)
        of_lower = [Fingerprint("path of equilibria", build(m), {}, (1.0,), {}).signature.numbers for m in (part, mesh)]
        found = {"signature": relative(*(numbers.get("the elements beside the mesh", [1.0]) for numbers in of_lower))}
        for lower, other in zip(one.beside, whole.beside, strict=True):
            meshes = lower.fields.mesh, other.fields.mesh
            points = [[point_of(m, i) for i in range(0, meshes[1].nt, 3)] for m in meshes]
            found["centres of lower elements"] = 0.0 if points[0] == points[1] else np.inf
        for field in names():
            found[field] = difference(space, one[field], whole[field], part.element_numbers)
            at_nodes = one.at_nodes(field)
            found[f"{field} at nodes"] = difference(space, at_nodes, whole.at_nodes(field), part.node_numbers)
            found[f"{field} at nodes of some"] = difference(
                space, one.at_nodes(field, "some"), whole.at_nodes(field, "some"), part.node_numbers
            )
            found[f"{field}, bits"] = 0.0 if same_bits(space, at_nodes) else np.inf
        write_vtu(folder / (f"{name}.pvtu" if space.comm.divided else f"{name}.vtu"), one, names())
        again = read_state(folder / (f"{name}.pvtu" if space.comm.divided else f"{name}.vtu"), part)
        found["read again"] = float(
            space.comm.any(not all(np.array_equal(x, y[space.numbers]) for x, y in zip(again, (u, v), strict=True)))
        )
        if space.comm.leads:
            write_vtu(folder / f"{name} whole.vtu", whole, names())
        COMM.Barrier()
        again = read_state(folder / f"{name} whole.vtu", part)
        found["read whole"] = float(space.comm.any(not np.array_equal(again[0], u[space.numbers])))
        out[name] = {"differences": found, "ranks": [ids.tolist() for ids in COMM.allgather(part.element_numbers)]}
    messages = [
        refused(lambda: plot(one)),
        refused(lambda: write_mesh(folder / "mesh.vtu", part)),
        refused(lambda: write_vtu(folder / "x.vtu", one)),
        refused(lambda: Series(folder / "x.pvd").add(one, 0.0)),
        refused(lambda: compare_networks(part, StVK(young=1.0, poisson=0.3), u)),
    ]
    if COMM.rank == 0:
        (folder / "out.json").write_text(json.dumps({"bodies": out, "messages": messages}))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
