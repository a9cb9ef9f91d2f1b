import pickle

import meshio
import numpy as np
import pytest
from beams import beam, bent, block, column

from skfem_stvk import ElasticFoundation, Gravity, Pressure, StVK, System, Traction, solve_static
from skfem_stvk.errors import LoadError, StvkError
from skfem_stvk.linear import SuperLU
from skfem_stvk.solvers.statics import Interrupted, SolveError, Status
from skfem_stvk.terminal import Progress

MATERIAL = StVK(young=1e4, poisson=0.3, density=1.0)
PULL = Traction("tip", (0, 0, -1.0))
WALL = {"wall": "xyz"}


@pytest.fixture(scope="module")
def result():
    return solve_static(bent(), steps=3, quiet=True)


def test_one_line_per_step_is_printed(capsys):
    result = solve_static(bent(), steps=3)
    out, err = capsys.readouterr()
    lines = [line for line in out.splitlines() if not line.startswith("note: ")]  # the density of 1 kg/m^3 is noted
    assert len(lines) == 1 + len(result.history) + len(result.history.attempts)
    assert "iterations" in out and "residual" in out and not err


def test_quiet_prints_nothing(capsys):
    solve_static(bent(), steps=3, quiet=True)
    assert capsys.readouterr() == ("", "")


def test_the_record_of_a_step_is_complete(result):
    for step in result.history:
        record = step.iterations
        assert len(record.residuals) == len(record) + 1 == len(record.tangents) + 1 == len(record.linear) + 1
        assert set(record.tangents) <= {"exact", "clamped"} and all(s > 0 for s in record.lengths)
    assert sum(result.seconds.values()) > 0 and set(result.seconds) == {"assemble", "factor", "solve", "other"}
    assert np.array_equal(result.history[-1].u, result.u) and result.history.u.shape == (len(result.history), len(result.u))


def test_energies_add_up_to_the_potential_at_the_load_factor(result):
    system, u = result.system, result.u
    assert result.energies() == system.energies(u, 1.0) and result.history[-1].potential == pytest.approx(system.potential(u))
    for t in (0.3, 1.0):
        assert sum(system.energies(u, t).values()) == pytest.approx(system.potential(u, t), rel=1e-12)


def test_reactions_by_location(result):
    np.testing.assert_allclose(result.reaction().resultant, result.reaction(lambda x: x[0] == 0).resultant)


def bedded(*loads, **supports):
    """Return a body on springs with different stiffness along the axes; the end of the bed belongs to the wall."""
    bed = ElasticFoundation(lambda x: x[2] == 0, (40.0, 0.0, 90.0))
    return System(beam(), [MATERIAL, bed, *loads], **supports)


def test_reactions_of_foundations_are_those_of_their_springs():
    """The reaction of a foundation is the force of its springs, summed over the surface at rest.

    A wall supports the body, too.
    """
    system = bedded(PULL, Gravity((1.0, 2.0, -5.0)), fixed={"wall": "xyz"})
    result = solve_static(system, quiet=True, rtol=1e-12)
    floor = lambda x: (x[2] == 0) & (x[0] > 0)  # noqa: E731
    reaction = result.reaction(floor)
    by_hand = -(system.internal_force(result.u) - System(system.mesh, [MATERIAL]).internal_force(result.u)).reshape(-1, 3)
    np.testing.assert_allclose(reaction.by_node, by_hand[reaction.vertices], atol=1e-12 * np.abs(by_hand).max())
    assert (system.mesh.p[2, reaction.vertices] == 0).all() and not reaction.by_node[:, 1].any() and reaction.resultant[2] > 1.0


@pytest.mark.parametrize(
    "supports",
    [
        {"fixed": {"wall": "xyz"}},
        {"fixed": {"wall": "y"}},
        {"fixed": {"wall": "y"}, "prescribed": {lambda x: (x[2] == 0) & (x[0] > 2): {"z": 0.1}}},
    ],
    ids=["clamped", "bedded", "pressed on its bed"],
)
def test_loads_and_reactions_of_supports_and_foundations_are_in_balance(supports):
    system = bedded(PULL, Gravity((1.0, 2.0, -5.0)), Pressure("tip", 8.0), **supports)
    result = solve_static(system, quiet=True, rtol=1e-12)
    x, load = system.mesh.p.T + result.u.reshape(-1, 3), system.external_force(result.u).reshape(-1, 3)
    every, about = result.reaction(), (0.3, -1.0, 2.0)
    np.testing.assert_allclose(every.resultant, -load.sum(axis=0), atol=1e-8 * np.abs(load).sum())
    np.testing.assert_allclose(every.moment(about), -np.cross(x - about, load).sum(axis=0), atol=1e-7 * np.abs(load).sum())
    bed, wall = result.reaction(lambda x: (x[2] == 0) & (x[0] > 0)), result.reaction("wall")
    np.testing.assert_allclose(bed.resultant + wall.resultant, every.resultant, atol=1e-10)
    assert np.abs(bed.resultant).max() > 0.1 and np.abs(wall.resultant).max() > 0.1


def test_stress_by_element_and_node(result):
    mesh = result.system.mesh
    assert result.stress("cauchy").shape == (mesh.nt, 3, 3) and result.stress("von_mises", at="nodes").shape == (mesh.nv,)


def test_saved_files_hold_the_displacements(result, tmp_path):
    vtu = meshio.read(result.save(tmp_path / "beam.vtu"))
    np.testing.assert_allclose(vtu.point_data["displacement"].ravel(), result.u)
    result.save(tmp_path / "path.pvd")
    assert len(list(tmp_path.glob("path_*.vtu"))) == len(result.history)


@pytest.mark.filterwarnings("ignore:From t")
def test_states_are_saved_as_they_are_found(tmp_path):
    with pytest.raises(SolveError) as failure:
        solve_static(block(0.4), steps=4, quiet=True, save=tmp_path / "path.pvd")
    history = failure.value.result.history
    files = sorted(tmp_path.glob("path_*.vtu"))
    assert len(files) == len(history) > 0
    np.testing.assert_allclose(meshio.read(files[-1]).point_data["displacement"].ravel(), history[-1].u)


def test_ctrl_c_keeps_the_states_so_far(monkeypatch):
    def interrupt(self, line):
        if line.startswith("t ") and float(line.split()[1]) > 0.3:
            raise KeyboardInterrupt

    monkeypatch.setattr(Progress, "print", interrupt)
    with pytest.raises(KeyboardInterrupt) as caught:
        solve_static(bent(), steps=10, quiet=True)
    assert isinstance(caught.value, Interrupted)
    result = caught.value.result
    assert result.status is Status.INTERRUPTED and len(result.history) >= 2 and result.t == result.history[-1].t


def test_a_load_that_fails_during_the_solve_keeps_the_states_so_far():
    def push(t):
        if 0.5 < t < 1:  # values at 0, 1/3 and 1 are checked before the solve
            raise ZeroDivisionError("no load there")
        return (0.0, 0.0, -10 * t)

    system = System(beam(), [MATERIAL, Traction("tip", push)], fixed=WALL)
    with pytest.raises(SolveError, match=r"Interrupted at t = 0.*no load there") as failure:
        solve_static(system, steps=10, quiet=True, raise_on_failure=False)
    assert len(failure.value.result.history) >= 2 and isinstance(failure.value.__cause__, LoadError)


def test_results_and_errors_can_be_pickled(result):
    again = pickle.loads(pickle.dumps(result))
    np.testing.assert_array_equal(again.u, result.u)
    assert result == result and again != result and isinstance(hash(result), int) and len(again.history) == len(result.history)
    assert result.history[0] in result.history and len(repr(result.history[0])) < 500
    error = pickle.loads(pickle.dumps(SolveError(result)))
    assert error.result.status is result.status and isinstance(error, StvkError) and isinstance(error, RuntimeError)


def test_the_text_of_a_result_has_its_outcome(result):
    text = repr(result)
    assert "Converged" in text and f"{len(result.history)} states" in text and "factor" in text


def test_matrices_are_created_once():
    from skfem_stvk.solvers.newton.stopwatch import Stopwatch
    from skfem_stvk.solvers.statics.equilibrium import Equilibrium

    system = bent()
    problem = Equilibrium(system, SuperLU(), Stopwatch())
    problem.factorise(np.zeros(system.ndofs), 0.0)
    K, Kff = problem.tangent._K, problem.tangent._Kff
    problem.factorise(np.full(system.ndofs, 0.1), 0.0)
    assert problem.tangent._K is K and problem.tangent._Kff is Kff


def test_a_matrix_free_solve_creates_no_pattern():
    system = bent()
    solve_static(system, steps=1, solver="block-jacobi-cg", quiet=True)
    assert "pattern" not in system.__dict__


def test_iterative_solvers_are_only_as_precise_as_newton_needs():
    linear = solve_static(bent(), steps=1, solver="block-jacobi-cg", quiet=True).history[-1].iterations.linear
    assert min(linear) < 0.3 * max(linear)


def test_a_solve_in_the_plane_prints_its_hypothesis():
    assert "triangles in 2D" in repr(column(1.0))
