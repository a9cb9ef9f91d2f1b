import numpy as np
import pytest
from bodies import MESHES

from skfem_stvk import ElementMesh, Isotropic, MaterialError, RegionError, StVK, System


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: StVK(), "A material is missing"),
        (lambda: StVK(poisson=0.3), "A material is missing"),
        (lambda: StVK(3.0), "material is of type float"),
        (lambda: StVK(Isotropic(1.0, 0.3), young=2.0), "got a material as well"),
        (lambda: StVK(young=1.0, poisson=0.3, plane="stran"), "plane = 'stran'; known: 'strain', 'stress'. Did you mean 'strain'"),
        (lambda: StVK(young=1.0, poisson=0.3, thickness=0.0), "thickness = 0.; expected values in"),
        (lambda: StVK(young=1.0, area=-1.0), "area = -1.; expected values in"),
    ],
)
def test_a_bad_specification_is_refused_at_construction(make, message):
    with pytest.raises(MaterialError, match=message):
        make()


@pytest.mark.parametrize(
    ("name", "term", "error", "message"),
    [
        (
            "tetrahedra",
            StVK(young=1.0, poisson=0.3, plane="stress"),
            MaterialError,
            "plane is for triangles; the mesh has tetrahedra in 3D",
        ),
        ("tetrahedra", StVK(young=1.0, poisson=0.3, thickness=1.0), MaterialError, "thickness is for triangles"),
        ("triangles", StVK(young=1.0, poisson=0.3, area=1.0), MaterialError, "area is for segments"),
        ("membrane", StVK(young=1.0, poisson=0.3, plane="strain"), MaterialError, "membranes, always in plane stress"),
        (
            "triangles",
            StVK(young=1.0, poisson=0.6),
            MaterialError,
            r"poisson \(plane strain\) = 0.6; expected values in \(-1, 0.5\)",
        ),
        ("tetrahedra", StVK(young=1.0), MaterialError, "poisson = None; expected a number"),
        ("triangles", StVK(young=1.0, poisson=0.3, thickness=np.ones(3)), MaterialError, "thickness has 3 values"),
        ("tetrahedra", StVK(young=np.ones(3), poisson=0.3), MaterialError, "young has 3 values; expected .* 162 elements"),
        ("tetrahedra", StVK(young=1.0, poisson=0.3, region="steel"), RegionError, "no subdomain 'steel'; known: none"),
        ("tetrahedra", StVK(young=1.0, poisson=0.3, region=[0, 162]), RegionError, r"1 element \(162\) outside 0 ... 161"),
    ],
)
def test_a_specification_that_does_not_fit_the_mesh_is_refused(name, term, error, message):
    with pytest.raises(error, match=message):
        System(MESHES[name], term)


def test_arrays_follow_the_order_of_the_region():
    mesh, order = MESHES["tetrahedra"], np.random.default_rng(0).permutation(MESHES["tetrahedra"].nt)
    young = np.random.default_rng(1).uniform(1, 2, mesh.nt)
    here = System(mesh, StVK(young=young, poisson=0.3))
    there = System(mesh, StVK(young=young[order], poisson=0.3, region=order))
    u = np.random.default_rng(2).standard_normal(here.ndofs) / 10
    assert np.allclose(here.internal_force(u), there.internal_force(u), rtol=1e-12, atol=1e-14)


def test_a_named_region_is_the_elements_of_the_subdomain():
    mesh = MESHES["tetrahedra"]
    ids = np.arange(40)
    named = ElementMesh(mesh.p, mesh.t, {"left": ids, "right": np.arange(40, mesh.nt)})
    terms = [StVK(young=1.0, poisson=0.3, region="left"), StVK(young=1.0, poisson=0.3, region="right")]
    u = np.random.default_rng(2).standard_normal(mesh.p.size) / 10
    assert System(named, terms).energy(u) == pytest.approx(System(mesh, StVK(young=1.0, poisson=0.3)).energy(u), rel=1e-13)


def test_a_specification_is_frozen_and_reusable():
    term = StVK(young=1.0, poisson=0.3)
    with pytest.raises(AttributeError):
        term.region = "other"
    assert System(MESHES["tetrahedra"], term).ndofs != System(MESHES["membrane"], term).ndofs


def test_the_shorthand_is_not_an_attribute():
    assert not hasattr(StVK(young=1.0, poisson=0.3), "young")
