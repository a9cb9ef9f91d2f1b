"""Contact with rigid surfaces of triangles or segments: derivatives, other contacts as references, ledgers, and bad input."""

import pickle

import meshio
import numpy as np
import pytest
import skfem
from terms.test_mesh_contact import DISTANCE, GAP, LAW, by_node, force_of, joined, slope, tensor, two, upper

from skfem_stvk import (
    BackwardEuler,
    ContactError,
    EnergyMomentum,
    Friction,
    Gravity,
    MeshContact,
    RigidContact,
    RigidMesh,
    RigidPlane,
    Simulation,
    StVK,
    StvkError,
    StvkWarning,
    System,
    simulate,
    solve_static,
)
from skfem_stvk.mesh import ElementMesh
from skfem_stvk.terms.loads.load import Moment, StepStart

#: Corners of a table top of two triangles, larger than the blocks; its normal points upwards.
TABLE = np.array([[-1.0, 1.0, 1.0, -1.0], [-1.0, -1.0, 1.0, 1.0], [0.0, 0.0, 0.0, 0.0]]), np.array([[0, 0], [1, 2], [2, 3]])


def die(low=(0.0, 0.0, 0.0), size=(0.1, 0.1, 0.05), n=(6, 6, 3)):
    """Return the surface of a block as arrays."""
    mesh = ElementMesh.of(tensor(size, n))
    return mesh.p + np.reshape(low, (3, 1)), mesh.surface


def pressed(friction=None, law=LAW, fixed=None, **options):
    """Return an upper block, that of `two`, above a rigid block, and the system without contact."""
    mesh = two()
    t = mesh.t[:, mesh.elements("upper")]
    nodes = np.unique(t)
    block = ElementMesh(mesh.p[:, nodes], np.searchsorted(nodes, t))
    contact = MeshContact(None, RigidMesh(die()), distance=DISTANCE, friction=friction, name="die", **options)
    return System(block, [law, contact], fixed), System(block, law, fixed)


POLYGON = ElementMesh.of(tensor((0.1, 0.05), (6, 3), skfem.MeshTri))
FLAT = StVK(young=3e4, poisson=0.3, density=1000.0, thickness=0.02)


def pressed_on_a_polygon():
    """Return a block in the plane above a rigid polygon."""
    block = tensor((0.08, 0.05), (3, 2), skfem.MeshTri).translated((0.013, 0.05 + GAP))
    contact = MeshContact(None, RigidMesh((POLYGON.p, POLYGON.surface)), distance=DISTANCE, name="die")
    return System(block, [FLAT, contact])


def rng(system, size=2e-4, seed=0):
    u, v = np.random.default_rng(seed).normal(size=(2, system.ndofs))
    return size * u, v / np.abs(v).max()


@pytest.mark.parametrize("friction", [None, Friction(0.4, slip_length=1e-4)])
def test_forces_are_those_of_contact_with_a_body_that_does_not_move(friction):
    system, _ = pressed(friction)
    p, lower = system.mesh.p, tensor((0.1, 0.1, 0.05), (6, 6, 3))
    t = np.hstack([lower.t, system.mesh.t + lower.p.shape[1]])
    halves = {"lower": np.arange(lower.t.shape[1]), "upper": np.arange(lower.t.shape[1], t.shape[1])}
    mesh = ElementMesh(np.hstack([lower.p, p]), t, subdomains=halves)
    both = System(mesh, [LAW, MeshContact("lower", "upper", distance=DISTANCE, friction=friction)])
    assert len(system.bound_terms[1]._X) == len(both.bound_terms[1]._X)
    top, u = upper(both), rng(system)[0]
    w = np.zeros((both.mesh.nv, 3))
    contacts = [one.bound_terms[1].for_analysis(in_time=False) for one in (system, both)]
    histories = [contact.first_history() for contact in contacts]
    for t, shift in ((0.0, 0.0), (1.0, 2e-4)):
        moved = by_node(u).copy()
        moved[:, 0] += shift
        w[top] = moved
        found = []
        for i, x in enumerate((moved, w)):
            term = contacts[i].at(Moment(t, t, step=StepStart((histories[i],), in_time=False)), histories[i])
            term.look(x)
            found.append((term.energy_and_force(x), by_node(force_of(term, x.ravel())), term.evaluated(x)))
            histories[i] = contacts[i].advanced(histories[i], x, Moment(t, t))
        (W, F, of), (V, G, other) = found
        assert pytest.approx(V, rel=1e-12) == W and np.abs(F - G[top]).max() < 1e-11 * np.abs(F).max() > 0
        assert np.allclose(of[0], other[0][top], rtol=1e-9) and np.allclose(of[1], other[1][top], rtol=1e-9)


def test_a_block_rests_on_it_as_on_a_plane():
    mesh = tensor((0.1, 0.1, 0.1), (4, 4, 4))
    law, top = StVK(young=3e4, poisson=0.3, density=1000.0), mesh.p[2].max()
    turn = np.array([[0.8, -0.6, 0], [0.6, 0.8, 0], [0, 0, 1]])
    lid = {lambda x: x[2] == top: {"x": 0.0, "y": 0.0, "z": -2e-3}}
    with pytest.warns(StvkWarning, match="two-sided"):
        table = RigidMesh((turn @ TABLE[0] - [[0], [0], [3e-4]], TABLE[1]))
    contacts = MeshContact(None, table, distance=3e-4, name="floor"), RigidContact(RigidPlane((0, 0, 0), (0, 0, 1)), name="floor")
    forces = [
        solve_static(System(mesh, [law, contact], prescribed=lid), steps=5, quiet=True).contact("floor").resultant[2]
        for contact in contacts
    ]
    assert forces[0] == pytest.approx(forces[1], rel=0.03) and forces[0] > 1


@pytest.mark.parametrize(("n", "within"), [(1, 0.2), (5, 0.2), (64, 0.3)])
def test_the_force_hardly_depends_on_its_triangles(n, within):
    """Long edges are bisected. The edges of the last table are shorter than those of the block."""
    block, forces = ElementMesh.of(tensor((0.1, 0.1, 0.05), (4, 4, 2))), []
    for parts in (n, 40):
        top = tensor((1.0, 1.0), (parts, parts), skfem.MeshTri)
        table = np.vstack([top.p - 0.45, np.full(top.p.shape[1], -1.5e-3)]), top.t
        with pytest.warns(StvkWarning, match="two-sided"):
            contact = MeshContact(None, RigidMesh(table), distance=2.5e-3)
        body = System(block, [LAW, contact])
        forces.append(by_node(body.internal_force(np.zeros(body.ndofs)))[:, 2].sum())
    assert forces[0] == pytest.approx(forces[1], rel=within) and forces[1] < -1


def test_it_does_not_touch_itself():
    system, _ = pressed()
    fine = MeshContact(None, RigidMesh(die(n=(30, 30, 15))), distance=DISTANCE)
    away = np.full((system.mesh.nv, 3), 1.0)
    assert System(system.mesh, [LAW, fine]).bound_terms[1].energy_and_force(away) == 0


def test_refined_surfaces_are_the_same_surfaces():
    p = np.array([[0, 1, 0.2, 0.1], [0, 0.1, 0.5, 0.2], [0, 0, 0.1, 0.8]])
    sharp = ElementMesh(p, np.arange(4)[:, None])
    rigid = RigidMesh((p, sharp.surface))
    points, t = rigid.refined(0.1)
    assert len(t) > 100 and RigidMesh((points.T, t.T)).closed and len(np.unique(points, axis=0)) == len(points)
    rigid, longest = RigidMesh(die((0, 0, 0), (0.1, 0.3, 1.0), (1, 1, 1))), 0.06
    points, t = rigid.refined(longest)
    ends = points[t] - np.roll(points[t], 1, axis=1)
    fine = RigidMesh((points.T, t.T))
    assert 0.5 * longest < np.linalg.norm(ends, axis=2).max() <= longest and fine.closed
    assert fine._areas().sum() == pytest.approx(0.86) and fine._size() == pytest.approx(6 * 0.03)
    assert fine._areas().min() > 0.01 * longest**2
    with pytest.raises(ContactError, match=r"about .* triangles with edges of 1e-05 m"):
        rigid.refined(1e-5)


def test_energy_momentum_closes_the_ledger_of_an_impact():
    system, _ = pressed()
    run = simulate(system, EnergyMomentum(dt=2.5e-4), until=0.01, v0=np.tile([0.1, 0, -0.5], system.mesh.nv), quiet=True)
    ledger, kinetic = run.ledger, run.ledger["kinetic_energy"][0]
    assert np.abs(ledger["closure_error"]).max() < 1e-11 * kinetic and ledger["strain_energy MeshContact 1"].max() > 1e-4 * kinetic
    assert by_node(run.v)[:, 2].mean() > 0.1 and run.contact("die").gap.min() > 0
    force, p = ledger["contact die z"], ledger["linear_momentum_z"]
    assert force.max() > 0 and p[-1] - p[0] == pytest.approx(force[1:] @ np.diff(ledger["time"]), rel=1e-6)  # means over steps


def test_a_block_slides_and_friction_slows_it():
    friction, start, until = Friction(0.4, slip_speed=0.02), 0.3, 0.04
    system, _ = pressed(friction, law=StVK(young=3e5, poisson=0.3, density=1000.0), stiffness=1e3)
    body = System(system.mesh, [*system.terms, Gravity((0, 0, -9.81))])
    resting = simulate(body, BackwardEuler(dt=0.02), until=1.0, quiet=True)
    v0 = np.tile([start, 0, 0], system.mesh.nv)
    run = simulate(body, EnergyMomentum(dt=1e-3), until=until, u0=resting.u, v0=v0, quiet=True)
    ledger, slid = run.ledger, 0.4 * 9.81 * until
    assert ledger["linear_momentum_x"][-1] / ledger["linear_momentum_x"][0] == pytest.approx(1 - slid / start, rel=0.03)
    assert ledger["friction_work"][-1] == pytest.approx(ledger["kinetic_energy"][0] * (1 - (1 - slid / start) ** 2), rel=0.05)
    assert np.abs(ledger["closure_error"]).max() < 1e-10 * ledger["kinetic_energy"][0]


def test_a_block_that_touches_it_is_held_along_its_normal():
    system, _ = pressed(fixed={lambda x: x[0] == x[0].min(): "xy"})
    nodes, directions = system.bound_terms[1].held_directions(np.zeros((system.mesh.nv, 3)))
    assert len(nodes) and directions[:, 2].min() > 0.5
    found = solve_static(
        System(system.mesh, [*system.terms, Gravity((0, 0, -9.81))], {lambda x: x[0] == x[0].min(): "xy"}), quiet=True
    )
    assert found.success and found.contact("die").resultant[2] == pytest.approx(0.08 * 0.07 * 0.05 * 9810, rel=1e-6)


def test_a_run_is_resumed_with_the_same_surface_alone(tmp_path):
    friction = Friction(0.3, slip_speed=0.05)
    system, _ = pressed(friction)
    options = {"v0": np.tile([0.1, 0, -0.5], system.mesh.nv), "quiet": True}
    whole = simulate(system, BackwardEuler(dt=1e-3), until=0.015, **options)
    simulate(system, BackwardEuler(dt=1e-3), until=0.009, checkpoint=tmp_path, **options)
    again = simulate(
        pickle.loads(pickle.dumps(system)), BackwardEuler(dt=1e-3), until=0.015, checkpoint=tmp_path, resume=True, quiet=True
    )
    assert np.array_equal(again.u, whole.u) and np.array_equal(again.v, whole.v)
    p, t = die()
    mirrored = p * np.array([[-1], [1], [1]]), t[::-1]  # the coordinates have the same absolute values
    for other in (die((0, 0, -1e-3)), mirrored):
        moved = MeshContact(None, RigidMesh(other), distance=DISTANCE, friction=friction, name="die")
        with pytest.raises(StvkError, match=r"contacts .* changed"):
            simulate(
                System(system.mesh, [LAW, moved]), BackwardEuler(dt=1e-3), until=0.015, checkpoint=tmp_path, resume=True, quiet=True
            )


def test_removed_elements_take_their_facets_with_them():
    system, _ = pressed()
    u, v = rng(system)
    torn = system.without(np.flatnonzero(system.mesh.p[2, system.mesh.t].mean(axis=0) < 0.078))
    term = torn.bound_terms[1]
    assert term.energy_and_force(by_node(u)) < 1e-3 * system.bound_terms[1].energy_and_force(by_node(u))
    half = system.without(np.flatnonzero(system.mesh.p[0, system.mesh.t].mean(axis=0) < 0.04))
    by_node(v)[half.bare] = 0  # K has entries there that belong to no term
    K, F = half.tangent(u), lambda s: half.internal_force(u + s * v)
    assert np.abs(K @ v - slope(F)).max() < 1e-5 * np.abs(K @ v).max()


def test_elements_can_be_removed_while_the_body_touches():
    system, _ = pressed()
    corner = np.flatnonzero(system.mesh.p[:, system.mesh.t].mean(axis=1)[[0, 2]].sum(axis=0) < 0.1)
    options = {"remove": lambda t, u: corner if t > 1.5e-4 else None, "v0": np.tile([0, 0, -0.5], system.mesh.nv), "quiet": True}
    run = simulate(system, EnergyMomentum(dt=1e-4), until=6e-4, **options)
    ledger = run.ledger
    assert len(run.system.removed) == len(corner) > 2 and ledger["contact die z"][:4].min() > 0
    assert np.abs(ledger["closure_error"]).max() < 1e-11 * ledger["kinetic_energy"][0]


# Rigid polygons


def test_forces_of_a_polygon_are_those_of_a_body_that_does_not_move():
    one = pressed_on_a_polygon()
    both = System(joined(POLYGON, one.mesh, (0.0, 0.0)), [one.terms[0], MeshContact("lower", "upper", distance=DISTANCE)])
    u, _ = rng(one)
    w = np.zeros((both.mesh.nv, 2))
    w[upper(both)] = u.reshape(-1, 2)
    F, G = (force_of(body.bound_terms[1], x).reshape(-1, 2) for body, x in ((one, u), (both, w)))
    assert np.abs(F - G[upper(both)]).max() < 1e-11 * np.abs(F).max() > 0
    run = simulate(one, EnergyMomentum(dt=1e-3), until=0.02, v0=np.tile([0.1, -0.5], one.mesh.nv), quiet=True)
    assert np.abs(run.ledger["closure_error"]).max() < 1e-11 * run.ledger["kinetic_energy"][0]
    assert run.v[1::2].mean() > 0.1 and run.ledger["contact die y"].max() > 0


def test_the_side_of_a_polygon_is_on_the_right_of_its_segments():
    block, p = tensor((0.1, 0.1), (2, 2), skfem.MeshTri), np.array([[-0.1, 0.2, 0.2, -0.1], [-0.1, -0.1, 0.2, 0.2]])
    t = np.array([[0, 1, 2, 3], [1, 2, 3, 0]])
    with pytest.raises(ContactError, match="inside the RigidMesh at the start"):
        System(block, [FLAT, MeshContact(None, RigidMesh((p, t)), distance=1e-3)])
    room = RigidMesh((p, t[::-1]))
    assert room.closed and len(room.refined(0.1)[1]) == 16
    law = StVK(young=3e5, poisson=0.3, density=1000.0, plane="strain")
    body = System(block, [law, MeshContact(None, room, distance=1e-3, name="room")])
    run = simulate(body, BackwardEuler(dt=5e-3), until=0.2, v0=np.tile([1.0, -2.0], body.mesh.nv), quiet=True)
    x = body.mesh.p.T + run.u.reshape(-1, 2)
    assert x.min() > -0.1 and x.max() < 0.2 and run.ledger["strain_energy MeshContact 1"].max() > 0
    with pytest.warns(StvkWarning, match=r"2 segments \(0, 2\) of 3"):
        RigidMesh((p, t[:, :3]))
    with pytest.raises(ContactError, match=r"1 segment \(1\) of 4 without area"):
        RigidMesh((p[:, [0, 1, 1, 3]], t))


# The surface


@pytest.mark.parametrize("ending", ["stl", "ply", "vtu", "off"])
def test_files_are_read_and_vertices_at_one_point_are_one(tmp_path, ending):
    p, t = die()
    file = tmp_path / f"die.{ending}"
    meshio.Mesh(p[:, t].transpose(2, 1, 0).reshape(-1, 3), [("triangle", np.arange(t.size).reshape(-1, 3))]).write(file)
    rigid = RigidMesh(file)
    assert rigid.closed and len(rigid.points) == len(np.unique(t)) and len(rigid.simplices) == t.shape[1]
    assert rigid.file == str(file) and np.abs(rigid.points.max(axis=0) - [0.1, 0.1, 0.05]).max() < 1e-7


def test_quadratic_and_quadrilateral_facets_count_as_triangles():
    hexahedra, quadratic = (
        ElementMesh.of(tensor((1, 1, 1), (2, 2, 2), skfem.MeshHex)),
        ElementMesh.of(tensor((1, 1, 1), (1, 1, 1))).with_degree(2),
    )
    for mesh, count in ((hexahedra, 48), (quadratic, 48)):
        rigid = RigidMesh(ElementMesh(mesh.p, mesh.surface, element=mesh.facet))
        assert rigid.closed and len(rigid.simplices) == count and rigid._size() == pytest.approx(6)


def test_the_side_of_a_closed_surface_is_that_of_its_normals():
    block, inner = ElementMesh.of(tensor((0.1, 0.1, 0.1), (2, 2, 2))), (-0.05, -0.05, -0.05)
    p, t = die(inner, (0.2, 0.2, 0.2))
    room = RigidMesh((p, t[::-1]))
    assert room.closed
    System(block, [LAW, MeshContact(None, room, distance=1e-3)])  # within a room
    with pytest.raises(ContactError, match=r"1 node \(0\) inside the RigidMesh at the start.*reverse the order of the vertices"):
        System(block, [LAW, MeshContact(None, RigidMesh((p, t)), distance=1e-3)])
    outside = RigidMesh((p + 1, t[::-1]))
    with pytest.raises(ContactError, match="inside the RigidMesh"):
        System(block, [LAW, MeshContact(None, outside, distance=1e-3)])
    with pytest.warns(StvkWarning, match=r"1 triangle|2 triangles|3 triangles"):
        opened = RigidMesh((p, t[:, 1:]))
    assert not opened.closed
    System(block, [LAW, MeshContact(None, opened, distance=1e-3)])
    one = t.copy()
    one[:, 4] = one[::-1, 4]
    with pytest.warns(StvkWarning, match=r"triangles \(.*two-sided"):
        assert not RigidMesh((p, one)).closed


def cube(d, low, size, n):
    mesh = tensor((size,) * d, (n,) * d, skfem.MeshTet if d == 3 else skfem.MeshTri)
    return ElementMesh.of(mesh.translated((low,) * d))


@pytest.mark.parametrize("d", [2, 3])
def test_a_surface_within_the_body_is_refused(d):
    """Nothing would touch it. In the cavity of a hollow body, and outside, it is accepted."""
    law = StVK(young=3e4, poisson=0.3, density=1.0)
    block, core = cube(d, 0.0, 1.0, 5), cube(d, 0.45, 0.1, 1)
    outer = cube(d, 2.0, 0.1, 1)
    both = RigidMesh((np.hstack([outer.p, core.p]), np.hstack([outer.surface, core.surface + outer.nv])))
    for rigid in (RigidMesh((core.p, core.surface)), both):
        with pytest.raises(ContactError, match=r"the RigidMesh at \(0\.45, .*inside the body at the start; expected it outside"):
            System(block, [law, MeshContact(None, rigid, distance=0.01)])
    hollow = ElementMesh(block.p, block.t[:, ~((np.abs(block.p[:, block.t].mean(axis=1) - 0.5) < 0.1).all(axis=0))])
    assert hollow.nt < block.nt
    body = System(hollow, [law, MeshContact(None, both, distance=0.01)], {lambda x: x[0] == 0: "xyz"[:d]})
    System(block, [law, MeshContact(None, RigidMesh((outer.p, outer.surface)), distance=0.01)])
    over = np.tile(2.15 - np.full(d, 0.25), body.mesh.nv)  # the outer one is in the middle of the wall then
    with pytest.raises(ContactError, match=r"the RigidMesh at \(2\.0, .*inside the body"):
        body.contacts[0].refuse_start(over.reshape(-1, d))


BAD = {
    "a missing file": (lambda: "nowhere.stl", "nowhere.stl"),
    "a volume mesh": (lambda: tensor((1, 1, 1), (1, 1, 1)), r"tetrahedra in 3D; expected a surface.*\(mesh.p, mesh.surface\)"),
    "a flat mesh": (skfem.MeshTri, "triangles in 2D; expected a surface.*three coordinates"),
    "a cable": (lambda: (np.zeros((3, 2)), np.array([[0], [1]])), "segments in 3D; expected a surface"),
    "no triangles": (lambda: (TABLE[0], np.empty((3, 0), dtype=int)), "no elements"),
    "no mesh": (lambda: 3, "mesh = 3; expected a scikit-fem mesh"),
    "a line": (lambda: (TABLE[0] * [[1], [0], [0]], TABLE[1]), r"2 triangles \(0, 1\) of 2 without area"),
    "equal corners": (lambda: (TABLE[0][:, [0, 1, 1, 3]], TABLE[1]), r"1 triangle \(0\) of 2 without area"),
    "not finite": (lambda: (TABLE[0] * [[1], [1], [np.nan]], TABLE[1]), "not finite"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_surfaces_are_refused(name):
    given, message = BAD[name]
    with pytest.raises(StvkError, match=message):
        RigidMesh(given())


def test_contacts_that_do_not_fit_are_refused():
    block, rigid = ElementMesh.of(tensor((0.1, 0.1, 0.1), (2, 2, 2))), RigidMesh(die((0, 0, -0.052)))
    for body, second, distance, message in (
        (block, rigid, 0.06, "distance = 0.06 m; expected at most the shortest edge of the surfaces, 0.05 m"),
        (skfem.MeshTri(), rigid, 1e-3, "RigidMesh has 3 components; expected 2"),
        (
            block,
            RigidMesh(die((0, 0, -0.04))),
            1e-3,
            r"edges and triangles intersect at the start, first the edge of (nodes|the Rig)",
        ),
        (block, "die.stl", 1e-3, "no boundary, node set or subdomain 'die.stl'"),
    ):
        with pytest.raises(StvkError, match=message):
            System(body, [LAW, MeshContact(None, second, distance=distance)])
    system, _ = pressed()
    with pytest.raises(ContactError, match="moved = 'die'; expected a RigidContact of the body"):
        Simulation(system, BackwardEuler(dt=1e-3), moved=["die"])


def test_a_body_thrown_at_it_does_not_pass_through():
    system, _ = pressed()
    term, down = system.bound_terms[1], np.tile([0, 0, -2.5 * GAP], (system.mesh.nv, 1))
    assert term.contact_limit(0 * down, down) == pytest.approx(1 / 2.5, rel=2e-3)
    assert term.passes(0 * down, down) and not term.passes(0 * down, 0.39 * down) and term.passes(0 * down, 40 * down)
    run = simulate(
        system, BackwardEuler(dt=1e-3), until=3e-3, v0=np.tile([0, 0, -50.0], system.mesh.nv), quiet=True, raise_on_failure=False
    )
    assert (system.mesh.p[2] + by_node(run.u)[:, 2]).min() > 0.05
