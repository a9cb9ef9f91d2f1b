"""Contact with rigid shapes: exact derivatives and works, closed forms of friction, and balances of whole analyses."""

import re
import sys
import threading
import warnings

import numpy as np
import pytest
import skfem
from terms.toys import in_step

from skfem_stvk import (
    Anisotropic,
    BackwardEuler,
    ContactError,
    EnergyMomentum,
    Friction,
    Gravity,
    LinearBackwardEuler,
    NeoHookean,
    Rayleigh,
    ReducedSystem,
    RigidBox,
    RigidContact,
    RigidCylinder,
    RigidPlane,
    RigidSphere,
    Simulation,
    SimulationError,
    StVK,
    StvkError,
    StvkWarning,
    SupportError,
    System,
    Traction,
    VelocityVerlet,
    critical_step,
    modes,
    simulate,
    solve_static,
)
from skfem_stvk.mesh import ElementMesh, box
from skfem_stvk.solvers.dynamics import steps
from skfem_stvk.solvers.dynamics.motion_checkpoint import MotionCheckpoint
from skfem_stvk.solvers.runs.archive import read_archive, write_archive
from skfem_stvk.terms.loads.load import Moment, StepStart

LAW = StVK(young=1e3, poisson=0.3, density=1.0)
MESHES = {
    "tetrahedra": box((1.0, 1.0, 1.0), (3, 3, 3)),
    "quadratic tetrahedra": box((1.0, 1.0, 1.0), (1, 1, 1)).with_degree(2),
    "hexahedra": ElementMesh.of(skfem.MeshHex().refined(1)),
    "membrane": ElementMesh(*(lambda m: (np.vstack([m.p, 0.2 + 0 * m.p[:1]]), m.t))(skfem.MeshTri().refined(2))),
}
SHAPES = {
    "plane": RigidPlane((0, 0, 0.3), (0.1, 0.2, 1)),
    "sphere": RigidSphere((0.5, 0.5, -0.4), 0.7),
    "inside a sphere": RigidSphere((0.5, 0.5, 0.5), 0.6, inside=True),
    "cylinder": RigidCylinder((0.5, 0.5, -0.3), (0.3, 1, 0.2), 0.6),
    "inside a cylinder": RigidCylinder((0.5, 0.5, 0.5), (0.3, 1, 0.2), 0.45, inside=True),
    "box": RigidBox((0.1, 0.2, -0.75), (0.9, 0.8, 0.4)),
    "rounded box": RigidBox((0.1, 0.2, -0.75), (0.9, 0.8, 0.4), radius=0.25),
}


def BOTTOM(x):
    return x[2] == 0


def TOP(x):
    return x[2] == 1


#: Supports that leave translation along z free.
UPRIGHT = {lambda x: (x[0] == 0) & (x[1] == 0): "xy", lambda x: (x[0] == 1) & (x[1] == 0): "y"}


def bound(mesh="tetrahedra", shape="sphere", **options):
    """Return a body without and with a contact, the bound contact, and a state with velocities of size 1."""
    law = StVK(young=1e3, poisson=0.3, thickness=0.1) if mesh == "membrane" else LAW
    contact = RigidContact(SHAPES[shape], stiffness=1e4, **options)
    without, body = System(MESHES[mesh], [law]), System(MESHES[mesh], [law, contact])
    u, v = np.random.default_rng(0).normal(size=(2, body.ndofs))
    return without, body, body.bound_terms[1], 0.02 * u, v / np.abs(v).max()


def of_vertices(x):
    return x.reshape(-1, 3)


def force(term, u):
    out = np.zeros_like(of_vertices(u))
    term.energy_and_force(of_vertices(u), out)
    return out.ravel()


def slope(f, h=1e-6):
    return (f(h) - f(-h)) / (2 * h)


@pytest.mark.parametrize("shape", ["sphere", "cylinder", "box"])
def test_the_limit_is_the_deepest_point_on_a_way_through(shape):
    term, u = bound(shape=shape)[2:4]
    x, down = of_vertices(u), np.tile([0.0, 0.0, -1.0], (MESHES["tetrahedra"].nv, 1))
    above = x - 2 * down
    limit = term.contact_limit(above, down)
    depths = []
    for s in np.linspace(0, 5, 2001):
        gaps = term.evaluated(above + s * down)[1]
        depths.append(gaps[np.isfinite(gaps)])
    depths = np.array(depths)
    through = depths.min(axis=0) < -1e-3
    deepest = depths[:, through].argmin(axis=0).min() * 5 / 2000
    assert limit == pytest.approx(deepest, abs=0.02) if shape != "box" else deepest < limit < 2.5  # the middle of the way through
    assert term.name == "contact"
    assert term.contact_limit(above, -down) == np.inf
    assert bound(shape="plane")[2].contact_limit(x, down) == bound(shape="inside a sphere")[2].contact_limit(x, down) == np.inf


def test_a_block_on_a_plane_has_a_constant_pressure():
    mesh = box((1.0, 1.0, 1.0), (4, 4, 4))
    floor = RigidContact(RigidPlane((0, 0, 0), (0, 0, 1)), BOTTOM, name="floor")
    lid = RigidContact(RigidPlane((0, 0, 1), (0, 0, -1)), TOP, name="lid", motion=(0, 0, -0.1))
    body = System(mesh, [NeoHookean(young=1e3, poisson=0.0), floor, lid], fixed=UPRIGHT)
    result = solve_static(body, quiet=True)
    state = result.contact("floor")
    pressed = state.pressure[state.pressure > 0]
    assert len(pressed) == 25 and np.ptp(pressed) < 1e-10 * pressed.max() and state.area == pytest.approx(1.0)
    assert state.resultant == pytest.approx([0, 0, pressed[0]], abs=1e-9)
    assert result.contact("lid").resultant == pytest.approx(-state.resultant, abs=1e-6)
    assert state.gap.min() == pytest.approx(-pressed[0] / (10 * 1e3 / ((2 + np.sqrt(2)) / 3 / 4)), rel=1e-6)
    assert "contact 'floor': (" in repr(state)
    with pytest.raises(ContactError, match=r"name = 'wall'; expected a contact of the body; known: 'floor', 'lid'"):
        result.contact("wall")


def dropped(contact, integrator, until=0.03, **options):
    mesh = box((0.1, 0.1, 0.1), (3, 3, 3))
    terms = [StVK(young=3e4, poisson=0.4, density=1000.0), Gravity((0, 0, -9.81)), contact]
    v0 = np.zeros((mesh.nv, 3))
    v0[:, 2], v0[:, 0] = -0.5, 0.2 + 2 * mesh.p[2]
    return simulate(System(mesh, terms), integrator, until=until, v0=v0.ravel(), quiet=True, **options)


def floor(**options):
    return RigidContact(RigidPlane((0, 0, -2e-3), (0, 0, 1)), name="floor", **options)


@pytest.mark.parametrize(
    "contact",
    [
        floor(),
        floor(stiffness=1e8, onset=1e-3),
        RigidContact(RigidSphere((0.05, 0.05, -0.1), 0.095)),
        RigidContact(RigidBox((-0.1, -0.1, -0.1), (0.05, 0.2, -0.002), radius=0.01)),
        RigidContact(RigidPlane((0, 0, -2e-3), (0, 0, 1)), motion=lambda t: (0.1 * t, 0, 0.2 * t)),
        floor(friction=Friction(0.3, slip_speed=0.1)),
        RigidContact(RigidSphere((0.05, 0.05, -0.1), 0.095), motion=lambda t: (0, t, t), friction=Friction(0.5, slip_speed=0.1)),
    ],
    ids=["plane", "stiff plane", "sphere", "box", "moving plane", "friction", "moving sphere with friction"],
)
def test_energy_is_kept_but_for_friction_and_the_work_of_the_shape(contact):
    run = dropped(contact, EnergyMomentum(1e-3))
    kinetic = run.ledger["kinetic_energy"][0]
    assert run.success and np.abs(run.ledger["closure_error"]).max() < 1e-12 * kinetic
    assert np.abs(run.ledger["strain_energy RigidContact 2"]).max() > 1e-3 * kinetic
    assert (run.ledger["dissipated_work"][-1] > 1e-3 * kinetic) == (contact.friction is not None) == ("friction_work" in run.ledger)
    if contact.friction is not None:
        damped = dropped(contact, EnergyMomentum(1e-3), damping=Rayleigh(10.0, 1e-4))
        assert np.abs(damped.ledger["closure_error"]).max() < 1e-12 * kinetic
        assert np.array_equal(run.ledger["friction_work"], run.ledger["dissipated_work"])
        assert 1e-3 * kinetic < damped.ledger["friction_work"][-1] < 0.9 * damped.ledger["dissipated_work"][-1]
    assert (abs(run.ledger["external_work"][-1]) > 1e-3 * kinetic) == (contact.motion is not None)


def test_critical_steps_count_shapes_before_they_touch():
    run = dropped(floor(), VelocityVerlet())
    assert run.blow_ups == 0 and np.abs(run.ledger["closure_error"]).max() < 0.03 * run.ledger["kinetic_energy"][0]
    mesh = box((0.1, 0.1, 0.1), (3, 3, 3))
    law, far = StVK(young=3e4, poisson=0.4, density=1000.0), RigidContact(RigidPlane((0, 0, -9), (0, 0, 1)))
    assert critical_step(System(mesh, [law, far])).step < 0.7 * critical_step(System(mesh, [law])).step


@pytest.mark.parametrize("shape", ["plane", "sphere", "cylinder"])
@pytest.mark.parametrize("mesh", ["tetrahedra", "quadratic tetrahedra", "hexahedra"])
def test_friction_opposes_the_slip_and_has_the_derivative_of_its_force(mesh, shape):
    """Some points stick and others slide: the width is that of the middle slip."""
    friction = Friction(0.4, slip_speed=0.8)
    without, body, _, u, v = bound(mesh, shape, friction=friction)
    contact, plain, law = body.bound_terms[1], bound(mesh, shape)[2], without.internal_force
    begin, history = in_step(contact, of_vertices(u), 1.0, 1.0)
    assert np.array_equal(force(begin, u), force(plain, u)) and np.array_equal(force(begin, u + v), force(plain, u + v))
    end = Moment(1.01, 1.0, step=StepStart((history,), in_time=True))
    term = contact.at(end, history)
    slip = 0.02 * v
    rub = force(term, u + slip) - force(plain, u + slip)
    assert np.array_equal(force(term, u), force(plain, u)) and rub @ slip > 0
    pushed = np.zeros_like(of_vertices(u))
    plain.energy_and_force(of_vertices(u), pushed)
    sizes, most = np.linalg.norm(of_vertices(rub), axis=1), 0.4 * np.linalg.norm(pushed, axis=1)
    if mesh == "tetrahedra":  # points are vertices: Coulomb's limit, reached by some
        touching = most > 0
        assert (sizes <= most * (1 + 1e-12)).all()
        assert 0 < np.count_nonzero(sizes[touching] < 0.99 * most[touching]) < np.count_nonzero(touching)
        normals = pushed[touching] / np.linalg.norm(pushed[touching], axis=1, keepdims=True)
        assert np.abs((of_vertices(rub)[touching] * normals).sum(axis=1)).max() < 1e-12 * sizes.max()
    K = (body.tangent(u + slip, t=end) - without.tangent(u + slip)).toarray()
    change = slope(lambda s: body.internal_force(u + slip + s * v, end) - law(u + slip + s * v))
    assert np.abs(K @ v - change).max() < 1e-5 * np.abs(change).max() and np.abs(K - K.T).max() < 1e-10 * np.abs(K).max()

    def twice(s):
        f = np.zeros_like(of_vertices(u))
        term.mean_force(of_vertices(u), of_vertices(u + slip + s * v), (1.0, 1.0), 0.5, f)
        return f.ravel() - of_mean(s)

    def of_mean(s):
        f = np.zeros_like(of_vertices(u))
        plain.mean_force(of_vertices(u), of_vertices(u + slip + s * v), (1.0, 1.0), 0.5, f)
        return f.ravel()

    states = of_vertices(u), of_vertices(u + slip)
    still = System(MESHES[mesh], [LAW, RigidContact(SHAPES[shape], stiffness=1e4)])
    of_friction = body.tangent(u + slip, t=end.assuming(states)) - still.tangent(u + slip, t=end.assuming(states))
    assert np.abs(of_friction @ v - slope(twice)).max() < 1e-5 * np.abs(slope(twice)).max()
    linear_end = end._replace(step=end.step._replace(predicted=of_vertices(u + slip)))
    term = contact.at(linear_end, history)
    assert np.abs(force(term, u + slip) - force(plain, u + slip) - rub).max() < 1e-12 * np.abs(rub).max()
    linear = force(term, u + 3 * slip) - force(plain, u + 3 * slip)
    assert np.abs(linear - 3 * rub).max() < 1e-10 * np.abs(rub).max()
    K = body.tangent(u, t=linear_end) - still.tangent(u)
    assert np.abs(K @ slip - rub).max() < 1e-10 * np.abs(rub).max()


MU, G, SLIP = 0.3, 9.81, 1e-3


def slid(part, integrator, start=None):
    """Return the speeds of a block on a slope of `part` of the friction angle, over the steps."""
    mesh, angle = box((0.1, 0.1, 0.05), (2, 2, 1)), part * np.arctan(MU)
    k = 4e8
    slope = RigidContact(RigidPlane((0, 0, 0), (0, 0, 1)), BOTTOM, stiffness=k, friction=Friction(MU, slip_speed=SLIP))
    down = Gravity((G * np.sin(angle), 0, -G * np.cos(angle)))
    u0 = np.tile([0, 0, -1000 * G * np.cos(angle) * 0.05 / k], (mesh.nv, 1))
    body = System(mesh, [StVK(young=1e6, poisson=0.2, density=1000.0), slope, down])
    run = simulate(body, integrator, until=0.2, u0=u0.ravel(), quiet=True)
    return angle, np.array(run.ledger["time"]), run.ledger["linear_momentum_x"] / (1000 * 0.1 * 0.1 * 0.05)


def test_a_block_below_the_friction_angle_creeps():
    angle, _, speed = slid(0.99, BackwardEuler(2e-3))
    assert speed[-1] / SLIP == pytest.approx(1 - np.sqrt(1 - np.tan(angle) / MU), rel=1e-3)


@pytest.mark.parametrize("integrator", [BackwardEuler(2e-3), LinearBackwardEuler(2e-3, rtol=1e-6)], ids=lambda one: one.name)
def test_a_belt_drags_a_block_with_coulombs_acceleration_up_to_its_speed(integrator):
    mesh, k, speed = box((0.1, 0.1, 0.05), (2, 2, 1)), 4e8, 0.3
    friction = Friction(MU, slip_speed=SLIP)
    belt = RigidContact(RigidPlane((0, 0, 0), (0, 0, 1)), BOTTOM, k, friction, motion=lambda t: (speed * t, 0, 0))
    u0 = np.tile([0, 0, -1000 * G * 0.05 / k], (mesh.nv, 1))
    body = System(mesh, [StVK(young=1e6, poisson=0.2, density=1000.0), belt, Gravity((0, 0, -G))])
    run = simulate(body, integrator, until=0.2, u0=u0.ravel(), quiet=True)
    t, found = np.array(run.ledger["time"]), run.ledger["linear_momentum_x"] / (1000 * 0.1 * 0.1 * 0.05)
    half = len(t) // 4
    assert found[half] / t[half] == pytest.approx(MU * G, rel=0.05) and found[-1] == pytest.approx(speed, rel=1e-2)


@pytest.mark.parametrize(
    "integrator",
    [EnergyMomentum(1e-3), BackwardEuler(1e-3), LinearBackwardEuler(1e-3), VelocityVerlet(1e-4)],
    ids=lambda one: one.name,
)
def test_friction_and_moving_shapes_are_resumed_and_restored_to_the_last_bit(integrator, tmp_path):
    contact = RigidContact(
        RigidPlane((0, 0, -1e-4), (0, 0, 1)), motion=lambda t: (0, 0, 0.1 * t), friction=Friction(0.3, slip_speed=0.05)
    )
    whole = dropped(contact, integrator, 0.012)
    dropped(contact, integrator, 0.006, checkpoint=tmp_path)
    resumed = dropped(contact, integrator, 0.012, checkpoint=tmp_path, resume=True)
    assert np.array_equal(resumed.u, whole.u) and np.array_equal(resumed.ledger.rows(), whole.ledger.rows())
    assert np.abs(whole.contact("contact").resultant).min() > 0
    sim = Simulation(whole.system, integrator, v0=whole.v, u0=whole.u, t0=whole.t)
    for _ in range(5):
        sim.step()
    saved = sim.copy_state()
    for _ in range(5):
        sim.step()
    u, total = sim.u, sim.contact("contact").resultant
    sim.restore(saved)
    for _ in range(5):
        sim.step()
    assert np.array_equal(sim.u, u) and np.array_equal(sim.contact("contact").resultant, total)


def test_simulations_of_one_body_in_threads_do_not_affect_each_other():
    """Energy-momentum takes the tangent of the mean force, backward Euler that of the state, explicit steps that of all points."""
    mesh = box((0.1, 0.1, 0.1), (2, 2, 2))
    body = System(mesh, [StVK(young=3e4, poisson=0.4, density=1000.0), Gravity((0, 0, -9.81)), floor()])
    v0 = np.tile([0.1, 0, -0.5], mesh.nv)
    integrators = {"mean": EnergyMomentum(1e-3), "end": BackwardEuler(1e-3), "explicit": VelocityVerlet()}
    found = {}

    def go(name, how):
        sim = Simulation(body, integrators[name], v0=v0)
        sim.step(until=0.02)
        found[how, name] = sim.u

    for name in integrators:
        go(name, "alone")
    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        threads = [threading.Thread(target=go, args=(name, "together")) for name in integrators]
        for one in threads:
            one.start()
        for one in threads:
            one.join()
    finally:
        sys.setswitchinterval(interval)
    for name in integrators:
        assert np.array_equal(found["together", name], found["alone", name])


def thrown(stiffness=1e9, cells=2, speed=100.0, rests=True):
    """Return a block above a ball of 6 cm, and its velocities: the block falls on the ball, or the ball is thrown at the block."""
    mesh, motion = box((0.1, 0.1, 0.1), (cells,) * 3), None if rests else lambda t: (0, 0, speed * t)
    ball = RigidContact(RigidSphere((0.05, 0.05, -0.1), 0.06), stiffness=stiffness, motion=motion, name="ball")
    rubber = NeoHookean(young=3e7, poisson=0.3, density=1000.0)
    return System(mesh, [rubber, ball]), np.tile([0, 0, -speed * rests], mesh.nv)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda one: one[:-1], "the history of RigidContact 'floor' is .*; expected"),
        (lambda one: np.where(np.arange(len(one)) == 9, np.nan, one), "the history of RigidContact 'floor'"),
        (None, "history.0: it has no array 'history 0'"),
    ],
)
def test_a_checkpoint_with_a_damaged_history_is_refused(change, words, tmp_path):
    contact = floor(friction=Friction(0.3, slip_speed=0.05))
    dropped(contact, BackwardEuler(1e-3), 0.005, checkpoint=tmp_path)
    header, arrays = read_archive(tmp_path / "motion.npz", MotionCheckpoint.known, "")
    history = arrays.pop("history 0")
    write_archive(tmp_path / "motion.npz", header, arrays if change is None else arrays | {"history 0": change(history)})
    with pytest.raises(StvkError, match=f"is damaged: {words}"):
        dropped(contact, BackwardEuler(1e-3), 0.01, checkpoint=tmp_path, resume=True)


@pytest.mark.parametrize("rests", [True, False], ids=["the block moves", "the ball moves"])
@pytest.mark.parametrize("integrator", [LinearBackwardEuler, BackwardEuler, EnergyMomentum], ids=lambda one: one.__name__)
def test_nothing_passes_through_a_ball_in_one_step(integrator, rests):
    """At 100 m/s a block passes a ball of 6 cm in one step of 4 ms: no such step is accepted."""
    body, v0 = thrown(rests=rests)
    sim = Simulation(body, integrator(4e-3), v0=v0)
    with pytest.raises(SimulationError):
        sim.step()
    assert sim.t == 0 and not sim.u.any()
    body, v0 = thrown(3e10, 4, 20.0, rests)
    run = simulate(body, integrator(1e-4), until=8e-3, v0=v0, quiet=True)
    height = body.mesh.p[2].mean() + run.u.reshape(-1, 3)[:, 2].mean() - (0 if rests else 20.0 * run.t)
    assert run.success and run.ledger["strain_energy RigidContact 1"].max() > 1.0 and height > 0


def test_the_halves_of_a_step_that_would_pass_are_two_steps_of_half_the_length():
    """Forces that equation 9 has stored for the next step are those of the state before, not of the state that was refused."""
    body, v0 = thrown(1e9)
    halved = Simulation(body, LinearBackwardEuler(1.6e-3), v0=v0, halvings=1)
    half = Simulation(body, LinearBackwardEuler(0.8e-3), v0=v0)
    halved.step()
    half.step()
    half.step()
    assert np.array_equal(halved.u, half.u) and half.contact("ball").resultant[2] > 1.0
    with pytest.raises(SimulationError, match="the body would pass through a contact: 'ball'"):
        Simulation(body, LinearBackwardEuler(1.6e-3), v0=v0).step()


@pytest.mark.parametrize("integrator", [EnergyMomentum, LinearBackwardEuler, VelocityVerlet])
def test_a_shape_that_is_too_soft_for_the_speed_is_named_with_its_stiffness(integrator):
    """Smaller steps fail alike; a larger stiffness does not."""
    cube, plate = box((1.0, 1.0, 1.0), (2, 2, 2)), RigidBox((-1, -1, -0.3), (2, 2, -0.1))
    v0, law = np.tile([0, 0, -2.0], cube.nv), StVK(young=1e7, poisson=0.3, density=1e3)

    def dropped(k, dt):
        system = System(cube, [law, RigidContact(plate, stiffness=k, name="plate")])
        return simulate(system, integrator(dt), until=0.13, v0=v0, quiet=True, raise_on_failure=False)

    dt = 2e-3 if integrator is VelocityVerlet else 1e-2
    for smaller in (1, 20):
        run = dropped(1e5, dt / smaller)
        found = re.search(r"'plate' is too soft: with its stiffness of 1e\+05 \[N/m\^3\] the body gets (\S+) m deep", run.message)
        assert not run.success and float(found[1]) == pytest.approx(2 * np.sqrt(1e3 / 1e5), rel=0.3)
        assert "less than half of the thickness of the shape, 0.1 m. Take a larger stiffness." in run.message
        assert "smaller" not in run.message
    assert dropped(1e6, dt).success


def test_a_step_that_is_too_large_for_a_shape_is_not_blamed_on_its_stiffness():
    cube, plate = box((1.0, 1.0, 1.0), (2, 2, 2)), RigidBox((-1, -1, -0.3), (2, 2, -0.1))
    system = System(cube, [StVK(young=1e7, poisson=0.3, density=1e3), RigidContact(plate, stiffness=1e9)])
    v0 = np.tile([0, 0, -20.0], cube.nv)
    run = simulate(system, LinearBackwardEuler(10.0), until=10.0, v0=v0, quiet=True, raise_on_failure=False)
    assert "would pass through a contact: 'contact'. Try a smaller dt" in run.message and "soft" not in run.message


def test_half_the_thickness_of_a_shape_is_where_points_are_pushed_out_on_the_other_side():
    shapes = {
        RigidBox((0, 0, 0), (2, 1, 3)): 0.5,
        RigidSphere((0, 0, 0), 0.3): 0.3,
        RigidSphere((0, 0, 0), 0.3, True): np.inf,
        RigidCylinder((0, 0, 0), (1, 0, 0), 0.2): 0.2,
        RigidCylinder((0, 0, 0), (1, 0, 0), 0.2, True): np.inf,
        RigidPlane((0, 0, 0), (0, 0, 1)): np.inf,
    }
    assert {shape: shape.thickness / 2 for shape in shapes} == shapes


def test_without_the_check_a_block_passes_through_a_ball(monkeypatch):
    body, v0 = thrown()
    monkeypatch.setattr(steps, "_passed_contact", lambda *given: "")
    sim = Simulation(body, LinearBackwardEuler(4e-3), v0=v0)
    sim.step()
    assert (body.mesh.p[2] + sim.u.reshape(-1, 3)[:, 2]).max() < -0.16


@pytest.mark.parametrize(
    ("shape", "aside", "passes"),
    [
        ("sphere", 0.0, True),
        ("sphere", 0.6 * 0.7, True),
        ("sphere", 0.8 * 0.7, False),
        ("cylinder", 0.0, True),
        ("cylinder", 0.9 * 0.6, False),
        ("box", 0.0, True),
        ("inside a sphere", 0.0, False),
        ("plane", 0.0, False),
    ],
)
def test_points_pass_where_they_leave_on_the_other_side(shape, aside, passes):
    """Lines that graze a sphere or a cylinder, at an angle of less than a right one between the normals, do not pass it."""
    _, body, term, u, _ = bound(shape=shape)
    start = np.tile([0.5 + aside, 0.5, 5.0], (len(u) // 3, 1)) - body.mesh.p.T  # all nodes at one point, above the shape
    fall = np.tile([0, 0, -12.0], (len(u) // 3, 1))
    assert term.passes(start, start + fall) == passes
    assert not term.passes(start, start + 0.3 * fall)


def test_the_default_stiffness_is_ten_times_the_modulus_behind_each_facet_over_its_size():
    mesh = box((1.0, 1.0, 1.0), (4, 4, 4))
    young = np.where(mesh.p[0, mesh.t].mean(axis=0) < 0.5, 1e3, 5e3)
    plane = RigidContact(RigidPlane((0, 0, 0), (0, 0, 1)), BOTTOM)
    depth, h = 1e-3, (2 + np.sqrt(2)) / 3 / 4
    u = np.tile([0, 0, -depth], mesh.nv).reshape(-1, 3)
    for flipped in (False, True):
        t = mesh.t[[1, 0, 2, 3]] if flipped else mesh.t
        term = System(ElementMesh(mesh.p, t), [StVK(young=young, poisson=0.3), plane]).bound_terms[1]
        assert term.energy_and_force(u) == pytest.approx(10 * (1e3 + 5e3) / 2 / h * depth**2 / 2, rel=1e-12)
        force = np.zeros_like(u)
        term.energy_and_force(u, force)
        soft, stiff = (force[(mesh.p[0] == x) & (mesh.p[1] == 0.5) & (mesh.p[2] == 0), 2] for x in (0.25, 0.75))
        assert stiff == pytest.approx(5 * soft)


def test_damping_by_the_stiffness_at_rest_leaves_contacts_out(tmp_path):
    """K(0) is computed once. With contacts in it, it would depend on the time at which it was computed."""
    contact = RigidContact(
        RigidPlane((0, 0, 1e-3), (0, 0, 1)), motion=lambda t: (0, 0, 0.1 * t), friction=Friction(0.3, slip_speed=0.05)
    )
    for integrator in (BackwardEuler(1e-3), LinearBackwardEuler(1e-3), EnergyMomentum(1e-3), VelocityVerlet(5e-5)):
        options, folder = {"damping": Rayleigh(1.0, 1e-4)}, tmp_path / integrator.name
        whole = dropped(contact, integrator, 0.01, **options)
        dropped(contact, integrator, 0.005, checkpoint=folder, **options)
        assert np.array_equal(dropped(contact, integrator, 0.01, checkpoint=folder, resume=True, **options).u, whole.u)
    body = whole.system
    K = System(body.mesh, body.terms[:1]).tangent(np.zeros(body.ndofs))
    v = np.cos(np.arange(body.ndofs))
    assert np.abs(whole.motion.at_rest @ v - K @ v).max() < 1e-12 * np.abs(K @ v).max()
    assert np.abs(body.product(np.zeros(body.ndofs), v) - K @ v).max() > 0.1 * np.abs(K @ v).max()
    with pytest.raises(StvkError, match="tangent='rest' would leave out the stiffness of contacts"):
        dropped(contact, LinearBackwardEuler(1e-3, tangent="rest"))


def test_a_contact_that_touches_holds_a_body():
    mesh = box((1.0, 1.0, 1.0), (2, 2, 2))
    held = System(mesh, [LAW, Gravity((0, 0, -1.0)), RigidContact(RigidPlane((0, 0, 0), (0, 0, 1)), BOTTOM)], UPRIGHT)
    assert solve_static(held, quiet=True).contact("contact").resultant[2] == pytest.approx(1.0, rel=1e-6)
    apart = RigidContact(RigidPlane((0, 0, -0.1), (0, 0, 1)), BOTTOM)
    with pytest.raises(SupportError, match=r"translation along z.*A contact holds a body along its normals alone.*damping"):
        solve_static(System(mesh, [LAW, Gravity((0, 0, -1.0)), apart], UPRIGHT), quiet=True)


@pytest.mark.parametrize("mesh", ["quadratic tetrahedra", "hexahedra"])
def test_a_block_between_two_planes_that_it_touches_exactly_is_pressed(mesh):
    """Points between vertices are at gaps of 1e-17 m then, and their forces at the start are round-off."""
    floor = RigidContact(RigidPlane((0, 0, 0), (0, 0, 1)), BOTTOM, stiffness=1e4, name="floor")
    lid = RigidContact(RigidPlane((0, 0, 1), (0, 0, -1)), TOP, stiffness=1e4, motion=(0, 0, -0.1), name="lid")
    body = System(MESHES[mesh], [LAW, floor, lid], UPRIGHT)
    start = np.zeros(body.ndofs)
    assert 0 < np.abs(body.internal_force(start)).max() <= np.finfo(float).eps * body.round_off(start).max()
    assert solve_static(body, quiet=True).contact("floor").resultant[2] > 50


def test_friction_carries_a_part_of_a_static_load():
    """A pressed block is pulled: friction takes its share of what its supports took before, at most the coefficient."""
    mesh, held = box((1.0, 1.0, 1.0), (2, 2, 2)), {TOP: "xy"}
    for friction, share in ((None, 0.0), (Friction(0.2, slip_length=1e-5), 0.2)):
        plane = RigidContact(RigidPlane((0, 0, 0), (0, 0, 1)), BOTTOM, stiffness=1e5, friction=friction)
        pulled = Traction(BOTTOM, lambda t: (100 * max(0.0, t - 0.5), 0, 0))
        pressed = System(mesh, [LAW, plane, pulled, Traction(TOP, lambda t: (0, 0, -40 * min(1.0, 2 * t)))], held)
        force = solve_static(pressed, steps=10, quiet=True).contact("contact").resultant
        assert force == pytest.approx([-share * 40, 0, 40], rel=2e-3, abs=0.05)


AROUND = {  # shapes with the cube of 1 m on the wrong side, the depth of its deepest node, and the side on which it belongs
    "plane": (RigidPlane((0, 0, 0), (0, 0, -1)), 1.0, RigidPlane((0, 0, 0), (0, 0, 1))),
    "inclined plane": (RigidPlane((0, 0, 0), (-1, -1, -1)), 3**0.5, RigidPlane((0, 0, 0), (1, 1, 1))),
    "sphere": (RigidSphere((0.5, 0.5, 0.5), 1.0), 1.0, RigidSphere((0.5, 0.5, 0.5), 1.0, inside=True)),
    "hollow sphere": (RigidSphere((0.5, 0.5, -1), 0.9, inside=True), 4.5**0.5 - 0.9, RigidSphere((0.5, 0.5, -1), 0.9)),
    "cylinder": (RigidCylinder((0.5, 0.5, 0), (0, 0, 1), 1.0), 1.0, RigidCylinder((0.5, 0.5, 0), (0, 0, 1), 1.0, inside=True)),
    "box": (RigidBox((-0.1, -0.2, -0.1), (1.1, 1.1, 3)), 0.6, RigidBox((-0.1, -0.2, -1), (1.1, 1.1, -0.1))),
}
HELD = {lambda x: x[2] == 1: "xyz"}


def starts(mesh, contact, held=HELD, **start):
    """Yield calls that begin an analysis of a body with a contact: a static solve, and motions."""
    body = System(mesh, [LAW, Gravity((0, 0, -9.81)), contact], held)
    yield lambda: solve_static(body, quiet=True, raise_on_failure=False, **start)
    yield lambda: simulate(body, EnergyMomentum(dt=1e-4), until=1e-4, quiet=True, **start)
    yield lambda: simulate(body, VelocityVerlet(), until=1e-6, quiet=True, **start)
    yield lambda: Simulation(body, BackwardEuler(dt=1e-4), **start)


@pytest.mark.parametrize("where", [None, BOTTOM], ids=["everywhere", "bottom"])
@pytest.mark.parametrize("name", AROUND)
def test_a_start_on_the_wrong_side_of_a_shape_is_refused(name, where):
    """Facets that touch count as much as the nodes behind them, and the remedy is no larger stiffness."""
    wrong, depth, right = AROUND[name]
    mesh = box((1.0, 1.0, 1.0), (2, 2, 2))
    words = rf"no node of the body is outside the {wrong.name} at the start, and the deepest is {depth:.4g} m within.*Reverse the n"
    for start in starts(mesh, RigidContact(wrong, where)):
        with pytest.raises(ContactError, match=words) as caught:
            start()
        assert "stiffness" not in str(caught.value)
    for start in starts(mesh, RigidContact(right, where)):
        start()


def test_the_part_of_the_body_and_the_start_decide_on_the_side():
    """A body in two parts, of which one is on the wrong side; a body that `u0` or the motion of a shape takes there."""
    one = box((1.0, 1.0, 1.0), (2, 2, 2))
    both = ElementMesh(np.hstack([one.p, one.p - np.array([[0], [0], [1.5]])]), np.hstack([one.t, one.t + one.nv]))
    held = {lambda x: (x[2] == 1) | (x[2] == -0.5): "xyz"}
    floor = RigidPlane((0, 0, 0), (0, 0, 1))
    for where, refused in ((None, True), (lambda x: x[2] > -0.1, False)):
        with pytest.warns(StvkWarning, match="in 2 parts"):
            body = System(both, [LAW, RigidContact(floor, where)], held)
        if refused:
            with pytest.raises(ContactError, match=r"the deepest is 1\.5 m within"):
                solve_static(body, quiet=True)
        else:
            solve_static(body, quiet=True)
    below = np.tile([0, 0, -1.2], one.nv)
    at_rest = next(starts(one, RigidContact(floor), u0=below))
    for start in (at_rest, *list(starts(one, RigidContact(floor), None, u0=below))[1:]):
        with pytest.raises(ContactError, match=r"the deepest is 1\.2 m within"):
            start()
    lifted = RigidContact(floor, motion=lambda t: (0, 0, 1.1 + t))
    for start in starts(one, lifted):
        with pytest.raises(ContactError, match=r"the deepest is 1\.1 m within"):
            start()


def test_a_body_with_a_node_outside_and_a_sheet_slightly_within_may_start():
    """Points in a shape are pushed out, with a finding if they are deep."""
    block, sheet = box((1.0, 1.0, 1.0), (2, 2, 2)), MESHES["membrane"]
    with pytest.warns(StvkWarning, match="deep in the shape"):
        solve_static(System(block, [LAW, RigidContact(RigidPlane((0, 0, 0.6), (0, 0, 1)), stiffness=10.0)], HELD), quiet=True)
    law = StVK(young=1e3, poisson=0.3, thickness=0.1, density=1.0)
    for height, refused in ((0.21, False), (0.6, True)):
        body = System(sheet, [law, RigidContact(RigidPlane((0, 0, height), (0, 0, 1)), stiffness=1e4)])
        if refused:
            with pytest.raises(ContactError, match=r"the deepest is 0\.4 m within"):
                Simulation(body, BackwardEuler(dt=1e-4))
        else:
            Simulation(body, BackwardEuler(dt=1e-4))


@pytest.mark.parametrize(
    "shape",
    [
        RigidSphere((0.5, 0.5, 0), 0.1),
        RigidCylinder((0.5, 0.5, 0), (0, 0, 1), 0.1),
        RigidBox((0.4, 0.3, -0.1), (0.6, 0.7, 0.5)),
        RigidBox((0.4, 0.3, -0.1), (0.6, 0.7, 0.5), radius=0.05),
    ],
    ids=repr,
)
def test_points_halfway_through_a_shape_at_the_start_are_refused(shape):
    """In the centre, on the axis or between two faces no direction leads out, so no force or that to one side would act."""
    mesh = box((1.0, 1.0, 1.0), (2, 2, 2))
    for start in starts(mesh, RigidContact(shape)):
        with pytest.raises(ContactError, match=rf"points are 0\.1 m deep in the {shape.name} at the start, halfway through it"):
            start()
    for start in starts(mesh, RigidContact(shape.displaced((0.02, 0, 0.0)))):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", StvkWarning)  # it is deep, and thinner than the facets
            start()


def test_a_named_plane_that_is_not_touched_changes_no_bit():
    still = RigidContact(RigidPlane((0, 0, -9), (0, 0, 1)))
    mesh = box((0.1, 0.1, 0.1), (2, 2, 2))
    law, down = StVK(young=3e4, poisson=0.4, density=1000.0), Gravity((0, 0, -9.81))
    runs = [
        simulate(System(mesh, terms, {"left": "xyz"}), LinearBackwardEuler(1e-3), until=0.02, quiet=True)
        for terms in ([law, down], [law, down, still])
    ]
    assert np.array_equal(runs[0].u, runs[1].u)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: RigidSphere((0, 0, 0), -1.0), "RigidSphere: radius = -1.0; expected a positive length"),
        (lambda: RigidPlane((0, 0, 0), (0, 0, 0)), r"normal = \(0.0, 0.0, 0.0\); expected a direction"),
        (lambda: RigidPlane((0, 0), (0, 0, 1)), "point has 2 components and normal 3"),
        (lambda: RigidCylinder((0, 0), (0, 1), 1.0), "In the plane take a RigidSphere"),
        (lambda: RigidBox((0, 0, 0), (1, 1, 0)), "expected low below high"),
        (lambda: RigidBox((0, 0, 0), (1, 1, 1), radius=0.6), "radius = 0.6; expected 0 to 0.5"),
        (lambda: Friction(0.3), "neither slip_speed nor slip_length"),
        (lambda: Friction(-0.3, slip_speed=1.0), "coefficient = -0.3; expected a positive number"),
        (lambda: RigidContact("plane"), r"shape = 'plane'; expected RigidPlane\(...\)"),
        (lambda: floor(stiffness=0.0), "RigidContact 'floor': stiffness = 0.0; expected a positive number"),
        (lambda: floor(onset=-1.0), "onset = -1.0; expected a depth"),
        (lambda: floor(friction=0.3), r"friction = 0.3; expected Friction\(...\)"),
        (lambda: RigidContact(RigidPlane((0, 0), (0, 1)), frictoin=3), r"RigidContact\(frictoin=...\): there .* mean 'friction'\?"),
        (lambda: Friction(mu=0.3), r"Friction\(mu=...\): there is no such argument; known: .* Did you mean 'coefficient'\?"),
        (lambda: RigidPlane(origin=(0, 0), normal=(0, 1)), r"RigidPlane\(origin=...\): there .* Did you mean 'point'\?"),
        (lambda: RigidSphere(center=(0, 0), radius=1.0), r"RigidSphere\(center=...\): there .* Did you mean 'centre'\?"),
        (
            lambda: System(MESHES["tetrahedra"], [LAW, floor(), floor(), RigidContact(SHAPES["plane"])]),
            "name = 'floor': several contacts; expected a name of its own for each, such as name='floor'",
        ),
        (
            lambda: System(MESHES["tetrahedra"], [LAW, floor(motion=lambda t: (0, 0))]),
            r"RigidContact 'floor': what the function motion returned at t = 0 has shape \(2,\)|RigidContact 'floor': .*expected 3",
        ),
        (lambda: System(MESHES["tetrahedra"], [LAW, floor(motion=(0, 0))]), "RigidContact 'floor': motion has shape"),
        (lambda: System(skfem.MeshTri(), [LAW, floor()]), "its RigidPlane has 3 components; expected 2"),
        (
            lambda: System(skfem.MeshTet(), [StVK(Anisotropic(np.eye(6))), floor()]),
            r"without Young's modulus.*expected stiffness=",
        ),
        (
            lambda: dropped(floor(friction=Friction(0.3, slip_length=1.0)), BackwardEuler(1e-3)),
            r"Friction\(slip_speed=None\) in a motion",
        ),
        (
            lambda: solve_static(
                System(MESHES["tetrahedra"], [LAW, floor(friction=Friction(0.3, slip_speed=1.0))], {"left": "xyz"}), quiet=True
            ),
            r"Friction\(slip_length=None\) in statics",
        ),
    ],
)
def test_bad_contacts_are_refused(make, words):
    with pytest.raises(ContactError, match=words):
        make()


def test_a_motion_that_ends_in_nan_names_its_contact():
    with pytest.raises(SimulationError, match="RigidContact 'floor': what the function motion returned at t = 0"):
        dropped(floor(motion=lambda t: (0, 0, np.nan if 0.0055 < t < 0.5 else 0.0)), BackwardEuler(1e-3))


def test_modes_count_the_points_that_touch_and_no_friction():
    mesh, top = box((1.0, 1.0, 1.0), (2, 2, 2)), {TOP: "xyz"}
    deep, rub = RigidPlane((0, 0, 0.01), (0, 0, 1)), Friction(0.3, slip_length=1e-3)
    alone = modes(System(mesh, LAW, top), 4).frequencies
    bedded = modes(System(mesh, [LAW, RigidContact(deep, BOTTOM, 1e3, rub)], top), 4).frequencies
    apart = modes(System(mesh, [LAW, RigidContact(RigidPlane((0, 0, -0.01), (0, 0, 1)), BOTTOM)], top), 4).frequencies
    smooth = modes(System(mesh, [LAW, RigidContact(deep, BOTTOM, 1e3)], top), 4).frequencies
    assert np.array_equal(apart, alone) and np.array_equal(bedded, smooth) and bedded[0] > 1.01 * alone[0]


def test_a_static_body_without_loads_stays_where_a_contact_does_not_touch():
    mesh = box((1.0, 1.0, 1.0), (2, 2, 2))
    result = solve_static(System(mesh, [LAW, RigidContact(RigidPlane((0, 0, -1), (0, 0, 1)))], {TOP: "xyz"}), quiet=True)
    assert result.success and not result.u.any() and not result.contact("contact").force.any()


def test_reduced_bodies_refuse_contacts():
    body = System(box((1.0, 1.0, 1.0), (2, 2, 2)), [LAW, floor()], {"left": "xyz"})
    with pytest.raises(StvkError, match="contacts 'floor'; expected none"):
        ReducedSystem(body, 5, quiet=True)


def test_the_shape_moves_with_time_and_the_load_factor():
    contact = floor(motion=lambda t: (0, 0, t), stiffness=1.0)
    term = System(MESHES["tetrahedra"], [LAW, contact]).bound_terms[1]
    u = np.zeros((MESHES["tetrahedra"].nv, 3))
    for t in (0.2, Moment(0.4, 1.0), 0.0):
        assert term.at(Moment.of(t), None).evaluated(u)[1].min() == pytest.approx(2e-3 - Moment.of(t).time)


def test_energies_at_a_load_factor_are_those_of_the_shape_there():
    body = System(MESHES["tetrahedra"], [LAW, RigidContact(SHAPES["plane"], stiffness=1.0, motion=(0, 0, 0.1))])
    u = np.zeros(body.ndofs)
    for t in (0.25, 1.0):
        fresh = System(body.mesh, body.terms)
        assert body.potential(u, t) == fresh.energy(u, t) == body.energies(u, t)["RigidContact 1"]
        assert body.energies(u, 0.5)["RigidContact 1"] != fresh.energy(u, t) and body.energy(u) == fresh.energy(u, 0.0)


def test_removed_elements_take_their_facets_with_them():
    body = System(box((1.0, 1.0, 1.0), (2, 2, 2)), [LAW, RigidContact(RigidPlane((0, 0, 0.1), (0, 0, 1)), BOTTOM)])
    x = body.mesh.p[:, body.mesh.t].mean(axis=1)
    torn = body.without(np.flatnonzero(x[0] < 0.5))
    u = np.zeros(body.ndofs)
    assert torn.bound_terms[1].energy_and_force(of_vertices(u)) == pytest.approx(
        body.bound_terms[1].energy_and_force(of_vertices(u)) / 2
    )


def test_the_ledger_has_the_resultants_of_contacts_with_which_momentum_balances():
    mesh = box((0.1, 0.1, 0.1), (2, 2, 2))
    law, dt, g = NeoHookean(young=3e4, poisson=0.4, density=1000.0), 1e-3, np.array([0.3, 0.0, -9.81])
    floor = RigidContact(RigidPlane((0, 0, -0.001), (0, 0.1, 1)), friction=Friction(0.3, slip_speed=0.1), name="floor")
    body = System(mesh, [law, Gravity(g), floor])
    run = simulate(body, BackwardEuler(dt=dt, rtol=1e-12), until=0.03, v0=np.tile([0.2, 0, -0.5], mesh.nv), quiet=True)
    ledger = run.ledger
    for axis, component in zip("xyz", g, strict=True):
        force, momentum = ledger[f"contact floor {axis}"], ledger[f"linear_momentum_{axis}"]
        change = np.diff(momentum) - dt * (force[1:] + body.mass().total * component)
        assert np.abs(change).max() < 1e-9 * np.abs(momentum).max() + 1e-12
    assert ledger["contact floor z"][-1] == pytest.approx(run.contact("floor").resultant[2], rel=1e-12)
    assert ledger["contact floor z"].max() > 10


def test_a_slack_sheet_in_a_contact_has_advice_that_helps():
    """A sheet that lies in a plane has no tension, so statics fails; the advice names the contact and a way that succeeds."""
    points = np.array([[0.05 * i, 0.05 * j, -1e-4] for j in range(5) for i in range(9)]).T
    quads = np.array([[9 * j + i, 9 * j + i + 1, 9 * j + i + 10, 9 * j + i + 9] for j in range(4) for i in range(8)])
    sheet = ElementMesh(points, np.vstack([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]).T)
    law = StVK(young=1e5, poisson=0.3, thickness=2e-3, density=1e3)

    def lying(*shapes):
        contacts = [RigidContact(shape, stiffness=1e6, name="floor") for shape in shapes]
        return System(sheet, [law, Gravity((0, 0, -1.0)), *contacts], fixed={lambda x: x[0] == 0: "xyz"})

    over_an_edge = solve_static(lying(RigidBox((0.2, -1, -0.2), (1, 1, 0))), quiet=True, raise_on_failure=False)
    assert "Does the body start in a contact? Move them apart" in over_an_edge.message and "without tension" in over_an_edge.message
    body = lying(RigidPlane((0, 0, 0), (0, 0, 1)))
    failed = solve_static(body, quiet=True, raise_on_failure=False)
    assert not failed.success and "solve_static(system, u0=run.u, t0=0.999)" in failed.message
    run = simulate(body, BackwardEuler(2e-2), until=2.0, quiet=True)
    assert solve_static(body, u0=run.u, t0=0.999, quiet=True).success
