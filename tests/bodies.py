"""Meshes and materials that the tests share.

The meshes have unequal edges and elements of both orientations. The materials have `lambda != mu` and `nu != 0`.
"""

import numpy as np
import skfem

from skfem_stvk import Anisotropic, ElementMesh, Isotropic, Orthotropic, StVK, TransverselyIsotropic
from skfem_stvk.mesh import points
from skfem_stvk.mesh.element import ELEMENTS
from skfem_stvk.mesh.points import rule_of
from skfem_stvk.referee.bodies import elasticity
from skfem_stvk.referee.discretisation import Discretisation, Shape
from skfem_stvk.referee.reference import ReferenceStVK


def distorted(p, rng, amount=0.15):
    """Return coordinates, each moved by up to `amount` times the mean spacing, so that no two edges are equal."""
    return p + amount * (np.ptp(p, axis=1).max() / p.shape[1] ** (1 / p.shape[0])) * rng.uniform(-1, 1, p.shape)


def turned_round(t, rng):
    """Return `t` with two vertices exchanged in about half of the elements, so that both orientations occur."""
    t = t.copy()
    half = rng.random(t.shape[1]) < 0.5
    t[:2, half] = t[1::-1, half]
    return t


def box(n=3):
    rng = np.random.default_rng(1)
    mesh = skfem.MeshTet.init_tensor(*[np.linspace(0, 1, n + 1)] * 3)
    return ElementMesh(distorted(mesh.p, rng), turned_round(mesh.t, rng))


def sheet(n=4):
    rng = np.random.default_rng(2)
    mesh = skfem.MeshTri.init_tensor(*[np.linspace(0, 1, n + 1)] * 2)
    return ElementMesh(distorted(mesh.p, rng), turned_round(mesh.t, rng))


def membrane(n=4):
    flat = sheet(n)
    x, y = flat.p
    return ElementMesh(np.stack([x, y, 0.3 * np.sin(3 * x) + 0.2 * y**2]), flat.t)


def bar(n=6, d=1):
    s = np.linspace(0, 1, n + 1) ** 1.3
    p = np.stack([s, 0.3 * s**2, np.cos(s)])[:d]
    return ElementMesh(p, np.stack([np.arange(n), np.arange(1, n + 1)])[[1, 0]])


def random_frames(n, rng):
    return np.linalg.qr(rng.standard_normal((n, 3, 3)))[0]


def some_voigt(rng):
    a = rng.standard_normal((6, 6))
    return a @ a.T + 3 * np.eye(6)


MESHES = {
    "tetrahedra": box(),
    "triangles": sheet(),
    "membrane": membrane(),
    "segments": bar(),
    "cable in the plane": bar(d=2),
    "cable": bar(d=3),
}


def bodies():
    """Return `{name: (mesh, terms)}`: each kind of simplex with each kind of material that suits it."""
    rng = np.random.default_rng(3)
    frame = random_frames(1, rng)[0]
    ply = {"young_axial": 14.0, "young_transverse": 1.0, "poisson_axial": 0.3, "poisson_transverse": 0.4, "shear_axial": 0.6}
    cases = {}
    for name, mesh in MESHES.items():
        cases[f"{name}, isotropic"] = mesh, [StVK(young=2.0, poisson=0.3)]
        cases[f"{name}, auxetic"] = mesh, [StVK(young=2.0, poisson=-0.4)]
        # a frame tilted out of the plane has no meaning in plane strain alone, but the material is valid there
        cases[f"{name}, anisotropic"] = mesh, [StVK(Anisotropic(some_voigt(rng), frame=frame))]
        cases[f"{name}, fibres"] = mesh, [StVK(TransverselyIsotropic(**ply, frame=random_frames(mesh.nt, rng)))]
        cases[f"{name}, two regions"] = (
            mesh,
            [
                StVK(young=2.0, poisson=0.45, region=np.arange(mesh.nt // 2)),
                StVK(Isotropic.from_lame(1.0, 0.3), region=np.arange(mesh.nt // 2, mesh.nt)),
            ],
        )
    for name in ("triangles", "membrane"):
        thickness = rng.uniform(0.5, 2, MESHES[name].nt)
        cases[f"{name}, plane stress"] = MESHES[name], [StVK(young=2.0, poisson=0.3, plane="stress", thickness=thickness)]
    cases["cable, area"] = MESHES["cable"], [StVK(young=rng.uniform(1, 2, MESHES["cable"].nt), area=0.3)]
    n = MESHES["tetrahedra"].nt
    orthotropic = Orthotropic(
        young=(rng.uniform(8, 12, n), rng.uniform(1, 2, n), 0.5),
        poisson=(0.3, 0.25, rng.uniform(0.1, 0.3, n)),
        shear=(0.2, 0.5, rng.uniform(0.6, 0.9, n)),
        frame=random_frames(n, rng),
    )
    cases["tetrahedra, heterogeneous orthotropic with element frames"] = MESHES["tetrahedra"], [StVK(orthotropic)]
    cases["tetrahedra, an array of constants"] = (
        MESHES["tetrahedra"],
        [StVK(young=rng.uniform(1, 100, n), poisson=rng.uniform(-0.4, 0.45, n))],
    )
    return cases


BODIES = bodies()


def reference_of(mesh, terms):
    """Return scikit-fem's assembly of these terms."""
    return ReferenceStVK(mesh.p, mesh.t, elasticity(mesh, terms))


def state(mesh, amount=0.3, seed=4):
    """Return a random displacement of each vertex; the displacements are not small."""
    return amount * np.random.default_rng(seed).standard_normal(mesh.p.size) / mesh.nv ** (1 / mesh.k)


def curved(mesh, amount=0.03, seed=5):
    """Return the mesh with quadratic simplices whose mid-edge nodes are moved: edges are curved, both orientations remain."""
    quadratic, rng = mesh.with_degree(2), np.random.default_rng(seed)
    p = quadratic.p.copy()
    p[:, mesh.nv :] += amount * rng.uniform(-1, 1, (mesh.d, quadratic.nv - mesh.nv))
    return ElementMesh(p, quadratic.t, element=quadratic.element)


def boxes(k, d=None, n=2):
    """Return a mesh of unequal hexahedra or quadrilaterals of both orientations; quadrilaterals with `d = 3` form a membrane."""
    rng, element = np.random.default_rng(6), ELEMENTS["hexahedra" if k == 3 else "quadrilaterals"]
    mesh = (skfem.MeshHex if k == 3 else skfem.MeshQuad).init_tensor(*[np.linspace(0, 1, n + 1)] * k)
    mirrored = [int(np.flatnonzero((element.nodes == row).all(axis=1))[0]) for row in np.abs(element.nodes - np.eye(k)[0])]
    p, t = distorted(mesh.p, rng), mesh.t.copy()
    half = rng.random(t.shape[1]) < 0.5
    t[:, half] = t[mirrored][:, half]
    if d == 3 > k:
        p = np.vstack([p, 0.3 * np.sin(3 * p[0]) + 0.2 * p[1] ** 2])
    return ElementMesh(p, t, element=element)


#: Elements with several points: curved quadratic simplices, quadrilaterals and hexahedra that are no parallelepipeds.
CURVED = {
    "quadratic tetrahedra": curved(box(2)),
    "quadratic triangles": curved(sheet(3)),
    "quadratic membrane": curved(membrane(3)),
    "quadratic segments": curved(bar(4), 0.02),
    "quadratic cable": curved(bar(4, d=3), 0.02),
    "quadrilaterals": boxes(2, n=3),
    "quadrilateral membrane": boxes(2, 3, n=3),
    "hexahedra": boxes(3),
}
#: Elements with several points whose Jacobian is the same at all of them.
STRAIGHT = {
    "quadratic tetrahedra": box(2).with_degree(2),
    "quadratic triangles": sheet(3).with_degree(2),
    "quadratic segments": bar(4).with_degree(2),
    "quadrilaterals": ElementMesh.of(skfem.MeshQuad.init_tensor(np.linspace(0, 1, 4) ** 1.3, np.linspace(0, 2, 3))),
    "hexahedra": ElementMesh.of(skfem.MeshHex.init_tensor(np.linspace(0, 1, 3) ** 1.3, np.linspace(0, 2, 3), [0, 0.3, 1])),
}
EVERY_MESH = MESHES | CURVED


def scikit_fem_of(mesh):
    """Return a basis of scikit-fem on the same nodes, with its vector element and a rule of high order.

    Return None if scikit-fem has no mesh of this kind.
    """
    known = {
        "tetrahedra": (skfem.MeshTet, skfem.ElementTetP1),
        "triangles": (skfem.MeshTri, skfem.ElementTriP1),
        "segments": (skfem.MeshLine, skfem.ElementLineP1),
        "quadratic tetrahedra": (skfem.MeshTet2, skfem.ElementTetP2),
        "quadratic triangles": (skfem.MeshTri2, skfem.ElementTriP2),
        "quadrilaterals": (skfem.MeshQuad, skfem.ElementQuad1),
        "hexahedra": (skfem.MeshHex, skfem.ElementHex1),
    }
    if mesh.k < mesh.d or mesh.element.name not in known:
        return None
    of_mesh, of_element = known[mesh.element.name]
    return skfem.Basis(of_mesh(mesh.p, mesh.corners, sort_t=False), skfem.ElementVector(of_element()), intorder=7)


def values_at(x, t, element, xi):
    """Return the values `sum_a N_a x_a` of a field `x` (d, nv) in elements `t` (n, nt), (nt, nq, d).

    `xi` (nq, k) are the reference points.
    """
    return np.einsum("qa,dat->tqd", element.values(xi), x[:, t])


def element_sizes(mesh, kind="exact"):
    """Return lengths, areas or volumes by the named rule, (nt,). The rule "exact" is exact except for curved membranes."""
    return points.sizes_of(mesh.p, mesh.t, mesh.element, kind)


def jacobians(mesh, xi):
    """Return determinants of the base vectors at reference points, (nt, nq).

    The determinant is negative where an element is inverted relative to its centre.
    """
    now, centre = (
        points.base_vectors_at(mesh.p, mesh.t, mesh.element, at) for at in (xi, rule_of(mesh.element, "one-point").points)
    )
    return points.signed(now, centre)


def node_sizes(mesh):
    """Return the shortest distance between two nodes in the elements around each node, (nv,), as the referee computes it."""
    return Shape(mesh, Discretisation(mesh.element.name)).node_size
