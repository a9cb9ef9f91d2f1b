"""Stresses equal closed forms, have the internal force as virtual work, and rotate with the body."""

import numpy as np
import pytest
from bodies import BODIES, MESHES, state
from homogeneous import LAM, MU, affine, forces, gradients, homogeneous, rotation
from hypothesis import given
from hypothesis import strategies as st

from skfem_stvk import ElementMesh, Isotropic, StateError, StVK, StvkWarning, System
from skfem_stvk.referee.bodies import is_condensed, voigt_matrix
from skfem_stvk.referee.reference import anisotropic_tensor, engineering_matrix
from skfem_stvk.results import Fields

SOLIDS = ("tetrahedra", "triangles")  # space and plane strain: uniaxial strain and shear are the same states in both


@pytest.mark.parametrize("name", SOLIDS)
@pytest.mark.parametrize("s", [0.6, 1.0, 1.7])
def test_uniaxial_strain(name, s):
    now = homogeneous(name, np.diag([s, 1, 1]))
    across = LAM / 2 * (s**2 - 1)
    assert np.allclose(now["pk1"], np.diag([(LAM + 2 * MU) / 2 * s * (s**2 - 1), across, across]), rtol=0, atol=1e-13)
    assert np.allclose(now["cauchy"], np.diag([(LAM + 2 * MU) / 2 * s * (s**2 - 1), across / s, across / s]), rtol=0, atol=1e-13)
    assert np.allclose(now["von_mises"], abs((LAM + 2 * MU) / 2 * s * (s**2 - 1) - across / s), rtol=0, atol=1e-13)


@pytest.mark.parametrize("name", SOLIDS)
@pytest.mark.parametrize("g", [-0.4, 0.9])
def test_simple_shear(name, g):
    now = homogeneous(name, [[1, g, 0], [0, 1, 0], [0, 0, 1]])
    P = [
        [(LAM / 2 + MU) * g**2, MU * g + (LAM / 2 + MU) * g**3, 0],
        [MU * g, (LAM + 2 * MU) * g**2 / 2, 0],
        [0, 0, LAM * g**2 / 2],
    ]
    assert np.allclose(now["pk1_stress"], P, rtol=0, atol=1e-13)
    assert np.allclose(now["cauchy_stress"], np.array(P) @ [[1, 0, 0], [g, 1, 0], [0, 0, 1]], rtol=0, atol=1e-13)


def small(mesh):
    """Return random displacements that leave membranes a positive thickness."""
    return state(mesh, 0.1 if mesh.d == mesh.k == 3 else 0.03)


@pytest.mark.few
@pytest.mark.parametrize("name", BODIES)
def test_the_internal_force_is_the_virtual_work_of_each_stress(name):
    mesh, terms = BODIES[name]
    u, system = small(mesh), System(mesh, terms)
    now, force = Fields(mesh, terms).at(u), system.internal_force(u)
    rest, V = gradients(mesh.p, mesh.t), now.fields.volume
    p = mesh.p + u.reshape(-1, mesh.d).T
    limit = 1e-12 * np.abs(force).max()
    assert limit > 0
    F = np.asarray(now["deformation_gradient"])
    assert np.abs(forces(mesh, now["pk1"], rest, V) - force).max() < limit
    assert np.abs(forces(mesh, F @ now["pk2"], rest, V) - force).max() < limit
    assert np.abs(forces(mesh, now["cauchy"], gradients(p, mesh.t), V * np.abs(now["volume_ratio"])) - force).max() < limit
    assert (V * now["strain_energy_density"]).sum() == pytest.approx(system.energy(u), rel=1e-12)


def stiffness_in_space(term, n):
    """Return the elasticity tensor in global axes from the given constants, (n, 3, 3, 3, 3)."""
    material = term.material
    frame = getattr(material, "frame", None)
    if isinstance(material, Isotropic):
        E, nu = np.asarray(material.young), np.asarray(0.0 if material.poisson is None else material.poisson)
        G = E / 2 / (1 + nu)
        voigt = engineering_matrix((E, E, E), (nu, nu, nu), (G, G, G))
    else:
        voigt = voigt_matrix(material)
    return anisotropic_tensor(voigt, frame, np.broadcast_to(np.eye(3), (n, 3, 3)), False)


@pytest.mark.few
@pytest.mark.parametrize("name", [name for name in BODIES if "regions" not in name])
def test_stress_is_stiffness_times_strain_and_one_of_the_two_vanishes_across(name):
    mesh, (term,) = BODIES[name]
    now = Fields(mesh, term).at(small(mesh))
    E, S = np.asarray(now["green_strain"]), np.asarray(now["pk2"])
    limit = 1e-12 * np.abs(S).max()
    assert np.abs(np.einsum("nijkl,nkl->nij", stiffness_in_space(term, mesh.nt), E) - S).max() < limit
    normals = now.responses[0].point.frames[..., mesh.k :]
    assert np.abs((S if is_condensed(mesh, term) else E) @ normals).max(initial=0) < limit
    if is_condensed(mesh, term):  # the Cauchy stress across, by the current normals, is zero, too
        F = np.asarray(now["deformation_gradient"])
        current = np.linalg.inv(F).swapaxes(1, 2) @ normals
        assert np.abs(now["cauchy"] @ current).max() < 1e-11 * np.abs(now["cauchy"]).max()


@given(st.lists(st.floats(-1, 1), min_size=3, max_size=3).filter(lambda a: np.linalg.norm(a) > 0.1), st.floats(-3, 3))
@pytest.mark.parametrize("name", ["tetrahedra, fibres", "membrane, anisotropic", "cable, isotropic"])
def test_cauchy_stress_rotates_with_the_body_and_pk2_stress_does_not(name, axis, angle):
    mesh, terms = BODIES[name]
    fields, u, Q = Fields(mesh, terms), small(mesh), rotation(axis, angle)
    moved = (Q @ (mesh.p + u.reshape(-1, 3).T) - mesh.p).ravel("F")
    here, there = fields.at(u), fields.at(moved)
    size = np.abs(here["cauchy"]).max()
    assert np.abs(there["pk2"] - here["pk2"]).max() < 1e-12 * size
    assert np.abs(there["pk1"] - Q @ here["pk1"]).max() < 1e-12 * size
    assert np.abs(there["cauchy"] - Q @ here["cauchy"] @ Q.T).max() < 1e-12 * size
    for scalar in ("von_mises", "volume_ratio", "strain_energy_density"):
        assert np.allclose(there[scalar], here[scalar], rtol=1e-9, atol=1e-12 * size)


def test_terms_on_one_element_add_up_by_their_sections():
    mesh = MESHES["triangles"]
    thick, thin = (StVK(young=E, poisson=nu, plane="stress", thickness=h) for E, nu, h in ((2.0, 0.3, 0.5), (9.0, 0.1, 0.2)))
    u = small(mesh)
    both, one, other = (Fields(mesh, terms).at(u) for terms in ([thick, thin], thick, thin))
    assert np.allclose(both.fields.volume, one.fields.volume)
    assert np.allclose(both["pk2"], one["pk2"] + 0.2 / 0.5 * other["pk2"], rtol=1e-13, atol=1e-16)
    E33 = (0.5 * one["green_strain"] + 0.2 * other["green_strain"])[:, 2, 2] / 0.7
    assert np.allclose(both["green_strain"][:, 2, 2], E33, rtol=1e-13, atol=1e-16)
    system = System(mesh, [thick, thin])
    force = system.internal_force(u)
    assert np.abs(forces(mesh, both["pk1"], gradients(mesh.p, mesh.t), both.fields.volume) - force).max() < 1e-13
    assert (both.fields.volume * both["strain_energy_density"]).sum() == pytest.approx(system.energy(u), rel=1e-13)


def test_elements_in_no_term_are_masked_and_the_others_unchanged():
    mesh = MESHES["triangles"]
    ids = np.arange(5, mesh.nt)
    u = small(mesh)
    part, whole = (Fields(mesh, StVK(young=2.0, poisson=0.3, region=region)).at(u) for region in (ids, None))
    for name in ("cauchy", "green_strain", "strain_energy_density", "volume_ratio", "von_mises"):
        mask = np.ma.getmaskarray(part[name]).reshape(mesh.nt, -1)
        assert mask[:5].all() and not mask[5:].any()
        assert np.array_equal(np.ma.getdata(part[name])[5:], whole[name][5:])
        assert not np.ma.isMaskedArray(whole[name])


def test_solids_without_a_term_have_strain_but_no_stress():
    mesh = MESHES["tetrahedra"]
    now = Fields(mesh, StVK(young=2.0, poisson=0.3, region=np.arange(9))).at(small(mesh))
    for name in ("deformation_gradient", "green_strain", "volume_ratio", "principal_stretches"):
        assert not np.ma.is_masked(now[name])
    for name in ("pk1", "pk2", "cauchy", "von_mises", "strain_energy_density"):
        assert np.ma.getmaskarray(now[name]).reshape(mesh.nt, -1)[:, 0].sum() == mesh.nt - 9


def test_tension_stays_tension_in_an_inverted_element():
    mirrored = homogeneous("tetrahedra", np.diag([-1.3, 1, 1]))
    straight = homogeneous("tetrahedra", np.diag([1.3, 1, 1]))
    assert (mirrored["volume_ratio"] < 0).all()
    assert np.allclose(mirrored["cauchy"], straight["cauchy"], rtol=1e-12, atol=1e-13)
    assert straight["cauchy"][0, 0, 0] > 0.5


def test_an_element_that_has_shrunk_to_nothing_is_named_and_masked():
    mesh = ElementMesh([[0, 1, 0, 0, 1], [0, 0, 1, 0, 1], [0, 0, 0, 1, 1.0]], [[0, 1], [1, 2], [2, 3], [3, 4]])
    u = np.zeros((5, 3))
    u[0] = [1.0, 0, 0]  # onto vertex 1: exactly flat
    now = Fields(mesh, StVK(young=1.0, poisson=0.3)).at(u.ravel())
    with pytest.warns(StvkWarning, match=r"1 element \(0\): shrunk to zero volume"):
        cauchy = now["cauchy"]
    assert cauchy.mask[0].all() and not cauchy.mask[1].any()
    assert np.isfinite(np.ma.getdata(cauchy)).all()
    assert np.isfinite(now["pk1"]).all()


@pytest.mark.parametrize("name", ["triangles", "membrane", "cable"])
def test_results_without_thickness_are_masked(name):
    mesh = MESHES[name]
    u = affine(mesh, 3 * np.eye(3))
    term = StVK(young=2.0, poisson=0.3, plane="stress" if name == "triangles" else None)
    now = Fields(mesh, term).at(u)
    with pytest.warns(StvkWarning, match=f"{mesh.nt} elements .0, 1, .* leaves no thickness"):
        assert now["volume_ratio"].mask.all()
    assert now["cauchy"].mask.all() and now["von_mises"].mask.all() and now["principal_stretches"].mask.all()
    for field in ("pk1", "pk2", "green_strain", "strain_energy_density"):
        assert np.isfinite(now[field]).all() and not np.ma.is_masked(now[field])
    force = System(mesh, term).internal_force(u)
    rest = gradients(mesh.p, mesh.t)
    assert np.abs(forces(mesh, now["pk1"], rest, now.fields.volume) - force).max() < 1e-12 * np.abs(force).max()


@pytest.mark.parametrize("size", [1e80, 1e160, 1e300])
def test_overflow_is_refused(size):
    mesh = MESHES["tetrahedra"]
    with pytest.raises(StateError, match=r"overflow at displacements of up to .*: the previous step may have diverged"):
        Fields(mesh, StVK(young=1e200, poisson=0.3)).at(size * state(mesh))["pk2"]
