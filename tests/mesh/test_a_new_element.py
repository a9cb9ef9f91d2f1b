"""A hexahedron with 27 nodes needs only two rows of `ELEMENTS`, for itself and its facets, and one row of `KINDS`."""

from dataclasses import replace

import meshio
import numpy as np
import pytest
import skfem
from extensions.element import HEX27, KIND, QUAD9

from skfem_stvk import (
    EnergyMomentum,
    Gravity,
    Pressure,
    StVK,
    StvkWarning,
    System,
    Traction,
    VelocityVerlet,
    modes,
    read_mesh,
    simulate,
    solve_static,
    verify,
)
from skfem_stvk.mesh import ElementMesh, box, mesh_quality
from skfem_stvk.mesh.element import ELEMENTS
from skfem_stvk.mesh.facets import facets_of, find_facets
from skfem_stvk.mesh.groups import as_cells
from skfem_stvk.mesh.points import KINDS as RULES
from skfem_stvk.mesh.points import rule_of
from skfem_stvk.referee.reference import KINDS, ReferenceStVK, isotropic_tensor
from skfem_stvk.results.vtu import write_mesh
from skfem_stvk.scenes.scene import Scene

RUBBER = StVK(young=5e6, poisson=0.3, density=1e3)


@pytest.fixture(autouse=True)
def registered(monkeypatch):
    for element in (QUAD9, HEX27):
        monkeypatch.setitem(ELEMENTS, element.name, element)
    monkeypatch.setitem(KINDS, HEX27.name, KIND)


#: A scene of `curved()` in a file.
SCENE = """
fixed = { left = "xyz" }
analysis = { type = "static", steps = 1 }

[mesh]
file = "curved.vtu"

[materials]
rubber = { model = "isotropic", young = 5e6, poisson = 0.3, density = 1e3 }

[[terms]]
type = "stvk"
material = "rubber"

[[terms]]
type = "gravity"
g = [0.0, 0.0, -9.81]

[[terms]]
type = "traction"
on = "right"
traction = [0.0, 0.0, -2e4]
"""


def curved(cells=(2, 2, 1)):
    """Return curved hexahedra with unequal edges, of both orientations, with the boundaries of a box."""
    rng = np.random.default_rng(3)
    mesh = box((2.0, 1.0, 0.9), cells, "hexahedra").with_degree(2)
    p = mesh.p + 0.02 * rng.uniform(-1, 1, mesh.p.shape)
    p[0] = np.where((mesh.p[0] == 0) | (mesh.p[0] == 2), mesh.p[0], p[0])
    t, half = mesh.t.copy(), rng.random(mesh.nt) < 0.5
    half[:2] = True, False
    t[:, half] = t[HEX27.reversed][:, half]
    return replace(mesh, p=p, t=t)


def bent(mesh):
    return 0.05 * np.sin(3 * mesh.p[[1, 2, 0]]).T.ravel()


def of_scikit_fem(mesh):
    return skfem.MeshHex2(mesh.p, mesh.corners, sort_t=False, validate=False)


def basis_on(mesh):
    return skfem.Basis(of_scikit_fem(mesh), skfem.ElementHex2(), intorder=11)


@pytest.mark.parametrize("element", [HEX27, QUAD9], ids=lambda element: element.name)
def test_functions_nodes_and_facets_are_those_of_scikit_fem(element):
    theirs, xi = element.scikit_fem(), rule_of(element, "exact").points
    for a in range(element.n):
        value, slope = theirs.lbasis(xi.T, a)
        np.testing.assert_allclose(element.values(xi)[:, a], value, atol=1e-14)
        np.testing.assert_allclose(element.derivatives(xi)[:, a].T, slope, atol=1e-14)
    np.testing.assert_array_equal(element.nodes, theirs.doflocs)
    facet = ELEMENTS[element.facet]
    points = np.random.default_rng(0).random((5, facet.k))
    for nodes in element.facets:
        at = facet.values(points) @ element.nodes[list(nodes)]
        np.testing.assert_allclose(element.values(at)[:, nodes], facet.values(points), atol=1e-14)


@pytest.mark.parametrize("rule", ["usual", "exact"])
def test_energy_force_and_tangent_are_those_of_scikit_fem(rule):
    mesh = curved()
    u, reference = bent(mesh), ReferenceStVK(mesh.p, mesh.t, isotropic_tensor(5e6, 0.3, 3, condensed=False), HEX27.name, rule)
    system = System(mesh, RUBBER, quadrature=None if rule == "usual" else rule)
    F, K = reference.internal_force(u), reference.tangent(u)
    assert system.energy(u) == pytest.approx(reference.energy(u), rel=1e-13)
    assert np.abs(system.internal_force(u) - F).max() < 1e-13 * np.abs(F).max()
    assert np.abs(system.tangent(u) - K).max() < 1e-13 * np.abs(K).max()


def test_the_mass_rule_gives_the_mass_and_the_centre_of_curved_elements():
    mesh = curved()
    system = System(mesh, RUBBER)
    basis = basis_on(mesh)
    mass = 1e3 * skfem.Functional(lambda w: 1.0 + 0 * w.x[0]).assemble(basis)
    moment = 1e3 * skfem.Functional(lambda w: w.x[0]).assemble(basis)
    lumped = system.body.lumped_mass
    assert (lumped > 0).all() and lumped.sum() == pytest.approx(mass, rel=1e-13)
    weight = System(mesh, [RUBBER, Gravity((0, 0, -2.0))]).external_force(0 * bent(mesh)).reshape(-1, 3)[:, 2]
    assert weight.sum() == pytest.approx(-2 * mass, rel=1e-13)
    assert weight @ mesh.p[0] == pytest.approx(-2 * moment, rel=1e-13)


def test_pressure_on_the_whole_surface_has_no_resultant_and_the_work_of_the_volume():
    mesh = curved()
    system, u = System(replace(mesh, boundaries={"all": mesh.surface}), [RUBBER, Pressure("all", 3e4)]), bent(mesh)
    forces, x = system.external_force(u).reshape(-1, 3), mesh.p.T + u.reshape(-1, 3)
    volume = skfem.Functional(lambda w: 1.0 + 0 * w.x[0]).assemble(basis_on(replace(mesh, p=x.T)))
    assert np.abs(forces.sum(axis=0)).max() < 1e-12 * np.abs(forces).sum()
    assert (forces * x).sum() == pytest.approx(-3 * 3e4 * volume, rel=1e-12)


@pytest.mark.parametrize("solver", ["superlu", "amg-cg"])
def test_solve_static_finds_an_equilibrium_of_the_reference(solver):
    mesh = curved()
    loads = [Gravity((0, 0, -9.81)), Traction("right", (0, 0, -2e4))]
    system = System(mesh, [RUBBER, *loads], fixed={"left": "xyz"})
    found = solve_static(system, solver=solver, quiet=True)
    F = ReferenceStVK(mesh.p, mesh.t, isotropic_tensor(5e6, 0.3, 3, condensed=False), HEX27.name).internal_force(found.u)
    left = np.delete(F - system.external_force(found.u), system.supports.held)
    assert found.success and np.abs(left).max() < 1e-7 * np.abs(F).max() and np.abs(found.u).max() > 0.02


def test_simulate_conserves_energy_and_momentum():
    mesh = curved()
    system, push = System(mesh, RUBBER), np.sin(3 * mesh.p[::-1]).T.ravel()
    run = simulate(system, EnergyMomentum(dt=1e-3), until=0.01, v0=push, quiet=True)
    momenta = [run.ledger[f"{kind}_momentum_{x}"] for kind in ("linear", "angular") for x in "xyz"]
    assert run.success and np.ptp(run.ledger["strain_energy"]) > 0.1 * run.ledger["total_energy"][0]
    assert np.ptp(run.ledger["total_energy"]) < 1e-12 * run.ledger["total_energy"][0]
    assert np.ptp(momenta, axis=1).max() < 1e-12 * np.abs(momenta).max()
    explicit = simulate(system, VelocityVerlet(), until=0.01, v0=push, quiet=True)
    assert explicit.success and np.abs(explicit.u - run.u).max() < 0.1 * np.abs(run.u).max()


def test_modes_bound_frequencies_closer_than_tetrahedra_with_almost_the_same_nodes():
    one, other, fine = (
        modes(System(box((2.0, 1.0, 0.9), cells, kind).with_degree(2), RUBBER, {"left": "xyz"}), 3, mass="consistent").frequencies
        for cells, kind in (((4, 2, 2), "hexahedra"), ((4, 2, 2), "tetrahedra"), ((6, 3, 3), "hexahedra"))
    )
    assert (fine < one).all() and (one < other).all() and one == pytest.approx(other, rel=0.02)


def test_the_referee_passes_the_element():
    report = verify(curved((2, 1, 1)), young=5e6, poisson=0.3, quiet=True)
    assert report.passed and report.header is not None


def test_a_written_mesh_is_read_back(tmp_path):
    mesh = curved()
    mesh = replace(mesh, subdomains={"half": np.arange(2, dtype=np.int32)}, node_sets={"some": np.array([1, 20, mesh.nv - 1])})
    again = read_mesh(write_mesh(tmp_path / "mesh.vtu", mesh))
    assert again.element is HEX27 and np.array_equal(again.p, mesh.p) and np.array_equal(again.t, mesh.t)
    for name in ("boundaries", "subdomains", "node_sets"):
        ours, theirs = getattr(mesh, name), getattr(again, name)
        assert sorted(ours) == sorted(theirs) and all(np.array_equal(ours[key], theirs[key]) for key in ours)
    of_scikit_fem(mesh).save(tmp_path / "theirs.vtk")
    theirs = read_mesh(tmp_path / "theirs.vtk")
    assert theirs.element is HEX27 and np.array_equal(theirs.p[:, theirs.t], mesh.p[:, mesh.t])
    other, nodes = mesh.renumbered()
    assert (
        other.element is HEX27
        and np.array_equal(other.p[:, other.t], mesh.p[:, mesh.t])
        and np.array_equal(other.p, mesh.p[:, nodes])
    )


def test_cells_of_ambiguous_node_order_are_read_by_their_corners():
    mesh = curved()
    _, cells = as_cells(mesh.t, HEX27)
    with pytest.warns(StvkWarning, match="higher order"):
        taken = ElementMesh.of(meshio.Mesh(mesh.p.T, [("VTK_LAGRANGE_HEXAHEDRON", cells)]))
    assert taken.element is ELEMENTS["hexahedra"] and np.array_equal(taken.p[:, taken.t], mesh.p[:, mesh.corners])


def test_meshes_with_nodes_off_the_edges_have_no_ends():
    assert curved().ends() is None


def test_quality_names_the_elements_that_fold():
    mesh = curved()
    assert mesh_quality(mesh).sound
    p = mesh.p.copy()
    p[:, mesh.t[26, 1]] = p[:, mesh.t[0, 1]]  # the middle of the cell is pushed to a corner
    (fault,) = [fault for fault in mesh_quality(replace(mesh, p=p)).faults if fault.name == "folded"]
    assert fault.ids.tolist() == [1] and "of faces and of the cell" in fault.text


def test_scenes_accept_the_element_from_a_file_and_from_a_key(tmp_path):
    mesh = curved()
    loads = [Gravity((0, 0, -9.81)), Traction("right", (0, 0, -2e4))]
    system = System(mesh, [RUBBER, *loads], fixed={"left": "xyz"})
    write_mesh(tmp_path / "curved.vtu", mesh)
    (tmp_path / "scene.toml").write_text(SCENE, encoding="utf-8")
    again = Scene.read(tmp_path / "scene.toml")
    assert again.system().mesh.element is HEX27
    assert np.array_equal(again.solve(quiet=True).result.u, solve_static(system, steps=1, quiet=True).u)
    text = (tmp_path / "scene.toml").read_text(encoding="utf-8")
    start, end = text.index("[mesh]"), text.index("[", text.index("[mesh]") + 1)
    made = '[mesh]\ntype = "box"\nsize = [2.0, 1.0, 0.9]\ncells = [2, 2, 1]\nelement = "hexahedra"\ndegree = 2\n'
    (tmp_path / "box.toml").write_text(text[:start] + made + text[end:], encoding="utf-8")
    assert Scene.read(tmp_path / "box.toml").system().mesh.element is HEX27


@pytest.mark.parametrize("rule", RULES)
def test_no_weight_is_negative(rule):
    assert (rule_of(HEX27, rule).weights > 0).all()


def test_the_mesh_is_that_of_scikit_fem():
    straight = skfem.MeshHex2.from_mesh(skfem.MeshHex().refined(1))
    mesh = ElementMesh.of(straight)
    assert mesh.element is HEX27 and np.array_equal(mesh.t, ElementMesh.of(skfem.MeshHex().refined(1)).with_degree(2).t)
    every, sides = facets_of(mesh.t, mesh.nv, HEX27)[0], box((1.0, 1.0, 1.0), 2, "hexahedra").with_degree(2)
    assert every.shape == (9, 36) and (find_facets(every[::-1], every, mesh.nv) == np.arange(36)).all()
    for side in sides.boundaries.values():
        assert (find_facets(side, facets_of(sides.t, sides.nv, HEX27)[0], sides.nv) >= 0).all()
    view = skfem.Basis(straight, skfem.ElementVector(skfem.ElementHex2())).get_dofs(lambda x: x[0] == 0)
    by_view, by_predicate = (System(mesh, RUBBER, fixed=[(where, "xyz")]).supports.fixed for where in (view, lambda x: x[0] == 0))
    assert np.array_equal(by_view, by_predicate) and len(by_view) == 75
    with pytest.warns(StvkWarning, match="0 of their 54 edges are curved"):
        assert mesh.with_degree(1).element is ELEMENTS["hexahedra"]
