"""Laws of principal stretches equal their readable twins and independent forms, in flat, mirrored and hardly strained elements."""

from functools import partial

import numpy as np
import pytest
import skfem
from bodies import CURVED, MESHES, state
from scipy.optimize import minimize
from slow import slow

from skfem_stvk import (
    Corotated,
    ElementMesh,
    InvertibleStVK,
    Isotropic,
    MaterialError,
    Orthotropic,
    StVK,
    StvkError,
    System,
    solve_static,
)
from skfem_stvk.edges import TENSILE, WARPED
from skfem_stvk.results import Fields

LAWS = {"corotated": Corotated, "invertible": InvertibleStVK}


TET = np.array([[0.1, 0, 0], [1.3, 0.2, 0.1], [0.3, 0.9, -0.1], [0.2, 0.1, 1.1]])
LAM, MU = 2.3, 1.1


def one_tet(law, mirrored):
    """Return a body of one tetrahedron of either orientation."""
    p, t = TET.T, np.array([[0], [2], [1], [3]] if mirrored else [[0], [1], [2], [3]])
    material = Isotropic.from_lame(LAM, MU)
    return System(ElementMesh(p, t), LAWS[law](material))


def independent(law, F):
    """Return `w` and P by NumPy's singular values; P is the derivative of `w` by complex steps."""
    U, s, V = np.linalg.svd(F)
    sign = np.sign(np.linalg.det(F)) or 1.0
    U[:, 2] *= np.sign(np.linalg.det(U))
    V[2] *= np.sign(np.linalg.det(V))
    s[2] *= sign

    def w(s):
        if law == "corotated":
            return MU * ((s - 1) ** 2).sum() + LAM / 2 * (s - 1).sum() ** 2
        c = np.where(s.real > 0.6, s, 0.6)
        d, E = s - c, (c**2 - 1) / 2
        wi = c * (LAM * E.sum() + 2 * MU * E)
        wij = LAM * np.outer(c, c) * (1 - np.eye(3))
        return LAM / 2 * E.sum() ** 2 + MU * (E**2).sum() + wi @ d + d @ wij @ d / 2 + (LAM / 2 + MU) * (d**2).sum()

    p = [w(s + 1e-30j * e).imag / 1e-30 for e in np.eye(3)]
    return w(s), U @ np.diag(p) @ V


def rotation(seed):
    Q = np.linalg.qr(np.random.default_rng(seed).standard_normal((3, 3)))[0]
    return Q * np.sign(np.linalg.det(Q))


STRETCHES = {
    "moderate": (1.3, 1.1, 0.8),
    "equal": (1.4, 1.4, 1.4),
    "two equal": (1.4, 0.7, 0.7),
    "two equal below the threshold": (1.2, 0.3, 0.3),
    "on the threshold": (1.2, 1.1, 0.6),
    "nearly flat": (1.2, 0.9, 1e-9),
    "flat": (1.2, 0.9, 0.0),
    "mirrored": (1.2, 0.9, -0.7),
    "nearly a line": (1.2, 1e-4, 1e-9),
    "small": (1e-3, 2e-4, 1e-5),
    "large": (1e3, 2e2, 1.0),
}


@pytest.mark.few
@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("name", STRETCHES)
@pytest.mark.parametrize("law", LAWS)
def test_energy_and_force_are_those_of_singular_values(law, name, mirrored):
    """Energy and force are those of `w` and P by singular values.

    As in finite volumes (Teran et al. 2003), the force at a node is P times a third of the area vectors around the node.
    """
    body = one_tet(law, mirrored)
    F = rotation(1) @ np.diag(STRETCHES[name]) @ rotation(2)
    W, force = body.energy_and_force((TET @ F.T - TET).ravel())
    w, P = independent(law, F)
    vectors = (TET[1:] - TET[0]).T
    volume = abs(np.linalg.det(vectors)) / 6
    assert pytest.approx(volume * w, rel=1e-12) == W
    areas = -volume * np.linalg.inv(vectors)  # a third of the sum of the area vectors of the three facets at a node
    wanted = -areas @ P.T
    s = np.sort(STRETCHES[name])
    known = 3e-13 + 1e-16 * s[2] / (s[0] + s[1])  # the directions of two small stretches are no more accurate
    assert force.reshape(4, 3)[1:] == pytest.approx(wanted, abs=known * np.abs(wanted).max())


@pytest.mark.few
@pytest.mark.parametrize(
    "name", [name for name in STRETCHES if name not in ("on the threshold", "nearly a line", "flat", "nearly flat")]
)
@pytest.mark.parametrize("law", LAWS)
def test_the_tangent_is_the_derivative_of_the_force_where_stretches_are_alike_or_mirrored(law, name):
    body, v = one_tet(law, False), np.random.default_rng(5).standard_normal(12)
    s = np.array(STRETCHES[name])
    u, h = (TET @ (rotation(1) @ np.diag(s) @ rotation(2)).T - TET).ravel(), 1e-4 * np.abs(s).min()
    slope = sum(w * (body.internal_force(u + n * h * v) - body.internal_force(u - n * h * v)) for n, w in {1: 8, 2: -1}.items())
    Kv = body.tangent(u) @ v
    assert Kv == pytest.approx(slope / (12 * h), abs=2e-7 * np.abs(Kv).max())


@pytest.mark.parametrize("law", LAWS)
def test_a_flat_element_has_one_rotation_and_finite_forces(law):
    """Forces are finite in flat elements, also where an element degenerates to a line or a point and the rotation is not unique."""
    body = one_tet(law, False)
    for rank in (2, 1, 0):
        F = rotation(1) @ np.diag([1.2, 0.9, 0.7] * (np.arange(3) < rank)) @ rotation(2)
        W, force = body.energy_and_force((TET @ F.T - TET).ravel())
        w, _ = independent(law, F)
        volume = abs(np.linalg.det(TET[1:] - TET[0])) / 6
        assert pytest.approx(volume * w, rel=1e-12) == W and np.isfinite(force).all() and np.abs(force).max() > 0.1
        lowest, highest = np.linalg.eigvalsh(body.jacobian((TET @ F.T - TET).ravel(), kept=TENSILE).toarray())[[0, -1]]
        assert lowest > -1e-13 * highest


@pytest.mark.few
@pytest.mark.parametrize("offset", [0.0, 2.0**20])
@pytest.mark.parametrize("strain", [1e-3, 1e-12])
@pytest.mark.parametrize("name", ["tetrahedra", "triangles", "membrane", "hexahedra"])
@pytest.mark.parametrize("law", LAWS)
def test_small_strains_have_the_forces_of_linear_elasticity(law, name, strain, offset):
    """At small strains, forces equal those of linear elasticity up to the nonlinear part, far from the origin as near it."""
    mesh = (MESHES | CURVED)[name]
    p = np.round(mesh.p * 2**20) / 2**20  # adding the offset is exact
    mesh = ElementMesh(p + offset, mesh.t, element=mesh.element)
    body, rest = System(mesh, LAWS[law](young=3.0, poisson=0.3)), System(mesh, StVK(young=3.0, poisson=0.3))
    u = strain * state(mesh)
    linear = rest.tangent(np.zeros(body.ndofs)) @ u
    assert body.internal_force(u) == pytest.approx(linear, abs=(1e-13 + 20 * strain) * np.abs(linear).max())
    K, K0 = body.tangent(u), rest.tangent(np.zeros(body.ndofs))
    assert abs(K - K0).max() < (1e-13 + 20 * strain) * abs(K0).max()


def test_plane_stress_of_corotated_elements_is_exact():
    """The minimum over the stretch across has the energy of plane stress, at any strain: `lam` becomes 2 mu lam/(lam + 2 mu)."""
    material = Isotropic.from_lame(LAM, MU)
    body = System(
        ElementMesh(np.array([[0.0, 1, 0.2], [0, 0.1, 0.9]]), np.array([[0], [1], [2]])), Corotated(material, plane="stress")
    )
    x = body.mesh.p.T
    for s in ((1.7, 0.6), (0.4, 0.5), (1.0, -0.3)):
        F = rotation(3)[:2, :2]
        F = np.linalg.qr(F)[0]
        F = F * [1, np.linalg.det(F)] @ np.diag(s)
        least = minimize(
            lambda z, s=s: MU * ((np.array([*s, z[0]]) - 1) ** 2).sum() + LAM / 2 * (sum(s) + z[0] - 3) ** 2, [1.0], tol=1e-14
        )
        area = np.linalg.det((x[1:] - x[0]).T) / 2
        assert body.energy((x @ F.T - x).ravel()) == pytest.approx(area * least.fun, rel=1e-9)


def block(n=2):
    mesh = skfem.MeshTet.init_tensor(*[np.linspace(0, 1, n + 1)] * 3)
    return mesh.with_boundaries({"left": lambda x: x[0] < 1e-9})


@pytest.mark.parametrize("law", LAWS.values())
def test_only_isotropic_materials(law):
    material = Orthotropic(young=(9.0, 2.0, 1.0), poisson=(0.3, 0.2, 0.1), shear=(0.5, 0.6, 0.7))
    with pytest.raises(MaterialError, match=rf"{law.__name__}: material = Orthotropic\(\.\.\.\); expected Isotropic"):
        System(MESHES["tetrahedra"], law(material))


@pytest.mark.parametrize("threshold", [0.5, 3**-0.5, 1.0, 1.2, float("nan"), "high"])
def test_thresholds_where_stress_falls_are_refused(threshold):
    with pytest.raises(MaterialError, match=r"threshold .* 1/sqrt\(3\) = 0.577"):
        InvertibleStVK(young=1.0, poisson=0.3, threshold=threshold)


def test_above_the_threshold_the_law_is_st_venant_kirchhoff():
    mesh = MESHES["tetrahedra"]
    u = 0.1 * state(mesh)
    bodies = [System(mesh, law(young=3.0, poisson=0.3)) for law in (StVK, InvertibleStVK)]
    assert bodies[0].smallest_stretch(u) > 0.6
    (W, F), (w, f) = (body.energy_and_force(u) for body in bodies)
    assert w == pytest.approx(W, rel=1e-13) and f == pytest.approx(F, abs=1e-13 * np.abs(F).max())
    K, k = (body.tangent(u) for body in bodies)
    assert abs(K - k).max() < 1e-12 * abs(K).max()


def rotated(mesh, amount=0.05, seed=3):
    """Return displacements of a rotated and slightly strained body, and the rotation."""
    R, x = rotation(seed)[: mesh.d, : mesh.d], mesh.p.T
    R = np.linalg.qr(R)[0]
    R[:, 0] *= np.sign(np.linalg.det(R))
    return ((x + amount * state(mesh).reshape(-1, mesh.d)) @ R.T - x).ravel(), R


def by_node(K, R):
    """Return `R K R'` for one rotation of all nodes."""
    d, nv = len(R), len(K) // len(R)
    return np.einsum("ij,ajbk,lk->aibl", R, K.reshape(nv, d, nv, d), R).reshape(K.shape)


@pytest.mark.parametrize("material", ["isotropic", "orthotropic"])
@pytest.mark.parametrize("name", ["tetrahedra", "triangles", slow("quadratic tetrahedra"), slow("hexahedra")])
def test_the_warped_tangent_of_a_rotated_body_is_the_rotated_one_at_rest(name, material):
    mesh = (MESHES | CURVED)[name]
    orthotropic = Orthotropic(young=(9.0, 2.0, 1.0), poisson=(0.3, 0.2, 0.1), shear=(0.5, 0.6, 0.7))
    body = System(mesh, StVK(Isotropic(2.0, 0.3) if material == "isotropic" else orthotropic))
    u, R = rotated(mesh, 0.0)
    K0 = body.tangent(np.zeros(body.ndofs)).toarray()
    assert body.jacobian(u, kept=WARPED).toarray() == pytest.approx(by_node(K0, R), abs=1e-12 * np.abs(K0).max())
    u, R = rotated(mesh, 0.3)
    K = body.jacobian(u, kept=WARPED).toarray()
    lowest, highest = np.linalg.eigvalsh(K)[[0, -1]]
    assert np.abs(K - K.T).max() < 1e-14 * highest and lowest > -1e-13 * highest
    assert 1e-3 < np.abs(K - by_node(K0, R)).max() / np.abs(K).max() < 0.5


def test_the_warped_tangent_of_corotated_elements_is_near_their_own():
    mesh = MESHES["tetrahedra"]
    law, stvk = Corotated(young=2.0, poisson=0.3), StVK(young=2.0, poisson=0.3)
    u, _ = rotated(mesh, 0.3)
    exact, warped = System(mesh, law).tangent(u), System(mesh, law).jacobian(u, kept=WARPED)
    assert abs(warped - System(mesh, stvk).jacobian(u, kept=WARPED)).max() < 1e-12 * abs(warped).max()
    assert 0.01 < np.linalg.norm((exact - warped).toarray()) / np.linalg.norm(exact.toarray()) < 0.3


@pytest.mark.parametrize("name", ["tetrahedra", "triangles"])
def test_rotations_at_nodes_follow_rigid_rotations_but_torques_do_not_balance(name):
    mesh = MESHES[name]
    body = System(mesh, Corotated(young=2.0, poisson=0.3, rotation="vertex"))
    u, _ = rotated(mesh, 0.0)
    assert np.abs(body.internal_force(u)).max() < 1e-13
    u, _ = rotated(mesh, 0.4)
    F, x = body.internal_force(u).reshape(-1, mesh.d), mesh.p.T + u.reshape(-1, mesh.d)
    torque = np.einsum("ni,nj->ij", x, F)
    assert np.abs(torque - torque.T).max() > 1e-3 * np.abs(torque).max()
    with pytest.raises(StvkError, match="Corotated 0 has no energy"):
        body.potential(u)
    small = 1e-7 * state(mesh)
    K0 = System(mesh, StVK(young=2.0, poisson=0.3)).tangent(np.zeros(body.ndofs))
    assert body.internal_force(small) == pytest.approx(K0 @ small, abs=1e-5 * np.abs(K0 @ small).max())


@pytest.mark.parametrize("name", ["membrane", "cable", "segments"])
def test_rotations_at_nodes_need_elements_that_fill_their_space(name):
    with pytest.raises(MaterialError, match="rotation='vertex'"):
        System(MESHES[name], Corotated(young=2.0, poisson=0.3, rotation="vertex"))


def spin(t):
    return np.array([[np.cos(t), -np.sin(t), 0], [np.sin(t), np.cos(t), 0], [0, 0, 1.0]])


@pytest.mark.parametrize("name", ["tetrahedra", "hexahedra", "quadratic tetrahedra"])
def test_user_supplied_frames_rotate_linear_elasticity(name):
    mesh = (MESHES | CURVED)[name]
    body = System(mesh, Corotated(young=2.0, poisson=0.3, rotation=lambda t: np.broadcast_to(spin(t), (mesh.nt, 3, 3))))
    K0 = System(mesh, StVK(young=2.0, poisson=0.3)).tangent(np.zeros(body.ndofs)).toarray()
    u, x = 0.3 * state(mesh), mesh.p.T
    for t in (0.0, 0.7, 2.0):
        force = body.residual(u, t)
        wanted = (K0 @ ((x + u.reshape(-1, 3)) @ spin(t) - x).ravel()).reshape(-1, 3) @ spin(t).T
        assert force.reshape(-1, 3) == pytest.approx(wanted, abs=1e-12 * np.abs(wanted).max())
        assert body.jacobian(u, t).toarray() == pytest.approx(by_node(K0, spin(t)), abs=1e-12 * np.abs(K0).max())


def test_a_law_in_frames_is_unchanged_by_calls_at_other_times():
    mesh = MESHES["tetrahedra"]
    law = Corotated(young=2.0, poisson=0.3, rotation=lambda t: np.broadcast_to(spin(t), (mesh.nt, 3, 3)))
    body, fresh, u = System(mesh, law), System(mesh, law), 0.3 * state(mesh)
    at_one = body.internal_force(u, 1.0)
    body.jacobian(u, 2.0)
    body.product(u, u, 0.7)
    assert np.array_equal(body.internal_force(u), fresh.internal_force(u)) and np.array_equal(body.internal_force(u, 1.0), at_one)
    assert np.array_equal(body.tangent(u).data, fresh.tangent(u).data) and np.array_equal(body.product(u, u), fresh.product(u, u))
    assert np.abs(at_one - fresh.internal_force(u)).max() > 0.1 * np.abs(at_one).max()


def test_a_body_follows_user_supplied_frames():
    """In statics, a body follows user-supplied frames without stress if three nodes are prescribed to rotate with the frames."""
    mesh = block()
    x, n = mesh.p.T, mesh.t.shape[1]
    law = Corotated(young=1e3, poisson=0.3, density=1.0, rotation=lambda t: np.broadcast_to(spin(0.5 * t), (n, 3, 3)))
    corners = [int(np.argmin(((x - corner) ** 2).sum(axis=1))) for corner in ([0, 0, 0], [1, 0, 0], [0, 1, 0])]
    body = System(mesh, law, prescribed={tuple(corners): lambda X, t: spin(0.5 * t) @ X - X})
    found = solve_static(body, quiet=True)
    assert found.u.reshape(-1, 3) == pytest.approx(x @ spin(0.5).T - x, abs=1e-9)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (lambda n: np.ones((n, 3)), "expected an array of shape"),
        (lambda n: np.eye(3), "expected an array of shape"),
        (lambda n: 2 * np.broadcast_to(np.eye(3), (n, 3, 3)), r"no rotation of \d+ elements \(0, 1"),
        (lambda n: np.diag([1, 1, -1.0]) + np.zeros((n, 1, 1)), "determinant"),
        (lambda n: np.eye(3) + np.where(np.arange(n) == 4, np.nan, 0)[:, None, None], r"no rotation of (1 )?element"),
        (lambda n: "round", "expected an array of shape"),
    ],
)
def test_invalid_rotations_are_refused_with_their_elements(given, message):
    mesh = MESHES["tetrahedra"]
    with pytest.raises(MaterialError, match=message):
        System(mesh, Corotated(young=2.0, poisson=0.3, rotation=lambda t: given(mesh.nt)))


@pytest.mark.parametrize("name", ["tetrahedra", "triangles"])
@pytest.mark.parametrize("law", [partial(Corotated, rotation="vertex"), partial(InvertibleStVK, extend="stress")])
def test_fields_are_masked_only_on_elements_of_laws_without_stress(law, name):
    mesh = MESHES[name]
    half, others, u = np.arange(mesh.nt // 2), np.arange(mesh.nt // 2, mesh.nt), 0.2 * state(mesh)
    mixed = Fields(mesh, [law(young=3.0, poisson=0.3, region=half), StVK(young=3.0, poisson=0.3)]).at(u)
    whole = Fields(mesh, StVK(young=3.0, poisson=0.3)).at(u)
    for field in ("pk2_stress", "von_mises_stress", "strain_energy_density"):
        assert np.ma.getmaskarray(mixed[field])[half].all() and not np.ma.getmaskarray(mixed[field])[others].any()
        np.testing.assert_array_equal(mixed[field][others], whole[field][others])
    np.testing.assert_array_equal(mixed["volume_ratio"][others], whole["volume_ratio"][others])


def test_stresses_are_masked_if_frames_are_not_those_of_the_elements():
    with pytest.raises(MaterialError, match="stresses exist only for rotation='element'"):
        Corotated(young=3.0, poisson=0.3, rotation="vertex").response(None)


@pytest.mark.few
@pytest.mark.parametrize("name", STRETCHES)
def test_extended_stresses_have_the_forces_of_the_area_vectors_and_no_energy(name):
    """Above the threshold extended stresses are those of the energy; below, each principal stress is continued linearly.

    The extended stresses have no energy.
    """
    F, s = rotation(1) @ np.diag(STRETCHES[name]) @ rotation(2), np.array(STRETCHES[name])
    mesh = ElementMesh(TET.T, np.array([[0], [1], [2], [3]]))
    body = System(mesh, InvertibleStVK(Isotropic.from_lame(LAM, MU), extend="stress"))
    c = np.maximum(s, 0.6)
    E = (c**2 - 1) / 2
    p = c * (LAM * E.sum() + 2 * MU * E) + (LAM + 2 * MU) * (s - c)
    P = rotation(1) @ np.diag(p) @ rotation(2)
    vectors = (TET[1:] - TET[0]).T
    wanted = abs(np.linalg.det(vectors)) / 6 * np.linalg.inv(vectors) @ P.T
    u = (TET @ F.T - TET).ravel()
    assert body.internal_force(u).reshape(4, 3)[1:] == pytest.approx(wanted, abs=1e-11 * np.abs(wanted).max())
    assert np.isnan(body.energies(u)["InvertibleStVK 0"]) and not body.conservative
    with pytest.raises(StvkError, match="InvertibleStVK 0 has no energy"):
        body.energy(u)
