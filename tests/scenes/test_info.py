"""`info` reports sizes, costs and problems of a mesh or a scene."""

import json

import numpy as np
import pytest
import skfem
from rich.console import Console

from skfem_stvk import ElementMesh, StVK, System, critical_step, modes
from skfem_stvk.scenes import info
from skfem_stvk.scenes.commands.main import main
from skfem_stvk.scenes.info import inspect_mesh, inspect_scene
from skfem_stvk.scenes.scene import Scene

STEEL = {"young": 210e9, "poisson": 0.3, "density": 7850.0}


def box(n=2, size=0.1):
    ends = [np.linspace(0, size, n + 1)] * 3
    return ElementMesh.of(skfem.MeshTet.init_tensor(*ends).with_defaults())


def facts(found, title):
    return {fact.name: fact.value for fact in found.facts[title]}


def names(found, refused=None):
    return [one.name for one in found.remarks if refused in (None, one.refused)]


def shown(found):
    console = Console(width=124, record=True, file=open("/dev/null", "w"))  # noqa: SIM115
    console.print(found.rendered(124))
    return console.export_text()


def test_a_mesh_is_counted():
    found = facts(inspect_mesh(box()), "mesh")
    mesh = skfem.MeshTet.init_tensor(*[np.linspace(0, 0.1, 3)] * 3)
    L = System(box(), StVK(young=1.0, poisson=0.3)).bound_terms[0].form.pairs.shape[1]
    assert (found["elements"], found["nodes"], found["edges"], found["TSEPs"]) == (mesh.nelements, 27, mesh.edges.shape[1], L)
    assert found["volume"] == pytest.approx(1e-3) and found["size of the box"] == pytest.approx([0.1] * 3)
    assert facts(inspect_mesh(box()), "boundaries")["left"] == 8


@pytest.mark.few(3)
@pytest.mark.parametrize("kind", ["triangles", "quadrilaterals", "hexahedra", "segments", "quadratic tetrahedra"])
def test_every_kind_of_elements_gets_all_tables(kind):
    line = np.linspace(0, 0.1, 4)
    mesh = {
        "triangles": lambda: skfem.MeshTri.init_tensor(line, line),
        "quadrilaterals": lambda: skfem.MeshQuad.init_tensor(line, line),
        "hexahedra": lambda: skfem.MeshHex.init_tensor(line, line, line),
        "segments": lambda: skfem.MeshLine(line),
        "quadratic tetrahedra": lambda: ElementMesh.of(skfem.MeshTet()).with_degree(2),
    }[kind]()
    found = inspect_mesh(ElementMesh.of(mesh), **STEEL)
    assert {"mesh", "body", "explicit steps", "costs", "memory"} <= set(found.facts), found.remarks
    assert names(found) == [], found.remarks
    assert facts(found, "mesh")["edges"] > 0 and len(found.extremes) >= 4
    assert {"an energy W", "a force F", "a tangent K"} <= set(facts(found, "costs"))


def test_numbers_of_a_body_equal_those_of_the_analyses():
    found, system = inspect_mesh(box(), **STEEL), System(box(), StVK(**STEEL))
    body, steps = facts(found, "body"), facts(found, "explicit steps")
    assert body["unknowns"] == 81 and body["rigid motions left"] == 6
    assert body["mass"] == pytest.approx(7.85)
    frequencies = modes(system, 10).frequencies
    assert body["eigenfrequencies"] == pytest.approx(frequencies[frequencies > 1][:3], rel=1e-6)
    assert steps["critical step"] == critical_step(system).step
    assert facts(found, "costs")["linear solver"] == "superlu"
    K = system.tangent(np.zeros(81))
    assert facts(found, "memory")["K"] == (K.data.nbytes + K.indices.nbytes + K.indptr.nbytes) / 1e6
    assert facts(found, "memory")["pattern of K"] == system.memory()["pattern of K"] / 1e6
    assert found.remarks == [] and "no problem" in shown(found)


def test_free_and_constrained_unknowns_are_counted():
    """The bar has 20 vertices, and 4 of them are held."""
    (unknowns,) = (fact for fact in inspect_scene(scene()).facts["body"] if fact.name == "unknowns")
    assert unknowns.value == 60 - 12 and "12 constrained" in unknowns.note


def bad_meshes():
    p, t = box().p, box().t
    flat, tiny = p.copy(), p.copy()
    flat[:, t[3, 0]] = p[:, t[:3, 0]].mean(axis=1)
    tiny[:, 13] = p[:, t[:, np.flatnonzero((t == 13).any(axis=0))[0]]].mean(axis=1)
    apart = np.concatenate([p, p + 5], axis=1), np.concatenate([t, t + p.shape[1]], axis=1)
    return {
        "duplicates": (p, np.concatenate([t, t[:, :2]], axis=1)),
        "collapsed": (p, np.concatenate([t, [[0], [0], [1], [2]]], axis=1)),
        "unused": (np.concatenate([p, [[9.0]] * 3], axis=1), t),
        "not finite": (np.where(np.arange(27) == 5, np.nan, p), t),
        "flat": (flat, t),
        "parts": apart,
    }


@pytest.mark.parametrize("name", bad_meshes())
def test_a_bad_mesh_gets_remarks_and_raises_no_error(name):
    found = inspect_mesh(ElementMesh(*bad_meshes()[name]), **STEEL)
    assert found.remarks and all(len(one.text) > 20 for one in found.remarks)
    assert found.refused == (name != "parts"), found.remarks
    assert "elements" in facts(found, "mesh") and found.extremes
    json.dumps(found.to_dict(), allow_nan=False)
    assert ("refused" in shown(found)) == found.refused


def test_a_mesh_without_any_sound_element_is_refused():
    found = inspect_mesh(ElementMesh(np.full((3, 4), np.nan), np.arange(4)[:, None]), **STEEL)
    assert found.refused and found.extremes == []
    json.dumps(found.to_dict(), allow_nan=False)


def test_unconnected_elements_are_reported_without_eigenfrequencies():
    t, p = np.arange(4 * 40).reshape(40, 4).T, np.tile(box(1).p[:, box(1).t[:, 0]], 40) + np.repeat(np.arange(40), 4)
    found = inspect_mesh(ElementMesh(p, t), **STEEL)
    assert facts(found, "body")["rigid motions left"] == 240 and "eigenfrequencies" not in facts(found, "body")
    assert facts(found, "mesh")["parts"] == 40 and any("40 parts" in one.text for one in found.remarks)


def test_mechanisms_are_not_listed_as_eigenfrequencies():
    cable = ElementMesh([[0.0, 1.0, 2.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]], [[0, 1], [1, 2]])
    found = inspect_mesh(cable, young=1e9, density=1e3)
    assert min(facts(found, "body").get("eigenfrequencies", [1.0])) > 1e-3


def test_tables_have_headings_and_sizes_the_unit_of_the_dimension_of_the_elements():
    words = shown(inspect_mesh(box())).split()
    assert {"m^3", "measure", "worst", "median"} <= set(words)
    assert "m^2" in shown(inspect_mesh(ElementMesh.of(skfem.MeshTri())))


def test_all_errors_of_a_mesh_are_reported_together():
    p, t = box().p, box().t
    found = inspect_mesh(ElementMesh(np.concatenate([p, [[9.0]] * 3], axis=1), np.concatenate([t, t[:, :1]], axis=1)), **STEEL)
    assert {"duplicates", "unused"} <= set(names(found, refused=True))


def test_a_material_in_other_units_is_detected():
    found = inspect_mesh(box(), young=210.0, poisson=0.3, density=7.85)
    assert [one.text.split(" = ")[0] for one in found.remarks if one.name == "implausible"] == ["--young"]


def test_without_a_density_the_mass_is_unknown_and_costs_are_reported():
    found = inspect_mesh(box(), young=210e9, poisson=0.3)
    assert facts(found, "body")["mass"] == "unknown" and "explicit steps" not in found.facts
    assert "a tangent K" in facts(found, "costs")


def test_an_illegal_material_is_refused():
    found = inspect_mesh(box(), young=210e9, poisson=0.6)
    assert names(found, refused=True) == ["body"] and "poisson" in found.remarks[0].text.lower()


def test_the_elements_with_the_smallest_step_are_named_with_a_remedy():
    mesh = box(3)
    p = mesh.p.copy()
    inner = int(np.flatnonzero(((p > 0.01) & (p < 0.09)).all(axis=0))[0])
    other = mesh.t[:, (mesh.t == inner).any(axis=0)]
    neighbour = int(next(node for node in other.ravel() if node != inner))
    p[:, inner] = 0.95 * p[:, neighbour] + 0.05 * p[:, inner]
    found = inspect_mesh(ElementMesh(p, mesh.t), **STEEL)
    (text,) = (one.text for one in found.remarks if one.name == "critical step")
    first = facts(found, "explicit steps")["elements that set it"][0]
    assert f"{first}" in text and inner in mesh.t[:, first] and "Remesh" in text


def test_polynomials_bound_the_lowest_frequency_from_above_within_60_percent():
    line = np.linspace(0, 1, 13)
    mesh = skfem.MeshTet.init_tensor(line, 0.2 * line[::6], 0.2 * line[::6]).with_defaults()
    for fixed in (None, {"left": "xyz"}, {"left": "xyz", "right": "xyz"}):
        system = System(mesh, StVK(**STEEL), fixed=fixed)
        exact = modes(system, 8).frequencies
        exact = exact[exact > 1]
        bound = info._ritz_frequencies(system)
        assert exact[0] * (1 - 1e-9) <= bound[0] <= 1.6 * exact[0], fixed


def scene(**tables):
    data = {
        "mesh": {"type": "box", "size": [0.4, 0.1, 0.1], "cells": [4, 1, 1]},
        "materials": {"steel": {"model": "isotropic", "young": 210e9, "poisson": 0.3, "density": 7850.0}},
        "terms": [{"type": "stvk", "material": "steel"}, {"type": "gravity", "g": [0.0, 0.0, -9.81]}],
        "fixed": {"left": "xyz"},
        "analysis": {"type": "static"},
    }
    return Scene.of_data(data | tables)


ANALYSES = {
    "static": {"type": "static"},
    "arc-length": {"type": "arc-length"},
    "modes": {"type": "modes", "n": 3},
    "implicit": {"type": "dynamic", "dt": 1e-4, "until": 1e-2},
    "explicit": {"type": "dynamic", "integrator": "velocity-verlet", "until": 1e-3},
}


@pytest.mark.parametrize("name", ANALYSES)
def test_every_analysis_is_reported_with_its_costs(name):
    costs = facts(inspect_scene(scene(analysis=ANALYSES[name])), "costs")
    assert ("a tangent K" in costs) == ("linear solver" in costs) == (name != "explicit")
    assert ("steps" in costs) == (name in ("implicit", "explicit"))


def test_the_number_of_steps_equals_that_of_the_motion():
    for name in ("implicit", "explicit"):
        other = scene(analysis=ANALYSES[name])
        steps = facts(inspect_scene(other), "costs")["steps"]
        assert steps == pytest.approx(other.solve(quiet=True).values["steps"], rel=0.02), name


def test_an_explicit_step_above_the_critical_step_is_reported_with_a_remedy():
    step = critical_step(scene().system()).step
    for factor, many in ((1.05, 1), (0.95, 0)):
        analysis = ANALYSES["explicit"] | {"dt": factor * step}
        texts = [one.text for one in inspect_scene(scene(analysis=analysis)).remarks if one.name == "critical step"]
        assert len(texts) == many and all("leave dt out" in text for text in texts)


def test_a_scene_on_a_bad_mesh_is_refused_with_the_errors_of_the_mesh(tmp_path):
    p, t = bad_meshes()["duplicates"]
    skfem.MeshTet(p, t).save(tmp_path / "bad.vtk")
    found = inspect_scene(scene(mesh={"file": str(tmp_path / "bad.vtk")}, fixed={}))
    assert found.refused and "duplicates" in names(found) and facts(found, "mesh")["elements"] == t.shape[1]
    assert "body" not in found.facts


def test_statics_of_an_unconstrained_body_are_refused():
    found = inspect_scene(scene(fixed={}))
    assert names(found, refused=True) == ["supports"] and facts(found, "body")["rigid motions left"] == 6


def test_a_motion_without_loads_and_velocities_is_refused_before_it_runs():
    found = inspect_scene(scene(terms=[{"type": "stvk", "material": "steel"}], analysis=ANALYSES["implicit"]))
    assert names(found, refused=True) == ["motion"] and "Nothing moves the body" in found.remarks[0].text
    assert "in all" in facts(found, "memory")


@pytest.mark.parametrize("name", ["superlu", "amg-cg", "block-jacobi-cg", "ssor-cg"])
def test_every_linear_solver_is_reported(name):
    found = inspect_scene(scene(solver={"name": name}))
    assert found.remarks == [] and facts(found, "costs")["linear solver"] == name


def test_times_are_measured_on_the_threads_of_the_scene():
    assert facts(inspect_scene(scene(threads=1)), "costs")["threads"] == 1


def test_values_and_labels_are_in_the_units_of_the_scene():
    found = inspect_scene(scene(units="mm-N-MPa"))
    assert {"implausible"} == set(names(found))
    assert {fact.name: fact.unit for fact in found.facts["body"]}["mass"] == "t"
    assert "mm" in shown(found)


def test_refusals_are_listed_first_and_each_remark_once():
    found = info.Inspection("SI")
    for name, refused in (("a doubt", False), ("a fault", True), ("a doubt", False)):
        found.remark(name, name, refused)
    assert [one.text for one in found.remarks] == ["a fault", "a doubt"]


def test_a_failing_part_is_reported_and_the_others_are_retained(monkeypatch):
    monkeypatch.setattr(info, "critical_step", lambda *given, **more: 1 / 0)
    found = inspect_mesh(box(), **STEEL)
    assert [one.text for one in found.remarks] == ["critical step could not be inspected: ZeroDivisionError: division by zero"]
    assert "a tangent K" in facts(found, "costs")


def test_the_command_reports_on_a_scene_with_other_values(tmp_path, capsys):
    path = tmp_path / "beam.toml"
    scene().write(path)
    assert main(["info", str(path), "--set", "mesh.cells=[2,1,1]", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["mesh"]["nodes"] == 12
    assert main(["info", str(path), "--young", "1e9"]) == 2
    assert "--set materials.NAME.young" in capsys.readouterr().err


def test_the_command_reports_on_a_mesh_file(tmp_path, capsys):
    path = tmp_path / "box.vtk"
    skfem.MeshTet().refined(1).save(path)
    assert main(["info", str(path), "--young", "1e6", "--poisson", "0.3", "--density", "1000", "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed["mesh"]["elements"] == 40 and printed["body"]["mass"] == pytest.approx(1000)
    assert main(["info", str(path)]) == 0
    assert "worst elements" in capsys.readouterr().out
    assert main(["info", str(path), "--density", "1000"]) == 2
    assert "--young" in capsys.readouterr().err


def test_the_command_without_a_file_reports_on_the_installation_in_json(capsys):
    assert main(["info", "--json"]) == 0
    assert "numpy" in json.loads(capsys.readouterr().out)


def test_the_critical_elements_of_a_large_body_are_not_computed(monkeypatch):
    monkeypatch.setattr(info, "MOST_NUMBERS", 10)
    found = inspect_mesh(box(), **STEEL)
    assert facts(found, "explicit steps")["elements that set it"] == "not looked for" and names(found) == []
    assert facts(found, "explicit steps")["critical step"] > 0
