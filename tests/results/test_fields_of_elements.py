"""Strain and stress of elements with several points equal scikit-fem's at its points.

Tests include homogeneous states and the extrapolation to nodes.
"""

import numpy as np
import pytest
import skfem
from bodies import CURVED, STRAIGHT, scikit_fem_of, some_voigt, state, values_at
from skfem.helpers import grad, identity, mul, trace, transpose

from skfem_stvk import Anisotropic, StVK, StvkError, System
from skfem_stvk.mesh.points import rule_of
from skfem_stvk.results import Fields, names

SOLID = [name for name in CURVED if scikit_fem_of(CURVED[name])]
SECTION = {1: {"area": 0.3}, 2: {"thickness": 0.3}, 3: {}}


def material(mesh, **more):
    young = np.random.default_rng(1).uniform(1, 3, mesh.nt)
    return StVK(young=young, poisson=0.3, **SECTION[mesh.k], **more)


@pytest.mark.parametrize("name", SOLID)
def test_strain_and_stress_at_the_points_are_scikit_fems(name):
    """Strain and stress at the points equal scikit-fem's.

    Plane problems are in plane strain; scikit-fem's tensor has no stress across.
    """
    mesh, known = CURVED[name], scikit_fem_of(CURVED[name])
    points, weights = rule_of(mesh.element)
    basis = skfem.Basis(known.mesh, known.elem, quadrature=(points.T, weights))
    u, term = state(mesh, 0.2), material(mesh)
    now = Fields(mesh, term).at(u)
    F = grad(basis.interpolate(u)) + identity(grad(basis.interpolate(u)))
    E = (mul(transpose(F), F) - identity(F)) / 2
    lam, mu = (np.asarray(c)[:, None] for c in term.material.lame(term.hypothesis(mesh)))
    S = lam * trace(E) * identity(E) + 2 * mu * E
    k = mesh.k
    for field, exact in (("deformation_gradient", F), ("green_strain", E), ("pk2_stress", S)):
        found = now.at_points(field)
        assert found.shape == (mesh.nt, len(weights), 3, 3)
        exact = np.moveaxis(np.asarray(exact), (2, 3), (0, 1))
        assert np.abs(found[..., :k, :k] - exact).max() < 1e-12 * np.abs(exact).max()
        mean = np.einsum("tq,tqij->tij", basis.dx, exact) / basis.dx.sum(axis=1)[:, None, None]
        assert np.abs(now[field][:, :k, :k] - mean).max() < 1e-12 * np.abs(exact).max()
    density = (S * E).sum(axis=(0, 1)) / 2
    np.testing.assert_allclose(now.at_points("strain_energy_density"), density, rtol=1e-11, atol=1e-13 * density.max())


@pytest.mark.parametrize("name", STRAIGHT)
def test_the_energy_of_straight_elements_is_density_times_volume(name):
    mesh = STRAIGHT[name]
    fields, u = Fields(mesh, material(mesh)), state(mesh, 0.2)
    assert fields.at(u)["strain_energy_density"] @ fields.volume == pytest.approx(System(mesh, material(mesh)).energy(u), rel=1e-12)


@pytest.mark.few
@pytest.mark.parametrize("law", ["isotropic", "anisotropic"])
@pytest.mark.parametrize("name", CURVED)
def test_all_fields_of_a_homogeneous_state_are_the_same_everywhere(name, law):
    """All fields of a homogeneous state are constant by element, at points and at nodes, also on curved elements: the patch test.

    Membranes and cables are stretched equally in all directions. Their tensors have axes that vary from point to point.
    """
    mesh, rng = CURVED[name], np.random.default_rng(2)
    fills = mesh.k == mesh.d
    term = StVK(young=2.0, poisson=0.3) if law == "isotropic" or not fills else StVK(Anisotropic(some_voigt(rng)))
    H = 0.2 * rng.standard_normal((mesh.d, mesh.d)) if fills else 0.2 * np.eye(mesh.d)
    now = Fields(mesh, term).at((H @ mesh.p).T.ravel())
    alike = [field for field in names() if fills or field in ("volume_ratio", "von_mises_stress", "strain_energy_density")]
    for field in alike:
        by_element = now[field]
        for values in (now.at_nodes(field), now.at_points(field), by_element):
            assert np.abs(values - by_element[0]).max() < 1e-9 * max(1.0, np.abs(by_element[0]).max()), field
    if fills:
        assert np.abs(now["deformation_gradient"][:, : mesh.d, : mesh.d] - np.eye(mesh.d) - H).max() < 1e-12


@pytest.mark.parametrize("name", [name for name in STRAIGHT if STRAIGHT[name].element.degree == 2])
def test_linear_fields_are_extrapolated_to_nodes_exactly(name):
    """Linear strains and stresses are extrapolated exactly; they belong to a small quadratic displacement."""
    mesh, small = STRAIGHT[name], 1e-9
    rng = np.random.default_rng(3)
    A, B = rng.standard_normal((mesh.d, mesh.d)), rng.standard_normal((mesh.d, mesh.d, mesh.d))
    u = small * (A @ mesh.p + np.einsum("ijk,jn,kn->in", B, mesh.p, mesh.p))
    now = Fields(mesh, StVK(young=2.0, poisson=0.3)).at(u.T.ravel())
    gradient = small * (A[:, :, None] + np.einsum("ijk,kn->ijn", B + B.transpose(0, 2, 1), mesh.p))
    strain = np.moveaxis(gradient + gradient.transpose(1, 0, 2), 2, 0) / 2
    d = mesh.d
    assert np.abs(now.at_nodes("green_strain")[:, :d, :d] - strain).max() < 1e-7 * small
    x = values_at(mesh.p, mesh.t, mesh.element, rule_of(mesh.element).points)
    at = small * (A + np.einsum("ijk,tqk->tqij", B + B.transpose(0, 2, 1), x))
    assert np.abs(now.at_points("green_strain")[..., :d, :d] - (at + at.swapaxes(2, 3)) / 2).max() < 1e-7 * small


@pytest.mark.parametrize("name", ["quadrilaterals", "hexahedra"])
def test_fields_of_boxes_that_are_linear_along_each_axis_are_extrapolated_exactly(name):
    mesh = STRAIGHT[name]
    fields = Fields(mesh, StVK(young=2.0, poisson=0.3))
    points = rule_of(mesh.element).points
    f = lambda x: 1 + np.prod(x + 0.3, axis=-1)  # noqa: E731
    np.testing.assert_allclose(fields.to_nodes @ f(points), f(mesh.element.nodes), rtol=1e-12)


@pytest.mark.parametrize(
    ("make", "options", "order"),
    [
        (skfem.MeshTet, {"degree": 2}, 1.8),
        (skfem.MeshTri, {"degree": 2}, 1.8),
        (skfem.MeshHex, {}, 0.9),
        (skfem.MeshQuad, {}, 0.9),
        (skfem.MeshHex, {"quadrature": "one-point"}, 0.9),
        (skfem.MeshQuad, {"quadrature": "one-point"}, 0.9),
    ],
    ids=lambda given: given.__name__ if isinstance(given, type) else str(given),
)
def test_extrapolated_stresses_of_a_smooth_state_converge_at_all_nodes(make, options, order):
    """Extrapolated stresses converge at large strains in cells of different sizes.

    Gradients of quadratic elements are linear, which gives order 2. Gradients of boxes are constant along their own axis, which
    gives order 1 at nodes without neighbours to compensate.
    """
    d, errors = make().dim(), []

    def moved(x):
        return 0.1 * np.stack([np.sin(2 * x[(i + 1) % d]) + x[i] ** 2 for i in range(d)])

    for n in (4, 8):
        lines = [np.linspace(0, 1, n + 1) ** 1.2] * d
        system = System(make.init_tensor(*lines), StVK(young=2.0, poisson=0.3), **options)
        x = system.mesh.p
        F = np.eye(d)[:, :, None] + np.zeros((d, d, x.shape[1]))
        for i in range(d):
            F[i, (i + 1) % d] += 0.2 * np.cos(2 * x[(i + 1) % d])
            F[i, i] += 0.2 * x[i]
        E = (np.einsum("kin,kjn->nij", F, F) - np.eye(d)) / 2
        lam, mu = 2.0 * 0.3 / (1.3 * 0.4), 2.0 / 2.6
        S = lam * np.trace(E, axis1=1, axis2=2)[:, None, None] * np.eye(d) + 2 * mu * E
        found = Fields.of(system).at(moved(x).T.ravel()).at_nodes("pk2_stress")[:, :d, :d]
        errors.append(np.abs(found - S).max() / np.abs(S).max())
    assert errors[1] < 0.1 and np.log2(errors[0] / errors[1]) > order


def test_elements_without_a_term_are_masked_at_points_and_nodes():
    mesh = CURVED["quadratic tetrahedra"]
    now = Fields(mesh, StVK(young=2.0, poisson=0.3, region=np.arange(20))).at(state(mesh, 0.1))
    for values in (now["cauchy"], now.at_points("cauchy")):
        assert np.array_equal(np.ma.getmaskarray(values).reshape(mesh.nt, -1).all(axis=1), np.arange(mesh.nt) >= 20)
    there = np.zeros(mesh.nv, dtype=bool)
    there[mesh.t[:, :20]] = True
    assert np.array_equal(~np.ma.getmaskarray(now.at_nodes("cauchy")).reshape(mesh.nv, -1).any(axis=1), there)


@pytest.mark.parametrize("name", ["quadrilaterals", "hexahedra"])
def test_boxes_with_one_point_have_the_fields_of_their_mean_gradient(name):
    mesh, u = CURVED[name], state(CURVED[name], 0.2)
    system = System(mesh, material(mesh), quadrature="one-point", hourglass=0.0)
    fields = Fields.of(system)
    now, usual = fields.at(u), Fields(mesh, material(mesh)).at(u)
    assert now.at_points("pk2_stress").shape == (mesh.nt, 1, 3, 3)
    assert np.abs(now["deformation_gradient"] - usual["deformation_gradient"]).max() < 0.02
    assert np.abs(now["green_strain"] - usual["green_strain"]).max() > 1e-4
    assert now["strain_energy_density"] @ fields.volume == pytest.approx(system.energy(u), rel=1e-12)
    assert now.at_nodes("cauchy").shape == (mesh.nv, 3, 3)


def test_an_unknown_rule_of_fields_is_refused():
    with pytest.raises(StvkError, match="quadrature = 'best'; known: 'exact', 'one-point'"):
        Fields(CURVED["hexahedra"], StVK(young=1.0, poisson=0.3), quadrature="best")
