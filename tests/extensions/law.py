"""A toy law of elements: St. Venant-Kirchhoff's law of a material that has lost a part of its stiffness."""

from dataclasses import dataclass, field
from typing import Annotated

from skfem_stvk import StVK
from skfem_stvk.arguments import Quantity, number
from skfem_stvk.terms.laws.elastic_law import ElasticLaw


@dataclass(frozen=True, eq=False)
class Damaged(ElasticLaw):
    """Elastic body with `1 - damage` times the energy of `StVK`."""

    damage: Annotated[float, Quantity(None, "Lost fraction of the stiffness.", ge=0, lt=1)] = field(default=0.5, kw_only=True)

    def __post_init__(self, young, poisson, density):
        super().__post_init__(young, poisson, density)
        number("Damaged: damage", self.damage, "a number from 0 to 1", -1e-300, 1.0)

    def stiffness(self, mesh):
        """Return the coefficients of `StVK` on a material with less stiffness."""
        return self.of_fraction(1 - self.damage).stiffness(mesh)

    def of_fraction(self, part=1.0):
        """Return `StVK` with a fraction `part` of the stiffness."""
        law = self.material
        return StVK(young=part * law.young, poisson=law.poisson, plane=self.plane, thickness=self.thickness, region=self.region)
