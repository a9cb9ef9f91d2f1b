"""Strong ellipticity is lost at the states that closed forms give.

The acoustic form is the second derivative of the energy density and equals the full tensor in all directions.
"""

import numpy as np
import pytest
from bodies import BODIES, MESHES, state
from homogeneous import POISSON, YOUNG, affine, homogeneous, rotation
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq

from skfem_stvk import ElementMesh, NeoHookean, StVK, System, VolumePenalty
from skfem_stvk.results import Fields
from skfem_stvk.results.table import acoustic_form
from skfem_stvk.terms.laws.volume_penalty import ENERGIES

NAME = "smallest_acoustic_eigenvalue"
MU = YOUNG / (2 * (1 + POISSON))
FILLING = [name for name in BODIES if name.startswith(("tetrahedra", "triangles", "segments"))]
TWO_SHEETS = [StVK(young=E, poisson=nu, plane="stress", thickness=h) for E, nu, h in ((2.0, 0.3, 0.5), (9.0, 0.1, 0.2))]
POISSONS = (-0.4, 0.0, 0.2, 0.3, 0.45, 0.49)
ONE = {"tetrahedra": MESHES["tetrahedra"], "triangles": MESHES["triangles"]}
ONE = {name: ElementMesh(mesh.p[:, mesh.t[:, 0]], np.arange(len(mesh.t))[:, None]) for name, mesh in ONE.items()}


def of_one(name, F, terms):
    """Return the field on a mesh of one element that is deformed by F."""
    return float(Fields(ONE[name], terms).at(affine(ONE[name], F))[NAME][0])


def lost_at(name, shape, term):
    """Return the largest stretch `s < 1` at which the state `shape(s)` loses strong ellipticity."""
    return brentq(lambda s: of_one(name, shape(s), term), 0.05, 1.0, xtol=1e-13)


#: States that are compressed alike in all directions: kind of element, hypothesis, and the square of the stretch.
ALIKE = {
    "in space": ("tetrahedra", None, lambda nu: (1 + nu) / (2 - nu)),
    "plane strain": ("triangles", "strain", lambda nu: 1 / (2 * (1 - nu))),
    "plane stress": ("triangles", "stress", lambda nu: (1 + nu) / 2),  # as plane strain, with `lam* = E nu/(1 - nu^2)` for `lam`
}


@pytest.mark.parametrize("nu", POISSONS)
@pytest.mark.parametrize("state", ALIKE)
def test_equal_compression_loses_ellipticity_at_the_closed_value(state, nu):
    name, plane, squared = ALIKE[state]
    found = lost_at(name, lambda s: s * np.eye(3), StVK(young=YOUNG, poisson=nu, plane=plane))
    assert found == pytest.approx(np.sqrt(squared(nu)), rel=1e-11)


def uniaxial_strain(nu):
    """Return the largest stretch at which uniaxial strain loses strong ellipticity, in closed form.

    With `N = (c, n)`, `y = s^2`, `x = c^2`, `det Q` is a quadratic in `x`. Ellipticity is lost where its minimum over `x` in (0, 1)
    is zero, or where `Q_33 = T + mu` is zero at x = 1.

        Q_11 = T + mu y + (lam + mu) y x        Q_22 = T + mu + (lam + mu)(1 - x)
        Q_12^2 = (lam + mu)^2 y x (1 - x)       T = (y - 1)(lam/2 + mu x)
    """
    mu, lam = 1.0, 2 * nu / (1 - 2 * nu)

    def det(y, x):
        T = (y - 1) * (lam / 2 + mu * x)
        first, second = T + mu * y + (lam + mu) * y * x, T + mu + (lam + mu) * (1 - x)
        return first * second - (lam + mu) ** 2 * y * x * (1 - x)

    def lowest(y):
        at_0, at_half, at_1 = det(y, 0.0), det(y, 0.5), det(y, 1.0)
        a, b = 2 * (at_0 + at_1 - 2 * at_half), 4 * at_half - 3 * at_0 - at_1
        inside = [at_0 - b * b / (4 * a)] if a > 0 and 0 < -b / (2 * a) < 1 else []
        return min(at_0, at_1, *inside)

    across = 1 - 2 * mu / (lam + 2 * mu)
    grid = np.linspace(1, 0.01, 2000)
    first = next(i for i, y in enumerate(grid) if lowest(y) < 0)
    return np.sqrt(max(across, brentq(lowest, grid[first], grid[first - 1], xtol=1e-15)))


@pytest.mark.few
@pytest.mark.parametrize("nu", POISSONS)
@pytest.mark.parametrize("name", ONE)
def test_uniaxial_strain_loses_ellipticity_where_the_determinant_touches_zero(name, nu):
    F = {"tetrahedra": rotation([1, 2, -1], 0.7) @ rotation([0, 1, 1], 1.1), "triangles": rotation([0, 0, 1], 0.4)}[name]
    found = lost_at(name, lambda s: F @ np.diag([s, 1, 1]) @ F.T, StVK(young=YOUNG, poisson=nu))
    assert found == pytest.approx(uniaxial_strain(nu), rel=1e-9)


def test_the_published_values_of_uniaxial_strain():
    assert uniaxial_strain(0.0) == pytest.approx(2 - np.sqrt(2), rel=1e-12)
    assert [round(uniaxial_strain(nu), 3) for nu in (0.0, 0.3, 0.45)] == [0.586, 0.706, 0.906]


def test_a_bar_on_a_line_loses_ellipticity_at_its_limit_point():
    """A bar in one dimension loses ellipticity at its limit point: `P = E/2 s (s^2 - 1)`, `dP/ds = E/2 (3 s^2 - 1)`."""
    for s in (0.4, 3**-0.5, 0.8, 1.0, 1.6):
        assert np.allclose(homogeneous("segments", np.diag([s, 1, 1]))[NAME], YOUNG / 2 * (3 * s**2 - 1), rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize("name", ONE)
def test_at_rest_an_isotropic_solid_has_its_shear_modulus(name):
    assert np.allclose(homogeneous(name, np.eye(3))[NAME], MU, rtol=1e-12)


def density(fields, F):
    """Return the energy density (nt,) of elements that are all deformed by F."""
    return np.asarray(fields.at(affine(fields.mesh, F))["strain_energy_density"])


def motion(name, rng):
    """Return a deformation gradient F far from rest, and unit vectors a and N in the space of the mesh."""
    k = MESHES[name].k
    F = np.eye(3)
    F[:k, :k] += 0.4 * rng.standard_normal((k, k))
    a, N = np.zeros((2, 3))
    a[:k], N[:k] = rng.standard_normal((2, k))
    return F, a / np.linalg.norm(a), N / np.linalg.norm(N)


@pytest.mark.few
@pytest.mark.parametrize("name", [*FILLING, "triangles, two sheets"])
def test_the_form_is_the_second_derivative_of_the_energy_density_along_a_dyad(name):
    """The acoustic form is the second derivative of the energy density along `a N'`, and the field is below all its values.

    The five-point stencil is exact for a quartic.
    """
    mesh, terms = BODIES[name] if name in BODIES else (MESHES["triangles"], TWO_SHEETS)
    fields, rng = Fields(mesh, terms), np.random.default_rng(7)
    weights = {-2: -1 / 12, -1: 16 / 12, 0: -30 / 12, 1: 16 / 12, 2: -1 / 12}
    for _ in range(5):
        F, a, N = motion(name.split(",")[0], rng)
        second = sum(w * density(fields, F + s * np.outer(a, N)) for s, w in weights.items())
        k, now = mesh.k, fields.at(affine(mesh, F))
        form = acoustic_form(now.responses[0])
        found = np.einsum("nikJL,i,k,J,L->n", form, a[:k], a[:k], N[:k], N[:k])
        limit = 1e-11 * np.abs(form).max()
        assert np.abs(found - second).max() < limit
        assert (now[NAME] <= second + limit).all()


@pytest.mark.parametrize("kind", ENERGIES)
@pytest.mark.parametrize("name", ["tetrahedra", "triangles", "segments"])
def test_a_volume_penalty_adds_its_second_derivative(name, kind):
    rng, mesh = np.random.default_rng(11), MESHES[name]
    region = np.arange(mesh.nt // 2)
    penalties = [VolumePenalty(0.7, kind), VolumePenalty(0.4, "quadratic", region=region)]
    fields = Fields(mesh, [StVK(young=2.0, poisson=0.3), *penalties])
    h = 1e-4
    for _ in range(5):
        F, a, N = motion(name, rng)
        F = 0.7 * (np.eye(3) + 0.5 * (F - np.eye(3)))  # compressed: J < 1
        F[mesh.k :, mesh.k :] = np.eye(3 - mesh.k)
        assert 0.02 < np.linalg.det(F) < 0.9
        second = sum(w * density(fields, F + s * h * np.outer(a, N)) for s, w in {-1: 1, 0: -2, 1: 1}.items()) / h**2
        k = mesh.k
        form = acoustic_form(fields.at(affine(mesh, F)).responses[0])
        found = np.einsum("nikJL,i,k,J,L->n", form, a[:k], a[:k], N[:k], N[:k])
        assert np.abs(found - second).max() < 1e-6 * np.abs(form).max()


def test_a_volume_penalty_does_not_delay_the_loss_in_hydrostatic_compression():
    """A volume penalty does not change the loss in hydrostatic compression.

    Ellipticity is lost by motions normal to `N`, which do not change the volume. The pressure of the penalty adds no stiffness for
    dyads.
    """
    nu, s = 0.3, 0.9
    terms = [StVK(young=YOUNG, poisson=nu), VolumePenalty(0.3 * YOUNG)]
    across = YOUNG / (1 - 2 * nu) * (s**2 - 1) / 2 + MU * s**2
    assert of_one("tetrahedra", s * np.eye(3), terms) == pytest.approx(across, rel=1e-12)
    assert lost_at("tetrahedra", lambda s: s * np.eye(3), terms) == pytest.approx(np.sqrt((1 + nu) / (2 - nu)), rel=1e-11)


def test_a_volume_penalty_delays_the_loss_in_uniaxial_strain():
    terms = [StVK(young=YOUNG, poisson=0.3), VolumePenalty(0.3 * YOUNG)]
    s = uniaxial_strain(0.3)
    assert of_one("tetrahedra", np.diag([s, 1, 1]), terms[0]) == pytest.approx(0, abs=1e-9)
    assert of_one("tetrahedra", np.diag([s, 1, 1]), terms) > 0.01 * YOUNG


@given(
    st.lists(st.floats(-1, 1), min_size=3, max_size=3).filter(lambda a: np.linalg.norm(a) > 0.1),
    st.floats(-3, 3),
    st.integers(0, 10**6),
)
@settings(max_examples=20)
def test_a_rotation_of_the_deformed_body_changes_nothing(axis, angle, seed):
    mesh, terms = BODIES["tetrahedra, heterogeneous orthotropic with element frames"]
    fields, Q = Fields(mesh, [*terms, VolumePenalty(1.0)]), rotation(axis, angle)
    u = state(mesh, 0.15, seed)
    assume(System(mesh, terms).smallest_volume_ratio(u) > 0)  # the penalty has an energy in such states only
    moved = (Q @ (mesh.p + u.reshape(-1, 3).T) - mesh.p).ravel("F")
    here, there = fields.at(u)[NAME], fields.at(moved)[NAME]
    assert np.ptp(here) > 0.1 and np.abs(there - here).max() < 1e-7


@given(st.integers(0, 10**6), st.lists(st.floats(0.3, 1.5), min_size=3, max_size=3))
@settings(max_examples=30)
def test_a_rotation_of_an_isotropic_body_at_rest_changes_nothing(seed, stretches):
    Q, R = np.linalg.qr(np.random.default_rng(seed).standard_normal((2, 3, 3)))[0]
    term = StVK(young=YOUNG, poisson=POISSON)
    found = of_one("tetrahedra", Q @ np.diag(stretches) @ R.T, term)
    assert found == pytest.approx(of_one("tetrahedra", np.diag(stretches), term), rel=1e-7, abs=1e-9)


def test_hardly_any_direction_of_a_dense_set_has_less():
    """In a few very anisotropic elements another local minimum is slightly lower."""
    for name in ("tetrahedra, fibres", "tetrahedra, isotropic", "triangles, fibres"):
        mesh, terms = BODIES[name]
        now = Fields(mesh, terms).at(state(mesh, 0.15 if mesh.k == 3 else 0.05))
        N = np.random.default_rng(5).standard_normal((4000, mesh.k))
        N /= np.linalg.norm(N, axis=1, keepdims=True)
        form, found = acoustic_form(now.responses[0]), now[NAME]
        dense = np.array([np.linalg.eigvalsh(np.einsum("ikJL,sJ,sL->sik", one, N, N))[:, 0].min() for one in form])
        size = np.abs(form).max(axis=(1, 2, 3, 4))
        assert (found <= dense + 1e-12 * size).mean() > 0.95 and (np.abs(dense - found) < 5e-3 * size).all()
        assert (found < 0).any() and (found > 0).any()


@pytest.mark.parametrize("name", ["membrane", "cable", "cable in the plane"])
def test_membranes_and_cables_in_space_are_masked(name):
    now = homogeneous(name, 0.5 * np.eye(3))
    assert np.ma.getmaskarray(now[NAME]).all()


def test_elements_in_no_term_or_in_another_law_are_masked():
    mesh = MESHES["tetrahedra"]
    for others in ([], [NeoHookean(young=2.0, poisson=0.3, region=np.arange(9, mesh.nt))]):
        now = Fields(mesh, [StVK(young=2.0, poisson=0.3, region=np.arange(9)), *others]).at(-0.5 * mesh.p.ravel("F"))
        assert np.array_equal(np.ma.getmaskarray(now[NAME]), np.arange(mesh.nt) >= 9)
