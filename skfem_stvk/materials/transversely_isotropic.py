"""Transversely isotropic material: one axis, and the same in all directions across it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from .material import FramedMaterial
from .orthotropic import Orthotropic
from .values import Values, constant


@dataclass(frozen=True, eq=False)
class TransverselyIsotropic(FramedMaterial):
    """Fibres along material axis 1, the first column of `frame`; every constant a number or one value an element.

    Parameters
    ----------
    young_axial, young_transverse : moduli along and across the axis [Pa].
    poisson_axial : contraction across under tension along the axis (nu_12 = nu_13).
    poisson_transverse : contraction across under tension across (nu_23).
    shear_axial : shear modulus of planes that hold the axis [Pa] (G_12 = G_13); the other is `E_t/(2 (1 + nu_23))`.
    frame : material axes as columns, see `FramedMaterial`.
    density : mass density [kg/m^3].

    Raises
    ------
    MaterialError
        for constants out of range, or that give no positive definite matrix, with element ids.

    >>> ply = TransverselyIsotropic(140e9, 10e9, poisson_axial=0.3, poisson_transverse=0.4, shear_axial=5e9)
    >>> ply.stiffness().shape
    (6, 6)
    """

    young_axial: ArrayLike
    young_transverse: ArrayLike
    poisson_axial: ArrayLike
    poisson_transverse: ArrayLike
    shear_axial: ArrayLike

    def __post_init__(self) -> None:
        limits = {"poisson_transverse": (-1.0, 1.0), "poisson_axial": (-np.inf, np.inf)}
        for name in ("young_axial", "young_transverse", "poisson_axial", "poisson_transverse", "shear_axial"):
            object.__setattr__(self, name, constant(getattr(self, name), name, *limits.get(name, (0.0, np.inf))))
        super().__post_init__()

    def stiffness(self) -> Values:
        shear = np.asarray(self.young_transverse) / (2 * (1 + np.asarray(self.poisson_transverse)))
        return Orthotropic(
            young=(self.young_axial, self.young_transverse, self.young_transverse),
            poisson=(self.poisson_transverse, self.poisson_axial, self.poisson_axial),
            shear=(shear, self.shear_axial, self.shear_axial),
        ).stiffness()
