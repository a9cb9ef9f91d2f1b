"""Materials of a scene."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from ... import materials
from .quantities import Part, key

Row = Annotated[list[float], Field(min_length=2, max_length=6)]
Frame = Annotated[list[Annotated[list[float], Field(min_length=2, max_length=3)]], Field(min_length=2, max_length=3)]
Three = Annotated[list[float], Field(min_length=3, max_length=3)]
Positives = Annotated[list[Annotated[float, Field(gt=0)]], Field(min_length=3, max_length=3)]


class AnyMaterial(Part):
    """What all materials have."""

    density: Annotated[float | None, key("Mass density; motion, modes and gravity need it.", "density", gt=0)] = None


class IsotropicModel(AnyMaterial):
    """The same in all directions."""

    model: Literal["isotropic"]
    young: Annotated[float, key("Young's modulus.", "stress", gt=0)]
    poisson: Annotated[
        float | None, key("Poisson's ratio, in solids and plane strain below 1/2; segments do without it.", gt=-1, lt=1)
    ] = None

    def material(self) -> materials.Material:
        """The material of the library."""
        return materials.Isotropic(self.young, self.poisson, density=self.density)


class LameModel(AnyMaterial):
    """Isotropic, by a Lame pair."""

    model: Literal["lame"]
    lam: Annotated[float, key("First Lame constant.", "stress")]
    mu: Annotated[float, key("Shear modulus.", "stress", gt=0)]

    def material(self) -> materials.Material:
        """The material of the library."""
        return materials.Isotropic.from_lame(self.lam, self.mu, density=self.density)


class FramedModel(AnyMaterial):
    """What anisotropic materials share."""

    frame: Annotated[Frame | None, key("Rows of the matrix whose columns are the material axes; by default the global axes.")] = (
        None
    )


class OrthotropicModel(FramedModel):
    """Three planes of symmetry."""

    model: Literal["orthotropic"]
    young: Annotated[Positives, key("Moduli along the axes: E_1, E_2, E_3.", "stress")]
    poisson: Annotated[Three, key("Ratios nu_23, nu_13, nu_12.")]
    shear: Annotated[Positives, key("Shear moduli G_23, G_13, G_12.", "stress")]

    def material(self) -> materials.Material:
        """The material of the library."""
        young, poisson, shear = ((one[0], one[1], one[2]) for one in (self.young, self.poisson, self.shear))
        return materials.Orthotropic(young, poisson, shear, frame=self.frame, density=self.density)


class TransverselyIsotropicModel(FramedModel):
    """Fibres along the first axis."""

    model: Literal["transversely-isotropic"]
    young_axial: Annotated[float, key("Modulus along the fibres.", "stress", gt=0)]
    young_transverse: Annotated[float, key("Modulus across.", "stress", gt=0)]
    poisson_axial: Annotated[float, key("Contraction across under tension along the fibres.")]
    poisson_transverse: Annotated[float, key("Contraction across under tension across.", gt=-1, lt=1)]
    shear_axial: Annotated[float, key("Shear modulus of planes that hold the fibres.", "stress", gt=0)]

    def material(self) -> materials.Material:
        """The material of the library."""
        constants = self.model_dump(exclude={"model"})
        return materials.TransverselyIsotropic(**constants)


class AnisotropicModel(FramedModel):
    """The elasticity matrix itself."""

    model: Literal["anisotropic"]
    voigt: Annotated[
        list[Row], key("6 x 6 matrix in the order 11, 22, 33, 23, 13, 12, engineering shear.", "stress", min_length=6, max_length=6)
    ]

    def material(self) -> materials.Material:
        """The material of the library."""
        return materials.Anisotropic(self.voigt, frame=self.frame, density=self.density)


Material = Annotated[
    IsotropicModel | LameModel | OrthotropicModel | TransverselyIsotropicModel | AnisotropicModel, Field(discriminator="model")
]
