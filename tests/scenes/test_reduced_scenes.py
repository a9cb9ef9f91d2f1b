"""Scenes on a reduced basis agree with reduced systems and with full scenes."""

import numpy as np
import pytest

from skfem_stvk import ReducedSystem, Scene, SceneError, solve_static

TABLES = {
    "mesh": {"type": "box", "size": [4.0, 1.0, 1.0], "cells": [6, 1, 1]},
    "materials": {"rubber": {"model": "isotropic", "young": 1e6, "poisson": 0.3, "density": 1e3}},
    "terms": [{"type": "stvk", "material": "rubber"}, {"type": "traction", "on": "right", "traction": [0.0, 0.0, -5e3]}],
    "fixed": {"left": "xyz"},
    "output": {"reactions": {"wall": "left"}, "probes": {"tip": "right"}},
}
STATIC, ARC = {"type": "static", "steps": 4}, {"type": "arc-length", "steps": 4}
MOTION = {"type": "dynamic", "integrator": "newmark", "dt": 0.02, "until": 0.2}
BASIS = {"size": 12, "modes": 6}


def scene(analysis, reduced=None, **more):
    return Scene.of_data(TABLES | {"analysis": analysis} | ({} if reduced is None else {"reduced": reduced}) | more)


def test_a_static_scene_gives_the_solution_of_a_reduced_system():
    reduced = scene(STATIC, BASIS)
    outcome, full = reduced.solve(quiet=True), scene(STATIC).solve(quiet=True)
    same = solve_static(ReducedSystem(reduced.built.system, 12, 6, quiet=True), steps=4, quiet=True)
    assert outcome.values["tip.z"] == pytest.approx(same.u.reshape(-1, 3)[reduced.built.mesh.p[0] == 4.0, 2].mean(), rel=1e-10)
    assert outcome.values["wall.z"] == pytest.approx(5e3, rel=1e-9) == full.values["wall.z"]
    assert outcome.values["tip.z"] == pytest.approx(full.values["tip.z"], rel=0.05)
    assert outcome.values["tip.z"] != full.values["tip.z"]
    without = scene(STATIC, BASIS | {"derivatives": False, "size": 6}).solve(quiet=True)
    assert abs(without.values["tip.z"]) < 0.95 * abs(full.values["tip.z"])


@pytest.mark.parametrize("analysis", [ARC, MOTION], ids=["arc length", "motion"])
def test_paths_and_motions_are_near_those_of_the_full_scene(analysis, tmp_path):
    outcome, full = (scene(analysis, basis).solve(quiet=True) for basis in (BASIS, None))
    assert outcome.success and outcome.values["tip.z"] == pytest.approx(full.values["tip.z"], rel=0.1)


def test_a_scene_is_written_with_its_basis_and_solved_in_a_folder(tmp_path):
    motion = scene(MOTION, BASIS)
    again = Scene.read(motion.write(tmp_path / "written.toml"))
    assert again.sections.reduced == motion.sections.reduced and again.sections.solver.name == "auto"
    first = motion.solve(tmp_path / "results", quiet=True)
    assert first.success and (tmp_path / "results" / "report.html").exists()
    static = scene(STATIC, BASIS).solve(tmp_path / "static", quiet=True)
    assert static.success and np.isfinite(static.values["wall.z"])


@pytest.mark.parametrize(
    ("tables", "message"),
    [
        ({"analysis": {"type": "modes"}}, "modes need the whole body"),
        ({"analysis": MOTION | {"integrator": "velocity-verlet"}}, "use an implicit integrator"),
        ({"analysis": MOTION | {"mass": "consistent"}}, "analysis.mass: the basis"),
        ({"analysis": MOTION | {"damping": {"tau": 0.1}}}, "use alpha or beta"),
        ({"analysis": MOTION | {"remove": {"stress": 1e6}}}, "analysis.remove: a reduced body"),
        ({"analysis": STATIC, "solver": {"name": "superlu"}}, "dense matrices with their own solver"),
        ({"analysis": MOTION, "solver": {"tangent": "clamped"}}, "the tangent of a reduced body is always exact"),
        ({"analysis": STATIC, "reduced": {"size": 0}}, "reduced.size"),
    ],
)
def test_conflicting_keys_are_refused(tables, message):
    with pytest.raises(SceneError, match=message):
        scene(**({"reduced": BASIS} | tables)).solve(quiet=True)


def test_a_scene_without_a_basis_creates_no_reduced_system(monkeypatch):
    from skfem_stvk.solvers import reduced

    def refused(*given, **more):
        raise AssertionError("expected no call of ReducedSystem")

    monkeypatch.setattr(reduced, "ReducedSystem", refused)
    assert scene(STATIC).solve(quiet=True).success
    with pytest.raises(AssertionError):
        scene(STATIC, BASIS).solve(quiet=True)
