"""An edge network is the literal sum over edges and pairs of edges."""

import numpy as np
import pytest
from bodies import BODIES, CURVED, MESHES, state
from scipy.sparse import csr_matrix, identity

from skfem_stvk import (
    EdgeNetwork,
    Gravity,
    LinearBackwardEuler,
    MeshError,
    NodalLoad,
    StVK,
    StvkError,
    System,
    VelocityVerlet,
    modes,
    simulate,
    solve_static,
)

LINEAR = {name: body for name, body in BODIES.items() if body[0].element.is_linear_simplex}
MESH = MESHES["tetrahedra"]
NETWORK = EdgeNetwork.of(MESH, StVK(young=9.0, poisson=0.4, density=2.0))


@pytest.mark.few
@pytest.mark.parametrize("name", LINEAR)
def test_the_network_of_a_body_has_its_energy_force_and_tangent(name):
    """W, F, K and the quartic of a network agree with the assembly from simplices to round-off, for every material and section."""
    mesh, terms = LINEAR[name]
    system, network = System(mesh, terms), System(mesh, EdgeNetwork.of(mesh, terms))
    u, v = state(mesh), state(mesh, seed=9)
    assert abs(system.energy(u)) > 1e-3 and network.quartic
    assert network.energy(u) == pytest.approx(system.energy(u), rel=1e-13)
    assert network.energy_along(u, v) == pytest.approx(system.energy_along(u, v), rel=1e-12)
    F, K = system.internal_force(u), system.tangent(u)
    assert np.abs(network.internal_force(u) - F).max() < 1e-13 * np.abs(F).max()
    assert abs(network.tangent(u) - K).max() < 1e-13 * abs(K).max()
    assert np.abs(network.product(u, v) - K @ v).max() < 1e-13 * np.abs(K @ v).max()


def test_the_parts_of_a_network_add_up_to_the_whole():
    """Edges, adjacent pairs and opposite pairs add up to the whole, in W, F and K."""
    u = state(MESH)
    whole, edges = System(MESH, NETWORK), System(MESH, NETWORK.diagonal())
    one, other = System(MESH, NETWORK.without("opposite")), System(MESH, NETWORK.without("adjacent"))
    for quantity in ("energy", "internal_force", "tangent"):
        parts = [getattr(system, quantity)(u) for system in (one, other, edges, whole)]
        rest = parts[0] + parts[1] - parts[2] - parts[3]
        largest = [float(abs(part).max()) if quantity != "energy" else abs(part) for part in parts]
        error = float(abs(rest).max()) if quantity != "energy" else abs(rest)
        assert error < 1e-13 * max(largest) and min(largest) > 1e-3
    i, j = NETWORK.pairs
    assert (i < j).all() and NETWORK.adjacent.sum() + len(NETWORK.without("adjacent").pairs.T) == len(i)
    assert not len(NETWORK.diagonal().pairs.T) and not NETWORK.without("adjacent").adjacent.any()


def test_counts_of_pairs_are_those_of_faces_and_tetrahedra():
    """There are three adjacent pairs for each face, and three opposite pairs for each tetrahedron."""
    faces = {tuple(sorted(face)) for tet in MESH.t.T for face in (tet[:3], tet[1:], tet[[0, 2, 3]], tet[[0, 1, 3]])}
    assert NETWORK.adjacent.sum() == 3 * len(faces) and (~NETWORK.adjacent).sum() == 3 * MESH.nt


@pytest.mark.parametrize("poisson", [-0.3, 0.0, 0.3, 0.45])
def test_without_opposite_pairs_some_state_has_less_energy_than_rest(poisson):
    network = EdgeNetwork.of(MESH, StVK(young=1.0, poisson=poisson))
    assert network.definite() and network.diagonal().definite() and not network.without("opposite").definite()
    lowest = np.linalg.eigvalsh(network.without("opposite").L.toarray())[0]
    assert lowest < -1e-6 and np.linalg.eigvalsh(network.L.toarray())[0] > 0


def test_an_edited_network_has_the_energy_of_its_coefficients():
    """Stiffer edges add the energy of springs."""
    L = NETWORK.L.copy()
    L.setdiag(L.diagonal() + 2.0)
    stiffer, springs = EdgeNetwork(NETWORK.edges, L), EdgeNetwork(NETWORK.edges, 2.0 * identity(len(NETWORK.edges.T), format="csr"))
    u = state(MESH)
    energies = [System(MESH, network).energy(u) for network in (stiffer, NETWORK, springs)]
    assert energies[0] == pytest.approx(energies[1] + energies[2], rel=1e-13) and energies[2] > 1e-3


def test_edges_may_be_given_in_any_order_and_direction():
    rng = np.random.default_rng(5)
    order = rng.permutation(len(NETWORK.edges.T))
    edges = NETWORK.edges[:, order]
    edges[:, ::2] = edges[::-1, ::2]
    u = state(MESH)
    F = System(MESH, NETWORK).internal_force(u)
    assert (
        np.abs(System(MESH, EdgeNetwork(edges, NETWORK.L[order][:, order])).internal_force(u) - F).max() < 1e-13 * np.abs(F).max()
    )


def test_statics_modes_and_motions_of_a_network_are_those_of_its_body():
    law, load = StVK(young=9.0, poisson=0.4, density=2.0), Gravity((0, 0, -0.2))
    fixed = {(0, 1, 2, 3): "xyz"}
    one = System(MESH, [law, load], fixed)
    other = System(MESH, [EdgeNetwork.of(MESH, law), load], fixed)
    found, again = (solve_static(system, quiet=True) for system in (one, other))
    assert found.success and again.success and np.abs(found.u - again.u).max() < 1e-8 * np.abs(found.u).max()
    assert modes(one, 3).frequencies == pytest.approx(modes(other, 3).frequencies, rel=1e-9)
    for integrator in (VelocityVerlet(0.01), LinearBackwardEuler(0.05)):
        runs = [simulate(system, until=0.2, integrator=integrator, quiet=True) for system in (one, other)]
        assert np.abs(runs[0].u - runs[1].u).max() < 1e-8 * np.abs(runs[0].u).max() and np.abs(runs[0].u).max() > 1e-4


def test_several_laws_have_one_network_with_the_mass_of_all():
    half = np.arange(MESH.nt // 2)
    rest = np.arange(MESH.nt // 2, MESH.nt)
    laws = [StVK(young=9.0, poisson=0.4, density=2.0, region=half), StVK(young=1.0, poisson=0.1, density=3.0, region=rest)]
    one, other = System(MESH, laws), System(MESH, EdgeNetwork.of(MESH, laws))
    u = state(MESH)
    F = one.internal_force(u)
    assert np.abs(other.internal_force(u) - F).max() < 1e-13 * np.abs(F).max()
    assert other.mass().vertex == pytest.approx(one.mass().vertex, rel=1e-13)


def test_springs_without_pairs_are_refused_as_a_mechanism():
    with pytest.raises(StvkError, match=r"held|rigid"):
        solve_static(System(MESH, [NETWORK.diagonal(), NodalLoad([3], (0, 0, -0.1))]), quiet=True)


ONE = csr_matrix(np.eye(2))


@pytest.mark.parametrize(
    ("edges", "L", "message"),
    [
        ([[0, 0], [1, 1]], ONE, "edge.* given more than once"),
        ([[0, 1], [1, 1]], ONE, r"1 edge \(1\) .*the same vertex twice"),
        ([[0, 1], [1, 2]], np.eye(2), "expected a sparse matrix"),
        ([[0, 1], [1, 2]], csr_matrix(np.eye(3)), r"L has shape \(3, 3\); expected \(2, 2\)"),
        ([[0, 1], [1, 2]], csr_matrix([[1.0, 0.5], [0.0, 1.0]]), "not symmetric, in the rows of 2 edges"),
        ([[0, 1], [1, 2]], csr_matrix([[1.0, np.nan], [np.nan, 1.0]]), "not finite"),
        ([[0.5, 1], [1, 2]], ONE, "whole numbers"),
        ([[0, -1], [1, 2]], ONE, r"1 edge \(1\) with a vertex below zero"),
    ],
)
def test_invalid_networks_are_refused(edges, L, message):
    with pytest.raises(StvkError, match=message):
        EdgeNetwork(np.array(edges), L)


def test_a_mesh_that_does_not_fit_is_refused():
    with pytest.raises(MeshError, match="strain varies within an element"):
        EdgeNetwork.of(CURVED["quadratic tetrahedra"], StVK(young=1.0, poisson=0.3))
    with pytest.raises(MeshError, match=f"has vertex {MESH.nv - 1}; the mesh has 9"):
        System((np.arange(9.0)[None], np.array([range(8), range(1, 9)])), NETWORK)
    with pytest.raises(MeshError, match=r"^EdgeNetwork: it has .*quadratic tetrahedra .*Take degree=1"):
        System(MESH, NETWORK, degree=2)
    with pytest.raises(MeshError, match=r"^EdgeNetwork: the mesh lacks \d+ edges \(.*and has \d+ other edges"):
        System((MESH.p, np.random.default_rng(3).permutation(MESH.nv)[MESH.t]), NETWORK)
    with pytest.raises(MeshError, match=r"^EdgeNetwork: the mesh lacks 0 edges .*and has \d+ other edges"):
        half = EdgeNetwork.of(MESH, StVK(young=1.0, poisson=0.3, region=np.arange(MESH.nt // 2)))
        System(MESH, EdgeNetwork(half.edges, half.L, NETWORK.laws))
    with pytest.raises(StvkError, match="expected StVK"):
        EdgeNetwork.of(MESH, 3.0)
    with pytest.raises(StvkError, match="expected at most 20000"):
        n = 20_001
        EdgeNetwork(np.stack([np.arange(n), np.arange(1, n + 1)]), identity(n, format="csr")).definite()


def test_statics_reports_an_unstable_body_without_opposite_pairs():
    """Without opposite pairs some states have less energy than the state at rest, so that the equilibrium found is unstable."""
    terms = [NETWORK.without("opposite"), Gravity((0, 0, -0.02))]
    found = solve_static(System(MESH, terms, {(0, 1, 2, 3): "xyz"}), quiet=True, raise_on_failure=False)
    whole = solve_static(System(MESH, [NETWORK, *terms[1:]], {(0, 1, 2, 3): "xyz"}), quiet=True)
    assert whole.success and not found.success and "negative eigenvalue" in found.message


@pytest.mark.parametrize(("part", "young"), [("all", 9e9), ("edges", 9e-9), ("adjacent", 9.0)])
def test_elements_can_be_removed_from_the_network_of_a_law(part, young):
    """After elements are removed, the network equals the network of the remaining elements."""
    law, removed = StVK(young=young, poisson=0.4, density=2.0), np.random.default_rng(2).permutation(MESH.nt)[:30]
    retained = np.setdiff1d(np.arange(MESH.nt), removed)
    take = {"all": lambda n: n, "edges": EdgeNetwork.diagonal, "adjacent": lambda n: n.without("opposite")}[part]
    system = System(MESH, take(EdgeNetwork.of(MESH, law)))
    rest = System(MESH, take(EdgeNetwork.of(MESH, StVK(young=young, poisson=0.4, density=2.0, region=retained))))
    u, before = state(MESH), system.internal_force(state(MESH))
    system = system.without(removed[:7])
    system = system.without(removed)
    F = rest.internal_force(u)
    assert np.abs(before - F).max() > 1e-2 * np.abs(F).max()
    assert np.abs(system.internal_force(u) - F).max() < 1e-12 * np.abs(F).max()
    assert system.energy(u) == pytest.approx(rest.energy(u), rel=1e-12)
    assert abs(system.tangent(u) - rest.tangent(u)).max() < 1e-12 * abs(rest.tangent(u)).max()
    assert system.mass().vertex == pytest.approx(rest.mass().vertex, rel=1e-12)
    joined, left = (set(map(tuple, one.bound_terms[0].nodes_joined.T)) for one in (system, rest))
    assert joined == left < set(map(tuple, system.bound_terms[0].nodes_paired.T))


def test_elements_cannot_be_removed_from_a_network_without_laws():
    with pytest.raises(StvkError, match="EdgeNetwork"):
        System(MESH, EdgeNetwork(NETWORK.edges, NETWORK.L)).without([3])


def test_a_network_of_a_law_is_made_with_one_kind_of_pairs():
    """`EdgeNetwork.of` with one kind of pairs equals the whole network without the other kind."""
    law, whole = StVK(young=9.0, poisson=0.4, density=2.0), NETWORK
    parts = {"none": whole.diagonal(), "adjacent": whole.without("opposite"), "opposite": whole.without("adjacent")}
    for pairs, part in parts.items():
        made = EdgeNetwork.of(MESH, law, pairs)
        assert not (made.L != part.L).nnz and made.L.nnz < whole.L.nnz and np.array_equal(made.edges, part.edges)
    assert not (EdgeNetwork.of(MESH, law, "all").L != whole.L).nnz
    with pytest.raises(StvkError, match=r"EdgeNetwork\.of: pairs = 'angular'; known: 'adjacent', 'all', 'none', 'opposite'"):
        EdgeNetwork.of(MESH, law, "angular")
