"""A system that is written as a scene, read and built again is unchanged bit for bit."""

import warnings
from dataclasses import dataclass, replace

import numpy as np
import pytest
import skfem

from skfem_stvk import (
    Anisotropic,
    BodyForce,
    Box,
    Corotated,
    EdgeNetwork,
    ElasticFoundation,
    ElementMesh,
    EnergyMomentum,
    Friction,
    Gravity,
    InvertibleStVK,
    Isotropic,
    LinearElastic,
    MeshContact,
    NearestNode,
    NeoHookean,
    NodalLoad,
    Orthotropic,
    Plane,
    Pressure,
    Ramp,
    RigidBox,
    RigidContact,
    RigidCylinder,
    RigidMesh,
    RigidPlane,
    RigidSphere,
    Sine,
    SpringNetwork,
    Stop,
    StVK,
    StvkError,
    StvkWarning,
    System,
    Table,
    Traction,
    TransverselyIsotropic,
    VelocityVerlet,
    VolumePenalty,
    modes,
    simulate,
    solve_static,
)
from skfem_stvk.mesh import box
from skfem_stvk.results import write_mesh
from skfem_stvk.scene.scene import Scene
from skfem_stvk.scene.schema.analyses import DynamicAnalysis

STATIC = {"type": "static", "steps": 2}
STEEL = Isotropic(2.1, 0.3, density=7.85)
WOOD = Orthotropic(
    (11.0, 0.9, 0.5), (0.6, 0.45, 0.37), (0.04, 0.7, 0.75), frame=np.linalg.qr([[1, 2, 0.3], [0, 1, 4], [2, 0, 1]])[0]
)


def crooked(mesh):
    """Return the mesh with coordinates that have no short decimal form."""
    rng = np.random.default_rng(5)
    return replace(mesh, p=mesh.p / 3 + 0.02 * rng.random(mesh.p.shape))


SOLID = crooked(box((2, 1, 1), (2, 1, 1)))
FLAT = crooked(box((2, 1), (3, 2)))
BOXES = crooked(box((2, 1, 1), (2, 1, 1), "hexahedra"))
SHEET = replace(FLAT, p=np.append(FLAT.p, [np.full(FLAT.nv, 0.1)], axis=0))


def rewritten(system, tmp_path, analysis=STATIC):
    """Write the system as a scene, read it, and return both systems. Assert that nothing is left out."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        scene = Scene.of(system, analysis)
    scene.write(tmp_path / "scene.toml")
    again = Scene.read(tmp_path / "scene.toml")
    assert scene.left_out == () and again.data["terms"] == scene.resolved(tmp_path)["terms"]
    return scene.system(), again.system()


def assert_same(other, system):
    rng = np.random.default_rng(7)
    u = 0.02 * rng.standard_normal(system.ndofs)
    assert np.array_equal(other.mesh.p, system.mesh.p) and np.array_equal(other.mesh.t, system.mesh.t)
    one, two = other.jacobian(u, 0.7), system.jacobian(u, 0.7)  # shapes that move are now where they are at 0.7
    assert np.array_equal(one.data, two.data) and np.array_equal(one.indices, two.indices)
    np.testing.assert_array_equal(other.elastic_energies(u), system.elastic_energies(u))
    assert np.array_equal(other.internal_force(u), system.internal_force(u))
    for t in (0.0, 0.3, 1.0):
        assert np.array_equal(other.external_force(u, t), system.external_force(u, t))
        assert np.array_equal(other.supports.values(t), system.supports.values(t))
    assert np.array_equal(other.supports.fixed, system.supports.fixed)
    assert np.array_equal(other.supports.prescribed, system.supports.prescribed)


LAWS = {
    "St. Venant-Kirchhoff": (SOLID, StVK(STEEL)),
    "of wood": (SOLID, StVK(WOOD)),
    "of fibres": (SOLID, StVK(TransverselyIsotropic(14.0, 1.0, 0.3, 0.4, 0.5))),
    "anisotropic": (SOLID, StVK(Anisotropic(np.diag([3.0, 4, 5, 1, 2, 3]) + 0.1))),
    "plane stress": (FLAT, StVK(young=1.1, poisson=0.7, plane="stress", thickness=0.3)),
    "membrane": (SHEET, StVK(young=1.1, poisson=0.3, thickness=0.3)),
    "cable": (crooked(box(2.0, 4)), StVK(young=1.1, area=0.3)),
    "wrinkling": (SHEET, StVK(young=1.1, poisson=0.3, thickness=0.3, wrinkling=True)),
    "neo-Hookean": (SOLID, NeoHookean(STEEL)),
    "linear": (SOLID, LinearElastic(STEEL)),
    "corotated": (SOLID, Corotated(STEEL, rotation="vertex")),
    "invertible": (SOLID, InvertibleStVK(STEEL, threshold=0.7, extend="stress")),
    "springs": (SOLID, SpringNetwork(STEEL, "van-gelder")),
    "edges": (SOLID, [EdgeNetwork.of(SOLID, StVK(STEEL, Box((0, 0, 0), (0.4, 1, 1)))), StVK(WOOD)]),
    "adjacent edges": (SOLID, EdgeNetwork.of(SOLID, StVK(STEEL)).without("opposite")),
    "opposite edges": (SOLID, EdgeNetwork.of(SOLID, StVK(STEEL)).without("adjacent")),
    "edges alone": (SOLID, EdgeNetwork.of(SOLID, StVK(STEEL)).diagonal()),
    "several": (
        SOLID,
        [StVK(STEEL, [5, 3, 0]), NeoHookean(STEEL, SOLID.p[0, SOLID.t].mean(axis=0) > 0.3), VolumePenalty(2.5, "quadratic")],
    ),
    "penalty": (FLAT, [StVK(STEEL), VolumePenalty(region=np.arange(4), kind="compression")]),
    "quadratic": (SOLID.with_degree(2), StVK(STEEL)),
    "of scikit-fem": (
        skfem.MeshTet().refined(1).with_defaults().with_subdomains({"low": lambda x: x[2] < 0.5}),
        [StVK(STEEL, "low"), NeoHookean(STEEL)],
    ),
    "in another order": (replace(SOLID, subdomains={"back": np.arange(12)[::-1]}), StVK(STEEL, "back")),
}


@pytest.mark.parametrize("name", LAWS)
def test_a_law_is_the_same_in_a_scene(name, tmp_path):
    mesh, terms = LAWS[name]
    system = System(mesh, terms)
    for other in rewritten(system, tmp_path):
        assert_same(other, system)


LOADS = {
    "gravity": (SOLID, Gravity((0, 0.1, -9.81))),
    "body force": (FLAT, BodyForce(Ramp((0.1, 1 / 3), 0.4, start=0.1), [4, 2])),
    "nodes": (SOLID, NodalLoad([3, 1], (0.1, 0.2, 1 / 7))),
    "the nearest": (SOLID, NodalLoad(NearestNode((0.6, 0.3, 0.3)), Sine((0, 0, 1.0), 3.0, 0.5))),
    "traction": (BOXES, Traction("right", (0.1, 0.2, 1 / 7))),
    "traction in a box": (FLAT, Traction(Box((-1, -1), (0.1, 2)), Table((1.0, 2.0), (0, 0.5), (1, 1 / 3)))),
    "traction where": (SOLID, Traction(lambda x: x[0] > 0.6, (0, 0, 1 / 7))),
    "traction on scikit-fem's": (SOLID.with_degree(2), Traction("right", (0, 0, 1 / 7))),
    "pressure": (BOXES, Pressure("top", 1 / 7)),
    "pressure in time": (FLAT, Pressure(lambda x: x[1] > 0.3, Ramp(1 / 7, 0.5))),
    "pressure on all": (SHEET, Pressure(None, 1 / 7)),
    "pressure on some": (SHEET, Pressure([1, 4], Sine(1 / 7, 2.0))),
    "foundation": (SOLID, ElasticFoundation("left", (0, 1 / 3, 2.0))),
    "plane": (SOLID, RigidContact(RigidPlane((0, 0, 0.1), (0.1, 0.2, 1)), "front", friction=Friction(0.3, slip_length=1 / 3))),
    "sphere": (BOXES, RigidContact(RigidSphere((0, 0, -0.1), 0.3), stiffness=1 / 7, onset=0.01, name="ball")),
    "inside a cylinder": (
        SOLID,
        RigidContact(RigidCylinder((0.1, 0.2, 0), (1, 0, 0.3), 0.3, True), motion=Ramp((0, 0, -0.1), 0.3)),
    ),
    "box": (FLAT, RigidContact(RigidBox((0, 0), (0.2, 0.3), 0.05), lambda x: x[0] < 0.1, motion=(1 / 30, 0))),
    "some of a membrane": (SHEET, RigidContact(RigidPlane((0, 0, 0.1), (0, 0, 1)), [1, 4], motion=Sine((0, 0, 0.1), 2.0))),
    "touching itself": (SOLID, MeshContact(None, distance=0.01, friction=Friction(0.3, slip_length=1 / 3))),
    "two surfaces": (BOXES, MeshContact("left", "right", distance=0.01, stiffness=1 / 7, name="ends")),
    "elements of a membrane": (SHEET, MeshContact([1], [4], distance=0.01, stiffness=1 / 7)),
    "foundation alike": (BOXES, ElasticFoundation(Plane((0, 0, 0), (0, 0, 1), within=0.03), 1 / 3)),
}


def test_a_rigid_mesh_of_a_file_is_the_same_in_a_scene(tmp_path):
    die = box((1, 1, 1), (1, 1, 1))
    p = die.p + np.array([[0], [0], [SOLID.p[2].min() - 1.1]])
    write_mesh(tmp_path / "die.vtu", ElementMesh(p, die.surface))
    terms = [StVK(STEEL), MeshContact(None, RigidMesh(tmp_path / "die.vtu"), distance=0.15)]
    system = System(SOLID, terms)
    for other in rewritten(system, tmp_path):
        assert_same(other, system)
    in_memory = System(SOLID, [terms[0], MeshContact(None, RigidMesh((p, die.surface)), distance=0.15)])
    with pytest.warns(StvkWarning, match="a RigidMesh in memory has no file"):
        Scene.of(in_memory, STATIC)


@pytest.mark.parametrize("name", LOADS)
def test_a_load_is_the_same_in_a_scene(name, tmp_path):
    mesh, load = LOADS[name]
    system = System(mesh, [StVK(STEEL), load])
    for other in rewritten(system, tmp_path):
        assert_same(other, system)


VIEW = skfem.Basis(skfem.MeshTet().refined(1), skfem.ElementVector(skfem.ElementTetP1())).get_dofs(lambda x: x[2] == 0)
SUPPORTS = {
    "by name": (SOLID, {"left": "xyz"}, {"right": {"x": 0.1, "z": 1 / 3}}),
    "shapes": (SOLID, {Box((-1, -1, -1), (0.1, 2, 2)): "xz"}, {NearestNode((0.6, 0.3, 0.3)): {"y": Sine(0.1, 2.0)}}),
    "twice": (FLAT, [("left", "x"), ([0, 4], "y"), ("left", "y")], [("right", {"x": 0.1}), ("right", {"y": Ramp(0.2, 0.5)})]),
    "predicates": (BOXES, {(lambda x: x[0] < 0.1): "xyz"}, [(lambda x: x[0] > 0.6, Table((0.1, 0, 1 / 3), (0, 1), (0, 2)))]),
    "other times": (FLAT, {"left": "xy"}, {"right": {"x": Ramp(0.1, 0.3), "y": 0.2}}),
    "components": (FLAT, {"left": "x"}, {"bottom": {"y": 0.1}}),
    "of scikit-fem": (skfem.MeshTet().refined(1), VIEW.drop(["u^1"]), None),
    "of scikit-fem by place": (skfem.MeshTet().refined(1), [(VIEW, "z"), (VIEW, VIEW.keep(["u^1"]))], None),
}


@pytest.mark.parametrize("name", SUPPORTS)
def test_supports_are_the_same_in_a_scene(name, tmp_path):
    mesh, fixed, prescribed = SUPPORTS[name]
    system = System(mesh, StVK(STEEL), fixed, prescribed)
    for other in rewritten(system, tmp_path):
        assert_same(other, system)


@pytest.mark.parametrize("quadrature", [{"quadrature": "exact"}, {"quadrature": "one-point", "hourglass": 0.07}])
def test_rules_are_the_same_in_a_scene(quadrature, tmp_path):
    system = System(BOXES, StVK(STEEL), **quadrature)
    for other in rewritten(system, tmp_path):
        assert_same(other, system)


def test_a_scene_and_the_same_in_python_give_identical_results(tmp_path):
    system = System(SOLID, [StVK(STEEL), Traction(lambda x: x[0] > 0.6, (0, 0, -0.01)), Gravity((0, 0, -1e-3))], {"left": "xyz"})
    expected = solve_static(system, 2, rtol=1e-8, quiet=True)
    scene = Scene.of(system, {"type": "static", "steps": 2})
    scene.write(tmp_path / "scene.toml")
    for one in (scene, Scene.read(tmp_path / "scene.toml")):
        assert one.solve(quiet=True).result.u.tobytes() == expected.u.tobytes()


def test_the_resolved_scene_of_a_run_refers_to_its_mesh(tmp_path):
    scene = Scene.of(System(SOLID, [StVK(STEEL), Gravity((0, 0, -1e-3))], {"left": "xyz"}), {"type": "static", "steps": 1})
    outcome = scene.solve(tmp_path / "results", quiet=True)
    again = Scene.read(tmp_path / "results" / "resolved.toml").solve(quiet=True)
    assert again.result.u.tobytes() == outcome.result.u.tobytes()


LOADED = [StVK(STEEL), Traction(lambda x: x[0] > 0.6, (0, 0, -0.01)), Gravity(Ramp((0, 0, -1e-2), until=0.5))]


@pytest.mark.parametrize(
    ("analysis", "python"),
    [
        (
            {"type": "arc-length", "steps": 2},
            lambda body: solve_static(body, 2, rtol=1e-8, quiet=True, method="arc-length", stop=Stop(load=1.0)).u,
        ),
        (
            {"type": "dynamic", "integrator": "energy-momentum", "dt": 0.1, "until": 0.5},
            lambda body: simulate(body, EnergyMomentum(dt=0.1), until=0.5, quiet=True).u,
        ),
        (
            {"type": "dynamic", "integrator": "velocity-verlet", "dt": 0.01, "until": 0.1},
            lambda body: simulate(body, VelocityVerlet(dt=0.01), until=0.1, quiet=True).u,
        ),
        ({"type": "modes", "n": 3}, lambda body: modes(body, 3).frequencies),
    ],
    ids=["arc length", "energy-momentum", "velocity-verlet", "modes"],
)
def test_each_analysis_gives_the_same_result_in_a_scene_and_in_python(analysis, python, tmp_path):
    body = System(SOLID, [StVK(STEEL)] if analysis["type"] == "modes" else LOADED, {"left": "xyz"})
    scene = Scene.of(body, analysis)
    scene.write(tmp_path / "scene.toml")
    expected = python(body)
    assert np.abs(expected).max() > 0
    for one in (scene, Scene.read(tmp_path / "scene.toml")):
        result = one.solve(quiet=True).result
        assert (result.frequencies if analysis["type"] == "modes" else result.u).tobytes() == expected.tobytes()


def test_elements_of_a_region_retain_their_order(tmp_path):
    """Elements of a region retain their order of summation, although a mesh file has ascending ids."""
    mesh = crooked(box((2, 1, 1), (3, 2, 2)))
    order = np.random.default_rng(2).permutation(mesh.nt)
    mesh = replace(mesh, subdomains={"all of it": order})
    body = System(mesh, [StVK(STEEL, "all of it"), BodyForce((1.0, 2.0, 3.0), "all of it")], {"left": "xyz"})
    for other in rewritten(body, tmp_path):
        assert_same(other, body)
    (region,) = {str(term["region"]) for term in Scene.of(body, STATIC).data["terms"]}
    assert region == str({"type": "elements", "ids": order.tolist()})


ANALYSES = [
    {"type": "static", "steps": 3, "stability": True},
    {"type": "arc-length", "stop": {"turns": 2}},
    {"type": "dynamic", "integrator": "newmark", "dt": 1e-3, "until": 1.0, "beta": 0.3},
    {"type": "modes", "n": 3},
    DynamicAnalysis(type="dynamic", until=1.0, integrator="velocity-verlet"),
]


@pytest.mark.parametrize("analysis", ANALYSES, ids=lambda one: one["type"] if isinstance(one, dict) else one.integrator)
def test_analyses_are_unchanged_in_a_scene(analysis, tmp_path):
    scene = Scene.of(System(SOLID, StVK(STEEL), {"left": "xyz"}), analysis)
    scene.write(tmp_path / "scene.toml")
    again = Scene.read(tmp_path / "scene.toml").sections.analysis
    given = analysis if isinstance(analysis, dict) else analysis.model_dump(exclude_none=True)
    for name, value in given.items():
        found = getattr(again, name)
        assert (found.model_dump(exclude_none=True) if hasattr(found, "model_dump") else found) == value, name


def test_the_same_constants_are_one_material():
    system = System(SOLID, [StVK(young=1.0, poisson=0.3, region=[0]), NeoHookean(young=1.0, poisson=0.3, region=[1]), StVK(STEEL)])
    assert list(Scene.of(system, STATIC).data["materials"]) == ["isotropic-1", "isotropic-2"]


def test_new_names_differ_from_names_of_the_mesh():
    mesh = replace(SOLID, node_sets={"nodes-1": [0]}, subdomains={"region-1": [0]})
    scene = Scene.of(System(mesh, [StVK(STEEL, [1, 2]), StVK(WOOD)], {(3, 4): "x"}), STATIC)
    assert scene.data["fixed"] == {"nodes-2": "x"} and scene.data["terms"][0]["region"] == "region-2"
    assert list(scene.built.mesh.node_sets["nodes-1"]) == [0]


class OwnLaw(StVK):
    """Law of a user."""


@dataclass(frozen=True, eq=False)
class OwnMaterial(Isotropic):
    """Material of a user."""


LEFT_OUT = {
    "terms[1], Traction: traction is a function other than Ramp, Sine or Table": [Traction("right", lambda t: (t, 0, 0))],
    "terms[1], Gravity: g is a function": [Gravity(lambda x, t: (x[0], 0, 0))],
    "terms[1], NodalLoad: force has one value for each": [NodalLoad([0, 1], np.ones((3, 2)))],
    "terms[1], Pressure: pressure has one value for each": [Pressure("top", np.ones(6))],
    "terms[1], StVK: young has one value for each element": [StVK(young=np.ones(SOLID.nt), poisson=0.3)],
    "terms[1], StVK: frame has one value for each element": [
        StVK(Orthotropic((1, 1, 1), (0, 0, 0), (1, 1, 1), frame=np.broadcast_to(np.eye(3), (SOLID.nt, 3, 3))))
    ],
    "terms[1], SpringNetwork: stiffness has no key": [SpringNetwork(STEEL, stiffness=np.ones(35))],
    "terms[1], Corotated: rotation is a function": [Corotated(STEEL, rotation=lambda t: np.broadcast_to(np.eye(3), (12, 3, 3)))],
    "terms[1], OwnLaw: OwnLaw is a term that scenes cannot express": [OwnLaw(STEEL)],
    "terms[1], StVK: OwnMaterial is a material that scenes cannot express": [StVK(OwnMaterial(1.0, 0.3))],
    "terms[1], VolumePenalty: stiffness has one value": [VolumePenalty(np.ones(SOLID.nt))],
    "terms[1], EdgeNetwork: it is made of 2 laws": [EdgeNetwork.of(SOLID, [StVK(STEEL), StVK(STEEL)])],
}


@pytest.mark.parametrize("message", LEFT_OUT)
def test_terms_without_a_name_in_scenes_are_left_out_with_a_warning(message, tmp_path):
    edges = EdgeNetwork.of(SOLID, StVK(STEEL)).edges.shape[1]
    terms = [SpringNetwork(STEEL, stiffness=np.ones(edges)) if "SpringNetwork" in message else one for one in LEFT_OUT[message]]
    with pytest.warns(StvkWarning, match="The scene leaves out parts that it cannot express: ") as warnings_:
        scene = Scene.of(System(SOLID, [StVK(STEEL), *terms]), STATIC)
    assert len(scene.left_out) == 1 and scene.left_out[0].startswith(message) and scene.left_out[0] in str(warnings_[0].message)
    assert [term["type"] for term in scene.data["terms"]] == ["stvk"]


def test_supports_and_precision_without_a_name_in_scenes_are_reported():
    prescribed = [("right", {"x": 0.1, "y": lambda t: t}), ([0, 1], lambda x, t: 0 * x), ([6], {"z": np.array([0.1])})]
    system = System(replace(SOLID, node_sets={"a\x1b": [2]}), StVK(STEEL), {"a\x1b": "x"}, prescribed, dtype=np.float32)
    system = system.without([1])
    with pytest.warns(StvkWarning, match="leaves out parts"):
        scene = Scene.of(system, STATIC)
    reasons = [
        "fixed on 'a\\x1b': the name",
        "prescribed on 'right', component y: it is a function",
        "prescribed on 2 vertices (0, 1), component xyz: it is a function",
        "prescribed on 1 vertex (6), component z: it has one value for each",
        "dtype = float32",
        "1 element (1): removed from the system",
    ]
    assert len(scene.left_out) == len(reasons)
    assert all(one.startswith(reason) for one, reason in zip(scene.left_out, reasons, strict=True)), scene.left_out
    assert scene.data["prescribed"] == {"right": {"x": 0.1}}


def test_arguments_other_than_a_system_and_an_analysis_are_refused():
    with pytest.raises(StvkError, match="expected a System"):
        Scene.of(SOLID, STATIC)
    with pytest.raises(StvkError, match=r"analysis = 'static'; expected a table such as"):
        Scene.of(System(SOLID, StVK(STEEL)), "static")
    with pytest.raises(StvkError, match="No law of this system can be expressed in a scene: terms"):
        Scene.of(System(SOLID, OwnLaw(STEEL)), STATIC)
    with pytest.raises(StvkError, match="unstatic"):
        Scene.of(System(SOLID, StVK(STEEL)), {"type": "unstatic"})


def test_simplices_of_terms_get_names_in_the_mesh_and_boundaries_retain_their_names(tmp_path):
    ropes = StVK(young=100.0, area=0.01, simplices=[[0, 3], [3, 5]])
    skin = StVK(STEEL, thickness=0.1, simplices="left")
    system = System(SOLID, [StVK(STEEL), skin, ropes, Pressure(None, 0.1, simplices="left")], fixed={"right": "xyz"})
    first, again = rewritten(system, tmp_path)
    for other in (first, again):
        assert_same(other, system)
        assert [body.mesh.nt for body in other.body.beside] == [2, 2]
    assert again.mesh.lines["simplices-1"].tolist() == [[0, 3], [3, 5]]


def bag():
    """Return the first body of docs/how-to/membranes.md: a ball in its skin, on a rope to a hook that no other element contains."""
    ball = crooked(ElementMesh.of(skfem.MeshTet.init_ball(1)))
    top = int(np.argmax(ball.p[2]))
    terms = [
        StVK(young=1e3, poisson=0.3, thickness=1e-3, density=9.0, simplices=ball.surface),
        StVK(young=1e5, area=1e-4, density=10.0, simplices=[[top], [ball.nv]]),
        StVK(young=1e2, poisson=0.45, density=5.0, simplices=ball.t),
        Gravity((0, 0, -9.81)),
    ]
    return System(np.append(ball.p, [[0], [0], [2.0]], axis=1), terms, {(ball.nv,): "xyz"})


def sail():
    """Return a flat sheet in space on two ropes, one along its edge."""
    terms = [StVK(young=10.0, poisson=0.3), StVK(young=100.0, area=0.01, simplices=[[0, 1], [SHEET.nv, 2]])]
    points = np.append(SHEET.p, [[1.0], [1.0], [0.1]], axis=1)
    return System(replace(SHEET, p=points), [*terms, NodalLoad([SHEET.nv], (0.1, 0.2, 0.3))], {"left": "xyz"})


@pytest.mark.parametrize("body", [bag, sail])
def test_nodes_that_only_cables_or_membranes_contain_are_in_the_scene(body, tmp_path):
    system = body()
    for other in rewritten(system, tmp_path):
        assert_same(other, system)
        assert [one.mesh.nt for one in other.body.beside] == [one.mesh.nt for one in system.body.beside]


def test_a_flat_membrane_of_a_scene_is_in_space():
    data = {"terms": [{"type": "stvk", "material": "a"}], "materials": {"a": {"model": "isotropic", "young": 1.0, "poisson": 0.3}}}
    data |= {"mesh": {"type": "box", "size": [2.0, 1.0], "cells": [3, 2], "dimension": 3}, "analysis": {"type": "static"}}
    flat = box((2.0, 1.0), (3, 2))
    expected = System(replace(flat, p=np.append(flat.p, np.zeros((1, flat.nv)), axis=0)), StVK(young=1.0, poisson=0.3))
    assert_same(Scene.of_data(data).system(), expected)
    with pytest.raises(StvkError, match="mesh: dimension = 1; expected at least 2"):
        _ = Scene.of_data(data | {"mesh": data["mesh"] | {"dimension": 1}}).built
