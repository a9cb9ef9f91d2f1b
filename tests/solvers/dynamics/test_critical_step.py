"""The critical explicit step is 2/omega_max, the bound is below it, longer steps are unstable, and critical elements are named."""

from dataclasses import replace

import numpy as np
import pytest
import skfem
from bodies import MESHES, box, distorted, random_frames, some_voigt, state
from scipy.spatial import Delaunay
from slow import slow

from skfem_stvk import (
    Anisotropic,
    Corotated,
    ElasticFoundation,
    ElementMesh,
    NeoHookean,
    RigidContact,
    RigidPlane,
    SpringNetwork,
    StVK,
    StvkError,
    System,
    VolumePenalty,
    critical_elements,
    critical_step,
)
from skfem_stvk.edges import ALL, NONE
from skfem_stvk.mesh import box as solid
from skfem_stvk.solvers.dynamics.critical_step import LargestFrequency
from skfem_stvk.solvers.dynamics.damping import EdgeDamping, Rayleigh
from skfem_stvk.terms.loads.load import Assumed, Moment

#: `step` is 2 over `sqrt(value + residual)`, so it is too small by at most the first, and too large by hardly more than the second.
BELOW, ABOVE = 1e-3, 1e-4


def unstructured(n=200):
    """Return tetrahedra between random points, with slivers."""
    p = np.random.default_rng(0).random((3, n)) * [[2.0], [1.0], [1.0]]
    mesh = ElementMesh(p, Delaunay(p.T).simplices.T)
    base_vectors = mesh.p[:, mesh.t[1:]] - mesh.p[:, mesh.t[:1]]
    volume = np.abs(np.linalg.det(base_vectors.transpose(2, 0, 1)))
    used, t = np.unique(mesh.t[:, volume > 1e-2 * volume.mean()], return_inverse=True)
    return ElementMesh(p[:, used], t.reshape(4, -1))


def systems():
    rng, found = np.random.default_rng(5), {}
    for name, mesh in {**MESHES, "unstructured": unstructured()}.items():
        letters, some = "xyz"[: mesh.d], tuple(range(0, mesh.nv, 4))
        density, young = rng.uniform(0.5, 2, mesh.nt), rng.uniform(1, 3, mesh.nt)
        term = StVK(young=young, poisson=0.35, density=density)
        found[f"{name}, free"] = System(mesh, term)
        found[f"{name}, held"] = System(mesh, term, fixed={some: letters}, prescribed={(1,): {letters[-1]: 0.1}})
    mesh = MESHES["tetrahedra"]
    general = StVK(Anisotropic(some_voigt(rng), frame=random_frames(1, rng)[0], density=2.0))
    found["anisotropic"] = System(mesh, general)
    young = np.where(np.arange(mesh.nt) % 7 == 3, 1e9, 1e2)
    found["stiff and soft"] = System(mesh, StVK(young=young, poisson=0.3, density=1e3))
    found["penalty"] = System(mesh, [StVK(young=2.0, poisson=0.3, density=1.0), VolumePenalty(5.0, kind="quadratic")])
    floor = ElementMesh.of(skfem.MeshTet(mesh.p, mesh.t).with_boundaries({"floor": lambda x: x[2] < 0.1}))
    found["foundation"] = System(
        floor, [StVK(young=2.0, poisson=0.3, density=1.0), ElasticFoundation("floor", stiffness=(0.5, 30.0, 90.0))]
    )
    return found


SYSTEMS = systems()
AMOUNTS = (0.0, 0.2, 0.5)


def matrices(system, u):
    """Return K, K0, K_GN and m over the free degrees of freedom."""
    free = np.setdiff1d(np.arange(system.ndofs), system.supports.held)
    K = system.tangent(u), system.tangent(np.zeros(system.ndofs)), system.jacobian(u, kept=NONE)
    return [k.toarray()[np.ix_(free, free)] for k in K], np.repeat(system.mass().vertex, system.mesh.d)[free]


def largest(K, m):
    return np.linalg.eigvalsh(K / np.sqrt(np.outer(m, m)))[-1]


@pytest.mark.few
@pytest.mark.parametrize("amount", AMOUNTS)
@pytest.mark.parametrize("name", SYSTEMS)
def test_the_step_is_that_of_the_largest_eigenvalue(name, amount):
    system = SYSTEMS[name]
    u = state(system.mesh, amount) - amount * system.mesh.p.ravel("F")  # compressed, so that K is indefinite
    (K, _, _), m = matrices(system, u)
    exact = 2 / np.sqrt(largest(K, m))
    found = critical_step(system, u)
    assert exact * (1 - BELOW) < found.step < exact * (1 + ABOVE)
    assert 0.75 * exact < found.bound <= min(found.step, exact)
    assert found.omega == pytest.approx(2 / found.step) and found.omega_bound == pytest.approx(2 / found.bound)
    assert 0 < found.products < 100
    if (name, amount) == ("tetrahedra, free", 0.5):
        assert np.linalg.eigvalsh(K)[0] < -0.02 * np.linalg.eigvalsh(K)[-1]


def exact_with_damping(K, D, m):
    """Return the critical step by bisection of `T^2 K + 2 T D <= 4 M`."""
    low, high = 0.0, 2 / np.sqrt(largest(K, m))
    for _ in range(50):
        T = (low + high) / 2
        low, high = (T, high) if largest(T**2 * K + 2 * T * D, m) <= 4 else (low, T)
    return low


DAMPINGS = {
    "mass": (Rayleigh(alpha=20.0), (20.0, 0, 0)),
    "stiffness": (Rayleigh(beta=0.05), (0, 0.05, 0)),
    "edges": (EdgeDamping(0.2), (0, 0, 0.2)),
    "all": ([Rayleigh(1.0, 0.02), EdgeDamping(0.04)], (1.0, 0.02, 0.04)),
}


@pytest.mark.few
@pytest.mark.parametrize("damping", DAMPINGS)
@pytest.mark.parametrize("amount", AMOUNTS)
@pytest.mark.parametrize("name", ["tetrahedra, held", slow("triangles, free"), slow("anisotropic"), "cable, free"])
def test_damping_makes_the_step_smaller(name, amount, damping):
    system, (given, (alpha, beta, tau)) = SYSTEMS[name], DAMPINGS[damping]
    u = state(system.mesh, amount)
    (K, K0, KGN), m = matrices(system, u)
    exact, undamped = exact_with_damping(K, alpha * np.diag(m) + beta * K0 + tau * KGN, m), critical_step(system, u)
    found = critical_step(system, u, damping=given)
    assert exact * (1 - 2 * BELOW) < found.step < exact * (1 + ABOVE) and found.step < 0.95 * undamped.step
    assert 0.6 * exact < found.bound <= exact
    assert (found.omega, found.omega_bound) == (undamped.omega, undamped.omega_bound)


def test_the_step_at_rest_follows_from_the_damping_ratio():
    system, (alpha, beta) = SYSTEMS["tetrahedra, free"], (2.0, 0.1)
    (K, _, _), m = matrices(system, np.zeros(system.ndofs))
    omega = np.sqrt(largest(K, m))
    xi = (alpha / omega + beta * omega) / 2
    found = critical_step(system, damping=Rayleigh(alpha, beta))
    assert found.step == pytest.approx(2 / omega * (np.sqrt(1 + xi**2) - xi), rel=2e-3)


def grows(system, step, force, n=1500):
    """Return whether `v += T M^-1 f(u, v); u += T v` diverges from a velocity of 1e-9."""
    free = np.ones(system.ndofs)
    free[system.supports.held] = 0
    u, v = np.zeros(system.ndofs), 1e-9 * free * np.random.default_rng(0).standard_normal(system.ndofs)
    for _ in range(n):
        v += step * system.mass().solve(force(u, v))
        u += step * v
        if np.abs(u).max() > 1e-3:
            return True
    return False


def force(system, alpha=0.0, beta=0.0, tau=0.0):
    K0, KGN = system.tangent(np.zeros(system.ndofs)), system.jacobian(np.zeros(system.ndofs), kept=NONE)
    return lambda u, v: -system.internal_force(u) - alpha * system.mass().multiply(v) - (beta * K0 + tau * KGN) @ v


@pytest.mark.few
@pytest.mark.parametrize("damping", [None, *DAMPINGS])
@pytest.mark.parametrize("name", ["tetrahedra, held", slow("triangles, free"), "cable, free"])
def test_instability_is_observed_within_two_percent(name, damping):
    """2 % above the step a perturbation of 1e-9 grows by six orders; 2 % below it does not.

    Damping uses the velocity of the previous step.
    """
    system, (given, factors) = SYSTEMS[name], DAMPINGS.get(damping, (None, (0, 0, 0)))
    step = critical_step(system, damping=given).step
    assert not grows(system, 0.98 * step, force(system, *factors))
    assert grows(system, 1.02 * step, force(system, *factors))


def test_the_largest_frequency_is_found_at_another_vertex():
    """In a mesh that is otherwise at rest, one vertex is moved close to its neighbours.

    An estimate that only continued from the previous mode would miss the largest frequency.
    """
    mesh = box(6)
    system = System(mesh, StVK(young=2.0, poisson=0.3, density=1.0))
    frequency = LargestFrequency(system)
    for vertex in (60, 171, 280):
        u = np.zeros((mesh.nv, 3))
        u[vertex] = 2.5 * np.array([0.05, 0.08, -0.06])
        (K, _, _), m = matrices(system, u.ravel())
        exact = 2 / np.sqrt(largest(K, m))
        assert exact < 0.8 * critical_step(system).step
        assert exact * (1 - BELOW) < frequency.at(u.ravel()).step < exact * (1 + ABOVE)


def test_the_step_depends_only_on_the_state():
    system = SYSTEMS["tetrahedra, held"]
    frequency, u = LargestFrequency(system, EdgeDamping(0.1)), state(system.mesh)
    first = frequency.at(u)
    frequency.at(0.3 * u)
    assert frequency.at(u) == first == critical_step(system, u, damping=EdgeDamping(0.1))
    assert frequency.bound(u) == first.bound


def test_fully_constrained_elements_do_not_limit_the_step():
    """All vertices of a stiff part are constrained, so that its neighbours are affected only as by a wall."""
    mesh = MESHES["triangles"]
    stiff = np.flatnonzero((mesh.p[0][mesh.t] < 0.4).all(axis=0))
    young = np.where(np.isin(np.arange(mesh.nt), stiff), 1e6, 1.0)
    fixed = {tuple(np.unique(mesh.t[:, stiff]).tolist()): "xy"}
    stiff_wall, soft = (System(mesh, StVK(young=y, poisson=0.3, density=1.0), fixed=fixed) for y in (young, 1.0))
    found, wanted = critical_step(stiff_wall), critical_step(soft)
    assert found.step == pytest.approx(wanted.step, rel=1e-3) and found.bound == pytest.approx(wanted.bound, rel=1e-12)


def test_single_precision_is_sufficient():
    system = SYSTEMS["tetrahedra, free"]
    single = System(system.mesh, system.terms, dtype=np.float32)
    u = state(system.mesh)
    for damping in (None, EdgeDamping(0.1)):
        one, other = critical_step(single, u, damping=damping), critical_step(system, u, damping=damping)
        assert one.step == pytest.approx(other.step, rel=1e-3) and one.bound == pytest.approx(other.bound, rel=1e-5)


@pytest.mark.parametrize("factor", [1e-6, 1.0, 1e6])
def test_units_do_not_matter(factor):
    mesh = MESHES["tetrahedra"]
    one = critical_step(System(mesh, StVK(young=2.0, poisson=0.3, density=1.0)))
    other = critical_step(System(ElementMesh(factor * mesh.p, mesh.t), StVK(young=2e9, poisson=0.3, density=1e3)))
    assert other.step == pytest.approx(factor * 1e-3 * one.step, rel=1e-9) and other.products == one.products


def test_a_single_degree_of_freedom_has_the_textbook_step():
    """A mass of 1/2 kg on a spring of 4 N/m: omega^2 = 8."""
    line = ElementMesh([[0.0, 1.0]], [[0], [1]])
    system = System(line, StVK(young=4.0, poisson=0.3, density=1.0), fixed={(0,): "x"})
    found = critical_step(system)
    assert found.step == pytest.approx(2 / np.sqrt(8)) and found.bound == pytest.approx(found.step)
    assert critical_step(system, damping=Rayleigh(alpha=1.0)).step == pytest.approx(4 / (1 + np.sqrt(1 + 32)))
    assert str(found) == "critical step 0.7071 s, safe bound 0.7071 s"


def test_a_body_without_positive_stiffness_has_no_critical_step():
    """A bar compressed beyond 1/sqrt(3) of its length has negative stiffness."""
    line = ElementMesh([[0.0, 1.0]], [[0], [1]])
    system = System(line, StVK(young=4.0, poisson=0.3, density=1.0), fixed={(0,): "x"})
    found = critical_step(system, [0.0, -0.7])
    assert (found.step, found.bound, found.omega, found.omega_bound) == (np.inf, np.inf, 0.0, 0.0)


BLOCK, SOLID = solid((0.2, 0.2, 0.1), (3, 3, 2)), StVK(young=1e6, poisson=0.3, density=1e3)
UNDAMPED = {
    "contact": RigidContact(RigidPlane((0, 0, 0), (0, 0, 1)), lambda x: x[2] == 0, stiffness=1e10),
    "foundation": ElasticFoundation(lambda x: x[2] == 0, stiffness=1e10),
    "volume": VolumePenalty(1e8),
}


@pytest.mark.parametrize("order", [1, -1])
@pytest.mark.parametrize("name", UNDAMPED)
def test_edge_damping_makes_the_step_smaller_by_the_damped_terms_alone(name, order):
    system, bare = System(BLOCK, [SOLID, UNDAMPED[name]][::order]), System(BLOCK, [SOLID])
    u, m = 1e-3 * state(BLOCK, 0.2), np.repeat(bare.mass().vertex, 3)
    K = system.tangent(u, t=Moment(0.0, 1.0, contact=Assumed.TOUCHING)).toarray()
    for tau in (1e-4, 2e-3, 1e-2):
        exact = exact_with_damping(K, tau * bare.jacobian(u, kept=NONE).toarray(), m)
        found = critical_step(system, u, damping=EdgeDamping(tau))
        assert exact * (1 - 2 * BELOW) < found.step < exact * (1 + ABOVE) and 0.6 * exact < found.bound <= exact


@pytest.mark.few
@pytest.mark.parametrize("free", [False, True])
@pytest.mark.parametrize("order", [1, -1])
@pytest.mark.parametrize("name", UNDAMPED)
def test_the_factor_of_damped_terms_is_theirs_alone(name, order, free):
    system, bare, other = (System(BLOCK, terms) for terms in ([SOLID, UNDAMPED[name]][::order], SOLID, [SOLID, UNDAMPED[name]]))
    u, some = 1e-3 * state(BLOCK, 0.2) - np.tile([0, 0, 1e-3], BLOCK.nv), np.arange(9, system.ndofs)
    wanted = (other.tangent(u) + 2 * bare.jacobian(u, kept=NONE)).toarray()
    damped = ALL._replace(damped=3.0)
    v = np.random.default_rng(0).normal(size=system.ndofs)
    assert np.abs(system.linear_operator(u, kept=damped) @ v - wanted @ v).max() < 1e-12 * np.abs(wanted @ v).max()
    K = system.jacobian(u, kept=damped, free=system.free_dofs(np.arange(9)) if free else None).toarray()
    assert np.abs(K - (wanted[np.ix_(some, some)] if free else wanted)).max() < 1e-12 * np.abs(wanted).max()


RNG = np.random.default_rng(0)
CELLS = {"quadrilaterals": skfem.MeshQuad().refined(2), "hexahedra": skfem.MeshHex().refined(1)}
MORE = {name: ElementMesh.of(mesh) for name, mesh in CELLS.items()}
MORE = {name: replace(mesh, p=distorted(mesh.p, RNG, 0.1)) for name, mesh in MORE.items()}
MORE |= {f"quadratic {name}": MESHES[name].with_degree(2) for name in ("triangles", "tetrahedra", "segments", "cable")}
ELEMENTS = MESHES | MORE


def body(name, **more):
    mesh = ELEMENTS[name]
    rng = np.random.default_rng(1)
    law = StVK(young=rng.uniform(1, 3, mesh.nt), poisson=0.35, density=rng.uniform(0.5, 2, mesh.nt))
    return System(mesh, law, **more)


def of_one(system, e):
    """Return the step of one element, with K of a mesh of its own and the masses of the body."""
    mesh, law = system.mesh, system.terms[0]
    kept = np.unique(mesh.t[:, e])
    t = np.searchsorted(kept, mesh.t[:, [e]])
    one = ElementMesh(mesh.p[:, kept], t, element=mesh.element)
    material = law.material
    alone = System(one, StVK(young=material.young[e], poisson=0.35, density=material.density[e]), quadrature=system.quadrature)
    K, m = alone.tangent(np.zeros(alone.ndofs)).toarray(), np.repeat(system.mass().vertex[kept], mesh.d)
    return 2 / np.sqrt(np.linalg.eigvalsh(K / np.sqrt(np.outer(m, m)))[-1])


@pytest.mark.few
@pytest.mark.parametrize("name", ELEMENTS)
def test_each_step_follows_from_the_own_stiffness_and_the_masses_of_the_body(name):
    system = body(name)
    found = critical_elements(system, 3)
    for e in (0, system.mesh.nt // 2, int(found.elements[0])):
        assert found.every[e] == pytest.approx(of_one(system, e), rel=1e-9)


@pytest.mark.parametrize("quadrature", [None, slow("one-point"), "exact"])
def test_steps_use_the_quadrature_of_the_system(quadrature):
    system = body("hexahedra", quadrature=quadrature)
    assert critical_elements(system).every[5] == pytest.approx(of_one(system, 5), rel=1e-9)


@pytest.mark.few
@pytest.mark.parametrize("name", ELEMENTS)
def test_the_step_of_the_body_does_not_exceed_that_of_an_element(name):
    system = body(name, fixed={tuple(range(0, ELEMENTS[name].nv, 4)): "x"})
    least, step = critical_elements(system, 1).steps[0], critical_step(system).step
    assert step <= least * (1 + 1e-3)  # the tolerance of eigenvalues
    assert least < 2.5 * step


@pytest.mark.parametrize("height", [1e-3, 1e-5])
def test_a_sliver_determines_the_step_of_the_body_to_five_percent(height):
    """Steps from the element's own mass alone would be ten times too short."""
    mesh = box(3)
    p = mesh.p.copy()
    a, b, c, apex = p[:, mesh.t[:, 40]].T
    normal = np.cross(b - a, c - a)
    p[:, mesh.t[3, 40]] = apex - (1 - height) * normal * (normal @ (apex - a)) / (normal @ normal)
    system = System(replace(mesh, p=p), StVK(young=1.0, poisson=0.3, density=1.0))
    found = critical_elements(system, 3)
    assert found.elements[0] == 40
    assert found.steps[0] == pytest.approx(critical_step(system).step, rel=0.05)


def test_steps_depend_on_the_displacements():
    system = body("tetrahedra")
    stretched = 0.5 * system.mesh.p.ravel("F")
    assert (critical_elements(system, u=stretched).every < critical_elements(system).every).all()


def test_laws_and_penalties_add_up_and_other_terms_are_named():
    mesh = box(2)
    floor = ElementMesh.of(skfem.MeshTet(mesh.p, mesh.t).with_boundaries({"floor": lambda x: x[2] < 0.1}))
    law = StVK(young=2.0, poisson=0.3, density=1.0)
    plain = critical_elements(System(floor, law))
    stiffer = critical_elements(System(floor, [law, VolumePenalty(50.0, kind="quadratic")]))
    assert (stiffer.every < plain.every).all() and plain.left_out == stiffer.left_out == ()
    bedded = System(floor, [law, ElasticFoundation("floor", stiffness=1e4)])
    assert critical_elements(bedded).left_out == ("ElasticFoundation 1",)
    np.testing.assert_array_equal(critical_elements(bedded).every, plain.every)
    for other in (NeoHookean, Corotated):
        np.testing.assert_allclose(critical_elements(System(floor, other(young=2.0, poisson=0.3, density=1.0))).every, plain.every)
    with pytest.raises(StvkError, match="SpringNetwork 0: expected at least one term on elements"):
        critical_elements(System(floor, SpringNetwork(young=2.0, poisson=0.25, density=1.0)))


def test_a_stiff_element_is_found():
    mesh = box(3)
    young = np.ones(mesh.nt)
    young[77] = 1e4
    found = critical_elements(System(mesh, StVK(young=young, poisson=0.3, density=1.0)), 4)
    assert found.elements[0] == 77 and found.steps[0] < 0.1 * found.steps[1] and "77" in repr(found)
    assert (np.diff(found.steps) >= 0).all() and len(found.steps) == 4
    np.testing.assert_array_equal(found.every[found.elements], found.steps)


def test_constrained_removed_and_unused_elements_have_infinite_steps():
    mesh = box(2)
    constrained = tuple(mesh.t[:, 5].tolist())
    system = System(mesh, StVK(young=1.0, poisson=0.3, density=1.0), fixed={constrained: "xyz"})
    with_all = critical_elements(system).every
    assert np.isinf(with_all[5]) and np.isfinite(np.delete(with_all, 5)).all()
    system = system.without([7])
    assert np.flatnonzero(np.isinf(critical_elements(system).every)).tolist() == [5, 7]
    some = StVK(young=1.0, poisson=0.3, density=1.0, region=np.delete(np.arange(mesh.nt), 3))
    assert np.flatnonzero(np.isinf(critical_elements(System(mesh, some)).every)).tolist() == [3]
