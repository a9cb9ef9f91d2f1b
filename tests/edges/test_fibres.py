"""Fibres: Picinbono's law, closed forms, fields of directions, and bodies of several laws."""

import numpy as np
import pytest
import skfem
from bodies import box, membrane, sheet, state

from skfem_stvk import (
    Isotropic,
    LinearElastic,
    MaterialError,
    NeoHookean,
    StVK,
    System,
    TransverselyIsotropic,
    frames_along,
    solve_static,
)
from skfem_stvk.results import Fields

LAM, MU, D_LAM, D_MU = 1.5, 1.0, 4.0, 3.0
ALONG = D_LAM + 2 * D_MU
RNG = np.random.default_rng(0)


def energy(E, a):
    """Return Picinbono's energy per volume for strains `E` (n, 3, 3) and fibres `a` (n, 3)."""
    trace, e = np.trace(E, axis1=1, axis2=2), np.einsum("ni,nij,nj->n", a, E, a)
    return LAM / 2 * trace**2 + MU * (E**2).sum(axis=(1, 2)) + D_LAM / 2 * e**2 + D_MU * e**2


def test_the_energy_is_picinbonos_with_a_fibre_in_each_element():
    mesh, directions = box(), RNG.standard_normal((box().nt, 3))
    fibres = TransverselyIsotropic.from_lame(LAM, MU, ALONG, frame=frames_along(mesh, directions))
    body, u = System(mesh, StVK(fibres)), 0.5 * state(mesh)
    fields = Fields.of(body)
    E = fields.at(u)["green_strain"]
    a = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    assert body.energy(u) == pytest.approx(fields.volume @ energy(E, a), rel=1e-12)
    assert abs(body.energy(u) / System(mesh, StVK(Isotropic.from_lame(LAM, MU))).energy(u) - 1) > 0.1


def test_without_fibres_the_law_is_isotropic_and_constants_may_vary():
    plain = TransverselyIsotropic.from_lame(LAM, MU, 0.0)
    assert plain.young_axial == pytest.approx(plain.young_transverse) == Isotropic.from_lame(LAM, MU).young
    lam, mu, along = RNG.uniform(1, 2, (3, 5))
    each = TransverselyIsotropic.from_lame(lam, mu, along).stiffness()
    for i in range(5):
        np.testing.assert_allclose(each[i], TransverselyIsotropic.from_lame(lam[i], mu[i], along[i]).stiffness(), rtol=1e-12)
        wanted = lam[i] * np.pad(np.ones((3, 3)), (0, 3)) + np.diag([2 * mu[i]] * 3 + [mu[i]] * 3)
        wanted[0, 0] += along[i]
        np.testing.assert_allclose(each[i], wanted, rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize(
    ("lam", "mu", "along"), [(1.0, -1.0, 0.0), (-1.0, 1.0, 0.0), (1.5, 1.0, -2.7), (1.5, 1.0, np.nan)], ids=str
)
def test_invalid_constants_are_refused(lam, mu, along):
    with pytest.raises(MaterialError):
        TransverselyIsotropic.from_lame(lam, mu, along)


@pytest.mark.parametrize("axis", [0, 1])
def test_a_bar_of_fibres_has_the_force_and_width_of_the_closed_form(axis):
    """Uniaxial stress `S` along `axis`: `E = C^-1 S`, force `F S A` with the stretch `F = sqrt(1 + 2 E)`."""
    fibres = TransverselyIsotropic.from_lame(LAM, MU, ALONG)
    stretch = 1.2
    mesh = skfem.MeshTet.init_tensor(np.linspace(0, 1, 4), np.linspace(0, 1.2, 4), np.linspace(0, 0.7, 3))
    length = np.ptp(mesh.p[axis])
    body = System(
        mesh,
        StVK(fibres),
        fixed=[(lambda x, i=i: x[i] == 0, "xyz"[i]) for i in range(3)],
        prescribed={(lambda x: x[axis] == length): {"xyz"[axis]: (stretch - 1) * length}},
    )
    result = solve_static(body, quiet=True)
    compliance = np.linalg.inv(fibres.stiffness())
    strain = (stretch**2 - 1) / 2
    S = strain / compliance[axis, axis]
    area = np.prod([np.ptp(mesh.p[i]) for i in range(3) if i != axis])
    assert result.reaction(lambda x: x[axis] == length).resultant[axis] == pytest.approx(stretch * S * area, rel=1e-8)
    for other in {0, 1, 2} - {axis}:
        width = np.sqrt(1 + 2 * compliance[other, axis] * S)
        end = np.isclose(mesh.p[other], np.ptp(mesh.p[other]))
        assert result.u.reshape(-1, 3)[end, other] == pytest.approx((width - 1) * np.ptp(mesh.p[other]), rel=1e-7)
    assert float(fibres.young_axial) / float(fibres.young_transverse) > 2


@pytest.mark.parametrize("mesh", [box(), sheet(), membrane()], ids=["tetrahedra", "triangles", "membrane"])
def test_frames_have_their_first_axis_along_the_field_in_every_form(mesh):
    def around(x):
        return np.stack([-x[1] - 0.2, x[0] + 0.3, *x[2:] * 0.5])

    centres = mesh.p[:, mesh.t].mean(axis=1)
    wanted = around(centres).T
    wanted /= np.linalg.norm(wanted, axis=1, keepdims=True)
    by_function, by_element = frames_along(mesh, around), frames_along(mesh, 7 * around(centres).T)
    for frames in (by_function, by_element):
        assert np.abs(frames[:, :, 0] - wanted).max() < 1e-14
        assert np.abs(frames.transpose(0, 2, 1) @ frames - np.eye(mesh.d)).max() < 1e-14
        assert np.linalg.det(frames) == pytest.approx(np.ones(mesh.nt))
    at_nodes = around(mesh.p).T * RNG.choice([-1, 1], mesh.nv)[:, None]
    close = frames_along(mesh, at_nodes)[:, :, 0]
    assert (np.abs((close * wanted).sum(axis=1)) > 0.93).all()
    one = frames_along(mesh, np.eye(mesh.d)[1])
    assert (one[:, :, 0] == np.eye(mesh.d)[1]).all() and one.shape == (mesh.nt, mesh.d, mesh.d)


@pytest.mark.parametrize(
    ("directions", "message"),
    [
        ([1.0, 0], r"shape \(2,\)"),
        (np.ones((3, 7)), r"shape \(3, 7\)"),
        (np.zeros(3), r"directions are zero or not finite in 162 elements"),
        (lambda x: np.where(x[0] > 0.5, np.nan, x), "zero or not finite"),
        (lambda x: x.T, r"expected \(3,\) or \(3, 162\)"),
        ("fibres", "directions = 'fibres'"),
    ],
    ids=["two", "shape", "zero", "nan", "transposed", "text"],
)
def test_invalid_directions_are_refused(directions, message):
    with pytest.raises(MaterialError, match=message):
        frames_along(box(), directions)


def test_as_many_nodes_as_elements_are_ambiguous():
    mesh = skfem.MeshTri(np.array([[0.0, 1, 0, 1], [0, 0, 1, 1]]), np.array([[0, 1, 0, 1], [1, 2, 1, 3], [2, 3, 3, 2]]))
    with pytest.raises(MaterialError, match="expected a function of x, because"):
        frames_along(mesh, np.ones((4, 2)))
    with pytest.raises(MaterialError, match="mesh = None"):
        frames_along(None, [1.0, 0, 0])
    with pytest.raises(MaterialError, match="on a line"):
        frames_along(skfem.MeshLine(), [1.0])


def three_laws(nu=0.0, **more):
    """Return a bar with one of three laws in each third of its length."""
    mesh = skfem.MeshTet.init_tensor(np.linspace(0, 3, 7), np.linspace(0, 1, 3), np.linspace(0, 0.8, 3)).with_subdomains(
        {"first": lambda x: x[0] < 1, "second": lambda x: (x[0] > 1) & (x[0] < 2), "third": lambda x: x[0] > 2}
    )
    laws = [
        StVK(young=10.0, poisson=nu, region="first"),
        LinearElastic(young=6.0, poisson=nu, region="second"),
        NeoHookean(young=8.0, poisson=nu, region="third"),
    ]
    return System(mesh, laws, **more)


def test_laws_in_series_carry_the_force_of_their_closed_forms():
    """Without contraction the first Piola-Kirchhoff stresses are `E s (s^2 - 1)/2`, `E (s - 1)` and `E/2 (s - 1/s)`."""
    body = three_laws(
        fixed=[(lambda x: x[0] == 0, "x"), (lambda x: x[1] == 0, "y"), (lambda x: x[2] == 0, "z")],
        prescribed={(lambda x: x[0] == 3): {"x": 0.6}},
    )
    result = solve_static(body, quiet=True)
    u = result.u.reshape(-1, 3)
    ends = [float(u[np.isclose(body.mesh.p[0], x), 0].mean()) for x in range(4)]
    one, two, three = 1 + np.diff(ends)
    force = result.reaction(lambda x: x[0] == 3).resultant[0]
    stresses = [10 * one * (one**2 - 1) / 2, 6 * (two - 1), 4 * (three - 1 / three)]
    assert stresses == pytest.approx([force / 0.8] * 3, rel=1e-7) and force > 0.5
    inside = np.interp(body.mesh.p[0], [0, 1, 2, 3], ends)
    assert np.abs(u[:, 0] - inside).max() < 1e-7 and np.abs(u[:, 1:]).max() < 1e-7
