"""Cantilever of the speed studies: 5 x 1 x 1 m, clamped at x = 0. The load bends its end by half of its length."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from time import perf_counter
from typing import NamedTuple

import numpy as np
import skfem

from skfem_stvk.arguments import Array

LENGTH, YOUNG, POISSON = 5.0, 1.5e6, 0.3
TRACTION = (0.0, 0.0, -1.0e4)  # force per rest area at the end [Pa]: P L^2/EI = 2
RTOL = 1e-8
#: Load factors of the programs that do not choose their own load steps.
TENTHS = np.arange(1, 11) / 10


class Run(NamedTuple):
    """Result and cost of one program: displacement of the end's centre (3,) [m], Newton iterations, seconds by part."""

    name: str
    ndofs: int
    tip: Array
    iterations: int
    seconds: dict[str, float]

    @property
    def total(self) -> float:
        """Wall time [s]."""
        return sum(self.seconds.values())


@contextmanager
def timed(seconds: dict[str, float], part: str) -> Iterator[None]:
    """Add the wall time of the `with` block to `seconds[part]`."""
    start = perf_counter()
    yield
    seconds[part] = seconds.get(part, 0.0) + perf_counter() - start


def cantilever(n: int) -> skfem.MeshTet:
    """Return the mesh of 5 n x n x n cells of six tetrahedra, with the boundaries "wall" and "tip".

    The end's centre is a vertex if `n` is even.
    """
    across = np.linspace(0, 1, n + 1)
    mesh = skfem.MeshTet.init_tensor(np.linspace(0, LENGTH, 5 * n + 1), across, across)
    return mesh.with_boundaries({"wall": lambda x: x[0] == 0, "tip": lambda x: x[0] == LENGTH})


def end_centre(mesh: skfem.MeshTet) -> int:
    """Return the vertex at the end's centre."""
    return int(np.argmin(np.linalg.norm(mesh.p - np.array([[LENGTH], [0.5], [0.5]]), axis=0)))
