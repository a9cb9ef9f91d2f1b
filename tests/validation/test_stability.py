"""Studies of stability: closed forms, independent solves and quick versions are correct, and the studies detect errors."""

from types import SimpleNamespace

import numpy as np
import pytest
import skfem
from scipy.integrate import quad, solve_ivp
from scipy.spatial.transform import Rotation
from slow import slow

from skfem_stvk import Corotated, StVK, System
from skfem_stvk.results import Fields
from validation import stability
from validation.stability import arch, column, corotated, dome, ellipticity, independent, law, picture, post_buckling, snap_through
from validation.stability.limit_points import Convergence, wrong
from validation.stability.not_found import NotFoundError
from validation.stability.studies import run
from validation.statics.meshes import moved_box

LAM, MU = 1.3, 0.8


def a_result(*kinds, t=1.0, smallest=0.5):
    """Return a stand-in for a path with critical points of these kinds."""
    points = tuple(SimpleNamespace(kind=kind, t=t, resolved=True) for kind in kinds)
    step = SimpleNamespace(smallest_volume_ratio=smallest)
    return SimpleNamespace(critical_points=points, history=[step], message="It ended.")


# closed forms


@pytest.mark.parametrize("bar", snap_through.BARS)
def test_the_closed_form_of_the_bar_is_the_force_of_its_edge(bar):
    for depth in bar.rise * np.array([-0.3, 0.2, 0.9, 1.7, 2.2]):
        force = -bar.system().internal_force([0, 0, 0, -depth])[3]
        assert force == pytest.approx(float(bar.force(depth)), rel=1e-12, abs=1e-12 * bar.limit_load)
    np.testing.assert_allclose(bar.force(np.array(bar.limit_points)) / bar.limit_load, [1, -1], rtol=1e-13)
    for point in bar.limit_points:
        nearby = bar.force(point + 1e-5 * bar.rise * np.array([-1, 1]))
        assert abs(np.diff(nearby)[0]) < 1e-12 * bar.limit_load


def test_the_theory_of_shallow_arches_is_the_derivative_of_its_energy():
    body = arch.Arch(37)
    e, h, E = body.rise, body.thickness, arch.STIFFNESS

    def energy(b):
        def bending(x):
            return E * h**3 / 24 * ((b - e) * 2 * np.pi**2 * np.cos(2 * np.pi * x)) ** 2

        stretched = quad(lambda x: (b**2 - e**2) / 2 * (np.pi * np.sin(2 * np.pi * x)) ** 2, 0, 1)[0]
        return quad(bending, 0, 1)[0] + E * h / 2 * stretched**2

    for b in e * np.array([0.9, 0.3, -0.6]):
        step = 1e-4 * e
        slope = (8 * (energy(b + step) - energy(b - step)) - (energy(b + 2 * step) - energy(b - 2 * step))) / (12 * step)
        assert slope == pytest.approx(-float(body.load(b)) / 4, rel=1e-9)  # the load's work is q L (e - b)/4
    nearby = body.load(body.limit_rise + 1e-6 * np.array([-1, 1]) * e)
    assert abs(np.diff(nearby)[0]) < 1e-10 * body.load(body.limit_rise)


def test_the_arch_has_its_thickness_normal_to_the_middle_line():
    body, a, step = arch.Arch(), np.linspace(0, 1, 41), 1e-6
    across = np.subtract(body.map_to_arch(a, 1.0), body.map_to_arch(a, 0.0))
    along = np.subtract(body.map_to_arch(a + step, 0.5), body.map_to_arch(a - step, 0.5)) / (2 * step)
    np.testing.assert_allclose(np.hypot(*across), body.thickness, rtol=1e-12)
    assert np.abs((across * along).sum(axis=0)).max() < 1e-9 * body.thickness
    np.testing.assert_allclose(body.map_to_arch(a, 0.5)[1], body.rise * np.sin(np.pi * a) ** 2, atol=1e-15)


def test_the_arch_would_leave_its_path_only_after_the_limit_point():
    body = arch.Arch()
    thrust = np.pi**2 / 4 * arch.STIFFNESS * body.thickness * (body.rise**2 - body.limit_rise**2)
    sideways = (
        8.183 * np.pi**2 * arch.STIFFNESS * body.thickness**3 / 12
    )  # the second load of a clamped beam, tan z = z at z = 4.4934
    assert pytest.approx(4 * 4.493409458**2 / np.pi**2, rel=1e-4) == 8.183 and thrust < sideways


@pytest.mark.parametrize("angle", [5, 40, 80, 120])
def test_elliptic_integrals_solve_the_equation_of_the_elastica(angle):
    exact = post_buckling.elastica(angle)
    P = exact.load * np.pi**2 / 4

    def slope(s, y):
        theta, bend = y[:2]
        return [bend, -P * np.sin(theta), np.cos(theta), np.sin(theta)]

    end = solve_ivp(slope, (0, 1), [np.radians(angle), 0, 0, 0], rtol=1e-12, atol=1e-13).y[:, -1]  # from the head to the clamp
    assert abs(end[0]) < 1e-9
    np.testing.assert_allclose([1 - end[2], end[3]], [exact.shortening, exact.deflection], atol=1e-10)


def acoustic_minimum(F, lam, mu, directions):
    E = (F.T @ F - np.eye(len(F))) / 2
    S = lam * np.trace(E) * np.eye(len(F)) + 2 * mu * E
    f = directions @ F.T
    Q = (
        (lam + mu) * f[:, :, None] * f[:, None]
        + mu * F @ F.T
        + np.einsum("ni,ij,nj->n", directions, S, directions)[:, None, None] * np.eye(len(F))
    )
    return np.linalg.eigvalsh(Q)[:, 0].min()


@pytest.mark.few
@pytest.mark.parametrize("nu", [0.0, 0.2, 0.3, 0.45])
@pytest.mark.parametrize("case", ellipticity.CASES, ids=lambda case: case.name)
def test_ellipticity_is_lost_at_the_closed_stretches(case, nu):
    lam, mu = 2 * nu / (1 - 2 * nu), 1.0
    angles = np.linspace(0, np.pi, 4001)
    directions = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    if case.k == 3:
        directions = np.pad(directions, ((0, 0), (0, 1)))
        elsewhere = np.random.default_rng(0).standard_normal((20_000, 3))
        directions = np.concatenate([directions, elsewhere / np.linalg.norm(elsewhere, axis=1)[:, None]])
    s = case.critical(nu)
    values = [acoustic_minimum(np.diag(case.stretches(s * (1 + step))), lam, mu, directions) for step in (1e-5, -1e-5)]
    assert values[0] > 0 > values[1]


def test_the_stretches_equal_the_tabulated_values():
    np.testing.assert_allclose([ellipticity.uniaxial(nu) for nu in (0, 0.3, 0.45)], (0.586, 0.706, 0.906), atol=5e-4)


@pytest.mark.parametrize("case", law.CASES, ids=lambda case: case.name)
def test_the_laws_cases_are_homogeneous_states(case):
    k = len(case.vertices[0])
    p, nu, s = np.array(case.vertices).T, 0.3, 0.8
    lateral = {"uniaxial stress": 1 - nu * (s * s - 1), "free to one side": 1 - nu / (1 - nu) * (s * s - 1)}
    t = next((np.sqrt(value) for name, value in lateral.items() if case.name.startswith(name)), 1.0)
    F = np.diag([s, t, t][:k])
    system = System((p, np.arange(k + 1)[:, None]), StVK(young=law.YOUNG, poisson=nu, **case.options))
    force = system.internal_force(((F - np.eye(k)) @ p).T.ravel()).reshape(-1, k)
    expected = law.YOUNG * case.modulus(nu) / 2 * s * (s * s - 1) * case.section
    assert force[-1, 0] == pytest.approx(expected, rel=1e-12)
    free = [(vertex, "xyz".index(c)) for vertex in range(k + 1) for c in "xyz"[:k] if c not in case.constrained[vertex]]
    assert all(abs(force[index]) < 1e-12 * abs(expected) for index in free if index != (k, 0))


# independent solves


@pytest.mark.parametrize("k", [2, 3])
def test_the_independent_force_and_tangent_equal_those_of_the_edge_form(k):
    mesh = moved_box(k, 2)
    cells, element = (skfem.MeshTri, skfem.ElementTriP1) if k == 2 else (skfem.MeshTet, skfem.ElementTetP1)
    basis = skfem.Basis(cells(mesh.p, mesh.t), skfem.ElementVector(element()), intorder=1)
    body = independent.Body(basis, LAM, MU, basis.zeros(), np.arange(basis.N), 0)
    nu = LAM / (2 * (LAM + MU))
    system = System(mesh, StVK(young=2 * MU * (1 + nu), poisson=nu))
    u = 0.2 * np.random.default_rng(1).standard_normal(basis.N)
    force, K = body.force_and_tangent(u)
    np.testing.assert_allclose(force, system.internal_force(u), atol=1e-13 * np.abs(force).max())
    assert abs(K - system.tangent(u)).max() < 1e-13 * abs(K).max()


def section():
    """Return a body of quadratic triangles on 0.5 < r < 1.3, -0.2 < z < 0.4."""
    mesh = skfem.MeshTri.init_tensor(np.linspace(0.5, 1.3, 4), np.linspace(-0.2, 0.4, 3))
    basis = skfem.Basis(mesh, skfem.ElementVector(skfem.ElementTriP2()), intorder=6)
    return independent.Body(basis, LAM, MU, basis.zeros(), np.arange(basis.N), 0, independent.axisymmetric)


def test_the_work_of_axisymmetric_forces_is_the_work_of_the_stress():
    body, (a, b) = section(), (0.2, -0.1)
    widened, raised = (
        body.basis.project(move) for move in (lambda x: np.stack([x[0], 0 * x[1]]), lambda x: np.stack([0 * x[0], x[1]]))
    )
    F = np.diag([1 + a, 1 + b, 1 + a])
    E = (F @ F - np.eye(3)) / 2
    P = F @ (LAM * np.trace(E) * np.eye(3) + 2 * MU * E)
    volume = np.pi * (1.3**2 - 0.5**2) * 0.6
    force, _ = body.force_and_tangent(a * widened + b * raised)
    assert force @ widened == pytest.approx((P[0, 0] + P[2, 2]) * volume, rel=1e-10)
    assert force @ raised == pytest.approx(P[1, 1] * volume, rel=1e-10)


def test_the_axisymmetric_tangent_is_the_derivative_of_the_force():
    body, rng = section(), np.random.default_rng(2)
    u, v, step = *(0.1 * rng.standard_normal((2, body.basis.N))), 1e-3
    forces = {m: body.force_and_tangent(u + m * step * v)[0] for m in (-2, -1, 1, 2)}
    difference = (8 * (forces[1] - forces[-1]) - (forces[2] - forces[-2])) / (12 * step)  # exact: the force is cubic
    K = body.force_and_tangent(u)[1]
    np.testing.assert_allclose(K @ v, difference, atol=1e-11 * np.abs(difference).max())
    assert abs(K - K.T).max() < 1e-13 * abs(K).max()


def test_displacement_control_finds_the_limit_point_of_a_bar():
    bar = snap_through.BARS[0]
    system = bar.system()
    body = SimpleNamespace(
        basis=SimpleNamespace(zeros=lambda: np.zeros(4)),
        free=np.array([3]),
        control=3,
        load=system.external_force(np.zeros(4)),
        force_and_tangent=lambda u: (system.internal_force(u), system.tangent(u)),
    )
    point = independent.limit_point(body, -np.linspace(0.1, 1, 5))
    assert point.t == pytest.approx(1, abs=1e-12) and -point.w == pytest.approx(bar.limit_points[0], abs=1e-9)
    with pytest.raises(NotFoundError, match="no limit point"):
        independent.limit_point(body, -np.linspace(0.1, 0.3, 3))


def test_the_dome_is_a_quarter_of_a_cap():
    mesh = dome.mesh_of(8, 2)
    a, b, c, d = (mesh.p[:, corner] for corner in mesh.t)
    volumes = np.abs(np.einsum("ij,ij->j", np.cross(b - a, c - a, axis=0), d - a)) / 6
    assert volumes.min() > 0.5 * volumes.max()
    assert volumes.sum() == pytest.approx(np.pi / 4 * dome.RADIUS**2 * dome.THICKNESS, rel=0.01)
    np.testing.assert_allclose(mesh.p[:, dome._apex(mesh.p)], [0, 0, dome.RISE], atol=1e-15)
    rims = [int(where(mesh.p).sum()) for where in dome.SUPPORTS]
    assert rims == [17 * 3, 9 * 3, 9 * 3]


# the studies


@pytest.mark.few
@pytest.mark.parametrize(
    "study",
    [
        snap_through.snap_through,
        slow(arch.arch),
        slow(dome.dome),
        column.column,
        corotated.corotated,
        post_buckling.post_buckling,
        law.law,
        ellipticity.ellipticity,
    ],
    ids=lambda study: study.__name__,
)
def test_the_claim_holds(study):
    found = study(quick=True)
    assert found.passed, found.failures


# detection of errors


def test_another_bar_is_detected(monkeypatch):
    monkeypatch.setattr(snap_through, "BARS", snap_through.BARS[:1])
    right = snap_through.Bar.system
    monkeypatch.setattr(snap_through.Bar, "system", lambda bar: right(bar._replace(rise=(1 + 1e-9) * bar.rise)))
    failures = snap_through.snap_through().failures
    assert "distance from the path" in failures[0] and "limit point at" in failures[1]


def test_a_missing_limit_point_is_detected():
    assert not list(wrong(a_result("limit point", "limit point")))
    assert "expected 2" in next(wrong(a_result("limit point")))
    assert "bifurcation" in next(wrong(a_result("limit point", "bifurcation")))
    assert "nothing found" in next(wrong(a_result()))
    assert "inverted" in next(wrong(a_result("limit point", "limit point", smallest=-0.1)))


def test_an_error_of_one_percent_in_the_limit_load_is_detected():
    values = [1 + 0.3 * h**2 - 0.02 * h**4 for h in (1, 0.5, 0.25)]
    assert not list(Convergence(values, 1.0).failures(1e-3, (2.0, 0.15)))
    assert "extrapolated" in next(Convergence(values, 1.01).failures(1e-3, (2.0, 0.15)))
    assert "order 1.0" in next(Convergence([2.0, 1.5, 1.25], 1.0).failures(1.0, (2.0, 0.15)))


def stub_arch(monkeypatch, theory=1.0, loads=(1.284873, 1.053216, 1.000735)):
    results = iter(a_result("limit point", t=load) for load in loads)
    monkeypatch.setattr(arch, "followed", lambda *mesh, count: next(results))
    quadratic = {50: 0.98342, 100: 0.996135}
    monkeypatch.setattr(arch, "quadratic", lambda body, n: SimpleNamespace(t=theory * quadratic[body.slenderness]))
    return arch.arch(quick=True).failures


def test_an_error_of_one_percent_in_the_arch_is_detected(monkeypatch):
    assert not stub_arch(monkeypatch)
    assert len(stub_arch(monkeypatch, theory=1.01)) == 3
    assert len(stub_arch(monkeypatch, loads=np.array((1.284873, 1.053216, 1.000735)) * 0.99)) >= 1


def test_an_error_of_three_millionths_in_the_dome_is_detected(monkeypatch):
    loads, twin = iter((3.490109, 2.621697)), SimpleNamespace(t=3.490109 * (1 + 3e-6))
    monkeypatch.setattr(dome, "followed", lambda *mesh, count: a_result("limit point", t=next(loads)))
    monkeypatch.setattr(dome, "axisymmetric", lambda n, m: SimpleNamespace(t=2.35017))
    monkeypatch.setattr(dome, "tetrahedra", lambda n, m: twin)
    monkeypatch.setattr(independent, "limit_point", lambda body, depths: body)
    (failure,) = dome.dome(quick=True).failures
    assert "by displacement control" in failure


def test_a_wrong_moment_of_inertia_is_detected(monkeypatch):
    monkeypatch.setattr(column, "FINE", (2, 4))
    wrong_load = property(lambda body: np.pi**2 * column.YOUNG * body.height**3 / 11.9 / 4)
    monkeypatch.setattr(column.Column, "euler_load", wrong_load)
    failures = column.column(quick=True).failures
    assert any("thin columns" in failure for failure in failures)


def test_critical_loads_of_the_straight_column_are_the_bifurcations_of_its_path():
    body = column.Column(corotated.SLENDERNESS, 2)
    found = corotated.critical_load(body.mesh(), StVK(young=column.YOUNG, poisson=0.0))
    assert found == pytest.approx(body.buckled().t, rel=1e-5)


def test_another_stiffness_of_corotated_columns_is_detected(monkeypatch):
    monkeypatch.setattr(corotated, "meshes", lambda: {"quadratic triangles, 2 through h": column.Column(20, 2).mesh()})
    monkeypatch.setitem(corotated.LAWS, "Corotated", lambda young, poisson: Corotated(young=1.01 * young, poisson=poisson))
    failures = corotated.corotated().failures
    assert len(failures) == 2 and "StVK 1.7468" in failures[0] and "1.7468" in failures[1]


def test_another_mode_is_detected():
    body = column.Column(20, 2)
    deflection = np.zeros((body.mesh().nv, 2))
    x = body.mesh().p[0]
    deflection[:, 1] = -3 * (1 - np.cos(np.pi * x / 2))
    assert column.mode_error(body, SimpleNamespace(mode=deflection.ravel())) < 1e-14
    deflection[:, 1] = x**2
    assert column.mode_error(body, SimpleNamespace(mode=deflection.ravel())) > 0.01


def test_another_elastica_is_detected(monkeypatch):
    right = post_buckling.elastica
    monkeypatch.setattr(post_buckling, "SLENDER", (10, 20))
    monkeypatch.setattr(post_buckling, "ANGLES", (40,))
    monkeypatch.setattr(post_buckling, "elastica", lambda angle: right(1.03 * angle)._replace(load=right(angle).load))
    assert any("of thin columns" in failure for failure in post_buckling.post_buckling(quick=True).failures)


def test_another_law_is_detected(monkeypatch):
    monkeypatch.setattr(law, "CASES", [law.CASES[1]._replace(modulus=lambda nu: (1 + 1e-7) * law.confined(nu))])
    assert len(law.law().failures) == len(law.POISSON)


def test_another_acoustic_tensor_is_detected(monkeypatch):
    monkeypatch.setattr(ellipticity, "StVK", lambda young, poisson: StVK(young=young, poisson=poisson + 1e-8))
    monkeypatch.setattr(ellipticity, "CASES", ellipticity.CASES[1:2])
    assert len(ellipticity.ellipticity(quick=True).failures) == len(ellipticity.POISSON)


def test_an_eigenvalue_without_a_zero_is_not_found(monkeypatch):
    monkeypatch.setattr(Fields, "at", lambda fields, u: {"smallest_acoustic_eigenvalue": np.ones(fields.mesh.nt)})
    with pytest.raises(NotFoundError, match="do not vanish"):
        ellipticity.lost(ellipticity.CASES[0], 0.3, 2)


def test_states_are_rotated():
    for k in (2, 3):
        R = ellipticity.rotation(k)
        np.testing.assert_allclose(R @ R.T, np.eye(k), atol=1e-15)
        assert np.abs(R - np.eye(k)).max() > 0.1
    assert Rotation.from_matrix(ellipticity.rotation(3)).magnitude() > 1


# the command


def test_the_command_draws_the_requested_paths(tmp_path, capsys):
    assert stability.main(quick=True, only=["snap-through", "law"], out=str(tmp_path / "new")) == 0
    out = capsys.readouterr().out
    assert "all 2 claims hold" in out and "One bar" in out and "arch" not in out
    assert (tmp_path / "new" / "stability.png").stat().st_size > 10_000


def test_the_command_reports_missing_limit_points(monkeypatch, capsys):
    def broken(quick):
        """a claim"""
        raise NotFoundError("There is no limit point.")

    monkeypatch.setattr("validation.stability.studies.arch", broken)
    assert run(["arch", "law"], quick=True, out=None) == 1
    out = capsys.readouterr().out
    assert "There is no limit point." in out and "DOES NOT HOLD: broken" in out and "Limit points of the law" in out


def test_an_odd_number_of_panels_leaves_an_empty_panel(tmp_path):
    line = picture.Curve([0, 1], [0, 1], "line")
    panel = picture.Panel("A path", ("u", "P"), (line,), (line,), line)
    assert picture.draw([panel] * 3, tmp_path / "three.png").exists()
