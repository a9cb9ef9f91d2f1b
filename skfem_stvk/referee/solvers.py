"""Checks of a user's static solver on problems with known solutions."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
import skfem
from numpy.typing import NDArray

from ..arguments import Array, flag, number, whole
from ..edges.materials import Hypothesis, Isotropic
from ..errors import StvkError
from ..mesh import ElementMesh
from ..terms import StVK
from .case import rotation
from .discretisation import Discretisation, Shape
from .element_model import model_of, second_piola, small_strain
from .implementations import ContractViolation, Implementation, guarded
from .judgement import relative
from .manufactured import Manufactured, fitted_order, moved_box
from .moduli import engineering_constants
from .reference import lame_tensor
from .report import Report, judge
from .results import Explanation, Naming, Task

#: Cells along each side of the three meshes of the order check, by dimension. SMALL is the mesh of all other checks.
LADDER = {2: (8, 12, 18), 3: (4, 6, 9)}
SMALL = {2: 4, 3: 3}
#: Orders of linear elements, and the amount by which a fitted order may be smaller.
ORDERS, SLACK = {"L2": 2.0, "H1": 1.0}, 0.25
#: Displacement gradient of the patch test, and angles of the rigid motions [degrees].
STRAINED = np.array([[0.25, 0.10, -0.05], [-0.07, -0.15, 0.12], [0.04, 0.09, 0.20]])
ANGLES = (30.0, 60.0)
#: Axes of rotation, by dimension. In space it is not a coordinate axis.
AXIS = {2: np.array([0.0, 0.0, 1.0]), 3: np.array([1.0, 2.0, -2.0])}
#: Constant body force, relative to Young's modulus over the length of the body, and the small one for reciprocity.
LOAD, SMALL_LOAD = np.array([0.6, -0.4, 0.5]), 0.02
#: A hypothesis holds if its residual is below this part of the load, or below 100 times the solver's tolerance.
VANISHES = 1e-4
#: Relative error of the gradient above which a solution is another equilibrium, and order of the rule for the load.
FAR, LOAD_ORDER = 0.5, 4

BodyForceOf = Callable[[Array], Array]
Solve = Callable[[Any, Isotropic, BodyForceOf, "PrescribedNodes"], Any]


@dataclass(frozen=True)
class PrescribedNodes:
    """Nodes at which all components of the displacement are prescribed. The other nodes are free, and no traction acts.

    Attributes
    ----------
    nodes
        (m,) ids of nodes, columns of `mesh.p`.
    values
        (m, d) displacements of these nodes [m].
    dofs
        (m d,) degrees of freedom of these nodes, `d * node + component`, in the order of `values.ravel()`.
    """

    nodes: NDArray[np.int64]
    values: Array

    @property
    def dofs(self) -> NDArray[np.int64]:
        d = self.values.shape[1]
        return (d * self.nodes[:, None] + np.arange(d)).ravel()


def verify_solver(
    solve: Solve,
    *,
    young: float,
    poisson: float,
    dimension: int = 3,
    rtol: float = 1e-6,
    quiet: bool = False,
) -> Report:
    """Check a static solver for St. Venant-Kirchhoff bodies of linear tetrahedra, or of triangles in plane strain.

    This function calls `solve(mesh, material, body_force, boundary)` about twenty times, on cubes of 27 cells or more:

    - `mesh`: `skfem.MeshTet` or `MeshTri`. `mesh.p` (d, nv) are the nodes [m], `mesh.t` (d + 1, nt) the elements. Elements may
      have either orientation.
    - `material`: has `material.young` [Pa] and `material.poisson`; `skfem.models.elasticity.lame_parameters` takes both.
    - `body_force(X)` (d, n) at points `X` (d, n) of the undeformed body: force per undeformed volume [N/m^3]. The force does not
      rotate or grow with the body.
    - `boundary.nodes` (m,), `boundary.values` (m, d): nodes with a prescribed displacement, and these displacements.
      `boundary.dofs` (m d,) are their degrees of freedom `d * node + component`. No traction acts on the rest of the surface.

    `solve` returns the displacements of all nodes, (nv, d), or (ndofs,) with the degrees of freedom `d * node + component`. The
    displacements are large. If a solver needs load steps, it must scale `boundary.values` and `body_force` together.

    The limit of each check is `rtol` times the largest displacement, unless the report gives another limit:

    - boundary values: prescribed nodes have their prescribed displacements.
    - rigid motion: a boundary with one free face rotates the body by 30 and 60 degrees.
    - patch test: a homogeneous strain of 25 % on the boundary gives the same strain everywhere. This also holds with one free face
      whose traction vanishes.
    - equilibrium: under a constant load the nodal forces balance. For linear elements these forces are unique.
    - symmetry: a mirrored and rotated problem has the mirrored and rotated solution.
    - reciprocity (Betti): two small loads on a strained body satisfy `int b1 . u2 = int b2 . u1`.
    - order: the errors of a manufactured solution on three meshes fall with order 2 in L2 and 1 in H1, at most 0.25 less.

    If a check fails, hypotheses are tried on the solution under the constant load, and the report names those that explain it.
    Examples are a factor in the load or in lambda and mu, linear strain, a load per deformed volume, or components in blocks.

    Parameters
    ----------
    solve
        Function `solve(mesh, material, body_force, boundary)` that returns displacements, as above.
    young, poisson
        Young's modulus [Pa] and Poisson's ratio. Avoid `poisson = 0`, where lambda is 0, and 1/4, where lambda is mu.
    dimension
        Dimension of the bodies, 2 or 3.
    rtol
        Relative tolerance to which the solver solves its equations, relative to the displacements.
    quiet
        Whether to hide the progress bar.

    Returns
    -------
    Report
        Use `report.passed`, `report.named`, `print(report)` and `report.save("folder")`.

    Raises
    ------
    StvkError, MaterialError
        if `solve` cannot be called, or a number is out of range.

    Examples
    --------
    >>> from skfem_stvk import BodyForce, StVK, System, solve_static
    >>> def solve(mesh, material, body_force, boundary):
    ...     prescribed = {tuple(boundary.nodes): lambda x, t: t * boundary.values.T}
    ...     system = System(mesh, [StVK(material), BodyForce(lambda x, t: t * body_force(x))], prescribed=prescribed)
    ...     return solve_static(system, steps=2, quiet=True).u
    >>> verify_solver(solve, young=1e5, poisson=0.3, dimension=2, quiet=True).passed
    True
    """
    if not callable(solve):
        raise StvkError(f"solve is a {type(solve).__name__}; expected a function solve(mesh, material, body_force, boundary) -> u.")
    young = number("young", young, "Young's modulus in Pa, a positive number", low=0.0)
    poisson = number("poisson", poisson, "Poisson's ratio, between -1 and 1/2", low=-1.0, high=0.5)
    rtol = number("rtol", rtol, "a relative tolerance between 0 and 1e-2", low=0.0, high=1e-2)
    d, quiet = whole("dimension", dimension, "2 or 3", least=2, most=3), flag("quiet", quiet)
    trial = _Trial(solve, Isotropic(young=young, poisson=poisson), d, rtol)
    lines = [
        f"solver: {getattr(solve, '__name__', type(solve).__name__)}(mesh, material, body_force, boundary)",
        f"linear {'tetrahedra' if d == 3 else 'triangles, plane strain'}, E = {young:g}, nu = {poisson:g}, "
        f"equations solved to {rtol:g}",
    ]
    return judge("verify solver", {"lines": lines}, list(_tasks(trial)), quiet, partial(_explain, trial))


@dataclass(frozen=True)
class _Problem:
    mesh: Any
    boundary: PrescribedNodes
    force: BodyForceOf


class _Trial:
    """Solver under test, its problems, and its cached solutions. Each problem is solved once."""

    def __init__(self, solve: Solve, material: Isotropic, d: int, rtol: float) -> None:
        self.solve, self.material, self.d, self.rtol = solve, material, d, rtol
        self.lam, self.mu = (float(value) for value in material.lame(Hypothesis.SOLID))
        self.young = float(np.asarray(material.young))
        self.implementation = Implementation("solver", None, 0)
        self.exact = Manufactured(self.lam, self.mu)
        self.small = self.box(SMALL[d])
        self.strained = STRAINED[:d, :d]
        self._answers: dict[str, Array | ContractViolation] = {}

    def box(self, n: int) -> Any:
        """Return a scikit-fem mesh of the unit cube or square with displaced inner nodes and `n` cells along each side."""
        moved = moved_box(self.d, n)
        return {2: skfem.MeshTri, 3: skfem.MeshTet}[self.d](moved.p, np.asarray(moved.t, dtype=np.int64))

    def constant(self, part: Array) -> BodyForceOf:
        """Return the constant body force `E part / L`, with `part` (d,), Young's modulus E and the length L = 1 of the body."""
        b = self.young * part
        return lambda X: np.repeat(b[:, None], np.shape(X)[1], axis=1)

    def loaded(self) -> _Problem:
        """Return the problem of a constant load on the strained body."""
        return self.problem(self.small, lambda X: self.strained @ X, self.constant(LOAD[: self.d]))

    def manufactured(self, n: int) -> _Problem:
        """Return the problem with the manufactured solution, on `n` cells per side."""
        exact = self.exact
        return self.problem(
            self.box(n), lambda X: exact.displacement(X, 1.0), lambda X: exact.body_force(np.asarray(X, dtype=float), 1.0)
        )

    def problem(self, mesh: Any, moved: BodyForceOf, force: BodyForceOf | None = None, free: bool = False) -> _Problem:
        """Return the problem of a body whose surface is displaced by `moved(X)`. If `free`, the face x = 1 is free."""
        X = mesh.p
        constrained = ((X == 0) | (X == 1))[free:].any(axis=0) | (X[0] == 0)
        nodes = np.flatnonzero(constrained)
        boundary = PrescribedNodes(nodes, np.array(moved(X[:, nodes]).T))
        return _Problem(mesh, boundary, self.constant(np.zeros(self.d)) if force is None else force)

    def answer(self, name: str, problem: _Problem) -> Array:
        """Return the displacements that the solver found, (nv, d). The solver is called once for each name."""
        if name not in self._answers:
            try:
                self._answers[name] = self._solve(problem)
            except ContractViolation as violation:
                self._answers[name] = violation
        answer = self._answers[name]
        if isinstance(answer, ContractViolation):
            raise answer
        return answer

    def _solve(self, problem: _Problem) -> Array:
        p, t = problem.mesh.p.copy(), problem.mesh.t.copy()
        given = PrescribedNodes(problem.boundary.nodes.copy(), problem.boundary.values.copy())
        mesh = type(problem.mesh)(p, t)
        returned = guarded("solve", lambda: self.solve(mesh, self.material, problem.force, given))
        nv, kind = problem.mesh.p.shape[1], type(returned).__name__
        u = guarded("The result of solve", lambda: np.array(returned))
        if u.dtype.kind not in "fiu" or u.shape not in ((nv, self.d), (nv * self.d,)):
            raise ContractViolation(
                f"solve returned a {kind} of shape {u.shape} and {u.dtype}; expected the displacements of all nodes, real numbers "
                f"({nv}, {self.d}) or ({nv * self.d},) with {self.d} * node + component."
            )
        return u.reshape(nv, self.d).astype(float)


def _tasks(trial: _Trial) -> Iterator[Task]:
    d = trial.d
    task = partial(Task, implementation=trial.implementation, needs="")
    yield task("boundary values", quantity="u", state="constant load", measure=partial(_boundary, trial))
    for angle in ANGLES:
        gradient = rotation(d, angle, AXIS[d]) - np.eye(d)
        measure = partial(_affine, trial, f"rotated by {angle:g} degrees", gradient, True)
        yield task("rigid motion", quantity="u", state=f"{angle:g} degrees", measure=measure)
    for free, gradient in ((False, trial.strained), (True, _free_at_x(trial))):
        state = "one face free" if free else "homogeneous strain"
        yield task("patch test", quantity="u", state=state, measure=partial(_affine, trial, state, gradient, free))
    yield task("equilibrium", quantity="F", state="constant load", measure=partial(_equilibrium, trial))
    for name, Q in _symmetries(d).items():
        yield task("symmetry", quantity="u", state=name, measure=partial(_symmetric, trial, name, Q))
    yield task("reciprocity", quantity="work", state="small loads on the strained body", measure=partial(_reciprocal, trial))
    for norm in ORDERS:
        yield task("order", quantity=norm, state=f"{LADDER[d]} cells per side", measure=partial(_order, trial, norm))


def _boundary(trial: _Trial) -> dict[str, Any]:
    problem = trial.loaded()
    u = trial.answer("loaded", problem)
    off, size = np.abs(u[problem.boundary.nodes] - problem.boundary.values).max(), np.abs(problem.boundary.values).max()
    return _relative(off, size, trial.rtol, "largest prescribed displacement")


def _affine(trial: _Trial, name: str, gradient: Array, free: bool) -> dict[str, Any]:
    shift = np.array([0.3, -0.2, 0.1])[: trial.d, None]
    u = trial.answer(name, trial.problem(trial.small, lambda X: gradient @ X + shift, free=free))
    exact = (gradient @ trial.small.p + shift).T
    return _relative(np.abs(u - exact).max(), np.abs(exact).max(), trial.rtol, "largest displacement")


def _equilibrium(trial: _Trial) -> dict[str, Any]:
    evidence = _Evidence(trial)
    off = np.abs((evidence.force() - evidence.load)[evidence.free]).max()
    size = np.abs(evidence.force()).max()
    words = "largest force at a node; the limit is at least 10 rtol, because forces are more sensitive than displacements"
    return _relative(off, size, 10 * trial.rtol, words)


def _symmetric(trial: _Trial, name: str, Q: Array) -> dict[str, Any]:
    """Compare with the problem in axes transformed by the orthogonal `Q`: `x -> Q (x - c) + c`, `u -> Q u`, `b -> Q b`."""
    d, problem, c = trial.d, trial.loaded(), np.full((trial.d, 1), 0.5)
    u = trial.answer("loaded", problem)
    mesh = type(problem.mesh)(Q @ (problem.mesh.p - c) + c, problem.mesh.t)
    boundary = PrescribedNodes(problem.boundary.nodes, problem.boundary.values @ Q.T)
    rotated = trial.answer(name, _Problem(mesh, boundary, trial.constant(Q @ LOAD[:d])))
    return _relative(np.abs(rotated - u @ Q.T).max(), np.abs(u).max(), 2 * trial.rtol, "largest displacement")


def _reciprocal(trial: _Trial) -> dict[str, Any]:
    """Check the symmetry of `C_ij`, the integral of `u_i` due to a small load along `j`.

    The difference of loads of both signs cancels the terms of second order.
    """
    d, weights = trial.d, _at_nodes(trial.small, _shape(trial.small).volume)
    C = np.zeros((d, d))
    for j in range(d):
        for sign in (1, -1):
            load = trial.constant(sign * SMALL_LOAD * np.eye(d)[j])
            u = trial.answer(f"small {sign * (j + 1)}", trial.problem(trial.small, lambda X: trial.strained @ X, load))
            C[:, j] += sign * weights @ u
    limit = max(1e-5, 2 * trial.rtol * np.abs(trial.strained @ trial.small.p).max() / max(np.abs(C).max(), 1e-300))
    words = "largest compliance; the limit is 1e-5, or the solver's rtol over the size of the response"
    return _relative(np.abs(C - C.T).max(), np.abs(C).max(), min(limit, 0.01), words)


def _order(trial: _Trial, norm: str) -> dict[str, Any]:
    errors = []
    for n in LADDER[trial.d]:
        problem = trial.manufactured(n)
        errors.append(trial.exact.errors(problem.mesh, trial.answer(f"manufactured {n}", problem).ravel()))
    of_norm = [error[list(ORDERS).index(norm)] for error in errors]
    order = fitted_order(1 / np.array(LADDER[trial.d]), of_norm)
    values = " -> ".join(f"{error:.1e}" for error in of_norm)
    return {
        "measured": np.maximum(ORDERS[norm] - order, 0.0),
        "limit": SLACK,
        "scale": f"order {ORDERS[norm]:g}; fitted {order:.2f}, relative errors {values}",
        "reason": "the order of linear elements; meshes are too coarse for the last quarter",
    }


def _relative(off: float, size: float, limit: float, words: str) -> dict[str, Any]:
    return relative(off, size, limit, words, "the solver's tolerance, rtol")


def _free_at_x(trial: _Trial) -> Array:
    """Return the displacement gradient of a homogeneous state without traction on faces x = const, rotated by 20 degrees.

    The condition is `S e_x = 0`. E has no shear with x, `E_xx = -lam/(lam + 2 mu) (E_yy + E_zz)`, and its other entries are those
    of STRAINED.
    """
    d, E = trial.d, 0.5 * (trial.strained + trial.strained.T)
    E[0, :] = E[:, 0] = 0
    E[0, 0] = -trial.lam / (trial.lam + 2 * trial.mu) * np.trace(E)
    values, vectors = np.linalg.eigh(np.eye(d) + 2 * E)
    return np.asarray(rotation(d, 20.0, AXIS[d]) @ (vectors * np.sqrt(values)) @ vectors.T - np.eye(d))


def _symmetries(d: int) -> dict[str, Array]:
    mirror = np.diag([-1.0, *[1.0] * (d - 1)])
    if d == 2:
        return {"mirrored": mirror, "rotated by 90 degrees": np.array([[0.0, -1.0], [1.0, 0.0]])}
    return {"mirrored": mirror, "axes in turn": np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])}


def _shape(mesh: Any) -> Shape:
    """Return the shape of a scikit-fem mesh of linear simplices."""
    own = ElementMesh(mesh.p, np.asarray(mesh.t, dtype=np.int32))
    return Shape(own, Discretisation(own.element.name))


def _at_nodes(mesh: Any, volumes: Array) -> Array:
    """Return the volumes of elements, shared evenly among their nodes, (nv,)."""
    share = np.broadcast_to(volumes / len(mesh.t), mesh.t.shape)
    return np.bincount(mesh.t.ravel(), share.ravel(), minlength=mesh.p.shape[1])


class _Evidence:
    """Solution of a problem, by default under a constant load, with nodal forces by several laws and the nodal load."""

    def __init__(self, trial: _Trial, name: str = "loaded", problem: _Problem | None = None) -> None:
        problem = problem or trial.loaded()
        self.u = trial.answer(name, problem)
        self.boundary, self.free = problem.boundary, np.setdiff1d(np.arange(len(self.u)), problem.boundary.nodes)
        self.shape, self.lam, self.mu, self.material = _shape(problem.mesh), trial.lam, trial.mu, trial.material
        self.model = model_of(self.shape.mesh, [StVK(self.material)])
        self.b = trial.young * LOAD[: trial.d]
        self.load = _at_nodes(problem.mesh, self.shape.volume)[:, None] * self.b

    def force(self, lam: float = 1.0, mu: float = 1.0, **changes: Any) -> Array:
        """Return the nodal forces (nv, d) for `lam` times lambda and `mu` times mu, by default of St. Venant-Kirchhoff.

        `changes` are attributes of the `ElementModel` to replace.
        """
        tensor = lame_tensor(lam * self.lam, mu * self.mu, self.u.shape[1])[None]
        return replace(self.model, tensor=tensor, **changes).internal_force(self.u.ravel()).reshape(self.u.shape)

    def per_deformed_volume(self) -> Array:
        """Return the nodal load (nv, d) if the body force acts per deformed volume."""
        F = np.eye(self.u.shape[1]) + self.model.displacement_gradient(self.u.ravel())[:, 0]
        return _at_nodes(self.shape.mesh, self.shape.volume * np.linalg.det(F))[:, None] * self.b

    def fitted(self, columns: list[Array], right: Array) -> tuple[Array, float]:
        """Return least-squares factors of the columns at free nodes, and the residual relative to the right-hand side."""
        A, f = np.stack([column[self.free].ravel() for column in columns], axis=1), right[self.free].ravel()
        factors, *_ = np.linalg.lstsq(A, f, rcond=None)
        return factors, float(np.linalg.norm(A @ factors - f) / np.linalg.norm(f))


def _explain(trial: _Trial, report: Report) -> None:
    """Name the fault, by hypotheses on the solution under a constant load, or else by the checks that failed."""
    if report.passed:
        return
    bad = {result.check for result in report.failures()}
    naming, limit = Naming(), max(VANISHES, 100 * trial.rtol)
    with suppress(ContractViolation, np.linalg.LinAlgError):
        evidence = _Evidence(trial)
        if np.isfinite(evidence.u).all():
            off = (evidence.force() - evidence.load)[evidence.free]
            naming.before = float(np.linalg.norm(off) / np.linalg.norm(evidence.load[evidence.free]))
            naming.explain(_of_boundary(trial, evidence, limit))
            for some in _by_forces(evidence, limit):
                if naming.explain(some, limit):
                    break
        else:
            naming.smallest = "The solution is not a number: Newton's method diverged, and its result was returned."
    if not naming.explanations and not naming.smallest and "order" in bad:
        naming.explain(_other_equilibria(trial))
    if not naming.explanations and not naming.smallest:
        naming.smallest = " ".join(f"Likely, by {check}: {WORDS[check]}." for check in WORDS if check in bad)
    report.named = naming


#: The most frequent cause of each failure, for failures that no hypothesis explains. The most reliable checks come first.
WORDS = {
    "boundary values": "prescribed displacements are ignored or applied in part: their values, or load steps that do not reach 1",
    "rigid motion": "the strain is not objective: linear strain, or updates that add up small rotations",
    "patch test": "gradients of shape functions, orientation or numbering of elements; with a free face alone: a traction there",
    "equilibrium": "other equations were solved, or the solver stopped early: pass a larger rtol if this is intended",
    "symmetry": "axes are confused, or the answer depends on the orientation of the elements",
    "reciprocity": "the force is no derivative of an energy: terms that are lagged, explicit or not symmetric",
    "order": "the load where it varies: evaluated at displaced points, at wrong ones, or per deformed volume",
}


def _by_forces(e: _Evidence, limit: float) -> Iterator[list[Explanation]]:
    """Yield hypotheses on the forces at free nodes, the simplest first.

    If the forces are correct to `limit`, only the first hypothesis is yielded.
    """
    inner, load = e.force(), np.linalg.norm(e.load[e.free])
    yield [Explanation("no load", "the solution is that without the body force", float(np.linalg.norm(inner[e.free]) / load))]
    (c,), rest = e.fitted([e.load], inner)
    if rest <= limit and abs(c - 1) <= limit:
        return
    words = f"the load is {c:.3f} x the requested one, or lambda and mu are both {1 / c:.3f} x"
    yield [Explanation(f"load x {c:.3f}", words, rest)]
    (lam, mu), rest = e.fitted([e.force(mu=0.0), e.force(lam=0.0)], e.load)
    words = f"your lambda is {lam:.3f} x and your mu {mu:.3f} x the requested ones"
    words += engineering_constants(lam * e.lam, mu * e.mu, e.material)
    yield [Explanation(f"lambda x {lam:.3f}, mu x {mu:.3f}", words, rest)]
    others = []
    for name, words, force, right in (
        ("linear strain", "the solution is that of linear elasticity", e.force(strain=small_strain, stress=second_piola), e.load),
        ("S for P", "the force lacks the deformation gradient: S is used instead of P = F S", e.force(stress=second_piola), e.load),
        ("load per deformed volume", "it is integrated over the deformed body, or follows it", inner, e.per_deformed_volume()),
    ):
        (c,), rest = e.fitted([right], force)
        others.append(Explanation(name, words + (f"; and the load is {c:.3f} x" if abs(c - 1) > limit else ""), rest))
    yield others


def _other_equilibria(trial: _Trial) -> Iterator[Explanation]:
    """Yield an explanation if a solution of the manufactured problem balances the load but is far from the exact solution."""
    for n in LADDER[trial.d]:
        problem = trial.manufactured(n)
        e = _Evidence(trial, f"manufactured {n}", problem)
        far = trial.exact.errors(problem.mesh, e.u.ravel())[1]
        fine, coarse = (_load(problem, order) for order in (LOAD_ORDER, 1))
        size, inner = np.linalg.norm(fine[e.free]), e.force()
        rest, rounded = (float(np.linalg.norm((fine - other)[e.free]) / size) for other in (inner, coarse))
        if far > FAR and rest <= max(rounded, VANISHES, 100 * trial.rtol):
            words = (
                f"on {n} cells per side the solution is in balance with the load, but its gradient differs from the exact one by "
                f"{far:.0%}: start from rest and raise load and prescribed displacements in steps"
            )
            yield Explanation("another equilibrium", words, rest)
            return


def _load(problem: _Problem, order: int) -> Array:
    """Return the integral of the body force times the shape functions, (nv, d), by a rule of this order."""
    d, kind = len(problem.mesh.p), {2: skfem.ElementTriP1, 3: skfem.ElementTetP1}
    basis = skfem.Basis(problem.mesh, skfem.ElementVector(kind[d]()), intorder=order)
    X = np.asarray(basis.global_coordinates())
    b = np.asarray(problem.force(X.reshape(d, -1))).reshape(X.shape)
    return np.asarray(skfem.LinearForm(lambda v, w: (w.b * v).sum(axis=0)).assemble(basis, b=b)).reshape(-1, d)


def _of_boundary(trial: _Trial, e: _Evidence, limit: float) -> Iterator[Explanation]:
    """Yield an explanation of wrong boundary displacements: ignored, scaled, or components stored in blocks."""
    at, values = e.u[e.boundary.nodes], e.boundary.values
    size = np.abs(values).max()
    off = float(np.abs(at - values).max() / size)
    if off <= limit:
        return
    blocked = float(np.abs(e.u.reshape(trial.d, -1).T[e.boundary.nodes] - values).max() / size)
    c = float((at * values).sum() / (values**2).sum())
    scaled = float(np.abs(at - c * values).max() / size)
    if blocked <= limit:
        words = f"degrees of freedom are stored in blocks; expected {trial.d} * node + component"
        yield Explanation("components in blocks", words, blocked)
    elif scaled <= limit and abs(c) <= limit:
        yield Explanation("boundary ignored", "prescribed displacements are taken as zero", scaled)
    elif scaled <= limit:
        yield Explanation(f"boundary x {c:.3f}", f"prescribed displacements are {c:.3f} x the requested ones", scaled)
    else:
        yield Explanation("boundary not kept", "prescribed nodes move", off)
