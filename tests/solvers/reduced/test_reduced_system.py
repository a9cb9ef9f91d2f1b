"""W, F, K, supports, loads and files of a reduced body are those of the body, which `verify` checks. Invalid ones are refused."""

from types import SimpleNamespace

import numpy as np
import pytest
import skfem
from bodies import box, curved
from solvers.reduced.test_quartic import ordered

from skfem_stvk import (
    BodyForce,
    ElasticFoundation,
    Gravity,
    NeoHookean,
    Pressure,
    ReducedSystem,
    StVK,
    StvkError,
    SupportError,
    System,
    Traction,
    VolumePenalty,
    modes,
    verify,
)
from skfem_stvk.linear import Kind, Pardiso, SuperLU
from skfem_stvk.solvers.dynamics.at_rest import AtRest
from skfem_stvk.solvers.reduced.basis import masses_of, second_derivatives, vibration_modes

LAW = StVK(young=2.0, poisson=0.3, density=1.5)


def left(x):
    return x[0] < 1e-9


def right(x):
    return x[0] > 0.99


def upright(n=2):
    """Return a cube with two plane ends normal to x."""
    mesh = box(n)
    p = mesh.p.copy()
    p[0, p[0] < 0.2] = 0
    p[0, p[0] > 0.8] = 1
    return type(mesh)(p, mesh.t)


def cube(*terms, **held):
    return System(upright(), [LAW, *terms], **{"fixed": [(left, "xyz")]} | held)


def reduced_of(body, size=6, modes=3, **options):
    return ReducedSystem(body, size, modes, quiet=True, **options)


def some_q(reduced, amount=0.3):
    """Return generalized coordinates with finite displacements."""
    q = np.cos(1.0 + np.arange(reduced.size))
    return q * amount / np.abs(reduced.basis @ q).max()


BODIES = {
    "held": lambda: cube(),
    "pulled": lambda: cube(prescribed=[(right, {"x": 0.2, "y": 0.1})]),
    "rotated": lambda: cube(
        prescribed=[(right, lambda x, t: np.stack([0 * x[0], x[1] * (np.cos(t) - 1) - x[2] * np.sin(t), x[1] * np.sin(t)]))]
    ),
    "quadratic": lambda: System(curved(upright(1)), LAW, fixed=[(left, "xyz")]),
    "on springs": lambda: System(upright(), [LAW, ElasticFoundation(left, 3.0)]),
    "with a penalty": lambda: cube(VolumePenalty(0.7)),
    "neo-Hookean": lambda: System(upright(), NeoHookean(young=2.0, poisson=0.3, density=1.5), fixed=[(left, "xyz")]),
    "without density": lambda: System(upright(), StVK(young=2.0, poisson=0.3), fixed=[(left, "xyz")]),
}


@pytest.mark.parametrize("name", BODIES)
def test_energy_force_and_tangent_are_those_of_the_body_projected(name):
    body = BODIES[name]()
    reduced = reduced_of(body)
    q, t, V = some_q(reduced, 0.1), 0.6, reduced.basis
    u = reduced.displacements(q, t)
    W, F, K = reduced.linearize(q, t)
    assert np.allclose(u[body.supports.held], body.supports.values(t), rtol=0, atol=1e-15)
    assert np.abs(u).max() > 0.05 and abs(W / body.energy(u) - 1) < 1e-12
    full, tangent = V.T @ body.internal_force(u), V.T @ (body.tangent(u) @ V)
    assert np.abs(F - full).max() < 1e-12 * np.abs(full).max()
    assert np.abs(K - tangent).max() < 1e-12 * np.abs(tangent).max()
    pulled = reduced.lifts.T @ body.internal_force(u)
    assert np.abs(reduced.lift_force(q, t) - pulled).max(initial=0) <= 1e-12 * np.abs(pulled).max(initial=0)
    assert np.allclose(reduced.coordinates(u, t), q, atol=1e-13)


@pytest.mark.parametrize("name", BODIES)
def test_the_basis_is_orthonormal_by_mass_and_zero_at_constrained_degrees_of_freedom(name):
    body = BODIES[name]()
    reduced = reduced_of(body)
    density = 1.0 if name == "without density" else 1.5
    with_mass = System(body.mesh, StVK(young=1.0, poisson=0.3, density=density), fixed=[(left, "xyz")])
    masses = np.repeat(with_mass.mass().vertex, 3)
    assert np.abs(reduced.basis.T * masses @ reduced.basis - np.eye(6)).max() < 1e-13
    assert not reduced.basis[body.supports.held].any()


LOADS = {
    "dead": [Gravity((0.1, -0.2, 0.3)), Traction(right, (0.1, 0.2, -0.1))],
    "a function of time": [Traction(right, lambda t: (0.1 * t, 0.2 * np.sin(t), 0.0))],
    "a function of x and t": [BodyForce(lambda x, t: (x[0] * t, x[1], 0 * x[2] + t))],
    "following": [Pressure(right, 0.2), Gravity((0, 0, -0.1))],
}


@pytest.mark.parametrize("name", LOADS)
def test_loads_are_those_of_the_body_projected(name):
    body = cube(*LOADS[name], prescribed=[([3], {"y": 0.1})] if name == "dead" else None)
    reduced = reduced_of(body)
    q, t = some_q(reduced), 0.7
    u, V = reduced.displacements(q, t), reduced.basis
    for mine, of_body in (
        (reduced.external_force(q, t), V.T @ body.external_force(u, t)),
        (reduced.residual(q, t), V.T @ body.residual(u, t)),
        (reduced.jacobian(q, t), V.T @ (body.jacobian(u, t) @ V)),
    ):
        assert np.abs(mine - of_body).max() < 1e-12 * np.abs(of_body).max()
    if body.conservative:
        assert abs(reduced.potential(q, t) - body.potential(u, t)) < 1e-12 * abs(body.energy(u))


def test_the_energy_along_a_line_is_a_quartic():
    reduced = reduced_of(BODIES["pulled"]())
    q, v = some_q(reduced), some_q(reduced)[::-1].copy()
    c = reduced.energy_along(q, v, 0.5)
    for s in (-2.0, 0.5, 3.0):
        assert abs(np.polynomial.polynomial.polyval(s, c) / reduced.energy(q + s * v, 0.5) - 1) < 1e-13


def test_a_changed_prescribed_displacement_takes_effect_at_the_same_time():
    """A prescribed displacement that changes between two calls at the same time takes effect, such as that of a handle."""
    given = [0.1]
    reduced = reduced_of(cube(prescribed=[(right, {"x": lambda t: t * given[0]})]))
    q = some_q(reduced)
    before, s = reduced.energy(q, 0.5), reduced.amounts(0.5)
    assert reduced.energy(q, 0.5) == before
    given[0] = -0.3
    np.testing.assert_allclose(reduced.amounts(0.5), -3 * s, rtol=1e-14)
    u = reduced.displacements(q, 0.5)
    assert abs(reduced.energy(q, 0.5) / reduced.body.energy(u) - 1) < 1e-12 and abs(reduced.energy(q, 0.5) / before - 1) > 0.01


def test_amounts_can_be_overwritten():
    reduced = reduced_of(BODIES["pulled"]())
    s = reduced.amounts(0.5)
    expected = s.copy()
    s[:] = np.nan
    np.testing.assert_array_equal(reduced.amounts(0.5), expected)


REFUSED = [
    (SupportError, "rigid", lambda: reduced_of(System(upright(), LAW))),
    (StvkError, "size = 10; expected at most 9: there are 3 modes and 6 modal derivatives", lambda: reduced_of(cube(), 10, 3)),
    (StvkError, "size = 4; expected at most 3: there are 3 modes", lambda: reduced_of(cube(), 4, 3, derivatives=False)),
    (StvkError, "size = 6 needs about", lambda: reduced_of(cube(), most_memory=1e6)),
    (StvkError, "young: a reduced body defines these", lambda: verify(reduced_of(cube()), young=1.0)),
]


@pytest.mark.parametrize(("error", "message", "call"), REFUSED, ids=[row[1] for row in REFUSED])
def test_invalid_reductions_are_refused(error, message, call):
    with pytest.raises(error, match=message):
        call()


@pytest.mark.parametrize(
    ("given", "size"),
    [
        ({"modes": 2}, 5),
        ({"modes": 2, "derivatives": False}, 2),
        ({"modes": 0, "snapshots": 4}, 4),
        ({"modes": 0, "snapshots": 40}, 30),
        ({"size": 4}, 4),
        ({}, 30),
    ],
)
def test_default_sizes_follow_from_the_other_arguments(given, size):
    """The default sizes follow from the arguments given. Duplicate snapshots count once."""
    body, rng = cube(), np.random.default_rng(2)
    if "snapshots" in given:
        states = rng.standard_normal((body.ndofs, given["snapshots"]))
        states[body.supports.held] = 0
        given = given | {"snapshots": np.hstack([states, states])}
    reduced = ReducedSystem(body, quiet=True, **given)
    assert (reduced.size, reduced.basis.shape[1]) == (size, size)


def test_a_body_of_few_nodes_has_as_many_modes_as_degrees_of_freedom():
    body = System(skfem.MeshTet(), LAW, fixed={(0, 1, 2): "xyz"})
    assert ReducedSystem(body, quiet=True).size == body.ndofs - 9


def test_snapshots_are_in_the_span():
    body = cube(prescribed=[(right, {"x": 0.2})])
    states = np.random.default_rng(0).standard_normal((body.ndofs, 3))
    states[body.supports.held] = 0
    states[body.supports.held] += body.supports.values(0.4)[:, None]
    reduced = reduced_of(body, 3, 0, snapshots=states)
    for u in states.T:
        assert np.abs(reduced.displacements(reduced.coordinates(u, 0.4), 0.4) - u).max() < 1e-12
    states[body.supports.held[0], 1] += 0.1
    with pytest.raises(StvkError, match="snapshots violate the supports in 1 of 3"):
        reduced_of(body, 3, 0, snapshots=states)
    for count in (0, 3):
        with pytest.raises(StvkError, match=r"snapshots have the shape \(\d+, 0\); expected a column for each state, or None"):
            reduced_of(body, None, count, snapshots=states[:, :0])


@pytest.mark.parametrize("count", [3, 40])
def test_modes_of_the_basis_are_those_of_the_body(count):
    """The modes equal those of `modes`, including the double bending modes of a square bar."""
    mesh = skfem.MeshTet.init_tensor(np.linspace(0, 3, 7), np.linspace(0, 1, 3), np.linspace(0, 1, 3))
    body = System(mesh, LAW, fixed=[(left, "xyz")])
    values, vectors = vibration_modes(masses_of(body), AtRest(body), count)
    expected = modes(body, count).eigenvalues
    assert np.abs(values / expected - 1).max() < 1e-8
    assert vectors.shape == (body.ndofs - len(body.supports.held), count)


def test_masses_of_a_torn_body_without_density_are_those_of_density_1():
    light, heavy = (System(upright(), StVK(young=2.0, poisson=0.3, density=density)) for density in (None, 1.0))
    wanted = masses_of(heavy.without([3, 7, 30]))
    assert masses_of(heavy).sum() > 1.01 * wanted.sum()
    np.testing.assert_allclose(masses_of(light.without([3, 7, 30])), wanted, rtol=1e-13)


def test_modal_derivatives_are_the_second_derivatives_of_the_force():
    """Second derivatives of F along two fields equal half the difference of `K(phi_j) phi_i` and `K(-phi_j) phi_i`."""
    body = cube()
    fields = np.random.default_rng(0).standard_normal((body.ndofs, 3))
    along = second_derivatives(body, fields)
    for i, j in ((0, 0), (0, 2), (1, 2)):
        plus, minus = (body.tangent(sign * fields[:, j]) @ fields[:, i] for sign in (1, -1))
        assert np.abs(along(i, j) - (plus - minus) / 2).max() < 1e-12 * np.abs(plus).max()


@pytest.mark.parametrize("solver", [SuperLU(), Pardiso()])
def test_many_right_hand_sides_at_once_have_the_solutions_of_single_ones(solver):
    if solver.name == "pardiso":
        pytest.importorskip("pypardiso")
    rest = AtRest(cube())
    factors = solver.analyse(rest._tangent.unknowns()).factorise(rest.K, Kind.SYMMETRIC)
    B = np.random.default_rng(0).standard_normal((len(rest.free), 5))
    X = factors.solve_many(B)
    for x, b in zip(X.T, B.T, strict=True):
        assert np.abs(x - factors.solve(b).x).max() < 1e-11 * np.abs(x).max()
    assert np.abs(rest.K @ X - B).max() < 1e-10


def failures(reduced):
    return {(result.check, result.quantity) for result in verify(reduced, quiet=True).failures()}


@pytest.mark.parametrize("name", ["held", "rotated", "quadratic", "with a penalty"])
def test_reduced_bodies_pass(name):
    report = verify(reduced_of(BODIES[name]()), quiet=True)
    assert report.passed, str(report)
    assert len(report.results) == 1 + 3 * 6


def altered(change):
    """Return a reduced body with changed coefficients of the quartic."""
    reduced = reduced_of(cube())
    inner = reduced.in_coordinates
    change(inner.coefficients, reduced)
    inner._known = {}
    return reduced


def test_a_wrong_coefficient_is_noticed():
    def change(T, reduced):
        T[np.argmax(np.abs(T))] *= 1 + 1e-6

    assert {("agreement", "W"), ("agreement", "F"), ("agreement", "K")} <= failures(altered(change))


def test_a_missing_cubic_part_is_noticed():
    """The check finds a missing cubic part: the coefficients with exactly one factor `x_0` are zero."""

    def change(T, reduced):
        T[[indices.count(0) == 1 for indices in ordered(reduced.size + 1)]] = 0

    assert ("agreement", "F") in failures(altered(change))


class AlteredResponse:
    """Reduced body with an altered response."""

    def __init__(self, reduced, response):
        self.__dict__.update(body=reduced.body, columns=reduced.columns, size=reduced.size, masses=reduced.masses, quartic=True)
        self._reduced, self._response = reduced, response

    def response(self, z):
        return self._response(*self._reduced.response(z))


FAULTS = {
    "a wrong factor in K": (lambda W, F, K: (W, F, 1.001 * K), ("derivatives", "K")),
    "a wrong factor in F": (lambda W, F, K: (W, 1.001 * F, K), ("derivatives", "F")),
    "K that is not symmetric": (lambda W, F, K: (W, F, K + 1e-6 * np.triu(K, 1)), ("symmetry", "K")),
    "another energy": (lambda W, F, K: (W + 1.0, F, K), ("agreement", "W")),
}


@pytest.mark.parametrize("name", FAULTS)
def test_wrong_responses_are_noticed(name):
    response, noticed = FAULTS[name]
    assert noticed in failures(AlteredResponse(reduced_of(cube()), response))


def test_a_basis_that_is_not_orthonormal_is_noticed():
    reduced = reduced_of(cube())
    stretched = AlteredResponse(reduced, lambda *response: response)
    stretched.columns = 1.001 * reduced.columns
    assert ("orthonormality", "V' M V") in failures(stretched)


def test_a_file_makes_the_same_body_again(tmp_path):
    body = BODIES["rotated"]()
    reduced = reduced_of(body)
    again = ReducedSystem.load(reduced.save(tmp_path / "body.npz"), BODIES["rotated"]())
    q = np.cos(np.arange(6.0))
    for one, other in zip(reduced.linearize(q, 0.3), again.linearize(q, 0.3), strict=True):
        assert np.array_equal(one, other)
    assert np.array_equal(reduced.displacements(q, 0.3), again.displacements(q, 0.3))


def test_a_file_serves_a_body_with_other_loads(tmp_path):
    file = reduced_of(cube()).save(tmp_path / "body.npz")
    assert ReducedSystem.load(file, cube(Traction(right, (1.0, 0, 0)))).external_force(np.zeros(6)).any()


OTHERS = {
    "elastic terms": lambda: System(upright(), StVK(young=2.1, poisson=0.3, density=1.5), fixed=[(left, "xyz")]),
    "mesh": lambda: System(upright(3), LAW, fixed=[(left, "xyz")]),
    "supports": lambda: System(upright(), LAW, fixed=[(left, "xyz"), (right, "y")]),
    "masses": lambda: System(upright(), StVK(young=2.0, poisson=0.3, density=1.6), fixed=[(left, "xyz")]),
}


@pytest.mark.parametrize("name", OTHERS)
def test_a_file_of_another_body_is_refused(name, tmp_path):
    file = reduced_of(cube()).save(tmp_path / "body.npz")
    with pytest.raises(StvkError, match=f"another problem: .*{name}.* changed"):
        ReducedSystem.load(file, OTHERS[name]())


def test_damaged_files_and_files_of_other_formats_are_refused(tmp_path):
    file = reduced_of(cube()).save(tmp_path / "body.npz")
    content = file.read_bytes()
    file.write_bytes(content[: len(content) // 2])
    with pytest.raises(StvkError, match="cannot be read as a reduced body"):
        ReducedSystem.load(file, cube())
    with pytest.raises(StvkError, match=r"does not end in \.npz"):
        ReducedSystem.load(tmp_path / "body.txt", cube())
    with pytest.raises(StvkError, match="body = "):
        ReducedSystem.load(file, SimpleNamespace())
