"""Supports and locations on quadratic elements, hexahedra and quadrilaterals include all nodes.

Degrees of freedom equal scikit-fem's.
"""

import numpy as np
import pytest
import skfem
from bodies import CURVED, scikit_fem_of

from skfem_stvk import ElementMesh, RegionError
from skfem_stvk.mesh.locations import describe, facets_at, vertices_at
from skfem_stvk.system import Supports
from skfem_stvk.system.supports import dofs_at


def straight(name):
    """Return a scikit-fem basis with named boundaries, on a mesh of elements with plane facets."""
    known = {
        "quadratic tetrahedra": (skfem.MeshTet, skfem.ElementTetP2),
        "quadratic triangles": (skfem.MeshTri, skfem.ElementTriP2),
        "quadratic segments": (skfem.MeshLine, skfem.ElementLineP2),
        "quadrilaterals": (skfem.MeshQuad, skfem.ElementQuad1),
        "hexahedra": (skfem.MeshHex, skfem.ElementHex1),
    }
    of_mesh, element = known[name]
    mesh = of_mesh().refined(2).with_boundaries({"wall": lambda x: x[0] == 0, "tip": lambda x: x[0] == 1})
    return skfem.Basis(mesh, skfem.ElementVector(element()))


def ours(basis):
    mesh = ElementMesh.of(basis.mesh)
    return mesh.with_degree(2) if "P2" in type(basis.elem.elem).__name__ else mesh


@pytest.mark.parametrize(
    "name", ["quadratic tetrahedra", "quadratic triangles", "quadratic segments", "quadrilaterals", "hexahedra"]
)
def test_scikit_fems_degrees_of_freedom_are_ours(name):
    basis = straight(name)
    mesh = ours(basis)
    wall = basis.get_dofs("wall")
    assert np.abs(basis.doflocs[:, :: mesh.d] - mesh.p).max() < 1e-15 and mesh.p.size == basis.N
    by_name = Supports(mesh, {"wall": "xyz"[: mesh.d]}).fixed
    assert np.array_equal(by_name, wall.flatten()) and np.array_equal(by_name, Supports(mesh, wall).fixed)
    assert np.array_equal(by_name, Supports(mesh, [(wall, "xyz"[: mesh.d])]).fixed)
    assert np.array_equal(by_name, Supports(mesh, {lambda x: x[0] == 0: "xyz"[: mesh.d]}).fixed)
    assert np.array_equal(
        np.sort(dofs_at(mesh, {"wall": wall, "tip": basis.get_dofs("tip")})), basis.get_dofs({"wall", "tip"}).all()
    )
    one = wall.keep([row for row in basis.elem.dofnames if row.endswith("^1")]) if mesh.d > 1 else wall
    assert np.array_equal(Supports(mesh, one).fixed, Supports(mesh, {"wall": "x"}).fixed)
    on_element = basis.get_dofs(elements=[1])
    assert np.array_equal(Supports(mesh, on_element).fixed, np.sort(basis.element_dofs[:, 1]))
    assert np.array_equal(np.sort(vertices_at(mesh, on_element)), np.sort(mesh.t[:, 1]))
    assert describe(wall) == describe(np.unique(wall.flatten() // mesh.d))
    assert np.array_equal(np.sort(facets_at(mesh, wall), axis=0), np.sort(facets_at(mesh, "wall"), axis=0))
    if mesh.element.degree == 2 and mesh.k > 1:
        assert len(by_name) > mesh.d * (mesh.p[0, : basis.mesh.nvertices] == 0).sum()


@pytest.mark.parametrize("name", [name for name in CURVED if scikit_fem_of(CURVED[name])])
def test_degrees_of_freedom_of_a_curved_mesh_are_ours(name):
    basis = scikit_fem_of(CURVED[name])
    view = basis.get_dofs(elements=[0, 2])
    assert np.array_equal(Supports(CURVED[name], view).fixed, view.flatten())


@pytest.mark.parametrize("name", ["quadratic tetrahedra", "quadratic triangles", "quadratic segments"])
def test_degrees_of_freedom_of_linear_vectors_are_refused_on_quadratic_elements_and_the_reverse(name):
    basis = straight(name)
    linear = {3: skfem.ElementTetP1, 2: skfem.ElementTriP1, 1: skfem.ElementLineP1}[basis.mesh.dim()]()
    other = skfem.Basis(basis.mesh, skfem.ElementVector(linear)).get_dofs("wall")
    own = type(basis.elem.elem).__name__
    with pytest.raises(RegionError, match=rf"expected those of quadratic vectors with . components, such as ElementVector\({own}"):
        Supports(ours(basis), other)
    with pytest.raises(RegionError, match=r"expected those of linear vectors with . components"):
        Supports(ElementMesh.of(basis.mesh), basis.get_dofs("wall"))
    finer = skfem.Basis(basis.mesh.refined(1), basis.elem).get_dofs(elements=[0])
    with pytest.raises(
        RegionError, match=rf"of another mesh, with {finer.obj.topo.nvertices} vertices .* has {basis.mesh.nvertices} v"
    ):
        Supports(ours(basis), finer)


def test_prescribed_values_follow_the_nodes_of_a_location_including_edge_nodes():
    basis = straight("quadratic tetrahedra")
    mesh, tip = ours(basis), basis.get_dofs("tip")
    move = lambda x, t: (t * x[1], 0 * x[1], t * x[2] ** 2)  # noqa: E731
    for where in ("tip", tip):
        supports = Supports(mesh, {"wall": "xyz"}, [(where, move)])
        u = np.zeros(mesh.p.size)
        u[supports.held] = supports.values(0.5)
        there = np.flatnonzero(mesh.p[0] == 1)
        assert len(supports.prescribed) == 3 * len(there) == len(tip.flatten())
        assert np.allclose(u.reshape(-1, 3)[there], np.transpose(move(mesh.p[:, there], 0.5)), atol=0)


def test_messages_call_them_nodes():
    mesh = ours(straight("quadratic triangles"))
    with pytest.raises(RegionError, match=f"none of the {mesh.nv} nodes satisfies"):
        Supports(mesh, {lambda x: x[0] > 7: "x"})
    with pytest.raises(RegionError, match=rf"name 1 node \({mesh.nv}\) outside"):
        Supports(mesh, [([mesh.nv], "x")])
    flat = ElementMesh(mesh.p, mesh.t, boundaries={"wall": np.array([[0], [1]])}, element=mesh.element)
    with pytest.raises(RegionError, match=r"has shape \(2, 1\).*expected \(3, n\), n > 0: the nodes of facets"):
        Supports(flat, {"wall": "x"})
