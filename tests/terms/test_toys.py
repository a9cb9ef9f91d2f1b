"""Minimal laws and loads work in whole analyses, and planted faults in them are found."""

from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest
from bodies import MESHES
from terms.test_conformance import CASES, dense, derivative, force_of, states, with_its_blocks
from terms.toys import Anchors, Areas, Contacts, Friction, Springs, Vortex, Wind

from skfem_stvk import Gravity, NodalLoad, Simulation, StVK, StvkError, System, solve_static
from skfem_stvk.mesh import ElementMesh
from skfem_stvk.solvers.dynamics import BackwardEuler, EnergyMomentum, LinearBackwardEuler, Newmark, VelocityVerlet, simulate
from skfem_stvk.solvers.dynamics.integrators import StepFailed
from skfem_stvk.solvers.dynamics.integrators.implicit import ImplicitStepper

MESH = MESHES["tetrahedra"]
SOLID = StVK(young=50.0, poisson=0.3, density=1.0)
FIXED = {(0, 1, 2, 3): "xyz"}
RNG = np.random.default_rng(5)
ENDS = np.unique(np.sort(RNG.integers(0, MESH.nv, (2, 60)), axis=0), axis=1)
PAIRS = ENDS[:, ENDS[0] < ENDS[1]]
TRIPLES = np.argsort(RNG.random((10, MESH.nv)), axis=1)[:, :3].T
TOYS = {
    "springs": [Springs(PAIRS, 5.0)],
    "areas": [Areas(TRIPLES, 0.5)],
    "anchors": [Anchors([5, 6, 7], 5.0)],
    "wind": [Wind(PAIRS, 0.5)],
    "vortex": [Vortex(np.arange(4, 9), 0.5)],
    "all": [Springs(PAIRS, 5.0), Areas(TRIPLES, 0.5), Anchors([5, 6, 7], 5.0), Wind(PAIRS, 0.5), Vortex(np.arange(4, 9), 0.5)],
}
SYMMETRIC = ("springs", "areas", "anchors")


def loaded(name, dtype=np.float64, **options):
    return System(MESH, [SOLID, *TOYS[name], NodalLoad([MESH.nv - 1], (0.03, 0.02, -0.1))], FIXED, dtype=dtype, **options)


@cache
def with_small_steps(name):
    return simulate(loaded(name), until=0.1, integrator=VelocityVerlet(2.5e-4), quiet=True).u


def balance(system, u):
    residual = system.residual(u)
    residual[system.supports.held] = 0
    return np.abs(residual).max() / np.abs(system.external_force(u)).max()


@pytest.mark.few
@pytest.mark.filterwarnings("ignore::skfem_stvk.StvkWarning")
@pytest.mark.parametrize(
    ("name", "solver"),
    [(name, solver) for solver in ("superlu", "auto") for name in TOYS] + [(name, "block-jacobi-cg") for name in SYMMETRIC],
)
def test_a_static_solve_finds_the_equilibrium(name, solver):
    system = loaded(name)
    found = solve_static(system, solver=solver, quiet=True)
    without = solve_static(System(MESH, [SOLID, *system.terms[-1:]], FIXED), quiet=True)
    assert found.success and balance(system, found.u) < 1e-7
    assert np.abs(found.u - without.u).max() > 1e-3 * np.abs(found.u).max()


@pytest.mark.few
@pytest.mark.parametrize("integrator", [VelocityVerlet(1e-3), Newmark(0.01), BackwardEuler(0.01), EnergyMomentum(0.01)], ids=repr)
@pytest.mark.parametrize("name", TOYS)
def test_a_motion_is_near_that_of_small_steps(name, integrator):
    system = loaded(name)
    found = simulate(system, until=0.1, integrator=integrator, quiet=True)
    u = with_small_steps(name)
    assert found.success and np.abs(found.u - u).max() < 0.15 * np.abs(u).max()
    if not isinstance(integrator, BackwardEuler):  # BackwardEuler dissipates energy
        assert abs(found.ledger["closure_error"][-1]) < 0.03 * np.abs(found.ledger["kinetic_energy"]).max()


@pytest.mark.parametrize("name", TOYS)
def test_assembled_and_matrix_free_products_are_the_same(name):
    system, u, v = loaded(name), *0.1 * np.random.default_rng(1).standard_normal((2, MESH.p.size))
    K, F = system.tangent(u), system.internal_force(u)
    force = derivative(lambda s: system.internal_force(u + s * v), 0.1)
    assert np.abs(K @ v - force).max() < 1e-11 * np.abs(force).max()
    assert np.abs(system.product(u, v) - force).max() < 1e-11 * np.abs(force).max()
    if name not in ("wind", "all"):
        energy, force, again = system.linearize(u)
        assert energy == pytest.approx(system.energy(u), rel=1e-13) and np.abs(force - F).max() < 1e-13 * np.abs(F).max()
        assert abs(again - K).max() == 0
    else:
        with pytest.raises(StvkError, match=r"^Wind \d has no energy"):
            system.linearize(u)
    assert (np.abs(system.round_off(u)) >= np.abs(F) * (1 - 1e-12)).all()
    single = loaded(name, dtype=np.float32)
    assert np.abs(single.internal_force(u) - F).max() < 1e-5 * np.abs(F).max()
    assert abs(single.tangent(u) - K).max() < 1e-5 * abs(K).max()
    assert (system.conservative, system.dead) == (name in SYMMETRIC, name in SYMMETRIC) and system.quartic == (name == "vortex")
    assert sum(system.memory().values()) > 0


def test_a_body_of_springs_only_has_mass_moves_and_has_an_equilibrium():
    pairs = np.array(np.triu_indices(MESH.nv, 1))
    system = System(MESH, [Springs(pairs, 30.0), Gravity((0, 0, -1.0))], FIXED)
    assert solve_static(system, quiet=True).success
    system.check_held()
    run = simulate(system, until=0.2, integrator=VelocityVerlet(1e-3), quiet=True)
    assert run.success and abs(run.ledger["closure_error"][-1]) < 1e-4 * np.abs(run.ledger["kinetic_energy"]).max()


def test_terms_with_history_get_the_state_at_the_beginning_of_each_step():
    system = System(MESH, [SOLID, Friction([5, 6], 20.0), NodalLoad([MESH.nv - 1], (0.03, 0.02, -0.1))], FIXED)
    found = solve_static(system, steps=4, quiet=True)
    states = [(0.0, np.zeros(system.ndofs)), *((step.t, step.u) for step in found.history[:-1])]
    begun = system.bound_terms[1].begun
    assert len(begun) == len(states)
    assert all(t == s and np.array_equal(u.ravel(), v) for (t, u), (s, v) in zip(begun, states, strict=True))
    begun.clear()
    run = simulate(system, until=0.05, integrator=BackwardEuler(0.01), quiet=True)
    assert [t for t, _ in begun] == list(run.ledger["time"][:-1]) and not np.array_equal(begun[-1][1].ravel(), run.u)


def test_two_simulations_of_one_system_do_not_affect_each_other():
    system = System(MESH, [SOLID, Friction([5, 6], 20.0), NodalLoad([MESH.nv - 1], (0.03, 0.02, -0.1))], FIXED)
    alone = Simulation(system, BackwardEuler(0.01))
    for _ in range(6):
        alone.step()
    one, other = Simulation(system, BackwardEuler(0.01)), Simulation(system, BackwardEuler(0.02))
    for _ in range(6):
        one.step()
        other.step()
    assert np.array_equal(one.u, alone.u) and abs(one.u - other.u).max() > 0.01 * abs(one.u).max()


@pytest.mark.parametrize("integrator", [BackwardEuler(0.01), LinearBackwardEuler(0.01), EnergyMomentum(0.01), VelocityVerlet(1e-3)])
def test_a_simulation_goes_back_to_the_history_of_a_saved_state(integrator, tmp_path):
    system = System(MESH, [SOLID, Friction([5, 6], 20.0), NodalLoad([MESH.nv - 1], (0.03, 0.02, -0.1))], FIXED)
    sim = Simulation(system, integrator)
    sim.step()
    saved, _, (history,) = sim.copy_state(), sim.save(tmp_path), sim.copy_state().snapshot.history
    for _ in range(3):
        sim.step()
    u = sim.u
    sim.restore(saved)
    loaded = Simulation.load(tmp_path, system)
    for _ in range(3):
        sim.step()
        loaded.step()
    assert np.array_equal(sim.u, u) and np.array_equal(loaded.u, u)
    assert not np.array_equal(sim.copy_state().snapshot.history[0], history)
    sim.restore(saved)
    assert np.array_equal(sim.copy_state().snapshot.history[0], history)


@pytest.mark.filterwarnings("ignore::skfem_stvk.StvkWarning")
def test_a_step_whose_second_half_fails_leaves_history_and_state_as_they_were(monkeypatch):
    system = System(MESH, [SOLID, Friction([5, 6], 20.0), NodalLoad([MESH.nv - 1], (0.03, 0.02, -0.1))], FIXED)
    sim, step = Simulation(system, BackwardEuler(0.01), halvings=1, on_failure="hold"), ImplicitStepper.step
    sim.step()
    u, (history,), times = sim.u, sim.copy_state().snapshot.history, []

    def fails(self, state, t):
        times.append(t)
        if len(times) != 2:  # the whole step and its second half
            raise StepFailed("planted")
        step(self, state, t)

    monkeypatch.setattr(ImplicitStepper, "step", fails)
    sim.step()
    assert sim.failures == 1 and len(times) == 3 and np.array_equal(sim.u, u)
    assert np.array_equal(sim.copy_state().snapshot.history[0], history)


def test_a_static_path_is_resumed_with_its_history(tmp_path):
    system = System(MESH, [SOLID, Friction([5, 6], 20.0), NodalLoad([MESH.nv - 1], (0.03, 0.02, -0.1))], FIXED)
    whole = solve_static(system, steps=4, checkpoint=tmp_path, quiet=True)
    for file in sorted(tmp_path.glob("state_*.npz"))[2:]:
        file.unlink()
    again = solve_static(system, steps=4, checkpoint=tmp_path, resume=True, quiet=True)
    assert np.array_equal(again.u, whole.u) and len(again.history) == len(whole.history)
    assert np.array_equal(again.step.history[0], whole.step.history[0])


def test_changed_pairs_make_a_new_pattern_and_discard_all_derived_data():
    system = System(MESH, [SOLID, Contacts([[0, 1], [7, 8]]), NodalLoad([MESH.nv - 1], (0.03, 0.02, -0.1))], FIXED)
    contacts, u = system.bound_terms[1], 0.1 * np.random.default_rng(1).standard_normal(MESH.p.size)
    held, mass = system.free_dofs(system.supports.held), system.mass("consistent")
    K, operator = system.tangent(u), system.linear_operator(u)
    Kff = held.matrix(K)
    mass.add_to(K, 1.0)
    coupled = set(zip(*SOLID.bind(ElementMesh.of(MESH)).nodes_paired.tolist(), strict=True))
    apart = np.array([pair for pair in zip(*np.triu_indices(MESH.nv, 1), strict=True) if pair not in coupled]).T
    contacts.take(apart)
    assert system.pattern_version == 1
    other = System(MESH, [SOLID, Springs(apart)], FIXED)
    new = system.tangent(u)
    assert new.nnz > K.nnz and abs(new - other.tangent(u)).max() < 1e-13 * abs(new).max()
    with pytest.raises(StvkError, match="does not have the pattern"):
        system.tangent(u, out=K)
    fresh = held.matrix(new)
    assert fresh.nnz > Kff.nnz and abs(fresh - new[held.free][:, held.free]).max() == 0
    mass.add_to(new, 1.0)
    M = System(MESH, SOLID, FIXED).mass("consistent").matrix
    assert abs(new - other.tangent(u) - M).max() < 1e-13 * abs(new).max()
    operator.prepare(u)
    assert np.abs(operator @ u - other.tangent(u) @ u).max() < 1e-13 * np.abs(u).max() * abs(new).max()
    assert np.abs(system.product(u, u) - other.product(u, u)).max() < 1e-12 * np.abs(u).max() * abs(new).max()


@dataclass(frozen=True, eq=False)
class Grasping(Contacts):
    """Springs that couple other pairs from the third step on."""

    class Bound(Contacts.Bound):
        begun = 0

        def first_history(self):
            return np.zeros(0)

        def advanced(self, history, u, moment):
            self.begun += 1
            if self.begun == 3:
                self.take(PAIRS)
            return history


def test_a_solve_continues_when_the_pairs_change():
    system = System(MESH, [SOLID, Grasping([[0], [1]]), NodalLoad([MESH.nv - 1], (0.03, 0.02, -0.1))], FIXED)
    found = solve_static(system, steps=4, solver="superlu", quiet=True)
    assert found.success and system.pattern_version == 1 and balance(system, found.u) < 1e-8


@pytest.mark.parametrize("name", [name for name, case in CASES.items() if case.toy])
def test_blocks_that_differ_from_those_of_the_force_are_found(name):
    case = CASES[name]
    for _, u in states(case):
        term = case.term.bind(case.mesh)
        right = term.add_blocks

        def wrong(u, blocks, kept=None, right=right):
            right(u, blocks)
            for part in (blocks.pairs, blocks.own):
                if part is not None and len(part):
                    part[0] *= 1.001

        v = np.ones_like(u) * np.arange(len(u))[:, None]
        slope = derivative(lambda s, u=u, v=v, term=term: force_of(term, u + s * v), 1e-3).ravel()
        error = np.abs(dense(case, term, u)[0] @ v.ravel() - slope).max()
        term.add_blocks = wrong
        assert np.abs(dense(case, term, u)[0] @ v.ravel() - slope).max() > 100 * error


@pytest.mark.parametrize(
    "name, fault", [("wind", {"symmetric": True}), ("anchors", {"balanced": True}), ("wind", {"balanced": True})]
)
def test_a_false_declaration_is_found(name, fault):
    """A false declaration of symmetry or balance is found.

    The term gets no arrays for the other blocks, or has another K.
    """
    case = CASES[name]
    term = case.term.bind(case.mesh)
    u = 0.3 * np.random.default_rng(2).standard_normal(case.mesh.p.T.shape)
    right = dense(case, term, u)[0]
    for key, value in fault.items():
        setattr(term, key, value)
    try:
        error = np.abs(dense(case, term, u)[0] - right).max()
    except TypeError:
        error = np.inf
    assert error > 1e-3 * np.abs(right).max()


@pytest.mark.parametrize(
    "pairs, match",
    [
        ([[0, 3], [1, 2]], r"1 pair \(1\) of nodes_paired; expected vertices 0 <= a < b"),
        ([[0, 0], [1, 1]], "of nodes_paired twice"),
        ([[0], [999]], "expected vertices"),
        ([[0, 1, 2]], "expected \\(2, n\\) pairs"),
    ],
)
def test_invalid_pairs_are_refused(pairs, match):
    term = Springs([[0], [1]]).bind(MESH)
    term.nodes_paired = np.array(pairs)
    with pytest.raises(StvkError, match=match):
        with_its_blocks(CASES["anchors"], term)


def test_an_object_without_blocks_is_not_a_term():
    class Nothing:
        def bind(self, body, dtype):
            return object()

    with pytest.raises(StvkError, match="object is no elastic term; expected symmetric, balanced"):
        System(MESH, [Nothing()])
