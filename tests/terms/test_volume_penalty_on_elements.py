"""The volume penalty on elements with several points: scikit-fem's forms by the same rule, its barrier, and its rounding."""

import numpy as np
import pytest
import skfem
from bodies import CURVED, STRAIGHT, box, scikit_fem_of, state
from kernels.parts import in_parts
from skfem.helpers import ddot, grad
from slow import slow

from skfem_stvk import StateError, StVK, System, VolumePenalty
from skfem_stvk.edges import Tensions
from skfem_stvk.edges.elements import Quadrature
from skfem_stvk.edges.pairs import ALL
from skfem_stvk.mesh.points import base_vectors_at, determinants, rule_of
from skfem_stvk.system.pattern import Pattern
from skfem_stvk.terms import Body
from skfem_stvk.terms.laws.volume_penalty import ENERGIES

EVERY = {f"{name}, curved": mesh for name, mesh in CURVED.items()} | {f"{name}, straight": mesh for name, mesh in STRAIGHT.items()}
SOLID = [name for name, mesh in EVERY.items() if mesh.k == mesh.d]
KNOWN = [name for name in SOLID if scikit_fem_of(EVERY[name])]
SECTION = {1: {"area": 0.3}, 2: {"thickness": 0.3}, 3: {}}


def bound(mesh, kind, rule="usual", dtype=np.float64):
    body = Body(mesh, [StVK(young=1.0, poisson=0.3, **SECTION[mesh.k])], Quadrature.of(mesh.element, rule))
    return VolumePenalty(np.random.default_rng(3).uniform(1, 4, mesh.nt), kind).bind(body, dtype)


def tangent(term, mesh, u, kept=ALL):
    pattern = Pattern(mesh.nv, mesh.d, [term.nodes_paired])
    data = np.zeros(pattern.nnz)
    term.fill(u, term.rows(pattern), data, False, kept=kept)
    return pattern.matrix(data)


def cofactor(F):
    """Return dJ/dF by components, for any number of points."""
    full = np.zeros((3, 3, *F.shape[2:])) + np.eye(3)[:, :, None, None]
    full[: len(F), : len(F)] = F
    rows = [np.cross(full[(i + 1) % 3], full[(i + 2) % 3], axis=0) for i in range(3)]
    return np.array(rows)[: len(F), : len(F)]


def by_scikit_fem(mesh, kind, u, rule):
    """Return W, F and K from densities of `psi(det F)` at the points of our rule, by scikit-fem.

    The second derivative of det F is a difference of cofactors, which is exact because cofactors are quadratic.
    """
    basis, (points, weights) = scikit_fem_of(mesh), rule_of(mesh.element, rule)
    basis = skfem.Basis(basis.mesh, basis.elem, quadrature=(points.T, weights))
    k = np.random.default_rng(3).uniform(1, 4, mesh.nt)[:, None] * (0.3 if mesh.k < 3 else 1.0)
    now = grad(basis.interpolate(u.ravel())) + np.eye(mesh.d)[:, :, None, None]
    cof = cofactor(now)
    e, energy = np.sum(now[0] * cof[0], axis=0) - 1, ENERGIES[kind]
    psi, slope, curvature = (k * part(e) for part in (energy.density, energy.slope, energy.curvature))

    def bilinear(v, w, _):
        change = (cofactor(now + grad(v)) - cofactor(now - grad(v))) / 2
        return curvature * ddot(cof, grad(v)) * ddot(cof, grad(w)) + slope * ddot(change, grad(w))

    W = float((psi * basis.dx).sum())
    F = skfem.LinearForm(lambda w, _: slope * ddot(cof, grad(w))).assemble(basis)
    return W, F, skfem.BilinearForm(bilinear).assemble(basis)


@pytest.mark.few
@pytest.mark.parametrize(("kind", "rule"), [*((kind, "usual") for kind in ENERGIES), ("barrier", "exact")])
@pytest.mark.parametrize("name", KNOWN)
def test_energy_force_and_tangent_are_scikit_fems(name, kind, rule, monkeypatch):
    in_parts(monkeypatch, 2)
    mesh, term = EVERY[name], bound(EVERY[name], kind, rule)
    u = state(mesh, 0.1).reshape(-1, mesh.d) - 0.1 * mesh.p.T
    W, F, K = by_scikit_fem(mesh, kind, u, rule)
    found = np.zeros_like(u)
    assert term.energy_and_force(u, found) == pytest.approx(W, rel=1e-12)
    assert np.abs(found.ravel() - F).max() < 1e-12 * np.abs(F).max()
    assert abs(tangent(term, mesh, u) - K).max() < 1e-12 * abs(K).max()
    again, total = np.zeros_like(u), term.blocks(u, found * 0)[0]
    term.blocks(u, again)
    assert total == pytest.approx(W, rel=1e-12) and np.abs(again - found).max() < 1e-14 * np.abs(found).max()


@pytest.mark.few
@pytest.mark.parametrize("kind", ENERGIES)
@pytest.mark.parametrize("name", SOLID)
def test_a_homogeneous_state_has_the_energy_of_its_volume_and_no_force_within(name, kind):
    mesh, J = EVERY[name], 0.7
    G = np.linalg.qr(np.random.default_rng(1).standard_normal((mesh.d, mesh.d)))[0]
    G[0] *= J / np.linalg.det(G)
    u = mesh.p.T @ (G.T - np.eye(mesh.d))
    body = Body(mesh, [StVK(young=1.0, poisson=0.3)])
    term, force = VolumePenalty(2.0, kind).bind(body), np.zeros_like(u)
    W = term.energy_and_force(u, force)
    exact = name != "quadratic tetrahedra, curved"  # the four points do not integrate its volume exactly
    psi = float(ENERGIES[kind].density(np.array(J - 1)))
    assert pytest.approx(2 * psi * body.volumes.sum(), rel=1e-12 if exact else 2e-2) == W
    facets = np.concatenate([mesh.t[list(ids)] for ids in mesh.element.facets], axis=1)
    _, at, counts = np.unique(np.sort(facets, axis=0), axis=1, return_index=True, return_counts=True)
    inner = np.ones(mesh.nv, dtype=bool)
    inner[facets[:, at[counts == 1]]] = False
    assert inner.any() and np.abs(force[inner]).max() < (1e-12 if exact else 0.2) * np.abs(force).max()


@pytest.mark.parametrize("kind", ENERGIES)
@pytest.mark.parametrize("name", ["quadratic tetrahedra, curved", "quadrilaterals, curved", "hexahedra, curved"])
def test_without_pressure_the_tangent_is_positive_semi_definite(name, kind):
    mesh = EVERY[name]
    u = state(mesh, 0.1).reshape(-1, mesh.d) - 0.2 * mesh.p.T
    term = bound(mesh, kind)
    without = np.linalg.eigvalsh(tangent(term, mesh, u, Tensions(1.0, 0.0)).toarray())
    whole = np.linalg.eigvalsh(tangent(term, mesh, u).toarray())
    assert without[0] > -1e-13 * without[-1] and whole[0] < -1e-3 * whole[-1]


@pytest.mark.parametrize("name", ["quadratic tetrahedra, curved", "quadratic triangles, curved", "hexahedra, curved"])
def test_the_rounding_in_single_precision_is_within_its_bound(name):
    mesh = EVERY[name]
    u = np.float64(np.float32(state(mesh, 0.1).reshape(-1, mesh.d) - 0.1 * mesh.p.T))
    exact, found, sizes = np.zeros_like(u), np.zeros_like(u, dtype=np.float32), np.zeros_like(u)
    bound(mesh, "quadratic").energy_and_force(u, exact)
    bound(mesh, "quadratic", dtype=np.float32).energy_and_force(u, found)
    bound(mesh, "quadratic").add_round_off(u, sizes)
    eps = np.finfo(np.float32).eps
    assert (np.abs(found - exact) <= 2 * eps * sizes).all() and np.abs(found - exact).max() > 1e-3 * eps * sizes.max()


def point_ratios(mesh, u):
    xi = rule_of(mesh.element).points
    rest, now = (
        determinants(base_vectors_at(np.ascontiguousarray(x.T), mesh.t, mesh.element, xi)) for x in (mesh.p.T, mesh.p.T + u)
    )
    return (now / rest).min(axis=1)


@pytest.mark.parametrize("dtype", [np.float64, slow(np.float32)])
def test_the_barrier_names_elements_with_no_volume_at_a_point(dtype):
    """The barrier refuses elements whose volume ratio is not positive at an integration point, and names them.

    A ratio below zero at a node only is allowed by the barrier. `inside_out` lists the element, and a step ends before it.
    """
    mesh = box(2).with_degree(2)
    body = System(mesh, [StVK(young=1.0, poisson=0.3), VolumePenalty()], dtype=dtype)
    a, b, middle = *mesh.t[:2, 3], mesh.t[4, 3]
    u = np.zeros((mesh.nv, 3))
    u[middle] = 0.3 * (mesh.p[:, a] - mesh.p[:, b])
    assert len(body.inside_out(u.ravel())) > 1 and np.isfinite(body.energy(u.ravel())) and point_ratios(mesh, u).min() > 0
    assert body.step_limit(0 * u.ravel(), u.ravel()) == pytest.approx(0.25 / 0.3, rel=1e-6)
    u[middle] *= 4
    ids = np.flatnonzero(point_ratios(mesh, u) <= 0)
    assert 0 < len(ids) <= len(body.inside_out(u.ravel()))
    for call in (body.energy, body.internal_force, body.tangent, body.round_off):
        with pytest.raises(StateError, match=rf"^{len(ids)} elements? \({ids[0]}.* inverted or flat .* barrier"):
            call(u.ravel())
