"""`skfem-stvk budget` measures what fits in a time step. No test asserts a time."""

from itertools import count

import meshio
import numpy as np
import pytest

from skfem_stvk import ReducedSystem, Simulation, SimulationError, StVK
from skfem_stvk.mesh import box
from skfem_stvk.scenes.commands import budget
from skfem_stvk.scenes.commands.main import main
from skfem_stvk.solvers.dynamics import INTEGRATORS

MESH = box(size=(4.0, 1.0, 1.0), cells=(6, 2, 2))
MATERIAL = ["--young", "1e5", "--poisson", "0.3", "--density", "1000"]
SOLVERS = ["ssor-cg", "superlu"]


@pytest.fixture(autouse=True)
def short(monkeypatch):
    monkeypatch.setattr(budget, "STEPS", 2)
    monkeypatch.setattr(budget, "SIZES", (5, 9))
    monkeypatch.setattr(budget, "_solvers", lambda: (SOLVERS, ["petsc"]))


@pytest.fixture
def file(tmp_path):
    meshio.Mesh(MESH.p.T, [("tetra", MESH.t.T)]).write(tmp_path / "bar.vtu")
    return str(tmp_path / "bar.vtu")


def bar(step=1e-3, mesh=MESH):
    return budget.Budget(mesh, StVK(young=1e5, poisson=0.3, density=1e3), "left", "right", step)


def rows_of(made, body):
    return [budget.measured(row, work) for row, work in made.rows() if row.body == body]


@pytest.mark.slow
def test_the_table_has_each_integrator_and_solver_each_size_and_the_response(file, capsys):
    assert main(["budget", file, *MATERIAL, "--step", "1e-3"]) == 0
    lines = capsys.readouterr().out.splitlines()
    text = "\n".join(lines)
    head = next(i for i, line in enumerate(lines) if line.startswith("body "))
    plan, table = lines[:head], [line.split() for line in lines[head + 1 :]]
    assert "fixed: lower end along x; pushed: upper end along x" in plan[0] and "To measure" in plan[1]
    assert "Not installed, so not measured: petsc" in text and "Machine: " in text
    full = [(name, solver) for name, kind in INTEGRATORS.items() for solver in ([] if kind.explicit else SOLVERS)]
    assert [tuple(line[1:3]) for line in table if line[0] == "full" and line[2] in SOLVERS] == full
    assert [(line[0], line[2]) for line in table if line[1] == "unknowns"] == [
        (size, kind.__name__) for size in ("5", "9") for kind in budget.ON_BASIS
    ]
    assert [line[0] for line in table].count("precomputed") == 1
    assert {line[-1] for line in table if line[0] in ("5", "9", "precomputed")} == {"%"}


@pytest.mark.slow
def test_a_step_above_the_critical_one_is_named_and_the_critical_step_is_printed(file, capsys):
    assert main(["budget", file, *MATERIAL, "--step", "0.1"]) == 0
    out = capsys.readouterr().out
    rows = [line for line in out.splitlines() if line.startswith("full") and ("Verlet" in line or "ForwardEuler" in line)]
    assert len(rows) == 2 and all(line.endswith("above critical") for line in rows)
    assert out.count("above critical: The critical step of explicit integrators is ") == 1


def test_an_explicit_step_below_the_critical_one_is_measured():
    found = [row for row in rows_of(bar(1e-4), "full") if not row.solver]
    assert [row.integrator for row in found] == ["ForwardEuler", "VelocityVerlet"]
    assert all(row.times is not None and len(row.times) == 2 and not row.reason for row in found)


def test_units_name_the_push_and_the_critical_step_and_give_the_seconds_of_a_step(file, capsys, monkeypatch):
    """In mm-kg-ms a step of 1 is a millisecond. A modulus in Pa gets a note."""
    found = []
    monkeypatch.setattr(budget, "print_table", lambda rows, step: found.append((rows, step)))
    assert main(["budget", file, *MATERIAL, "--step", "1", "--units", "mm-kg-ms"]) == 0
    ((rows, seconds),) = found
    out = capsys.readouterr().out
    assert "steps of 1 ms of" in out and " kN along " in out and " mm. In motion" in out and seconds == pytest.approx(1e-3)
    assert "young = 100000 GPa is unusual" in out
    explained = [budget.measured(row, work).explanation for row, work in rows if row.integrator == "ForwardEuler"]
    assert explained[0].endswith(" ms.")


@pytest.mark.parametrize(
    ("times", "words"), [([1, 2, 3], "yes"), ([1, 2, 5], "median only"), ([1, 5, 5], "no"), ([4, 4, 4], "yes")]
)
def test_a_row_fits_if_its_slowest_steps_do(times, words):
    row = budget.BudgetRow("full", times=np.array(times, dtype=float))
    assert row.fits(4.0) == words and words in row.line(4.0)


def test_the_first_step_and_the_time_between_steps_are_not_counted(monkeypatch):
    clock, calls = count(), []
    monkeypatch.setattr(budget, "perf_counter", lambda: float(next(clock)))
    monkeypatch.setattr(budget, "SECONDS", 5.0)
    monkeypatch.setattr(budget, "STEPS", 100)
    times = budget.seconds(calls.append)
    assert times.tolist() == [1.0, 1.0, 1.0] and calls == [1, 2, 3, 4]


def test_the_error_of_a_reduced_body_is_that_of_its_displacements_under_the_push():
    made = bar()
    by_size = {row.body: row.error for body in ("5 unknowns", "9 unknowns") for row in rows_of(made, body)}
    assert 0 < by_size["9 unknowns"] < by_size["5 unknowns"] < 0.2
    own = ReducedSystem(made.loaded, 5, quiet=True)  # of its own modes, not of the columns of the larger basis
    u = budget.solve_static(own, quiet=True).u
    assert by_size["5 unknowns"] == pytest.approx(np.abs(u - made.u).max() / np.abs(made.u).max(), rel=1e-3)
    made.u = 1.5 * made.u
    assert rows_of(made, "9 unknowns")[0].error == pytest.approx(1 / 3, abs=0.05)


def test_the_push_bends_the_body_by_a_tenth_of_its_length_along_its_softest_axis():
    made = bar(mesh=box(size=(4.0, 1.0, 0.5), cells=(6, 2, 1)))
    assert made.axis == 2 and 0.2 < np.abs(made.u.reshape(-1, 3)[made.nodes, 2]).mean() < 0.42


def test_a_smaller_push_is_taken_where_the_first_has_no_equilibrium(monkeypatch):
    monkeypatch.setattr(budget, "PARTS", (1e9, 0.02))
    assert 0.05 < np.abs(bar().u).max() < 0.1


@pytest.mark.parametrize(
    ("error", "reason"), [(SimulationError(None, "No state was found."), "no state"), (ValueError, None)], ids=["step", "bug"]
)
def test_a_step_without_a_state_is_a_row_with_a_reason_and_other_errors_are_raised(error, reason, monkeypatch):
    made = bar()

    def step(self, **inputs):
        raise error

    monkeypatch.setattr(Simulation, "step", step)
    if reason is None:
        with pytest.raises(ValueError):
            rows_of(made, "9 unknowns")
    else:
        found = rows_of(made, "9 unknowns")
        assert [(row.reason, row.explanation) for row in found] == 2 * [(reason, "No state was found.")]


def test_elements_that_invert_in_the_motion_are_reported(monkeypatch):
    made = bar()
    monkeypatch.setattr(Simulation, "inside_out", lambda self: np.arange(3))
    (row, _) = rows_of(made, "9 unknowns")
    assert row.reason == "inverted" and row.explanation == "3 elements are inverted after 3 steps." and row.times is None


def test_what_a_body_does_not_take_is_named(monkeypatch):
    monkeypatch.setattr(budget, "_solvers", lambda: (["superlu", "nothing"], []))
    monkeypatch.setattr(budget, "MANY", 10)
    monkeypatch.setattr(budget, "SIZES", (5, 5000))
    made = bar()
    named = {row.solver: row for row in rows_of(made, "full") if row.solver}
    assert named["superlu"].reason == "too large" and "up to 10 unknowns" in named["superlu"].explanation
    assert named["nothing"].reason == "refused" and "solver = 'nothing'" in named["nothing"].explanation
    assert {row.reason for row in rows_of(made, "5000 unknowns")} == {"too few unknowns"}


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--step", "0"], "--step = 0.0; expected a positive time step"),
        (["--step", "nan"], "--step = nan"),
        (["--step", "1e-3", "--fixed", "wall"], "'wall'"),
        (["--step", "1e-3", "--pushed", "tip"], "'tip'"),
        (["--step", "1e-3", "--pushed", "lower end along x"], "all of its nodes are fixed"),
    ],
)
def test_wrong_options_are_exit_code_two(options, words, file, capsys):
    assert main(["budget", file, *MATERIAL, *options]) == 2
    assert words in " ".join(capsys.readouterr().err.split())


def test_a_body_that_is_not_held_names_the_option(tmp_path, capsys):
    p = MESH.p + np.array([[3.0], [0.0], [0.0]]) * (MESH.p[1:] ** 2).sum(axis=0)  # its lower end is one node
    meshio.Mesh(p.T, [("tetra", MESH.t.T)]).write(tmp_path / "tip.vtu")
    assert main(["budget", str(tmp_path / "tip.vtu"), *MATERIAL, "--step", "1e-3"]) == 2
    err = " ".join(capsys.readouterr().err.split())
    assert "rigid modes left" in err and "--fixed NAME" in err


def test_a_material_is_required(file):
    with pytest.raises(SystemExit):
        main(["budget", file, "--young", "1e5", "--step", "1e-3"])
