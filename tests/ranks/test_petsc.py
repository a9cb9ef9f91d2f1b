"""PETSc solves as the other solvers do, on one machine and on ranks; tests of `.ci/petsc`, skipped without petsc4py."""

import json
import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from bodies import EVERY_MESH
from buckled import compressed, strut
from linear.problems import NAMES, indefinite, problem

from skfem_stvk import Pressure, StVK, System, Traction, solve_static
from skfem_stvk.errors import StvkError
from skfem_stvk.linear import Kind, Outcome, Petsc, SuperLU, Unknowns, choose, petsc
from skfem_stvk.solvers.newton.outcome import Status
from skfem_stvk.space import Space

needs_petsc = pytest.mark.skipif(not Petsc().available, reason="petsc4py cannot be imported: see docs/how-to/cluster.md")
SYMMETRIC, GENERAL = Kind.SYMMETRIC, Kind.GENERAL


def test_the_page_the_error_and_ci_install_the_same():
    root = Path(__file__).parents[2]
    page, ci = (root / "docs" / "how-to" / "cluster.md").read_text(), (root / ".ci" / "petsc").read_text()
    for line in ("apt install python3-petsc4py python3-petsc4py-real python3-mpi4py", 'pip install ".[mpi]" "numpy<2"'):
        assert page.count(line) == petsc.MISSING.count(line) == ci.count(line) == 1
    for text in (page, petsc.MISSING):
        assert "/usr/bin/python3 -m venv --system-site-packages venv" in text
    assert "/usr/bin/python3 -m venv --system-site-packages " in ci


def solved(K, unknowns, options="", kind=SYMMETRIC, rtol=1e-10):
    """Return the solution for a random force."""
    b = np.random.default_rng(3).standard_normal(unknowns.n)
    return Petsc(options).analyse(unknowns).factorise(K, kind).solve(b, rtol)


def left(x):
    return x[0] < np.quantile(x[0], 0.2)


def body(name, *loads):
    mesh = EVERY_MESH[name]
    terms = [StVK(young=np.random.default_rng(4).uniform(1, 5, mesh.nt), poisson=0.3), *loads]
    return System(mesh, terms, fixed={left: "xyz"[: mesh.d]})


@needs_petsc
@pytest.mark.parametrize("name", ["tetrahedra", "quadratic tetrahedra", "hexahedra", "triangles", "quadratic triangles"])
def test_a_static_solve_is_that_of_superlu(name):
    d = EVERY_MESH[name].d
    system = body(name, Traction(lambda x: x[0] > 0.5, 0.01 * np.arange(1, d + 1)))
    one, other = (solve_static(system, 2, solver=solver, rtol=1e-12, quiet=True) for solver in ("petsc", "superlu"))
    assert one.solver == "petsc" and np.abs(one.u).max() > 1e-3
    assert np.abs(one.u - other.u).max() < 1e-11 * np.abs(other.u).max()


@needs_petsc
def test_a_follower_load_makes_k_unsymmetric_and_gmres_solves():
    system = body("tetrahedra", Pressure(lambda x: x[0] > 0.5, 0.05))
    one, other = (solve_static(system, 1, solver=solver, rtol=1e-12, quiet=True).u for solver in ("petsc", "superlu"))
    assert np.abs(one - other).max() < 1e-11 * np.abs(other).max()
    K, unknowns = problem()
    K.data *= 1 + 0.2 * np.random.default_rng(5).uniform(-1, 1, K.nnz)
    analysis, b = Petsc().analyse(unknowns), np.ones(unknowns.n)
    for kind, name in ((GENERAL, "gmres"), (SYMMETRIC, "cg"), (GENERAL, "gmres")):
        factors = analysis.factorise(K, kind)
        assert analysis.method.getType() == name
    assert np.linalg.norm(b - K @ factors.solve(b, 1e-10).x) <= 1e-10 * np.linalg.norm(b)


@pytest.mark.few
@needs_petsc
@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("below", [1, 3])
def test_an_indefinite_matrix_is_never_solved(name, below):
    K, unknowns = problem(name)
    assert solved(indefinite(K, unknowns, below), unknowns).outcome is Outcome.NEGATIVE_CURVATURE
    assert solved(-K, unknowns).outcome is Outcome.NEGATIVE_CURVATURE
    assert solved(-K, unknowns, "-pc_type jacobi -ksp_type cg").outcome is Outcome.NEGATIVE_CURVATURE


@needs_petsc
def test_the_coarsest_matrix_shows_a_mode_that_conjugate_gradients_cannot_see():
    """K and its multigrid have negative eigenvalues along the same mode, so that their product is positive definite."""
    K, unknowns = problem("membrane")
    K = indefinite(K, unknowns, 1)
    values, vectors = np.linalg.eigh(K.toarray())
    b = vectors @ np.where(values < 0, 1e-3, 1.0)
    factors = Petsc().analyse(unknowns).factorise(K, SYMMETRIC)
    assert factors.solve(b, 1e-3).outcome is Outcome.NEGATIVE_CURVATURE
    factors._indefinite = False
    assert factors.solve(b, 1e-3).outcome is Outcome.SOLVED


@needs_petsc
def test_each_matrix_has_a_preconditioner_of_its_own():
    """The unknowns of the second matrix have other stiffnesses than those of the first one."""
    K, unknowns = problem()
    other, scale = K.copy(), 10.0 ** np.random.default_rng(6).uniform(-2, 2, unknowns.n // 3 + 99)[unknowns.vertex % 99]
    other.data *= scale[np.repeat(np.arange(unknowns.n), np.diff(K.indptr))] * scale[K.indices]
    analysis, b = Petsc("-pc_type ilu -ksp_type cg").analyse(unknowns), np.ones(unknowns.n)
    analysis.factorise(K, SYMMETRIC).solve(b, 1e-8)
    again, first = analysis.factorise(other, SYMMETRIC).solve(b, 1e-8), Petsc("-pc_type ilu -ksp_type cg").analyse(unknowns)
    assert again.iterations == first.factorise(other, SYMMETRIC).solve(b, 1e-8).iterations


@needs_petsc
def test_slow_multigrid_is_built_again_from_the_start():
    K, unknowns = problem()
    analysis = Petsc().analyse(unknowns)
    analysis.factorise(K, SYMMETRIC).solve(np.ones(unknowns.n))
    method = analysis.method
    analysis.factorise(K, SYMMETRIC)
    assert analysis.method is method and analysis.pace.first > 1
    analysis.pace.is_slow = True
    analysis.factorise(K, SYMMETRIC).solve(np.ones(unknowns.n))
    assert analysis.method is not method and not analysis.pace.is_slow


OPTIONS = {
    "-ksp_type minres -pc_type jacobi": "minres",
    "-ksp_type preonly -pc_type lu": "preonly",
    "-pc_type jacobi -ksp_max_it 2000": "cg",
    "-pc_gamg_threshold -1 -mg_levels_ksp_max_it 3": "cg",
}


@needs_petsc
@pytest.mark.parametrize("options", OPTIONS)
def test_options_choose_the_method_and_leave_the_database_as_it_was(options):
    from petsc4py import PETSc

    before = PETSc.Options().getAll()
    K, unknowns = problem()
    analysis = Petsc(options).analyse(unknowns)
    solution = analysis.factorise(K, SYMMETRIC).solve(np.ones(unknowns.n), 1e-9)
    assert solution.outcome is Outcome.SOLVED and analysis.method.getType() == OPTIONS[options]
    assert PETSc.Options().getAll() == before


@needs_petsc
@pytest.mark.parametrize(
    "options, words",
    [
        ("-pc_type nonsense", "Unable to find requested PC type nonsense"),
        ("-ksp_tpye cg -pc_type jacobi", r"PETSc has not used -ksp_tpye\."),
        ("-stvk_pc_type jacobi", "PETSc has not used -stvk_pc_type"),
    ],
)
def test_options_that_petsc_refuses_or_ignores_are_errors(options, words):
    K, unknowns = problem()
    with pytest.raises(StvkError, match=words):
        Petsc(options).analyse(unknowns).factorise(K, SYMMETRIC)


@pytest.mark.parametrize("options", [3, None, "ksp_type cg", "-1"])
def test_text_without_options_is_refused(options):
    with pytest.raises(StvkError, match="expected PETSc's options, such as '-ksp_type cg -pc_type gamg'"):
        Petsc(options)


@needs_petsc
def test_options_of_the_database_precede_and_reach_the_solver():
    code = (
        "from linear.problems import problem\n"
        "from skfem_stvk.linear import Kind, Petsc\n"
        "K, unknowns = problem()\n"
        "Petsc('-ksp_type minres').analyse(unknowns).factorise(K, Kind.SYMMETRIC).solve(K @ (K[0].toarray()[0]))\n"
    )
    environment = {
        "PETSC_OPTIONS": "-stvk_ksp_monitor -stvk_ksp_type cg -stvk_ksp_view",
        "PYTHONPATH": str(Path(__file__).parents[1]),
    }
    done = subprocess.run(
        [sys.executable, "-c", code], env={**os.environ, **environment}, capture_output=True, text=True, check=True
    )
    assert "KSP Residual norm" in done.stdout and "type: cg" in done.stdout and "near null space" in done.stdout


@needs_petsc
def test_petsc_leaves_signals_to_python():
    code = (
        "import os\n"
        "from skfem_stvk.linear import Petsc\n"
        "assert Petsc().available\n"
        "read, write = os.pipe()\n"
        "os.close(read)\n"
        "try:\n    os.write(write, b'x')\n"
        "except BrokenPipeError:\n    print('broken pipe')\n"
    )
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False).stdout == "broken pipe\n"


@needs_petsc
def test_each_reason_has_an_outcome_and_an_unknown_one_is_a_failure():
    from petsc4py import PETSc

    reasons = {value: name for name, value in vars(PETSc.KSP.ConvergedReason).items() if not name.startswith("_") and value}
    assert {value for value in reasons if value > 0} <= set(petsc.OUTCOMES)
    assert {reasons[value]: outcome for value, outcome in petsc.OUTCOMES.items() if value in (-3, -8, -9, -10, -11, 5)} == {
        "DIVERGED_MAX_IT": Outcome.OUT_OF_ITERATIONS,
        "DIVERGED_INDEFINITE_PC": Outcome.NEGATIVE_CURVATURE,
        "DIVERGED_NANORINF": Outcome.NOT_FINITE,
        "DIVERGED_INDEFINITE_MAT": Outcome.NEGATIVE_CURVATURE,
        "DIVERGED_PCSETUP_FAILED": Outcome.SINGULAR,
        "CONVERGED_CG_NEG_CURVE": Outcome.NEGATIVE_CURVATURE,
    }
    assert not [value for value, outcome in petsc.OUTCOMES.items() if value <= 0 and outcome is Outcome.SOLVED]


@needs_petsc
def test_an_unknown_reason_is_a_failure_and_a_residual_is_not_believed():
    K, unknowns = problem()
    analysis, exact = Petsc().analyse(unknowns), Petsc("-ksp_type preonly -pc_type cholesky").analyse(unknowns)
    factors = analysis.factorise(K, SYMMETRIC)
    exact.factorise(K, SYMMETRIC)
    analysis.method = SimpleNamespace(setTolerances=lambda rtol: None, solve=exact.method.solve, its=1, reason=-77)
    assert factors.solve(np.ones(unknowns.n)).outcome is Outcome.INACCURATE
    analysis.method.reason = 2
    assert factors.solve(np.ones(unknowns.n)).outcome is Outcome.SOLVED

    def half(b, y):
        exact.method.solve(b, y)
        y.scale(0.5)

    analysis.method.solve = half
    assert factors.solve(np.ones(unknowns.n)).outcome is Outcome.INACCURATE


@needs_petsc
def test_a_negative_diagonal_entry_is_seen():
    """The first node is coupled to no other, so that multigrid leaves it to Jacobi's method, which would have the sign of K."""
    K, unknowns = problem()
    row = np.repeat(np.arange(unknowns.n), np.diff(K.indptr))
    n = np.count_nonzero(unknowns.vertex == unknowns.vertex[0])
    K.data[((row < n) | (K.indices < n)) & (row != K.indices)] = 0
    K.data[(row == 0) & (K.indices == 0)] *= -1
    assert solved(K, unknowns).outcome is Outcome.NEGATIVE_CURVATURE


@needs_petsc
def test_too_few_iterations_are_an_outcome():
    K, unknowns = problem()
    assert solved(K, unknowns, "-ksp_max_it 3").outcome is Outcome.OUT_OF_ITERATIONS


@needs_petsc
def test_direct_factors_of_petsc_are_exact():
    K, unknowns = problem()
    b = np.ones(unknowns.n)
    expected = SuperLU().analyse(unknowns).factorise(K, SYMMETRIC).solve(b).x
    solution = Petsc("-ksp_type preonly -pc_type cholesky").analyse(unknowns).factorise(K, SYMMETRIC).solve(b, 1e-10)
    assert solution.iterations == 1 and np.abs(solution.x - expected).max() < 1e-10 * np.abs(expected).max()


@needs_petsc
@pytest.mark.parametrize("package", ["petsc", "mumps"])
@pytest.mark.parametrize("below", [0, 1, 3])
def test_cholesky_factors_count_negative_eigenvalues(package, below):
    K, unknowns = problem("soft and stiff")
    if below:
        K = indefinite(K, unknowns, below)
    solver = Petsc(f"-ksp_type preonly -pc_type cholesky -pc_factor_mat_solver_type {package}")
    factors = solver.analyse(unknowns).factorise(K, SYMMETRIC)
    assert factors.negative_pivots == below and not solver.iterative
    assert factors.solve(np.ones(unknowns.n), 1e-6).outcome is Outcome.SOLVED


@needs_petsc
@pytest.mark.parametrize("method", ["preonly", "cg"])
def test_pivots_of_petsc_find_an_unstable_state(method):
    """A bar that is compressed beyond its critical load, in the straight state."""
    system = compressed(strut())
    other, one = (
        solve_static(system, 1, solver=solver, raise_on_failure=False, quiet=True)
        for solver in ("superlu", Petsc(f"-ksp_type {method} -pc_type cholesky"))
    )
    assert one.status is other.status is Status.UNSTABLE
    assert "K has 3 negative eigenvalue(s)" in one.message and "K has 3 negative eigenvalue(s)" in other.message


@pytest.mark.parametrize("name", NAMES)
def test_block_rows_are_k_with_a_diagonal_for_constrained_components(name):
    K, unknowns = problem(name)
    rows = petsc.BlockRows(unknowns, Space(unknowns.n))
    rows.fill(K.data)
    full = type(K)((rows.values, rows.indices, rows.indptr)).toarray()
    rest = np.setdiff1d(np.arange(len(full)), rows.dofs)
    assert np.array_equal(full[np.ix_(rows.dofs, rows.dofs)], K.toarray())
    assert not full[np.ix_(rest, rows.dofs)].any() and (np.diag(full)[rest] > 0).all()
    assert len(full) == rows.d * len(np.unique(unknowns.vertex)) and len(full) % rows.d == 0
    assert (np.diff(rows.indptr).reshape(-1, rows.d) == np.diff(rows.indptr)[:: rows.d, None]).all()
    assert np.array_equal(rows.own, np.arange(len(full))) and np.array_equal(rows.numbers, np.arange(len(full) // rows.d))


def test_a_structure_without_a_diagonal_is_refused():
    indptr, indices = np.array([0, 1, 2]), np.array([1, 0])
    with pytest.raises(StvkError, match=r"K has no diagonal block in 2 rows \(0, 1\)"):
        petsc.BlockRows(Unknowns(np.arange(2), np.zeros(2, dtype=int), indptr, indices), Space(2))


def test_dependent_rigid_modes_are_left_out():
    modes = np.random.default_rng(1).standard_normal((30, 3)) @ np.array([[1.0, 0, 2, 1], [0, 1, 1, 1], [0, 0, 0, 0]])
    V = petsc.orthonormal(modes, Space(30))
    assert V.shape == (30, 2) and np.abs(V.T @ V - np.eye(2)).max() < 1e-12
    assert np.abs(V @ (V.T @ modes) - modes).max() < 1e-12


def test_a_matrix_beyond_the_integers_of_petsc_is_refused():
    petsc.check_range(2.0**31 - 1, np.int32)
    with pytest.raises(StvkError, match="K has 2147483648 rows, or entries on one rank; expected at most 2147483647"):
        petsc.check_range(2.0**31, np.int32)


def test_a_missing_petsc4py_names_the_lines_that_install_it(monkeypatch):
    unknowns = problem()[1]
    monkeypatch.setitem(sys.modules, "petsc4py", None)
    petsc._package.cache_clear()
    with pytest.raises(ImportError, match=r"(?s)apt install python3-petsc4py .*PETSC_DIR=.*conda-forge petsc4py"):
        choose("petsc", 10, SYMMETRIC).analyse(unknowns)
    assert choose("auto", 10, SYMMETRIC, divided=True).name == "block-jacobi-cg" and not Petsc().available
    petsc._package.cache_clear()


@needs_petsc
def test_another_mpi_library_than_that_of_mpi4py_is_refused(monkeypatch):
    from mpi4py import MPI

    monkeypatch.setattr(MPI, "Get_library_version", lambda: "MPICH 4.2\0")
    petsc._package.cache_clear()
    with pytest.raises(ImportError, match=r"petsc4py uses the MPI library 'Open MPI.*'; expected that of mpi4py, 'MPICH 4.2'"):
        petsc._package()
    petsc._package.cache_clear()


@needs_petsc
def test_the_documented_program_with_snes_finds_the_state_of_the_static_solve():
    page = (Path(__file__).parents[2] / "docs" / "how-to" / "cluster.md").read_text()
    names = {}
    exec(page.split("```python\n# snes.py\n")[1].split("```")[0], names)
    expected = solve_static(names["system"], solver="superlu", rtol=1e-12, quiet=True).u
    assert names["snes"].reason > 0 and names["snes"].its > 3 and np.abs(expected).max() > 0.1
    assert np.abs(names["u"] - expected).max() < 1e-9 * np.abs(expected).max()


@needs_petsc
@pytest.mark.parametrize("ranks", [2, 3])
def test_displacements_on_ranks_are_those_on_one_machine(ranks, on_ranks, tmp_path):
    """An infinite difference stands for other bits at shared nodes."""
    on_ranks(ranks, Path(__file__).with_name("petsc_on_ranks.py"), tmp_path / "out.json", timeout=300)
    found = json.loads((tmp_path / "out.json").read_text())
    assert found.pop("indefinite") == [True, False] and "K has 3 negative eigenvalue(s)" in found.pop("counted") and len(found) > 30
    assert not {case: value for case, value in found.items() if not value <= 1e-12}
