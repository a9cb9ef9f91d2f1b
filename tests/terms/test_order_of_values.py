"""Values at vertices follow the given order of the ids. Vertices chosen by name, mask or predicate are in ascending order."""

import numpy as np
import pytest
from bodies import MESHES, box, sheet, state

from skfem_stvk import ElementMesh, LoadError, NodalLoad, Pressure, RegionError, StVK, System, Traction
from skfem_stvk.errors import SupportError
from skfem_stvk.system.supports import Supports
from skfem_stvk.terms.loads.load import Value

MESH = box()
FEW = [9, 5, 60, 20]
VALUES = np.array([[1.0, 2, 3, 4], [-1, 5, 0, 2], [7, 8, 9, -3]])
ELASTIC = StVK(young=2.0, poisson=0.3)


def external(mesh, *terms, at=None):
    system = System(mesh, [ELASTIC, *terms])
    u = np.zeros(system.ndofs) if at is None else at
    return system.external_force(u).reshape(-1, mesh.d)


def facet_ids(mesh):
    """Return the vertices of two boundary facets in random order; the facets may share an edge, a vertex or none."""
    there = np.unique(mesh.surface[:, :2])
    return np.random.default_rng(4).permutation(there)


def test_forces_on_vertices_follow_the_ids_as_given():
    f = external(MESH, NodalLoad(FEW, VALUES))
    assert np.array_equal(f[FEW], VALUES.T) and np.count_nonzero(f) == np.count_nonzero(VALUES)
    assert np.array_equal(external(MESH, NodalLoad(FEW, tuple(VALUES))), f)
    assert np.array_equal(external(MESH, NodalLoad(FEW, lambda x, t: t * VALUES)), f)


def test_forces_on_all_vertices_follow_the_ids_as_given():
    order = np.random.default_rng(3).permutation(MESH.nv)
    values = np.random.default_rng(5).standard_normal((3, MESH.nv))
    f = external(MESH, NodalLoad(order, values))
    assert np.array_equal(f[order], values.T)
    u = state(MESH)
    system = System(MESH, [ELASTIC, NodalLoad(order, values)])
    assert system.potential(u) - system.energy(u) == pytest.approx(-(f * u.reshape(-1, 3)).sum())


def test_names_masks_and_predicates_are_ascending():
    ids = np.sort(FEW)
    mesh, mask = ElementMesh(MESH.p, MESH.t, node_sets={"few": FEW}), np.zeros(MESH.nv, dtype=bool)
    mask[FEW] = True
    for where in ("few", mask, lambda x: mask):
        assert np.array_equal(external(mesh, NodalLoad(where, VALUES))[ids], VALUES.T)


def test_prescribed_values_follow_the_ids_as_given():
    mesh = ElementMesh(MESH.p, MESH.t)
    for given in ({"x": VALUES[0], "z": lambda x, t: 10 * t * x[2]}, lambda x, t: t * np.stack([VALUES[0], 0 * x[1], 10 * x[2]])):
        supports = Supports(mesh, None, [(FEW, given)])
        u = np.full((mesh.nv, 3), np.nan)
        u.reshape(-1)[supports.held] = supports.values(1.0)
        assert np.array_equal(u[FEW, 0], VALUES[0]) and np.array_equal(u[FEW, 2], 10 * mesh.p[2, FEW])


def test_functions_of_x_get_the_coordinates_in_the_order_of_the_ids():
    seen = []
    external(MESH, NodalLoad(FEW, lambda x, t: seen.append(x) or x))
    assert np.array_equal(seen[0], MESH.p[:, FEW])


@pytest.mark.parametrize("name", MESHES)
def test_values_on_facets_follow_the_ids_as_given(name):
    """Values by vertex have the same forces as a function of location, which does not depend on any order."""
    mesh = MESHES[name]
    ids, d = facet_ids(mesh), mesh.d
    values = np.random.default_rng(6).standard_normal((d, mesh.nv))
    by_function = external(
        mesh, Traction(ids, lambda x, t: values[:, [np.abs(mesh.p.T - point).sum(axis=1).argmin() for point in x.T]])
    )
    f = external(mesh, Traction(ids, tuple(values[:, ids])))
    assert np.abs(f - by_function).max() < 1e-14 and np.abs(f).max() > 0.01
    assert np.array_equal(external(mesh, Traction(ids[::-1], tuple(values[:, ids[::-1]]))).round(14), f.round(14))


@pytest.mark.parametrize("mesh", [box(), sheet()], ids=["tetrahedra", "triangles"])
def test_pressures_at_vertices_follow_the_ids_as_given(mesh):
    ids, u = facet_ids(mesh), 0.3 * state(mesh)
    p = np.random.default_rng(6).uniform(1, 3, mesh.nv)
    sorted_ids = np.sort(ids)
    one, other = (System(mesh, [ELASTIC, Pressure(where, p[where])]) for where in (ids, sorted_ids))
    assert one.external_force(u) == pytest.approx(other.external_force(u), abs=1e-14)
    assert abs(one.jacobian(u) - other.jacobian(u)).max() < 1e-13 and np.abs(one.external_force(u)).max() > 0.01


def test_values_of_ids_without_facets_are_refused():
    facet = MESH.surface[:, 0]
    inner = np.setdiff1d(np.arange(MESH.nv), MESH.surface)[0]
    ids = [facet[2], inner, facet[0], facet[1]]
    external(MESH, Traction(ids, (1, 2, 3)))
    with pytest.raises(
        LoadError, match=r"Traction on 4 vertices .* has shape \(3, 4\); expected .*\(3, 3\), one column for each of the 3"
    ):
        external(MESH, Traction(ids, VALUES))


@pytest.mark.parametrize(
    "specification", [lambda ids: NodalLoad(ids, (1, 2, 3)), lambda ids: Traction(ids, (1, 2, 3)), lambda ids: Pressure(ids, 1.0)]
)
def test_duplicates_are_refused(specification):
    ids = [*MESH.surface[:, 0], MESH.surface[1, 0]]
    with pytest.raises(RegionError, match=rf"the vertices name 1 vertex \({ids[-1]}\) more than once"):
        external(MESH, specification(ids))
    with pytest.raises(RegionError, match="more than once"):
        Supports(MESH, [([5, 9, 5], "x")])
    with pytest.raises(RegionError, match="more than once"):
        Supports(MESH, None, [([5, 9, 5], {"x": [1, 2, 3]})])


def test_rows_for_vertices_are_refused_with_a_remedy():
    for error, ask in (
        (LoadError, lambda: external(MESH, NodalLoad(FEW, VALUES.T))),
        (LoadError, lambda: external(MESH, NodalLoad(FEW, VALUES.T.tolist()))),
        (LoadError, lambda: external(MESH, NodalLoad(FEW, lambda t: VALUES.T))),
        (SupportError, lambda: Supports(MESH, None, [(FEW, lambda x, t: x.T)])),
    ):
        with pytest.raises(error, match=r"has shape \(4, 3\); expected 3 components .*\. Transpose it: values\.T\."):
            ask()


SQUARE = np.arange(9.0).reshape(3, 3)


def test_as_many_vertices_as_components_need_a_tuple():
    for given in (SQUARE, SQUARE.astype(int), lambda t: SQUARE):
        with pytest.raises(
            LoadError, match=r"3 components and 3 vertices: rows may be either\. Give a tuple of 3 components: tuple\(values\)"
        ):
            external(MESH, NodalLoad([9, 5, 60], given))
    for given in (tuple(SQUARE), SQUARE.tolist(), lambda t: tuple(SQUARE), lambda x, t: SQUARE):
        assert np.array_equal(external(MESH, NodalLoad([9, 5, 60], given))[[9, 5, 60]], SQUARE.T)


def test_one_vertex_and_one_dimension_are_not_ambiguous():
    assert Value(np.ones((1, 1)), (1,), np.zeros((1, 1)), "It").at(1.0).tolist() == [[1.0]]
    assert Value(np.array([[3.0], [4.0]]), (2,), np.zeros((2, 1)), "It").at(1.0).tolist() == [[3.0], [4.0]]
    assert Value(np.array([3.0, 4.0]), (2,), np.zeros((2, 2)), "It").at(1.0).tolist() == [[3.0], [4.0]]
    with pytest.raises(LoadError, match="Transpose it"):
        Value(np.array([[3.0, 4.0]]), (2,), np.zeros((2, 1)), "It")


@pytest.mark.parametrize(
    "given", [[[1, 2], [3]], np.ma.masked_equal([1.0, 2.0], 2.0), ([1, 2, 3], "abc"), [np.ma.masked_equal([1, 2, 3], 2), 4]]
)
def test_ragged_and_masked_values_are_refused(given):
    with pytest.raises(LoadError, match="expected 2 components"):
        Value(given, (2,), np.zeros((2, 3)), "It")
