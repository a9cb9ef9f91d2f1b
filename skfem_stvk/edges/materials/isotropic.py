"""Isotropic material: Young's modulus and Poisson's ratio, or a Lame pair."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike

from ...arguments import Array, Quantity
from ...errors import MaterialError
from .material import Density, Hypothesis, Material, check_length, constant


@dataclass(frozen=True, eq=False)
class Isotropic(Material):
    """Material that is the same in all directions: `S = lam tr(E) I + 2 mu E`.

    Every constant is a number, or an array with one value per element.

    Parameters
    ----------
    young
        Young's modulus [Pa], positive.
    poisson
        Poisson's ratio, in (-1, 1/2); in plane stress in (-1, 1). Segments do not use it.
    density
        Mass density [kg/m^3].

    Raises
    ------
    MaterialError
        for a constant that is not finite or out of range, with element ids.

    Examples
    --------
    >>> lam, mu = Isotropic(young=2.6, poisson=0.3).lame(Hypothesis.SOLID)
    >>> float(lam), float(mu)
    (1.5, 1.0)
    >>> float(Isotropic.from_lame(lam=1.5, mu=1.0).poisson)
    0.3
    """

    young: Annotated[ArrayLike, Quantity("stress", "Young's modulus.", gt=0)]
    poisson: Annotated[
        ArrayLike | None,
        Quantity(None, "Poisson's ratio, in solids and plane strain below 1/2; segments do without it.", gt=-1, lt=1),
    ] = None

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "young", constant(self.young, "young", low=0.0))
        if self.poisson is not None:
            object.__setattr__(self, "poisson", constant(self.poisson, "poisson", low=-1.0, high=1.0))

    @classmethod
    def from_lame(
        cls,
        lam: Annotated[ArrayLike, Quantity("stress", "First Lame constant.")],
        mu: Annotated[ArrayLike, Quantity("stress", "Shear modulus.", gt=0)],
        *,
        density: Density = None,
    ) -> Isotropic:
        """Return the isotropic material with these Lame constants [Pa]: `mu > 0` and `3 lam + 2 mu > 0`.

        Parameters
        ----------
        lam
            First Lame constant [Pa], with `3 lam + 2 mu > 0`.
        mu
            Shear modulus [Pa], positive.
        density
            Mass density [kg/m^3].

        Returns
        -------
        Isotropic
            The material with the corresponding Young's modulus and Poisson's ratio.

        Raises
        ------
        MaterialError
            for a constant that is not finite or out of range, with element ids.
        """
        lam, mu = constant(lam, "lam"), constant(mu, "mu", low=0.0)
        bulk = constant(3 * lam + 2 * mu, "3 lam + 2 mu", low=0.0)
        return cls(mu * bulk / (lam + mu), lam / (2 * (lam + mu)), density=density)

    def check(self, n: int, hypothesis: Hypothesis) -> None:
        super().check(n, hypothesis)
        check_length(np.asarray(self.young), n, "young")
        if hypothesis is Hypothesis.UNIAXIAL_STRESS:
            return
        if self.poisson is None:
            raise MaterialError(
                f"poisson = None; expected a number: {hypothesis.value} needs Poisson's ratio, only segments do not."
            )
        check_length(np.asarray(self.poisson), n, "poisson")
        if hypothesis is not Hypothesis.PLANE_STRESS:
            constant(self.poisson, f"poisson ({hypothesis.value})", low=-1.0, high=0.5)

    def lame(self, hypothesis: Hypothesis) -> tuple[Array, Array]:
        """Return the pair `(lam, mu)` [Pa] within the element's own dimensions.

        `lam = E nu/((1 + nu)(1 - 2 nu))` in solids and plane strain, `E nu/(1 - nu^2)` in plane stress; `mu = E/(2 (1 + nu))`.
        Under uniaxial stress the only modulus is `lam + 2 mu = E`, and the pair is `(E, 0)`.

        Parameters
        ----------
        hypothesis
            Components of strain or stress that vanish across the element.
        """
        young = np.asarray(self.young)
        if hypothesis is Hypothesis.UNIAXIAL_STRESS:
            return young, 0 * young
        nu = np.asarray(self.poisson)
        narrowing = 1 - nu if hypothesis is Hypothesis.PLANE_STRESS else 1 - 2 * nu
        return young * nu / ((1 + nu) * narrowing), young / (2 * (1 + nu))

    def strain_across(self, trace: Array) -> Array:
        """Return the strain (n,) across elements without stress there, `-nu/E tr S`.

        A missing Poisson's ratio counts as zero.

        Parameters
        ----------
        trace
            (n,) traces of the stress, `tr S` [Pa].
        """
        nu = np.asarray(0.0 if self.poisson is None else self.poisson)
        return -nu / np.asarray(self.young) * trace
