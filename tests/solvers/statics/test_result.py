import pickle

import meshio
import numpy as np
import pytest
from beams import beam, bent, block, column

from skfem_stvk import ElasticFoundation, Gravity, Isotropic, Pressure, StVK, System, Traction, solve_static
from skfem_stvk.errors import LoadError, RegionError, StateError, StvkError, SupportError
from skfem_stvk.linear import SuperLU
from skfem_stvk.solvers.statics import Interrupted, SolveError, Status
from skfem_stvk.solvers.statics import path_outputs as outputs

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


def test_energies_add_up_to_the_potential(result):
    assert sum(result.energies().values()) == pytest.approx(result.system.potential(result.u), rel=1e-12)
    assert result.history[-1].potential == pytest.approx(result.system.potential(result.u), rel=1e-12)


def test_reactions_by_location(result):
    np.testing.assert_allclose(result.reaction().resultant, result.reaction(lambda x: x[0] == 0).resultant)
    with pytest.raises(SupportError, match="reaction: no support and no foundation acts at 'tip'"):
        result.reaction("tip")
    with pytest.raises(RegionError, match=r"'wall'"):
        result.reaction("wal")


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
    with pytest.raises(StvkError, match="pk1"):
        result.stress("piola")
    with pytest.raises(StvkError, match="known: 'elements', 'nodes'"):
        result.stress("cauchy", at="vertices")


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
    def interrupt(self, outcome):
        if outcome.t > 0.3:
            raise KeyboardInterrupt

    monkeypatch.setattr(outputs.PathProgress, "line", interrupt)
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
        solve_static(system, steps=10, quiet=True)
    assert len(failure.value.result.history) >= 2 and isinstance(failure.value.__cause__, LoadError)


def test_results_and_errors_can_be_pickled(result):
    again = pickle.loads(pickle.dumps(result))
    np.testing.assert_array_equal(again.u, result.u)
    error = pickle.loads(pickle.dumps(SolveError(result)))
    assert error.result.status is result.status


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


@pytest.mark.parametrize(
    ("make", "error", "message"),
    [
        (lambda: System(beam(), [MATERIAL], fixed=WALL), LoadError, "Nothing acts on the body"),
        (lambda: System(beam(), [MATERIAL, PULL]), SupportError, r"Not held: .*6 rigid modes.*translation along x.*rotation"),
        (
            lambda: System(beam(), [MATERIAL, PULL], fixed={"wall": "xy"}),
            SupportError,
            r"has 1 rigid mode left, translation along z\.",
        ),
        (lambda: System(beam(), [MATERIAL, PULL], fixed=WALL, dtype=np.float32), StvkError, "float32.*float64"),
    ],
)
def test_unsolvable_problems_are_refused_before_the_solve(make, error, message):
    with pytest.raises(error, match=message):
        solve_static(make(), quiet=True)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"steps": 0}, "steps = 0; expected a whole number"),
        ({"steps": 2.5}, "steps = 2.5"),
        ({"rtol": 0.0}, "rtol = 0.0"),
        ({"rtol": float("nan")}, "rtol = nan"),
        ({"solver": "mumps"}, "solver = 'mumps'; expected 'auto', 'superlu'"),
        ({"u0": np.zeros(5)}, r"shape \(5,\)"),
        ({"save": "nowhere/at/all.pvd"}, "nowhere"),
    ],
)
def test_invalid_parameters_are_refused(options, message):
    with pytest.raises(StvkError, match=message):
        solve_static(bent(), quiet=True, **options)


def test_a_start_with_nan_is_refused():
    system = bent()
    with pytest.raises(StateError, match="not finite in 1 entry"):
        solve_static(system, u0=np.where(np.arange(system.ndofs) == 3, np.nan, 0.0), quiet=True)


def test_bad_supports_loads_and_materials_are_refused():
    with pytest.raises(RegionError, match=r"'wal'.*'wall'"):
        System(beam(), [MATERIAL], fixed={"wal": "xyz"})
    with pytest.raises(RegionError, match=r"'tipp'.*'tip'"):
        System(beam(), [MATERIAL, Traction("tipp", (0, 0, 1.0))])
    with pytest.raises(StvkError, match="fixed and prescribed"):
        System(beam(), [MATERIAL], fixed=WALL, prescribed={"wall": {"x": 0.1}})
    with pytest.raises(ValueError, match="density"):
        System(beam(), [StVK(Isotropic(1e4, 0.3)), Gravity(g=(0, 0, -9.81))])


def test_a_solve_in_the_plane_prints_its_hypothesis():
    assert "triangles in 2D" in repr(column(1.0))
