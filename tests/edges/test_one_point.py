"""Boxes with one point, on meshes of unequal boxes: volumes, steps, penalties, stretches, work, and motions."""

import numpy as np
import pytest
import skfem
from bodies import boxes, state
from skfem.quadrature import get_quadrature
from skfem.refdom import RefHex, RefQuad
from slow import slow

from skfem_stvk import EnergyMomentum, Gravity, StVK, System, VolumePenalty, simulate, solve_static
from skfem_stvk.edges import NONE, TENSILE
from skfem_stvk.mesh.points import base_vectors_at
from skfem_stvk.terms.laws.volume_penalty import ENERGIES

TERM = StVK(young=2.0, poisson=0.3, density=1.5)
MESHES = {"hexahedra": boxes(3), "quadrilaterals": boxes(2, n=3)}
#: Weights and points of the derivative at zero, exact for polynomials of degree six.
SEVEN = [(w / 60, s) for w, s in zip((-1, 9, -45, 45, -9, 1), (-3, -2, -1, 1, 2, 3), strict=True)]


def body(mesh, *more, hourglass=0.3, **options):
    return System(mesh, [TERM, *more], quadrature="one-point", hourglass=hourglass, **options)


def mean_gradients(mesh):
    """Return mean gradients (nt, n, d) by a rule that is exact for cofactors, and volumes (nt,)."""
    xi, weights = get_quadrature(RefHex if mesh.k == 3 else RefQuad, 7)
    base_vectors = base_vectors_at(mesh.p, mesh.t, mesh.element, xi.T)
    volumes = np.abs(np.linalg.det(base_vectors)) * weights
    gradients = np.einsum("qai,tqdi,tq->tad", mesh.element.derivatives(xi.T), np.linalg.inv(base_vectors), volumes)
    return gradients / volumes.sum(axis=1)[:, None, None], volumes.sum(axis=1)


def deformation(mesh, u):
    """Return mean deformation gradients at `u` (nv, d), (nt, d, d)."""
    return np.eye(mesh.d) + np.einsum("tad,atc->tcd", mean_gradients(mesh)[0], u[mesh.t])


def ratios(mesh, u):
    """Return volume ratios of the mean deformation gradient, and at the nodes, (nt, 1 + n)."""
    rest, now = (
        base_vectors_at(np.ascontiguousarray(x.T), mesh.t, mesh.element, mesh.element.nodes) for x in (mesh.p.T, mesh.p.T + u)
    )
    return np.column_stack([np.linalg.det(deformation(mesh, u)), np.linalg.det(now) / np.linalg.det(rest)])


@pytest.mark.parametrize("name", MESHES)
def test_volumes_are_those_of_the_mean_gradient_and_at_the_nodes(name):
    mesh, bound = MESHES[name], body(MESHES[name]).bound_terms[0]
    u = state(mesh, 0.6).reshape(-1, mesh.d)
    J = ratios(mesh, u)
    assert bound.volume_ratios(u) == pytest.approx(J.min(axis=1), rel=1e-12, abs=1e-12)
    assert J.min() < 0 and list(body(mesh).inside_out(u.ravel())) == list(np.flatnonzero(J.min(axis=1) <= 0))
    assert bound.volume_ratios(0 * u) == pytest.approx(1, rel=1e-13)
    A = 0.4 * np.random.default_rng(0).standard_normal((mesh.d, mesh.d))  # this affine map has the mean gradient A
    assert bound.volume_ratios(mesh.p.T @ A.T) == pytest.approx(np.linalg.det(np.eye(mesh.d) + A), rel=1e-12)


@pytest.mark.parametrize("name", MESHES)
def test_the_step_limit_is_the_first_root_of_all_cubics(name):
    mesh = MESHES[name]
    bound, places = body(mesh).bound_terms[0], np.array([0.0, 1.0, -1.0, 2.0])
    for seed in range(3):
        u, v = (0.2 * state(mesh, seed=100 * seed + i).reshape(-1, mesh.d) for i in (1, 2))
        J, first = np.array([ratios(mesh, u + s * v).ravel() for s in places]), np.inf
        for c in np.linalg.solve(np.vander(places, increasing=True), J).T:
            roots = np.roots(c[::-1])
            if c[0] > 0:
                first = min(first, roots.real[(np.abs(roots.imag) < 1e-9 * np.abs(roots)) & (roots.real > 0)].min(initial=np.inf))
        assert np.isfinite(first) and bound.step_limit(u, v) == pytest.approx(first, rel=1e-8)


@pytest.mark.parametrize("name", MESHES)
def test_the_smallest_stretch_is_that_of_the_mean_gradient(name):
    mesh, bound = MESHES[name], body(MESHES[name]).bound_terms[0]
    u = state(mesh, 0.4).reshape(-1, mesh.d)
    least = np.linalg.svd(deformation(mesh, u), compute_uv=False)[:, -1]
    found = bound.smallest_stretches(u)
    assert found == pytest.approx(least, rel=1e-11) and bound.smallest_stretch(u) == found.min()


def test_derivatives_of_polynomials_of_degree_six_are_exact():
    c = np.random.default_rng(0).standard_normal(7)
    assert sum(w * np.polyval(c, s) for w, s in SEVEN) == pytest.approx(c[5], rel=1e-12)


@pytest.mark.parametrize("kind", ENERGIES)
@pytest.mark.parametrize("name", [slow("hexahedra"), "quadrilaterals"])
def test_a_volume_penalty_has_the_energy_of_the_mean_gradient(name, kind):
    """Its force and tangent agree with derivatives along a line.

    On a line J is a cubic, and `(J - 1)^2` has degree six; other penalties are smooth.
    """
    mesh, k = MESHES[name], 3.0
    with_penalty, without = body(mesh, VolumePenalty(k, kind)), body(mesh)
    step = 1.0 if kind == "quadratic" else 1e-3
    u = state(mesh, 0.1) - 0.2 * mesh.p.ravel("F")
    v = step * state(mesh, 0.1, seed=7)
    _, volumes = mean_gradients(mesh)

    def penalty(x):
        J = np.linalg.det(deformation(mesh, x.reshape(-1, mesh.d)))
        assert ((J < 1).all() and (J > 0.1).all()) or kind == "quadratic"
        return k * (ENERGIES[kind].density(J - 1) * volumes).sum()

    W, limit = with_penalty.energy(u) - without.energy(u), 1e-12 if kind == "quadratic" else 1e-10
    assert pytest.approx(penalty(u), rel=1e-11) == W and W > 1e-3
    force, K = (getattr(with_penalty, name)(u) - getattr(without, name)(u) for name in ("internal_force", "tangent"))
    slope = sum(w * penalty(u + s * v) for w, s in SEVEN)
    assert force @ v == pytest.approx(slope, rel=limit, abs=limit * W)
    both = sum(w * (with_penalty.internal_force(u + s * v) - without.internal_force(u + s * v)) for w, s in SEVEN)
    assert np.abs(K @ v - both).max() < limit * max(np.abs(both).max(), np.abs(force).max() * step)
    assert (
        np.abs(with_penalty.product(u, v) - with_penalty.tangent(u) @ v).max() < 1e-13 * np.abs(with_penalty.tangent(u) @ v).max()
    )


@pytest.mark.parametrize("name", MESHES)
def test_a_deformed_rotating_body_is_not_damped(name):
    """A rotation causes no damping, neither as a rate nor as one large step.

    Hourglass control acts like a tension, and K without tensions does not contain it.
    """
    mesh, bound = MESHES[name], body(MESHES[name]).bound_terms[0]
    u, v = state(mesh, 0.2).reshape(-1, mesh.d), state(mesh, 0.2, seed=2).reshape(-1, mesh.d)
    W, x, size = np.eye(mesh.d)[::-1] * np.sign(np.arange(mesh.d)[:, None] - 0.5), mesh.p.T + u, np.zeros_like(u)
    rotation = np.linalg.qr(W + np.eye(mesh.d))[0]
    rotation[0] *= np.linalg.det(rotation)
    assert bound.damping_force(u, v, size) > 1e-3
    for call in (bound.damping_force, lambda u, w, out: bound.mean_force(u, u + w, (-1.0, 1.0), 0.5, out)):
        force = np.zeros_like(u)
        spin = x @ (W - W.T) if call == bound.damping_force else x @ rotation.T - x
        assert call(u, spin, force) < 1e-26 and np.abs(force).max() < 1e-13 * np.abs(size).max()
    without, whole = (System.jacobian(body(mesh, hourglass=h), u.ravel(), kept=NONE) for h in (0.3, 0.0))
    assert abs(without - whole).max() < 1e-15 * abs(whole).max()
    assert (
        abs(body(mesh).jacobian(u.ravel(), kept=TENSILE) - body(mesh, hourglass=0.0).jacobian(u.ravel(), kept=TENSILE)).max() > 1e-3
    )


@pytest.mark.parametrize("name", MESHES)
def test_energy_and_momenta_of_a_tumbling_body_are_conserved(name):
    mesh = MESHES[name]
    system, x = body(mesh), mesh.p.T - mesh.p.mean(axis=1)
    spin = np.cross([3.0, -2, 5], x) if mesh.d == 3 else 5 * x[:, ::-1] * [-1, 1]
    v0 = 0.1 * (spin + x * [1.0, -0.5, 0.3][: mesh.d] + 0.2 * np.sin(9 * x)).ravel()
    ledger = simulate(system, EnergyMomentum(dt=0.1, rtol=1e-11), until=1.0, v0=v0, quiet=True).ledger
    assert ledger["strain_energy"].max() > 1e-3 * ledger["total_energy"][0]
    assert np.abs(ledger["closure_error"]).max() < 1e-10 * ledger["total_energy"][0]
    scale = np.abs(system.mass("lumped").multiply(v0)).sum()
    for momentum in (column for column in ledger.names if "_momentum" in column):
        assert np.ptp(ledger[momentum]) < 1e-10 * scale, momentum


@pytest.mark.parametrize(("name", "solver"), [("hexahedra", "amg-cg"), ("quadrilaterals", "block-jacobi-cg")])
def test_a_body_hangs_in_equilibrium(name, solver):
    mesh = MESHES[name]
    top = np.flatnonzero(mesh.p[0] < 0.05)
    system = body(mesh, Gravity([0.05, 0.02, 0.01][: mesh.d]), fixed=[(top, "xyz"[: mesh.d])])
    result = solve_static(system, solver=solver, quiet=True)
    weight = system.external_force(result.u).reshape(-1, mesh.d).sum(axis=0)
    assert result.status.success and np.abs(result.u).max() > 0.01
    assert result.reaction([*top]).resultant == pytest.approx(-weight, rel=1e-6)


@pytest.mark.parametrize("make", [skfem.MeshHex, skfem.MeshQuad])
def test_only_the_control_resists_hourglass_modes_of_a_parallelepiped(make):
    """A penalty has no energy in these modes either, because its volume is that of the mean gradient."""
    mesh = make().scaled(0.5)
    signs = np.prod(np.sign(mesh.p[:2] - 0.25), axis=0)
    u = np.zeros((mesh.nvertices, len(mesh.p)))
    u[:, 0] = 0.01 * signs
    plain, penalised = (System(mesh, terms, quadrature="one-point", hourglass=0.0) for terms in (TERM, [TERM, VolumePenalty(5.0)]))
    assert max(plain.energy(u.ravel()), penalised.energy(u.ravel())) < 1e-28
    assert System(mesh, TERM, quadrature="one-point").energy(u.ravel()) > 1e-6
