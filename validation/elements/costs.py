"""Cost of each element: points, bytes without K, and times of setup, F, K and K v."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np
import skfem

from skfem_stvk import ElementMesh, StVK, System
from skfem_stvk.arguments import Array

from ..study import Study

REPEATED, QUICK_REPEATED = 15, 2
#: Cells along each side by dimension.
CELLS, QUICK_CELLS = {2: 150, 3: 20}, {2: 8, 3: 3}
#: Relative tolerance between the product of the compiled operator and that of K.
AGREEMENT = 1e-10


class Choice(NamedTuple):
    """Element and quadrature rule in dimension `d`."""

    name: str
    points: int
    d: int
    boxes: bool = False
    degree: int = 1
    curved: bool = False
    part: float = 1.0
    options: dict[str, Any] = {}  # noqa: RUF012

    def mesh(self, n: int) -> ElementMesh:
        """Return a square or cube of about `part` times `n` cells along each side.

        Inner nodes are moved, so that no two elements are alike.
        """
        n = max(2, round(self.part * n))
        lines, rng = [np.linspace(0, 1, n + 1)] * self.d, np.random.default_rng(1)
        kinds = {2: (skfem.MeshTri, skfem.MeshQuad), 3: (skfem.MeshTet, skfem.MeshHex)}
        mesh = ElementMesh.of(kinds[self.d][self.boxes].init_tensor(*lines))
        mesh = replace(mesh, p=mesh.p + 0.1 / n * rng.uniform(-1, 1, mesh.p.shape), boundaries={})
        if self.degree == 2:
            mesh = mesh.with_degree(2)
        if self.curved:
            mesh = replace(mesh, p=mesh.p + 0.02 / n * rng.uniform(-1, 1, mesh.p.shape))
        return mesh


ONE_POINT = {"quadrature": "one-point", "hourglass": 0.05}
CHOICES = (
    Choice("triangles", 1, 2),
    Choice("quadrilaterals", 4, 2, boxes=True),
    Choice("quadrilaterals, one point", 1, 2, boxes=True, options=ONE_POINT),
    Choice("quadratic triangles", 3, 2, degree=2, part=0.5),
    Choice("tetrahedra", 1, 3),
    Choice("hexahedra", 8, 3, boxes=True),
    Choice("hexahedra, one point", 1, 3, boxes=True, options=ONE_POINT),
    Choice("quadratic tetrahedra", 4, 3, degree=2, part=0.5),
    Choice("quadratic tetrahedra, curved", 4, 3, degree=2, curved=True, part=0.5),
    Choice("quadratic tetrahedra, exact rule", 14, 3, degree=2, part=0.5, options={"quadrature": "exact"}),
)


def costs(quick: bool = False) -> Sequence[Study]:
    """Measure times and memory of all elements."""
    rows, failures = [], []
    for choice in CHOICES:
        row, off = _measured(choice, (QUICK_CELLS if quick else CELLS)[choice.d], QUICK_REPEATED if quick else REPEATED)
        rows.append(row)
        if not off <= AGREEMENT:
            failures.append(f"{choice.name}: error of K v without K = {off:.1e}; expected at most {AGREEMENT:g}")
    return [
        Study(
            "Costs of elements",
            "K v without forming K equals K times v",
            (
                "element",
                "points",
                "elements",
                "nodes",
                "bytes",
                "nnz of K",
                "setup, us",
                "F, ns",
                "K, ns",
                "K v, ns",
                "F",
                "K",
                "K v",
            ),
            tuple(rows),
            tuple(failures),
            (
                "per element: bytes without K and its pattern, entries of K, times of the setup, and of F, K and K v at "
                "one "
                f"state (best of {QUICK_REPEATED if quick else REPEATED}); the last three columns have F, K and K v in products of "
                "SciPy's CSR matrix K with a vector (one thread) in the same run",
            ),
        )
    ]


def _measured(choice: Choice, n: int, repeated: int) -> tuple[tuple[str, ...], float]:
    mesh = choice.mesh(n)
    _system(choice, choice.mesh(2))
    setup = _shortest(lambda: _system(choice, mesh), min(repeated, 3))
    system = _system(choice, mesh)
    u = 1e-2 / n * np.random.default_rng(0).standard_normal(system.ndofs)
    v, force = np.cos(np.arange(system.ndofs)), np.empty(system.ndofs)
    K = system.tangent(u)
    without_K = sum(size for part, size in system.memory().items() if "pattern" not in part and part not in ("product", "mass"))
    # calls alternate, so that other load on the machine affects all alike
    calls: dict[str, Callable[[], Any]] = {
        "F": lambda: system.energy_and_force(u, out=force),
        "K": lambda: system.tangent(u, out=K),
        "K v": lambda: system.product(u, v),
        "CSR": lambda: K @ v,
    }
    best = dict.fromkeys(calls, np.inf)
    for _ in range(repeated):
        for name, call in calls.items():
            best[name] = min(best[name], _shortest(call, 2))
    product: Array = K @ v
    off = float(np.abs(system.product(u, v) - product).max() / np.abs(product).max())
    nt = system.mesh.nt
    each = [f"{1e9 * best[name] / nt:.0f}" for name in ("F", "K", "K v")]
    ratios = [f"{best[name] / best['CSR']:.2f}" for name in ("F", "K", "K v")]
    sizes = str(choice.points), str(nt), str(system.mesh.nv), f"{without_K / nt:.0f}", f"{K.nnz / nt:.0f}"
    return (choice.name, *sizes, f"{1e6 * setup / nt:.2f}", *each, *ratios), off


def _system(choice: Choice, mesh: ElementMesh) -> System:
    return System(mesh, StVK(young=1e5, poisson=0.3), **choice.options)


def _shortest(call: Callable[[], Any], repeated: int) -> float:
    best = np.inf
    for _ in range(repeated):
        begin = perf_counter()
        call()
        best = min(best, perf_counter() - begin)
    return float(best)
