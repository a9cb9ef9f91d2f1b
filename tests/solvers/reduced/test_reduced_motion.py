"""`simulate` on the coordinates of a basis equals the full motion if the basis has all modes. No step evaluates the full body."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from on_bases import OnModes, bar

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
    StvkError,
    Traction,
    VelocityVerlet,
    simulate,
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


@pytest.mark.few
@pytest.mark.parametrize("integrator", TIGHT, ids=names(TIGHT))
@pytest.mark.parametrize("name", BODIES)
def test_with_all_modes_the_reduced_motion_is_the_full_one(name, integrator):
    """Displacements, velocities and all ledger columns agree: energies, works, momenta, probes and reactions.

    Reactions of moving supports are means over a step of the whole body, and forces at its end on a basis.
    """
    body = BODIES[name]()
    watched = {"probes": {"tip": [17]}, "reactions": {"wall": lambda x: x[0] == 0}, "damping": Rayleigh(0.3, 1e-3)}
    full, reduced = (simulate(one, integrator, until=0.2, quiet=True, **watched) for one in (body, OnModes(body)))
    assert largest(full.u) > 0.01
    assert largest(reduced.u - full.u) < 1e-9 * largest(full.u) and largest(reduced.v - full.v) < 1e-9 * largest(full.v)
    assert reduced.ledger.names == full.ledger.names
    of_step = name == "prescribed" and integrator.needs_acceleration
    for column in full.ledger:
        scale = largest(full.ledger[column]) + 1e-6 * largest(full.ledger["total_energy"])
        one, other = full.ledger[column], reduced.ledger[column]
        if "reaction" in column and of_step:
            one, other = one[1:], (other[1:] + other[:-1]) / 2
        assert largest(other - one) < 1e-6 * scale, column
    assert of_step or reduced.reaction().resultant == pytest.approx(full.reaction().resultant, rel=1e-7, abs=1e-8)


@pytest.mark.parametrize("name", BODIES)
def test_with_precomputed_coefficients_the_reduced_motion_is_the_full_one(name):
    body = BODIES[name]()
    free = body.ndofs - len(body.supports.held)
    reduced = ReducedSystem(body, free, free, derivatives=False, quiet=True)
    for integrator in (TIGHT[0], TIGHT[2]):
        full, found = (simulate(one, integrator, until=0.1, quiet=True, damping=Rayleigh(0.3, 1e-3)) for one in (body, reduced))
        assert largest(found.u - full.u) < 1e-8 * largest(full.u) and largest(found.v - full.v) < 1e-8 * largest(full.v)


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


@pytest.mark.parametrize(
    ("integrator", "options", "message"),
    [
        (
            VelocityVerlet(dt=1e-4),
            {},
            "expected one of LinearBackwardEuler, BackwardEuler, Newmark, GeneralizedAlpha, EnergyMomentum",
        ),
        (Newmark(dt=0.1, tangent="clamped"), {}, "expected the defaults"),
        (Newmark(dt=0.1, solver="superlu"), {}, "expected the defaults"),
        (Newmark(dt=0.1), {"mass": "consistent"}, "expected 'lumped'"),
        (Newmark(dt=0.1), {"damping": EdgeDamping(0.1)}, r"expected Rayleigh\(alpha, beta\)"),
        (Newmark(dt=0.1), {"remove": lambda t, u: None}, "Simulate its body"),
    ],
    ids=["explicit", "tangent", "solver", "mass", "damping", "removal"],
)
def test_unsupported_options_of_a_reduced_motion_are_refused(integrator, options, message):
    with pytest.raises(StvkError, match=message):
        simulate(OnModes(bar(loads=GENTLE), 3), integrator, until=0.2, quiet=True, **options)


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
