"""What a new integrator, linear solver, peer, command or hard case takes: a file, such as those in `extensions`, and a row.

Toy laws and loads are in `terms/toys.py`; `terms/test_toys.py` takes them through whole analyses.
"""

import sys

import numpy as np
import pytest
from bodies import box
from extensions import command, hard_case, integrator, peer, solver

from skfem_stvk import Gravity, StVK, System, Traction, VelocityVerlet, modes, simulate, solve_static
from skfem_stvk.cli.main import COMMANDS, Command, main
from skfem_stvk.dynamics import INTEGRATORS
from skfem_stvk.errors import SceneError
from skfem_stvk.linear import SOLVERS
from skfem_stvk.peers import PEERS, available, load
from skfem_stvk.peers.peer import Package
from skfem_stvk.scene import Scene
from skfem_stvk.scene.templates import json_schema
from validation import hard
from validation.bench import Plan, bench

STEEL = StVK(young=1e5, poisson=0.3, density=1000.0)
#: A scene that each of these changes.
BAR = {
    "mesh": {"type": "box", "size": [2.0, 1.0, 1.0], "cells": [2, 1, 1]},
    "materials": {"steel": {"model": "isotropic", "young": 1e5, "poisson": 0.3}},
    "terms": [{"type": "stvk", "material": "steel"}, {"type": "traction", "on": "right", "traction": [0.0, 0.0, -2e3]}],
    "fixed": {"left": "xyz"},
    "analysis": {"type": "static", "steps": 2},
}


def bar(*loads):
    return System(box(2), [STEEL, *loads], fixed={lambda x: x[0] < 0.1: "xyz"})


@pytest.fixture
def drift_kick(monkeypatch):
    monkeypatch.setitem(INTEGRATORS, "DriftKick", integrator.DriftKick)
    return integrator.DriftKick


def test_an_integrator_is_a_file_and_a_row(drift_kick, tmp_path):
    """It moves a body with the order that it declares, finds its critical step, and goes on from a checkpoint."""
    mesh = box(2)
    system, push = System(mesh, STEEL), 0.5 * np.sin(3 * mesh.p[::-1]).ravel("F")
    ends = [simulate(system, drift_kick(dt=dt), until=0.016, v0=push, quiet=True).v for dt in (2e-4, 1e-4)]
    truth = simulate(system, VelocityVerlet(dt=2e-5), until=0.016, v0=push, quiet=True).v
    errors = [np.abs(v - truth).max() for v in ends]
    assert errors[0] / errors[1] == pytest.approx(2, rel=0.1) and errors[1] < 0.1 * np.abs(truth).max()
    run = simulate(system, drift_kick(), until=0.02, v0=push, quiet=True, checkpoint=tmp_path / "run")
    momenta = [run.ledger[f"linear_momentum_{x}"] for x in "xyz"]
    assert run.success and np.ptp(momenta, axis=1).max() < 1e-12 * np.abs(momenta).max()
    longer = simulate(system, checkpoint=tmp_path / "run", resume=True, until=0.03, quiet=True)
    assert np.array_equal(longer.u, simulate(system, drift_kick(), until=0.03, v0=push, quiet=True).u)


def test_a_linear_solver_is_a_file_and_a_row(monkeypatch):
    """Statics, arc length, implicit steps and modes take it by its name."""
    monkeypatch.setattr(sys.modules["skfem_stvk.linear.choose"], "SOLVERS", (*SOLVERS, solver.Dense()))
    system = bar(Traction(lambda x: x[0] > 0.9, (0, 0, -2e3)))
    by, right = (solve_static(system, steps=2, solver=name, quiet=True) for name in ("dense", "superlu"))
    assert by.success and by.solver == "dense" and np.abs(by.u - right.u).max() < 1e-7 * np.abs(right.u).max()
    path = solve_static(system, steps=2, solver="dense", method="arc-length", quiet=True)
    assert np.abs(path.u - right.u).max() < 1e-7 * np.abs(right.u).max() and path.history[-1].negative == 0
    assert modes(system, 2, solver="dense").frequencies == pytest.approx(modes(system, 2, solver="superlu").frequencies)


def test_a_scene_takes_an_integrator_and_a_linear_solver_by_their_row(drift_kick, monkeypatch):
    """Those that are registered when it is checked, with the same results as in Python; others are named beside them."""
    monkeypatch.setattr(sys.modules["skfem_stvk.linear.choose"], "SOLVERS", (*SOLVERS, solver.Dense()))
    free = System(box(2), [STEEL, Gravity((0, 0, -9.81))])
    moved = Scene.of(free, {"type": "dynamic", "integrator": "drift-kick", "dt": 1e-6, "until": 1e-4})
    assert np.array_equal(moved.solve(quiet=True).result.u, simulate(free, drift_kick(dt=1e-6), until=1e-4, quiet=True).u)
    assert Scene.of_data(BAR | {"solver": {"name": "dense"}}).solve(quiet=True).result.solver == "dense"
    with pytest.raises(SceneError, match=r"solver\.name: 'dence' is not known here; did you mean 'dense'\?"):
        Scene.of_data(BAR | {"solver": {"name": "dence"}})
    assert "dense" in json_schema() and "drift-kick" in json_schema()


def test_a_peer_is_a_file_and_a_row(monkeypatch):
    """It is listed, loaded by its name, and timed and compared by the benchmark beside the others."""
    monkeypatch.setitem(PEERS, "Toy", Package("numpy", "numpy", "pip install numpy"))
    monkeypatch.setitem(sys.modules, "skfem_stvk.peers.numpy", peer)
    assert available()["Toy"] == np.__version__ and load("Toy") is peer.Toy
    plan = Plan("quick", boxes=(50,), parts=(), judged=(), referenced=(), peers={"Toy": ("box 50",)}, seconds=0.0)
    found = bench(plan, quiet=True)
    assert not found.failures and {time.quantity for time in found.timings if time.player == "Toy"} == {"W", "F"}
    assert max(error.error for error in found.errors if error.player == "Toy") < 1e-9


def test_a_command_is_a_file_and_a_row(monkeypatch, capsys, tmp_path):
    monkeypatch.setitem(COMMANDS, "toy", Command(command.run, "count the elements of a mesh", command.arguments))
    system = bar(Gravity((0, 0, -9.81)))
    solve_static(system, steps=1, quiet=True, save=tmp_path / "bar.pvd")
    assert main(["toy", str(tmp_path / "bar_0000.vtu")]) == 0
    assert f"{system.mesh.nt} elements" in capsys.readouterr().out
    assert main(["toy", str(tmp_path / "no.vtu")]) == 2
    with pytest.raises(SystemExit):
        main(["--help"])
    assert "count the elements of a mesh" in capsys.readouterr().out


def test_a_hard_case_is_a_row_of_a_file(monkeypatch, capsys, tmp_path):
    monkeypatch.setitem(sys.modules, "validation.hard.hard_case", hard_case)
    assert hard.main(only=["hard_case"], out=str(tmp_path)) == 0
    out = capsys.readouterr().out
    assert "1 cases" in out and "every claim holds" in out
    assert "stretch a cube by 50 %" in (tmp_path / "hard-cases.csv").read_text(encoding="utf-8")
