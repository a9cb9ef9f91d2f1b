"""Membranes and cables on the nodes of tetrahedra: each term has its own elements."""

import re
import warnings

import meshio
import numpy as np
import pytest
import skfem
from bodies import box, distorted, reference_of, turned_round

from skfem_stvk import (
    BodyForce,
    ElementMesh,
    EnergyMomentum,
    Gravity,
    MaterialError,
    MeshError,
    NeoHookean,
    Pressure,
    RegionError,
    StVK,
    StvkError,
    System,
    VolumePenalty,
    critical_elements,
    critical_step,
    modes,
    read_state,
    simulate,
    solve_static,
)
from skfem_stvk.results import Fields, write_vtu
from skfem_stvk.system.signature import Fingerprint

RNG = np.random.default_rng(5)
SOLID = box(2)
SKIN = turned_round(SOLID.surface, RNG)
N = SOLID.nv
POINTS = np.concatenate([SOLID.p, [[-0.6, 1.7, 0.4], [-0.5, -0.7, 1.9], [1.8, 1.6, 1.7]]], axis=1)
CABLES = np.array([[N, N + 1, N + 2, N], [int(SOLID.t[0, 0]), int(SKIN[1, 4]), int(SKIN[0, 0]), N + 1]])
EACH = np.linspace(0.5, 1.5, SKIN.shape[1])
LAWS = {
    "tetrahedra": (SOLID.t, {"young": 1e4, "poisson": 0.4, "density": 1000.0}),
    "membrane": (SKIN, {"young": 2e6, "poisson": 0.3, "thickness": 1e-3 * EACH, "density": 900.0}),
    "cables": (CABLES, {"young": 1e8, "poisson": 0.2, "area": [1e-6, 2e-6, 3e-6, 4e-6], "density": 7800.0}),
}
CORNERS = {(N, N + 1, N + 2): "xyz"}


def bag(*more, **keywords):
    return System(POINTS, [StVK(simplices=t, **law) for t, law in LAWS.values()] + list(more), **keywords)


def displaced(ndofs=3 * POINTS.shape[1], size=0.2):
    return size * np.random.default_rng(6).standard_normal(ndofs)


def alone(t, law, *more):
    """Return a body of one term on a separate mesh, and its nodes."""
    nodes, t = np.unique(t, return_inverse=True)
    return System((POINTS[:, nodes], t.reshape(-1, LAWS_ROWS[len(nodes), t.size])), [StVK(**law), *more]), nodes


LAWS_ROWS = {(len(np.unique(t)), t.size): t.shape[1] for t, _ in LAWS.values()}


def sums_of_all(of):
    """Return the sum of the results of `of` (System, displacements) over the terms on separate meshes."""
    u, total = displaced().reshape(-1, 3), np.zeros((POINTS.shape[1], 3))
    for t, law in LAWS.values():
        body, nodes = alone(t, law)
        total[nodes] += of(body, u[nodes].ravel()).reshape(-1, 3)
    return total.ravel()


def nodes_of(body):
    """Return the indices of the nodes of a separate mesh among the points, by coordinates."""
    return [int(np.flatnonzero((x == POINTS.T).all(axis=1))[0]) for x in body.mesh.p.T]


def test_W_F_and_K_are_the_sums_of_those_by_scikit_fem():
    body, u, v, W, K = bag(), displaced(), np.cos(np.arange(3 * POINTS.shape[1])), [], np.zeros((3 * POINTS.shape[1],) * 2)
    F = np.zeros(len(K))
    assert [one.mesh.element.name for one in body.body.beside] == ["triangles", "segments"]
    assert body.mesh.element.name == "tetrahedra" and body.mesh.nv == POINTS.shape[1] and body.quartic
    for t, law in LAWS.values():
        one, nodes = alone(t, law)
        reference, dofs = reference_of(one.mesh, [StVK(**law)]), (3 * nodes[:, None] + np.arange(3)).ravel()
        W.append(reference.energy(u[dofs]))
        F[dofs] += reference.internal_force(u[dofs])
        K[np.ix_(dofs, dofs)] += reference.tangent(u[dofs]).toarray()
    assert body.energy(u) == pytest.approx(sum(W), rel=1e-12) == body.energy_along(u, v)[0]
    assert list(body.energies(u).values()) == pytest.approx(W, rel=1e-12)
    assert np.abs(body.internal_force(u) - F).max() < 1e-13 * np.abs(F).max()
    assert np.abs(body.tangent(u).toarray() - K).max() < 1e-13 * np.abs(K).max()
    assert np.abs(body.product(u, v) - K @ v).max() < 1e-13 * np.abs(K @ v).max()


def test_masses_weights_and_body_forces_include_all_elements():
    body = bag(Gravity(g=(0.3, -2.0, 0.7)), BodyForce(lambda x, t: (x[0], t, 0 * x[1])))
    total = sum(alone(t, law)[0].mass().total for t, law in LAWS.values())
    assert body.mass().total == pytest.approx(total, rel=1e-14)
    v = np.cos(np.arange(body.ndofs))
    for kind in ("lumped", "consistent"):
        M = body.mass(kind)
        expected = sums_of_all(lambda one, x, kind=kind: one.mass(kind).multiply(v.reshape(-1, 3)[nodes_of(one)].ravel()))
        assert np.abs(M.multiply(v) - expected).max() < 1e-14 * np.abs(expected).max()
        assert np.abs(M.multiply(M.solve(v)) - v).max() < 1e-12
    u = np.zeros(body.ndofs)
    expected = np.zeros(body.ndofs)
    for t, law in LAWS.values():
        one, nodes = alone(t, law, *body.loads)
        expected.reshape(-1, 3)[nodes] += one.external_force(np.zeros(one.ndofs), 0.6).reshape(-1, 3)
    assert np.abs(body.external_force(u, 0.6) - expected).max() < 1e-14 * np.abs(expected).max()


def test_pressure_acts_on_its_own_simplices():
    """Pressure acts on its own simplices.

    On a closed skin with further nodes outside, the force is that on the membrane alone, and it balances.
    """
    p, u = 3.0, displaced(size=0.05)
    body = bag(Pressure(None, p, simplices=SKIN))
    skin, nodes = alone(*LAWS["membrane"], Pressure(None, p))
    expected = skin.external_force(u.reshape(-1, 3)[nodes].ravel()).reshape(-1, 3)
    found = body.external_force(u).reshape(-1, 3)
    assert np.abs(found[nodes] - expected).max() < 1e-14 * np.abs(expected).max() > 0
    assert np.abs(np.delete(found, nodes, axis=0)).max() == 0
    assert np.abs(found.sum(axis=0)).max() < 1e-13
    K = body.jacobian(u) - body.tangent(u)
    v = np.cos(np.arange(body.ndofs))
    stencil = body.external_force(u + v) - body.external_force(u - v)  # quadratic in u
    assert np.abs(K @ v + stencil / 2).max() < 1e-12 * np.abs(stencil).max()


@pytest.mark.parametrize("kind", ["linear", "quadratic", "boxes"])
def test_simplices_may_be_named_by_a_boundary(kind):
    """Membranes on the named facets of any solid have the W of a mesh of these facets alone."""
    mesh = {"linear": SOLID, "quadratic": SOLID.with_degree(2)}.get(kind)
    if mesh is None:
        cube = skfem.MeshHex.init_tensor(*[np.linspace(0, 1, 3)] * 3)
        mesh = ElementMesh.of(skfem.MeshHex(distorted(cube.p, RNG), cube.t))
    mesh = mesh.with_boundaries({"skin": lambda x: np.full(x.shape[1], True)})
    skin = StVK(young=2e3, poisson=0.3, thickness=0.1, simplices="skin")
    body = System(mesh, [StVK(young=1e3, poisson=0.4), skin])
    (other,) = body.body.beside
    u = displaced(mesh.p.size, 0.05)
    bare = System(mesh, StVK(young=1e3, poisson=0.4))
    nodes, t = np.unique(other.mesh.t, return_inverse=True)
    if kind == "quadratic":
        alone = other.mesh
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of nodes without elements
            whole = StVK(young=2e3, poisson=0.3, thickness=0.1).bind(alone)
        W = whole.energy_and_force(u.reshape(-1, 3))
    else:
        alone = ElementMesh(mesh.p[:, nodes], t.reshape(other.mesh.t.shape), element=other.mesh.element)
        W = System(alone, StVK(young=2e3, poisson=0.3, thickness=0.1)).energy(u.reshape(-1, 3)[nodes].ravel())
    assert 0.01 * bare.energy(u) < W
    assert body.energy(u) == pytest.approx(bare.energy(u) + W, rel=1e-14)


def test_terms_with_the_same_simplices_are_on_the_same_elements():
    t, law = LAWS["tetrahedra"]
    body = System(SOLID.p, [StVK(simplices=t, **law), NeoHookean(simplices=t.copy(), **law), VolumePenalty()])
    assert body.mesh.nt == t.shape[1] and not body.body.beside
    u = displaced(SOLID.p.size, 0.02)
    on_mesh = System(SOLID, [StVK(**law), NeoHookean(**law), VolumePenalty()])
    assert body.energy(u) == pytest.approx(on_mesh.energy(u), rel=1e-14)


def test_simplices_of_one_dimension_are_regions_of_one_mesh():
    one, two = SOLID.t[:, :20], SOLID.t[:, 20:]
    E, nu = np.linspace(1, 3, SOLID.nt), np.full(SOLID.nt, 0.3)
    nu[:20] = 0.1
    body = System(SOLID.p, [StVK(young=E[20:], poisson=0.3, simplices=two), StVK(young=E[:20], poisson=0.1, simplices=one)])
    u = displaced(SOLID.p.size)
    assert body.energy(u) == pytest.approx(System(SOLID, StVK(young=E, poisson=nu)).energy(u), rel=1e-13)


def test_bodies_without_additional_elements_cost_the_same():
    plain, same = System(SOLID, StVK(young=1.0, poisson=0.3)), System(SOLID.p, StVK(young=1.0, poisson=0.3, simplices=SOLID.t))
    assert plain.body.beside == same.body.beside == ()
    u = displaced(SOLID.p.size)
    plain.tangent(u)
    same.tangent(u)
    assert plain.memory() == same.memory()
    assert (plain.internal_force(u) == same.internal_force(u)).all()


def test_a_hanging_bag_is_in_equilibrium_with_its_reactions(tmp_path):
    body = bag(Gravity(g=(0, 0, -0.02)), fixed={**CORNERS, lambda x: x[2] < 0.1: "xyz"})
    result = solve_static(body, quiet=True, save=tmp_path / "bag.pvd", checkpoint=tmp_path / "states")
    assert result.success
    assert result.reaction().resultant[2] == pytest.approx(0.02 * body.mass().total, rel=1e-8)
    again = solve_static(body, quiet=True, save=tmp_path / "bag.pvd", checkpoint=tmp_path / "states", resume=True)
    assert (again.u == result.u).all()
    u, _ = read_state(tmp_path / "bag.pvd", body.mesh)
    assert (u == result.u).all()


def test_motions_conserve_energy_and_the_critical_step_includes_cables(tmp_path):
    body = bag(Gravity(g=(0, 0, -9.81)), fixed={lambda x: x[2] < 0.1: "xyz"})
    run = simulate(body, EnergyMomentum(dt=1e-3), until=0.02, quiet=True, save=tmp_path / "run.pvd", every=10)
    kinetic = run.ledger["kinetic_energy"]
    assert kinetic.max() > 0 and np.abs(run.ledger["closure_error"]).max() < 1e-12 * kinetic.max()
    without = System(SOLID, StVK(**LAWS["tetrahedra"][1]), fixed={lambda x: x[2] < 0.1: "xyz"})
    assert critical_step(body).step < 0.5 * critical_step(without).step  # the cables are stiff and light
    assert critical_elements(body).left_out == ("StVK 1", "StVK 2")
    assert (np.diff(modes(body, 4).frequencies) >= 0).all()


def test_elements_of_the_mesh_can_be_removed_and_additional_elements_stay():
    body, u = bag(), displaced()
    other = System(POINTS, [StVK(simplices=t[:, 3:] if t is SOLID.t else t, **law) for t, law in LAWS.values()])
    whole, body = body, body.without([0, 1, 2])
    assert body.removed.tolist() == [0, 1, 2] and other.mesh.nt == SOLID.nt - 3
    F = other.internal_force(u)
    assert np.abs(body.internal_force(u) - F).max() < 1e-14 * np.abs(F).max()
    assert body.mass().total == pytest.approx(other.mass().total, rel=1e-14)
    assert not whole.removed.size and whole.energy(u) == bag().energy(u)


def test_files_contain_all_elements_with_their_stresses(tmp_path):
    body, u = bag(), displaced(size=0.02)
    state = Fields.of(body).at(u)
    file = meshio.read(write_vtu(tmp_path / "bag.vtu", state))
    assert [(block.type, len(block.data)) for block in file.cells] == [
        ("tetra", SOLID.nt),
        ("triangle", SKIN.shape[1]),
        ("line", CABLES.shape[1]),
    ]
    assert (file.cells[2].data.T == CABLES).all()
    skin, nodes = alone(*LAWS["membrane"])
    expected = Fields.of(skin).at(u.reshape(-1, 3)[nodes].ravel())["von_mises_stress"]
    assert np.allclose(file.cell_data["von_mises_stress"][1], expected, rtol=1e-12)
    assert np.allclose(state.beside[0]["von_mises_stress"], expected, rtol=1e-12)
    at_corner = file.point_data["von_mises_stress"][N + 2]  # a corner with one cable only
    assert at_corner == pytest.approx(float(state.beside[1]["von_mises_stress"][2]))


def test_a_checkpoint_includes_the_additional_elements():
    fingerprint = [Fingerprint("path of equilibria", one, {}, [1.0], {}) for one in (bag(), exchanged())]
    assert "the elements beside the mesh" in fingerprint[1].differences(fingerprint[0].signature)
    assert not fingerprint[0].differences(fingerprint[0].signature)


def exchanged():
    """Return the same bag with two cables exchanged."""
    t, law = LAWS["cables"]
    terms = [StVK(simplices=t, **law) for t, law in list(LAWS.values())[:2]]
    return System(POINTS, [*terms, StVK(simplices=t[:, [1, 0, 2, 3]], **law)])


LAW = {"young": 1.0, "poisson": 0.3}


@pytest.mark.parametrize(
    ("mesh", "terms", "error", "message"),
    [
        (POINTS, [StVK(**LAW)], MeshError, "Got points without elements, and StVK 0 has no simplices"),
        (POINTS, [StVK(simplices=SKIN, **LAW), StVK(**LAW)], MeshError, "StVK 1 has no simplices"),
        (SOLID, [StVK(**LAW), StVK(simplices=SOLID.t, **LAW)], MeshError, "expected elements of lower dimension"),
        (SOLID, [StVK(**LAW), StVK(simplices=SKIN.T, **LAW)], MeshError, "one column for each element"),
        (SOLID, [StVK(**LAW), StVK(simplices=SKIN + N, **LAW)], MeshError, "outside 0 ... "),
        (SOLID, [StVK(**LAW), StVK(simplices=SKIN * 1.5, **LAW)], MeshError, "expected (n, nt) ids of nodes"),
        (SOLID, [StVK(**LAW), StVK(simplices="skin", **LAW)], MeshError, "or the name of a boundary or of lines; "),
        (POINTS, [StVK(simplices="skin", **LAW)], MeshError, "points alone, without names"),
        (POINTS, [StVK(simplices=SOLID.t, **LAW)], MeshError, "3 vertices (27, 28, 29): on no element"),
        (
            SOLID,
            [StVK(**LAW), StVK(simplices=np.array([[0], [0], [1]]), **LAW)],
            MeshError,
            "The triangles: 1 element (0): the same",
        ),
        (SOLID, [StVK(**LAW), StVK(simplices=CABLES[:, :0], **LAW)], MeshError, "expected (n, nt) ids"),
        (SOLID, [StVK(**LAW), StVK(simplices=SKIN, area=1.0, **LAW)], MaterialError, "area is for segments"),
        (SOLID, [StVK(**LAW), Pressure(None, 1.0, simplices=CABLES % N)], StvkError, "no surface"),
        (SOLID, [StVK(**LAW), Pressure([99999], 1.0, simplices=SKIN)], RegionError, "outside"),
    ],
    ids=str,
)
def test_simplices_that_do_not_fit_are_refused_in_words(mesh, terms, error, message):
    with pytest.raises(error, match=re.escape(message)):
        System(mesh, terms)


def test_a_region_together_with_simplices_is_refused():
    with pytest.raises(MaterialError, match="expected one of them"):
        StVK(region=[0], simplices=SKIN, **LAW)
    with pytest.raises(MaterialError, match="A System connects"):
        StVK(simplices=SKIN, **LAW).bind(SOLID)


def test_degree_2_with_bare_points_is_refused_with_a_remedy():
    with pytest.raises(MeshError, match="Raise the degree of a mesh"):
        System(POINTS, [StVK(simplices=SOLID.t, **LAW)], degree=2)


def test_simplices_are_copied():
    t = SKIN.copy()
    term = StVK(simplices=t, **LAW)
    t[:] = 0
    assert (term.simplices == SKIN).all()
