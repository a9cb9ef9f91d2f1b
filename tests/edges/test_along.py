"""The energy along a line is a quartic, and its coefficients are accurate to the last digits."""

from decimal import localcontext
from fractions import Fraction

import numpy as np
import pytest
from bodies import BODIES, MESHES, state
from kernels.parts import in_parts
from slow import slow

from skfem_stvk import ElementMesh, StVK, System
from skfem_stvk.referee import exact

TERM = StVK(young=2.0, poisson=0.3)


def along(mesh, terms, u, v, dtype=np.float64):
    u, v = u.reshape(-1, mesh.d), v.reshape(-1, mesh.d)
    return sum(term.bind(mesh, dtype).along(u, v) for term in terms)


@pytest.mark.few(8)
@pytest.mark.parametrize("parts", [1, 2, 5])
@pytest.mark.parametrize("name", BODIES)
def test_the_quartic_is_the_energy_along_the_line(name, parts, monkeypatch):
    in_parts(monkeypatch, parts)
    mesh, terms = BODIES[name]
    body, u, v = System(mesh, terms), state(mesh), state(mesh, seed=9)
    c = along(mesh, terms, u, v)
    assert c.shape == (5,) and np.abs(c).min() > 1e-4
    for s in (0.0, 1.0, -1.0, 0.3, -2.7, 5.0):
        terms_of_s = c * s ** np.arange(5)
        assert terms_of_s.sum() == pytest.approx(body.energy(u + s * v), abs=1e-13 * np.abs(terms_of_s).sum())


def exact_coefficients(mesh, u, v):
    """Return the coefficients from the energy at five points, in 50 digits; divided differences have no truncation error."""
    lam, mu = (float(value) for value in TERM.material.lame(TERM.hypothesis(mesh)))
    inverse = inverse_of_vandermonde()
    body = exact.ExactStVK(mesh.p, mesh.t, (lam, mu))
    with localcontext() as context:
        context.prec = 2 * exact.DIGITS
        x, y = body._at_nodes(u), body._at_nodes(v)
        states = [body._state(x + s * y) for s in range(-2, 3)]
        W = [(body._volume * (stress * strain).sum(axis=(0, 1))).sum() / 2 for _, strain, stress in states]
        return np.array([float(sum(w * n.numerator / n.denominator for w, n in zip(W, row, strict=True))) for row in inverse])


def inverse_of_vandermonde():
    """Return the fractions (5, 5) that give the coefficients of a quartic from its values at -2 ... 2."""
    rows = []
    for m in range(-2, 3):
        product, scale = [Fraction(1)], Fraction(1)
        for other in set(range(-2, 3)) - {m}:
            product = [a - other * b for a, b in zip([Fraction(0), *product], [*product, Fraction(0)], strict=True)]
            scale *= m - other
        rows.append([value / scale for value in product])
    return list(zip(*rows, strict=True))


@pytest.mark.few
@pytest.mark.parametrize(("of_u", "of_v"), [(0.3, 0.3), (1e-10, 1e-10), (1e-10, 1.0), (1.0, 1e-10)])
@pytest.mark.parametrize("offset", [0.0, 1e6])
@pytest.mark.parametrize("name", ["tetrahedra", "triangles", "membrane"])
def test_every_coefficient_has_all_its_digits(name, offset, of_u, of_v):
    """The digits remain at small strains and far from the origin, where `|p|^2 - |P|^2` loses them."""
    mesh = MESHES[name]
    mesh = ElementMesh(mesh.p + offset, mesh.t)
    rng = np.random.default_rng(7)
    # towards larger bodies, so that no coefficient is a difference of large numbers
    u, v = (amount * (mesh.p.T - offset + 0.3 * rng.random(mesh.p.T.shape)).ravel() for amount in (of_u, of_v))
    found, wanted = along(mesh, [TERM], u, v), exact_coefficients(mesh, u, v)
    assert (wanted > 0).all()
    assert np.abs(found / wanted - 1).max() < 1e-13


@pytest.mark.parametrize("name", ["tetrahedra, two regions", slow("membrane, anisotropic"), "cable, area"])
def test_single_precision_agrees_with_double(name):
    mesh, terms = BODIES[name]
    u, v = state(mesh), state(mesh, seed=9)
    single, double = along(mesh, terms, u, v, np.float32), along(mesh, terms, u, v)
    assert single.dtype == np.float64 and 0 < np.abs(single - double).max() < 2e-6 * np.abs(double).max()


def test_coefficients_are_bitwise_reproducible(monkeypatch):
    in_parts(monkeypatch, 3)
    mesh = MESHES["tetrahedra"]
    assembly, u, v = TERM.bind(mesh), state(mesh).reshape(-1, 3), state(mesh, seed=9).reshape(-1, 3)
    first = assembly.along(u, v)
    for _ in range(5):
        assembly.along(v, u)
        assert np.array_equal(assembly.along(u, v), first)
