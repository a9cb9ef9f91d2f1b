"""JAX and PyTorch, with automatic differentiation of an energy density that is written in their own arrays."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix, csr_matrix

from ...arguments import Array
from . import lame, require

#: Function of a deformation gradient F (3, 3) that returns the energy per volume at rest [Pa], in the library's own arrays.
Density = Callable[[Any], Any]


class Library(NamedTuple):
    """Functions of a library.

    `array` converts NumPy arrays. `gradient` and `hessian` return the first and second derivative of a function with respect to its
    first argument. `over_elements` vectorises a function over all elements.
    """

    array: Callable[[Array], Any]
    gradient: Callable[..., Any]
    hessian: Callable[..., Any]
    over_elements: Callable[..., Any]


class Differentiated:
    """W, F and K for `W = sum V density(F)` over linear tetrahedra, with `F = I + sum_a u_a g_a'`.

    The density is that of St. Venant-Kirchhoff, or a user's function of F alone that contains all its constants.
    """

    def __init__(
        self, library: Library, p: Array, t: NDArray[np.int32], constants: tuple[float, float], density: Density | None
    ) -> None:
        X = p.T[t.T]
        base_vectors = X[:, 1:] - X[:, :1]
        g = np.swapaxes(np.linalg.inv(base_vectors), 1, 2)  # (nt, 3, 3), row by row
        self._g = library.array(np.concatenate([-g.sum(axis=1, keepdims=True), g], axis=1))
        self._volumes = library.array(np.abs(np.linalg.det(base_vectors)) / 6)
        self._array, self._t, self._ndofs = library.array, t.T, p.size
        one, law = library.array(np.eye(3)), density or _st_venant_kirchhoff(library.array(np.eye(3)), *lame(*constants))

        def of_element(u: Any, g: Any, volume: Any) -> Any:
            return volume * law(one + u.T @ g)

        each = of_element, library.gradient(of_element), library.hessian(of_element)
        self._derivatives = [library.over_elements(one) for one in each]
        dofs = (3 * t.T[:, :, None] + np.arange(3)).reshape(-1, 12)
        self._rows, self._columns = (one.ravel() for one in np.broadcast_arrays(dofs[:, :, None], dofs[:, None]))

    def energy(self, u: Array) -> float:
        return float(self._of_elements(0, u).sum())

    def internal_force(self, u: Array) -> Array:
        force = np.zeros((self._ndofs // 3, 3))
        np.add.at(force, self._t, self._of_elements(1, u))
        return force.ravel()

    def tangent(self, u: Array) -> csr_matrix:
        values = self._of_elements(2, u).ravel()
        return coo_matrix((values, (self._rows, self._columns)), shape=(self._ndofs,) * 2).tocsr()

    def _of_elements(self, order: int, u: Array) -> Array:
        own = self._array(u.reshape(-1, 3)[self._t])
        return np.asarray(self._derivatives[order](own, self._g, self._volumes))


def _st_venant_kirchhoff(one: Any, lam: float, mu: float) -> Density:
    def density(F: Any) -> Any:
        E = (F.T @ F - one) / 2
        return lam / 2 * E.trace() ** 2 + mu * (E * E).sum()

    return density


class JAX(Differentiated):
    """Peer that uses `jax.grad` and `jax.hessian` of each element's energy, compiled by XLA. See `Peer`.

    `density` replaces the St. Venant-Kirchhoff density by a user's function of F (3, 3), written in `jax.numpy`, that contains all
    its constants. Double precision is set for the whole process.
    """

    name = "JAX"

    def __init__(self, p: Array, t: NDArray[np.int32], young: float, poisson: float, *, density: Density | None = None) -> None:
        jax = require("JAX")
        jax.config.update("jax_enable_x64", True)
        self.version: str = jax.__version__
        library = Library(jax.numpy.asarray, jax.grad, jax.hessian, lambda one: jax.jit(jax.vmap(one)))
        super().__init__(library, p, t, (young, poisson), density)


class PyTorch(Differentiated):
    """Peer that uses `torch.func.grad` and `torch.func.hessian` of each element's energy. See `Peer`.

    The computation is in double precision on the CPU. `density` replaces the St. Venant-Kirchhoff density by a user's function of F
    (3, 3), written in `torch`, that contains all its constants.
    """

    name = "PyTorch"

    def __init__(self, p: Array, t: NDArray[np.int32], young: float, poisson: float, *, density: Density | None = None) -> None:
        torch = require("PyTorch")
        self.version: str = torch.__version__
        library = Library(torch.from_numpy, torch.func.grad, torch.func.hessian, torch.func.vmap)
        super().__init__(library, p, t, (young, poisson), density)
