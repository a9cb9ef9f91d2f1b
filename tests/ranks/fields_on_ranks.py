"""Run by `mpiexec -n N python -m mpi4py fields_on_ranks.py OUT.json`: differences between a body on ranks and on one machine.

For each kind of elements, each division and each term, the largest difference of fields and numbers, relative to their size. Every
vector on ranks must have the same bits at nodes that ranks share.
"""

import json
import sys
import warnings
from pathlib import Path

import numpy as np
from mpi4py import MPI

sys.path.insert(0, str(Path(__file__).parent.parent))
from bodies import EVERY_MESH, state

import skfem_stvk as S
from skfem_stvk.ranks import distribute
from skfem_stvk.system.operator import FreeOperator

warnings.simplefilter("ignore")
RNG = np.random.default_rng


def divisions(mesh, ranks):
    """Return the rank of each element by name of the division; None for METIS."""
    strips = np.argsort(np.argsort(mesh.p[0, mesh.t].mean(axis=0), kind="stable")) * ranks // mesh.nt
    random = RNG(3).permutation(np.arange(mesh.nt) % ranks)
    pieces = np.where(np.arange(mesh.nt) % 7 < 2, 0, strips)  # parts in pieces, nodes on many ranks
    found = {"METIS": None, "strips": strips, "random": random, "pieces": pieces}
    return {name: of for name, of in found.items() if of is None or len(np.unique(of)) == ranks}


def equal_bits(space, x):
    """Return whether a vector has the bits of the rank that counts the node, on all ranks."""
    return not space.comm.any(not np.array_equal(space.share(space.counted(x)), x))


def difference(space, own, whole, at=None):
    """Return the largest difference, relative to the whole; infinity if ranks that share a node have other bits there."""
    if at is None:
        return (
            0.0
            if np.array_equal(own, whole)
            else float(np.max(np.abs(np.asarray(own) - whole) / np.maximum(np.abs(whole), 1e-300)))
        )
    own, size = own.reshape(len(at), -1), abs(whole).max() + 1e-300
    if not all(equal_bits(space, np.ascontiguousarray(column)) for column in own.T):
        return float("inf")
    return space.comm.most(float(abs(own - whole.reshape(-1, own.shape[1])[at]).max(initial=0.0))) / size


def compare(build, mesh, part, u, v):
    """Return the differences of what a system and its terms compute, by name."""
    one, whole = build(part), build(mesh)
    space, nodes = part.space, part.node_numbers
    fields = [fields_of(system, u[system.space.numbers], v[system.space.numbers]) for system in (one, whole)]
    sizes = [abs(field).max() + 1e-300 for field in fields[1].values()]
    own = np.concatenate([field.reshape(part.nv, -1) for field in fields[0].values()], axis=1)
    bits = own == space.share(space.counted(np.ones(part.nv))[:, None] * own)
    columns = np.cumsum([field.size // part.nv for field in fields[0].values()])[:-1]
    off = [
        float(abs(field.reshape(part.nv, -1) - other.reshape(mesh.nv, -1)[nodes]).max()) / size if equal.all() else np.inf
        for field, other, size, equal in zip(
            fields[0].values(), fields[1].values(), sizes, np.split(bits, columns, axis=1), strict=True
        )
    ]
    found = dict(zip(fields[0], space.comm.most(np.array(off)).tolist(), strict=True))
    numbers = {"smallest J": (one.smallest_volume_ratio(u[space.numbers]), whole.smallest_volume_ratio(u))}
    if not whole.without_energy:
        numbers["W"] = one.energy(u[space.numbers]), whole.energy(u)
    found |= {name: difference(space, *pair) for name, pair in numbers.items()}
    same = np.array_equal(one.inside_out(8 * u[space.numbers]), whole.inside_out(8 * u))
    return found | {"inverted elements": 0.0 if same else float("inf")}


def fields_of(system, u, v):
    """Return vectors and blocks at nodes, by name."""
    free, y, K = system.free_dofs(np.flatnonzero(system.space.numbers % 5 == 0)), np.zeros_like(v), system.linear_operator(u)
    y[free.free] = FreeOperator(K, free) @ v[free.free]
    return {
        "F": system.internal_force(u),
        "loads": system.external_force(u, 0.7),
        "residual": system.residual(u, 0.7),
        "K v": K @ v,
        "K v of free": y,
        "diagonal": K.diagonal_blocks(),
    }


def named(mesh):
    """Return the mesh with names: two regions, its skin, a face between them, nodes at one end, and cables."""
    size = mesh.bounds[0, 1] - mesh.bounds[0, 0]
    order = np.argsort(mesh.p[0, mesh.t].mean(axis=0))
    low = np.sort(order[: mesh.nt // 3])
    regions = {"low": low, "high": np.setdiff1d(np.arange(mesh.nt), low)}
    ends = {"end": np.flatnonzero(mesh.p[0] < mesh.bounds[0, 0] + 0.3 * size)}
    first, last = mesh.t[0, [0, -1]]
    lines = {} if mesh.element.degree == 2 else {"cables": np.array([mesh.t[:2, 0], [first, last]], dtype=np.int32).T}
    return S.ElementMesh(mesh.p, mesh.t, regions, {"skin": mesh.surface}, ends, mesh.element, lines)


def terms(mesh):
    """Return functions that make the terms of a body on a mesh, or on its part, by name."""
    d, young = mesh.d, RNG(4).uniform(1, 5, mesh.nt)

    def base(m):
        return S.StVK(young=young[m.element_numbers], poisson=0.3, density=2.0)

    corner = tuple(mesh.p[:, 3] + 0.001)
    laws = {
        "StVK": lambda m: [base(m)],
        "two regions": lambda m: [
            S.StVK(young=m.values(young, "low") if hasattr(m, "values") else young[m.elements("low")], poisson=0.2, region="low"),
            S.NeoHookean(young=3.0, poisson=0.3, region="high", density=2.0),
        ],
        "NeoHookean": lambda m: [S.NeoHookean(young=young[m.element_numbers], poisson=0.3)],
        "LinearElastic": lambda m: [S.LinearElastic(young=young[m.element_numbers], poisson=0.3)],
        "Corotated": lambda m: [S.Corotated(young=young[m.element_numbers], poisson=0.3)],
        "InvertibleStVK": lambda m: [S.InvertibleStVK(young=young[m.element_numbers], poisson=0.3)],
        "VolumePenalty": lambda m: [base(m), S.VolumePenalty(0.5, kind="quadratic", region="low")],
        "Gravity": lambda m: [base(m), S.Gravity(g=np.arange(1.0, d + 1))],
        "BodyForce": lambda m: [base(m), S.BodyForce(lambda x, t: (1 + t) * x, region="high")],
        "NodalLoad": lambda m: [base(m), S.NodalLoad("end", np.arange(1.0, d + 1)), S.NodalLoad([0, 5], np.ones(d))],
        "NodalLoad by x": lambda m: [base(m), S.NodalLoad(lambda x: x[0] > -9, lambda x, t: t * x)],
        "nearest node": lambda m: [base(m), S.NodalLoad(S.NearestNode(corner), np.ones(d))],
        "Traction": lambda m: [base(m), S.Traction("skin", np.arange(1.0, d + 1))],
        "Traction by x": lambda m: [base(m), S.Traction("skin", lambda x, t: x[[-1] * d])],
        "Pressure": lambda m: [base(m), S.Pressure("skin", 0.3)],
        "ElasticFoundation": lambda m: [base(m), S.ElasticFoundation(lambda x: x[0] > -9, np.arange(1.0, d + 1))],
    }
    if mesh.element.is_linear_simplex:
        laws["SpringNetwork"] = lambda m: [S.SpringNetwork(young=young[m.element_numbers], poisson=0.3)]
        laws["EdgeNetwork"] = lambda m: [S.EdgeNetwork.of(m, base(m))]
        laws["skin"] = lambda m: [
            base(m),
            S.StVK(young=7.0, poisson=0.3, simplices="skin", **({"thickness": 0.1} if d == 3 else {})),
        ]
        laws["cables"] = lambda m: [base(m), S.StVK(young=7.0, area=0.2, simplices="cables")]
        laws["cables by nodes"] = lambda m: [base(m), S.StVK(young=7.0, area=0.2, simplices=mesh.t[:2, :3])]
    return laws


def applies(mesh, make):
    """Return whether the terms are for meshes of these elements."""
    try:
        S.System(mesh, make(mesh))
    except S.errors.StvkError:
        return False
    return True


def main(out, *which):
    comm, found = MPI.COMM_WORLD, {}
    for name, bare in EVERY_MESH.items():
        mesh = named(bare)
        u, v = 0.4 * state(mesh).ravel(), RNG(5).standard_normal(mesh.p.size)
        laws = {term: make for term, make in terms(mesh).items() if applies(mesh, make)}
        for how, part_of in divisions(mesh, comm.size).items():
            if which and how not in which:
                continue
            part = distribute(mesh, part_of=part_of)
            for term, make in laws.items():
                if how == "random" or term in ("StVK", "Pressure", "ElasticFoundation", "NodalLoad", "two regions"):
                    found[f"{name}, {how}, {term}"] = compare(lambda m, make=make: S.System(m, make(m)), mesh, part, u, v)
    if comm.rank == 0:
        Path(out).write_text(json.dumps(found))


if __name__ == "__main__":
    main(*sys.argv[1:])
