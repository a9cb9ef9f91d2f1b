"""All parts of a divided body decide alike: errors, cuts of steps, verdicts, refusals and solvers."""

import re
from functools import partial

import numpy as np
import pytest
from divided import Division, beam, caught, combined, grounded, separate_threads

from skfem_stvk import (
    BackwardEuler,
    EnergyMomentum,
    ForwardEuler,
    LinearBackwardEuler,
    NeoHookean,
    Newmark,
    NodalLoad,
    Pressure,
    PrincipalStressLimit,
    ReducedSystem,
    StVK,
    System,
    Traction,
    VelocityVerlet,
    critical_elements,
    critical_step,
    modes,
    simulate,
    solve_static,
)
from skfem_stvk.errors import StateError, StvkError
from skfem_stvk.linear import BlockJacobiCg, Kind, Outcome, Petsc, SsorCg, SuperLU
from skfem_stvk.linear.cg import conjugate_gradients
from skfem_stvk.linear.choose import choose
from skfem_stvk.solvers.dynamics.forces import add_damping_force, add_mean_force
from skfem_stvk.solvers.newton.outcome import Status
from skfem_stvk.solvers.newton.stability import ON_PARTS
from skfem_stvk.system.bound import compressed_in_part

__all__ = ["separate_threads"]  # a fixture
pytestmark = pytest.mark.filterwarnings("ignore::skfem_stvk.errors.StvkWarning")
divided = pytest.mark.parametrize("how", ["strips", "random"])


OVERFLOWS = {
    "energy": lambda s, u: s.energy(u),
    "force": lambda s, u: s.internal_force(u),
    "both": lambda s, u: s.energy_and_force(u),
    "linearize": lambda s, u: s.linearize(u),
    "tangent": lambda s, u: s.tangent(u),
    "free tangent": lambda s, u: s.tangent(u, free=s.free_dofs(np.flatnonzero(s.space.numbers < 5))),
    "jacobian": lambda s, u: s.jacobian(u),
    "operator": lambda s, u: s.linear_operator(u),
    "product": lambda s, u: s.product(u, u),
    "foundation": lambda s, u: s.foundation_force(1e250 * u),
    "along": lambda s, u: s.energy_along(0 * u, u),
    "potential": lambda s, u: s.potential(u),
    "damping": lambda s, u: add_damping_force(s, u, u, np.zeros(s.ndofs)),
    "mean force": lambda s, u: add_mean_force(s, 0 * u, u, np.zeros(s.ndofs)),
    "critical step": lambda s, u: critical_step(s, u),
}
NOT_FINITE = {
    "volume ratio": lambda s, u: s.smallest_volume_ratio(u),
    "step limit": lambda s, u: s.step_limit(0 * u, u),
    "inside out": lambda s, u: s.inside_out(u),
    "compressed": lambda s, u: s.mesh.ids_of_all(compressed_in_part(s, u, 0.9)),
    "external force": lambda s, u: s.external_force(u),
    "round-off": lambda s, u: s.round_off(u),
}


STATES = [(name, 1e200) for name in OVERFLOWS] + [(name, np.nan) for name in OVERFLOWS | NOT_FINITE]


@pytest.mark.filterwarnings("ignore:(overflow|invalid value) encountered:RuntimeWarning")
@pytest.mark.parametrize(("name", "value"), STATES)
def test_a_state_that_overflows_in_one_part_is_refused_in_all(name, value):
    """All parts raise the same StateError, and can go on with another state."""
    body = Division("tetrahedra", "strips")
    alone = np.setdiff1d(np.unique(body.mesh.t[:, body.parts[2]]), np.unique(body.mesh.t[:, np.concatenate(body.parts[:2])]))
    u = np.zeros(body.mesh.p.size)
    u[3 * alone[0]] = value

    def work(system, dofs):
        error = caught(lambda: (OVERFLOWS | NOT_FINITE)[name](system, u[dofs]))
        return error, system.energy(0.01 * np.cos(system.space.numbers))

    found, (error, energy) = body.run(work, grounded)
    assert error[0] is StateError
    kinds = {one for _, (one, _) in found}
    assert len(kinds) == 1 and kinds.pop()[0] is StateError
    for _, (_, own) in found:
        assert own == pytest.approx(energy, rel=1e-13)


def alone(comm, work):
    with comm.together():
        return work()


def test_the_text_of_an_error_is_that_of_the_part_that_has_it():
    def work(system, dofs):
        space = system.space

        def fails():
            if space.comm.leads:
                raise StateError("only here")
            return 1.0

        return caught(lambda: alone(space.comm, fails)), caught(lambda: space.comm.sum_of(fails)), space.comm.sum_of(lambda: 1.5)

    found, _ = Division("triangles", "strips").run(work, grounded)
    for _, (together, summed, total) in found:
        assert together == summed == (StateError, "only here") and total == 4.5


@divided
@pytest.mark.parametrize("of", ["energy_and_force", "internal_force", "tangent", "linear_operator"])
def test_a_term_that_refuses_an_inverted_element_of_one_part_names_it_in_all(of, how):
    body = Division("tetrahedra", how)
    u = np.zeros_like(body.mesh.p.T)
    corner = body.mesh.t[0, 40]
    u[corner] = 3 * (body.mesh.p[:, body.mesh.t[1:, 40]].mean(axis=1) - body.mesh.p[:, corner])

    def work(system, dofs):
        inverted = system.inside_out(u.ravel()[dofs])
        return caught(lambda: getattr(system, of)(u.ravel()[dofs])), inverted.tolist(), system.energy(0 * dofs)

    found, (error, inverted, _) = body.run(work, partial(grounded, law=NeoHookean))
    assert error[0] is StateError and "inverted or flat (J down to " in error[1] and inverted
    for _, (own, own_inverted, energy) in found:
        assert own[0] is StateError and "where the energy of NeoHookean is infinite" in own[1] and energy == 0
        named = re.search(r"elements? \((.*?)\)", own[1])[1].replace(", ...", "").split(", ")
        assert set(map(int, named)) <= set(inverted) and own_inverted == inverted


LOADS = {
    "none cut": (grounded, 0),
    "refused inside a term": (partial(grounded, law=NeoHookean, load=20), 1),
    "stopped": (partial(grounded, load=2), 10),
}


@pytest.mark.few
@divided
@pytest.mark.parametrize("name", LOADS)
def test_newton_cuts_steps_in_all_parts_at_the_same_place(name, how, separate_threads):
    """Terms raise StateError in the part with an inverted element, forces overflow, or elements invert."""
    make, cuts = LOADS[name]

    def solve(system, dofs):
        result = solve_static(system, steps=1, solver="block-jacobi-cg", rtol=1e-10, quiet=True, raise_on_failure=False)
        tried = [(attempt.t, attempt.end, len(attempt.iterations)) for attempt in result.history.attempts]
        steps = [(step.t, tuple(step.iterations.lengths)) for step in result.history]
        return result.u, result.status, (steps, tried, result.message)

    found, (u, status, (_, tried, _)) = Division("tetrahedra", how).run(solve, make)
    assert len({repr(own) for _, (*_, own) in found}) == 1
    assert {own for _, (_, own, _) in found} == {status} and len(tried) >= cuts
    of_parts = combined([(dofs, own) for dofs, (own, *_) in found], (len(u), 1))[:, 0]
    if status is Status.CONVERGED:
        np.testing.assert_allclose(of_parts, u, rtol=0, atol=1e-7 * abs(u).max())


@divided
def test_a_motion_that_blows_up_in_one_part_ends_in_all(how, separate_threads):
    body = Division("tetrahedra", how)
    v = np.zeros(body.mesh.p.size)
    v[0] = 1e30

    def move(system, dofs):
        run = simulate(system, ForwardEuler(dt=0.5), until=40.0, v0=v[dofs], quiet=True, raise_on_failure=False)
        return run.status, run.ledger.steps, run.message, run.t

    found, whole = body.run(move, grounded)
    assert whole[0] is Status.BLEW_UP
    assert {own[:2] for _, own in found} == {whole[:2]}
    assert len({own[2:] for _, own in found}) == 1


@divided
def test_a_motion_that_computes_its_step_halves_it_in_all_parts(how, separate_threads):
    """Critical steps, their reviews and restarts are those of the whole body, with damping and a load that changes."""
    body = Division("tetrahedra", how)

    def make(mesh, young):
        return System(
            mesh, [StVK(young=young, poisson=0.3, density=2.0), NodalLoad("skin", lambda t: 0.003 * np.sin(9 * t) * np.ones(3))]
        )

    def move(system, dofs):
        run = simulate(system, VelocityVerlet(), until=2.0, quiet=True)
        return run.u, run.ledger.steps, run.dt

    found, (_, steps, dt) = body.run(move, make)
    assert steps > 15
    for _, (_, own_steps, own_dt) in found:
        assert own_steps == steps and own_dt == pytest.approx(dt, rel=1e-6)


@divided
def test_parts_report_that_eigenvalues_were_not_counted(how, separate_threads):
    def solve(system, dofs):
        return solve_static(system, steps=1, quiet=True).message

    found, whole = Division("tetrahedra", how).run(solve, grounded)
    assert all(ON_PARTS in message for _, message in found)
    assert "not counted" not in whole


def column(mesh, young, force=10.0):
    """Return a column that is clamped at one end and pressed at the other."""
    terms = [StVK(young=1e3, poisson=0.3), Traction(lambda x: x[0] > 5.999, (-force, 0, 0))]
    return System(mesh, terms, fixed={lambda x: x[0] < 1e-9: "xyz"})


@divided
@pytest.mark.parametrize("force", [5.0, 10.0])
def test_a_state_beyond_its_buckling_load_is_unstable_in_all_parts(force, how, separate_threads, monkeypatch):
    """The quotient of a direction of negative curvature proves it, without a factorisation."""
    monkeypatch.setattr(System, "check_held", lambda self, u=None, t=0.0: None)

    def solve(system, dofs):
        result = solve_static(system, steps=1, solver="block-jacobi-cg", quiet=True, raise_on_failure=False)
        return result.status, result.message

    found, whole = beam(how).run(solve, partial(column, force=force))
    assert whole[0] is (Status.UNSTABLE if force > 9 else Status.CONVERGED)
    (status, message), *others = (own for _, own in found)
    assert status is whole[0] and others == [(status, message)] * 2
    assert ("unstable: K is not positive definite" if force > 9 else ON_PARTS) in message


def test_a_direction_of_negative_curvature_has_its_quotient():
    """The quotient is an upper bound of the lowest eigenvalue, here -3."""
    K = np.diag([2.0, 1.0, -3.0, 4.0])
    solution = conjugate_gradients(lambda v: K @ v, lambda r: r, np.ones(4), 1e-8, 50)
    assert solution.outcome is Outcome.NEGATIVE_CURVATURE and -3 <= solution.curvature < 0
    assert np.isnan(conjugate_gradients(lambda v: 2 * v, lambda r: r, np.ones(4), 1e-8, 50).curvature)


REFUSED = {
    "arc length": (lambda s: solve_static(s, method="arc-length", quiet=True), "method = 'arc-length'; expected 'load-steps'"),
    "stability": (lambda s: solve_static(s, stability=True, quiet=True), "stability = True; expected False"),
    "modes": (lambda s: modes(s, 2), "modes(system); expected a body on one machine"),
    "critical elements": (lambda s: critical_elements(s, 2), "critical_elements(system); expected a body on one machine"),
    "reduced": (lambda s: ReducedSystem(s, 3, quiet=True), "ReducedSystem(body); expected a body on one machine"),
    "without": (lambda s: s.without([0]), "System.without(elements); expected all elements"),
    "removal": (
        lambda s: simulate(s, VelocityVerlet(), until=1.0, remove=PrincipalStressLimit(1.0), quiet=True),
        "remove = a rule; expected None",
    ),
    "float32": (lambda s: System(s.mesh, StVK(young=1.0, poisson=0.3), dtype=np.float32), "dtype = float32; expected float64"),
    "consistent mass": (
        lambda s: simulate(s, BackwardEuler(dt=0.1, solver="block-jacobi-cg"), until=1.0, mass="consistent", quiet=True),
        "mass = 'consistent' with solver = 'block-jacobi-cg'; expected 'lumped'",
    ),
} | {
    solver: (
        lambda s, solver=solver: solve_static(s, solver=solver, quiet=True),
        f"solver = '{solver}'; expected 'petsc', 'block-jacobi-cg'",
    )
    for solver in ("superlu", "pardiso", "amg-cg", "ssor-cg", "nonsense")
}


@pytest.mark.parametrize("name", REFUSED)
def test_analyses_that_need_the_whole_body_are_refused_by_name(name):
    call, text = REFUSED[name]

    def work(system, dofs):
        before = system.space.comm.reductions if system.space.comm.divided else 0
        error = caught(lambda: call(system))
        return error, (system.space.comm.reductions if system.space.comm.divided else 0) - before

    body = Division("tetrahedra", "strips")
    parts = Division.only_parts(body, work, grounded)
    for _, (error, reductions) in parts:
        assert error[0] is StvkError and text in error[1] and "a body that is divided into parts" in error[1], error
        assert reductions <= 9, "work was done before the refusal"


def test_auto_is_conjugate_gradients_on_parts_and_the_header_says_so(separate_threads, capsys):
    def solve(system, dofs):
        result = solve_static(system, steps=1, quiet=not system.space.comm.leads)
        run = simulate(system, LinearBackwardEuler(dt=0.05), until=0.1, quiet=not system.space.comm.leads)
        return result.solver, run.iterations

    body = Division("tetrahedra", "random")
    found = Division.only_parts(body, solve, grounded)
    assert {own[0] for _, own in found} == {"block-jacobi-cg"}
    out = capsys.readouterr().out
    n = body.mesh.p.size
    whole = f"System: {body.mesh.nt} tetrahedra in 3D, {n} degrees of freedom, 3 term(s), {n} of them free"
    assert out.count(whole) == 2 and out.count("solver 'block-jacobi-cg' (for another: ") == 2


@pytest.mark.parametrize("integrator", [None, BackwardEuler(dt=0.05), Newmark(dt=0.05), EnergyMomentum(dt=0.05)], ids=repr)
def test_an_unsymmetric_stiffness_without_petsc_is_refused_in_all_parts_alike(integrator, separate_threads, monkeypatch):
    monkeypatch.setattr(Petsc, "available", False)

    def solve(system, dofs):
        pushed = System(system.mesh, [*system.terms, Pressure("skin", lambda t: 0.1 * t)], fixed={lambda x: x[0] < 0.3: "x"})
        if integrator is None:
            return caught(lambda: solve_static(pushed, quiet=True))
        return caught(lambda: simulate(pushed, integrator, until=0.1, quiet=True))

    found = Division("tetrahedra", "strips").only_parts(solve, grounded)
    assert len({own for _, own in found}) == 1
    kind, text = found[0][1]
    assert kind is StvkError and "K is not symmetric, for example because of a follower pressure" in text


@pytest.mark.parametrize("kind", [Kind.SYMMETRIC, Kind.GENERAL])
@pytest.mark.parametrize("installed", [False, True])
def test_solvers_for_parts_are_chosen_by_the_kind_of_k(kind, installed, monkeypatch):
    def chosen(solver):
        return choose(solver, 10, kind, divided=True).name

    monkeypatch.setattr(Petsc, "available", installed)
    if kind is Kind.GENERAL and not installed:
        with pytest.raises(StvkError, match=r"solver = 'auto'; expected 'petsc', but petsc4py is missing\. K is not symmetric"):
            chosen("auto")
    else:
        assert chosen("auto") == ("petsc" if installed else "block-jacobi-cg")
    assert chosen("petsc") == chosen(Petsc("-pc_type jacobi")) == choose("petsc", 10, kind).name == "petsc"
    able, refused = "'petsc', 'block-jacobi-cg'", [BlockJacobiCg(assembled=True), SsorCg(), SuperLU()]
    if kind is Kind.SYMMETRIC:
        assert chosen("block-jacobi-cg") == chosen(BlockJacobiCg()) == "block-jacobi-cg"
    else:
        able, refused = "'petsc'", [*refused, BlockJacobiCg()]
    for other in refused:
        with pytest.raises(StvkError, match=f"solver = '{other.name}'; expected {able} for a body"):
            chosen(other)
    with pytest.raises(StvkError, match="solver = 'umfpack'; expected "):
        chosen("umfpack")
