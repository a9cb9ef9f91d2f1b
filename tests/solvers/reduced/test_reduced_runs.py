"""Runs and solves on the coordinates of a basis equal the full ones if the basis has all modes. No step evaluates the full body."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from on_bases import OnModes, bar, column

from skfem_stvk import (
    BackwardEuler,
    EdgeDamping,
    EnergyMomentum,
    GeneralizedAlpha,
    Gravity,
    LinearBackwardEuler,
    Newmark,
    Pressure,
    Rayleigh,
    ReducedSystem,
    Stop,
    StvkError,
    Traction,
    VelocityVerlet,
    simulate,
    solve_static,
)
from skfem_stvk.results.complete_files import ForeignFile
from skfem_stvk.solvers.dynamics.integrators import ENERGY, INTEGRATORS


def tip(x):
    return x[0] > 1.99


GENTLE = (Traction(tip, (0.0, -4.0, 2.5)), Gravity((0.0, -0.3, 0.1)))
BODIES = {
    "dead loads": lambda: bar(loads=GENTLE),
    "prescribed": lambda: bar(
        loads=GENTLE, prescribed={tip: {"x": lambda t: -0.5 * t**2, "y": lambda x, t: 2 * t**2 * (1 + x[2])}}
    ),
    "pressure": lambda: bar(Pressure(lambda x: x[1] < 1e-6, 1.0), loads=GENTLE),
    "functions of t": lambda: bar(loads=(Traction(tip, lambda t: (0.0, -9.0 * np.sin(9 * t), 3.0)),)),
}
TIGHT = (
    BackwardEuler(dt=0.02, rtol=1e-12),
    LinearBackwardEuler(dt=0.02, rtol=1e-13),
    Newmark(dt=0.02, rtol=1e-12),
    GeneralizedAlpha(dt=0.02, rtol=1e-12),
)
ALL = (*TIGHT, EnergyMomentum(dt=0.02))


def largest(x):
    return float(np.abs(x).max())


def names(given):
    return [one.name for one in given]


def precomputed(body):
    """Return a reduced body with all modes, whose coefficients are precomputed."""
    free = body.ndofs - len(body.supports.held)
    return ReducedSystem(body, free, free, derivatives=False, quiet=True)


@pytest.mark.few(6)
@pytest.mark.parametrize("make", [OnModes, precomputed])
@pytest.mark.parametrize("integrator", TIGHT, ids=names(TIGHT))
@pytest.mark.parametrize("name", BODIES)
def test_with_all_modes_the_reduced_motion_is_the_full_one(name, integrator, make):
    """Displacements, velocities and all ledger columns agree: energies, works, momenta, probes and reactions.

    Reactions of moving supports are means over a step of the whole body, and forces at its end on a basis.
    """
    body = BODIES[name]()
    watched = {"probes": {"tip": [17]}, "reactions": {"wall": lambda x: x[0] == 0}, "damping": Rayleigh(0.3, 1e-3)}
    full, reduced = (simulate(one, integrator, until=0.2, quiet=True, **watched) for one in (body, make(body)))
    assert largest(full.u) > 0.01
    limit = 1e-9 if make is OnModes else 1e-8
    assert largest(reduced.u - full.u) < limit * largest(full.u) and largest(reduced.v - full.v) < limit * largest(full.v)
    assert reduced.ledger.names == full.ledger.names
    of_step = name == "prescribed" and integrator.needs_acceleration
    for quantity in full.ledger:
        scale = largest(full.ledger[quantity]) + 1e-6 * largest(full.ledger["total_energy"])
        one, other = full.ledger[quantity], reduced.ledger[quantity]
        if "reaction" in quantity and of_step:
            one, other = one[1:], (other[1:] + other[:-1]) / 2
        assert largest(other - one) < 1e-6 * scale, quantity
    assert of_step or reduced.reaction().resultant == pytest.approx(full.reaction().resultant, rel=1e-7, abs=1e-8)


def test_reactions_and_loads_are_the_rate_of_the_momentum():
    """Reactions and loads equal the rate of the momentum in the ledger of a motion with few coordinates.

    The reactions include the residual at free nodes, which is transferred to the wall.
    """
    body = bar(loads=GENTLE)
    watched = {"reactions": {"wall": lambda x: x[0] == 0}, "until": 0.2, "quiet": True}
    ledger = simulate(ReducedSystem(body, 8, 6, quiet=True), Newmark(dt=0.0025), **watched).ledger
    load = body.external_force(np.zeros(body.ndofs)).reshape(-1, 3).sum(axis=0)
    for axis, applied in zip("yz", load[1:], strict=True):
        rate = np.gradient(ledger[f"linear_momentum_{axis}"], ledger["time"])[2:-2]
        assert largest(rate - ledger[f"reaction wall {axis}"][2:-2] - applied) < 0.01 * largest(rate)


def test_energy_momentum_conserves_the_energy_on_a_basis():
    """`EnergyMomentum` conserves the energy to round-off over many periods of a strongly nonlinear motion.

    Newmark's method does not.
    """
    reduced = OnModes(bar(loads=GENTLE), 6)
    v0 = reduced.columns @ np.array([1.0, 0.7, 0.5, 0.4, 0.2, 0.1])
    conserved, lost = (simulate(reduced, one, until=8.0, v0=v0, quiet=True).ledger for one in (EnergyMomentum(0.05), Newmark(0.05)))
    scale = conserved["kinetic_energy"].max()
    assert conserved["strain_energy"].max() > 0.3 * scale
    assert largest(conserved["closure_error"]) < 1e-11 * scale < 1e-3 * scale < largest(lost["closure_error"])


def test_one_quadrature_point_instead_of_two_does_not_conserve_the_energy(monkeypatch):
    from skfem_stvk.solvers.dynamics import step_matrix

    monkeypatch.setattr(step_matrix, "GAUSS", (0.5, 0.5))
    reduced = OnModes(bar(loads=GENTLE), 6)
    ledger = simulate(reduced, EnergyMomentum(0.05), until=2.0, v0=reduced.columns @ np.linspace(1, 0.1, 6), quiet=True).ledger
    assert largest(ledger["closure_error"]) > 1e-4 * ledger["kinetic_energy"].max()


@pytest.mark.parametrize("integrator", ALL, ids=names(ALL))
def test_orders_of_convergence_equal_the_declared_orders(integrator):
    reduced = OnModes(bar(loads=GENTLE, prescribed={tip: {"y": lambda t: 0.1 * np.sin(5 * t) ** 2}}), 3)
    v0 = reduced.columns[:, :3] @ np.array([0.5, 0.3, 0.2])

    def at(dt):
        run = simulate(reduced, replace(integrator, dt=dt), until=0.16, v0=v0, quiet=True)
        return np.concatenate([run.u, run.v])

    steps = (0.001 if integrator.order == 1 else 0.01) / 2 ** np.arange(4)
    states = [at(dt) for dt in steps]
    changes = [np.linalg.norm(one - other) for one, other in pairwise(states)]
    slopes = np.log2(np.array(changes[:-1]) / changes[1:])
    assert abs(slopes[-1] - integrator.order) < 0.15


def test_declared_conservation_on_a_basis_needs_an_integrator_that_accepts_a_basis():
    promises = {name: one.conserves_reduced for name, one in INTEGRATORS.items()}
    assert {name for name, conserved in promises.items() if conserved is None} == {"ForwardEuler", "VelocityVerlet"}
    assert {name for name, conserved in promises.items() if conserved} == {"EnergyMomentum"} and promises["EnergyMomentum"] == {
        ENERGY
    }


@pytest.mark.parametrize("integrator", ALL, ids=names(ALL))
def test_steps_do_not_evaluate_the_full_body(integrator, monkeypatch):
    reduced = OnModes(bar(loads=GENTLE), 9)
    inner, calls = OnModes(bar(loads=GENTLE), 9), []
    reduced.response = inner.response  # replaces precomputed coefficients
    for name in ("energy", "internal_force", "energy_and_force", "inside_out", "tangent", "external_force", "foundation_force"):
        method = getattr(reduced.body, name)
        monkeypatch.setattr(
            reduced.body, name, lambda *given, name=name, method=method, **more: (calls.append(name), method(*given, **more))[1]
        )
    counts = []
    for until in (0.1, 0.4):
        calls.clear()
        inner.count = 0
        run = simulate(reduced, integrator, until=until, damping=Rayleigh(0.1, 1e-3), probes={"tip": [17]}, quiet=True)
        counts.append(len(calls))
    assert counts[0] == counts[1] < 30 and run.motion.states.n == 9
    evaluations = 2 if isinstance(integrator, EnergyMomentum) else 1
    assert inner.count <= evaluations * (run.iterations + run.ledger.steps) + run.ledger.steps


def test_a_resumed_motion_equals_the_whole_one_bitwise(tmp_path):
    body = BODIES["prescribed"]()
    reduced, integrator = OnModes(body, 9), EnergyMomentum(dt=0.02)
    whole = simulate(reduced, integrator, until=0.4, probes={"tip": [17]}, quiet=True)
    simulate(reduced, integrator, until=0.2, probes={"tip": [17]}, checkpoint=tmp_path, quiet=True)
    again = simulate(reduced, until=0.4, checkpoint=tmp_path, resume=True, quiet=True)
    assert (again.u == whole.u).all() and (again.v == whole.v).all() and (again.ledger.rows() == whole.ledger.rows()).all()
    for other in (OnModes(body, 8), body):
        with pytest.raises((StvkError, ForeignFile), match="the basis changed"):
            simulate(other, until=0.5, checkpoint=tmp_path, resume=True, quiet=True)


@pytest.mark.filterwarnings("ignore::skfem_stvk.errors.StvkWarning")
def test_saved_states_have_fields_and_numbers_of_inverted_elements(tmp_path):
    body = BODIES["dead loads"]()
    reduced = OnModes(body, 9)
    run = simulate(reduced, Newmark(dt=0.02), until=0.4, save=tmp_path / "run.pvd", every=5, quiet=True)
    assert len(list(tmp_path.glob("*.vtu"))) == 5 and run.state["von_mises_stress"].shape == (body.mesh.nt,)
    strong = simulate(reduced, Newmark(dt=0.02), until=0.1, v0=400 * reduced.columns[:, 5], quiet=True, raise_on_failure=False)
    assert strong.ledger["inside_out"][-1] == len(body.inside_out(strong.u)) > 0 and not strong.success


KNOWN = "LinearBackwardEuler, BackwardEuler, Newmark, GeneralizedAlpha, EnergyMomentum"
REFUSED = [
    (f"expected one of {KNOWN}", VelocityVerlet(dt=1e-4), {}),
    ("expected the defaults", Newmark(dt=0.1, tangent="clamped"), {}),
    ("expected the defaults", Newmark(dt=0.1, solver="superlu"), {}),
    ("expected 'lumped'", Newmark(dt=0.1), {"mass": "consistent"}),
    (r"expected Rayleigh\(alpha, beta\)", Newmark(dt=0.1), {"damping": EdgeDamping(0.1)}),
    ("Simulate its body", Newmark(dt=0.1), {"remove": lambda t, u: None}),
    ("expected .auto. for a reduced system", None, {"solver": "superlu"}),
    ("expected None for a reduced system", None, {"checkpoint": "kept"}),
]


@pytest.mark.parametrize(("message", "integrator", "options"), REFUSED)
def test_unsupported_options_of_a_reduced_body_are_refused(message, integrator, options, tmp_path, monkeypatch):
    """Without an integrator, they are those of a static solve."""
    monkeypatch.chdir(tmp_path)
    reduced = OnModes(bar(loads=GENTLE), 3)
    with pytest.raises(StvkError, match=message):
        if integrator is None:
            solve_static(reduced, quiet=True, **options)
        else:
            simulate(reduced, integrator, until=0.2, quiet=True, **options)


@pytest.mark.parametrize("fault", ["masses", "damping", "reactions of what is prescribed"])
def test_faults_show_in_the_motion_or_in_its_ledger(fault, monkeypatch):
    from skfem_stvk.solvers.dynamics.motion import Motion
    from skfem_stvk.solvers.dynamics.step_problem import StepProblem
    from skfem_stvk.system.coordinates import CoordinateMass

    body = BODIES["prescribed"]()
    options = {"until": 0.2, "quiet": True, "damping": Rayleigh(0.3, 1e-3)}
    right = simulate(OnModes(body, 20), BackwardEuler(dt=0.02), **options)
    if fault == "masses":
        monkeypatch.setattr(CoordinateMass, "__init__", wrong_masses(CoordinateMass.__init__))
    elif fault == "damping":
        monkeypatch.setattr(Motion, "add_linear_damping", lambda self, v, out: None)
    else:
        monkeypatch.setattr(StepProblem, "full", property(lambda self: 0 * self._u0, lambda self, value: None), raising=False)
    wrong = simulate(OnModes(body, 20), BackwardEuler(dt=0.02), **options)
    closure = [largest(one.ledger["closure_error"] - right.ledger["closure_error"]) for one in (wrong,)]
    assert largest(wrong.u - right.u) > 1e-3 * largest(right.u) or closure[0] > 1e-3 * right.ledger["kinetic_energy"].max()


def wrong_masses(made):
    def mass_of(self, body):
        made(self, body)
        self.matrix[0, 0] *= 1.1

    return mass_of


STATIC = {
    "dead loads": lambda: bar(loads=GENTLE),
    "prescribed": lambda: bar(prescribed={tip: {"x": -0.1, "y": lambda x, t: 0.5 * t * (1 + x[2])}}),
    "pressure": lambda: bar(Pressure(lambda x: x[1] < 1e-6, 4.0), loads=GENTLE),
    "functions of t": lambda: bar(loads=(Traction(tip, lambda t: (0.0, -4.0 * t**2, 9.0 * t)),)),
}


@pytest.mark.parametrize("make", [OnModes, precomputed])
@pytest.mark.parametrize("name", STATIC)
def test_with_all_modes_the_reduced_solve_is_the_full_one(name, make):
    body = STATIC[name]()
    full = solve_static(body, steps=3, quiet=True)
    reduced = solve_static(make(body), steps=3, quiet=True)
    assert largest(full.u) > 0.05 and largest(reduced.u - full.u) < 1e-8 * largest(full.u)
    assert [step.t for step in reduced.history] == [step.t for step in full.history]
    assert abs(reduced.history.iterations - full.history.iterations) < len(full.history) + 1 and reduced.solver == "dense"
    for one, other in zip(reduced.history, full.history, strict=True):
        assert largest(one.u - other.u) < 1e-8 * largest(full.u)
        assert one.strain_energy == pytest.approx(other.strain_energy, rel=1e-8)
        assert one.potential == pytest.approx(other.potential, rel=1e-8, nan_ok=True)
        assert one.smallest_volume_ratio == pytest.approx(other.smallest_volume_ratio, rel=1e-6)
    np.testing.assert_allclose(reduced.reaction().resultant, full.reaction().resultant, rtol=1e-7, atol=1e-8)


@pytest.mark.parametrize("size", [4, 12])
def test_reactions_balance_the_loads_on_small_bases(size):
    """Reactions balance the loads on a basis of 4 modes.

    The residual at free nodes is transferred to the supports. Without the transfer a fifth of the load is missing.
    """
    body = STATIC["dead loads"]()
    full = solve_static(body, steps=2, quiet=True).reaction()
    result = solve_static(ReducedSystem(body, size, 6, quiet=True), steps=2, quiet=True)
    found = result.reaction()
    np.testing.assert_allclose(found.resultant, full.resultant, rtol=1e-10, atol=1e-10)
    np.testing.assert_allclose(found.moment((0, 0, 0)), full.moment((0, 0, 0)), atol=0.02 * largest(full.moment((0, 0, 0))))
    bare = replace(result, projected=False).reaction()
    assert largest(bare.resultant - full.resultant) > 0.1 * largest(full.resultant)


@pytest.mark.parametrize("t", [0.0, 0.3, 1.0])
def test_prescribe_changes_only_the_prescribed_entries(t):
    """`prescribe` sets the prescribed displacements, on the mesh and on a basis, and leaves all free entries unchanged."""
    body = STATIC["prescribed"]()
    whole = OnModes(body)
    held = body.supports.held
    u, z = (np.random.default_rng(3).standard_normal(space.n) for space in (body.space, whole.space))
    there, on_basis = body.prescribe(u.copy(), t), whole.prescribe(z.copy(), t)
    np.testing.assert_array_equal(there[held], body.supports.values(t))
    np.testing.assert_array_equal(np.delete(there, held), np.delete(u, held))
    np.testing.assert_array_equal(on_basis[: whole.size], z[: whole.size])
    np.testing.assert_allclose(whole.space.expand(on_basis)[held], body.supports.values(t), atol=1e-14)
    assert largest(whole.space.expand(whole.state(there, t)) - there) < 1e-12 * largest(u)


def test_arc_length_reaches_the_same_displacement_at_the_same_load():
    body = STATIC["dead loads"]()
    stop = Stop(displacement=(tip, "y", -0.15))
    full, reduced = (solve_static(one, method="arc-length", stop=stop, quiet=True) for one in (body, OnModes(body)))
    assert reduced.t == pytest.approx(full.t, rel=1e-8) and largest(reduced.u - full.u) < 1e-8 * largest(full.u)


def test_the_error_falls_as_modes_are_added():
    body = bar(loads=(Traction(tip, (0.0, -0.3, 0.2)),))
    full = solve_static(body, steps=2, quiet=True)
    errors = [largest(solve_static(OnModes(body, n), steps=2, quiet=True).u - full.u) / largest(full.u) for n in (2, 12, 40, 70)]
    assert errors[0] > 3 * errors[1] and errors[-1] < 0.2 * errors[1] and errors[-1] < 2e-3


def test_a_bifurcation_and_its_mode_are_those_of_the_full_body():
    """A basis with all modes has the same bifurcation point as the full body, with the same mode on the mesh."""
    body, stop = column(60.0), Stop(load=1.0)
    found = [solve_static(one, steps=4, method="arc-length", stop=stop, quiet=True) for one in (body, OnModes(body))]
    full, reduced = (one.critical_points[0] for one in found)
    assert full.kind == reduced.kind == "bifurcation" and reduced.resolved
    assert reduced.t == pytest.approx(full.t, rel=1e-6) and found[0].status is found[1].status
    assert largest(reduced.mode - full.mode) < 1e-5 and largest(reduced.u - full.u) < 1e-6


@pytest.mark.filterwarnings("ignore::skfem_stvk.errors.StvkWarning")
def test_a_reduced_solve_without_equilibrium_ends_at_the_load_of_the_full_one():
    body = bar(loads=(Traction(tip, (-400.0, 0.0, 0.0)),))
    found = [solve_static(one, steps=8, quiet=True, raise_on_failure=False) for one in (body, OnModes(body))]
    assert [one.status.value for one in found] == ["stopped before the end"] * 2
    assert found[1].t == pytest.approx(found[0].t, rel=0.02)
    assert "invert" in found[1].message and not len(body.inside_out(found[1].u))


def test_iterations_do_not_evaluate_the_full_body(monkeypatch):
    """The number of evaluations of the full body is proportional to the number of states found, not to the number of iterations."""
    reduced = OnModes(bar(loads=GENTLE), 9)
    calls, names = [], ("energy", "internal_force", "energy_and_force", "inside_out", "step_limit", "smallest_volume_ratio")
    body, coefficients = reduced.body, {}
    for name in (*names, "tangent", "external_force"):
        method = getattr(body, name)
        monkeypatch.setattr(
            body, name, lambda *given, name=name, method=method, **more: (calls.append(name), method(*given, **more))[1]
        )
    inner = OnModes(bar(loads=GENTLE), 9)
    reduced.response = inner.response  # replaces precomputed coefficients
    reduced.external_force = lambda z, t: coefficients.setdefault("loads", inner.external_force(z, 1.0)) * t
    result = solve_static(reduced, steps=2, quiet=True)
    assert result.history.iterations > 7
    assert "tangent" not in calls and calls.count("step_limit") == 0
    assert len(calls) < 10 * (len(result.history) + 1)


def test_states_are_saved_on_the_mesh(tmp_path):
    body = STATIC["dead loads"]()
    result = solve_static(OnModes(body, 8), steps=2, quiet=True, save=tmp_path / "path.pvd", fields=["von_mises_stress"])
    assert len(list(tmp_path.glob("*.vtu"))) == len(result.history)
    assert result.state["von_mises_stress"].shape == (body.mesh.nt,)


@pytest.mark.filterwarnings("ignore::skfem_stvk.errors.StvkWarning")
@pytest.mark.parametrize("fault", ["a lift that is forgotten", "the sign of the loads", "a tangent of another state"])
def test_faults_are_caught(fault):
    body = STATIC["prescribed"]()
    full = solve_static(body, steps=3, quiet=True)
    reduced = OnModes(body)
    if fault == "a lift that is forgotten":
        reduced.columns[:, -1] = 0
    elif fault == "the sign of the loads":
        loads = reduced.external_force
        reduced.external_force = lambda z, t: -loads(z, t)
    else:
        response = reduced.response
        reduced.response = lambda z: (*response(z)[:2], response(0 * z)[2])
    result = solve_static(reduced, steps=3, quiet=True, raise_on_failure=False)
    assert largest(result.u - full.u) > 1e-3 * largest(full.u) or result.history.iterations > 2 * full.history.iterations
