"""Quadratic simplices, hexahedra and quadrilaterals fall without strain, vibrate correctly, and have the right weight."""

import numpy as np
import pytest
from bodies import CURVED, EVERY_MESH, STRAIGHT
from scipy.linalg import eigh
from slow import slow

from skfem_stvk import (
    BackwardEuler,
    EnergyMomentum,
    ForwardEuler,
    Gravity,
    StVK,
    System,
    VelocityVerlet,
    critical_step,
    modes,
    simulate,
)
from skfem_stvk.solvers.dynamics.motion import Motion
from skfem_stvk.system.signature import Fingerprint
from skfem_stvk.terms.loads.load import Moment

SECTION = {1: {"area": 0.3}, 2: {"thickness": 0.3}, 3: {}}


def body(mesh, g=-9.81, **more):
    rng = np.random.default_rng(0)
    material = StVK(young=1e6, poisson=0.3, density=rng.uniform(800, 1200, mesh.nt), **SECTION[mesh.k])
    return System(mesh, [material, Gravity(g * np.arange(1.0, mesh.d + 1))], **more)


def left(mesh):
    """Return the nodes of the leftmost elements."""
    return np.unique(mesh.t[:, mesh.p[0, mesh.t].min(axis=0) < 0.1])


@pytest.mark.few
@pytest.mark.parametrize("mass", ["lumped", "consistent"])
@pytest.mark.parametrize("name", EVERY_MESH)
def test_a_free_body_accelerates_uniformly(name, mass):
    """Gravity is M g with the mass in use; with the other mass a quadratic body would be strained."""
    system, mesh = body(EVERY_MESH[name]), EVERY_MESH[name]
    rest = np.zeros(system.ndofs)
    g = -9.81 * np.arange(1.0, mesh.d + 1)
    a = Motion(system, mass, None).accelerations(rest, rest, 0.3).reshape(-1, mesh.d)
    assert np.abs(a - g).max() < 1e-12 * np.abs(g).max()
    other = system.external_force(rest, Moment(0.3, 1.0, {"lumped": "consistent", "consistent": "lumped"}[mass]))
    wrong = system.mass(mass).solve(other).reshape(-1, mesh.d)
    assert (np.abs(wrong - g).max() > 0.2 * np.abs(g).max()) == (mesh.element.degree == 2 and mesh.k > 1)


@pytest.mark.few
@pytest.mark.parametrize(
    ("integrator", "mass"),
    [
        (VelocityVerlet(), "lumped"),
        (ForwardEuler(), "lumped"),
        (EnergyMomentum(dt=0.01), "lumped"),
        (EnergyMomentum(dt=0.01), "consistent"),
        (BackwardEuler(dt=0.01, rtol=1e-8), "lumped"),
    ],
    ids=lambda given: given if isinstance(given, str) else type(given).__name__,
)
@pytest.mark.parametrize(
    "name", [slow(name) if "tetra" in name else name for name in CURVED if name not in ("quadratic membrane", "quadratic cable")]
)
def test_a_free_body_falls_without_strain(name, integrator, mass):
    system, mesh = body(CURVED[name]), CURVED[name]
    run = simulate(system, integrator, until=0.05, mass=mass, quiet=True)
    u = run.u.reshape(-1, mesh.d)
    exact = -9.81 * 0.05**2 / 2 * np.arange(1.0, mesh.d + 1)
    assert run.status.value == "finished"
    assert np.ptp(u, axis=0).max() < 1e-7 * np.abs(exact).max()
    assert system.energy(run.u) < 1e-12 * run.ledger["kinetic_energy"][-1]
    if isinstance(integrator, VelocityVerlet | EnergyMomentum):
        assert u.mean(axis=0) == pytest.approx(exact, rel=1e-9)
        assert np.abs(run.ledger["closure_error"]).max() < 1e-9 * run.ledger["kinetic_energy"][-1]


@pytest.mark.parametrize("mass", ["lumped", "consistent"])
@pytest.mark.parametrize("name", ["quadratic tetrahedra", "hexahedra", "quadratic membrane"])
def test_energy_and_momenta_of_a_tumbling_body_are_conserved(name, mass):
    mesh = CURVED[name]
    system = System(mesh, StVK(young=1e5, poisson=0.3, density=1e3, **SECTION[mesh.k]))
    x = mesh.p.T - mesh.p.mean(axis=1)
    v0 = (np.cross([3.0, -2, 5], x) + x * [1.0, -0.5, 0.3] + 0.2 * np.sin(9 * x)).ravel()
    run = simulate(system, EnergyMomentum(dt=0.01, rtol=1e-11), until=0.1, v0=v0, mass=mass, quiet=True)
    ledger = run.ledger
    assert ledger["strain_energy"].max() > 1e-4 * ledger["total_energy"][0]
    assert np.abs(ledger["closure_error"]).max() < 1e-10 * ledger["total_energy"][0]
    for axis in "xyz":
        for momentum in ("linear", "angular"):
            values = ledger[f"{momentum}_momentum_{axis}"]
            scale = np.abs(system.mass(mass).multiply(v0)).sum()
            assert np.ptp(values) < 1e-10 * scale


def dense(system, mass):
    free = np.setdiff1d(np.arange(system.ndofs), system.supports.held)
    K, M = system.tangent(np.zeros(system.ndofs)).toarray(), system.mass(mass).matrix.toarray()
    return K[np.ix_(free, free)], M[np.ix_(free, free)]


@pytest.mark.parametrize("name", CURVED)
def test_the_critical_step_is_that_of_the_largest_eigenvalue(name):
    mesh = CURVED[name]
    for system in (body(mesh), body(mesh, fixed=[(left(mesh)[:3], "x")])):
        largest = eigh(*dense(system, "lumped"), eigvals_only=True)[-1]
        found = critical_step(system)
        exact = 2 / np.sqrt(largest)
        assert found.bound <= exact * (1 + 1e-12) and 0.99 * exact < found.step < 1.001 * exact
        assert found.bound > 0.6 * exact


@pytest.mark.few
@pytest.mark.parametrize("mass", ["lumped", "consistent"])
@pytest.mark.parametrize("name", [name for name, mesh in CURVED.items() if mesh.k == mesh.d])
def test_modes_are_those_of_the_dense_matrices(name, mass):
    mesh = CURVED[name]
    for system, rigid in ((body(mesh), {1: 1, 2: 3, 3: 6}[mesh.d]), (body(mesh, fixed=[(left(mesh), "xyz"[: mesh.d])]), 0)):
        n = min(9, system.ndofs - len(system.supports.held))
        found, exact = modes(system, n, mass=mass), eigh(*dense(system, mass), eigvals_only=True)
        assert found.rigid.sum() == rigid
        np.testing.assert_allclose(found.eigenvalues, exact[:n], rtol=1e-8, atol=1e-9 * exact[-1])


@pytest.mark.parametrize("mass", ["lumped", "consistent"])
@pytest.mark.parametrize("name", ["quadratic tetrahedra", "quadratic triangles", "quadrilaterals", "hexahedra"])
def test_reactions_carry_the_weight_and_the_inertia(name, mass):
    """Newton's second law of the whole body: reactions and weight are the rate of its momentum."""
    mesh = CURVED[name]
    system = body(mesh, fixed=[(left(mesh), "xyz"[: mesh.d])])
    motion, rng = Motion(system, mass, None), np.random.default_rng(1)
    run = simulate(system, EnergyMomentum(dt=1e-3), until=5e-3, mass=mass, quiet=True)
    state = run.last.copy()
    state.u += 1e-3 * rng.standard_normal(system.ndofs) * (np.isin(np.arange(system.ndofs), system.supports.held) == 0)
    a = motion.accelerations(state.u, run.v, state.t)
    weight = motion.loads(state.u, 0.0).reshape(-1, mesh.d).sum(axis=0)
    assert weight == pytest.approx(-9.81 * system.mass(mass).total * np.arange(1.0, mesh.d + 1), rel=1e-12)
    ground = motion.ground_forces(state, (0.0, state.t), 1e-3, False).reshape(-1, mesh.d).sum(axis=0)
    rate = motion.mass.multiply(a).reshape(-1, mesh.d).sum(axis=0)
    assert ground + weight == pytest.approx(rate, abs=1e-10 * np.abs(weight).max())


def test_fingerprints_depend_on_elements_and_quadrature():
    mesh = CURVED["quadratic tetrahedra"]
    one, same, exact = body(mesh), body(mesh), body(mesh, quadrature="exact")
    first = Fingerprint("motion", one, {}, [0.0], {})
    assert first.differences(Fingerprint("motion", same, {}, [0.0], {}).signature) == ""
    straight = STRAIGHT["quadratic tetrahedra"]
    for other in (exact, body(straight)):
        assert "the elastic terms" in first.differences(Fingerprint("motion", other, {}, [0.0], {}).signature)
    flat = body(straight)
    differences = Fingerprint("motion", flat, {}, [0.0], {}).differences(
        Fingerprint("motion", body(straight, quadrature="exact"), {}, [0.0], {}).signature
    )
    assert differences == "the elastic terms changed"
