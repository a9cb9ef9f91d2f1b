"""Stress and energy density of the compiled laws at points equal those of the readable laws.

The tests include small strains and flat elements.
"""

import numpy as np
import pytest
from bodies import CURVED, MESHES, state

from skfem_stvk import Corotated, InvertibleStVK, NeoHookean, StVK, StvkWarning, System
from skfem_stvk.mesh.geometry import Geometry
from skfem_stvk.results import Fields

EVERY = MESHES | {name: CURVED[name] for name in ("quadratic tetrahedra", "hexahedra", "quadratic membrane")}
FIELDS = ("pk2_stress", "green_strain", "strain_energy_density")


def laws_on(mesh):
    """Return all laws with their own stress that fit the mesh, with heterogeneous constants, by name and plane."""
    rng = np.random.default_rng(6)
    constants = {"young": rng.uniform(1, 4, mesh.nt), "poisson": rng.uniform(0.05, 0.45, mesh.nt)}
    planes = ("strain", "stress") if mesh.k == mesh.d == 2 else (None,)
    found = {(law.__name__, plane): law(**constants, plane=plane) for law in (Corotated, InvertibleStVK) for plane in planes}
    if mesh.k > 1:
        found |= {("NeoHookean", plane): NeoHookean(**constants, plane=plane) for plane in planes}
    if mesh.k < 3:
        found["wrinkling", planes[-1]] = StVK(**constants, plane=planes[-1], wrinkling=True)
    return found


def fields_of(mesh, law, u):
    now = Fields.of(System(mesh, law)).at(u)
    return {name: np.asarray(now[name]) for name in FIELDS}


def states_for(law, mesh):
    """Return finite displacements by name.

    Laws that have a stress in inverted elements get a state with inverted elements. Tension fields get a state with slack.
    """
    x, noise = mesh.p.ravel("F"), state(mesh)
    found = {"wide": 0.1 * noise + 0.8 * x}
    if law == "wrinkling":
        return found | {"wrinkled": 0.3 * noise}
    found |= {"pushed": 0.1 * noise - 0.3 * x}
    return found if law == "NeoHookean" else found | {"inside out": noise - 1.6 * x * (np.arange(len(x)) % mesh.d == 0)}


@pytest.mark.few
@pytest.mark.parametrize("strain", [1e-6, 1e-12])
@pytest.mark.parametrize("name", EVERY)
def test_small_strains_have_the_fields_of_linear_elasticity(name, strain):
    """At small strains all fields equal those of StVK up to the nonlinear part.

    The fields include the strain across elements with zero stress across.
    """
    mesh = EVERY[name]
    u = strain * state(mesh)
    for (law, plane), term in laws_on(mesh).items():
        if law == "wrinkling":
            continue
        stvk = StVK(term.material, plane=plane)
        wanted, found = fields_of(mesh, stvk, u), fields_of(mesh, term, u)
        for field in FIELDS:
            size = np.abs(wanted[field]).max()
            assert size > 0 and np.abs(found[field] - wanted[field]).max() < (1e-13 + 20 * strain) * size, (law, plane, field)


def test_neo_hookean_sheets_at_large_stretch_have_no_stress_across():
    mesh = MESHES["membrane"]
    now = fields_of(mesh, NeoHookean(young=2.0, poisson=0.4), 4 * mesh.p.ravel("F") + 0.1 * state(mesh))
    S, axes = now["pk2_stress"], Geometry(mesh.p, mesh.t).axes
    normals = np.cross(axes[..., 0], axes[..., 1])
    assert np.abs(now["green_strain"]).max() > 9
    assert np.abs(np.einsum("nij,nj->ni", S, normals)).max() < 1e-14 * np.abs(S).max()


@pytest.mark.parametrize(("name", "share"), [("membrane", 2 * 0.3 / 0.7), ("cable", 0.3)])
@pytest.mark.parametrize("law", [Corotated, InvertibleStVK])
def test_the_stretch_across_stretched_sheets_and_cables_is_that_of_linear_elasticity(law, name, share):
    """If all stretches within the element are 1.4, Poisson's effect is that of their elongation, or of their Green strain."""
    mesh = MESHES[name]
    strain = np.linalg.eigvalsh(fields_of(mesh, law(young=2.0, poisson=0.3), 0.4 * mesh.p.ravel("F"))["green_strain"])
    across = ((1 - share * 0.4) ** 2 - 1) / 2 if law is Corotated else -share * 0.48
    assert strain[:, 0] == pytest.approx(across, rel=1e-12) and strain[:, -1] == pytest.approx((1.4**2 - 1) / 2, rel=1e-12)


@pytest.mark.parametrize("name", [name for name, mesh in EVERY.items() if mesh.k < 3])
def test_taut_tension_fields_have_the_fields_of_stvk(name):
    """Fields of taut elements equal those of StVK, including the strain across, which follows from the stress."""
    mesh = EVERY[name]
    term = next(law for (kind, _), law in laws_on(mesh).items() if kind == "wrinkling")
    u = states_for("wrinkling", mesh)["wide"]
    wanted, found = fields_of(mesh, StVK(term.material, plane=term.plane), u), fields_of(mesh, term, u)
    for field in FIELDS:
        size = np.abs(wanted[field]).max()
        assert size > 0.1 and np.abs(found[field] - wanted[field]).max() < 1e-13 * size, field


@pytest.mark.parametrize("name", ["tetrahedra", "triangles", "hexahedra"])
@pytest.mark.parametrize("law", [Corotated, InvertibleStVK])
def test_flat_elements_have_an_energy_density_and_no_finite_stress(law, name):
    """Elements with a single zero stretch have a finite energy density and an infinite stress."""
    mesh = EVERY[name]
    body = System(mesh, law(young=2.0, poisson=0.3))
    flat = np.zeros((mesh.nv, mesh.d))
    flat[:, 0] = -mesh.p[0]
    now = Fields.of(body).at(flat.ravel())
    with pytest.warns(StvkWarning, match="stress is infinite"):
        assert np.ma.getmaskarray(now["pk2_stress"]).all()
    assert not np.ma.is_masked(now["strain_energy_density"])
    assert now["strain_energy_density"] @ now.fields.volume == pytest.approx(body.energy(flat.ravel()), rel=1e-12)
