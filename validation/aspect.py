"""Accuracy with flat elements: errors of F against 50 digits on clouds of random, flattened and rotated tetrahedra."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from rich.console import Console

from skfem_stvk import ElementMesh, StVK
from skfem_stvk.mesh.geometry import aspect_ratios
from skfem_stvk.referee.exact import ExactStVK
from skfem_stvk.referee.reference import ReferenceStVK, isotropic_tensor
from skfem_stvk.terminal import grid

YOUNG, POISSON = 1.0, 0.3
LAME = POISSON / ((1 + POISSON) * (1 - 2 * POISSON)), 1 / (2 * (1 + POISSON))
ASPECTS = (1, 50, 500, 5000)
STRAINS = (1e-1, 1e-3, 1e-6)


class Errors(NamedTuple):
    """Largest errors over the tetrahedra of a cloud, each relative to the largest force on the element's vertices.

    `ours` and `theirs` are the errors of this package and of scikit-fem in double precision. `double` and `single` are the errors
    of this package in each precision, divided by eps and by the ratio of longest edge to smallest height of the element.
    """

    ours: float
    theirs: float
    double: float
    single: float


def cloud(aspect: float, n: int) -> ElementMesh:
    """Return `n` separate tetrahedra with random corners in a box of this aspect, each rotated at random."""
    rng = np.random.default_rng(0)
    corners = rng.random((n, 4, 3)) / [1, 1, aspect]
    rotated = corners @ np.linalg.qr(rng.normal(size=(n, 3, 3)))[0]
    return ElementMesh(rotated.reshape(-1, 3).T, np.arange(4 * n).reshape(n, 4).T)


def errors(mesh: ElementMesh, strain: float) -> Errors:
    """Return the errors for displacements with a random gradient of size `strain` on each element."""
    n = mesh.nt
    gradients = strain * np.random.default_rng(1).normal(size=(n, 3, 3))
    u = mesh.p.T.reshape(n, 4, 3) @ gradients
    truth = ExactStVK(mesh.p, mesh.t, LAME).energy_and_force(u.ravel())[1].reshape(u.shape)
    scale, aspects = np.abs(truth).max(axis=(1, 2)), aspect_ratios(mesh)

    def of(force: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(np.abs(force.reshape(u.shape) - truth).max(axis=(1, 2)) / scale)

    def own(dtype: type) -> NDArray[np.float64]:
        force = np.zeros((mesh.nv, 3))
        StVK(young=YOUNG, poisson=POISSON).bind(mesh, dtype).energy_and_force(u.reshape(-1, 3), force)
        return of(force)

    theirs = of(ReferenceStVK(mesh.p, mesh.t, isotropic_tensor(YOUNG, POISSON, 3, condensed=False)).internal_force(u.ravel()))
    double, single = own(np.float64), own(np.float32)
    over = [(error / (np.finfo(dtype).eps * aspects)).max() for error, dtype in ((double, np.float64), (single, np.float32))]
    return Errors(double.max(), theirs.max(), *over)


def measure(n: int = 1000) -> Iterator[tuple[float, float, Errors]]:
    """Yield the aspect of the box, the strain, and the errors of `n` tetrahedra."""
    for aspect in ASPECTS:
        mesh = cloud(aspect, n)
        for strain in STRAINS:
            yield aspect, strain, errors(mesh, strain)


def main() -> int:
    """Measure the error of F against the aspect ratio of the elements, in double and single precision, and of scikit-fem."""
    columns = "box", "strain", "skfem-stvk", "scikit-fem", "over eps x aspect", "float32"
    printed = grid("Largest error of F against 50 digits, 1000 random tetrahedra each", *columns, right=columns)
    for aspect, strain, found in measure():
        printed.add_row(
            f"1:{aspect:.0f}",
            f"{strain:g}",
            f"{found.ours:.0e}",
            f"{found.theirs:.0e}",
            f"{found.double:.1f}",
            f"{found.single:.1f}",
        )
    Console(highlight=False).print(printed)
    return 0
