"""Supports at the start and on a path with kinks: velocities, impulses, energies and reactions of all integrators."""

import numpy as np
import pytest
import skfem
from motions import BOTH, MESHES, driven, material, pushed, velocities

from skfem_stvk import (
    EdgeDamping,
    ElasticFoundation,
    Gravity,
    NeoHookean,
    NodalLoad,
    Ramp,
    Rayleigh,
    ReducedSystem,
    Simulation,
    StVK,
    StvkError,
    StvkWarning,
    SupportError,
    System,
    Table,
    simulate,
    solve_static,
)
from skfem_stvk.solvers.dynamics import (
    BackwardEuler,
    EnergyMomentum,
    ForwardEuler,
    GeneralizedAlpha,
    LinearBackwardEuler,
    Newmark,
    VelocityVerlet,
)
from skfem_stvk.solvers.dynamics.integrators import INTEGRATORS
from skfem_stvk.solvers.dynamics.integrators.implicit import ImplicitStepper
from skfem_stvk.terms.loads.load import Moment

DT = 0.02
#: Every integrator with each kind of mass that it takes.
METHODS = [
    (ForwardEuler(DT / 2), "lumped"),
    (VelocityVerlet(DT / 2), "lumped"),
    *(
        (one, mass)
        for one in (
            BackwardEuler(DT, rtol=1e-13),
            LinearBackwardEuler(DT, rtol=1e-13),
            Newmark(DT, rtol=1e-13),
            Newmark(DT, beta=0.4, gamma=0.6, rtol=1e-13),
            GeneralizedAlpha(DT, rho=0.5, rtol=1e-13),
            GeneralizedAlpha(DT, rho=1.0, rtol=1e-13),
            EnergyMomentum(DT),
        )
        for mass in ("lumped", "consistent")
    ),
]
METHOD = pytest.mark.parametrize(("integrator", "mass"), METHODS, ids=[f"{one} {mass}" for one, mass in METHODS])
#: Factor of a path that starts at once, stops, waits and returns; all kinks are at ends of steps.
PATH = Table(1.0, times=[0, 0.1, 0.2, 0.26, 0.4], factors=[0, 1, 1, 0.2, 0.2])
WAYS = {"x": 0.08, "y": -0.05, "z": 0.03}


def led(d, law=None, path=PATH, **terms):
    """Return a body with a prescribed left end, with one load that changes with time and with weight."""
    mesh = MESHES[d]
    loads = [NodalLoad([int(np.argmax(mesh.p[0]))], lambda t: [0.04 * f for f in pushed(t)[:d]]), Gravity((0.3, -1.0, 0.5)[:d])]
    ways = {axis: lambda t, way=WAYS[axis]: way * path(t) for axis in "xyz"[:d]}
    return System(mesh, [law or material(mesh), *loads, *terms.get("more", ())], prescribed={"left": ways})


def columns(run, prefix):
    return np.stack([run.ledger[prefix + axis] for axis in "xyz"[: run.system.mesh.d]], axis=1)


@pytest.mark.few
@METHOD
def test_a_support_at_rest_has_no_velocity_and_the_reactions_of_statics(integrator, mass):
    """After a quick pull and strong damping, `v1 = 2 w/T - v` would ring for ever."""
    mesh = MESHES[2]
    grip = {"right": {"x": Ramp(0.05, until=0.1), "y": 0.0}}
    body = System(mesh, material(mesh), fixed={"left": "xy"}, prescribed=grip)
    damping = [Rayleigh(alpha=6.0, beta=0.03)] if not integrator.explicit else Rayleigh(alpha=6.0)
    run = simulate(body, integrator, until=6.0, mass=mass, damping=damping, reactions={"grip": "right"}, quiet=True)
    end, still = np.unique(mesh.boundaries["right"]), solve_static(body, quiet=True).reaction("right").resultant
    assert not run.v.reshape(-1, 2)[end].any()
    assert run.ledger["kinetic_energy"][-1] < 1e-9 * run.ledger["kinetic_energy"].max()
    np.testing.assert_allclose(columns(run, "reaction grip ")[-4:], [still] * 4, rtol=1e-3)
    np.testing.assert_allclose(run.reaction("right").resultant, still, rtol=1e-3)


@pytest.mark.few
@METHOD
def test_the_velocity_of_a_support_is_that_before_a_kink(integrator, mass):
    """At the end of a step on a kink, it is the velocity within the step; the first one is that after the start."""
    body, left = led(2), np.unique(MESHES[2].boundaries["left"])
    for until, rate in ((0.1, 10.0), (0.14, 0.0), (0.24, -0.8 / 0.06), (0.3, 0.0)):
        run = simulate(body, integrator, until=until, mass=mass, damping=BOTH, quiet=True)
        wanted = rate * np.array([WAYS["x"], WAYS["y"]])
        np.testing.assert_allclose(run.v.reshape(-1, 2)[left], [wanted] * len(left), rtol=0, atol=1e-10)


@pytest.mark.few
@METHOD
@pytest.mark.parametrize("damping", [None, [Rayleigh(beta=4e-3), EdgeDamping(3e-3)]], ids=["free", "damped"])
def test_reactions_and_loads_are_the_rate_of_momentum_in_each_step(integrator, mass, damping):
    """The inertia of supports, and the impulse of a kink, are in the reactions: `M (v1 - v)/T`."""
    run = simulate(led(2), integrator, until=0.5, mass=mass, damping=damping, reactions={"clamp": "left"}, quiet=True)
    system, times, T = run.system, run.ledger["time"], np.diff(run.ledger["time"])[:, None]
    loads = np.array([system.external_force(np.zeros(system.ndofs), Moment(t, 1.0)).reshape(-1, 2).sum(axis=0) for t in times])
    used = dict.fromkeys((ForwardEuler, BackwardEuler, LinearBackwardEuler), loads[1:])
    rate, forces = np.diff(columns(run, "linear_momentum_"), axis=0) / T, columns(run, "reaction clamp ")[1:]
    forces = forces + used.get(type(integrator), (loads[:-1] + loads[1:]) / 2)
    close = {LinearBackwardEuler: 5e-2, GeneralizedAlpha: 0.1}.get(
        type(integrator), 1e-10
    )  # their equation is not that of the ends
    if damping and isinstance(integrator, VelocityVerlet):
        close = 1e-3  # damping at a predicted velocity
    if isinstance(integrator, Newmark) and integrator.gamma != 0.5:
        close = 0.1
    np.testing.assert_allclose(rate, forces, rtol=0, atol=close * np.abs(forces).max())
    np.testing.assert_array_equal(run.reaction("left").resultant, columns(run, "reaction clamp ")[-1])


@pytest.mark.few
@METHOD
def test_free_nodes_get_the_impulse_of_a_kink_once(integrator, mass):
    """In a bar of one element without stiffness, a consistent mass gives the free end minus half of the speed of the other."""
    bar = System(
        skfem.MeshLine(), StVK(young=1e-9, poisson=0.3, density=2.0), prescribed={(0,): {"x": Table(0.3, [0, 0.2, 0.4], [0, 0, 1])}}
    )
    run = simulate(bar, integrator, until=0.4, mass=mass, quiet=True)
    speed = 0.0 if mass == "lumped" else -0.75
    assert run.v == pytest.approx([1.5, speed], rel=1e-5, abs=1e-7)
    late = simulate(bar, integrator, until=1.0, mass=mass, quiet=True)
    assert late.v == pytest.approx([0.0, 0.0], abs=1e-5), "the second kink takes it back"
    if not isinstance(integrator, GeneralizedAlpha):  # which spreads an impulse over some steps
        assert late.u == pytest.approx([0.3, 0.2 * speed], rel=1e-5, abs=1e-7)


LAWS = {
    "StVK": lambda d: material(MESHES[d]),
    "neo-Hooke": lambda d: NeoHookean(young=3.0, poisson=0.3, density=1.0, **({"thickness": 0.7} if d == 2 else {})),
}


@pytest.mark.few
@pytest.mark.parametrize("damping", [None, Rayleigh(0.8, 4e-3), EdgeDamping(3e-3), BOTH], ids=["free", "Rayleigh", "edges", "both"])
@pytest.mark.parametrize("mass", ["lumped", "consistent"])
@pytest.mark.parametrize(("law", "d"), [("StVK", 2), ("StVK", 3), ("neo-Hooke", 3)])
def test_the_work_of_supports_balances_the_energies(law, d, mass, damping):
    body = led(d, LAWS[law](d), more=[ElasticFoundation("right", 0.7)])
    ledger = simulate(body, EnergyMomentum(DT), until=0.5, mass=mass, damping=damping, quiet=True).ledger
    size = max(ledger["kinetic_energy"].max(), ledger["strain_energy"].max())
    assert np.abs(ledger["closure_error"]).max() < 1e-12 * size and ledger["external_work"].max() > 0.5 * size


@pytest.mark.parametrize(
    "integrator", [BackwardEuler(1e-3, rtol=1e-12), LinearBackwardEuler(1e-3, rtol=1e-12)], ids=["BE", "eq. 9"]
)
def test_the_work_of_a_push_is_the_kinetic_energy_of_the_support(integrator):
    """A support of a rigid body that starts at once has done the work `M v^2/2`, not `M v^2`."""
    mesh = MESHES[2]
    every = {"x": Table(0.3, [0, 0.1, 0.2], [0, 0, 1]), "y": 0.0}
    one = [int(np.argmax(mesh.p.sum(axis=0)))]
    others = [number for number in range(mesh.nv) if number not in one]
    run = simulate(
        System(mesh, material(mesh), prescribed=[(others, every), (one, {"x": every["x"]})]), integrator, until=0.11, quiet=True
    )
    assert run.ledger["external_work"][-1] == pytest.approx(run.system.mass().total * 3.0**2 / 2, rel=2e-2)


MOVED = [(*method, False) for method in METHODS] + [(one, mass, True) for one, mass in METHODS[2:] if mass == "lumped"]


@pytest.mark.few
@pytest.mark.parametrize(
    ("integrator", "mass", "reduced"), MOVED, ids=[f"{one} {mass}{' reduced' * on}" for one, mass, on in MOVED]
)
def test_an_input_that_moves_evenly_has_its_speed_at_once(integrator, mass, reduced):
    mesh = MESHES[3]
    body = System(mesh, [material(mesh), Gravity((0.3, -1.0, 0.5))], fixed={"left": "xyz"}, prescribed={"right": "xyz"})
    sim = Simulation(ReducedSystem(body, 10, 6, quiet=True) if reduced else body, integrator, mass=mass, ledger=True)
    right = np.unique(mesh.boundaries["right"])
    for i in range(8):
        part = (i + 1) * integrator.dt / DT
        sim.step(right=(2e-3 * part, -1e-3 * part, 0.0))
        np.testing.assert_allclose(sim.v.reshape(-1, 3)[right], [np.array([0.1, -0.05, 0.0])] * len(right), rtol=1e-9, atol=1e-12)
    speed = (np.array([0.02, -0.01, 0.0]) - sim.mean("right")) / (2.5 * DT)
    sim.step(until=sim.t + 2.5 * DT, right=(0.02, -0.01, 0.0))
    np.testing.assert_allclose(sim.v.reshape(-1, 3)[right], [speed] * len(right), rtol=1e-5, atol=1e-12)
    for _ in range(3):
        sim.step()
        assert not np.abs(sim.v.reshape(-1, 3)[right]).max() > 1e-12
    ledger = sim.ledger
    if isinstance(integrator, EnergyMomentum):
        assert np.abs(ledger["closure_error"]).max() < 1e-12 * ledger["kinetic_energy"].max()


@pytest.mark.parametrize("rest", [None, BOTH], ids=["free", "damped"])
@pytest.mark.parametrize("mass", ["lumped", "consistent"])
def test_a_run_goes_on_from_the_velocities_of_another(mass, rest):
    """Half-way along a straight piece of the path, `v0` of a next run has all velocities, and the motion is the same."""
    body, integrator = led(2), EnergyMomentum(DT)
    whole = simulate(body, integrator, until=0.48, mass=mass, damping=rest, quiet=True)
    first = simulate(body, integrator, until=0.16, mass=mass, damping=rest, quiet=True)
    options = {"u0": first.u, "v0": first.v, "t0": first.t, "mass": mass, "damping": rest, "quiet": True}
    second = simulate(body, integrator, until=0.48, **options)
    np.testing.assert_allclose(second.u, whole.u, rtol=0, atol=1e-10)
    np.testing.assert_allclose(second.v, whole.v, rtol=0, atol=1e-9)


@pytest.mark.few
@METHOD
def test_a_driven_run_resumes_to_the_same_bits(integrator, mass, tmp_path):
    options = {"mass": mass, "damping": BOTH, "reactions": {"clamp": "left"}, "quiet": True}
    whole = simulate(led(2), integrator, until=0.4, **options)
    simulate(led(2), integrator, until=0.2, checkpoint=tmp_path / "folder", **options)
    again = simulate(led(2), checkpoint=tmp_path / "folder", resume=True, until=0.4, quiet=True)
    np.testing.assert_array_equal(again.ledger.rows(), whole.ledger.rows())
    for one, other in zip((again.u, again.v, again.reaction().by_node), (whole.u, whole.v, whole.reaction().by_node), strict=True):
        np.testing.assert_array_equal(one, other)


def test_a_step_that_is_cut_has_the_velocity_within_its_parts(monkeypatch):
    """Parts of a step differ the function of the support within themselves, also around a kink in the middle of the step."""
    solve = ImplicitStepper.solve

    def limited(self, w, moment, inside_out):
        long = self.problem.matrix._c < 12 / DT**2  # 4/h^2: halves are not too long
        return (w, "too long", []) if long else solve(self, w, moment, inside_out)

    monkeypatch.setattr(ImplicitStepper, "solve", limited)
    path = Table(1.0, times=[0, 0.1 + DT / 2, 0.2], factors=[0, 1, 1])
    with pytest.warns(StvkWarning, match="10 steps in a row had to be cut into parts"):
        run = simulate(led(2, path=path), EnergyMomentum(DT), until=0.2, reactions={"clamp": "left"}, quiet=True)
    assert run.cuts == 10
    loads = [run.system.external_force(np.zeros(run.system.ndofs), Moment(t, 1.0)) for t in np.linspace(0.0, 0.2, 21)]
    loads = np.reshape(loads, (21, -1, 2)).sum(axis=1)
    loads = ((loads[1:] + loads[:-1]) / 2).reshape(10, 2, 2).mean(axis=1)
    forces = columns(run, "reaction clamp ")[1:] + loads
    np.testing.assert_allclose(
        forces, np.diff(columns(run, "linear_momentum_"), axis=0) / DT, rtol=0, atol=1e-10 * np.abs(forces).max()
    )
    assert np.abs(run.ledger["closure_error"]).max() < 1e-12 * run.ledger["kinetic_energy"].max()


MESH = MESHES[2]
LEFT = np.unique(MESH.boundaries["left"])


@pytest.mark.parametrize("integrator", [VelocityVerlet(0.01), EnergyMomentum(0.01)], ids=lambda one: one.name)
def test_constrained_vertices_are_bitwise_at_their_prescribed_positions(integrator):
    u0 = np.full(MESH.p.size, 1e-13)
    system = System(MESH, material(MESH), fixed={"left": "xy"})
    run = simulate(system, integrator, until=0.05, u0=u0, v0=velocities(MESH), quiet=True)
    assert not run.u.reshape(-1, 2)[LEFT].any() and not run.v.reshape(-1, 2)[LEFT].any()


def test_rounding_of_large_displacements_is_no_jump():
    far = 1e5 + 1 / 3
    system = System(MESH, material(MESH), prescribed={"left": {"x": lambda t: far, "y": 0.0}})
    u0 = np.tile([np.nextafter(far, np.inf), 0.0], MESH.nv)
    assert simulate(system, VelocityVerlet(0.01), until=0.05, u0=u0, v0=velocities(MESH), quiet=True).success
    with pytest.raises(SupportError, match="at t0 = 0 s"):
        simulate(system, VelocityVerlet(0.01), until=0.05, u0=u0 + 1e-3, quiet=True)


@pytest.mark.parametrize("dt", [1e-5, 1e-2])
def test_initial_velocities_of_supports_suit_the_step_size(dt):
    """The velocity of supports is a difference over a fraction of the step, for fast and slow supports."""
    omega = 0.05 / dt
    system = System(MESH, material(MESH), prescribed={"left": {"x": lambda t: 1e-4 * np.sin(omega * t), "y": 0.0}})
    run = simulate(system, EnergyMomentum(dt), until=dt, quiet=True)
    moving = system.mass().vertex[LEFT].sum()
    assert run.ledger["kinetic_energy"][0] == pytest.approx(moving * (1e-4 * omega) ** 2 / 2, rel=1e-6)


@pytest.mark.filterwarnings("ignore:.*above the critical one")
@pytest.mark.parametrize("integrator", INTEGRATORS.values())
def test_a_step_far_longer_than_the_motion_is_one_step_to_its_end(integrator, tmp_path):
    system, until = driven(2).system, 0.004
    one, huge = (simulate(system, integrator(dt), until=until, quiet=True) for dt in (until, 1e9))
    assert huge.success and huge.t == until and huge.ledger.steps == 2
    np.testing.assert_array_equal(huge.u, one.u)
    np.testing.assert_array_equal(huge.ledger.rows(), one.ledger.rows())
    assert np.abs(huge.u).max() > 0.5 * 0.6 * until  # the supports have moved
    simulate(system, integrator(1e9), until=until, checkpoint=tmp_path / "c", quiet=True)
    with pytest.raises(StvkError, match=r"until = -1 s; expected an end after t = 0 s"):
        simulate(system, checkpoint=tmp_path / "c", resume=True, until=-1.0, quiet=True)


def test_an_automatic_step_far_longer_than_the_motion_is_one_step_to_its_end():
    run = simulate(System(MESH, material(MESH)), VelocityVerlet(), until=1e-9, v0=velocities(MESH), quiet=True)
    assert run.success and run.t == 1e-9 and run.ledger.steps == 2
    np.testing.assert_allclose(run.u, 1e-9 * velocities(MESH), rtol=1e-6)
