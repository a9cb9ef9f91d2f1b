"""Materials: constants, frames, stored copies and refused values."""

import numpy as np
import pytest
from bodies import MESHES

from skfem_stvk import Anisotropic, Isotropic, MaterialError, NeoHookean, Orthotropic, StVK, TransverselyIsotropic
from skfem_stvk.edges.materials import Hypothesis

SOLID, PLANE_STRESS, UNIAXIAL = Hypothesis.SOLID, Hypothesis.PLANE_STRESS, Hypothesis.UNIAXIAL_STRESS


def isotropic_voigt(young, poisson):
    lam, mu = Isotropic(young, poisson).lame(SOLID)
    C = np.diag([2 * mu] * 3 + [mu] * 3)
    C[:3, :3] += lam
    return C


@pytest.mark.parametrize("poisson", [-0.9, -0.4, 0.0, 0.25, 0.45, 0.4999])
def test_lame_pair_gives_back_young_and_poisson(poisson):
    lam, mu = Isotropic(2.0, poisson).lame(SOLID)
    back = Isotropic.from_lame(lam, mu)
    assert back.young == pytest.approx(2.0, rel=1e-12)
    assert back.poisson == pytest.approx(poisson, abs=1e-12)


@pytest.mark.parametrize("made", [StVK, NeoHookean, Isotropic, Orthotropic])
@pytest.mark.parametrize(
    ("given", "meant"), [("E", "young"), ("nu", "poisson"), ("youngs_modulus", "young"), ("poison", "poisson"), ("rho", "density")]
)
def test_an_unknown_constant_is_refused_with_the_constant_that_is_meant(made, given, meant):
    with pytest.raises(
        MaterialError, match=rf"^{made.__name__}\({given}=...\): there is no such argument; .*Did you mean '{meant}'"
    ):
        made(**{given: 0.3})


def test_an_unknown_constant_like_no_other_is_refused_without_a_guess():
    with pytest.raises(MaterialError, match=r"known: 'density', 'poisson', 'young'\.$"):
        Isotropic(young=1.0, colour="red")


def test_plane_stress_allows_poisson_up_to_one():
    lam, _ = Isotropic(2.0, 0.8).lame(PLANE_STRESS)
    assert lam == pytest.approx(2.0 * 0.8 / (1 - 0.64))
    Isotropic(2.0, 0.8).check(5, PLANE_STRESS)
    with pytest.raises(MaterialError, match=r"poisson \(three-dimensional\) = 0.8; expected values in \(-1, 0.5\)"):
        Isotropic(2.0, 0.8).check(5, SOLID)


def test_solids_need_poisson_and_segments_do_not():
    Isotropic(2.0).check(3, UNIAXIAL)
    with pytest.raises(MaterialError, match="poisson = None; expected a number"):
        Isotropic(2.0).check(3, SOLID)


def test_engineering_constants_of_an_isotropic_body_give_the_isotropic_matrix():
    E, nu = 3.0, 0.3
    G = E / (2 * (1 + nu))
    assert np.allclose(Orthotropic((E, E, E), (nu, nu, nu), (G, G, G)).stiffness(), isotropic_voigt(E, nu))
    assert np.allclose(TransverselyIsotropic(E, E, nu, nu, G).stiffness(), isotropic_voigt(E, nu))


def test_orthotropic_compliance_contains_the_engineering_constants():
    S = np.linalg.inv(Orthotropic((10.0, 2.0, 1.0), (0.4, 0.3, 0.2), (0.5, 0.6, 0.7)).stiffness())
    assert np.allclose(np.diag(S), [0.1, 0.5, 1.0, 2.0, 1 / 0.6, 1 / 0.7])
    assert np.allclose([S[1, 2], S[0, 2], S[0, 1]], [-0.4 / 2.0, -0.3 / 10.0, -0.2 / 10.0])


def test_a_transversely_isotropic_matrix_is_the_same_in_all_directions_across_its_axis():
    ply = {"young_axial": 14.0, "young_transverse": 1.0, "poisson_axial": 0.3, "poisson_transverse": 0.4, "shear_axial": 0.6}
    c, s = np.cos(0.7), np.sin(0.7)
    about_the_axis = np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
    about_another = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    plain = StVK(TransverselyIsotropic(**ply)).coefficients(MESHES["tetrahedra"])
    same = StVK(TransverselyIsotropic(**ply, frame=about_the_axis)).coefficients(MESHES["tetrahedra"])
    other = StVK(TransverselyIsotropic(**ply, frame=about_another)).coefficients(MESHES["tetrahedra"])
    assert np.abs(plain - same).max() < 1e-13 * np.abs(plain).max()
    assert np.abs(plain - other).max() > 1e-2 * np.abs(plain).max()


BAD_AT_7 = np.where(np.arange(20) == 7, np.nan, 1.0)
SYMMETRIC = isotropic_voigt(1.0, 0.3)
LOPSIDED = SYMMETRIC + np.eye(6, k=1)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Isotropic(0.0, 0.3), r"young = 0\.; expected values in \(0, inf\)"),
        (lambda: Isotropic(-1.0, 0.3), "young = -1.; expected values in"),
        (lambda: Isotropic(np.nan, 0.3), "young = nan; expected finite values"),
        (lambda: Isotropic("steel", 0.3), "young = 'steel'; expected a number"),
        (lambda: Isotropic("70e9", 0.3), "young = '70e9'; expected a number"),
        (lambda: Isotropic(True, 0.3), "young = True; expected a number"),
        (lambda: Isotropic(1j, 0.3), "young = 1j; expected a number"),
        (lambda: Isotropic(BAD_AT_7, 0.3), r"young = nan in 1 element \(7\); expected finite values"),
        (
            lambda: Isotropic(np.where(BAD_AT_7 > 0, 1.0, -3.0), 0.3),
            r"young = -3 in 1 element \(7\); expected values in \(0, inf\)",
        ),
        (lambda: Isotropic(1.0, 1.0), r"poisson = 1.; expected values in \(-1, 1\)"),
        (lambda: Isotropic(1.0, -1.0), "poisson = -1.; expected values in"),
        (lambda: Isotropic(np.ones((2, 2)), 0.3), r"young has shape \(2, 2\)"),
        (lambda: Isotropic(1.0, 0.3, density=-1.0), "density = -1.; expected values in"),
        (lambda: Isotropic.from_lame(-1.0, 1.0), r"3 lam \+ 2 mu = -1.; expected values in"),
        (lambda: Isotropic.from_lame(1.0, 0.0), "mu = 0.; expected values in"),
        (lambda: Orthotropic((1.0, 1.0), (0.3,) * 3, (1.0,) * 3), r"young = \(1.0, 1.0\); expected three entries, for 1, 2, 3"),
        (lambda: Orthotropic(1.0, (0.3,) * 3, (1.0,) * 3), "young = 1.0; expected three entries"),
        (lambda: Orthotropic("abc", (0.3,) * 3, (1.0,) * 3), "young = 'abc'; expected three entries"),
        (lambda: Orthotropic((1.0, 1.0, -2.0), (0.3,) * 3, (1.0,) * 3), "young_3 = -2.; expected values in"),
        (lambda: Orthotropic((1.0, 1.0, 1.0), (0.3,) * 3, (1.0, 0.0, 1.0)), "shear_13 = 0.; expected values in"),
        (lambda: Orthotropic((1.0, 1.0, 1.0), (0.9,) * 3, (1.0,) * 3), "not positive definite"),
        (lambda: Orthotropic((np.ones(3), np.ones(4), 1.0), (0.1,) * 3, (1.0,) * 3), "different lengths"),
        (lambda: TransverselyIsotropic(1.0, 1.0, 0.3, 1.0, 1.0), "poisson_transverse = 1.; expected values in"),
        (lambda: TransverselyIsotropic(-1.0, 1.0, 0.3, 0.3, 1.0), "young_axial = -1.; expected values in"),
        (lambda: TransverselyIsotropic(1.0, 1.0, 0.3, 0.3, 0.0), "shear_axial = 0.; expected values in"),
        (lambda: TransverselyIsotropic(1.0, 1.0, np.nan, 0.3, 1.0), "poisson_axial = nan; expected finite values"),
        (lambda: Anisotropic(np.diag([1.0, 1, 1, 1, 1, 0])), "not positive definite"),
        (lambda: Anisotropic(SYMMETRIC, frame=np.eye(3) + 1e-6), "columns of frame are not orthonormal"),
        (lambda: Anisotropic(np.eye(3)), r"voigt has shape \(3, 3\); expected \(6, 6\)"),
        (lambda: Anisotropic(LOPSIDED), "not symmetric"),
        (lambda: Anisotropic(SYMMETRIC + 1e-6 * np.eye(6, k=1)), "not symmetric"),
        (lambda: Anisotropic(np.stack([SYMMETRIC, -SYMMETRIC])), r"not positive definite in 1 element \(1\)"),
        (lambda: Anisotropic(SYMMETRIC, frame=2 * np.eye(3)), "columns of frame are not orthonormal"),
        (lambda: Anisotropic(SYMMETRIC, frame=np.ones((4, 3, 3))), r"not orthonormal in 4 elements \(0, 1, 2, 3\)"),
        (lambda: Anisotropic(SYMMETRIC, frame=np.eye(4)), r"frame has shape \(4, 4\)"),
    ],
)
def test_invalid_constants_are_refused_by_the_constructor(make, message):
    with pytest.raises(MaterialError, match=message):
        make()


@pytest.mark.parametrize(
    ("material", "message"),
    [
        (Isotropic(np.ones(4), 0.3), "young has 4 values; expected a single one, or one for each of the 5 elements"),
        (Isotropic(1.0, np.full(6, 0.3)), "poisson has 6 values"),
        (Isotropic(1.0, np.array([0.3, 0.3, 0.5, 0.3, 0.7])), r"in 2 elements \(2, 4\)"),
        (Isotropic(1.0, 0.3, density=np.ones(3)), "density has 3 values"),
        (Anisotropic(np.stack([SYMMETRIC] * 4)), "the elasticity matrix has 4 values"),
        (Anisotropic(SYMMETRIC, frame=np.stack([np.eye(3)] * 4)), "frame has 4 values"),
        (Orthotropic((np.ones(6), 1.0, 1.0), (0.3,) * 3, (1.0,) * 3), "the elasticity matrix has 6 values"),
    ],
)
def test_arrays_that_do_not_fit_the_region_are_refused(material, message):
    with pytest.raises(MaterialError, match=message):
        material.check(5, SOLID)


def test_a_plane_frame_equals_the_same_frame_in_space():
    c, s = np.cos(0.4), np.sin(0.4)
    ply = Orthotropic((10.0, 2.0, 1.0), (0.4, 0.3, 0.2), (0.5, 0.6, 0.7))
    constants = {"young": ply.young, "poisson": ply.poisson, "shear": ply.shear}
    flat = StVK(Orthotropic(**constants, frame=[[c, -s], [s, c]])).coefficients(MESHES["triangles"])
    solid = StVK(Orthotropic(**constants, frame=[[c, -s, 0], [s, c, 0], [0, 0, 1]])).coefficients(MESHES["triangles"])
    other = StVK(Orthotropic(**constants, frame=[[c, s], [-s, c]])).coefficients(MESHES["triangles"])
    assert np.array_equal(flat, solid)
    assert np.abs(flat - other).max() > 1e-2 * np.abs(flat).max()


def test_a_material_copies_its_arrays():
    young = np.ones(4)
    material = Isotropic(young, 0.3)
    young[0] = np.nan
    assert np.isfinite(material.young).all()
    with pytest.raises(ValueError, match="read-only"):
        material.young[0] = 2.0
