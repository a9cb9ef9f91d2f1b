"""Limits follow the shape of the mesh, and right bodies of any shape pass."""

import numpy as np
import pytest
import skfem
from bodies import box
from slow import slow

from skfem_stvk import ElementMesh, StVK, System, embedded_mesh, verify
from skfem_stvk.mesh.geometry import aspect_ratios
from skfem_stvk.referee.case import EDGES
from skfem_stvk.referee.checks.homogeneous import CLOSED_FORMS
from skfem_stvk.referee.results import CheckOutcome

TERM = StVK(young=2.0, poisson=0.3)
QUIET = {"quiet": True}


def of_simplices(report):
    """Return all results except those of edges and their pairs, whose limits are higher by an aspect ratio."""
    return [r for r in report.results if r.subject != EDGES]


@pytest.mark.few
@pytest.mark.parametrize("offset", [0.0, 1e6])
@pytest.mark.parametrize("size", [1e-6, 1.0, 1e6])
def test_unit_and_location_do_not_matter(size, offset):
    mesh = box(3)
    report = verify((size * (mesh.p + offset), mesh.t), TERM, **QUIET)
    assert report.passed, str(report)


#: States with displacements smaller than the edges of elements.
STRAINED = ("rest", "small random strain", "affine", *CLOSED_FORMS)


@pytest.mark.parametrize("squeeze", [1e-1, 1e-2, 2e-4])
def test_flat_elements_pass_with_limits_for_their_round_off(squeeze):
    mesh = box(3)
    report = verify((mesh.p * np.array([[1.0], [squeeze], [1.0]]), mesh.t), TERM, **QUIET)
    assert report.passed, str(report)
    aspect = aspect_ratios(ElementMesh(mesh.p * np.array([[1.0], [squeeze], [1.0]]), mesh.t)).max()
    strained = [r for r in of_simplices(report) if r.check in ("agreement", "closed forms", "patch test") and r.state in STRAINED]
    assert strained and max(r.limit for r in strained) <= 1.5 * max(1e-12, 20 * np.finfo(float).eps * aspect)


def test_a_loss_with_the_square_of_the_aspect_ratio_does_not_pass():
    """An error of eps x aspect^2 on flat elements does not pass. The Gram form has such an error."""
    mesh = box(3)
    flat = ElementMesh(mesh.p * np.array([[1.0], [1e-3], [1.0]]), mesh.t)
    body, loss = System(flat, TERM), np.finfo(float).eps * aspect_ratios(flat).max() ** 2

    class Gram:
        def internal_force(self, u):
            return body.internal_force(u) * (1 + loss)

    failed = {r.check for r in verify(flat, TERM, candidate=Gram(), **QUIET).failures()}
    assert 1e-11 < loss < 1e-8 and "agreement" in failed


def sliver(h):
    """Return two tetrahedra, one of them flat: four vertices around a square, h out of its plane."""
    p = np.array([[1, 0, h], [-1, 0, h], [0, 1, -h], [0, -1, -h], [0, 0, 2.0]]).T
    return p, np.array([[0, 1, 2, 3], [0, 1, 2, 4]]).T


@pytest.mark.few(2)
@pytest.mark.parametrize("h", [0.3, 0.1, 0.03, 0.01, 0.001])
def test_single_slivers_pass(h):
    assert verify(sliver(h), TERM, **QUIET).passed


def test_a_delaunay_mesh_of_random_points_passes():
    from scipy.spatial import Delaunay

    points = np.random.default_rng(0).random((200, 3))
    t = Delaunay(points).simplices.T
    x = points[t.T]
    t = t[:, np.abs(np.linalg.det(x[:, 1:] - x[:, :1])) > 1e-6]
    assert verify((points.T, t), TERM, **QUIET).passed


def test_slivers_that_an_offset_would_flatten_are_measured_without_it():
    p, t = sliver(3e-4)
    report = verify((3e-6 * p, t), TERM, **QUIET)
    assert {r["offset_m"] for r in report.precision} == {0.0, 1e3}
    assert not [r for r in report.results if r.outcome is CheckOutcome.COULD_NOT_RUN]


def test_long_chains_and_graded_meshes_pass():
    assert verify(skfem.MeshLine(np.linspace(0, 1, 3001)), young=1.0, **QUIET).passed
    graded = skfem.MeshTri().refined(1)
    for _ in range(9):
        graded = graded.refined(graded.elements_satisfying(lambda x: np.hypot(*x) < 1.5 * np.hypot(*x).min()))
    assert verify(graded, young=1.0, poisson=0.3, **QUIET).passed


def test_limits_of_ordinary_meshes_are_1e_12():
    limits = {(r.check, r.quantity, r.limit) for r in of_simplices(verify(embedded_mesh(), TERM, **QUIET)) if r.limit is not None}
    by_place = {limit for check, quantity, limit in limits if check in ("agreement", "symmetry", "balance") and quantity != "W"}
    assert by_place == {1e-12} and all(limit < 2e-11 for _, _, limit in limits)


def test_limits_follow_the_aspect_ratio_up_to_1e_6():
    """Limits grow with the aspect ratio up to 1e-6.

    Differences of two neighbouring states far from rest have the largest limits: the round-off of both states over their distance.
    """
    flat, flattest = (of_simplices(verify(sliver(h), TERM, **QUIET)) for h in (1e-5, 1e-9))
    assert max(r.limit for r in flat if r.limit is not None and r.check != "derivatives") < 2e-9
    assert max(r.limit for r in flat if r.check == "derivatives") < 1e-8
    assert max(r.limit for r in flattest if r.limit is not None) == 1e-6


def test_the_limits_of_edges_grow_with_the_square_of_the_aspect_ratio_and_are_needed():
    """Errors of edges on flat elements exceed the limit of simplices, and are below the limit of edges."""
    mesh = box(3)
    flat = ElementMesh(mesh.p * np.array([[1.0], [1e-3], [1.0]]), mesh.t)
    results = [r for r in verify(flat, TERM, **QUIET).results if r.check == "agreement" and r.state in STRAINED]
    aspect, eps = aspect_ratios(flat).max(), np.finfo(float).eps
    of = {name: [r for r in results if r.subject == name] for name in (EDGES, "skfem-stvk")}
    assert max(r.limit for r in of[EDGES]) < 30 * eps * aspect**2 < 1e-6
    assert max(r.measured for r in of["skfem-stvk"]) < 20 * eps * aspect < max(r.measured for r in of[EDGES])


@pytest.mark.parametrize("poisson", [slow(-0.999), slow(0.3), 0.499])
def test_an_energy_with_an_error_above_the_limit_of_flat_elements_fails_the_closed_forms(poisson):
    """An energy with a relative error of 1e-9 fails all closed forms on flat elements, also where lambda and mu cancel in W.

    At nu = -0.999 parts of opposite signs may leave 3e-11 of their size.
    """
    mesh = box(3)
    flat = (mesh.p * np.array([[1.0], [1e-2], [1.0]]), mesh.t)
    body = System(flat, StVK(young=2.0, poisson=poisson))

    class WrongEnergy:
        def energy(self, u):
            return body.energy(u) * (1 + 1e-9)

    report = verify(flat, body.terms[0], candidate=WrongEnergy(), **QUIET)
    failed = {r.state for r in report.failures() if r.check == "closed forms" and r.quantity == "W"}
    assert failed == set(CLOSED_FORMS)


@pytest.mark.few
@pytest.mark.parametrize("poisson", [-0.9999, -0.4, 0.0, 0.25, 0.45, 0.499, 0.49999])
def test_any_poisson_passes(poisson):
    assert verify(box(2), young=1.0, poisson=poisson, **QUIET).passed
