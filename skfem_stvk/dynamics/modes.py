"""Natural modes of vibration: the lowest eigenpairs of (K, M)."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import eigh

from ..errors import LoadError, StvkError
from ..linear import Kind, LinearSolver, choose
from ..linear.choose import direct
from ..mesh.displacements import by_vertex
from ..results import Fields, Series, plot
from ..results.state import State
from ..system import System
from .largest import bound_on_eigenvalues
from .rigid_part import rigid_part
from .shift_invert import ShiftedProblem, lowest_vectors

Array = NDArray[Any]

#: A motion of which all but this part is rigid is rigid, if its eigenvalue is rounding: so many eps of the largest one.
NOT_RIGID, ROUNDING = 1e-6, 1e4
#: In pictures the largest displacement is this part of the size of the body.
SHOWN = 0.1
#: "auto" takes a direct solver up to so many unknowns: it factorises once and solves about a hundred times.
MANY = 200_000


@dataclass(frozen=True, eq=False, repr=False)
class Modes:
    """Natural modes: `K x = omega^2 M x` over the free degrees of freedom, ascending.

    Attributes
    ----------
    frequencies : (n,) `omega/(2 pi)` [Hz]; 0 of rigid modes, NaN of unstable ones.
    eigenvalues : (n,) `omega^2` [1/s^2].
    shapes : (n, ndofs) `x`, with `x_i' M x_j = delta_ij`, and 0 where the body is held [kg^-1/2].
    rigid : (n,) whether the mode moves the body, or parts of it, as a whole, without stiffness.
    unstable : (n,) whether `omega^2` is negative: the state is no minimum of the potential, and the mode grows.
    residuals : (n,) sizes of `M^-1/2 (K x - omega^2 M x)` [1/s^2]: an eigenvalue lies within.
    system, u : whose modes they are, and the displacements (ndofs,) there [m].
    """

    frequencies: Array
    eigenvalues: Array
    shapes: Array
    rigid: NDArray[np.bool_]
    unstable: NDArray[np.bool_]
    residuals: Array
    system: System = field(compare=False)
    u: Array

    def __len__(self) -> int:
        return len(self.eigenvalues)

    def state(self, number: int, scale: float | None = None) -> State:
        """The body displaced by `u` and by `scale` times the mode of this number, counted from 0; by default a tenth of its size."""
        if not -len(self) <= number < len(self):
            raise StvkError(f"Mode {number} came; there are {len(self)}, from 0 to {len(self) - 1}.")
        mesh, shape = self.system.mesh, self.shapes[number].reshape(-1, self.system.mesh.d)
        if scale is None:
            scale = SHOWN * float(np.linalg.norm(np.ptp(mesh.p, axis=1)) / np.linalg.norm(shape, axis=1).max())
        return Fields(mesh, self.system.elastic_terms).at(self.u + scale * shape.ravel())

    def plot(self, number: int, scale: float | None = None, **options: Any) -> Any:
        """Draw a mode, by default coloured by the length of displacements; options as of `results.plot`, `scale` as of `state`."""
        return plot(
            self.state(number, scale), **{"field": "displacement", "label": f"mode {number}: {self._named(number)}", **options}
        )

    def save(self, path: str | os.PathLike[str], scale: float | None = None) -> Path:
        """Write all modes as a series for ParaView, whose time is the number of the mode; errors as of `results.Series`."""
        series = Series(path, ["von_mises_stress"])
        for number in range(len(self)):
            series.add(self.state(number, scale), number)
        return series.path

    def _named(self, number: int) -> str:
        if self.rigid[number]:
            return "rigid"
        if self.unstable[number]:
            return f"unstable, omega^2 = {self.eigenvalues[number]:.4g} 1/s^2"
        return f"{self.frequencies[number]:.6g} Hz"

    def __repr__(self) -> str:
        rows = [f"{number:4d}  {self._named(number)}" for number in range(len(self))]
        return "\n".join([f"Modes: {len(self)}, {self.rigid.sum()} of them rigid, {self.unstable.sum()} unstable", *rows])


def modes(
    system: System,
    n: int = 10,
    *,
    u: ArrayLike | None = None,
    mass: str = "lumped",
    solver: str | LinearSolver = "auto",
) -> Modes:
    """The n lowest natural modes of a system, held as it is, at rest or at a state of equilibrium.

    Parameters
    ----------
    n : how many, rigid ones included.
    u : displacements (ndofs,) [m] of the equilibrium about which it vibrates, such as `solve_static(system).u`; by default none. K is that of the
        stressed body there.
    mass : "lumped", or "consistent".
    solver : as of `solve_static`; by default a direct one, and multigrid for more than 200 000 unknowns.

    Raises
    ------
    StvkError
        if there are not n modes, or the solver is unknown or fails.
    MaterialError
        if a material has no density, or a vertex that can move has no mass.
    LoadError
        if there is a follower load: K is not symmetric then.
    StateError
        if `u` does not have one finite entry for each degree of freedom.

    >>> import skfem
    >>> from skfem_stvk import StVK, System
    >>> mesh = skfem.MeshTri.init_tensor(np.linspace(0, 1, 9), np.linspace(0, 1, 9))
    >>> free = modes(System(mesh, StVK(young=1e6, poisson=0.3, density=1e3)), 5)
    >>> free.rigid, free.frequencies.round(1)
    (array([ True,  True,  True, False, False]), array([ 0. ,  0. ,  0. , 12.3, 13.5]))
    """
    if not isinstance(system, System):
        raise StvkError(f"A {type(system).__name__} came; expected a System: System(mesh, terms, ...).")
    if not system.conservative:
        raise LoadError(
            "Modes: a load follows the body, so that K is not symmetric. Take it out, or its direction at the equilibrium as a dead load."
        )
    free = np.setdiff1d(np.arange(system.ndofs), system.supports.held)
    if isinstance(n, bool) or not isinstance(n, int | np.integer) or not 1 <= n <= len(free):
        raise StvkError(f"n = {n!r}; expected a number of modes, from 1 to {len(free)}, the number of free degrees of freedom.")
    chosen = direct(len(free)) if solver == "auto" and len(free) <= MANY else choose(solver, len(free), Kind.SYMMETRIC)
    problem = ShiftedProblem(system, chosen, system.mass(mass))
    x = np.zeros(system.ndofs) if u is None else by_vertex(system.mesh, u).ravel().astype(np.float64)
    vectors = lowest_vectors(problem, x, n)
    return _ritz(problem, x, np.array([problem.free.vector(vector) for vector in vectors.T]), int(n))


def _ritz(problem: ShiftedProblem, u: Array, vectors: Array, n: int) -> Modes:
    """The n lowest modes in the span of the rows of `vectors` (m, ndofs), by exact products with K and M."""
    system, mass, K = problem.system, problem.mass, problem.stiffness(u)
    images, momenta = (np.array([multiply(row) for row in vectors]) for multiply in (lambda v: K @ v, mass.multiply))
    values, c = eigh(_product(vectors, images), _product(vectors, momenta))
    values, c = values[:n], c[:, :n].T
    shapes = c @ vectors
    accelerations = np.array([mass.solve(row) for row in c @ images]) - values[:, None] * shapes
    residuals = np.sqrt([max(float(row @ mass.multiply(row)), 0.0) for row in accelerations])
    largest = bound_on_eigenvalues(system.linear_operator(u), mass.vertex)
    rounding = ROUNDING * float(np.finfo(system.dtype).eps) * largest
    rigid = (np.abs(values) <= rounding) & (rigid_part(system, mass, u, shapes) >= 1 - NOT_RIGID)
    unstable = ~rigid & (values < -rounding)
    frequencies = np.where(unstable, np.nan, np.where(rigid, 0.0, np.sqrt(np.maximum(values, 0)) / (2 * np.pi)))
    return Modes(frequencies, values, shapes, rigid, unstable, residuals, system, u)


def _product(a: Array, b: Array) -> Array:
    product: Array = a @ b.T
    return (product + product.T) / 2
