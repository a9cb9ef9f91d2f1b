"""Findings of the monitors: elements, extremes, and no finding without a cause."""

import numpy as np
import pytest
from bodies import BODIES, CURVED, MESHES, box, random_frames, state
from solvers.statics.beams import block

from skfem_stvk import (
    Anisotropic,
    ElasticFoundation,
    ElementMesh,
    Isotropic,
    Orthotropic,
    StVK,
    System,
    TransverselyIsotropic,
    VolumePenalty,
    solve_static,
)
from skfem_stvk.errors import StvkWarning
from skfem_stvk.results import Fields
from skfem_stvk.results.monitors import Monitors, poisson_of

FOUNDATION = ElasticFoundation(lambda x: x[0] < 0.5, stiffness=1.0)


def in_regions(mesh, *materials):
    """Return a body with each material in a separate region, with unordered ids, and a term without simplices in between."""
    parts = np.array_split(np.random.default_rng(5).permutation(mesh.nt), len(materials))
    terms = [StVK(material, region=part) for material, part in zip(materials, parts, strict=True)]
    return System(mesh, [terms[0], FOUNDATION, *terms[1:]]), parts


def named(findings):
    return {finding.name: finding for finding in findings}


@pytest.mark.few
@pytest.mark.parametrize("name", BODIES)
@pytest.mark.parametrize("amount", [0.0, 0.01])
def test_a_slightly_deformed_body_has_no_findings(name, amount):
    mesh, terms = BODIES[name]
    assert Monitors(System(mesh, terms)).at(state(mesh, amount)) == ()


@pytest.mark.parametrize("name", ["tetrahedra", "triangles"])
def test_inverted_and_compressed_elements_are_named_in_all_regions(name):
    mesh = MESHES[name]
    system, _ = in_regions(mesh, Isotropic(1.0, 0.2), Isotropic(2.0, 0.4))
    u = state(mesh, 0.4 if mesh.k == 3 else 0.8)
    found, now = named(Monitors(system).at(u)), Fields(mesh, system.elastic_terms).at(u)
    J, stretches = np.asarray(now["volume_ratio"]), np.asarray(now["principal_stretches"])[:, : mesh.k].min(axis=1)
    if name == "triangles":  # stretches within the plane; those across are 1
        stretches = np.linalg.svd(now.responses[0].gradient + np.eye(2), compute_uv=False)[:, -1]
    assert list(found) == ["inside out", "compressed"]
    for finding, wanted, extreme in (
        (found["inside out"], J <= 0, J.min()),
        (found["compressed"], stretches < 3**-0.5, stretches.min()),
    ):
        assert 3 < wanted.sum() < mesh.nt - 3
        assert np.array_equal(finding.elements, np.flatnonzero(wanted))
        assert finding.extreme == pytest.approx(extreme, rel=1e-9) and isinstance(finding.extreme, float)


def test_the_limit_is_one_over_the_root_of_three_and_zero():
    mesh = MESHES["tetrahedra"]
    monitors = Monitors(System(mesh, StVK(young=1.0, poisson=0.3)))

    def names(s):
        return [finding.name for finding in monitors.at(((s - 1) * mesh.p * [[1], [0], [0]]).ravel("F"))]

    assert names(3**-0.5 + 1e-9) == [] and names(3**-0.5 - 1e-9) == ["compressed"]
    assert names(1e-6) == ["compressed"] and names(-1e-6) == ["inside out", "compressed"] and names(-1.0) == ["inside out"]


@pytest.mark.parametrize("name", ["membrane", "cable"])
def test_membranes_and_cables_may_be_compressed_but_not_inverted(name):
    mesh = MESHES[name]
    monitors = Monitors(System(mesh, StVK(young=1.0, poisson=0.3)))
    (finding,) = monitors.at(-1.4 * mesh.p.ravel("F"))
    assert finding.name == "compressed" and len(finding.elements) == mesh.nt and finding.extreme == pytest.approx(0.4)
    assert "wrinkle" in finding.text and "VolumePenalty" not in finding.text


def test_elements_that_lock_are_named_in_all_regions():
    mesh = MESHES["tetrahedra"]
    n = len(np.array_split(np.arange(mesh.nt), 3)[1])
    many = Isotropic(1.0, np.linspace(0.4, 0.49, n))
    system, parts = in_regions(mesh, Isotropic(1.0, 0.45), many, Isotropic(1.0, 0.4999))
    (finding,) = Monitors(system).before()
    assert finding.name == "locking" and finding.extreme == 0.4999
    wanted = np.concatenate([parts[1][many.poisson > 0.45], parts[2]])
    assert np.array_equal(finding.elements, np.sort(wanted)) and 0 < len(wanted) - len(parts[2]) < n
    first = finding.elements[0]
    assert first > 0 and f"({', '.join(f'{x:.4g}' for x in mesh.p[:, mesh.t[:, first]].mean(axis=1))}) at rest" in finding.text


@pytest.mark.parametrize("nu", [-0.5, 0.3, 0.45, 0.4501])
def test_only_poissons_ratios_above_the_limit_lock(nu):
    found = Monitors(System(MESHES["tetrahedra"], StVK(young=1.0, poisson=nu))).before()
    assert len(found) == (nu > 0.45)


def test_plane_strain_locks_and_plane_stress_membranes_and_cables_do_not():
    term, mesh = StVK(young=1.0, poisson=0.499), MESHES["triangles"]
    assert len(Monitors(System(mesh, term)).before()[0].elements) == mesh.nt
    for name, options in (("triangles", {"plane": "stress"}), ("membrane", {}), ("cable", {}), ("segments", {})):
        system = System(MESHES[name], StVK(young=1.0, poisson=0.499, **options))
        assert Monitors(system).before() == ()


@pytest.mark.parametrize("nu", [-0.3, 0.0, 0.3, 0.49])
def test_poissons_ratio_of_an_isotropic_material_does_not_depend_on_its_class(nu):
    G = 1 / (2 * (1 + nu))
    matrix = Orthotropic(young=(1.0, 1.0, 1.0), poisson=(nu, nu, nu), shear=(G, G, G)).stiffness()
    frame = random_frames(1, np.random.default_rng(2))[0]
    for material in (
        Isotropic(1.0, nu),
        Anisotropic(np.stack([matrix, 3 * matrix]), frame=frame),
        TransverselyIsotropic(1.0, 1.0, poisson_axial=nu, poisson_transverse=nu, shear_axial=G),
    ):
        assert np.allclose(poisson_of(material), nu, rtol=0, atol=1e-12)


def test_poissons_ratio_of_other_materials_is_that_of_the_reuss_averages():
    """Poisson's ratio of anisotropic materials is that of the Reuss averages of K and G.

    `K` is from the change of volume under pressure. `G` is from the mean over all directions of shear, by random rotations.
    """
    rng = np.random.default_rng(0)
    material = Orthotropic(young=(9.0, 1.5, 0.5), poisson=(0.3, 0.25, 0.2), shear=(0.2, 0.5, 0.7))
    compliance = np.linalg.inv(material.stiffness())
    pressure = compliance @ [1.0, 1, 1, 0, 0, 0]
    Q = np.linalg.qr(rng.standard_normal((200_000, 3, 3)))[0]
    m, n = Q[:, :, 0], Q[:, :, 1]
    stress = np.stack(
        [
            2 * m[:, 0] * n[:, 0],
            2 * m[:, 1] * n[:, 1],
            2 * m[:, 2] * n[:, 2],
            *(m[:, i] * n[:, j] + m[:, j] * n[:, i] for i, j in ((1, 2), (0, 2), (0, 1))),
        ],
        axis=1,
    )
    K, G = 1 / pressure[:3].sum(), 1 / np.einsum("ni,ij,nj->n", stress, compliance, stress).mean()
    assert float(poisson_of(material)) == pytest.approx((3 * K - 2 * G) / (6 * K + 2 * G), abs=3e-3)


def test_rubber_with_fibres_locks():
    """Rubber with fibres locks at any direction of the fibres, because its bulk is nearly incompressible."""
    mesh, fibre = MESHES["tetrahedra"], np.zeros((6, 6))
    fibre[0, 0] = 50.0
    lam, mu = 0.49 / (1.49 * 0.02), 1 / 2.98
    rubber = np.diag([2 * mu] * 3 + [mu] * 3)
    rubber[:3, :3] += lam
    term = StVK(Anisotropic(rubber + fibre, frame=random_frames(mesh.nt, np.random.default_rng(1))))
    (finding,) = Monitors(System(mesh, term)).before()
    assert finding.name == "locking" and len(finding.elements) == mesh.nt


def test_texts_have_finding_location_and_remedy():
    mesh = box(1)
    system = System(mesh, StVK(young=1.0, poisson=0.47))
    (locking,) = Monitors(system).before()
    centre = ", ".join(f"{x:.4g}" for x in mesh.p[:, mesh.t[:, 0]].mean(axis=1))
    assert f"6 elements (0, 1, 2, 3, 4, ...), the first at ({centre}) at rest" in locking.text
    for word in ("0.47", "lock", "finer mesh", "smaller Poisson's ratio", "degree=2"):
        assert word in locking.text
    found = named(Monitors(system).at(-1.3 * mesh.p.ravel("F")))
    assert set(found) == {"inside out", "compressed"}
    assert "VolumePenalty" in found["inside out"].text and "J down to -0.027" in found["inside out"].text
    assert "VolumePenalty" in found["compressed"].text and "down to 0.3" in found["compressed"].text


def test_a_volume_penalty_is_not_recommended_if_used():
    mesh = box(1)
    system = System(mesh, [StVK(young=1.0, poisson=0.3), VolumePenalty(kind="compression")])
    for finding in Monitors(system).at(-1.3 * mesh.p.ravel("F")):
        assert "add a VolumePenalty" not in finding.text and "or a VolumePenalty" not in finding.text


def test_only_elements_in_a_term_are_monitored():
    mesh = MESHES["tetrahedra"]
    used = np.unique(mesh.t[:, :5])
    u = np.zeros((mesh.nv, 3))
    u[used] = -1.4 * mesh.p.T[used]
    with pytest.warns(StvkWarning, match="in no term"):
        system = System(mesh, StVK(young=1.0, poisson=0.3, region=np.arange(5)))
    for finding in Monitors(system).at(u.ravel()):
        assert np.array_equal(finding.elements, np.arange(5))


def test_without_findings_no_lists_of_elements_are_computed(monkeypatch):
    """Without findings, the monitors compute only the smallest values, and no arrays over all elements."""
    mesh = MESHES["tetrahedra"]
    system = System(mesh, StVK(young=1.0, poisson=0.3))
    (term,) = system.bound_terms
    for name in ("volume_ratios", "smallest_stretches"):
        monkeypatch.setattr(term, name, lambda u: pytest.fail("a list was made"))
    assert Monitors(system).at(state(mesh, 0.02)) == ()


def test_a_solve_warns_from_which_load_the_model_is_unreliable():
    with pytest.warns(StvkWarning, match=r"From t = .* 1/sqrt\(3\)"):
        result = solve_static(block(0.44, n=3, nu=0.0), quiet=True, raise_on_failure=False)
    found = [{finding.name for finding in step.findings} for step in result.history]
    assert "compressed" not in found[0] and any("compressed" in names for names in found)


def test_a_finding_in_a_mesh_of_one_element_has_its_location():
    mesh = ElementMesh(np.array([[0.0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 2]]), np.array([[0], [1], [2], [3]]))
    (finding,) = Monitors(System(mesh, StVK(young=1.0, poisson=0.3))).at(-0.5 * mesh.p.ravel("F"))
    assert finding.text.startswith("1 element (0), the first at (0.25, 0.25, 0.5) at rest: compressed")


@pytest.mark.parametrize("name", CURVED)
def test_elements_with_several_points_are_monitored_at_points_and_volumes_also_at_nodes(name):
    mesh = CURVED[name]
    system = System(mesh, StVK(young=1.0, poisson=0.47))
    locking = Monitors(system).before()
    assert [finding.name for finding in locking] == (["locking"] if mesh.element.shape.one_point and mesh.k == mesh.d else [])
    assert not locking or "one-point" in locking[0].text
    found = named(Monitors(system).at(-0.5 * mesh.p.ravel("F")))
    assert "compressed" in found and found["compressed"].extreme == pytest.approx(0.5, rel=1e-9)
    assert len(found["compressed"].elements) == mesh.nt and "inside out" not in found
    if mesh.k == mesh.d:
        inverted = named(Monitors(system).at(-1.3 * mesh.p.ravel("F")))
        assert ("inside out" in inverted) == (mesh.d != 2) and "compressed" in inverted
