"""Tables of elements agree with scikit-fem's."""

import copy
import pickle

import meshio
import numpy as np
import pytest
import skfem

from skfem_stvk.errors import StvkError
from skfem_stvk.mesh import ElementMesh
from skfem_stvk.mesh.element import ELEMENTS
from skfem_stvk.mesh.groups import as_cells
from skfem_stvk.mesh.points import KINDS, rule_of

SKFEM = {
    "segments": skfem.ElementLineP1(),
    "triangles": skfem.ElementTriP1(),
    "tetrahedra": skfem.ElementTetP1(),
    "quadratic segments": skfem.ElementLineP2(),
    "quadratic triangles": skfem.ElementTriP2(),
    "quadratic tetrahedra": skfem.ElementTetP2(),
    "quadrilaterals": skfem.ElementQuad1(),
    "hexahedra": skfem.ElementHex1(),
}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", ELEMENTS)
def test_shape_functions_are_those_of_scikit_fem(name, kind):
    element, rule = ELEMENTS[name], rule_of(ELEMENTS[name], kind)
    N, dN = element.values(rule.points), element.derivatives(rule.points)
    for a in range(element.n):
        value, gradient = SKFEM[name].lbasis(rule.points.T, a)
        np.testing.assert_allclose(N[:, a], value, atol=2e-15)
        np.testing.assert_allclose(dN[:, a].T, gradient, atol=2e-15)
    np.testing.assert_allclose(element.values(element.nodes), np.eye(element.n), atol=1e-15)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", ELEMENTS)
def test_no_weight_is_negative(name, kind):
    rule = rule_of(ELEMENTS[name], kind)
    assert (rule.weights > 0).all()
    size = {1: 1, 2: 1 / 2, 3: 1 / 6}[ELEMENTS[name].k]
    assert rule.weights.sum() == pytest.approx(size if ELEMENTS[name].is_simplex else 1, rel=1e-14)


@pytest.mark.parametrize(("kind", "degree"), [("usual", 2), ("exact", 4), ("mass", 4)])
@pytest.mark.parametrize("name", [name for name, element in ELEMENTS.items() if not element.is_linear_simplex])
def test_rules_are_exact_for_their_polynomials(name, kind, degree):
    element, rule = ELEMENTS[name], rule_of(ELEMENTS[name], kind)
    fine = skfem.quadrature.get_quadrature(SKFEM[name].refdom, 8)
    powers = np.random.default_rng(0).integers(0, degree + 1, (40, element.k))
    for power in powers[powers.sum(axis=1) <= degree]:
        value = (rule.points**power).prod(axis=1) @ rule.weights
        assert value == pytest.approx((fine[0].T ** power).prod(axis=1) @ fine[1], rel=1e-13)


@pytest.mark.parametrize("name", [name for name, element in ELEMENTS.items() if element.k > 1])
def test_facets_have_the_nodes_of_their_element(name):
    element = ELEMENTS[name]
    facet = ELEMENTS[element.facet]
    xi = np.random.default_rng(0).random((5, facet.k)) / (facet.k + 1)
    for nodes in element.facets:
        assert len(nodes) == facet.n
        x = facet.values(xi) @ element.nodes[list(nodes)]
        others = np.delete(element.values(x), nodes, axis=1)  # functions of nodes that are not on the facet vanish there
        np.testing.assert_allclose(others, 0, atol=1e-15)
        np.testing.assert_allclose(element.values(x)[:, nodes], facet.values(xi), atol=1e-15)


@pytest.mark.parametrize("name", ELEMENTS)
def test_a_copy_or_a_pickle_is_the_row_of_the_table(name):
    element = ELEMENTS[name]
    assert len(element.nodes) == element.n and pickle.loads(pickle.dumps(element)) is copy.deepcopy(element) is element


@pytest.mark.parametrize("name", ELEMENTS)
def test_elements_of_the_same_name_in_other_packages_have_the_same_nodes(name):
    element = ELEMENTS[name]
    assert type(SKFEM[name]) is element.scikit_fem and np.array_equal(element.nodes, SKFEM[name].doflocs)
    assert element.mesh is None or element.mesh.elem is element.scikit_fem
    p = np.concatenate([element.nodes, np.zeros((element.n, 3 - element.k))], axis=1)
    cell, ids = as_cells(np.arange(element.n)[:, None], element)
    assert meshio.CellBlock(cell, ids).dim == element.k
    assert ElementMesh.of(meshio.Mesh(p, [(cell, ids)])).element is element


@pytest.mark.parametrize("name", ELEMENTS)
def test_reversed_nodes_give_the_opposite_orientation(name):
    element, xi = ELEMENTS[name], rule_of(ELEMENTS[name], "usual").points
    jacobian = np.einsum("qai,aj->qij", element.derivatives(xi), element.nodes[element.reversed])
    assert np.linalg.det(jacobian) == pytest.approx(-1, abs=1e-14)
    assert element.reversed[:2] == [1, 0] and sorted(element.reversed) == list(range(element.n))


def test_an_unknown_rule_is_refused():
    with pytest.raises(StvkError, match="usual, exact"):
        rule_of(ELEMENTS["triangles"], "best")
