"""The referee judges all elements.

The package passes on straight and curved elements, flat elements, and elements far from the origin. Faults in tables of elements
are caught.
"""

from fractions import Fraction

import numpy as np
import pytest
import skfem
from bodies import CURVED, MESHES, box, boxes, curved, membrane

from skfem_stvk import Anisotropic, ElementMesh, StVK, System, verify
from skfem_stvk.mesh.element import ELEMENTS
from skfem_stvk.referee.discretisation import Discretisation, Shape, boundary_nodes, facet_ids
from skfem_stvk.referee.element_model import model_of
from skfem_stvk.referee.exact import ExactStVK
from skfem_stvk.referee.faults import FAULTS
from skfem_stvk.referee.results import CheckOutcome
from skfem_stvk.referee.verification import verify_candidate

TERM = StVK(young=2.0, poisson=0.3)
QUIET = {"quiet": True}


TETRAHEDRA = CURVED["quadratic tetrahedra"]
STRAIGHT = box(2).with_degree(2)
BODIES = {
    "straight tetrahedra": STRAIGHT,
    "straight and curved tetrahedra": ElementMesh(
        np.hstack([TETRAHEDRA.p[:, :47], STRAIGHT.p[:, 47:]]), STRAIGHT.t, element=STRAIGHT.element
    ),
    "straight membrane": membrane(3).with_degree(2),
    **CURVED,
}


@pytest.mark.few
@pytest.mark.parametrize("name", BODIES)
def test_all_elements_pass(name):
    report = verify(BODIES[name], TERM, **QUIET)
    assert report.passed, str(report)
    tested = {r.check for r in report.results if r.outcome is CheckOutcome.PASSED}
    assert {"agreement", "derivatives", "invariance", "balance", "symmetry", "rigid modes", "precision"} <= tested


@pytest.mark.parametrize("name", ["quadratic tetrahedra", "quadratic triangles"])
def test_the_exact_rule_passes_the_patch_test_on_curved_elements(name):
    report = verify(BODIES[name], TERM, quadrature="exact", **QUIET)
    assert report.passed, str(report)
    (patch,) = [r for r in report.results if r.check == "patch test"]
    assert patch.outcome is CheckOutcome.PASSED and "order" in report.header["mesh"]["rule"]


def test_curved_tetrahedra_with_four_points_get_no_patch_test_and_a_reason():
    (patch,) = [r for r in verify(TETRAHEDRA, TERM, **QUIET).results if r.check == "patch test"]
    assert patch.outcome is CheckOutcome.NOT_APPLICABLE and "quadrature='exact' does" in patch.reason


@pytest.mark.parametrize("k", [2, 3])
@pytest.mark.parametrize("hourglass", [None, 0.2, np.float32(0.3), Fraction(1, 5)])
def test_one_point_with_hourglass_control_passes(k, hourglass):
    mesh = boxes(k)
    report = verify(mesh, TERM, quadrature="one-point", hourglass=hourglass, **QUIET)
    assert report.passed, str(report)
    assert "mean gradients, hourglass control" in str(report)


def test_materials_of_all_kinds_pass_on_all_elements():
    rng = np.random.default_rng(0)
    a = rng.standard_normal((6, 6))
    material = Anisotropic(a @ a.T + 3 * np.eye(6), frame=np.linalg.qr(rng.standard_normal((3, 3)))[0])
    for name in ("quadratic tetrahedra", "quadratic membrane", "hexahedra"):
        half = BODIES[name].nt // 2
        terms = [StVK(material, region=np.arange(half)), StVK(young=3.0, poisson=0.4, region=np.arange(half, BODIES[name].nt))]
        assert verify(BODIES[name], terms, **QUIET).passed, name


@pytest.mark.parametrize("mesh", [box(1).with_degree(2), curved(box(1)), boxes(3, n=1)], ids=["straight", "curved", "hexahedra"])
def test_flat_elements_pass(mesh):
    flat = ElementMesh(mesh.p * np.array([[1.0], [1e-2], [1.0]]), mesh.t, element=mesh.element)
    report = verify(flat, TERM, **QUIET)
    assert report.passed, str(report)


def test_degree_2_of_a_linear_mesh_and_meshes_of_scikit_fem_are_the_same_body():
    mesh = skfem.MeshTet().refined(1)
    one, two = verify(mesh, TERM, degree=2, **QUIET), verify(skfem.MeshTet2.from_mesh(mesh), TERM, **QUIET)
    assert one.passed and two.passed
    assert one.header["mesh"]["elements"] == two.header["mesh"]["elements"] == "40 quadratic tetrahedra in 3D"
    assert one.header["mesh"]["nodes"] == two.header["mesh"]["nodes"]


def test_the_head_has_element_rule_and_number_of_curved_elements():
    report = verify(BODIES["straight and curved tetrahedra"], TERM, **QUIET)
    facts, text = report.header["mesh"], " ".join(str(report).split())
    assert 0 < facts["curved elements"] < 48 and facts["rule"] == "4 points of order 2"
    assert f"48 quadratic tetrahedra in 3D, {facts['curved elements']} of them curved" in text
    assert "integrated by 4 points of order 2" in text


@pytest.mark.slow
def test_a_right_model_passes_and_single_precision_does_not():
    candidate = model_of(TETRAHEDRA, [TERM])
    assert verify(TETRAHEDRA, TERM, candidate=candidate, **QUIET).passed
    single = System(TETRAHEDRA, TERM, dtype=np.float32)
    failed = verify(TETRAHEDRA, TERM, candidate=single, **QUIET).failures("candidate")
    assert {r.quantity for r in failed if r.check == "agreement"} == {"W", "F", "K"}
    assert max(r.measured for r in failed if r.check == "agreement" and r.state != "rigid rotation") < 1e-4


ON = {
    "one point dropped": ("quadratic triangles", "hexahedra", "quadrilaterals"),
    "a wrong weight": ("quadratic triangles", "hexahedra", "quadrilaterals"),
    "midside nodes exchanged": ("quadratic triangles",),
    "curved taken as straight": ("quadratic triangles",),
}


@pytest.mark.few
@pytest.mark.parametrize(("name", "body"), [(name, body) for name in ON for body in ON[name]])
def test_a_fault_in_the_tables_is_caught_on_other_elements_too(name, body):
    candidate = FAULTS[name].make(BODIES[body], [TERM])
    failures = verify_candidate(candidate, BODIES[body], [TERM]).failures()
    assert {r.quantity for r in failures if r.check == "agreement"} == {"W", "F", "K"}


def test_quadrilaterals_without_hourglass_control_have_zero_energy_modes():
    candidate, mesh = FAULTS["no hourglass control"], boxes(2)
    failures = verify_candidate(candidate.make(mesh, [TERM]), mesh, [TERM], given={"quadrature": "one-point"}).failures()
    assert {"agreement", "no further zero mode"} <= {r.check for r in failures}


def test_a_fault_in_one_curved_element_is_found_in_that_element():
    right = model_of(TETRAHEDRA, [TERM])
    X = right.X.copy()
    X[4, 7] += 1e-4

    class Misplaced:
        def internal_force(self, u):
            return type(right)(**(vars(right) | {"X": X})).internal_force(u)

    failures = [r for r in verify(TETRAHEDRA, TERM, candidate=Misplaced(), **QUIET).failures("candidate") if r.check == "agreement"]
    assert (
        failures
        and {tuple(r.worst["suspects"]) for r in failures} <= {(7,), ()}
        and (7,) in {tuple(r.worst["suspects"]) for r in failures}
    )


@pytest.mark.few
@pytest.mark.parametrize("name", [*MESHES, *BODIES])
def test_fifty_digits_agree_with_ours(name):
    mesh, rng = (MESHES | BODIES)[name], np.random.default_rng(1)
    how, (u, v) = Discretisation(mesh.element.name), 0.1 * rng.standard_normal((2, mesh.p.size)) / mesh.nt ** (1 / mesh.k)
    lam, mu = (float(value) for value in TERM.material.lame(TERM.hypothesis(mesh)))
    body, exact = System(mesh, TERM), ExactStVK(mesh.p, mesh.t, (lam, mu), how)
    (W, F), K = exact.energy_and_force(u), exact.tangent(u)
    assert body.energy(u) == pytest.approx(W, rel=1e-13)
    assert np.abs(body.internal_force(u) - F).max() < 1e-13 * np.abs(F).max()
    assert abs(body.tangent(u) - K).max() < 1e-13 * abs(K).max()
    assert np.abs(K @ v - exact.product(u, v)).max() < 1e-13 * np.abs(K @ v).max()


def test_fifty_digits_are_exact_where_doubles_are_not():
    """A uniaxial stretch by 1e-12 has the stress (lam + 2 mu) (1e-12 + ...) to all digits of a double, on a unit tetrahedron."""
    p, t = np.array([[0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]]), np.arange(4)[:, None]
    u, e = np.zeros(12), 1e-12
    u[3] = e
    _, F = ExactStVK(p, t, (1.5, 1.0)).energy_and_force(u)
    assert F[3] == pytest.approx(3.5 / 6 * (e + 1.5 * e**2), rel=1e-15)


def test_shapes_of_simple_elements():
    cube = ElementMesh(skfem.MeshHex().p, skfem.MeshHex().t, element=ELEMENTS["hexahedra"])
    assert Shape(cube, Discretisation("hexahedra")).aspect == pytest.approx([1.0])
    linear, quadratic = box(2), box(2).with_degree(2)
    one, two = (Shape(mesh, Discretisation(mesh.element.name)) for mesh in (linear, quadratic))
    assert two.aspect == pytest.approx(one.aspect) and two.volume == pytest.approx(one.volume)
    assert not two.curved.any() and Shape(TETRAHEDRA, Discretisation(TETRAHEDRA.element.name)).curved.all()


def test_facets_and_boundary_nodes_are_scikit_fems():
    mesh = skfem.MeshHex.init_tensor(*[np.linspace(0, 1, 4)] * 3)
    body = ElementMesh(mesh.p, mesh.t, element=ELEMENTS["hexahedra"])
    assert facet_ids(body).max() + 1 == mesh.nfacets
    assert np.array_equal(boundary_nodes(body), np.sort(mesh.boundary_nodes()))
    tets = skfem.MeshTet().refined(1)
    quadratic = ElementMesh.of(tets).with_degree(2)
    basis = skfem.Basis(tets, skfem.ElementTetP2())
    assert np.array_equal(boundary_nodes(quadratic), np.sort(basis.get_dofs().all()))
