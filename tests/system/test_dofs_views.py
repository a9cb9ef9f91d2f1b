"""A view of scikit-fem's `get_dofs` stands for its vertices where a location is expected.

As the whole of `fixed`, the view stands for its degrees of freedom.
"""

import numpy as np
import pytest
import skfem

from skfem_stvk import (
    ElasticFoundation,
    ElementMesh,
    Gravity,
    NodalLoad,
    Pressure,
    RegionError,
    Stop,
    StVK,
    SupportError,
    System,
    Traction,
    simulate,
    solve_static,
)
from skfem_stvk.mesh.locations import describe, facets_at, vertices_at
from skfem_stvk.results import Reaction
from skfem_stvk.solvers.dynamics import VelocityVerlet

MESH = skfem.MeshTet.init_tensor(*[np.linspace(0, 1, n) for n in (4, 3, 5)]).with_boundaries(
    {"bot": lambda x: x[2] == 0, "top": lambda x: x[2] == 1, "side": lambda x: x[0] == 0}
)
BASIS = skfem.Basis(MESH, skfem.ElementVector(skfem.ElementTetP1()))
BOT, TOP = BASIS.get_dofs("bot"), BASIS.get_dofs("top")
IDS = np.flatnonzero(MESH.p[2] == 0)
RUBBER = StVK(young=1e5, poisson=0.3, density=1e3)
ELEMENTS = [skfem.ElementTetP1(), skfem.ElementVector(skfem.ElementTetP2()), skfem.ElementVector(skfem.ElementTetP0())]


def as_sets(facets):
    return {frozenset(facet) for facet in facets.T.tolist()}


def force(*terms):
    system = System(MESH, [RUBBER, *terms])
    return system.residual(np.cos(np.arange(system.ndofs)) / 50)


@pytest.mark.parametrize(
    "term",
    [
        lambda where: NodalLoad(where, (1.0, 2.0, 3.0)),
        lambda where: Traction(where, lambda x, t: x),
        lambda where: Pressure(where, 2.0),
        lambda where: ElasticFoundation(where, 4e3),
    ],
)
def test_a_view_as_location_of_loads_is_its_vertices(term):
    assert np.array_equal(force(term(BOT)), force(term("bot"))) and (force(term(BOT)) != force()).any()


def test_a_view_as_any_other_location_is_its_vertices():
    mesh = ElementMesh.of(MESH)
    assert np.array_equal(vertices_at(mesh, BOT), IDS) and describe(BOT) == describe(IDS)
    assert as_sets(facets_at(mesh, BOT)) == as_sets(mesh.boundaries["bot"])
    assert as_sets(mesh.with_boundaries({"floor": BOT}).boundaries["floor"]) == as_sets(mesh.boundaries["bot"])
    u = np.sin(np.arange(mesh.p.size))
    assert np.array_equal(Reaction.of(mesh, u, u, BOT).vertices, IDS)
    system = System(MESH, [RUBBER, Gravity((0, 0, -9.81))], fixed={"bot": "xyz"})
    result = solve_static(system, steps=2, method="arc-length", stop=Stop(displacement=(TOP, "z", -1e-3)), quiet=True)
    assert result.u.reshape(-1, 3)[np.flatnonzero(MESH.p[2] == 1), 2].mean() == pytest.approx(-1e-3, rel=1e-8)
    assert np.array_equal(result.reaction(BOT).by_node, result.reaction("bot").by_node)
    run = simulate(system, VelocityVerlet(), until=0.01, probes={"A": TOP}, reactions={"B": BOT}, quiet=True)
    assert np.array_equal(
        run.ledger["A z"], simulate(system, VelocityVerlet(), until=0.01, probes={"A": "top"}, quiet=True).ledger["A z"]
    )
    assert np.array_equal(run.reaction(BOT).by_node, run.reaction("bot").by_node)


def test_vertices_of_views_by_id_retain_their_order():
    view = BASIS.get_dofs(nodes=np.array([9, 5]))
    f = force(NodalLoad(view, np.array([[1.0, 2.0], [0, 0], [0, 0]]))) - force()
    assert -f[27] == pytest.approx(1.0) and -f[15] == pytest.approx(2.0)


@pytest.mark.parametrize(
    "fixed",
    [
        BOT,
        BOT.keep("u^3"),
        BOT.drop("u^1"),
        BASIS.get_dofs(elements=[3]),
        BASIS.get_dofs(nodes=np.array([1, 7])),
        BASIS.get_dofs({"bot", "side"}),
    ],
)
def test_a_view_as_fixed_is_its_degrees_of_freedom(fixed):
    system = System(MESH, RUBBER, fixed=fixed)
    assert np.array_equal(system.supports.fixed, fixed.flatten())
    assert np.array_equal(system.free_dofs(fixed).fixed, fixed.flatten())


def test_several_views_by_name_are_the_degrees_of_freedom_of_all():
    several = {"bot": BOT.keep("u^3"), "top": TOP}
    expected = np.union1d(several["bot"].all(), TOP.all())
    for fixed in (several, list(several.items())):
        assert np.array_equal(System(MESH, RUBBER, fixed=fixed).supports.fixed, expected)
        assert np.array_equal(System(MESH, RUBBER).free_dofs(fixed).fixed, expected)


@pytest.mark.parametrize("element", ELEMENTS, ids=["a number per vertex", "quadratic", "one per element"])
def test_degrees_of_freedom_of_another_element_are_refused(element):
    view = skfem.Basis(MESH, element).get_dofs(elements=[0, 1])
    for fixed in (view, [(view, "xyz")], {"bot": view}):
        with pytest.raises(RegionError, match=r"are of Element\w+.*; expected those of linear vectors with 3 components"):
            System(MESH, RUBBER, fixed=fixed)
    with pytest.raises(RegionError, match="are of Element"):
        System(MESH, RUBBER).free_dofs(view)
    with pytest.raises(RegionError, match=r"NodalLoad on .*are of Element"):
        force(NodalLoad(view, (1, 2, 3)))


@pytest.mark.parametrize(
    ("mesh", "difference"),
    [
        (MESH.refined(1), "with 315 vertices in 3D; this one has 60"),
        (MESH.translated((1, 0, 0)), "with as many vertices elsewhere"),
    ],
)
def test_degrees_of_freedom_of_another_mesh_are_refused(mesh, difference):
    view = skfem.Basis(mesh, skfem.ElementVector(skfem.ElementTetP1())).get_dofs(lambda x: x[2] == 0)
    for fixed in (view, [(view, "xyz")]):
        with pytest.raises(RegionError, match=f"of another mesh, {difference}"):
            System(MESH, RUBBER, fixed=fixed)


def test_degrees_of_freedom_are_refused_as_elements():
    with pytest.raises(RegionError, match="degrees of freedom; expected a name in subdomains, element ids or a mask"):
        System(MESH, StVK(young=1.0, poisson=0.3, region=BOT))


@pytest.mark.parametrize("bare", [BOT.all("u^3"), [0, 1, 2], range(3), np.array(5)])
def test_bare_integers_are_refused_as_fixed(bare):
    with pytest.raises(SupportError, match=r"Bare integers do not say which components.*get_dofs"):
        System(MESH, RUBBER, fixed=bare)


@pytest.mark.parametrize("several", [(BOT, TOP), [BOT, BASIS.get_dofs("side")], {"bot": BOT}])
def test_several_views_are_refused_as_a_location(several):
    with pytest.raises(RegionError, match="expected the name of a boundary"):
        force(NodalLoad(several, (1, 2, 3)))
