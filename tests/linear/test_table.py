"""The command that prints the tables of docs/measurements/solvers.md works on small bodies."""

import io
import platform

import numpy as np
import pytest
from rich.console import Console

from skfem_stvk.linear import SOLVERS
from validation import solvers


@pytest.mark.parametrize("name", [s.name for s in SOLVERS if s.name != "pardiso" or platform.machine() in ("x86_64", "AMD64")])
def test_each_solver_is_measured_and_solves(name):
    row = solvers.measured("beam 10:1", 2, name)
    assert row["n"] == solvers.unknowns_of("beam 10:1", 2) == 540
    assert row["residual"] <= solvers.RTOL and (row["iterations"] > 0) == (name in ("amg-cg", "block-jacobi-cg", "ssor-cg"))


def test_a_run_beyond_the_time_limit_is_skipped_and_reported(monkeypatch):
    monkeypatch.setattr(solvers, "LIMIT", 0)
    monkeypatch.setattr(solvers, "SOLVERS", SOLVERS[:1])
    rows = list(solvers.measurements("cube", (2, 3)))
    assert "residual" in rows[0] and rows[1]["skipped"] > 0
    console = Console(width=132, record=True, file=io.StringIO())
    console.print(solvers.table_of("cube", rows))
    assert "not run: some" in console.export_text()


def test_the_operator_is_the_matrix():
    operator, unknowns = solvers.problem("cube", 3, matrix_free=True)
    K, _ = solvers.problem("cube", 3)
    v = np.cos(np.arange(unknowns.n))
    assert np.abs(operator.matvec(v) - K @ v).max() < 1e-9 * np.abs(K @ v).max()
    d = operator.diagonal_blocks()[unknowns.vertex, unknowns.component, unknowns.component]
    assert np.abs(d - K.diagonal()).max() < 1e-9 * np.abs(d).max()
