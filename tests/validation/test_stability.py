"""Studies of stability: closed forms and quick versions are correct, and the studies detect errors."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from skfem_stvk import StVK, System
from validation.stability import column, law, limit_points, post_buckling, snap_through

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


# the studies


@pytest.mark.few(2)
@pytest.mark.parametrize(
    "study",
    [
        snap_through.snap_through,
        column.column,
        post_buckling.post_buckling,
        law.law,
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


@pytest.mark.slow
def test_a_wrong_moment_of_inertia_is_detected(monkeypatch):
    monkeypatch.setattr(column, "FINE", (2, 4))
    wrong_load = property(lambda body: np.pi**2 * column.YOUNG * body.height**3 / 11.9 / 4)
    monkeypatch.setattr(column.Column, "euler_load", wrong_load)
    failures = column.column(quick=True).failures
    assert any("thin columns" in failure for failure in failures)


@pytest.mark.slow
def test_another_mode_is_detected():
    body = column.Column(20, 2)
    deflection = np.zeros((body.mesh().nv, 2))
    x = body.mesh().p[0]
    deflection[:, 1] = -3 * (1 - np.cos(np.pi * x / 2))
    assert column.mode_error(body, SimpleNamespace(mode=deflection.ravel())) < 1e-14
    deflection[:, 1] = x**2
    assert column.mode_error(body, SimpleNamespace(mode=deflection.ravel())) > 0.01


@pytest.mark.slow
def test_another_elastica_is_detected(monkeypatch):
    right = post_buckling.elastica
    monkeypatch.setattr(post_buckling, "SLENDER", (10, 20))
    monkeypatch.setattr(post_buckling, "ANGLES", (40,))
    monkeypatch.setattr(post_buckling, "elastica", lambda angle: right(1.03 * angle)._replace(load=right(angle).load))
    assert any("of thin columns" in failure for failure in post_buckling.post_buckling(quick=True).failures)


@pytest.mark.slow
def test_another_law_is_detected(monkeypatch):
    monkeypatch.setattr(law, "CASES", [law.CASES[1]._replace(modulus=lambda nu: (1 + 1e-7) * law.confined(nu))])
    assert len(law.law().failures) == len(law.POISSON)


def test_a_missing_limit_point_is_an_error():
    result = SimpleNamespace(critical_points=(), message="It ended.")
    with pytest.raises(limit_points.NotFoundError, match=r"There is no limit point on the path\. It ended\."):
        limit_points.first(result, "limit point")
