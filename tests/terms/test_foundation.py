"""The energy of an elastic foundation is the integral of k u^2/2 over the surface; forces and stiffness are its derivatives."""

import numpy as np
import pytest
from bodies import MESHES, sheet, state
from forces import integral

from skfem_stvk import ElementMesh, RegionError, StVK
from skfem_stvk.edges import TENSILE
from skfem_stvk.errors import LoadError
from skfem_stvk.mesh.points import sizes_of
from skfem_stvk.system.pattern import Pattern
from skfem_stvk.terms import Body, ElasticFoundation

K_XYZ = np.array([2.0, 0.0, 5.0])
CASES = {(name, part): (mesh, part) for name, mesh in MESHES.items() for part in ("all", "part")}


def where(part):
    return (lambda x: x[0] > -9) if part == "all" else (lambda x: x[0] < 0.4)


def bound(mesh, part="all", stiffness=None, dtype=np.float64):
    section = {1: {"area": 0.3}, 2: {"thickness": 0.3}}.get(mesh.k, {})
    body = Body(mesh, [StVK(young=1.0, poisson=0.3, **section)])
    k = [2.0] if mesh.d == 1 else K_XYZ[: mesh.d]
    return ElasticFoundation(where(part), k if stiffness is None else stiffness).bind(body, dtype)


def dense(term, mesh, u, add=False, others=()):
    pattern = Pattern(mesh.nv, mesh.d, [term.nodes_paired, *others])
    K = pattern.matrix(np.full(pattern.nnz, 0.0 if add else np.nan))
    force = np.zeros(u.shape)
    paired = term.with_blocks(mesh.nv, mesh.d, np.float64)
    linearized = paired.fill(u, paired.rows(pattern), K.data, add, force)
    return np.nan_to_num(K.toarray()), force, linearized


@pytest.mark.few
@pytest.mark.parametrize("case", CASES)
def test_the_energy_of_a_linear_field_is_that_of_quadrature(case):
    mesh, part = CASES[case]
    A = np.random.default_rng(1).standard_normal((mesh.d, mesh.d))
    facets = mesh.surface[:, where(part)(mesh.p)[mesh.surface].all(axis=0)]
    areas = sizes_of(mesh.p, facets, mesh.facet) * (0.3 if mesh.k < 3 else 1)
    k = [2.0] if mesh.d == 1 else K_XYZ[: mesh.d]
    expected = integral(mesh.p, facets, areas, lambda x: (np.array(k)[:, None] * (A @ x) ** 2).sum(axis=0)[None])[0] / 2
    assert bound(mesh, part).energy_and_force((A @ mesh.p).T) == pytest.approx(expected, rel=1e-12)


@pytest.mark.few
@pytest.mark.parametrize("case", CASES)
def test_force_and_stiffness_are_derivatives_of_the_energy(case):
    mesh, part = CASES[case]
    term = bound(mesh, part)
    u, v = (state(mesh, seed=seed).reshape(-1, mesh.d) for seed in (1, 2))
    K, force, linearized = dense(term, mesh, u)
    W = {s: term.energy_and_force(u + s * v) for s in (-1, 0, 1)}
    assert linearized.energy == W[0]
    assert np.vdot(force, v) == pytest.approx((W[1] - W[-1]) / 2, abs=1e-13 * W[0])
    assert v.ravel() @ K @ v.ravel() == pytest.approx(W[1] - 2 * W[0] + W[-1], rel=1e-11)
    assert force.ravel() == pytest.approx(K @ u.ravel(), abs=1e-14 * np.abs(force).max())
    assert np.array_equal(K, K.T) and np.linalg.eigvalsh(K).min() > -1e-14
    again = np.zeros_like(force)
    assert term.energy_and_force(u, again) == W[0] and np.array_equal(again, force)


@pytest.mark.few
@pytest.mark.parametrize("case", CASES)
def test_products_diagonals_lines_and_round_off_agree_with_the_matrix(case):
    mesh, part = CASES[case]
    term = bound(mesh, part)
    u, v = (state(mesh, seed=seed).reshape(-1, mesh.d) for seed in (1, 2))
    K = dense(term, mesh, u)[0]
    paired = term.with_blocks(mesh.nv, mesh.d, np.float64)
    energy, blocks = paired.blocks(u, np.zeros(u.shape), kept=TENSILE)
    out, diagonal, size = np.zeros(u.shape), np.zeros((mesh.nv, mesh.d, mesh.d)), np.zeros(u.shape)
    paired.pairs.add_product(blocks, v, out)
    paired.pairs.add_diagonal(blocks, diagonal)
    term.add_round_off(u, size)
    assert energy == term.energy_and_force(u)
    assert out.ravel() == pytest.approx(K @ v.ravel(), abs=1e-14 * np.abs(K).max())
    assert diagonal == pytest.approx(np.stack([K[mesh.d * a :, mesh.d * a :][: mesh.d, : mesh.d] for a in range(mesh.nv)]))
    assert size.ravel() == pytest.approx(np.abs(K) @ np.abs(u.ravel()))
    c = term.along(u, v)
    assert c.shape == (5,) and not c[3:].any()
    for s in (-1.5, 0.0, 0.7):
        assert np.polyval(c[::-1], s) == pytest.approx(term.energy_and_force(u + s * v), rel=1e-12)


@pytest.mark.parametrize("name", MESHES)
def test_fill_adds_to_earlier_values_on_a_larger_pattern(name):
    mesh = MESHES[name]
    term, u = bound(mesh, "part"), state(mesh).reshape(-1, mesh.d)
    others = [StVK(young=1.0, poisson=0.3).bind(mesh).nodes_paired]
    pattern = Pattern(mesh.nv, mesh.d, [term.nodes_paired, *others])
    data = np.ones(pattern.nnz)
    paired = term.with_blocks(mesh.nv, mesh.d, np.float64)
    paired.fill(u, paired.rows(pattern), data, add=True)
    assert pattern.matrix(data - 1).toarray() == pytest.approx(dense(term, mesh, u)[0], abs=1e-14)


def test_grounded_lists_the_degrees_of_freedom_tied_to_the_ground():
    mesh = MESHES["tetrahedra"]
    vertices = np.unique(mesh.surface[:, (mesh.p[0] < 0.4)[mesh.surface].all(axis=0)])
    assert np.array_equal(bound(mesh, "part").grounded, np.sort(np.concatenate([3 * vertices, 3 * vertices + 2])))


def test_single_precision_gives_single_precision():
    mesh = MESHES["tetrahedra"]
    term, u = bound(mesh, dtype=np.float32), state(mesh).reshape(-1, 3)
    force, out = np.zeros((2, mesh.nv, 3), dtype=np.float32)
    term.energy_and_force(u, force)
    paired = term.with_blocks(mesh.nv, mesh.d, np.float32)
    blocks = paired.blocks(u)[1]
    paired.pairs.add_product(blocks, u.astype(np.float32), out)
    exact = np.zeros(u.shape)
    bound(mesh).energy_and_force(u, exact)
    assert blocks.dtype == np.float32
    assert force == pytest.approx(exact, abs=1e-6 * np.abs(exact).max()) and out == pytest.approx(exact, abs=1e-6)


def test_a_number_is_the_stiffness_of_all_components():
    mesh = sheet()
    u = state(mesh).reshape(-1, 2)
    assert bound(mesh, stiffness=3.0).energy_and_force(u) == bound(mesh, stiffness=(3, 3)).energy_and_force(u)


@pytest.mark.parametrize("stiffness", [-1.0, (1, np.nan, 1), 0, (0, 0, 0), "stiff", [[1, 2]], (1, 2, -3)])
def test_an_invalid_stiffness_is_refused(stiffness):
    with pytest.raises(LoadError, match=r"ElasticFoundation: stiffness is .*; expected"):
        ElasticFoundation("floor", stiffness)


def test_a_stiffness_of_other_components_and_a_location_without_facets_are_refused():
    mesh = MESHES["tetrahedra"]
    with pytest.raises(LoadError, match=r"stiffness has shape \(2,\); expected a number, or 3 components"):
        bound(mesh, stiffness=(1, 2))
    with pytest.raises(
        RegionError, match="ElasticFoundation on 'floor': the mesh has no boundary or node set 'floor'; known: none"
    ):
        ElasticFoundation("floor", 1.0).bind(ElementMesh(mesh.p, mesh.t))
