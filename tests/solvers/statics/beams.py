"""Small test cases of statics: unstructured meshes of both orientations, with nu != 0."""

import numpy as np
import skfem
from bodies import turned_round

from skfem_stvk import ElementMesh, Gravity, NodalLoad, StVK, System, Traction

LOAD = np.array([30.0, -20.0, -60.0])
#: Buckling load of `column`.
CRITICAL = np.pi**2 * (1e4 / (1 - 0.3**2)) / 12 / (4 * 20**2)


def beam(n=2, length=5.0, seed=7):
    """Return a cantilever along x with displaced inner vertices."""
    mesh = skfem.MeshTet.init_tensor(
        np.linspace(0, length, int(length * n) + 1), np.linspace(0, 1, n + 1), np.linspace(0, 1, n + 1)
    )
    rng, p = np.random.default_rng(seed), mesh.p.copy()
    inner = np.setdiff1d(np.arange(p.shape[1]), mesh.boundary_nodes())
    p[:, inner] += 0.2 / n * rng.uniform(-1, 1, (3, len(inner)))
    ends = {"wall": mesh.facets[:, mesh.facets_satisfying(lambda x: x[0] == 0)]}
    ends["tip"] = mesh.facets[:, mesh.facets_satisfying(lambda x: x[0] == length)]
    return ElementMesh(p, turned_round(mesh.t, rng), boundaries=ends)


def bent(load=LOAD, n=2, **options):
    """Return a cantilever with large bending by a traction and by its own weight."""
    terms = [StVK(young=1e4, poisson=0.3, density=1.0), Gravity(g=(0, 0, -5.0)), Traction("tip", load)]
    return System(beam(n), terms, fixed={"wall": "xyz"}, **options)


def block(squeeze, n=6, nu=0.3):
    """Return the unit cube between two plates that are bonded to it and pressed together."""
    mesh = skfem.MeshTet.init_tensor(*[np.linspace(0, 1, n + 1)] * 3)
    return System(
        mesh,
        StVK(young=1e5, poisson=nu),
        fixed={lambda x: x[0] == 0: "xyz"},
        prescribed={lambda x: x[0] == 1: {"x": -squeeze, "y": 0.0, "z": 0.0}},
    )


def column(load, imperfection=0.0, n=40):
    """Return a slender strut in plane strain, clamped at its foot and compressed at its head.

    The mesh is symmetric about the axis.
    """
    quads = skfem.MeshQuad.init_tensor(np.linspace(0, 20, n + 1), np.linspace(-0.5, 0.5, 3))
    a, b, c, d = quads.t
    middle = quads.p[:, quads.t].mean(axis=1)
    p = np.hstack([quads.p, middle])
    m = quads.nvertices + np.arange(quads.nelements)
    t = np.hstack([np.stack(corner) for corner in ((a, b, m), (b, c, m), (c, d, m), (d, a, m))])
    return System(
        (p, t),
        [StVK(young=1e4, poisson=0.3), Traction(lambda x: x[0] == 20, (-load, imperfection * load))],
        fixed={lambda x: x[0] == 0: "xy"},
    )


def two_bars(rise, load):
    """Return two bars from feet at (-1, 0) and (1, 0) to a node at the height `rise`, with a load there."""
    p, t = np.array([[-1, 0, 1.0], [0, rise, 0]]), np.array([[0, 1], [1, 2]])
    return System((p, t), [StVK(young=1e5, poisson=0.3, area=1e-2), NodalLoad([1], load)], fixed=[([0, 2], "xy")])


def free_of(system):
    """Return the ids of the degrees of freedom that can move."""
    return np.setdiff1d(np.arange(system.ndofs), system.supports.held)


def tangent(system, u, t=1.0):
    """Return K over the free degrees of freedom, dense."""
    return system.jacobian(u, t).toarray()[np.ix_(free_of(system), free_of(system))]
