"""The tangent with retained tensions is `2 J' L J + sum g t Lap (x) I`; without negative tensions it is semi-definite."""

import numpy as np
import pytest
from bodies import BODIES, MESHES, boxes, state
from kernels.parts import in_parts
from scipy.spatial import Delaunay

from skfem_stvk import Anisotropic, ElementMesh, StVK, StvkError, System
from skfem_stvk.edges import ALL, NONE, TENSILE, Tensions
from skfem_stvk.system import Pattern


def unstructured(k, d, n=40):
    """Return simplices between random points; for `d > k` they are bent into space."""
    rng = np.random.default_rng(5)
    if k == 1:
        p, t = np.cumsum(rng.uniform(0.2, 1, (1, n)), axis=1) / n, np.stack([np.arange(n - 1), np.arange(1, n)])
    else:
        p = rng.random((k, n))
        t = Delaunay(p.T).simplices.T
        volume = np.abs(np.linalg.det((p[:, t[1:]] - p[:, t[:1]]).T))
        t = t[:, volume > 0.02 * volume.mean()]
    used, t = np.unique(t, return_inverse=True)
    p = p[:, used]
    return ElementMesh(np.stack([*p, *(np.sin(3 * p[0] + i) for i in range(d - k))]), t.reshape(k + 1, -1))


def compressed(mesh):
    """Return displacements (nv, d) of a compressed body, with edges in tension and in compression."""
    return state(mesh).reshape(-1, mesh.d) - 0.3 * mesh.p.T


def bound(mesh, terms, dtype=np.float64):
    return [term.bind(mesh, dtype) for term in terms]


def from_the_edges(assembly, u, kept):
    """Return `2 J' L J + sum g t Lap (x) I`, (ndofs, ndofs), dense, from the coefficients of the edges."""
    form, (nv, d) = assembly.form, u.shape
    (a, b), e = form.edges, np.arange(form.edges.shape[1])
    J, B = np.zeros((len(e), nv, d)), np.zeros((len(e), nv))
    B[e, a], B[e, b] = 1, -1
    J[e, a] = form.P + form.differences(u)
    J[e, b] = -J[e, a]
    J, t = J.reshape(len(e), -1), form.tensions(u)
    t = np.where(t > 0, kept.positive, kept.negative) * t
    return 2 * J.T @ form.L @ J + np.kron(B.T @ (t[:, None] * B), np.eye(d))


def dense(assembly, u, kept):
    """Return the same matrix from the kernels, by way of CSR values."""
    pattern = Pattern(len(u), u.shape[1], [assembly.nodes_paired])
    data = np.zeros(pattern.nnz)
    assembly.fill(u, assembly.rows(pattern), data, False, None, kept)
    return pattern.matrix(data).toarray()


@pytest.mark.few
@pytest.mark.parametrize("parts", [1, 3])
@pytest.mark.parametrize("name", BODIES)
def test_tensions_are_L_times_squared_elongations(name, parts, monkeypatch):
    in_parts(monkeypatch, parts)
    mesh, terms = BODIES[name]
    u = compressed(mesh)
    for assembly in bound(mesh, terms):
        wanted = assembly.form.tensions(u)
        assert wanted.min() < -1e-3 < 1e-3 < wanted.max()
        for _ in range(2):
            assert np.abs(assembly.tensions(u) - wanted).max() < 1e-12 * np.abs(wanted).max()
            assembly.tensions(-2 * u)


def test_tensions_of_small_strains_keep_all_digits_far_from_the_origin():
    near = MESHES["tetrahedra"]
    u = state(near, 1e-10).reshape(-1, 3)
    far = ElementMesh(near.p + 2.0**20, near.t)
    same = ElementMesh(far.p - 2.0**20, near.t)  # the coordinates as rounded there
    term = StVK(young=2.0, poisson=0.3)
    here, there = term.bind(same).tensions(u), term.bind(far).tensions(u)
    assert np.abs(here - there).max() < 1e-14 * np.abs(here).max() > 0


@pytest.mark.few
@pytest.mark.parametrize("parts", [1, 2, 5])
@pytest.mark.parametrize("name", BODIES)
def test_the_tangent_is_that_of_the_edges_with_retained_tensions(name, parts, monkeypatch):
    in_parts(monkeypatch, parts)
    mesh, terms = BODIES[name]
    u = compressed(mesh)
    for assembly in bound(mesh, terms):
        exact = from_the_edges(assembly, u, ALL)
        scale = np.abs(exact).max()
        assert np.abs(dense(assembly, u, ALL) - exact).max() < 1e-12 * scale
        for kept in (TENSILE, NONE, Tensions(0.3, 0.3), Tensions(0.2, 0.9)):
            wanted = from_the_edges(assembly, u, kept)
            assert np.abs(wanted - exact).max() > 1e-3 * scale
            assert np.abs(dense(assembly, u, kept) - wanted).max() < 1e-12 * scale


KINDS = {"tetrahedra": (3, 3), "triangles": (2, 2), "membrane": (2, 3), "segments": (1, 1), "cable": (1, 3)}
STATES = {
    "crushed": lambda x, noise: -0.7 * x + 0.1 * noise,
    "inside out": lambda x, noise: -1.7 * x + 0.1 * noise,
    "pushed together at random": lambda x, noise: -0.4 * x + 0.2 * noise,
    "collapsed to a point": lambda x, noise: -x,
}


@pytest.mark.few
@pytest.mark.parametrize("stress", STATES)
@pytest.mark.parametrize("law", ["isotropic", "general"])
@pytest.mark.parametrize("kind", KINDS)
def test_clamped_and_gauss_newton_tangents_are_positive_semi_definite(kind, law, stress):
    mesh = unstructured(*KINDS[kind])
    rng = np.random.default_rng(6)
    if law == "isotropic":
        term = StVK(young=rng.uniform(1, 10, mesh.nt), poisson=rng.uniform(-0.3, 0.45, mesh.nt))
    else:
        A = rng.standard_normal((mesh.nt, 6, 6))
        term = StVK(Anisotropic(A @ np.swapaxes(A, 1, 2) + np.eye(6)))
    noise = rng.standard_normal(mesh.p.T.shape) / mesh.nv ** (1 / mesh.k)
    body, u = System(mesh, term), STATES[stress](mesh.p.T, noise)
    (assembly,) = body.bound_terms
    exact, *others = (np.linalg.eigvalsh(dense(assembly, u, kept)) for kept in (ALL, TENSILE, NONE))
    assert exact[0] < -1e-6 * np.abs(exact).max()
    for lowest, highest in ((values[0], values[-1]) for values in others):
        assert lowest >= -1e-13 * highest


def regular(k):
    """Return equilateral triangles, regular tetrahedra or equal segments, two of each, without obtuse angles."""
    if k == 1:
        return ElementMesh(np.array([[0.0, 1.0, 2.0]]), np.array([[0, 1], [1, 2]]))
    if k == 2:
        p = np.array([[0, 1, 0.5, 1.5], [0, 0, np.sqrt(0.75), np.sqrt(0.75)]])
        return ElementMesh(p, np.array([[0, 1, 2], [1, 3, 2]]).T)
    p = np.array([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])
    other = p[1:].sum(axis=0) * 2 / 3 - p[0]
    return ElementMesh(np.concatenate([p, [other]]).T, np.array([[0, 1, 2, 3], [4, 1, 2, 3]]).T)


@pytest.mark.parametrize("k", [1, 2, 3])
def test_the_clamped_tangent_is_bitwise_exact_in_pure_tension(k):
    mesh = regular(k)
    assembly = StVK(young=2.0, poisson=0.3).bind(mesh)
    u = 0.1 * mesh.p.T + 0.01 * state(mesh).reshape(-1, mesh.d)
    assert (assembly.tensions(u) > 0).all()
    assert np.array_equal(dense(assembly, u, TENSILE), dense(assembly, u, ALL))
    assert (assembly.tensions(-2 * u) < 0).any()
    assert np.abs(dense(assembly, -2 * u, TENSILE) - dense(assembly, -2 * u, ALL)).max() > 1e-3


def test_elements_without_an_edge_form_have_no_tensions():
    mesh = boxes(2)
    (term,) = System(mesh, StVK(young=1.0, poisson=0.3)).bound_terms
    with pytest.raises(StvkError, match="quadrilaterals have no edge form"):
        term.tensions(np.zeros((mesh.nv, 2)))
