"""Loads with a potential that are not dead: their stiffness is in every tangent of a path of equilibria."""

import numpy as np
import pytest
from beams import beam, tangent
from springs import PointSpring

from skfem_stvk import ElementMesh, NodalLoad, Stop, StVK, System, Traction, solve_static
from skfem_stvk.linear import Kind, SuperLU
from skfem_stvk.results.monitors import Monitors
from skfem_stvk.solvers.newton.newton import length as length_along
from skfem_stvk.solvers.newton.problem import Tangent
from skfem_stvk.solvers.newton.stopwatch import Stopwatch
from skfem_stvk.solvers.statics import Status
from skfem_stvk.solvers.statics.continuation import ContinuationOptions
from skfem_stvk.solvers.statics.equilibrium import Equilibrium
from skfem_stvk.solvers.statics.load_steps import LoadSteps

ELASTIC = StVK(young=1e4, poisson=0.3)
MESH = beam(n=1)
TIP = np.unique(MESH.boundaries["tip"])
ANCHOR = (6.0, 3.0, -2.0)


def tied(length=0.5, stiffness=300.0):
    """Return a cantilever whose tip is pulled far to one side by springs."""
    return System(
        MESH, [ELASTIC, PointSpring(TIP, ANCHOR, stiffness, length), Traction("tip", (0, 0, 30.0))], fixed={"wall": "xyz"}
    )


@pytest.fixture(scope="module")
def pulled():
    return solve_static(tied(), steps=4, quiet=True, solver="superlu", rtol=1e-11)


def test_the_residual_with_springs_is_the_gradient_of_the_potential(pulled):
    system, v = pulled.system, np.sin(np.arange(len(pulled.u)))
    held = system.supports.held
    v[held] = 0
    W = {s: system.potential(pulled.u + s * v) for s in (-2e-3, -1e-3, 1e-3, 2e-3)}
    slope = (8 * (W[1e-3] - W[-1e-3]) - (W[2e-3] - W[-2e-3])) / 12e-3
    assert abs(slope) < 1e-6 * system.energy(pulled.u) and pulled.status is Status.CONVERGED
    assert pulled.u.reshape(-1, 3)[TIP, 1].mean() > 1.0


def test_newtons_method_converges_quadratically_with_their_stiffness(pulled):
    last = pulled.history[-1].iterations.residuals
    assert len(pulled.history) == 4 and last[-1] < 1e-11 and last[-2] < 1e-4 and len(last) < 12


@pytest.mark.parametrize("solver", ["amg-cg", "block-jacobi-cg", "ssor-cg"])
def test_every_solver_finds_the_same_state(pulled, solver):
    """All solvers find the same state; matrix-free solvers get a matrix."""
    found = solve_static(tied(), steps=4, quiet=True, solver=solver, stability=True)
    assert np.abs(found.u - pulled.u).max() < 1e-6 * np.abs(pulled.u).max()
    assert found.history[-1].lowest == pytest.approx(np.linalg.eigvalsh(tangent(pulled.system, pulled.u))[0], rel=1e-4)


def test_the_line_search_converges_from_a_remote_start(pulled):
    """The line search converges from a remote start.

    The energy of springs with a rest length is not a quartic along a line.
    """
    start = np.zeros(MESH.p.size)
    start.reshape(-1, 3)[:, 1] = 1.2 * (MESH.p[0] / 5) ** 2
    start[pulled.system.supports.held] = 0
    found = solve_static(tied(), steps=1, u0=start, quiet=True, solver="superlu", rtol=1e-11)
    assert np.abs(found.u - pulled.u).max() < 1e-8


def shallow(spring):
    """Return an inclined bar that is pushed down at its head, with or without a vertical spring at the head."""
    mesh = ElementMesh(np.array([[-1.0, 0.0], [0.0, 0.3]]), np.array([[0], [1]]))
    terms = [StVK(young=1e5, poisson=0.3, area=1e-2), NodalLoad([1], (0.0, -6.0))]
    return System(mesh, [*terms, *spring], fixed=[([0], "xy"), ([1], "x")])


def vertical(u, k):
    """Return the load factor at which the head is in equilibrium at `u`.

    The bar has the energy `E A/(8 L^3) (l^2 - L^2)^2`, and the stiffness of the spring grows with the load.
    """
    L2, h = 1.09, 0.3
    bar = 1e5 * 1e-2 / (2 * L2**1.5) * ((h + u) ** 2 + 1 - L2) * (h + u)
    return -bar / (6.0 + k * (h + u - 0.6))


def test_arc_length_follows_springs_through_limit_points():
    k = 4.0
    system = shallow([PointSpring([1], (0.0, 0.6), k)])
    path = solve_static(system, steps=20, method="arc-length", stop=Stop(turns=2), quiet=True, rtol=1e-12)
    u = np.array([step.u[3] for step in path.history])
    assert np.array([step.t for step in path.history]) == pytest.approx(vertical(u, k), rel=1e-8, abs=1e-9)
    grid = np.linspace(-0.3 - 1e-9, 0.0, 400_001)
    first, second = path.critical_points
    assert first.kind == second.kind == "limit point" and first.t == pytest.approx(vertical(grid, k).max(), rel=1e-8)
    assert (
        abs(first.t - solve_static(shallow([]), steps=20, method="arc-length", stop=Stop(turns=1), quiet=True).critical_points[0].t)
        > 0.01
    )


def test_a_body_that_a_load_makes_unstable_at_rest_is_unstable():
    """A body with springs that push away from its position is unstable at rest, and its path has no bifurcation.

    K is indefinite from the start.
    """
    mesh = ElementMesh(np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0], [1]]))
    away = PointSpring([1], (1.0, 0.0), lambda t: -150.0)
    terms = [StVK(young=1e4, poisson=0.3, area=1e-2), away, NodalLoad([1], (1.0, 0.0))]
    system = System(mesh, terms, fixed=[([0], "xy"), ([1], "y")])
    path = solve_static(system, steps=4, method="arc-length", quiet=True)
    assert [step.negative for step in path.history] == [1] * len(path.history) and path.critical_points == ()
    assert path.status is Status.UNSTABLE


def equilibrium(system, solver=None):
    return Equilibrium(system, solver or SuperLU(), Stopwatch())


def test_the_line_search_minimises_the_potential_of_springs():
    """The line search minimises the potential of springs.

    Their energy along a line is not a quartic, and their force varies along it.
    """
    problem, u = equilibrium(tied(length=2.0, stiffness=3e3)), np.zeros(MESH.p.size)
    residual = problem.residual(u, 1.0)
    v = problem.tangent.free.vector(-residual.vector / 300)
    s = length_along(problem, u, v, 1.0, residual, np.inf)
    slopes = [problem.residual(u + length * v, 1.0).vector @ v[problem.tangent.free.free] for length in (0.0, s)]
    assert not problem.quartic and slopes[0] < 0 and abs(slopes[1]) <= 0.1 * abs(slopes[0])


def test_a_tangent_with_springs_is_not_assumed_positive_definite():
    kinds = []

    class Spy:
        def factorise(self, K, kind):
            kinds.append(kind)

    for system in (tied(), System(MESH, [ELASTIC, Traction("tip", (0, 0, 30.0))], fixed={"wall": "xyz"})):
        problem = equilibrium(system)
        problem.tangent._analysis = Spy()
        problem.factorise(np.zeros(MESH.p.size), 1.0, Tangent.CLAMPED)
    assert kinds == [Kind.SYMMETRIC, Kind.POSITIVE_DEFINITE]


@pytest.mark.parametrize(("k", "negative"), [(-150.0, 1), (-50.0, 0)])
def test_a_path_begins_with_the_negative_eigenvalues_of_springs(k, negative):
    mesh = ElementMesh(np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0], [1]]))
    away = PointSpring([1], (1.0, 0.0), lambda t: k)
    system = System(mesh, [StVK(young=1e4, poisson=0.3, area=1e-2), away], fixed=[([0], "xy"), ([1], "y")])
    path = LoadSteps(
        equilibrium(system),
        np.zeros(4),
        0.0,
        ContinuationOptions(0.25, 1e-8, Monitors(system), False, lambda t, record: None),
    )
    assert path._point.negative == negative
