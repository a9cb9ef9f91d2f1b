"""Anisotropic material: all 21 constants."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from .material import FramedMaterial
from .values import Values, constant


@dataclass(frozen=True, eq=False)
class Anisotropic(FramedMaterial):
    """The elasticity matrix itself.

    Parameters
    ----------
    voigt : (6, 6) or (n, 6, 6) matrix [Pa] from strains to stresses in Voigt order 11, 22, 33, 23, 13, 12 with engineering shear
        strains `2 E_23, 2 E_13, 2 E_12`; symmetric positive definite.
    frame : material axes as columns, see `FramedMaterial`.
    density : mass density [kg/m^3].

    Raises
    ------
    MaterialError
        if the matrix is not symmetric positive definite, with element ids.

    >>> import numpy as np
    >>> Anisotropic(np.diag([3.0, 3, 3, 1, 1, -1]))
    Traceback (most recent call last):
    skfem_stvk.errors.MaterialError: The elasticity matrix is not positive definite (lowest eigenvalue -1.00e+00). ...
    """

    voigt: ArrayLike

    def __post_init__(self) -> None:
        object.__setattr__(self, "voigt", constant(self.voigt, "voigt", shape=(6, 6)))
        super().__post_init__()

    def stiffness(self) -> Values:
        return np.asarray(self.voigt)
