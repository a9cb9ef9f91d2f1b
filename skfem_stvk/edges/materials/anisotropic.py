"""Anisotropic materials: all 21 constants, nine along three axes, or five along and across one axis."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from ...arguments import Array, Quantity, real_array, shown
from ...errors import MaterialError, name_ids
from ...mesh import MeshLike
from .material import FramedMaterial, constant

#: A value for each of three axes or planes.
Three: TypeAlias = tuple[ArrayLike, ArrayLike, ArrayLike]


@dataclass(frozen=True, eq=False)
class Anisotropic(FramedMaterial):
    """Material given by the elasticity matrix itself.

    Parameters
    ----------
    voigt
        (6, 6) or (n, 6, 6) matrix [Pa] from strains to stresses in Voigt order 11, 22, 33, 23, 13, 12 with engineering shear
        strains `2 E_23, 2 E_13, 2 E_12`; symmetric positive definite.
    density
        Mass density [kg/m^3].
    frame
        Material axes as columns, (3, 3) or, for axes in the plane, (2, 2); one frame per element has one more axis in front. By
        default the global axes.

    Raises
    ------
    MaterialError
        if the matrix is not symmetric positive definite, with element ids.

    Examples
    --------
    >>> import numpy as np
    >>> Anisotropic(np.diag([3.0, 3, 3, 1, 1, -1]))
    Traceback (most recent call last):
    skfem_stvk.errors.MaterialError: The elasticity matrix is not positive definite (lowest eigenvalue -1.00e+00). ...
    """

    voigt: Annotated[ArrayLike, Quantity("stress", "6 x 6 matrix in the order 11, 22, 33, 23, 13, 12, engineering shear.")]

    def __post_init__(self) -> None:
        object.__setattr__(self, "voigt", constant(self.voigt, "voigt", shape=(6, 6)))
        super().__post_init__()

    def stiffness(self) -> Array:
        return np.asarray(self.voigt)


@dataclass(frozen=True, eq=False)
class Orthotropic(FramedMaterial):
    """Material with three planes of symmetry: the inverse of the compliance with `1/E_i`, `-nu_ij/E_i` and `1/G_ij`.

    Each of the nine constants is a number, or an array with one value per element.

    Parameters
    ----------
    young
        Young's moduli `(E_1, E_2, E_3)` [Pa].
    poisson
        Poisson's ratios `(nu_23, nu_13, nu_12)`; `nu_ij` is the contraction along `j` under tension along `i`, so `nu_ij/E_i =
        nu_ji/E_j`.
    shear
        Shear moduli `(G_23, G_13, G_12)` [Pa], in Voigt order.
    density
        Mass density [kg/m^3].
    frame
        Material axes as columns, (3, 3) or, for axes in the plane, (2, 2); one frame per element has one more axis in front. By
        default the global axes.

    Raises
    ------
    MaterialError
        for constants out of range, or without a positive definite matrix, with element ids.

    Examples
    --------
    >>> wood = Orthotropic(young=(11e9, 0.9e9, 0.5e9), poisson=(0.6, 0.45, 0.37), shear=(0.04e9, 0.7e9, 0.75e9))
    >>> wood.stiffness().shape
    (6, 6)
    """

    young: Annotated[Three, Quantity("stress", "Moduli along the axes: E_1, E_2, E_3.", gt=0)]
    poisson: Annotated[Three, Quantity(None, "Ratios nu_23, nu_13, nu_12.")]
    shear: Annotated[Three, Quantity("stress", "Shear moduli G_23, G_13, G_12.", gt=0)]

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
    """Material with fibres along material axis 1, the first column of `frame`.

    Every constant is a number, or an array with one value per element.

    Parameters
    ----------
    young_axial, young_transverse
        Young's moduli along and across the axis [Pa].
    poisson_axial
        Contraction across under tension along the axis (nu_12 = nu_13).
    poisson_transverse
        Contraction across under tension across (nu_23).
    shear_axial
        Shear modulus of planes that contain the axis [Pa] (G_12 = G_13); the other is `E_t/(2 (1 + nu_23))`.
    density
        Mass density [kg/m^3].
    frame
        Material axes as columns, (3, 3) or, for axes in the plane, (2, 2); one frame per element has one more axis in front. By
        default the global axes.

    Raises
    ------
    MaterialError
        for constants out of range, or without a positive definite matrix, with element ids.

    Examples
    --------
    >>> ply = TransverselyIsotropic(140e9, 10e9, poisson_axial=0.3, poisson_transverse=0.4, shear_axial=5e9)
    >>> ply.stiffness().shape
    (6, 6)
    """

    young_axial: Annotated[ArrayLike, Quantity("stress", "Modulus along the fibres.", gt=0)]
    young_transverse: Annotated[ArrayLike, Quantity("stress", "Modulus across.", gt=0)]
    poisson_axial: Annotated[ArrayLike, Quantity(None, "Contraction across under tension along the fibres.")]
    poisson_transverse: Annotated[ArrayLike, Quantity(None, "Contraction across under tension across.", gt=-1, lt=1)]
    shear_axial: Annotated[ArrayLike, Quantity("stress", "Shear modulus of planes that hold the fibres.", gt=0)]

    def __post_init__(self) -> None:
        limits = {"poisson_transverse": (-1.0, 1.0), "poisson_axial": (-np.inf, np.inf)}
        for name in ("young_axial", "young_transverse", "poisson_axial", "poisson_transverse", "shear_axial"):
            object.__setattr__(self, name, constant(getattr(self, name), name, *limits.get(name, (0.0, np.inf))))
        super().__post_init__()

    @classmethod
    def from_lame(
        cls, lam: ArrayLike, mu: ArrayLike, along: ArrayLike, *, frame: ArrayLike | None = None, density: ArrayLike | None = None
    ) -> TransverselyIsotropic:
        """Return a material with Lame constants and more stiffness along its fibres.

        ::

            W = lam/2 (tr E)^2 + mu tr E^2 + along/2 (a'E a)^2

        `a` is the direction of the fibres. If the Lame constants along the fibres differ by `d_lam` and `d_mu`, the added energy is
        `d_lam/2 (a'E a)^2 + d_mu (a'E a)^2`, and `along = d_lam + 2 d_mu`. The shear stiffness along the fibres equals that across.
        `mu`, `3 lam + 2 mu` and the modulus along the fibres must be positive.

        Parameters
        ----------
        lam, mu
            Lame constants across the fibres [Pa].
        along
            Additional stiffness along the fibres [Pa].
        frame
            Material axes as columns, (3, 3) or, for axes in the plane, (2, 2); one frame per element has one more axis in front. By
            default the global axes.
        density
            Mass density [kg/m^3].

        Returns
        -------
        TransverselyIsotropic
            The material with the corresponding moduli.

        Raises
        ------
        MaterialError
            for constants out of range, or without a positive definite matrix, with element ids.

        Notes
        -----
        Picinbono, Delingette and Ayache (2003) use a law of this kind for organs with fibres; their printed formula was not found.

        Examples
        --------
        >>> fibres = TransverselyIsotropic.from_lame(1.5, 1.0, along=10.0)
        >>> fibres.stiffness().round(12)[:3, :3].tolist(), round(float(fibres.young_axial), 12)
        ([[13.5, 1.5, 1.5], [1.5, 3.5, 1.5], [1.5, 1.5, 3.5]], 12.6)
        """
        lam, mu, along = constant(lam, "lam"), constant(mu, "mu", low=0.0), constant(along, "along")
        constant(3 * lam + 2 * mu, "3 lam + 2 mu", low=0.0)
        first, both = lam + 2 * mu + along, 2 * (lam + mu)  # C_11, C_22 + C_23
        axial = constant(first - 2 * lam**2 / both, "young_axial", low=0.0)
        minor = first * (lam + 2 * mu) - lam**2
        return cls(
            young_axial=axial,
            young_transverse=2 * mu * axial * both / minor,
            poisson_axial=lam / both,
            poisson_transverse=(first * lam - lam**2) / minor,
            shear_axial=mu,
            frame=frame,
            density=density,
        )

    def stiffness(self) -> Array:
        shear = np.asarray(self.young_transverse) / (2 * (1 + np.asarray(self.poisson_transverse)))
        return Orthotropic(
            young=(self.young_axial, self.young_transverse, self.young_transverse),
            poisson=(self.poisson_transverse, self.poisson_axial, self.poisson_axial),
            shear=(shear, self.shear_axial, self.shear_axial),
        ).stiffness()


def frames_along(mesh: MeshLike, directions: ArrayLike | Callable[[Array], ArrayLike]) -> Array:
    """Return frames with first axes along a field of directions.

    They are for fibres: `TransverselyIsotropic(..., frame=...)`. The other axes are at any right angles to the first, since they do
    not matter for a material with only fibres. Directions have any length, and fibres have no sign. From directions at nodes, each
    element gets the axis along which those at its nodes are largest, in either sense.

    Parameters
    ----------
    mesh
        Mesh in two or three dimensions.
    directions
        Directions: (d,) for all elements; (nt, d), one for each; (nv, d), one at each node; or a function of the centres x (d, nt)
        of the elements that returns (d,) or (d, nt).

    Returns
    -------
    numpy.ndarray
        Frames (nt, d, d), with axes as columns.

    Raises
    ------
    MaterialError
        if they have another shape, are not finite or zero, with ids; or if there are as many nodes as elements, so that (n, d)
        is ambiguous: use a function then.

    Examples
    --------
    >>> import skfem
    >>> ring = skfem.MeshTri.init_tensor(np.linspace(1, 2, 3), np.linspace(0, 1, 3))
    >>> frames = frames_along(ring, lambda x: np.stack([-x[1], x[0]]))              # round the origin
    >>> frames.shape, bool(np.allclose(frames.transpose(0, 2, 1) @ frames, np.eye(2)))
    ((8, 2, 2), True)
    """
    if isinstance(mesh, type) or not (hasattr(mesh, "p") and hasattr(mesh, "t")):
        raise MaterialError(f"frames_along: mesh = {shown(mesh)}; expected a mesh of scikit-fem or an ElementMesh.")
    (d, nv), nt = mesh.p.shape, mesh.t.shape[1]
    if d == 1:
        raise MaterialError("frames_along: the mesh is on a line, which has only one direction. Leave the frame out.")
    raw = directions
    if callable(directions):
        try:
            raw = directions(mesh.p[:, mesh.t].mean(axis=1))
        except Exception as error:
            raise MaterialError(
                f"frames_along: the function directions failed with {type(error).__name__}: {error}. It gets x, of shape "
                f"({d}, {nt})."
            ) from error
    values = real_array(raw)
    expected = (
        f"({d},), ({nt}, {d}) for elements or ({nv}, {d}) for nodes" if not callable(directions) else f"({d},) or ({d}, {nt})"
    )
    if values is None:
        raise MaterialError(f"frames_along: directions = {shown(raw)}; expected {expected}.")
    if callable(directions) and values.shape == (d, nt):
        values = values.T
    elif not callable(directions) and nv == nt and values.shape == (nt, d):
        raise MaterialError(
            f"frames_along: directions have shape {values.shape}; expected a function of x, because the mesh has as many nodes as "
            "elements."
        )
    elif not callable(directions) and values.shape == (nv, d):
        values = _at_elements(values, mesh.t)
    elif values.shape == (d,):
        values = np.broadcast_to(values, (nt, d))
    elif callable(directions) or values.shape != (nt, d):
        raise MaterialError(f"frames_along: directions have shape {values.shape}; expected {expected}.")
    largest = np.abs(values).max(axis=1)
    bad = np.flatnonzero(~(np.isfinite(values).all(axis=1) & (largest > 0)))
    if len(bad):
        raise MaterialError(
            f"frames_along: directions are zero or not finite in {name_ids(bad, 'element')}; expected nonzero vectors."
        )
    axis = values / largest[:, None]
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    if d == 2:
        return np.stack([axis, np.stack([-axis[:, 1], axis[:, 0]], axis=1)], axis=2)
    second = np.cross(axis, np.eye(3)[np.abs(axis).argmin(axis=1)])
    second /= np.linalg.norm(second, axis=1, keepdims=True)
    return np.stack([axis, second, np.cross(axis, second)], axis=2)


def _at_elements(at_nodes: Array, t: Array) -> Array:
    """Return fibre axes (nt, d) of elements from directions (nv, d) at nodes: the main eigenvectors of the sums of their dyads."""
    bad = np.flatnonzero(~np.isfinite(at_nodes).all(axis=1))
    if len(bad):
        raise MaterialError(f"frames_along: directions are not finite at {name_ids(bad, 'node')}; expected finite vectors.")
    each = at_nodes[t]  # (n, nt, d)
    values, vectors = np.linalg.eigh(np.einsum("nti,ntj->tij", each, each))
    return np.asarray(vectors[:, :, -1] * (values[:, -1:] > 0))
