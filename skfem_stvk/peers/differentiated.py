"""Bodies whose energy density a library of automatic differentiation differentiates, element by element."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix, csr_matrix

from ..arguments import Array
from .peer import lame

#: The energy per volume at rest of a deformation gradient F (3, 3), in the library's own arrays [Pa].
Density = Callable[[Any], Any]


class Library(NamedTuple):
    """What is needed of a library: its arrays from NumPy's; and of a function of arrays, the function, its first and its second
    derivative with respect to the first of them, over all elements at once."""

    array: Callable[[Array], Any]
    over_elements: Callable[[Callable[..., Any], int], Callable[..., Any]]


class Differentiated:
    """W, F and K of `W = sum V density(F)` over linear tetrahedra, with `F = I + sum_a u_a g_a'`.

    The density is St. Venant-Kirchhoff's, or a function of F alone that a user has written, with all its constants.
    """

    def __init__(
        self, library: Library, p: Array, t: NDArray[np.int32], constants: tuple[float, float], density: Density | None
    ) -> None:
        X = p.T[t.T]
        spokes = X[:, 1:] - X[:, :1]
        g = np.swapaxes(np.linalg.inv(spokes), 1, 2)  # (nt, 3, 3), row by row
        self._g = library.array(np.concatenate([-g.sum(axis=1, keepdims=True), g], axis=1))
        self._volumes = library.array(np.abs(np.linalg.det(spokes)) / 6)
        self._array, self._t, self._ndofs = library.array, t.T, p.size
        one, law = library.array(np.eye(3)), density or _st_venant_kirchhoff(library.array(np.eye(3)), *lame(*constants))

        def of_element(u: Any, g: Any, volume: Any) -> Any:
            return volume * law(one + u.T @ g)

        self._derivatives = [library.over_elements(of_element, order) for order in range(3)]
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
