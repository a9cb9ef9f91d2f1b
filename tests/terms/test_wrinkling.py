"""Membranes and cables without compression: the relaxed energy in its three states equals independent forms."""

import inspect

import numpy as np
import pytest
import skfem
from bodies import CURVED, MESHES, state
from scipy.optimize import minimize

from skfem_stvk import (
    EdgeNetwork,
    ElementMesh,
    MaterialError,
    Orthotropic,
    StVK,
    System,
    solve_static,
    verify,
)
from skfem_stvk.kernels import tension_fields as stvk
from skfem_stvk.results import Fields

YOUNG, NU, THICKNESS, AREA = 3.0, 0.3, 0.4, 0.5 * (1.7 * 1.1)
#: Corners of one triangle with unequal edges, away from the origin; for bodies in the plane of either orientation, and in space.
CORNERS = np.array([[0.2, 1.9, 0.6], [0.1, 0.1, 1.2]])
#: Principal Green strains E1 >= E2, and the name of the energy that applies: one of three.
STRAINS = {
    "taut": (0.3, 0.1, "taut"),
    "taut, narrower": (0.3, -0.05, "taut"),
    "equal": (0.2, 0.2, "taut"),
    "nearly equal": (0.2, 0.2 - 1e-9, "taut"),
    "just taut": (0.3, -0.09 + 1e-4, "taut"),
    "just wrinkled": (0.3, -0.09 - 1e-4, "wrinkled"),
    "wrinkled": (0.3, -0.3, "wrinkled"),
    "hardly pulled": (1e-4, -0.2, "wrinkled"),
    "large": (4.0, -0.45, "taut"),
    "small": (1e-4, -9e-5, "wrinkled"),
    "just slack": (-1e-4, -0.2, "slack"),
    "slack": (-0.1, -0.3, "slack"),
    "equally slack": (-0.2, -0.2, "slack"),
}


def body_of(space, nu=NU, wrinkling=True):
    """Return a body of one triangle, and its law.

    The triangle is "in the plane", "turned round" (of opposite orientation) or "in space".
    """
    p = CORNERS if space != "in space" else tilt() @ np.vstack([CORNERS, np.zeros(3)])
    t = np.array([[0], [2], [1]] if space == "turned round" else [[0], [1], [2]])
    plane = None if space == "in space" else "stress"
    law = StVK(young=YOUNG, poisson=nu, thickness=THICKNESS, plane=plane, wrinkling=wrinkling)
    return System(ElementMesh(p, t), law), law


def tilt():
    Q = np.linalg.qr(np.random.default_rng(8).standard_normal((3, 3)))[0]
    return Q * np.sign(np.linalg.det(Q))


def strained(space, E1, E2, angle=0.7, rotated=True):
    """Return displacements with the given principal strains, the first at an angle, followed by a rotation of the triangle."""
    c, s = np.cos(angle), np.sin(angle)
    V = np.array([[c, -s], [s, c]])
    F = V @ np.diag(np.sqrt([1 + 2 * E1, 1 + 2 * E2])) @ V.T
    if space == "in space":
        out = (tilt() @ np.vstack([F @ CORNERS, np.zeros(3)])) - tilt() @ np.vstack([CORNERS, np.zeros(3)])
        return out.ravel("F")
    rotation = V.T if rotated else np.eye(2)
    return (rotation @ F @ CORNERS - CORNERS).ravel("F")


def density(E, nu):
    """Return the energy per area of a strain (2, 2) by its definition."""
    E2, E1 = np.linalg.eigvalsh(E)
    if E1 <= 0:
        return 0.0
    if -nu * E1 > E2:
        return YOUNG * THICKNESS * E1**2 / 2
    return YOUNG * THICKNESS / (2 * (1 - nu**2)) * (E1**2 + E2**2 + 2 * nu * E1 * E2)


def area():
    a, b = CORNERS[:, 1] - CORNERS[:, 0], CORNERS[:, 2] - CORNERS[:, 0]
    return abs(a[0] * b[1] - a[1] * b[0]) / 2


@pytest.mark.few
@pytest.mark.parametrize("space", ["in the plane", "turned round", "in space"])
@pytest.mark.parametrize("name", STRAINS)
def test_energy_and_stress_are_those_of_the_state(name, space):
    """Force and stress equal differences of the energy that `density` defines."""
    E1, E2, kind = STRAINS[name]
    (body, _), u = body_of(space), strained(space, E1, E2)
    W, F = body.energy_and_force(u)
    assert pytest.approx(area() * density(np.diag([E1, E2]), NU), rel=1e-10) == W
    if kind == "slack":
        assert W == 0 and not F.any() and not body.tangent(u).data.any()
    step, v = 1e-6 * max(abs(E1), 0.01), state(body.mesh, seed=9)
    slope = (energy_of(body, u + step * v) - energy_of(body, u - step * v)) / (2 * step)
    assert slope == pytest.approx(F @ v, rel=1e-5, abs=1e-9)
    stress = np.linalg.eigvalsh(Fields.of(body).at(u)["pk2_stress"][0])
    scale = YOUNG / (1 - NU**2)
    wanted = {"taut": (scale * (E1 + NU * E2), scale * (E2 + NU * E1)), "wrinkled": (YOUNG * E1, 0), "slack": (0, 0)}[kind]
    assert np.sort(stress) == pytest.approx(np.sort([*wanted, 0.0]), rel=1e-7, abs=1e-7 * YOUNG * abs(E1))


def energy_of(body, u):
    """Return the energy by `density`, with the strain of a triangle from its corners."""
    X, x = body.mesh.p, body.mesh.p + u.reshape(-1, body.mesh.d).T
    P, p = X[:, 1:] - X[:, :1], x[:, 1:] - x[:, :1]
    R = np.linalg.qr(P)[1]
    F = p @ np.linalg.inv(R)
    return area() * density((F.T @ F - np.eye(2)) / 2, NU)


def test_the_energy_is_the_least_of_all_wider_strains():
    """The relaxed energy is the minimum over `D >= 0` of the energy of `E + D` (Pipkin): wrinkles take up the length D."""
    rng = np.random.default_rng(1)
    for nu in (0.3, 0.0, -0.3, 0.49):
        body, _ = body_of("in the plane", nu)
        for E1, E2 in ((0.3, 0.1), (0.3, -0.3), (0.1, -0.02), (-0.1, -0.3)):
            angle = rng.uniform(0, 3)
            c, s = np.cos(angle), np.sin(angle)
            V = np.array([[c, -s], [s, c]])
            E = V @ np.diag([E1, E2]) @ V.T

            def plain(root, E=E, nu=nu):
                L = np.array([[root[0], 0], [root[1], root[2]]])
                A = E + L @ L.T
                return YOUNG * THICKNESS / (2 * (1 - nu**2)) * ((1 - nu) * (A * A).sum() + nu * np.trace(A) ** 2)

            least = min(minimize(plain, rng.uniform(0, 0.6, 3), tol=1e-14).fun for _ in range(4))
            assert body.energy(strained("in the plane", E1, E2, angle)) == pytest.approx(area() * least, rel=1e-5, abs=1e-8)


@pytest.mark.few
@pytest.mark.parametrize("name", ["taut", "equal", "just taut", "just wrinkled", "wrinkled", "large", "small", "hardly pulled"])
@pytest.mark.parametrize("space", ["turned round", "in space"])
def test_the_tangent_is_the_derivative_of_the_force_within_each_state(name, space):
    E1, E2, _ = STRAINS[name]
    (body, _), u = body_of(space), strained(space, E1, E2)
    K, step = body.tangent(u).toarray(), 1e-3 * min(E1, 1e-3)
    for v in np.eye(body.ndofs):
        slope = (body.internal_force(u + step * v) - body.internal_force(u - step * v)) / (2 * step)
        assert np.abs(slope - K @ v).max() < 1e-5 * np.abs(K).max()
    assert np.abs(K - K.T).max() <= 1e-14 * np.abs(K).max()
    assert np.linalg.eigvalsh(K)[0] > -1e-13 * np.abs(K).max()


@pytest.mark.parametrize("border", [(0.3, -0.3 * 0.3), (0.0, -0.2)])
def test_energy_and_force_are_continuous_across_the_borders_and_the_tangent_jumps(border):
    body, _ = body_of("in space")
    (E1, E2), e = border, 1e-8
    here, there = (strained("in space", E1 + a * e, E2 + a * e) for a in (1, -1))
    (W, F), (W1, F1) = body.energy_and_force(here), body.energy_and_force(there)
    K, K1 = body.tangent(here).toarray(), body.tangent(there).toarray()
    assert abs(W - W1) < 10 * e and np.abs(F - F1).max() < 100 * e
    assert np.abs(K - K1).max() > 0.05 * np.abs(K).max()


def law_on(mesh, more, wrinkling=True):
    rng = np.random.default_rng(4)
    return StVK(young=rng.uniform(1, 9, mesh.nt), poisson=rng.uniform(-0.3, 0.45, mesh.nt), wrinkling=wrinkling, **more)


#: Faults in the law; the energy or its derivatives show each fault.
PLANTS = {
    "the border is E2 = 0": ("taut = tense & (m2 >= -nu * n1)", "taut = tense & (m2 >= 0 * n1)"),
    "1 - nu^2 left where it wrinkles": ("n2 = m2 if taut else -nu * n1", "n2 = m2 if taut else 0 * n1"),
    "slack is wrinkled": ("n1 = m1 if tense else zero", "n1 = m1"),
    "no rotation of the axes": ("slope = mu if taut else (S1 - S2) / (m1 - m2 if m1 > m2 else one)", "slope = mu"),
}


@pytest.mark.parametrize("name", PLANTS)
def test_faults_in_the_formulas_are_found(name):
    """A fault in one line of the formulas, run as plain Python, changes energy or slope from those of `density`."""
    source = inspect.getsource(stvk)
    right, wrong = PLANTS[name]
    assert source.count(right) == 1
    one = np.float64(1)
    relaxed = [plain_of(text) for text in (source, source.replace(right, wrong))]
    lam, mu = YOUNG * NU / (1 - NU**2) / 2, YOUNG / (2 * (1 + NU))
    errors = []
    for formulas in relaxed:
        worst = 0.0
        for E1, E2, _ in STRAINS.values():
            S1, S2, _, tense, taut = formulas["_relaxed"](lam, mu, 2 * E1, 2 * E2, one)
            W = (S1 * 2 * E1 + S2 * 2 * E2) / 4
            worst = max(worst, abs(W - density(np.diag([E1, E2]), NU) / THICKNESS), -min(S1, S2))
            if tense and not taut:
                exact = (S1 - S2) / (2 * E1 - 2 * E2)
                slope = eval(
                    formulas["slope"], {"mu": mu, "taut": taut, "S1": S1, "S2": S2, "m1": 2 * E1, "m2": 2 * E2, "one": one}
                )
                worst = max(worst, abs(slope - exact))
        errors.append(worst)
    assert errors[0] < 1e-12 and errors[1] > 1e-3


def plain_of(source):
    """Return the namespace of `_relaxed` from a source as plain Python, with the expression of the slope."""
    begin = source.index("def _relaxed")
    spaces: dict = {}
    exec(source[begin : source.index("@by_type(respond", begin)], spaces)
    line = next(line for line in source.splitlines() if line.strip().startswith("slope ="))
    return spaces | {"slope": line.split("=", 1)[1].strip()}


def test_a_taut_membrane_has_the_law_without_wrinkling():
    """Forces are those of StVK where no element wrinkles; clamped tensions of edges are far from these forces."""
    mesh = MESHES["membrane"]
    laws = law_on(mesh, {}, True), law_on(mesh, {}, False)
    u = 0.3 * mesh.p.ravel("F") + 0.02 * state(mesh)
    relaxed, plain = (System(mesh, law) for law in laws)
    F, wanted = relaxed.internal_force(u), plain.internal_force(u)
    assert np.abs(F - wanted).max() < 1e-13 * np.abs(wanted).max()
    assert np.abs(relaxed.tangent(u).toarray() - plain.tangent(u).toarray()).max() < 1e-12 * np.abs(F).max()
    form = laws[1].bind(mesh).form
    t = form.tensions(u.reshape(-1, 3))
    pull = np.maximum(t, 0)[:, None] * form.differences(mesh.p.T + u.reshape(-1, 3))
    clamped = np.zeros((mesh.nv, 3))
    np.add.at(clamped, form.edges[0], pull)
    np.add.at(clamped, form.edges[1], -pull)
    assert (t < 0).any() and np.abs(clamped.ravel() - wanted).max() > 0.05 * np.abs(wanted).max()


def test_cables_pull_and_do_not_push():
    mesh = ElementMesh(np.array([[0.0, 0, 0], [1.5, 0.5, -0.3]]).T, np.array([[0], [1]]))
    cable, bar = (System(mesh, StVK(young=3.0, area=0.2, wrinkling=wrinkling)) for wrinkling in (True, False))
    X = mesh.p.ravel("F")
    for part, pulled in ((0.2, True), (-0.2, False), (-1.0, False), (-2.1, True)):
        W, F = cable.energy_and_force(part * X)
        assert pytest.approx(bar.energy(part * X) if pulled else 0, rel=1e-13) == W
        assert np.abs(F - (bar.internal_force(part * X) if pulled else 0)).max() < 1e-13


@pytest.mark.parametrize("name", ["membrane", "cable", "quadratic membrane"])
def test_the_work_of_the_mean_force_is_the_energy_difference(name):
    """The work of the mean force is the energy difference, also for elements that have shrunk to a line or to a point."""
    mesh = (MESHES | CURVED)[name]
    body = System(mesh, law_on(mesh, {}))
    (term,), X = body.bound_terms, mesh.p.T
    flat, point = -X * [0, 0, 1] - 0.5 * X * [0, 1, 0], -X
    for u0, u1 in ((0.4 * state(mesh).reshape(X.shape), flat), (point, 0.5 * X), (0.2 * X, point), (flat, point)):
        force = np.zeros_like(X)
        R = term.mean_force(u0, u1, (0.5, 0.5), 0.5, force)
        change = body.energy(u1.ravel()) - body.energy(u0.ravel())
        assert np.isfinite(R) and np.vdot(force, u1 - u0) == pytest.approx(change, abs=1e-13 * (1 + abs(change)))
        assert np.abs(force.sum(axis=0)).max() < 1e-13 * (1 + np.abs(force).max())
        torque = np.einsum("ni,nj->ij", X + (u0 + u1) / 2, force)
        assert np.abs(torque - torque.T).max() < 1e-12 * (1 + np.abs(force).max())


def test_the_abilities_of_a_tension_field():
    term = law_on(MESHES["membrane"], {}).bind(MESHES["membrane"])
    assert term.has_mean_force and not term.quartic and not term.damped
    assert term.smallest_stretch(-0.9 * MESHES["membrane"].p.T) == np.inf
    assert term.symmetric and term.balanced and term.has_energy


def test_laws_without_relaxed_energy_are_refused():
    wood = Orthotropic((4.0, 2.0, 1.0), (0.25, 0.25, 0.125), (1.0, 2.0, 0.5))
    with pytest.raises(MaterialError, match=r"wrinkling=True\): material = Orthotropic\(\.\.\.\); expected Isotropic"):
        StVK(wood, wrinkling=True)
    with pytest.raises(MaterialError, match="wrinkling = 1; expected True or False"):
        StVK(young=1.0, poisson=0.3, wrinkling=1)
    law = StVK(young=1.0, poisson=0.3, wrinkling=True)
    with pytest.raises(MaterialError, match=r"surfaces in space, segments.*the mesh has tetrahedra in 3D\. Leave it out there"):
        System(MESHES["tetrahedra"], law)
    with pytest.raises(MaterialError, match=r"triangles in 2D in plane strain\. Give plane='stress'"):
        System(MESHES["triangles"], law)
    for network in (EdgeNetwork.of, lambda mesh, law: law.coefficients(mesh)):
        with pytest.raises(MaterialError, match="not quadratic in squared lengths"):
            network(MESHES["membrane"], law)
    with pytest.raises(MaterialError, match="expected StVK without wrinkling: verify has no reference for this energy"):
        verify(MESHES["membrane"], law, quiet=True)


def test_a_sheared_sheet_has_the_tension_field_of_an_infinite_strip():
    """With wrinkling, the stress in the middle is that of the closed form; without, the flat sheet is unstable."""
    young, shear = 1e6, 0.2
    flat = skfem.MeshTri.init_tensor(np.linspace(0, 4, 33), np.linspace(0, 1, 9))
    sheet = ElementMesh(np.concatenate([flat.p, np.zeros((1, flat.p.shape[1]))]), flat.t)
    lower, upper = (tuple(np.flatnonzero(flat.p[1] == y)) for y in (0, 1))
    middle = np.flatnonzero(np.abs(sheet.p[0][sheet.t].mean(axis=0) - 2) < 0.5)
    results, principal, forces = [], [], []
    for wrinkling in (True, False):
        law = StVK(young=young, poisson=0.3, thickness=1e-3, wrinkling=wrinkling)
        system = System(sheet, law, fixed={lower: "xyz"}, prescribed={upper: {"x": shear, "y": 0.0, "z": 0.0}})
        results.append(solve_static(system, steps=4, quiet=True, raise_on_failure=False))
        stress = np.linalg.eigvalsh(results[-1].state["pk2_stress"])[middle]
        principal.append(stress.mean(axis=0)[[0, -1]])
        forces.append(float(results[-1].reaction(upper).resultant[0]))
    (across, along), plain = principal
    strain = shear**2 / 4 + np.sqrt(shear**4 / 16 + shear**2 / 4)  # principal strain of an infinite strip
    assert results[0].success and along == pytest.approx(young * strain, rel=0.005) and abs(across) < 1e-6 * along
    assert "unstable" in results[1].status.value and plain[0] < -0.5 * along
    assert forces[0] == pytest.approx(241.8, rel=1e-3) and forces[0] < 0.85 * forces[1]
