"""Largest stable step of explicit integrators, from the largest eigenvalue of (K, M) and from a bound on it; and of elements."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...arguments import Array, whole
from ...edges import ALL
from ...errors import StvkError, name_ids
from ...mesh import ElementMesh
from ...mesh.displacements import by_vertex
from ...space import Space
from ...system import System, TangentOperator
from ...system.bound import BoundTerms
from ...system.coordinates import checked_system, checked_whole
from ...system.mass import Mass
from ...system.pattern import Pattern
from ...terms.loads.load import APART, Assumed, Moment
from .damping import Damping, damping_factors

#: Largest number of estimates with damping, and the relative change of the step at which they end.
MOST, PRECISION = 6, 1e-4
#: Relative residual of the eigenvalue, and largest number of products with K.
RESIDUAL, MOST_PRODUCTS = 1e-3, 300
#: Relative length below which a direction, made orthogonal to the others, is only round-off.
SHORT = 1e-8
#: Number of products with norms of blocks. Each of them improves the bound.
SWEEPS = 5
#: Number of elements whose eigenvalues are computed together; their matrices take a few megabytes.
AT_ONCE = 4096


@dataclass(frozen=True)
class CriticalStep:
    """Largest stable step of central differences (velocity Verlet, symplectic Euler) at a state.

    Attributes
    ----------
    step
        Step from the largest eigenvalue of `M^-1 K` [s].
    bound
        Smaller, safe step [s], from the norms of the blocks of K alone.
    omega, omega_bound
        Largest circular frequency without damping, and an upper bound on it [1/s]. Without damping the steps are `2/omega` and
        `2/omega_bound`.
    products
        Number of products of K with a vector that `step` took.
    """

    step: float
    bound: float
    omega: float
    omega_bound: float
    products: int

    def __str__(self) -> str:
        return f"critical step {self.step:.4g} s, safe bound {self.bound:.4g} s"


class LargestFrequency:
    """Critical steps of a system as it deforms. Only scratch arrays are retained from one state to the next.

    With lagged velocities in the damping forces, `M a_n + D v_{n-1/2} + F(u_n) = h`, a step `T` is stable as long as

        T^2 x'Kx + 2 T x'Dx <= 4 x'Mx        for all motions x that the supports allow,        D = alpha M + beta K0 + tau K_GN(u)

    For a damping ratio `xi` this is `T <= (2/omega) (sqrt(1 + xi^2) - xi)`, so damping makes the step smaller. The stiffness of
    loads that have a potential and are not dead counts by a bound on its own largest eigenvalue. `ForwardEuler` is this scheme.
    `VelocityVerlet` evaluates damping at a predicted velocity, so its step is that of twice the damping.

    The search for an eigenvalue always begins with the same random motion. The mode of the previous state would save a fifth of the
    products. It could miss an eigenvalue that has become the largest one elsewhere.

    Parameters
    ----------
    damping
        Damping, as `Rayleigh`, `EdgeDamping`, or several.

    Attributes
    ----------
    vertex
        (nv,) lumped masses [kg], 0 for constrained vertices.
    """

    def __init__(self, system: System, damping: Damping | None = None) -> None:
        checked_system(system)
        self._system, self._mass, self._damping = system, system.mass(), damping_factors(damping)
        self._operator: TangentOperator | None = None
        self._products, self._is_free = 0, self._mass.free.ravel()
        self.vertex = np.where(self._mass.free.any(axis=1), self._mass.vertex, 0.0)
        self._at_rest: TangentOperator | None = None

    def at(self, u: ArrayLike, t: float = 0.0) -> CriticalStep:
        """Return the critical step at displacements `u` (ndofs,) [m] and time `t` [s].

        Raises
        ------
        StateError
            if `u` does not have one finite entry for each degree of freedom, or K overflows.
        """
        self._products = 0
        square_bound, bound = self._solve(u, t, self._bound)
        square, step = self._solve(u, t, self._largest)
        omega_bound = float(np.sqrt(square_bound))
        return CriticalStep(max(step, bound), bound, min(float(np.sqrt(square)), omega_bound), omega_bound, self._products)

    def bound(self, u: ArrayLike, t: float = 0.0) -> float:
        """Return the safe bound alone [s]. It costs a few products. Raises the errors of `at`."""
        return self._solve(u, t, self._bound)[1]

    def _solve(self, u: ArrayLike, t: float, elastic: Callable[[TangentOperator], float]) -> tuple[float, float]:
        """Return the largest `omega^2` without damping, and the step.

        The step `T` solves `T^2 lam + 2 T alpha = 4`, where `lam` is the largest eigenvalue of `K + 2/T (beta K0 + tau K_GN)`.
        `lam` is a convex function of 1/T, so chords from 1/T = 0 on find the solution. The last step is shortened to account for
        the remaining error.
        """
        alpha, beta, tau = self._damping
        loads = self._of_loads(u, t)

        def estimate(K: TangentOperator) -> float:
            return elastic(K) + loads

        square = estimate(self._prepared(u, t, np.inf))
        step = _root(square, alpha + (beta + tau) * square)
        if beta + tau == 0 or square == 0:
            return square, step
        for _ in range(MOST):
            largest = estimate(self._prepared(u, t, step))
            before, excess = step, (step**2 * largest + 2 * step * alpha) / 4
            step = _root(square, alpha + max(largest - square, 0.0) * step / 2)
            if abs(step - before) <= PRECISION * step:
                break
        return square, min(step, before / max(excess, 1.0))

    def _prepared(self, u: ArrayLike, t: float, step: float) -> TangentOperator:
        """Return `K + 2/T (beta K0 + tau K_GN)` at `u` as an operator. `K_GN` has the terms with a damping force only."""
        tau_share, beta_share = 2 * self._damping.tau / step, 2 * self._damping.beta / step
        retained, touching = ALL._replace(damped=1 + tau_share), Moment(t, 1.0, contact=Assumed.TOUCHING)
        if self._operator is None:
            self._operator = self._system.linear_operator(u, kept=retained, t=touching)
        else:
            self._operator.prepare(u, kept=retained, t=touching)
        if beta_share and self._at_rest is None:
            self._at_rest = self._system.linear_operator(np.zeros(self._system.ndofs), t=APART)
        if beta_share and self._at_rest is not None:
            self._operator.scale_and_add(1.0, [(beta_share, self._at_rest)])
        return self._operator

    def _of_loads(self, u: ArrayLike, t: float) -> float:
        """Return a bound on the increase of the largest eigenvalue by the stiffness of loads [1/s^2], from Gershgorin's circles."""
        K, space = self._system.load_stiffness(u, Moment(t, 1.0)), self._system.space
        if K is None:
            return 0.0
        mass, rows = np.repeat(self._mass.vertex, self._system.mesh.d)[self._is_free], np.zeros(space.n)
        rows[self._is_free] = abs(K[self._is_free][:, self._is_free]) @ (1 / np.sqrt(mass))
        return space.comm.most(float((space.share(rows)[self._is_free] / np.sqrt(mass)).max(initial=0.0)))

    def _bound(self, K: TangentOperator) -> float:
        return bound_on_eigenvalues(K, self.vertex)

    def _largest(self, K: TangentOperator) -> float:
        """Return an upper estimate of the largest eigenvalue: the Rayleigh quotient plus the residual, at most the bound."""
        bound = self._bound(K)
        if bound == 0:
            return 0.0
        mass = np.repeat(self._mass.vertex, self._system.mesh.d)
        x = self._system.space.random() / np.sqrt(np.where(self._is_free, mass, np.inf))
        found = largest_eigenvalue(K.matvec, self._mass, x, self._system.space)
        self._products += found.products
        return min(max(found.value + found.residual, 0.0), bound)


def critical_step(system: System, u: ArrayLike | None = None, *, damping: Damping | None = None) -> CriticalStep:
    """Return the largest stable step of explicit integrators with the lumped mass.

    Parameters
    ----------
    system
        Body with densities, and its supports.
    u
        (ndofs,) displacements [m], by default zero.
    damping
        `Rayleigh`, `EdgeDamping` or a list of them. The step is then that of `ForwardEuler`. For `VelocityVerlet` damping counts
        twice, so pass twice the damping.

    Returns
    -------
    CriticalStep
        The `step` [s] from the largest eigenvalue of `M^-1 K`, and the safe `bound` [s] from the norms of the blocks of K.

    Raises
    ------
    MaterialError
        if a material has no density, or a vertex that can move has no mass.
    StateError
        if `u` does not have one finite entry for each degree of freedom, or K overflows.
    StvkError
        if `damping` is no damping.

    Examples
    --------
    >>> import numpy as np
    >>> from skfem_stvk import ElementMesh, StVK, System
    >>> line = ElementMesh(np.linspace(0, 1, 11)[None], np.stack([np.arange(10), np.arange(1, 11)]))
    >>> bar = System(line, StVK(young=4.0, poisson=0.3, density=1.0))
    >>> critical = critical_step(bar)             # the time that a wave of speed 2 m/s takes through an element of 0.1 m
    >>> round(critical.step, 4), round(critical.bound, 3)
    (0.05, 0.05)
    """
    return LargestFrequency(system, damping).at(np.zeros(system.ndofs) if u is None else u)


def _root(k: float, c: float) -> float:
    """Return the `T > 0` that solves `T^2 k + 2 T c = 4`; infinity if there is none."""
    rate = c + np.sqrt(c**2 + 4 * k)
    return float(4 / rate) if rate > 0 else np.inf


class Largest(NamedTuple):
    """Eigenpair of `K x = value M x`."""

    value: float  # Rayleigh quotient of x [1/s^2]: not above the largest eigenvalue
    residual: float  # residual norm for `M^-1/2 K M^-1/2` [1/s^2]: an eigenvalue lies within it of `value`
    vector: Array  # x (ndofs,), of length one in M
    products: int  # number of products with K


def largest_eigenvalue(product: Callable[[Array], Array], mass: Mass, x: Array, space: Space) -> Largest:
    """Return the largest eigenvalue of (K, M), by locally optimal conjugate gradients (LOBPCG, Knyazev 2001).

    The iteration starts from `x` (ndofs,). Lanczos' method needs as many products and stores all vectors so far; LOBPCG stores the
    last three. scipy's `lobpcg` finds the same eigenvalue on slender, mixed and compact bodies, membranes and single tetrahedra. It
    takes one or two products more (14 for 13, 26 for 24), and 1.4 to 2.1 times the time.
    """
    dot = space.dot

    def unit(v: Array) -> Array:
        size = np.sqrt(dot(v, mass.multiply(v)))
        return v / size if size > 0 else v

    x = unit(x)
    Kx, products, size = product(x), 1, 0.0
    p = Kp = np.zeros_like(x)
    while True:
        value = dot(x, Kx)
        size = max(size, abs(value))
        w = mass.solve(Kx) - value * x
        residual = float(np.sqrt(max(dot(w, mass.multiply(w)), 0.0)))
        if residual <= RESIDUAL * size or products >= MOST_PRODUCTS:
            return Largest(value, residual, x, products)
        w = unit(w - dot(w, mass.multiply(x)) * x)
        Kw, products = product(w), products + 1
        basis, images = [x, w], [Kx, Kw]
        for other, image in zip(basis, images, strict=True):
            along = dot(other, mass.multiply(p))
            p, Kp = p - along * other, Kp - along * image
        length = np.sqrt(dot(p, mass.multiply(p)))
        if length > SHORT:
            basis.append(p / length)
            images.append(Kp / length)
        small = np.array([[dot(a, image) for image in images] for a in basis])
        first, *others = np.linalg.eigh((small + small.T) / 2)[1][:, -1]
        p, Kp = _combined(others, basis[1:]), _combined(others, images[1:])
        x, Kx = first * x + p, first * Kx + Kp


def bound_on_eigenvalues(K: TangentOperator, vertex: Array) -> float:
    """Return an upper bound on the eigenvalues of (K, M) [1/s^2], with M lumped to the masses `vertex` (nv,).

        value <= max_a (k_a s_a + sum_b |K_ab| s_b) / (m_a s_a)        for any s > 0

    `k_a` is the largest eigenvalue of the diagonal block, and `|K_ab|` are the norms of the others. These are Gershgorin's circles
    of blocks, scaled. The iteration starts from `s = m^-1/2`. The next `s_a` is the numerator divided by `m_a`, so that the bound
    decreases (Collatz, Wielandt). Constrained vertices have the mass zero. Where parts of a divided body share an edge, the sum of
    the norms of their contributions to `K_ab` replaces `|K_ab|`, which is not larger.
    """
    own = _largest_of_blocks(K.diagonal_blocks().astype(np.float64))
    inverse = np.divide(1.0, vertex, out=np.zeros(len(vertex)), where=vertex > 0)
    s, bound = np.sqrt(inverse), np.inf
    for _ in range(SWEEPS):
        sums = K.space.counted(own * s)
        K.add_norms(s, sums)
        K.space.share(sums)
        sums *= inverse
        rows = np.divide(sums, s, out=np.zeros(len(s)), where=s > 0)
        bound, s = min(bound, K.space.comm.most(float(rows.max()))), sums
    return bound


def _largest_of_blocks(blocks: Array) -> Array:
    """Return upper bounds (nv,) on the eigenvalues of symmetric blocks (nv, d, d), by traces (Wolkowicz, Styan 1980).

    They are exact for d < 3.
    """
    d = blocks.shape[1]
    mean = np.einsum("vcc->v", blocks) / d
    spread = np.einsum("vij,vij->v", blocks, blocks) - d * mean**2
    return np.maximum(mean + np.sqrt(np.maximum(spread, 0) * (d - 1) / d), 0)


def _combined(factors: Sequence[float], vectors: Sequence[Array]) -> Array:
    return np.einsum("i,ij->j", factors, np.stack(vectors))


@dataclass(frozen=True, eq=False, repr=False)
class CriticalElements:
    """Elements that limit the critical step of a body, and the largest step that each element allows.

    Attributes
    ----------
    elements
        (n,) ids of the elements, the smallest step first.
    steps
        (n,) steps of these elements [s].
    every
        (nt,) step of each element [s]; infinite for elements without stiffness or with all nodes constrained.
    left_out
        Terms that do not act on elements of the mesh, such as "ElasticFoundation 1" or cables attached to it. They reduce the step
        of the body further.
    """

    elements: NDArray[np.int64]
    steps: Array
    every: Array
    left_out: tuple[str, ...]

    def __repr__(self) -> str:
        usual = float(np.median(self.every))
        shown = ", ".join(f"{step:.3g} s" for step in self.steps[:3])
        return f"CriticalElements: {name_ids(self.elements, 'element')} allow steps of {shown}; in the median {usual:.3g} s"


def critical_elements(system: System, n: int = 5, *, u: ArrayLike | None = None) -> CriticalElements:
    """Return the n elements that allow the smallest steps of explicit integrators.

    ::

        T_e = 2/omega_e,    omega_e^2 the largest eigenvalue of (K_e, M)        T of the body <= min_e T_e

    `K_e` is an element's own part of K, and M has the lumped masses of the body at its nodes. Both are over its free degrees of
    freedom. `omega_e^2` is the Rayleigh quotient of a motion of these nodes alone. At rest the other elements add stiffness to it,
    hence the inequality. Where one element is much worse than its neighbours, such as a sliver or a stiff one, its `T_e` is the
    step of the body. Remesh there, or use a material that is softer or heavier.

    Parameters
    ----------
    system
        Body with densities, and its supports.
    n
        Number of elements.
    u
        (ndofs,) displacements [m], by default zero.

    Returns
    -------
    CriticalElements
        Ids of the elements with the smallest first, `elements` (n,), their `steps` (n,) [s], and the step of `every` element (nt,).

    Raises
    ------
    MaterialError
        if a material has no density, or a vertex that can move has no mass.
    StateError
        if `u` does not have one finite entry for each degree of freedom.
    StvkError
        if no term acts on elements, for example if there are only springs.

    Examples
    --------
    >>> import numpy as np
    >>> from skfem_stvk import ElementMesh, StVK, System
    >>> line = ElementMesh(np.array([[0.0, 1.0, 1.1, 2.0]]), np.array([[0, 1, 2], [1, 2, 3]]))
    >>> bar = System(line, StVK(young=4.0, poisson=0.3, density=1.0))     # waves of 2 m/s
    >>> found = critical_elements(bar, 2)
    >>> found.elements, found.steps.round(3)
    (array([1, 2]), array([0.162, 0.462]))
    """
    checked_whole(system, "critical_elements(system)")
    n = whole("n", n, "a number of elements, from 1", 1)
    x = np.zeros(system.mesh.p.T.shape) if u is None else by_vertex(system.mesh, u).astype(np.float64)
    system.mass()  # refuses bodies without mass
    on_mesh = [any(term is one for one in system.body.terms) for term in system.elastic_terms]
    chosen = [good and (term.is_law or term.has_pressure) for term, good in zip(system.elastic_terms, on_mesh, strict=True)]
    names = zip(system.elastic_names, chosen, strict=True)
    if not any(chosen):
        raise StvkError(
            f"{', '.join(system.elastic_names)}: expected at least one term on elements, because the steps are those of elements."
        )
    terms = [term for term, good in zip(system.elastic_terms, chosen, strict=True) if good]
    every = _steps(system, terms, x)
    order = np.argsort(every, kind="stable")[: min(n, int(np.isfinite(every).sum()))]
    return CriticalElements(order, every[order], every, tuple(name for name, good in names if not good))


def _steps(system: System, terms: list[Any], x: Array) -> Array:
    """Return the steps (nt,) [s] that the elements allow.

    The parts of K by element are assembled on a mesh in which each element has its own nodes.
    """
    apart, t = _apart(system.mesh), system.mesh.t
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # about elements on which these terms do not act
        bound = BoundTerms(apart, terms, np.float64, getattr(system, "rule", None))
    pattern = Pattern(apart.nv, apart.d, [term.nodes_paired for term in bound.bound_terms])
    values, u = np.zeros(pattern.nnz), np.empty((apart.nv, apart.d))
    u[apart.t] = x[t]
    for term in bound.pair_terms:
        term.fill(u, term.rows(pattern), values, True, None, ALL)
    d, order = apart.d, np.argsort(apart.t, axis=0, kind="stable")  # columns of a row of K are in the order of the nodes
    nodes, own = np.take_along_axis(apart.t, order, axis=0), np.take_along_axis(t, order, axis=0)  # apart, in the body
    mass, is_free = system.mass().vertex, system.mass().free
    inverse = is_free * np.divide(1.0, np.sqrt(mass), out=np.zeros(len(mass)), where=mass > 0)[:, None]
    scale = inverse[own].transpose(1, 0, 2).reshape(t.shape[1], -1)  # (nt, n d)
    dofs = (d * nodes.T[:, :, None] + np.arange(d)).reshape(t.shape[1], -1)
    full = pattern.indptr[dofs[:, 0] + 1] - pattern.indptr[dofs[:, 0]] == dofs.shape[1]
    full[system.removed] = False
    steps = np.full(t.shape[1], np.inf)
    for ids in np.array_split(np.flatnonzero(full), max(1, full.sum() // AT_ONCE)):
        K = values[pattern.indptr[dofs[ids]][:, :, None] + np.arange(dofs.shape[1])]
        square = np.linalg.eigvalsh(K * scale[ids][:, :, None] * scale[ids][:, None, :])[:, -1]
        with np.errstate(divide="ignore"):
            steps[ids] = 2 / np.sqrt(np.maximum(square, 0.0))
    return steps


def _apart(mesh: ElementMesh) -> ElementMesh:
    """Return the mesh with separate nodes for each element, with the elements in the same order."""
    m, nt = mesh.element.corners, mesh.nt
    t = np.arange(m * nt).reshape(nt, m).T
    apart = ElementMesh(mesh.p[:, mesh.corners.T.ravel()], t, mesh.subdomains, element=mesh.element.linear)
    if mesh.element.degree == 1:
        return apart
    straight = apart.with_degree(2)
    p = straight.p.copy()
    p[:, straight.t] = mesh.p[:, mesh.t]
    return ElementMesh(p, straight.t, mesh.subdomains, element=mesh.element)
