"""Reactions of supports that share nodes add up, with the loads, to zero in statics and to those of the whole body in motions."""

import numpy as np
import pytest
import skfem

from skfem_stvk import (
    BackwardEuler,
    Box,
    ElasticFoundation,
    ElementMesh,
    EnergyMomentum,
    Gravity,
    Newmark,
    ReducedSystem,
    Simulation,
    StVK,
    System,
    Traction,
    VelocityVerlet,
    simulate,
    solve_static,
)
from skfem_stvk.mesh.locations import vertices_at
from skfem_stvk.results.reactions import moment_of

POINT = (0.3, -0.2, 0.7)
FACES = {"left": (0, 0), "right": (0, 1), "bottom": (1, 0), "back": (1, 1), "front": (2, 0), "top": (2, 1)}


def cube(d=3, degree=1, n=3):
    """Return a mesh with a boundary for each of its faces, of unequal elements, and a node set `all`."""
    lines = [np.linspace(0, 1, n) ** 1.2, np.linspace(0, 1.1, n), np.linspace(0, 0.9, n)]
    mesh = (skfem.MeshTet if d == 3 else skfem.MeshTri).init_tensor(*lines[:d])
    ends = mesh.p.min(axis=1), mesh.p.max(axis=1)
    faces = {name: (lambda x, i=i, e=ends[end][i]: np.abs(x[i] - e) < 1e-9) for name, (i, end) in FACES.items() if i < d}
    mesh = ElementMesh.of(mesh.with_boundaries(faces))
    mesh = ElementMesh(mesh.p, mesh.t, boundaries=mesh.boundaries, node_sets={"all": np.arange(mesh.nv)})
    return mesh.with_degree(degree) if degree > 1 else mesh


def loads(d):
    return [Traction("top" if d == 3 else "right", (10.0, -60.0, 400.0)[:d]), Gravity((3.0, -9.0, 5.0)[:d])]


def law(mesh):
    young = np.random.default_rng(3).uniform(0.5e5, 2e5, mesh.nt)
    return StVK(young=young, poisson=0.3, density=700.0)


#: Supports, and the places that have all of them.
SUPPORTS = {
    "symmetry planes": ({"left": "x", "bottom": "y", "front": "z"}, {}),
    "clamps that overlap": ({"left": "xyz", "bottom": "xy", "front": "xz"}, {}),
    "prescribed alike": ({"bottom": "y"}, {"left": {"x": 0.02}, "front": {"x": 0.02, "z": -0.01}}),
    "one place, two kinds": ({"left": "y", "front": "z"}, {"left": {"x": 0.02}, "bottom": {"x": 0.02}}),
}


def places(fixed, prescribed):
    return list(dict.fromkeys([*fixed, *prescribed]))


def sums(reaction, about=POINT):
    d = reaction.rest.shape[1]
    return np.array([*reaction.resultant, *np.atleast_1d(reaction.moment(about[:d]))])


def of_loads(system, u, t=1.0, about=POINT):
    d = system.mesh.d
    force = system.external_force(u, t).reshape(-1, d)
    x = system.mesh.p.T + u.reshape(-1, d)
    return np.array([*force.sum(axis=0), *np.atleast_1d(moment_of(x - about[:d], force))])


def limited(entries, d):
    """Return supports without the faces and components that a plane body lacks."""
    axes = "xyz"[:d]
    kept = {name: support for name, support in entries.items() if FACES[name][0] < d}
    if all(isinstance(one, str) for one in kept.values()):
        kept = {name: "".join(c for c in support if c in axes) for name, support in kept.items()}
    else:
        kept = {name: {c: value for c, value in support.items() if c in axes} for name, support in kept.items()}
    return {name: support for name, support in kept.items() if support}


@pytest.mark.few
@pytest.mark.parametrize(("d", "degree"), [(3, 1), (2, 1), (2, 2)])
@pytest.mark.parametrize("name", SUPPORTS)
def test_supports_and_loads_add_up_to_zero(name, d, degree):
    """Forces and moments about any point; without shares of common nodes they differ by more than a hundredth."""
    mesh = cube(d, degree)
    fixed, prescribed = (limited(entries, d) for entries in SUPPORTS[name])
    result = solve_static(System(mesh, [law(mesh), *loads(d)], fixed=fixed, prescribed=prescribed), rtol=1e-12, quiet=True)
    found = sum(sums(result.reaction(place)) for place in places(fixed, prescribed))
    wanted = of_loads(result.system, result.u)
    np.testing.assert_allclose(found, -wanted, rtol=0, atol=1e-9 * np.abs(wanted).max())
    np.testing.assert_allclose(found, sums(result.reaction()), rtol=0, atol=1e-9 * np.abs(wanted).max())
    whole = sum(sums(result.reaction(vertices_at(mesh, place))) for place in places(fixed, prescribed))
    assert np.abs(whole + wanted).max() > 0.01 * np.abs(wanted).max()


def test_a_support_has_its_own_components_and_equal_shares_of_common_ones():
    mesh = cube()
    fixed = {"left": "xy", "bottom": "y", "front": "yz"}
    result = solve_static(System(mesh, [law(mesh), *loads(3)], fixed=fixed), quiet=True)
    corner = int(np.flatnonzero((mesh.p == mesh.p.min(axis=1)[:, None]).all(axis=0))[0])
    at_all = result.reaction()
    force = at_all.by_node[list(at_all.vertices).index(corner)]
    for name, share in (("left", (1, 1 / 3, 0)), ("bottom", (0, 1 / 3, 0)), ("front", (0, 1 / 3, 1))):
        own = result.reaction(name)
        np.testing.assert_array_equal(own.by_node[list(own.vertices).index(corner)], force * share)
    assert np.abs(force).min() > 0.1


def test_other_places_have_all_constrained_components_at_their_nodes():
    mesh = cube()
    result = solve_static(System(mesh, [law(mesh), *loads(3)], fixed={"left": "x", "bottom": "y", "front": "z"}), quiet=True)
    everything, nodes = result.reaction(), vertices_at(mesh, "left")
    for other in (nodes, lambda x: x[0] < 1e-9, Box((0, 0, 0), (0, 2, 2))):
        place = result.reaction(other)
        np.testing.assert_array_equal(place.by_node, everything.by_node[np.isin(everything.vertices, place.vertices)])
        assert np.array_equal(place.vertices, nodes) and np.abs(place.by_node[:, 1:]).max() > 1


@pytest.mark.parametrize("where", ["shapes", "ids"])
def test_shapes_and_ids_of_supports_are_their_locations_too(where):
    """Shapes and tuples of ids are compared by value; other ids must be the same object."""
    mesh = cube()
    boxes = {"left": Box((0, 0, 0), (0, 2, 2)), "bottom": Box((0, 0, 0), (2, 0, 2)), "front": Box((0, 0, 0), (2, 2, 0))}
    own = boxes if where == "shapes" else {name: vertices_at(mesh, name) for name in boxes}
    fixed = [(own[name], "xyz"[FACES[name][0]]) for name in boxes]
    result = solve_static(System(mesh, [law(mesh), *loads(3)], fixed=fixed), quiet=True)
    again = {name: Box(one.low, one.high) if where == "shapes" else one for name, one in own.items()}
    found = sum(result.reaction(one).resultant for one in again.values())
    np.testing.assert_allclose(found, result.reaction().resultant, rtol=1e-12)
    if where == "ids":
        copies = [result.reaction(list(one)).resultant for one in own.values()]
        assert np.abs(sum(copies) - found).max() > 1


def test_foundations_are_supports_of_nodes_that_no_support_holds():
    """At other nodes their forces belong to the supports there."""
    mesh = cube()
    beds = [ElasticFoundation("bottom", (2e4, 5e4, 1e4)), ElasticFoundation("front", (0.0, 0.0, 8e4))]
    system = System(mesh, [law(mesh), *beds, *loads(3)], fixed={"left": "x"})
    result = solve_static(system, rtol=1e-12, quiet=True)
    wanted = of_loads(result.system, result.u)
    found = {name: sums(result.reaction(name)) for name in ("left", "bottom", "front")}
    np.testing.assert_allclose(sum(found.values()), -wanted, rtol=0, atol=1e-9 * np.abs(wanted).max())
    assert not found["front"][:2].any() and found["left"][1:3].all()
    springs = system.foundation_force(result.u).reshape(-1, 3)
    alone = np.setdiff1d(vertices_at(mesh, "bottom"), np.union1d(vertices_at(mesh, "left"), vertices_at(mesh, "front")))
    place = result.reaction("bottom")
    np.testing.assert_array_equal(place.by_node[np.isin(place.vertices, alone)], springs[alone])
    assert not place.by_node[mesh.p[0, place.vertices] == 0].any()


def moving():
    """Return a body that is driven at two places and held at others, all of which share nodes."""
    mesh = cube()
    drive = lambda t: 0.02 * np.sin(9 * t)  # noqa: E731
    fixed, prescribed = {"bottom": "y", "front": "yz"}, {"left": {"x": drive}, "back": {"x": drive}}
    return System(mesh, [law(mesh), *loads(3)], fixed=fixed, prescribed=prescribed), ("left", "back", "bottom", "front")


@pytest.mark.parametrize(
    ("integrator", "mass"),
    [
        (EnergyMomentum(2e-3), "consistent"),
        (VelocityVerlet(2e-4), "lumped"),
        (Newmark(2e-3), "lumped"),
        (BackwardEuler(2e-3), "lumped"),
    ],
    ids=lambda one: getattr(one, "name", one),
)
def test_supports_of_a_motion_add_up_to_all_of_them(integrator, mass):
    system, names = moving()
    reactions = {"all": None} | {f"at {name}": name for name in names}
    run = simulate(system, integrator, until=0.02, mass=mass, reactions=reactions, quiet=True)
    columns = {name: np.stack([run.ledger[f"reaction {name} {axis}"] for axis in "xyz"], axis=1) for name in reactions}
    whole = columns.pop("all")
    np.testing.assert_allclose(sum(columns.values()), whole, rtol=0, atol=1e-11 * np.abs(whole).max())
    np.testing.assert_allclose(sum(sums(run.reaction(name)) for name in names), sums(run.reaction()), rtol=1e-11)
    for name in names:
        np.testing.assert_allclose(columns[f"at {name}"][-1], run.reaction(name).resultant, rtol=1e-12, atol=1e-9)
    assert not columns["at left"][:, 1:].any() and not columns["at bottom"][:, [0, 2]].any()


def test_a_resumed_run_records_the_same_reactions(tmp_path):
    system, names = moving()
    options = {"reactions": {"all": None} | {name: name for name in names}, "quiet": True}
    whole = simulate(system, EnergyMomentum(2e-3), until=0.02, **options)
    simulate(system, EnergyMomentum(2e-3), until=0.01, checkpoint=tmp_path / "run", **options)
    again = simulate(system, until=0.02, checkpoint=tmp_path / "run", resume=True, quiet=True)
    for name in whole.ledger:
        np.testing.assert_array_equal(again.ledger[name], whole.ledger[name], err_msg=name)
    assert again.ledger["reaction left x"].any() and not again.ledger["reaction left y"].any()


@pytest.mark.parametrize("reduced", [False, True])
def test_supports_of_a_simulation_add_up_to_all_of_them(reduced):
    mesh = cube()
    fixed = {"bottom": "y", "left": "yz", "front": "z"}
    system = System(mesh, [law(mesh), *loads(3)], fixed=fixed, prescribed={"left": "x"})
    sim = Simulation(ReducedSystem(system, modes=8, quiet=True) if reduced else system, Newmark(2e-3))
    for k in range(4):
        sim.step(left=(0.002 * (k + 1),))
    parts = {name: sim.reaction(name) for name in ("left", "bottom", "front")}
    whole = sim.reaction("all")
    assert not parts["bottom"][[0, 2]].any() and not parts["front"][:2].any() and np.abs(whole).min() > 1
    np.testing.assert_allclose(sum(parts.values()), whole, rtol=0, atol=1e-10 * np.abs(whole).max())
