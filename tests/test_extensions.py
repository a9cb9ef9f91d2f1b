"""Files and rows needed for a new law, element, load, integrator, linear solver, key, peer, command or hard case.

`extensions/package.py` adds the rows and names the files of the package that need them. Further toy laws and loads are in
`terms/toys.py`. `terms/test_toys.py` runs whole analyses with them, and `mesh/test_a_new_element.py` runs them with the
element.
"""

import re
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import pytest
from bodies import box
from extensions import command, hard_case, peer
from extensions.integrator import DriftKick
from extensions.law import Damaged
from extensions.load import SharedForce
from extensions.package import EXTENSIONS, Package

from skfem_stvk import (
    BodyForce,
    Gravity,
    StVK,
    System,
    Traction,
    VelocityVerlet,
    modes,
    simulate,
    solve_static,
    verify,
    verify_integrator,
    verify_law,
    verify_solver,
)
from skfem_stvk.arguments import Quantity
from skfem_stvk.errors import SceneError
from skfem_stvk.mesh import box as box_mesh
from skfem_stvk.referee.peers import PEERS, available, load
from skfem_stvk.referee.peers import Package as Peer
from skfem_stvk.scenes.commands.main import COMMANDS, Command, main
from skfem_stvk.scenes.scene import Scene
from skfem_stvk.scenes.templates import json_schema, page
from skfem_stvk.testing import Inconsistent, assert_consistent
from validation import hard
from validation.bench import Plan, bench
from validation.textbook_laws import LAM, LAWS, MU

STEEL = StVK(young=1e5, poisson=0.3, density=1000.0)
#: A scene that the tests modify.
BAR = {
    "mesh": {"type": "box", "size": [2.0, 1.0, 1.0], "cells": [2, 1, 1]},
    "materials": {"steel": {"model": "isotropic", "young": 1e5, "poisson": 0.3}},
    "terms": [{"type": "stvk", "material": "steel"}, {"type": "traction", "on": "right", "traction": [0.0, 0.0, -2e3]}],
    "fixed": {"left": "xyz"},
    "analysis": {"type": "static", "steps": 2},
}
#: Largest number of existing files of the package that an extension edits.
MOST = {"law": 2, "element": 2, "load": 2, "integrator": 1, "linear solver": 1, "key of scenes": 1}


@dataclass(frozen=True)
class Slowed(DriftKick):
    """Integrator with an option."""

    drag: Annotated[float, Quantity(None, "Lost fraction of the velocity.", ge=0)] = 0.5


def bar(*loads):
    return System(box(2), [STEEL, *loads], fixed={lambda x: x[0] < 0.1: "xyz"})


@pytest.fixture
def package(monkeypatch):
    return Package(monkeypatch)


def edited(monkeypatch, kind):
    """Return the files of the package that an extension of this kind edits."""
    with monkeypatch.context() as rows:
        package = Package(rows)
        EXTENSIONS[kind](package)
    return list(package.edited)


def test_files_that_an_extension_edits_are_those_of_the_docs(monkeypatch):
    """The page on the design of the code contains this table, which the test prints; no kind of extension edits more files."""
    table = {kind: edited(monkeypatch, kind) for kind in EXTENSIONS}
    lines = [f"| {kind} | {len(files)} | {', '.join(f'`{name}`' for name in files)} |" for kind, files in table.items()]
    print("\n".join(lines))
    assert {kind: len(files) for kind, files in table.items()} == MOST
    docs = (Path(__file__).parents[1] / "docs/topics/design.md").read_text(encoding="utf-8")
    assert "\n".join(lines) in docs


@pytest.mark.parametrize("kind", EXTENSIONS)
def test_an_extension_needs_no_other_row(monkeypatch, kind):
    """After the rows are removed, scenes have the same keys as before."""
    before = page()
    edited(monkeypatch, kind)
    assert page() == before


def test_a_new_law_works_in_python_in_a_scene_and_with_the_referee(package):
    EXTENSIONS["law"](package)
    pull = Traction("right", (0.0, 0.0, -2e3))
    system = System(box_mesh((2.0, 1.0, 1.0), (2, 1, 1)), [Damaged(young=1e5, poisson=0.3, damage=0.2), pull], {"left": "xyz"})
    found = solve_static(system, steps=2, quiet=True)
    whole = solve_static(System(system.mesh, [StVK(young=0.8e5, poisson=0.3), pull], {"left": "xyz"}), steps=2, quiet=True)
    assert found.success and np.abs(found.u - whole.u).max() < 1e-10 * np.abs(found.u).max()
    law = {"type": "damaged", "material": "steel", "damage": 0.2}
    assert np.array_equal(Scene.of_data(BAR | {"terms": [law, BAR["terms"][1]]}).solve(quiet=True).result.u, found.u)
    with pytest.raises(SceneError, match=r"terms\[0\]\.damage: got 1.0; expected a value less than 1"):
        Scene.of_data(BAR | {"terms": [law | {"damage": 1.0}, BAR["terms"][1]]})
    assert "## damaged" in page() and "Lost fraction of the stiffness" in json_schema()
    claims, mesh = Damaged(young=1e5, poisson=0.3), box(2)
    assert assert_consistent(System(mesh, claims), mesh).passed
    assert_consistent(System(mesh, claims), mesh, young=0.5e5, poisson=0.3)
    with pytest.raises(Inconsistent, match=r"W, F, K x 0\.5"):
        assert_consistent(System(mesh, claims), mesh, young=1e5, poisson=0.3)
    textbook = LAWS["St. Venant-Kirchhoff"]
    claims = Damaged(young=MU * (3 * LAM + 2 * MU) / (LAM + MU), poisson=LAM / 2 / (LAM + MU), damage=0.0)
    assert verify_law(energy=textbook.W, claims=claims, quiet=True).passed
    assert not verify_law(energy=lambda F: 2 * textbook.W(F), claims=claims, quiet=True).passed


def test_a_new_load_works_in_python_in_a_scene_and_with_the_referee(package):
    """A constant force on linear elements acts as `BodyForce`, and solutions with a varying force converge at their order."""
    EXTENSIONS["load"](package)
    weight = (30.0, 0.0, -2e2)
    found, other = (solve_static(bar(of(weight)), steps=2, quiet=True).u for of in (SharedForce, BodyForce))
    assert np.abs(found).max() > 1e-3 and np.abs(found - other).max() < 1e-10 * np.abs(found).max()
    ramp = {"type": "ramp", "until": 0.5}
    ours, theirs = (
        Scene.of_data(BAR | {"terms": [BAR["terms"][0], {"type": kind, "force": list(weight), "time": ramp}]})
        for kind in ("shared-force", "body-force")
    )
    u, v = (scene.solve(quiet=True).result.u for scene in (ours, theirs))
    assert np.abs(u).max() > 1e-3 and np.abs(u - v).max() < 1e-10 * np.abs(u).max()
    with pytest.raises(SceneError, match=r"terms\[1\]\.force: has 2 components; expected 3"):
        Scene.of_data(BAR | {"terms": [BAR["terms"][0], {"type": "shared-force", "force": [1.0, 2.0]}]}).system()

    def solve(mesh, material, body_force, boundary, factor=1.0):
        prescribed = {tuple(boundary.nodes): lambda x, t: t * boundary.values.T}
        force = SharedForce(lambda x, t: factor * t * body_force(x))
        return solve_static(System(mesh, [StVK(material), force], prescribed=prescribed), steps=2, quiet=True).u

    assert verify_solver(solve, young=1e5, poisson=0.3, dimension=2, quiet=True).passed
    wrong = verify_solver(lambda *problem: solve(*problem, factor=0.9), young=1e5, poisson=0.3, dimension=2, quiet=True)
    assert wrong.named.names == ["load x 0.900"]


def test_an_element_is_judged_by_the_referee(package):
    EXTENSIONS["element"](package)
    mesh = box_mesh((2.0, 1.0, 0.9), (2, 1, 1), "hexahedra").with_degree(2)
    assert mesh.element.name == "triquadratic hexahedra" and verify(mesh, young=5e6, poisson=0.3, quiet=True).passed


def test_an_integrator_is_a_file_and_a_row(package, tmp_path):
    """DriftKick converges at order 1 and conserves momentum; `simulate` finds its critical step and resumes."""
    EXTENSIONS["integrator"](package)
    mesh = box(2)
    system, push = System(mesh, STEEL), 0.5 * np.sin(3 * mesh.p[::-1]).ravel("F")
    ends = [simulate(system, DriftKick(dt=dt), until=0.016, v0=push, quiet=True).v for dt in (2e-4, 1e-4)]
    truth = simulate(system, VelocityVerlet(dt=2e-5), until=0.016, v0=push, quiet=True).v
    errors = [np.abs(v - truth).max() for v in ends]
    assert errors[0] / errors[1] == pytest.approx(2, rel=0.1) and errors[1] < 0.1 * np.abs(truth).max()
    run = simulate(system, DriftKick(), until=0.02, v0=push, quiet=True, checkpoint=tmp_path / "run")
    momenta = [run.ledger[f"linear_momentum_{x}"] for x in "xyz"]
    assert run.success and np.ptp(momenta, axis=1).max() < 1e-12 * np.abs(momenta).max()
    longer = simulate(system, checkpoint=tmp_path / "run", resume=True, until=0.03, quiet=True)
    assert np.array_equal(longer.u, simulate(system, DriftKick(), until=0.03, v0=push, quiet=True).u)


def test_the_referee_judges_an_integrator_by_what_it_declares(package):
    def step(system, u, v, dt):
        run = simulate(system, DriftKick(dt=dt), until=dt, u0=u, v0=v, quiet=True, raise_on_failure=False)
        return run.u, run.v

    EXTENSIONS["integrator"](package)
    conserves = [one.replace("_", " ") for one in DriftKick.conserves]
    assert verify_integrator(step, order=DriftKick.order, conserves=conserves, stable=2.0, quiet=True).passed
    assert not verify_integrator(step, order=2, conserves=conserves, stable=2.0, quiet=True).passed


def test_a_linear_solver_is_a_file_and_a_row(package):
    """Statics, arc length, implicit steps and modes accept the solver by its name, and the referee passes its solutions."""
    EXTENSIONS["linear solver"](package)
    system = bar(Traction(lambda x: x[0] > 0.9, (0, 0, -2e3)))
    by, right = (solve_static(system, steps=2, solver=name, quiet=True) for name in ("dense", "superlu"))
    assert by.success and by.solver == "dense" and np.abs(by.u - right.u).max() < 1e-7 * np.abs(right.u).max()
    path = solve_static(system, steps=2, solver="dense", method="arc-length", quiet=True)
    assert np.abs(path.u - right.u).max() < 1e-7 * np.abs(right.u).max() and path.history[-1].negative == 0
    assert modes(system, 2, solver="dense").frequencies == pytest.approx(modes(system, 2, solver="superlu").frequencies)

    def solve(mesh, material, body_force, boundary):
        prescribed = {tuple(boundary.nodes): lambda x, t: t * boundary.values.T}
        made = System(mesh, [StVK(material), BodyForce(lambda x, t: t * body_force(x))], prescribed=prescribed)
        return solve_static(made, steps=2, solver="dense", quiet=True).u

    assert verify_solver(solve, young=1e5, poisson=0.3, dimension=2, quiet=True).passed


def test_a_scene_takes_an_integrator_and_a_linear_solver_by_their_row(package):
    """A scene accepts integrators and solvers registered at the time of the check, with the same results as in Python.

    An unknown name is refused; the message suggests a registered name.
    """
    EXTENSIONS["integrator"](package)
    EXTENSIONS["linear solver"](package)
    free = System(box_mesh((2.0, 1.0, 1.0), (2, 1, 1)), [STEEL, Gravity((0, 0, -9.81))])
    steel, terms = BAR["materials"]["steel"] | {"density": 1000.0}, [BAR["terms"][0], {"type": "gravity", "g": [0.0, 0.0, -9.81]}]
    motion = {"type": "dynamic", "integrator": "drift-kick", "dt": 1e-6, "until": 1e-4}
    moved = Scene.of_data(BAR | {"materials": {"steel": steel}, "terms": terms, "fixed": {}, "analysis": motion})
    assert np.array_equal(moved.solve(quiet=True).result.u, simulate(free, DriftKick(dt=1e-6), until=1e-4, quiet=True).u)
    assert Scene.of_data(BAR | {"solver": {"name": "dense"}}).solve(quiet=True).result.solver == "dense"
    with pytest.raises(SceneError, match=r"solver\.name: 'dence' is not known here; did you mean 'dense'\?"):
        Scene.of_data(BAR | {"solver": {"name": "dence"}})
    assert "dense" in json_schema() and "drift-kick" in json_schema()


def test_options_of_an_integrator_are_keys_as_soon_as_it_is_registered(package):
    """The key has the type, limits and description of the option; it is refused for another integrator."""
    EXTENSIONS["integrator"](package)
    package.add("skfem_stvk.solvers.dynamics.integrators", "INTEGRATORS", "Slowed", Slowed)
    motion = {"type": "dynamic", "integrator": "slowed", "dt": 1e-6, "until": 1e-5, "drag": 0.25}
    terms = [BAR["terms"][0]]
    dense = {"steel": BAR["materials"]["steel"] | {"density": 1e3}}
    scene = Scene.of_data(BAR | {"materials": dense, "terms": terms, "analysis": motion})
    assert scene.built.integrator == Slowed(dt=1e-6, drag=0.25)
    assert re.search(r"`drag` \| number >= 0 \|.*For slowed: lost fraction of the velocity, by default 0.5", page())
    for wrong, said in (({"drag": -1.0}, "greater than or equal to 0"), ({"integrator": "drift-kick"}, "is an option of slowed")):
        with pytest.raises(SceneError, match=rf"analysis\.drag: .*{said}"):
            Scene.of_data(BAR | {"materials": dense, "terms": terms, "analysis": motion | wrong})


def test_a_key_of_a_scene_is_checked_printed_and_stored(package):
    with pytest.raises(SceneError, match="author: unknown key"):
        Scene.of_data(BAR | {"author": "Lame"})
    EXTENSIONS["key of scenes"](package)
    scene = Scene.of_data(BAR | {"author": "Lame"})
    assert scene.sections.author == scene.data["author"] == "Lame"
    assert "| `author` | text |" in page() and "Who wrote it" in json_schema()
    with pytest.raises(SceneError, match="author: got 3; expected text"):
        Scene.of_data(BAR | {"author": 3})


def test_a_peer_is_a_file_and_a_row(monkeypatch):
    """The peer is listed and loaded by its name, and the benchmark times it and compares it with the others."""
    monkeypatch.setitem(PEERS, "Toy", Peer("numpy", "numpy", "pip install numpy"))
    monkeypatch.setitem(sys.modules, "skfem_stvk.referee.peers.numpy", peer)
    assert available()["Toy"] == np.__version__ and load("Toy") is peer.Toy
    plan = Plan("quick", boxes=(50,), parts=(), judged=(), referenced=(), peers={"Toy": ("box 50",)}, seconds=0.0)
    found = bench(plan, quiet=True)
    assert not found.failures and {time.quantity for time in found.timings if time.implementation == "Toy"} == {"W", "F"}
    assert max(error.error for error in found.errors if error.implementation == "Toy") < 1e-9


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
