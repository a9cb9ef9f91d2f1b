"""A body after the removal of elements equals the body that is built without these elements, in the pattern of the whole body."""

import warnings
from copy import copy
from dataclasses import dataclass

import meshio
import numpy as np
import pytest
import skfem
from bodies import EVERY_MESH, random_frames, some_voigt, state
from slow import slow
from terms.toys import Anchors, Friction, Springs, Vortex

from skfem_stvk import (
    Anisotropic,
    BodyForce,
    Corotated,
    ElasticFoundation,
    ElementMesh,
    Gravity,
    InvertibleStVK,
    LinearElastic,
    NeoHookean,
    NodalLoad,
    Pressure,
    RegionError,
    StVK,
    StvkError,
    StvkWarning,
    SupportError,
    System,
    Traction,
    VolumePenalty,
    modes,
    solve_static,
)
from skfem_stvk.edges import TENSILE
from skfem_stvk.kernels.lanes import LANES
from skfem_stvk.mesh.facets import facets_of, find_facets
from skfem_stvk.results import Fields, animate, write_vtu
from skfem_stvk.results.picture import picture_of
from skfem_stvk.results.series import save_series
from skfem_stvk.solvers.dynamics.forces import add_damping_force, add_mean_force
from skfem_stvk.system.bound import compressed_in_part
from skfem_stvk.system.rigid import parts_of_body
from skfem_stvk.terms.loads.load import Moment, StepStart

RNG = np.random.default_rng(21)
BOXES = [name for name, mesh in EVERY_MESH.items() if mesh.element.shape.one_point and mesh.k == mesh.d]
#: Meshes with the longest compile times; other meshes test the same properties.
RARE = "quadratic tetrahedra", "quadratic triangles"
CASES = [slow(name, None) if name in RARE else (name, None) for name in EVERY_MESH] + [
    slow(name, "one-point") if name == "hexahedra" else (name, "one-point") for name in BOXES
]


def quietly(what, *arguments, **options):
    """Call a function without the warnings of loose parts and of loads and supports on them."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", StvkWarning)
        return what(*arguments, **options)


class Pair:
    """Pair of a body from which elements are removed, and the body built of the other elements, with the same data."""

    def __init__(self, name, quadrature=None, dtype=np.float64, loads=True):
        mesh, rng = EVERY_MESH[name], np.random.default_rng(5)
        self.out = rng.permutation(mesh.nt)[: mesh.nt // 3 + 1]
        self.kept = np.setdiff1d(np.arange(mesh.nt), self.out)
        self.used = np.unique(mesh.t[:, self.kept])
        number = np.full(mesh.nv, -1)
        number[self.used] = np.arange(len(self.used))
        every, t2f = facets_of(mesh.t, mesh.nv, mesh.element)
        facets = every[:, :: 2 if mesh.k > 1 else 1]
        outer = mesh.surface
        there = np.zeros(every.shape[1], dtype=bool)
        there[t2f[:, self.kept]] = True
        left, left_outer = (one[:, there[find_facets(one, every, mesh.nv)]] for one in (facets, outer))
        self.mesh = ElementMesh(mesh.p, mesh.t, boundaries={"some": facets, "outer": outer}, element=mesh.element)
        self.rest = ElementMesh(
            mesh.p[:, self.used],
            number[mesh.t[:, self.kept]],
            boundaries={"some": number[left], "outer": number[left_outer]},
            element=mesh.element,
        )
        self.dofs = (mesh.d * self.used[:, None] + np.arange(mesh.d)).ravel()
        numbers = rng.uniform(1, 2, (4, mesh.nt)), random_frames(mesh.nt, rng), some_voigt(rng)
        options = {"quadrature": quadrature, "dtype": dtype}
        self.whole = quietly(System, self.mesh, self.terms(np.arange(mesh.nt), numbers, loads), **options)
        self.part = quietly(System, self.rest, self.terms(self.kept, numbers, loads), **options)

    def terms(self, ids, numbers, loads):
        """Return terms on the given elements.

        The terms are a law on all, a general law on half, a penalty on two thirds, and all kinds of loads.
        """
        mesh, ((young, density, k, section), frames, C) = self.mesh, numbers
        size = {1: {"area": section[ids]}, 2: {"thickness": section[ids]}, 3: {}}[mesh.k]
        half, some = (np.flatnonzero(ids % m < n) for m, n in ((2, 1), (3, 2)))
        also = {name: value[half] for name, value in size.items()}
        found = [
            StVK(young=young[ids], poisson=0.3, density=density[ids], **size),
            StVK(Anisotropic(C, frame=frames[ids[half]], density=2.0), region=half, **also),
        ]
        if mesh.k == mesh.d:
            found.append(VolumePenalty(k[ids[some]], "quadratic", some))
        if loads:
            found += [
                ElasticFoundation("some", np.arange(1.0, mesh.d + 1)),
                Gravity(np.arange(1.0, mesh.d + 1)),
                BodyForce(lambda x, t: [t + x[0] ** 2] * mesh.d, region=half),
                Traction("some", lambda x, t: [t + x[0]] * mesh.d),
            ]
        if loads and mesh.k == mesh.d > 1:
            found.append(Pressure("outer", lambda t: 2 * t))
        return found

    def remove(self):
        first = quietly(self.whole.without, self.out[: len(self.out) // 2])
        self.whole = quietly(first.without, self.out)
        return self


@pytest.fixture(scope="module")
def pairs():
    made = {}

    def pair(name, quadrature=None):
        if (name, quadrature) not in made:
            made[name, quadrature] = Pair(name, quadrature).remove()
        return made[name, quadrature]

    return pair


def alike(found, wanted, limit=1e-14):
    return np.abs(found - wanted).max() <= limit * np.abs(wanted).max()


@pytest.mark.few
@pytest.mark.parametrize(("name", "quadrature"), CASES)
def test_all_functions_of_displacements_are_those_of_the_remaining_body(pairs, name, quadrature):
    pair = pairs(name, quadrature)
    whole, part, dofs = pair.whole, pair.part, pair.dofs
    u, v = 0.7 * state(pair.mesh), state(pair.mesh, seed=8)
    x, y = u[dofs], v[dofs]
    assert whole.energies(u, 0.7).keys() == part.energies(x, 0.7).keys()
    assert whole.energies(u, 0.7) == pytest.approx(part.energies(x, 0.7), rel=1e-13)
    others = np.setdiff1d(np.arange(whole.ndofs), dofs)
    for kind in ("internal_force", "round_off", "foundation_force"):
        found, wanted = getattr(whole, kind)(u), getattr(part, kind)(x)
        limit = 1.0 if kind == "round_off" else 1e-14  # bounds depend on the frames of elements
        assert alike(found[dofs], wanted, limit) and not found[others].any(), kind
    for moment in (0.3, Moment(2.0, 1.0, "lumped"), Moment(2.0, 1.0)):
        found, wanted = whole.external_force(u, moment), part.external_force(x, moment)
        assert alike(found[dofs], wanted) and not found[others].any()
    for system, state_of, direction in ((whole, u, v), (part, x, y)):
        assert not system.mesh.nt or np.isfinite(system.product(state_of, direction)).all()
    assert alike(whole.product(u, v)[dofs], part.product(x, y)) and not whole.product(u, v)[others].any()
    for add in (add_mean_force, add_damping_force):
        found, wanted = np.zeros(whole.ndofs), np.zeros(part.ndofs)
        assert add(whole, u, v, found) == pytest.approx(add(part, x, y, wanted), rel=1e-13)
        assert alike(found[dofs], wanted, 1e-13) and not found[others].any()
    if whole.quartic:
        assert np.allclose(whole.energy_along(u, v), part.energy_along(x, y), rtol=1e-13)


@pytest.mark.few
@pytest.mark.parametrize(("name", "quadrature"), CASES)
def test_tangents_are_those_of_the_remaining_body_in_the_old_pattern(pairs, name, quadrature):
    pair = pairs(name, quadrature)
    whole, part, dofs = pair.whole, pair.part, pair.dofs
    u = 0.7 * state(pair.mesh)
    x, before = u[dofs], whole.pattern_version
    held = whole.free_dofs(np.arange(pair.mesh.d))
    for kept in ((), (TENSILE,)):
        options = {"kept": kept[0]} if kept else {}
        K, wanted = whole.jacobian(u, 0.7, **options), part.jacobian(x, 0.7, **options).toarray()
        assert alike(K[dofs][:, dofs].toarray(), wanted, 3e-14)
        others = np.setdiff1d(np.arange(whole.ndofs), dofs)
        assert others.size == pair.mesh.d * len(whole.bare)
        rest = K[others].toarray()
        assert not np.delete(rest, others, axis=1).any()
        if others.size:
            stiffness = rest[:, others]
            assert (stiffness == stiffness[0, 0] * np.eye(len(others))).all()
            assert 0.05 < stiffness[0, 0] / np.abs(wanted.diagonal()).mean() < 20
        assert (whole.jacobian(u, 0.7, free=held, **options).toarray() == held.matrix(K).toarray()).all()
    assert (whole.tangent(u).indices == whole.pattern.indices).all() and whole.pattern_version == before
    W, F, K = whole.linearize(u)
    assert pytest.approx(part.energy(x), rel=1e-13) == W and alike(F[dofs], part.internal_force(x))
    assert (K.data == whole.tangent(u).data).all()


@pytest.mark.few
@pytest.mark.parametrize("name", EVERY_MESH)
@pytest.mark.parametrize("kind", ["lumped", "consistent"])
def test_masses_are_those_of_the_remaining_body_even_if_cached_before(name, kind):
    pair = Pair(name)
    pair.whole.mass(kind)
    early = pair.remove().whole.mass(kind)
    part, dofs = pair.part.mass(kind), pair.dofs
    others = np.setdiff1d(np.arange(pair.whole.ndofs), dofs)
    v = RNG.standard_normal(pair.whole.ndofs)
    fresh = Pair(name).remove().whole.mass(kind)
    for mass in (early, fresh):
        assert mass.total == pytest.approx(part.total, rel=1e-14)
        assert alike(mass.matrix.toarray()[np.ix_(dofs, dofs)], part.matrix.toarray())
        for found, wanted in ((mass.multiply(v), part.multiply(v[dofs])), (mass.solve(v), part.solve(v[dofs]))):
            assert alike(found[dofs], wanted, 1e-12) and not found[others].any()
    K = pair.whole.tangent(np.zeros(pair.whole.ndofs))
    before = K.data.copy()
    early.add_to(K, 2.0)
    K.data -= before
    assert alike(K.toarray(), 2 * early.matrix.toarray(), 1e-11)


@pytest.mark.few
@pytest.mark.parametrize(("name", "quadrature"), CASES)
def test_volumes_and_stretches_exclude_removed_elements(pairs, name, quadrature):
    pair = pairs(name, quadrature)
    whole, part, dofs, mesh = pair.whole, pair.part, pair.dofs, pair.mesh
    u, v = 0.2 * state(mesh), state(mesh, seed=8)
    assert whole.smallest_volume_ratio(u) == part.smallest_volume_ratio(u[dofs])
    assert whole.smallest_stretch(u) == part.smallest_stretch(u[dofs])
    assert whole.step_limit(u, v) == pytest.approx(part.step_limit(u[dofs], v[dofs]), rel=1e-12)
    crushed = 1.5 * state(mesh)
    assert (whole.inside_out(crushed) == pair.kept[part.inside_out(crushed[dofs])]).all()
    below = np.nextafter(np.median(np.concatenate([[part.smallest_stretch(crushed[dofs])], [1.5]])), 9)
    assert len(compressed_in_part(whole, crushed, below))
    assert (compressed_in_part(whole, crushed, below) == pair.kept[compressed_in_part(part, crushed[dofs], below)]).all()


def test_pressure_on_a_membrane_retains_the_orientation_of_the_remaining_elements():
    flat = skfem.MeshTri.init_tensor(np.linspace(0, 1, 5), np.linspace(0, 1, 3))
    (a, b, c), t = flat.p.T[flat.t], flat.t.copy()
    reversed_ = np.linalg.det(np.stack([b - a, c - a], axis=1)) < 0
    t[:2, reversed_] = t[1::-1, reversed_]  # equal orientation of all triangles, because the remaining pieces may be disconnected
    mesh = ElementMesh(np.vstack([flat.p, 0.2 * flat.p[0] ** 2]), t)
    out, law, u = np.arange(0, mesh.nt, 3), StVK(young=1.0, poisson=0.3), 0.3 * state(mesh)
    body = System(mesh, [law, Pressure(None, 2.0)])
    body = quietly(body.without, out)
    left = quietly(System, mesh, [law, *(Pressure([one], 2.0) for one in np.setdiff1d(np.arange(mesh.nt), out))])
    assert alike(body.external_force(u), left.external_force(u), 3e-15)
    assert alike(body.jacobian(u).data - body.tangent(u).data, left.jacobian(u).data - left.tangent(u).data, 1e-13)


def test_a_barrier_ignores_removed_inverted_elements():
    mesh = EVERY_MESH["tetrahedra"]
    body = System(mesh, [StVK(young=1.0, poisson=0.3), VolumePenalty()])
    u = state(mesh, 0.5)
    inverted = body.inside_out(u)
    assert 0 < len(inverted) < mesh.nt
    body = quietly(body.without, inverted)
    assert np.isfinite(body.energy(u)) and np.isfinite(body.tangent(u).data).all()


def test_the_edge_form_is_that_of_the_remaining_body(pairs):
    pair = pairs("tetrahedra")
    form, u = pair.whole.bound_terms[0].form, state(pair.mesh).reshape(-1, 3)
    zeta = form.squared_elongations(u)
    assert zeta @ form.L @ zeta / 4 == pytest.approx(pair.whole.bound_terms[0].energy_and_force(u), rel=1e-13)


def strip(**options):
    """Return a strip of 2 x 8 triangles on each of 4 columns, fixed at the left."""
    mesh = skfem.MeshTri.init_tensor(np.linspace(0, 4, 9), np.linspace(0, 1, 3))
    terms = [StVK(young=1e4, poisson=0.3, density=1.0), Gravity((0, -5.0)), NodalLoad(lambda x: x[0] > 3.9, (3.0, 0))]
    return System(mesh, terms, fixed={lambda x: x[0] == 0: "xy"}, **options)


def column(system, low, high):
    """Return the elements with centres between `low` and `high`."""
    x = system.mesh.p[0, system.mesh.t].mean(axis=0)
    return np.flatnonzero((low < x) & (x < high))


@pytest.mark.parametrize("solver", ["superlu", "ssor-cg", "block-jacobi-cg", "amg-cg"])
def test_equilibria_of_the_remaining_body(solver):
    body = strip()
    kept = np.setdiff1d(np.arange(body.mesh.nt), column(body, 3.5, 9))
    used = np.unique(body.mesh.t[:, kept])
    number = np.full(body.mesh.nv, -1)
    number[used] = np.arange(len(used))
    other = System(
        ElementMesh(body.mesh.p[:, used], number[body.mesh.t[:, kept]]), [*body.terms[:2]], fixed={lambda x: x[0] == 0: "xy"}
    )
    body = body.without(column(body, 3.5, 9))
    found, wanted = (solve_static(one, solver=solver, steps=2, quiet=True) for one in (body, other))
    dofs = (2 * used[:, None] + np.arange(2)).ravel()
    assert alike(found.u[dofs], wanted.u, 1e-6)
    assert not np.delete(found.u, dofs).any()
    assert found.reaction().resultant == pytest.approx(wanted.reaction().resultant, rel=1e-6, abs=1e-6)
    np.testing.assert_allclose(found.stress()[kept], wanted.stress(), rtol=1e-5, atol=1e-5 * np.abs(wanted.stress()).max())
    if solver == "superlu":
        assert modes(body, 4).frequencies == pytest.approx(modes(other, 4).frequencies, rel=1e-9)


def test_a_solver_does_not_repeat_its_analysis():
    from skfem_stvk.linear.superlu import SuperLU
    from skfem_stvk.system.free_tangent import FreeTangent

    body = strip()
    calls = []

    class Counted(SuperLU):
        def analyse(self, unknowns):
            calls.append(1)
            return super().analyse(unknowns)

    from skfem_stvk.linear import Kind

    tangent = FreeTangent(body, Counted(), Kind.SYMMETRIC)
    u = np.zeros(body.ndofs)
    for removed in ([], [5], [6, 31]):
        body = body.without(removed)
        tangent.factorise(tangent.free_matrix(u, 1.0)).solve(np.ones(len(tangent.free.free)))
    assert calls == [1]


def test_loose_parts_are_reported_and_refused_in_statics():
    body = strip()
    with pytest.warns(StvkWarning, match=r"1 part becomes loose: 16 elements \(8, .*\) with 15 vertices"):
        body = body.without(column(body, 1.5, 2))
    assert len(np.unique(parts_of_body(body))) == 2
    with pytest.raises(SupportError, match=r"the part of 15 vertices .* has 3 rigid modes left"):
        solve_static(body, quiet=True)
    body = quietly(body.without, column(body, 2, 9))
    assert solve_static(body, quiet=True).success
    assert len(body.bare) == 15


def test_the_largest_piece_of_a_free_body_is_not_a_loose_part():
    body = System(strip().mesh, StVK(young=1.0, poisson=0.3))
    with pytest.warns(StvkWarning, match=r"1 part becomes loose: 12 elements"):
        body = body.without(column(body, 1.5, 2))
    body = body.without(column(body, 3.5, 9))  # elements of a part that is loose already
    with pytest.warns(StvkWarning, match=r"1 part becomes loose"):
        body = body.without(column(body, 2.5, 3))


def test_a_part_that_loses_its_support_is_loose():
    body = strip()
    with pytest.warns(StvkWarning, match=r"1 part becomes loose: 28 elements"):
        body = body.without(column(body, 0, 0.5))


def test_a_part_that_hangs_by_a_vertex_is_a_mechanism():
    body = strip()
    x = body.mesh.p[:, body.mesh.t].mean(axis=1)
    body = body.without(np.flatnonzero((x[0] > 1.5) & (x[0] < 2) & (x[1] > 0.5)))
    solve_static(body, quiet=True)
    lower = np.flatnonzero((x[0] > 1.5) & (x[0] < 2) & (x[1] < 0.5))
    body = body.without(lower[:1])
    with pytest.raises(SupportError, match="mechanism"):
        solve_static(body, quiet=True)


def test_removal_of_no_elements_of_elements_twice_and_by_mask():
    body = strip()
    body = body.without([])
    body = body.without(np.zeros(body.mesh.nt, dtype=bool))
    assert not body.removed.size and body.energy(state(body.mesh)) == strip().energy(state(body.mesh))
    body = body.without([4])
    mask = np.zeros(body.mesh.nt, dtype=bool)
    mask[[4, 9]] = True
    body = body.without(mask)
    W = body.energy(state(body.mesh))
    body = body.without([9])
    assert (body.removed == [4, 9]).all() and body.energy(state(body.mesh)) == W


def answers(body, u):
    """Return properties of a body, some of them at a state, all of which the body may cache."""
    found = [body.jacobian(u, 0.5).data, body.residual(u, 0.5), body.product(u, u), body.round_off(u), body.grounded, body.bare]
    found += [body.mass().multiply(u)]
    found += [body.smallest_volume_ratio(u), body.step_limit(0 * u, u), body.energy_along(0 * u, u) if body.quartic else 0.0]
    if body.mesh.element.is_linear_simplex:
        found += [term.form.L.data for term in body.bound_terms if hasattr(term, "form")]
    return [*map(np.array, found), body.mass("consistent").multiply(u)]


@pytest.mark.few
@pytest.mark.parametrize("cached_before", [False, True], ids=["", "cached before"])
@pytest.mark.parametrize(
    ("name", "quadrature"), [*((name, None) for name in EVERY_MESH), ("hexahedra", "one-point"), ("quadrilaterals", "one-point")]
)
def test_the_original_body_is_unchanged(name, quadrature, cached_before):
    """The body from which elements are removed stays bitwise the same, and neither body has cached results of the other.

    Both bodies share scratch arrays and are evaluated alternately.
    """
    pair, other = Pair(name, quadrature), Pair(name, quadrature)
    whole, u = pair.whole, 0.3 * state(pair.mesh)
    wanted_whole, wanted_torn = answers(other.whole, u), answers(other.remove().whole, u)
    fresh_torn = answers(Pair(name, quadrature).remove().whole, u)
    if cached_before:
        answers(whole, u)
    torn = pair.remove().whole
    for _ in range(2):
        for body, *wanted in ((torn, wanted_torn, fresh_torn), (whole, wanted_whole, wanted_whole)):
            *every, mass = answers(body, u)
            for found, one, another in zip(every, *(others[:-1] for others in wanted), strict=True):
                assert np.array_equal(found, one) and np.array_equal(found, another)
            assert alike(mass, wanted[1][-1], 1e-15)  # sums include elements without mass, or exclude them
    assert not whole.removed.size and (torn.removed == np.sort(pair.out)).all()
    assert (torn.pattern is whole.pattern) == cached_before


@dataclass(frozen=True, eq=False)
class RemovableFriction(Friction):
    """Friction as a user-defined term that supports the removal of elements."""

    class Bound(Friction.Bound):
        def without(self, removed):
            left = copy(self)
            left.begun = []
            return left


def test_a_body_with_removed_elements_continues_the_history():
    mesh, rng = EVERY_MESH["tetrahedra"], np.random.default_rng(3)
    whole = System(mesh, [StVK(young=1.0, poisson=0.3), RemovableFriction([1, 4], 2.0)])
    u, v, w = 0.1 * rng.standard_normal((3, whole.ndofs))
    torn, history = whole.without([0]), whole.advanced(whole.first_history(), u, 0.0)
    for later, one in ((u, history), (v, torn.advanced(history, v, 0.0))):
        for body, kept, start in ((torn, later, one), (whole, u, history)):
            energy = ((w - kept).reshape(-1, 3)[[1, 4]] ** 2).sum()  # 1/2 k slip^2
            end = Moment(1.0, 1.0, step=StepStart(start, in_time=False))
            assert body.energies(w, end)["RemovableFriction 1"] == pytest.approx(energy, rel=1e-14)
            assert body.linearize(w, t=end)[0] == pytest.approx(body.energy(w, end), rel=1e-14)


def test_degrees_of_freedom_of_the_whole_body_are_those_of_the_remaining_one():
    body = strip()
    u = 0.3 * state(body.mesh)
    free = body.free_dofs(body.supports.held)
    body.tangent(u, free=free)
    torn = body.without([4, 9])
    K = torn.tangent(u, free=free)
    assert np.abs(K - free.matrix(torn.tangent(u))).max() == 0 and np.abs(K - body.tangent(u, free=free)).max() > 0.01


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ([99], "outside 0"),
        ([-1], "outside 0"),
        ([1, 1], "more than once"),
        (np.ones(3, dtype=bool), "mask of shape"),
        ("nowhere", "no subdomain"),
        ([0.5], "expected a list"),
        (np.arange(32), "All 32 elements would be removed"),
        (None, "All 32 elements would be removed"),
    ],
)
def test_invalid_removals_are_refused_without_changes(given, message):
    body = strip()
    with pytest.raises(RegionError, match=message):
        body.without(given)
    assert not body.removed.size


@pytest.mark.parametrize(
    ("term", "name"),
    [(Springs(np.array([[0], [5]])), "Springs"), (Anchors([5, 2, 7], 3.0), "Anchors"), (Friction([1, 2], 3.0), "Friction")],
    ids=lambda one: one if isinstance(one, str) else "",
)
def test_terms_without_elements_refuse_removal_by_name(term, name):
    mesh = EVERY_MESH["tetrahedra"]
    body = System(mesh, [StVK(young=1.0, poisson=0.3), term])
    W = body.energy(state(mesh))
    with pytest.raises(StvkError, match=f"{name}: elements cannot be removed"):
        body = body.without([0])
    assert body.energy(state(mesh)) == W and not body.removed.size


def test_loads_whose_pairs_change_refuse_removal_by_name():
    class Travelling(Vortex):
        class Bound(Vortex.Bound):
            pairs_change, pattern_version = True, 0

    body = System(EVERY_MESH["tetrahedra"], [StVK(young=1.0, poisson=0.3), Travelling([1, 4, 9], 2.0)])
    with pytest.raises(StvkError, match="Travelling: elements cannot be removed"):
        body.without([0])


def test_loads_without_elements_are_bound_again():
    mesh = EVERY_MESH["tetrahedra"]
    body = System(mesh, [StVK(young=1.0, poisson=0.3), Vortex([1, 4, 9], 2.0)])
    K = body.jacobian(state(mesh))
    body = body.without([0])
    assert np.isfinite(body.jacobian(state(mesh), out=K).data).all()


def test_a_retained_stiffness_of_a_removed_element_is_found():
    """A planted fault is found: one removed element of a block retains its coefficients."""
    pair = Pair("tetrahedra", loads=False)
    term = pair.whole.bound_terms[0]
    kept = term._D.copy()
    term = pair.remove().whole.bound_terms[0]
    u = state(pair.mesh)
    wanted = pair.part.internal_force(u[pair.dofs])
    assert alike(pair.whole.internal_force(u)[pair.dofs], wanted)
    own = int(np.flatnonzero(term.elements.elements == pair.out[0])[0])
    block, lane = divmod(own, LANES)
    numbers = slice(block * (len(kept) // len(term.elements.t)) + lane, (block + 1) * (len(kept) // len(term.elements.t)), LANES)
    term._D[numbers] = kept[numbers]
    assert not alike(pair.whole.internal_force(u)[pair.dofs], wanted, 1e-3)


@pytest.mark.few
@pytest.mark.parametrize("name", EVERY_MESH)
def test_fields_are_those_of_the_remaining_body(pairs, name):
    pair = pairs(name)
    u, v = 0.3 * state(pair.mesh), state(pair.mesh, seed=8)
    found, wanted = Fields.of(pair.whole).at(u, v), Fields.of(pair.part).at(u[pair.dofs], v[pair.dofs])
    for field in ("cauchy_stress", "green_strain", "volume_ratio", "strain_energy_density", "principal_stretches"):
        assert np.ma.getmaskarray(found[field])[pair.out].all() and not np.ma.getmaskarray(found[field])[pair.kept].any()
        assert alike(found[field][pair.kept], wanted[field], 1e-12)
        assert alike(found.at_nodes(field)[pair.used], wanted.at_nodes(field), 1e-11)


@pytest.mark.parametrize("name", ["tetrahedra", "triangles", "hexahedra", "quadratic triangles"])
def test_files_and_pictures_exclude_removed_elements(pairs, name, tmp_path):
    pair = pairs(name)
    u = 0.3 * state(pair.mesh)
    file = write_vtu(tmp_path / "torn.vtu", Fields.of(pair.whole).at(u))
    read = meshio.read(file)
    assert len(read.points) == pair.mesh.nv and len(read.cells[0].data) == len(pair.kept)
    assert all(len(values[0]) == len(pair.kept) for values in read.cell_data.values())
    torn, whole = (
        picture_of(one, "von_mises", 1.0, None) for one in (Fields.of(pair.whole).at(u), Fields.of(pair.part).at(u[pair.dofs]))
    )
    assert torn.cells.shape == whole.cells.shape
    assert alike(np.sort(torn.moved[torn.cells].ravel()), np.sort(whole.moved[whole.cells].ravel()), 1e-12)


def test_films_exclude_removed_elements(tmp_path):
    body = strip()
    before = Fields.of(body).at(0.1 * state(body.mesh))
    body = quietly(body.without, [4, 5])
    after = Fields.of(body).at(0.1 * state(body.mesh))
    series = save_series(tmp_path / "film.pvd", ["von_mises"], [(0.0, before), (1.0, after)])
    for source in (series, [(0.0, before), (1.0, after)]):
        assert animate(source, tmp_path / "film.gif", "von_mises").stat().st_size > 1000


LAWS = {
    "neo-Hookean": lambda young, region: NeoHookean(young=young, poisson=0.3, region=region),
    "linear": lambda young, region: LinearElastic(young=young, poisson=0.3, region=region),
    "corotated": lambda young, region: Corotated(young=young, poisson=0.3, region=region),
    "invertible": lambda young, region: InvertibleStVK(young=young, poisson=0.3, region=region),
    "wrinkling": lambda young, region: StVK(young=young, poisson=0.3, region=region, plane="stress", wrinkling=True),
}
ON_MESHES = [
    (law, name) for law in LAWS for name in ("tetrahedra", "triangles", "hexahedra") if law != "wrinkling" or name == "triangles"
]


@pytest.mark.parametrize(
    ("law", "name"), [row if row == ("neo-Hookean", "tetrahedra") or row[0] == "wrinkling" else slow(*row) for row in ON_MESHES]
)
def test_other_laws_support_the_removal_of_elements(law, name):
    """Other laws, on half of the elements, support removal, also if the removed elements are inverted."""
    pair = Pair(name, loads=False)
    mesh, n = pair.mesh, pair.mesh.nt
    young, some = np.random.default_rng(9).uniform(1, 2, n), np.flatnonzero(np.arange(n) % 4 > 0)
    other = StVK(young=0.5, poisson=0.2)
    whole = System(mesh, [other, LAWS[law](young[some], some)])
    mine = np.flatnonzero(np.isin(pair.kept, some))
    part = quietly(System, pair.rest, [other, LAWS[law](young[pair.kept[mine]], mine)])
    u = 0.1 * state(mesh)
    whole = quietly(whole.without, pair.out)
    if len(whole.bare):
        u.reshape(-1, mesh.d)[whole.bare] += 5 * state(mesh).reshape(-1, mesh.d)[whole.bare]
    x = u[pair.dofs]
    assert whole.energy(u) == pytest.approx(part.energy(x), rel=1e-13)
    assert alike(whole.internal_force(u)[pair.dofs], part.internal_force(x), 1e-13)
    assert alike(whole.tangent(u)[pair.dofs][:, pair.dofs].toarray(), part.tangent(x).toarray(), 1e-12)
    assert whole.smallest_volume_ratio(u) == part.smallest_volume_ratio(x)
    v = 0.05 * state(mesh, seed=8)
    forces = [np.zeros(body.ndofs) for body in (whole, part)]
    R = add_mean_force(whole, u, u + v, forces[0]), add_mean_force(part, x, x + v[pair.dofs], forces[1])
    assert R[0] == pytest.approx(R[1], rel=1e-10, abs=1e-12) and alike(forces[0][pair.dofs], forces[1], 1e-10)
    found, wanted = Fields.of(whole).at(u), Fields.of(part).at(x)
    assert alike(found["cauchy_stress"][pair.kept], wanted["cauchy_stress"], 1e-11)
