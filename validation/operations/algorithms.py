"""List of the algorithms, and the counted run of an algorithm."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from . import edges, obrien_hodgins, picinbono, total_lagrangian, total_lagrangian_matrices
from .body import Body
from .counting import Tally, counted, plain


class Algorithm(NamedTuple):
    """Algorithm: `prepare` computes the constants of a body; `run` adds F or K to arrays.

    The arrays are (nv, 3) for F, (ne, 3, 3) and (nv, 3, 3) for the blocks of K. `displacements`: `run` takes displacements instead
    of positions.
    """

    name: str
    quantity: str
    prepare: Callable[[Body], Any]
    run: Callable[..., None]
    displacements: bool = False


ALGORITHMS = (
    Algorithm("edges", "F", edges.prepare, edges.force),
    Algorithm("edges, from displacements", "F", edges.prepare, edges.force_displacement, True),
    Algorithm("Total Lagrangian", "F", total_lagrangian.prepare, total_lagrangian.force),
    Algorithm("Total Lagrangian, matrix B", "F", total_lagrangian_matrices.prepare, total_lagrangian_matrices.force),
    Algorithm("O'Brien-Hodgins", "F", obrien_hodgins.prepare, obrien_hodgins.force),
    Algorithm("O'Brien-Hodgins, as printed", "F", obrien_hodgins.prepare, obrien_hodgins.force_as_printed),
    Algorithm("Picinbono", "F", picinbono.prepare, picinbono.force, True),
    Algorithm("edges", "K", edges.prepare, edges.tangent),
    Algorithm("edges, from displacements", "K", edges.prepare, edges.tangent_displacement, True),
    Algorithm("edges, pair by pair", "K", edges.prepare, edges.tangent_by_pairs),
    Algorithm("Total Lagrangian", "K", total_lagrangian.prepare, total_lagrangian.tangent),
    Algorithm("Total Lagrangian, matrix B", "K", total_lagrangian_matrices.prepare, total_lagrangian_matrices.tangent),
)

#: Linear elements for small strain, which compute a different F. The ratio to them is the price of large strain.
LINEAR = Algorithm("linear elements", "F", picinbono.prepare, picinbono.linear_force, True)


def algorithm(quantity: str, name: str) -> Algorithm:
    """Return the algorithm of that name."""
    (found,) = (a for a in ALGORITHMS if (a.quantity, a.name) == (quantity, name))
    return found


def state(body: Body) -> NDArray[np.float64]:
    """Return random displacements (nv, 3) [m] of 0.3 times the mean element size, so that strains are large."""
    size = np.ptp(body.p, axis=1).max() / body.nv ** (1 / 3)
    return 0.3 * size * np.random.default_rng(4).standard_normal((body.nv, 3))


def zeros(body: Body, quantity: str) -> tuple[NDArray[np.float64], ...]:
    """Return the zero arrays to which an algorithm adds."""
    return (np.zeros((body.nv, 3)),) if quantity == "F" else (np.zeros((body.edges.shape[1], 3, 3)), np.zeros((body.nv, 3, 3)))


def count(chosen: Algorithm, body: Body, u: NDArray[np.float64]) -> tuple[Tally, tuple[NDArray[np.float64], ...]]:
    """Return the operations of one run at displacements `u` (nv, 3), and the computed arrays."""
    tally = Tally()
    rest = chosen.prepare(body)
    rest = type(rest)(*(counted(field, tally) for field in rest))
    out = [counted(array, tally) for array in zeros(body, chosen.quantity)]
    chosen.run(rest, counted(u if chosen.displacements else body.p.T + u, tally), *out)
    return tally, tuple(plain(array) for array in out)
