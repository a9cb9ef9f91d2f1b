"""Natural modes of vibration: the lowest eigenpairs of (K, M)."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import eig, eigh

from ... import arguments
from ...arguments import Array
from ...linear import Kind, LinearSolver, choose
from ...linear.choose import direct, is_auto
from ...mesh.displacements import by_vertex
from ...results import Fields, plot
from ...results.fields import State
from ...results.series import save_series
from ...system import System
from ...system.coordinates import checked_whole
from ...system.free_tangent import SYMMETRIC, with_loads
from ...system.mass import Mass
from ...system.rigid import motions, parts_of_body
from .critical_step import bound_on_eigenvalues
from .shift_invert import ShiftedProblem, lowest_vectors, nearest_vectors

#: Largest non-rigid part of a rigid motion. Its eigenvalue must also be round-off: at most `ROUNDING` eps of the largest one.
NOT_RIGID, ROUNDING = 1e-6, 1e4
#: Singular values below this part of the largest are treated as zero.
ZERO = 1e-10
#: Largest displacement in pictures, as a part of the size of the body.
SHOWN = 0.1
#: Largest number of unknowns for which "auto" uses a direct solver. It factorises once and solves about a hundred times.
MANY = 200_000


@dataclass(frozen=True, eq=False, repr=False)
class Modes:
    """Natural modes: `K x = omega^2 M x` over the free degrees of freedom, ascending by (the real part of) omega^2.

    If a load follows the body, K need not be symmetric. Then two modes can merge into a complex pair, with which the body flutters.
    It takes energy from the load, and the oscillation grows. Eigenvalues and shapes are complex arrays if there is such a pair
    among them.

    Attributes
    ----------
    frequencies
        (n,) frequencies `Re(omega)/(2 pi)` [Hz]; 0 for rigid modes, NaN for modes that grow without oscillation.
    eigenvalues
        (n,) eigenvalues `omega^2` [1/s^2].
    shapes
        (n, ndofs) shapes `x` [kg^-1/2], 0 at constrained degrees of freedom, with `x_i' M x_j = delta_ij`. If K is not symmetric,
        only `x_i^H M x_i = 1` holds, and the motion is the real part of `x exp(i omega t)`.
    rigid
        (n,) whether the mode is a rigid motion of the body or of parts of it, without stiffness.
    unstable
        (n,) whether the mode grows: `omega^2` is negative (divergence, without oscillation), or complex (flutter).
    flutter
        (n,) whether `omega^2` is complex.
    growth
        (n,) rate at which the mode grows without damping, `|Im(omega)|` [1/s]; 0 for stable modes.
    residuals
        (n,) norms of `M^-1/2 (K x - omega^2 M x)` [1/s^2]. If K is symmetric, an eigenvalue lies within this distance.
    system, u
        The system, and its displacements (ndofs,) [m] about which it vibrates.
    """

    frequencies: Array
    eigenvalues: Array
    shapes: Array
    rigid: NDArray[np.bool_]
    unstable: NDArray[np.bool_]
    flutter: NDArray[np.bool_]
    growth: Array
    residuals: Array
    system: System = field(compare=False)
    u: Array

    def __len__(self) -> int:
        return len(self.eigenvalues)

    @property
    def stable(self) -> bool:
        """Whether none of these modes grows. Higher modes are not examined."""
        return not self.unstable.any()

    def state(self, number: int, scale: float | None = None) -> State:
        """Return the body displaced by `u` and `scale` times (the real part of) mode `number`, counted from 0.

        By default the largest displacement is a tenth of the body's size.
        """
        number = arguments.whole("number", number, f"a mode from 0 to {len(self) - 1}", -len(self), len(self) - 1)
        mesh, shape = self.system.mesh, self.shapes[number].real.reshape(-1, self.system.mesh.d)
        if scale is None:
            scale = SHOWN * float(np.linalg.norm(np.ptp(mesh.p, axis=1)) / np.linalg.norm(shape, axis=1).max())
        factor = arguments.number("scale", scale, "a finite factor, or None for a tenth of the body's size")
        return Fields.of(self.system).at(self.u + factor * shape.ravel())

    def plot(self, number: int, scale: float | None = None, **options: Any) -> Any:
        """Draw a mode, coloured by the length of displacements by default.

        Options are those of `results.plot`, and `scale` is that of `state`.
        """
        state = self.state(number, scale)  # refuses an invalid mode number
        return plot(state, **{"field": "displacement", "label": f"mode {number}: {self._named(number)}"} | options)

    def save(self, path: str | os.PathLike[str], scale: float | None = None) -> Path:
        """Write all modes as a series for ParaView, with the number of the mode as time.

        Raises the errors of `results.write_vtu`.
        """
        return save_series(path, ["von_mises_stress"], ((number, self.state(number, scale)) for number in range(len(self))))

    def _named(self, number: int) -> str:
        units = self.system.units
        if self.rigid[number]:
            return "rigid"
        if self.flutter[number]:
            growth = f"exp({self.growth[number]:.4g} t/{units.of('s')})"
            return f"unstable, flutters at {self.frequencies[number]:.6g} {units.of('Hz')} and grows by {growth}"
        if self.unstable[number]:
            return f"unstable, omega^2 = {self.eigenvalues[number]:.4g} {units.of('1/s^2')}"
        return f"{self.frequencies[number]:.6g} {units.of('Hz')}"

    def __repr__(self) -> str:
        rows = [f"{number:4d}  {self._named(number)}" for number in range(len(self))]
        return "\n".join([f"Modes: {len(self)}, {self.rigid.sum()} of them rigid, {self.unstable.sum()} unstable", *rows])


def modes(
    system: System,
    n: int = 10,
    *,
    u: ArrayLike | None = None,
    t: float = 1.0,
    mass: str = "lumped",
    solver: str | LinearSolver = "auto",
) -> Modes:
    """Return the n lowest natural modes of a system with its supports, at rest or at a state of equilibrium.

    Parameters
    ----------
    system
        Body with densities, and its supports; free bodies are allowed.
    n
        Number of modes, including rigid ones.
    u
        Displacements (ndofs,) [m] of the equilibrium about which the system vibrates, such as `solve_static(system).u`; by default
        zero. K is that of the stressed body, and includes the stiffness of loads that depend on the displacements. If these loads
        make K unsymmetric, the modes nearest to zero are found, which can show flutter.
    t
        Load factor of this equilibrium, for these loads: `step.t` of a state on a path.
    mass
        Kind of the mass, "lumped" or "consistent".
    solver
        Linear solver, as in `solve_static`; by default a direct solver, and multigrid for more than 200 000 unknowns.

    Returns
    -------
    Modes
        The `frequencies` (n,) [Hz], `shapes` (n, ndofs), and which modes are `rigid` or `unstable`, in ascending order of
        `omega^2`.

    Raises
    ------
    StvkError
        if there are not n modes, or the solver is unknown or fails.
    MaterialError
        if a material has no density, or a vertex that can move has no mass.
    StateError
        if `u` does not have one finite entry for each degree of freedom.

    Examples
    --------
    >>> import skfem
    >>> from skfem_stvk import StVK, System
    >>> mesh = skfem.MeshTri.init_tensor(np.linspace(0, 1, 9), np.linspace(0, 1, 9))
    >>> free = modes(System(mesh, StVK(young=1e6, poisson=0.3, density=1e3)), 5)
    >>> free.rigid, free.frequencies.round(1)
    (array([ True,  True,  True, False, False]), array([ 0. ,  0. ,  0. , 12.3, 13.5]))
    """
    checked_whole(system, "modes(system)")
    free = np.setdiff1d(np.arange(system.ndofs), system.supports.held)
    n = arguments.whole("n", n, f"a number of modes, from 1 to {len(free)}, the number of free degrees of freedom", 1, len(free))
    x = np.zeros(system.ndofs) if u is None else by_vertex(system.mesh, u).ravel().astype(np.float64)
    moment = arguments.number("t", t, "the load factor of the equilibrium")
    kind = _kind(system, x, moment, free)
    chosen = direct(len(free)) if is_auto(solver) and len(free) <= MANY else choose(solver, len(free), kind)
    problem = ShiftedProblem(system, with_loads(chosen, system), system.mass(mass), kind, x, moment)
    vectors = (nearest_vectors if kind is Kind.GENERAL else lowest_vectors)(problem, n)
    return _ritz(problem, np.array([problem.free.vector(vector) for vector in vectors.T]), int(n))


def _kind(system: System, u: Array, t: float, free: Array) -> Kind:
    """Return the kind of K. With follower loads, decide by its entries over the free degrees of freedom."""
    if system.conservative:
        return Kind.SYMMETRIC
    K = system.jacobian(u, t)[free][:, free]
    return Kind.SYMMETRIC if abs(K - K.T).max() <= SYMMETRIC * abs(K).max() else Kind.GENERAL


def _ritz(problem: ShiftedProblem, vectors: Array, n: int) -> Modes:
    """Return the n lowest modes in the span of the rows of `vectors` (m, ndofs), by exact products with K and M."""
    system, mass, u, K = problem.system, problem.mass, problem.u, problem.stiffness()
    images, momenta = (np.array([multiply(row) for row in vectors]) for multiply in (lambda v: K @ v, mass.multiply))
    largest = bound_on_eigenvalues(system.linear_operator(u), mass.vertex)
    rounding = ROUNDING * float(np.finfo(system.dtype).eps) * largest
    if problem.kind is Kind.GENERAL:
        values, c = _unsymmetric(vectors @ images.T, vectors @ momenta.T, rounding)
    else:
        values, c = eigh(_product(vectors, images), _product(vectors, momenta))
    values, c = values[:n], c[:, :n].T
    shapes, forces = c @ vectors, c @ images
    residuals = _residuals(mass, values, shapes, forces)
    rigid = (np.abs(values) <= rounding) & (_rigid_part(system, mass, u, shapes.real) >= 1 - NOT_RIGID)
    flutter = np.abs(values.imag) > 0
    unstable = flutter | (~rigid & (values.real < -rounding))
    omega = np.sqrt(values.astype(complex))
    frequencies = np.where(rigid, 0.0, np.where(unstable & ~flutter, np.nan, omega.real / (2 * np.pi)))
    growth = np.where(unstable, np.abs(omega.imag), 0.0)
    return Modes(frequencies, values, shapes, rigid, unstable, flutter, growth, residuals, system, u)


def _unsymmetric(K: Array, M: Array, rounding: float) -> tuple[Array, Array]:
    """Return the eigenvalues, ascending by their real parts, and vectors (columns) of small matrices.

    They are real unless there are complex pairs. Round-off can make two equal eigenvalues a pair with a tiny imaginary part. For
    such a pair, the real and the imaginary part of the vectors are returned.
    """
    values, c = eig(np.linalg.solve(M, K))  # one real matrix, so that pairs are bitwise conjugate
    order = np.lexsort((values.imag, values.real))
    values, c = values[order], c[:, order].astype(complex)
    real = np.abs(values.imag) <= rounding
    c[:, real] = np.where(values[real].imag > 0, c[:, real].imag, c[:, real].real)
    values[real] = values[real].real
    c *= np.exp(-1j * np.angle(c[np.argmax(np.abs(c), axis=0), np.arange(c.shape[1])]))
    c /= np.sqrt(np.einsum("in,ij,jn->n", c.conj(), M, c).real)
    return (values.real, c.real) if real.all() else (values, c)


def _residuals(mass: Mass, values: Array, shapes: Array, forces: Array) -> Array:
    """Return the norms (n,) of `M^-1/2 (K x - omega^2 M x)`, from `K x`."""
    squares = np.zeros(len(values))
    solved = np.array([mass.solve(row.real) + 1j * mass.solve(row.imag) for row in forces])
    for part in (np.real, np.imag):
        rows = part(solved - values[:, None] * shapes)
        squares += [max(float(row @ mass.multiply(row)), 0.0) for row in rows]
    return np.sqrt(squares)


def _product(a: Array, b: Array) -> Array:
    product: Array = a @ b.T
    return (product + product.T) / 2


def _rigid_part(system: System, mass: Mass, u: Array, shapes: Array) -> Array:
    """Return `|P x|^2 / |x|^2` (n,) in M for motions x, the rows of `shapes` (n, ndofs).

    P projects on the rigid motions of each part of the body that the supports allow, at displacements `u` (ndofs,).
    """
    mesh = system.mesh
    where = mesh.p.T + u.reshape(-1, mesh.d)
    part = parts_of_body(system)
    is_constrained = np.zeros(system.ndofs, dtype=bool)
    is_constrained[system.supports.held] = True
    found, all_of_it = np.zeros(len(shapes)), np.array([x @ mass.multiply(x) for x in shapes])
    for own in np.split(np.argsort(part, kind="stable"), np.cumsum(np.bincount(part))[:-1]):
        rigid = _allowed(where[own], is_constrained.reshape(-1, mesh.d)[own])
        padded = np.zeros((rigid.shape[1], mesh.nv, mesh.d))
        padded[:, own] = rigid.T.reshape(-1, len(own), mesh.d)
        for motion in _orthonormal(mass, padded.reshape(len(padded), system.ndofs)):
            found += (shapes @ mass.multiply(motion)) ** 2
    return found / all_of_it


def _allowed(x: Array, is_constrained: NDArray[np.bool_]) -> Array:
    """Return the rigid motions (dofs, m) of vertices at `x` (nv, d) that do not move constrained degrees of freedom."""
    x = x - x.mean(axis=0)
    every = motions(x / (np.linalg.norm(x, axis=1).max() or 1.0)).reshape(x.size, -1)
    constrained = every[is_constrained.ravel()]
    if not len(constrained):
        return every
    _, values, right = np.linalg.svd(constrained, full_matrices=True)
    rank = int((values > ZERO * values.max()).sum())
    allowed: Array = every @ right[rank:].T
    return allowed


def _orthonormal(mass: Mass, vectors: Array) -> Array:
    """Return rows with the same span, orthonormal in M."""
    if not len(vectors):
        return vectors
    values, c = np.linalg.eigh(vectors @ np.array([mass.multiply(v) for v in vectors]).T)
    retained = values > ZERO * values.max()
    basis: Array = (c[:, retained] / np.sqrt(values[retained])).T @ vectors
    return basis
