"""`skfem-stvk budget` measures what fits in a time step. No test asserts a time."""

from itertools import count

import meshio
import numpy as np
import pytest

from skfem_stvk import LinearBackwardEuler, ReducedSystem, Simulation, SimulationError, StVK, StvkError, System
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
    monkeypatch.setattr(budget, "solver_names", lambda: ["auto", *SOLVERS])


@pytest.fixture
def file(tmp_path):
    meshio.Mesh(MESH.p.T, [("tetra", MESH.t.T)]).write(tmp_path / "bar.vtu")
    return str(tmp_path / "bar.vtu")


def bar(step=1e-3, mesh=MESH):
    return budget.Budget(System(mesh, StVK(young=1e5, poisson=0.3, density=1e3), fixed={"left": "xyz"}), "right", step)


def lines_of(made, body):
    return [line for line in made.lines() if line.startswith(body)]


@pytest.mark.slow
def test_the_table_has_each_integrator_and_solver_each_size_and_the_response(file, capsys):
    assert main(["budget", file, *MATERIAL, "--step", "1e-3"]) == 0
    lines = capsys.readouterr().out.splitlines()
    head = next(i for i, line in enumerate(lines) if line.startswith("body "))
    table = [line.split() for line in lines[head + 1 :]]
    assert "fixed: lower end; pushed: upper end" in lines[0]
    full = [(name, solver) for name, kind in INTEGRATORS.items() for solver in ([] if kind.explicit else SOLVERS)]
    assert [tuple(line[1:3]) for line in table if line[0] == "full" and line[2] in SOLVERS] == full
    assert [(line[0], line[2]) for line in table if line[1] == "unknowns"] == [
        (size, kind.__name__) for size in ("5", "9") for kind in budget.ON_BASIS
    ]
    assert [line[0] for line in table].count("precomputed") == 1
    assert {line[-1] for line in table if line[0] in ("5", "9", "precomputed")} == {"%"}


@pytest.mark.slow
def test_a_step_above_the_critical_one_and_a_body_that_is_too_large_for_direct_solvers_are_not_measured(file, capsys, monkeypatch):
    monkeypatch.setattr(budget, "MANY", 10)
    assert main(["budget", file, *MATERIAL, "--step", "0.1"]) == 0
    rows = [line for line in capsys.readouterr().out.splitlines() if line.startswith("full")]
    assert len([line for line in rows if " above the critical step, 0.0" in line and line.endswith(" s")]) == 2
    assert len([line for line in rows if "superlu" in line and "up to 10 unknowns" in line]) == len(rows) // 2 - 1


def test_units_name_the_push_and_give_the_seconds_of_a_step(file, capsys, monkeypatch):
    """In mm-kg-ms a step of 1 is a millisecond. A modulus in Pa gets a note."""
    monkeypatch.setattr(budget.Budget, "lines", lambda self: [])
    assert main(["budget", file, *MATERIAL, "--step", "1", "--units", "mm-kg-ms"]) == 0
    out = capsys.readouterr().out
    assert " kN along " in out and " mm. In motion" in out and "fits in 1 ms?" in out
    assert "young = 100000 GPa is unusual" in out


@pytest.mark.parametrize(
    ("times", "words"), [([1, 2, 3], "yes"), ([1, 2, 5], "median only"), ([1, 5, 5], "no"), ([4, 4, 4], "yes")]
)
def test_a_row_fits_if_its_slowest_steps_do(times, words):
    line = bar(4.0)._line("full", "Newmark", lambda: (np.array(times, dtype=float), 0.02), "superlu")
    assert line.split()[:3] == ["full", "Newmark", "superlu"] and line.endswith(" 2 %") and f" 3  {words} " in line


def test_the_first_step_and_the_time_between_steps_are_not_counted(monkeypatch):
    clock, calls = count(), []
    monkeypatch.setattr(budget, "perf_counter", lambda: float(next(clock)))
    monkeypatch.setattr(budget, "SECONDS", 2.5)
    monkeypatch.setattr(budget, "STEPS", 100)
    times = budget.seconds(calls.append)
    assert times.tolist() == [1.0, 1.0, 1.0] and calls == [1, 2, 3, 4]


def test_the_error_of_a_reduced_body_is_that_of_its_displacements_under_the_push():
    made = bar()
    five, nine = (made._reduced(n, LinearBackwardEuler(dt=1e-3))[1] for n in (5, 9))
    assert 0 < nine < five < 0.2
    u = budget.solve_static(ReducedSystem(made.loaded, 5, quiet=True), quiet=True).u
    assert five == pytest.approx(np.abs(u - made.u).max() / np.abs(made.u).max(), rel=1e-3)


def test_the_push_bends_the_body_by_a_tenth_of_its_length_along_its_softest_axis():
    made = bar(mesh=box(size=(4.0, 1.0, 0.5), cells=(6, 2, 1)))
    assert made.axis == 2 and 0.2 < np.abs(made.u.reshape(-1, 3)[made.nodes, 2]).mean() < 0.42


def test_a_smaller_push_is_taken_where_the_first_has_no_equilibrium(monkeypatch):
    monkeypatch.setattr(budget, "PARTS", (1e9, 0.02))
    assert 0.05 < np.abs(bar().u).max() < 0.1


def test_a_step_without_a_state_is_a_line_with_a_reason_and_other_errors_are_raised():
    def work(error):
        raise error

    line = bar()._line("full", "Newmark", lambda: work(SimulationError(None, "No state was found.")), "superlu")
    assert line.split(maxsplit=3) == ["full", "Newmark", "superlu", "No state was found."]
    with pytest.raises(ValueError):
        bar()._line("full", "Newmark", lambda: work(ValueError()))


def test_elements_that_invert_in_the_motion_are_reported(monkeypatch):
    monkeypatch.setattr(Simulation, "inside_out", lambda self: np.arange(3))
    with pytest.raises(StvkError, match="3 elements are inverted after 3 steps"):
        bar()._reduced(5, LinearBackwardEuler(dt=1e-3))


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--step", "0"], "--step = 0.0; expected a positive time step"),
        (["--step", "nan"], "--step = nan"),
        (["--step", "1e-3", "--fixed", "wall"], "'wall'"),
        (["--step", "1e-3", "--pushed", "tip"], "'tip'"),
        (["--step", "1e-3", "--pushed", "lower end"], "all of its nodes are fixed"),
    ],
)
def test_wrong_options_are_exit_code_two(options, words, file, capsys):
    assert main(["budget", file, *MATERIAL, *options]) == 2
    assert words in " ".join(capsys.readouterr().err.split())


def test_a_body_that_is_not_held_is_refused(tmp_path, capsys):
    p = MESH.p + np.array([[3.0], [0.0], [0.0]]) * (MESH.p[1:] ** 2).sum(axis=0)  # its lower end is one node
    meshio.Mesh(p.T, [("tetra", MESH.t.T)]).write(tmp_path / "tip.vtu")
    assert main(["budget", str(tmp_path / "tip.vtu"), *MATERIAL, "--step", "1e-3"]) == 2
    assert "rigid modes left" in " ".join(capsys.readouterr().err.split())


def test_a_material_is_required(file):
    with pytest.raises(SystemExit):
        main(["budget", file, "--young", "1e5", "--step", "1e-3"])
