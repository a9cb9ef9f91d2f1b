"""What flat elements cost: errors of F against 50 digits as a block is squeezed flat."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import skfem
from rich.console import Console

from skfem_stvk import ElementMesh, StVK, System
from skfem_stvk.mesh.geometry import aspect_ratios
from skfem_stvk.referee.exact import ExactStVK
from skfem_stvk.referee.terminal import grid
from skfem_stvk.reference import ReferenceStVK, isotropic_tensor

YOUNG, POISSON = 1.0, 0.3
LAME = POISSON / ((1 + POISSON) * (1 - 2 * POISSON)), 1 / (2 * (1 + POISSON))
SQUEEZES = (1.0, 0.1, 0.01, 0.001)
STRAINS = (1e-1, 1e-3, 1e-6)


def measure() -> Iterator[tuple[float, float, float, float]]:
    """Largest aspect ratio, strain, and the relative errors of F of the edge form and of scikit-fem.

    The block is stretched along x and y, as a sheet would be: what happens across it follows from small differences.
    """
    cube = skfem.MeshTet.init_tensor(*[np.linspace(0, 1, 4)] * 3)
    noise = np.random.default_rng(0).uniform(-0.1, 0.1, cube.p.shape)
    for squeeze in SQUEEZES:
        p = (cube.p + noise) * np.array([[1.0], [1.0], [squeeze]])
        mesh = ElementMesh(p, cube.t)
        body = System(mesh, StVK(young=YOUNG, poisson=POISSON))
        reference = ReferenceStVK(p, mesh.t, isotropic_tensor(YOUNG, POISSON, 3, condensed=False))
        for strain in STRAINS:
            u = (strain * np.diag([1.0, -0.5, 0.2]) @ p).T.ravel()
            _, truth = ExactStVK(p, mesh.t, LAME).energy_and_force(u)
            errors = [np.abs(model.internal_force(u) - truth).max() / np.abs(truth).max() for model in (body, reference)]
            yield float(aspect_ratios(mesh).max()), strain, float(errors[0]), float(errors[1])


def main() -> int:
    """error of F against the aspect ratio of the elements, of the edge form and of scikit-fem"""
    columns = "aspect ratio", "strain", "skfem-stvk", "scikit-fem"
    printed = grid("Error of F against 50 digits in a stretched sheet", *columns, right=columns)
    for aspect, strain, ours, theirs in measure():
        printed.add_row(f"{aspect:.0f}", f"{strain:g}", f"{ours:.0e}", f"{theirs:.0e}")
    Console(highlight=False).print(printed)
    return 0
