"""Linear elasticity has the constant stiffness of St. Venant-Kirchhoff at rest.

Tests cover the saved factorisations, and the spurious stress of rotations.
"""

import numpy as np
import pytest
from bodies import EVERY_MESH, box, boxes, random_frames, some_voigt, state
from scipy.sparse.linalg import spsolve
from slow import slow

from skfem_stvk import (
    Anisotropic,
    BackwardEuler,
    ElasticFoundation,
    EnergyMomentum,
    Gravity,
    LinearBackwardEuler,
    LinearElastic,
    Newmark,
    Pressure,
    Rayleigh,
    StVK,
    System,
    VolumePenalty,
    modes,
    simulate,
    solve_static,
)
from skfem_stvk.results import Fields
from skfem_stvk.system.free_tangent import FreeTangent


def materials(mesh):
    rng = np.random.default_rng(11)
    isotropic = StVK(young=rng.uniform(1, 9, mesh.nt), poisson=rng.uniform(-0.3, 0.45, mesh.nt)).material
    return isotropic, Anisotropic(some_voigt(rng), frame=random_frames(mesh.nt, rng))


@pytest.mark.few
@pytest.mark.parametrize("name", [slow(name) if name == "quadratic tetrahedra" else name for name in EVERY_MESH])
def test_the_stiffness_is_that_of_the_body_at_rest_in_all_states(name):
    mesh = EVERY_MESH[name]
    for material in materials(mesh):
        linear, law = System(mesh, LinearElastic(material)), System(mesh, StVK(material))
        K, u = law.tangent(np.zeros(mesh.p.size)), 2 * state(mesh)
        for at in (0 * u, u):
            assert abs(linear.tangent(at) - K).max() <= 1e-14 * abs(K).max()
        W, F = linear.energy_and_force(u)
        assert np.abs(F - K @ u).max() < 1e-13 * np.abs(F).max() and pytest.approx(u @ (K @ u) / 2, rel=1e-12) == W
        assert abs(law.internal_force(u) - F).max() > 0.01 * np.abs(F).max()
        assert linear.constant_tangent and not law.constant_tangent


@pytest.mark.parametrize("k", [2, slow(3)])
def test_the_stiffness_of_boxes_with_one_point_is_that_at_rest(k):
    mesh = boxes(k)
    linear, law = (System(mesh, kind(young=2.0, poisson=0.3), quadrature="one-point") for kind in (LinearElastic, StVK))
    K, u = law.tangent(np.zeros(mesh.p.size)), state(mesh)
    assert abs(linear.tangent(u) - K).max() <= 1e-14 * abs(K).max()
    assert np.abs(linear.internal_force(u) - K @ u).max() < 1e-13 * np.abs(K @ u).max()


@pytest.mark.parametrize("options", [{"plane": "stress", "thickness": 0.2}, {"plane": "strain"}])
def test_plane_strain_and_plane_stress(options):
    mesh = EVERY_MESH["triangles"]
    linear, law = (System(mesh, kind(young=2.0, poisson=0.3, **options)) for kind in (LinearElastic, StVK))
    assert abs(linear.tangent(state(mesh)) - law.tangent(np.zeros(mesh.p.size))).max() < 1e-14


@pytest.fixture
def factorised(monkeypatch):
    """Return the list of tangents that were factorised."""
    counts, factorise = [], FreeTangent.factorise

    def counted(self, K, exact=True):
        counts.append(exact)
        return factorise(self, K, exact)

    monkeypatch.setattr(FreeTangent, "factorise", counted)
    return counts


LINEAR = LinearElastic(young=100.0, poisson=0.3, density=1.0)


SOFT = StVK(young=50.0, poisson=0.3, density=1.0, region=np.arange(20))
STIFF = LinearElastic(young=500.0, poisson=0.1, density=1.0, region=np.arange(20, 48))


def loaded(*terms, gravity=(0.2, 0, -1.0)):
    mesh = box(2)
    wall = tuple(np.flatnonzero(mesh.p[2] > 0.8))
    return System(mesh, [*(terms or [LINEAR]), Gravity(gravity)], fixed={wall: "xyz"})


@pytest.mark.parametrize("solver", ["superlu", "amg-cg", "ssor-cg", "block-jacobi-cg", "auto"])
def test_statics_takes_one_factorisation_and_one_iteration(solver, factorised):
    """A static path takes one factorisation and one iteration. The path is straight, so later steps begin at their solution."""
    system = loaded()
    found = solve_static(system, steps=4, solver=solver, quiet=True)
    assert found.success and factorised == [True] and sum(len(step.iterations) for step in found.history) == 1
    free = np.setdiff1d(np.arange(system.ndofs), system.supports.held)
    K = system.tangent(np.zeros(system.ndofs))[free][:, free]
    exact = spsolve(K.tocsc(), system.external_force(np.zeros(system.ndofs))[free])
    assert np.abs(found.u[free] - exact).max() < 1e-7 * np.abs(exact).max()


def test_prescribed_displacements_take_one_factorisation_too(factorised):
    mesh = box(2)
    wall, tip = (tuple(np.flatnonzero(where)) for where in (mesh.p[2] > 0.8, mesh.p[2] < 0.2))
    system = System(mesh, LINEAR, fixed={wall: "xyz"}, prescribed={tip: {"x": 0.1, "z": -0.05}})
    found = solve_static(system, steps=3, solver="superlu", quiet=True)
    assert found.success and factorised == [True]
    assert found.u.reshape(-1, 3)[list(tip), 0] == pytest.approx(0.1)


def test_linear_regions_and_foundations_take_one_factorisation(factorised):
    system = loaded(LinearElastic(SOFT.material, region=SOFT.region), STIFF, ElasticFoundation(lambda x: x[2] < 0.2, 5.0))
    assert system.constant_tangent and solve_static(system, steps=3, quiet=True).success and factorised == [True]


@pytest.mark.parametrize(
    "terms",
    [
        [SOFT, STIFF],
        [LINEAR, VolumePenalty()],
        [LINEAR, Pressure(lambda x: x[2] < 0.2, 0.5)],
    ],
    ids=["StVK", "penalty", "follower"],
)
def test_nonlinear_terms_take_more_factorisations(terms, factorised):
    system = loaded(*terms)
    found = solve_static(system, steps=2, quiet=True)
    assert not system.constant_tangent and found.success and len(factorised) > 2


INTEGRATORS = [LinearBackwardEuler(0.02), BackwardEuler(0.02), Newmark(0.02), EnergyMomentum(0.02)]


@pytest.mark.parametrize("integrator", INTEGRATORS, ids=lambda one: type(one).__name__)
@pytest.mark.parametrize("damping", [None, Rayleigh(0.1, 0.01)], ids=["", "damped"])
def test_a_run_with_a_constant_step_takes_one_factorisation(integrator, damping, factorised):
    system = loaded()
    run = simulate(system, integrator, until=0.4, damping=damping, quiet=True)
    assert run.success and factorised == [True] and run.ledger.steps == 21
    if isinstance(integrator, EnergyMomentum) and damping is None:
        energy = run.ledger["total_energy"]
        assert np.ptp(energy) < 1e-10 * np.ptp(run.ledger["kinetic_energy"]) > 0


def test_eq_9_is_a_step_of_the_linear_equation():
    """`LinearBackwardEuler` equals an explicit loop over `(M/T^2 + K) T v1 = h - F + M v0/T`."""
    system, T = loaded(), 0.02
    free = np.setdiff1d(np.arange(system.ndofs), system.supports.held)
    K = system.tangent(np.zeros(system.ndofs)).toarray()[np.ix_(free, free)]
    M, h = system.mass().matrix.toarray()[np.ix_(free, free)], system.external_force(np.zeros(system.ndofs))[free]
    u, v = np.zeros(len(free)), np.zeros(len(free))
    for _ in range(20):
        v = np.linalg.solve(M / T**2 + K, h - K @ u + M @ v / T) / T
        u = u + T * v
    run = simulate(system, LinearBackwardEuler(T), until=20 * T, quiet=True)
    assert np.abs(run.u[free] - u).max() < 1e-8 * np.abs(u).max()


def test_a_shorter_last_step_takes_another_factorisation(factorised):
    run = simulate(loaded(), LinearBackwardEuler(0.02), until=0.25, quiet=True)
    assert run.success and factorised == [True, True]


def test_modes_do_not_change_with_the_state():
    system = loaded()
    u = solve_static(system, quiet=True).u
    at_rest = modes(loaded(StVK(LINEAR.material)), 4).eigenvalues
    assert modes(system, 4, u=u).eigenvalues == pytest.approx(at_rest, rel=1e-6)


def test_damping_is_that_of_the_stiffness_at_rest():
    mesh = box(2)
    term, v = LINEAR.bind(mesh), state(mesh).reshape(-1, 3)
    force = np.zeros_like(v)
    R = term.damping_force(2 * v, v, force)
    K = System(mesh, LINEAR).tangent(np.zeros(mesh.p.size))
    assert np.abs(force.ravel() - K @ v.ravel()).max() < 1e-13 * np.abs(force).max()
    assert pytest.approx(np.vdot(force, v), rel=1e-12) == 2 * R


def rotated(mesh, t):
    """Return displacements of a rotation by `t` about the z axis (in the plane: about the origin)."""
    c, s = np.cos(t) - 1, np.sin(t)
    u = np.zeros_like(mesh.p)
    u[0], u[1] = c * mesh.p[0] - s * mesh.p[1], s * mesh.p[0] + c * mesh.p[1]
    return u.ravel("F")


@pytest.mark.parametrize("name", ["tetrahedra", "quadratic tetrahedra", "hexahedra"])
@pytest.mark.parametrize("degrees", [1, 45, 90])
def test_a_rotation_has_a_spurious_stress(name, degrees):
    """A rotation has `s_xx = s_yy = 2 (mu + lam) (cos t - 1)`, `s_zz = 2 lam (cos t - 1)` in all measures.

    St. Venant-Kirchhoff has no stress.
    """
    mesh, t = EVERY_MESH[name], np.radians(degrees)
    law = LinearElastic(young=2.6, poisson=0.3)
    lam, mu = 1.5, 1.0
    u = rotated(mesh, t)
    now = Fields(mesh, law).at(u)
    expected = 2 * (np.cos(t) - 1) * np.diag([mu + lam, mu + lam, lam])
    for measure in ("cauchy_stress", "pk1_stress", "pk2_stress"):
        assert np.abs(now[measure] - expected).max() < 1e-12
    assert np.abs(now["green_strain"]).max() < 1e-12 > np.abs(Fields(mesh, StVK(law.material)).at(u)["pk2_stress"]).max()
    energy = now["strain_energy_density"] @ now.fields.volume
    limit = 1e-10 if name == "tetrahedra" else 1e-4  # the rule does not integrate volumes of curved elements exactly
    assert energy == pytest.approx(System(mesh, law).energy(u), rel=limit) and energy > 0


def test_a_rotation_has_a_spurious_stress_in_plane_strain_and_plane_stress():
    mesh, t = EVERY_MESH["triangles"], 0.7
    strain = Fields(mesh, LinearElastic(young=2.6, poisson=0.3)).at(rotated(mesh, t))["cauchy_stress"]
    assert np.abs(strain - 2 * (np.cos(t) - 1) * np.diag([2.5, 2.5, 1.5])).max() < 1e-12
    stress = Fields(mesh, LinearElastic(young=2.6, poisson=0.3, plane="stress")).at(rotated(mesh, t))["cauchy_stress"]
    lam = 2.6 * 0.3 / (1 - 0.09)
    assert np.abs(stress - 2 * (np.cos(t) - 1) * np.diag([1 + lam, 1 + lam, 0])).max() < 1e-12


@pytest.mark.parametrize("name", ["tetrahedra", "quadrilaterals", "membrane"])
def test_nodal_forces_are_those_of_the_stress(name):
    """By virtual work, the stress times the small strain of any motion is the work of the forces."""
    mesh, (isotropic, anisotropic) = EVERY_MESH[name], materials(EVERY_MESH[name])
    u, v = state(mesh), state(mesh, seed=9)
    for material in (isotropic, anisotropic):
        fields = Fields(mesh, LinearElastic(material))
        both = (
            fields.at(u + v)["strain_energy_density"]
            - fields.at(u)["strain_energy_density"]
            - fields.at(v)["strain_energy_density"]
        )
        assert both @ fields.volume == pytest.approx(System(mesh, LinearElastic(material)).internal_force(u) @ v, rel=1e-9)
