"""Gravity, body forces, tractions and nodal loads have the specified resultant and moment on all kinds of simplices."""

from functools import partial

import numpy as np
import pytest
from bodies import MESHES, sheet
from forces import force, integral, moment

from skfem_stvk import ElementMesh, MaterialError, RegionError, StVK
from skfem_stvk.errors import LoadError
from skfem_stvk.mesh.geometry import Geometry
from skfem_stvk.mesh.points import sizes_of
from skfem_stvk.terms import Body, BodyForce, Gravity, NodalLoad, Pressure, Traction

NAMES = list(MESHES)


def body_of(mesh, density=None):
    """Return a body with a different section in each element, except for tetrahedra."""
    section = np.random.default_rng(5).uniform(0.5, 2, mesh.nt)
    return Body(
        mesh, [StVK(young=2.0, poisson=0.3, density=density, **{1: {"area": section}, 2: {"thickness": section}}.get(mesh.k, {}))]
    )


def uniform_body(mesh):
    return Body(mesh, [StVK(young=2.0, poisson=0.3, **{1: {"area": 0.3}, 2: {"thickness": 0.3}}.get(mesh.k, {}))])


def linear(d, seed=6):
    """Return a field that is linear in x and grows as t squared."""
    rng = np.random.default_rng(seed)
    A, b = rng.standard_normal((d, d)), rng.standard_normal((d, 1))
    return lambda x, t: t**2 * (A @ x + b)


def outer(x, f):
    """Return the components of the density of the moment, (d d, n)."""
    return np.einsum("an,bn->abn", x, f).reshape(-1, x.shape[1])


@pytest.mark.parametrize("name", NAMES)
def test_weight_is_mass_times_g_and_acts_at_the_centre_of_mass(name):
    mesh = MESHES[name]
    density = np.random.default_rng(7).uniform(1, 3, mesh.nt)
    body, g = body_of(mesh, density), np.array([1.0, -2.0, 3.0])[: mesh.d]
    f = force(Gravity(g).bind(body), mesh)
    section = body.section
    mass = Geometry(mesh.p, mesh.t).volume * section * density
    centre = mesh.p[:, mesh.t].mean(axis=1) @ mass / mass.sum()
    assert f.sum(axis=1) == pytest.approx(mass.sum() * g, rel=1e-13)
    assert moment(mesh.p, f) == pytest.approx(moment(centre[:, None], mass.sum() * g[:, None]), rel=1e-12, abs=1e-13)


@pytest.mark.few
@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("region", [None, "half"])
def test_a_linear_body_force_is_integrated_exactly(name, region):
    mesh = MESHES[name]
    mesh = ElementMesh(mesh.p, mesh.t, subdomains={"half": np.arange(mesh.nt // 2)})
    ids = mesh.elements(region)
    body, b, t = body_of(mesh), linear(mesh.d), 0.7
    f = force(BodyForce(b, region).bind(body), mesh, t=t)
    sizes = (Geometry(mesh.p, mesh.t).volume * body.section)[ids]
    assert f.sum(axis=1) == pytest.approx(integral(mesh.p, mesh.t[:, ids], sizes, lambda x: b(x, t)), rel=1e-12)
    density = integral(mesh.p, mesh.t[:, ids], sizes, lambda x: outer(x, b(x, t))).reshape(mesh.d, mesh.d)
    assert mesh.p @ f.T == pytest.approx(density, rel=1e-12, abs=1e-14)


@pytest.mark.parametrize("name", NAMES)
def test_a_linear_traction_is_integrated_exactly_over_the_whole_surface(name):
    mesh = MESHES[name]
    body, T, t = uniform_body(mesh), linear(mesh.d), 0.7
    f = force(Traction(lambda x: x[0] > -9, T).bind(body), mesh, t=t)
    areas = sizes_of(mesh.p, mesh.surface, mesh.facet) * (0.3 if mesh.k < 3 else 1)
    assert f.sum(axis=1) == pytest.approx(integral(mesh.p, mesh.surface, areas, lambda x: T(x, t)), rel=1e-12)
    density = integral(mesh.p, mesh.surface, areas, lambda x: outer(x, T(x, t))).reshape(mesh.d, mesh.d)
    assert mesh.p @ f.T == pytest.approx(density, rel=1e-12, abs=1e-14)


@pytest.mark.parametrize("load", [Traction, BodyForce])
def test_a_constant_is_a_function_that_ramps(load):
    mesh = MESHES["tetrahedra"]
    body, value = body_of(mesh), (1.0, -2.0, 3.0)
    where = [lambda x: x[0] > -9] if load is Traction else []
    constant = load(*where, value).bind(body)
    for same in (lambda t: t * np.array(value), lambda x, t: t * np.array(value), lambda x, t: [t + 0 * x[0], -2 * t, 3 * t]):
        other = load(*where, same).bind(body)
        for t in (0.0, 0.3, 1.0, 0.3):
            assert force(other, mesh, t=t) == pytest.approx(force(constant, mesh, t=t), rel=1e-13, abs=1e-15)
    assert force(constant, mesh, t=0.3) == pytest.approx(0.3 * force(constant, mesh), rel=1e-15)
    assert not force(constant, mesh, t=0.0).any()


def test_traction_resultant_is_area_times_thickness_times_traction():
    mesh = sheet()
    thickness = np.where(mesh.p[0, mesh.t].mean(axis=0) < 0.5, 0.1, 0.4)
    body = Body(mesh, [StVK(young=1.0, poisson=0.3, thickness=thickness)])
    boundary = mesh.surface[:, 3:5]
    lengths = np.linalg.norm(np.diff(mesh.p[:, boundary], axis=1)[:, 0], axis=0)
    owner = [next(e for e in range(mesh.nt) if set(facet) <= set(mesh.t[:, e])) for facet in boundary.T.tolist()]
    named = ElementMesh(mesh.p, mesh.t, boundaries={"some": boundary[::-1]})
    body = Body(named, [StVK(young=1.0, poisson=0.3, thickness=thickness)])
    f = force(Traction("some", (2.0, -1.0)).bind(body), mesh)
    assert f.sum(axis=1) == pytest.approx((lengths @ thickness[owner]) * np.array([2.0, -1.0]), rel=1e-13)


def test_a_traction_may_act_on_inner_facets_of_a_named_boundary():
    mesh = MESHES["tetrahedra"]
    inner = np.array([[a, b, c] for a, b, c in mesh.t[:3].T if not {a, b, c} <= set(mesh.surface.ravel())])[:1].T
    named = ElementMesh(mesh.p, mesh.t, boundaries={"inner": np.concatenate([inner, inner[::-1]], axis=1)})
    f = force(Traction("inner", (0, 0, 2.0)).bind(body_of(named)), mesh)
    assert f.sum(axis=1) == pytest.approx([0, 0, 2 * sizes_of(mesh.p, inner, mesh.facet)[0]])  # a duplicate facet counts once


def test_the_end_of_a_segment_has_its_area():
    mesh = MESHES["cable"]
    area = np.linspace(1, 2, mesh.nt)
    body = Body(mesh, [StVK(young=1.0, poisson=0.3, area=area)])
    f = force(Traction(lambda x: x[0] == x[0].max(), (1.0, 2.0, 3.0)).bind(body), mesh)
    assert f[:, -1] == pytest.approx(area[-1] * np.array([1.0, 2.0, 3.0]))
    assert np.count_nonzero(f) == 3


@pytest.mark.parametrize("name", NAMES)
def test_nodal_loads_are_the_given_values_on_each_vertex(name):
    mesh = MESHES[name]
    rng = np.random.default_rng(8)
    ids = rng.permutation(mesh.nv)[:4]
    values = rng.standard_normal((mesh.d, 4))
    f = force(NodalLoad(ids, values).bind(body_of(mesh)), mesh, t=0.5)
    assert np.array_equal(f[:, ids], 0.5 * values)
    assert f.sum() == pytest.approx(0.5 * values.sum())
    each = force(NodalLoad(ids, lambda t: t * np.ones(mesh.d)).bind(body_of(mesh)), mesh, t=0.5)
    assert each.sum() == pytest.approx(0.5 * 4 * mesh.d)


@pytest.mark.parametrize("density", [None, 2.0])
def test_a_changed_value_of_a_function_takes_effect_at_the_same_time(density):
    """A function that changes its value between two calls at the same time takes effect, such as that of a device.

    Equal values are distributed over the body only once.
    """
    mesh, given = MESHES["tetrahedra"], [1.0]
    function = lambda t: (0, 0, t * given[0])  # noqa: E731
    term = BodyForce(function) if density is None else Gravity(function)
    load = term.bind(body_of(mesh) if density is None else body_of(mesh, density))
    one, again = load.forces(0.5), load.forces(0.5)
    given[0] = -3.0
    assert again is one and np.abs(one).max() > 0
    np.testing.assert_array_equal(force(load, mesh, t=0.5).T[:, 2], -3 * one[:, 2])


def test_loads_add_to_a_force_in_single_precision():
    mesh = MESHES["tetrahedra"]
    for where in (lambda x: x[0] > -9, lambda x: x[0] < 0.4):
        load = Traction(where, (1.0, -2.0, 0.5)).bind(body_of(mesh))
        out = np.zeros((mesh.nv, 3), dtype=np.float32)
        load.add_force(out, 0.5, out)
        assert out.dtype == np.float32
        expected = force(load, mesh, t=0.5)
        assert np.abs(out.T - expected).max() < 1e-6 * np.abs(expected).max()


LOADS = [
    (
        Gravity((0, 0, -9.81)),
        MaterialError,
        r"The material has no density\. Give it one: StVK\(\.\.\., density=\.\.\.\) \[kg/m\^3\]",
    ),
    (BodyForce((0, 0)), LoadError, r"BodyForce: force has shape \(2,\); expected 3 components \(x, y, z\), or \(3, \d+\)"),
    (BodyForce((0, 0, 1), region="steel"), RegionError, "The mesh has no subdomain 'steel'; known: none"),
    (
        Traction("tpi", (0, 0, 1)),
        RegionError,
        r"Traction on 'tpi': the mesh has no boundary or node set 'tpi'; known: 'tip'\. Did you mean 'tip'\?",
    ),
    (
        Traction(lambda x: x[0] == 99, (0, 0, 1)),
        RegionError,
        r"none of the 64 vertices satisfies the predicate '<lambda>'. The mesh has x\[0\] from",
    ),
    (
        Traction([0, 1], (0, 0, 1)),
        RegionError,
        r"Traction on 2 vertices \(0, 1\): .*none of the 108 boundary facets has all its vertices there.*NodalLoad",
    ),
    (
        Traction("tip", lambda x: x),
        LoadError,
        r"Traction on 'tip': a function of one argument is a function of t, but this one calls it x",
    ),
    (
        Traction("tip", lambda x, t: x[:2]),
        LoadError,
        r"what the function \w+ returned at t = 0 has shape \(2, \d+\); expected 3 components",
    ),
    (
        Traction("tip", lambda x, t: x + (np.nan if t == 0 else t)),
        LoadError,
        r"what the function \w+ returned at t = 0 is not finite in \d+ entries",
    ),
    (
        Traction("tip", lambda x, t: x[3]),
        LoadError,
        r"failed at t = 0 with IndexError: index 3.*It gets x, of shape \(3, \d+\), and t",
    ),
    (Traction("tip", lambda t: (1 / t, 0, 0)), LoadError, r"failed at t = 0 with ZeroDivisionError.*It gets t, a number"),
    (Traction("tip", lambda: 0), LoadError, r"the function traction has 0 arguments; expected one of t, or one of x and t"),
    (Traction("tip", lambda x, t: "no"), LoadError, r"what the function traction returned at t = 0 is 'no'; expected 3 components"),
    (NodalLoad("tip", 5.0), LoadError, r"NodalLoad on 'tip': force has shape \(\); expected 3 components"),
    (NodalLoad([], (0, 0, 1)), RegionError, r"NodalLoad on 0 vertices \(\): no vertex there"),
    (
        NodalLoad([0, 64], (0, 0, 1)),
        RegionError,
        r"NodalLoad on 2 vertices \(0, 64\): the vertices name 1 vertex \(64\) outside 0 \.\.\. 63",
    ),
]


@pytest.mark.parametrize(("load", "error", "message"), LOADS, ids=[message[:50] for _, _, message in LOADS])
def test_an_invalid_load_is_refused_with_a_remedy(load, error, message):
    mesh = MESHES["tetrahedra"]
    named = ElementMesh(mesh.p, mesh.t, boundaries={"tip": mesh.surface[:, :4]})
    with pytest.raises(error, match=message):
        load.bind(body_of(named))


@pytest.mark.parametrize("make", [Gravity, BodyForce, partial(NodalLoad, [1]), partial(Traction, "tip"), partial(Pressure, "tip")])
@pytest.mark.parametrize(
    ("value", "message"),
    [
        ((0, 0, 10**400), r"= \(0, 0, 1000.*; expected finite numbers, or a function"),
        ("down", r"= 'down'; expected finite numbers"),
        ((0, "1"), r"= \(0, .1.\); expected finite numbers"),
        ((0, 0, np.nan), r"is not finite; expected finite numbers"),
        (np.where(np.arange(12) == 4, np.inf, 1.0).reshape(1, 12), r"is not finite in 1 entry \(4\)"),
        (1j, "= 1j; expected finite numbers"),
    ],
)
def test_a_load_that_is_not_a_finite_number_is_refused_without_a_mesh(make, value, message):
    kind = getattr(make, "func", make)
    with pytest.raises(LoadError, match=rf"^{kind.__name__}: {kind.given_by} {message}"):
        make(value)


def test_the_error_of_a_function_that_fails_later_has_the_time():
    load = BodyForce(lambda t: (0, 0, np.nan if t == 0.5 else t)).bind(body_of(MESHES["tetrahedra"]))
    with pytest.raises(LoadError, match=r"BodyForce: what the function force returned at t = 0\.5 is not finite"):
        load.forces(0.5)
    assert load.forces(0.25).any()


@pytest.mark.parametrize("other", [0.05, 0.2])
def test_terms_of_different_thickness_on_the_same_elements_have_no_section(other):
    mesh = sheet()
    some = np.arange(5)
    body = Body(mesh, [StVK(young=1.0, poisson=0.3, thickness=0.1), StVK(young=1.0, poisson=0.3, thickness=other, region=some)])
    with pytest.raises(LoadError, match=r"5 elements \(0, 1, 2, 3, 4\): terms of different thickness on the same elements"):
        BodyForce((0, 1)).bind(body)


def test_masses_of_terms_on_the_same_elements_add_up():
    mesh = sheet()
    one, other = StVK(young=1.0, poisson=0.3, density=2.0), StVK(young=1.0, poisson=0.3, density=3.0, region=np.array([4, 1]))
    mass = Body(mesh, [one, other]).mass
    area = Geometry(mesh.p, mesh.t).volume
    assert mass == pytest.approx(area * np.where(np.isin(np.arange(mesh.nt), [1, 4]), 5, 2))
    with pytest.raises(MaterialError, match="No term has a density"):
        _ = Body(mesh, []).mass
