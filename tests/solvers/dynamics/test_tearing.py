"""Bodies that lose elements in motion: energies balance, runs resume bit for bit, and motions equal those of smaller bodies."""

import warnings

import numpy as np
import pytest
import skfem
from slow import slow

from skfem_stvk import (
    ElementMesh,
    EnergyMomentum,
    ForwardEuler,
    Gravity,
    Newmark,
    PrincipalStressLimit,
    Rayleigh,
    StVK,
    StvkError,
    StvkWarning,
    System,
    VelocityVerlet,
    critical_step,
    read_mesh,
    simulate,
)
from skfem_stvk.results import Fields
from skfem_stvk.solvers.dynamics import BackwardEuler, EdgeDamping, LinearBackwardEuler, SimulationError
from skfem_stvk.solvers.dynamics.ledger_rows import LedgerWriter

INTEGRATORS = {
    "verlet": lambda: VelocityVerlet(2e-4),
    "verlet, steps that are found": VelocityVerlet,
    "euler": lambda: ForwardEuler(1e-4),
    "energy and momentum": lambda: EnergyMomentum(2e-3),
    "newmark, rest": lambda: Newmark(2e-3, tangent="rest"),
    "backward euler": lambda: BackwardEuler(2e-3, solver="superlu"),
    "linear backward euler": lambda: LinearBackwardEuler(2e-3),
}


def sheet(nx=8, ny=4, d=2, **options):
    """Return a sheet fixed at its left end, with densities and stiffnesses that vary by element."""
    if d == 2:
        mesh = skfem.MeshTri.init_tensor(np.linspace(0, 2, nx + 1), np.linspace(0, 1, ny + 1))
    else:
        mesh = skfem.MeshTet.init_tensor(np.linspace(0, 2, nx + 1), np.linspace(0, 1, ny + 1), [0, 0.2])
    rng = np.random.default_rng(1)
    terms = [
        StVK(young=rng.uniform(1, 2, mesh.t.shape[1]) * 1e4, poisson=0.3, density=rng.uniform(1, 2, mesh.t.shape[1])),
        Gravity(np.arange(1.0, d + 1)),
    ]
    return System(mesh, terms, fixed={lambda x: x[0] == 0: "xyz"[:d]}, **options)


def pulled(system, speed=5.0):
    """Return velocities that stretch the body."""
    return (system.mesh.p.T * ([speed] + [0] * (system.mesh.d - 1))).ravel()


def at(t_of, ids):
    """Return a rule that removes elements once, at the first step after a time."""
    return lambda t, u: ids if t > t_of else []


def quietly(what, *arguments, **options):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", StvkWarning)
        return what(*arguments, **options)


@pytest.mark.few
@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("name", INTEGRATORS)
@pytest.mark.parametrize("damping", [None, [Rayleigh(0.3, 1e-5), EdgeDamping(1e-5)]], ids=["", "damped"])
def test_a_body_without_its_removed_elements_moves_like_one_built_without_them(name, d, damping):
    """The reference is a run up to the removal, and then a run of a system without the elements from the same state."""
    if name == "newmark, rest" and damping:
        damping = Rayleigh(0.3, 1e-5)
    out = np.array([3, 4, 5, 11])
    options = {"damping": damping, "quiet": True}
    body = sheet(d=d)
    run = quietly(simulate, body, INTEGRATORS[name](), until=0.04, v0=pulled(body), remove=at(0.0199, out), **options)
    assert (run.removed == out).all() and (run.removed_at == run.removed_at[0]).all()
    other = sheet(d=d)
    first = quietly(simulate, other, INTEGRATORS[name](), until=float(run.removed_at[0]), v0=pulled(other), **options)
    left = sheet(d=d)
    left = quietly(left.without, out)
    second = quietly(simulate, left, INTEGRATORS[name](), until=0.04, u0=first.u, v0=first.v, t0=first.t, **options)
    limit = 1e-2 if name == "verlet, steps that are found" else 2e-6  # the step sizes differ
    assert np.abs(run.u - second.u).max() < limit * np.abs(second.u).max()
    assert np.abs(run.v - second.v).max() < 30 * limit * np.abs(second.v).max()
    lost = first.ledger["total_energy"][-1] - second.ledger["total_energy"][0]
    assert lost != 0 and run.ledger["removed_energy"][-1] == pytest.approx(lost, rel=1e-8)


@pytest.mark.parametrize("name", INTEGRATORS)
def test_the_ledger_with_removals_closes_as_well_as_without(name):
    """The energy of removed elements is computed from their stresses, independently of the ledger."""
    body = sheet()
    seen = []

    def rule(t, u):
        if 0.01 < t < 0.0125 or t > 0.03:
            seen.append((t, u))
            return np.flatnonzero(np.arange(64) % 16 == (3 if t < 0.02 else 7))
        return None

    run = quietly(simulate, body, INTEGRATORS[name](), until=0.04, v0=pulled(body), remove=rule, quiet=True)
    ledger, plain = run.ledger, quietly(simulate, sheet(), INTEGRATORS[name](), until=0.04, v0=pulled(body), quiet=True).ledger
    most = ledger["kinetic_energy"].max()
    assert np.abs(ledger["closure_error"]).max() < 4 * np.abs(plain["closure_error"]).max() + 1e-11 * most
    jumps = np.diff(ledger["removed_energy"])
    assert np.count_nonzero(np.abs(jumps) > 1e-6 * most) == 2 and len(run.removed) == 8
    whole = sheet()
    state = Fields.of(whole).at(seen[0][1])
    own = run.removed[:4]
    strain = (state["strain_energy_density"] * Fields.of(whole).volume)[own].sum()
    step = int(np.flatnonzero(np.abs(jumps) > 1e-6 * most)[0])
    assert ledger["time"][step + 1] == run.removed_at[0]
    assert 0 < strain < jumps[step] + 1.0 * most  # the jump includes potential and kinetic energy
    v = quietly(simulate, sheet(), INTEGRATORS[name](), until=float(run.removed_at[0]), v0=pulled(body), quiet=True).v
    left = sheet()
    before = v @ left.mass().multiply(v) / 2, -(left.external_force(seen[0][1], 1.0) @ seen[0][1])
    left = quietly(left.without, own)
    lumped = [whole.body.lumped_mass, left.body.lumped_mass]
    weight = [-(m[:, None] * [1.0, 2.0] * seen[0][1].reshape(-1, 2)).sum() for m in lumped]
    kinetic = before[0] - v @ left.mass().multiply(v) / 2
    assert jumps[step] == pytest.approx(strain + kinetic + weight[0] - weight[1], rel=1e-6)


def test_a_missing_energy_of_removal_is_detected(monkeypatch):
    """Planted fault: the energy of removed elements is zero."""
    monkeypatch.setattr(LedgerWriter, "_total_energy", lambda self, state: 0.0)
    body = sheet()
    run = quietly(simulate, body, EnergyMomentum(2e-3), until=0.04, v0=pulled(body), remove=at(0.01, [3]), quiet=True)
    assert np.abs(run.ledger["closure_error"]).max() > 1e-3 * run.ledger["kinetic_energy"].max()


def torn(until, system=None, integrator=None, limit=1.5e3, **options):
    system = sheet() if system is None else system
    rule = PrincipalStressLimit(limit)
    return quietly(
        simulate, system, integrator or VelocityVerlet(), until=until, v0=pulled(system), remove=rule, quiet=True, **options
    )


def test_elements_with_principal_stress_above_the_limit_are_removed():
    run = torn(0.05)
    assert len(run.removed) > 3 and (np.diff(run.removed_at) >= 0).all() and run.success
    largest = np.linalg.eigvalsh(run.state["cauchy_stress"])[:, -1]
    there = np.setdiff1d(np.arange(64), run.removed)
    assert largest[there].max() <= 1.5e3
    assert f"{len(run.removed)} elements" in run.message and "removed between t = " in run.message
    same = torn(0.05, integrator=VelocityVerlet(run.dt))
    whole = quietly(simulate, sheet(), VelocityVerlet(run.dt), until=same.removed_at[0], v0=pulled(sheet()), quiet=True)
    largest = np.linalg.eigvalsh(whole.state["cauchy_stress"])[:, -1]
    assert (np.flatnonzero(largest > 1.5e3) == np.sort(same.removed[same.removed_at == same.removed_at[0]])).all()


def test_limits_may_vary_by_element_and_be_checked_rarely():
    limit = np.full(64, np.inf)
    limit[:9] = 1e3
    body = sheet()
    rule = PrincipalStressLimit(limit, every=7)
    run = quietly(simulate, body, VelocityVerlet(2e-4), until=0.05, v0=pulled(body), remove=rule, quiet=True)
    assert 0 < len(run.removed) <= 9 and run.removed.max() < 9
    steps = np.round(run.removed_at / 2e-4).astype(int)
    assert (steps % 7 == 0).all()


def test_a_limit_that_no_element_reaches_changes_nothing():
    free, watched = (torn(0.03, limit=limit) for limit in (1e9, np.inf))
    plain = quietly(simulate, sheet(), VelocityVerlet(), until=0.03, v0=pulled(sheet()), quiet=True)
    for run in (free, watched):
        assert (run.u == plain.u).all() and not run.removed.size and "removed" not in run.message
    assert "removed_energy" not in plain.ledger and not watched.ledger["removed_energy"].any()


def test_the_step_follows_the_critical_step_after_removals():
    run = torn(0.05)
    now = critical_step(run.system, run.u).step
    assert run.dt <= 0.9 * now
    heavy = sheet()
    one = simulate(heavy, VelocityVerlet(), until=0.05, v0=pulled(heavy), remove=at(0.01, np.arange(20, 40)), quiet=True)
    assert one.dt <= 0.9 * critical_step(heavy, one.u).step and one.status.value == "finished"


@pytest.mark.few
@pytest.mark.parametrize("name", [*INTEGRATORS])
@pytest.mark.parametrize("again", ["a new system", slow("the same system")])
def test_a_torn_run_resumes_bit_for_bit(name, again, tmp_path):
    options = {"damping": Rayleigh(0.1), "every": 3}
    wanted = torn(0.0451, integrator=INTEGRATORS[name](), save=tmp_path / "one.pvd", **options)
    body = sheet()
    first = torn(0.018, body, INTEGRATORS[name](), save=tmp_path / "two.pvd", checkpoint=tmp_path / "kept", **options)
    assert 0 < len(first.removed) < len(wanted.removed)
    body = sheet() if again == "a new system" else body
    found = torn(0.0451, body, INTEGRATORS[name](), checkpoint=tmp_path / "kept", resume=True, save=tmp_path / "two.pvd", **options)
    assert (found.u == wanted.u).all() and (found.v == wanted.v).all()
    assert (found.removed == wanted.removed).all() and (found.removed_at == wanted.removed_at).all()
    assert (found.system.removed == np.sort(wanted.removed)).all()
    for column in wanted.ledger:
        assert (found.ledger[column] == wanted.ledger[column]).all(), column
    names = sorted(file.name for file in tmp_path.glob("one_*.vtu"))
    assert len(names) > 3
    for one in names:
        assert (tmp_path / one).read_bytes() == (tmp_path / one.replace("one", "two")).read_bytes()


@pytest.mark.parametrize("name", INTEGRATORS)
def test_removals_do_not_change_the_system_of_the_caller(name):
    body = sheet()
    u = pulled(body)
    whole = body.tangent(0.1 * u).data
    run = torn(0.045, body, INTEGRATORS[name]())
    assert len(run.removed) and not body.removed.size and (body.tangent(0.1 * u).data == whole).all()
    assert run.system is not body and run.system.pattern is body.pattern


def test_elements_removed_before_the_run_belong_to_the_problem(tmp_path):
    whole = sheet()
    notched = whole.without([30, 31])
    torn(0.02, notched, checkpoint=tmp_path / "kept")
    with pytest.raises(StvkError, match=r"The system lacks 0 elements .*2 of them from the start"):
        torn(0.04, whole, checkpoint=tmp_path / "kept", resume=True)
    again = sheet().without([30, 31])
    run = torn(0.04, again, checkpoint=tmp_path / "kept", resume=True)
    assert np.isnan(run.removed_at[:2]).all() and (run.removed[:2] == [30, 31]).all()
    other = sheet().without([30, 31, np.setdiff1d(np.arange(64), run.removed)[-1]])
    with pytest.raises(StvkError, match="Pass the system with which the motion began"):
        torn(0.05, other, checkpoint=tmp_path / "kept", resume=True)


def test_a_resumed_run_needs_the_same_rule(tmp_path):
    torn(0.02, checkpoint=tmp_path / "kept")
    with pytest.raises(StvkError, match=r"remove was 'PrincipalStressLimit\(1500, every=1\)' and is None"):
        simulate(sheet(), VelocityVerlet(), until=0.03, checkpoint=tmp_path / "kept", resume=True, quiet=True)
    with pytest.raises(StvkError, match=r"and is 'PrincipalStressLimit\(1600, every=1\)'"):
        torn(0.03, limit=1.6e3, checkpoint=tmp_path / "kept", resume=True)


def test_files_of_a_torn_body_contain_the_remaining_elements(tmp_path):
    run = torn(0.05, save=tmp_path / "torn.pvd", every=1)
    last = sorted(tmp_path.glob("torn_*.vtu"))[-1]
    assert read_mesh(last).nt == 64 - len(run.removed) if not run.system.bare.size else True
    assert run.animate(tmp_path / "torn.gif").stat().st_size > 1000


def test_loose_parts_fall_freely():
    body = sheet()
    x = body.mesh.p[0, body.mesh.t].mean(axis=0)
    with pytest.warns(StvkWarning, match="1 part becomes loose"):
        run = simulate(body, EnergyMomentum(2e-3), until=0.3, v0=pulled(body), remove=at(0.01, (x > 0.75) & (x < 1)), quiet=True)
    flying = body.mesh.p[0] > 1.2
    g = body.mass().vertex[flying]
    before = np.flatnonzero(run.ledger["time"] > run.removed_at[0])[0]
    fall = (g[:, None] * run.v.reshape(-1, 2)[flying]).sum(axis=0) / g.sum()
    assert fall[1] == pytest.approx(2.0 * (run.t - run.removed_at[0]), abs=0.2)
    assert before and np.abs(run.ledger["closure_error"]).max() < 1e-9 * run.ledger["kinetic_energy"].max()


def test_bare_nodes_stay_where_they_are():
    body = sheet()
    corner = np.flatnonzero((body.mesh.t == np.flatnonzero((body.mesh.p.T == [2, 1]).all(axis=1))[0]).any(axis=0))
    kept = {}

    def rule(t, u):
        if t > 0.01 and not kept:
            kept["u"] = u
        return corner if kept else None

    for integrator in (VelocityVerlet(2e-4), Newmark(2e-3), LinearBackwardEuler(2e-3)):
        kept.clear()
        run = quietly(simulate, body, integrator, until=0.04, v0=pulled(body), remove=rule, quiet=True)
        dofs = (2 * run.system.bare[:, None] + np.arange(2)).ravel()
        assert len(dofs) and (run.u[dofs] == kept["u"][dofs]).all() and not run.v[dofs].any()


@pytest.mark.parametrize(
    "answer", [[99], np.ones(3, dtype=bool), np.arange(64), "nowhere", 0.5], ids=["99", "mask", "all", "name", "0.5"]
)
def test_results_of_rules_are_checked_and_errors_contain_the_run(answer):
    body = sheet()
    with pytest.raises(SimulationError) as raised:
        simulate(
            body, VelocityVerlet(2e-4), until=0.02, v0=pulled(body), remove=lambda t, u: answer if t > 0.01 else None, quiet=True
        )
    assert isinstance(raised.value.__cause__, StvkError) and raised.value.run.ledger.steps > 40


def test_limits_have_one_value_for_each_element():
    with pytest.raises(SimulationError, match=r"limit has shape \(3,\)(?!.*raise_on_failure)"):
        simulate(
            sheet(), VelocityVerlet(2e-4), until=0.01, v0=pulled(sheet()), remove=PrincipalStressLimit([1.0, 2.0, 3.0]), quiet=True
        )


def test_meshes_of_quadratic_elements_may_tear(tmp_path):
    mesh = ElementMesh.of(skfem.MeshTri.init_tensor(np.linspace(0, 2, 5), np.linspace(0, 1, 3))).with_degree(2)
    body = System(mesh, StVK(young=1e4, poisson=0.3, density=1.0), fixed={lambda x: x[0] == 0: "xy"})
    run = quietly(
        simulate,
        body,
        VelocityVerlet(),
        until=0.05,
        v0=pulled(body),
        remove=PrincipalStressLimit(300.0),
        quiet=True,
        save=tmp_path / "torn.pvd",
    )
    assert len(run.removed) and run.animate(tmp_path / "torn.gif").exists()
