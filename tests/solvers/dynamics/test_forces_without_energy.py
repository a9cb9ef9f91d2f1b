"""Motions with some forces that have no energy: the ledger omits that energy and balances nevertheless."""

import matplotlib
import numpy as np
import pytest
from motions import MESHES

from skfem_stvk import Corotated, Gravity, InvertibleStVK, Simulation, StVK, StvkError, StvkWarning, System, simulate
from skfem_stvk.solvers.dynamics import BackwardEuler, EnergyMomentum, ForwardEuler, LinearBackwardEuler, Newmark, VelocityVerlet
from skfem_stvk.solvers.dynamics.ledger_rows import known_total
from skfem_stvk.solvers.dynamics.motion_checkpoint import MotionCheckpoint
from skfem_stvk.solvers.runs.archive import read_archive, write_archive

matplotlib.use("Agg")
MESH = MESHES[3]
INTEGRATORS = {
    one.name: one
    for one in (
        ForwardEuler(),
        VelocityVerlet(2e-3),
        Newmark(0.01),
        BackwardEuler(0.01),
        LinearBackwardEuler(0.01),
        EnergyMomentum(0.01),
    )
}


def turning(t):
    c, s = np.cos(0.3 * t), np.sin(0.3 * t)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])


def at_vertices(**options):
    return Corotated(rotation="vertex", **options)


def by_stress(**options):
    return InvertibleStVK(extend="stress", **options)


def in_frames(region=None, **options):
    n = MESH.nt if region is None else len(region)
    return Corotated(rotation=lambda t: np.broadcast_to(turning(t), (n, 3, 3)), region=region, **options)


OPTIONS = {"young": 30.0, "poisson": 0.3, "density": 1.0}


def body(law, mixed):
    """Return a falling cantilever with the law everywhere, or with the law in one half of the elements and StVK in the other."""
    terms = [law(**OPTIONS)]
    if mixed:
        terms = [law(region=np.arange(0, MESH.nt, 2), **OPTIONS), StVK(region=np.arange(1, MESH.nt, 2), **OPTIONS)]
    return System(MESH, [*terms, Gravity((0.3, -1.0, 0.5))], fixed={"left": "xyz"})


def without_value(ledger):
    return [name for name in ledger if np.isnan(ledger[name]).any()]


@pytest.mark.parametrize("law", [at_vertices, by_stress, in_frames])
def test_energy_momentum_has_the_work_of_the_force_at_the_middle(law):
    """Its work balances the energies to round-off, because this force acts in the step."""
    system, integrator = body(law, True), INTEGRATORS["EnergyMomentum"]
    sim = Simulation(system, integrator, ledger=True)
    sim.step(until=0.1)
    for ledger in (sim.ledger, simulate(system, integrator, until=0.1, quiet=True).ledger):
        assert np.abs(ledger["closure_error"]).max() < 1e-12 * ledger["kinetic_energy"].max()
        assert ledger["external_work"][-1] < 0


@pytest.mark.few
@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize("mixed", [False, True])
@pytest.mark.parametrize("law", [at_vertices, by_stress, in_frames])
def test_missing_energies_are_nan_and_the_rest_balances(law, mixed, integrator):
    system = body(law, mixed)
    ledger = simulate(system, INTEGRATORS[integrator], until=0.3, quiet=True).ledger
    (own,) = system.without_energy
    of_terms = [f"strain_energy {own}"] if mixed else []
    assert without_value(ledger) == ["strain_energy", *of_terms, "total_energy"]
    assert all(np.isnan(ledger[name]).all() for name in without_value(ledger))
    known = ledger["kinetic_energy"] + (ledger["strain_energy StVK 1"] if mixed else 0.0) + ledger["potential_energy"]
    np.testing.assert_array_equal(known, known_total(ledger))
    gained = known - known[0] - ledger["external_work"]
    assert ledger["closure_error"] == pytest.approx(gained, abs=1e-15)
    lost = 1e-12 if integrator == "EnergyMomentum" else 0.3 if "Euler" in integrator else 5e-3  # the force at the middle is its own
    size = ledger["kinetic_energy"].max()
    assert np.abs(gained).max() < lost * size and np.abs(ledger["external_work"]).max() > 0.02 * size


@pytest.mark.few
@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize("law", [at_vertices, by_stress])
def test_a_resumed_run_has_the_ledger_of_an_uninterrupted_run(law, integrator, tmp_path):
    """The balance includes the energies of the other half."""
    given = INTEGRATORS[integrator]
    whole = simulate(body(law, True), given, until=0.2, quiet=True)
    simulate(body(law, True), given, until=0.1, quiet=True, checkpoint=tmp_path / "run")
    resumed = simulate(body(law, True), given, until=0.2, quiet=True, checkpoint=tmp_path / "run", resume=True)
    np.testing.assert_array_equal(resumed.u, whole.u)
    np.testing.assert_array_equal(resumed.ledger.rows(), whole.ledger.rows())


def test_a_checkpoint_with_impossible_energies_is_refused(tmp_path):
    system, until = body(at_vertices, True), 0.1
    simulate(system, Newmark(0.01), until=until, quiet=True, checkpoint=tmp_path / "run")
    file = tmp_path / "run" / "motion.npz"
    header, arrays = read_archive(file, MotionCheckpoint.known, "")
    names, rows = header["record"]["columns"], arrays["rows"]
    for name, value in (
        ("strain_energy", 0.0),
        ("strain_energy Corotated 0", 0.0),
        ("total_energy", 0.0),
        ("strain_energy StVK 1", np.nan),
        ("closure_error", np.nan),
        ("strain_energy StVK 1", 1.01 * rows[:, names.index("strain_energy StVK 1")]),
        ("external_work", 1.01 * rows[:, names.index("external_work")]),
    ):
        impossible = rows.copy()
        impossible[:, names.index(name)] = value
        write_archive(file, header, arrays | {"rows": impossible})
        with pytest.raises(StvkError, match=r"motion\.npz is damaged"):
            simulate(system, checkpoint=tmp_path / "run", resume=True, until=2 * until, quiet=True)


def test_missing_energies_are_dashes_in_output_and_pictures(capsys):
    run = simulate(body(at_vertices, False), Newmark(0.01), until=0.05)
    assert "J   strain -   total -   closure error" in capsys.readouterr().out
    legend = [text.get_text() for text in run.ledger.plot().axes[0].get_legend().get_texts()]
    assert {"strain energy: -", "total energy: -", "kinetic energy"} <= set(legend)


def test_a_blow_up_without_an_energy_is_reported():
    with pytest.warns(StvkWarning):
        run = simulate(body(at_vertices, False), VelocityVerlet(0.5), until=50.0, quiet=True, raise_on_failure=False)
    assert run.status.name == "BLEW_UP" and np.isfinite(run.u).all() and "nan" not in run.message
