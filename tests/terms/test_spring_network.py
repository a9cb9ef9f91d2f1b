"""Springs along edges: the constants of all rules, their difference from the elastic body, and whole analyses with springs."""

import numpy as np
import pytest
from bodies import MESHES, box, some_voigt, state
from scipy.optimize import nnls

from skfem_stvk import (
    Anisotropic,
    BackwardEuler,
    EdgeDamping,
    EnergyMomentum,
    Gravity,
    LinearBackwardEuler,
    MaterialError,
    NodalLoad,
    RegionError,
    SpringNetwork,
    StVK,
    StvkWarning,
    SupportError,
    System,
    VolumePenalty,
    critical_step,
    modes,
    simulate,
    solve_static,
)
from skfem_stvk.mesh import ElementMesh
from skfem_stvk.mesh.element import LOCAL_EDGES
from skfem_stvk.results.fields import Fields
from skfem_stvk.terms.laws.spring_network import RULES, Rest

RNG = np.random.default_rng(21)
REGULAR = 2.0 * np.array([[0, 1, 0.5, 0.5], [0, 0, 3**0.5 / 2, 3**0.5 / 6], [0, 0, 0, (2 / 3) ** 0.5]])
TET = ElementMesh(REGULAR, np.arange(4)[:, None])
TRIANGLE = ElementMesh(REGULAR[:2, :3], np.arange(3)[:, None])


def lattice(n=3):
    """Return a mesh of equilateral triangles."""
    i, j = np.meshgrid(np.arange(n + 1), np.arange(n + 1), indexing="ij")
    p = np.stack([(i + j / 2).ravel(), (3**0.5 / 2 * j).ravel()])
    a = (i * (n + 1) + j)[:-1, :-1].ravel()
    return ElementMesh(p, np.concatenate([np.stack([a, a + n + 1, a + 1]), np.stack([a + n + 1, a + 1, a + n + 2])], axis=1))


def single(rng, n, k):
    """Return n random simplices that share no vertices."""
    return ElementMesh(rng.standard_normal((k, (k + 1) * n)), np.arange((k + 1) * n).reshape(n, k + 1).T)


def springs(mesh, nu, rule="least-squares", young=1.0, **options):
    return SpringNetwork(young=young, poisson=nu, rule=rule, **options).constants(mesh)


def rest_stiffness(mesh, term):
    return System(mesh, term).tangent(np.zeros(mesh.p.size)).toarray()


def along(mesh):
    """Return the derivatives of the edge lengths by all displacements, computed independently from the mesh, (ne, ndofs)."""
    edges = SpringNetwork(young=1.0, poisson=0.3).edges(mesh)
    d, P = mesh.d, mesh.p[:, edges[0]] - mesh.p[:, edges[1]]
    rows = np.zeros((edges.shape[1], mesh.p.size))
    for i, (a, b) in enumerate(edges.T):
        n = P[:, i] / np.linalg.norm(P[:, i])
        rows[i, d * a : d * a + d], rows[i, d * b : d * b + d] = n, -n
    return rows


def residual(mesh, nu, rule="least-squares", **options):
    """Return the relative error `|K_e - sum k n n'|_F / |K_e|_F` of a mesh of one element."""
    K, D = rest_stiffness(mesh, StVK(young=1.0, poisson=nu, **options)), along(mesh)
    return np.linalg.norm(K - D.T @ np.diag(springs(mesh, nu, rule, **options)) @ D) / np.linalg.norm(K)


@pytest.mark.parametrize(("nu", "published"), [(0.0, 0.447), (0.25, 0.2), (0.3, 0.235), (0.4, 0.447)])
def test_springs_miss_the_stiffness_of_a_regular_tetrahedron(nu, published):
    assert residual(TET, nu) == pytest.approx(published, abs=5e-4)


@pytest.mark.parametrize(("nu", "published"), [(1 / 3, 0.0), (0.3, 0.035)])
def test_springs_equal_an_equilateral_triangle_only_at_one_third(nu, published):
    assert residual(TRIANGLE, nu, plane="stress") == pytest.approx(published, abs=5e-4)


@pytest.mark.parametrize(("mesh", "nu", "options"), [(TET, 0.25, {}), (TRIANGLE, 1 / 3, {"plane": "stress", "thickness": 0.3})])
def test_lloyds_closed_forms_are_the_least_squares_fit_of_regular_elements(mesh, nu, options):
    fitted, lloyd = (springs(mesh, nu, rule, young=3.0, **options) for rule in ("least-squares", "lloyd"))
    assert np.abs(fitted / lloyd - 1).max() < 1e-13
    closed = 3.0 * (2 * np.sqrt(2) / 25 * 2 if mesh is TET else np.sqrt(3) / 4 * 0.3)
    assert np.abs(lloyd / closed - 1).max() < 1e-13


def test_van_gelders_rule_is_not_exact():
    """Van Gelder's rule differs from the best fit.

    The difference is 4 % for a regular tetrahedron at nu = 1/4, none for an equilateral triangle, and large for other triangles.
    """
    assert springs(TET, 0.25, "van-gelder")[0] / springs(TET, 0.25)[0] == pytest.approx(1.0417, abs=1e-4)
    assert residual(TRIANGLE, 1 / 3, "van-gelder", plane="stress") < 1e-14
    slanted = ElementMesh(np.array([[0.0, 1, 0.2], [0, 0, 0.7]]), np.arange(3)[:, None])
    assert residual(slanted, 1 / 3, "van-gelder", plane="stress") > 1.04 * residual(slanted, 1 / 3, plane="stress") > 0.2


@pytest.mark.parametrize("k", [2, 3])
def test_the_fit_is_the_best_of_all_nonnegative_springs(k):
    """The fit equals SciPy's active-set method (NNLS) on each element.

    Without the constraint, most random tetrahedra would have a negative spring.
    """
    mesh = single(np.random.default_rng(4), 60, k)
    found = springs(mesh, 0.3).reshape(mesh.nt, -1)
    negative = 0
    for e, vertices in enumerate(mesh.t.T):
        own = ElementMesh(mesh.p[:, vertices], np.arange(k + 1)[:, None])
        D = along(own)
        A = np.stack([np.outer(row, row).ravel() for row in D], axis=1)
        K = rest_stiffness(own, StVK(young=1.0, poisson=0.3)).ravel()
        best = nnls(A, K)[0]
        assert np.abs(found[e] - best).max() < 1e-8 * np.abs(best).max()
        negative += (np.linalg.lstsq(A, K, rcond=None)[0] < 0).any()
    assert negative > 0.7 * mesh.nt if k == 3 else negative > 0


def test_plain_least_squares_gives_most_random_tetrahedra_a_negative_spring():
    mesh = single(np.random.default_rng(0), 5000, 3)
    rest = Rest.of(mesh, mesh.t, SpringNetwork(young=1.0, poisson=0.3))
    C = rest.crossed
    k = np.linalg.solve(C**2, np.einsum("nij,njk,nki->ni", C, rest.stiffness, C)[:, :, None])[:, :, 0]
    assert (k < 0).any(axis=1).mean() == pytest.approx(0.865, abs=0.02)
    fitted = RULES["least-squares"](rest)
    retained = (k >= 0).all(axis=1)
    assert np.abs(fitted[retained] - k[retained]).max() < 1e-9 * np.abs(k[retained]).max() and (fitted >= 0).all()


@pytest.mark.parametrize("name", ["tetrahedra", "triangles", "membrane", "segments", "cable"])
def test_edge_diagonal_springs_are_the_first_sum_of_the_edge_form_to_first_order(name):
    mesh = MESHES[name]
    law = StVK(young=RNG.uniform(1, 3, mesh.nt), poisson=0.3)
    form = law.bind(mesh).form
    lengths = np.linalg.norm(form.P, axis=1)
    k = SpringNetwork(law.material, rule="edge-diagonal").constants(mesh)
    assert k == pytest.approx(2 * form.L.diagonal() * lengths**2, rel=1e-12)
    if mesh.k == 1:
        assert k == pytest.approx(law.material.young[np.lexsort(np.sort(mesh.t, axis=0)[::-1])] / lengths, rel=1e-12)


@pytest.mark.parametrize("options", [{"plane": "stress", "thickness": 0.4}, {"plane": "strain"}])
def test_triangular_springs_are_the_triangle_to_first_order(options):
    mesh = MESHES["triangles"]
    law = StVK(young=RNG.uniform(1, 3, mesh.nt), poisson=0.2, **options)
    triangular = SpringNetwork(law.material, rule="triangular", **options)
    K, exact = rest_stiffness(mesh, triangular), rest_stiffness(mesh, law)
    assert np.abs(K - exact).max() < 1e-12 * np.abs(exact).max()
    assert np.abs(rest_stiffness(mesh, SpringNetwork(law.material, rule="edge-diagonal", **options)) - exact).max() > 0.05
    u = 1e-4 * state(mesh, 1.0)
    one, two = (System(mesh, term).internal_force(u) for term in (triangular, law))
    assert 0 < np.abs(one - two).max() < 1e-3 * np.abs(two).max()


def test_triangular_springs_have_delingettes_coefficients():
    """Coefficients equal `l^2 (2 c^2 (lam + G) + G)/(8A)` and `l l (2 c c (lam + G) - G)/(8A)`.

    In these formulas `G = 2 mu` as in Delingette's paper, and `c` are the opposite cotangents.
    """
    x = np.array([[0.0, 1.1, 0.3], [0.0, 0.2, 0.9]])
    mesh = ElementMesh(x, np.arange(3)[:, None])
    lam, G = 0.3 / (1 - 0.09), 2 / (2 * 1.3)
    edges, A = np.array(LOCAL_EDGES[2]), abs(np.linalg.det(x[:, 1:] - x[:, :1])) / 2
    lengths = np.linalg.norm(x[:, edges[:, 0]] - x[:, edges[:, 1]], axis=0)
    cot = np.array([(lengths @ lengths - 2 * l**2) / (4 * A) for l in lengths])
    matrix = np.outer(lengths, lengths) * (2 * np.outer(cot, cot) * (lam + G) - G) / (8 * A)
    np.fill_diagonal(matrix, lengths**2 * (2 * cot**2 * (lam + G) + G) / (8 * A))
    bound = SpringNetwork(young=1.0, poisson=0.3, plane="stress", rule="triangular")._springs(mesh)
    order = [next(i for i, edge in enumerate(edges) if set(edge) == set(pair)) for pair in bound.edges.T]
    expected = matrix[np.ix_(order, order)]
    assert bound.own == pytest.approx(np.diag(expected), rel=1e-12)
    assert bound.between == pytest.approx(expected[tuple(bound.pairs)], rel=1e-12)


def test_on_equilateral_triangles_at_one_third_springs_are_the_elements_to_first_order():
    mesh = lattice()
    law = StVK(young=2.0, poisson=1 / 3, plane="stress")
    exact = rest_stiffness(mesh, law)
    for rule in RULES:
        K = rest_stiffness(mesh, SpringNetwork(law.material, rule=rule, plane="stress"))
        assert np.abs(K - exact).max() < 1e-13 * np.abs(exact).max()
    u = 0.05 * state(mesh, 1.0)
    F, of_springs = (System(mesh, term).internal_force(u) for term in (law, SpringNetwork(law.material, plane="stress")))
    assert np.abs(F - of_springs).max() > 1e-2 * np.abs(F).max()


def test_user_supplied_constants_follow_scikit_fems_order():
    """User-supplied constants follow scikit-fem's order of edges: each edge has the energy `1/2 k e^2`."""
    import skfem

    host = skfem.MeshTet().refined(1)
    k = RNG.uniform(1, 2, host.edges.shape[1])
    term = SpringNetwork(stiffness=k)
    assert np.array_equal(term.edges(host), host.edges) and np.array_equal(term.constants(host), k)
    flat = skfem.MeshTri().refined(1)
    assert np.array_equal(SpringNetwork(young=1.0, poisson=0.3).edges(flat), flat.facets)
    u = 0.1 * state(ElementMesh.of(host))
    x, moved = host.p.T, host.p.T + u.reshape(-1, 3)
    a, b = host.edges
    e = np.linalg.norm(moved[a] - moved[b], axis=1) - np.linalg.norm(x[a] - x[b], axis=1)
    assert System(host, term).energy(u) == pytest.approx(k @ e**2 / 2, rel=1e-12)


def test_constants_of_a_region_follow_the_order_of_its_edges():
    mesh, half = box(2), np.arange(11)
    ends = SpringNetwork(young=1.0, poisson=0.3, region=half).edges(mesh)
    assert np.array_equal(ends, ends[:, np.lexsort(ends[::-1])]) and set(ends.ravel()) == set(mesh.t[:, half].ravel())
    k = RNG.uniform(1, 2, ends.shape[1])
    assert np.array_equal(SpringNetwork(stiffness=k, region=half).constants(mesh), k)


def test_the_mass_is_that_of_the_elements():
    mesh = box(2)
    of_springs = System(mesh, SpringNetwork(young=1.0, poisson=0.3, density=7.0)).mass().vertex
    assert np.array_equal(of_springs, System(mesh, StVK(young=1.0, poisson=0.3, density=7.0)).mass().vertex)
    k = np.ones(SpringNetwork(young=1.0, poisson=0.3).edges(mesh).shape[1])
    assert np.array_equal(System(mesh, SpringNetwork(stiffness=k, density=7.0)).mass().vertex, of_springs)
    with pytest.raises(MaterialError, match="has no density"):
        System(mesh, SpringNetwork(stiffness=k)).mass()


def hanging_bar(rule="least-squares", poisson=0.25, **options):
    """Return a bar of springs that hangs from one end, with its loads."""
    mesh = box(2)
    wall, tip = np.flatnonzero(mesh.p[2] > 0.8), np.flatnonzero(mesh.p[2] < 0.2)
    term = SpringNetwork(young=100.0, poisson=poisson, rule=rule, density=1.0)
    loads = [Gravity((0, 0, -9.81)), NodalLoad(tip, (0.3, 0, -0.5))]
    return System(mesh, [term, *options.get("terms", ()), *loads], fixed={tuple(wall): "xyz"})


@pytest.mark.parametrize("rule", ["least-squares", "edge-diagonal", "van-gelder"])
@pytest.mark.parametrize("solver", ["superlu", "amg-cg", "ssor-cg"])
def test_springs_balance(rule, solver):
    system = hanging_bar(rule)
    found = solve_static(system, solver=solver, quiet=True, rtol=1e-10)
    residual = system.residual(found.u)
    residual[system.supports.held] = 0
    assert found.success and np.abs(residual).max() < 1e-8 * np.abs(system.external_force(found.u)).max()
    assert 0.02 < np.abs(found.u).max() < 1


def test_springs_of_a_single_tetrahedron_have_no_mechanism():
    eigenvalues = np.linalg.eigvalsh(rest_stiffness(TET, SpringNetwork(young=1.0, poisson=0.25)))
    assert (eigenvalues[:6] < 1e-12).all() and eigenvalues[6] > 1e-2
    for fixed, left in ((None, "6 rigid"), ({(0,): "xyz"}, "3"), ({(0,): "xyz", (1,): "yz"}, "1")):
        with pytest.raises(SupportError, match=f"Not held.*{left}"):
            System(TET, SpringNetwork(young=1.0, poisson=0.25), fixed=fixed).check_held()
    System(TET, SpringNetwork(young=1.0, poisson=0.25), fixed={(0,): "xyz", (1,): "yz", (2,): "z"}).check_held()


def test_tetrahedra_of_springs_that_share_an_edge_can_rotate_about_it():
    p = np.concatenate([REGULAR, REGULAR[:, 2:] * [[1], [-1], [-1]]], axis=1)
    mesh = ElementMesh(p, np.array([[0, 0], [1, 1], [2, 4], [3, 5]]))
    fixed = {(0, 1, 2): "xyz"}
    with pytest.raises(SupportError, match=r"1 mechanism.*can rotate about"):
        System(mesh, SpringNetwork(young=1.0, poisson=0.25), fixed=fixed).check_held()
    K = System(mesh, SpringNetwork(young=1.0, poisson=0.25)).tangent(np.zeros(18)).toarray()
    free = np.setdiff1d(np.arange(18), np.arange(9))
    assert np.linalg.eigvalsh(K[np.ix_(free, free)])[0] < 1e-12
    lost = SpringNetwork(stiffness=np.array([1.0, 0, *np.ones(9)]))
    assert list(lost.elements_held_in_shape(mesh)) == [1] and lost.edges(mesh)[:, 1].tolist() == [0, 2]
    System(mesh, lost, fixed=fixed).check_held()  # an element with a missing spring is not assumed rigid


def spinning(term, integrator, **options):
    system = System(box(2), term)
    x = system.mesh.p.T - system.mesh.p.mean(axis=1)
    v = np.cross([0.5, 1.0, 2.0], x) + 0.2 * np.random.default_rng(1).standard_normal(x.shape)
    return simulate(system, integrator, until=0.2, v0=v.ravel(), quiet=True, **options)


SPRINGS = SpringNetwork(young=50.0, poisson=0.25, density=1.0)


def test_damping_along_the_springs_is_a_parallel_dashpot_at_each():
    """Each spring has a parallel dashpot with the force `c (v_ab . n) n`, `c = tau k`.

    Rigid motions have no damping force, at any rotation of the body.
    """
    mesh, tau = box(2), 0.03
    term = SPRINGS.bind(mesh)
    a, b = SPRINGS.edges(mesh)
    u, v = (0.2 * state(mesh, seed=seed).reshape(-1, 3) for seed in (3, 4))
    p = (mesh.p.T + u)[a] - (mesh.p.T + u)[b]
    n = p / np.linalg.norm(p, axis=1, keepdims=True)
    pull = (tau * SPRINGS.constants(mesh) * np.einsum("nc,nc->n", v[a] - v[b], n))[:, None] * n
    expected = np.zeros_like(u)
    np.add.at(expected, a, pull)
    np.subtract.at(expected, b, pull)
    force = np.zeros_like(u)
    R = term.damping_force(u, v, force)
    assert np.abs(tau * force - expected).max() < 1e-13 * np.abs(expected).max()
    assert pytest.approx(np.vdot(force, v), rel=1e-12) == 2 * R
    turning = np.zeros_like(u)
    assert term.damping_force(u, np.cross([1.0, 2.0, 3.0], mesh.p.T + u), turning) < 1e-25 and np.abs(turning).max() < 1e-12
    run = spinning(SPRINGS, EnergyMomentum(0.01), damping=EdgeDamping(0.05))
    energy, spin = run.ledger["total_energy"], run.ledger["angular_momentum_z"]
    assert energy[-1] < 0.99 * energy[0] and np.ptp(spin) < 1e-10 * abs(spin[0])
    assert np.abs(run.ledger["closure_error"]).max() < 1e-9 * energy[0]
    assert spinning(SPRINGS, LinearBackwardEuler(2e-3), damping=EdgeDamping(0.05)).success


def test_modes_and_critical_steps_are_those_of_the_stiffness():
    system = hanging_bar()
    u = solve_static(system, quiet=True).u
    free = np.setdiff1d(np.arange(system.ndofs), system.supports.held)
    K, M = (A.toarray()[np.ix_(free, free)] for A in (system.tangent(u), system.mass().matrix))
    exact = np.linalg.eigvalsh(K / np.sqrt(np.outer(M.diagonal(), M.diagonal())))
    assert modes(system, 3, u=u).eigenvalues == pytest.approx(exact[:3], rel=1e-6)
    assert critical_step(system, u).step == pytest.approx(2 / np.sqrt(exact[-1]), rel=1e-2)


def test_a_volume_penalty_prevents_inverted_elements_of_a_bar():
    """A volume penalty, as Lloyd and Teschner use it with springs, prevents inverted elements.

    The penalty derives its stiffness from young and poisson, or uses a given one.
    """
    mesh = box(2)
    both = System(mesh, [SPRINGS, VolumePenalty()])
    assert both.energies(-0.3 * mesh.p.ravel("F"))["VolumePenalty 1"] > 0
    lam_2mu = 50.0 * 0.75 / (1.25 * 0.5)
    usual = System(mesh, [SPRINGS, VolumePenalty(0.15 * lam_2mu)])
    u = -0.3 * mesh.p.ravel("F")
    assert usual.energy(u) == pytest.approx(both.energy(u), rel=1e-12)
    bare = SpringNetwork(stiffness=SPRINGS.constants(mesh), density=1.0)
    with pytest.raises(MaterialError, match=r"VolumePenalty: .*Give stiffness= \[Pa\]"):
        System(mesh, [bare, VolumePenalty()])
    assert System(mesh, [bare, VolumePenalty(0.15 * lam_2mu)]).energy(u) == pytest.approx(both.energy(u), rel=1e-12)
    run = simulate(both, BackwardEuler(0.01), until=0.05, u0=u, quiet=True)
    assert run.success and both.smallest_volume_ratio(run.u) > 0


@pytest.mark.parametrize("nu", [0.3, 0.25])
def test_lloyds_rule_warns_for_other_materials(nu):
    if nu == 0.3:
        with pytest.warns(StvkWarning, match=r"nu = 1/4 in tetrahedra, and 1 element \(0\)"):
            springs(TET, nu, "lloyd")
        with pytest.warns(StvkWarning, match=r'nu = 1/3 in triangles in plane stress \(plane="stress"\)'):
            springs(TRIANGLE, nu, "lloyd", plane="stress")
    else:
        assert len(springs(TET, nu, "lloyd")) == 6
        with pytest.warns(StvkWarning, match="nu = 1/3"):
            springs(TRIANGLE, 1 / 3, "lloyd", plane="strain")


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"rule": "gelder"}, r"rule = 'gelder'; known: 'edge-diagonal', .* Did you mean 'van-gelder'"),
        ({"rule": "lloyd", "stiffness": [1.0]}, "got stiffness= as well"),
        ({"young": None}, "A material is missing"),
        ({"young": None, "stiffness": [1.0, -2.0]}, r"negative in 1 edge \(1\), first value -2"),
        ({"young": None, "stiffness": [1.0, np.nan, np.inf]}, r"not finite in 2 edges \(1, 2\)"),
        ({"young": None, "stiffness": 3.0}, r"shape \(\); expected one value"),
        ({"young": None, "stiffness": [1.0], "poisson": 0.3}, "poisson is of no use without young"),
        ({"poisson": 0.7}, "poisson"),
    ],
)
def test_invalid_spring_networks_are_refused(given, message):
    with pytest.raises(MaterialError, match=message):
        SpringNetwork(**({"young": 1.0, "poisson": 0.25} | ({"poisson": None} if "young" in given else {}) | given)).bind(TET)


@pytest.mark.parametrize(
    ("mesh", "given", "message"),
    [
        (TET, {"stiffness": np.ones(5)}, "stiffness has 5 values; expected one for each of the 6 edges"),
        (TET, {"stiffness": np.zeros(6)}, "all springs is zero"),
        (TET, {"young": 1.0, "poisson": 0.25, "rule": "triangular"}, "is for triangles"),
        (MESHES["segments"], {"young": 1.0, "rule": "lloyd"}, "is for triangles and tetrahedra"),
        (box(1).with_degree(2), {"young": 1.0, "poisson": 0.25}, "the mesh has quadratic tetrahedra in 3D. Take degree=1"),
        (TET, {"material": Anisotropic(some_voigt(RNG)), "rule": "van-gelder"}, "is for isotropic materials"),
    ],
)
def test_meshes_and_materials_that_do_not_fit_are_refused(mesh, given, message):
    with pytest.raises(MaterialError, match=message):
        System(mesh, SpringNetwork(**given))


def test_an_unknown_region_is_refused():
    with pytest.raises(RegionError):
        System(TET, SpringNetwork(young=1.0, poisson=0.25, region="nowhere"))


def test_springs_have_no_stress_and_their_body_can_be_plotted(tmp_path):
    mesh = box(2)
    u = 0.1 * state(mesh)
    now = Fields.of(System(mesh, SPRINGS)).at(u)
    assert now["cauchy_stress"].mask.all()
    assert np.array_equal(now["deformation_gradient"], Fields(mesh, StVK(young=1.0, poisson=0.3)).at(u)["deformation_gradient"])
    found = solve_static(hanging_bar(), quiet=True, save=tmp_path / "springs.pvd")
    assert found.success and found.plot("displacement").get_axes() and found.plot().get_axes()


@pytest.mark.filterwarnings("ignore::skfem_stvk.StvkWarning")  # warnings of loose parts
@pytest.mark.parametrize("rule", ["least-squares", "triangular", "lloyd", "own"])
def test_elements_can_be_removed(rule):
    """After elements are removed, the network equals that of the other elements, on the vertices that they have."""
    mesh = MESHES["triangles"] if rule == "triangular" else box(2)
    out = np.random.default_rng(2).permutation(mesh.nt)[: mesh.nt // 3]
    retained = np.setdiff1d(np.arange(mesh.nt), out)
    given = {"young": 3.0, "poisson": 0.25, "rule": rule, "density": 1.0}
    if rule == "own":
        given = {"stiffness": np.ones(SPRINGS.edges(mesh).shape[1]), "density": 1.0}
    system = System(mesh, SpringNetwork(**given))
    whole = system.energy(u := 0.1 * state(mesh))
    system, edges = system.without(out), SpringNetwork(young=1.0, poisson=0.25, region=retained).edges(mesh)
    (term,) = system.bound_terms
    assert set(map(tuple, term.nodes_joined.T)) == set(map(tuple, edges.T)) < set(map(tuple, term.nodes_paired.T))
    if rule == "own":
        given["stiffness"] = np.ones(edges.shape[1])
    rest = System(mesh, [SpringNetwork(**given, region=retained), StVK(young=1e-30, poisson=0.3)])
    W, F = rest.energy_and_force(u)
    assert system.energy(u) == pytest.approx(W, rel=1e-12) and 0.95 * whole > W
    assert np.abs(system.internal_force(u) - F).max() < 1e-12 * np.abs(F).max()
    K = rest.tangent(u)
    has = np.repeat(np.isin(np.arange(mesh.nv), mesh.t[:, retained]), mesh.d)
    assert abs(system.tangent(u) - K)[has][:, has].max() < 1e-12 * abs(K).max()
