"""Two clamped tangents of quadratic elements: by the eigenvalues of S at points, or by tensions of node pairs."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any
from unittest.mock import patch

import numpy as np
import skfem
from rich.console import Console
from scipy.sparse.linalg import spsolve

from skfem_stvk import StVK, System
from skfem_stvk.arguments import Array
from skfem_stvk.edges import ALL, NONE, TENSILE, Assembly, Linearized, Tensions
from skfem_stvk.terminal import grid

YOUNG = 1e5
#: Iteration limit.
MOST = 100


def by_pairs(self: Assembly, u: Array, rows: Any, data: Array, add: bool, force: Any = None, kept: Tensions = ALL) -> Linearized:
    """Fill K as `Assembly.fill` does, but with TENSILE keep positive tensions of node pairs.

    A tension `t` enters its block as `-t I`.
    """
    _, without = self.blocks(u, None, None, NONE)
    W, blocks = self.blocks(u, force)
    if kept == TENSILE:
        tensions = (without - blocks).reshape(-1, 9)[:, 0]
        blocks = without
        for index in (0, 4, 8):
            blocks.reshape(-1, 9)[:, index] -= np.maximum(tensions, 0)
    return Linearized(W, self.pairs.fill(rows.of_all_pairs, blocks, add, data))


_usual = Assembly.fill


def negative_in_tension(body: System) -> float:
    """Return the fraction of node pairs with a negative tension under a stretch in all directions."""
    (term,) = body.bound_terms
    assert isinstance(term, Assembly)
    u = 0.1 * body.mesh.p.T
    tensions = (term.blocks(u, kept=NONE)[1] - term.blocks(u)[1]).reshape(-1, 9)[:, 0]
    return float((tensions < 0).mean())


def cases(quick: bool) -> Iterator[tuple[str, System, Array, Array]]:
    """Yield names and bodies, with the constrained degrees of freedom and the displacements (nv, 3) that prescribe their values."""
    s = np.linspace(0, 1, 3 if quick else 5)
    cube, slender = (
        skfem.MeshTet.init_tensor(s, s, s),
        skfem.MeshTet.init_tensor(np.linspace(0, 1, 5 if quick else 17), [0, 0.1], [0, 0.1]),
    )
    for name, amount, angle in (
        ("cube, doubled", 1.0, 0.0),
        ("cube, pushed by 20 %", -0.2, 0.0),
        ("cube, twisted by 90 degrees", 0.0, np.pi / 2),
        ("cube, twisted by 120 degrees, pushed by 10 %", -0.1, 2 * np.pi / 3),
    ):
        yield name, *_with_constrained_ends(cube, 2, amount * np.eye(3)[2], angle)
    yield "bar, its end pushed aside by half of its length", *_with_constrained_ends(slender, 0, np.array([0, 0, -0.5]), 0.0)


def _with_constrained_ends(mesh: skfem.MeshTet, axis: int, shift: Array, angle: float) -> tuple[System, Array, Array]:
    """Return a body with both ends along an axis constrained.

    The second end is shifted, and rotated about the middle of its cross-section.
    """
    body = System(mesh, StVK(young=YOUNG, poisson=0.3), degree=2)
    x, c, s = body.mesh.p.T, np.cos(angle), np.sin(angle)
    moved = (x - 0.5) @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) + 0.5 - x + shift
    end = x[:, axis] == 1
    held = np.flatnonzero(np.repeat(end | (x[:, axis] == 0), 3))
    return body, held, np.where(end[:, None], moved, 0.0)


def iterations(body: System, held: Array, ends: Array, pairs: bool) -> str:
    """Return the number of iterations with the clamped tangent and the exact line search.

    The iteration starts from the linear solution and ends when the residual is 1e-8 of its first value.
    """
    free, (term,) = body.free_dofs(held), body.bound_terms
    u = ends.ravel().copy()
    with patch.object(Assembly, "fill", by_pairs if pairs else _usual):
        u[free.free] = -spsolve(
            free.matrix(body.tangent(np.zeros(u.size))).tocsc(), (body.tangent(np.zeros(u.size)) @ u)[free.free]
        )
        first = None
        for count in range(MOST):
            residual = body.internal_force(u)[free.free]
            first = first or float(np.linalg.norm(residual))
            if np.linalg.norm(residual) < 1e-8 * first:
                return str(count)
            K = free.matrix(body.jacobian(u, kept=TENSILE)).tocsc()
            step = free.vector(-spsolve(K, residual))
            c = term.along(u.reshape(-1, 3), step.reshape(-1, 3))
            roots = np.roots(np.polyder(c[::-1]))
            u = u + step * min(roots.real[(np.abs(roots.imag) < 1e-9) & (roots.real > 0)], default=1.0)
    return f"over {MOST}"


def main(quick: bool = False) -> int:
    """Count Newton's iterations of quadratic tetrahedra with either clamped tangent."""
    columns = "body", "pairs below 0 in tension", "eigenvalues at points", "tensions of pairs"
    printed = grid("Iterations with a clamped tangent and the exact line search", *columns, right=columns[1:])
    for name, body, held, ends in cases(quick):
        counts = [iterations(body, held, ends, pairs) for pairs in (False, True)]
        printed.add_row(name, f"{100 * negative_in_tension(body):.0f} %", *counts)
    Console(highlight=False, width=132).print(printed)
    return 0
