"""The critical step of each element is found, is not below the body's, and the critical elements are named."""

from dataclasses import replace

import numpy as np
import pytest
import skfem
from bodies import MESHES, box, distorted
from slow import slow

from skfem_stvk import (
    Corotated,
    ElasticFoundation,
    ElementMesh,
    NeoHookean,
    SpringNetwork,
    StVK,
    StvkError,
    System,
    VolumePenalty,
    critical_elements,
    critical_step,
)

RNG = np.random.default_rng(0)
CELLS = {"quadrilaterals": skfem.MeshQuad().refined(2), "hexahedra": skfem.MeshHex().refined(1)}
MORE = {name: ElementMesh.of(mesh) for name, mesh in CELLS.items()}
MORE = {name: replace(mesh, p=distorted(mesh.p, RNG, 0.1)) for name, mesh in MORE.items()}
MORE |= {f"quadratic {name}": MESHES[name].with_degree(2) for name in ("triangles", "tetrahedra", "segments", "cable")}
BODIES = MESHES | MORE


def body(name, **more):
    mesh = BODIES[name]
    rng = np.random.default_rng(1)
    law = StVK(young=rng.uniform(1, 3, mesh.nt), poisson=0.35, density=rng.uniform(0.5, 2, mesh.nt))
    return System(mesh, law, **more)


def of_one(system, e):
    """Return the step of one element, with K of a mesh of its own and the masses of the body."""
    mesh, law = system.mesh, system.terms[0]
    kept = np.unique(mesh.t[:, e])
    t = np.searchsorted(kept, mesh.t[:, [e]])
    one = ElementMesh(mesh.p[:, kept], t, element=mesh.element)
    material = law.material
    alone = System(one, StVK(young=material.young[e], poisson=0.35, density=material.density[e]), quadrature=system.quadrature)
    K, m = alone.tangent(np.zeros(alone.ndofs)).toarray(), np.repeat(system.mass().vertex[kept], mesh.d)
    return 2 / np.sqrt(np.linalg.eigvalsh(K / np.sqrt(np.outer(m, m)))[-1])


@pytest.mark.few
@pytest.mark.parametrize("name", BODIES)
def test_each_step_follows_from_the_own_stiffness_and_the_masses_of_the_body(name):
    system = body(name)
    found = critical_elements(system, 3)
    for e in (0, system.mesh.nt // 2, int(found.elements[0])):
        assert found.every[e] == pytest.approx(of_one(system, e), rel=1e-9)


@pytest.mark.parametrize("quadrature", [None, slow("one-point"), "exact"])
def test_steps_use_the_quadrature_of_the_system(quadrature):
    system = body("hexahedra", quadrature=quadrature)
    assert critical_elements(system).every[5] == pytest.approx(of_one(system, 5), rel=1e-9)


@pytest.mark.few
@pytest.mark.parametrize("name", BODIES)
def test_the_step_of_the_body_does_not_exceed_that_of_an_element(name):
    system = body(name, fixed={tuple(range(0, BODIES[name].nv, 4)): "x"})
    least, step = critical_elements(system, 1).steps[0], critical_step(system).step
    assert step <= least * (1 + 1e-3)  # the tolerance of eigenvalues
    assert least < 2.5 * step


@pytest.mark.parametrize("height", [1e-3, 1e-5])
def test_a_sliver_determines_the_step_of_the_body_to_five_percent(height):
    """Steps from the element's own mass alone would be ten times too short."""
    mesh = box(3)
    p = mesh.p.copy()
    a, b, c, apex = p[:, mesh.t[:, 40]].T
    normal = np.cross(b - a, c - a)
    p[:, mesh.t[3, 40]] = apex - (1 - height) * normal * (normal @ (apex - a)) / (normal @ normal)
    system = System(replace(mesh, p=p), StVK(young=1.0, poisson=0.3, density=1.0))
    found = critical_elements(system, 3)
    assert found.elements[0] == 40
    assert found.steps[0] == pytest.approx(critical_step(system).step, rel=0.05)


def test_steps_depend_on_the_displacements():
    system = body("tetrahedra")
    stretched = 0.5 * system.mesh.p.ravel("F")
    assert (critical_elements(system, u=stretched).every < critical_elements(system).every).all()


def test_laws_and_penalties_add_up_and_other_terms_are_named():
    mesh = box(2)
    floor = ElementMesh.of(skfem.MeshTet(mesh.p, mesh.t).with_boundaries({"floor": lambda x: x[2] < 0.1}))
    law = StVK(young=2.0, poisson=0.3, density=1.0)
    plain = critical_elements(System(floor, law))
    stiffer = critical_elements(System(floor, [law, VolumePenalty(50.0, kind="quadratic")]))
    assert (stiffer.every < plain.every).all() and plain.left_out == stiffer.left_out == ()
    bedded = System(floor, [law, ElasticFoundation("floor", stiffness=1e4)])
    assert critical_elements(bedded).left_out == ("ElasticFoundation 1",)
    np.testing.assert_array_equal(critical_elements(bedded).every, plain.every)
    for other in (NeoHookean, Corotated):
        np.testing.assert_allclose(critical_elements(System(floor, other(young=2.0, poisson=0.3, density=1.0))).every, plain.every)
    with pytest.raises(StvkError, match="SpringNetwork 0: expected at least one term on elements"):
        critical_elements(System(floor, SpringNetwork(young=2.0, poisson=0.25, density=1.0)))


def test_a_stiff_element_is_found():
    mesh = box(3)
    young = np.ones(mesh.nt)
    young[77] = 1e4
    found = critical_elements(System(mesh, StVK(young=young, poisson=0.3, density=1.0)), 4)
    assert found.elements[0] == 77 and found.steps[0] < 0.1 * found.steps[1] and "77" in repr(found)
    assert (np.diff(found.steps) >= 0).all() and len(found.steps) == 4
    np.testing.assert_array_equal(found.every[found.elements], found.steps)


def test_constrained_removed_and_unused_elements_have_infinite_steps():
    mesh = box(2)
    constrained = tuple(mesh.t[:, 5].tolist())
    system = System(mesh, StVK(young=1.0, poisson=0.3, density=1.0), fixed={constrained: "xyz"})
    with_all = critical_elements(system).every
    assert np.isinf(with_all[5]) and np.isfinite(np.delete(with_all, 5)).all()
    system = system.without([7])
    assert np.flatnonzero(np.isinf(critical_elements(system).every)).tolist() == [5, 7]
    some = StVK(young=1.0, poisson=0.3, density=1.0, region=np.delete(np.arange(mesh.nt), 3))
    assert np.flatnonzero(np.isinf(critical_elements(System(mesh, some)).every)).tolist() == [3]
