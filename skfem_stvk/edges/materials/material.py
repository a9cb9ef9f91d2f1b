"""Base of all materials: checked constants, a density, a frame, and the check that they fit a region."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from enum import Enum
from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...arguments import Array, Quantity, Specification, real_array, shown
from ...errors import MaterialError, name_ids


class Hypothesis(Enum):
    """Assumption on the components of strain or stress that vanish across an element."""

    SOLID = "three-dimensional"
    PLANE_STRAIN = "plane strain"
    PLANE_STRESS = "plane stress"
    UNIAXIAL_STRESS = "uniaxial stress"

    @property
    def condensed(self) -> bool:
        """Whether the stress across the element vanishes, so that the strain across it is condensed out."""
        return self in (Hypothesis.PLANE_STRESS, Hypothesis.UNIAXIAL_STRESS)


#: The parameter of all materials.
Density = Annotated[ArrayLike | None, Quantity("density", "Mass density; motion, modes and gravity need it.", gt=0)]


@dataclass(frozen=True, eq=False)
class Material(Specification):
    """A linear relation `S = C : E` of second Piola-Kirchhoff stress and Green-Lagrange strain, without a mesh."""

    density: Density = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        if self.density is not None:
            object.__setattr__(self, "density", constant(self.density, "density", low=0.0))

    def check(self, n: int, hypothesis: Hypothesis) -> None:
        """Refuse constants that do not fit a region of `n` elements under this hypothesis.

        Raises
        ------
        MaterialError
        """
        if self.density is not None:
            check_length(np.asarray(self.density), n, "density")


@dataclass(frozen=True, eq=False)
class FramedMaterial(Material, ABC):
    """A material given by constants along its own axes.

    The columns of `frame` are the material axes in global coordinates: (3, 3), or (2, 2) for axes in the plane. One frame per
    element has one more axis in front. The default is the global axes.
    """

    frame: Annotated[
        ArrayLike | None, Quantity(None, "Rows of the matrix with the material axes in its columns; by default the global axes.")
    ] = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.frame is not None:
            object.__setattr__(self, "frame", _orthonormal(self.frame))
        _refuse_indefinite(self.stiffness())

    @abstractmethod
    def stiffness(self) -> Array:
        """Elasticity matrix in material axes [Pa], Voigt order 11, 22, 33, 23, 13, 12, engineering shear: (6, 6) or (n, 6, 6)."""

    def check(self, n: int, hypothesis: Hypothesis) -> None:
        super().check(n, hypothesis)
        check_length(self.stiffness(), n, "the elasticity matrix", (6, 6))
        if self.frame is not None:
            check_length(np.asarray(self.frame), n, "frame", (3, 3))


def _orthonormal(frame: ArrayLike) -> Array:
    """Return the frame as (3, 3) or (n, 3, 3)."""
    real = real_array(frame)
    size = 2 if real is not None and real.shape[-2:] == (2, 2) else 3
    array = constant(frame, "frame", shape=(size, size))
    error = np.abs(np.swapaxes(array, -1, -2) @ array - np.eye(size)).max(axis=(-1, -2))
    if len(bad := np.flatnonzero(np.atleast_1d(error) > 1e-8)):
        where = f" in {name_ids(bad, 'element')}" if array.ndim == 3 else ""
        raise MaterialError(
            f"The columns of frame are not orthonormal{where}: frame' frame differs from the identity by {error.max():.1e}. "
            "Expected the material axes as unit vectors at right angles, one per column."
        )
    if size == 2:
        embedded = np.broadcast_to(np.eye(3), (*array.shape[:-2], 3, 3)).copy()
        embedded[..., :2, :2] = array
        return embedded
    return array


def _refuse_indefinite(stiffness: Array) -> None:
    """Refuse an elasticity matrix that is not symmetric positive definite."""
    matrices = stiffness.reshape(-1, 6, 6)
    size = np.abs(matrices).max(axis=(1, 2))
    asymmetry = np.abs(matrices - np.swapaxes(matrices, 1, 2)).max(axis=(1, 2))
    lowest = np.linalg.eigvalsh(matrices)[:, 0]
    for bad, what, cause in (
        (asymmetry > 1e-9 * size, "symmetric", "A transposed or mistyped entry?"),
        (~(lowest > 1e-14 * size), "positive definite", "Poisson's ratios too large for the moduli (nu_ij^2 < E_i/E_j must hold)?"),
    ):
        if bad.any():
            where = f" in {name_ids(np.flatnonzero(bad), 'element')}" if stiffness.ndim == 3 else ""
            detail = f"entries differ by {asymmetry.max():.2e}" if what == "symmetric" else f"lowest eigenvalue {lowest.min():.2e}"
            raise MaterialError(f"The elasticity matrix is not {what}{where} ({detail}). {cause}")


def constant(value: ArrayLike, name: str, low: float = -np.inf, high: float = np.inf, shape: tuple[int, ...] = ()) -> Array:
    """Return the constant as an array of this shape; one value per element has one more axis in front.

    A constant that is not finite, or not strictly between `low` and `high`, is refused with the element ids.
    """
    real = real_array(value)
    if real is None:
        raise MaterialError(f"{name} = {shown(value)}; expected a number, or an array with one value per element.")
    array = np.array(real)  # a copy: materials are frozen
    if not array.size or array.shape not in (shape, (len(array) if array.ndim else 0, *shape)):
        raise MaterialError(
            f"{name} has shape {array.shape}; expected {shape or 'a number'}, or one value per element: {('n', *shape)}."
        )
    _refuse(array, ~np.isfinite(array), name, "finite values", shape)
    array.flags.writeable = False
    _refuse(array, ~((array > low) & (array < high)), name, f"values in ({low:g}, {high:g})", shape)
    return array


def _refuse(array: Array, bad: NDArray[np.bool_], name: str, expected: str, shape: tuple[int, ...]) -> None:
    if not bad.any():
        return
    if array.ndim == len(shape):
        raise MaterialError(f"{name} = {np.array2string(array)}; expected {expected}.")
    ids = np.flatnonzero(bad.reshape(len(array), -1).any(axis=1))
    raise MaterialError(
        f"{name} = {array[bad][0]:g} in {name_ids(ids, 'element')}; expected {expected}. Was it set for all elements?"
    )


def check_length(array: Array, n: int, name: str, shape: tuple[int, ...] = ()) -> None:
    """Refuse an array with one value per element if there are not `n` elements."""
    if array.ndim > len(shape) and len(array) != n:
        expected = f"a single one, or one for each of the {n} elements of its region, in their order"
        raise MaterialError(f"{name} has {len(array)} values; expected {expected}.")
