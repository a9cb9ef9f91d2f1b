"""Orthotropic material: engineering constants along three axes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..arguments import shown
from ..errors import MaterialError
from .material import FramedMaterial
from .values import Values, constant


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

    Each of the nine is a number, or an array with one value an element.

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
                f"The constants have different lengths: {sorted(lengths)}; expected one value an element in each array."
            )
        super().__post_init__()

    def stiffness(self) -> Values:
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
