"""Friction against closed forms: sliding, sticking and rolling, with every integrator, both contacts, near and far."""

import numpy as np
import pytest
import skfem
from terms.test_mesh_contact import by_node, deformed, pair

from skfem_stvk import (
    BackwardEuler,
    EnergyMomentum,
    ForwardEuler,
    Friction,
    GeneralizedAlpha,
    Gravity,
    LinearBackwardEuler,
    MeshContact,
    Newmark,
    Rayleigh,
    RigidBox,
    RigidContact,
    RigidMesh,
    RigidPlane,
    StVK,
    System,
    VelocityVerlet,
    simulate,
)
from skfem_stvk.edges import ALL
from skfem_stvk.mesh import ElementMesh, box
from skfem_stvk.solvers.dynamics.motion import Motion
from skfem_stvk.solvers.dynamics.record import MotionState
from skfem_stvk.system.free_tangent import EPS
from skfem_stvk.system.system import for_analysis
from skfem_stvk.terms.loads.load import Moment, StepStart

MU, G, SIZE, DENSITY = 0.3, 9.81, 0.1, 1e3
MASS, FAR = DENSITY * SIZE**3, 1000.0
STIFF = StVK(young=1e6, poisson=0.3, density=DENSITY)
RUBBING = Friction(MU, slip_speed=1e-3)
#: Distance of the barrier, and the gap at which it nearly carries the weight of the block.
DISTANCE, GAP = 4e-3, 3.97e-3
ALPHA = {f"GeneralizedAlpha, rho {rho}": GeneralizedAlpha(1e-3, rho=rho) for rho in (0.0, 0.5, 1.0)}
NEWTON = {one.name: one for one in (BackwardEuler(1e-3), Newmark(1e-3), EnergyMomentum(1e-3))} | ALPHA
EVERY = NEWTON | {one.name: one for one in (LinearBackwardEuler(1e-3), ForwardEuler(), VelocityVerlet())}


def at(mesh, x, height=0.0):
    """Return the mesh, displaced to `x` and to a height."""
    by = np.zeros((mesh.p.shape[0], 1))
    by[0], by[-1] = x, height
    return ElementMesh(mesh.p + by, mesh.t, element=mesh.element)


def block(contact, part, x=0.0):
    """Return a cube at `x` on a slope of `part` of the friction angle, with contact "rigid" or "mesh", and the angle."""
    angle = part * np.arctan(MU)
    down = Gravity((G * np.sin(angle), 0, -G * np.cos(angle)))
    mesh = at(box((SIZE,) * 3, (2, 2, 2) if contact == "rigid" else (1, 1, 1)), x, 0.0 if contact == "rigid" else GAP)
    if contact == "rigid":
        floor = RigidContact(RigidPlane((x, 0, 0), (0, 0, 1)), lambda p: p[2] == 0, friction=RUBBING, name="floor")
    else:
        table = at(box((0.4, 0.3, 0.1), (3, 2, 1)), x - 0.1, -0.1)
        table = RigidMesh((table.p - [[0], [0.1], [0]], table.surface))
        floor = MeshContact(None, table, distance=DISTANCE, friction=RUBBING, name="floor")
    return System(mesh, [STIFF, down, floor]), angle


def moved(system, integrator, speed=0.0, until=0.1, beta=1e-3):
    """Return the run of a damped body that starts with a speed along x."""
    v0 = np.zeros(system.mesh.p.T.shape)
    v0[:, 0] = speed
    return simulate(system, integrator, until=until, v0=v0.ravel(), damping=Rayleigh(beta=beta), quiet=True)


CASES = [("rigid", name, x) for name in EVERY for x in (0.0, FAR)] + [("mesh", name, FAR) for name in NEWTON]


@pytest.mark.few
@pytest.mark.parametrize(("contact", "name", "x"), CASES)
def test_a_block_slides_with_coulombs_acceleration_and_reports_coulombs_force(contact, name, x):
    system, angle = block(contact, 1.5, x)
    run = moved(system, EVERY[name])
    t, momentum = run.ledger["time"], run.ledger["linear_momentum_x"]
    half = len(t) // 2
    acceleration = (momentum[-1] - momentum[half]) / MASS / (t[-1] - t[half])
    assert acceleration == pytest.approx(G * (np.sin(angle) - MU * np.cos(angle)), rel=0.01)
    along, across, normal = run.contact("floor").resultant
    assert abs(across) < 1e-3 * normal and run.cuts == 0
    if contact == "rigid":  # the normals of a barrier are those of its pairs of triangles
        assert -along / normal == pytest.approx(MU, rel=0.01)


@pytest.mark.parametrize("name", EVERY)
def test_a_support_that_drags_a_block_over_a_floor_carries_its_friction(name):
    mesh, speed = at(box((SIZE,) * 3, (2, 2, 2)), 0.0, -1e-4), 0.1

    def bottom(x):
        return x[2] < 0

    floor = RigidContact(RigidPlane((0, 0, 0), (0, 0, 1)), bottom, friction=RUBBING, name="floor")
    system = System(mesh, [STIFF, floor], fixed={bottom: "yz"}, prescribed={bottom: {"x": lambda t: speed * t}})
    run = moved(system, EVERY[name], speed, until=0.01)
    force, N = run.reaction(bottom).resultant, run.contact("floor").resultant[2]
    assert N > 1.0 and abs(force[0] - MU * N) < 0.01 * MU * N and abs(force[2] + N) < 0.01 * N


@pytest.mark.few
@pytest.mark.parametrize(("contact", "name", "x"), CASES)
def test_a_block_that_stops_below_the_friction_angle_sticks_without_chatter(contact, name, x):
    """Its speed, with that of vibrations, falls below 1 % of that at the start, and does not alternate from step to step."""
    (system, angle), explicit = block(contact, 0.5, x), EVERY[name].explicit  # whose steps are shorter with more damping
    run = moved(system, EVERY[name], speed=0.1, until=0.12, beta=1e-3 if explicit else 4e-3)
    v = run.ledger["linear_momentum_x"] / MASS
    late = v[run.ledger["time"] > 0.09]
    change = np.diff(late)
    assert run.cuts == 0 and np.abs(late).max() < (4e-3 if explicit else 1e-3) and (change[1:] * change[:-1] < 0).mean() < 0.3
    lost, energy = run.ledger["friction_work"], MASS * 0.1**2 / 2
    assert lost[-1] == pytest.approx(energy / (1 - np.tan(angle) / MU), rel=0.2)
    assert np.diff(lost).min() >= 0


@pytest.mark.parametrize("name", [name for name in EVERY if name != "LinearBackwardEuler"])
def test_a_disc_that_slides_ends_rolling_with_two_thirds_of_its_speed(name):
    """Its circumference is a polygon: what it loses at the corners is within the tolerance."""
    mesh = at(ElementMesh.of(skfem.MeshTri.init_circle(3).scaled(0.1)), FAR, 0.1)
    law, floor = StVK(young=1e6, poisson=0.3, density=DENSITY), RigidPlane((FAR, 0), (0, 1))
    body = System(mesh, [law, Gravity((0, -G)), RigidContact(floor, friction=Friction(MU, slip_speed=5e-2), name="floor")])
    v0 = np.tile([1.0, 0.0], mesh.nv)
    run = simulate(body, EVERY[name], until=0.2, v0=v0, quiet=True)
    assert run.v[::2].mean() == pytest.approx(2 / 3, rel=0.04)
    energy = run.ledger["kinetic_energy"][0]
    assert run.ledger["friction_work"][-1] == pytest.approx(energy / 3, rel=0.1)
    assert run.ledger["closure_error"].max() < (1e-12 if name == "EnergyMomentum" else 0.01) * energy


@pytest.mark.parametrize("shape", ["plane", "box", "rounded box"])
@pytest.mark.parametrize("kind", ["tetrahedra", "hexahedra", "quadratic tetrahedra"])
def test_energy_momentum_does_not_stop_where_an_undamped_body_sticks(kind, shape):
    mesh = at(ElementMesh.of(skfem.MeshHex().refined(1).scaled(SIZE)) if kind == "hexahedra" else box((SIZE,) * 3, (2, 2, 2)), FAR)
    mesh = mesh.with_degree(2) if kind == "quadratic tetrahedra" else mesh
    table = RigidBox((FAR - 1, -1, -1), (FAR + 1, 1, 0), radius=0.05 if shape == "rounded box" else 0.0)
    table = RigidPlane((FAR, 0, 0), (0, 0, 1)) if shape == "plane" else table
    body = System(mesh, [STIFF, Gravity((1.7, 0, -9.66)), RigidContact(table, friction=RUBBING)])
    run = simulate(body, EnergyMomentum(1e-3), until=0.04, quiet=True)
    assert run.cuts == 0 and np.abs(run.v[::3].mean()) < 5e-3
    assert np.abs(run.ledger["closure_error"]).max() < 1e-10 * run.ledger["kinetic_energy"].max()


def rubbing(contact, x=0.0):
    """Return a block in an analysis in time that touches and slips, its displacements (nv, d), and those before the step."""
    body = block(contact, 0.5, x)[0]
    system = for_analysis(body, in_time=True)
    rng = np.random.default_rng(1)
    start = 1e-5 * rng.normal(size=(system.mesh.nv, 3)) - [0, 0, 1e-5]
    return system, start + 2e-7 * rng.normal(size=start.shape), start


def friction_at(system, u, start):
    """Return the friction (nv, 3) [N] at `u`, after a step of 1 ms from `start`."""
    motion, forces = Motion(system, None, None), np.zeros((2, *u.shape))
    motion.begin_step(system.advanced(system.first_history(), start.ravel(), motion.moment(0.0)))
    for t, force in zip((1e-3, 0.0), forces, strict=True):
        (term,) = system.contacts_at(motion.moment(t))
        term.energy_and_force(u, force)
    return forces[0] - forces[1]


@pytest.mark.parametrize("contact", ["rigid", "mesh"])
def test_friction_is_the_same_far_from_the_origin(contact):
    near, far = (friction_at(*rubbing(contact, x)) for x in (0.0, FAR))
    assert np.abs(near - far).max() < 1e-7 * np.abs(near).max() and np.abs(near[:, :2]).max() > 1e-3


@pytest.mark.parametrize("contact", ["rigid", "mesh"])
def test_the_round_off_of_friction_counts_displacements(contact):
    """A displacement by 1/3 km rounds the slips. The errors are within the estimate, and above that of the normal force alone."""
    system, u, start = rubbing(contact)
    if contact == "mesh":
        system = for_analysis(pair(friction=RUBBING, law=STIFF)[0], in_time=True)
        start = by_node(deformed(system)[0])
        u = start + 2e-7 * np.random.default_rng(2).normal(size=start.shape)
    far = np.array([FAR / 3, 0, 0])
    near = friction_at(system, u, start)
    error = np.abs(friction_at(system, u + far, start + far) - near)
    sums, without = np.zeros((2, *u.shape))
    history = system.advanced(system.first_history(), (start + far).ravel(), 0.0)
    for t, out in ((1e-3, sums), (0.0, without)):
        (term,) = system.contacts_at(Moment(t, 1.0, step=StepStart(history, in_time=True)))
        term.add_round_off(u + far, out)
    if contact == "mesh":  # the barrier's own is larger far from the origin
        sums -= without
        without[:] = 0
    assert (error <= EPS * sums).all() and (error > EPS * without).any()


@pytest.mark.few
@pytest.mark.parametrize("contact", ["rigid", "mesh"])
@pytest.mark.parametrize("name", NEWTON)
def test_the_matrix_of_a_step_has_the_friction_of_its_equation(contact, name):
    system, u, start = rubbing(contact)
    integrator = NEWTON[name]
    motion = Motion(system, None, None)
    stepper, state = integrator.stepper(motion), MotionState.at(0.0, start.ravel(), 0 * start.ravel())
    motion.begin_step(system.advanced(system.first_history(), state.u, motion.moment(0.0)))
    problem, moment = stepper.problem, motion.moment(1e-3)
    problem.begin(state, integrator.coefficients(state, 1e-3, stepper))
    w, v, h = (u - start).ravel(), np.random.default_rng(2).normal(size=u.size), 1e-10
    ends = [problem.residual(w + s * h * v, moment).vector for s in (1, -1)]
    problem.residual(w, moment)
    change = (ends[0] - ends[1]) / (2 * h)
    K = problem.matrix._matrix(w, moment, ALL)
    limit = 0.02 if name == "EnergyMomentum" else 1e-5  # its matrix is a substitute
    assert np.linalg.norm(K @ v - change) < limit * np.linalg.norm(change)
