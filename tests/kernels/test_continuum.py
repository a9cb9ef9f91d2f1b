"""W, F and K of St. Venant-Kirchhoff's law on all elements agree with the formulas of the continuum, and so do its other forces."""

import numpy as np
import pytest
from bodies import CURVED, EVERY_MESH, STRAIGHT, box, some_voigt, state

from skfem_stvk import Anisotropic, ElementMesh, StVK, System
from skfem_stvk.edges import Tensions
from skfem_stvk.edges.elements import Quadrature
from skfem_stvk.kernels.lanes import LANES
from skfem_stvk.mesh.points import rule_of
from skfem_stvk.referee.reference import anisotropic_tensor, isotropic_tensor
from skfem_stvk.terms.body import Body

VOIGT = some_voigt(np.random.default_rng(3))
FRAME = np.linalg.qr(np.random.default_rng(4).standard_normal((3, 3)))[0]
LAWS = {"isotropic": StVK(young=2.0, poisson=0.3), "general": StVK(Anisotropic(VOIGT, frame=FRAME))}


def partly_curved():
    """Return quadratic tetrahedra; some blocks of lanes contain only straight elements, and others contain curved ones."""
    straight = box(3).with_degree(2)
    p, rng = straight.p.copy(), np.random.default_rng(5)
    middle = np.flatnonzero((np.arange(straight.nv) >= box(3).nv) & (p[0] > 0.8))
    p[:, middle] += 0.02 * rng.uniform(-1, 1, (3, len(middle)))
    return ElementMesh(p, straight.t, element=straight.element)


PARTLY = {"partly curved tetrahedra": partly_curved()}
MESHES = EVERY_MESH | {f"straight {name}": mesh for name, mesh in STRAIGHT.items()} | PARTLY


def tensor_of(law, mesh, axes):
    """Return the elasticity tensor in the axes (n, d, k), (n, k, k, k, k)."""
    condensed = mesh.k == 1 or mesh.k < mesh.d
    if law == "isotropic":
        return isotropic_tensor(2.0, 0.3, mesh.k, condensed)
    return anisotropic_tensor(VOIGT, FRAME, axes, condensed)


def points_of(mesh, kind):
    """Return `A`, gradients and sizes of each point.

    The axes `A` (n, d, k) are the global ones for solids. The gradients (n, a, k) are along them, and the sizes (n,) are the
    point's share.
    """
    rule = rule_of(mesh.element, "mass" if kind == "one-point" else kind)
    found = []
    for dN, weight in zip(mesh.element.derivatives(rule.points), rule.weights, strict=True):
        base_vectors = np.einsum("ai,dan->ndi", dN, mesh.p[:, mesh.t])
        axes = np.linalg.qr(base_vectors)[0] if mesh.k < mesh.d else np.broadcast_to(np.eye(mesh.d), base_vectors.shape)
        jacobian = np.swapaxes(axes, 1, 2) @ base_vectors
        found.append((axes, dN @ np.linalg.inv(jacobian), weight * np.abs(np.linalg.det(jacobian))))
    if kind != "one-point":
        return found
    sizes = sum(size for _, _, size in found)
    return [(found[0][0], sum(g * size[:, None, None] for _, g, size in found) / sizes[:, None, None], sizes)]


def continuum(mesh, law, kind, u):
    """Return W, F and K by `E = 1/2 (F'F - I)`, `F = A + sum_a u_a (x) g_a`."""
    x, W, F, K = u.reshape(-1, mesh.d), 0.0, np.zeros((mesh.nv, mesh.d)), np.zeros((mesh.nv, mesh.d, mesh.nv, mesh.d))
    a, b = mesh.t.T[:, :, None], mesh.t.T[:, None, :]
    for axes, g, sizes in points_of(mesh, kind):
        now = axes + np.einsum("nad,nak->ndk", x[mesh.t.T], g)
        E = (np.swapaxes(now, 1, 2) @ now - np.eye(mesh.k)) / 2
        C = tensor_of(law, mesh, axes) * sizes[:, None, None, None, None]
        S = np.einsum("nijkl,nkl->nij", C, E)
        W += (S * E).sum() / 2
        np.add.at(F, mesh.t.T, np.einsum("ndi,nij,naj->nad", now, S, g))
        of = np.einsum("ndi,nijkl,nek,naj,nbl->nadbe", now, C, now, g, g, optimize=True)
        of += np.einsum("nai,nij,nbj,de->nadbe", g, S, g, np.eye(mesh.d), optimize=True)
        np.add.at(K.transpose(0, 2, 1, 3), (a, b), of.transpose(0, 1, 3, 2, 4))
    if kind == "one-point":
        H = hourglass(mesh, law, g, sizes)
        W += np.einsum("nab,nad,nbd->", H, x[mesh.t.T], x[mesh.t.T]) / 2
        np.add.at(F, mesh.t.T, np.einsum("nab,nbd->nad", H, x[mesh.t.T]))
        np.add.at(K.transpose(0, 2, 1, 3), (a, b), np.einsum("nab,de->nabde", H, np.eye(mesh.d)))
    return W, F.ravel(), K.reshape(u.size, u.size)


def hourglass(mesh, law, g, sizes):
    """Return the stiffness of the hourglass modes, (n, a, b).

    The modes `gamma_k` are products of reference coordinates minus their affine part.
    """
    signs = 2 * mesh.element.nodes - 1
    bits = [[i for i in range(mesh.k) if pattern >> i & 1] for pattern in range(2**mesh.k)]
    modes = np.array([signs[:, axes].prod(axis=1) for axes in bits if len(axes) > 1])
    X = mesh.p.T[mesh.t.T]
    gamma = modes - np.einsum("kb,nbd,nad->nka", modes, X, g)
    assert np.abs(np.einsum("nka,nad->nkd", gamma, X)).max() < 1e-14
    modulus = 2.0 * 0.7 / (1.3 * 0.4) if law == "isotropic" else np.diag(VOIGT)[:3].max()
    c = 0.05 / 16 * modulus * sizes * (g**2).sum(axis=(1, 2))
    return 2 * np.einsum("n,nka,nkb->nab", c, gamma, gamma)


def assert_near(found, wanted, limit=1e-12):
    assert np.abs(wanted).max() > 1e-4 and np.abs(found - wanted).max() <= limit * np.abs(wanted).max()


def assert_is_the_continuum(mesh, law, kind="usual"):
    """Compare W, F and K of the body with those of the continuum, by single calls and by one pass."""
    u, body = state(mesh), System(mesh, LAWS[law], quadrature=None if kind == "usual" else kind)
    W, F, K = continuum(mesh, law, kind, u)
    for found, force, tangent in ((*body.energy_and_force(u), body.tangent(u)), body.linearize(u)):
        assert found == pytest.approx(W, rel=1e-12)
        assert_near(force, F)
        assert_near(tangent.toarray(), K)


def rules(mesh):
    """Return the rules that differ on this mesh.

    On linear simplices all rules are the same. The rule "one-point" exists for boxes that fill the space.
    """
    if mesh.element.is_linear_simplex:
        return ("usual",)
    return ("usual", "exact", "one-point") if mesh.element.shape.one_point and mesh.k == mesh.d else ("usual", "exact")


def quadrature(mesh, kind):
    return Quadrature.of(mesh.element, kind, 0.05 if kind == "one-point" else None)


CASES = [(name, law, kind) for name, mesh in MESHES.items() for law in LAWS for kind in rules(mesh)]


@pytest.mark.few(12)
@pytest.mark.parametrize(("name", "law", "kind"), CASES)
def test_all_laws_on_all_elements_are_those_of_the_continuum(name, law, kind):
    assert_is_the_continuum(MESHES[name], law, kind)


@pytest.mark.parametrize("count", [1, LANES - 1, LANES, LANES + 1])
@pytest.mark.parametrize("law", LAWS)
def test_blocks_of_lanes_may_be_full_or_not(count, law):
    whole = box(2)
    used, t = np.unique(whole.t[:, :count], return_inverse=True)
    assert_is_the_continuum(ElementMesh(whole.p[:, used], t.reshape(4, -1)), law)


def test_partly_curved_meshes_store_one_frame_or_one_for_each_point():
    assembly = LAWS["isotropic"].bind(PARTLY["partly curved tetrahedra"])
    assert len(set(np.diff(assembly.points.starts))) == 2
    for name, mesh in CURVED.items():
        assert len(set(np.diff(LAWS["isotropic"].bind(mesh).points.starts))) == 1, name
    straight, curved = (LAWS["isotropic"].bind(meshes["quadratic tetrahedra"]) for meshes in (STRAIGHT, CURVED))
    assert 4 * straight._D.size == curved._D.size


@pytest.mark.few
@pytest.mark.parametrize(("name", "law", "kind"), CASES)
def test_quartics_mean_forces_and_damping_agree_with_the_energy(name, law, kind):
    """The quartic, the work of mean forces, damping as `K v` without stress, and clamped stiffnesses agree with the energy."""
    mesh = MESHES[name]
    assembly = LAWS[law].bind(Body(mesh, [], quadrature(mesh, kind)))
    u, v = (state(mesh, seed=seed).reshape(-1, mesh.d) for seed in (4, 9))
    c = assembly.along(u, v)
    for s in (-1.0, 0.5, 2.0):
        assert np.polyval(c[::-1], s) == pytest.approx(assembly.energy_and_force(u + s * v), rel=1e-11)
    mean, weights = np.zeros_like(u), (0.2, 0.8)
    change = assembly.mean_force(u, u + v, weights, 0.5, mean)
    work = assembly.energy_and_force(u + v) - assembly.energy_and_force(u) + (weights[1] - weights[0]) * change
    assert (mean * v).sum() == pytest.approx(work, rel=1e-11) and change > 0
    damping, product = np.zeros_like(u), np.zeros_like(u)
    half = assembly.damping_force(u, v, damping)
    _, blocks = assembly.blocks(u, kept=Tensions(0.0, 0.0))
    assembly.pairs.add_product(blocks, v, product)
    assert_near(damping, product)
    assert 2 * half == pytest.approx((damping * v).sum(), rel=1e-12)


@pytest.mark.few
@pytest.mark.parametrize("name", [name for name, mesh in MESHES.items() if not mesh.element.is_linear_simplex])
def test_the_clamp_scales_eigenvalues_of_the_stress_by_sign(name):
    """The curvature without negative stresses is the largest, and the parts of positive and negative stresses add up.

    In pure tension the clamp changes nothing.
    """
    mesh = MESHES[name]
    assembly = LAWS["isotropic"].bind(mesh)
    v = state(mesh, seed=9).reshape(-1, mesh.d)

    def curvature(u, kept):
        product = np.zeros_like(u)
        assembly.pairs.add_product(assembly.blocks(u, kept=kept)[1], v, product)
        return (v * product).sum()

    u = state(mesh).reshape(-1, mesh.d) - 0.2 * mesh.p.T
    none, tensile, pressed, every = (curvature(u, Tensions(*kept)) for kept in ((0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)))
    assert tensile + pressed - none == pytest.approx(every, rel=1e-11) and pressed < none < tensile
    stretched = 0.3 * mesh.p.T
    assert curvature(stretched, Tensions(1.0, 0.0)) == pytest.approx(curvature(stretched, Tensions(1.0, 1.0)), rel=1e-12)
