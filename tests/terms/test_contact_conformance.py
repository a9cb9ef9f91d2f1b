"""Suite of requirements for all terms with contact: those of the package, and a minimal one of `toys.py`.

A contact of one's own is one more row of `CASES`. Faults that are planted in the cases are found.
"""

from functools import partial
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import pytest
import skfem
from terms.test_conformance import dense, derivative, force_of
from terms.test_mesh_contact import KINDS, deformed, pair, upper
from terms.test_rigid_contact import LAW, MESHES, SHAPES
from terms.test_rigid_mesh import pressed, pressed_on_a_polygon
from terms.toys import Floor

from skfem_stvk import Friction, RigidBox, RigidContact, RigidPlane, RigidSphere, StVK, System
from skfem_stvk.edges import TENSILE
from skfem_stvk.mesh import ElementMesh
from skfem_stvk.terms import BoundContact
from skfem_stvk.terms.loads.load import APART, Moment, StepStart


class Case(NamedTuple):
    """Contact of a body, with states (nv, d) in which it touches and does not, and a direction towards the contact.

    Attributes
    ----------
    system
        Body with a law and the contact.
    apart, touching, way
        The states, and a direction (nv, d) along which the body that is apart first touches, and then passes if it can.
    ends
        Whether something is passed within `way`.
    step, limit
        Step of differences in units of length, and their largest relative error.
    mean
        Largest relative error of twice the derivative of the mean force. `RigidContact` leaves out the change of its normal.
    path
        Largest relative error of the energy along a way by quadrature. At edges of boxes the force jumps from face to face.
    """

    system: System
    apart: Any
    touching: Any
    way: Any
    ends: bool
    step: float = 1e-6
    limit: float = 1e-6
    mean: float = 1.2
    path: float = 1e-4

    @property
    def mesh(self) -> ElementMesh:
        return self.system.mesh

    @property
    def direction(self) -> Any:
        """A direction (nv, d) of size 1 in which all components differ."""
        v = np.random.default_rng(4).normal(size=self.apart.shape)
        return v / np.abs(v).max()


def rigid(mesh="tetrahedra", shape="sphere", **options):
    return on_shape(MESHES[mesh], SHAPES[shape], **options)


def on_shape(mesh, shape, **options):
    """Return a body that falls from above through a shape, or within a hollow one from its middle."""
    law = StVK(young=1e3, poisson=0.3, **{1: {"area": 0.2}, 2: {"thickness": 0.2}, 3: {}}[mesh.k])
    system = System(mesh, [law, RigidContact(shape, stiffness=1e4, name="touch", **options)])
    u = 0.02 * np.random.default_rng(0).normal(size=mesh.p.T.shape)
    up = np.eye(mesh.d)[-1] * np.ones((mesh.nv, 1))
    hollow = getattr(shape, "inside", False)
    apart = u - 0.7 * (mesh.p.T - 0.5) if hollow else u + 2 * up
    path = 3e-3 if isinstance(shape, RigidBox) else 1e-4
    return Case(system, apart, u, -4 * up, np.isfinite(shape.thickness), path=path)


def meshed(kind="tetrahedra", **options):
    system, _ = pair(kind, **options)
    return above(system, upper(system))


def above(system, nodes):
    """Return a case in which these nodes fall on a surface."""
    u = deformed(system)[0].reshape(-1, system.mesh.d)
    apart, way = u.copy(), np.zeros_like(u)
    apart[nodes, -1] += 0.02
    way[nodes, -1] = -0.05
    return Case(system, apart, u, way, True, 1e-7, 1e-5, 0.5 if system.mesh.element.degree == 2 else 0.1)


def on_a_rigid_mesh(d):
    system = pressed()[0] if d == 3 else pressed_on_a_polygon()
    return above(system, np.arange(system.mesh.nv))


def toy():
    system = System(MESHES["tetrahedra"], [LAW, Floor(0.3, 100.0)])
    u = 0.02 * np.random.default_rng(0).normal(size=(system.mesh.nv, 3))
    return Case(system, u + np.array([0, 0, 2.0]), u, np.tile([0, 0, -4.0], (system.mesh.nv, 1)), False, mean=1e-3)


FLAT = {
    "triangles": ElementMesh.of(skfem.MeshTri().refined(2)),
    "quadratic triangles": ElementMesh.of(skfem.MeshTri().refined(1)).with_degree(2),
    "quadrilaterals": ElementMesh.of(skfem.MeshQuad().refined(2)),
    "segments": ElementMesh.of(skfem.MeshLine(np.linspace(0, 1, 5))),
}
RUBBING = Friction(0.4, slip_speed=0.05, slip_length=1e-4)
CASES = {
    "toy": toy,
    "plane": lambda: rigid(shape="plane")._replace(mean=1e-3),
    "plane with an onset": lambda: rigid(shape="plane", onset=0.05)._replace(mean=1e-3),
    **{shape: partial(rigid, shape=shape) for shape in SHAPES if shape != "plane"},
    "sphere with an onset": lambda: rigid(onset=0.05),
    "sphere, quadratic tetrahedra": lambda: rigid("quadratic tetrahedra"),
    "cylinder, hexahedra": lambda: rigid("hexahedra", "cylinder"),
    "rounded box, membrane": lambda: rigid("membrane", "rounded box"),
    "disc, triangles": lambda: on_shape(FLAT["triangles"], RigidSphere((0.5, -0.4), 0.6)),
    "inside a disc, quadrilaterals": lambda: on_shape(FLAT["quadrilaterals"], RigidSphere((0.5, 0.5), 0.6, inside=True)),
    "line, quadratic triangles": lambda: on_shape(FLAT["quadratic triangles"], RigidPlane((0, 0.2), (0.3, 1)))._replace(mean=1e-3),
    "rectangle, triangles": lambda: on_shape(FLAT["triangles"], RigidBox((0.2, -1), (0.9, 0.3), radius=0.2)),
    "point, segments": lambda: on_shape(FLAT["segments"], RigidPlane((0.1,), (2.0,)))._replace(mean=1e-3),
    "moving sphere with friction": lambda: rigid(friction=RUBBING, motion=lambda t: (t, 0, 0)),
    "two bodies": meshed,
    **{f"two bodies, {kind}": partial(meshed, kind) for kind in KINDS[1:]},
    "two bodies with friction": lambda: meshed(friction=RUBBING),
    "rigid mesh": lambda: on_a_rigid_mesh(3),
    "polygon": lambda: on_a_rigid_mesh(2),
}


@pytest.fixture(params=CASES)
def case(request):
    return CASES[request.param]()


def blocks_at(case, term, u):
    """Return K at `u`, after the term has looked at it."""
    if hasattr(term, "look"):
        term.look(u)
    return dense(case, term, u)[0]


def check_protocol(case):
    term, v = case.system.bound_terms[1], case.direction
    assert isinstance(term, BoundContact) and term.has_mean_force and case.system.contacts == [term]
    assert term.energy_and_force(case.apart) == 0 < term.energy_and_force(case.touching)
    assert np.isfinite(term.identity()).all() and not blocks_at(case, term, case.apart).any()
    pressure, gap, area = term.evaluated(case.touching)
    assert pressure.shape == gap.shape == (len(v),) and pressure.min() >= 0 < pressure.max() and area > 0
    assert not term.evaluated(case.apart)[0].any() and term.evaluated(case.apart)[2] == 0 < term.evaluated(case.apart)[1].min()
    nodes, normals = term.held_directions(case.touching)
    assert len(nodes) == len(normals) and np.allclose(np.linalg.norm(normals, axis=1), 1)
    term.refuse_start(case.apart)
    assert not blocks_at(case, term.at(APART, None), case.touching).any()


def check_derivatives(case):
    """Check the derivatives where it touches, K without negative curvature, and the energy along a way across the onset."""
    term, v = case.system.bound_terms[1], case.direction
    u = case.touching
    K, F = blocks_at(case, term, u), force_of(term, u)
    assert derivative(lambda s: term.energy_and_force(u + s * v), case.step) == pytest.approx(np.vdot(F, v), rel=case.limit)
    change = derivative(lambda s: force_of(term, u + s * v), case.step).ravel()
    assert np.abs(K @ v.ravel() - change).max() < case.limit * np.abs(change).max()
    clamped = np.linalg.eigvalsh(dense(case, term, u, TENSILE)[0])
    assert clamped[0] > -1e-9 * clamped[-1]
    product = case.system.tangent(u.ravel()) @ v.ravel()
    assert np.abs(case.system.product(u.ravel(), v.ravel()) - product).max() < 1e-10 * np.abs(product).max()
    begin, way = case.apart, u - case.apart
    energies, works = [], []
    points, weights = np.polynomial.legendre.leggauss(4)
    parts = np.linspace(0, 1, 401)
    for low, high in pairwise(parts):
        at = low + (high - low) * (points + 1) / 2
        works.append(sum(w * np.vdot(force_of(term, begin + s * way), way) for w, s in zip(weights, at, strict=True)) / 2 / 400)
        energies.append(term.energy_and_force(begin + high * way))
    assert np.abs(np.cumsum(works) - energies).max() < case.path * energies[-1]


def check_symmetry_and_balance(case):
    term = case.system.bound_terms[1]
    K, F = blocks_at(case, term, case.touching), force_of(term, case.touching)
    assert (np.abs(K - K.T).max() <= 1e-12 * np.abs(K).max()) == term.symmetric
    x = case.mesh.p.T + case.touching
    torque = x.T @ F - F.T @ x
    assert (np.abs(F.sum(axis=0)).max() < 1e-12 * np.abs(F).sum()) == term.balanced
    assert (np.abs(torque).max() < 1e-12 * np.abs(x).max() * np.abs(F).sum()) == (term.balanced or case.mesh.d == 1)


def check_discrete_gradient(case):
    """Check the work of the mean force between states that touch, across the onset, and at equal states, and its derivative."""
    term, v, size = case.system.bound_terms[1], case.direction, 1e3 * case.step
    middle = case.touching + 0.5 * size * v
    for u0, u1 in ((case.touching, case.touching + size * v), (case.apart, case.touching), (case.touching, case.touching)):
        force, change = np.zeros_like(u0), term.energy_and_force(u1) - term.energy_and_force(u0)
        assert term.mean_force(u0, u1, (0.5, 0.5), 0.5, force) == 0
        assert np.vdot(force, u1 - u0) == pytest.approx(change, rel=1e-9, abs=1e-12 * term.energy_and_force(case.touching))
    assert force == pytest.approx(force_of(term, case.touching), abs=1e-9 * np.abs(force).max())
    u0, u1 = case.touching, middle

    def twice(s):
        force = np.zeros_like(u0)
        term.mean_force(u0, u1 + s * v, (1.0, 1.0), 0.5, force)
        return force.ravel()

    K, change = blocks_at(case, term.at(Moment(0.0, 0.0, contact=(u0, u1)), None), u1), derivative(twice, case.step)
    assert np.abs(K @ v.ravel() - change).max() < case.mean * np.abs(change).max()


def check_step_limit(case):
    """Check the limit by bisection of the part of the way that passes nothing."""
    term = case.system.bound_terms[1]
    limit, low, high = term.contact_limit(case.apart, case.way), 0.0, 1.0
    assert term.passes(case.apart, case.apart + case.way) == case.ends == (limit <= 1)
    for _ in range(30):
        middle = (low + high) / 2
        low, high = (low, middle) if term.passes(case.apart, case.apart + middle * case.way) else (middle, high)
    assert 0.99 * low <= limit and (not case.ends or limit <= high * (1 + 1e-9))
    assert term.contact_limit(case.apart, -case.way) > 1


def check_look(case):
    """Check that K in a state does not depend on the states before, and that a look makes place for its blocks."""
    body, fresh = case.system, bound_again(case.system)
    far = body.tangent(case.apart.ravel())
    K, other = body.tangent(case.touching.ravel()), fresh.tangent(case.touching.ravel())
    assert np.array_equal(K.indices, other.indices) and np.array_equal(K.data, other.data)
    between = body.bound_terms[1].pairs_change and body.bound_terms[1].balanced  # a surface alone has coupled nodes
    assert K.nnz > far.nnz if between else K.nnz >= far.nnz
    again = body.tangent(case.apart.ravel())
    assert np.array_equal(again.indices, far.indices) and np.array_equal(again.data, far.data)


def bound_again(system):
    """Return the same system, bound again."""
    return System(system.mesh, system.terms)


def check_explicit_state(case):
    """Check that calls at other times and from other histories leave the contact as it was, and that a history comes back."""
    body, fresh, v = case.system, bound_again(case.system), case.direction
    u, moved = case.touching.ravel(), (case.touching + 1e3 * case.step * v).ravel()

    def after(history, t):
        return body.internal_force(moved, Moment(t, t, step=StepStart(history, in_time=True)))

    first = body.advanced(body.first_history(), u, 0.0)
    wanted = after(first, 1e-3)
    second = body.advanced(first, (u + moved) / 2, Moment(1e-3, 1e-3))
    assert np.array_equal(after(second, 2e-3), wanted) == (not body.contacts[0].does_work)
    assert len(first) == body.contacts[0].has_history
    body.return_to(first)
    assert np.array_equal(after(first, 1e-3), wanted)
    for t in (1.0, 0.0):
        body.tangent(moved, t=t)
        body.product(u, moved, t)
    for name in ("internal_force", "tangent", "contact_force", "round_off"):
        found, expected = (getattr(one, name)(u) for one in (body, fresh))
        assert np.array_equal(*(getattr(one, "data", one) for one in (found, expected))), name


CHECKS = {name.removeprefix("check_"): check for name, check in list(globals().items()) if name.startswith("check_")}


@pytest.mark.few(24)
@pytest.mark.parametrize("check", CHECKS)
def test_contacts_meet_the_requirement(check, case):
    CHECKS[check](case)


def scaled(method, factor):
    def wrong(term):
        right = getattr(term, method)
        return lambda *given: factor * right(*given)

    return method, wrong


def with_energy(term):
    """Return a method whose energy jumps where the contact touches."""
    right = term.energy_and_force
    return lambda u, force=None: (W := right(u, force)) + 1e-3 * (W > 0) * right(np.zeros_like(u))


def stiffer(term):
    right = term.add_blocks

    def add_blocks(u, blocks, *kept):
        right(u, blocks, *kept)
        for part in (blocks.own, blocks.pairs):
            if part is not None:
                part *= 1.001

    return add_blocks


def of_the_end(term):
    """Return a mean force that is the force at the end."""

    def mean_force(u0, u1, weights, theta, force):
        force += sum(weights) * force_of(term, u1)
        return 0.0

    return mean_force


#: Faults by the check that finds them: method, and a function that returns a wrong one.
FAULTS = {
    "protocol": ("evaluated", lambda term: lambda u, right=term.evaluated: (1 + right(u)[0], *right(u)[1:])),
    "derivatives": ("energy_and_force", with_energy),
    "derivatives ": ("add_blocks", stiffer),
    "discrete_gradient": ("mean_force", of_the_end),
    "step_limit": scaled("contact_limit", 1.05),
    "step_limit ": scaled("contact_limit", 0.9),
}


@pytest.mark.parametrize(
    ("fault", "name"),
    [(fault, name) for name in ("toy", "sphere", "two bodies") for fault in FAULTS if "limit" not in fault or name != "toy"],
)
def test_planted_faults_are_found(fault, name):
    """Nothing passes the floor of the toy, so it has no limit that could be wrong."""
    case, (method, wrong) = CASES[name](), FAULTS[fault]
    term = case.system.bound_terms[1]
    setattr(term, method, wrong(term))
    with pytest.raises(AssertionError):
        CHECKS[fault.strip()](case)


@pytest.mark.parametrize("name", FLAT)
def test_areas_of_points_are_lengths_times_thickness_and_sections_of_bars(name):
    mesh = FLAT[name]
    law = StVK(young=1e3, poisson=0.3, **({"area": 0.2} if mesh.k == 1 else {"thickness": 0.2}))
    contact = RigidContact(RigidPlane((0,) * mesh.d, (1.0,) * mesh.d), lambda x: x[-1] == 0, stiffness=1.0)
    assert System(mesh, [law, contact]).bound_terms[1].areas.sum() == pytest.approx(0.2)


@pytest.mark.parametrize("name", ["toy", "two bodies"])
def test_a_false_declaration_of_balance_is_found(name):
    case = CASES[name]()
    term = case.system.bound_terms[1]
    term.balanced = not term.balanced
    with pytest.raises((AssertionError, AttributeError, TypeError, ValueError)):
        check_symmetry_and_balance(case)


def test_a_contact_that_does_not_look_is_found():
    case = meshed()
    case.system.bound_terms[1].look = lambda u: None
    with pytest.raises((AssertionError, IndexError, ValueError)):
        check_look(case)


@pytest.mark.parametrize("method", ["at", "advanced"])
def test_a_contact_that_changes_is_found(monkeypatch, method):
    """A contact that stays at its first moment, or that overwrites the history of the step before."""
    case = rigid(friction=RUBBING, motion=lambda t: (t, 0, 0))
    right = getattr(type(case.system.bound_terms[1]), method)

    def wrong(self, *given):
        if method == "at":
            return vars(self).setdefault("_memo", right(self, *given))
        found = right(self, *given)
        given[0][:] = found
        return given[0]

    monkeypatch.setattr(type(case.system.bound_terms[1]), method, wrong)
    with pytest.raises(AssertionError):
        check_explicit_state(case)
