"""Masses of elements with several points, including curved ones, equal scikit-fem's matrix.

Lumped masses are those of Hinton, Rock and Zienkiewicz.
"""

import numpy as np
import pytest
import skfem
from bodies import CURVED, STRAIGHT, scikit_fem_of, values_at
from skfem.helpers import dot

from skfem_stvk import StVK
from skfem_stvk.mesh.element import ELEMENTS
from skfem_stvk.mesh.points import rule_of
from skfem_stvk.system.mass import ConsistentMass, LumpedMass, bounds_of_elements
from skfem_stvk.terms import Body
from skfem_stvk.terms.loads.spread import Spread, lumped_shares, sizes_at_points

RNG = np.random.default_rng(0)
SECTION = {1: "area", 2: "thickness"}
SHARES = {
    "quadratic tetrahedra": [1 / 36] * 4 + [4 / 27] * 6,
    "quadratic triangles": [1 / 19] * 3 + [16 / 57] * 3,
    "quadratic segments": [1 / 6] * 2 + [2 / 3],
    "quadrilaterals": [1 / 4] * 4,
    "hexahedra": [1 / 8] * 8,
}


def body(mesh):
    """Return a body whose section and density vary from element to element."""
    section = {SECTION[mesh.k]: RNG.uniform(0.5, 2, mesh.nt)} if mesh.k < 3 else {}
    return Body(mesh, [StVK(young=2.0, poisson=0.3, density=RNG.uniform(1, 3, mesh.nt), **section)])


BODIES = {name: body(mesh) for name, mesh in CURVED.items()}


def consistent(body, held=()):
    return ConsistentMass(None, body, np.array(held, dtype=int))


def scalar(mass, nv, d):
    """Return the matrix of one component (nv, nv), column by column."""
    columns = [mass.multiply(np.repeat(row, d)).reshape(nv, d) for row in np.eye(nv)]
    assert all(np.ptp(column, axis=1).max() == 0 for column in columns)
    return np.array(columns)[:, :, 0]


@pytest.mark.parametrize("name", [name for name, mesh in CURVED.items() if scikit_fem_of(mesh)])
def test_the_consistent_matrix_is_scikit_fems(name):
    """The consistent matrix is scikit-fem's by the same rule, which is exact except for curved quadratic elements."""
    of, basis = BODIES[name], scikit_fem_of(CURVED[name])
    points, weights = rule_of(CURVED[name].element, "mass")
    basis = skfem.Basis(basis.mesh, basis.elem, quadrature=(points.T, weights))
    heavy = (of.mass / of.sizes)[:, None]
    M = skfem.BilinearForm(lambda u, v, w: heavy * dot(u, v)).assemble(basis)
    v, mass = RNG.standard_normal(of.mesh.p.size), consistent(of)
    exact = M @ v
    assert np.abs(mass.multiply(v) - exact).max() < 2e-14 * np.abs(exact).max()


@pytest.mark.parametrize("name", [name for name in STRAIGHT if name != "quadratic segments"])
def test_the_consistent_matrix_of_straight_elements_is_scikit_fems_to_round_off(name):
    of, basis = body(STRAIGHT[name]), scikit_fem_of(STRAIGHT[name])
    heavy = (of.mass / of.sizes)[:, None]
    v = RNG.standard_normal(of.mesh.p.size)
    exact = skfem.BilinearForm(lambda u, v, w: heavy * dot(u, v)).assemble(basis) @ v
    assert np.abs(consistent(of).multiply(v) - exact).max() < 1e-14 * np.abs(exact).max()


@pytest.mark.parametrize("name", CURVED)
def test_the_total_is_density_times_volume_and_consistent_masses_have_their_centre(name):
    of, mesh = BODIES[name], CURVED[name]
    total, basis = of.mass.sum(), scikit_fem_of(mesh)
    if basis:
        assert total == pytest.approx((of.mass / of.sizes) @ basis.dx.sum(axis=1), rel=1e-14)
    lumped, mass = LumpedMass(None, of, np.array([], dtype=int)), consistent(of)
    ones = np.tile(np.arange(1.0, mesh.d + 1), mesh.nv)
    for one in (lumped, mass):
        assert one.total == pytest.approx(total, rel=1e-14)
        assert one.multiply(ones).reshape(-1, mesh.d).sum(axis=0) == pytest.approx(total * np.arange(1.0, mesh.d + 1), rel=1e-13)
    weights = (of.mass / of.sizes) * sizes_at_points(mesh.p, mesh.t, mesh.element)
    x = values_at(mesh.p, mesh.t, mesh.element, rule_points(mesh))
    centre = np.einsum("tqd,qt->d", x, weights)
    assert mass.multiply(np.ones(mesh.p.size)) @ mesh.p.T.ravel() == pytest.approx(centre.sum(), rel=1e-13)
    if not mesh.element.is_simplex:
        assert lumped.vertex @ mesh.p.T == pytest.approx(centre, rel=1e-13)
    if basis:  # the centre is exact, for curved elements too
        exact = (of.mass / of.sizes) @ np.einsum("dtq,tq->td", np.array(basis.global_coordinates()), basis.dx)
        assert centre == pytest.approx(exact, rel=1e-13)


def rule_points(mesh):
    return rule_of(mesh.element, "mass").points


@pytest.mark.parametrize("name", SHARES)
def test_lumped_masses_of_straight_elements_are_those_of_textbooks(name):
    mesh = STRAIGHT[name]
    shares = lumped_shares(mesh.p, mesh.t, mesh.element)
    np.testing.assert_allclose(shares, np.array(SHARES[name])[:, None] + 0 * shares, rtol=1e-13)


@pytest.mark.parametrize("name", CURVED)
def test_lumped_masses_are_positive_and_the_scaled_diagonal_of_quadratic_elements(name):
    mesh = CURVED[name]
    shares = lumped_shares(mesh.p, mesh.t, mesh.element)
    assert shares.min() > 0.01 and np.abs(shares.sum(axis=0) - 1).max() < 1e-14
    matrices = Spread(mesh, mesh.element, mesh.t, np.ones(mesh.nt)).matrices()
    diagonal, rows = np.einsum("aan->an", matrices), matrices.sum(axis=1)
    wanted = rows if not mesh.element.is_simplex else diagonal / diagonal.sum(axis=0)
    np.testing.assert_allclose(shares, wanted, rtol=1e-13)
    if mesh.element.degree == 2 and mesh.k > 1:
        assert rows.min() < 0.02  # row sums cannot be masses: those of corners are about 0 in the plane and -1/20 in space


@pytest.mark.parametrize("name", CURVED)
def test_solve_inverts_multiply_with_constrained_degrees_of_freedom_at_rest(name):
    mesh, of = CURVED[name], BODIES[name]
    held = np.concatenate([np.arange(mesh.d), [mesh.p.size - 1]])
    free = np.setdiff1d(np.arange(mesh.p.size), held)
    for kept in ((), held):
        mass, f = consistent(of, kept), RNG.standard_normal(mesh.p.size)
        inner = free if len(kept) else np.arange(mesh.p.size)
        M = np.kron(scalar(mass, mesh.nv, mesh.d), np.eye(mesh.d))
        a = mass.solve(f)
        exact = np.linalg.solve(M[np.ix_(inner, inner)], f[inner])
        assert np.array_equal(M, M.T) and np.linalg.eigvalsh(M).min() > 0
        assert np.abs(a[inner] - exact).max() < 1e-13 * np.abs(exact).max() and not a[np.array(kept, dtype=int)].any()


@pytest.mark.few
@pytest.mark.parametrize("amount", [0.0, 0.02, 0.1, 0.25])
@pytest.mark.parametrize("name", [name for name in CURVED if name not in ("quadratic membrane", "quadrilateral membrane")])
def test_bounds_contain_all_eigenvalues_of_elements_and_are_near_them(name, amount):
    """Bounds contain all eigenvalues and are within 10 % of them, also for strongly curved elements.

    There, Jacobians differ by a factor of 20 and more between the points.
    """
    element, rng = ELEMENTS[CURVED[name].element.name], np.random.default_rng(3)
    d, n = CURVED[name].d, 60
    x = np.zeros((d, element.n, n))
    x[: element.k] = element.nodes.T[:, :, None]
    x += amount * rng.uniform(-1, 1, x.shape)
    p, t = x.transpose(0, 2, 1).reshape(d, -1), np.arange(n * element.n).reshape(n, element.n).T
    sizes = sizes_at_points(p, t, element)
    low, high = bounds_of_elements(p, t, element)
    N = element.values(rule_points(CURVED[name]))
    M = np.einsum("qa,qb,qn->nab", N, N, sizes)
    scale = 1 / np.sqrt(np.einsum("naa->na", M))
    values = np.linalg.eigvalsh(M * scale[:, :, None] * scale[:, None])
    assert low <= values.min() and values.max() <= high
    assert low > 0.9 * values.min() and high < 1.1 * values.max()
    if amount == 0.25:  # bounds of straight elements would not contain the eigenvalues
        straight = bounds_of_elements(*[np.ascontiguousarray(element.nodes.T), np.arange(element.n)[:, None]], element)
        assert sizes.min() > 0 and (values.min() < 0.98 * straight[0] or values.max() > 1.02 * straight[1])
