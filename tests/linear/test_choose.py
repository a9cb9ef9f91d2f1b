"""Solvers are chosen by name, by object, and automatically."""

import importlib
import sys

import pytest
import skfem
from linear.problems import problem

from skfem_stvk import StVK, System
from skfem_stvk.errors import StvkError
from skfem_stvk.linear import SOLVERS, AmgCg, Kind, Pardiso, SuperLU, choose
from skfem_stvk.linear import choose as function
from skfem_stvk.system.free_tangent import entries_of

module = importlib.import_module(function.__module__)


@pytest.mark.parametrize("solver", SOLVERS, ids=lambda s: s.name)
def test_a_name_and_an_object_are_the_same_solver(solver):
    assert choose(solver.name, 100, Kind.SYMMETRIC) == solver == choose(solver, 100, Kind.SYMMETRIC)


@pytest.mark.parametrize("wrong", ["umfpack", 3, None])
def test_an_unknown_solver_is_refused_with_the_known_names(wrong):
    with pytest.raises(StvkError, match=r"'auto', 'superlu', 'pardiso', 'amg-cg', 'block-jacobi-cg', 'ssor-cg'"):
        choose(wrong, 100, Kind.SYMMETRIC)


def test_a_solver_unsuited_to_the_matrix_is_refused_before_any_work():
    with pytest.raises(StvkError, match="kind = general; expected at most symmetric"):
        choose("amg-cg", 100, Kind.GENERAL)


@pytest.mark.parametrize("installed", [True, False])
@pytest.mark.parametrize("kind", Kind)
@pytest.mark.parametrize("n", [10, 3_000, 300_000])
def test_the_automatic_choice_suits_the_matrix_and_is_installed(installed, kind, n, monkeypatch):
    monkeypatch.setattr(module, "pardiso_is_installed", lambda: installed)
    chosen = choose("auto", n, kind)
    assert chosen.takes >= kind and (installed or chosen != Pardiso())
    assert (chosen == AmgCg()) == (n == 300_000 and kind != Kind.GENERAL)
    assert n > 10 or chosen == SuperLU()


@pytest.mark.parametrize(("installed", "solver"), [(True, Pardiso()), (False, AmgCg())])
def test_with_10_000_unknowns_pardiso_is_chosen_if_installed(installed, solver, monkeypatch):
    monkeypatch.setattr(module, "pardiso_is_installed", lambda: installed)
    assert choose("auto", 10_000, Kind.SYMMETRIC) == solver


@pytest.mark.parametrize(("row", "solver"), [(45, Pardiso()), (80, AmgCg())])
def test_more_entries_per_row_favour_multigrid(row, solver, monkeypatch):
    monkeypatch.setattr(module, "pardiso_is_installed", lambda: True)
    assert choose("auto", 10_000, Kind.SYMMETRIC, entries=row * 10_000) == solver
    assert choose("auto", 10_000, Kind.GENERAL, entries=row * 10_000) == Pardiso()


@pytest.mark.few
@pytest.mark.parametrize("installed", [True, False])
@pytest.mark.parametrize(
    ("make", "degree", "fewest"),
    [
        (skfem.MeshTri, 1, (15_000, 10_000)),
        (skfem.MeshQuad, 1, (15_000, 10_000)),
        (skfem.MeshTri, 2, (30_000, 20_000)),
        (skfem.MeshTet, 1, (15_000, 6_000)),
        (skfem.MeshTet, 2, (1_500, 1_500)),
        (skfem.MeshHex, 1, (1_500, 1_500)),
    ],
)
def test_the_smallest_size_for_multigrid_depends_on_the_element(make, degree, fewest, installed, monkeypatch):
    monkeypatch.setattr(module, "pardiso_is_installed", lambda: installed)
    system = System(make().refined(4 if degree == 1 else 3), StVK(young=1.0, poisson=0.3), degree=degree if degree == 2 else None)
    row, threshold = entries_of(system) / system.ndofs, fewest[0 if installed else 1]
    assert choose("auto", threshold, Kind.SYMMETRIC, entries=round(row * threshold)) == AmgCg()
    assert choose("auto", threshold - 1, Kind.SYMMETRIC, entries=round(row * (threshold - 1))) != AmgCg()


@pytest.mark.parametrize("degree", [1, 2])
def test_entries_of_K_are_counted_before_assembly(degree):
    system = System(skfem.MeshTet().refined(1), StVK(young=1.0, poisson=0.3), degree=degree)
    assert entries_of(system) == system.pattern.nnz


def test_a_missing_pypardiso_names_the_line_that_installs_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "pypardiso", None)
    monkeypatch.setitem(sys.modules, "pypardiso.pardiso_wrapper", None)
    with pytest.raises(ImportError, match=r"pip install 'skfem-stvk\[pardiso\]'"):
        Pardiso().analyse(problem()[1])


def test_pypardiso_is_not_imported_before_it_is_used():
    import subprocess

    code = "import sys, skfem_stvk.linear; sys.exit('pypardiso' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code]).returncode == 0
