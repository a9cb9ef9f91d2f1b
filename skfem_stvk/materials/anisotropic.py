"""Anisotropic materials: all 21 constants, nine along three axes, or five along and across one axis."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..arguments import Array, shown
from ..errors import MaterialError
from .material import FramedMaterial, constant


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

    def stiffness(self) -> Array:
        return np.asarray(self.voigt)


@dataclass(frozen=True, eq=False)
class Orthotropic(FramedMaterial):
    """Three planes of symmetry: the inverse of the compliance with `1/E_i`, `-nu_ij/E_i` and `1/G_ij`.

    Parameters
    ----------
    young : `(E_1, E_2, E_3)` [Pa].
    poisson : `(nu_23, nu_13, nu_12)`; `nu_ij` is the contraction along `j` under tension along `i`, so `nu_ij/E_i = nu_ji/E_j`.
    shear : `(G_23, G_13, G_12)` [Pa], in Voigt order.
    frame : material axes as columns, see `FramedMaterial`.
    density : mass density [kg/m^3].

    Each of the nine is a number, or an array with one value per element.

    Raises
    ------
    MaterialError
        for constants out of range, or that give no positive definite matrix, with element ids.

    >>> wood = Orthotropic(young=(11e9, 0.9e9, 0.5e9), poisson=(0.6, 0.45, 0.37), shear=(0.04e9, 0.7e9, 0.75e9))
    >>> wood.stiffness().shape
    (6, 6)
    """

    young: tuple[ArrayLike, ArrayLike, ArrayLike]
    poisson: tuple[ArrayLike, ArrayLike, ArrayLike]
    shear: tuple[ArrayLike, ArrayLike, ArrayLike]

    def __post_init__(self) -> None:
        for name, labels in (("young", "123"), ("poisson", ("23", "13", "12")), ("shear", ("23", "13", "12"))):
            values = getattr(self, name)
            several = isinstance(values, tuple | list) or (isinstance(values, np.ndarray) and values.ndim > 0)
            if not several or len(values) != 3:
                raise MaterialError(f"{name} = {shown(values)}; expected three entries, for {', '.join(labels)}.")
            low = -np.inf if name == "poisson" else 0.0
            named = tuple(constant(value, f"{name}_{label}", low=low) for value, label in zip(values, labels, strict=True))
            object.__setattr__(self, name, named)
        lengths = {np.shape(value) for values in (self.young, self.poisson, self.shear) for value in values} - {()}
        if len(lengths) > 1:
            raise MaterialError(
                f"The constants have different lengths: {sorted(lengths)}; expected one value per element in each array."
            )
        super().__post_init__()

    def stiffness(self) -> Array:
        constants = np.broadcast_arrays(*self.young, *self.poisson, *self.shear)
        (e1, e2, e3, nu23, nu13, nu12), shear = constants[:6], constants[6:]
        compliance = np.zeros((*e1.shape, 6, 6))
        for i, young in enumerate((e1, e2, e3)):
            compliance[..., i, i] = 1 / young
        for i, j, nu, young in ((1, 2, nu23, e2), (0, 2, nu13, e1), (0, 1, nu12, e1)):
            compliance[..., i, j] = compliance[..., j, i] = -nu / young
        for i, modulus in enumerate(shear):
            compliance[..., 3 + i, 3 + i] = 1 / modulus
        return np.linalg.inv(compliance)


@dataclass(frozen=True, eq=False)
class TransverselyIsotropic(FramedMaterial):
    """Fibres along material axis 1, the first column of `frame`; every constant a number or one value per element.

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

    def stiffness(self) -> Array:
        shear = np.asarray(self.young_transverse) / (2 * (1 + np.asarray(self.poisson_transverse)))
        return Orthotropic(
            young=(self.young_axial, self.young_transverse, self.young_transverse),
            poisson=(self.poisson_transverse, self.poisson_axial, self.poisson_axial),
            shear=(shear, self.shear_axial, self.shear_axial),
        ).stiffness()
