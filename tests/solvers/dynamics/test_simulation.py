"""A simulation that another program drives makes the steps of `simulate`, with inputs, and goes back to the last bit."""

import pickle
import sys
import threading
from copy import copy, deepcopy
from dataclasses import replace

import numpy as np
import pytest
from motions import BOTH, MESHES, SCENES, driven, material, spinning

from skfem_stvk import (
    ElementMesh,
    Gravity,
    NodalLoad,
    ReducedSystem,
    Simulation,
    SimulationError,
    System,
    Traction,
    simulate,
    solve_static,
)
from skfem_stvk.errors import StvkError
from skfem_stvk.solvers.dynamics import (
    BackwardEuler,
    EnergyMomentum,
    ForwardEuler,
    GeneralizedAlpha,
    LinearBackwardEuler,
    Newmark,
    VelocityVerlet,
)
from skfem_stvk.solvers.dynamics.integrators.implicit import ImplicitStepper

DT = 0.01
IMPLICIT = [one(DT) for one in (LinearBackwardEuler, BackwardEuler, Newmark, GeneralizedAlpha, EnergyMomentum)]
INTEGRATORS = [*IMPLICIT, ForwardEuler(DT), VelocityVerlet(DT)]
EXPLICIT_BY_ITSELF = VelocityVerlet()


def by_name(one):
    return one.name if one.dt else f"{one.name} by itself"


def with_middle(mesh):
    """Return the mesh with a name for the nodes between its ends."""
    middle = np.setdiff1d(np.arange(mesh.nv), np.concatenate([ids.ravel() for ids in mesh.boundaries.values()]))
    return ElementMesh(mesh.p, mesh.t, boundaries=mesh.boundaries, node_sets={"middle": middle})


def gripped(young=3.0):
    """Return a heavy body fixed at its left end, whose right end is an input."""
    mesh = with_middle(MESHES[3])
    return System(mesh, [material(mesh, young), Gravity((0.3, -1.0, 0.5))], fixed={"left": "xyz"}, prescribed={"right": "xyz"})


def hand(i):
    """Return the displacement of the grip after step `i`; at rest in the first step."""
    i = max(i - 1, 0)
    return np.array([0.05 * np.sin(0.2 * i), 0.02 * (1 - np.cos(0.3 * i)), 0.04 * (1 - np.cos(0.1 * i))])


def state_of(sim):
    return sim.t, sim.dt, sim.steps, sim.u, sim.v, *(sim.ledger.rows().ravel() if sim.ledger is not None else ())


def assert_same(one, other):
    for x, y in zip(one, other, strict=True):
        np.testing.assert_array_equal(x, y)


@pytest.mark.few
@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize("integrator", [*INTEGRATORS, EXPLICIT_BY_ITSELF], ids=by_name)
def test_steps_are_those_of_simulate_to_the_last_bit(integrator, scene):
    system, v0, damping, *_ = SCENES[scene](2)
    run = simulate(system, integrator, until=0.2, v0=v0, damping=damping, quiet=True)
    sim = Simulation(system, integrator, v0=v0, damping=damping, ledger=True)
    while sim.t < run.t:
        sim.step(**({} if run.t - sim.t > sim.dt else {"until": run.t}))
    assert_same(state_of(sim), (run.t, run.dt, run.ledger.steps - 1, run.u, run.v, *sim.ledger.rows().ravel()))
    np.testing.assert_allclose(sim.ledger["closure_error"], run.ledger["closure_error"], rtol=1e-12, atol=1e-15)
    assert abs(sim.u).max() > 1e-3


@pytest.mark.parametrize("integrator", INTEGRATORS, ids=by_name)
def test_inputs_are_functions_of_time_that_are_linear_within_each_step(integrator):
    """Forces of inputs and of functions enter in the same way, so that the states are equal up to the order of sums."""
    mesh, n = MESHES[3], 20
    times, values = DT * np.arange(n + 1), np.array([hand(i) for i in range(n + 1)])
    forces = 0.05 * values[:, ::-1]
    terms = [material(mesh), Gravity((0.3, -1.0, 0.5))]
    nodes = gripped().mesh.boundaries["left"]
    by_input = System(mesh, terms, prescribed={"right": "xyz"})
    sim = Simulation(by_input, integrator, pushed=["left"])
    for i in range(1, n + 1):
        sim.step(right=values[i], left=forces[i])

    def at(t, table):
        return np.array([np.interp(t, times, column) for column in table.T])

    left = np.unique(nodes)
    push = NodalLoad(left, lambda t: at(t, forces) / len(left))
    move = {"right": lambda x, t: at(t, values)[:, None] + 0 * x}
    run = simulate(System(mesh, [*terms, push], prescribed=move), integrator, until=n * DT, quiet=True)
    np.testing.assert_allclose(sim.u, run.u, rtol=0, atol=1e-12)
    np.testing.assert_allclose(sim.v, run.v, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(sim.mean("right"), values[-1])
    np.testing.assert_allclose(sim.u_at("right"), np.tile(values[-1], (len(sim.u_at("right")), 1)), rtol=0, atol=0)


def test_an_input_that_is_not_given_keeps_its_value():
    one, other = (Simulation(gripped(), LinearBackwardEuler(DT), pushed=["middle"]) for _ in range(2))
    for i in range(3):
        one.step(right=(0.01, 0, 0))
        other.step(**({"right": (0.01, 0, 0)} if i == 0 else {}))
    assert_same(state_of(one), state_of(other))


def test_each_node_of_a_moved_location_can_have_its_own_displacement():
    sim = Simulation(gripped(), LinearBackwardEuler(DT))
    n = len(sim.u_at("right"))
    turned = 0.01 * np.cos(np.arange(3 * n)).reshape(n, 3)
    sim.step(right=turned)
    np.testing.assert_array_equal(sim.u_at(np.sort(np.unique(sim.system.mesh.boundaries["right"]))), turned)


def test_whole_steps_and_a_shorter_one_lead_to_a_time():
    one, other = (Simulation(gripped(), BackwardEuler(DT)) for _ in range(2))
    one.step(until=0.035)
    for _ in range(3):
        other.step()
    assert one.steps == 4 and one.t == 0.035 and other.t == 3 * DT
    other.step(until=0.035)
    assert_same(state_of(one), state_of(other))
    one.step()
    assert one.t == 0.035 + DT
    with pytest.raises(StvkError, match=r"until = 0\.01; expected a time after t = 0\.045"):
        one.step(until=0.01)


SOLVERS = {
    "": INTEGRATORS,
    "amg-cg": [replace(one, solver="amg-cg") for one in IMPLICIT if one.name in ("LinearBackwardEuler", "BackwardEuler")],
    "superlu": [replace(IMPLICIT[0], solver="superlu"), replace(IMPLICIT[-1], solver="superlu")],
    "block-jacobi-cg": [replace(IMPLICIT[0], solver="block-jacobi-cg"), replace(IMPLICIT[1], solver="block-jacobi-cg")],
    "tangents": [
        replace(IMPLICIT[0], tangent="clamped"),
        replace(IMPLICIT[0], tangent="rest"),
        replace(IMPLICIT[1], tangent="warped"),
    ],
}


@pytest.mark.few
@pytest.mark.parametrize("damping", [None, BOTH], ids=["", "damped"])
@pytest.mark.parametrize(
    "integrator", [EXPLICIT_BY_ITSELF, *(one for some in SOLVERS.values() for one in some)], ids=lambda one: repr(one)[:60]
)
def test_a_restored_state_leads_to_the_same_steps(integrator, damping):
    if damping and getattr(integrator, "tangent", "") == "rest":
        damping = BOTH[:1]
    sim = Simulation(gripped(), integrator, pushed=["middle"], damping=damping, ledger=True)
    for i in range(5):
        sim.step(right=hand(i), middle=(0, 0.1 * i, 0))
    saved, found = sim.copy_state(), []
    for _ in range(2):
        for i in range(20):
            sim.step(right=hand(5 + i))
        found.append((*state_of(sim), sim.reaction("right"), sim.energy()))
        sim.restore(saved)
    assert_same(*found)
    assert sim.t == saved.t and sim.steps == 5 and sim.ledger.steps == 6


@pytest.mark.few
@pytest.mark.parametrize("ledger", [False, True], ids=["", "ledger"])
@pytest.mark.parametrize("integrator", [*INTEGRATORS, EXPLICIT_BY_ITSELF], ids=by_name)
def test_a_restored_state_is_that_before_elements_were_removed(integrator, ledger):
    sim = Simulation(gripped(), integrator, ledger=ledger)
    for i in range(3):
        sim.step(right=hand(i))
    saved, found = sim.copy_state(), []
    for _ in range(2):
        sim.step(right=hand(3))
        sim.remove([2])
        assert sim.system.removed.tolist() == [2]
        for i in range(4, 10):
            sim.step(right=hand(i))
        found.append(state_of(sim))
        sim.restore(saved)
        assert not len(sim.system.removed)
    assert_same(*found)


def test_states_of_other_simulations_are_refused_before_anything_changes():
    system = gripped()
    sim, other, same = (Simulation(system, BackwardEuler(DT)) for _ in range(3))
    sim.step(right=hand(3))
    other.step(right=hand(5))
    before = state_of(sim)
    with pytest.raises(StvkError, match=r"restore\(a state of another simulation\); expected a result of copy_state"):
        sim.restore(other.copy_state())
    assert_same(state_of(sim), before)
    sim.step(right=hand(4))
    for i in (3, 4):
        same.step(right=hand(i))
    assert_same(state_of(sim), state_of(same))


@pytest.mark.parametrize("copied", [copy, deepcopy, pickle.dumps], ids=lambda one: one.__name__)
def test_copies_that_would_share_the_state_are_refused(copied):
    for system in (gripped(), ReducedSystem(gripped(), 4, 2, quiet=True)):
        sim = Simulation(system, BackwardEuler(DT))
        with pytest.raises(StvkError, match=r"cannot be copied or pickled; expected copy_state\(\) and restore"):
            copied(sim)


@pytest.mark.few
@pytest.mark.parametrize("integrator", [BackwardEuler(DT), EXPLICIT_BY_ITSELF], ids=by_name)
@pytest.mark.parametrize("call", ["step", "remove", "restore", "save", "copy_state"])
def test_motions_and_loads_of_a_simulation_cannot_change_it(integrator, call, tmp_path):
    mesh, calls, sims = with_middle(MESHES[3]), [], []

    def once():
        if calls:
            getattr(sims[0], calls.pop())(*arguments[call])

    def moved(x, t):
        return once() or np.array([0.0, 0.1 * t, 0.0])

    def pulled(x, t):
        return once() or np.full_like(x, 0.1 * t)

    motion = System(mesh, [material(mesh)], fixed={"left": "xyz"}, prescribed={"right": moved})
    load = System(mesh, [material(mesh), Traction("right", pulled)], fixed={"left": "xyz"})
    for system in (motion, load):
        sims[:] = [Simulation(system, integrator, ledger=True)]
        sims[0].step()
        saved, before = sims[0].copy_state(), state_of(sims[0])
        arguments = {"step": (), "remove": ([2],), "restore": (saved,), "save": (tmp_path,), "copy_state": ()}
        calls.append(call)
        with pytest.raises(
            StvkError, match=rf"{call}\(\) within a call of this simulation, by a motion or a load; expected functions"
        ):
            sims[0].step()
        assert not calls and not list(tmp_path.iterdir())
        assert_same(state_of(sims[0]), before)
        sims[0].step()
        found = state_of(sims[0])
        sims[0].restore(saved)
        sims[0].step()
        assert_same(state_of(sims[0]), found)


@pytest.mark.parametrize("integrator", [BackwardEuler(DT), LinearBackwardEuler(DT), EXPLICIT_BY_ITSELF], ids=by_name)
@pytest.mark.parametrize("until", [1e308, 1e300, 1e20])
def test_an_end_up_to_which_times_do_not_resolve_the_steps_is_refused(integrator, until):
    sim = Simulation(gripped(), integrator)
    with pytest.raises(
        StvkError, match=r"until = 1e\+\d+ s; expected an end before \de\+\d+ s, up to which times resolve steps of"
    ):
        sim.step(until=until, right=hand(3))
    assert sim.t == 0 and not sim.u.any()
    sim.step(right=hand(2))
    with pytest.raises(StvkError, match="up to which times resolve steps of"):
        simulate(clamped_free(), integrator, until=until, quiet=True)


@pytest.mark.parametrize("integrator", INTEGRATORS, ids=by_name)
def test_a_failed_step_leaves_everything_as_it_was(integrator):
    """A force of 1e250 N overflows in every integrator."""
    sims = [Simulation(clamped_free(), integrator, pushed=["right"], on_failure="hold", ledger=True) for _ in range(2)]
    for number, sim in enumerate(sims):
        for i in range(10):
            sim.step(right=(0, 0.01 * i, 0))
            if number:
                sim.step(until=sim.t + 2.5 * DT, right=(1e250, 0, 0))
    assert (sims[0].failures, sims[1].failures) == (0, 10)
    assert_same(*map(state_of, sims))
    raising = Simulation(clamped_free(), integrator, pushed=["right"])
    with pytest.raises(SimulationError, match=r"No state was found between t = 0 s and 0\.025 s: .*as it was before.*halvings=6"):
        raising.step(until=2.5 * DT, right=(1e250, 0, 0))
    assert raising.t == 0 and raising.steps == 0 and raising.failures == 1


def clamped_free():
    mesh = MESHES[3]
    return System(mesh, [material(mesh), Gravity((0.3, -1.0, 0.5))], fixed={"left": "xyz"})


def test_failed_steps_are_halved_as_often_as_allowed(monkeypatch):
    solve, longest = ImplicitStepper.solve, 0.3 * DT

    def limited(self, w, moment, inside_out):
        long = self.problem.matrix._c < 1 / longest**2
        return (w, "too long", []) if long else solve(self, w, moment, inside_out)

    monkeypatch.setattr(ImplicitStepper, "solve", limited)
    one, two = (Simulation(gripped(), BackwardEuler(DT), halvings=halvings) for halvings in (1, 2))
    with pytest.raises(SimulationError, match="not even in 2 parts: too long"):
        one.step(right=(0.01, 0, 0))
    two.step(right=(0.01, 0, 0))
    assert one.t == 0 and not one.u.any() and two.t == DT
    short = Simulation(gripped(), BackwardEuler(DT / 4))
    short.step(right=(0.01, 0, 0), until=DT)
    np.testing.assert_allclose(two.u, short.u, rtol=0, atol=1e-9)


@pytest.mark.parametrize("integrator", INTEGRATORS, ids=by_name)
def test_reactions_balance_the_momentum_of_each_step(integrator):
    """`sum M (v1 - v0) = T (reactions + weight + pushed)`; eq. 9 has the force at the end, which differs by its own error."""
    system = gripped()
    sim = Simulation(system, integrator, pushed=["middle"])
    M, weight = system.mass(), system.external_force(np.zeros(system.ndofs), 1.0).reshape(-1, 3).sum(axis=0)
    for i in range(12):
        before, load = sim.v, np.array([0.0, 0.2 * i, -0.1])
        sim.step(right=hand(i), middle=load)
        change = M.multiply(sim.v - before).reshape(-1, 3).sum(axis=0) / DT
        forces = sim.reaction("left") + sim.reaction("right") + weight
        mean = (
            load
            if isinstance(integrator, LinearBackwardEuler | BackwardEuler | ForwardEuler)
            else load - [0, 0.1 * (i > 0), -0.05 * (i == 0)]
        )
        if i > 1:
            size = abs(sim.reaction("right")).max()
            tolerance = (
                3e-2 if type(integrator) is LinearBackwardEuler else 1e-9 if not isinstance(integrator, GeneralizedAlpha) else 0.2
            )
            np.testing.assert_allclose(change, forces + mean, rtol=0, atol=tolerance * size)


@pytest.mark.parametrize(
    "integrator", [replace(one, dt=2e-4, **({"rtol": 1e-12} if one in IMPLICIT else {})) for one in INTEGRATORS], ids=by_name
)
def test_supports_that_stay_have_reactions_too(integrator):
    """The force is at the end of the step, or the mean over it, which differ by O(dt)."""
    system = clamped_free()
    sim, weight = Simulation(system, integrator), system.external_force(np.zeros(system.ndofs), 1.0)
    for _ in range(400):
        before = sim.v
        sim.step()
    change = system.mass().multiply(sim.v - before).reshape(-1, 3).sum(axis=0) / integrator.dt
    np.testing.assert_allclose(sim.reaction("left"), change - weight.reshape(-1, 3).sum(axis=0), rtol=5e-3)


def test_the_reactions_of_eq_9_are_those_of_the_end_of_the_step():
    system = gripped()
    sim, loads = Simulation(system, LinearBackwardEuler(DT)), system.external_force(np.zeros(system.ndofs), 1.0)
    for i in range(5):
        before = sim.v
        sim.step(right=hand(i))
    force = system.mass().multiply(sim.v - before) / DT + system.internal_force(sim.u) - loads
    for name in ("left", "right"):
        nodes = np.unique(system.mesh.boundaries[name])
        np.testing.assert_allclose(sim.reaction(name), force.reshape(-1, 3)[nodes].sum(axis=0), rtol=1e-12)


@pytest.mark.parametrize("reduced", [False, True], ids=["system", "reduced"])
def test_work_of_inputs_and_energy_balance(reduced):
    body = gripped()
    sim = Simulation(
        ReducedSystem(body, 10, 6, quiet=True) if reduced else body, EnergyMomentum(DT), pushed=["middle"], ledger=True
    )
    for i in range(40):
        sim.step(right=hand(i), middle=(0.0, 0.01 * i, 0.0))
    assert abs(sim.ledger["external_work"][-1]) > 1e-4
    assert abs(sim.ledger["closure_error"]).max() < 1e-10 * abs(sim.ledger["total_energy"]).max()
    assert sim.energy().total == pytest.approx(sim.ledger["total_energy"][-1], rel=1e-12)


@pytest.mark.parametrize("integrator", IMPLICIT[:4], ids=by_name)
def test_a_full_basis_gives_the_states_and_reactions_of_the_body(integrator):
    body = gripped()
    free = body.ndofs - len(body.supports.held)
    reduced = ReducedSystem(body, free, free, derivatives=False, quiet=True)
    precise = replace(integrator, rtol=1e-13)
    one, other = (Simulation(system, precise, pushed=["middle"]) for system in (body, reduced))
    for i in range(10):
        for sim in (one, other):
            sim.step(right=hand(i), middle=(0, 0.1, 0))
    np.testing.assert_allclose(other.u, one.u, rtol=0, atol=1e-10)
    np.testing.assert_allclose(other.mean("right"), one.mean("right"), rtol=0, atol=1e-14)
    np.testing.assert_allclose(other.reaction("right"), one.reaction("right"), rtol=1e-7)
    if isinstance(integrator, LinearBackwardEuler | BackwardEuler):
        np.testing.assert_allclose(other.reaction("left"), one.reaction("left"), rtol=1e-5, atol=1e-7)


def test_a_reduced_body_takes_inputs_beside_functions_of_time():
    mesh = MESHES[3]
    terms = material(mesh)
    system = System(mesh, terms, prescribed={"left": lambda x, t: 0.1 * np.sin(t) + 0 * x, "right": "xy"})
    reduced = ReducedSystem(system, 8, 5, quiet=True)
    sim = Simulation(reduced, LinearBackwardEuler(DT))
    for i in range(5):
        sim.step(right=(0.01 * i, -0.02))
    np.testing.assert_allclose(sim.mean("right")[:2], (0.04, -0.02), rtol=0, atol=1e-14)
    np.testing.assert_allclose(sim.mean("left"), 0.1 * np.sin(sim.t) * np.ones(3), rtol=1e-9)
    assert sim.reaction("right")[2] == 0


BROKEN = {
    "a name": (
        {"rihgt": (0, 0, 0)},
        "rihgt = .*expected an input of the simulation; known: 'middle', 'right'. Did you mean 'right'",
    ),
    "a shape": ({"right": (0, 0)}, r"right has shape \(2,\); expected \(3,\) displacements along x, y, z \[m\], or \(\d+, 3\)"),
    "a number": ({"right": 0.1}, r"right = 0.1; expected \(3,\)|right has shape \(\)"),
    "nan": (
        {"middle": (0, np.nan, 0)},
        r"middle is not finite in 1 entry \(1\); expected \(3,\) components of the total force \[N\]",
    ),
    "text": ({"middle": "up"}, "middle = 'up'; expected"),
    "masked": ({"middle": np.ma.masked_array([0, 1, 2.0], [0, 1, 0])}, "middle"),
}


@pytest.mark.parametrize("what", BROKEN)
def test_a_wrong_input_is_refused_before_the_step(what):
    given, match = BROKEN[what]
    sim, other = (Simulation(gripped(), BackwardEuler(DT), pushed=["middle"]) for _ in range(2))
    for one in (sim, other):
        one.step(right=(0.01, 0, 0))
    with pytest.raises(StvkError, match=match):
        sim.step(**{"right": (0.5, 0, 0)} | given)
    for one in (sim, other):
        one.step()
    assert_same(state_of(sim), state_of(other))


def motion(system):
    return simulate(system, BackwardEuler(DT), until=0.1, quiet=True)


def test_other_analyses_hold_inputs_at_zero():
    mesh = MESHES[3]
    terms = [material(mesh), Gravity((0.3, -1.0, 0.5))]
    held = System(mesh, terms, fixed={"left": "xyz", "right": "xyz"})
    for u, expected in zip(*([motion(one).u, solve_static(one, quiet=True).u] for one in (gripped(), held)), strict=True):
        np.testing.assert_allclose(u, expected, rtol=0, atol=1e-10)


@pytest.mark.few
@pytest.mark.parametrize("ledger", [False, True], ids=["", "ledger"])
@pytest.mark.parametrize("integrator", [*INTEGRATORS, EXPLICIT_BY_ITSELF], ids=by_name)
def test_a_saved_simulation_goes_on_from_its_file(integrator, ledger, tmp_path):
    sim = Simulation(gripped(), integrator, pushed=["middle"], ledger=ledger)
    for i in range(6):
        sim.step(right=hand(i), middle=(0, 0.1 * i, 0))
    sim.save(tmp_path / "state")
    loaded = Simulation.load(tmp_path / "state", gripped())
    for i in range(6, 12):
        for one in (sim, loaded):
            one.step(right=hand(i))
    np.testing.assert_allclose(loaded.u, sim.u, rtol=0, atol=0 if ledger else 1e-12)
    assert loaded.t == pytest.approx(sim.t, abs=1e-12) and (not ledger or loaded.steps == sim.steps)
    with pytest.raises(StvkError, match=r"inputs that are not zero\. Continue it with Simulation.load"):
        simulate(gripped(), until=1.0, checkpoint=tmp_path / "state", resume=True, quiet=True)
    with pytest.raises(StvkError, match="of another problem"):
        Simulation.load(tmp_path / "state", gripped(young=4.0))


@pytest.mark.parametrize("integrator", INTEGRATORS, ids=by_name)
def test_simulate_goes_on_from_a_saved_simulation(integrator, tmp_path):
    system, v0, *_ = spinning(2)
    sim = Simulation(system, integrator, v0=v0, ledger=True)
    for _ in range(5):
        sim.step()
    sim.save(tmp_path / "state")
    run = simulate(system, until=0.2, checkpoint=tmp_path / "state", resume=True, quiet=True)
    whole = simulate(system, integrator, until=0.2, v0=v0, quiet=True)
    np.testing.assert_array_equal(run.u, whole.u)
    with pytest.raises(StvkError, match="of another problem"):
        Simulation(system, integrator, v0=2 * v0).save(tmp_path / "state")


def test_a_simulation_goes_on_from_a_checkpoint_of_simulate(tmp_path):
    system = driven(2).system
    simulate(system, Newmark(DT), until=0.1, quiet=True, checkpoint=tmp_path / "state")
    sim = Simulation.load(tmp_path / "state", system)
    sim.step()
    np.testing.assert_array_equal(sim.u, simulate(system, Newmark(DT), until=0.11, quiet=True).u)


@pytest.mark.parametrize("reduced", [False, True], ids=["system", "reduced"])
@pytest.mark.parametrize("integrator", [LinearBackwardEuler(DT), EnergyMomentum(DT)], ids=by_name)
def test_four_threads_give_the_answers_of_one(integrator, reduced):
    body = gripped()
    body = ReducedSystem(body, 10, 6, quiet=True) if reduced else body
    found = {}

    def go(number, key):
        sim = Simulation(body, integrator)
        for i in range(60):
            sim.step(right=(0.2 + 0.2 * number) * hand(i))
        found[key, number] = sim.u, sim.reaction("right")

    for number in range(4):
        go(number, "alone")
    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        threads = [threading.Thread(target=go, args=(number, "together")) for number in range(4)]
        for one in threads:
            one.start()
        for one in threads:
            one.join()
    finally:
        sys.setswitchinterval(interval)
    for number in range(4):
        assert_same(found["together", number], found["alone", number])
    assert abs(found["alone", 0][0] - found["alone", 3][0]).max() > 1e-3


def test_a_simulation_describes_itself_and_its_arrays_cannot_be_written_to():
    sim = Simulation(gripped(), LinearBackwardEuler(DT), t0=2.0)
    assert "inputs: 'right'" in repr(sim) and sim.t == 2.0 and not len(sim.inside_out())
    sim.step(right=(0.01, 0, 0))
    with pytest.raises(ValueError, match="read-only"):
        sim.u[0] = 1
