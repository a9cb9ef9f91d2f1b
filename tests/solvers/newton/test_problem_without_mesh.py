"""Newton's method and the eigenvalue tools work on twenty unknowns without mesh, system and degrees of freedom."""

import ast
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.sparse import csr_matrix

import skfem_stvk
from skfem_stvk import StateError
from skfem_stvk.linear import Kind, SuperLU, Unknowns
from skfem_stvk.solvers.newton.newton import End, NewtonOptions, newton
from skfem_stvk.solvers.newton.problem import Residual, Tangent, slope
from skfem_stvk.solvers.newton.stability import lowest_mode, nearest_mode, stability_of
from skfem_stvk.space import Space

N, GHOSTS = 20, 3
RTOL = 1e-10


class WithGhosts(Space):
    """Vectors in reverse order in which the first three entries occur twice.

    A part of a body on one of several ranks has ghosts in this way.
    """

    def __init__(self):
        super().__init__(N + GHOSTS)

    def dot(self, x, y):
        assert len(x) == len(y) == N + GHOSTS
        return super().dot(x[:N], y[:N])


class Unknown(Space):
    """The unknowns of vectors with ghosts."""

    def __init__(self):
        super().__init__(N)

    def expand(self, x):
        return np.concatenate([x[::-1], x[:GHOSTS]])

    def restrict(self, f):
        return f[:N][::-1]

    def dot(self, x, y):
        assert len(x) == len(y) == N
        return super().dot(x, y)


class Wells:
    """Chain of masses with the potential `V(x) = 1/2 x'Ax + 1/4 sum c_i x_i^4 - t b.x`.

    Each mass is in a double well if `A` is not positive definite. States are vectors with ghosts, and the spaces define which
    entries count.
    """

    iterative, quartic, symmetric, has_barrier = False, True, True, False
    states, space = WithGhosts(), Unknown()

    def __init__(self, spring=1.0, well=0.5):
        rng = np.random.default_rng(0)
        chain = 2 * np.eye(N) - np.eye(N, k=1) - np.eye(N, k=-1)
        self.A, self.c, self.b = spring * chain + well * np.eye(N), 1 + rng.random(N), rng.normal(size=N)
        self.factorised, self.exact = [], None

    def gradient(self, x, t):
        return self.A @ x + self.c * x**3 - t * self.b

    def hessian(self, x):
        return self.A + 3 * np.diag(self.c * x**2)

    def residual(self, u, t):
        x = self.space.restrict(u)
        r = self.gradient(x, t)
        if not np.isfinite(r).all() or np.abs(x).max() > 1e50:
            raise StateError("too large")
        norm = self.space.norm
        return Residual(r, norm(r), norm(t * self.b) + norm(self.A @ x))

    def round_off(self, u, t):
        x = np.abs(self.space.restrict(u))
        return np.finfo(float).eps * self.space.norm(np.abs(self.A) @ x + self.c * x**3 + np.abs(t * self.b))

    def matrix(self, u, t):
        K = csr_matrix(np.ones((N, N)))
        K.data[:] = self.hessian(self.space.restrict(u)).ravel()
        return K, Unknowns(np.arange(N), np.zeros(N, dtype=int), K.indptr, K.indices)

    def operator(self, u, t):
        return self.matrix(u, t)[0]

    def stiffness_norm(self, u, t):
        return float(np.abs(self.hessian(self.space.restrict(u))).sum(axis=1).max())

    def factorise(self, u, t, tangent=Tangent.EXACT):
        K, unknowns = self.matrix(u, t)
        if tangent is not Tangent.EXACT:
            values, vectors = np.linalg.eigh(K.toarray())
            K.data[:] = (vectors @ np.diag(np.maximum(values, 0.1)) @ vectors.T).ravel()
        factors = SuperLU().analyse(unknowns).factorise(K, Kind.SYMMETRIC)
        self.factorised.append(tangent)
        if tangent is Tangent.EXACT:
            self.exact = factors
        return factors

    def solve(self, factors, b, rtol):
        return factors.solve(b, rtol)

    def switch_to_direct(self, u, t):
        return False

    def negative_pivots(self):
        return None if self.exact is None else self.exact.negative_pivots

    def energy_along(self, u, v, t):
        s = np.arange(5.0)
        x, y = self.space.restrict(u), self.space.restrict(v)
        values = [0.5 * z @ self.A @ z + 0.25 * (self.c * z**4).sum() - t * self.b @ z for z in (x + one * y for one in s)]
        c = np.polynomial.Polynomial.fit(s, values, 4).convert().coef
        return np.append(c, np.zeros(5 - len(c)))

    def step_limit(self, u, v):
        return np.inf

    def contact_limit(self, u, v, t):
        return np.inf, ""

    def way_is_free(self, u, found, t):
        return True

    def inside_out(self, u):
        return ()

    def named(self, inside_out):
        return ", ".join(inside_out)


def solved(problem, x=None, t=1.0, **options):
    u, end, record = newton(problem, problem.space.expand(np.zeros(N) if x is None else x), t, NewtonOptions(RTOL, **options))
    return problem.space.restrict(u), end, record


@pytest.mark.parametrize("full_first", [True, False], ids=["full steps first", "line search"])
def test_newton_finds_the_minimum_quadratically_with_the_exact_tangent(full_first):
    problem = Wells()
    x, end, record = solved(problem, full_first=full_first)
    assert end.converged and np.abs(problem.gradient(x, 1.0)).max() < 1e-9
    truth = minimize(lambda x: 0.5 * x @ problem.A @ x + 0.25 * (problem.c * x**4).sum() - problem.b @ x, np.zeros(N)).x
    np.testing.assert_allclose(x, truth, atol=1e-5)
    assert set(record.tangents) == {"exact"} and record.negative_pivots == 0
    assert record.residuals[-1] < 30 * record.residuals[-2] ** 2 or record.residuals[-1] < 1e-14


def test_newton_from_an_indefinite_state_finds_a_minimum():
    problem = Wells(spring=0.3, well=-2.0)
    start = 0.05 * np.cos(np.arange(N))
    assert np.linalg.eigvalsh(problem.hessian(start))[0] < 0
    x, end, record = solved(problem, start, t=0.1, full_first=False)
    assert end.converged and "clamped" in record.tangents and np.linalg.eigvalsh(problem.hessian(x))[0] > 0


def test_without_a_potential_the_line_search_uses_the_slope():
    found = []
    for quartic in (True, False):
        problem = Wells(spring=0.3, well=-2.0)
        problem.quartic = quartic
        if not quartic:
            problem.energy_along = None
        x, end, _ = solved(problem, 1.5 * np.ones(N), t=0.1, full_first=False)
        assert end.converged
        found.append(x)
    np.testing.assert_allclose(*found, atol=1e-7)


@pytest.mark.parametrize(("counted", "end"), [(1.0, End.AT_ROUND_OFF), (0.0, End.NO_LENGTH)])
def test_a_line_search_that_finds_only_round_off_ends_there(counted, end):
    """Forces have errors of 1e-8 with another sign at the states of the search than at its start, so that no length is found."""

    class Rounded(Wells):
        has_barrier, quartic, seen = True, False, b""

        def residual(self, u, t):
            exact, again = super().residual(u, t), u.tobytes() == self.seen
            self.seen = u.tobytes()
            rounded = exact.vector + (1e-8 if again else -1e-8)
            return Residual(rounded, self.space.norm(rounded), exact.scale)

        def round_off(self, u, t):
            return counted * 1e-7

    u, found, _ = newton(Rounded(), np.zeros(N + GHOSTS), 1.0, NewtonOptions(1e-13))
    assert found is end and (not counted or np.abs(Wells().residual(u, 1.0).vector).max() < 1e-6)


def test_a_state_with_ghosts_is_measured_by_its_spaces():
    """Planted fault: a product that counts ghosts twice gives another slope."""
    problem, counted = Wells(), Wells()
    counted.space = Unknown()
    counted.space.dot = lambda x, y: float(Unknown().expand(x) @ Unknown().expand(y))
    u, v = problem.space.expand(np.zeros(N)), problem.space.expand(np.ones(N))
    residual = problem.residual(u, 1.0)
    assert slope(problem, residual, v) == pytest.approx(problem.energy_along(u, v, 1.0)[1], abs=1e-9)
    assert abs(slope(counted, residual, v) - slope(problem, residual, v)) > 0.1
    assert problem.states.dot(u + v, v) == N and problem.states.norm(v) == np.sqrt(N)


def faulty(expand=None, **changes):
    problem = Wells()
    if expand:
        problem.space = Unknown()
        problem.space.expand = expand
    for name, value in changes.items():
        setattr(problem, name, value)
    return problem


FAULTS = {
    "a search direction of the wrong sign": (
        lambda: faulty(expand=lambda x: -Unknown().expand(x)),
        {},
        End.NO_DESCENT,
    ),
    "numbers overflow": (lambda: faulty(expand=lambda x: np.full(N + GHOSTS, -1e60) * np.sign(x[0])), {}, None),
    "a step limit far below one": (
        lambda: faulty(step_limit=lambda u, v: 1e-4, named=lambda found: "this one"),
        {"full_first": False},
        End.INSIDE_OUT,
    ),
    "a contact limit far below one": (
        lambda: faulty(contact_limit=lambda u, v, t: (1e-4, "floor")),
        {"full_first": False},
        End.CONTACT,
    ),
    "a result with inverted elements": (
        lambda: faulty(inside_out=lambda u: ["corner"] * int(np.abs(u).max() > 0.1)),
        {},
        End.INSIDE_OUT,
    ),
    "a tangent a hundred times too stiff": (lambda: faulty(hessian=lambda x: 100 * Wells().hessian(x)), {}, None),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_planted_fault_ends_with_a_reason_and_without_a_state(fault):
    make, options, expected = FAULTS[fault]
    x, end, record = solved(make(), **options)
    if expected is None:
        assert not end.converged or np.abs(Wells().gradient(x, 1.0)).max() < 1e-8, "a converged state must be a solution"
    else:
        assert end is expected and (record.detail or end is not End.INSIDE_OUT)


def test_an_allowed_number_of_inverted_elements_converges():
    inverted = faulty(inside_out=lambda u: ["corner"])
    assert solved(inverted)[1] is End.INSIDE_OUT
    assert solved(inverted, most_inside_out=1)[1].converged


def test_full_steps_across_a_flat_state_are_rejected():
    problem = faulty(way_is_free=lambda u, found, t: False)
    _, end, record = solved(problem)
    assert end.converged and 0 < record.restarted < len(record)


@pytest.mark.parametrize("well", [0.5, -0.5, -2.0])
def test_eigenvalues_of_the_tangent_are_those_of_the_matrix(well):
    problem = Wells(well=well)
    u = problem.space.expand(0.3 * np.sin(np.arange(N)))
    values, vectors = np.linalg.eigh(problem.hessian(problem.space.restrict(u)))
    nearest = np.argmin(np.abs(values))
    mode, lowest = nearest_mode(problem, u, 0.0), lowest_mode(problem, u, 0.0)
    assert mode.value == pytest.approx(values[nearest], rel=1e-5)
    assert abs(problem.space.restrict(mode.vector) @ vectors[:, nearest]) == pytest.approx(1, abs=1e-4)
    assert lowest.value == pytest.approx(values[0], rel=1e-4)
    verdict = stability_of(problem, u, 0.0)
    assert verdict.stable is bool(values[0] > 0) and verdict.negative == (values < 0).sum()


def test_nonlinear_solvers_name_no_mesh_and_no_free_degrees_of_freedom():
    folder = Path(skfem_stvk.__file__).parent / "solvers" / "newton"
    for file in folder.glob("*.py"):
        tree = ast.parse(file.read_text())
        named = {node.attr for node in ast.walk(tree) if isinstance(node, ast.Attribute)}
        modules = {node.module or "" for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
        assert not named & {"free", "free_dofs", "system", "mesh", "supports", "fixed", "held", "ndofs"}, file.name
        assert not {"mesh", "system", "edges", "kernels"} & {part for module in modules for part in module.split(".")}, file.name
