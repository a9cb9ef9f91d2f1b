"""Loads on all elements, including curved ones, equal scikit-fem's forms and closed forms.

Pressures on closed surfaces balance, and forces are derivatives of energies.
"""

import numpy as np
import pytest
import skfem
from bodies import CURVED, MESHES, STRAIGHT, scikit_fem_of, state, values_at
from forces import force, moment, stiffness
from skfem.helpers import dot

from skfem_stvk import ElementMesh, StVK
from skfem_stvk.edges.bound_term import bound
from skfem_stvk.mesh.points import rule_of, sizes_at_points, sizes_of
from skfem_stvk.system.pattern import Pattern
from skfem_stvk.terms import Body, BodyForce, ElasticFoundation, Gravity, NodalLoad, Pressure, Traction
from skfem_stvk.terms.loads.load import Moment

RNG = np.random.default_rng(0)
SECTION = {1: {"area": 0.3}, 2: {"thickness": 0.3}, 3: {}}
SOLID = [name for name, mesh in CURVED.items() if mesh.k == mesh.d]
KNOWN = [name for name, mesh in CURVED.items() if scikit_fem_of(mesh)]


def body(mesh, **more):
    return Body(mesh, [StVK(young=1.0, poisson=0.3, density=RNG.uniform(1, 3, mesh.nt), **(SECTION[mesh.k] | more))])


def everywhere(x):
    return x[0] > -np.inf


def field(mesh):
    """Return nodal values of a random field in the space of the shape functions, so that interpolation between nodes is exact."""
    values = RNG.standard_normal(mesh.p.shape)
    return values, values.T.ravel()


def with_our_rule(mesh):
    basis, (points, weights) = scikit_fem_of(mesh), rule_of(mesh.element, "mass")
    return skfem.Basis(basis.mesh, basis.elem, quadrature=(points.T, weights))


@pytest.mark.parametrize("name", KNOWN)
@pytest.mark.parametrize("kind", ["constant", "of x"])
def test_body_force_is_scikit_fems(name, kind):
    mesh = CURVED[name]
    basis, (values, flat) = with_our_rule(mesh), field(mesh)
    section = 0.3 if mesh.k < 3 else 1.0
    if kind == "constant":
        given, values = values[:, 0], np.repeat(values[:, :1], mesh.nv, axis=1)
        flat = values.T.ravel()
    else:
        given = lambda x, t: t / 0.7 * values  # noqa: E731
    load = BodyForce(given).bind(body(mesh))
    t = 1.0 if kind == "constant" else 0.7
    exact = skfem.LinearForm(lambda v, w: section * dot(w["b"], v)).assemble(basis, b=basis.interpolate(flat))
    assert np.abs(force(load, mesh, t=t).T.ravel() - exact).max() < 2e-14 * np.abs(exact).max()


@pytest.mark.parametrize("name", CURVED)
def test_gravity_is_mass_times_g_and_in_motion_uses_its_mass_matrix(name):
    mesh = CURVED[name]
    of, g = body(mesh), np.arange(1.0, mesh.d + 1)
    load = Gravity(g).bind(of)
    consistent = force(load, mesh)
    lumped = np.zeros((mesh.nv, mesh.d))
    load.add_force(lumped, Moment(0.0, 1.0, "lumped"), lumped)
    assert consistent.sum(axis=1) == pytest.approx(of.mass.sum() * g, rel=1e-13)
    assert np.allclose(lumped, of.lumped_mass[:, None] * g, rtol=1e-14, atol=0)
    half = np.zeros((mesh.nv, mesh.d))
    load.add_force(half, 0.5, half)
    assert np.array_equal(2 * half, consistent.T)
    different = np.abs(lumped - consistent.T).max() > 0.05 * np.abs(lumped).max()
    assert different == (mesh.element.degree == 2 and mesh.k > 1)
    if mesh.element.degree == 2 and mesh.k == 3:
        assert consistent[0].min() < 0  # corners are pulled up


@pytest.mark.parametrize("name", [name for name in KNOWN if CURVED[name].k > 1])
def test_traction_is_scikit_fems(name):
    """A traction that varies along curved and skew facets has scikit-fem's forces, if both use the same rule on facets."""
    mesh = CURVED[name]
    values, flat = field(mesh)
    points, weights = rule_of(mesh.facet, "mass")
    known = scikit_fem_of(mesh)
    basis = skfem.FacetBasis(known.mesh, known.elem, quadrature=(points.T, weights))
    section = 0.3 if mesh.k < 3 else 1.0
    ids = np.unique(mesh.surface)
    load = Traction(everywhere, lambda x, t: values[:, ids]).bind(body(mesh))
    exact = skfem.LinearForm(lambda v, w: section * dot(w["b"], v)).assemble(basis, b=basis.interpolate(flat))
    assert np.abs(force(load, mesh).T.ravel() - exact).max() < 2e-14 * np.abs(exact).max()


@pytest.mark.parametrize("name", CURVED)
def test_a_constant_traction_has_the_resultant_of_its_area(name):
    mesh = CURVED[name]
    of, T = body(mesh), np.arange(1.0, mesh.d + 1)
    areas = of.facet_areas(mesh.surface)
    assert force(Traction(everywhere, T).bind(of), mesh).sum(axis=1) == pytest.approx(areas.sum() * T, rel=1e-13)
    if mesh.k > 1:
        assert areas.sum() == pytest.approx(
            (0.3 if mesh.k < 3 else 1) * sizes_of(mesh.p, mesh.surface, mesh.facet).sum(), rel=1e-13
        )


def test_a_constant_traction_on_straight_quadratic_facets_acts_at_edge_nodes_only():
    mesh = STRAIGHT["quadratic tetrahedra"]
    f = force(Traction(everywhere, (1.0, 0, 0)).bind(body(mesh)), mesh)[0]
    corners = np.unique(mesh.corners)
    assert np.abs(f[corners]).max() < 1e-15 and f.sum() == pytest.approx(sizes_of(mesh.p, mesh.surface, mesh.facet).sum())


def bubble(solid):
    """Return the surface of a solid as a closed membrane with outward normals."""
    nodes, t = np.unique(solid.surface, return_inverse=True)
    return ElementMesh(solid.p[:, nodes], t.reshape(solid.surface.shape), element=solid.facet)


CLOSED = {name: CURVED[name] for name in SOLID if CURVED[name].k > 1}
CLOSED |= {name: MESHES[name] for name in ("tetrahedra", "triangles")}
CLOSED |= {f"bubble of {name}": bubble((MESHES | CURVED)[name]) for name in ("tetrahedra", "quadratic tetrahedra", "hexahedra")}


def pressure(mesh, p):
    return Pressure(None if mesh.k < mesh.d else everywhere, p).bind(body(mesh))


def enclosed(mesh, u):
    """Return the enclosed volume at displacements `u` (nv, d).

    For solids this is the volume of the elements, for bubbles the flux of x.
    """
    x = mesh.p + u.T
    element, xi, weights = mesh.element, *rule_of(mesh.element, "mass")
    slopes = np.einsum("qai,dat->tqid", element.derivatives(xi), x[:, mesh.t])
    if mesh.k < mesh.d:
        at = values_at(x, mesh.t, element, xi)
        return (np.einsum("tqd,tqd->tq", at, np.cross(slopes[:, :, 0], slopes[:, :, 1])) @ weights).sum() / 3
    rest = np.einsum("qai,dat->tqid", element.derivatives(xi), mesh.p[:, mesh.t])
    return ((np.linalg.det(slopes) * np.sign(np.linalg.det(rest))) @ weights).sum() * (0.3 if mesh.k == 2 else 1)


@pytest.mark.parametrize("name", CLOSED)
def test_pressure_on_a_closed_surface_is_minus_the_gradient_of_the_volume(name):
    """The pressure force on a closed surface is minus p times the gradient of the enclosed volume.

    The volume is a cubic in u, for which the stencil of four points and the quadrature rules are exact.
    """
    mesh, p = CLOSED[name], 2.5
    u, v = (state(mesh, amount, seed).reshape(-1, mesh.d) for amount, seed in ((0.5, 1), (1.0, 2)))
    V = {s: enclosed(mesh, u + s * v) for s in (-2, -1, 1, 2)}
    slope = (8 * (V[1] - V[-1]) - (V[2] - V[-2])) / 12
    f = force(pressure(mesh, p), mesh, u)
    assert np.abs(f).max() > 0.01
    assert np.vdot(f.T, v) == pytest.approx(-p * slope, abs=1e-12 * np.abs(f).sum() * np.abs(v).max())
    x = mesh.p + u.T
    assert np.abs(f.sum(axis=1)).max() < 2e-14 * np.abs(f).sum()
    assert np.abs(moment(x, f)).max() < 2e-13 * np.abs(f).sum() * np.abs(x).max()


@pytest.mark.few
@pytest.mark.parametrize("name", [name for name in CURVED if CURVED[name].k > 1 and (CURVED[name].d == 3 or CURVED[name].k == 2)])
@pytest.mark.parametrize("given", [2.5, lambda x, t: t * (1 + x[0] - 2 * x[1])], ids=["constant", "of x"])
def test_load_stiffness_is_minus_the_derivative_of_the_force(name, given):
    """The load stiffness is minus the derivative of the force.

    The force is a quadratic in u, for which central differences are exact.
    """
    mesh = CURVED[name]
    load = pressure(mesh, given)
    u = state(mesh, 0.5).reshape(-1, mesh.d)
    K = stiffness(load, mesh, u, t=0.7)
    for direction in RNG.standard_normal((3, u.size)):
        v = direction.reshape(u.shape)
        slope = (force(load, mesh, u + v, 0.7) - force(load, mesh, u - v, 0.7)).T.ravel() / 2
        assert np.abs(slope).max() > 0.1 and np.abs(K @ direction + slope).max() < 1e-12 * np.abs(slope).max()


@pytest.mark.parametrize("name", [name for name in CURVED if "membrane" in name])
def test_membranes_of_mixed_orientation_are_pushed_to_one_side(name):
    """Elements with reversed node order, including nodes on edges, are pushed in the direction of their first neighbour."""
    mesh = CURVED[name]
    other = [1, 0, 2, 3, 5, 4] if mesh.element.is_simplex else [1, 0, 3, 2]
    t = mesh.t.copy()
    t[:, 1::3] = t[other][:, 1::3]
    assert sizes_at_points(mesh.p, t, mesh.element).sum() == pytest.approx(sizes_of(mesh.p, mesh.t, mesh.element).sum(), rel=1e-12)
    mixed = ElementMesh(mesh.p, t, element=mesh.element)
    f, again = force(pressure(mesh, 2.0), mesh), force(pressure(mixed, 2.0), mixed)
    assert np.abs(f).max() > 0 and f == pytest.approx(again, abs=1e-14)


@pytest.mark.parametrize("name", CURVED)
def test_a_foundation_has_the_energy_of_quadrature_and_its_derivatives(name):
    mesh = CURVED[name]
    of, k = body(mesh), np.array([2.0, 0.0, 5.0])[: mesh.d]
    term = ElasticFoundation(everywhere, k).bind(of)
    u, v = (state(mesh, seed=seed).reshape(-1, mesh.d) for seed in (1, 2))
    if mesh.k > 1:
        points = rule_of(mesh.facet, "mass").points
        areas = sizes_at_points(mesh.p, mesh.surface, mesh.facet) * (0.3 if mesh.k < 3 else 1)
        at = values_at(u.T, mesh.surface, mesh.facet, points)
        assert term.energy_and_force(u) == pytest.approx(np.einsum("qn,nqd,d->", areas, at**2, k) / 2, rel=1e-13)
    W = {s: term.energy_and_force(u + s * v) for s in (-1, 0, 1)}
    F, sizes = np.zeros_like(u), np.zeros_like(u)
    term.energy_and_force(u, F)
    pattern = Pattern(mesh.nv, mesh.d, [term.nodes_paired])
    paired, K = bound(term).with_blocks(mesh.nv, mesh.d, np.float64), pattern.matrix(np.zeros(pattern.nnz))
    paired.fill(u, paired.pairs.rows(pattern), K.data, add=True)
    assert np.vdot(F, v) == pytest.approx((W[1] - W[-1]) / 2, abs=1e-13 * W[0])
    assert v.ravel() @ K @ v.ravel() == pytest.approx(W[1] - 2 * W[0] + W[-1], rel=1e-11)
    term.add_round_off(u, sizes)
    assert sizes.ravel() == pytest.approx(abs(K) @ np.abs(u.ravel()))


def test_forces_may_act_at_edge_nodes():
    mesh = CURVED["quadratic tetrahedra"].with_boundaries({"low": everywhere})
    middle = mesh.t[6, :2]
    f = force(NodalLoad(np.sort(middle), (1.0, 2.0, 3.0)).bind(body(mesh)), mesh)
    assert np.array_equal(f[:, middle], np.repeat([[1.0], [2.0], [3.0]], 2, axis=1)) and np.abs(f).sum() == 12
    everyone = force(NodalLoad("low", (1.0, 0, 0)).bind(body(mesh)), mesh)
    assert everyone[0].sum() == len(np.unique(mesh.surface)) > len(np.unique(mesh.surface[:3]))


def test_an_inner_edge_between_two_thicknesses_of_quadrilaterals_has_their_mean():
    mesh = ElementMesh.of(skfem.MeshQuad.init_tensor(np.linspace(0, 2, 3), np.linspace(0, 1, 2)))
    of = body(mesh, thickness=np.array([0.2, 0.6]))
    inner = np.flatnonzero(mesh.p[0] == 1)[:, None]
    rim = mesh.surface[:, (mesh.p[0] == 0)[mesh.surface].all(axis=0)]
    assert of.facet_sections(inner) == pytest.approx([0.4]) and of.facet_areas(rim) == pytest.approx([0.2])
