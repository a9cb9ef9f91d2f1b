"""Contact between surfaces in two dimensions, of segments and vertices, and with rigid polygons."""

import numpy as np
import pytest
import skfem
from terms.test_mesh_contact import DISTANCE, GAP, slope, tensor, upper
from terms.toys import in_step

from skfem_stvk import (
    BackwardEuler,
    ContactError,
    EnergyMomentum,
    Friction,
    MeshContact,
    NeoHookean,
    RigidMesh,
    StVK,
    StvkWarning,
    System,
    Traction,
    simulate,
    solve_static,
)
from skfem_stvk.edges import TENSILE
from skfem_stvk.mesh import ElementMesh

LAW = StVK(young=3e4, poisson=0.3, density=1000.0, plane="strain", thickness=0.02)


def joined(lower, above):
    """Return one mesh of two bodies, "lower" and "upper"."""
    t = np.hstack([lower.t, above.t + lower.p.shape[1]])
    halves = {"lower": np.arange(lower.t.shape[1]), "upper": np.arange(lower.t.shape[1], t.shape[1])}
    mesh = ElementMesh.of(type(lower)(np.hstack([lower.p, above.p]), t))
    return ElementMesh(mesh.p, mesh.t, subdomains=halves, element=mesh.element)


def two(kind="triangles", gap=GAP, lower=(0.1, 0.05), above=(0.08, 0.05), shift=0.013):
    shape = skfem.MeshQuad if kind == "quadrilaterals" else skfem.MeshTri
    mesh = joined(tensor(lower, (3, 2), shape), tensor(above, (4, 2), shape).translated((shift, lower[1] + gap)))
    return mesh.with_degree(2) if kind == "quadratic triangles" else mesh


KINDS = ("triangles", "quadratic triangles", "quadrilaterals")


def pair(kind="triangles", gap=GAP, friction=None, law=LAW, fixed=None, **options):
    mesh = two(kind, gap)
    contact = MeshContact("lower", "upper", friction=friction, **{"distance": DISTANCE, "name": "pair"} | options)
    return System(mesh, [law, contact], fixed), System(mesh, [law, MeshContact("lower", "upper", distance=1e-9)], fixed)


def by_node(x):
    return x.reshape(-1, 2)


def state(system, size=2e-4):
    u, v = np.random.default_rng(0).normal(size=(2, system.ndofs))
    return size * u, v / np.abs(v).max()


def flat_force(term, u):
    out = np.zeros_like(by_node(u))
    term.energy_and_force(by_node(u), out)
    return out.ravel()


@pytest.mark.parametrize("kind", KINDS)
def test_force_and_stiffness_are_derivatives_and_forces_balance(kind):
    system, without = pair(kind)
    term, (u, v) = system.bound_terms[1], state(system)
    W, F = term.energy_and_force(by_node(u)), flat_force(term, u)
    assert W > 0 and slope(lambda s: term.energy_and_force(by_node(u + s * v))) == pytest.approx(F @ v, rel=1e-5)
    K = system.tangent(u).toarray() - without.tangent(u).toarray()
    change = slope(lambda s: flat_force(term, u + s * v))
    assert np.abs(K @ v - change).max() < 1e-5 * np.abs(change).max() and np.abs(K - K.T).max() < 1e-12 * np.abs(K).max()
    clamped = system.jacobian(u, kept=TENSILE).toarray() - without.jacobian(u, kept=TENSILE).toarray()
    assert np.linalg.eigvalsh(clamped).min() > -1e-9 * np.abs(K).max() > np.linalg.eigvalsh(K).min()
    x, f = system.mesh.p.T + by_node(u), by_node(F)
    assert (
        np.abs(f.sum(axis=0)).max() < 1e-13 * np.abs(f).sum()
        and abs((x[:, 0] * f[:, 1] - x[:, 1] * f[:, 0]).sum()) < 1e-13 * np.abs(f).sum()
    )
    assert term._barrier.areas().sum() == pytest.approx(0.56, rel=1e-12)


def test_the_force_is_proportional_to_the_thickness_and_the_pressure_is_not():
    found = []
    for thickness in (0.02, 0.06):
        system, _ = pair(law=StVK(young=3e4, poisson=0.3, plane="strain", thickness=thickness))
        term, x = system.bound_terms[1], np.zeros((system.mesh.nv, 2))
        found.append((term.energy_and_force(x), *term.evaluated(x)))
    (W, p, _, A), (V, q, _, B) = found
    assert pytest.approx(3 * W) == V and pytest.approx(3 * A) == B and np.allclose(p, q, rtol=1e-12) and p.max() > 0


def test_nothing_passes_through_anything():
    system, _ = pair()
    term, down = system.bound_terms[1], np.zeros((system.mesh.nv, 2))
    down[upper(system), 1] = -2.5 * GAP
    assert term.contact_limit(0 * down, down) == pytest.approx(1 / 2.5, rel=2e-3)
    assert term.passes(0 * down, down) and not term.passes(0 * down, 0.39 * down) and term.passes(0 * down, 60 * down)
    with pytest.raises(
        ContactError, match=r"pairs of edges intersect at the start, first the edge of nodes \(\d+, \d+\) and the edge"
    ):
        pair(gap=-0.01)
    inner = joined(tensor((0.1, 0.1), (2, 2), skfem.MeshTri), tensor((0.02, 0.02), (1, 1), skfem.MeshTri).translated((0.03, 0.031)))
    with pytest.raises(ContactError, match="inside another part of the body at the start"):
        System(inner, [LAW, MeshContact(None, distance=1e-3)])


def test_two_squares_pressed_carry_the_load():
    """The squares have the same width, so that the state is homogeneous, for nu = 0."""
    mesh = two(gap=1e-3, lower=(0.1, 0.05), above=(0.1, 0.05), shift=0.0)
    law, lid = StVK(young=3e4, poisson=0.0, plane="strain", thickness=0.02), mesh.p[1].max()
    body = System(
        mesh,
        [law, MeshContact("lower", "upper", distance=1e-3, name="pair")],
        {lambda x: x[1] == 0: "xy"},
        {lambda x: x[1] == lid: {"x": 0.0, "y": -5e-3}},
    )
    found = solve_static(body, steps=8, quiet=True)
    state = found.contact("pair")
    assert found.success and state.resultant[1] == pytest.approx(found.reaction(lambda x: x[1] == lid).resultant[1], rel=1e-6)
    assert state.area == pytest.approx(2 * 0.1 * 0.02, rel=0.5)
    along = np.abs(mesh.p[0] - 0.05) < 0.03
    inner = np.flatnonzero((np.abs(mesh.p[1] - 0.05) < 1e-9) & along)
    assert state.pressure[inner].mean() == pytest.approx(-state.resultant[1] / (0.1 * 0.02), rel=0.1)


def test_a_strip_with_a_slit_touches_itself():
    mesh = tensor((0.12, 0.10), (6, 5), skfem.MeshTri)
    centre = mesh.p[:, mesh.t].mean(axis=1)
    mesh = ElementMesh.of(mesh.remove_elements(np.flatnonzero((centre[0] > 0.04) & (np.abs(centre[1] - 0.05) < 0.01))))

    def tip(x):
        return (x[1] == x[1].max()) & (x[0] > 0.09)

    law = NeoHookean(young=3e4, poisson=0.3, density=1e3, plane="strain")
    terms = [law, MeshContact(None, distance=3e-3, name="skin"), Traction(tip, (0, -3e3))]
    found = solve_static(System(mesh, terms, {lambda x: x[1] == 0: "xy"}), steps=5, quiet=True)
    state = found.contact("skin")
    assert found.success and 0 < state.gap.min() < 3e-3 and state.area > 0 and np.abs(state.resultant).max() < 1e-9


def thrown(system, speed=0.5, along=0.1):
    v = np.zeros((system.mesh.nv, 2))
    v[upper(system)] = along, -speed
    return v.ravel()


def test_energy_momentum_keeps_energy_and_linear_momentum():
    system, _ = pair()
    run = simulate(system, EnergyMomentum(dt=1e-3), until=0.02, v0=thrown(system), quiet=True)
    ledger, kinetic = run.ledger, run.ledger["kinetic_energy"][0]
    assert np.abs(ledger["closure_error"]).max() < 1e-11 * kinetic and ledger["strain_energy MeshContact 1"].max() > 1e-4 * kinetic
    assert np.abs(np.diff([ledger[f"linear_momentum_{axis}"] for axis in "xy"])).max() < 1e-12
    away = by_node(run.v)[upper(system), 1].mean() - np.delete(by_node(run.v), upper(system), axis=0)[:, 1].mean()
    assert away > 0.1


def test_friction_slows_a_sliding_body_and_its_work_is_in_the_ledger():
    speeds = []
    for friction in (None, Friction(0.4, slip_speed=0.05)):
        system, _ = pair(friction=friction, fixed={lambda x: x[1] == 0: "xy"})
        run = simulate(system, EnergyMomentum(dt=1e-3), until=0.015, v0=thrown(system, 0.4, 0.3), quiet=True)
        speeds.append(by_node(run.v)[upper(system), 0].mean())
    kinetic = run.ledger["kinetic_energy"][0]
    assert speeds[1] < 0.9 * speeds[0]
    assert np.abs(run.ledger["closure_error"]).max() < 1e-11 * kinetic and run.ledger["friction_work"][-1] > 0.01 * kinetic


def test_friction_is_at_most_coulombs():
    system, without = (pair(friction=friction)[0] for friction in (Friction(0.4, slip_length=1e-4), None))
    u = np.zeros((system.mesh.nv, 2))
    term, _ = in_step(system.bound_terms[1], u, 0.0, 1.0, in_time=False)
    normal = by_node(flat_force(without.bound_terms[1], u))[upper(system), 1].sum()
    for slip, share in ((0.5e-4, 0.75), (1e-3, 1.0)):
        moved = u.copy()
        moved[upper(system), 0] += slip
        rub = by_node(flat_force(term, moved) - flat_force(without.bound_terms[1], moved))
        assert rub[upper(system), 0].sum() == pytest.approx(share * 0.4 * abs(normal), rel=1e-3)
        assert term.work(u, moved)[1] == pytest.approx(slip * rub[upper(system), 0].sum())


# Rigid polygons


def test_forces_of_a_polygon_are_those_of_a_body_that_does_not_move():
    lower = tensor((0.1, 0.05), (6, 3), skfem.MeshTri)
    block = tensor((0.08, 0.05), (3, 2), skfem.MeshTri).translated((0.013, 0.05 + GAP))
    both = System(joined(lower, block), [LAW, MeshContact("lower", "upper", distance=DISTANCE)])
    polygon = ElementMesh.of(lower)
    one = System(block, [LAW, MeshContact(None, RigidMesh((polygon.p, polygon.surface)), distance=DISTANCE, name="die")])
    u, v = state(one)
    w = np.zeros((both.mesh.nv, 2))
    w[upper(both)] = by_node(u)
    F, G = (flat_force(body.bound_terms[1], x) for body, x in ((one, u), (both, w)))
    assert np.abs(by_node(F) - by_node(G)[upper(both)]).max() < 1e-11 * np.abs(F).max() > 0
    change = slope(lambda s: one.internal_force(u + s * v))
    assert np.abs(one.tangent(u) @ v - change).max() < 1e-5 * np.abs(change).max()
    run = simulate(one, EnergyMomentum(dt=1e-3), until=0.02, v0=np.tile([0.1, -0.5], one.mesh.nv), quiet=True)
    assert np.abs(run.ledger["closure_error"]).max() < 1e-11 * run.ledger["kinetic_energy"][0]
    assert by_node(run.v)[:, 1].mean() > 0.1 and run.ledger["contact die y"].max() > 0


def test_the_side_of_a_polygon_is_on_the_right_of_its_segments():
    block, p = tensor((0.1, 0.1), (2, 2), skfem.MeshTri), np.array([[-0.1, 0.2, 0.2, -0.1], [-0.1, -0.1, 0.2, 0.2]])
    t = np.array([[0, 1, 2, 3], [1, 2, 3, 0]])
    with pytest.raises(ContactError, match="inside the RigidMesh at the start"):
        System(block, [LAW, MeshContact(None, RigidMesh((p, t)), distance=1e-3)])
    room = RigidMesh((p, t[::-1]))
    assert room.closed and len(room.refined(0.1)[1]) == 16
    law = StVK(young=3e5, poisson=0.3, density=1000.0, plane="strain")
    body = System(block, [law, MeshContact(None, room, distance=1e-3, name="room")])
    run = simulate(body, BackwardEuler(dt=5e-3), until=0.2, v0=np.tile([1.0, -2.0], body.mesh.nv), quiet=True)
    x = body.mesh.p.T + by_node(run.u)
    assert x.min() > -0.1 and x.max() < 0.2 and run.ledger["strain_energy MeshContact 1"].max() > 0
    with pytest.warns(StvkWarning, match=r"2 segments \(0, 2\) of 3"):
        RigidMesh((p, t[:, :3]))
    with pytest.raises(ContactError, match=r"1 segment \(1\) of 4 without area"):
        RigidMesh((p[:, [0, 1, 1, 3]], t))
