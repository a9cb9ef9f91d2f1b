"""The stress of a volume penalty is a pressure, whose virtual work is that of the internal force."""

import numpy as np
import pytest
from bodies import BODIES, MESHES, state
from homogeneous import forces, gradients

from skfem_stvk import ElementMesh, StateError, StVK, StvkWarning, System, VolumePenalty
from skfem_stvk.results import Fields
from skfem_stvk.results.law_on_elements import dilation, volume_stress
from skfem_stvk.terms.laws.volume_penalty import ENERGIES

SOLID = [name for name in BODIES if name.split(",")[0] in ("tetrahedra", "triangles", "segments")]
KINDS = tuple(ENERGIES)


@pytest.mark.few
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", SOLID)
def test_the_internal_force_is_the_virtual_work_of_each_stress(name, kind):
    mesh, terms = BODIES[name]
    k = np.random.default_rng(0).uniform(5, 20, mesh.nt)
    terms = [*terms, VolumePenalty(k, kind)]
    u = state(mesh, 0.1 if mesh.d == 3 else 0.03)
    system, now = System(mesh, terms), Fields(mesh, terms).at(u)
    force, V = system.internal_force(u), now.fields.volume
    limit = 1e-11 * np.abs(force).max()
    assert np.abs(System(mesh, terms[-1]).internal_force(u)).max() > (1e-2 if kind == "quadratic" else 1e-4) * np.abs(force).max()
    rest, p, F = gradients(mesh.p, mesh.t), mesh.p + u.reshape(-1, mesh.d).T, np.asarray(now["deformation_gradient"])
    assert np.abs(forces(mesh, now["pk1"], rest, V) - force).max() < limit
    assert np.abs(forces(mesh, F @ now["pk2"], rest, V) - force).max() < limit
    assert np.abs(forces(mesh, now["cauchy"], gradients(p, mesh.t), V * np.abs(now["volume_ratio"])) - force).max() < limit
    assert (V * now["strain_energy_density"]).sum() == pytest.approx(system.energy(u), rel=1e-12)


@pytest.mark.few
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("J", [0.4, 0.9, 1.3])
@pytest.mark.parametrize(
    ("name", "plane"), [("tetrahedra", None), ("triangles", "strain"), ("triangles", "stress"), ("segments", None)]
)
def test_cauchys_stress_is_a_pressure(name, plane, J, kind):
    """The Cauchy stress is `psi' I` in solids and in plane strain.

    In plane stress and in segments the stress across is zero. The stress is per current area, with the thickness by StVK.
    """
    mesh, k = MESHES[name], 7.0
    gradient = np.linalg.qr(np.random.default_rng(1).standard_normal((mesh.d, mesh.d)))[0] * np.geomspace(1, 1.5, mesh.d)
    gradient[0] *= J / np.linalg.det(gradient)
    u = (mesh.p.T @ (gradient.T - np.eye(mesh.d))).ravel()
    stvk = StVK(young=2.0, poisson=0.1, plane=plane)
    without, both = (Fields(mesh, terms).at(u) for terms in (stvk, [stvk, VolumePenalty(k, kind)]))
    slope = k * float(ENERGIES[kind].slope(np.array(J - 1)))
    within = np.eye(3)
    if plane == "stress" or mesh.k == 1:
        within[mesh.k :] = 0
    else:
        assert without["volume_ratio"] == pytest.approx(np.full(mesh.nt, J))
    area = J / np.abs(np.asarray(without["volume_ratio"]))  # the thickness of StVK changes too
    wanted = slope * area[:, None, None] * within
    assert both["cauchy"] - without["cauchy"] == pytest.approx(wanted, abs=1e-12)
    density = k * float(ENERGIES[kind].density(np.array(J - 1)))
    assert both["strain_energy_density"] - without["strain_energy_density"] == pytest.approx(np.full(mesh.nt, density), abs=1e-12)
    assert np.array_equal(both["green_strain"], without["green_strain"])


def test_the_default_stiffness_and_the_region_are_those_of_the_system():
    mesh = MESHES["tetrahedra"]
    half = np.random.default_rng(0).permutation(mesh.nt)[: mesh.nt // 2]
    terms = [StVK(young=np.linspace(1, 9, mesh.nt), poisson=0.3), VolumePenalty(kind="compression", region=half)]
    u = state(mesh) - 0.3 * mesh.p.ravel("F")
    now, system = Fields(mesh, terms).at(u), System(mesh, terms)
    assert (now.fields.volume * now["strain_energy_density"]).sum() == pytest.approx(system.energy(u), rel=1e-13)
    plain = Fields(mesh, terms[0]).at(u)
    changed = np.abs(now["pk2"] - plain["pk2"]).max(axis=(1, 2)) > 1e-6
    assert 0.3 * mesh.nt < changed.sum() and set(np.flatnonzero(changed)) <= set(half)
    assert len(np.unique(now.fields.material_of)) == 2 and len(np.unique(now.fields.material_of[half])) == 1


def test_an_infinite_stress_is_marked_and_zero():
    """The area of the first triangle vanishes while the penalty has a slope; without a slope there is no stress."""
    gradient = np.array([np.diag([-1.0, 0.2]), np.diag([-1.0, 0.2]), np.diag([0.1, 0.2])])
    S, lost = volume_stress(np.array([3.0, 0.0, 3.0]), gradient, np.ones(3, dtype=bool))
    assert lost.tolist() == [True, False, False] and not S[:2].any() and S[2].any()


def test_elements_with_only_a_penalty_have_its_stress():
    for name in ("tetrahedra", "triangles", "segments"):
        mesh = MESHES[name]
        u = -0.2 * mesh.p.ravel("F")
        now = Fields(mesh, VolumePenalty(3.0, "quadratic")).at(u)
        across = [1.0] * 3 if mesh.k > 1 else [1.0, 0, 0]
        assert now["cauchy"] == pytest.approx(np.tile(np.diag(across) * 3 * (0.8**mesh.k - 1), (mesh.nt, 1, 1)))
        assert (now.fields.volume * now["strain_energy_density"]).sum() == pytest.approx(
            System(mesh, VolumePenalty(3.0, "quadratic")).energy(u)
        )


def test_the_stress_of_inverted_elements_follows_the_convention():
    """The Cauchy stress of inverted elements is per absolute area, so that a stress that restores the volume is tension.

    The barrier has no stress there.
    """
    mesh = MESHES["tetrahedra"]
    u = (-2.2 * mesh.p.T * [1, 0, 0]).ravel()
    for kind in ("quadratic", "compression"):
        now = Fields(mesh, VolumePenalty(2.0, kind)).at(u)
        slope = 2 * float(ENERGIES[kind].slope(np.array(-2.2)))
        assert now["cauchy"] == pytest.approx(np.tile(-slope * np.eye(3), (mesh.nt, 1, 1)), rel=1e-9)
        force = System(mesh, VolumePenalty(2.0, kind)).internal_force(u)
        assert (
            np.abs(forces(mesh, now["pk1"], gradients(mesh.p, mesh.t), now.fields.volume) - force).max()
            < 1e-11 * np.abs(force).max()
        )
    with pytest.raises(StateError, match=f"{mesh.nt} elements .* inverted or flat .* barrier"):
        Fields(mesh, [StVK(young=1.0, poisson=0.3), VolumePenalty(2.0, "barrier")]).at(u)["pk2"]


def test_an_element_that_has_shrunk_to_nothing_is_named_once_and_masked():
    mesh = ElementMesh([[0, 1, 0, 0, 1], [0, 0, 1, 0, 1], [0, 0, 0, 1, 1.0]], [[0, 1], [1, 2], [2, 3], [3, 4]])
    u = np.zeros((5, 3))
    u[0] = [1.0, 0, 0]  # onto vertex 1: exactly flat
    now = Fields(mesh, [StVK(young=1.0, poisson=0.3), VolumePenalty(kind="compression")]).at(u.ravel())
    with pytest.warns(StvkWarning, match=r"1 element \(0\): shrunk to zero volume .* stress is infinite") as caught:
        for name in ("cauchy", "pk1", "pk2", "von_mises"):
            mask = np.ma.getmaskarray(now[name]).reshape(2, -1)
            assert mask[0].all() and not mask[1].any() and np.isfinite(np.ma.getdata(now[name])).all()
    assert len(caught) == 1
    assert not np.ma.is_masked(now["strain_energy_density"]) and now["strain_energy_density"][0] > 0


@pytest.mark.parametrize("k", [1, 2, 3])
def test_the_dilation_has_no_cancellation(k):
    H = np.random.default_rng(k).standard_normal((20, k, k))
    assert dilation(H) == pytest.approx(np.linalg.det(np.eye(k) + H) - 1, rel=1e-9, abs=1e-12)
    small = 1e-12 * (H @ np.swapaxes(H, 1, 2))
    assert dilation(small) == pytest.approx(np.trace(small, axis1=1, axis2=2), rel=1e-10)
