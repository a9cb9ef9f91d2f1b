"""Verdicts of solves on stability, starts, scales and ends are right."""

import numpy as np
import pytest
import skfem
from beams import CRITICAL, beam, bent, block, column, tangent, two_bars

from skfem_stvk import Corotated, Gravity, Pressure, StVK, System, Traction, solve_static
from skfem_stvk.errors import StvkWarning
from skfem_stvk.linear import SuperLU
from skfem_stvk.solvers.newton.stability import Mode
from skfem_stvk.solvers.newton.stopwatch import Stopwatch
from skfem_stvk.solvers.statics import Interrupted, SolveError, Status, load_steps, message
from skfem_stvk.solvers.statics import solve as solve_module
from skfem_stvk.solvers.statics.equilibrium import Equilibrium
from skfem_stvk.solvers.statics.message import branch_end

OPTIONS = {"quiet": True, "raise_on_failure": False}


@pytest.mark.parametrize("solver", ["superlu", "pardiso", "amg-cg", "block-jacobi-cg", "ssor-cg"])
def test_a_straight_cable_bears_its_weight_with_every_solver(solver):
    n = 21
    p, t = np.zeros((3, n)), np.stack([np.arange(n - 1), np.arange(1, n)])
    p[0] = np.linspace(0, 10, n)
    cable = [StVK(young=2e11, poisson=0.3, area=1e-4, density=7800.0), Gravity((0, 0, -9.81))]
    assert solve_static(System((p, t), cable, fixed=[([0, n - 1], "xyz")]), solver=solver, **OPTIONS).success


@pytest.mark.parametrize("order", [[0, 1, 2, 3], [3, 2, 1, 0], [0, 2, 1, 3]])
def test_a_chain_with_a_compressed_link_is_unstable_at_any_numbering(order):
    """A chain with one compressed link is unstable at any numbering of its nodes.

    K = 50 N/m [[0, 1], [1, -1]]. SuperLU exchanges rows here, so its pivots do not show the inertia.
    """
    order, x = np.array(order), np.arange(4.0)
    goal = np.cumsum([0, np.sqrt(1.1), np.sqrt(0.9), 1.0])
    goal[3] = goal[2] + 1
    p = np.zeros((2, 4))
    p[0, order] = x
    system = System(
        (p, np.array([order[:-1], order[1:]])),
        StVK(young=1e5, poisson=0.3, area=1e-2),
        fixed=[([order[0]], "xy"), ([order[3]], "y")],
        prescribed=[([order[i]], {"x": goal[i] - x[i]}) for i in (1, 2, 3)],
    )
    assert solve_static(system, steps=1, solver="superlu", **OPTIONS).status is Status.UNSTABLE


def test_a_state_behind_a_snap_through_is_judged_by_its_own_tangent():
    """A state behind a snap-through is judged by its own tangent.

    The last step starts where K is indefinite and ends, after one iteration, where K is positive definite.
    """
    result = solve_static(two_bars(0.1, lambda t: (0, -0.72 * t if t <= 0.5 else -0.5)), steps=2, **OPTIONS)
    assert (np.linalg.eigvalsh(tangent(result.system, result.u)) > 1).all()
    assert result.status is Status.CONVERGED, result.message


def test_states_without_an_iteration_are_as_unstable_as_the_previous_one():
    p, t = np.array([[0, 1, 2.0], [0, 0, 0]]), np.array([[0, 1], [1, 2]])
    strut = System((p, t), StVK(young=1e5, poisson=0.3, area=1e-2), fixed=[([0], "xy")], prescribed=[([2], {"x": -0.1, "y": 0.0})])
    assert {step.status for step in solve_static(strut, **OPTIONS).history} == {Status.UNSTABLE}


def test_prescribed_displacements_at_the_start_are_extended_into_the_body():
    ramped = solve_static(block(0.2), quiet=True)
    pressed = {lambda x: x[0] == 1: {"x": lambda t: -0.2, "y": 0.0, "z": 0.0}}
    system = System(ramped.system.mesh, StVK(young=1e5, poisson=0.3), fixed={lambda x: x[0] == 0: "xyz"}, prescribed=pressed)
    result = solve_static(system, **OPTIONS)
    assert result.success
    np.testing.assert_allclose(result.u, ramped.u, atol=1e-7)


@pytest.mark.parametrize("solver", ["superlu", "amg-cg", "block-jacobi-cg", "ssor-cg"])
def test_a_load_that_returns_to_zero_ends_at_rest(solver):
    system = System(
        skfem.MeshTet.init_tensor(*[np.linspace(0, 1, 7)] * 3),
        [StVK(young=1e5, poisson=0.3), Traction(lambda x: x[0] == 1, lambda t: (0, 0, -4e3 * t * (1 - t)))],
        fixed={lambda x: x[0] == 0: "xyz"},
    )
    result = solve_static(system, solver=solver, **OPTIONS)
    assert result.success and np.abs(result.u).max() < 1e-9
    assert len(result.history[-1].iterations) <= 8


@pytest.mark.filterwarnings("ignore:From t")
@pytest.mark.parametrize("error", [KeyboardInterrupt, MemoryError])
@pytest.mark.parametrize("check, system", [("stability_of", bent), ("branch_end", lambda: block(0.4, n=4))])
def test_an_interruption_of_the_last_check_keeps_the_states(monkeypatch, error, check, system):
    def fail(*_):
        raise error

    monkeypatch.setattr(solve_module, check, fail)
    with pytest.raises(BaseException) as caught:  # a bare KeyboardInterrupt would end pytest
        solve_static(system(), steps=3, quiet=True)
    result = caught.value.result
    assert isinstance(caught.value, Interrupted | SolveError) and result.history[-1].t == result.t > 0
    assert (result.t == 1) == (check == "stability_of")


def test_without_supports_the_reactions_are_those_of_the_foundation():
    from skfem_stvk import ElasticFoundation

    system = System(beam(), [StVK(young=1e4, poisson=0.3), ElasticFoundation("wall", 1e6), Traction("tip", (0, 0, -1.0))])
    result = solve_static(system, quiet=True)
    np.testing.assert_allclose(result.reaction().resultant, [0, 0, 1], atol=1e-7)


def test_a_step_starts_at_the_extrapolation_of_the_last_two_states():
    """A step starts at the extrapolation of the last two states. If the response is linear, no iteration is needed."""
    history = solve_static(two_bars(0.1, (0, -1e-9)), steps=10, quiet=True).history
    assert [len(step.iterations) for step in history[2:]] == [0] * (len(history) - 2)


def test_prescribed_displacements_are_extended_into_the_body():
    history = solve_static(block(0.2), steps=1, quiet=True).history
    assert len(history) == 1 and not history.attempts
    assert history[0].iterations.residuals[0] < 1


def test_the_last_of_seven_equal_steps_is_the_seventh(monkeypatch):
    monkeypatch.setattr(load_steps, "FEW", -1)
    t = solve_static(bent(), steps=7, quiet=True).history.t  # the sum of seven times 1/7 is less than 1
    assert len(t) == 7 and t[-1] == 1


def test_unstable_intermediate_states_are_reported():
    history = solve_static(column(3 * CRITICAL), steps=4, solver="superlu", **OPTIONS).history
    assert history[0].status is Status.CONVERGED and history[-1].status is Status.UNSTABLE
    assert "unstable" in str(history[-1])


@pytest.mark.filterwarnings("ignore:From t")
def test_elements_must_not_invert_again():
    system = block(0.4)
    u0 = np.tile([0.5, 0, 0], system.mesh.nv)  # inverted between the plates, which do not move
    result = solve_static(system, u0=u0, **OPTIONS)
    assert result.history[0].t == 0 and result.history[0].status is Status.CONVERGED
    assert result.status is Status.STOPPED and not len(system.inside_out(result.u))


def test_the_start_of_a_path_satisfies_the_supports():
    system = bent()
    first = solve_static(system, steps=1, u0=np.full(system.ndofs, 0.01), quiet=True).history[0]
    assert first.t == 0 and not first.u[system.supports.held].any()


def test_a_load_that_is_nonzero_at_the_start_has_a_state_at_zero():
    system = System(beam(), [StVK(young=1e4, poisson=0.3), Traction("tip", lambda t: (0, 0, -10.0))], fixed={"wall": "xyz"})
    history = solve_static(system, steps=5, quiet=True).history
    assert history.t[0] == 0 and len(history[0].iterations) > 1
    assert [len(step.iterations) for step in history[1:]] == [0] * (len(history) - 1)


def test_without_a_state_at_zero_there_is_no_path():
    system = System(beam(), [StVK(young=1e4, poisson=0.3), Traction("tip", lambda t: (-1e6, 0, 0))], fixed={"wall": "xyz"})
    result = solve_static(system, **OPTIONS)
    assert result.status is Status.STOPPED and not len(result.history) and len(result.history.attempts) == 1


def test_round_off_ends_a_solve_only_if_the_residual_no_longer_falls():
    for step in solve_static(bent(), steps=2, rtol=1e-18, quiet=True).history:
        before, last = step.iterations.residuals[-2:]
        assert last > before / 2


def test_a_flat_element_counts_as_inverted():
    """An element with J = 0 exactly counts as inverted."""
    system = System((np.eye(3, 4, 1), np.arange(4)[:, None]), StVK(young=1.0, poisson=0.3))
    u = np.zeros((4, 3))
    u[3, 2] = -1
    assert system.smallest_volume_ratio(u.ravel()) == 0
    np.testing.assert_array_equal(system.inside_out(u.ravel()), [0])


def test_messages_of_stopped_results_have_their_own_load_factor():
    result = solve_static(bent(load=(-1e4, 0, 0)), steps=4, **OPTIONS)
    assert result.status is Status.STOPPED and 0 < result.t < 1
    loads = result.system.external_force(result.u, result.t).reshape(-1, 3).sum(axis=0)
    np.testing.assert_allclose(result.reaction().resultant, -loads, rtol=1e-6, atol=1e-6 * np.abs(loads).max())
    assert result.energies() == result.system.energies(result.u, result.t)
    attempts = result.history.attempts
    assert (
        result.history.iterations
        == sum(len(one.iterations) for one in [*result.history, *attempts])
        > sum(len(step.iterations) for step in result.history)
    )


def test_seconds_add_up_to_the_whole_solve(monkeypatch):
    ticks = []  # a clock that advances by a second at each reading
    monkeypatch.setattr("skfem_stvk.solvers.newton.stopwatch.perf_counter", lambda: ticks.append(1) or float(len(ticks)))
    result = solve_static(bent(), steps=3, quiet=True)
    assert sum(result.seconds.values()) == len(ticks) - 1
    assert all(seconds > 0 for seconds in result.seconds.values())


def test_at_the_end_of_a_branch_the_most_deformed_elements_of_its_mode_are_named(monkeypatch):
    """At the end of a branch the elements with the largest deformation in its mode are named.

    One of two cubes in a row is soft and becomes unstable. The stiff cube moves as a rigid body.
    """
    import re

    mesh = skfem.MeshTet.init_tensor(np.linspace(0, 2, 9), *[np.linspace(0, 1, 5)] * 2)
    soft = np.flatnonzero(mesh.p[0, mesh.t].mean(axis=0) < 1)
    young = np.where(np.isin(np.arange(mesh.nelements), soft), 1e4, 1e6)
    pushed = {lambda x: x[0] == 2: {"x": -0.45, "y": 0.0, "z": 0.0}}
    system = System(mesh, StVK(young=young, poisson=0.3), fixed={lambda x: x[0] == 0: "xyz"}, prescribed=pushed)
    monkeypatch.setattr(message, "MOST_NAMED", 3)
    with pytest.warns(StvkWarning) as warned:
        result = solve_static(system, steps=5, **OPTIONS)
    assert result.status is Status.STOPPED
    named = re.search(r"gives way most in 3 elements \(([\d, ]+)\)", result.message)
    assert named and np.isin([int(one) for one in named[1].split(",")], soft).all()
    assert len([one for one in warned if "compressed" in str(one.message)]) == 1, "one warning is expected"


def test_a_branch_with_constant_stiffness_does_not_end():
    system = column(0.5 * CRITICAL)
    result = solve_static(system, quiet=True)
    assert branch_end(Equilibrium(system, SuperLU(), Stopwatch()), np.zeros(system.ndofs), 0.0, result.u, 1.0) == ""


def test_messages_on_softening_are_not_given_for_other_laws(monkeypatch):
    system = bent()
    corotated = System(system.mesh, [Corotated(young=1e4, poisson=0.3), Traction("tip", (-1e5, 0, 1e3))], fixed={"wall": "xyz"})
    result = solve_static(corotated, steps=1, **OPTIONS)
    assert result.status is Status.STOPPED and "Venant" not in result.message and "Try" in result.message
    problem, values = Equilibrium(corotated, SuperLU(), Stopwatch()), iter([1.0, 1e-3])
    u = np.zeros(corotated.ndofs)
    monkeypatch.setattr(message, "nearest_mode", lambda problem, u, t: problem.factorise(u, t) and Mode(next(values), u + 1))
    text = branch_end(problem, u, 0.0, u, 1.0)
    assert "gives way most in" in text and "inf" not in text and "principal stretch" not in text


def test_no_end_of_a_branch_is_reported_for_an_unsymmetric_tangent(monkeypatch):
    """No end of a branch is reported for an unsymmetric tangent, which has no lowest eigenvalue."""
    system = bent()
    pressed = System(system.mesh, [system.terms[0], Pressure("tip", 1e9)], fixed={"wall": "xyz"})
    result = solve_static(pressed, steps=1, **OPTIONS)
    assert result.status is Status.STOPPED and "stable branch ends" not in result.message
    problem, values = Equilibrium(pressed, SuperLU(), Stopwatch()), iter([1.0, 1e-3])
    u = np.zeros(pressed.ndofs)
    monkeypatch.setattr(message, "nearest_mode", lambda problem, u, t: problem.factorise(u, t) and Mode(next(values), u + 1))
    assert branch_end(problem, u, 0.0, u, 1.0) == ""
    assert next(values, "all") == "all", "both values were used"
